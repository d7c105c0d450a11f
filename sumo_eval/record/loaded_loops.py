"""Importing this loads every compiled loop that this machine has: processes forked from one that has imported it have
them at once. What is not compiled yet is compiled by the process that needs it.

The process that imports it makes the children, and takes in what a supervisor that was killed has left behind.
"""

import sys
import warnings
from types import TracebackType

from sumo_eval.record.hygiene import adopt_orphans
from sumo_eval.record.loops import compiled, load


def _in_a_sentence(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Leave a process that cannot be made to the owner, who says so in a sentence, or has gone while it was made."""
    if not issubclass(kind, OSError | EOFError):
        sys.__excepthook__(kind, error, trace)


load(compiled())
sys.excepthook = _in_a_sentence
adopt_orphans()
warnings.filterwarnings("ignore", "forkserver: waitpid returned unexpected pid")  # the end of what was taken in
