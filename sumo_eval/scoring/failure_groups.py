"""Groups of similar failures, for the report: the parameter ranges that their cases share.

Failures of one ADS and one kind belong to one group if a chain of neighbours joins their points
(single linkage in the unit box). A group is described by two things: the narrowest ranges that hold
all its cases, of those parameters whose driven range it does not fill; and the share of all cases
in these ranges that fail in this way.

Users: `report/page_data.py`. Free to change: the limits below. The words of kinds are not: groups
are sorted by a kind's first word, and `templates/report.js` cuts its filter out of a kind.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.trajectory import FloatArray, IntArray

# Order of groups, the gravest kind first. The first word of a kind decides its place: `caused
# collision` has that of "caused".
GRAVEST_FIRST = "caused", "avoidable", "collision", "not evaluated", "off road", "unavoidable"
MOST_LINKED = 2_000  # most failures of one kind that are compared pair by pair; more form one group
# Points of k parameters are neighbours if their distance in steps (`_step`) is at most this times
# sqrt(k). One step in every parameter is a distance of sqrt(k); the factor 1.6 leaves a margin.
NEIGHBOUR_DISTANCE = 1.6
SPANNED = 0.999  # a group that covers this share of a parameter's driven range fills the range


class FailureGroup(NamedTuple):
    """Cases of one ADS that fail in one way and are neighbours.

    kind: of the failure, in words.
    places: indices of its m cases among all cases, (m,), ascending.
    ranges: parameter -> (least, most), for parameters whose driven range the group does not fill.
    alike: number of cases of the ADS in these ranges that fail in this way.
    inside: number of all cases of the ADS in these ranges.
    """

    ads: str
    kind: str
    places: IntArray
    ranges: Mapping[str, tuple[float, float]]
    alike: int
    inside: int


def failure_kinds(cases: CaseTable) -> tuple[IntArray, list[str]]:
    """The kind of failure of each case, (n,), as an index of a list of kinds, and this list.

    The first kind is the empty word: the case did not fail. If several kinds fit a case, the last
    of them in the list counts, so that a collision hides a departure. The list does not have the
    order of `GRAVEST_FIRST`. A collision is plain `collision` if it is not known whether the ideal
    vehicle collides.
    """
    flags = {"off road": cases.off_road | cases.departed, "collision": cases.collided}
    for kind in ("unavoidable", "avoidable", "caused"):
        flags[f"{kind} collision"] = getattr(cases, kind)
    kinds, codes = np.zeros(len(cases), np.intp), {"": 0}
    for kind, flag in flags.items():  # a later kind replaces an earlier one
        kinds[flag] = codes.setdefault(kind, len(codes))
    missing = np.flatnonzero(~cases.evaluated)
    for case, status, place in zip(
        missing.tolist(), cases.status[missing], cases.error_place[missing], strict=True
    ):
        kind = f"not evaluated ({status}){f' at {place}' if place else ''}"
        kinds[case] = codes.setdefault(kind, len(codes))
    return kinds, list(codes)


def failure_groups(logical: LogicalScenario, cases: CaseTable) -> list[FailureGroup]:
    """The groups of one logical scenario: the gravest kind first, and within a kind the largest
    group first.
    """
    groups = []
    ads_of_case, points = cases.ads, cases.parameters(logical.names)
    kinds, words = failure_kinds(cases)
    for ads in dict.fromkeys(chunk.ads for chunk in cases.chunks):
        places = np.flatnonzero(ads_of_case == ads)
        own_points = points[places]
        for kind in set(np.unique(kinds[places]).tolist()) - {0}:
            failed = kinds[places] == kind  # whether each case of the ADS fails in this way
            for members in _linked(logical, own_points, np.flatnonzero(failed)):
                least, most = own_points[members].min(axis=0), own_points[members].max(axis=0)
                narrow = np.flatnonzero(most - least < SPANNED * np.ptp(own_points, axis=0))
                ranges = {logical.names[k]: (float(least[k]), float(most[k])) for k in narrow}
                values = own_points[:, narrow]
                inside = np.all((values >= least[narrow]) & (values <= most[narrow]), axis=1)
                alike = int(np.sum(inside & failed))
                groups.append(
                    FailureGroup(
                        ads, words[kind], places[members], ranges, alike, int(inside.sum())
                    )
                )
    rank = {kind.split()[0]: index for index, kind in enumerate(GRAVEST_FIRST)}
    groups.sort(key=lambda group: (rank[group.kind.split()[0]], group.kind, -len(group.places)))
    return groups


def _linked(logical: LogicalScenario, points: FloatArray, failed: IntArray) -> list[IntArray]:
    """The failures of each group, as indices of `points`.

    points: of all cases of the ADS, (n, k), in the parameters' units.
    failed: indices of the points at which the ADS fails in one way.
    """
    if len(failed) < 2 or len(failed) > MOST_LINKED:
        return [failed]
    # imported here: scipy's clustering takes half a second, and a replay makes no groups
    from scipy.cluster.hierarchy import fcluster, linkage

    unit = logical.to_unit(points)
    steps = np.array([_step(column) for column in unit.T])
    tree = linkage(unit[failed] / steps, method="single")
    labels = fcluster(tree, NEIGHBOUR_DISTANCE * np.sqrt(unit.shape[1]), criterion="distance")
    # groups in the order of their first cases
    return [failed[labels == label] for label in dict.fromkeys(labels.tolist())]


def _step(values: FloatArray) -> float:
    """Length of one step along a parameter, unit-box length: the median distance of neighbouring
    levels, but at least an eighth of the driven range; 1 if there is one level.

    values: of the parameter at all points, in the unit box, (n,).
    """
    levels = np.unique(values)
    if len(levels) < 2:
        return 1.0
    return float(max((levels[-1] - levels[0]) / 8.0, np.median(np.diff(levels))))
