"""Which points of a parameter space become concrete scenarios."""
