"""Recordings of traffic: logical scenarios learnt from them, crash rates of ADSs, recorded scenes.

Commands `learn`, `campaign` and `humans`; also `calibrate` and `sensitivity` of scored runs.
"""
