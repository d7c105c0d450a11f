"""Importing this loads what child processes run, and the compiled loops that every run needs, where
this machine has them: processes forked from one that has imported it have them at once. Who else
drives is loaded by the process that needs it, in the twentieth of a second, and what is not
compiled yet is compiled by it.
"""

import gc
import os
import sys
from types import TracebackType


def _report_others(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Leave a process that cannot be made to the owner, which reports it or has ended."""
    if not issubclass(kind, OSError | EOFError):
        sys.__excepthook__(kind, error, trace)


def _load() -> None:
    """Without looks for garbage: all of it stays, and is left out when a child looks for its
    own.
    """
    gc.disable()
    import sumo_eval.record.worker  # noqa: F401
    from sumo_eval.record.loops import OF_EVERY_RUN, compiled, load

    if known := set(OF_EVERY_RUN).intersection(compiled()):
        load(sorted(known))
    gc.freeze()
    gc.enable()


if os.environ.get("PYTHONSAFEPATH") == "sumo_eval":  # for the start of this process alone
    del os.environ["PYTHONSAFEPATH"]
_load()
sys.excepthook = _report_others
