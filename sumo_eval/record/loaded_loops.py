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
    """Print the traceback of an error of any other kind than two: OSError, where the system refused
    a process, which the owner reports, and EOFError, where the owner has ended.
    """
    if not issubclass(kind, OSError | EOFError):
        sys.__excepthook__(kind, error, trace)


def _load() -> None:
    """Load what children run. Nothing of it is ever freed, so garbage collection is off meanwhile,
    and later collections in the children leave it out (`gc.freeze`).
    """
    gc.disable()
    import sumo_eval.record.worker  # noqa: F401
    from sumo_eval.record.loops import OF_EVERY_RUN, compiled, load

    if on_disk := set(OF_EVERY_RUN).intersection(compiled()):
        load(sorted(on_disk))
    gc.freeze()
    gc.enable()


# `record.children` sets it to this for the start of this process; any other value is the user's
if os.environ.get("PYTHONSAFEPATH") == "sumo_eval":
    del os.environ["PYTHONSAFEPATH"]
_load()
sys.excepthook = _report_others
