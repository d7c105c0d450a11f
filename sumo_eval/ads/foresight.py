"""Knowledge of the ideal vehicle of Eq. 17 before a case begins: which vehicles it would touch, and
from when on it can know this.

Times of sight come from the scripts of the actors, in continuous time, so that they do not depend
on the simulation's step. The motion of a lively actor (`Actor.lively`) has no closed form: it is
interpolated between steps. Contact is looked for from step to step, as in a drive. Clearances are
checked every `_LOOK` s.

Users: `ads/known_answers.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import atan2, cos, inf, isfinite, isinf
from typing import NamedTuple

import numpy as np

from sumo_eval.ads.lane_change import shortest_duration
from sumo_eval.ads.overtaking import CLEARANCE, EMERGENCY_GAP, EMERGENCY_LATERAL
from sumo_eval.ads.perception import covers, safe_gap
from sumo_eval.cosim.impossible import farthest_in
from sumo_eval.cosim.vehicle_model import GRAVITY
from sumo_eval.method.criticality import ideal_impact_speed
from sumo_eval.scenario.bodies import half_sizes
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Start, Way, lane_at
from sumo_eval.scenario.road.reference_line import Line, map_places
from sumo_eval.scenario.touch import Body, share_at_touch
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.trajectory import FloatArray

# s, headway to a vehicle ahead in the lane that is entered: the minimum of UN R157 from 60 km/h on
FOLLOWING_GAP = 1.6
# s between two looks at clearances, and between two looks for a first sight, whose instant is then
# bisected; a vehicle of 40 m/s moves 2 m in this time
_LOOK = 0.05
_HALVINGS = 30  # of `_LOOK`: to 5e-11 s
_AHEAD = 0.01  # m of road over which the direction of the ego's lane change is computed
# m; an ego that steers is at most this far off its path (0.002 with the settings that ship)
_TRACKING_ERROR = 0.005
# m added to a search radius on curves, where bodies are nearer on the map than their x and y say
_CURVE = 1.0


_Moving = Callable[[float], "_Shape"]
"""A moving body: time, s -> its shape then."""


class Foresight(NamedTuple):
    """Knowledge of one actor.

    noticed: when it is first seen after its motion has begun to change, s; inf: never.
    meets: whether an ego that keeps its speed would touch it.
    speed: its lowest speed along the road in the case, m/s; 0 if the ego has to change lane and the
        actor comes from behind.
    hidden: whether a nearer vehicle hides it when its motion begins to change.
    """

    noticed: float
    meets: bool
    speed: float
    hidden: bool


def foresee(concrete: ConcreteScenario, settings: SimulationSettings) -> tuple[Foresight, ...]:
    """One `Foresight` for each actor.

    settings: those of the case, its ego's body among them.

    Actors move as they do while the ego keeps its speed; an actor with a SUMO model is assumed to
    keep its speed.
    """
    ego, vehicle, step = concrete.ego, settings.vehicle, settings.step
    until = _end_at_its_speed(concrete, settings)
    undisturbed = tracks([concrete], [(vehicle.length, vehicle.width)], step, until)
    foreseen = [
        _Foreseen(actor, step, rows)
        for actor, rows in zip(concrete.actors, undisturbed.others[0], strict=True)
    ]
    foresights = []
    for track, first_move in zip(foreseen, undisturbed.begins[0].tolist(), strict=True):
        actor = track.actor
        ahead = actor.start.x > ego.x
        # a slower actor in the ego's path is a hazard from the start, and so is an actor whose
        # motion never changes
        at_once = isinf(first_move) or (ahead and _is_slower_in_lane(ego, actor, vehicle))
        changes = 0.0 if at_once else first_move
        others = [other.shape for other in foreseen if other is not track]
        noticed = first_sight(ego, settings, track.shape, others, changes, until)
        # an actor from behind, with a SUMO model, brakes for an ego that keeps its speed
        yields = actor.model is not None and not ahead
        meets = not yields and _meets(ego, vehicle, track, until, concrete.road.line)
        # an ego that has to change lane waits for an actor from behind, as if that stood still
        speed = 0.0 if ego.way is not None and not ahead else track.slowest
        foresights.append(Foresight(noticed, meets, speed, hidden=noticed > changes))
    return tuple(foresights)


def _is_slower_in_lane(ego: Start, actor: Actor, vehicle: VehicleSettings) -> bool:
    """Whether an actor starts slower than the ego, with its body in a lane that the ego drives
    in.
    """
    lanes = [ego.y] if ego.way is None else [ego.y, ego.y + ego.way.offset]
    in_a_lane = 2.0 * min(abs(actor.start.y - y) for y in lanes) < actor.width + vehicle.width
    return in_a_lane and actor.start.speed * cos(actor.heading) < ego.speed


def evasion(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    known: Sequence[Foresight],
    deceleration: float,
) -> tuple[float, float, float, float]:
    """The path of an ideal vehicle that steers to the lane on its left: y of its lane's centre,
    offset, x of the start and length, m (`lane_change.PATH`). Offset 0: it keeps its lane and
    brakes.

    It steers where all of this holds:

    - The ideal vehicle may steer (`ideal_steers`), has a lane on its left, and the scenario is not
      `lively`.
    - It would touch an actor without acts that a nearer vehicle hides at first.
    - Braking with `deceleration` (m/s2) from the first sight of that actor on would not avoid it.
    - A lane change from the first sight on, at the ego's speed and as quick as an emergency change
      of the synthetic drivers, is clear of every actor to the end: 0.3 m across or, along the road,
      `FOLLOWING_GAP` to an actor ahead and 2 m to an actor behind. To the actor that it goes round,
      any gap along the road is enough.

    settings: those of the case.
    known: of each actor.
    """
    ego, road, vehicle = concrete.ego, concrete.road, settings.vehicle
    speed, grip = ego.speed, vehicle.friction * GRAVITY
    deceleration = min(deceleration, grip)
    lane = lane_at(road, ego.y)
    # along its lane; the length, 1 m, is a divisor
    straight = road.lane_width * lane, 0.0, 0.0, 1.0
    # actor -> time of its first sight, s
    suddenly_seen = {
        actor: foresight.noticed for actor, foresight in zip(concrete.actors, known, strict=True)
        if foresight.meets and foresight.hidden and isfinite(foresight.noticed)
        and not actor.acts
    }  # fmt: skip
    if not settings.ideal_steers or concrete.lively or lane + 1 == road.lanes or not suddenly_seen:
        return straight
    begin = min(suddenly_seen.values())  # of braking or of the lane change, s
    # x of the ego then, m, and s until its brakes are at the full deceleration
    begin_x, build_up = ego.x + speed * begin, deceleration / vehicle.brake_jerk
    brakes_in_time = all(
        ideal_impact_speed(
            speed, actor.start.speed,
            actor.x(begin) - begin_x - 0.5 * (vehicle.length + actor.length),
            deceleration=deceleration, build_up=build_up,
        ) <= 0.0
        for actor in suddenly_seen
    )  # fmt: skip
    if brakes_in_time:
        return straight
    length = shortest_duration(road.lane_width, min(EMERGENCY_LATERAL, grip)) * speed
    steered = replace(ego, way=Way(road.lane_width, begin_x, begin_x + length, ends=False))

    def clear(actor: Actor, time: float, x: float, y: float) -> bool:
        """Whether an ego that changes lane, at x, y, is far enough from an actor at a time."""
        along = abs(actor.x(time) - x) - 0.5 * (vehicle.length + actor.length)
        across = abs(actor.y(time) - y) - 0.5 * (vehicle.width + actor.width)
        goes_round, is_ahead = actor in suddenly_seen, actor.x(time) > x
        # before the lane change only an actor ahead matters, for which the ego would brake
        if time < begin:
            if goes_round or not is_ahead or across >= 0.0:
                return True
            return along >= safe_gap(speed, actor.speed(time), deceleration, build_up)
        least = FOLLOWING_GAP * speed if is_ahead else EMERGENCY_GAP
        return across >= CLEARANCE or along >= (0.0 if goes_round else least)

    times = np.arange(0.0, _end_at_its_speed(concrete, settings), _LOOK)
    x = steered.x_after(speed * times)
    looks = zip(times.tolist(), x.tolist(), steered.y_at(x).tolist(), strict=True)
    if not all(clear(actor, *look) for look in looks for actor in concrete.actors):
        return straight
    return road.lane_width * lane, road.lane_width, begin_x, length


def _end_at_its_speed(concrete: ConcreteScenario, settings: SimulationSettings) -> float:
    """Time at which an ego that keeps its speed is at the road's end, s; at most the time limit."""
    ego = concrete.ego
    to_the_end = (concrete.road.length - ego.x) / ego.speed if ego.speed > 0.0 else inf
    return min(settings.time_limit, to_the_end)


class _Foreseen(NamedTuple):
    """An actor as it moves while the ego keeps its speed.

    step: s between two rows.
    rows: x, y, heading, speed and speed across its body at every step, (at least 2, 5), as in
        `Tracks`.
    """

    actor: Actor
    step: float
    rows: FloatArray

    def body(self, k: int) -> Body:
        """The body after k steps."""
        row, actor = self.rows[k].tolist(), self.actor
        return Body._make([*row[:4], actor.length, actor.width, row[4]])

    def shape(self, time: float) -> _Shape:
        """Its shape at any time, s; a lively actor is interpolated between two steps."""
        actor = self.actor
        if actor.lively:
            rows = self.rows
            at = min(max(time / self.step, 0.0), len(rows) - 1.0)  # number of a row, with fraction
            k = min(int(at), len(rows) - 2)
            between = rows[k] + (at - k) * (rows[k + 1] - rows[k])
            x, y, heading = between[:3].tolist()
        else:
            # a sliding body keeps its heading: its lateral speed does not turn it
            across = 0.0 if actor.slides else actor.lateral_speed(time)
            x, y = actor.x(time), actor.y(time)
            heading = atan2(across, actor.speed(time)) if across else 0.0
        return _Shape(x, y, *half_sizes(heading, actor.length, actor.width))

    @property
    def slowest(self) -> float:
        """Its lowest speed along the road, m/s; 0 of an actor that brakes to a standstill."""
        if not self.actor.lively:
            return self.actor.start.speed if self.actor.braking is None else 0.0
        heading, speed, across = self.rows[:, 2:].T  # without x and y
        along = speed * np.cos(heading) - across * np.sin(heading)
        return max(float(along.min()), 0.0)


def _meets(
    ego: Start, vehicle: VehicleSettings, track: _Foreseen, until: float, line: Line
) -> bool:
    """Whether an ego that keeps its speed along its path touches an actor.

    until: end of the case, s.
    line: that the road follows; empty: it is straight.
    """
    rows, step = track.rows, track.step
    times = np.arange(len(rows)) * step
    # two bodies that touch within a step are at most this far apart at its start and at its end, m
    # between centres, along and across the road
    reach = 0.5 * (
        vehicle.length + vehicle.width + track.actor.length + track.actor.width
    ) + farthest_in(step)
    reach += _CURVE if line else 0.0
    ego_x = ego.x_after(ego.speed * times)
    x, y, *_ = rows.T
    near = (np.abs(x - ego_x) < reach) & (np.abs(y - ego.y_at(ego_x)) < reach)
    # steps at whose start and end they are near
    for k in np.flatnonzero(near[:-1] & near[1:]).tolist():
        time, later = k * step, (k + 1) * step
        if time < until and share_at_touch(
            _ego_body(ego, vehicle, time, line), _ego_body(ego, vehicle, later, line),
            _on_the_map(track.body(k), line), _on_the_map(track.body(k + 1), line),
        ) >= 0.0:  # fmt: skip
            return True
    return False


def first_sight(
    ego: Start,
    settings: SimulationSettings,
    watched: _Moving,
    others: Sequence[_Moving],
    time: float,
    until: float,
) -> float:
    """The first instant from `time` on at which a vehicle is not hidden, s; inf if it stays hidden
    until `until`.

    It is hidden while a nearer vehicle covers so much of its width that less than the share
    `ideal_visible_share` of it shows. The ego keeps its speed.

    watched: the vehicle. others: those that may hide it.
    """

    def hidden(when: float) -> bool:
        return any(_hides(ego, settings, other(when), watched(when), when) for other in others)

    while hidden(time):
        if time > until:
            return inf
        later = time + _LOOK
        if not hidden(later):
            for _ in range(_HALVINGS):
                middle = 0.5 * (time + later)
                if hidden(middle):
                    time = middle
                else:
                    later = middle
            return later
        time = later
    return time


def _hides(
    ego: Start, settings: SimulationSettings, nearer: _Shape, farther: _Shape, time: float
) -> bool:
    """Whether a nearer vehicle hides a farther one from the ego, as for the baselines
    (`perception.is_in_sight`).

    It hides nothing once it reaches the rear of the farther vehicle: so a collision of both is
    seen, even where a script drives one through the other.
    """
    eye = float(ego.x_after(ego.speed * time))
    if not eye < nearer.x < farther.x - nearer.half_length - farther.half_length:
        return False
    eye_y = float(ego.y_at(eye))
    # where the nearer vehicle is on the way from the eye to the farther one, 0..1, if lines of
    # sight begin at the eye; 1: they are parallel, as towards a vehicle in the ego's lane
    in_the_way = abs(farther.y - eye_y) < farther.half_width + 0.5 * settings.vehicle.width
    share = 1.0 if in_the_way else (nearer.x - eye) / (farther.x - eye)
    return covers(nearer, eye_y, farther, share, 1.0 - settings.ideal_visible_share)


class _Shape(NamedTuple):
    """Centre of a body, and half its extents along and across the road, as it is turned, m."""

    x: float
    y: float
    half_length: float
    half_width: float


def _ego_body(ego: Start, vehicle: VehicleSettings, time: float, line: Line) -> Body:
    """The ego's body on the map, if it keeps its speed, at a time, s.

    Where the ego steers, its rear axle follows the path, and the body points along the path there.
    In a lane change the body is larger by `_TRACKING_ERROR` on each side, so that a near miss
    counts as contact.
    """
    room = 2.0 * _TRACKING_ERROR if ego.way is not None else 0.0
    # m from the rear axle to the centre. On a straight path 0, as the centre follows the path as
    # well: subtracting half a wheelbase and adding it again would round x.
    to_centre = 0.5 * vehicle.wheelbase if line or ego.way is not None else 0.0
    x = float(ego.x_after(ego.speed * time - to_centre))
    y, next_y = ego.y_at([x, x + _AHEAD]).tolist()
    heading = atan2(next_y - y, _AHEAD)
    # the body as if its centre were at the rear axle
    length, width = vehicle.length + room, vehicle.width + room
    return _on_the_map(Body(x, y, heading, ego.speed, length, width), line).moved(to_centre)


def _on_the_map(body: Body, line: Line) -> Body:
    """A body along and across a road, turned into a body on the map."""
    if not line:
        return body
    x, y, heading = map_places(line, body.x, body.y, body.heading)
    return body._replace(x=float(x), y=float(y), heading=float(heading))
