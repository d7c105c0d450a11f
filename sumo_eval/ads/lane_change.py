"""Where to be across the road, as a path over x, and the steering that follows it.

A path is a function of the position along the road, not of time: a vehicle that brakes during its lane change needs no
sharper curve, and the place where it is clear of the vehicle ahead stays where it was planned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from sumo_eval.ads.perception import Mover
from sumo_eval.errors import must_be
from sumo_eval.settings import VehicleSettings

PEAK_BEND = 10.0 / math.sqrt(3.0)  # largest second derivative of the smooth step


class PathPoint(NamedTuple):
    """A path y(x) at one x: y, m; slope dy/dx; bend d2y/dx2, 1/m."""

    y: float
    slope: float
    bend: float


@dataclass(frozen=True, slots=True)
class LanePath:
    """A lane's centre line, and from `begin` on, over `length` m of road, the smooth step by `offset` m to the left.

    begin: x, m. start: y before it, m. y = start + offset (10 s^3 - 15 s^4 + 6 s^5), s = (x - begin) / length: straight
    and at rest at both ends.
    """

    start: float
    offset: float = 0.0
    begin: float = 0.0
    length: float = 1.0

    def __post_init__(self) -> None:
        if not self.length > 0.0:
            raise must_be("`length`", "a lane change", "greater than 0 m", self.length)

    @property
    def target(self) -> float:
        """y at the end, m."""
        return self.start + self.offset

    def y(self, x: float) -> float:
        """y at x, m."""
        if self.offset == 0.0:
            return self.start
        return self.start + self.offset * smooth_step((x - self.begin) / self.length)

    def at(self, x: float) -> PathPoint:
        """y, slope and bend at x."""
        s = (x - self.begin) / self.length
        if s <= 0.0 or self.offset == 0.0:
            return PathPoint(self.start, 0.0, 0.0)
        if s >= 1.0:
            return PathPoint(self.start + self.offset, 0.0, 0.0)
        scale = self.offset / self.length
        return PathPoint(
            self.start + self.offset * smooth_step(s),
            scale * smooth_step_rate(s),
            scale / self.length * smooth_step_bend(s),
        )


def smooth_step(share: float) -> float:
    """10 s^3 - 15 s^4 + 6 s^5, limited to 0..1: `sumo_eval.scenario.concrete.smooth_step` for one plain float."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 + s * (-15.0 + 6.0 * s))


def smooth_step_rate(share: float) -> float:
    """Derivative of `smooth_step`: 30 s^2 (1 - s)^2, 0 outside 0..1."""
    s = min(max(share, 0.0), 1.0)
    return 30.0 * s * s * (1.0 - s) * (1.0 - s)


def smooth_step_bend(share: float) -> float:
    """Second derivative of `smooth_step`: 60 s (1 - s) (1 - 2 s), 0 outside 0..1."""
    s = min(max(share, 0.0), 1.0)
    return 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)


def share_of_duration(done: float) -> float:
    """The share of a lane change's duration at which the share `done` of its offset is covered (0..1 -> 0..1)."""
    if not 0.0 <= done <= 1.0:
        raise must_be("`done`", "a lane change", "within 0..1", done)
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if smooth_step(middle) < done else (low, middle)
    return 0.5 * (low + high)


def shortest_duration(offset: float, lateral_acceleration: float) -> float:
    """Duration of a smooth step by `offset` (m) that peaks at `lateral_acceleration` (m/s2), s, at constant speed.

    sqrt(PEAK_BEND |offset| / lateral_acceleration).
    """
    return math.sqrt(PEAK_BEND * abs(offset) / lateral_acceleration)


class Steering:
    """Steering wheel angles that keep a kinematic single-track vehicle on a path.

    The rear axle is led along y(x) (the centre then runs on it as well, up to wheelbase^2/8 times the curvature):

        kappa = kappa_path + (w/v)^2 e_y + 2 (w/v) e_psi,    steering = ratio * atan(wheelbase * kappa)

    kappa_path = y'' / (1 + y'^2)^(3/2); e_y = y_path - y, e_psi = atan(y') - heading, both at the rear axle at the end
    of the coming step, predicted with the curvature now steered. The feedback is critically damped with the rate w, per
    second; below `SLOW` it becomes one per metre, so that a stopping vehicle does not turn its wheel without end.
    Single-track model: Rajamani, Vehicle Dynamics and Control (2012), ch. 2.
    """

    RATE = 1.0  # w, 1/s
    SLOW = 8.0  # m/s

    def __init__(self, vehicle: VehicleSettings, step: float) -> None:
        self._wheelbase = vehicle.wheelbase
        self._ratio = vehicle.steering_ratio
        self._step = step
        self._curvature = 0.0

    def rear_axle_next(self, me: Mover) -> float:
        """x of the rear axle at the end of the coming step, m: where the path is asked for."""
        return me.x - 0.5 * self._wheelbase + me.along * self._step

    def angle(self, me: Mover, point: PathPoint) -> float:
        """Steering wheel angle, rad, for a vehicle `me` whose path is `point` at `rear_axle_next(me)`."""
        speed = me.speed
        turned = me.heading + 0.5 * speed * self._step * self._curvature
        y = me.y - 0.5 * self._wheelbase * math.sin(me.heading) + speed * self._step * math.sin(turned)
        heading = me.heading + speed * self._step * self._curvature
        per_metre = self.RATE / max(speed, self.SLOW)
        wanted = math.atan(point.slope)
        self._curvature = (
            point.bend * math.cos(wanted) ** 3
            + per_metre * per_metre * (point.y - y)
            + 2.0 * per_metre * (wanted - heading)
        )
        return self._ratio * math.atan(self._wheelbase * self._curvature)
