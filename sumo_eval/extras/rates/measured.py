"""Measurement of one manoeuvre in a recording, as parameters of its class's scenario.

At t = 0 the vehicle that changes lane begins to move sideways, the lead vehicle begins to brake, or
the gap passes 3.5 s. Sideways moves are fitted with the smooth step that scenario files have,
motion along the road with constant acceleration. Moves to both sides count alike; a scenario shows
them to one side.

Users: `extras/rates/encounters.py`, `extras/rates/learned.py`, `extras/rates/scenes.py`.
"""

from typing import Any, NamedTuple

import numpy as np

from sumo_eval.drivers.recorded.events import (
    BRAKING_BELOW,
    Event,
    RecordedLaneChange,
    RecordedTraffic,
)
from sumo_eval.drivers.recorded.recordings import INTERVAL
from sumo_eval.scenario.concrete import smooth_step
from sumo_eval.trajectory import FloatArray

AROUND = 2.0  # s before and after a lane change that are fitted with it
SHORTEST, LONGEST = 1.0, 15.0  # s; durations of a fitted lane change
NEAREST, FARTHEST = 1.5, 6.0  # m across; less is a move within a lane, more crosses two lanes
APPROACH_WINDOW = 5.0  # s of the lead vehicle's motion that are measured from t = 0 on
LEAST_BRAKING = 3  # samples; fewer do not determine an acceleration
SLOWEST = 0.1  # m/s by which a headway is divided, at least

# reasons why an event has no parameters
NOT_WHOLE = "not recorded from its beginning to its end"
NOTHING_REVEALED = "no lead that it reveals"
NO_FIT = "does not fit a lane change of 1 to 15 s and 1.5 to 6 m"
REAR_MOVES = "the vehicle behind changes lane as well"
LEAD_MOVES = "the lead changes lane meanwhile"


class NotMeasuredError(Exception):
    """An event counts but cannot be measured; the text is one of the reasons above."""


class Motion(NamedTuple):
    """An actor's recorded motion.

    time: from t = 0 on, s, (n,).
    x: of its centre ahead of the ego's centre at t = 0, m, (n,).
    y: of its centre to the left of the middle of the ego's lane at t = 0, m, (n,). It is mirrored
        where the recorded move is to the other side than that of the class's scene.
    bodies: half the sum of the lengths of actor and ego, m.
    """

    time: FloatArray
    x: FloatArray
    y: FloatArray
    bodies: float


Measurement = tuple[dict[str, float], Motion]
"""Values of an event by name, among them all parameters of its class (`scenes.Quantity`); the
motion of its actor.
"""


def _part(traffic: RecordedTraffic, vehicle: str, begin: float, duration: float) -> slice:
    """The rows of a vehicle over `duration` s from the time `begin` on, s.

    Raises NotMeasuredError if the vehicle is not recorded throughout.
    """
    whole = traffic.slices[vehicle]
    since = begin - traffic.t[whole.start]
    # 1e-6: a time that is rounded past its sample still counts
    first = whole.start + int(np.ceil(since / INTERVAL - 1e-6))
    last = whole.start + int(np.floor((since + duration) / INTERVAL + 1e-6))
    if not whole.start <= first < last < whole.stop:
        raise NotMeasuredError(NOT_WHOLE)
    return slice(first, last + 1)


def position_at(traffic: RecordedTraffic, vehicle: str, time: float) -> tuple[float, float]:
    """Position along the road, m, and speed, m/s, of a vehicle at a time.

    Raises NotMeasuredError if the vehicle is not recorded at this time.
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
    ego_speed: of the ego at t = 0, m/s.
    acceleration: of the actor, m/s2.
    bodies: as in `Motion`.
    gap: bumper to bumper from the ego to the actor ahead at t = 0, m.
    closing: speed of the ego less that of the actor at t = 0, m/s.
    values: parameters that several classes have, by name.
    """

    def __init__(self, traffic: RecordedTraffic, ego: str, begin: float, part: slice) -> None:
        self.ego_x, self.ego_speed = position_at(traffic, ego, begin)
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

        lane: number of the ego's lane at t = 0.
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


def _sideways(traffic: RecordedTraffic, change: RecordedLaneChange) -> tuple[float, float, float]:
    """Begin and duration, s, and offset, m, of the smooth step that fits a lane change best."""
    if not change.complete:
        raise NotMeasuredError(NOT_WHOLE)
    whole = traffic.slices[change.vehicle]
    t = traffic.t[whole]
    near = (t >= change.onset - AROUND) & (t <= change.end + AROUND)
    begin, duration, offset = fit_smooth_step(
        t[near], traffic.y[whole][near], change.onset, change.duration
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

    def fit(begin: float, duration: float) -> tuple[float, float]:
        """The least sum of squares of a step, and the offset that gives it."""
        share = smooth_step((time - begin) / max(abs(duration), INTERVAL))
        share = share - share.mean()
        spread = (share**2).sum()
        offset = (share * across).sum() / spread if spread > 0.0 else 0.0
        rest = across - offset * share
        return rest @ rest, offset

    # a smooth step begins before its onset is seen, and ends later
    guess = np.array([onset - 0.1 * duration, 1.2 * max(duration, 0.5)])
    begin, duration = minimize(
        lambda step: fit(*step)[0],
        guess,
        method="Nelder-Mead",
        options={"xatol": 1e-3, "fatol": 1e-9},
    ).x
    return begin, abs(duration), fit(begin, duration)[1]


def cut_in(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> Measurement:
    """Measure a cut-in of any kind, by the vehicle that changes lane."""
    begin, duration, offset = _sideways(traffic, change)
    pair = _Pair(traffic, event["ego"], begin, _part(traffic, change.vehicle, begin, duration))
    values = pair.values | {"duration": duration}
    # In the scenario the actor comes from a ramp on the right and moves to the left, or from the
    # left lane and moves to the right. `offset` is the recorded direction.
    mirror = 1.0 if change.origin < 0 else -1.0
    return values, pair.motion(change.to, mirror * np.sign(offset))


def cut_out(traffic: RecordedTraffic, event: Event, change: RecordedLaneChange) -> Measurement:
    """Measure a lead vehicle that leaves the lane, and the vehicle that it reveals."""
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


def braking(traffic: RecordedTraffic, event: Event) -> Measurement:
    """Measure the braking of a lead vehicle, for as long as it exceeds `BRAKING_BELOW`."""
    whole = traffic.slices[event["lead"]]
    first = whole.start + round((event["t"] - traffic.t[whole.start]) / INTERVAL)
    acceleration = traffic.acceleration[first : whole.stop]
    # samples until the lead no longer brakes; 0 if it brakes to the end of its recording
    steps = int(np.argmax(acceleration > -BRAKING_BELOW))
    if steps < LEAST_BRAKING:
        raise NotMeasuredError(NOT_WHOLE)
    pair = _Pair(traffic, event["ego"], event["t"], slice(first, first + steps + 1))
    values = {
        "headway": pair.gap / max(pair.ego_speed, SLOWEST),
        "deceleration": -pair.acceleration,
        "duration": steps * INTERVAL,
    }
    return pair.values | values, pair.motion_in_lane(LEAD_MOVES)


def approach(traffic: RecordedTraffic, event: Event) -> Measurement:
    """Measure the first `APPROACH_WINDOW` of an approach to a slower lead vehicle."""
    part = _part(traffic, event["lead"], event["t"], APPROACH_WINDOW)
    pair = _Pair(traffic, event["ego"], event["t"], part)
    return pair.values, pair.motion_in_lane(LEAD_MOVES)


def lane_change(
    traffic: RecordedTraffic, event: Event, change: RecordedLaneChange, lead: str, rear: str
) -> Measurement:
    """Measure the ego's change to the left, between a lead vehicle and a vehicle behind it.

    lead, rear: names of these vehicles.
    """
    begin, duration, _ = _sideways(traffic, change)
    lead_x, lead_speed = position_at(traffic, lead, begin)
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
