"""A scenario file in TOML: read into a `LogicalScenario`, and checked with vehicles at every point
of its sample.

Users: `cli/tools.py`, `extras/openscenario/describe.py`, `extras/rates/learned.py`,
`extras/rates/recorded_scene.py`, `extras/studies/qualification/regulations.py`, `record/facts.py`,
`scenario/catalogue.py`.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.groups import grouped
from sumo_eval.scenario.file_tables import ScenarioFile
from sumo_eval.scenario.first_places import STANDARD_EGO, misplaced
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.reachable import leaves_at, never_begin
from sumo_eval.settings import SimulationSettings
from sumo_eval.settings.config import validated
from sumo_eval.settings.toml_file import read_toml
from sumo_eval.text import number_in
from sumo_eval.trajectory import FloatArray


def read_scenario(path: Path, given: Mapping[str, str] | None = None) -> LogicalScenario:
    """The logical scenario in a TOML file.

    given: options by name, as written.

    Raises InputError naming what is wrong.
    """
    return scenario_from(
        read_toml(path, "scenario file"), f"scenario file {path}", path.parent, given
    )


def scenario_from(
    content: Mapping[str, Any], where: str, folder: Path, given: Mapping[str, str] | None = None
) -> LogicalScenario:
    """The logical scenario in a plain mapping.

    where: its name in errors.
    folder: base of its relative paths.
    given: as in `read_scenario`.
    """
    table, options = _with_options(validated(content, ScenarioFile, where), given or {})
    return table.logical(options, where, folder)


def _with_options(
    table: ScenarioFile, given: Mapping[str, str]
) -> tuple[ScenarioFile, dict[str, float]]:
    """The file as the given options change it, and the value of every option by name."""
    owner = f"scenario `{table.name}`"
    # an option without a default is infinite unless given
    values = {
        item.name: math.inf if item.default is None else item.default for item in table.option
    }
    check_known(f"option of {owner}", values, *given)
    for item in table.option:
        if item.name not in given:
            continue
        wanted = "a finite number" + ("" if item.unit == "1" else f" of {item.unit}")
        wanted += "" if item.above is None else f" above {item.above:g}"
        value = number_in(given[item.name])
        if math.isnan(value) or (item.above is not None and value <= item.above):
            raise must_be(f"`{item.name}`", owner, wanted, given[item.name])
        values[item.name] = value
        changes = item.given  # what the file changes when this option is given
        # the value as a part of the scenario's name, which has no `-`, `.` and `+`
        word = f"{value:g}".replace("-", "minus_").replace(".", "_").replace("+", "")
        suffix = (changes.suffix or item.name).replace("{value}", word)
        table = replace(
            table,
            name=f"{table.name}_{suffix}",
            about=table.about if changes.about is None else changes.about,
            road=changes.road or table.road,
            vehicle=(*table.vehicle, *changes.vehicle),
        )
    return table, values


def check_file(path: Path, given: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Read a scenario file, place vehicles at every point of its own sample, and say in sentences
    what it holds.

    given: options by name, as written.
    Raises InputError with what is wrong, at the first point where something is.
    """
    from sumo_eval.scenario.sampling.samples import sample

    logical = read_scenario(Path(path), given)
    chosen = sample(logical)
    check_points(logical, chosen.points)
    ranges = ", ".join(
        f"{item.name} {item.low:g}..{item.high:g}{item.unit_suffix}" for item in logical.parameters
    )
    return (
        f"Logical scenario `{logical.name}`: {ranges}.",
        f"Its own sample has {len(chosen.points)} possible points; constraints refuse "
        f"{len(chosen.refused)} more.",
        f"Exposure: {logical.exposure_about}.",
        *leaving(logical, chosen.points),
        *chosen.notes,
    )


def leaving(logical: LogicalScenario, points: FloatArray) -> Iterator[str]:
    """A sentence for each vehicle whose script leads beyond the road at some of the points (n,
    k).
    """
    # the run's own limit is not known here: the default
    limit = SimulationSettings().time_limit if logical.time_limit is None else logical.time_limit
    end = logical.road.end
    departures = grouped(
        (name, (time, concrete.label))
        for concrete in logical.concretes(points)
        for name, time in leaves_at(concrete, limit)
    )
    for name, times in departures.items():
        time, where = min(times)
        yield (
            f"Vehicle `{name}` comes to the end of the road, x = {end:g} m, before the ego is at "
            f"x = {logical.road.length:g} m at {len(times)} of {len(points)} points, after "
            f"{time:.1f} s at {where}: "
            "the case then continues without it and records `actor_left_the_network`."
        )


def check_points(logical: LogicalScenario, points: FloatArray) -> None:
    """Place every vehicle at every point (n, k), and evaluate the zone rule there.

    Raises InputError at the first fault.
    """
    for concrete in logical.concretes(points):
        # for its error only: a parameter may be a setting, with a value beyond the setting's bounds
        concrete.simulation(SimulationSettings())
        # a case ends when the ego is at x = `length`, before the end of the road, `road.end`
        start, ends_at = concrete.ego.x, logical.road.length
        if start >= ends_at:
            at = f"scenario `{logical.name}` at {concrete.label}"
            raise must_be("`end.x`", at, f"beyond the ego's start, x = {start:g} m", ends_at)
        ego_body = logical.ego_body or STANDARD_EGO
        for wrong in misplaced(logical.road, concrete.ego, ego_body, concrete.actors):
            raise must_be(
                wrong.what, f"scenario `{logical.name}` at {concrete.label}", wrong.must, wrong.got
            )
        # the run's own limit is not known here: any moment may count
        limit = math.inf if logical.time_limit is None else logical.time_limit
        for actor, index in never_begin(concrete, limit):
            name = actor.acts[index].name or f"number {index + 1}"
            raise InputError(
                f"The condition of manoeuvre {name} of vehicle `{actor.name}` of scenario "
                f"`{logical.name}` at {concrete.label} can never hold, whatever the ego does: the "
                "manoeuvre would never begin."
            )
    # called for their errors only
    if logical.approach is not None:
        logical.approach(logical.columns(points))
    if logical.margin is not None:
        logical.margin(logical.columns(points))
