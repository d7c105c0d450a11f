"""Importing this loads every compiled loop that ships: processes forked from one that has imported it have them at
once. On a machine whose loops are not compiled yet it loads nothing, and each process compiles what it needs.

The process that imports it makes the children, and takes in what a supervisor that was killed has left behind.
"""

import warnings

from sumo_eval.record.hygiene import adopt_orphans
from sumo_eval.record.loops import are_ready, load

if are_ready():
    load()
adopt_orphans()
warnings.filterwarnings("ignore", "forkserver: waitpid returned unexpected pid")  # the end of what was taken in
