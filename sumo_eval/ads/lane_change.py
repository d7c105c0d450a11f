"""Paths across the road over x, and the steering that follows them.

A path is a function of the position along the road, not of time. So a vehicle that brakes during
its lane change needs no sharper curve, and the place where it is clear of the lead vehicle stays
where it was planned.

Users: `ads/`, `drivers/`.
"""

import functools
from math import atan, atan2, cos, sin, sqrt, tan
from typing import Any

from sumo_eval.errors import must_be
from sumo_eval.kernels import fields, kernel
from sumo_eval.scenario.concrete import lane_at
from sumo_eval.scenario.motion import quintic, quintic_bend, quintic_rate

PEAK_BEND = 10.0 / sqrt(3.0)  # largest second derivative of the smooth step
RATE = 1.0  # w of `steering`, 1/s: how fast an error decays
SLOW = 8.0  # m/s; at a lower speed an error decays with distance, at RATE / SLOW per metre

PATH = fields("start", "offset", "begin", "length")
"""A path: the parallel to the road at y = `start`, m; from x = `begin`, m, on a smooth step by
`offset` m to the left, `length` m of road long; then the parallel there. Offset 0: no step."""


@kernel
def smooth_step(share: float) -> float:
    """10 s^3 - 15 s^4 + 6 s^5, limited to 0..1."""
    return float(quintic(min(max(share, 0.0), 1.0)))


@kernel
def smooth_step_at(share: float) -> tuple[float, float, float]:
    """`smooth_step` and its first two derivatives, which are 0 outside 0..1."""
    s = min(max(share, 0.0), 1.0)
    return float(quintic(s)), float(quintic_rate(s)), float(quintic_bend(s))


@kernel
def path_y(path: Any, x: float) -> float:
    """y of a path at x, m."""
    return path_at(path, x)[0]


@kernel
def path_at(path: Any, x: float) -> tuple[float, float, float]:
    """A path at x: y, m; slope dy/dx; curvature d2y/dx2, 1/m."""
    if path.offset == 0.0:
        return path.start, 0.0, 0.0
    step, rate, bend = smooth_step_at((x - path.begin) / path.length)
    scale = path.offset / path.length
    return path.start + path.offset * step, scale * rate, scale / path.length * bend


@kernel
def keep_lane(path: Any, me: Any, road: Any) -> None:
    """Write to `path` the centre line of the lane that the ego is in."""
    path.start = road.lane_width * lane_at(road, me.y)
    path.offset, path.begin, path.length = 0.0, 0.0, 1.0


@kernel
def curvature_kept(path: Any, me: Any) -> float:
    """Curvature at the start of a path, 1/m: that of the parallel to the road's line.

    A drive begins with the steering wheel turned for this curvature. With a straight wheel the ego
    would leave the path in its first step, further the longer the step is.
    """
    line = line_curvature(me)
    return float(line / (1.0 - line * path.start))


@kernel
def line_curvature(me: Any) -> float:
    """Curvature of the road's line, 1/m, from that of its parallel at a vehicle (`curvature`)."""
    return float(me.curvature / (1.0 + me.curvature * me.y))


@kernel
def rear_axle_next(me: Any, scenario: Any) -> float:
    """x of the rear axle at the end of the coming step, m: where `steering` needs the path."""
    return float(me.x - 0.5 * scenario.vehicle.wheelbase + me.along * scenario.step)


@kernel
def steering(
    memory: Any, me: Any, path_y: float, slope: float, bend: float, scenario: Any
) -> float:
    """Steering wheel angle, rad, that keeps a kinematic single-track vehicle on a path.

    The rear axle follows the path y(x); the centre then follows it as well, up to wheelbase^2 / 8
    times the curvature. The curvature to steer, kappa, and the angle:

        kappa = kappa_path + (w / v)^2 e_y + 2 (w / v) e_psi
        angle = ratio * atan(wheelbase * kappa)

    kappa_path = y'' / (1 + y'^2)^(3/2). The errors e_y = path_y - y and e_psi = atan(y') - heading
    are those of the rear axle at the end of the coming step, predicted with the present curvature.
    The feedback is critically damped with the rate w = `RATE`, per second. Below the speed `SLOW`
    the rate w / v, per metre, no longer grows, so that a stopping vehicle does not turn its wheel
    without end.

    On a curved road the path is y(x) in the road's frame. The curvature of the parallel to the
    road's line through the path's point is added. Single-track model: Rajamani, Vehicle Dynamics
    and Control (2012), ch. 2.

    memory: its `curvature` is the present one, 1/m, and becomes the new one.
    path_y and the next two arguments: the values of `path_at` at `rear_axle_next`.
    """
    memory.curvature = steered(memory.curvature, me, path_y, slope, bend, scenario)
    return float(
        scenario.vehicle.steering_ratio * atan(scenario.vehicle.wheelbase * memory.curvature)
    )


@kernel
def steered(now: float, me: Any, path_y: float, slope: float, bend: float, scenario: Any) -> float:
    """The curvature, 1/m, that `steering` steers next; arguments as there.

    now: the present curvature, 1/m.
    """
    half = 0.5 * scenario.vehicle.wheelbase  # m from the centre to the rear axle
    ahead = me.speed * scenario.step  # m in the coming step
    per_metre = RATE / max(me.speed, SLOW)  # w / v
    # y and heading: of the rear axle at the end of the step; wanted: heading of the path there, rad
    if me.curvature == 0.0:  # a straight road
        mean_heading = me.heading + 0.5 * ahead * now
        y = me.y - half * sin(me.heading) + ahead * sin(mean_heading)
        heading = me.heading + ahead * now
        wanted = atan(slope)
        beside = 0.0  # curvature of the road's parallel at the path, 1/m
    else:
        line = line_curvature(me)
        y, heading = _rear_axle_on_a_curve(now, me, line, half, ahead)
        stretched = 1.0 / (1.0 - line * path_y)  # metres of the line for each metre of the path
        wanted, beside = atan(slope * stretched), line * stretched
        bend = bend * stretched * stretched
    cosine = cos(wanted)  # 1 / sqrt(1 + y'^2)
    return float(
        bend * (cosine * cosine * cosine)
        + per_metre * per_metre * (path_y - y)
        + 2.0 * per_metre * (wanted - heading)
        + beside
    )


@kernel
def _rear_axle_on_a_curve(
    now: float, me: Any, line: float, half: float, ahead: float
) -> tuple[float, float]:
    """y, m, and heading, rad, of the rear axle at the end of the coming step, on a curved road.

    now, line: present curvature of the vehicle's motion, and that of the road's line, 1/m.
    half: from the centre to the rear axle, m. ahead: distance of the step, m.
    """
    # from the centre back to the rear axle
    left, turn = beside_an_arc(me.curvature, -half * cos(me.heading), -half * sin(me.heading))
    y, heading = me.y + left, me.heading - turn
    # the rear axle's motion in the coming step
    mean_heading = heading + 0.5 * ahead * now
    left, turn = beside_an_arc(
        line / (1.0 - line * y), ahead * cos(mean_heading), ahead * sin(mean_heading)
    )
    return y + left, heading + ahead * now - turn


@kernel
def beside_an_arc(curvature: float, ahead: float, left: float) -> tuple[float, float]:
    """End of a straight move that starts on an arc, seen from the arc: distance to its left, m, and
    by how much the arc has turned beside the end, rad:

        (2 l - k (a^2 + l^2)) / (1 + sqrt(1 + k^2 (a^2 + l^2) - 2 k l)),  atan2(k a, 1 - k l)

    curvature: k, of the arc, 1/m.
    ahead, left: a and l, the move in the arc's direction at its start, and to the left of that, m.
    """
    square = ahead * ahead + left * left
    root = sqrt(max(1.0 + curvature * (curvature * square - 2.0 * left), 0.0))
    return (2.0 * left - curvature * square) / (1.0 + root), atan2(
        curvature * ahead, 1.0 - curvature * left
    )


@kernel
def lane_kept(ego: Any, scenario: Any) -> float:
    """Steering wheel angle, rad, for rules that decide on the pedals alone.

    The ego follows `ego.way` (see `cosim.records`): the parallel to the road's line on which it
    began, and the lane change that it has to make. On a straight road without a lane change the
    angle is 0.
    """
    if scenario.road.bent == 0 and ego.way.asked == 0:
        return 0.0
    vehicle = scenario.vehicle
    # curvature that the vehicle drives now, 1/m
    now = tan(ego.steering / vehicle.steering_ratio) / vehicle.wheelbase
    y, slope, bend = path_at(ego.way, rear_axle_next(ego.seen, scenario))
    curvature = steered(now, ego.seen, y, slope, bend, scenario)
    return float(vehicle.steering_ratio * atan(vehicle.wheelbase * curvature))


@functools.cache  # every driver of a population calls it with the same share
def share_of_duration(done: float) -> float:
    """The share of a lane change's duration, 0..1, after which the share `done` of its offset,
    0..1, is covered.
    """
    if not 0.0 <= done <= 1.0:
        raise must_be("`done`", "a lane change", "within 0..1", done)
    return share_when_done(done)


@kernel
def share_when_done(done: float) -> float:
    """`share_of_duration`, the inverse of `smooth_step`, without the check; by bisection."""
    low, high = 0.0, 1.0
    for _ in range(40):  # to 1e-12
        middle = 0.5 * (low + high)
        if smooth_step(middle) < done:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def shortest_duration(offset: float, lateral_acceleration: float) -> float:
    """Duration of a smooth step, s, that peaks at `lateral_acceleration`, m/s2, at constant speed:
    sqrt(PEAK_BEND |offset| / lateral_acceleration).

    offset: m.
    """
    return sqrt(PEAK_BEND * abs(offset) / lateral_acceleration)
