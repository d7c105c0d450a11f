"""Rooms that the six steps of the paper and the three main uses do not need; the core never imports
it.
"""
