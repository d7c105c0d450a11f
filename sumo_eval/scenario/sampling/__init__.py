"""Choice of the points of a parameter space that become concrete scenarios."""
