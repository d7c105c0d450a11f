"""Manoeuvres in recordings that a driver had to answer, measured as parameters of a scenario.

`learned` makes scenarios of them, as `scenes` describes. `drivers.recorded.events` decides which
vehicles count; this module measures. Its classes:

- cut_in: a vehicle changes into the lane ahead of another, which it had not overtaken just before.
- overtaken_and_cut_off: a cut-in by a faster vehicle that was behind at most `OVERTOOK` s before.
- merging: a cut-in from a ramp or an auxiliary lane, whose lane number is negative.
- cut_out: a lead leaves the lane and reveals the next vehicle.
- braking: a lead at most 5 s ahead brakes.
- approach: the gap to a slower lead falls through 3.5 s.
- lane_change: the ego changes to the left, with a lead in its old lane and a vehicle behind in the
  new one.

At t = 0 the vehicle that changes lane begins to move sideways, the lead begins to brake, or the gap
passes 3.5 s. Sideways moves are fitted with the smooth step that scenario files have, motion along
the road with constant acceleration. Moves to either side count alike, and a scenario has them to
one side.

Users: `extras/rates/learned.py`, `extras/rates/recorded_scene.py`, `extras/rates/scenes.py`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.drivers.recorded.events import (
    BRAKING_BELOW,
    GHOST_LATERAL_SPEED,
    Event,
    RecordedLaneChange,
    RecordedTraffic,
    encounters,
    find_lane_changes,
)
from sumo_eval.drivers.recorded.recordings import INTERVAL, MOTOR_CLASSES, STANDARD_LANE, Recordings
from sumo_eval.errors import InputError
from sumo_eval.scenario.concrete import smooth_step
from sumo_eval.trajectory import FloatArray

CLASSES = (
    "cut_in", "overtaken_and_cut_off", "merging", "cut_out", "braking", "approach", "lane_change",
)  # fmt: skip
OVERTOOK = 20.0  # s; at most so long before its lane change an overtaking vehicle was behind
AROUND = 2.0  # s before and after a lane change that are fitted with it
SPEEDS_EVERY = 10  # samples; quantiles of speeds use every tenth
SHORTEST, LONGEST = 1.0, 15.0  # s; durations of a fitted lane change
NEAREST, FARTHEST = 1.5, 6.0  # m across; less is a move within a lane, more one over two lanes
# s of a lead's motion that are measured; after that the scenario's lead keeps its speed
APPROACH_WINDOW = 5.0
LEAST_BRAKING = 3  # samples; fewer do not determine an acceleration
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
    """An event counts but has no parameters; the text is one of the reasons above."""


class Motion(NamedTuple):
    """An actor's recorded motion.

    time: from t = 0 on, s, (n,).
    x: of its centre ahead of the ego's centre at t = 0, m, (n,).
    y: of its centre to the left of the middle of the ego's lane at t = 0, m, (n,); mirrored where
        the scene of its class shows the other side.
    bodies: half the sum of the lengths of actor and ego, m.
    """

    time: FloatArray
    x: FloatArray
    y: FloatArray
    bodies: float


Measurement = tuple[dict[str, float], Motion]
"""Values of an event by name, among them all parameters of its class; the motion of its actor."""


@dataclass
class Encounters:
    """The encounters of one class.

    rows: parameters of each encounter that has them.
    sources: `recording`, `ego`, `other` and `t` of each of these.
    motions: recorded motion of the actor of each of these.
    events: number of all encounters, with or without parameters.
    left_out: reason -> number of encounters without parameters.
    ghosts: number of events that move as no vehicle can (`drivers.recorded.events`); they count
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
    speeds: quantiles of the vehicles' speeds at 5, 50 and 95 %, m/s.
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


def _part(traffic: RecordedTraffic, vehicle: str, begin: float, duration: float) -> slice:
    """The rows of a vehicle from `begin` on for `duration`, s.

    Raises NotMeasuredError if it is not recorded throughout.
    """
    whole = traffic.slices[vehicle]
    since = begin - traffic.t[whole.start]
    # 1e-6: a time that is rounded past its sample still counts
    first = whole.start + int(np.ceil(since / INTERVAL - 1e-6))
    last = whole.start + int(np.floor((since + duration) / INTERVAL + 1e-6))
    if not whole.start <= first < last < whole.stop:
        raise NotMeasuredError(NOT_WHOLE)
    return slice(first, last + 1)


def _at(traffic: RecordedTraffic, vehicle: str, time: float) -> tuple[float, float]:
    """Position along the road, m, and speed, m/s, of a vehicle at a time.

    Raises NotMeasuredError if it is not recorded then.
    """
    whole = traffic.slices[vehicle]
    clock = traffic.t[whole]
    if not clock[0] - 1e-6 <= time <= clock[-1] + 1e-6:
        raise NotMeasuredError(NOT_WHOLE)
    x, speed = (np.interp(time, clock, values[whole]) for values in (traffic.x, traffic.speed))
    return x, speed


def _bodies(traffic: RecordedTraffic, *vehicles: str) -> float:
    """Half the sum of the lengths of two vehicles, m."""
    return float(sum(traffic.length[traffic.slices[name].start] for name in vehicles) / 2.0)


class _Pair:
    """The ego at t = 0 and the motion of an actor, with constant acceleration along the road.

    begin: time of t = 0 in the recording, s.
    part: rows of the actor's motion.

    ego_x, x0: positions of ego and actor at t = 0, m.
    bodies: as in `Motion`.
    gap: bumper to bumper from the ego to the actor ahead at t = 0, m.
    closing: speed of the ego less that of the actor at t = 0, m/s.
    values: parameters that several classes have.
    """

    def __init__(self, traffic: RecordedTraffic, ego: str, begin: float, part: slice) -> None:
        self.ego_x, self.ego_speed = _at(traffic, ego, begin)
        self.bodies = _bodies(traffic, ego, traffic.names[part.start])
        self._traffic, self._part = traffic, part
        self._time = time = traffic.t[part] - begin
        # least squares fit of x0 + speed t + acceleration t^2 / 2
        design = np.column_stack([np.ones_like(time), time, 0.5 * time**2])
        fit = np.linalg.lstsq(design, traffic.x[part], rcond=None)[0]
        self.x0, speed, self.acceleration = fit
        self.gap = self.x0 - self.ego_x - self.bodies
        self.closing = self.ego_speed - speed
        self.values = {
            "ego_speed": self.ego_speed,
            "closing_speed": self.closing,
            "gap": self.gap,
            "acceleration": self.acceleration,
        }

    def motion(self, lane: int, mirror: float = 1.0) -> Motion:
        """The actor's motion.

        lane: the ego's at t = 0.
        mirror: factor of y, 1 or -1.
        """
        y = mirror * (self._traffic.y[self._part] - self._traffic.centres[lane])
        return Motion(self._time, self._traffic.x[self._part] - self.ego_x, y, self.bodies)

    def motion_in_lane(self, reason: str) -> Motion:
        """The motion of an actor that keeps its lane.

        reason: of the NotMeasuredError if it does not.
        """
        lanes = self._traffic.lane[self._part]
        if np.ptp(lanes):
            raise NotMeasuredError(reason)
        return self.motion(lanes[0])


def find_encounters(
    parts: Iterable[Recordings], watch: Callable[[str, int], None] = lambda what, done: None
) -> EncounterSurvey:
    """Find and measure every encounter in recordings.

    parts: recordings, read one part at a time, so that memory holds only one.
    watch: receives the name of each recording that was read, and their number so far.
    Raises InputError if two recordings have the same name.
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
            # ramps have numbers below 0
            lanes = [traffic.centres[lane] for lane in sorted(traffic.centres) if lane >= 0]
            gaps += lane_gaps(lanes).tolist()
            _measure_recording(name, traffic, classes)
            watch(name, len(names))
    return EncounterSurvey(
        classes, kilometres, hours, vehicles, tuple(names),
        tuple(np.quantile(np.concatenate(speeds or [np.zeros(1)]), [0.05, 0.5, 0.95]).tolist()),
        round(float(np.median(gaps)), 2) if gaps else STANDARD_LANE,
        tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def lane_gaps(middles: ArrayLike) -> FloatArray:
    """Distances between neighbouring lanes, m.

    middles: y of lanes with a vehicle, in order, m, (n,).
    """
    gaps = np.diff(middles)
    # other distances: a lane between has no vehicle, or one lane is recorded as two
    return np.asarray(gaps[(gaps > 2.5) & (gaps < 4.5)])


def _measure_recording(
    name: str, traffic: RecordedTraffic, classes: Mapping[str, Encounters]
) -> None:
    """Count and measure the events of a recording, and add them to `classes`."""
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
    """The events that count.

    Each is a tuple: class, event, name of the actor, function that measures the event, and this
    function's arguments after traffic and event.
    """
    changes = find_lane_changes(traffic)
    # an event has the vehicle that changes lane under its kind's name, and the change's time
    crossings = {(change.vehicle, round(change.t, 3)): change for change in changes}
    events = encounters(traffic, changes)
    for kind, measure in (("cut_in", _cut_in), ("cut_out", _cut_out)):
        for event in events[kind]:
            change = crossings[event[kind], round(event["t"], 3)]
            name = _kind_of_cut_in(traffic, event, change) if kind == "cut_in" else kind
            yield name, event, change.vehicle, measure, change
    for event in events["lead_braking"]:
        if event["headway"] <= BRAKING_HEADWAY:
            yield "braking", event, event["lead"], _braking
    for event in events["approach"]:
        if event["start_kind"] == "range_crossing":
            yield "approach", event, event["lead"], _approach
    for change in changes:
        # to the left, and not from a ramp
        pair = _neighbours(traffic, change) if change.to > change.origin >= 0 else None
        if pair is not None:
            event = {
                "ego": change.vehicle,
                "t": change.t,
                "ghost": change.lateral_speed > GHOST_LATERAL_SPEED,
            }
            yield "lane_change", event, pair[1], _lane_change, change, *pair


def _kind_of_cut_in(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> str:
    """The class of a cut-in."""
    if change.origin < 0:
        return "merging"
    if event["cut_in_speed"] > event["ego_speed"]:
        for time in np.arange(event["t"] - OVERTOOK, event["t"], 1.0):
            with suppress(NotMeasuredError):
                if _at(traffic, change.vehicle, time)[0] < _at(traffic, event["ego"], time)[0]:
                    return "overtaken_and_cut_off"
    return "cut_in"


def _sideways(traffic: RecordedTraffic, change: RecordedLaneChange) -> tuple[float, float, float]:
    """Begin and duration, s, and offset, m, of the smooth step that fits a lane change best."""
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
    """Least squares fit of y0 + offset * smooth_step((t - begin) / duration).

    Returns begin and duration, s, and offset, m.

    time: t, s, (n,).
    y: across the road, m, (n,).
    onset, duration: approximate begin and duration, s.
    """
    from scipy import optimize

    minimize: Any = optimize.minimize
    across = y - y.mean()

    def fit(step: FloatArray) -> tuple[float, float]:
        """Sum of squares for `step`, begin and duration, and the offset that makes it least."""
        share = smooth_step((time - step[0]) / max(abs(step[1]), INTERVAL))
        share = share - share.mean()
        spread = (share**2).sum()
        offset = (share * across).sum() / spread if spread > 0.0 else 0.0
        rest = across - offset * share
        return rest @ rest, offset

    # a smooth step begins before its onset is seen, and ends later
    guess = np.array([onset - 0.1 * duration, 1.2 * max(duration, 0.5)])
    best = minimize(
        lambda step: fit(step)[0],
        guess,
        method="Nelder-Mead",
        options={"xatol": 1e-3, "fatol": 1e-9},
    ).x
    return best[0], abs(best[1]), fit(best)[1]


def _cut_in(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> Measurement:
    begin, duration, offset = _sideways(traffic, change)
    pair = _Pair(traffic, event["ego"], begin, _part(traffic, change.vehicle, begin, duration))
    values = pair.values | {"duration": duration}
    # in the scenario the actor comes from a ramp on the right, or from the lane on the left
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
    # in the scenario the lead moves to the left
    return values, pair.motion(change.origin, np.sign(offset))


def _braking(traffic: RecordedTraffic, event: Event) -> Measurement:
    """Measure a lead's braking, from `BRAKING_BELOW` until it eases off to that again."""
    whole = traffic.slices[event["lead"]]
    first = whole.start + round((event["t"] - traffic.t[whole.start]) / INTERVAL)
    acceleration = traffic.acceleration[first : whole.stop]
    # samples until the lead no longer brakes; 0 if it brakes to the end of its recording
    steps = int(np.argmax(acceleration > -BRAKING_BELOW))
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
    """Names of the lead in the old lane and of the vehicle behind in the new one; None: not both.

    Both must be within their headway at the lane change.
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
