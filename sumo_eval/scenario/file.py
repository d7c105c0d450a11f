"""A scenario file in TOML: read into a `LogicalScenario`, and checked with vehicles at every point of its sample."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario import played
from sumo_eval.scenario.bodies import VULNERABLE
from sumo_eval.scenario.builder import built
from sumo_eval.scenario.concrete import (
    Actor,
    EgoBody,
    Start,
)
from sumo_eval.scenario.logical import (
    LogicalScenario,
)
from sumo_eval.scenario.reachable import never_begin
from sumo_eval.scenario.tables import ScenarioFile
from sumo_eval.settings.config import mistakes
from sumo_eval.settings.toml_file import read_toml
from sumo_eval.trajectory import FloatArray

_ADAPTER = TypeAdapter(ScenarioFile)


def read_scenario(path: Path, given: Mapping[str, str] | None = None) -> LogicalScenario:
    """The logical scenario in a TOML file. given: options by name, as written.

    Raises InputError naming what is wrong.
    """
    return scenario_from(read_toml(path, "scenario file"), f"scenario file {path}", path.parent, given)


def scenario_from(
    content: Mapping[str, Any], where: str, folder: Path, given: Mapping[str, str] | None = None
) -> LogicalScenario:
    """The logical scenario in a plain mapping. `where` names it in errors; `folder`: where its paths start.

    given: as in `read_scenario`.
    """
    try:
        table = _ADAPTER.validate_json(json.dumps(content, default=str), strict=True)
    except ValidationError as error:
        raise InputError(mistakes(error, where, ScenarioFile)) from None
    table, options = _with_options(table, given or {})
    return built(table, options, where, folder)


def _with_options(table: ScenarioFile, given: Mapping[str, str]) -> tuple[ScenarioFile, dict[str, float]]:
    """The file as it is with the options that are given, and the value of every option by name."""
    owner = f"scenario `{table.name}`"
    values = {item.name: math.inf if item.default is None else item.default for item in table.option}
    for key in given:
        if key not in values:
            raise unknown(f"option of {owner}", key, values)
    for item in table.option:
        if item.name not in given:
            continue
        unit = "" if item.unit == "1" else f" {item.unit}"
        wanted = "finite" if item.above is None else f"finite and above {item.above:g}{unit}"
        try:
            value = float(given[item.name])
        except ValueError:
            raise must_be(
                f"`{item.name}`", owner, f"a number of {item.unit}" if unit else "a number", given[item.name]
            ) from None
        if not (math.isfinite(value) and (item.above is None or value > item.above)):
            raise must_be(f"`{item.name}`", owner, wanted, value)
        values[item.name] = value
        then = item.given
        table = replace(
            table,
            name=f"{table.name}_{item.name if then.suffix is None else then.suffix.replace('{value}', _worded(value))}",
            about=table.about if then.about is None else then.about,
            road=table.road if then.road is None else then.road,
            vehicle=(*table.vehicle, *then.vehicle),
        )
    return table, values


def _worded(value: float) -> str:
    """A number as a part of a name."""
    return f"{value:g}".replace("-", "minus_").replace(".", "_").replace("+", "")


def check_file(path: Path, given: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Read a scenario file, place vehicles at every point of its own sample, and say in sentences what it holds.

    given: options by name, as written. Raises InputError with what is wrong, at the first point where something is.
    """
    from sumo_eval.scenario.sampling.samples import sample

    logical = read_scenario(Path(path), given)
    chosen = sample(logical)
    if not len(chosen.points):
        raise InputError(f"Scenario `{logical.name}` must have possible points, got none of {len(chosen.refused)}.")
    check_points(logical, chosen.points)
    ranges = ", ".join(f"{item.name} {item.low:g}..{item.high:g}{item.behind}" for item in logical.parameters)
    return (
        f"Logical scenario `{logical.name}`: {ranges}.",
        f"Its own sample has {len(chosen.points)} possible points; constraints refuse {len(chosen.refused)} more.",
        f"Exposure: {logical.exposure_about}.",
        *chosen.notes,
    )


def check_points(logical: LogicalScenario, points: FloatArray) -> None:
    """Place every vehicle at every point (n, k), and work out the approach there. InputError at the first fault."""
    for row in points.tolist():
        concrete = logical.concrete(**dict(zip(logical.names, row, strict=True)))
        _check_place(logical, concrete.ego, concrete.actors, concrete.label)
        limit = math.inf if logical.time_limit is None else logical.time_limit
        for actor, index in never_begin(concrete, limit):
            name = actor.acts[index].name or f"number {index + 1}"
            raise InputError(
                f"The condition of manoeuvre {name} of vehicle `{actor.name}` of scenario `{logical.name}` at "
                f"{concrete.label} can never hold, whoever drives: the manoeuvre would never begin."
            )
    if logical.approach is not None:
        logical.approach(logical.columns(points))
    if logical.margin is not None:
        logical.margin(logical.columns(points))


_TOUCH = 1e-6  # m: bodies that only touch are not inside each other
_BESIDE = 300.0  # m beside the road at which somebody may still be who comes from there, or stands there


def _reach(actor: Actor, furthest: float) -> float:
    """How far beside the lanes a vehicle may be, m: not at all where SUMO drives it, or its script knows time alone."""
    return furthest if actor.body in VULNERABLE or (actor.lively and not actor.follows_at_once) else 0.0


def _check_place(logical: LogicalScenario, ego: Start, actors: Sequence[Actor], label: str) -> None:
    road, owner = logical.road, f"scenario `{logical.name}` at {label}"
    end = road.length + road.run_out
    ego_body = logical.ego_body or EgoBody(4.5, 1.8)
    bodies = [("ego", ego, 0.0, 0.0), *((item.name, item.start, item.length, item.heading) for item in actors)]
    furthest = max([_BESIDE, *(crossing.reach for crossing in road.crossings)])
    beside = [0.0, *(_reach(item, furthest) for item in actors)]
    for (name, start, length, _), reach in zip(bodies, beside, strict=True):
        if not (length / 2 <= start.x <= end - length / 2):
            raise must_be(f"Vehicle `{name}`", owner, "on the road", start.x)
        if not road.right_edge_at(start.x) - reach <= start.y <= road.left_edge_at(start.x) + reach:
            raise must_be(f"Vehicle `{name}`", owner, "on a lane", start.y)
    for item in actors:
        reach = _reach(item, furthest)
        for act in item.acts:
            for x, y in act.table if act.kind == played.PATH else ():
                if not (0.0 <= x <= end and road.right_edge - reach <= y <= road.left_edge + reach):
                    raise must_be(f"The path of vehicle `{item.name}`", owner, "on the map", f"({x:g}, {y:g}) m")
    boxes = [("ego", *_box(ego, 0.0, ego_body.length, ego_body.width))]
    boxes += [(item.name, *_box(item.start, item.heading, item.length, item.width)) for item in actors]
    for (one, x, y, long, wide), (two, x2, y2, long2, wide2) in itertools.combinations(boxes, 2):
        if long + long2 - abs(x - x2) > _TOUCH and wide + wide2 - abs(y - y2) > _TOUCH:
            raise must_be(f"Vehicle `{two}`", owner, f"clear of `{one}` at the start", f"x = {x2:g} m beside {x:g} m")


def _box(start: Start, heading: float, length: float, width: float) -> tuple[float, float, float, float]:
    """Centre and half extents along and across the road."""
    c, s = abs(math.cos(heading)), abs(math.sin(heading))
    return start.x, start.y, 0.5 * (length * c + width * s), 0.5 * (length * s + width * c)
