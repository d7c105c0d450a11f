"""Costs on this machine."""
