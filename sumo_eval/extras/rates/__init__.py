"""Crash rates from recordings: logical scenarios learnt from traffic, and how often an ADS would
crash in them.
"""
