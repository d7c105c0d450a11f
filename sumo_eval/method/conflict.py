"""Encounters with an actor that moves in two dimensions, under ideal braking (Eqs. 2 and 5-6
searched), and conflicts of two ways, as where one road leads into another or crosses it: their
area, the time to it, PET.

In an encounter the ego keeps its path and brakes ideally to a standstill from the obstacle's first
move plus the scenario's delay on; the obstacle follows its script. While both overlap across the
road and the obstacle is ahead, its inverse TTC counts; where the bodies touch it is infinite. An
actor that reacts is assumed to keep its speed. Where ways conflict (`conflict = true`) the time
until both would touch on them counts instead.

A way is a function of the place along the road; on it the ego has a speed. The time to collision on
conflicting ways is the time after which the bodies would touch if the ego kept its speed on its way
while the actor follows its script (Hayward 1972: on a collision course, whatever the angle). Bodies
are upright rectangles, as wide and long as the turned bodies reach along and across the road.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_eval.kernels import kernel, rows
from sumo_eval.scenario import ConcreteScenario, LogicalScenario
from sumo_eval.scenario.motion import quintic
from sumo_eval.scenario.undisturbed import Tracks, meetings, tracks
from sumo_eval.settings import VehicleSettings, ZoneSettings
from sumo_eval.trajectory import BoolArray, FloatArray, half_extents

# s between two looks; contact between two is found on the straight line from one to the other
STEP = 0.1
HORIZON = 6.0  # s ahead in which a collision course counts, ITTC 0.17 1/s
_LONGEST = 60.0  # s that are looked at, at most
_FINER = 0.02  # s between two looks where ways do not conflict
_AT_ONCE = 500  # points searched together

_WAY = np.dtype([(name, "f8") for name in ("y", "offset", "begin", "length")])


class Conflict(NamedTuple):
    """Conflict of two undisturbed ways; all nan where the actor never comes into the ego's strip.

    begin, end: of the stretch of the ego's way over which the actor passes, x, m.
    enters, leaves: when the actor's body is in the ego's strip, s; it leaves at inf where the ways
        join.
    time_to: until the ego's front is at `begin` at its speed, s.
    pet: from the first one's leaving the area, or `begin` where ways join, until the second one's
        entering, s; 0 where both are there at once.
    """

    begin: float
    end: float
    enters: float
    leaves: float
    time_to: float
    pet: float


def encounter(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """Eqs. 2 and 5-6: max ITTC, 1/s, impact speed, m/s, and the smallest gap in the ego's way, m,
    (3, n).

    logical: a scenario with a `search`.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.

    Max ITTC is inf where ideal braking hits, 0 where the obstacle is never closed upon in the ego's
    way; the gap is inf where it is never in the way. Sampled every 0.02 s, so an ITTC below its
    peak by the motion of half a step.
    """
    parts = (points[begin : begin + _AT_ONCE] for begin in range(0, len(points), _AT_ONCE))
    return np.concatenate(
        [np.empty((3, 0)), *(_of(logical, part, settings) for part in parts)], axis=1
    )


def _of(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    search = logical.search
    assert search is not None
    size = ego_size(logical)
    values = [dict(zip(logical.names, row, strict=True)) for row in points.tolist()]
    placed = [logical.placed(point) for point in values]
    delays = [float(search.delay(point)) for point in values]
    if search.conflict:
        return conflict_criticality(placed, search.obstacle, delays, size, settings)
    longest = min(logical.time_limit or _LONGEST, _LONGEST)
    # the obstacle begins before the ego has come to the end of the road
    until = [
        min(longest, delay + concrete.ego.speed / settings.deceleration + _time_on_road(concrete))
        for concrete, delay in zip(placed, delays, strict=True)
    ]
    met = meetings(
        placed, [size] * len(placed), _FINER, until, settings.deceleration, search.obstacle, delays
    )
    return met[:, :3].T


def _time_on_road(concrete: ConcreteScenario) -> float:
    """Time in which the ego comes to the end of the road at its first speed, s."""
    ego = concrete.ego
    return (concrete.road.length - ego.x) / max(ego.speed, 1.0)


def crossing_conflict(
    concrete: ConcreteScenario, other: int, size: tuple[float, float]
) -> Conflict:
    """The conflict with actor `other`, which crosses the ego's way, if neither reacts.

    concrete: the concrete scenario.
    other: the actor's number.
    size: length and width of the ego's body, m.
    """
    ego, (length, width) = concrete.ego, size
    found = tracks([concrete], [size], STEP, min(_time_on_road(concrete), _LONGEST))
    times: FloatArray = np.arange(found.others.shape[2], dtype=float) * STEP
    track = found.others[0, other]
    long, wide = (reach[0] for reach in _extents(found.others[:, other], concrete, other))
    x, y = track[:, 0], track[:, 1]
    apart = np.abs(y - ego.y_at(x)) - wide - 0.5 * width
    inside = np.flatnonzero(apart < 0.0)
    if not inside.size:
        return Conflict(*(math.nan,) * 6)
    first, last = int(inside[0]), int(inside[-1])

    def crossed(after: int) -> float:
        """Time at which the actor's body is at the strip's edge, between two samples, s."""
        before = apart[after - 1] / (apart[after - 1] - apart[after])
        return float(times[after - 1] + (times[after] - times[after - 1]) * before)

    def reached(place: float) -> float:
        """Time at which the ego's front is at x = place, s."""
        return (place - ego.x) / ego.speed if ego.speed > 0.0 else math.inf

    enters = float(times[first]) if first == 0 else crossed(first)
    leaves = crossed(last + 1) if last + 1 < len(times) else math.inf
    begin, end = float((x - long)[inside].min()), float((x + long)[inside].max())
    arrives, clears = reached(begin - 0.5 * length), reached(end + 0.5 * length)
    there, gone = enters, leaves
    # one behind the other from there
    if math.isinf(leaves) and math.cos(track[last, 2]) > math.cos(0.25 * math.pi):
        there = float(np.interp(begin, x + long, times, left=-math.inf))
        gone, clears = enters, reached(begin + 0.5 * length)
    return Conflict(begin, end, enters, leaves, arrives, max(arrives - gone, there - clears, 0.0))


_ACROSS = 0.5  # sine of the angle to the road from which on an actor crosses it


def conflicting(logical: LogicalScenario, concrete: ConcreteScenario) -> int | None:
    """Number of the actor whose way conflicts with the ego's: the obstacle of zones of
    conflicts, or of other zones where it crosses the road; None without one.
    """
    search = logical.search
    if search is None or not (
        search.conflict or abs(math.sin(concrete.actors[search.obstacle].heading)) > _ACROSS
    ):
        return None
    return search.obstacle


def conflict_at(logical: LogicalScenario, values: Mapping[str, float]) -> Conflict | None:
    """The conflict of a concrete scenario without any reaction; None where no way conflicts with
    the ego's.
    """
    concrete = logical.placed(values)
    other = conflicting(logical, concrete)
    return None if other is None else crossing_conflict(concrete, other, ego_size(logical))


def ego_size(logical: LogicalScenario) -> tuple[float, float]:
    """Length and width of the ego's body, m."""
    vehicle, own = VehicleSettings(), logical.ego_body
    return (vehicle.length, vehicle.width) if own is None else (own.length, own.width)


def conflict_criticality(
    placed: Sequence[ConcreteScenario],
    other: int,
    delays: Sequence[float],
    size: tuple[float, float],
    settings: ZoneSettings,
) -> FloatArray:
    """Eqs. 2 and 5-6 on conflicting ways: max ITTC, 1/s, impact speed, m/s, smallest distance, m.

    placed: n cases of one scenario.
    other: number of the actor whose first move makes the ego brake.
    delays: s, (n,), from that move to the braking.
    size: length and width of the ego's body, m.
    settings: `[method.zones]`.

    The ego keeps its way and brakes ideally to a standstill, or keeps its speed where that touches
    no actor: 0 then. Max ITTC is the largest inverse time to collision on the conflicting ways,
    with any actor except those that react and come from behind; inf where ideal braking hits.
    """
    strength, never = settings.deceleration, np.full(len(placed), np.inf)
    speeds = np.array([concrete.ego.speed for concrete in placed])
    until = _begins(placed, other) + np.array(delays) + speeds / strength + HORIZON
    until = np.minimum(until, _LONGEST)
    found = tracks(placed, [size] * len(placed), STEP, float(until.max()))
    # A case ends at its own time: nothing may depend on the cases searched with it.
    late = np.arange(found.others.shape[2]) > np.ceil(until / STEP - 1e-9)[:, None]
    np.copyto(found.others[..., 0], np.inf, where=late[:, None])
    first = found.begins[:, other]
    brakes = np.where(first > until, 0.0, first) + np.array(delays)
    searched = _with_all(placed, found, size, _braked(placed, found, never, strength), 0)
    at = np.flatnonzero(np.isinf(searched[0]))
    searched[:2] = 0.0
    if at.size:
        hit = Tracks(found.egos[at], found.others[at], found.begins[at])
        some = [placed[i] for i in at.tolist()]
        egos = _braked(some, hit, brakes[at], strength)
        searched[:, at] = _with_all(some, hit, size, egos, round(HORIZON / STEP))
    return searched


def _braked(
    placed: Sequence[ConcreteScenario], found: Tracks, begins: FloatArray, strength: float
) -> FloatArray:
    """x and speed of the egos, (n, T, 2), which brake to a standstill.

    begins: when each begins to brake, s.
    """
    x, v = np.array([[concrete.ego.x, concrete.ego.speed] for concrete in placed]).T[:, :, None]
    time, wait = np.arange(found.others.shape[2]) * STEP, begins[:, None]
    braking = np.clip(time - wait, 0.0, v / strength)
    speed = v - strength * braking
    return np.stack([x + v * np.minimum(time, wait) + braking * (v + speed) / 2.0, speed], axis=2)


def _with_all(
    placed: Sequence[ConcreteScenario],
    found: Tracks,
    size: tuple[float, float],
    egos: FloatArray,
    horizon: int,
) -> FloatArray:
    """Max ITTC, impact speed and smallest distance of the bodies, (3, n), with the most critical
    actor.

    egos: x and speed, (n, T, 2).
    horizon: looks ahead.
    """
    each = np.array(
        [
            _with(placed, found.others[:, number], number, size, egos, horizon)
            for number in range(found.others.shape[1])
        ]
    ).transpose(1, 0, 2)
    each[:, _let_the_ego_in(placed)] = np.array([[0.0], [0.0], [np.inf]])
    return np.stack([each[0].max(axis=0), each[1].max(axis=0), each[2].min(axis=0)])


def _let_the_ego_in(placed: Sequence[ConcreteScenario]) -> BoolArray:
    """Actors that react and come from behind the ego, (others, n): no braking of the ego averts
    their acts, which SUMO alone knows.
    """
    react = [[actor.model is not None for actor in concrete.actors] for concrete in placed]
    behind = [[actor.start.x < concrete.ego.x for actor in concrete.actors] for concrete in placed]
    found: BoolArray = np.array(react, dtype=bool) & np.array(behind, dtype=bool)
    return found.T


def _with(
    placed: Sequence[ConcreteScenario],
    track: FloatArray,
    other: int,
    size: tuple[float, float],
    egos: FloatArray,
    horizon: int,
) -> FloatArray:
    """Max ITTC, impact speed and smallest distance of the bodies with number `other`, (3, n).

    track: its, (n, T, 5).
    """
    long, wide = _extents(track, placed[0], other)
    ways = np.zeros(len(placed), _WAY)
    for i, concrete in enumerate(placed):
        way, offset = concrete.ego.way, (0.0, 0.0, 1.0)
        if way is not None:
            offset = (way.offset, way.begin, way.length(concrete.ego.speed))
        ways[i] = (concrete.ego.y, *offset)
    bodies = np.stack(
        [track[:, :, 0], track[:, :, 1], long + 0.5 * size[0], wide + 0.5 * size[1]], axis=2
    )
    result = np.zeros((len(placed), 3))
    _search_rows(ways, egos, bodies, STEP, horizon, result)
    inverse, touch, nearest = result.T
    hit = np.flatnonzero(touch >= 0.0)
    at, impact = touch[hit].astype(np.intp), np.zeros(len(placed))
    heading, speed, across = (track[hit, at, channel] for channel in (2, 3, 4))
    along = speed * np.cos(heading) - across * np.sin(heading)
    sideways = speed * np.sin(heading) + across * np.cos(heading)
    impact[hit] = np.hypot(egos[hit, at, 1] - along, sideways)
    return np.stack([np.where(touch >= 0.0, np.inf, inverse), impact, np.maximum(nearest, 0.0)])


def _begins(placed: Sequence[ConcreteScenario], other: int) -> FloatArray:
    """Latest time at which the first move of vehicle `other` can begin, s: one with a condition
    begins before the ego has come to the end of the road.
    """
    begins = []
    for concrete in placed:
        latest, script = _time_on_road(concrete), concrete.actors[other].acts
        begins.append(min([latest if act.program else act.begin for act in script], default=0.0))
    return np.array(begins)


def _extents(
    track: FloatArray, concrete: ConcreteScenario, other: int
) -> tuple[FloatArray, FloatArray]:
    """Half of the reach of a body along and across the road, (n, T), m; track: (n, T, 5)."""
    actor = concrete.actors[other]
    return half_extents(track[:, :, 2], actor.length, actor.width)


@kernel
def _y_at(way: Any, x: float) -> float:
    return float(way.y + way.offset * quintic(min(max((x - way.begin) / way.length, 0.0), 1.0)))


@kernel
def _apart(way: Any, x: float, other: Any) -> tuple[float, float]:
    """Distance of the bodies along and across the road, m; both negative where they touch."""
    return abs(other[0] - x) - other[2], abs(other[1] - _y_at(way, x)) - other[3]


@kernel
def _share(before: float, after: float) -> float:
    """The share of a step after which a distance that goes straight to a negative one is 0."""
    return before / (before - after) if before > 0.0 else 0.0


@rows
def _search_rows(
    ways: NDArray[Any],
    egos: FloatArray,
    others: FloatArray,
    step: float,
    horizon: int,
    result: FloatArray,
) -> None:
    """Largest inverse TTC, the step at which both touch (-1: never), the smallest distance.

    egos: x and speed.
    """
    for i in range(len(ways)):
        way = ways[i]
        inverse, nearest, touch = 0.0, math.inf, -1.0
        count = egos.shape[1]
        for k in range(count):
            x, speed = egos[i, k, 0], egos[i, k, 1]
            along, across = _apart(way, x, others[i, k])
            nearest = min(nearest, max(along, across))
            if along < 0.0 and across < 0.0:
                touch = float(k)
                break
            if speed <= 0.0:
                continue
            last_along, last_across = along, across
            for ahead in range(1, min(horizon, count - 1 - k) + 1):
                along, across = _apart(way, x + speed * step * ahead, others[i, k + ahead])
                if along < 0.0 and across < 0.0:
                    share = max(_share(last_along, along), _share(last_across, across))
                    time = step * (ahead - 1 + share)
                    inverse = max(inverse, 1.0 / max(time, 1e-6))
                    break
                last_along, last_across = along, across
        result[i, 0], result[i, 1], result[i, 2] = inverse, touch, nearest
