"""Impossible states that SUMO may show of a vehicle: on no lane, jumped, faster than anything
drives.
"""

from __future__ import annotations

import math
from typing import Any

from sumo_eval.cosim.contact import Body
from sumo_eval.errors import SimulationError
from sumo_eval.scenario.concrete import Road

FASTEST = 1000.0  # m/s, what is shown beyond it is no motion of a vehicle
BACKWARDS = -1.0  # m/s, no speed is below 0
LOST = 1e9  # m and m/s; a vehicle that is on no lane has the place and the speed -1073741824
LIMIT_TOLERANCE = 1e-6  # m/s2
JUMP_TOLERANCE = 0.01  # m, motion of one step that speed cannot explain
BESIDE = 0.05  # m, nearer than this to where SUMO loses a vehicle it is kept


def farthest_in(step: float) -> float:
    """Distance that no road vehicle drives in a step, m: 100 m/s."""
    return FASTEST * step * 0.1


class LeftTheRoadError(Exception):
    """SUMO has lost the ego, because it has left the road."""


def front(body: Body) -> tuple[float, float]:
    """Centre of the front bumper, m."""
    half = 0.5 * body.length
    return body.x + half * math.cos(body.heading), body.y + half * math.sin(body.heading)


def leaves_the_lanes(ego: Body, road: Road, step: float) -> bool:
    """Whether the ego is, or within a step gets, where SUMO has no lane for it: its centre beside
    the road, or its front bumper's centre half a width off the road or beyond its ends.
    """
    ahead = ego.speed * step
    coming = ego._replace(
        x=ego.x + ahead * math.cos(ego.heading), y=ego.y + ahead * math.sin(ego.heading)
    )
    reach = 0.5 * ego.width - BESIDE
    for body in (ego, coming):
        x, y = front(body)
        right, left = float(road.right_edge_at(x)), float(road.left_edge_at(x))
        on_lanes = right - reach <= y <= left + reach and 0.0 <= x <= road.length + road.run_out
        beside = not road.right_edge_at(body.x) <= body.y <= road.left_edge_at(body.x)
        if beside or not on_lanes:
            return True
    return False


def impossible(
    calls: Any, name: str, last: tuple[float, float], now: float, step: float
) -> SimulationError:
    """An error with the impossible quantity that SUMO shows of a vehicle.

    last: its front bumper before, m.
    """
    x, y = calls.getPosition(name)
    angle, speed = calls.getAngle(name), calls.getSpeed(name)
    far = FASTEST * step
    if not (abs(x - last[0]) < far and abs(y - last[1]) < far):  # nan is less than nothing
        what = f"the place ({x:g}, {y:g}) m, a step after ({last[0]:.2f}, {last[1]:.2f}) m,"
    elif not BACKWARDS < speed < FASTEST:
        what = f"the speed {speed:g} m/s"
    else:
        what = f"the angle {angle:g} deg"
    return SimulationError(
        f"SUMO gave vehicle `{name}` {what} at {now:.2f} s, which no vehicle can have."
    )
