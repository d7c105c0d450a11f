"""Working off many cases: what a case is, the engines that run them, and the store that keeps what
happened.
"""
