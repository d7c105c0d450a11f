"""Reaction to signals. The first Ctrl-C: finish the running cases, keep everything. The second:
stop at once, and still keep everything.

SIGTERM: the running cases have `GRACE` to end, since its sender mostly sends SIGKILL next.

Users: `cli/compare.py`, `cli/run.py`, `extras/studies/trials.py`.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from sumo_eval.cli.sentences import tell

GRACE = 10.0  # s for running cases after SIGTERM


@contextmanager
def heard() -> Iterator[None]:
    """Context for imports: for a Ctrl-C or SIGTERM in it, KeyboardInterrupt is raised at its end.

    Raised during an import, the exception could end in a callback of Python's own, which drops it.
    """
    signals = []
    with _handled(lambda number, frame: signals.append(number)):
        yield
    if signals:
        raise KeyboardInterrupt


@contextmanager
def stop_on_signal() -> Iterator[Callable[[], bool]]:
    """Context whose value is a function: whether a signal has come, after which work should stop.
    The second signal raises KeyboardInterrupt.
    """
    signals: list[int] = []
    # SIGTERM starts this timer, which sends a second SIGTERM; that stops at once
    last_signal = threading.Timer(GRACE, os.kill, (os.getpid(), signal.SIGTERM))
    last_signal.daemon = True

    def ask(number: int, frame: FrameType | None) -> None:
        if signals:
            raise KeyboardInterrupt
        signals.append(number)
        ending = "; Ctrl-C once more stops at once."
        if number == signal.SIGTERM:
            last_signal.start()
            ending = f", in {GRACE:g} s at the latest."
        tell(f"Stopping when the running cases have ended{ending}", err=True)

    with _handled(ask):
        try:
            yield lambda: bool(signals)
        finally:
            last_signal.cancel()
    if signals:  # also after the last case: the steps that follow may take as long as the cases
        raise KeyboardInterrupt


@contextmanager
def _handled(handle: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """A context in which a function handles Ctrl-C and SIGTERM."""
    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
