"""SUMO's network and route files of a batch of cases, or of one case in a batch of its own.

Every case is on a road of its own. All roads are in the same place, so that every position has the
digits that it has when its case is alone. Vehicles of different roads do not see each other.

The harness moves the vehicles, so SUMO's own driver models are switched off (`actionStepLength`),
which takes two thirds off a step: a vehicle keeps the speed that it received. The models stay on
for actors with a SUMO model, and for the ego of an ADS that asks SUMO.

`ads_asks`: an ADS may ask SUMO for vehicles, lanes and edges by their names. In a batch these names
then end with the case's suffix; a case alone has the names that the user knows.

Users: `cosim/doors/traci_module.py`, `cosim/episode_rows.py`, `cosim/on_traci.py`,
`cosim/simulation.py`, `cosim/stage.py`, `cosim/traffic.py`.
"""

import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from sumo_eval.cosim.sumo.sections import vehicle_routes
from sumo_eval.cosim.sumo.sumo_files import EGO, departures, network_xml, vehicle_types
from sumo_eval.scenario.bodies import VULNERABLE
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.settings import SimulationSettings

_NEVER = 1e6  # s until SUMO's driver model decides something: beyond every time limit
_LANE = re.compile(r"((?:road|ramp)\d*)(_\d+)")  # name of a lane: its edge, its number
# names of edges, lanes and junctions in a network file, up to where a case's suffix belongs
_NAMES = re.compile(r'(?<=[" ])(?:road|ramp|node)\d+|(?<=")(?:begin|end)(?=")')
_SUFFIX = "\0"  # stands for the suffix of a case


def suffix(case: int, count: int, *, ads_asks: bool = True) -> str:
    """Ending of the names in SUMO of a case: with `ads_asks` of its vehicles, their types, its
    edge (`road`) and route, else of the edge alone (`vehicle_names` names the vehicles).

    case: number of the case. count: of the cases; 1: the case is alone, and the ending is "".
    """
    return "" if count == 1 else f"~{case}~" if ads_asks else str(case)


def name_in_sumo(name: str, suffix: str) -> str:
    """The name in SUMO of a vehicle, type, edge or lane of a case; a lane keeps its number at the
    end: `road~7~_0`, `ramp2~7~_0`.
    """
    lane = _LANE.fullmatch(name)
    return f"{lane[1]}{suffix}{lane[2]}" if lane else f"{name}{suffix}"


def vehicle_names(cases: Sequence[ConcreteScenario], *, ads_asks: bool) -> list[list[str]]:
    """The vehicles' names in SUMO: of each case the ego's, then those of its actors in order.

    ads_asks: False: a batch has short names, `7.0` being the ego of case 7.
    """
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
    """Whether a single lane can stand for all lanes of the road in SUMO.

    SUMO looks for lane changes where there are several lanes, which takes a third of its step, and
    no vehicle changes lanes by itself. A curved road keeps its lanes, and so does a case whose
    actors SUMO does not move (`ConcreteScenario.lively`).
    """
    return not (concrete.road.bent or concrete.lively)


def has_shadow(concrete: ConcreteScenario, vehicle: int) -> bool:
    """Whether a vehicle has a shadow: a second body in the lane that it reaches into.

    SUMO has a vehicle in one lane alone. The shadow shows it to SUMO's driver models in another
    lane (`cosim/traffic.py`), so it exists only where they drive and there are several lanes.

    vehicle: 0 the ego, then the actors.
    """
    if not concrete.reacts or concrete.road.lanes == 1:
        return False
    if vehicle == 0:
        return True
    actor = concrete.actors[vehicle - 1]
    # SUMO keeps what it drives within a lane, and has pedestrians and cyclists on no lane
    return not actor.follows_at_once and actor.body not in VULNERABLE


def shadow_name(name: str) -> str:
    """The name in SUMO of a vehicle's shadow."""
    return f"{name}.shadow"


def shared_network_xml(
    cases: Sequence[ConcreteScenario], *, own_lanes: bool = False, ads_asks: bool = False
) -> str:
    """A network with a road for each case, all between the same two junctions, unless the road has
    several sections: then each case has all of them, and junctions of its own.

    own_lanes: every road has all its lanes, throughout.
    ads_asks: every road has all its lanes and sections.
    """
    road = cases[0].road  # the cases of a batch have equal roads
    if ads_asks and road.spans:
        head, sections, tail = _marked(road)
        endings = (suffix(case, len(cases)) for case in range(len(cases)))
        return "".join([head, *(sections.replace(_SUFFIX, it) for it in endings), tail])
    road = plain(road)
    edges, lanes = [], []
    for case, concrete in enumerate(cases):
        name = f"road{suffix(case, len(cases), ads_asks=ads_asks)}"
        one_lane = not (own_lanes or ads_asks) and fits_one_lane(concrete)
        head, edge, tail = _parts(road, one_lane)
        edges.append(edge.replace('"road', f'"{name}'))
        lanes += [f"{name}_{lane}" for lane in range(edge.count("<lane "))]
    # the end junction lists the lanes of one road: list the lanes of all roads instead
    start, _, end = tail.partition('incLanes="road')
    return "".join([head, *edges, start, 'incLanes="', " ".join(lanes), end[end.index('"') :]])


def plain(road: Road) -> Road:
    """The road with all its lanes throughout, without crossings: SUMO need not know where lanes
    end, as the harness moves the vehicles.
    """
    return replace(road, spans=(), crossings=()) if road.shaped else road


@functools.lru_cache(maxsize=64)
def _marked(road: Road) -> tuple[str, str, str]:
    """The text of a road's network in three parts: before its first edge, its edges, junctions and
    connections, the end. In the second part `_SUFFIX` stands in each name.
    """
    head, opening, rest = network_xml(road).partition("  <edge ")
    sections, closing, end = rest.rpartition("</net>")
    return head, _NAMES.sub(rf"\g<0>{_SUFFIX}", opening + sections), closing + end


@functools.lru_cache(maxsize=64)
def _parts(road: Road, one_lane: bool) -> tuple[str, str, str]:
    """The text of a road's network in three parts: before its edge, its edge, its junctions.

    one_lane: a single lane stands for all lanes (`fits_one_lane`).
    """
    # Centred on the right-hand lane, as places are measured from there: so wide that it reaches the
    # further edge, and beyond the nearer one.
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

    own_lanes: as of the network: vehicles depart in their own lanes.
    ads_asks: as of the network; also SUMO's driver model of the ego is on, and every vehicle has a
        type of its own.
    """
    # names of types by their attributes: vehicles that differ in nothing share a type
    types: dict[tuple[tuple[str, str], ...], str] = {}
    others = []
    names = vehicle_names(cases, ads_asks=ads_asks)
    count = len(cases)
    own_lanes = own_lanes or ads_asks
    for case, concrete in enumerate(cases):
        ending = suffix(case, count, ads_asks=ads_asks)
        vehicle = concrete.simulation(settings).vehicle
        shown = concrete if ads_asks else replace(concrete, road=plain(concrete.road))
        one_lane = not own_lanes and fits_one_lane(concrete)
        starts = departures(shown, vehicle.length, one_lane=one_lane, exact=ads_asks)
        for route, edges in vehicle_routes(shown, starts).items():
            in_sumo = " ".join(f"{edge}{ending}" for edge in edges)
            others.append(_element("route", {"id": f"{route}{ending}", "edges": in_sumo}))
        described = zip(vehicle_types(concrete, vehicle), starts, strict=True)
        for index, (kind, departure) in enumerate(described):
            name = names[case][index]
            type_name = kind.pop("id")
            # index 0 is the ego
            model_is_on = concrete.actors[index - 1].model is not None if index else ads_asks
            if not model_is_on:
                kind["actionStepLength"] = str(_NEVER)
            if ads_asks:
                kind["id"] = type_name = name
            elif count > 1:
                type_name = f"type{len(types)}"
            departure |= {
                "type": types.setdefault((*kind.items(),), type_name),
                "route": f"{departure['route']}{ending}",
            }
            ids = [name]
            if not ads_asks and has_shadow(concrete, index):
                ids.append(shadow_name(name))
            others += [_element("vehicle", departure | {"id": it}) for it in ids]
    kinds = [_element("vType", {"id": name, **dict(kind)}) for kind, name in types.items()]
    return "\n".join(
        ['<?xml version="1.0" encoding="UTF-8"?>', "<routes>", *kinds, *others, "</routes>", ""]
    )


def _element(tag: str, attributes: Mapping[str, str]) -> str:
    """An element as text. Its values are numbers and names of the batch, which need no escaping."""
    written = " ".join([f'{name}="{value}"' for name, value in attributes.items()])
    return f"<{tag} {written}/>"
