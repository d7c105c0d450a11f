"""How long work tells how far it is: a function that whoever runs it brings."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Told what is being done, how much of it is done, how much there is, and how many of the done ones failed."""

    def __call__(self, stage: str, done: int, total: int, failed: int = 0) -> None:
        """Show it."""


def quiet(stage: str, done: int, total: int, failed: int = 0) -> None:
    """Shows nothing."""
