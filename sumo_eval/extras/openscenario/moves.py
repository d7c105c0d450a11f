"""Actions of a scenario file during the drive, as acts of an actor. `scene` and `story` call them
in the order of the file.

Interpretations, where the standard leaves a choice or this package supports less:

- A speed, lane or offset relative to the ego is relative to the one at its start, because an ADS's
  motion is unknown before the drive. Only a move made by `match_vehicle` follows the drive.
- SynchronizeAction is planned once, when it begins, for a master that keeps its speed
  (`synchronized`).
- A `rate` is the peak rate of a change, `maxLateralAcc` the peak lateral acceleration.
- The sign of a `rate` is ignored; the target gives the direction.

Functions for one kind of action take the action's element, the entity that moves, and when the move
begins. They return when it begins and ends.

Users: `extras/openscenario/scene.py`, `extras/openscenario/starts.py`,
`extras/openscenario/story.py`.
"""

import math
from dataclasses import replace

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.acts import (
    ACROSS,
    NO_MOVE,
    SPEEDS,
    FileTraffic,
    add_act,
    changes_speed,
    depend_on,
    match_vehicle,
    note_plan,
    unended_move,
)
from sumo_eval.extras.openscenario.drive_numbers import (
    constant,
    of_vehicle,
    operation,
    vehicle_number,
)
from sumo_eval.extras.openscenario.frame import ORIGIN, SAME, Frame
from sumo_eval.extras.openscenario.moments import AT_ONCE, NEVER, Moment, Span
from sumo_eval.extras.openscenario.network import ON, Lane, MapRoad, in_frame
from sumo_eval.extras.openscenario.places import (
    Entity,
    MapPath,
    Places,
    PlannedMove,
    Spot,
    UnplacedError,
)
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.scenario.played import (
    ALONG,
    AND,
    AT_MOST,
    BELOW,
    BY_TIME,
    CONSTANT,
    COSINE,
    ENDED,
    KEEP,
    LARGER,
    PATH,
    SPEED,
    Act,
    Pairs,
    X,
    Y,
)
from sumo_eval.scenario.road.pose import Pose

_PEAKS = {"linear": 1.0, "sinusoidal": 0.5 * math.pi, "cubic": 1.5}
"""Ratio of the peak of the rate to its mean, by the shape of a change."""
_STRONGEST = {"sinusoidal": 0.5 * math.pi**2, "cubic": 6.0}
"""Peak lateral acceleration of a move by 1 m in 1 s, m/s2, by its shape."""
_DIMENSIONS = ("rate", "time", "distance")
_SHAPES = ("linear", "step", "cubic", "sinusoidal")
_SHARES = np.arange(1, 33) / 32  # knots of a curved change of speed, as shares of its time
_THERE = 0.05  # m and m/s: a distance and a speed within this count as reached
_AT_PATH = 0.5  # m: an entity this near to its trajectory is on it
_MOST = 1e3  # m/s or m/s2: a limit that never acts, where the file has none
# faults
_STEADY = "over the distance of a lateral move the speed must stay the same, above 0 m/s"
_FROM_ZERO = "the times of a trajectory must begin with 0 s when it begins"


def begin_action(traffic: FileTraffic, element: Node, entity: Entity, moment: Moment) -> Span:
    """Give an entity the act of an action; return when the action begins and ends.

    element: the action, as <SpeedAction>, or its holder, as <LongitudinalAction>.
    """
    if entity.deleted:
        return Span(moment, moment.time)
    if element.tag in ("LongitudinalAction", "LateralAction", "RoutingAction"):
        element = element.only_child()
    readers = {
        "SpeedAction": _change_speed, "LaneChangeAction": _change_lane,
        "LaneOffsetAction": _take_offset, "LongitudinalDistanceAction": _keep_distance,
        "FollowTrajectoryAction": _follow_trajectory, "SynchronizeAction": _synchronize,
    }  # fmt: skip
    move = entity.next_move
    span = element.chosen(readers, "moves")(traffic, element, entity, moment)
    # Where the action became no act, the entity's next act gets the number `move`. Plans that
    # this action noted under this number must not count as that act's own.
    if entity.next_move == move:
        for other in traffic.places.entities.values():
            other.plans = [
                plan._replace(move=NO_MOVE) if plan.move == move else plan for plan in other.plans
            ]
    return span


# -- speeds ----------------------------------------------------------------------------------------


def _change_speed(traffic: FileTraffic, element: Node, entity: Entity, begin: Moment) -> Span:
    speed = target_speed(element, traffic.places, entity)
    dynamics = traffic.places.exact(element.child("SpeedActionDynamics"))
    target = element.child("SpeedActionTarget").only_child()
    if target.flag("continuous"):
        if not is_step(dynamics):
            raise dynamics.fault("a continuous speed is supported with the shape `step` only")
        return _keep_relative(traffic, target, entity, begin, speed)
    shape = dynamics.one_of("dynamicsShape", _SHAPES)
    # During an earlier change, the speed lies between its ends: assume the end from which this
    # change takes longer.
    ends = (entity.pace, entity.before) if changes_speed(entity, begin) else (entity.pace,)
    first = max(ends, key=lambda it: abs(it - speed))
    change = abs(speed - first)
    if target.tag == "RelativeTargetSpeed":
        other = depend_on(traffic, target, entity, begin, SPEEDS)
        if unended_move(traffic, other, begin, SPEEDS) or changes_speed(other, begin):
            raise target.fault(f"the speed of `{other.name}` when this begins is unknown")
    unsure = unended_move(traffic, entity, begin, SPEEDS)
    # It has the speed already and needs no act. An event further down in the file must not
    # change the speed before (`note_plan`).
    if change <= SAME and begin.known and not unsure:
        note_plan(entity, begin, SPEEDS, dynamics, NO_MOVE)
        return Span(begin, begin.time)
    # The speed at the begin is unknown. Or the move begins by a condition: an event further
    # down in the file may then change the speed before, and the act must set it again.
    if unsure or change <= SAME:
        return _from_any_speed(traffic, dynamics, entity, begin, speed)
    step = is_step(dynamics)
    rate = change / AT_ONCE if step else _rate(dynamics, entity, begin, speed)
    if rate == 0.0:  # it never reaches the speed
        return Span(begin, NEVER)
    lasts = change / rate
    act = Act(SPEED, speed=speed, acceleration=rate)
    if shape in _STRONGEST and not step:
        act = _curved_change(shape, entity.pace, speed, rate)
    entity.before, entity.pace = first, speed
    entity.steady = begin.time + lasts if begin.known else 0.0
    # all but a step and a linear change by rate depend on the speed at which they begin
    if not step and (shape, dynamics.text("dynamicsDimension")) != ("linear", "rate"):
        note_plan(entity, begin, SPEEDS, dynamics, entity.next_move)
    return add_act(traffic, entity, begin, act, lasts)


def target_speed(action: Node, places: Places, mover: Entity) -> float:
    """The speed that a SpeedAction of an entity leads to, m/s."""
    target = action.child("SpeedActionTarget").only_child()
    speed = target.number("value")
    if target.tag == "RelativeTargetSpeed":
        other = places.referred(target)
        vehicle_number(other, target)  # refuses a deleted entity
        # `waits` includes this action, if the speed is relative to the entity's own
        if other.waits > (other is mover):
            raise UnplacedError("", other.name)  # no text: `starts` tries again later
        speed = other.pace * speed if _by_factor(target) else other.pace + speed
    elif target.tag != "AbsoluteTargetSpeed":
        raise target.unsupported()
    if speed < 0.0:
        raise target.fault(f"the speed must be at least 0 m/s, got {speed:g}")
    return speed


def is_step(dynamics: Node) -> bool:
    """Whether a change is a step, or takes 0 s."""
    if dynamics.one_of("dynamicsShape", _SHAPES) == "step":
        return True
    return dynamics.text("dynamicsDimension", "") == "time" and dynamics.number("value") == 0.0


def _keep_relative(
    traffic: FileTraffic, target: Node, entity: Entity, begin: Moment, speed: float
) -> Span:
    """A speed relative to another entity's at every instant, without end.

    target: <RelativeTargetSpeed>.
    speed: its value by the other entity's speed so far, m/s.
    """
    entity.pace, value = speed, target.number("value")
    factor, added = (value, 0.0) if _by_factor(target) else (1.0, value)
    other = traffic.places.referred(target)
    if other is entity and (factor, added) != (1.0, 0.0):  # it would change in every step
        raise target.fault(
            f"a continuous speed must be relative to another entity, got `{entity.name}` itself"
        )
    number = float(vehicle_number(other, target))
    # pairs as in `_keep_distance`: the second 0 keeps the speed alone, so the last pair is unused
    return match_vehicle(traffic, entity, begin, (number, factor), (added, 0.0), (0.0, 0.0))


def _by_factor(target: Node) -> bool:
    """Whether a relative speed is a factor; otherwise it is a difference."""
    return target.one_of("speedTargetValueType", ("delta", "factor")) == "factor"


def _from_any_speed(
    traffic: FileTraffic, dynamics: Node, entity: Entity, begin: Moment, speed: float
) -> Span:
    """A change from whatever speed the entity then has, at once or at a constant rate."""
    kind, step = dynamics.one_of("dynamicsDimension", _DIMENSIONS), is_step(dynamics)
    if not step and (dynamics.text("dynamicsShape") != "linear" or kind == "distance"):
        raise dynamics.fault(f"the speed of `{entity.name}` when this begins is unknown")
    if step or kind == "time":
        lasts = AT_ONCE if step else dynamics.above_zero("value")
        act = Act(BY_TIME, table=((lasts, speed),))
    else:
        rate = abs(dynamics.number("value"))
        if rate == 0.0:  # it never reaches the speed
            return Span(begin, NEVER)
        act = Act(SPEED, speed=speed, acceleration=rate)
    entity.pace = speed
    # its duration is unknown: it ends by a condition even where it begins at a time
    add_act(traffic, entity, begin, act, NEVER)
    return Span(begin, NEVER, entity.ended())


def _rate(dynamics: Node, entity: Entity, begin: Moment, speed: float) -> float:
    """The mean rate of a change of speed, m/s2."""
    kind = dynamics.one_of("dynamicsDimension", _DIMENSIONS)
    shape = dynamics.text("dynamicsShape")
    if (kind, shape) != ("rate", "linear") and changes_speed(entity, begin):
        raise dynamics.fault(
            f"`{entity.name}` still changes its speed when this begins, at {begin.time:g} s: "
            "only a linear change by `rate` is supported then"
        )
    if kind == "rate":
        return abs(dynamics.number("value")) / _PEAKS[shape]
    change, value = abs(speed - entity.pace), dynamics.above_zero("value")  # value: s or m
    # Every shape is symmetric, so the mean speed over a distance is the mean of both ends.
    return change / value * (1.0 if kind == "time" else 0.5 * (speed + entity.pace))


def _curved_change(shape: str, before: float, after: float, rate: float) -> Act:
    """A cubic or sinusoidal change of a speed, m/s; rate: its mean, m/s2."""
    # share of the change that is done after each share of the time: `cubic` 3 s^2 - 2 s^3
    shares = _SHARES * _SHARES * (3.0 - 2.0 * _SHARES)
    if shape == "sinusoidal":
        shares = 0.5 * (1.0 - np.cos(math.pi * _SHARES))
    speeds = before + (after - before) * shares
    table = np.column_stack([_SHARES * abs(after - before) / rate, speeds]).tolist()
    return Act(BY_TIME, table=tuple(map(tuple, table)))


# -- distances -------------------------------------------------------------------------------------


def place_apart(traffic: FileTraffic, element: Node, entity: Entity) -> None:
    """Put an entity at the distance of a LongitudinalDistanceAction at the start."""
    other, apart, gap = _apart(traffic, element, entity)
    # m ahead over the ground: the time gap times the speed of the vehicle behind, which is
    # `other` if the gap is below 0
    further = -gap * (other.speed if gap < 0.0 else entity.speed)
    x = other.frame.x + (apart + further / traffic.frame.ground(other.frame))
    entity.frame = entity.frame._replace(x=x)


def _apart(traffic: FileTraffic, element: Node, entity: Entity) -> tuple[Entity, float, float]:
    """Where a LongitudinalDistanceAction wants the entity, relative to a second entity.

    Returns the second entity; how far ahead of its centre the entity's centre must be, m along
    the road's line; and the time gap by which the centre must be further behind, s, as in
    `played.PLAY` under `match`. Both numbers may be below 0.
    """
    other = traffic.places.referred(element)
    if other is entity:
        raise element.fault(f"a distance must be to another entity, got `{entity.name}` itself")
    if entity.leaves_lane or other.on_map:
        raise element.fault("a distance of an entity that leaves its lane is not supported")
    # on a curve the distance is along the lane, not along the file's reference line
    systems = ("entity", "lane") if traffic.frame.line else ("entity", "lane", "road")
    element.one_of("coordinateSystem", systems, "entity")
    sides = ("any", "leadingReferencedEntity", "trailingReferencedEntity")
    side = element.one_of("displacement", sides, "any")
    ahead = entity.frame.x >= other.frame.x if side == "any" else side.startswith("leading")
    apart = 0.0 if element.get("timeGap") is not None else element.not_negative("distance")
    free = element.flag("freespace")
    if free:
        apart += 0.5 * (entity.length + other.length)
    # without `freespace` the distance is between reference points, not centres
    apart = (apart if ahead else -apart) + (0.0 if free else entity.centre - other.centre)
    gap = element.not_negative("timeGap", 0.0) * (-1.0 if ahead else 1.0)
    return other, apart / traffic.frame.ground(other.frame), gap


def _keep_distance(traffic: FileTraffic, element: Node, entity: Entity, begin: Moment) -> Span:
    limits = element.find("DynamicConstraints")
    once = not element.flag("continuous")
    if once and not limits:
        if not begin.known or begin.time > 0.0:
            raise element.fault("without <DynamicConstraints> it is supported at the start only")
        place_apart(traffic, element, entity)
        return Span(begin, begin.time)
    other, apart, gap = _apart(traffic, element, entity)
    # m by which it is further ahead, relative to the other, when it begins
    gained = (entity.pace - other.pace) * begin.time
    leads_now, leads_then = (entity.frame.x + it >= other.frame.x for it in (0.0, gained))
    if element.text("displacement", "any") == "any" and leads_now != leads_then:
        raise element.fault(
            f"its `displacement` must say whether `{entity.name}` leads, as it may pass "
            f"`{other.name}` before"
        )
    if other is not traffic.ego:  # the ego's speed during the drive is unknown
        entity.pace = other.pace
    # pairs of `played.PLAY` under `match`: (followed vehicle, factor), (speed added, kept: 1 a
    # position, 2 one within limits), (distance, time gap)
    keeps = (
        (float(vehicle_number(other, element)), 1.0),
        (0.0, 2.0 if limits else 1.0),
        (apart, gap),
    )
    if not limits:
        return match_vehicle(traffic, entity, begin, *keeps)
    for name in ("maxAccelerationRate", "maxDecelerationRate"):
        if limits.get(name) is not None:
            raise limits.fault(f"`{name}` is not supported")
    fastest = limits.number("maxSpeed", _MOST)
    rates = limits.number("maxAcceleration", _MOST), limits.number("maxDeceleration", _MOST)
    span = match_vehicle(traffic, entity, begin, *keeps, rates, (fastest, 0.0))
    return _until_there(traffic, entity, other, begin, apart, gap) if once else span


def _until_there(
    traffic: FileTraffic, entity: Entity, other: Entity, begin: Moment, apart: float, gap: float
) -> Span:
    """End a LongitudinalDistanceAction where the entity has the distance and the other's speed:
    from then on it keeps its speed.

    apart, gap: as `_apart` returns them.
    """
    # A condition can read only the end of an act: that of a move by 0 m, which ends at once,
    # shows that the action has begun.
    add_act(traffic, entity, begin, Act(COSINE, 0.0, AT_ONCE), 0.0)
    has_begun = entity.ended()

    x, target_x = (of_vehicle(X, it.number) for it in (entity, other))
    speed, target = (of_vehicle(ALONG, it.number) for it in (entity, other))
    # m along the line by which the time gap puts it behind, at the speed of the vehicle behind;
    # `played` too converts the ground's metres where the entity drives
    behind = constant(gap / traffic.frame.ground(entity.frame)) * (target if gap < 0.0 else speed)
    # the larger of both differences must be below `_THERE`
    off = abs(target_x + constant(apart) - behind - x).joined(LARGER, abs(target - speed))
    ends = (*off.program, *constant(_THERE).program, operation(BELOW))
    has_arrived = (*has_begun, *ends, operation(AND))
    entity.acts.append(Act(KEEP, program=has_arrived))
    # KEEP never ends: the end of a second move by 0 m shows that KEEP has begun
    return add_act(traffic, entity, Moment(0.0, has_arrived), Act(COSINE, 0.0, AT_ONCE), NEVER)


# -- lateral moves ---------------------------------------------------------------------------------


def _change_lane(traffic: FileTraffic, element: Node, entity: Entity, begin: Moment) -> Span:
    lane = _target_lane(traffic, element.child("LaneChangeTarget").only_child(), entity, begin)
    t = lane.centre + element.number("targetLaneOffset", 0.0)
    offset = _y(traffic.frame, t, element, entity) - _axle_y(entity)
    dynamics = traffic.places.exact(element.child("LaneChangeActionDynamics"))
    shape = _shape(dynamics, "lateral move", *_PEAKS)
    value = dynamics.above_zero("value")  # m/s, s or m
    kind = dynamics.one_of("dynamicsDimension", _DIMENSIONS)
    if kind == "time":
        lasts = value
    elif kind == "rate":
        lasts = abs(offset - entity.moved) / value * _PEAKS[shape]
    else:
        unsure = changes_speed(entity, begin) or unended_move(traffic, entity, begin, SPEEDS)
        if unsure or entity.pace <= 0.0:
            raise dynamics.fault(_STEADY)
        lasts = value / entity.pace
        # A later act must not change the speed before the move has ended. A move by 0 m
        # becomes no act, and needs no steady speed.
        if abs(offset - entity.moved) > ON:
            until = begin.time + lasts if begin.known else math.inf
            entity.plans.append(
                PlannedMove(until, SPEEDS, dynamics.fault(_STEADY), entity.next_move)
            )
    return _across(traffic, element, entity, begin, offset, lasts, shape)


def _target_lane(traffic: FileTraffic, target: Node, entity: Entity, begin: Moment) -> Lane:
    """The lane that a <LaneChangeTarget> names; target: its child."""
    if target.tag == "RelativeTargetLane":
        other = depend_on(traffic, target, entity, begin, ACROSS)
        of_other, lane = _lane_now(traffic.frame, other, target)
        if of_other.name != traffic.frame.road:
            raise target.fault(f"`{other.name}`, to which it is relative, is not on the ego's road")
        # `value` counts to the left as seen by that entity
        lanes = target.whole("value") * (other.placed().way or 1)
        return traffic.places.lane_beside(of_other, lane, lanes, target)
    if target.tag != "AbsoluteTargetLane":
        raise target.unsupported()
    road = entity.placed().road
    if not road:
        raise target.fault("the entity is on no road")
    return traffic.places.network.lane(road, target.text("value"), target)


def _take_offset(traffic: FileTraffic, element: Node, entity: Entity, begin: Moment) -> Span:
    target = element.child("LaneOffsetTarget").only_child()
    continuous = element.flag("continuous")
    if target.tag == "RelativeTargetLaneOffset":
        if continuous:
            raise target.fault("an offset that is kept to another entity is not supported")
        other = depend_on(traffic, target, entity, begin, ACROSS)
        y = _axle_y(other) + other.moved
    elif target.tag == "AbsoluteTargetLaneOffset":
        y = _y(traffic.frame, _lane_now(traffic.frame, entity, target)[1].centre, element, entity)
    else:
        raise target.unsupported()
    offset = y + traffic.frame.way * target.number("value") - _axle_y(entity)
    dynamics = element.child("LaneOffsetActionDynamics")
    shape = _shape(dynamics, "lateral move with `maxLateralAcc`", *_STRONGEST)
    strongest = dynamics.above_zero("maxLateralAcc", " m/s2")
    lasts = math.sqrt(_STRONGEST[shape] * abs(offset - entity.moved) / strongest)
    span = _across(traffic, element, entity, begin, offset, lasts, shape)
    # every actor keeps its offset; a continuous action never ends
    return Span(begin, NEVER) if continuous else span


def _shape(dynamics: Node, what: str, *shapes: str) -> str:
    """The shape of a change; an InputError if it is not one of `shapes`.

    what: name of the change in the message.
    """
    shape = dynamics.one_of("dynamicsShape", _SHAPES)
    if shape not in shapes:
        names = " and ".join(f"`{name}`" for name in shapes)
        raise dynamics.fault(f"a {what} of the shape `{shape}` is not supported, {names} are")
    return shape


def _lane_now(frame: Frame, other: Entity, element: Node) -> tuple[MapRoad, Lane]:
    """Road and lane of an entity when a move relative to it begins.

    They are those after its lateral moves so far; of the ego, which has none, at its start.
    """
    spot = other.placed()
    road, lane = spot.in_lane(element)
    if other.moved == 0.0:
        return road, lane
    now = road.lane_at(spot.t + frame.way * other.moved)
    if not now:
        raise element.fault(f"`{other.name}`, to which it is relative, is in no lane any more")
    return road, now


def _y(frame: Frame, t: float, element: Node, entity: Entity) -> float:
    """y in the frame of a place `t` m to the left of the reference line of the ego's road."""
    road = entity.placed().road
    if not road or road.name != frame.road:
        raise element.fault("a lateral move is supported on the ego's road only")
    return frame.way * (t - frame.offset)


def _axle_y(entity: Entity) -> float:
    """y in the frame of the reference point of an entity that drives along the road, m."""
    return entity.frame.y - entity.offset * math.cos(entity.frame.heading)


def _across(
    traffic: FileTraffic,
    element: Node,
    entity: Entity,
    begin: Moment,
    to: float,
    lasts: float,
    shape: str,
) -> Span:
    """A lateral move to the offset `to` m from the actor's start, in `lasts` s.

    to: positive to the left of the frame's road.
    """
    if entity.leaves_lane:
        raise element.fault(
            f"a lateral move is supported along a lane, which `{entity.name}` leaves before"
        )
    offset = to - entity.moved
    if last := unended_move(traffic, entity, begin, ACROSS):
        if begin.known:
            raise element.fault(f"where `{entity.name}` is across when this begins is unknown")
        # it begins once its own condition holds and the last lateral move has ended
        last_ended = ENDED, *last, 0.0
        begin = replace(begin, program=(*begin.program, last_ended, operation(AND)))
    if abs(offset) <= ON:
        return Span(begin, begin.time)
    if begin.known and begin.time < entity.busy_until - SAME:
        raise element.fault(
            f"`{entity.name}` still moves across when this begins, at {begin.time:.2f} s"
        )
    if math.cos(entity.frame.heading) < 0.0:  # oncoming: its left is the road's right
        offset = -offset
    entity.moved = to
    entity.busy_until = begin.time + lasts if begin.known else 0.0
    act = Act(COSINE, 0.0, lasts, 0.0, offset)  # begin, duration, speed, offset
    if shape == "linear":
        act = Act(CONSTANT, 0.0, lasts, abs(offset) / lasts, offset)
    return add_act(traffic, entity, begin, act, lasts)


# -- trajectories ----------------------------------------------------------------------------------


def _follow_trajectory(traffic: FileTraffic, element: Node, entity: Entity, begin: Moment) -> Span:
    course, spot = traffic.places.followed(element), entity.placed()
    ahead = element.number("initialDistanceOffset", 0.0)
    straight = course.straight
    pose = course.at(ahead, element)
    # 1. where it begins: at the entity
    if math.dist(pose[:2], spot.pose[:2]) > _AT_PATH:
        raise element.fault(f"the trajectory must begin where `{entity.name}` starts")
    at_start = begin.known and begin.time == 0.0
    if entity.speed > 0.0 and not at_start and (traffic.frame.line or not straight):
        raise element.fault(
            "a curved trajectory, or any on a curved road, is supported from the start, or of "
            "a standing entity"
        )
    begins = begin.time if begin.known else math.inf
    if entity.speed > 0.0 and entity.speed * begins > _AT_PATH:
        raise element.fault(f"the trajectory must begin before `{entity.name}` leaves its start")
    entity.on_map = bool(traffic.frame.line)  # on a curved road it leaves the road's coordinates
    # 2. its path: a straight one only gives a heading, on any other the body's centre follows
    if straight:
        entity.path = pose[:2], course.points[-1]
    else:
        start = course.at(ahead + entity.centre, element)
        entity.path = start[:2], *course.rest(ahead + entity.centre)
        pose = start.moved(-entity.centre, -entity.offset)
    entity.spot = replace(spot, pose=pose)
    entity.frame = in_frame(traffic.frame.pose_on_map(entity), ORIGIN, traffic.frame.line)
    # where the body's centre is when the trajectory ends
    last = course.at(course.length, element).moved(entity.centre, entity.offset * straight)
    if not straight or (entity.on_map and not course.times):
        points: Pairs = entity.path[1:] if course.times else (*entity.path[1:], last[:2])
        path = tuple(Pose(*it, 0.0).seen_from(traffic.frame.origin)[:2] for it in points)
        add_act(traffic, entity, begin, Act(PATH, table=path), NEVER)
        if not course.times:
            return Span(begin, NEVER, entity.ended())
    # 3. its speeds, where the trajectory has times
    if not course.times:
        return _until_last(traffic, entity, begin, last.seen_from(traffic.frame.origin))
    if ahead:
        raise element.fault(_FROM_ZERO)
    knots = _timed_speeds(element, course, at_start=at_start)
    lasts, entity.pace = knots[-1]
    return add_act(traffic, entity, begin, Act(BY_TIME, table=knots), lasts)


def _until_last(traffic: FileTraffic, entity: Entity, begin: Moment, last: Pose) -> Span:
    """When a straight trajectory without times ends; on it, other actions set the speed.

    last: place of its body's centre in the frame when it ends.
    """
    cos, sin = math.cos(entity.frame.heading), math.sin(entity.frame.heading)
    x, y = (of_vehicle(axis, entity.number) for axis in (X, Y))
    driven = x * constant(cos) + y * constant(sin)
    there = constant(last.x * cos + last.y * sin)
    at_end = Moment(0.0, (*there.program, *driven.program, operation(AT_MOST)))
    # a move by 0 m, which ends at once: a condition can read only the end of a move
    span = add_act(traffic, entity, at_end, Act(COSINE, 0.0, AT_ONCE), NEVER)
    return replace(span, begin=begin)


def _timed_speeds(element: Node, course: MapPath, *, at_start: bool) -> Pairs:
    """Knots (s, m/s) of the speeds on a trajectory with times.

    element: <FollowTrajectoryAction>.
    at_start: whether the action begins at 0 s.
    """
    # without <Timing>: the element itself, which has none of its attributes
    timing = element.find("TimeReference/Timing") or element
    times = np.array(course.times) * timing.number("scale", 1.0) + timing.number("offset", 0.0)
    domain = timing.one_of("domainAbsoluteRelative", ("absolute", "relative"), "relative")
    if times[0] != 0.0 or (domain == "absolute" and not at_start):
        raise element.fault(_FROM_ZERO)
    durations = np.diff(times)
    if not (durations > 0.0).all():
        raise element.fault("the times of its trajectory must ascend")
    lengths = np.hypot(*np.diff(course.points, axis=0).T)
    # a stretch has one speed, from just after its begin to its end
    begins_and_ends = np.column_stack([times[:-1] + AT_ONCE, times[1:]]).ravel()
    speeds = np.repeat(lengths / durations, 2)
    return tuple(zip(begins_and_ends.tolist(), speeds.tolist(), strict=True))


def _synchronize(traffic: FileTraffic, element: Node, entity: Entity, begin: Moment) -> Span:
    master = traffic.places.entity(element.text("masterEntityRef"), element)
    if not begin.known:
        raise element.fault(
            "a SynchronizeAction that begins by a condition on the drive is not supported"
        )
    if master is not traffic.ego or master.speed <= 0.0:
        raise element.fault("its master must be the ego and move at the start")
    if any(act.kind in SPEEDS for act in entity.acts):
        raise element.fault(f"place or speed of `{entity.name}` when this begins is unknown")
    for holder in element.child("TargetPositionMaster"), element.child("TargetPosition"):
        place = holder.only_child()
        beside = place.get("entityRef") is not None and traffic.places.referred(place)
        if beside and begin.time > 0.0 and (beside.speed > 0.0 or beside.acts):
            raise place.fault("a place beside an entity that has moved is not supported here")
    spot = traffic.places.spot
    distance = _ahead(traffic.frame, master, spot(element.child("TargetPositionMaster")))
    lasts = distance / master.speed - begin.time  # s until the master is at its place
    final, steady = _final_speed(element, master, entity)
    ahead = _ahead(traffic.frame, entity, spot(element.child("TargetPosition")))
    ahead -= entity.pace * begin.time
    try:
        knots = synchronized(ahead, lasts, entity.pace, final, steady)
    except InputError as error:
        raise element.fault(f"`{entity.name}` cannot be there when the ego is: {error}") from None
    entity.pace = final
    return add_act(traffic, entity, begin, Act(BY_TIME, table=knots), lasts)


def _ahead(frame: Frame, entity: Entity, goal: Spot) -> float:
    """How far an entity drives from its start to a place, m: along a curved road, else straight."""
    start = entity.placed().pose._replace(heading=entity.heading)
    if entity.on_map or not frame.line:
        return goal.pose.seen_from(start).x
    x, goal_x = (in_frame(it, frame.origin, frame.line).x for it in (start, goal.pose))
    way = math.copysign(1.0, math.cos(entity.frame.heading))
    return way * (goal_x - x) * frame.ground(entity.frame)


def _final_speed(element: Node, master: Entity, entity: Entity) -> tuple[float, float]:
    """The final speed of a SynchronizeAction, m/s, and the length of its steady part, m.

    master: the entity that the final speed may be relative to.
    """
    holder = element.find("FinalSpeed")
    if not holder:
        return entity.pace, 0.0
    kind = holder.only_child()
    final = kind.number("value")
    if kind.tag == "RelativeSpeedToMaster":
        final = master.speed * final if _by_factor(kind) else master.speed + final
    elif kind.tag != "AbsoluteSpeed":
        raise kind.unsupported()
    steady = kind.find("*")
    if not steady:
        return final, 0.0
    if steady.tag == "TargetTimeSteadyState":
        return final, steady.not_negative("time") * final
    return final, steady.not_negative("distance")


def synchronized(distance: float, time: float, speed: float, final: float, steady: float) -> Pairs:
    """Knots (s, m/s) of the speed with which an entity drives `distance` m in `time` s.

    speed: at first, m/s.
    final: over the last `steady` m, m/s.

    Before the steady part the speed changes once, as gently as possible. The entity keeps the first
    speed and then changes, or changes and then keeps the final speed. Where neither is possible,
    the speed changes twice, each time evenly over half of the remaining time, with a speed between.
    Where this speed would be below 0, the entity brakes, stands and starts.

    Raises InputError where no forward motion is possible.
    """
    if final <= 0.0:
        raise InputError(f"a final speed above 0 m/s is needed, got {final:g}")
    ahead, rest = distance - steady, time - steady / final  # m and s before the steady part
    only_steady = rest <= AT_ONCE or ahead <= ON
    # the steady part is too long; or there is no time or no way before it, but more than `_THERE`
    # would be left out with the other
    if ahead < -ON or rest < -SAME or (only_steady and max(ahead, speed * rest) > _THERE):
        raise InputError(
            f"{distance:.2f} m in {time:.2f} s leave no room for {steady:g} m at {final:g} m/s"
        )
    if only_steady:
        step = (max(rest, 0.0) + AT_ONCE, final)  # a jump to the final speed
        return ((rest, speed), step) if rest > 0.0 else (step,)
    mean = ahead / rest
    if abs(mean - final) <= SAME and abs(mean - speed) <= SAME:
        return ((rest, final),)
    if min(speed, final) + SAME < mean < max(speed, final) - SAME:
        # one change over `ramp` s: last if the mean is nearer to the first speed, else first
        if abs(mean - speed) < abs(mean - final):
            ramp = 2.0 * (ahead - speed * rest) / (final - speed)
            return _knots((rest - ramp, speed), (rest, final))
        ramp = 2.0 * (final * rest - ahead) / (final - speed)
        return _knots((ramp, final), (rest, final))
    middle = 2.0 * mean - 0.5 * (speed + final)
    if middle >= 0.0:
        return _knots((0.5 * rest, middle), (rest, final))
    # brakes and starts at one rate, m/s2, and stands in between
    rate = (speed * speed + final * final) / (2.0 * ahead)
    if (speed + final) / rate > rest + SAME:
        raise InputError(
            f"{distance:.2f} m in {time:.2f} s are too few for {speed:g} m/s at the start"
        )
    return _knots((speed / rate, 0.0), (rest - final / rate, 0.0), (rest, final))


def _knots(*knots: tuple[float, float]) -> Pairs:
    """Knots in ascending times; several within `AT_ONCE` become one, with the last speed."""
    kept: list[tuple[float, float]] = []
    for time, speed in knots:
        if time > (kept[-1][0] if kept else 0.0) + AT_ONCE:
            kept.append((time, speed))
        elif kept:
            kept[-1] = (kept[-1][0], speed)
    return tuple(kept)
