"""Knowledge of the ideal vehicle of Eq. 17 before a case begins: which vehicles it would touch, and
from when on it can know this.

Everything is worked out in continuous time from the scripts of the other vehicles, so that it does
not depend on the simulation's step; only whether bodies touch is checked step by step, as the
harness does it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.ads.lane_change import shortest_duration, smooth_step
from sumo_eval.ads.overtaking import CLEARANCE, EMERGENCY_GAP, EMERGENCY_LATERAL
from sumo_eval.ads.perception import covers, safe_gap
from sumo_eval.cosim.contact import Body, share_at_touch
from sumo_eval.cosim.impossible import FASTEST
from sumo_eval.method.criticality import ideal_impact_speed
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Start
from sumo_eval.scenario.road.reference_line import Piece, map_places
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.trajectory import FloatArray

# s to a vehicle ahead in the lane that is entered: the least of UN R157 from 60 km/h on
FOLLOWING_GAP = 1.6
# s between two looks for the first sight of a hidden vehicle, whose instant is then bisected
_LOOK = 0.05
_HALVINGS = 30  # of `_LOOK`: to 5e-11 s
_AHEAD = 0.01  # m on which the direction of a way is taken
# m by which a way may be driven otherwise than it lies (0.002 in every scenario that ships)
_STEERED = 0.005
# m by which bodies on a bent road may be nearer to each other than their places along and across it
# tell
_BEND = 1.0


Line = tuple[Piece, ...]
"""The line that a road follows; none: a straight one."""


_Moving = Callable[[float], "_Shape"]
"""Where a body is at a time."""


class Foresight(NamedTuple):
    """Knowledge of one other vehicle.

    noticed: when its first change of state can be seen, s; inf where it never can.
    meets: whether an ego that keeps its speed would touch it.
    speed: its lowest speed along the road to come, m/s.
    hidden: whether a nearer vehicle is what keeps it from being noticed at once.
    """

    noticed: float
    meets: bool
    speed: float
    hidden: bool


def foresee(concrete: ConcreteScenario, settings: SimulationSettings) -> tuple[Foresight, ...]:
    """One `Foresight` for each of the other vehicles.

    settings: those of the case, its ego's body among them.

    They do what they do while the ego keeps its speed; a vehicle that reacts is assumed to keep its
    speed, too.
    """
    ego, vehicle, step = concrete.ego, settings.vehicle, settings.step
    on_the_road = (concrete.road.length - ego.x) / ego.speed if ego.speed > 0.0 else math.inf
    until = min(settings.time_limit, on_the_road)
    found = tracks([concrete], [(vehicle.length, vehicle.width)], step, until)
    theirs = [_Track(actor, step, found.others[0, j]) for j, actor in enumerate(concrete.actors)]
    known = []
    for actor, track, begins in zip(concrete.actors, theirs, found.begins[0].tolist(), strict=True):
        ahead = actor.start.x > ego.x
        slower = actor.start.speed * math.cos(actor.heading) < ego.speed
        caught_up = ahead and slower and _on_the_way(ego, actor, vehicle)
        changes = 0.0 if caught_up or math.isinf(begins) else begins
        nearer = [other.shape for other in theirs if other is not track]
        noticed = first_sight(ego, settings, track.shape, nearer, changes, until)
        # it will not drive into whoever keeps its speed
        reacts = actor.model is not None and not ahead
        meets = not reacts and _meets(ego, vehicle, track, until, concrete.road.line)
        # it is let past: only who stands leads no one into it
        passes = ego.way is not None and not ahead
        known.append(Foresight(noticed, meets, 0.0 if passes else track.slowest, noticed > changes))
    return tuple(known)


def evasion(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    known: Sequence[Foresight],
    deceleration: float,
) -> tuple[float, float, float, float]:
    """The path (`PATH`) of an ideal vehicle that steers to the lane on its left, of offset 0 where
    it brakes.

    It steers where a steady vehicle shows so late, from behind a nearer one, that braking with
    `deceleration` (m/s2) from then on hits it, and where a lane change from then on at the speed it
    has, as quick as those of the synthetic drivers, is clear of all vehicles to the end: by 0.3 m
    across, and along the road of each that is not steady by `FOLLOWING_GAP` to the one ahead and 2
    m to the one behind.

    settings: those of the case.
    """
    ego, road, vehicle = concrete.ego, concrete.road, settings.vehicle
    lane = min(max(round(ego.y / road.lane_width), 0), road.lanes - 1)
    straight = road.lane_width * lane, 0.0, 0.0, 1.0
    others = list(zip(concrete.actors, known, strict=True))
    round_whom = [
        actor for actor, told in others
        if told.meets and told.hidden and math.isfinite(told.noticed) and not actor.acts
    ]  # fmt: skip
    if not settings.ideal_steers or concrete.lively or lane + 1 == road.lanes or not round_whom:
        return straight
    begin = min(told.noticed for actor, told in others if actor in round_whom)
    at = ego.x + ego.speed * begin
    hits = [
        ideal_impact_speed(
            ego.speed, actor.start.speed,
            actor.x(begin) - at - 0.5 * (vehicle.length + actor.length),
            deceleration=deceleration, build_up=deceleration / vehicle.brake_jerk,
        ) > 0.0
        for actor in round_whom
    ]  # fmt: skip
    if not any(hits):
        return straight
    duration = shortest_duration(road.lane_width, EMERGENCY_LATERAL)
    response = deceleration / vehicle.brake_jerk
    until = min(settings.time_limit, (road.length - ego.x) / ego.speed)
    for time in np.arange(0.0, until, _LOOK).tolist():
        x = ego.x + ego.speed * time
        y = ego.y + road.lane_width * smooth_step((time - begin) / duration)
        for actor in concrete.actors:
            along = abs(actor.x(time) - x) - 0.5 * (vehicle.length + actor.length)
            across = abs(actor.y(time) - y) - 0.5 * (vehicle.width + actor.width)
            shown = actor not in round_whom
            if time >= begin:
                least = (
                    0.0
                    if not shown
                    else FOLLOWING_GAP * ego.speed
                    if actor.x(time) > x
                    else EMERGENCY_GAP
                )
                clear = across >= CLEARANCE or along >= least
            else:  # it would brake behind a vehicle that is too near
                near = shown and actor.x(time) > x and across < 0.0
                clear = not near or along >= safe_gap(
                    ego.speed, actor.speed(time), deceleration, response
                )
            if not clear:
                return straight
    return straight[0], road.lane_width, at, duration * ego.speed


def _on_the_way(ego: Start, actor: Actor, vehicle: VehicleSettings) -> bool:
    """Whether another vehicle starts in a lane along which the ego drives."""
    lanes = [ego.y] if ego.way is None else [ego.y, ego.y + ego.way.offset]
    return min(abs(actor.start.y - y) for y in lanes) < 0.5 * (actor.width + vehicle.width)


class _Track:
    """Another vehicle as it moves while the ego keeps its speed.

    rows: at every step, as in `Tracks`.
    """

    def __init__(self, actor: Actor, step: float, rows: FloatArray) -> None:
        self.actor, self.step, self.rows = actor, step, rows

    def body(self, k: int) -> Body:
        """The body after k steps."""
        row, actor = self.rows[k].tolist(), self.actor
        return Body(row[0], row[1], row[2], row[3], actor.length, actor.width, row[4])

    def shape(self, time: float) -> _Shape:
        """Where it is and how far it reaches, at any time: between two steps, if its script says no
        more.
        """
        actor = self.actor
        if actor.lively:
            at = min(max(time / self.step, 0.0), len(self.rows) - 1.0)
            k = min(int(at), len(self.rows) - 2)
            between = self.rows[k] + (at - k) * (self.rows[k + 1] - self.rows[k])
            x, y, heading = between[:3].tolist()
        else:
            across = 0.0 if actor.slides else actor.lateral_speed(time)
            x, y, heading = (
                actor.x(time),
                actor.y(time),
                math.atan2(across, actor.speed(time)) if across else 0.0,
            )
        c, s = abs(math.cos(heading)), abs(math.sin(heading))
        half_length, half_width = 0.5 * actor.length, 0.5 * actor.width
        return _Shape(x, y, half_length * c + half_width * s, half_length * s + half_width * c)

    @property
    def slowest(self) -> float:
        """Its lowest speed along the road to come, m/s."""
        if not self.actor.lively:
            return self.actor.start.speed if self.actor.braking is None else 0.0
        along = self.rows[:, 3] * np.cos(self.rows[:, 2]) - self.rows[:, 4] * np.sin(
            self.rows[:, 2]
        )
        return max(float(along.min()), 0.0)


def _meets(ego: Start, vehicle: VehicleSettings, track: _Track, until: float, line: Line) -> bool:
    """Whether an ego that keeps its speed and its lane touches another vehicle.

    line: of the road, none: straight.
    """
    rows, step = track.rows, track.step
    times = np.arange(len(rows)) * step
    reach = (
        0.5 * (vehicle.length + vehicle.width + track.actor.length + track.actor.width)
        + FASTEST * step * 0.1
    )
    reach += _BEND if line else 0.0
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
    it: _Moving,
    others: Sequence[_Moving],
    time: float,
    until: float,
) -> float:
    """When another vehicle, whose state changes at a time, can be seen from then on, s; inf if it
    stays hidden.

    It is hidden while a nearer one covers so much of its width that less than `ideal_visible_share`
    shows; the ego keeps its speed.
    """

    def hidden(when: float) -> bool:
        return any(_hides(ego, settings, other(when), it(when), when) for other in others)

    while hidden(time):
        if time > until:
            return math.inf
        later = time + _LOOK
        if not hidden(later):
            for _ in range(_HALVINGS):
                middle = 0.5 * (time + later)
                time, later = (middle, later) if hidden(middle) else (time, middle)
            return later
        time = later
    return time


def _hides(
    ego: Start, settings: SimulationSettings, nearer: _Shape, it: _Shape, time: float
) -> bool:
    """Whether one vehicle hides a farther one from the ego, as for the baselines
    (`perception.is_in_sight`): looking along the road at a vehicle in its way, else along the
    line to the vehicle. One that has come up to the other hides it no longer: bodies are solid,
    and a collision is seen, also where a script drives through.
    """
    eye = ego.x + ego.speed * time
    if not eye < nearer.x < it.x - nearer.half_length - it.half_length:
        return False
    own, hiding = float(ego.y_at(eye)), 1.0 - settings.ideal_visible_share
    in_the_way = abs(it.y - own) < it.half_width + 0.5 * settings.vehicle.width
    share = 1.0 if in_the_way else (nearer.x - eye) / (it.x - eye)
    return covers(nearer.y, nearer.half_width, own, it.y, it.half_width, share, hiding)


class _Shape(NamedTuple):
    """Where a (turned) body is, and half its extents along and across the road, m."""

    x: float
    y: float
    half_length: float
    half_width: float


def _ego_body(ego: Start, vehicle: VehicleSettings, time: float, line: Line) -> Body:
    """The ego's body on the map.

    Where it steers its rear axle is on the way, square to it, and it takes `_STEERED` more room to
    each side: it brakes for vehicles that it would miss by less.
    """
    room = 2.0 * _STEERED if ego.way is not None else 0.0
    half = 0.5 * vehicle.wheelbase if line or ego.way is not None else 0.0
    x = float(ego.x_after(ego.speed * time - half))
    heading, y = 0.0, ego.y
    if ego.way is not None:
        y, ahead = ego.y_at(np.array([x, x + _AHEAD])).tolist()
        heading = math.atan2(ahead - y, _AHEAD)
    axle = _on_the_map(
        Body(x, y, heading, ego.speed, vehicle.length + room, vehicle.width + room), line
    )
    return axle._replace(
        x=axle.x + half * math.cos(axle.heading), y=axle.y + half * math.sin(axle.heading)
    )


def _on_the_map(body: Body, line: Line) -> Body:
    """A body that is given along and across a road."""
    if not line:
        return body
    x, y, heading = map_places(line, body.x, body.y, body.heading)
    return body._replace(x=float(x), y=float(y), heading=float(heading))
