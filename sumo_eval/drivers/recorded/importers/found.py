"""Result of an importer: samples as the source has them, in SI units, centres, y to the left."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from sumo_eval.errors import InputError


@dataclass(frozen=True, slots=True, eq=False)
class ImportedSamples:
    """Samples of one source at its own rate.

    planar: x, y and heading are those of a map (counter-clockwise) and have to be straightened;
        else they are road coordinates with lanes already.
    notes: whole sentences on what was assumed.
    """

    table: pd.DataFrame
    planar: bool = False
    notes: tuple[str, ...] = ()


def files_in(path: Path, *patterns: str) -> list[Path]:
    """The file itself, or the files of a folder that match, by name; a sentence where there is
    none.
    """
    if not path.exists():
        raise InputError(f"There is no file or folder {path}.")
    if not path.is_dir():
        return [path]
    files = sorted({file for pattern in patterns for file in path.glob(pattern)})
    if not files:
        raise InputError(f"Folder {path} must hold files called {', '.join(patterns)}, got none.")
    return files
