"""Knowledge of the ideal vehicle of Eq. 17 before a case begins: which vehicles it would touch, and
from when on it can know this. User: `ads/known_answers.py`.

Times of sight come from the scripts of the other vehicles, in continuous time, so that they do not
depend on the simulation's step. A lively actor (`Actor.lively`) reacts to others, so no script
says where it is: it is interpolated between steps. Contact is looked for from step to step, as in a
drive, and clearances are checked every `_LOOK` s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import atan2, cos, inf, isfinite, isinf, sin
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
# s between two looks, for clearances and for a first sight, whose instant is then bisected; a
# vehicle of 40 m/s moves 2 m in it
_LOOK = 0.05
_HALVINGS = 30  # of `_LOOK`: to 5e-11 s
_AHEAD = 0.01  # m of road over which the direction of the ego's lane change is computed
# m; an ego that steers is at most this far off its path (0.002 with the settings that ship)
_TRACKING_ERROR = 0.005
# m added to a search radius on curves, where bodies are nearer on the map than their x and y say
_CURVE = 1.0


_Moving = Callable[[float], "_Shape"]
"""A moving body: gives its shape at a time, s."""


class Foresight(NamedTuple):
    """Knowledge of one other vehicle.

    noticed: when it is first seen after its state has begun to change, s; inf where it never is.
    meets: whether an ego that keeps its speed would touch it.
    speed: its lowest speed along the road in the case, m/s; 0 if the ego has to change lane and it
        comes from behind.
    hidden: whether a nearer vehicle hides it when its state begins to change.
    """

    noticed: float
    meets: bool
    speed: float
    hidden: bool


def foresee(concrete: ConcreteScenario, settings: SimulationSettings) -> tuple[Foresight, ...]:
    """One `Foresight` for each actor.

    settings: those of the case, its ego's body among them.

    Actors move as they do while the ego keeps its speed; one with a SUMO model is
    taken to keep its speed.
    """
    ego, vehicle, step = concrete.ego, settings.vehicle, settings.step
    until = _end_at_its_speed(concrete, settings)
    undisturbed = tracks([concrete], [(vehicle.length, vehicle.width)], step, until)
    tracks_ahead = [
        _Foreseen(actor, step, rows)
        for actor, rows in zip(concrete.actors, undisturbed.others[0], strict=True)
    ]
    foresights = []
    for track, first_move in zip(tracks_ahead, undisturbed.begins[0].tolist(), strict=True):
        actor = track.actor
        ahead = actor.start.x > ego.x
        slower = actor.start.speed * cos(actor.heading) < ego.speed
        # whether it starts with its body in a path that the ego drives
        lanes = [ego.y] if ego.way is None else [ego.y, ego.y + ego.way.offset]
        on_the_way = 2.0 * min(abs(actor.start.y - y) for y in lanes) < actor.width + vehicle.width
        caught_up = ahead and slower and on_the_way
        # a slower one ahead is a hazard from the start, and so is one whose motion never changes
        changes = 0.0 if caught_up or isinf(first_move) else first_move
        others = [other.shape for other in tracks_ahead if other is not track]
        noticed = first_sight(ego, settings, track.shape, others, changes, until)
        # one with a SUMO model, from behind, brakes for an ego that keeps its speed
        yields = actor.model is not None and not ahead
        meets = not yields and _meets(ego, vehicle, track, until, concrete.road.line)
        # an ego that has to change lane waits for one from behind, as if that stood still
        speed = 0.0 if ego.way is not None and not ahead else track.slowest
        foresights.append(Foresight(noticed, meets, speed, hidden=noticed > changes))
    return tuple(foresights)


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

    - The ideal vehicle may steer (`ideal_steers`), has a lane on its left, and no actor is lively.
    - A vehicle without acts that it would touch is hidden by a nearer one at first.
    - Braking with `deceleration` (m/s2) from then on hits it.
    - A lane change from then on at its speed, as quick as those of the synthetic drivers, is clear
      of every vehicle to the end: 0.3 m across or, along the road, `FOLLOWING_GAP` to one ahead and
      2 m to one behind. To the vehicle that it goes round, any gap along the road is enough.

    settings: those of the case.
    """
    ego, road, vehicle = concrete.ego, concrete.road, settings.vehicle
    speed, grip = ego.speed, vehicle.friction * GRAVITY
    deceleration = min(deceleration, grip)
    lane = lane_at(road, ego.y)
    # the centre of lane 0 is y = 0; any length above 0 will do, as it is a divisor
    straight = road.lane_width * lane, 0.0, 0.0, 1.0
    suddenly_seen = {
        actor: foresight.noticed for actor, foresight in zip(concrete.actors, known, strict=True)
        if foresight.meets and foresight.hidden and isfinite(foresight.noticed)
        and not actor.acts
    }  # fmt: skip
    if not settings.ideal_steers or concrete.lively or lane + 1 == road.lanes or not suddenly_seen:
        return straight
    begin = min(suddenly_seen.values())
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
        if time < begin:  # still in its lane, where it would brake for a vehicle that is too near
            if goes_round or not is_ahead or across >= 0.0:
                return True
            return along >= safe_gap(speed, actor.speed(time), deceleration, build_up)
        least = FOLLOWING_GAP * speed if is_ahead else EMERGENCY_GAP
        return across >= CLEARANCE or along >= (0.0 if goes_round else least)

    times = np.arange(0.0, _end_at_its_speed(concrete, settings), _LOOK)
    places = steered.x_after(speed * times)
    way = zip(times.tolist(), places.tolist(), steered.y_at(places).tolist(), strict=True)
    if not all(clear(actor, *at) for at in way for actor in concrete.actors):
        return straight
    return straight[0], road.lane_width, begin_x, length


def _end_at_its_speed(concrete: ConcreteScenario, settings: SimulationSettings) -> float:
    """Time at which an ego that keeps its speed is at the road's end, s; at most the time limit."""
    ego = concrete.ego
    to_the_end = (concrete.road.length - ego.x) / ego.speed if ego.speed > 0.0 else inf
    return min(settings.time_limit, to_the_end)


class _Foreseen(NamedTuple):
    """Another vehicle as it moves while the ego keeps its speed.

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
        """Its shape at any time, s; a lively vehicle is interpolated between two steps."""
        actor = self.actor
        if actor.lively:
            rows = self.rows
            at = min(max(time / self.step, 0.0), len(rows) - 1.0)
            k = min(int(at), len(rows) - 2)
            between = rows[k] + (at - k) * (rows[k + 1] - rows[k])
            x, y, heading = between[:3].tolist()
        else:
            # a sliding body keeps its heading
            across = 0.0 if actor.slides else actor.lateral_speed(time)
            x, y = actor.x(time), actor.y(time)
            heading = atan2(across, actor.speed(time)) if across else 0.0
        return _Shape(x, y, *half_sizes(heading, actor.length, actor.width))

    @property
    def slowest(self) -> float:
        """Its lowest speed along the road, m/s; of one whose script brakes it, 0: it may stop."""
        if not self.actor.lively:
            return self.actor.start.speed if self.actor.braking is None else 0.0
        heading, speed, across = self.rows[:, 2:].T
        along = speed * np.cos(heading) - across * np.sin(heading)
        return max(float(along.min()), 0.0)


def _meets(
    ego: Start, vehicle: VehicleSettings, track: _Foreseen, until: float, line: Line
) -> bool:
    """Whether an ego that keeps its speed and its lane touches another vehicle.

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
    places = ego.x_after(ego.speed * times)
    near = np.abs(rows[:, 0] - places) < reach
    near &= np.abs(rows[:, 1] - ego.y_at(places)) < reach
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
    """The first instant from `time` on at which a vehicle is not hidden, s; inf where it stays
    hidden until `until`.

    It is hidden while a nearer one covers so much of its width that less than `ideal_visible_share`
    shows; the ego keeps its speed.
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
    """Whether one vehicle hides a farther one from the ego, as for the baselines
    (`perception.is_in_sight`). One that reaches the farther one's rear no longer hides it, so that
    a collision of both is seen, also where a script drives one through the other.
    """
    eye = float(ego.x_after(ego.speed * time))
    if not eye < nearer.x < farther.x - nearer.half_length - farther.half_length:
        return False
    eye_y = float(ego.y_at(eye))
    # distance of the nearer vehicle as a share of that of the farther one; 1 for a vehicle in the
    # ego's lane, to which lines of sight are parallel, while all others begin at the eye
    in_the_way = abs(farther.y - eye_y) < farther.half_width + 0.5 * settings.vehicle.width
    share = 1.0 if in_the_way else (nearer.x - eye) / (farther.x - eye)
    return covers(nearer, eye_y, farther, share, 1.0 - settings.ideal_visible_share)


class _Shape(NamedTuple):
    """Centre of a (turned) body, and half its extents along and across the road, m."""

    x: float
    y: float
    half_length: float
    half_width: float


def _ego_body(ego: Start, vehicle: VehicleSettings, time: float, line: Line) -> Body:
    """The ego's body on the map.

    Where it steers, its rear axle follows the path, and the body points along it. The body is then
    larger by `_TRACKING_ERROR` on each side, so that a near miss counts as contact.
    """
    room = 2.0 * _TRACKING_ERROR if ego.way is not None else 0.0
    # m from the centre back to the point that follows the path: the rear axle. On a straight path
    # 0: half a wheelbase less and again more would round x.
    half = 0.5 * vehicle.wheelbase if line or ego.way is not None else 0.0
    x = float(ego.x_after(ego.speed * time - half))
    y, next_y = ego.y_at([x, x + _AHEAD]).tolist()
    heading = atan2(next_y - y, _AHEAD)  # slope over `_AHEAD`
    axle = _on_the_map(
        Body(x, y, heading, ego.speed, vehicle.length + room, vehicle.width + room), line
    )
    return axle._replace(x=axle.x + half * cos(axle.heading), y=axle.y + half * sin(axle.heading))


def _on_the_map(body: Body, line: Line) -> Body:
    """A body that is given along and across a road."""
    if not line:
        return body
    x, y, heading = map_places(line, body.x, body.y, body.heading)
    return body._replace(x=float(x), y=float(y), heading=float(heading))
