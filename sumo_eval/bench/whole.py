"""What a whole evaluation costs from a cold start: `sumo-eval run` in a fresh process, and where its time goes.

The command itself is measured, by the lines in which it says that a stage is done. Processor time is kept apart for
its own process and for the children that drive and compute; these are counted on Linux only, where this process can
take in what the command leaves behind.
"""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sumo_eval.errors import InputError

STAGES = (  # of the last part of a stage's name in the command's lines, and what the table calls it
    ("controllers", "start-up"),
    ("zones", "zones"),
    ("ADSs and drivers against", "D"),
    ("drivers against", "D"),
    ("human-likeness of", "D"),
    ("ADSs", "driving: ADSs"),
    ("ideal vehicle", "driving: ideal vehicle"),
    ("no reaction", "driving: no reaction"),
    ("drivers", "driving: drivers"),
    ("confidence", "other scores and confidence"),
    ("report", "report"),
)
END = "leaving"
_DONE = re.compile(r"^(?P<stage>.+): \d+ done")
_ADOPT_ORPHANS = 36  # PR_SET_CHILD_SUBREAPER of <sys/prctl.h>


@dataclass(frozen=True, slots=True)
class WholeCosts:
    """Wall time, s; processor time of the command's own process and of its children, s (None: not known); stages: wall
    time from the end of the stage before to its own, s, by name, in the order in which they were done.
    """

    wall: float
    own: float
    children: float | None
    stages: dict[str, float]


def whole_costs(evaluation: Path | None, progress: Callable[[str], None]) -> WholeCosts:
    """Run an evaluation (None: the paper's) in a fresh process, into a folder that is thrown away.

    Raises InputError when the command fails.
    """
    with tempfile.TemporaryDirectory() as folder, _orphans_adopted() as adopts:
        command = [sys.executable, "-m", "sumo_eval", "run", *([str(evaluation)] if evaluation else [])]
        began = time.perf_counter()
        running = subprocess.Popen(
            [*command, "--out", f"{folder}/run"],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        heard: list[tuple[float, str]] = []
        ear = threading.Thread(target=_listen, args=(running, began, heard, progress), daemon=True)
        ear.start()
        try:
            _, status, usage = os.wait4(running.pid, 0)
        except BaseException:  # Ctrl-C, too: it must not go on behind our back
            running.kill()
            running.wait()
            raise
        wall = time.perf_counter() - began
        running.returncode = os.waitstatus_to_exitcode(status)
        ear.join()
        if running.returncode:
            said = next((line.strip() for _, line in reversed(heard) if line.strip()), "nothing.")
            raise InputError(f"The evaluation to measure ended with status {running.returncode} and said: {said}")
        children = _left_behind(running.pid) if adopts else None
    return WholeCosts(wall, usage.ru_utime + usage.ru_stime, children, stages_of(heard, wall))


def _listen(
    running: subprocess.Popen[str], began: float, heard: list[tuple[float, str]], progress: Callable[[str], None]
) -> None:
    """Note when the command says what; its children may hold the pipe open a little longer than it lives."""
    assert running.stderr is not None
    with running.stderr as lines:
        for line in lines:
            heard.append((time.perf_counter() - began, line))
            found = _DONE.match(line)
            if found is not None:
                progress(found["stage"])


def stages_of(heard: Sequence[tuple[float, str]], wall: float) -> dict[str, float]:
    """Wall time of each stage, s, from the command's lines and when they came: the rest of `wall` is its leaving."""
    stages: dict[str, float] = {}
    last = 0.0
    for when, line in heard:
        found = _DONE.match(line)
        if found is not None:
            name = stage_name(found["stage"])
            stages[name] = stages.get(name, 0.0) + when - last
            last = when
    stages[END] = wall - last
    return stages


def stage_name(stage: str) -> str:
    """What the table calls a stage of the command."""
    part = stage.rpartition(": ")[2]
    return next((name for beginning, name in STAGES if part.startswith(beginning)), part)


def _left_behind(group: int) -> float:
    """Processor time of the processes of an ended command that are ours now, and of theirs."""
    total = 0.0
    while True:
        try:
            _, _, usage = os.wait4(-group, 0)
        except ChildProcessError:
            return total
        total += usage.ru_utime + usage.ru_stime


@contextmanager
def _orphans_adopted() -> Iterator[bool]:
    """Whether processes that lose their parent become this one's children meanwhile."""
    if sys.platform != "linux":
        yield False
        return
    library = ctypes.CDLL(None)
    adopts = library.prctl(_ADOPT_ORPHANS, 1, 0, 0, 0) == 0
    try:
        yield adopts
    finally:
        library.prctl(_ADOPT_ORPHANS, 0, 0, 0, 0)
