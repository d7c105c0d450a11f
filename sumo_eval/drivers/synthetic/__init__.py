"""Skilled synthetic drivers: a population, and the control of an ego by each of them."""
