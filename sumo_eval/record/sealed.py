"""JSON files of a run folder that carry a hash of their own content, so that one that was edited or
damaged is found.

A program that can write such a file can also write a hash that fits: what is found is a slip, a
flipped bit, a cut file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError

SEAL = "seal"


def sealed(content: Mapping[str, Any], *, indent: int | None = None) -> str:
    """The text of a file with this content, and the hash of it as its last entry, `seal`."""
    # a scenario may have that name
    name = SEAL + "~" * (SEAL in content)
    return json.dumps({**content, name: _hash(content)}, indent=indent) + "\n"


def read_sealed(
    path: Path, mend: str, *, first: Callable[[Mapping[str, Any]], object] = lambda content: None
) -> dict[str, Any]:
    """The content of a file that `sealed` made the text of. OSError where there is none.

    Raises InputError for one that is not as it was written; `mend` says what may be done then.

    first: is shown the content before the hash is compared, and may refuse it for a better reason.
    """
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path} cannot be read, it was changed or damaged: {error}. {mend}"
        ) from error
    if isinstance(content, dict):
        first(content)
    if not isinstance(content, dict) or not content or content.popitem()[1] != _hash(content):
        raise InputError(
            f"{path} is not as it was written: its content does not fit its `{SEAL}`. {mend}"
        )
    return content


def _hash(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
