"""From recorded facts to scores: likeness of each case, terms of collisions, and how far a score
can be trusted.
"""
