"""Groups of similar failures: the parameter ranges that their cases share.

Failures of one ADS and one kind are joined while they are neighbours among the driven points
(single linkage in the unit box). The narrowest ranges that hold all cases of a group describe it,
for the parameters whose values it does not span, with the share of all cases in these ranges that
fail in this way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sumo_eval.cases import CaseTable, IntArray
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.trajectory import BoolArray, FloatArray

MOST_LINKED = 2_000  # failures of one kind that are compared pair by pair; more stand in one group
# Failures of k parameters are neighbours up to this times sqrt(k) steps apart (`_step`): a diagonal
# of one step each, and a margin.
APART = 1.6
SPANNED = 0.999  # share of a parameter's driven range from which on a group does not narrow it


@dataclass(frozen=True, slots=True, eq=False)
class FailureGroup:
    """Cases of one ADS that fail alike.

    ranges: parameter -> (least, most) where the group is narrower than the cases.

    places: where its cases stand among all cases, (k,), ascending.
    alike: cases in these ranges that fail so.
    inside: all cases of the ADS in them.
    """

    ads: str
    kind: str
    places: IntArray
    ranges: Mapping[str, tuple[float, float]]
    alike: int
    inside: int


def failure_kinds(cases: CaseTable) -> tuple[IntArray, list[str]]:
    """The kind of failure of each case, (n,), as a place in the list of kinds, which comes with it;
    the first kind is empty: it did not fail.

    Of several kinds of one case the last of the list counts: a contact before a departure.
    """
    words = ["", "off road", "unavoidable collision", "avoidable collision", "caused collision"]
    kinds = np.zeros(len(cases), dtype=np.intp)
    for code, flags in enumerate(
        (cases.off_road | cases.departed, cases.collided, cases.avoidable, cases.caused), 1
    ):
        kinds[flags] = code
    codes: dict[str, int] = {}
    lost = np.flatnonzero(~cases.evaluated)
    for number, status, place in zip(
        lost.tolist(), cases.status[lost], cases.error_place[lost], strict=True
    ):
        said = f"not evaluated ({status}){f' at {place}' if place else ''}"
        kinds[number] = codes.setdefault(said, len(words) + len(codes))
    return kinds, [*words, *codes]


def failure_groups(logical: LogicalScenario, cases: CaseTable) -> list[FailureGroup]:
    """The groups of one logical scenario: the gravest kinds first, and of these the largest
    groups.
    """
    groups = []
    owners, every = cases.ads, cases.parameters(logical.names)
    kinds, words = failure_kinds(cases)
    for ads in dict.fromkeys(chunk.ads for chunk in cases.chunks):
        own = np.flatnonzero(owners == ads)
        rows, failed = every[own], kinds[own]
        for kind in set(np.unique(failed).tolist()) - {0}:
            alike = failed == kind
            groups += [
                _group(logical, rows, group, alike, (ads, words[kind], own[group]))
                for group in _linked(logical, rows, np.flatnonzero(alike))
            ]
    groups.sort(key=lambda group: (_order(group.kind), -len(group.places)))
    return groups


def _order(kind: str) -> tuple[int, str]:
    """Sort key of a kind of failure: the gravest first, then by name."""
    first = ("caused", "avoidable", "not evaluated", "off road", "unavoidable")
    return next(place for place, word in enumerate(first) if kind.startswith(word)), kind


def _linked(logical: LogicalScenario, rows: FloatArray, members: np.ndarray) -> list[np.ndarray]:
    """The members of each group, as places in `rows`, the ADS's points, (n, k)."""
    if len(members) < 2 or len(members) > MOST_LINKED:
        return [members]
    # imported here: it takes half a second, and a replay never groups
    from scipy.cluster.hierarchy import fcluster, linkage

    unit = logical.to_unit(rows)
    steps = np.array([_step(column) for column in unit.T])
    tree = linkage(unit[members] / steps, method="single")
    labels = fcluster(tree, APART * np.sqrt(unit.shape[1]), criterion="distance")
    return [members[labels == label] for label in dict.fromkeys(labels.tolist())]


def _step(values: FloatArray) -> float:
    """The distance that counts as one step along a parameter: between its levels, but at least an
    eighth of its driven range.
    """
    levels = np.unique(values)
    if len(levels) < 2:
        return 1.0
    return float(max((levels[-1] - levels[0]) / 8.0, np.median(np.diff(levels))))


def _group(
    logical: LogicalScenario,
    rows: FloatArray,
    group: IntArray,
    failed: BoolArray,
    whose: tuple[str, str, IntArray],
) -> FailureGroup:
    """A group with its ranges.

    rows: all points of the ADS, (n, k).
    group: which of them are in it.
    failed: which fail so, (n,).
    whose: the ADS, the kind, and the group's places among the cases of all ADSs.
    """
    least, most = rows[group].min(axis=0), rows[group].max(axis=0)
    narrow = np.flatnonzero(most - least < SPANNED * np.ptp(rows, axis=0))
    inside = np.all((rows[:, narrow] >= least[narrow]) & (rows[:, narrow] <= most[narrow]), axis=1)
    alike, there = int(np.sum(inside & failed)), int(inside.sum())
    ranges = {logical.names[k]: (float(least[k]), float(most[k])) for k in narrow}
    return FailureGroup(*whose, ranges, alike, there)
