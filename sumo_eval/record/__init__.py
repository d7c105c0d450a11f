"""Driving of many cases: their plan, the engines that run them, and the store that keeps their
facts.
"""
