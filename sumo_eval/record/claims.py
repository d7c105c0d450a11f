"""Outcomes of cases as a child reports them: as plain values for a frame, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sumo_eval.coded import plain, record_of
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.record.cases import Case, Outcome, Setup, Status
from sumo_eval.record.kept import KeptRecording
from sumo_eval.record.reads import File
from sumo_eval.trajectory import Alone, Clip, Collision, EndReason

STATUS: dict[EndReason, Status] = {
    "contact": "collision",
    "standstill": "ok",
    "road_end": "ok",
    "time_limit": "ok",
    "decided": "ok",
    "off_road": "off_road",
    "ads_error": "ads_error",
    "ads_timeout": "ads_timeout",
    "sim_error": "sim_error",
}
"""The status of a case by the reason why its drive ended."""

OURS = ""
"""The home of everything that runs no users' code."""

Results = list[Outcome | Alone] | None
"""Of the cases of a batch.

`Alone`: why that case has to run alone. None: cases of this kind always have to.
"""

_RECORDS = {"Alone": Alone, "Clip": Clip, "Collision": Collision}


def home(case: Case, setup: Setup) -> str:
    """Which cases may share a process: those of one locator of a user's, and all of our own
    drivers.
    """
    return home_of_ads(case.controller, setup) if case.role == "ads" else OURS


def home_of_ads(locator: str, setup: Setup) -> str:
    """The home of an ADS under test.

    A vehicle model of the user's drives with each, and makes ours the user's.
    """
    ours = locator in SHIPPED or locator.startswith("sumo:")
    return OURS if ours and setup.simulation.plant is None else f"ADS `{locator}`"


def as_plain(results: Results, reads: list[File] | None) -> list[Any]:
    """Results for a frame, without their cases.

    reads: files that their process has newly read.
    """
    if results is None:
        return [reads, None]
    rows: list[Any] = [
        result
        if isinstance(result, Alone)
        else (
            *(result.status, result.recording, result.error, result.log, result.error_place),
            result.batched,
        )
        for result in results
    ]
    return [reads, plain(rows)]


def results_of(answer: Any, cases: Sequence[Case]) -> Results:
    """The outcomes given to `as_plain`, of these cases."""
    reads, rows = answer
    if rows is None:
        return None
    results: list[Outcome | Alone] = []
    for case, row in zip(cases, record_of(rows, _RECORDS), strict=True):
        if isinstance(row, Alone):
            results.append(row)
        else:
            status, kept, *texts = row
            outcome = Outcome(case, status, kept and KeptRecording(*kept), *texts)
            results.append(replace(outcome, reads=reads))
    return results
