"""Confidence in scores: intervals, ranking, risk, coverage of the sample, and the further cases
that would narrow an interval most.
"""
