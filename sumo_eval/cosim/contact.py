"""A contact of the ego's body with another: where and how fast.

SUMO's own collision check sees lanes, not bodies, so the harness decides, by `scenario/touch.py`.

Users: `cosim/world.py`.
"""

import math

from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.touch import Body, velocity
from sumo_eval.trajectory import Collision, Side

# m by which bodies grow on every side, so that the corner that touches is inside the other
_GROWN = 1e-3


def describe(time: float, name: str, ego: Body, other: Body) -> Collision:
    """The collision at the instant of touching."""
    return Collision(
        time=time,
        other=name,
        ego_velocity=velocity(ego),
        other_velocity=velocity(other),
        overlap=bumper_overlap(ego, other),
        side=struck_side(ego, other),
        ego_pose=(ego.x, ego.y, ego.heading),
        other_pose=(other.x, other.y, other.heading),
    )


def _in_frame_of(body: Body, point: tuple[float, float]) -> tuple[float, float]:
    """A point as (ahead, left) of a body's centre, m."""
    return Pose(*point, 0.0).seen_from(Pose(*body[:3]))[:2]


def bumper_overlap(ego: Body, other: Body) -> float:
    """Share of the ego's width that the other body covers, seen along the ego's heading, 0..1."""
    across = [_in_frame_of(ego, corner)[1] for corner in other.corners()]
    half = 0.5 * ego.width
    # ends of the common part, m to the left of the ego's centre
    left = min(max(across), half)
    right = max(min(across), -half)
    return min(max((left - right) / ego.width, 0.0), 1.0)


def struck_side(ego: Body, other: Body) -> Side:
    """Touched face of the ego; at a corner, the face that the other body moves into faster."""
    corners = [corner for corner in other.corners() if _inside(ego, corner)]
    corners += [corner for corner in ego.corners() if _inside(other, corner)]
    # no corner is inside where bodies cross like a plus: the other's centre decides
    points = [_in_frame_of(ego, corner) for corner in corners or [(other.x, other.y)]]
    ahead, left = (sum(each) / len(points) for each in zip(*points, strict=True))
    depths: dict[Side, float] = {
        "front": 0.5 * ego.length - ahead,
        "rear": 0.5 * ego.length + ahead,
        "left": 0.5 * ego.width - left,
        "right": 0.5 * ego.width + left,
    }
    nearest = min(depths.values())
    # at a corner of the ego two faces are touched: both bodies have grown by `_GROWN`, so the
    # depths of the two differ by at most twice that
    candidates = [side for side, depth in depths.items() if depth <= nearest + 2.0 * _GROWN]
    own, others = velocity(ego), velocity(other)
    closing = others[0] - own[0], others[1] - own[1]
    c = math.cos(ego.heading)
    s = math.sin(ego.heading)
    forward, leftward = closing[0] * c + closing[1] * s, closing[1] * c - closing[0] * s
    # m/s, at which the other body moves into each face
    inward: dict[Side, float] = {
        "front": -forward,
        "rear": forward,
        "left": -leftward,
        "right": leftward,
    }
    return max(candidates, key=lambda side: inward[side])


def _inside(body: Body, point: tuple[float, float]) -> bool:
    """Whether a point lies in a body that has grown by `_GROWN`."""
    ahead, left = _in_frame_of(body, point)
    return abs(ahead) <= 0.5 * body.length + _GROWN and abs(left) <= 0.5 * body.width + _GROWN
