"""What would have had to be different in a case."""
