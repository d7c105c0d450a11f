"""One case of a run as files that stand alone: for SUMO, for other simulators, and to run again.

Users: `cli/look.py`, `extras/wheel/outcome.py`.
"""

import shlex
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from sumo_eval.cosim.doors.entry import made_absolute
from sumo_eval.cosim.openscenario import opendrive_xml, openscenario_xml
from sumo_eval.cosim.sumo.sumo_files import case_files
from sumo_eval.record import run_folder
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.store import open_store
from sumo_eval.report.explain import known_case
from sumo_eval.report.page import write_csv, write_page
from sumo_eval.scenario.catalogue import is_file
from sumo_eval.settings import (
    EvaluationSettings,
    ExposureSettings,
    SamplingSettings,
    ScenarioSettings,
)
from sumo_eval.settings.config import to_toml
from sumo_eval.text import cell, file_stem


class Exported(NamedTuple):
    """The written files, and the command that drives the case again in their folder."""

    paths: tuple[Path, ...]
    line: str


def export_case(run: Path, case: str, out: Path) -> Exported:
    """Write a case into the folder `out`: SUMO network, routes, view and .sumocfg (opens in
    sumo-gui), OpenSCENARIO and OpenDRIVE, and an evaluation of this one case with its point.

    The files are named after the case, with `_` for characters other than letters, digits, dots,
    plus signs and single hyphens. The command that drives it again is in the .xosc header, too.

    Raises InputError for a case that the run does not have.
    """
    resolved = run_folder.resolved_run(run)
    settings, source = resolved.settings, resolved.source
    fact = known_case(run, case)
    with open_store(run) as store:
        # a drive that did not start has no trajectories
        started = fact.simulated_time is not None and not store.is_discarded(case)
        driven = store.trajectories(case) if started else None
    entry, logical = next(pair for pair in resolved.entries if pair[1].name == fact.scenario)
    concrete = replace(logical.concrete(**fact.values), exposure=fact.exposure)
    stem = file_stem(case)
    alone = _evaluation(settings, fact, entry, source, f"{stem}.csv")
    line = f"{_importing(alone, source)}sumo-eval run {stem}.toml --out again"
    texts = case_files(
        concrete, settings.simulation, concrete.road.name, stem,
        origin=f"{stem}.toml beside this file drives the whole case again."
    ) | {
        f"{stem}.xodr": opendrive_xml(concrete.road),
        f"{stem}.xosc": openscenario_xml(
            concrete, settings.simulation, f"{stem}.xodr", f"Run again: {line}", driven
        ),
        f"{stem}.toml": to_toml(alone)
    }  # fmt: skip
    columns, values = [*logical.names], [fact.values[name] for name in logical.names]
    if fact.exposure > 0.0:  # a sample whose exposures are all 0 is refused
        columns.append("exposure")
        values.append(fact.exposure)
    paths = [write_page(out / name, text, "The file") for name, text in texts.items()]
    points = write_csv(out / f"{stem}.csv", map(cell, columns), [map(repr, values)])
    return Exported((*paths, points), line)


def _evaluation(
    settings: EvaluationSettings, fact: Fact, entry: ScenarioSettings, source: Path, points: str
) -> EvaluationSettings:
    """The run's settings with this scenario, this point and this ADS alone; paths of its files made
    absolute.
    """
    ads = next(item for item in settings.ads if item.name == fact.driver)
    alone: EvaluationSettings = absolute(replace(settings, scenario=(entry,), ads=(ads,)), source)
    (scenario,) = alone.scenario
    sampling = SamplingSettings(method="file", file=points)  # the file has the exposure, too
    return replace(
        alone,
        scenario=(replace(scenario, sampling=sampling, exposure=ExposureSettings()),),
        run=replace(settings.run, qualification=""),  # `settings` has that of the whole run
    )


# settings that are paths of files, and settings that may hold a path, as `my_ads.py:MyAds`
_PATHS = "file", "files", "recordings", "cases", "qualification"
_LOCATORS = "use", "method", "controller", "source", "severity"


def absolute(value: Any, source: Path, name: str = "") -> Any:
    """Settings, or the value of one, with the paths of files absolute, so that they hold in a file
    of any folder.

    source: the folder that relative paths start from.
    name: of the setting.
    """
    if is_dataclass(value) and not isinstance(value, type):
        items = ((item.name, getattr(value, item.name)) for item in fields(value))
        return replace(value, **{key: absolute(item, source, key) for key, item in items})
    if isinstance(value, tuple):
        return tuple(absolute(item, source, name) for item in value)
    if not isinstance(value, str) or not value:
        return value
    if name in _PATHS or (name == "use" and is_file(value)):
        return str(source / value)
    return made_absolute(value, source) if name in _LOCATORS else value


def _importing(alone: EvaluationSettings, source: Path) -> str:
    """Prefix of the command: PYTHONPATH where modules next to the run's evaluation are needed."""
    named = (
        alone.scenario[0].use, alone.ads[0].controller, alone.drivers.source,
        alone.method.collision.severity
    )  # fmt: skip
    modules = [
        module for module, colon, _ in (locator.rpartition(":") for locator in named) if colon
    ]
    tops = [module.partition(".")[0] for module in modules if not module.endswith(".py")]
    beside = any(
        (source / f"{top}.py").is_file() or (source / top / "__init__.py").is_file() for top in tops
    )
    return f"env PYTHONPATH={shlex.quote(str(source))} " if beside else ""
