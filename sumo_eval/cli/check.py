"""`sumo-eval check`: is a controller, or an evaluation file, what it has to be?"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NoReturn

import click

from sumo_eval.cli.exit_status import DONE, GATE_FAILED, INPUT_WRONG
from sumo_eval.settings import AdsSettings, EvaluationSettings, RunSettings, ScenarioSettings

_RUN = RunSettings()
_LINES = 20  # of what an ADS printed


@click.command()
@click.argument("what", metavar="LOCATOR-or-FILE")
@click.option(
    "--step-timeout",
    type=click.FloatRange(min=0, min_open=True),
    default=_RUN.step_timeout,
    show_default=True,
    help="Wall time a step may take in the run that is to be, s.",
)
@click.option(
    "--case-timeout",
    type=click.FloatRange(min=0, min_open=True),
    default=_RUN.case_timeout,
    show_default=True,
    help="Wall time a case may take in the run that is to be, s.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Draws two of the cases.")
def check(what: str, step_timeout: float, case_timeout: float, seed: int) -> None:
    """Check an ADS (edge cases of two scenarios, driven twice), an evaluation file or a scenario file (FILE.toml).

    Exit status: 0 all is well, 1 the ADS breaks the contract or a run would lose cases of it to the clock, 2 it cannot
    be loaded or the file is wrong.
    """
    file = what.partition("?")[0]
    if file.endswith(".toml"):
        if _is_scenario(Path(file)):
            _check_scenario(what)
        _check_evaluation(Path(what))
    _check_controller(what, step_timeout, case_timeout, seed)


def _is_scenario(path: Path) -> bool:
    """Whether a file describes a logical scenario; what cannot be read at all is left to the evaluation's reader."""
    from sumo_eval.errors import InputError
    from sumo_eval.settings.toml_file import read_toml

    try:
        return not {"parameter", "ego", "vehicle", "zone"}.isdisjoint(read_toml(path, "file"))
    except InputError:
        with suppress(OSError):
            return b"[[parameter]]" in path.read_bytes()
        return False


def _check_scenario(use: str) -> NoReturn:
    """By the function that a run of the scenario alone, on its own sample, asks first."""
    from sumo_eval.record.facts import space_of
    from sumo_eval.scenario.catalogue import options_of
    from sumo_eval.scenario.file import check_file

    file, given = options_of(use)
    path = Path(file)
    scenario = ScenarioSettings(path.name + use.removeprefix(file))
    alone = EvaluationSettings("check", (scenario,), (AdsSettings("idm", "idm"),))
    space_of(scenario, alone, path.parent.resolve())
    for sentence in check_file(path, given):
        click.echo(sentence)
    sys.exit(DONE)


def _check_controller(locator: str, step_timeout: float, case_timeout: float, seed: int) -> None:
    from sumo_eval.record.apart import check_apart
    from sumo_eval.record.edge_cases import edge_cases
    from sumo_eval.scenario import catalogue
    from sumo_eval.text import last_lines

    cases = [
        case
        for name in ("front_vehicle_low_speed", "front_vehicle_cut_out")
        for case in edge_cases(catalogue.load(name), seed)
    ]
    findings, printed = check_apart(locator, cases, Path.cwd(), step_timeout, case_timeout)
    if printed:
        click.echo(f"It printed:\n{last_lines(printed, _LINES)}", err=True)
    for finding in findings:
        click.echo(f"{finding.kind:4}  {finding.text}")
        if finding.mend:
            click.echo(f"      -> {finding.mend}")
    failed = sum(finding.kind == "FAIL" for finding in findings)
    click.echo(f"{locator}: {'keeps the contract' if not failed else f'breaks the contract in {failed} point(s)'}")
    sys.exit(GATE_FAILED if failed else DONE)


def _check_evaluation(path: Path) -> None:
    """Ask of each part of the file what a run asks before it simulates; name every mistake, not only the first."""
    from sumo_eval.errors import InputError
    from sumo_eval.record.facts import refuse_doubles, resolve, space_of
    from sumo_eval.record.points import scenario_weights
    from sumo_eval.record.recording import planner
    from sumo_eval.scenario import catalogue
    from sumo_eval.scoring.quantities import chosen_severity
    from sumo_eval.settings import DriverSettings

    settings, source = resolve(path, Path(), resume=False)
    click.echo(f"ok    {path}: the settings are valid")
    wrong = 0

    def found(described: str, find: Callable[[], str]) -> None:
        nonlocal wrong
        try:
            said = find()
        except InputError as error:
            wrong += 1
            click.echo(f"FAIL  {described}: {error}")
        else:
            click.echo(f"ok    {described}: {said}")

    bare = replace(settings, ads=(), drivers=DriverSettings(), simulation=replace(settings.simulation, plant=None))
    spaces = []

    def points(entry: ScenarioSettings, offset: int) -> str:
        space = space_of(entry, settings, source, offset=offset)
        spaces.append(space)
        refuse_doubles(spaces)
        return f"{len(space.points)} points of {', '.join(space.logical.names)}"

    def planned(words: str, part: EvaluationSettings) -> str:
        planner(part, source)
        return words

    def ranking() -> str:
        names = [catalogue.find(entry.use, source).name for entry in settings.scenario]
        weights = scenario_weights(names, settings.method.ranking)
        return ", ".join(f"{name} weighs {weight:g}" for name, weight in weights.items())

    def severity() -> str:
        chosen_severity(settings.method.collision, source)
        return settings.method.collision.severity

    for offset, entry in enumerate(settings.scenario):
        found(f"scenario {entry.use}", partial(points, entry, offset))
    for ads in settings.ads:
        found(f"ADS {ads.name}", partial(planned, ads.controller, replace(bare, ads=(ads,))))
    plant = settings.simulation.plant
    words = "the single-track model" if plant is None else plant.file
    found("vehicle model", partial(planned, words, replace(bare, simulation=settings.simulation)))
    found("drivers", partial(planned, settings.drivers.source, replace(bare, drivers=settings.drivers)))
    found("severity", severity)
    if settings.method.ranking.weights:
        found("ranking", ranking)
    sys.exit(INPUT_WRONG if wrong else DONE)
