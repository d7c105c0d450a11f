"""JSON files of a run folder that carry a hash of their own content, by which an edited or damaged
file is noticed. For `record.run_folder`.

The hash shows a careless edit, a flipped bit and a file that was cut off. It does not show a
forgery: a program that can write the file can also write a hash that fits.

Users: `record/facts_file.py`, `record/run_folder.py`.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.input_file import read_input, sha256, taking_apart
from sumo_eval.text import shown

SEAL = "seal"
FIX = "Take the file from a copy of the run, or run the evaluation again into a new folder."


def sealed(content: Mapping[str, Any]) -> str:
    """The text of a file with this content and its hash, the last entry."""
    # a scenario in `content` may have the name `seal`: then the hash is under `seal~`
    name = f"{SEAL}~" if SEAL in content else SEAL
    return json.dumps({**content, name: _hash(content)}, indent=2) + "\n"


def read_sealed(path: Path, version: int | None = None) -> dict[str, Any]:
    """The content of a file that `sealed` wrote, without its hash.

    Raises InputError for a file that has changed since it was written.

    version: its `format_version`, where it has one; another version may have another seal.
    """
    text = read_input(path, path.stem)
    with taking_apart(path, FIX):
        content: dict[str, Any] = json.loads(text)
    whole = isinstance(content, dict) and content
    if whole and version is not None and content.get("format_version") != version:
        raise InputError(
            f"Run {path.parent} has format version {shown(content.get('format_version'))}; this "
            f"sumo_eval reads {version}."
        )
    # the hash is the last entry
    if not whole or content.popitem()[1] != _hash(content):
        raise InputError(
            f"{path} is not as it was written: its content does not fit its `{SEAL}`. {FIX}"
        )
    return content


def _hash(content: Mapping[str, Any]) -> str:
    return sha256(json.dumps(content, sort_keys=True))
