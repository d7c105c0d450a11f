"""The commands of `sumo-eval`, one a file; each imports what it needs when it runs."""
