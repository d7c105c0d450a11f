"""The contract of an ADS (see `cosim.contract`) checked where its code can harm nobody: in a child of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from sumo_eval.cosim.doors.contract import Finding, check_controller
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.doors.fault_place import fault_place
from sumo_eval.errors import InputError
from sumo_eval.record.cases import Setup
from sumo_eval.record.engines import what_happened
from sumo_eval.record.frames import Message
from sumo_eval.record.pool import Ended, Pool, Work
from sumo_eval.record.watch import interrupted
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import RunSettings, SimulationSettings
from sumo_eval.text import clean

_RUN = RunSettings()
_TIMEOUT = 600.0  # s for all drives of a check
_LONGEST = 100_000  # characters of one


class _Asked(NamedTuple):
    """An ADS to check, over these cases; none: whether it can be loaded and made."""

    locator: str
    cases: tuple[ConcreteScenario, ...]
    step_timeout: float
    case_timeout: float


def check_apart(
    locator: str,
    cases: Sequence[ConcreteScenario],
    folder: Path,
    step_timeout: float = _RUN.step_timeout,
    case_timeout: float = _RUN.case_timeout,
) -> tuple[list[Finding], str]:
    """Every point of the contract, and what the ADS printed. Without cases: only that it can be loaded and made.

    Raises InputError with one sentence when it cannot.
    """
    asked = _Asked(locator, tuple(cases), step_timeout, case_timeout)
    run = RunSettings(case_timeout=_TIMEOUT)
    work: Work[_Asked] = Work(_checked, folder, lambda _, message: _read(message), str)
    waiting = iter([asked])
    with Pool(1, run.case_timeout, run.memory_limit, 1) as pool:
        (ended,) = pool.run(work, lambda: next(waiting, None), lambda ended: ended)
    if isinstance(ended.result, InputError):
        raise ended.result
    if ended.how != "done":
        said = _said(ended, Setup(SimulationSettings(), run, folder))
        return [Finding("FAIL", said, "an ADS must not end, hang or write into the process that it is loaded in")], (
            ended.log
        )
    return ended.result, ended.log


def _checked(asked: _Asked, folder: Path) -> Message:
    """In the child: the findings, or why there are none."""
    try:
        if not asked.cases:
            load_controller(asked.locator, folder)
            return Message(["found", []])
        found = check_controller(
            asked.locator,
            asked.cases,
            folder=folder,
            step_timeout=asked.step_timeout,
            case_timeout=asked.case_timeout,
        )
    except InputError as error:
        return Message(["refused", str(error)[:_LONGEST]])
    except KeyboardInterrupt as error:
        place = f" At {found_at}." if (found_at := fault_place(error, None, folder)) else ""
        return Message(["found", [["FAIL", f"ADS `{asked.locator}`: {interrupted(error)}.{place}", "end no process"]]])
    return Message(["found", [[one.kind, one.text[:_LONGEST], one.mend] for one in found]])


def _read(message: Message) -> list[Finding] | InputError:
    """The findings in a child's message."""
    kind, rows = message.plain
    if kind == "refused":
        return InputError(clean(rows, _LONGEST, lines=True))
    return [Finding(*(clean(text, _LONGEST, lines=True) for text in row)) for row in rows]


def _said(ended: Ended[_Asked], setup: Setup) -> str:
    return what_happened(ended, setup, "The check", "drove it")
