"""Encounters with an actor that moves in two dimensions, and conflicts of two paths.

An encounter decides the zone of a point: how critical is it if the ego brakes ideally on its path
(Eqs. 2 and 5-6, searched over time)? The ego begins to brake at the obstacle's first move plus the
scenario's delay, and brakes to a standstill. The obstacle follows its script; an actor that reacts
keeps its speed. The inverse TTC counts while the bodies overlap across the road and the obstacle is
ahead of the ego. It is infinite where the bodies touch. In a scenario with `conflict = true` the
inverse time until the bodies would touch counts instead. `method/point_criticality.py` compares the
largest inverse TTC with ITTC*.

A conflict is a measure of a case: two paths cross or join, as where one road leads into another. It
has an area, a time to this area, and a PET, all of them if neither vehicle reacts.

The ego's path is y as a function of x along the road. The time to collision on conflicting paths is
the time after which the bodies would touch if the ego kept its speed on its path and the actor
followed its script (Hayward 1972: on a collision course, whatever the angle). For the area, a
turned actor counts as its bounding rectangle along the road.

Users: `point_criticality` (encounters), `scoring/` (conflicts), `record/` (compiles loops). Fixed:
results to the last bit, because they decide zones.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.errors import SumoEvalError, must_be, users_code
from sumo_eval.kernels import Records, fields, kernel, rows
from sumo_eval.method.checks import not_negative
from sumo_eval.scenario import ConcreteScenario, LogicalScenario
from sumo_eval.scenario.first_places import STANDARD_EGO
from sumo_eval.scenario.motion import quintic, quintic_rate
from sumo_eval.scenario.touch import Body, between, share_at_touch, widest_gap
from sumo_eval.scenario.undisturbed import meetings, tracks
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import FloatArray, half_extents

# A look is an instant at which bodies are compared.
STEP = 0.1  # s between looks on conflicting paths; between two looks the actors move evenly
# Parts of a step. Within a part the ego counts as moving evenly, which is at most 0.25 mm wrong
# while it brakes at 5 m/s2.
_PARTS = 5
HORIZON = 6.0  # s ahead in which a collision counts; a collision in 6 s has an ITTC of 0.17 1/s
_LONGEST = 60.0  # s that are searched at most
_FINER = 0.02  # s between looks where paths do not conflict
_AT_ONCE = 500  # points searched together
_ACROSS = 0.5  # an actor crosses the road if the sine of its angle to the road is above this

_WAY = np.dtype(fields("y", "offset", "begin", "length", "ego_long", "ego_wide", "long", "wide"))
"""The ego's path, then bodies, m.

y: at first.
offset, begin, length: the path moves by `offset` to the left, from x = `begin` on, over `length`.
ego_long, ego_wide: length and width of the ego's body.
long, wide: length and width of the actor's body.
"""


class Conflict(NamedTuple):
    """Conflict of the ego's path with an actor's, if neither vehicle reacts.

    The ego's path is a strip as wide as the ego. All fields are nan if the actor never comes into
    the strip.

    begin, end: x of the conflict area, the stretch of the strip that the actor passes over, m.
    enters, leaves: times at which the actor's body comes into the strip and is out of it, s;
        `leaves` is inf if it stays in the strip, as where the paths join.
    time_to: time at which the ego's front reaches `begin` at constant speed, s.
    pet: post-encroachment time: from the moment at which the first vehicle leaves the area until
        the second one enters it, s; 0 if both are there at once. Where the paths join, the area is
        the line x = `begin` alone.
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
    settings: `[method.zones]`, of which it uses a, the deceleration.

    Max ITTC is inf where ideal braking hits, 0 where the ego never closes on the obstacle in its
    path. The gap is inf where the obstacle is never in the path. ITTC and gap are sampled every
    0.02 s, so the ITTC misses its peak by at most the motion of half a step. In a scenario with
    `conflict = true`, `conflict_criticality` computes all three.
    """
    parts = (points[begin : begin + _AT_ONCE] for begin in range(0, len(points), _AT_ONCE))
    return np.concatenate(
        [np.empty((3, 0)), *(_encounters(logical, part, settings) for part in parts)], axis=1
    )


def _encounters(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """Max ITTC, impact speed and smallest gap of points that are searched together, (3, n)."""
    search = logical.search
    assert search is not None
    size = ego_size(logical)
    owner = f"the zone of scenario `{logical.name}`"
    # `place` and `delay` may be the user's, and zones ask for points that no sample holds
    with users_code(f"Scenario `{logical.name}` failed", SumoEvalError):
        placed = [logical.placed(logical.point(row)) for row in points.tolist()]
        delays = [
            float(not_negative(owner, "delay", search.delay(it.values)))  # type: ignore[arg-type]
            for it in placed
        ]
    actors = min(len(it.actors) for it in placed)
    if not 0 <= search.obstacle < actors:  # a kernel would read beyond its arrays
        raise must_be("`obstacle`", owner, f"an actor, 0..{actors - 1}", search.obstacle)
    if search.conflict:
        return conflict_criticality(placed, search.obstacle, delays, size, settings)
    longest = min(logical.time_limit or _LONGEST, _LONGEST)
    # End of the search at each point, s: late enough for the latest braking, because the obstacle
    # makes its first move before the ego is at the road's end.
    until = [
        min(longest, delay + concrete.ego.speed / settings.deceleration + _time_on_road(concrete))
        for concrete, delay in zip(placed, delays, strict=True)
    ]
    return meetings(
        placed, [size] * len(placed), _FINER, until, settings.deceleration, search.obstacle, delays
    ).T


def _time_on_road(concrete: ConcreteScenario) -> float:
    """Time in which the ego reaches the end of the road at its first speed, at least 1 m/s, s."""
    ego = concrete.ego
    return (concrete.road.length - ego.x) / max(ego.speed, 1.0)


def crossing_conflict(
    concrete: ConcreteScenario, other: int, size: tuple[float, float]
) -> Conflict:
    """The conflict with an actor whose path crosses or joins the ego's, if neither reacts.

    concrete: the concrete scenario.
    other: index of the actor.
    size: length and width of the ego's body, m.
    """
    ego = concrete.ego
    length, width = size
    until = min(_time_on_road(concrete), _LONGEST)
    motion = tracks([concrete], [size], STEP, until).others[0, other]
    actor = concrete.actors[other]
    times = np.arange(len(motion), dtype=float) * STEP
    x, y, heading = motion[:, :3].T  # of the actor, (looks,) each
    long, wide = half_extents(heading, actor.length, actor.width)
    # distance of the body from the strip, m, negative inside
    apart = np.abs(y - ego.y_at(x)) - wide - 0.5 * width
    inside = np.flatnonzero(apart < 0.0)
    if not inside.size:
        return Conflict(*(math.nan,) * 6)  # every field is nan
    first, last = inside[[0, -1]]

    def crossed(after: int) -> float:
        """Time at which the actor's body passes the strip's edge, s, before look `after`."""
        share = apart[after - 1] / (apart[after - 1] - apart[after])
        return float(times[after - 1] + (times[after] - times[after - 1]) * share)

    def reached(position: float) -> float:
        """Time at which the ego's centre is at x = `position`, s. If the ego stands: inf, or -inf
        if it is beyond.
        """
        ahead = position - ego.x
        return ahead / ego.speed if ego.speed > 0.0 else math.copysign(math.inf, ahead)

    enters = crossed(first) if first else 0.0
    leaves = crossed(last + 1) if last + 1 < len(times) else math.inf
    begin, end = float((x - long)[inside].min()), float((x + long)[inside].max())
    ego_arrives, ego_clears = reached(begin - 0.5 * length), reached(end + 0.5 * length)
    actor_arrives, actor_clears = enters, leaves
    # Paths join if the actor stays in the strip and drives along it, within 45 degrees. The area is
    # then the line x = `begin`. The actor arrives there with its front, and clears it when its rear
    # is there, which is when it comes into the strip. The ego clears the line with its rear.
    if math.isinf(leaves) and math.cos(heading[last]) > math.cos(0.25 * math.pi):
        actor_arrives = float(np.interp(begin, x + long, times, left=-math.inf))
        actor_clears = enters
        ego_clears = reached(begin + 0.5 * length)
    pet = max(ego_arrives - actor_clears, actor_arrives - ego_clears, 0.0)
    return Conflict(begin, end, enters, leaves, ego_arrives, pet)


def conflicting(logical: LogicalScenario, concrete: ConcreteScenario) -> int | None:
    """Index of the actor whose path conflicts with the ego's; None without such an actor.

    It is the obstacle of the scenario's zones, if the scenario's file has `conflict = true` or the
    obstacle crosses the road.
    """
    search = logical.search
    if search is None:
        return None
    crosses = abs(math.sin(concrete.actors[search.obstacle].heading)) > _ACROSS
    return search.obstacle if search.conflict or crosses else None


def conflict_at(logical: LogicalScenario, values: Mapping[str, float]) -> Conflict | None:
    """The conflict of a concrete scenario, if neither vehicle reacts; None if no actor's path
    conflicts with the ego's.

    values: of the point, by name.
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
    """Eqs. 2 and 5-6 on conflicting paths: max ITTC, 1/s, impact speed, m/s, and smallest distance
    of the bodies, m, (3, n).

    placed: n concrete scenarios of one logical scenario.
    other: index of the actor whose first move makes the ego brake.
    delays: time from that move to the braking, (n,), s.
    size: length and width of the ego's body, m.
    settings: `[method.zones]`: a.

    The ego keeps its path. Where it touches no actor at constant speed, it does not brake: max ITTC
    and impact speed are 0. Elsewhere it brakes ideally to a standstill. Max ITTC is then the
    largest inverse time to collision with any actor, inf if the ego still hits one. Actors that
    react and come from behind do not count.
    """
    strength = settings.deceleration
    waits = np.array(delays)
    # end of the search, late enough for the latest braking to a standstill
    standstills = [_begins(concrete, other) + concrete.ego.speed / strength for concrete in placed]
    until = np.minimum(standstills + waits + HORIZON, _LONGEST)
    motion = tracks(placed, [size] * len(placed), STEP, float(until.max()))
    others = motion.others
    looks = np.arange(others.shape[2])
    parts = np.arange(looks[-1] * _PARTS + 1) / _PARTS  # ends of the parts, in looks
    # A case ends at its own time, because its result must not depend on the cases searched with it.
    # From then on its actors are out of reach, at x = inf. (others[..., 0] is x.)
    late = looks > np.ceil(until / STEP - 1e-9)[:, None]
    np.copyto(others[..., 0], np.inf, where=late[:, None])
    # First with an ego at constant speed: whether it touches, and the smallest distance. Neither
    # needs a look ahead (0).
    unbraked = _braked(placed, parts, np.full(len(placed), np.inf), strength)
    result = _most_critical(placed, others, size, unbraked, 0)
    touches = np.flatnonzero(np.isinf(result[0]))
    result[:2] = 0.0
    if touches.size:
        some = [placed[i] for i in touches.tolist()]
        # An obstacle without a move in this time is an obstacle from the start.
        first = motion.begins[:, other]
        begins = np.where(first > until, 0.0, first) + waits
        egos = _braked(some, parts, begins[touches], strength)
        ahead = round(HORIZON / STEP)
        result[:, touches] = _most_critical(some, others[touches], size, egos, ahead)
    return result


def _braked(
    placed: Sequence[ConcreteScenario], looks: Records, begins: FloatArray, strength: float
) -> FloatArray:
    """x, m, and speed, m/s, of egos that brake to a standstill, at T instants, (n, T, 2).

    looks: the instants, in looks (`STEP`), (T,); may be fractions.
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
    value over all actors.

    others: motion of m actors at T looks, (n, m, T, 5), as in `Tracks`.
    egos: x and speed at the ends of all parts, (n, (T - 1) * _PARTS + 1, 2), from `_braked`.
    horizon: number of looks ahead in which a collision counts.

    An actor that reacts and comes from behind does not count: SUMO decides its acts, and no braking
    of the ego averts them.
    """
    ways = np.zeros(len(placed), _WAY)
    for i, concrete in enumerate(placed):
        way = concrete.ego.way
        # offset, begin and length without a lane change; length 1, because `_ego` divides by it
        change = 0.0, 0.0, 1.0
        if way is not None:
            change = way.offset, way.begin, way.length(concrete.ego.speed)
        ways[i] = concrete.ego.y, *change, *size, 0.0, 0.0
    each = np.zeros((others.shape[1], len(placed), 3))  # by actor and case, as `_search_rows`
    # all cases have the same actors; only the actors' motion differs
    for number, (actor, result) in enumerate(zip(placed[0].actors, each, strict=True)):
        ways["long"], ways["wide"] = actor.length, actor.width
        # x, y, heading, speed along the heading, speed across it, (n, T) each
        columns = np.moveaxis(others[:, number], 2, 0)
        heading, speed, across = columns[2:]
        c = np.cos(heading)
        s = np.sin(heading)
        # x, y, heading, speed along the road, speed across it, (n, T, 5)
        motion = np.dstack([*columns[:2], heading, speed * c - across * s, speed * s + across * c])
        _search_rows(ways, egos, motion, horizon, result)
        if actor.model is not None:
            behind = [it.actors[number].start.x < it.ego.x for it in placed]
            result[behind] = 0.0, 0.0, math.inf
    most: FloatArray = each.max(axis=0)
    most[:, 2] = each[..., 2].min(axis=0)  # of distances the smallest is the most critical
    return most.T


def _begins(concrete: ConcreteScenario, other: int) -> float:
    """Latest time at which actor `other` can begin its first move, s.

    A move with a `program` waits for a condition: it begins before the ego is at the road's end.
    """
    latest = _time_on_road(concrete)
    acts = concrete.actors[other].acts
    return min([latest if act.program else act.begin for act in acts], default=0.0)


@kernel
def _ego(way: Any, x: float) -> Body:
    """The ego's body on its path at x, m; way: a row of `_WAY`."""
    share = min(max((x - way.begin) / way.length, 0.0), 1.0)
    heading = math.atan(way.offset * quintic_rate(share) / way.length)
    y = way.y + way.offset * quintic(share)
    return Body(x, y, heading, 0.0, way.ego_long, way.ego_wide, 0.0)


@kernel
def _other(way: Any, pose: Any) -> Body:
    """The actor's body; way: a row of `_WAY`; pose: x, y, m, and heading, rad."""
    return Body(pose[0], pose[1], pose[2], 0.0, way.long, way.wide, 0.0)


@rows
def _search_rows(
    ways: Records, egos: FloatArray, others: FloatArray, horizon: int, result: FloatArray
) -> None:
    """Write the result of the ego and one actor in each of n cases: max ITTC, 1/s, inf if both
    touch; their relative speed at the look after the touch, m/s; the smallest distance of the
    bodies, m.

    ways: `_WAY`, (n,).
    egos: x and speed at the ends of all parts, (n, (T - 1) * _PARTS + 1, 2).
    others: the actor at T looks: x, y, heading, then speed along and across the road, (n, T, 5).
    horizon: number of looks ahead in which a collision counts.
    result: (n, 3).
    """
    for i in range(len(ways)):
        way = ways[i]
        inverse, impact, nearest = 0.0, 0.0, math.inf
        count = np.isfinite(others[i, :, 0]).sum()  # looks until the case ends, see x = inf above
        for k in range(count):
            x, speed = egos[i, _PARTS * k, 0], egos[i, _PARTS * k, 1]
            ego, other = _ego(way, x), _other(way, others[i, k])
            if k == 0:
                ego_before, other_before = ego, other
            nearest = min(nearest, max(widest_gap(ego, other)[0], 0.0))
            # Do the bodies touch between the look before and this one? The ego moves part by part.
            touch, other_was = -1.0, other_before  # touch: share of the part, 0..1; -1: none
            for part in range(1, _PARTS + 1):
                # `max`: there is nothing before the first look
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
            # Looks ahead: when would the bodies touch if the ego kept its present speed?
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
