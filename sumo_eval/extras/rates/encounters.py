"""Manoeuvres that a driver had to answer, from recordings, measured as parameters of a scenario.

Rules (`drivers.recorded.events` decides which vehicles count; this module measures):

- cut_in: a vehicle changes into the lane ahead of another, which it had not overtaken just before.
- overtaken_and_cut_off: a cut-in by a faster vehicle that had been behind within `OVERTOOK` s
  before.
- merging: a cut-in from a ramp or an auxiliary lane, whose lane number is negative.
- cut_out: a lead leaves the lane and reveals the next vehicle.
- braking: a lead at most 5 s ahead brakes.
- approach: the gap to a slower lead falls through 3.5 s.
- lane_change: a vehicle changes to the left, with a lead in its old lane and a vehicle behind in
  the new one.

t = 0 is when the actor begins to move sideways or to brake, when the gap passes 3.5 s, when the
changing vehicle begins to move. Sideways moves are fitted with the smooth step that scenario files
have, motion along the road with constant acceleration. Moves to either side count alike: the
scenario shows them to one.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.drivers.recorded.events import (
    BRAKING_BELOW,
    GHOST_LATERAL_SPEED,
    Event,
    RecordedLaneChange,
    RecordedTraffic,
    encounters,
    find_lane_changes,
)
from sumo_eval.drivers.recorded.recordings import INTERVAL, MOTOR_CLASSES, Recordings
from sumo_eval.errors import InputError
from sumo_eval.scenario.concrete import smooth_step
from sumo_eval.trajectory import FloatArray

CLASSES = (
    "cut_in", "overtaken_and_cut_off", "merging", "cut_out", "braking", "approach", "lane_change",
)  # fmt: skip
OVERTOOK = 20.0  # s before its lane change within which an overtaking vehicle was behind
AROUND = 2.0  # s before and after a lane change that its fit sees
SPEEDS_EVERY = 10  # samples; speeds are described by quantiles of every tenth
SHORTEST, LONGEST = 1.0, 15.0  # s; a fitted lane change outside does not count
NEAREST, FARTHEST = 1.5, 6.0  # m across; a fit outside is a move within a lane, or over two
# s of a lead's motion that is measured; the scenario's lead then keeps the speed that it has
APPROACH_WINDOW = 5.0
LEAST_BRAKING = 3  # steps; fewer samples do not determine an acceleration
BRAKING_HEADWAY = 5.0  # s; a lead that brakes further ahead does not count
REAR_HEADWAY = 4.0  # s; a vehicle further behind in the new lane does not count
LEAD_HEADWAY = 6.0  # s; a lead further ahead in the old lane does not count

# reasons why an event has no parameters
NOT_WHOLE = "not recorded from its beginning to its end"
NOTHING_REVEALED = "no lead that it reveals"
NO_FIT = "does not fit a lane change of 1 to 15 s and 1.5 to 6 m"
REAR_MOVES = "the vehicle behind changes lane as well"
LEAD_MOVES = "the lead changes lane meanwhile"


class NotMeasuredError(Exception):
    """An event that counts but has no parameters; its text is one of the reasons above."""


class Motion(NamedTuple):
    """An actor's recorded motion: times from t = 0 on, s; position ahead of the ego's centre
    at t = 0 and to the left of the lane that it begins or ends in, m.

    bodies: half the lengths of both, m.
    """

    time: FloatArray
    x: FloatArray
    y: FloatArray
    bodies: float


Measurement = tuple[dict[str, float], Motion]
"""Parameters of an event, and others that its class lacks; the motion of its actor."""


@dataclass
class Encounters:
    """The encounters of one class.

    rows: parameters of each.
    sources: `recording`, `ego`, `other` and `t` of each.
    motions: recorded motion of the actor of each.
    events: how many count for the rate, those without parameters included.
    left_out: how many of these have no parameters, by reason.
    ghosts: how many move as no vehicle can (`drivers.recorded.events`); they count nowhere else.
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

    kilometres: driven by all motor vehicles.
    hours: of these together.
    recordings: names.
    speeds: 5, 50 and 95 % of their speeds, m/s.
    lane_width: m, the median distance between neighbouring lanes; 3.5 where there are none.
    notes: of the readers.
    """

    classes: Mapping[str, Encounters]
    kilometres: float
    hours: float
    vehicles: int
    recordings: tuple[str, ...]
    speeds: tuple[float, ...]
    lane_width: float
    notes: tuple[str, ...]


def _part(traffic: RecordedTraffic, vehicle: str, begin: float, duration: float) -> slice:
    """The rows of a vehicle from `begin` on for `duration`, s; it must be recorded throughout."""
    whole = traffic.slices[vehicle]
    since = begin - traffic.t[whole.start]
    first = whole.start + int(np.ceil(since / INTERVAL - 1e-6))
    last = whole.start + int(np.floor((since + duration) / INTERVAL + 1e-6))
    if not whole.start <= first < last < whole.stop:
        raise NotMeasuredError(NOT_WHOLE)
    return slice(first, last + 1)


def _at(traffic: RecordedTraffic, vehicle: str, time: float) -> tuple[float, float]:
    """Position, m, and speed, m/s, of a vehicle at a time, at which it must be recorded."""
    whole = traffic.slices[vehicle]
    clock = traffic.t[whole]
    if not clock[0] - 1e-6 <= time <= clock[-1] + 1e-6:
        raise NotMeasuredError(NOT_WHOLE)
    x, speed = (np.interp(time, clock, values[whole]) for values in (traffic.x, traffic.speed))
    return x, speed


def _bodies(traffic: RecordedTraffic, *vehicles: str) -> float:
    """Half the lengths of two vehicles together, m."""
    return float(sum(traffic.length[traffic.slices[name].start] for name in vehicles) / 2.0)


class _Pair:
    """The ego at t = 0 (`begin`), and an actor's motion over the rows `part` with constant
    acceleration.
    """

    def __init__(self, traffic: RecordedTraffic, ego: str, begin: float, part: slice) -> None:
        self.ego_x, self.ego_speed = _at(traffic, ego, begin)
        self.bodies = _bodies(traffic, ego, traffic.names[part.start])
        self._traffic, self._part = traffic, part
        self._time = traffic.t[part] - begin
        self.x0, speed, self.acceleration = constant_acceleration(self._time, traffic.x[part])
        self.gap = self.x0 - self.ego_x - self.bodies
        self.closing = self.ego_speed - speed
        self.values = {
            "ego_speed": self.ego_speed,
            "closing_speed": self.closing,
            "gap": self.gap,
            "acceleration": self.acceleration,
        }

    def motion(self, lane: int, mirror: float = 1.0) -> Motion:
        """The actor's motion, across the road from the centre of a lane."""
        y = mirror * (self._traffic.y[self._part] - self._traffic.centres[lane])
        return Motion(self._time, self._traffic.x[self._part] - self.ego_x, y, self.bodies)

    def motion_in_lane(self, reason: str) -> Motion:
        """The motion of an actor that keeps its lane; one that does not has no parameters."""
        lanes = self._traffic.lane[self._part]
        if np.ptp(lanes):
            raise NotMeasuredError(reason)
        return self.motion(lanes[0])


def find_encounters(
    parts: Iterable[Recordings], watch: Callable[[str, int], None] = lambda what, done: None
) -> EncounterSurvey:
    """Every encounter in recordings, by class; one part of them is held at a time.

    watch: receives the name of the recording that was read last, and how many were.
    Raises InputError where two have one name.
    """
    classes = {name: Encounters(name) for name in CLASSES}
    kilometres = hours = 0.0
    vehicles = 0
    names = []
    notes: list[str] = []
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
            # a view would hold the whole recording
            speeds.append(traffic.speed[::SPEEDS_EVERY].copy())
            gaps += _lane_gaps(traffic)
            _measure_recording(name, traffic, classes)
            watch(name, len(names))
    return EncounterSurvey(
        classes, kilometres, hours, vehicles, tuple(names),
        tuple(np.quantile(np.concatenate(speeds or [np.zeros(1)]), [0.05, 0.5, 0.95]).tolist()),
        round(float(np.median(gaps)), 2) if gaps else 3.5,
        tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _lane_gaps(traffic: RecordedTraffic) -> list[float]:
    """Distances between the centres of neighbouring lanes, m."""
    centres = [traffic.centres[lane] for lane in sorted(traffic.centres) if lane >= 0]
    return [b - a for a, b in itertools.pairwise(centres) if 2.5 < b - a < 4.5]


def _measure_recording(
    name: str, traffic: RecordedTraffic, classes: Mapping[str, Encounters]
) -> None:
    """Count and measure the events of a recording."""
    for kind, event, other, measure, *more in _events_that_count(traffic):
        encountered = classes[kind]
        if event["ghost"]:
            encountered.ghosts += 1
            continue
        encountered.events += 1
        try:
            row, motion = measure(traffic, event, *more)
        except NotMeasuredError as reason:
            encountered.left_out[str(reason)] += 1
            continue
        encountered.rows.append(row)
        encountered.motions.append(motion)
        source = {"recording": name, "ego": event["ego"], "other": other, "t": event["t"]}
        encountered.sources.append(source)


def _events_that_count(traffic: RecordedTraffic) -> Iterator[Any]:
    """Class, event, name of the actor, function that measures the event, its further arguments."""
    changes = find_lane_changes(traffic)
    crossings = {(change.vehicle, round(change.t, 3)): change for change in changes}
    events = encounters(traffic, changes)
    for event in events["cut_in"]:
        change = crossings[event["cut_in"], round(event["t"], 3)]
        yield _kind_of_cut_in(traffic, event, change), event, change.vehicle, _cut_in, change
    for event in events["cut_out"]:
        change = crossings[event["cut_out"], round(event["t"], 3)]
        yield "cut_out", event, change.vehicle, _cut_out, change
    for event in events["lead_braking"]:
        if event["headway"] <= BRAKING_HEADWAY:
            yield "braking", event, event["lead"], _braking
    for event in events["approach"]:
        if event["start_kind"] == "range_crossing":
            yield "approach", event, event["lead"], _approach
    for change in changes:
        pair = _neighbours(traffic, change) if change.to > change.origin >= 0 else None
        if pair is not None:
            event = {
                "ego": change.vehicle,
                "t": change.t,
                "ghost": change.lateral_speed > GHOST_LATERAL_SPEED,
            }
            yield "lane_change", event, pair[1], _lane_change, change, *pair


def _kind_of_cut_in(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> str:
    if change.origin < 0:
        return "merging"
    if event["cut_in_speed"] > event["ego_speed"]:
        for time in np.arange(event["t"] - OVERTOOK, event["t"], 1.0):
            with suppress(NotMeasuredError):
                if _at(traffic, change.vehicle, time)[0] < _at(traffic, event["ego"], time)[0]:
                    return "overtaken_and_cut_off"
    return "cut_in"


def _sideways(traffic: RecordedTraffic, change: RecordedLaneChange) -> tuple[float, float, float]:
    """Begin, duration, s, and offset, m, of the smooth step that a lane change fits best."""
    if not change.complete:
        raise NotMeasuredError(NOT_WHOLE)
    whole = traffic.slices[change.vehicle]
    t = traffic.t[whole]
    seen = (t >= change.onset - AROUND) & (t <= change.end + AROUND)
    begin, duration, offset = fit_smooth_step(
        t[seen], traffic.y[whole][seen], change.onset, change.duration
    )
    if not (SHORTEST <= duration <= LONGEST and NEAREST <= abs(offset) <= FARTHEST):
        raise NotMeasuredError(NO_FIT)
    return begin, duration, offset


def fit_smooth_step(
    time: FloatArray, y: FloatArray, onset: float, duration: float
) -> tuple[float, float, float]:
    """Begin s, duration s and offset m of y0 + offset * smooth_step((t - begin) / duration), by
    least squares.

    time, y: (n,).
    onset, duration: approximate values.
    """
    from scipy import optimize

    minimize: Any = optimize.minimize
    across = y - y.mean()

    def fit(values: FloatArray) -> tuple[float, float]:
        """Sum of squares of a start and a duration, and the offset that has the least."""
        share = smooth_step((time - values[0]) / max(abs(values[1]), INTERVAL))
        share = share - share.mean()
        spread = (share**2).sum()
        offset = (share * across).sum() / spread if spread > 0.0 else 0.0
        rest = across - offset * share
        return rest @ rest, offset

    # begin and duration: a smooth step begins before its onset is seen, and ends later
    guess = np.array([onset - 0.1 * duration, 1.2 * max(duration, 0.5)])
    best = minimize(
        lambda values: fit(values)[0],
        guess,
        method="Nelder-Mead",
        options={"xatol": 1e-3, "fatol": 1e-9},
    ).x
    return best[0], abs(best[1]), fit(best)[1]


def constant_acceleration(time: FloatArray, x: FloatArray) -> tuple[float, float, float]:
    """x0 m, v0 m/s and a m/s2 of x0 + v0 t + a t^2 / 2 by least squares over (n,) samples."""
    design = np.column_stack([np.ones_like(time), time, 0.5 * time**2])
    x0, v0, a = np.linalg.lstsq(design, x, rcond=None)[0]
    return x0, v0, a


def _cut_in(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> Measurement:
    begin, duration, offset = _sideways(traffic, change)
    pair = _Pair(traffic, event["ego"], begin, _part(traffic, change.vehicle, begin, duration))
    values = pair.values | {"duration": duration}
    # the scenario shows a ramp on the right, another lane on the left
    mirror = 1.0 if change.origin < 0 else -1.0
    return values, pair.motion(change.to, mirror * np.sign(offset))


def _cut_out(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> Measurement:
    ego, revealed = event["ego"], event["revealed"]
    if not revealed:
        raise NotMeasuredError(NOTHING_REVEALED)
    begin, duration, offset = _sideways(traffic, change)
    pair = _Pair(traffic, ego, begin, _part(traffic, change.vehicle, begin, duration))
    ahead = _part(traffic, revealed, begin, duration)
    speed, x = np.polyfit(traffic.t[ahead] - begin, traffic.x[ahead], 1)
    values = {
        "ego_speed": pair.ego_speed,
        "lead_closing": pair.closing,
        "lead_gap": pair.gap,
        "lead_acceleration": pair.acceleration,
        "duration": duration,
        "closing_speed": pair.ego_speed - speed,
        "gap": x - pair.ego_x - _bodies(traffic, ego, revealed),
    }
    return values, pair.motion(change.origin, np.sign(offset))


def _braking(traffic: RecordedTraffic, event: Event) -> Measurement:
    whole = traffic.slices[event["lead"]]
    first = whole.start + round((event["t"] - traffic.t[whole.start]) / INTERVAL)
    acceleration = traffic.acceleration[first : whole.stop]
    eased = np.flatnonzero(acceleration > -BRAKING_BELOW)
    steps = int(eased[0]) if eased.size else 0
    if steps < LEAST_BRAKING:
        raise NotMeasuredError(NOT_WHOLE)
    pair = _Pair(traffic, event["ego"], event["t"], slice(first, first + steps + 1))
    values = {
        "headway": pair.gap / max(pair.ego_speed, 0.1),
        "deceleration": -pair.acceleration,
        "duration": steps * INTERVAL,
    }
    return pair.values | values, pair.motion_in_lane(LEAD_MOVES)


def _approach(traffic: RecordedTraffic, event: Event) -> Measurement:
    part = _part(traffic, event["lead"], event["t"], APPROACH_WINDOW)
    pair = _Pair(traffic, event["ego"], event["t"], part)
    return pair.values, pair.motion_in_lane(LEAD_MOVES)


def _neighbours(traffic: RecordedTraffic, change: RecordedLaneChange) -> tuple[str, str] | None:
    """The lead in the old lane and the vehicle behind in the new one at a lane change; None
    unless both are near.
    """
    before, rear = change.row - 1, traffic.follower[change.row]
    lead = traffic.lead[before]
    if lead < 0 or rear < 0:
        return None
    far_lead = traffic.gap[before] > LEAD_HEADWAY * traffic.speed[before]
    far_rear = traffic.gap[rear] > REAR_HEADWAY * traffic.speed[rear]
    return None if far_lead or far_rear else (traffic.names[lead], traffic.names[rear])


def _lane_change(
    traffic: RecordedTraffic, event: Event, change: RecordedLaneChange, lead: str, rear: str
) -> Measurement:
    begin, duration, _ = _sideways(traffic, change)
    lead_x, lead_speed = _at(traffic, lead, begin)
    pair = _Pair(traffic, change.vehicle, begin, _part(traffic, rear, begin, duration))
    pair.motion_in_lane(REAR_MOVES)
    values = {
        "ego_speed": pair.ego_speed,
        "lead_closing": pair.ego_speed - lead_speed,
        "lead_gap": lead_x - pair.ego_x - _bodies(traffic, change.vehicle, lead),
        "rear_closing": -pair.closing,
        "rear_gap": pair.ego_x - pair.x0 - pair.bodies,
        "rear_acceleration": pair.acceleration,
        "duration": duration,
    }
    return values, pair.motion(change.origin)
