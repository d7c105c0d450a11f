"""Progress and stopping of long work: functions that a caller passes in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Stopping = Callable[[], bool]
"""Asked before cases are begun: whether no more of them should be."""


class Progress(Protocol):
    """Told what is being done, how much of it is done, how much there is, and how many of the done
    ones failed.
    """

    def __call__(self, stage: str, done: int, total: int, failed: int = 0) -> None:
        """Show it."""


def quiet(stage: str, done: int, total: int, failed: int = 0) -> None:
    """Shows nothing."""


def never() -> bool:
    """Goes on to the end."""
    return False
