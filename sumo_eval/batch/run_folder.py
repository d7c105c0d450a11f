"""A run's folder: the resolved evaluation, who made it with what, the SUMO inputs, and the facts."""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sumo_eval.batch.store import FORMAT_VERSION
from sumo_eval.config import read_evaluation, to_toml
from sumo_eval.cosim.sumo_files import configuration_xml, network_xml, routes_xml, view_xml
from sumo_eval.errors import InputError
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import EvaluationSettings

FACTS = "facts.sqlite"
EVALUATION = "evaluation.toml"
MANIFEST = "manifest.json"
EXPOSURES = "exposure.json"


def create(folder: Path, settings: EvaluationSettings, source: Path, examples: Sequence[ConcreteScenario]) -> None:
    """Make a run folder. `source`: where relative paths of the evaluation start; `examples`: one case a scenario."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} already exists and is not empty; a run needs a folder of its own.")
    try:
        for name in ("networks", "routes"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / EVALUATION).write_text(to_toml(settings), encoding="utf-8")
        for concrete in examples:
            network, view = f"{concrete.road.name}.net.xml", f"{concrete.road.name}.view.xml"
            routes, configuration = f"{concrete.scenario}.rou.xml", f"{concrete.scenario}.sumocfg"
            simulation = settings.simulation
            texts = {
                f"networks/{network}": network_xml(concrete.road),
                f"networks/{view}": view_xml(concrete.road),
                f"routes/{routes}": routes_xml(concrete, simulation.vehicle),
                f"routes/{configuration}": configuration_xml(
                    f"../networks/{network}",
                    routes,
                    simulation.step,
                    lane_change_duration=simulation.lane_change_duration,
                    view=f"../networks/{view}",
                ),
            }
            for name, text in texts.items():
                (folder / name).write_text(text, encoding="utf-8")
        manifest = _manifest(folder, settings, source)
        (folder / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"The run folder {folder} cannot be written: {error}.") from error


def write_exposures(folder: Path, exposures: Mapping[str, Any]) -> None:
    """Keep what the exposure of every scenario was made of: the recordings need not be there when scores are."""
    (folder / EXPOSURES).write_text(json.dumps(exposures, indent=2) + "\n", encoding="utf-8")


def read_exposures(folder: Path) -> dict[str, Any]:
    """What `write_exposures` kept; nothing where a run has none."""
    try:
        exposures: dict[str, Any] = json.loads((folder / EXPOSURES).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise InputError(f"The exposures of run {folder} cannot be read: {error}.") from error
    return exposures


def read_settings(folder: Path) -> EvaluationSettings:
    """The resolved evaluation of a run."""
    if not (folder / FACTS).is_file():
        raise InputError(f"{folder} is no run folder: there is no {FACTS} in it.")
    return read_evaluation(folder / EVALUATION)


def read_manifest(folder: Path) -> Mapping[str, Any]:
    """The manifest of a run."""
    try:
        manifest: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"The manifest of run {folder} cannot be read: {error}.") from error
    if manifest.get("format_version") != FORMAT_VERSION:
        raise InputError(
            f"Run {folder} has format version {manifest.get('format_version')}; this sumo_eval reads {FORMAT_VERSION}."
        )
    return manifest


def _manifest(folder: Path, settings: EvaluationSettings, source: Path) -> dict[str, Any]:
    inputs = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        "format_version": FORMAT_VERSION,
        "name": settings.name,
        "seed": settings.seed,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "source_folder": str(source),
        "versions": {
            "python": sys.version.split()[0],
            **{name: version(name) for name in ("sumo_eval", "libsumo", "numpy", "scipy", "scikit-learn")},
        },
        "machine": {"system": platform.platform(), "processor": platform.machine(), "node": platform.node()},
        "sha256": {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in inputs},
    }
