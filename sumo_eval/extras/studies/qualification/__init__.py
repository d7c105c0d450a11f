"""Whether this installation is valid on this machine: known answers, found again."""
