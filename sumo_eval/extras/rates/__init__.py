"""Recordings of traffic: logical scenarios learnt from them, crash rates of ADSs, recorded scenes.

Commands `learn`, `campaign` and `humans`; also `calibrate` and `sensitivity` of scored runs.
"""

BUDGET = 40, 1_000_000  # fewest and most drives of an ADS in a scenario of a campaign
