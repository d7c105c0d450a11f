"""Confidence of scores: intervals, risk, coverage of the sample, and the further cases that would
help most.
"""
