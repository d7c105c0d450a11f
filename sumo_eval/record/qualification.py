"""The tool qualification that a run names: read before the run simulates, kept in its manifest.

Users: `cli/tools.py`, `record/facts.py`, `record/run_folder.py`.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.input_file import read_input, sha256, taking_apart

_LARGEST = 10_000_000  # bytes of a file


def read_qualification(named: str, source: Path) -> dict[str, Any]:
    """Entry of a run's manifest for a `qualification.json`: its hash, when and on which machine it
    was made, the number of checks, and the checks that failed.

    named: the file, or its folder, as the evaluation has it.
    source: folder that `named` is relative to.
    Raises InputError for anything but a qualification.
    """
    path = source / named
    if path.is_dir():
        path = path / "qualification.json"
    text = read_input(path, "qualification", _LARGEST)
    with taking_apart(path, "It is not what `sumo-eval qualify` writes: qualification.json."):
        content = json.loads(text)
        checks = [(str(it["name"]), it["passed"] is True) for it in content["checks"]]
        entry = {
            "file": str(path.resolve()),
            "sha256": sha256(text),
            "created": str(content["created"]),
            "checks": len(checks),
            "failed": [name for name, passed in checks if not passed],
            "versions": _texts(content["versions"]),
            "machine": _texts(content["machine"]),
        }
    if not checks:
        raise InputError(
            f"The qualification {path}, which `qualification` of [run] names, holds no checks."
        )
    return entry


def _texts(table: Mapping[str, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in table.items()}
