"""`sumo-eval check`: is a controller, or an evaluation file, what it has to be?"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NoReturn

import click

from sumo_eval.commands.exit_status import DONE, GATE_FAILED, INPUT_WRONG


@click.command()
@click.argument("what", metavar="LOCATOR-or-FILE")
@click.option("--step-timeout", type=click.FloatRange(min=0, min_open=True), default=1.0, show_default=True, help="s")
def check(what: str, step_timeout: float) -> None:
    """Check an ADS (two cases, each driven twice with one seed), an evaluation file or a scenario file (FILE.toml).

    Exit status: 0 all is well, 1 the ADS breaks the contract, 2 it cannot be loaded or the file is wrong.
    """
    if what.endswith(".toml"):
        if _is_scenario(Path(what)):
            _check_scenario(Path(what))
        _check_evaluation(Path(what))
    _check_controller(what, step_timeout)


def _is_scenario(path: Path) -> bool:
    """Whether a file describes a logical scenario; what cannot be read at all is left to the evaluation's reader."""
    from sumo_eval.errors import InputError
    from sumo_eval.toml_file import read_toml

    try:
        return "parameter" in read_toml(path, "file")
    except InputError:
        return False


def _check_scenario(path: Path) -> NoReturn:
    from sumo_eval.scenario.file import check_file

    for sentence in check_file(path):
        click.echo(sentence)
    sys.exit(DONE)


def _check_controller(locator: str, step_timeout: float) -> None:
    from sumo_eval.cosim.contract import check_controller
    from sumo_eval.scenario import catalogue

    cases = [
        catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20.0, lead_speed=5.0),
        catalogue.load("front_vehicle_cut_out").concrete(ego_speed=25.0, obstacle_speed=10.0, gap=60.0),
    ]
    findings = check_controller(locator, cases, folder=Path.cwd(), step_timeout=step_timeout)
    for finding in findings:
        click.echo(f"{finding.kind:4}  {finding.text}")
        if finding.mend:
            click.echo(f"      -> {finding.mend}")
    failed = sum(finding.kind == "FAIL" for finding in findings)
    click.echo(f"{locator}: {'keeps the contract' if not failed else f'breaks the contract in {failed} point(s)'}")
    sys.exit(GATE_FAILED if failed else DONE)


def _check_evaluation(path: Path) -> None:
    """Parse the file; find its scenarios, ADSs and drivers; name every mistake, not only the first."""
    from sumo_eval.cosim.controller import load_controller
    from sumo_eval.cosim.fmu import FmuPlant
    from sumo_eval.drivers.reference import open_people
    from sumo_eval.errors import InputError
    from sumo_eval.facts import resolve
    from sumo_eval.locators import load_object
    from sumo_eval.spaces import choose_points

    settings, source = resolve(path, Path(), resume=False)
    click.echo(f"ok    {path}: the settings are valid")
    wrong = 0

    def found(described: str, find: object) -> None:
        nonlocal wrong
        try:
            assert callable(find)
            said = find()
        except InputError as error:
            wrong += 1
            click.echo(f"FAIL  {described}: {error}")
        else:
            click.echo(f"ok    {described}{said}")

    def points(index: int) -> str:
        logical, chosen = choose_points(settings.scenario[index], source, settings)
        return f": {len(chosen.points)} points of {', '.join(p.name for p in logical.parameters)}"

    def controller(index: int) -> str:
        load_controller(settings.ads[index].locator, source)
        return f": {settings.ads[index].controller}"

    def plant() -> str:
        wiring = settings.simulation.plant
        if wiring is None:
            return ": the single-track model"
        FmuPlant(wiring, wiring.file, source)
        return f": {wiring.file}"

    def drivers() -> str:
        if settings.drivers.source == "recorded":
            open_people(settings.drivers, source)
        elif settings.drivers.source != "synthetic":
            load_object(settings.drivers.source, source, "Human reference")
        return f": {settings.drivers.source}"

    for index, scenario in enumerate(settings.scenario):
        found(f"scenario {scenario.use}", lambda index=index: points(index))
    for index, ads in enumerate(settings.ads):
        found(f"ADS {ads.name}", lambda index=index: controller(index))
    found("vehicle model", plant)
    found("drivers", drivers)
    sys.exit(INPUT_WRONG if wrong else DONE)
