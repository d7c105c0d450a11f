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
from sumo_eval.drivers.recorded.importers.found import Found
from sumo_eval.drivers.recorded.recordings import Recordings, canonical, read_csv
from sumo_eval.drivers.recorded.straighten import straighten
from sumo_eval.errors import InputError, unknown

READERS: Final[dict[str, Callable[[Path], Iterator[Found]]]] = {
    "highd": highd.read,
    "ind": levelx.read,
    "exid": levelx.read,
    "round": levelx.read,
    "unid": levelx.read,
    "ngsim": ngsim.read,
    "commonroad": commonroad.read,
    "sumo_fcd": sumo_fcd.read,
    "openacc": openacc.read,
    "dlr_highway": dlr_highway.read,
    "osi": osi.read,
    "map": map_table.read,
}
"""Formats that other people write, by the name they have on the command line."""

OWN: Final = "csv"  # the canonical table itself
FORMATS: Final = (*READERS, OWN)


def import_recordings(form: str, paths: Sequence[Path]) -> Recordings:
    """Read files or folders of one format into one table. All of them or none: the first mistake is an InputError."""
    parts = list(each_of(form, paths))
    names = [name for part in parts for name in part.table["recording"].unique()]
    double = {name for name in names if names.count(name) > 1}
    if double:
        raise InputError(f"Recordings must have different names, got {sorted(double)[0]!r} twice.")
    table = pd.concat([part.table for part in parts], ignore_index=True)
    notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
    return Recordings(table, notes)


def each_of(form: str, paths: Sequence[Path]) -> Iterator[Recordings]:
    """The recordings in files or folders of one format, one file after the other: who wants them one at a time holds no
    other. The first mistake that is come to is an InputError.
    """
    if form not in FORMATS:
        raise unknown("format of recordings", form, FORMATS)
    if not paths:
        raise InputError("At least one file or folder of recordings must be given, got none.")
    if form == OWN:
        for path in paths:
            if path.is_dir():
                raise InputError(
                    f"{path} is a folder. Of the format `{OWN}`, name every table that `sumo-eval humans import` "
                    f"wrote; other formats are {', '.join(READERS)}."
                )
        return (read_csv(path) for path in paths)
    return (_canonical(found) for path in paths for found in READERS[form](path))


def _canonical(found: Found) -> Recordings:
    if found.planar:
        table, notes = straighten(found.table)
        found = replace(found, table=table, notes=(*found.notes, *notes))
    return canonical(found.table, found.notes)
