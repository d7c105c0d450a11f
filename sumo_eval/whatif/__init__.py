"""Least changes of a case that change its outcome."""
