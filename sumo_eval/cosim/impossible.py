"""Limits of what SUMO may show of a vehicle. A vehicle beyond them is on no lane, has jumped, or is
faster than any vehicle.

Users: `ads/foresight.py`, `cosim/ego_control.py`, `cosim/ego_motion.py`, `cosim/lane_places.py`,
`cosim/loop.py`, `cosim/on_traci.py`, `cosim/stage.py`, `cosim/step_rules.py`,
`cosim/traffic.py`, `cosim/world.py`.
"""

from typing import Any

from sumo_eval.errors import SimulationError
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.touch import Body

FASTEST = 1000.0  # m/s; a higher speed in SUMO's answer is an error, not a motion
LOWEST_SPEED = -1.0  # m/s; SUMO's speeds are 0 or above, a lost vehicle's is far below
# m; SUMO shows a vehicle that is on no lane at the position -1073741824 m, and at that speed in m/s
LOST = 1e9
LIMIT_TOLERANCE = 1e-6  # m/s2, rounding of a change of speed at a limit of acceleration
JUMP_TOLERANCE = 0.01  # m, motion of one step that speed cannot explain
FARTHEST = 100.0  # m; no step moves a front bumper further, by driving or by turning round
LOSS_MARGIN = 0.05  # m; a vehicle counts as off the road this much before SUMO would lose it


def farthest_in(step: float) -> float:
    """Distance in m that no road vehicle exceeds in a step: at 100 m/s, a tenth of `FASTEST`."""
    return FASTEST * step * 0.1  # in this order: results depend on its last bit


class LeftTheRoadError(Exception):
    """SUMO has lost the ego, because it has left the road."""


def leaves_the_lanes(ego: Body, road: Road, step: float) -> bool:
    """Whether the ego is where SUMO has no lane for it, or gets there within a step.

    SUMO has no lane for it where the body's centre is beside the road, or where the centre of the
    front bumper is half a width off the road or beyond its ends.

    step: s.
    """
    reach = 0.5 * ego.width - LOSS_MARGIN
    for body in (ego, ego.moved(ego.speed * step)):
        x, y, *_ = body.moved(0.5 * body.length)  # the centre of the front bumper
        if not (
            road.right_edge_at(body.x) <= body.y <= road.left_edge_at(body.x)
            and road.right_edge_at(x) - reach <= y <= road.left_edge_at(x) + reach
            and 0.0 <= x <= road.end
        ):
            return True
    return False


def impossible(calls: Any, name: str, last: tuple[float, float], now: float) -> SimulationError:
    """An error that names the impossible place, speed or angle which SUMO shows of a vehicle.

    calls: SUMO's vehicles, as `traci.vehicle`.
    last: centre of its front bumper a step before, x and y, m.
    now: s.
    """
    x, y = calls.getPosition(name)
    angle = calls.getAngle(name)
    speed = calls.getSpeed(name)
    # the same limit as in `Stage._read_actor`; with `not`, so that nan is impossible as well
    if not (abs(x - last[0]) < FARTHEST and abs(y - last[1]) < FARTHEST):
        what = f"the place ({x:g}, {y:g}) m, a step after ({last[0]:.2f}, {last[1]:.2f}) m,"
    elif not LOWEST_SPEED < speed < FASTEST:
        what = f"the speed {speed:g} m/s"
    else:
        what = f"the angle {angle:g} deg"
    return SimulationError(
        f"SUMO gave vehicle `{name}` {what} at {now:.2f} s, which no vehicle can have."
    )
