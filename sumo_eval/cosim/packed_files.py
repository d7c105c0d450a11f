"""SUMO files of a pack: every case on a road of its own, all roads in the same place, so that no digit of a position
differs from the one that the case would have alone. Vehicles of different roads do not see each other.

SUMO's own driver models decide nothing in a case: the harness says what every vehicle does. Here they are not even
asked (`actionStepLength`), which takes two thirds off a step; a vehicle keeps the speed that it was told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sumo_eval.cosim.sumo_files import departures, network_xml, vehicle_types
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.settings import VehicleSettings

_NEVER = 1e6  # s until SUMO's driver models would decide something; beyond every time limit


def edge_name(case: int) -> str:
    """The road of case number `case` of a pack."""
    return f"road{case}"


def vehicle_name(case: int, vehicle: int) -> str:
    """A vehicle of case number `case` of a pack: 0 is the ego, 1.. are the actors in their order."""
    return f"{case}.{vehicle}"


def packed_network_xml(road: Road, count: int) -> str:
    """`count` copies of a road in one network."""
    head, _, rest = network_xml(road).partition("  <edge ")
    body, _, tail = rest.rpartition("</net>")
    edge, _, junctions = ("  <edge " + body).partition("  <junction ")
    junctions = "  <junction " + junctions
    edges = [
        edge.replace('"road', f'"{edge_name(case)}')
        .replace('"begin"', f'"begin{case}"')
        .replace('"end"', f'"end{case}"')
        for case in range(count)
    ]
    ends = [
        junctions.replace('id="begin"', f'id="begin{case}"')
        .replace('id="end"', f'id="end{case}"')
        .replace("road_", f"{edge_name(case)}_")
        for case in range(count)
    ]
    return "".join([head, *edges, *ends, "</net>", tail])


def packed_routes_xml(cases: Sequence[ConcreteScenario], vehicle: VehicleSettings) -> str:
    """Vehicle types, routes and departures of all cases; `vehicle` has the body that their scenario prescribes."""
    types: dict[tuple[str, ...], str] = {}  # vehicles that differ in nothing share a type
    others: list[str] = []
    for case, concrete in enumerate(cases):
        others.append(_element("route", {"id": f"along{case}", "edges": edge_name(case)}))
        described = zip(vehicle_types(concrete, vehicle), departures(concrete, vehicle.length), strict=True)
        for index, (kind, attributes) in enumerate(described):
            del kind["id"]
            kind["actionStepLength"] = str(_NEVER)
            known = types.setdefault((*kind, *kind.values()), f"type{len(types)}")
            own = {"id": vehicle_name(case, index), "type": known, "route": f"along{case}"}
            others.append(_element("vehicle", {**attributes, **own}))
    kinds = [
        _element("vType", {"id": name, **dict(zip(text[: len(text) // 2], text[len(text) // 2 :], strict=True))})
        for text, name in types.items()
    ]
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', "<routes>", *kinds, *others, "</routes>", ""])


def _element(tag: str, attributes: Mapping[str, str]) -> str:
    """One element; its values are numbers and the pack's own names, in which nothing needs escaping."""
    written = " ".join([f'{name}="{value}"' for name, value in attributes.items()])
    return f"<{tag} {written}/>"
