"""Output folder of a command: tried before the work begins, which could not be kept otherwise."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from sumo_eval.errors import InputError


def default(*words: str) -> Path:
    """The folder where `--out` names none: results/WORDS-TIME, as a run's."""
    from datetime import UTC, datetime

    name = "-".join(re.sub(r"[^\w.-]+", "_", word).strip("_") or "of" for word in words)
    return Path("results") / f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"


def ready(folder: Path) -> None:
    """Make the folder and write into it.

    Raises InputError where that cannot be done.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"The folder {folder} of `--out` cannot be written: {error.strerror or error}."
        ) from None
