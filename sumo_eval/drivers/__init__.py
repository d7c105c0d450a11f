"""The human reference: a population of skilled synthetic drivers, and recorded people."""
