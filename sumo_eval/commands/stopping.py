"""Ctrl-C once: finish what runs, keep everything. Twice: stop at once, and still keep everything. SIGTERM likewise."""

from __future__ import annotations

import signal
from types import FrameType, TracebackType
from typing import Any

import click

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopping:
    """A context that gives the function to ask whether to stop; the second signal raises KeyboardInterrupt."""

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Stopping:
        self._before = {number: signal.signal(number, self._ask) for number in _SIGNALS}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        """Whether a signal has come."""
        return self._asked

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
        click.echo("Stopping when the running cases have ended; Ctrl-C once more stops at once.", err=True)
