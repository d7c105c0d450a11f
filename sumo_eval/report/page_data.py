"""Data of the page's JavaScript: cases, zone maps, groups and roads, packed to be small.

`scoring/shown_cases.py` chooses the cases of a large run, `report/sent_drives.py` the drives.
Fixed: keys, which `templates/report.js` and `templates/replay.js` read.

Users: `extras/figures/of_scenes.py`, `extras/wheel/page.py`, `report/html.py`, `report/replay.py`.
"""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from math import isfinite

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.groups import grouped
from sumo_eval.method.zone_partition import ZonePartition
from sumo_eval.report.notes import index_note_words, why_missing
from sumo_eval.report.page import Json, packed_bytes
from sumo_eval.report.sent_drives import CHANNEL_STEPS, SentDrives
from sumo_eval.report.words import LOOKS, MEASURES, cause_words, count, end_reason
from sumo_eval.results import Evaluation
from sumo_eval.scenario.bodies import CAR
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.road.reference_line import knots_of
from sumo_eval.scoring.drive_results import finite
from sumo_eval.scoring.failure_groups import FailureGroup, failure_groups
from sumo_eval.scoring.findings import findings_of, mean_of
from sumo_eval.scoring.map_view import (
    GATHERED_PANELS,
    MOST_PANELS,
    View,
    choose_view,
    telling_slice,
)
from sumo_eval.scoring.preventability import verdicts
from sumo_eval.scoring.zone_levels import lattice_points, map_points, zone_levels
from sumo_eval.trajectory import FloatArray, IntArray

MOST_GROUPS = 12  # of failures of an ADS in a scenario
EmbeddedCase = tuple[CaseResult, Json]
"""A case that the page has, and what the page says of it in addition to its row."""


def page_data(
    evaluation: Evaluation,
    partitions: Mapping[str, ZonePartition],
    embedded: Mapping[str, Sequence[EmbeddedCase]],
    sent_drives: Callable[[], SentDrives],
) -> Json:
    """Everything the page draws, as plain JSON values.

    embedded: the cases of the page, by scenario.
    sent_drives: gives the drives of the page; called last, because a thread prepares them.
    """
    scenarios = [_scenario(evaluation, partitions[name], cases) for name, cases in embedded.items()]
    sent = sent_drives()
    for scenario in scenarios:
        drives = sent.scenarios[scenario["name"]]
        scenario |= {"trajectories": drives.trajectories, "drivers": drives.drivers}
        for row, recorded in zip(scenario["cases"], drives.rows, strict=True):
            row |= recorded
    return {
        "field": asdict(evaluation.settings.method.anthropomorphic.field),
        "channels": CHANNEL_STEPS,
        "folder": shlex.quote(str(evaluation.folder)),
        "severityUnit": evaluation.settings.method.collision.unit,
        "verdicts": {verdict: look._asdict() for verdict, look in LOOKS.items()},
        "embedded": len(sent.embedded.points),
        "embeddedDrivers": len(sent.embedded.with_drivers),
        "scenarios": scenarios,
    }


def embedded_cases(
    evaluation: Evaluation, shown: Mapping[str, IntArray]
) -> dict[str, list[EmbeddedCase]]:
    """The cases that the page has, by scenario, and within a scenario ADS by ADS.

    shown: by scenario, indices of these cases among those of an ADS, the same for all ADSs.
    """
    embedded: dict[str, list[EmbeddedCase]] = {zone.scenario: [] for zone in evaluation.zones}
    for findings in findings_of(evaluation):
        missing, verdict_of = findings.missing, verdicts(evaluation, findings.score)
        ratios, lost_of_c, lost_of_a = findings.terms.ratio, findings.lost_of_c, findings.share_lost
        # `shown` is the same for all ADSs: an index may be beyond the cases of one of them
        indices = shown[findings.score.scenario]
        for row in indices[indices < len(findings.cases)].tolist():
            case = findings.cases[row]
            details = {
                "missing": why_missing(case) if missing[row] else None,
                "avoided": finite(ratios[row]),  # Ug / U, or Lg / L, of Eq. 17
                "lost": finite(lost_of_c[row]),
                "aLost": finite(lost_of_a[row]) if case.incident else None,
                "verdict": str(verdict_of[row]),
            }
            embedded[findings.score.scenario].append((case, details))
    return embedded


def _scenario(
    evaluation: Evaluation, zones: ZonePartition, embedded: Sequence[EmbeddedCase]
) -> Json:
    """All that the page has of a scenario, except its drives."""
    logical = zones.logical
    cases = evaluation.cases_in(logical.name)
    view = choose_view(logical, cases, evaluation.settings.report.axes.get(logical.name))
    telling = telling_slice(view, cases)
    # maps are drawn in the slice at which the page opens: the most telling one, if there is one
    drawn = view._replace(fixed=telling or view.fixed)
    rows = [_case(case, logical.row(case.values)) | details for case, details in embedded]
    scores = evaluation.scores_in(logical.name)
    by_ads = {score.ads: evaluation.cases_behind(score) for score in scores}
    lattice = lattice_points(logical)
    return {
        "name": logical.name,
        "parameters": [
            {"name": item.name, "unit": item.unit_suffix.strip(), "low": item.low,
             "high": item.high}
            for item in logical.parameters
        ],
        "ads": list(by_ads),
        "meanIndex": {ads: mean_of(own.index, own.exposure) for ads, own in by_ads.items()},
        "road": drawn_road(logical.road),
        "bodies": drawn_bodies(logical.concrete(**cases[0].values)) if len(cases) else {},
        "view": {
            "x": view.x, "y": view.y, "panel": view.panel, "panels": view.panels,
            "fixed": drawn.fixed, "slice": telling, "mostPanels": MOST_PANELS,
            "gatheredPanels": GATHERED_PANELS
        },
        "maps": [
            zone_map(zones, drawn, panel) for panel in range(len(view.panels))
        ],
        # over the whole space: the page draws any slice from it
        "lattice": lattice and {"size": lattice[0]} | _packed(zones, lattice[1]),
        **_groups(logical, cases, {row["key"] for row in rows}),
        "mostDangerous": [
            {"values": logical.row(values).tolist()} for values in zones.most_dangerous
        ],
        "cases": rows
    }  # fmt: skip


def _groups(logical: LogicalScenario, cases: CaseTable, keys: set[str]) -> Json:
    """Groups of failures, at most MOST_GROUPS of each ADS, and how many more there are.

    keys: of the cases that the page has. A group names only these, but its size counts all.
    """
    groups, names = failure_groups(logical, cases), cases.case
    of_ads = grouped((group.ads, group) for group in groups)
    listed = [group for own in of_ads.values() for group in own[:MOST_GROUPS]]
    entries = [
        {
            "ads": group.ads, "kind": group.kind, "words": _group_words(group, logical),
            "ranges": group.ranges, "size": len(group.places),
            "cases": [key for key in names[group.places].tolist() if key in keys]
        }
        for group in listed
    ]  # fmt: skip
    return {"groups": entries, "moreGroups": len(groups) - len(listed)}


def _group_words(group: FailureGroup, logical: LogicalScenario) -> str:
    """Ranges of a group, and the share of all cases there that fail like it."""
    suffixes = {item.name: item.unit_suffix for item in logical.parameters}
    where = ", ".join(
        f"{name} {low:z.4g}{'' if low == high else f' to {high:z.4g}'}{suffixes[name]}"
        for name, (low, high) in group.ranges.items()
    )
    share = f"{group.alike} of all {count(group.inside, 'case')} there"
    words = "the only case there" if group.inside == 1 else share
    return f"{where or 'anywhere in the space'}: {words}"


_UNCHANGED = (
    "ads", "zone", "exposure", "status", "outcome", "error", "error_place", "impact_speed",
    "overlap", "side",
    "severity", "loss", "ideal_severity", "no_reaction_severity", "human_likeness",
    "likeness_length_factor", "operation_tolerance",
    "mixture_similarity", "plausibility", "weight", "index", "length_factor", "operation_factor",
    "similarity", "clips"
)  # fmt: skip
"""Fields of a case that the page holds unchanged."""


def _case(case: CaseResult, values: FloatArray) -> Json:
    """One case; the page computes none of this again.

    values: of its parameters, in the order of the scenario, (k,).
    """
    measures = [(label, getattr(case, name), unit) for name, label, unit in MEASURES]
    return {name: getattr(case, name) for name in _UNCHANGED} | {
        "key": case.case,
        "values": values.tolist(),
        "end": end_reason(case),
        "cause": cause_words(case),
        "time": case.simulated_time,
        "latency": case.latency_max,
        "kind": "undecided" if case.kind == "not known" else case.kind,
        "index_note": index_note_words(case),
        "ttc": case.min_ttc,
        "measures": [measure for measure in measures if measure[1] is not None],
    }


# --- maps -----------------------------------------------------------------------------------------


def map_words(view: View) -> str:
    """`gap against obstacle_speed, one panel for each ego_speed`."""
    words = view.names[view.x]
    if view.y is not None:
        words = f"{view.names[view.y]} against {words}"
    if view.panel is not None:
        words += f", one panel for each {view.names[view.panel]}"
    return words


def gathered_words(view: View) -> str:
    """Note on the cases of a panel that have another value than the panel; empty without any."""
    if view.panel is None or not view.gathered:
        return ""
    return f"Each case is drawn in the panel whose {view.names[view.panel]} is nearest to its own."


def zone_map(zones: ZonePartition, view: View, panel: int) -> Json:
    """The zones at the corners of cells over x and y (y slowest)."""
    axes, points = map_points(zones.logical, view, panel)
    return axes | _packed(zones, points)


def _packed(zones: ZonePartition, points: FloatArray) -> Json:
    """The zones at some points: learnt, exact, and the room that each constraint leaves."""
    gp, exact, *rooms = (packed_bytes(it.tobytes()) for it in zone_levels(zones, points))
    return {"gp": gp, "exact": exact, "rooms": rooms}


# --- roads ----------------------------------------------------------------------------------------


def drawn_road(road: Road) -> Json:
    """A road as pages draw it."""
    return {
        "end": road.length, "left": road.left_edge, "right": road.right_edge, "lanes": road.lanes,
        "laneWidth": road.lane_width, "line": drawn_line(road), **drawn_shape(road)
    }  # fmt: skip


def drawn_shape(road: Road) -> Json:
    """Parts of a road without the same lanes throughout, as pages draw it.

    gone: where an outermost lane is missing, four points [x, y], m, of which the last three are the
        edge of the road there.
    solid: lines that no vehicle may cross, [first x, last x, y], m.
    crossings: [x, width, length to each side], m.
    """
    gone = []
    solid = []
    last = road.length + road.run_out
    for span in road.spans:
        # x, m, where the lane begins to widen, is open, begins to narrow, and is gone; not finite:
        # it is there from the road's start, or to its end
        opening, closing = span.places[:2], span.places[2:]
        middle, half = road.lane_centre(span.lane), 0.5 * road.lane_width
        side = -half if span.lane == 0 else half
        outer, inner = middle + side, middle - side
        # Seen from each end of the road: `thin`: up to here there is no lane; `wide`: from here on
        # it has its full width. Closing is seen from the road's end, hence reversed.
        for end, thin, wide in ((0.0, *opening), (last, *closing[::-1])):
            if isfinite(wide):
                gone.append([[end, outer], [end, inner], [thin, inner], [wide, outer]])
        if isfinite(span.parted_until):
            solid.append([0.0, span.parted_until, inner])
        if isfinite(span.parted_from):
            solid.append([span.parted_from, last, inner])
    return {
        "gone": gone,
        "solid": solid,
        "crossings": [[it.at, it.width, it.reach] for it in road.crossings],
    }


def drawn_line(road: Road) -> list[list[float]]:
    """Start of each piece of a road's line, rows of s, x, y, heading, curvature, its rate; []
    without a line.
    """
    return [[float(f"{value:z.9g}") for value in row] for row in knots_of(road.line).tolist()]


def drawn_bodies(concrete: ConcreteScenario) -> dict[str, str]:
    """Bodies of the actors that are not cars, by name."""
    return {actor.name: actor.body for actor in concrete.actors if actor.body != CAR}
