"""A run's folder: the resolved evaluation, the manifest (versions and machine that made the run),
SUMO's input files, and the facts. One process at a time writes it (`only_writer`).
`record.facts` also decides whether a run may be resumed with these settings.

Users: `cli/`, `evaluation.py`, `nightly/`, `record/`, `report/`, `whatif/search.py`, `extras/`.
"""

import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import version
from operator import itemgetter
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.groups import grouped
from sumo_eval.input_file import MANIFEST, sha256, write_whole, writing
from sumo_eval.record.facts_file import FORMAT_VERSION
from sumo_eval.record.lock import LOCK, held_folder
from sumo_eval.record.qualification import read_qualification
from sumo_eval.record.sealed import read_sealed, sealed
from sumo_eval.record.store import FACTS, Store
from sumo_eval.record.trust import code_of, is_remembered, refuse_foreign_code, trust_code
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import EvaluationSettings, SimulationSettings
from sumo_eval.settings.config import read_evaluation, to_toml
from sumo_eval.text import file_stem, timestamp

EVALUATION = "evaluation.toml"
EXPOSURES = "exposure.json"
SHARD = "shard"  # name of the note in `FACTS` with the number and count of shards, `1/4`
GIVEN = "ads"  # folder of pickled ADSs, which have no file of their own (`record.given`)
_PACKAGES = ("sumo_eval", "libsumo", "numpy", "scipy", "scikit-learn")  # versions in the manifest
_GIT_PATIENCE = 10.0  # s, for Git in a large folder
Manifest = Mapping[str, Any]
_HALF_MADE = {EVALUATION, MANIFEST, FACTS, EXPOSURES, "networks", "routes"}
"""Names that the folder may hold if a run was ended while `create` wrote its files."""


@contextmanager
def only_writer(folder: Path, *, resume: bool) -> Iterator[None]:
    """Hold the right to write a run folder, which is made if it does not exist.

    Raises InputError if another process holds it, or for a folder that `refuse_foreign` refuses.
    """
    refuse_foreign(folder, resume)  # before a lock file is written into it

    with held_folder(folder):
        refuse_foreign(folder, resume)  # another process may have finished a run here just now
        yield


def refuse_foreign(folder: Path, resume: bool) -> None:
    """Refuse a folder that holds anything but a lock and given ADSs, unless `resume` and it holds
    a run, finished or not, or only files of a run that was stopped while it began.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(
            f"{folder} already exists and is not a folder; a run needs a folder of its own."
        )
    # files of SQLite and of `write_whole` count as the file that they belong to
    names = {
        re.sub(r"(-wal|-shm|-journal|(\.\d+)?\.half)$", "", path.name) for path in folder.iterdir()
    }
    names -= {LOCK, GIVEN}  # written before the run
    if not names:
        return
    if not resume:
        hint = " --resume continues the run in it." if is_run(folder) else ""
        raise InputError(
            f"{folder} already exists and is not empty; a run needs a folder of its own.{hint}"
        )
    if not is_run(folder) and not names <= _HALF_MADE:
        raise InputError(
            f"{folder} is not a run folder: there is no {MANIFEST} in it; nothing to resume."
        )


def is_run(folder: Path) -> bool:
    """Whether a folder holds a run, finished or not."""
    return (folder / MANIFEST).is_file()


def create(
    folder: Path,
    settings: EvaluationSettings,
    source: Path,
    examples: Iterable[ConcreteScenario],
    *,
    another_round: bool,
    driven: Manifest | None = None,
) -> None:
    """Write the files of a run folder except its facts.

    source: folder where relative paths of the evaluation start.
    examples: one concrete scenario of each logical one.
    another_round: whether the process that began or resumed the run continues it; else an existing
        run is resumed now, and the manifest notes that.
    driven: of a merged run, the manifest of its shards, by which it was driven.
    """
    # imported here: what only reads a run needs nothing of `cosim`
    from sumo_eval.record.identity import hashes_of_inputs

    before = driven or (read_manifest(folder) if is_run(folder) else {})
    named = settings.run.qualification
    # a run that continues keeps its record: the qualification's file need not exist any more
    earlier = before.get("qualification")
    qualified = {"qualification": earlier or read_qualification(named, source)} if named else {}
    with writing(f"The run folder {folder}"):
        for name in ("networks", "routes"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        inputs = {EVALUATION: to_toml(settings)} | _sumo_inputs(settings.simulation, examples)
        for name, text in inputs.items():
            write_whole(folder / name, text)
        manifest = {
            "format_version": FORMAT_VERSION,
            "name": settings.name,
            "seed": settings.seed,
            "created": timestamp(),
            "source_folder": str(source),
            **versions_and_machine(_PACKAGES),
            "sha256": {name: sha256(inputs[name]) for name in sorted(inputs)},
            "files": hashes_of_inputs(settings, source),
            "builds": builds_of(settings, source),
            **qualified,
        }
        if before:  # keep how the run began, and list each time that it was resumed
            now = {name: manifest[name] for name in ("created", "versions", "machine")}
            manifest |= {name: before[name] for name in now}
            resumed = before.get("resumed", []) + ([] if driven or another_round else [now])
            if resumed:
                manifest["resumed"] = resumed
        if driven:  # what is there now may have changed since
            manifest |= {name: driven.get(name, {}) for name in ("files", "builds")}
        write_whole(folder / MANIFEST, sealed(manifest))


def _sumo_inputs(
    simulation: SimulationSettings, examples: Iterable[ConcreteScenario]
) -> dict[str, str]:
    """Text of SUMO's input files of each example, by path in the run folder."""
    from sumo_eval.cosim.sumo.sumo_files import case_files, network_xml

    inputs = dict[str, str]()
    for concrete in examples:
        name, scenario = file_stem(concrete.road.name), file_stem(concrete.scenario)
        network = network_xml(concrete.road)
        # scenarios share a network, unless another scenario has another road of that name
        if inputs.get(f"networks/{name}.net.xml", network) != network:
            name = f"{name}_of_{scenario}"
        inputs |= case_files(concrete, simulation, f"networks/{name}", f"routes/{scenario}")
    return inputs


def write_exposures(folder: Path, exposures: Mapping[str, Any]) -> None:
    """Keep the exposure of every scenario and its sources: the recordings need not exist any more
    when the run is scored.
    """
    write_whole(folder / EXPOSURES, sealed(exposures))


def read_exposures(folder: Path) -> dict[str, Any]:
    """Exposures that `write_exposures` kept; empty if a run has none."""
    path = folder / EXPOSURES
    return read_sealed(path) if path.exists() else {}


def read_settings(folder: Path, *, driving: bool = False) -> EvaluationSettings:
    """The settings of a run, with everything that its evaluation file left out.

    driving: whether the run's ADSs will drive.

    Raises InputError for a run that names code and that this user neither recorded here nor trusts.
    """
    if not (folder / FACTS).is_file():
        raise InputError(f"{folder} is not a run folder: there is no {FACTS} in it.")
    settings = read_evaluation(folder / EVALUATION)
    # Whether a run names code does not depend on the source folder, so any folder will do here. The
    # manifest, which has the source folder, is read only if the run does.
    if code_of(settings, folder, driving=driving):
        refuse_foreign_code(folder, settings, source_of(folder), driving=driving)
    return settings


def resolved_run(folder: Path, *, driving: bool = False) -> Resolved:
    """The evaluation of a run with its scenarios; `driving` as in `read_settings`."""
    return Resolved.of(read_settings(folder, driving=driving), source_of(folder))


def source_of(folder: Path) -> Path:
    """Folder where relative paths of a run's evaluation start."""
    return Path(read_manifest(folder)["source_folder"])


def trust_own_runs(*runs: Path) -> bool:
    """Trust the code of those runs that the user has recorded or trusted on this machine; also in
    this process's other runs, if they name the same code.

    Returns whether these are all of the runs.
    """
    own = []
    for run in runs:
        with suppress(InputError, OSError):  # reported when the run is opened
            settings, source = read_evaluation(run / EVALUATION), source_of(run)
            if is_remembered(run, settings, source):
                trust_code(settings, source)
                own.append(run)
    return len(own) == len(runs)


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a run.

    Raises InputError for one of another format, and for one that was changed after it was written.
    """
    return read_sealed(folder / MANIFEST, FORMAT_VERSION)


def versions_of(manifest: Manifest) -> Mapping[str, str]:
    """Versions of the packages that made a run's facts, those of its last start: a run that is
    resumed with another simulator, or another version of this package, repeats its earlier drives.
    """
    last_start = manifest.get("resumed", [manifest])[-1]
    versions: Mapping[str, str] = last_start["versions"]
    return versions


def check_complete(store: Store, folder: Path) -> None:
    """Refuse to score a shard or an incomplete run: a mean over a part is not the run's."""
    if store.noted(SHARD) not in ("", "1/1"):
        raise InputError(
            f"Run {folder} is shard {store.noted(SHARD)} of an evaluation; put the shards together "
            "first: sumo-eval merge SHARD ... --out DIR."
        )
    refuse_incomplete(store, folder)


def refuse_incomplete(store: Store, folder: Path) -> None:
    """Refuse a run, or a shard of one, that has not recorded all of its cases."""
    if not store.sealed:
        shard = store.noted(SHARD)
        more = "" if shard in ("", "1/1") else f" --shard {shard}"
        raise InputError(
            f"Run {folder} is not complete; continue with: sumo-eval run --out "
            f"{shlex.quote(str(folder))} --resume{more}."
        )


def versions_and_machine(packages: Iterable[str]) -> dict[str, dict[str, str]]:
    """`versions` of Python and of packages, and `machine`, as records of a run name them."""
    return {
        "versions": {
            "python": sys.version.split()[0],
            **{name: version(name) for name in packages},
        },
        "machine": {
            "system": platform.platform(),
            "processor": platform.machine(),
            "node": platform.node(),
        },
    }


def builds_of(settings: EvaluationSettings, source: Path) -> Mapping[str, str]:
    """Build by ADS; without ADSs that ship and ADSs whose build is unknown."""
    own = [ads for ads in settings.ads if ads.build or ":" in ads.controller]
    commit = commit_of(source) if any(not ads.build for ads in own) else ""
    return {ads.name: ads.build or commit for ads in own if ads.build or commit}


def manifest_of_shards(shards: Iterable[Path]) -> Manifest:
    """Part of a merged run's manifest on its drives: the manifest of the shard that began first,
    with the builds of all shards.
    """
    manifests = [*map(read_manifest, shards)]
    # a manifest of an earlier version has no builds
    builds = grouped(pair for manifest in manifests for pair in manifest.get("builds", {}).items())
    return {
        **min(manifests, key=itemgetter("created")),
        "builds": {ads: ", ".join(dict.fromkeys(of_ads)) for ads, of_ads in builds.items()},
    }


def commit_of(folder: Path) -> str:
    """`3db9796abcde`, or `3db9796abcde-dirty` with changes that are not committed; "" without a
    commit.
    """
    command = [
        "git",
        "-C",
        str(folder),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=12",
        "--exclude=*",  # no tags: always the commit
    ]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_GIT_PATIENCE, check=False
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
