"""Check of an ADS's contract (`cosim.doors.contract`) in a child process, where its code can do no
harm. For `sumo-eval check`.

Users: `cli/tools.py`.
"""

from collections.abc import Sequence
from pathlib import Path

from sumo_eval.cosim.doors.contract import PATIENCE, Finding, check_controller
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.doors.fault_place import fault_place
from sumo_eval.record.engines import what_happened
from sumo_eval.record.pool import Pool, Work
from sumo_eval.record.watch import interrupted
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import RunSettings
from sumo_eval.text import clean

_LONGEST = 100_000  # characters of a text of a finding


def check_apart(
    locator: str, cases: Sequence[ConcreteScenario], run: RunSettings
) -> tuple[list[Finding], str]:
    """Findings on every point of the contract, and what the ADS printed.

    locator: its relative path starts in the current folder.
    cases: concrete scenarios that the ADS drives; if empty, the ADS is only loaded.
    run: time limits of its steps and cases.

    Raises InputError if it cannot be loaded.
    """
    # all cases are driven twice; each time the last case may begin just before `PATIENCE` is over
    limits = RunSettings(case_timeout=min(2.0 * (PATIENCE + run.case_timeout), 1e6))
    with Pool(1, limits) as pool:
        (ended,) = pool.each(
            Work(_checked, (Path.cwd(), run), _findings), [(locator, tuple(cases))]
        )
    if ended.how == "done":
        return ended.result, ended.log
    happened = what_happened(ended, limits, "The check", "drove it")
    fix = "an ADS must not end, hang or write into the process that it is loaded in"
    return [Finding("FAIL", happened, fix)], ended.log


def _findings(rows: Sequence[Sequence[str]], asked: object) -> list[Finding]:
    """The findings that `_checked` has sent as texts."""
    return [Finding(*(clean(text, _LONGEST, lines=True) for text in row)) for row in rows]


def _checked(
    asked: tuple[str, Sequence[ConcreteScenario]], shared: tuple[Path, RunSettings]
) -> list[tuple[str, str, str]]:
    """In the child: kind, text and what to do of each finding."""
    (locator, cases), (folder, run) = asked, shared
    try:
        if not cases:
            load_controller(locator, folder)
            return []
        findings = check_controller(
            locator,
            cases,
            folder=folder,
            step_timeout=run.step_timeout,
            case_timeout=run.case_timeout,
        )
    except KeyboardInterrupt as error:
        place = f" At {at}." if (at := fault_place(error, None, folder)) else ""
        return [("FAIL", f"ADS `{locator}`: {interrupted(error)}.{place}", "end no process")]
    return [(finding.kind, finding.text, finding.mend) for finding in findings]
