"""Check that all vehicles start on the road, on a lane, and clear of each other, and that their
paths stay on the map.

Users: readers of scenario files (`scenario/`, `extras/openscenario/`) call it at every point of a
sample; `method/conflict.py` takes the standard ego.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from sumo_eval.scenario import played
from sumo_eval.scenario.bodies import VULNERABLE, half_sizes
from sumo_eval.scenario.concrete import Actor, EgoBody, Road, Start

STANDARD_EGO = EgoBody(4.5, 1.8)
"""The ego's body where a scenario has none of its own."""
_TOUCH = 1e-6  # m: bodies that overlap by less only touch
_BESIDE = 300.0  # m: largest distance from the road of an actor that may be beside it (`_reach`)


class Misplaced(NamedTuple):
    """A vehicle with an impossible start or path, as parts of an error message.

    what: the vehicle or its path: "Vehicle `lead`".
    name: of the vehicle.
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
    end = road.end
    furthest = max([_BESIDE, *(crossing.reach for crossing in road.crossings)])
    # half: its length / 2, m; 0 of the ego, an end of which may be off the road
    # reach: largest distance from the lanes, m
    for name, start, half, reach in (
        ("ego", ego, 0.0, 0.0),
        *((it.name, it.start, it.length / 2, _reach(it, furthest)) for it in actors),
    ):
        if not half <= start.x <= end - half:
            must = (
                f"on the road, its centre at x = {half:g} to {end - half:g} m "
                f"(the ego's starts at {ego.x:g} m)"
            )
            yield Misplaced(f"Vehicle `{name}`", name, must, start.x)
        if not road.right_edge_at(start.x) - reach <= start.y <= road.left_edge_at(start.x) + reach:
            yield Misplaced(f"Vehicle `{name}`", name, "on a lane", start.y)
    yield from _in_junctions(road, ego, ego_body, actors)
    for item in actors:
        reach = _reach(item, furthest)
        # the path of an actor with `on_map` is straight on the map, not in road coordinates
        paths = [act.table for act in item.acts if act.kind == played.PATH]
        for x, y in itertools.chain(*(paths if item.on_map is None else ())):
            if not (0.0 <= x <= end and road.right_edge - reach <= y <= road.left_edge + reach):
                what, position = f"The path of vehicle `{item.name}`", f"({x:g}, {y:g}) m"
                yield Misplaced(what, item.name, "on the map", position)
    # (name, start, half length, half width), m along and across the road
    boxes = [("ego", ego, *half_sizes(0.0, ego_body.length, ego_body.width))]
    boxes += [(it.name, it.start, *half_sizes(it.heading, it.length, it.width)) for it in actors]
    for (one, a, long_a, wide_a), (two, b, long_b, wide_b) in itertools.combinations(boxes, 2):
        if long_a + long_b - abs(a.x - b.x) > _TOUCH and wide_a + wide_b - abs(a.y - b.y) > _TOUCH:
            got = f"x = {b.x:g} m beside {a.x:g} m"
            yield Misplaced(f"Vehicle `{two}`", two, f"clear of `{one}` at the start", got)


def _in_junctions(
    road: Road, ego: Start, ego_body: EgoBody, actors: Sequence[Actor]
) -> Iterator[Misplaced]:
    """Vehicles whose front bumper is in a junction of the user's network."""
    fronts = [("ego", ego.x + ego_body.length / 2)]
    fronts += [(it.name, it.start.x + it.length / 2) for it in actors if it.on_map is None]
    sections = () if road.network is None else road.network.sections
    for (_, begin, _), (end, _, _) in itertools.pairwise(sections):
        for name, front in fronts:
            if begin < front < end:
                must = (
                    f"on an edge, its front before x = {begin:g} m or from {end:g} m on: between "
                    "them is a junction, where SUMO inserts no vehicle"
                )
                yield Misplaced(f"Vehicle `{name}`", name, must, front)


def _reach(actor: Actor, furthest: float) -> float:
    """Largest allowed distance of an actor from the lanes at its start, m.

    `furthest` for a vulnerable road user and a `lively` vehicle; 0 for any other, and for one that
    SUMO drives and that no act brings to a lane.
    """
    keeps_lane = all(act.kind in (played.SPEED, played.KEEP, played.FOLLOW) for act in actor.acts)
    if actor.model is not None and actor.heading == 0.0 and keeps_lane:
        return 0.0
    return furthest if actor.body in VULNERABLE or actor.lively else 0.0
