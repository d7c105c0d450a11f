"""Slow, plain versions of clever functions, straight from the page; tests judge the clever ones by
them."""
