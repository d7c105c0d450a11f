"""Claims of a child process about its cases: outcomes as plain values for a frame of its pipe, and
back; and which cases may share a child.

Users: `record/engines.py`, `record/estimate.py`, `record/recording.py`, `record/worker.py`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from operator import attrgetter
from typing import Any

from sumo_eval.coded import plain, record_of
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.cosim.doors.entry import split_entry
from sumo_eval.record.cases import Case, Outcome, Setup, Status, on_its_own
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

NO_USER_CODE = ""
"""Affinity of all cases that run no users' code."""

Results = list[Outcome | Alone] | None
"""Results of the cases of a batch.

`Alone`: why that case has to be driven alone. None: cases of this kind always have to.
"""

_RECORDS = {"Alone": Alone, "Clip": Clip, "Collision": Collision}


def affinity(case: Case, setup: Setup) -> str:
    """Name of the group of cases that may share a process: those of one user's ADS, or all that run
    no users' code.

    Drivers and references are never driven with the user's vehicle model: they run no users' code.
    """
    return affinity_of_ads(case.controller, setup) if case.role == "ads" else NO_USER_CODE


def affinity_of_ads(locator: str, setup: Setup) -> str:
    """Affinity of the cases of an ADS under test.

    With a user's vehicle model (`plant`) users' code runs in every drive: then a shipped ADS has an
    affinity of its own too.
    """
    ships = split_entry(locator)[0] in SHIPPED or locator.startswith("sumo:")
    return NO_USER_CODE if ships and setup.simulation.plant is None else f"ADS `{locator}`"


def as_plain(results: Results, reads: list[File] | None) -> list[Any]:
    """Results for a frame, without their cases.

    reads: files that their process has newly read.
    """
    fields = attrgetter("status", "recording", "error", "log", "error_place", "batched")
    if results is None:
        return [reads, None]
    rows = [result if isinstance(result, Alone) else fields(result) for result in results]
    return [reads, plain(rows)]


@cache
def _fields_of_row() -> Any:
    """Adapter that checks the fields of an `Outcome`, as `as_plain` sends them."""
    from pydantic import TypeAdapter  # here, because children need not load it

    return TypeAdapter(tuple[Status, KeptRecording | None, str | None, str, str, str])


def results_of(answer: Any, cases: Sequence[Case]) -> Results:
    """Results of `cases` from a frame: the inverse of `as_plain`. Fails if the answer is not of its
    form.
    """
    reads, rows = answer
    together = not on_its_own(cases)  # a case on its own always has an outcome
    if rows is None and together:
        return None
    results: list[Outcome | Alone] = []
    for case, row in zip(cases, record_of(rows, _RECORDS), strict=True):
        if isinstance(row, Alone) and together:
            results.append(row)
        else:
            outcome = Outcome(case, *_fields_of_row().validate_python(row))
            results.append(replace(outcome, reads=reads))
    return results
