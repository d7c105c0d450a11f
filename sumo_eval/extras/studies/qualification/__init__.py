"""Qualification of this installation on this machine: known answers, found again."""
