"""The human reference: a population of skilled synthetic drivers, and recorded people."""

CLOSING_SPEED = 2.0
"""Closing speed from which on a vehicle comes up to a slower one ahead, m/s. Recorded approaches
begin at it, and above it a synthetic driver is alerted.
"""
