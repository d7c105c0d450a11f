"""Importing this loads every compiled loop that this machine has: processes forked from one that has imported it have
them at once. What is not compiled yet is compiled by the process that needs it.
"""

from sumo_eval.record.loops import compiled, load

load(compiled())
