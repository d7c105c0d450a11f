"""Processor time that simulations and computations take on this machine."""
