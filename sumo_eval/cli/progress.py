"""Long work shows how far it is: a bar with rate, time left and failures on a terminal, plain lines
elsewhere.
"""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import click

_LINE_EVERY = 10.0  # s between two plain lines of one stage
# s by which the time that is left is estimated: the beginning of a stage says little of its rest
_RECENT = 30.0
_TOO_EARLY = 5  # done since then below which nothing is estimated
_TOO_SHORT = 5.0  # s of work below which nothing is estimated
_WIDE = 120  # columns of a terminal with room for a long bar
_BURST = 1.0  # s within which what gets done came from one pack, and began long before


class _Burst(NamedTuple):
    """Work done within a moment.

    begin, end: its first and last report, s.
    done: of the stage, at its end.
    """

    begin: float
    end: float
    done: int


class _Stage:
    """Progress of one piece of work."""

    def __init__(self, now: float) -> None:
        self.task: Any = None  # of the bar
        self.said = now  # when its last line was printed
        self.finished = False
        self._under_way = False
        self._lately: list[_Burst] = []

    def note(self, now: float, done: int) -> None:
        """Remember how far it was in the last half minute.

        Its beginning is forgotten as soon as more is done: before the first cases are there, rules
        are compiled and processes start, which the rest need not wait for.
        """
        lately = self._lately
        if lately and now - lately[-1].begin < _BURST:
            lately[-1] = _Burst(lately[-1].begin, now, done)
        else:
            if len(lately) == 1 and not self._under_way and done > lately[0].done:
                self._under_way = True
                lately.clear()
            lately.append(_Burst(now, now, done))
        while len(lately) > 2 and now - lately[1].end > _RECENT:
            lately.pop(0)

    def left(self, total: int, unless: str) -> str:
        """`12.0/s, about 40 s left` by how it went lately; nothing while it is too early to say, or
        at the end.
        """
        first, last = self._lately[0], self._lately[-1]
        done, seconds = last.done - first.done, last.end - first.end
        if not self._under_way or last.done >= total or done < _TOO_EARLY or seconds < _TOO_SHORT:
            return ""
        rate = done / seconds
        return f"{rate:z.1f}/s, about {_duration((total - last.done) / rate)} left{unless}"


class Progress:
    """A context that gives the function to call with (stage, done, total, failed).

    at_most: the work may end before the total is reached, as a search does that has found what it
        looks for.
    """

    def __init__(self, at_most: bool = False) -> None:
        self._bar: Any = None
        self._stages: dict[str, _Stage] = {}
        self._at_most, self._unless = ("at most ", " if it takes them all") if at_most else ("", "")
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
            from rich.progress import Progress as Bar
            from rich.table import Column

            console = Console(stderr=True)
            self._bar = Bar(
                # Where the terminal is narrow, the description goes on in a second line and all
                # else stays whole.
                TextColumn(
                    "{task.description}",
                    markup=False,
                    table_column=Column(no_wrap=False, overflow="fold"),
                ),
                BarColumn(
                    bar_width=40 if console.width >= _WIDE else 6, table_column=Column(no_wrap=True)
                ),
                MofNCompleteColumn(table_column=Column(no_wrap=True)),
                TextColumn("{task.fields[left]}", style="cyan"),
                TextColumn("{task.fields[failed]}", style="yellow"),
                console=console,
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
        known = self._stages.setdefault(stage, _Stage(now))
        known.note(now, done)
        left, faults = known.left(total, self._unless), f"{failed} failed" if failed else ""
        if self._bar is not None:
            if known.task is None:
                known.task = self._bar.add_task(stage, total=total, left="", failed="")
            self._bar.update(known.task, completed=done, left=left, failed=faults)
        elif done == total:
            if not known.finished:
                known.finished = True
                _say(f"{stage}: {total} done", faults)
        elif now - known.said >= _LINE_EVERY:
            known.said = now
            _say(f"{stage}: {done} of {self._at_most}{total}", left, faults)


def _say(*words: str) -> None:
    with suppress(OSError):  # a full device behind stderr ends no work
        click.echo(", ".join(filter(None, words)), err=True)


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:z.0f} s"
    return f"{seconds / 60.0:z.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:z.1f} h"
