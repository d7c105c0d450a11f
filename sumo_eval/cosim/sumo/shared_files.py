"""SUMO's network and route files of a batch of cases, or of one case in a batch of its own.

Every case is on a road of its own. All roads are in the same place, so that every position has the
digits that it has when its case is alone. Vehicles of different roads do not see each other.

The harness says what vehicles do, SUMO's own driver models decide nothing. So they are switched off
(`actionStepLength`), which takes two thirds off a step: a vehicle keeps the speed that it received.
They stay on for actors with a SUMO model, and for the ego of an ADS that asks SUMO.

A case that is alone has the names that the user knows. `ads_asks`: an ADS asks SUMO by names.

Users: `cosim/doors/traci_module.py`, `cosim/episode_rows.py`, `cosim/on_traci.py`,
`cosim/simulation.py`, `cosim/stage.py`, `cosim/traffic.py`.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace

from sumo_eval.cosim.sumo.sumo_files import EGO, departures, network_xml, vehicle_types
from sumo_eval.scenario.bodies import VULNERABLE
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.settings import SimulationSettings

_NEVER = 1e6  # s until SUMO's driver model decides something: beyond every time limit


def suffix(case: int, count: int, *, ads_asks: bool = True) -> str:
    """Ending of the names of case number `case` of `count`, such as `road`, its edge; "" of a case
    that is alone.
    """
    return "" if count == 1 else f"~{case}~" if ads_asks else str(case)


def name_in_sumo(name: str, suffix: str) -> str:
    """The name of a vehicle, type, edge or lane of a case; a lane's number stays at its end."""
    edge, line, lane = name.rpartition("_")
    if edge == "road" and lane.isdigit():
        return f"{edge}{suffix}{line}{lane}"
    return f"{name}{suffix}"


def vehicle_names(cases: Sequence[ConcreteScenario], *, ads_asks: bool) -> list[list[str]]:
    """The vehicles' names in SUMO: of each case the ego's, then those of its actors in order."""
    if ads_asks or len(cases) == 1:
        return [
            [
                name_in_sumo(name, suffix(case, len(cases)))
                for name in (EGO, *(actor.name for actor in it.actors))
            ]
            for case, it in enumerate(cases)
        ]
    return [
        [f"{case}.{number}" for number in range(1 + len(it.actors))]
        for case, it in enumerate(cases)
    ]


def fits_one_lane(concrete: ConcreteScenario) -> bool:
    """Whether a single lane, as wide as the road, can stand for its lanes in SUMO.

    Its centre line is the right-hand lane's. No vehicle changes lanes by itself, and to look for
    lane changes takes a third of SUMO's step. A curved road keeps its lanes, and so does a
    `lively` case.
    """
    return not (concrete.road.bent or concrete.lively)


def has_shadow(concrete: ConcreteScenario, vehicle: int) -> bool:
    """Whether a second body stands for a vehicle in the lane that it reaches into.

    vehicle: 0 the ego, then the actors.

    Only SUMO's drivers need it, and they look for it in neighbouring lanes.
    """
    if not concrete.reacts or concrete.road.lanes == 1:
        return False
    if vehicle == 0:
        return True
    actor = concrete.actors[vehicle - 1]
    return not actor.follows_at_once and actor.body not in VULNERABLE


def shadow_name(name: str) -> str:
    """The name in SUMO of a vehicle's shadow."""
    return f"{name}.shadow"


def shared_network_xml(cases: Sequence[ConcreteScenario], *, ads_asks: bool = False) -> str:
    """A road for each case in one network, all between the same two junctions.

    ads_asks: every road has all its lanes.
    """
    road = plain(cases[0].road)
    tail = ""
    edges, lanes = [], []
    for case, concrete in enumerate(cases):
        name = f"road{suffix(case, len(cases), ads_asks=ads_asks)}"
        head, edge, tail = _parts(road, not ads_asks and fits_one_lane(concrete))
        edges.append(edge.replace('"road', f'"{name}'))
        lanes += [f"{name}_{lane}" for lane in range(edge.count("<lane "))]
    # the list of lanes at the end junction, written for one road, has to name those of all
    start, _, end = tail.partition('incLanes="road')
    return "".join([head, *edges, start, 'incLanes="', " ".join(lanes), end[end.index('"') :]])


def plain(road: Road) -> Road:
    """The road with all its lanes throughout: here SUMO leads no vehicle along lanes that end."""
    return replace(road, spans=(), crossings=()) if road.shaped else road


@functools.lru_cache(maxsize=64)
def _parts(road: Road, one_lane: bool) -> tuple[str, str, str]:
    """The text before the edge of a road, the edge, and the junctions."""
    wide = replace(road, lanes=1, lane_width=2.0 * max(road.left_edge, -road.right_edge))
    head, opening, rest = network_xml(wide if one_lane else road).partition("  <edge ")
    edge, closing, junctions = rest.partition("  <junction ")
    return head, opening + edge, closing + junctions


def shared_routes_xml(
    cases: Sequence[ConcreteScenario],
    settings: SimulationSettings,
    *,
    own_lanes: bool = False,
    ads_asks: bool = False,
) -> str:
    """Vehicle types, routes and departures of all cases.

    own_lanes: the roads have all their lanes, as with `ads_asks`.
    ads_asks: SUMO's driver model of the ego is on, and every vehicle has a type of its own.
    """
    # names of types by their attributes: vehicles that differ in nothing share a type
    types: dict[tuple[tuple[str, str], ...], str] = {}
    others = []
    names = vehicle_names(cases, ads_asks=ads_asks)
    count = len(cases)
    own_lanes = own_lanes or ads_asks
    for case, concrete in enumerate(cases):
        ending = suffix(case, count, ads_asks=ads_asks)
        route = f"along{ending}" if ads_asks else f"along{case}"
        others.append(_element("route", {"id": route, "edges": f"road{ending}"}))
        vehicle = concrete.simulation(settings).vehicle
        starts = departures(
            replace(concrete, road=plain(concrete.road)), vehicle.length,
            one_lane=not own_lanes and fits_one_lane(concrete), on_map=ads_asks,
        )  # fmt: skip
        described = zip(vehicle_types(concrete, vehicle), starts, strict=True)
        for index, (kind, departure) in enumerate(described):
            name = names[case][index]
            type_name = kind.pop("id")
            # SUMO's driver model is on: the ego (index 0) if its ADS asks SUMO, actors with a model
            is_on = concrete.actors[index - 1].model is not None if index else ads_asks
            if not is_on:
                kind["actionStepLength"] = str(_NEVER)
            if ads_asks:
                kind["id"] = type_name = name
            elif count > 1:
                type_name = f"type{len(types)}"
            own = {"type": types.setdefault((*kind.items(),), type_name), "route": route}
            ids = [name]
            if not ads_asks and has_shadow(concrete, index):
                ids.append(shadow_name(name))
            others += [_element("vehicle", {**departure, "id": it, **own}) for it in ids]
    kinds = [_element("vType", {"id": name, **dict(kind)}) for kind, name in types.items()]
    return "\n".join(
        ['<?xml version="1.0" encoding="UTF-8"?>', "<routes>", *kinds, *others, "</routes>", ""]
    )


def _element(tag: str, attributes: Mapping[str, str]) -> str:
    """One element; its values are numbers and the batch's own names, in which nothing needs
    escaping.
    """
    written = " ".join([f'{name}="{value}"' for name, value in attributes.items()])
    return f"<{tag} {written}/>"
