"""Check that all vehicles start on the road, on a lane, and clear of each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from sumo_eval.scenario import played
from sumo_eval.scenario.bodies import VULNERABLE
from sumo_eval.scenario.concrete import Actor, EgoBody, Road, Start

STANDARD_EGO = EgoBody(4.5, 1.8)
"""The ego's body where a scenario has none of its own."""
_TOUCH = 1e-6  # m: bodies that only touch are not inside each other
# m beside the road at which somebody may still be who comes from there, or stands there
_BESIDE = 300.0


class Misplaced(NamedTuple):
    """what: `Vehicle `NAME``, or its path.
    name: whose.
    must: where it must be.
    got: where it is, m.
    """

    what: str
    name: str
    must: str
    got: object


def misplaced(
    road: Road, ego: Start, ego_body: EgoBody, actors: Sequence[Actor]
) -> Iterator[Misplaced]:
    """Vehicles with an impossible start, and paths that leave the map."""
    end = road.length + road.run_out
    furthest = max([_BESIDE, *(crossing.reach for crossing in road.crossings)])
    bodies = [
        ("ego", ego, 0.0, 0.0),
        *((it.name, it.start, it.length, _reach(it, furthest)) for it in actors),
    ]
    for name, start, length, reach in bodies:
        if not (length / 2 <= start.x <= end - length / 2):
            must = (
                f"on the road, its centre at x = {length / 2:g} to {end - length / 2:g} m "
                f"(the ego's starts at {ego.x:g} m)"
            )
            yield Misplaced(f"Vehicle `{name}`", name, must, start.x)
        if not road.right_edge_at(start.x) - reach <= start.y <= road.left_edge_at(start.x) + reach:
            yield Misplaced(f"Vehicle `{name}`", name, "on a lane", start.y)
    for item in actors:
        reach = _reach(item, furthest)
        for act in item.acts:
            in_frame = act.kind == played.PATH and item.on_map is None
            for x, y in act.table if in_frame else ():
                if not (0.0 <= x <= end and road.right_edge - reach <= y <= road.left_edge + reach):
                    yield Misplaced(
                        f"The path of vehicle `{item.name}`",
                        item.name,
                        "on the map",
                        f"({x:g}, {y:g}) m",
                    )
    boxes = [("ego", *_box(ego, 0.0, ego_body.length, ego_body.width))]
    boxes += [
        (item.name, *_box(item.start, item.heading, item.length, item.width)) for item in actors
    ]
    for (one, x, y, long, wide), (two, x2, y2, long2, wide2) in itertools.combinations(boxes, 2):
        if long + long2 - abs(x - x2) > _TOUCH and wide + wide2 - abs(y - y2) > _TOUCH:
            got = f"x = {x2:g} m beside {x:g} m"
            yield Misplaced(f"Vehicle `{two}`", two, f"clear of `{one}` at the start", got)


def _reach(actor: Actor, furthest: float) -> float:
    """How far beside the lanes a vehicle may be, m: not at all where SUMO drives it, or its script
    knows time alone.
    """
    return (
        furthest
        if actor.body in VULNERABLE or (actor.lively and not actor.follows_at_once)
        else 0.0
    )


def _box(
    start: Start, heading: float, length: float, width: float
) -> tuple[float, float, float, float]:
    """Centre and half extents along and across the road."""
    c, s = abs(math.cos(heading)), abs(math.sin(heading))
    return start.x, start.y, 0.5 * (length * c + width * s), 0.5 * (length * s + width * c)
