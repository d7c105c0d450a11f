"""One case of a run as files of its own: for SUMO, for other simulators, and to run again.

The evaluation that runs it again names the user's files by absolute paths, so it needs them where
they are, on this machine.

Users: `cli/look.py`, `extras/wheel/outcome.py`, `extras/wheel/plan.py`.
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
from sumo_eval.record.only import without_left_out
from sumo_eval.record.store import open_store
from sumo_eval.report.explain import known_case
from sumo_eval.report.page import write_csv, write_page
from sumo_eval.scenario.catalogue import is_file
from sumo_eval.scenario.resolved import Resolved
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

    The files are named after the case, network and view after its road, with `_` for characters
    other than letters, digits, dots, plus signs and single hyphens. The command that drives the
    case again is in the .xosc header, too.

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
    alone = _evaluation(resolved, entry, fact, f"{stem}.csv")
    line = f"{_importing(alone, source)}sumo-eval run {stem}.toml --out again"
    texts = case_files(
        concrete, settings.simulation, file_stem(concrete.road.name), stem,
        origin=f"{stem}.toml beside this file drives the whole case again."
    ) | {
        f"{stem}.xodr": opendrive_xml(concrete.road),
        f"{stem}.xosc": openscenario_xml(
            concrete, settings.simulation, f"{stem}.xodr", f"Run again: {line}", driven
        ),
        f"{stem}.toml": to_toml(alone)
    }  # fmt: skip
    paths = [write_page(out / name, text, "The file") for name, text in texts.items()]
    # a sample whose exposures are all 0 is refused; the exposure of the only point weighs nothing
    values = [*map(fact.values.__getitem__, logical.names), fact.exposure or 1.0]
    columns = map(cell, (*logical.names, "exposure"))
    point = write_csv(out / f"{stem}.csv", columns, [map(repr, values)])
    return Exported((*paths, point), line)


def _evaluation(
    run: Resolved, entry: ScenarioSettings, fact: Fact, points: str
) -> EvaluationSettings:
    """The run's settings with the scenario, point and ADS of this case alone; paths of the user's
    files made absolute.

    entry: of the scenario in the run's evaluation.
    points: name of the file with the point.
    """
    settings = without_left_out(run, {fact.scenario})
    ads = next(item for item in settings.ads if item.name == fact.driver)
    alone: EvaluationSettings = absolute(
        replace(settings, scenario=(entry,), ads=(ads,)), run.source
    )
    (scenario,) = alone.scenario
    sampling = SamplingSettings(method="file", file=points)
    return replace(
        alone,
        # no exposure of its own: that of the point stands in its file
        scenario=(replace(scenario, sampling=sampling, exposure=ExposureSettings()),),
        # `only` names cases by their numbers in the run, and the qualification is for all its ADSs
        run=replace(settings.run, only=(), qualification=""),
    )


# settings that are paths of files; `extras/wheel/outcome.py` needs `qualification`
_PATHS = "file", "files", "recordings", "cases", "qualification"
# settings that may be locators, which may hold a path, as `my_ads.py:MyAds`: `method` is that of
# sampling; a `use` may also be the path of a scenario file
_LOCATORS = "use", "method", "controller", "source", "severity"


def absolute(value: Any, source: Path, name: str = "") -> Any:
    """Settings, or the value of one, with the paths of files absolute, so that an evaluation in any
    folder may have them.

    source: the folder that relative paths start from.
    name: of the setting that has the value; "" for tables of settings.
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
