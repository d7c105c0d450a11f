"""Manoeuvres in recordings that a driver had to answer, measured as parameters of a scenario.

`learned` makes scenarios of them, as `scenes` describes. `drivers.recorded.events` decides which
vehicles count; `measured` measures an event. The classes:

- cut_in: a vehicle changes into the lane ahead of another, which it had not overtaken just before.
- overtaken_and_cut_off: a cut-in by a faster vehicle that was behind at most `OVERTOOK` s before.
- merging: a cut-in from a ramp or an auxiliary lane; these lanes have negative numbers.
- cut_out: a lead vehicle leaves the lane and reveals the next vehicle.
- braking: a lead vehicle at most `BRAKING_HEADWAY` ahead brakes.
- approach: the gap to a slower lead vehicle falls below 3.5 s.
- lane_change: the ego changes to the left, with a lead vehicle in its old lane and a vehicle behind
  it in the new lane.

Users: `extras/rates/learned.py`, `extras/rates/recorded_scene.py`.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.drivers.recorded.events import (
    GHOST_LATERAL_SPEED,
    Event,
    RecordedLaneChange,
    RecordedTraffic,
    encounters,
)
from sumo_eval.drivers.recorded.recordings import MOTOR_CLASSES, STANDARD_LANE, Recordings
from sumo_eval.errors import InputError
from sumo_eval.extras.rates.measured import (
    Measurement,
    Motion,
    NotMeasuredError,
    approach,
    braking,
    cut_in,
    cut_out,
    lane_change,
    position_at,
)
from sumo_eval.trajectory import FloatArray

CLASSES = (
    "cut_in", "overtaken_and_cut_off", "merging", "cut_out", "braking", "approach", "lane_change",
)  # fmt: skip
Counted = tuple[str, Event, str, Callable[[], Measurement]]
"""An event that belongs to a class: class, event, name of the actor, and the function that measures
the event.
"""
OVERTOOK = 20.0  # s before its lane change within which an overtaking vehicle was behind
SPEEDS_EVERY = 10  # quantiles of speeds use every tenth sample
QUANTILES = 0.05, 0.5, 0.95  # of speeds
LANES_APART = 2.5, 4.5  # m; other distances are not those of neighbouring lanes
BRAKING_HEADWAY = 5.0  # s; a lead vehicle that brakes further ahead does not count
REAR_HEADWAY = 4.0  # s; a vehicle further behind in the new lane does not count
LEAD_HEADWAY = 6.0  # s; a lead vehicle further ahead in the old lane does not count


@dataclass
class Encounters:
    """The encounters of one class.

    rows: parameters of each encounter that could be measured.
    sources: of each row: names of `recording`, `ego` and `other` vehicle, and the time `t`, s.
    motions: of each row: recorded motion of the actor.
    events: number of all encounters, measured or not.
    left_out: reason -> number of encounters that could not be measured.
    ghosts: number of events that move as no vehicle can (`drivers.recorded.events`). They count
        nowhere else.
    """

    name: str
    rows: list[dict[str, float]] = field(default_factory=list)
    sources: list[dict[str, Any]] = field(default_factory=list)
    motions: list[Motion] = field(default_factory=list)
    events: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    ghosts: int = 0


class EncounterSurvey(NamedTuple):
    """Encounters in recordings.

    classes: name of the class -> its encounters.
    kilometres, hours: driven by all motor vehicles together.
    vehicles: number of motor vehicles.
    recordings: their names.
    speeds: `QUANTILES` of the vehicles' speeds, m/s.
    lane_width: median distance between neighbouring lanes, m; `STANDARD_LANE` if there are none.
    notes: of the importers.
    """

    classes: Mapping[str, Encounters]
    kilometres: float
    hours: float
    vehicles: int
    recordings: tuple[str, ...]
    speeds: tuple[float, ...]
    lane_width: float
    notes: tuple[str, ...]


def find_encounters(
    parts: Iterable[Recordings], watch: Callable[[str, int], None] = lambda what, done: None
) -> EncounterSurvey:
    """Find and measure every encounter in recordings.

    parts: recordings; each part is read when the one before is done, so that memory holds only one.
    watch: receives the name of each recording that was read, and their number so far.
    Raises InputError if two recordings have the same name.
    """
    classes = {name: Encounters(name) for name in CLASSES}
    kilometres = hours = 0.0
    vehicles = 0
    names = []
    notes = list[str]()
    speeds = []
    gaps = []
    for part in parts:
        notes += part.notes
        motor = part.table[part.table["class"].isin(MOTOR_CLASSES)]
        recordings: Any = motor.groupby("recording", sort=False)
        for name, table in recordings:
            if name in names:
                raise InputError(f"Recordings must have different names, got {name!r} twice.")
            traffic = RecordedTraffic(table)
            names.append(name)
            vehicles += len(traffic.slices)
            for track in traffic.slices.values():
                kilometres += float(np.abs(np.diff(traffic.x[track])).sum()) / 1000.0
                hours += (traffic.t[track.stop - 1] - traffic.t[track.start]) / 3600.0
            # a copy: a view would keep the whole recording in memory
            speeds.append(traffic.speed[::SPEEDS_EVERY].copy())
            # ramps have numbers below 0
            lanes = [traffic.centres[lane] for lane in sorted(traffic.centres) if lane >= 0]
            gaps += lane_gaps(lanes).tolist()
            _measure_recording(name, traffic, classes)
            watch(name, len(names))
    return EncounterSurvey(
        classes, kilometres, hours, vehicles, tuple(names),
        tuple(np.quantile(np.concatenate(speeds or [np.zeros(1)]), QUANTILES).tolist()),
        round(float(np.median(gaps)), 2) if gaps else STANDARD_LANE,
        tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def lane_gaps(middles: ArrayLike) -> FloatArray:
    """Distances between neighbouring lanes, m.

    middles: y of lanes with a vehicle, in order, m, (n,).
    """
    gaps, (least, most) = np.diff(middles), LANES_APART
    # without distances where a lane between has no vehicle, or where one lane is recorded as two
    return gaps[(gaps > least) & (gaps < most)]


def _measure_recording(
    name: str, traffic: RecordedTraffic, classes: Mapping[str, Encounters]
) -> None:
    """Count and measure the events of a recording, and add them to `classes`."""
    for kind, event, other, measure in _events_that_count(traffic):
        encountered = classes[kind]
        if event["ghost"]:
            encountered.ghosts += 1
            continue
        encountered.events += 1
        try:
            row, motion = measure()
        except NotMeasuredError as reason:
            encountered.left_out[str(reason)] += 1
            continue
        encountered.rows.append(row)
        encountered.motions.append(motion)
        source = {"recording": name, "ego": event["ego"], "other": other, "t": event["t"]}
        encountered.sources.append(source)


def _events_that_count(traffic: RecordedTraffic) -> Iterator[Counted]:
    """The events of the recording that belong to a class."""
    change_of = {(change.vehicle, round(change.t, 3)): change for change in traffic.changes}
    events = encounters(traffic)
    for kind, measure in (("cut_in", cut_in), ("cut_out", cut_out)):
        for event in events[kind]:
            # under the name of its kind, an event has the vehicle that changes lane
            change = change_of[event[kind], round(event["t"], 3)]
            name = _kind_of_cut_in(traffic, event, change) if kind == "cut_in" else kind
            yield name, event, change.vehicle, partial(measure, traffic, event, change)
    for event in events["lead_braking"]:
        if event["headway"] <= BRAKING_HEADWAY:
            yield "braking", event, event["lead"], partial(braking, traffic, event)
    for event in events["approach"]:
        if event["start_kind"] == "range_crossing":
            yield "approach", event, event["lead"], partial(approach, traffic, event)
    for change in traffic.changes:
        # to the left, and not from a ramp
        pair = _neighbours(traffic, change) if change.to > change.origin >= 0 else None
        if pair is not None:
            event = {
                "ego": change.vehicle,
                "t": change.t,
                "ghost": change.lateral_speed > GHOST_LATERAL_SPEED,
            }
            measured = partial(lane_change, traffic, event, change, *pair)
            yield "lane_change", event, pair[1], measured


def _kind_of_cut_in(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> str:
    """The class of a cut-in; change: the lane change of the vehicle that cuts in."""
    if change.origin < 0:
        return "merging"
    if event["cut_in_speed"] > event["ego_speed"]:
        vehicles = change.vehicle, event["ego"]
        for time in np.arange(event["t"] - OVERTOOK, event["t"], 1.0):
            with suppress(NotMeasuredError):  # not yet recorded at this time
                other_x, ego_x = (position_at(traffic, vehicle, time)[0] for vehicle in vehicles)
                if other_x < ego_x:
                    return "overtaken_and_cut_off"
    return "cut_in"


def _neighbours(traffic: RecordedTraffic, change: RecordedLaneChange) -> tuple[str, str] | None:
    """Names of the lead vehicle in the old lane and of the vehicle behind in the new lane.

    None where one of them is missing, or not within its headway at the lane change.
    """
    before, rear = change.row - 1, traffic.follower[change.row]
    lead = traffic.lead[before]
    if lead < 0 or rear < 0:  # rows of the table; below 0: no vehicle
        return None
    far_lead = traffic.gap[before] > LEAD_HEADWAY * traffic.speed[before]
    far_rear = traffic.gap[rear] > REAR_HEADWAY * traffic.speed[rear]
    return None if far_lead or far_rear else (traffic.names[lead], traffic.names[rear])
