"""From files of any known format to one canonical table of recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import pandas as pd

from sumo_eval.drivers.recorded.importers import (
    commonroad,
    dlr_highway,
    highd,
    levelx,
    map_table,
    ngsim,
    openacc,
    osi,
    sumo_fcd,
)
from sumo_eval.drivers.recorded.importers.found import ImportedSamples, files_in
from sumo_eval.drivers.recorded.recordings import Recordings, canonical, read_csv
from sumo_eval.drivers.recorded.straighten import straighten
from sumo_eval.errors import InputError, unknown

Reader = tuple[Callable[[Path], Iterator[ImportedSamples]], Sequence[str]]
_LEVELX: Final[Reader] = levelx.read, ("*_tracks.csv",)

READERS: Final[dict[str, Reader]] = {
    "highd": (highd.read, ("*_tracks.csv",)),
    "ind": _LEVELX,
    "exid": _LEVELX,
    "round": _LEVELX,
    "unid": _LEVELX,
    "ngsim": (ngsim.read, ("*.[ct][sx][vt]",)),
    "commonroad": (commonroad.read, ("*.xml",)),
    "sumo_fcd": (sumo_fcd.read, ("*.[xc][ms][lv]",)),
    "openacc": (openacc.read, ("*.csv",)),
    "dlr_highway": (dlr_highway.read, ("trajectories_*.csv",)),
    "osi": (osi.read, [f"*{ending}" for ending in osi.ENDINGS]),
    "map": (map_table.read, ("*.csv*",)),
}
"""Formats that other people write, by the name they have on the command line: reader of a file,
files of a folder."""

OWN: Final = "csv"  # the canonical table itself
FORMATS: Final = (*READERS, OWN)


def import_recordings(form: str, paths: Sequence[Path]) -> Recordings:
    """Read files or folders of one format into one table.

    All of them or none: the first mistake is an InputError.
    """
    parts = list(each_of(form, paths))
    names = [name for part in parts for name in part.table["recording"].unique()]
    double = {name for name in names if names.count(name) > 1}
    if double:
        raise InputError(f"Recordings must have different names, got {sorted(double)[0]!r} twice.")
    table = pd.concat([part.table for part in parts], ignore_index=True)
    notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
    return Recordings(table, notes)


def each_of(form: str, paths: Sequence[Path]) -> Iterator[Recordings]:
    """The recordings in files or folders of one format, one file after the other: who wants them
    one at a time holds no other. The first mistake that is come to is an InputError.
    """
    if form not in FORMATS:
        raise unknown("format of recordings", form, FORMATS)
    if not paths:
        raise InputError("At least one file or folder of recordings must be given, got none.")
    if form == OWN:
        for path in paths:
            if path.is_dir():
                raise InputError(
                    f"{path} is a folder. Of the format `{OWN}`, name every table that `sumo-eval "
                    "humans import` "
                    f"wrote; other formats are {', '.join(READERS)}."
                )
        return (read_csv(path) for path in paths)
    read, patterns = READERS[form]
    files = (file for path in paths for file in files_in(path, *patterns))
    return (_canonical(found) for file in files for found in read(file))


def _canonical(found: ImportedSamples) -> Recordings:
    if found.planar:
        table, notes = straighten(found.table)
        found = replace(found, table=table, notes=(*found.notes, *notes))
    return canonical(found.table, found.notes)
