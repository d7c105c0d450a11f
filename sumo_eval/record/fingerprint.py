"""Keys of cached scores, zones and pages: hashes of all that these depend on, which are recorded
facts, settings, sources of this package, and files that users name. (The fingerprint of a drive is
in `record/identity.py`.)

Users: `evaluation.py`, `record/human_reference.py`, `report/assessed.py`,
`scoring/drive_results.py`, `scoring/zones.py`.
"""

import hashlib
import os
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import Any

from sumo_eval.case_table import COLUMNS
from sumo_eval.record.kept_results import key_of
from sumo_eval.record.scenario_files import files_of
from sumo_eval.scenario.catalogue import options_of
from sumo_eval.scenario.formats import GROUP
from sumo_eval.settings import EvaluationSettings, ScenarioSettings

_PACKAGE = Path(__file__).parent.parent
# rooms and files of this package that scores depend on
_ROOMS = "drivers", "method", "record", "scenario", "scoring", "settings"
_FILES = (
    "case_table.py", "cases.py", "coded.py", "evaluation.py", "groups.py", "kernels.py",
    "results.py", "score_notes.py", "trajectory.py"
)  # fmt: skip
_READERS = "extras/openscenario"  # makes scenarios of files, as the room `scenario` does
_LIBRARIES = "numpy", "scipy", "numba"  # whose version may change a score


@cache
def sources(*rooms: str) -> str:
    """A hash of the files of this package that scores come from: of some rooms, or of all
    `_ROOMS`, and always of `_FILES` and `_READERS`.

    It includes the versions of the libraries that compute, and of the packages that read scenarios.
    """
    files = [
        file
        for room in (*(rooms or _ROOMS), _READERS)
        for ending in ("*.py", "*.toml", "*.j2", "*.js", "*.css")
        for file in (_PACKAGE / room).rglob(ending)
    ]
    files += [_PACKAGE / name for name in _FILES]
    readers = [
        (reader.value, reader.dist and reader.dist.version) for reader in entry_points(group=GROUP)
    ]
    digest = hashlib.blake2b(repr(([version(name) for name in _LIBRARIES], readers)).encode())
    for file in sorted(files):
        digest.update(str(file.relative_to(_PACKAGE)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def scores_key(
    settings: EvaluationSettings,
    content: str,
    source: Path,
    severity: str,
    exposures: Mapping[str, Any],
) -> bytes:
    """Key under which the scores of a run are kept.

    content: hash of its facts.
    source: folder of the evaluation, where relative paths start.
    severity: hash of a user's function of severity.
    exposures: notes on the exposure of each scenario.
    """
    named = [space_key(entry, source) for entry in settings.scenario]
    chosen = tuple(
        getattr(settings, part)
        for part in ("scenario", "ads", "seed", "drivers", "simulation", "method")
    )
    # COLUMNS, a value of the running code, is also in the key: a process that was started before an
    # update would otherwise write rows in its old form under the key of the new files
    return key_of("scores", COLUMNS, content, chosen, named, severity, exposures, sources())


def space_key(entry: ScenarioSettings, source: Path) -> bytes:
    """A hash of the files that a user's scenario and its sample come from. A shipped scenario has
    none: `sources` covers it.
    """
    named = options_of(entry.use)[0], entry.sampling.method, entry.sampling.file
    files = [file for locator in named if locator for file in files_of(locator, source)]
    # a missing file: random bytes, so that the key equals no other
    return key_of([(it, it.read_bytes() if it.is_file() else os.urandom(16)) for it in files])
