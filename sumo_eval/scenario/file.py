"""Reading of a scenario file in TOML into a `LogicalScenario` with the options that `use` sets, and
its check with vehicles at every point of a sample.

`scenario/file_tables.py` has the tables and keys of such a file, which are a public format.

Users: `cli/tools.py`, `extras/openscenario/describe.py`, `extras/openscenario/written.py`,
`extras/rates/learned.py`, `extras/rates/recorded_scene.py`,
`extras/studies/qualification/regulations.py`, `record/facts.py`, `scenario/catalogue.py`.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, SumoEvalError, check_known, must_be, users_code
from sumo_eval.groups import grouped
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.file_tables import OptionTable, ScenarioFile
from sumo_eval.scenario.first_places import STANDARD_EGO, misplaced
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.reachable import leaves_at, never_begin
from sumo_eval.settings import SimulationSettings
from sumo_eval.settings.config import validated
from sumo_eval.settings.toml_file import read_toml
from sumo_eval.text import number_in
from sumo_eval.trajectory import FloatArray


def read_scenario(path: Path, texts: Mapping[str, str] | None = None) -> LogicalScenario:
    """The logical scenario in a TOML file.

    texts: values of the options that `use` sets, by name, as the user wrote them: "1.5" of
        `use = "cut_in?lateral_acceleration=1.5"`.

    Raises InputError naming what is wrong.
    """
    return scenario_from(
        read_toml(path, "scenario file"), f"scenario file {path}", path.parent, texts
    )


def scenario_from(
    content: Mapping[str, Any], where: str, folder: Path, texts: Mapping[str, str] | None = None
) -> LogicalScenario:
    """The logical scenario in the parsed content of a TOML file.

    where: name of the file in errors.
    folder: base of its relative paths.
    texts: as in `read_scenario`.
    """
    table, options = _with_options(validated(content, ScenarioFile, where), texts or {})
    return table.logical(options, where, folder)


def _with_options(
    table: ScenarioFile, texts: Mapping[str, str]
) -> tuple[ScenarioFile, dict[str, float]]:
    """The file as the options set by `use` change it, and the value of every option by name."""
    owner = f"scenario `{table.name}`"
    # an option without a default is infinite unless `use` sets it, so that `min(..., option)` is
    # not limited
    values = {
        item.name: math.inf if item.default is None else item.default for item in table.option
    }
    check_known(f"option of {owner}", values, *texts)
    for item in table.option:
        if item.name in texts:
            values[item.name] = _value(item, texts[item.name], owner)
            table = _changed(table, item, values[item.name])
    return table, values


def _value(option: OptionTable, text: str, owner: str) -> float:
    """The value that a text gives an option, checked."""
    wanted = "a finite number" + ("" if option.unit == "1" else f" of {option.unit}")
    wanted += "" if option.above is None else f" above {option.above:g}"
    value = number_in(text)  # nan for a text that is no finite number
    if math.isnan(value) or (option.above is not None and value <= option.above):
        raise must_be(f"`{option.name}`", owner, wanted, text)
    return value


def _changed(table: ScenarioFile, option: OptionTable, value: float) -> ScenarioFile:
    """The file as its table `[option.given]` changes it where the option has a value."""
    changes = option.given
    # the value as a part of the scenario's name, which has no `-`, `.` and `+`
    word = f"{value:g}".replace("-", "minus_").replace(".", "_").replace("+", "")
    suffix = (changes.suffix or option.name).replace("{value}", word)
    return replace(
        table,
        name=f"{table.name}_{suffix}",
        about=table.about if changes.about is None else changes.about,
        road=changes.road or table.road,
        vehicle=(*table.vehicle, *changes.vehicle),
    )


def check_file(path: Path, texts: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Read a scenario file and place its vehicles at every point of its own sample.

    Returns sentences for the user: the space, its sample and exposure, vehicles that leave the
    road, notes of the scenario and of the sample.

    texts: as in `read_scenario`.
    Raises InputError at the first fault.
    """
    from sumo_eval.scenario.sampling.samples import sample

    logical = read_scenario(Path(path), texts)
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
        *logical.notes,
        *chosen.notes,
    )


def leaving(logical: LogicalScenario, points: FloatArray) -> Iterator[str]:
    """A sentence for each vehicle whose script leads beyond the road at some of the points (n,
    k).
    """
    # a scenario without a time limit has that of a run's settings. They are not known here, so the
    # default counts.
    limit = SimulationSettings().time_limit if logical.time_limit is None else logical.time_limit
    end = logical.road.end
    # by vehicle: (time, point in words) of each of its departures
    departures = grouped(
        (name, (time, concrete.label))
        for concrete in logical.concretes(points)
        for name, time in leaves_at(concrete, limit)
    )
    for name, of_vehicle in departures.items():
        earliest, point = min(of_vehicle)
        yield (
            f"Vehicle `{name}` comes to the end of the road, x = {end:g} m, before the ego is at "
            f"x = {logical.road.length:g} m at {len(of_vehicle)} of {len(points)} points, after "
            f"{earliest:.1f} s at {point}: "
            "the case then continues without it and records `actor_left_the_network`."
        )


def check_points(logical: LogicalScenario, points: FloatArray) -> None:
    """Place every vehicle at every point (n, k), and evaluate a zone rule of formulas there. No
    search for encounters is run.

    Raises InputError at the first fault.
    """
    # functions of a scenario in Python are the user's
    with users_code(f"Scenario `{logical.name}` failed", SumoEvalError):
        for concrete in logical.concretes(points):
            _check_point(logical, concrete)
    for function in (logical.approach, logical.margin):
        if function is not None:
            logical.values(function, points)  # called for its errors only


def _check_point(logical: LogicalScenario, concrete: ConcreteScenario) -> None:
    """Refuse a point with a wrong setting, an impossible start, or a move that never begins."""
    owner = f"scenario `{logical.name}` at {concrete.label}"
    # for its error only: a parameter may be a setting, with a value beyond the setting's bounds
    concrete.simulation(SimulationSettings())
    # a case ends when the ego is at x = `length`, before the end of the road, `road.end`
    start, ends_at = concrete.ego.x, logical.road.length
    if start >= ends_at:
        raise must_be("`end.x`", owner, f"beyond the ego's start, x = {start:g} m", ends_at)
    ego_body = logical.ego_body or STANDARD_EGO
    for fault in misplaced(logical.road, concrete.ego, ego_body, concrete.actors):
        raise must_be(fault.what, owner, fault.must, fault.got)
    # a scenario without a time limit has that of a run's settings, which may be any: a move is
    # refused only if it never begins, however long the case lasts
    limit = math.inf if logical.time_limit is None else logical.time_limit
    for actor, index in never_begin(concrete, limit):
        name = actor.acts[index].name or f"number {index + 1}"
        raise InputError(
            f"The condition of manoeuvre {name} of vehicle `{actor.name}` of {owner} can never "
            "hold, whatever the ego does: the manoeuvre would never begin."
        )
