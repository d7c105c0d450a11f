"""Recordings of traffic: logical scenarios learnt from them, crash rates of ADSs, recorded scenes.

Commands `learn`, `campaign` and `humans`. `people_command` also has `calibrate` and `sensitivity`,
which work on scored runs with `extras/studies/`.
"""

BUDGET = 40, 1_000_000  # fewest and most drives of an ADS in a scenario of a campaign
