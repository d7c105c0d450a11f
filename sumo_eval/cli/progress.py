"""Progress of long work, for all commands: a bar with rate, time left and failures on a terminal,
plain lines elsewhere.

Users: `cli/`, `extras/figures/command.py`, `extras/rates/`, `extras/studies/`,
`extras/wheel/command.py`.
"""

import sys
import time as clock
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import click

from sumo_eval.text import duration_words

_LINE_EVERY = 10.0  # s between two plain lines of one stage
# the time left is estimated from the last 30 s: a stage may begin at another rate
_RECENT = 30.0
_FEWEST_DONE = 5  # items that must have ended in these 30 s for an estimate
_SHORTEST = 5.0  # s that must lie between the first and the last of them for an estimate
_WIDE = 120  # columns of a terminal with room for a long bar
_BURST = 1.0  # s; reports within this time are one burst, e.g. of a batch whose cases end together


class _Burst(NamedTuple):
    """Reports of progress within `_BURST`.

    begin, end: times of the first and the last report, s.
    done: number of items of the stage that were done at the end.
    """

    begin: float
    end: float
    done: int


class _StageProgress:
    """Progress of one piece of work, whose items may be cases or points."""

    def __init__(self, now: float) -> None:
        self.task: Any = None  # its task in the bar of rich
        self.line_time = now  # when its latest plain line was printed, s
        self.finished = 0  # items in its latest `done` line
        self._under_way = False  # whether an item has ended since the first report
        self._bursts: list[_Burst] = []

    def note(self, now: float, done: int) -> None:
        """Remember the bursts of the last half minute.

        The bursts before the first item that ends are dropped: during them rules are compiled and
        processes start, and items end later at another rate.
        """
        recent = self._bursts
        if recent and now - recent[-1].begin < _BURST:
            recent[-1] = _Burst(recent[-1].begin, now, done)
        else:
            if recent and not self._under_way and done > recent[0].done:
                self._under_way = True
                recent.clear()
            recent.append(_Burst(now, now, done))
        # drop the oldest burst once the second oldest lies before the half minute
        while len(recent) > 2 and now - recent[1].end > _RECENT:
            recent.pop(0)

    def left(self, total: int, unless: str) -> str:
        """`12.0/s, about 40 s left`, at the rate of the last half minute; "" before there is a
        rate, and at the end.

        unless: appended text on how the work may end sooner.
        """
        first, last = self._bursts[0], self._bursts[-1]
        done, seconds = last.done - first.done, last.end - first.end
        if not self._under_way or last.done >= total or done < _FEWEST_DONE or seconds < _SHORTEST:
            return ""
        rate = done / seconds
        return f"{rate:z.1f}/s, about {duration_words((total - last.done) / rate)} left{unless}"


class Progress:
    """A context manager that gives a function to show progress.

    The function's arguments: name of the stage, items done, their total, items that failed.

    at_most: whether the work may end before the total is reached, as a search may.
    """

    def __init__(self, at_most: bool = False) -> None:
        self._bar = _make_bar() if sys.stderr.isatty() else None
        self._stages: dict[str, _StageProgress] = {}
        self._at_most = "at most " if at_most else ""
        self._unless = " if it takes them all" if at_most else ""

    def __enter__(self) -> Callable[..., None]:
        if self._bar is not None:
            self._bar.start()
        return self._show

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _show(self, name: str, done: int, total: int, failed: int = 0) -> None:
        """Show the progress of a stage: in the bar, or as a line if the last one is old enough."""
        now = clock.monotonic()
        stage = self._stages.setdefault(name, _StageProgress(now))
        stage.note(now, done)
        left = stage.left(total, self._unless)
        faults = f"{failed} failed" if failed else ""
        if self._bar is not None:
            if stage.task is None:
                stage.task = self._bar.add_task(name, total=total, left="", failed="")
            self._bar.update(stage.task, completed=done, total=total, left=left, failed=faults)
        elif done == total:
            if stage.finished != total:
                stage.finished = total
                _say(f"{name}: {total} done", faults)
        elif now - stage.line_time >= _LINE_EVERY:
            stage.line_time = now
            _say(f"{name}: {done} of {self._at_most}{total}", left, faults)


def _make_bar() -> Any:
    """A bar of rich for the terminal, with a task for each stage.

    On a narrow terminal the description continues in a second line, and all other columns stay
    whole.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar
    from rich.table import Column

    console = Console(stderr=True)
    return Bar(
        TextColumn("{task.description}", markup=False, table_column=Column(overflow="fold")),
        BarColumn(bar_width=40 if console.width >= _WIDE else 6, table_column=Column(no_wrap=True)),
        MofNCompleteColumn(table_column=Column(no_wrap=True)),
        TextColumn("{task.fields[left]}", style="cyan"),
        TextColumn("{task.fields[failed]}", style="yellow"),
        console=console,
    )


def _say(*parts: str) -> None:
    """Print a line of the parts that are not empty."""
    with suppress(OSError):  # the work continues if stderr cannot be written
        click.echo(", ".join(filter(None, parts)), err=True)
