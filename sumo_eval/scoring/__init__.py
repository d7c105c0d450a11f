"""Scores from recorded facts: D_i, harm and measures of each case, the scores of each ADS, and
their intervals. `scoring/steps.py` has the order of the work.
"""
