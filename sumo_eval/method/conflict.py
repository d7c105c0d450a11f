"""Encounters with an actor that moves in two dimensions, and conflicts of two ways.

Zones (`point_criticality`) need encounters, cases.csv (`scoring/`) conflicts.

Encounter: the ego brakes ideally on its path (Eqs. 2 and 5-6, searched in time). Braking begins at
the obstacle's first move plus the scenario's delay, and ends at a standstill. The obstacle follows
its script; an actor that reacts is assumed to keep its speed. Its inverse TTC counts while both
overlap across the road and it is ahead; it is infinite where the bodies touch. Where ways conflict
(`conflict = true`), the time until both would touch on them counts instead.

Conflict: two ways cross or join, as where one road leads into another. It has an area, a time to
this area, and a PET. The ego's way is y as a function of x along the road, at a speed. The time to
collision on conflicting ways is the time after which the bodies would touch if the ego kept its
speed on its way while the actor follows its script (Hayward 1972: on a collision course, whatever
the angle). Bodies are upright rectangles, as wide and long as the turned bodies reach along and
across the road.
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
from sumo_eval.scenario.undisturbed import meetings, tracks
from sumo_eval.settings import VehicleSettings, ZoneSettings
from sumo_eval.trajectory import BoolArray, FloatArray, half_extents

# A look is an instant at which bodies are compared.
STEP = 0.1  # s between looks on conflicting ways; contacts between two looks are interpolated
HORIZON = 6.0  # s ahead in which a collision counts; one in 6 s has an ITTC of 0.17 1/s
_LONGEST = 60.0  # s that are searched at most
_FINER = 0.02  # s between looks where ways do not conflict
_AT_ONCE = 500  # points searched together
_ACROSS = 0.5  # sine of the angle to the road from which an actor crosses it

_WAY = np.dtype([(name, "f8") for name in ("y", "offset", "begin", "length")])
"""The ego's way, m: y at first; its lane change by `offset` to the left, from x = `begin` on, over
`length`."""


class Conflict(NamedTuple):
    """Conflict of the ego's way with an actor's, if neither vehicle reacts.

    The ego's way is a strip as wide as the ego. All fields are nan where the actor never comes into
    the strip.

    begin, end: x of the conflict area, the stretch of the strip that the actor passes over, m.
    enters, leaves: times at which the actor's body comes into the strip and is out of it, s; it
        leaves at inf where it stays, as where the ways join.
    time_to: time at which the ego's front is at `begin` at its speed, s.
    pet: time from the first vehicle's leaving the area until the second one enters it, s; 0 where
        both are there at once. Where the ways join, the area is the line x = `begin` alone.
    """

    begin: float
    end: float
    enters: float
    leaves: float
    time_to: float
    pet: float


def encounter(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """Eqs. 2 and 5-6: max ITTC, 1/s, impact speed, m/s, and smallest gap, m, (3, n).

    logical: a scenario with a `search`.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.

    Max ITTC is inf where ideal braking hits, 0 where the ego never closes on the obstacle in its
    way. The gap is inf where the obstacle is never in the way. Both are sampled every 0.02 s, so
    the ITTC is below its peak by the motion of half a step. Where ways conflict,
    `conflict_criticality` computes all three.
    """
    parts = (points[begin : begin + _AT_ONCE] for begin in range(0, len(points), _AT_ONCE))
    return np.concatenate(
        [np.empty((3, 0)), *(_encounters(logical, part, settings) for part in parts)], axis=1
    )


def _encounters(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """`encounter` of points that are searched together."""
    search = logical.search
    assert search is not None
    size = ego_size(logical)
    values = [dict(zip(logical.names, row, strict=True)) for row in points.tolist()]
    placed = [logical.placed(point) for point in values]
    delays = [float(search.delay(point)) for point in values]
    if search.conflict:
        return conflict_criticality(placed, search.obstacle, delays, size, settings)
    longest = min(logical.time_limit or _LONGEST, _LONGEST)
    # long enough for the latest braking: the obstacle moves before the ego is at the road's end
    until = [
        min(longest, delay + concrete.ego.speed / settings.deceleration + _time_on_road(concrete))
        for concrete, delay in zip(placed, delays, strict=True)
    ]
    return meetings(
        placed, [size] * len(placed), _FINER, until, settings.deceleration, search.obstacle, delays
    ).T


def _time_on_road(concrete: ConcreteScenario) -> float:
    """Time in which the ego comes to the end of the road at its first speed (1 m/s at least), s."""
    ego = concrete.ego
    return (concrete.road.length - ego.x) / max(ego.speed, 1.0)


def crossing_conflict(
    concrete: ConcreteScenario, other: int, size: tuple[float, float]
) -> Conflict:
    """The conflict with actor `other`, whose way crosses or joins the ego's, if neither reacts.

    concrete: the concrete scenario.
    other: the actor's number.
    size: length and width of the ego's body, m.
    """
    ego, (length, width) = concrete.ego, size
    until = min(_time_on_road(concrete), _LONGEST)
    motion = tracks([concrete], [size], STEP, until).others[:, other]
    times: FloatArray = np.arange(motion.shape[1], dtype=float) * STEP
    (long,), (wide,) = _extents(motion, concrete, other)  # half the body's reach, m
    x, y, heading = motion[0, :, :3].T
    # distance of the body from the strip, m, negative inside
    apart = np.abs(y - ego.y_at(x)) - wide - 0.5 * width
    inside = np.flatnonzero(apart < 0.0)
    if not inside.size:
        return Conflict(*(math.nan,) * 6)
    first, last = int(inside[0]), int(inside[-1])

    def crossed(after: int) -> float:
        """Time at which the actor's body is at the strip's edge, s; `after` is the next look."""
        share = apart[after - 1] / (apart[after - 1] - apart[after])
        return float(times[after - 1] + (times[after] - times[after - 1]) * share)

    def reached(x: float) -> float:
        """Time at which the ego's centre is at x, s."""
        return (x - ego.x) / ego.speed if ego.speed > 0.0 else math.inf

    enters = float(times[first]) if first == 0 else crossed(first)
    leaves = crossed(last + 1) if last + 1 < len(times) else math.inf
    begin, end = float((x - long)[inside].min()), float((x + long)[inside].max())
    ego_arrives, ego_clears = reached(begin - 0.5 * length), reached(end + 0.5 * length)
    actor_arrives, actor_clears = enters, leaves
    # Ways that join: the actor stays in the strip and drives along it, within 45 degrees. The area
    # is then the line x = begin, where the actor's rear is when it enters the strip.
    if math.isinf(leaves) and math.cos(heading[last]) > math.cos(0.25 * math.pi):
        actor_arrives = float(np.interp(begin, x + long, times, left=-math.inf))
        actor_clears, ego_clears = enters, reached(begin + 0.5 * length)
    pet = max(ego_arrives - actor_clears, actor_arrives - ego_clears, 0.0)
    return Conflict(begin, end, enters, leaves, ego_arrives, pet)


def conflicting(logical: LogicalScenario, concrete: ConcreteScenario) -> int | None:
    """Number of the actor whose way conflicts with the ego's; None without one.

    It is the obstacle of the scenario's zones, if the scenario's file has `conflict = true` or the
    obstacle crosses the road.
    """
    search = logical.search
    if search is None:
        return None
    crosses = abs(math.sin(concrete.actors[search.obstacle].heading)) > _ACROSS
    return search.obstacle if search.conflict or crosses else None


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
    """Eqs. 2 and 5-6 on conflicting ways: max ITTC, 1/s, impact speed, m/s, and smallest distance
    of the bodies, m, (3, n).

    placed: n cases of one scenario.
    other: number of the actor whose first move makes the ego brake.
    delays: s, (n,), from that move to the braking.
    size: length and width of the ego's body, m.
    settings: `[method.zones]`.

    The ego keeps its way. Where it touches no actor at its speed, it keeps that too: max ITTC and
    impact speed are 0. Elsewhere it brakes ideally to a standstill: max ITTC is the largest inverse
    time to collision with any actor, inf where it hits one even so. Actors that react and come from
    behind do not count.
    """
    strength, waits = settings.deceleration, np.array(delays)
    speeds = np.array([concrete.ego.speed for concrete in placed])
    # long enough for the latest braking to a standstill
    until = np.minimum(_begins(placed, other) + waits + speeds / strength + HORIZON, _LONGEST)
    motion = tracks(placed, [size] * len(placed), STEP, float(until.max()))
    others, looks = motion.others, np.arange(motion.others.shape[2])
    # A case ends at its own time: nothing may depend on the cases searched with it. From then on
    # its actors are out of reach, at x = inf.
    late = looks > np.ceil(until / STEP - 1e-9)[:, None]
    np.copyto(others[..., 0], np.inf, where=late[:, None])
    # First at a constant speed. Only whether the bodies touch counts, so no look ahead is needed.
    unbraked = _braked(placed, looks, np.full(len(placed), np.inf), strength)
    result = _most_critical(placed, others, size, unbraked, 0)
    touches = np.flatnonzero(np.isinf(result[0]))
    result[:2] = 0.0
    if touches.size:
        some = [placed[i] for i in touches.tolist()]
        # an obstacle that makes no move in this time is an obstacle from the start
        first = motion.begins[:, other]
        begins = np.where(first > until, 0.0, first) + waits
        egos = _braked(some, looks, begins[touches], strength)
        ahead = round(HORIZON / STEP)
        result[:, touches] = _most_critical(some, others[touches], size, egos, ahead)
    return result


def _braked(
    placed: Sequence[ConcreteScenario], looks: NDArray[Any], begins: FloatArray, strength: float
) -> FloatArray:
    """x, m, and speed, m/s, of egos that brake to a standstill, at T looks, (n, T, 2).

    looks: numbers of the looks, (T,).
    begins: time at which each ego begins to brake, (n,), s; inf: never.
    strength: deceleration, m/s2.
    """
    x, v = np.array([[concrete.ego.x, concrete.ego.speed] for concrete in placed]).T[:, :, None]
    time, wait = looks * STEP, begins[:, None]
    braked = np.clip(time - wait, 0.0, v / strength)  # time of braking so far, s
    speed = v - strength * braked
    return np.stack([x + v * np.minimum(time, wait) + braked * (v + speed) / 2.0, speed], axis=2)


def _most_critical(
    placed: Sequence[ConcreteScenario],
    others: FloatArray,
    size: tuple[float, float],
    egos: FloatArray,
    horizon: int,
) -> FloatArray:
    """Max ITTC, impact speed and smallest distance of the bodies, (3, n): of each the most critical
    value of all actors.

    others: motion of the actors, (n, m, T, 5), as in `Tracks`.
    egos: x and speed, (n, T, 2).
    horizon: number of looks ahead in which a collision counts.
    """
    each = np.array(
        [
            _with_actor(placed, others[:, number], number, size, egos, horizon)
            for number in range(others.shape[1])
        ]
    ).transpose(1, 0, 2)
    # such an actor neither closes in nor hits nor comes near
    each[:, _react_from_behind(placed)] = np.array([[0.0], [0.0], [np.inf]])
    return np.stack([each[0].max(axis=0), each[1].max(axis=0), each[2].min(axis=0)])


def _react_from_behind(placed: Sequence[ConcreteScenario]) -> BoolArray:
    """Whether each actor reacts and comes from behind the ego, (others, n).

    These do not count: no braking of the ego averts their acts, which SUMO alone knows.
    """
    flags = [
        [actor.model is not None and actor.start.x < one.ego.x for actor in one.actors]
        for one in placed
    ]
    return np.array(flags, dtype=bool).T


def _with_actor(
    placed: Sequence[ConcreteScenario],
    track: FloatArray,
    other: int,
    size: tuple[float, float],
    egos: FloatArray,
    horizon: int,
) -> FloatArray:
    """Max ITTC, impact speed and smallest distance of the bodies with number `other`, (3, n).

    track: motion of that actor, (n, T, 5), as in `Tracks`.
    egos, horizon: as in `_most_critical`.
    """
    long, wide = _extents(track, placed[0], other)
    ways = np.zeros(len(placed), _WAY)
    for i, concrete in enumerate(placed):
        way = concrete.ego.way
        change = (0.0, 0.0, 1.0)  # without a lane change; `_y_at` divides by the length
        if way is not None:
            change = (way.offset, way.begin, way.length(concrete.ego.speed))
        ways[i] = (concrete.ego.y, *change)
    bodies = np.stack(
        [track[:, :, 0], track[:, :, 1], long + 0.5 * size[0], wide + 0.5 * size[1]], axis=2
    )
    result = np.zeros((len(placed), 3))
    _search_rows(ways, egos, bodies, horizon, result)
    inverse, touch, nearest = result.T
    hit = np.flatnonzero(touch >= 0.0)
    at = touch[hit].astype(np.intp)  # looks of the contacts
    # the actor's velocity along the road, and to its left
    heading, speed, across = (track[hit, at, channel] for channel in (2, 3, 4))
    along = speed * np.cos(heading) - across * np.sin(heading)
    sideways = speed * np.sin(heading) + across * np.cos(heading)
    impact = np.zeros(len(placed))
    impact[hit] = np.hypot(egos[hit, at, 1] - along, sideways)
    return np.stack([np.where(touch >= 0.0, np.inf, inverse), impact, np.maximum(nearest, 0.0)])


def _begins(placed: Sequence[ConcreteScenario], other: int) -> FloatArray:
    """Latest time at which actor `other` can begin its first move, s, (n,).

    A move that waits for a condition begins before the ego is at the end of the road.
    """
    begins = []
    for concrete in placed:
        latest, acts = _time_on_road(concrete), concrete.actors[other].acts
        begins.append(min([latest if act.program else act.begin for act in acts], default=0.0))
    return np.array(begins)


def _extents(
    track: FloatArray, concrete: ConcreteScenario, other: int
) -> tuple[FloatArray, FloatArray]:
    """Half of the reach of a body along and across the road, (n, T), m; track: (n, T, 5)."""
    actor = concrete.actors[other]
    return half_extents(track[:, :, 2], actor.length, actor.width)


@kernel
def _y_at(way: Any, x: float) -> float:
    """`Start.y_at` of a `_WAY`."""
    return float(way.y + way.offset * quintic(min(max((x - way.begin) / way.length, 0.0), 1.0)))


@kernel
def _apart(way: Any, x: float, other: Any) -> tuple[float, float]:
    """Distance of the bodies along and across the road, m; both negative where they touch.

    other: x, y, and the reach of both bodies together along and across the road.
    """
    return abs(other[0] - x) - other[2], abs(other[1] - _y_at(way, x)) - other[3]


@kernel
def _share(before: float, after: float) -> float:
    """Share of a step at which a distance is 0: it is `before` at the beginning and falls evenly to
    `after`, below 0.
    """
    return before / (before - after) if before > 0.0 else 0.0


@rows
def _search_rows(
    ways: NDArray[Any],
    egos: FloatArray,
    others: FloatArray,
    horizon: int,
    result: FloatArray,
) -> None:
    """Write the result of each row: largest inverse TTC, 1/s, the look at which both touch (-1:
    never), and the smallest distance, m.

    ways: `_WAY`, (n,).
    egos: x and speed at T looks, (n, T, 2).
    others: as in `_apart`, (n, T, 4).
    horizon: number of looks ahead in which a collision counts.
    result: (n, 3).
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
                along, across = _apart(way, x + speed * STEP * ahead, others[i, k + ahead])
                if along < 0.0 and across < 0.0:
                    share = max(_share(last_along, along), _share(last_across, across))
                    time = STEP * (ahead - 1 + share)
                    inverse = max(inverse, 1.0 / max(time, 1e-6))  # not by 0
                    break
                last_along, last_across = along, across
        result[i, 0], result[i, 1], result[i, 2] = inverse, touch, nearest
