"""From recordings to rates: logical scenarios learnt from traffic, and how often an ADS would crash
in them.
"""
