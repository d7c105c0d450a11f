"""Limits on columns of cases.csv: they look at every case of an ADS in a logical scenario by
itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sumo_eval.cases import CaseResult, CaseTable
from sumo_eval.report.comparison import AdsComparison
from sumo_eval.report.gate_result import MOST_KEYS, MOST_NAMED, CaseChange, GateResult
from sumo_eval.report.gate_settings import HIGHER_COLUMNS, LimitSettings
from sumo_eval.report.words import count, point
from sumo_eval.results import ScenarioResult
from sumo_eval.trajectory import FloatArray

_FIELDS = {"d_i": "index"}  # columns called otherwise than their field


def judge_cases(
    limit: LimitSettings, cases: CaseTable, score: ScenarioResult, compared: AdsComparison | None
) -> Iterator[GateResult]:
    """Every bound of a limit on a column.

    cases: of the new run.
    compared: beside their partners in the base.
    """
    after = column(cases, limit.quantity)
    before = np.full(len(cases), np.nan)
    if compared is not None:
        paired = compared.changed.paired
        before[paired.new_rows] = column(paired.base, limit.quantity)

    for beyond, words, own in _beyond(limit, before, after):
        yield replace(_result(limit, cases, score, (before, after, beyond), words), own=own)


def column(cases: CaseTable, name: str) -> FloatArray:
    """A column of cases.csv as numbers, (n,); nan where it is empty."""
    return np.asarray(getattr(cases, _FIELDS.get(name, name)), dtype=np.float64)


def _beyond(
    limit: LimitSettings, before: FloatArray, after: FloatArray
) -> Iterator[tuple[FloatArray, str, bool]]:
    """By how much each case is beyond each bound, (n,), nan where it has no value; the bound in
    words; whether it is on the case's own value.
    """
    worse = before - after if limit.quantity in HIGHER_COLUMNS else after - before
    if limit.at_least is not None:
        yield limit.at_least - after, f"below {limit.at_least:g}", True
    if limit.at_most is not None:
        yield after - limit.at_most, f"above {limit.at_most:g}", True
    if limit.worse_by is not None:
        yield worse - limit.worse_by, f"worse by more than {limit.worse_by:g}", False
    if (percent := limit.worse_by_percent) is not None:
        yield worse - np.abs(before) * percent / 100.0, f"worse by more than {percent:g} %", False


def _result(
    limit: LimitSettings,
    cases: CaseTable,
    score: ScenarioResult,
    values: tuple[FloatArray, FloatArray, FloatArray],
    words: str,
) -> GateResult:
    """One bound.

    values: before, after, and by how much beyond the bound.
    """
    before, after, beyond = values
    where, judged = (limit.quantity, score.ads, score.scenario), int(np.isfinite(beyond).sum())
    if not judged:
        nothing = f"{limit.quantity}: no case has a value to judge"
        return GateResult(*where, None, nothing)

    scale = np.maximum(1.0, np.abs(np.where(np.isfinite(before), before, after)))
    bad = np.flatnonzero(beyond > limit.tolerance * scale)
    worst = bad[np.argsort(-beyond[bad], kind="stable")].tolist()
    named = tuple(
        _change(cases[place], before[place], after[place]) for place in worst[:MOST_NAMED]
    )
    sentence = f"{limit.quantity} is {words} in {len(bad)} of {count(judged, 'case')}"
    keys = tuple(cases[place].case for place in worst[:MOST_KEYS])
    return GateResult(*where, not len(bad), sentence, float(len(bad)), None, keys, named)


def _change(case: CaseResult, before: float, after: float) -> CaseChange:
    old = None if np.isnan(before) else float(before)
    return CaseChange(case.case, point(case.values), old, float(after))
