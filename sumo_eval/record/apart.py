"""The contract of an ADS (see `cosim.contract`) checked where its code can do no harm: in a child
of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from sumo_eval.cosim.doors.contract import Finding, check_controller
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.doors.fault_place import fault_place
from sumo_eval.record.engines import what_happened
from sumo_eval.record.pool import Pool, Work
from sumo_eval.record.watch import interrupted
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import RunSettings
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
    """Every point of the contract, and what the ADS printed.

    Without cases: only that it can be loaded and made.

    Raises InputError when it cannot.
    """
    asked = _Asked(locator, tuple(cases), step_timeout, case_timeout)
    limits = RunSettings(case_timeout=_TIMEOUT)
    with Pool(1, limits) as pool:
        (ended,) = pool.each(Work(_checked, folder), [asked])
    if ended.how == "done":
        return [
            Finding(*(clean(text, _LONGEST, lines=True) for text in row)) for row in ended.result
        ], ended.log
    said = what_happened(ended, limits, "The check", "drove it")
    return [
        Finding(
            "FAIL", said, "an ADS must not end, hang or write into the process that it is loaded in"
        )
    ], (ended.log)


def _checked(asked: _Asked, folder: Path) -> list[tuple[str, str, str]]:
    """In the child: kind, text and what to do of each finding."""
    try:
        if not asked.cases:
            load_controller(asked.locator, folder)
            return []
        found = check_controller(
            asked.locator,
            asked.cases,
            folder=folder,
            step_timeout=asked.step_timeout,
            case_timeout=asked.case_timeout,
        )
    except KeyboardInterrupt as error:
        place = f" At {found_at}." if (found_at := fault_place(error, None, folder)) else ""
        return [("FAIL", f"ADS `{asked.locator}`: {interrupted(error)}.{place}", "end no process")]
    return [(one.kind, one.text, one.mend) for one in found]
