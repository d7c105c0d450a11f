"""Ctrl-C once: finish what runs, keep everything. Twice: stop at once, and still keep everything.

SIGTERM: running work has a few seconds to end, whatever it is; the sender mostly sends SIGKILL
next.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from sumo_eval.cli.sentences import tell

GRACE = 10.0  # s for running cases after SIGTERM


@contextmanager
def heard() -> Iterator[None]:
    """A context for imports, at whose end a Ctrl-C that came meanwhile is raised: amid an import it
    could fall into a callback of Python's own, which drops what is raised there.
    """
    signals: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: signals.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if signals:
        raise KeyboardInterrupt


class Stopping:
    """A context that gives the function to ask whether to stop; the second signal raises
    KeyboardInterrupt.
    """

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}
        self._at_last = threading.Timer(GRACE, os.kill, (os.getpid(), signal.SIGTERM))
        self._at_last.daemon = True

    def __enter__(self) -> Stopping:
        self._before = {
            number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(self, *_: object) -> None:
        self._at_last.cancel()
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        """Whether a signal has come."""
        return self._asked

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
        if number == signal.SIGTERM:
            self._at_last.start()
            then = f", in {GRACE:g} s at the latest."
        else:
            then = "; Ctrl-C once more stops at once."
        tell(f"Stopping when the running cases have ended{then}", err=True)
