"""Failures that are alike: what the cases of a group have in common in their parameters, in words and as ranges.

Failures of one ADS and one kind are joined while they stand next to each other among the points that were driven
(single linkage in the unit box). A group is told by the narrowest ranges that hold all of its cases, for the parameters
whose values it does not span; beside them stands how many of all cases in these ranges fail in that way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.report.words import count, outcome
from sumo_eval.results import CaseResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.trajectory import FloatArray

MOST_GROUPS = 12  # of one logical scenario
MOST_LINKED = 2_000  # failures of one kind that are compared pair by pair; more stand in one group
APART = 1.6  # steps between neighbouring points: cases further apart than this belong to different groups
SPANNED = 0.999  # share of a parameter's driven range from which on a group does not narrow it


@dataclass(frozen=True, slots=True)
class FailureGroup:
    """Cases of one ADS that fail alike. ranges: parameter -> (least, most) where the group is narrower than the cases.

    alike: cases in these ranges that fail so. inside: all cases of the ADS in them.
    """

    ads: str
    kind: str
    cases: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    alike: int
    inside: int
    words: str


def failure_kind(case: CaseResult) -> str:
    """How a case failed, in words; empty where it did not."""
    if not case.evaluated:
        place = f" at {case.error_place}" if case.error_place else ""
        return f"not evaluated ({case.status}){place}"
    if case.collided:
        kinds = ((case.caused, "caused collision"), (case.avoidable, "avoidable collision"))
        return next((words for holds, words in kinds if holds), "unavoidable collision")
    return "off road" if outcome(case) == "off road" else ""


def failure_groups(logical: LogicalScenario, cases: Sequence[CaseResult]) -> list[FailureGroup]:
    """The groups of one logical scenario: the gravest kinds first, and of these the largest groups."""
    found = []
    for ads in dict.fromkeys(case.ads for case in cases):
        own = [case for case in cases if case.ads == ads]
        unit = logical.to_unit(np.array([logical.row(case.values) for case in own]))
        kinds = np.array([failure_kind(case) for case in own])
        for kind in sorted({*kinds.tolist()} - {""}, key=_order):
            members = np.flatnonzero(kinds == kind)
            for group in _linked(unit, members):
                found.append(_told(logical, own, group, kinds, ads, kind))
    found.sort(key=lambda group: (_order(group.kind), -len(group.cases)))
    return found[:MOST_GROUPS]


def _order(kind: str) -> tuple[int, str]:
    """Kinds of failures, the gravest first."""
    first = ("caused", "avoidable", "not evaluated", "off road", "unavoidable")
    return next(place for place, word in enumerate(first) if kind.startswith(word)), kind


def _linked(unit: FloatArray, members: np.ndarray) -> list[np.ndarray]:
    """The members of each group, as rows of `unit`."""
    if len(members) < 2 or len(members) > MOST_LINKED:
        return [members]
    from scipy.cluster.hierarchy import fcluster, linkage  # half a second that a replay does not need

    steps = np.array([_step(column) for column in unit.T])
    tree = linkage(unit[members] / steps, method="single")
    labels = fcluster(tree, APART * np.sqrt(unit.shape[1]), criterion="distance")
    return [members[labels == label] for label in dict.fromkeys(labels.tolist())]


def _step(values: FloatArray) -> float:
    """The distance that counts as one step along a parameter: between levels, or what so many points come to."""
    levels = np.unique(values)
    if len(levels) < 2:
        return 1.0
    return float(max((levels[-1] - levels[0]) / 8.0, np.median(np.diff(levels))))


def _told(
    logical: LogicalScenario, own: Sequence[CaseResult], group: np.ndarray, kinds: np.ndarray, ads: str, kind: str
) -> FailureGroup:
    rows = np.array([logical.row(case.values) for case in own])
    least, most = rows[group].min(axis=0), rows[group].max(axis=0)
    driven = np.ptp(rows, axis=0)
    narrow = [k for k in range(rows.shape[1]) if most[k] - least[k] < SPANNED * driven[k]]
    inside = np.all((rows[:, narrow] >= least[narrow]) & (rows[:, narrow] <= most[narrow]), axis=1)
    alike = int(np.sum(inside & (kinds == kind)))
    ranges = {logical.names[k]: (float(least[k]), float(most[k])) for k in narrow}
    where = ", ".join(
        f"{name} {low:z.4g}" + ("" if low == high else f" to {high:z.4g}") + logical.parameters[k].behind
        for k, (name, (low, high)) in zip(narrow, ranges.items(), strict=True)
    )
    inside_words = f"{alike} of all {count(int(inside.sum()), 'case')} there"
    words = f"{where}: {inside_words}" if where else f"anywhere in the space: {inside_words}"
    keys = tuple(own[row].case for row in group.tolist())
    return FailureGroup(ads, kind, keys, ranges, alike, int(inside.sum()), words)
