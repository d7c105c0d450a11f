"""Skilled synthetic drivers: a population, and each of them at the wheel."""
