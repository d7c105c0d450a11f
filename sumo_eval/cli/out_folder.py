"""Output folder of a command: tried before the work, whose result would be lost otherwise.

Users: `cli/run.py`, `cli/space.py`, `extras/rates/command.py`,
`extras/studies/boundary_command.py`, `extras/studies/qualify_command.py`.
"""

import re
import tempfile
from pathlib import Path

from sumo_eval.errors import InputError


def default(*words: str) -> Path:
    """The folder without `--out`: results/WORDS-TIME, in UTC."""
    from datetime import UTC, datetime

    # a word of symbols alone becomes "of": the name keeps its parts
    name = "-".join(re.sub(r"[^\w.-]+", "_", word).strip("_") or "of" for word in words)
    return Path("results") / f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"


def ready(folder: Path) -> None:
    """Make the folder; raises InputError unless a file can be written in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"The folder {folder} of `--out` cannot be written: {error.strerror or error}."
        ) from None
