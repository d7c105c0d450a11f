"""Encounters with an actor that moves in two dimensions, and conflicts of two ways.

Users: `point_criticality` (encounters, for zones), `scoring/` (conflicts), `record/` (compiles
loops).

Encounter: the ego brakes ideally on its path (Eqs. 2 and 5-6, searched in time). Braking begins at
the obstacle's first move plus the scenario's delay, and ends at a standstill. The obstacle follows
its script; an actor that reacts is assumed to keep its speed. Its inverse TTC counts while both
overlap across the road and it is ahead; it is infinite where the bodies touch. Where ways conflict
(`conflict = true`), the time until both would touch on them counts instead.

Conflict: two ways cross or join, as where one road leads into another. It has an area, a time to
this area, and a PET. The ego's way is y as a function of x along the road, at a speed. The time to
collision on conflicting ways is the time after which the bodies would touch if the ego kept its
speed on its way while the actor follows its script (Hayward 1972: on a collision course, whatever
the angle). For the area, the turned actor is its bounding rectangle along the road.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.kernels import Records, fields, kernel, rows
from sumo_eval.scenario import ConcreteScenario, LogicalScenario
from sumo_eval.scenario.first_places import STANDARD_EGO
from sumo_eval.scenario.motion import quintic, quintic_rate
from sumo_eval.scenario.touch import Body, between, share_at_touch, widest_gap
from sumo_eval.scenario.undisturbed import meetings, tracks
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import FloatArray, half_extents

# A look is an instant at which bodies are compared.
STEP = 0.1  # s between looks on conflicting ways; between two looks the actors move evenly
_PARTS = 5  # of a step; within each the ego moves evenly, at most 0.25 mm off while it brakes
HORIZON = 6.0  # s ahead in which a collision counts; one in 6 s has an ITTC of 0.17 1/s
_LONGEST = 60.0  # s that are searched at most
_FINER = 0.02  # s between looks where ways do not conflict
_AT_ONCE = 500  # points searched together
_ACROSS = 0.5  # sine of the angle to the road from which an actor crosses it

_WAY = np.dtype(fields("y", "offset", "begin", "length", "ego_long", "ego_wide", "long", "wide"))
"""The ego's way, m: y at first; its lane change by `offset` to the left, from x = `begin` on, over
`length`. Length and width of its body, and of the other's.
"""


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
    way. The gap is inf where the obstacle is never in the way. ITTC and gap are sampled every
    0.02 s: the ITTC is below its peak by half a step's motion. Where ways conflict,
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
    ego = concrete.ego
    length, width = size
    until = min(_time_on_road(concrete), _LONGEST)
    motion = tracks([concrete], [size], STEP, until).others[0, other]
    actor = concrete.actors[other]
    times = np.arange(len(motion), dtype=float) * STEP
    x, y, heading = motion[:, :3].T
    long, wide = half_extents(heading, actor.length, actor.width)
    # distance of the body from the strip, m, negative inside
    apart = np.abs(y - ego.y_at(x)) - wide - 0.5 * width
    inside = np.flatnonzero(apart < 0.0)
    if not inside.size:
        return Conflict(*(math.nan,) * 6)  # every field is nan
    first, last = inside[[0, -1]]

    def crossed(after: int) -> float:
        """Time at which the actor's body is at the strip's edge, s; `after` is the next look."""
        share = apart[after - 1] / (apart[after - 1] - apart[after])
        return float(times[after - 1] + (times[after] - times[after - 1]) * share)

    def reached(position: float) -> float:
        """Time at which the ego's centre is at x = `position`, s; -inf: it stands beyond."""
        ahead = position - ego.x
        return ahead / ego.speed if ego.speed > 0.0 else math.copysign(math.inf, ahead)

    enters = crossed(first) if first else 0.0
    leaves = crossed(last + 1) if last + 1 < len(times) else math.inf
    begin, end = float((x - long)[inside].min()), float((x + long)[inside].max())
    ego_arrives, ego_clears = reached(begin - 0.5 * length), reached(end + 0.5 * length)
    actor_arrives, actor_clears = enters, leaves
    # Ways that join: the actor stays in the strip and drives along it, within 45 degrees. The area
    # is then the line x = begin, where the actor's rear is when it enters the strip.
    if math.isinf(leaves) and math.cos(heading[last]) > math.cos(0.25 * math.pi):
        actor_arrives = float(np.interp(begin, x + long, times, left=-math.inf))
        actor_clears = enters
        ego_clears = reached(begin + 0.5 * length)
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
    body = logical.ego_body or STANDARD_EGO
    return body.length, body.width


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

    The ego keeps its way. Where it touches no actor at its speed, it does not brake: max ITTC and
    impact speed are 0. Elsewhere it brakes ideally to a standstill: max ITTC is the largest inverse
    time to collision with any actor, inf where it hits one even so. Actors that react and come from
    behind do not count.
    """
    strength = settings.deceleration
    waits = np.array(delays)
    # long enough for the latest braking to a standstill
    standstills = [_begins(concrete, other) + concrete.ego.speed / strength for concrete in placed]
    until = np.minimum(standstills + waits + HORIZON, _LONGEST)
    motion = tracks(placed, [size] * len(placed), STEP, float(until.max()))
    others = motion.others
    looks = np.arange(others.shape[2])
    parts = np.arange(looks[-1] * _PARTS + 1) / _PARTS
    # A case ends at its own time: nothing may depend on the cases searched with it. From then on
    # its actors are out of reach, at x = inf.
    late = looks > np.ceil(until / STEP - 1e-9)[:, None]
    np.copyto(others[..., 0], np.inf, where=late[:, None])
    # First at a constant speed: touch and smallest distance, for which no look ahead is needed.
    unbraked = _braked(placed, parts, np.full(len(placed), np.inf), strength)
    result = _most_critical(placed, others, size, unbraked, 0)
    touches = np.flatnonzero(np.isinf(result[0]))
    result[:2] = 0.0
    if touches.size:
        some = [placed[i] for i in touches.tolist()]
        # an obstacle that makes no move in this time is an obstacle from the start
        first = motion.begins[:, other]
        begins = np.where(first > until, 0.0, first) + waits
        egos = _braked(some, parts, begins[touches], strength)
        ahead = round(HORIZON / STEP)
        result[:, touches] = _most_critical(some, others[touches], size, egos, ahead)
    return result


def _braked(
    placed: Sequence[ConcreteScenario], looks: Records, begins: FloatArray, strength: float
) -> FloatArray:
    """x, m, and speed, m/s, of egos that brake to a standstill, at T looks, (n, T, 2).

    looks: numbers of the looks, (T,); fractions stand for instants between two looks.
    begins: time at which each ego begins to brake, (n,), s; inf: never.
    strength: deceleration, m/s2.
    """
    # first position and speed, (n, 1) each
    x, v = np.array([[concrete.ego.x, concrete.ego.speed] for concrete in placed]).T[:, :, None]
    time = looks * STEP
    wait = begins[:, None]
    braked = np.clip(time - wait, 0.0, v / strength)  # time of braking so far, s
    speed = v - strength * braked
    # the first speed until the braking, the mean of first and present speed during it
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

    An actor that reacts and comes from behind does not count: no braking of the ego averts its
    acts, which SUMO alone knows.
    """
    ways = np.zeros(len(placed), _WAY)
    for i, concrete in enumerate(placed):
        way = concrete.ego.way
        change = 0.0, 0.0, 1.0  # without a lane change; `_ego` divides by the length
        if way is not None:
            change = way.offset, way.begin, way.length(concrete.ego.speed)
        ways[i] = concrete.ego.y, *change, *size, 0.0, 0.0
    each = np.zeros((others.shape[1], len(placed), 3))  # a result for each actor and case
    # the cases of a scenario have the same actors; only the actors' places differ
    for number, (actor, result) in enumerate(zip(placed[0].actors, each, strict=True)):
        ways["long"], ways["wide"] = actor.length, actor.width
        # x, y, heading, speed along the heading and across it, (n, T) each
        columns = np.moveaxis(others[:, number], 2, 0)
        heading, speed, across = columns[2:]
        c = np.cos(heading)
        s = np.sin(heading)
        # last the actor's velocity along the road and across it
        motion = np.dstack([*columns[:2], heading, speed * c - across * s, speed * s + across * c])
        _search_rows(ways, egos, motion, horizon, result)
        if actor.model is not None:
            behind = [it.actors[number].start.x < it.ego.x for it in placed]
            result[behind] = 0.0, 0.0, math.inf
    most: FloatArray = each.max(axis=0)
    most[:, 2] = each[..., 2].min(axis=0)
    return most.T


def _begins(concrete: ConcreteScenario, other: int) -> float:
    """Latest time at which actor `other` can begin its first move, s.

    A move with a `program` (a condition) begins before the ego is at the road's end.
    """
    latest = _time_on_road(concrete)
    acts = concrete.actors[other].acts
    return min([latest if act.program else act.begin for act in acts], default=0.0)


@kernel
def _ego(way: Any, x: float) -> Body:
    """The ego's body on its way at x."""
    share = min(max((x - way.begin) / way.length, 0.0), 1.0)
    heading = math.atan(way.offset * quintic_rate(share) / way.length)
    y = way.y + way.offset * quintic(share)
    return Body(x, y, heading, 0.0, way.ego_long, way.ego_wide, 0.0)


@kernel
def _other(way: Any, pose: Any) -> Body:
    """The other's body; pose: x, y and heading."""
    return Body(pose[0], pose[1], pose[2], 0.0, way.long, way.wide, 0.0)


@rows
def _search_rows(
    ways: Records, egos: FloatArray, others: FloatArray, horizon: int, result: FloatArray
) -> None:
    """Write the result of each row: largest inverse TTC, 1/s, inf where both touch, the speed at
    which they do, m/s, and the smallest distance, m.

    ways: `_WAY`, (n,).
    egos: x and speed at all ends of parts, (n, (T - 1) * _PARTS + 1, 2).
    others: at T looks: x, y, heading, then speed along and across the road, (n, T, 5).
    horizon: number of looks ahead in which a collision counts.
    result: (n, 3).
    """
    for i in range(len(ways)):
        way = ways[i]
        inverse, impact, nearest = 0.0, 0.0, math.inf
        count = np.isfinite(others[i, :, 0]).sum()
        for k in range(count):
            x, speed = egos[i, _PARTS * k, 0], egos[i, _PARTS * k, 1]
            ego, other = _ego(way, x), _other(way, others[i, k])
            if k == 0:
                ego_before, other_before = ego, other
            nearest = min(nearest, max(widest_gap(ego, other)[0], 0.0))
            touch, other_was = -1.0, other_before  # touch: share of the part, 0..1; -1: none
            for part in range(1, _PARTS + 1):
                ego_then = _ego(way, egos[i, max(_PARTS * (k - 1) + part, 0), 0])
                other_then = between(other_before, other, part / _PARTS)
                touch = max(touch, share_at_touch(ego_before, ego_then, other_was, other_then))
                ego_before, other_was = ego_then, other_then
            if touch >= 0.0:
                inverse = math.inf
                along, across = speed - others[i, k, 3], others[i, k, 4]
                impact = math.sqrt(along * along + across * across)
                break
            other_before = other
            if speed <= 0.0:
                continue
            for ahead in range(1, min(horizon + 1, count - k)):
                ego_then = _ego(way, x + speed * STEP * ahead)
                other_then = _other(way, others[i, k + ahead])
                share = share_at_touch(ego, ego_then, other, other_then)
                if share >= 0.0:
                    time = STEP * (ahead - 1 + share)
                    inverse = max(inverse, 1.0 / max(time, 1e-6))  # avoids a division by 0
                    break
                ego, other = ego_then, other_then
        result[i] = inverse, impact, nearest
