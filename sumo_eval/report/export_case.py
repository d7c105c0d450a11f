"""One case of a run as files that stand alone: for SUMO, for other simulators, and to run again."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

from sumo_eval.batch import run_folder
from sumo_eval.batch.store import Fact, open_store
from sumo_eval.config import to_toml
from sumo_eval.cosim.openscenario import opendrive_xml, openscenario_xml
from sumo_eval.cosim.sumo_files import configuration_xml, network_xml, routes_xml, view_xml
from sumo_eval.errors import InputError, unknown
from sumo_eval.scenario.catalogue import find
from sumo_eval.settings import EvaluationSettings, SamplingSettings


def export_case(run: Path, case: str, out: Path) -> tuple[Path, ...]:
    """Write a case into the folder `out` and return the paths: SUMO network, routes, view and .sumocfg (opens in
    sumo-gui), OpenSCENARIO and OpenDRIVE, and an evaluation of this one case with its point.

    `reproduce_line` of the same case is the line that runs it again; it stands in the .xosc header as well.
    Raises InputError for a case that the run does not have.
    """
    settings, source = run_folder.read_settings(run), Path(run_folder.read_manifest(run)["source_folder"])
    fact = _fact(run, settings, case)
    uses = {find(entry.use, source).name: entry for entry in settings.scenario}
    entry = uses[fact.scenario]
    logical = find(entry.use, source)
    concrete = replace(logical.concrete(**fact.values), exposure=fact.exposure)
    simulation = concrete.simulation(settings.simulation)
    road, view, stem = f"{concrete.road.name}.net.xml", f"{concrete.road.name}.view.xml", case
    line = reproduce_line(case)
    texts = {
        road: network_xml(concrete.road),
        view: view_xml(concrete.road),
        f"{stem}.rou.xml": routes_xml(concrete, simulation.vehicle, origin=f"The whole case again: {line}"),
        f"{stem}.sumocfg": configuration_xml(
            road, f"{stem}.rou.xml", simulation.step,
            lane_change_duration=simulation.lane_change_duration, view=view,
        ),
        f"{stem}.xodr": opendrive_xml(concrete.road),
        f"{stem}.xosc": openscenario_xml(concrete, settings.simulation, f"{stem}.xodr", f"Run again: {line}"),
        f"{stem}.toml": _evaluation(settings, fact, entry.use, source, f"{stem}.csv"),
    }  # fmt: skip
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8")
        with (out / f"{stem}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([*logical.names, "exposure"])
            writer.writerow([*(repr(fact.values[name]) for name in logical.names), repr(fact.exposure)])
    except OSError as error:
        raise InputError(f"The case cannot be written into {out}: {error}.") from error
    return tuple(out / name for name in (*texts, f"{stem}.csv"))


def reproduce_line(case: str) -> str:
    """The command that drives an exported case again, in its folder."""
    return f"sumo-eval run {case}.toml --out again"


def _fact(run: Path, settings: EvaluationSettings, case: str) -> Fact:
    with open_store(run / run_folder.FACTS) as store:
        facts = {fact.case: fact for fact in store.facts("ads")}
    if case not in facts:
        raise unknown(f"case of run {run}", case, facts)
    return facts[case]


def _evaluation(settings: EvaluationSettings, fact: Fact, use: str, source: Path, points: str) -> str:
    """The run's settings with this scenario, this point and this ADS alone; paths of its files made absolute."""
    entry = next(item for item in settings.scenario if item.use == use)
    ads = next(item for item in settings.ads if item.name == fact.driver)
    alone = replace(
        settings,
        scenario=(replace(entry, use=_absolute(use, source), sampling=SamplingSettings(method="file", file=points)),),
        ads=(replace(ads, controller=_absolute(ads.controller, source)),),
    )
    return to_toml(alone)


def _absolute(locator: str, source: Path) -> str:
    """A locator that starts with a file, with that file's whole path; others as they are."""
    place, colon, name = locator.rpartition(":")
    if colon and place.endswith(".py"):
        return f"{(source / place).resolve()}:{name}"
    return str((source / locator).resolve()) if locator.endswith(".toml") else locator
