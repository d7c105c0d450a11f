"""Recorded people: reading recordings, straightening them, finding events, matching them to
concrete scenarios.
"""
