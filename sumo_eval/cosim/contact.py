"""Description of a contact of the ego's body with another body: where and how fast.

`cosim/step_rules.py` finds contacts by `scenario/touch.py`, as SUMO's own collision check sees
lanes, not bodies.

Users: `cosim/recordings.py`.
"""

from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.touch import Body, velocity
from sumo_eval.trajectory import Collision, Side

# m by which bodies grow on every side, so that the touching corner is inside the other body
_GROWN = 1e-3


def describe(time: float, name: str, ego: Body, other: Body) -> Collision:
    """The collision at the instant of touching.

    time: s. name: of the other vehicle.
    """
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
    ahead, left = _touching_point(ego, other)
    # m from the touching point to each face of the ego
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
    speeds = _inward_speeds(ego, other)
    return max(candidates, key=lambda side: speeds[side])


def _touching_point(ego: Body, other: Body) -> tuple[float, float]:
    """Mean of the corners inside the other body, as (ahead, left) of the ego's centre, m."""
    corners = [corner for corner in other.corners() if _inside(ego, corner)]
    corners += [corner for corner in ego.corners() if _inside(other, corner)]
    # no corner is inside where bodies cross like a plus: take the other body's centre
    points = [_in_frame_of(ego, corner) for corner in corners or [(other.x, other.y)]]
    ahead, left = (sum(each) / len(points) for each in zip(*points, strict=True))
    return ahead, left


def _inward_speeds(ego: Body, other: Body) -> dict[Side, float]:
    """Speeds at which the other body moves into each face of the ego, m/s."""
    # both velocities as points, seen from the ego's in the direction of its heading
    closing = Pose(*velocity(other), 0.0).seen_from(Pose(*velocity(ego), ego.heading))
    forward, leftward, _ = closing
    return {"front": -forward, "rear": forward, "left": -leftward, "right": leftward}


def _inside(body: Body, point: tuple[float, float]) -> bool:
    """Whether a point lies in a body that has grown by `_GROWN`."""
    ahead, left = _in_frame_of(body, point)
    return abs(ahead) <= 0.5 * body.length + _GROWN and abs(left) <= 0.5 * body.width + _GROWN
