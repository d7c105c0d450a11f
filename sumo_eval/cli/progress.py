"""Long work shows how far it is: a bar with rate, time left and failures on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import click

_LINE_EVERY = 10.0  # s between two plain lines of one stage
_RECENT = 30.0  # s by which the time that is left is estimated: the beginning of a stage says little of its rest
_TOO_EARLY = 5  # done since then below which nothing is estimated


class Progress:
    """A context that gives the function to call with (stage, done, total, failed)."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._tasks: dict[str, Any] = {}
        self._began: dict[str, tuple[float, int]] = {}
        self._said: dict[str, float] = {}
        self._lately: dict[str, list[tuple[float, int]]] = {}
        self._finished: set[str] = set()
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            self._bar = Bar(
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[rate]}"),
                TimeRemainingColumn(),
                TextColumn("{task.fields[failed]}", style="yellow"),
                console=Console(stderr=True),
            )

    def __enter__(self) -> Callable[..., None]:
        if self._bar is not None:
            self._bar.start()
        return self._show

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _show(self, stage: str, done: int, total: int, failed: int = 0) -> None:
        now = clock.monotonic()
        self._note(stage, now, done)
        began, first = self._began.setdefault(stage, (now, done))
        rate = (done - first) / (now - began) if now > began else 0.0
        if self._bar is not None:
            if stage not in self._tasks:
                self._tasks[stage] = self._bar.add_task(stage, total=total, rate="", failed="")
            shown_rate = f"{rate:z.0f}/s" if rate else ""
            shown_failed = f"{failed} failed" if failed else ""
            self._bar.update(self._tasks[stage], completed=done, rate=shown_rate, failed=shown_failed)
        elif done == total:
            if stage not in self._finished:
                self._finished.add(stage)
                _say(f"{stage}: {total} done{_failed(failed)}")
        elif now - self._said.setdefault(stage, now) >= _LINE_EVERY:
            self._said[stage] = now
            _say(f"{stage}: {done} of {total}{self._left(stage, total)}{_failed(failed)}")

    def _note(self, stage: str, now: float, done: int) -> None:
        """Remember how far a stage was in the last half minute."""
        lately = self._lately.setdefault(stage, [])
        lately.append((now, done))
        while len(lately) > 2 and now - lately[1][0] > _RECENT:
            lately.pop(0)

    def _left(self, stage: str, total: int) -> str:
        """`, 12.0/s, about 40 s left` by how it went lately; nothing while it is too early to say."""
        (begin, first), (end, done) = self._lately[stage][0], self._lately[stage][-1]
        if done - first < _TOO_EARLY or end <= begin:
            return ""
        rate = (done - first) / (end - begin)
        return f", {rate:z.1f}/s, about {_duration((total - done) / rate)} left"


def _say(line: str) -> None:
    with suppress(OSError):  # a full device behind stderr ends no work
        click.echo(line, err=True)


def _failed(failed: int) -> str:
    return f", {failed} failed" if failed else ""


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:z.0f} s"
    return f"{seconds / 60.0:z.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:z.1f} h"
