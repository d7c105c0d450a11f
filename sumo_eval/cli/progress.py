"""Long work shows how far it is: a bar with rate, time left and failures on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import click

_LINE_EVERY = 10.0  # s between two plain lines of one stage
_RECENT = 30.0  # s by which the time that is left is estimated: the beginning of a stage says little of its rest
_TOO_EARLY = 5  # done since then below which nothing is estimated
_TOO_SHORT = 5.0  # s of work below which nothing is estimated
_WIDE = 120  # columns of a terminal with room for a long bar
_BURST = 1.0  # s within which what gets done came from one pack, and began long before


class _Burst(NamedTuple):
    """What was done within a moment. begin, end: its first and last report, s. done: of the stage, at its end."""

    begin: float
    end: float
    done: int


class Progress:
    """A context that gives the function to call with (stage, done, total, failed).

    at_most: the work may end before the total is reached, as a search does that has found what it looks for.
    """

    def __init__(self, at_most: bool = False) -> None:
        self._bar: Any = None
        self._tasks: dict[str, Any] = {}
        self._said: dict[str, float] = {}
        self._lately: dict[str, list[_Burst]] = {}
        self._under_way: set[str] = set()
        self._finished: set[str] = set()
        self._at_most = at_most
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
            from rich.progress import Progress as Bar
            from rich.table import Column

            console = Console(stderr=True)
            self._bar = Bar(
                # Where the terminal is narrow, the description goes on in a second line and all else stays whole.
                TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=False, overflow="fold")),
                BarColumn(bar_width=40 if console.width >= _WIDE else 6, table_column=Column(no_wrap=True)),
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
        self._note(stage, now, done)
        if self._bar is not None:
            if stage not in self._tasks:
                self._tasks[stage] = self._bar.add_task(stage, total=total, left="", failed="")
            self._bar.update(self._tasks[stage], completed=done, left=self._left(stage, total), failed=_failed(failed))
        elif done == total:
            if stage not in self._finished:
                self._finished.add(stage)
                _say(f"{stage}: {total} done{_behind(_failed(failed))}")
        elif now - self._said.setdefault(stage, now) >= _LINE_EVERY:
            self._said[stage] = now
            whole = f"at most {total}" if self._at_most else str(total)
            _say(f"{stage}: {done} of {whole}{_behind(self._left(stage, total))}{_behind(_failed(failed))}")

    def _note(self, stage: str, now: float, done: int) -> None:
        """Remember how far a stage was in the last half minute.

        What begins a stage is forgotten as soon as more is done: before the first cases are there, rules are compiled
        and processes start, which the rest need not wait for.
        """
        lately = self._lately.setdefault(stage, [])
        if lately and now - lately[-1].begin < _BURST:
            lately[-1] = _Burst(lately[-1].begin, now, done)
        else:
            if len(lately) == 1 and stage not in self._under_way and done > lately[0].done:
                self._under_way.add(stage)
                lately.clear()
            lately.append(_Burst(now, now, done))
        while len(lately) > 2 and now - lately[1].end > _RECENT:
            lately.pop(0)

    def _left(self, stage: str, total: int) -> str:
        """`12.0/s, about 40 s left` by how it went lately; nothing while it is too early to say, or at the end."""
        first, last = self._lately[stage][0], self._lately[stage][-1]
        if stage not in self._under_way or last.done >= total:
            return ""
        if last.done - first.done < _TOO_EARLY or last.end - first.end < _TOO_SHORT:
            return ""
        rate = (last.done - first.done) / (last.end - first.end)
        unless = " if it takes them all" if self._at_most else ""
        return f"{rate:z.1f}/s, about {_duration((total - last.done) / rate)} left{unless}"


def _say(line: str) -> None:
    with suppress(OSError):  # a full device behind stderr ends no work
        click.echo(line, err=True)


def _failed(failed: int) -> str:
    return f"{failed} failed" if failed else ""


def _behind(words: str) -> str:
    return f", {words}" if words else ""


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:z.0f} s"
    return f"{seconds / 60.0:z.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:z.1f} h"
