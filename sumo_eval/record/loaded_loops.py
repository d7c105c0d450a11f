"""Importing this loads every compiled loop that this machine has: processes forked from one that has imported it have
them at once. What is not compiled yet is compiled by the process that needs it.

The process that imports it makes the children, and takes in what a supervisor that was killed has left behind.
"""

import warnings

from sumo_eval.record.hygiene import adopt_orphans
from sumo_eval.record.loops import compiled, load

load(compiled())
adopt_orphans()
warnings.filterwarnings("ignore", "forkserver: waitpid returned unexpected pid")  # the end of what was taken in
