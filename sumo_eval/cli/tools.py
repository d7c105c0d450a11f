"""Helpers for authors: `check` an ADS or a file, the `schema` for editors.

Users: `cli/run.py`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED, INPUT_WRONG
from sumo_eval.cli.options import POSITIVE, SEED
from sumo_eval.cli.progress import Progress
from sumo_eval.cli.sentences import say, tell
from sumo_eval.errors import InputError, nearest, unknown
from sumo_eval.gone import refuse_use_case
from sumo_eval.input_file import read_input
from sumo_eval.text import last_lines, shown

if TYPE_CHECKING:
    from sumo_eval.record.recording import Space
    from sumo_eval.settings import EvaluationSettings

    # (name of the part, function that checks it and returns words on it, arguments of the function)
    Part = tuple[Any, ...]

_MOST_POINTS = 200  # of a scenario's own sample, at which `check` searches for a hazard
_MOST_FILES = 5  # of a folder, that an error message names
_MOST_LINES = 20  # of what an ADS printed


@click.command(epilog="Example: sumo-eval check my_ads.py:MyAds")
@click.argument("what", metavar="LOCATOR-or-FILE")
@click.option(
    "--step-timeout",
    type=POSITIVE,
    show_default="as `run.step_timeout`",
    help="Wall time a step may take in the run that is to be, s.",
)
@click.option(
    "--case-timeout",
    type=POSITIVE,
    show_default="as `run.case_timeout`",
    help="Wall time a case may take in the run that is to be, s.",
)
@SEED
def check(what: str, step_timeout: float | None, case_timeout: float | None, seed: int) -> None:
    """Check an ADS (edge cases of two scenarios and an empty road, driven twice), an evaluation
    file, or a scenario (name or FILE.toml).

    Exit status: 0 all is well, 1 the ADS breaks the contract or a run would lose cases of it to the
    clock, 2 it cannot be loaded or the file is wrong.
    """
    from sumo_eval.cosim.doors.controller import SHIPPED
    from sumo_eval.scenario.shipped_files import scenario_files

    # each `_check_...` exits: the lines after its call do not run
    file, mark, options = what.partition("?")
    scenarios = scenario_files()
    if file in scenarios:
        _check_scenario(f"{scenarios[file]}{mark}{options}")
    refuse_use_case(file)
    _refuse_a_folder(file)
    refuse_a_bare_file(file)
    if file.endswith(".toml") and not _has_scheme(file):
        if _is_scenario(Path(file)):
            _check_scenario(what)
        _check_evaluation(Path(what))
    # a misspelt name of a scenario; any other word goes on as a locator of an ADS
    if file.isidentifier() and nearest(file, (*SHIPPED, *scenarios)) in scenarios:
        raise unknown("scenario", file, scenarios)
    _check_controller(what, step_timeout, case_timeout, seed)


def _refuse_a_folder(named: str) -> None:
    """Refuse a folder, and name files in it that can be checked."""
    folder = Path(named)
    if not folder.is_dir():
        return
    files = sorted(
        path for ending in ("toml", "py") for path in folder.glob(f"*.{ending}") if path.is_file()
    )
    if not files:
        raise InputError(
            f"{shown(named)} is a folder without an evaluation, a scenario (.toml) or an ADS (.py)."
        )
    more = f" and {len(files) - _MOST_FILES} more" if len(files) > _MOST_FILES else ""
    listed = ", ".join(shown(str(path)) for path in files[:_MOST_FILES])
    raise InputError(f"{shown(named)} is a folder; name a file that it holds: {listed}{more}.")


def refuse_a_bare_file(locator: str) -> None:
    """Refuse a Python file without the name of an ADS, and name the ADSs that it offers."""
    import ast

    file = Path(locator)
    if file.suffix != ".py" or _has_scheme(locator):
        return
    content = read_input(file, "file")
    try:
        body = ast.parse(content, locator).body
    except (SyntaxError, ValueError) as error:
        raise InputError(f"{shown(locator)} is not readable Python: {error}.") from None
    names = [
        item.name
        for item in body
        if isinstance(item, ast.ClassDef | ast.FunctionDef) and not item.name.startswith("_")
    ]
    if not names:
        raise InputError(f"{shown(locator)} holds no class and no function, so no ADS.")
    listed = ", ".join(f"`{name}`" for name in names)
    raise InputError(
        f"{shown(locator)} is a file; name one of what it holds ({listed}): {locator}:{names[0]}"
    )


def _has_scheme(locator: str) -> bool:
    """Whether a locator names a program, a model or a file of another kind: `exec:python
    my_ads.py`.
    """
    if ":" not in locator:
        return False
    from sumo_eval.cosim.doors.controller import has_scheme

    return has_scheme(locator)


def _is_scenario(path: Path) -> bool:
    """Whether a file describes a logical scenario, by its tables.

    In a file that is not valid TOML, the text `[[parameter]]` decides. False for a file that cannot
    be read: the reader of evaluations then reports why.
    """
    from sumo_eval.settings.toml_file import read_toml

    try:
        return not {"parameter", "ego", "vehicle", "zone"}.isdisjoint(read_toml(path, "file"))
    except InputError:
        with suppress(InputError):
            return b"[[parameter]]" in read_input(path, "file")
        return False


def _check_scenario(use: str) -> NoReturn:
    """Check a scenario as at the start of a run of it alone, with its own sample.

    use: its file, with options as in `[[scenario]] use`.
    """
    from sumo_eval.method.point_criticality import is_searched
    from sumo_eval.method.zone_partition import refuse_impossible_zones
    from sumo_eval.record.facts import space_of
    from sumo_eval.scenario.catalogue import options_of
    from sumo_eval.scenario.file import check_file
    from sumo_eval.scenario.resolved import Resolved
    from sumo_eval.settings import EvaluationSettings, ScenarioSettings

    file, options = options_of(use)
    path = Path(file)
    entry = ScenarioSettings(path.name + use.removeprefix(file))  # its name, then the options
    alone = EvaluationSettings("check", (entry,))
    # `check_file` below checks all points of the sample
    space = space_of(Resolved.of(alone, path.parent.resolve()), 0, looked_at=_MOST_POINTS)
    logical = space.logical
    refuse_impossible_zones(logical, alone.method.zones)
    say(check_file(path, options))
    if is_searched(logical):
        sampled = (
            f"some {_MOST_POINTS} of these points and " if len(space.points) > _MOST_POINTS else ""
        )
        tell(f"Zones: {sampled}one in eight points of their dense grid were asked; a run asks all.")
    sys.exit(DONE)


def _check_controller(
    locator: str, step_timeout: float | None, case_timeout: float | None, seed: int
) -> None:
    from sumo_eval.record.apart import check_apart
    from sumo_eval.record.edge_cases import edge_cases
    from sumo_eval.record.loops import WORLD, compiled, ready
    from sumo_eval.scenario import catalogue
    from sumo_eval.settings import RunSettings

    run = RunSettings()
    run = replace(
        run,
        step_timeout=step_timeout or run.step_timeout,
        case_timeout=case_timeout or run.case_timeout,
    )
    cases = [
        case
        for name in ("front_vehicle_low_speed", "front_vehicle_cut_out")
        for case in edge_cases(catalogue.load(name), seed)
    ]
    values = {"ego_speed": cases[0].ego.speed}
    cases.append(replace(cases[0], scenario="empty_road", values=values, actors=()))
    if WORLD not in compiled():
        # what cannot be loaded is refused before anything is compiled
        check_apart(locator, (), run)
        with Progress() as progress:
            ready({WORLD}, progress)  # not during the first drive, which would count as slow
    findings, printed = check_apart(locator, cases, run)
    if printed:
        tell(f"It printed:\n{last_lines(printed, _MOST_LINES)}", err=True)
    # each finding with the next one; None follows the last
    for finding, following in zip(findings, [*findings[1:], None], strict=True):
        tell(f"{finding.kind:4}  {finding.text}")
        # findings in a row with one remedy share its line
        if finding.mend and (following is None or following.mend != finding.mend):
            tell(f"      -> {finding.mend}")
    failed = sum(finding.kind == "FAIL" for finding in findings)
    points = f"{failed} point{'s' * (failed != 1)}"
    tell(f"{locator}: {f'breaks the contract in {points}' if failed else 'keeps the contract'}")
    sys.exit(GATE_FAILED if failed else DONE)


def _check_evaluation(path: Path) -> None:
    """Check each part of the file as a run does before it simulates; name every mistake, not only
    the first.
    """
    from sumo_eval.record.facts import settings_of
    from sumo_eval.record.only import narrowed
    from sumo_eval.scenario.resolved import Resolved

    settings, source = settings_of(path, Path(), resume=False)
    if settings.run.only:
        settings = narrowed(Resolved.of(settings, source)).settings
    tell(f"ok    {path}: the settings are valid")

    spaces: list[Space] = []  # filled while the parts below are checked
    mistakes = _count_mistakes(_scenario_parts(settings, source, spaces))
    mistakes += _count_mistakes(_planned_parts(settings, source))
    # recorded drivers need valid settings and all spaces
    if settings.drivers.source == "recorded" and not mistakes:
        mistakes = sum(_check_recorded_people(space, settings, source) for space in spaces)
    names = [space.logical.name for space in spaces]
    mistakes += _count_mistakes(_closing_parts(settings, source, names))
    sys.exit(INPUT_WRONG if mistakes else DONE)


def _scenario_parts(
    settings: EvaluationSettings, source: Path, spaces: list[Space]
) -> Iterator[Part]:
    """The qualification that the settings name, then every scenario.

    spaces: gets the space of each scenario that is valid.
    """
    from sumo_eval.record.qualification import read_qualification

    named = settings.run.qualification
    if named:
        yield "qualification", lambda: f"{read_qualification(named, source)['checks']} checks"
    for entry in settings.scenario:
        yield f"scenario {entry.use}", _points, replace(settings, scenario=(entry,)), source, spaces


def _points(settings: EvaluationSettings, source: Path, spaces: list[Space]) -> str:
    """Add the space of the settings' only scenario to `spaces`; return words on it."""
    from sumo_eval.method.zone_partition import refuse_impossible_zones
    from sumo_eval.record.facts import space_of
    from sumo_eval.scenario.resolved import Resolved, refuse_doubles

    space = space_of(Resolved.of(settings, source), 0)
    refuse_doubles([valid.logical.name for valid in (*spaces, space)])
    spaces.append(space)
    refuse_impossible_zones(space.logical, settings.method.zones)
    return f"{len(space.points)} points of {', '.join(space.logical.names)}"


def _planned_parts(settings: EvaluationSettings, source: Path) -> Iterator[Part]:
    """ADSs, vehicle model and drivers, each checked by the planner, as a run does."""
    from sumo_eval.settings import DriverSettings

    plant = settings.simulation.plant
    drivers = settings.drivers
    bare = replace(
        settings,
        ads=(),
        drivers=DriverSettings(),
        simulation=replace(settings.simulation, plant=None),
    )
    for ads in settings.ads:
        yield f"ADS {ads.name}", _planned, replace(bare, ads=(ads,)), source, ads.controller
    vehicle = "the single-track model" if plant is None else plant.file
    modelled = replace(bare, simulation=settings.simulation)
    yield "vehicle model", _planned, modelled, source, vehicle
    yield "drivers", _planned, replace(bare, drivers=drivers), source, drivers.source


def _planned(settings: EvaluationSettings, source: Path, words: str) -> str:
    """Return `words` if the planner accepts the settings; else it raises InputError."""
    from sumo_eval.record.recording import planner
    from sumo_eval.scenario.resolved import Resolved

    planner(Resolved(settings, source, {}))
    return words


def _closing_parts(
    settings: EvaluationSettings, source: Path, names: Sequence[str]
) -> Iterator[Part]:
    """Severity and, if no scenario has a mistake, axes of maps and ranking.

    names: of the scenarios without a mistake.
    """
    from sumo_eval.method.severity import severity_of
    from sumo_eval.record.points import scenario_weights

    yield "severity", lambda: severity_of(settings.method.collision, source).name
    if len(names) == len(settings.scenario):
        if settings.report.axes:
            yield "axes of maps", _axes, settings, names
        if settings.method.ranking.weights:
            yield (
                "ranking",
                lambda: ", ".join(
                    f"{name} weighs {weight:g}"
                    for name, weight in scenario_weights(names, settings.method.ranking).items()
                ),
            )


def _axes(settings: EvaluationSettings, names: Sequence[str]) -> str:
    from sumo_eval.record.points import refuse_unknown_axes

    refuse_unknown_axes(names, settings.report)
    return ", ".join(settings.report.axes)


def _count_mistakes(parts: Iterable[Part]) -> int:
    """Check parts of a file, print a line for each, and return how many are wrong."""
    mistakes = 0
    for described, check_part, *arguments in parts:
        try:
            tell(f"ok    {described}: {check_part(*arguments)}")
        except InputError as error:
            mistakes += 1
            tell(f"FAIL  {described}: {error}")
    return mistakes


def _check_recorded_people(space: Space, settings: EvaluationSettings, source: Path) -> int:
    """Count the mistakes in recorded events of a scenario; warn where no safe point has any."""
    from sumo_eval.drivers.recorded.reference import matching_events, open_people, reference

    people = open_people(settings.drivers, source)
    name, recorded = space.logical.name, space.logical.recorded
    matched = []  # empty where the events cannot be read

    def matching() -> str:
        """Read events, and the drives at safe points until one has some."""
        safe = (space.concrete(number) for number in space.safe)
        matched.append(
            any(reference(point, people, settings.drivers, recorded).drives for point in safe)
        )
        if people.events is None or recorded is None:
            return "drives in named cases only"
        return f"{len(matching_events(people.events, name, recorded))} events like it"

    mistakes = _count_mistakes([(f"recorded people of {name}", matching)])
    # read without a mistake, and no drive at any safe point
    if matched == [False] and space.safe:
        tell(
            f"WARN  recorded people of {name}: none count at any of its {len(space.safe)} safe "
            "points, by `drivers.tolerance`, `drivers.coverage` or the road's lanes"
        )
    return mistakes


@click.command(epilog="Example: sumo-eval schema evaluation > evaluation.schema.json")
@click.argument("what", type=click.Choice(["scenario", "evaluation"]))
def schema(what: str) -> None:
    """Print the JSON schema of a scenario file or of an evaluation file, for editors that check
    TOML.
    """
    from sumo_eval.scenario.schema import schema_of

    tell(json.dumps(schema_of(what), indent=2))
