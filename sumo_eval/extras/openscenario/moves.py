"""Actions of a scenario file during the drive, as acts of an actor. `scene` and `story` call them
in the order of the file.

Interpretations, where the standard leaves a choice or this package supports less:

- A speed, lane or offset relative to the ego is relative to the one at its start, because an ADS's
  motion is unknown before the drive. Only a move made by `_relative` follows the drive.
- SynchronizeAction is planned once, when it begins, for a master that keeps its speed
  (`synchronized`).
- A `rate` is the peak rate of a change, `maxLateralAcc` the peak lateral acceleration.
- The sign of a `rate` is ignored; the target gives the direction.

Users: `extras/openscenario/describe.py`, `extras/openscenario/logical.py`,
`extras/openscenario/scene.py`, `extras/openscenario/starts.py`, `extras/openscenario/story.py`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.drive_numbers import constant, of_vehicle, operation
from sumo_eval.extras.openscenario.frame import ORIGIN, SAME, Frame
from sumo_eval.extras.openscenario.moments import (
    AT_ONCE,
    NEVER,
    Moment,
    Past,
    Span,
    from_time,
    implied,
)
from sumo_eval.extras.openscenario.network import ON, Lane, MapRoad, in_frame
from sumo_eval.extras.openscenario.places import Entity, MapPath, Places, UnplacedError
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.scenario.played import (
    ALONG,
    AND,
    BELOW,
    BY_TIME,
    CONSTANT,
    COSINE,
    EGO,
    ENDED,
    KEEP,
    LARGER,
    MATCH,
    PATH,
    SPEED,
    Act,
    Move,
    Pairs,
    X,
)
from sumo_eval.scenario.road.pose import Pose

_PEAKS = {"linear": 1.0, "sinusoidal": 0.5 * math.pi, "cubic": 1.5}
"""Ratio of the peak of the rate to its mean, by the shape of a change."""
_STRONGEST = {"sinusoidal": 0.5 * math.pi**2, "cubic": 6.0}
"""Peak lateral acceleration of a move by 1 m in 1 s, m/s2, by its shape."""
_DIMENSIONS = ("rate", "time", "distance")
_SHAPES = ("linear", "step", "cubic", "sinusoidal")
# kinds of acts that change a speed, and of acts that move across the road
_SPEEDS, _ACROSS = (SPEED, BY_TIME, MATCH), (COSINE, CONSTANT)
# a move (actor's number, act's index) that stands for none: the ego has no acts
_NO_MOVE = EGO, 0
_SHARES = np.arange(1, 33) / 32  # knots of a curved change of speed, as shares of its time
_THERE = 0.05  # m and m/s: a distance and a speed within this count as reached
_MOST = 1e3  # m/s or m/s2: a limit that never acts, where the file has none
# faults
_STEADY = "over the distance of a lateral move the speed must stay the same, above 0 m/s"
_FROM_ZERO = "the times of a trajectory must begin with 0 s when it begins"


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


def changes_nothing(act: Act) -> bool:
    """Whether a move only keeps a speed, or moves by 0 m to remember that a condition held."""
    return act.kind == KEEP or (act.kind == COSINE and act.offset == 0.0)


def is_step(dynamics: Node) -> bool:
    """Whether a change is a step, or takes 0 s."""
    if dynamics.one_of("dynamicsShape", _SHAPES) == "step":
        return True
    return dynamics.text("dynamicsDimension", "") == "time" and dynamics.number("value") == 0.0


@dataclass(slots=True)
class Moves:
    """Maker of acts from the actions of a file.

    ego: the entity that the ADS drives.
    actors: by number.

    Methods for one kind of action take the action's element, the entity that moves, and when the
    move begins. They return when it begins and ends.
    """

    places: Places
    frame: Frame
    ego: Entity
    actors: list[Entity]

    def begin(self, element: Node, entity: Entity, moment: Moment) -> Span:
        """Give an entity the act of an action; return when the action begins and ends.

        element: the action, as <SpeedAction>, or its holder, as <LongitudinalAction>.
        """
        if entity.deleted:
            return Span(moment, moment.time)
        if element.tag in ("LongitudinalAction", "LateralAction", "RoutingAction"):
            element = element.only()
        readers = {
            "SpeedAction": self._speed, "LaneChangeAction": self._lane_change,
            "LaneOffsetAction": self._lane_offset, "LongitudinalDistanceAction": self._distance,
            "FollowTrajectoryAction": self._follow, "SynchronizeAction": self._synchronize,
        }  # fmt: skip
        move = entity.next_move
        span = element.chosen(readers, "moves")(element, entity, moment)
        # Where the action became no act, the entity's next act gets the number `move`. Plans that
        # this action noted under this number, the last item of `reads`, must not count as that
        # act's own.
        if entity.next_move == move:
            for other in self.places.entities.values():
                other.reads = [(*it[:3], _NO_MOVE) if it[3] == move else it for it in other.reads]
        return span

    def _read(self, target: Node, mover: Entity, begin: Moment, kinds: tuple[int, ...]) -> Entity:
        """The entity to which a move is relative. Notes that the move depends on it (`_plan`).

        target: element that refers to this entity.
        mover: entity that moves.
        kinds: as in `_plan`.
        """
        other = self.places.referred(target)
        if other is not mover:
            if kinds == _ACROSS and other.moved != 0.0:
                raise target.fault(f"`{other.name}`, to which it is relative, also moves across")
            self._plan(other, begin, kinds, target, mover.next_move)
        return other

    def _plan(
        self, entity: Entity, begin: Moment, kinds: tuple[int, ...], element: Node, move: Move
    ) -> None:
        """Note that a move was planned from an entity's acts so far.

        `_add` refuses a later act of the entity that may begin before the move does.

        begin: when the move begins.
        kinds: kinds of acts on which the move depends, `_SPEEDS` or `_ACROSS`.
        element: that a fault names.
        move: the planned move.
        """
        fault = element.fault(
            f"`{entity.name}`, on which it depends, may move before by an event below it in the "
            "file, which is not supported"
        )
        entity.reads.append((begin.time if begin.known else math.inf, kinds, fault, move))

    def _add(self, entity: Entity, begin: Moment, act: Act, lasts: float) -> Span:
        """Give an entity an act; return when the act runs.

        Raises an InputError if the act may begin before a move above it in the file, which was
        planned without the act.

        lasts: duration, s; without effect where the act begins by a condition.
        """
        earliest, past = self._implied(begin)
        for until, kinds, fault, move in entity.reads:
            # the act's own plan does not count, nor that of a move that ends before the act begins
            matters = act.kind in kinds and move not in (*past, entity.next_move)
            if matters and earliest < until and not changes_nothing(act):
                raise fault
        entity.acts.append(act._replace(begin=begin.time, program=begin.program))
        if begin.known:
            return Span(begin, begin.time + lasts)
        return Span(begin, NEVER, entity.ended())

    def _implied(self, begin: Moment) -> tuple[float, set[Past]]:
        """Earliest time of a moment, s, and what is certainly past then."""
        past = set[Past]({0.0})
        programs = [begin.program]
        # The list grows in the loop: a move that has ended has begun, so its own condition held.
        for program in programs:
            new = implied(program) - past
            ended = (item for item in new if isinstance(item, tuple))
            programs += (self.actors[number].acts[index].program for number, index in ended)
            past |= new
        return begin.time + max(item for item in past if isinstance(item, float)), past

    def follows(self, begin: Moment, span: Span) -> bool:
        """Whether a moment certainly comes at or after the end of an element."""
        earliest, past = self._implied(begin)
        if span.begin.known:
            return span.end - SAME <= earliest
        # all that is past at the element's end must be past at the moment, too
        _, past_at_end = self._implied(Moment(0.0, span.ended))
        return earliest == NEVER or (bool(span.ended) and past_at_end <= past)

    # -- speeds ------------------------------------------------------------------------------------

    def _speed(self, element: Node, entity: Entity, begin: Moment) -> Span:
        speed = target_speed(element, self.places, entity)
        dynamics = self.places.exact(element.child("SpeedActionDynamics"))
        target = element.child("SpeedActionTarget").only()
        if target.flag("continuous"):
            if not is_step(dynamics):
                raise dynamics.fault("a continuous speed is supported with the shape `step` only")
            return self._continuous(target, entity, begin, speed)
        shape = dynamics.one_of("dynamicsShape", _SHAPES)
        # During an earlier change, the speed lies between its ends: assume the end from which this
        # change takes longer.
        ends = (entity.pace, entity.before) if _changes(entity, begin) else (entity.pace,)
        first = max(ends, key=lambda it: abs(it - speed))
        change = abs(speed - first)
        if target.tag == "RelativeTargetSpeed":
            other = self._read(target, entity, begin, _SPEEDS)
            if self._unsure(other, begin, _SPEEDS) or _changes(other, begin):
                raise target.fault(f"the speed of `{other.name}` when this begins is unknown")
        unsure = self._unsure(entity, begin, _SPEEDS)
        # It has the speed already and needs no act. An event further down in the file must not
        # change the speed before (`_plan`).
        if change <= SAME and begin.known and not unsure:
            self._plan(entity, begin, _SPEEDS, dynamics, _NO_MOVE)
            return Span(begin, begin.time)
        # The speed at the begin is unknown. Or the move begins by a condition: an event further
        # down in the file may then change the speed before, and the act must set it again.
        if unsure or change <= SAME:
            return self._from_any_speed(dynamics, entity, begin, speed)
        step = is_step(dynamics)
        rate = change / AT_ONCE if step else self._rate(dynamics, entity, begin, speed)
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
            self._plan(entity, begin, _SPEEDS, dynamics, entity.next_move)
        return self._add(entity, begin, act, lasts)

    def _continuous(self, target: Node, entity: Entity, begin: Moment, speed: float) -> Span:
        """A speed relative to another entity's at every instant, without end.

        target: <RelativeTargetSpeed>.
        speed: its value by the other entity's speed so far, m/s.
        """
        entity.pace, value = speed, target.number("value")
        factor, added = (value, 0.0) if _by_factor(target) else (1.0, value)
        number = float(self.places.referred(target).number)
        # pairs as in `_distance`: the second 0 keeps the speed alone, so the last pair is unused
        return self._relative(entity, begin, (number, factor), (added, 0.0), (0.0, 0.0))

    def _unsure(self, entity: Entity, begin: Moment, kinds: tuple[int, ...]) -> Move | None:
        """The entity's last move of some kinds so far, if it may not have ended at a moment.

        None where this move and the moment are times: `busy_until` and `steady` then give its end.
        """
        earlier = [k for k, act in enumerate(entity.acts)
                   if act.kind in kinds and not changes_nothing(act)]  # fmt: skip
        if not earlier or (begin.known and not any(entity.acts[k].program for k in earlier)):
            return None
        last = entity.number, earlier[-1]
        return None if last in self._implied(begin)[1] else last

    def _from_any_speed(self, dynamics: Node, entity: Entity, begin: Moment, speed: float) -> Span:
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
        self._add(entity, begin, act, NEVER)
        return Span(begin, NEVER, entity.ended())

    def _rate(self, dynamics: Node, entity: Entity, begin: Moment, speed: float) -> float:
        """The mean rate of a change of speed, m/s2."""
        kind = dynamics.one_of("dynamicsDimension", _DIMENSIONS)
        shape = dynamics.text("dynamicsShape")
        if (kind, shape) != ("rate", "linear") and _changes(entity, begin):
            raise dynamics.fault(
                f"`{entity.name}` still changes its speed when this begins, at {begin.time:g} s: "
                "only a linear change by `rate` is supported then"
            )
        if kind == "rate":
            return abs(dynamics.number("value")) / _PEAKS[shape]
        change, value = abs(speed - entity.pace), dynamics.above_zero("value")  # value: s or m
        # Every shape is symmetric, so the mean speed over a distance is the mean of both ends.
        return change / value * (1.0 if kind == "time" else 0.5 * (speed + entity.pace))

    def _relative(self, entity: Entity, begin: Moment, *table: tuple[float, float]) -> Span:
        """Keep a speed or a position relative to another vehicle's at every instant.

        table: as in `played.PLAY` under `match`: three or five pairs.
        """
        if self.frame.line and math.cos(entity.frame.heading) < 0.0:
            raise entity.element.fault(
                "a speed relative to another's is not supported of an oncoming vehicle on a curve"
            )
        span = self._add(entity, begin, Act(MATCH, table=table), NEVER)
        # after every step `played` looks only at acts with a condition: a time becomes a condition
        if begin.known:
            entity.acts[-1] = entity.acts[-1]._replace(begin=0.0, program=from_time(begin.time))
        return span

    # -- distances ---------------------------------------------------------------------------------

    def place_apart(self, element: Node, entity: Entity) -> None:
        """Put an entity at the distance of a LongitudinalDistanceAction at the start."""
        other, apart, gap = self._apart(element, entity)
        # m ahead over the ground: the time gap times the speed of the vehicle behind, which is
        # `other` if the gap is below 0
        further = -gap * (other.speed if gap < 0.0 else entity.speed)
        x = other.frame.x + (apart + further / self.frame.ground(other.frame))
        entity.frame = entity.frame._replace(x=x)

    def _apart(self, element: Node, entity: Entity) -> tuple[Entity, float, float]:
        """Where a LongitudinalDistanceAction wants the entity, relative to a second entity.

        Returns the second entity; how far ahead of its centre the entity's centre must be, m along
        the road's line; and the time gap by which the centre must be further behind, s, as in
        `played.PLAY` under `match`. Both numbers may be below 0.
        """
        other = self.places.referred(element)
        if entity.on_map or other.on_map:
            raise element.fault("a distance of an entity that drives on the map is not supported")
        # on a curve the distance is along the lane, not along the file's reference line
        systems = ("entity", "lane") if self.frame.line else ("entity", "lane", "road")
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
        return other, apart / self.frame.ground(other.frame), gap

    def _distance(self, element: Node, entity: Entity, begin: Moment) -> Span:
        limits = element.find("DynamicConstraints")
        once = not element.flag("continuous")
        if once and not limits:
            if not begin.known or begin.time > 0.0:
                raise element.fault(
                    "without <DynamicConstraints> it is supported at the start only"
                )
            self.place_apart(element, entity)
            return Span(begin, begin.time)
        other, apart, gap = self._apart(element, entity)
        if other is not self.ego:  # the ego's speed during the drive is unknown
            entity.pace = other.pace
        # pairs of `played.PLAY` under `match`: (followed vehicle, factor), (speed added, kept: 1 a
        # position, 2 one within limits), (distance, time gap)
        keeps = (float(other.number), 1.0), (0.0, 2.0 if limits else 1.0), (apart, gap)
        if not limits:
            return self._relative(entity, begin, *keeps)
        for name in ("maxAccelerationRate", "maxDecelerationRate"):
            if limits.get(name) is not None:
                raise limits.fault(f"`{name}` is not supported")
        fastest = limits.number("maxSpeed", _MOST)
        rates = limits.number("maxAcceleration", _MOST), limits.number("maxDeceleration", _MOST)
        span = self._relative(entity, begin, *keeps, rates, (fastest, 0.0))
        return self._until_there(entity, other, begin, apart, gap) if once else span

    def _until_there(
        self, entity: Entity, other: Entity, begin: Moment, apart: float, gap: float
    ) -> Span:
        """End a LongitudinalDistanceAction where the entity has the distance and the other's speed:
        from then on it keeps its speed.

        apart, gap: as `_apart` returns them.
        """
        # A condition can read only the end of an act: that of a move by 0 m, which ends at once,
        # shows that the action has begun.
        self._add(entity, begin, Act(COSINE, 0.0, AT_ONCE), 0.0)
        has_begun = entity.ended()

        x, target_x = (of_vehicle(X, it.number) for it in (entity, other))
        speed, target = (of_vehicle(ALONG, it.number) for it in (entity, other))
        # m along the line by which the time gap puts it behind, at the speed of the vehicle behind;
        # `played` too converts the ground's metres where the entity drives
        behind = constant(gap / self.frame.ground(entity.frame)) * (target if gap < 0.0 else speed)
        # the larger of both differences must be below `_THERE`
        off = abs(target_x + constant(apart) - behind - x).joined(LARGER, abs(target - speed))
        ends = (*off.program, *constant(_THERE).program, operation(BELOW))
        has_arrived = (*has_begun, *ends, operation(AND))
        entity.acts.append(Act(KEEP, program=has_arrived))
        # KEEP never ends: the end of a second move by 0 m shows that KEEP has begun
        return self._add(entity, Moment(0.0, has_arrived), Act(COSINE, 0.0, AT_ONCE), NEVER)

    # -- lateral moves -----------------------------------------------------------------------------

    def _lane_change(self, element: Node, entity: Entity, begin: Moment) -> Span:
        lane = self._target_lane(element.child("LaneChangeTarget").only(), entity, begin)
        t = lane.centre + element.number("targetLaneOffset", 0.0)
        offset = self._y(t, element, entity) - entity.frame.y
        dynamics = self.places.exact(element.child("LaneChangeActionDynamics"))
        shape = self._shape(dynamics, "lateral move", *_PEAKS)
        value = dynamics.above_zero("value")  # m/s, s or m
        kind = dynamics.one_of("dynamicsDimension", _DIMENSIONS)
        if kind == "time":
            lasts = value
        elif kind == "rate":
            lasts = abs(offset - entity.moved) / value * _PEAKS[shape]
        else:
            unsure = _changes(entity, begin) or self._unsure(entity, begin, _SPEEDS)
            if unsure or entity.pace <= 0.0:
                raise dynamics.fault(_STEADY)
            lasts = value / entity.pace
            # A later act must not change the speed before the move has ended. A move by 0 m
            # becomes no act, and needs no steady speed.
            if abs(offset - entity.moved) > ON:
                until = begin.time + lasts if begin.known else math.inf
                entity.reads.append((until, _SPEEDS, dynamics.fault(_STEADY), entity.next_move))
        return self._across(element, entity, begin, offset, lasts, shape)

    def _target_lane(self, target: Node, entity: Entity, begin: Moment) -> Lane:
        """The lane that a <LaneChangeTarget> names; target: its child."""
        if target.tag == "RelativeTargetLane":
            other = self._read(target, entity, begin, _ACROSS)
            # `value` counts to the left as seen by that entity
            lanes = target.whole("value") * (other.placed().way or 1)
            return self.places.lane_beside(*self._lane_now(other, target), lanes, target)
        if target.tag != "AbsoluteTargetLane":
            raise target.unsupported()
        road = entity.placed().road
        if not road:
            raise target.fault("the entity is on no road")
        return self.places.network.lane(road, target.text("value"), target)

    def _lane_offset(self, element: Node, entity: Entity, begin: Moment) -> Span:
        target = element.child("LaneOffsetTarget").only()
        continuous = element.flag("continuous")
        if target.tag == "RelativeTargetLaneOffset":
            if continuous:
                raise target.fault("an offset that is kept to another entity is not supported")
            other = self._read(target, entity, begin, _ACROSS)
            y = other.frame.y + other.moved
        elif target.tag == "AbsoluteTargetLaneOffset":
            y = self._y(self._lane_now(entity, target)[1].centre, element, entity)
        else:
            raise target.unsupported()
        offset = y + self.frame.way * target.number("value") - entity.frame.y
        dynamics = element.child("LaneOffsetActionDynamics")
        shape = self._shape(dynamics, "lateral move with `maxLateralAcc`", *_STRONGEST)
        strongest = dynamics.above_zero("maxLateralAcc", " m/s2")
        lasts = math.sqrt(_STRONGEST[shape] * abs(offset - entity.moved) / strongest)
        span = self._across(element, entity, begin, offset, lasts, shape)
        # every actor keeps its offset; a continuous action never ends
        return Span(begin, NEVER) if continuous else span

    def _shape(self, dynamics: Node, what: str, *shapes: str) -> str:
        """The shape of a change; an InputError if it is not one of `shapes`.

        what: name of the change in the message.
        """
        shape = dynamics.one_of("dynamicsShape", _SHAPES)
        if shape not in shapes:
            names = " and ".join(f"`{name}`" for name in shapes)
            raise dynamics.fault(f"a {what} of the shape `{shape}` is not supported, {names} are")
        return shape

    def _lane_now(self, other: Entity, element: Node) -> tuple[MapRoad, Lane]:
        """Road and lane of an entity when a move relative to it begins.

        They are those after its lateral moves so far; of the ego, which has none, at its start.
        """
        spot = other.placed()
        road, lane = spot.in_lane(element)
        if other.moved == 0.0:
            return road, lane
        now = road.lane_at(spot.t + self.frame.way * other.moved)
        if not now:
            raise element.fault(f"`{other.name}`, to which it is relative, is in no lane any more")
        return road, now

    def _y(self, t: float, element: Node, entity: Entity) -> float:
        """y in the frame of a place `t` m to the left of the reference line of the ego's road."""
        road = entity.placed().road
        if not road or road.name != self.frame.road:
            raise element.fault("a lateral move is supported on the ego's road only")
        return self.frame.way * (t - self.frame.offset)

    def _across(
        self, element: Node, entity: Entity, begin: Moment, to: float, lasts: float, shape: str
    ) -> Span:
        """A lateral move to the offset `to` m from the actor's start, in `lasts` s.

        to: positive to the left of the frame's road.
        """
        if entity.on_map:
            raise element.fault(
                f"`{entity.name}` drives straight on the map, so it has no lane to move across"
            )
        offset = to - entity.moved
        if last := self._unsure(entity, begin, _ACROSS):
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
        return self._add(entity, begin, act, lasts)

    # -- trajectories ------------------------------------------------------------------------------

    def _follow(self, element: Node, entity: Entity, begin: Moment) -> Span:
        course, spot = self.places.followed(element), entity.placed()
        ahead = element.number("initialDistanceOffset", 0.0)
        straight = course.straight
        pose = course.at(ahead, element)
        # 1. where it begins: at the entity, within 0.5 m
        if math.dist(pose[:2], spot.pose[:2]) > 0.5:
            raise element.fault(f"the trajectory must begin where `{entity.name}` starts")
        at_start = begin.known and begin.time == 0.0
        if entity.speed > 0.0 and not at_start and (self.frame.line or not straight):
            raise element.fault(
                "a curved trajectory, or any on a curved road, is supported from the start, or of "
                "a standing entity"
            )
        # 2. its path: a straight one only gives a heading, on any other the body's centre follows
        if straight:
            entity.path = pose[:2], course.points[-1]
        else:
            start = course.at(ahead + entity.centre, element)
            entity.path = start[:2], *course.rest(ahead + entity.centre)
            pose = start.moved(-entity.centre, -entity.offset)
            path = (Pose(*it, 0.0).seen_from(self.frame.origin)[:2] for it in entity.path[1:])
            self._add(entity, begin, Act(PATH, table=tuple(path)), NEVER)
        entity.spot = replace(spot, pose=pose)
        entity.on_map = bool(self.frame.line)  # on a curved road it leaves the road's coordinates
        entity.frame = in_frame(self.frame.pose_on_map(entity), ORIGIN, self.frame.line)
        # 3. its speeds, where the trajectory has times
        if not course.times:
            return self._add(entity, begin, Act(KEEP), NEVER)
        if ahead:
            raise element.fault(_FROM_ZERO)
        knots = _timed_speeds(element, course, at_start=at_start)
        lasts, entity.pace = knots[-1]
        return self._add(entity, begin, Act(BY_TIME, table=knots), lasts)

    def _synchronize(self, element: Node, entity: Entity, begin: Moment) -> Span:
        master = self.places.entity(element.text("masterEntityRef"), element)
        if not begin.known:
            raise element.fault(
                "a SynchronizeAction that begins by a condition on the drive is not supported"
            )
        if master is not self.ego or master.speed <= 0.0:
            raise element.fault("its master must be the ego and move at the start")
        if begin.time > 0.0 and any(act.kind in _SPEEDS for act in entity.acts):
            raise element.fault(f"the place of `{entity.name}` when this begins is unknown")
        goal = self.places.spot(element.child("TargetPositionMaster")).pose
        start = master.placed().pose
        distance = goal.seen_from(start).x
        if self.frame.turns:  # along the path on which it turns
            at = in_frame(goal, self.frame.origin, self.frame.line)
            distance = at.x - start.seen_from(self.frame.origin).x
        lasts = distance / master.speed - begin.time  # s until the master is at its place
        final, steady = self._final_speed(element, master, entity)
        target = self.places.spot(element.child("TargetPosition")).pose
        pose = entity.placed().pose._replace(heading=entity.heading)
        ahead = target.seen_from(pose).x - entity.pace * begin.time
        try:
            knots = synchronized(ahead, lasts, entity.pace, final, steady)
        except InputError as error:
            raise element.fault(
                f"`{entity.name}` cannot be there when the ego is: {error}"
            ) from None
        entity.pace = final
        return self._add(entity, begin, Act(BY_TIME, table=knots), lasts)

    def _final_speed(self, element: Node, master: Entity, entity: Entity) -> tuple[float, float]:
        """The final speed of a SynchronizeAction, m/s, and the length of its steady part, m.

        master: the entity that the final speed may be relative to.
        """
        holder = element.find("FinalSpeed")
        if not holder:
            return entity.pace, 0.0
        kind = holder.only()
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


def _curved_change(shape: str, before: float, after: float, rate: float) -> Act:
    """A cubic or sinusoidal change of a speed, m/s; rate: its mean, m/s2."""
    # share of the change that is done after each share of the time: `cubic` 3 s^2 - 2 s^3
    shares = _SHARES * _SHARES * (3.0 - 2.0 * _SHARES)
    if shape == "sinusoidal":
        shares = 0.5 * (1.0 - np.cos(math.pi * _SHARES))
    speeds = before + (after - before) * shares
    table = np.column_stack([_SHARES * abs(after - before) / rate, speeds]).tolist()
    return Act(BY_TIME, table=tuple(map(tuple, table)))


def _changes(entity: Entity, begin: Moment) -> bool:
    """Whether an earlier change of speed, begun at a time, still lasts when a move begins."""
    return begin.known and begin.time < entity.steady - SAME


def _by_factor(target: Node) -> bool:
    """Whether a relative speed is a factor; otherwise it is a difference."""
    return target.one_of("speedTargetValueType", ("delta", "factor")) == "factor"


def target_speed(action: Node, places: Places, mover: Entity) -> float:
    """The speed that a SpeedAction of an entity leads to, m/s."""
    target = action.child("SpeedActionTarget").only()
    speed = target.number("value")
    if target.tag == "RelativeTargetSpeed":
        other = places.referred(target)
        # `waits` includes this action, if the speed is relative to the entity's own
        if other.waits > (other is mover):
            raise UnplacedError("", other.name)  # no text: `scene` tries again later
        speed = other.pace * speed if _by_factor(target) else other.pace + speed
    elif target.tag != "AbsoluteTargetSpeed":
        raise target.unsupported()
    if speed < 0.0:
        raise target.fault(f"the speed must be at least 0 m/s, got {speed:g}")
    return speed
