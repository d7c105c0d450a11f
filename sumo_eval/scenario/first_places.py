"""The check that all vehicles start on the road, on a lane or (pedestrians and the like) near the
lanes, and clear of each other, and that their paths stay on the map.

Users: readers of scenario files (`scenario/`, `extras/openscenario/`) call `misplaced` at every
point of a sample; they and `method/conflict.py` take `STANDARD_EGO`.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from sumo_eval.scenario import played
from sumo_eval.scenario.bodies import VULNERABLE, half_sizes
from sumo_eval.scenario.concrete import Actor, EgoBody, Road, Start

STANDARD_EGO = EgoBody(4.5, 1.8)
"""The ego's body where a scenario has none of its own."""
_TOUCH = 1e-6  # m: bodies that overlap by less only touch, which is allowed
# m: how far from the lanes those actors may be that may be beside them (`_reach`); if a crossing
# road reaches further, as far as that road
_BESIDE = 300.0


class Misplaced(NamedTuple):
    """A vehicle with an impossible start or path, as parts of an error message.

    what: the vehicle or its path, as "Vehicle `lead`".
    name: of the vehicle.
    must: where it must be, as "on a lane".
    got: where it is: x or y, m, or a text.
    """

    what: str
    name: str
    must: str
    got: object


def misplaced(
    road: Road, ego: Start, ego_body: EgoBody, actors: Sequence[Actor]
) -> Iterator[Misplaced]:
    """Vehicles with an impossible start, and paths that leave the map."""
    furthest = max([_BESIDE, *(crossing.reach for crossing in road.crossings)])
    yield from _off_the_road(road, ego, ego_body, actors, furthest)
    yield from _in_junctions(road, ego, ego_body, actors)
    yield from _off_the_map(road, actors, furthest)
    yield from _overlapping(ego, ego_body, actors)


def _off_the_road(
    road: Road, ego: Start, ego_body: EgoBody, actors: Sequence[Actor], furthest: float
) -> Iterator[Misplaced]:
    """Vehicles that start before or behind the road, or too far from its lanes.

    furthest: as in `_reach`.
    """
    for name, start, length, reach in (
        ("ego", ego, ego_body.length, 0.0),
        *((it.name, it.start, it.length, _reach(it, furthest)) for it in actors),
    ):
        # The ego's rear may be before the road's beginning. No front may be beyond the road's end:
        # SUMO would move it back.
        first = 0.0 if name == "ego" else length / 2
        last = road.end - length / 2
        if not first <= start.x <= last:
            must = (
                f"on the road, its centre at x = {first:g} to {last:g} m "
                f"(the ego's starts at {ego.x:g} m)"
            )
            yield Misplaced(f"Vehicle `{name}`", name, must, start.x)
        if not road.right_edge_at(start.x) - reach <= start.y <= road.left_edge_at(start.x) + reach:
            yield Misplaced(f"Vehicle `{name}`", name, "on a lane", start.y)


def _in_junctions(
    road: Road, ego: Start, ego_body: EgoBody, actors: Sequence[Actor]
) -> Iterator[Misplaced]:
    """Vehicles whose front bumper is in a junction of the user's network."""
    fronts = [("ego", ego.x + ego_body.length / 2)]
    fronts += [(it.name, it.start.x + it.length / 2) for it in actors if it.on_map is None]
    sections = () if road.network is None else road.network.sections
    # a junction begins where an edge ends, and ends where the next edge begins
    for (_, begin, _), (end, _, _) in itertools.pairwise(sections):
        for name, front in fronts:
            if begin < front < end:
                must = (
                    f"on an edge, its front before x = {begin:g} m or from {end:g} m on: between "
                    "them is a junction, where SUMO inserts no vehicle"
                )
                yield Misplaced(f"Vehicle `{name}`", name, must, front)


def _off_the_map(road: Road, actors: Sequence[Actor], furthest: float) -> Iterator[Misplaced]:
    """Points of paths that are off the map.

    furthest: as in `_reach`.
    """
    for actor in actors:
        if actor.on_map is not None:  # its path is not in road coordinates
            continue
        reach = _reach(actor, furthest)
        low, high = road.right_edge - reach, road.left_edge + reach
        for x, y in itertools.chain(*(it.table for it in actor.acts if it.kind == played.PATH)):
            if not (0.0 <= x <= road.end and low <= y <= high):
                what, position = f"The path of vehicle `{actor.name}`", f"({x:g}, {y:g}) m"
                yield Misplaced(what, actor.name, "on the map", position)


def _overlapping(ego: Start, ego_body: EgoBody, actors: Sequence[Actor]) -> Iterator[Misplaced]:
    """Vehicles whose bodies overlap another's at the start."""
    # (name, start, half length, half width), m along and across the road
    boxes = [("ego", ego, *half_sizes(0.0, ego_body.length, ego_body.width))]
    boxes += [(it.name, it.start, *half_sizes(it.heading, it.length, it.width)) for it in actors]
    for (one, a, long_a, wide_a), (two, b, long_b, wide_b) in itertools.combinations(boxes, 2):
        if long_a + long_b - abs(a.x - b.x) > _TOUCH and wide_a + wide_b - abs(a.y - b.y) > _TOUCH:
            got = f"x = {b.x:g} m beside {a.x:g} m"
            yield Misplaced(f"Vehicle `{two}`", two, f"clear of `{one}` at the start", got)


def _reach(actor: Actor, furthest: float) -> float:
    """Largest allowed distance of an actor from the lanes, m.

    It is `furthest` for a vulnerable road user and a `lively` vehicle, else 0. It is 0 also for an
    actor that SUMO drives, or will drive, and that nothing moves across the road until then: SUMO
    drives on lanes only.
    """
    keeps_lane = all(act.kind in (played.SPEED, played.KEEP, played.FOLLOW) for act in actor.acts)
    if actor.model is not None and actor.heading == 0.0 and keeps_lane:
        return 0.0
    return furthest if actor.body in VULNERABLE or actor.lively else 0.0
