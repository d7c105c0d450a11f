"""Module that the fork server imports (`record.children`), so that each child has from its start
what it runs: `record.worker`, and the compiled loops that every run needs, as far as this machine
has compiled them.

A child loads the loop of another ADS when it needs that, in 0.05 s, and first compiles a loop that
this machine has not compiled.
"""

import gc
import os
import sys
from types import TracebackType


def _report_others(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print the traceback of an error, except of two kinds. OSError: the system refused a process,
    which the owner reports. EOFError: the owner has ended.
    """
    if not issubclass(kind, OSError | EOFError):
        sys.__excepthook__(kind, error, trace)


def _load() -> None:
    """Load what children run. None of these objects is ever released: garbage collection is off
    while they are loaded, and `gc.freeze` exempts them from later collections in the children.
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
