"""Import of recordings, for `sumo-eval humans import` and `learn`: files of any known format become
one canonical table.

Users: `drivers/recorded/reference.py`, `extras/rates/command.py`, `extras/rates/people_command.py`.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

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
from sumo_eval.drivers.recorded.importers.tables import TRACK, Samples, files_in
from sumo_eval.drivers.recorded.recordings import MOTOR_CLASSES, Recordings, canonical, read_csv
from sumo_eval.drivers.recorded.straighten import straighten
from sumo_eval.errors import InputError, check_known, doubled

READERS: dict[str, tuple[Callable[[Path], Samples], Sequence[str]]] = {
    "highd": (highd.read, ("*_tracks.csv",)),
    **dict.fromkeys(("ind", "exid", "round", "unid"), (levelx.read, ("*_tracks.csv",))),
    "ngsim": (ngsim.read, ("*.csv", "*.txt")),
    "commonroad": (commonroad.read, ("*.xml",)),
    "sumo_fcd": (sumo_fcd.read, ("*.xml", "*.csv", "*.gz")),
    "openacc": (openacc.read, ("*.csv",)),
    "dlr_highway": (dlr_highway.read, ("trajectories_*.csv",)),
    "osi": (osi.read, [f"*{ending}" for ending in osi.ENDINGS]),
    "map": (map_table.read, ("*.csv*",)),  # also compressed, as .csv.gz
}
"""Foreign formats by their name on the command line: (reader of one file, glob patterns of such
files in a folder)."""

OWN = "csv"  # name of the format of canonical tables
FORMATS = (*READERS, OWN)


def import_recordings(form: str, paths: Sequence[Path]) -> Recordings:
    """Read files or folders of one format into one table.

    Raises InputError at the first mistake: all files are read, or none.
    """
    parts = list(each_of(form, paths))
    names = [name for part in parts for name in part.table["recording"].unique()]
    if double := doubled(names):
        raise InputError(f"Recordings must have different names, got {double[0]!r} twice.")
    table = pd.concat([part.table for part in parts], ignore_index=True)
    tracks = table.drop_duplicates(TRACK, keep="last")  # last sample of each
    kinds = tracks["class"]
    known = sorted((*MOTOR_CLASSES, "bicycle", "pedestrian"))
    unknown_classes = kinds[~kinds.isin(known)].value_counts()
    notes = [note for part in parts for note in part.notes]
    notes += [
        f"{count} vehicles have the class `{kind}`, which is not known: they are in no event. "
        f"Known: {', '.join(known)}."
        for kind, count in unknown_classes.items()
    ]
    again = tracks.duplicated(["vehicle", "t", "x", "y", "speed"]).sum()
    if again:
        notes.append(
            f"{again} tracks end like one of the same name in another recording. Drivers, rates "
            "and intervals count each: import every drive once."
        )
    return Recordings(table, tuple(dict.fromkeys(notes)))


def each_of(form: str, paths: Sequence[Path]) -> Iterator[Recordings]:
    """The recordings in files or folders of one format, one file at a time, so that memory holds
    only one.

    Raises InputError at the call for an unknown format, no path or a folder of canonical tables.
    A missing path, a folder without such files or a mistake in a file raises it when reached.
    """
    check_known("format of recordings", FORMATS, form)
    if not paths:
        raise InputError("At least one file or folder of recordings must be given, got none.")
    if form == OWN:
        for path in paths:
            if path.is_dir():
                raise InputError(
                    f"{path} is a folder. Of the format `{OWN}`, name every table that `sumo-eval "
                    f"humans import` wrote; other formats are {', '.join(READERS)}."
                )
        return (read_csv(path) for path in paths)
    read, patterns = READERS[form]
    return (_canonical(file, *read(file)) for path in paths for file in files_in(path, *patterns))


def _canonical(path: Path, table: pd.DataFrame, notes: list[str]) -> Recordings:
    """The canonical table of a file; without a column `lane` it is on a map, and is straightened
    first.
    """
    try:
        if "lane" not in table:
            table, more_notes = straighten(table)
            notes += more_notes
        return canonical(table, notes)
    except InputError as error:
        raise InputError(" ".join((f"{path}: {error}", *notes))) from None
