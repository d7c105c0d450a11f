"""Importing this loads every compiled loop that ships: processes forked from one that has imported it have them at
once. On a machine whose loops are not compiled yet it loads nothing, and each process compiles what it needs.
"""

from sumo_eval.record.loops import are_ready, load

if are_ready():
    load()
