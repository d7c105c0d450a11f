"""Module that the fork server imports (`record.children`), so that each child has at once what it
runs: `record.worker`, and the compiled loops that every run needs, if this machine has them.

A child loads the loop of any other ADS when it needs it, in 0.05 s, and compiles it first if this
machine has not.
"""

import gc
import os
import sys
from types import TracebackType


def _report_others(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print the traceback of an error, unless the system refused a process: the owner reports
    that, or has ended.
    """
    if not issubclass(kind, OSError | EOFError):
        sys.__excepthook__(kind, error, trace)


def _load() -> None:
    """Load all of it. Garbage collection is off meanwhile, because all of it stays; the collections
    of children leave it out (`gc.freeze`).
    """
    gc.disable()
    import sumo_eval.record.worker  # noqa: F401
    from sumo_eval.record.loops import OF_EVERY_RUN, compiled, load

    if on_disk := set(OF_EVERY_RUN).intersection(compiled()):
        load(sorted(on_disk))
    gc.freeze()
    gc.enable()


if os.environ.get("PYTHONSAFEPATH") == "sumo_eval":  # for the start of this process alone
    del os.environ["PYTHONSAFEPATH"]
_load()
sys.excepthook = _report_others
