"""Scores from recorded facts: likeness of each case, terms of collisions, and the confidence of
each score.
"""
