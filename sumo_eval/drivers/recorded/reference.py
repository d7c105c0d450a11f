"""The human reference from recordings: drives in events like a concrete scenario, aligned to its
start.

Users: `cli/tools.py`, `drivers/recorded/exposure.py`, `extras/rates/people_command.py`,
`record/recording.py`.
"""

import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pandas import DataFrame, Index, isna

from sumo_eval.drivers.recorded.events import Events, extract_events
from sumo_eval.drivers.recorded.importers.tables import (
    DRIVER,
    TRACK,
    check_motion,
    make_numbers,
    read_table,
    unread,
)
from sumo_eval.drivers.recorded.importing import OWN, import_recordings
from sumo_eval.drivers.recorded.recordings import Recordings
from sumo_eval.errors import InputError, check_known
from sumo_eval.input_file import changed_at
from sumo_eval.method.driving_task import off_road
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import Counterpart
from sumo_eval.scenario.road.reference_line import Line, map_places
from sumo_eval.settings import DriverSettings
from sumo_eval.trajectory import Trajectory

# in a folder of the user's own drives: which file was driven in which concrete scenario
NAMED_CASES = "cases.csv"
_NAMES = "scenario", "file"  # its columns of text
_LEAST_SPACING = 1.0  # m between the lanes 0 and 1; less is no lane
_STANDS = 0.1  # m/s; a vehicle slower than this stands
_SAME_TIME = 1e-6  # s; a smaller difference of two times is rounding
_PLACES = "t", "x", "y"
_MOTION = "heading", "speed", "acceleration"  # channels of a drive that a table may lack
_KNOWN = *_MOTION, "steering"


class People(NamedTuple):
    """Sources of a reference: recorded driving, its events, and drives that the user recorded in
    named cases.

    tracks: by (recording, vehicle).
    centres: y of a lane's middle, m, by (recording, lane).
    named, folder: the user's table of cases, and where its files are.
    """

    recordings: Recordings | None = None
    events: Events | None = None
    tracks: Mapping[tuple[str, str], DataFrame] = {}
    centres: Mapping[tuple[str, int], float] = {}
    named: DataFrame | None = None
    folder: Path = Path()


class Reference(NamedTuple):
    """Drives in one concrete scenario.

    names: of the drivers, one a drive.
    left_out: of each drive that covers too little of the road, the share that it covers; inf for
        each that leaves the road.
    """

    drives: tuple[Trajectory, ...] = ()
    names: tuple[str, ...] = ()
    left_out: tuple[float, ...] = ()


def open_people(settings: DriverSettings, source: Path) -> People:
    """The recorded people that the settings name, paths relative to `source`.

    Raises InputError where there are none.
    """
    if not settings.recordings and not settings.cases:
        raise InputError(
            "`drivers.recordings` or `drivers.cases` must name what was recorded, got neither."
        )
    paths = tuple((source / name).absolute() for name in settings.recordings)
    people = _recorded(paths, tuple(map(changed_at, paths))) if paths else People()
    if not settings.cases:
        return people
    folder = source / settings.cases
    # as text: a file called 007 is not 7
    named = read_table(folder / NAMED_CASES, _NAMES, dtype=dict.fromkeys(_NAMES, str))
    return people._replace(named=named, folder=folder)


@functools.lru_cache(maxsize=4)
def _recorded(paths: tuple[Path, ...], changed: tuple[int, ...]) -> People:
    """Recordings, their events and tracks: read once for the reference and the exposure.

    changed: times of the files' last changes, so that changed files are read again.
    """
    recordings = import_recordings(OWN, paths)
    table = recordings.table
    tracks: Any = dict(iter(table.groupby(TRACK)))
    centres: Any = table.groupby(["recording", "lane"])["y"].median().to_dict()
    return People(recordings, extract_events(recordings), tracks, centres)


def notes_of(people: People, parameters: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Sentences on what was left out, assumed or not read.

    parameters: of each scenario of the evaluation, by its name.
    """
    notes = [*people.recordings.notes] if people.recordings else []
    named = people.named
    if named is not None:
        cases = people.folder / NAMED_CASES
        known = [*_NAMES, *itertools.chain(*parameters.values())]
        notes += unread("Column", named, known, cases)
        notes += unread("Scenario", named["scenario"].unique(), [*parameters], cases)
        for file in named["file"][named["scenario"].isin(parameters)].unique():
            path = people.folder / file
            table = _table_of(path, changed_at(path))
            notes += unread("Column", table, (*_PLACES, *_KNOWN, "driver"), path)
    return tuple(notes)


def reference(
    concrete: ConcreteScenario,
    people: People,
    settings: DriverSettings,
    recorded: Counterpart | None,
) -> Reference:
    """All drives recorded in a concrete scenario: named drives as they are, else events like it,
    nearest first.

    An event counts when each parameter is within its tolerance, when its recording covers
    `settings.coverage` of the road or ends in standstill, and when the drive fits on the road: a
    recorded motorway may have had more lanes, or an exit. A driver counts once. Positions begin at
    the ego's start; lateral ones are stretched from the recorded lanes' width to the scenario's.

    recorded: the events that correspond to the scenario; None: unknown.

    Raises InputError for a column `start` without times of the ego's track.
    """
    named = _named_drives(concrete, people)
    if named is not None:
        return named
    if people.events is None or recorded is None:
        return Reference()
    events = matching_events(people.events, concrete.scenario, recorded)
    own = settings.tolerance or {}
    tolerance = {name: own.get(name, within) for name, within in recorded.tolerance}
    route = concrete.road.length - concrete.ego.x
    drives = {}
    left_out = []
    for event in _nearest(events, concrete.values, tolerance).itertuples():
        track = people.tracks[str(event.recording), str(event.ego)]
        name = track["driver"].iloc[0] or f"{event.recording}/{event.ego}"
        if name in drives:
            continue
        first, last = track["t"].iloc[[0, -1]]
        if not first - _SAME_TIME <= event.start <= last + _SAME_TIME:
            raise InputError(
                f"The `start` column in [recorded] of scenario `{concrete.scenario}` must hold "
                f"times within the ego's track, {first:g}..{last:g} s in recording "
                f"`{event.recording}`, got `{recorded.start}` with {event.start:g}."
            )
        drive = _aligned(track, event.start, concrete, people)  # type: ignore[arg-type]
        ahead = drive.x.max() - concrete.ego.x
        covers = drive.speed[-1] < _STANDS or ahead >= settings.coverage * route
        if len(drive) < 2 or not covers:
            left_out.append(ahead / route)
        elif off_road(drive.x, drive.y, concrete.road, 0.0).any():
            left_out.append(math.inf)
        else:
            drives[name] = drive
    return Reference(tuple(drives.values()), tuple(drives), tuple(left_out))


def matching_events(events: Events, scenario: str, recorded: Counterpart) -> DataFrame:
    """The complete events that correspond to a scenario, with a column for each parameter, under
    its name.

    scenario: its name, for errors.

    Raises InputError for a column that its events do not have, or that holds no numbers.
    """
    table = events.tables[recorded.event]
    columns = dict(recorded.columns)
    if len(table):  # without events it has none of these columns
        owner = f"column of `{recorded.event}` events in [recorded] of scenario `{scenario}`:"
        check_known(
            owner, list(map(str, table)), *columns.values(), recorded.start, *dict(recorded.only)
        )
        for column, value in recorded.only:
            table = table[table[column].astype(str) == value]
    columns = {"start": recorded.start, **columns}
    names = ["event", "recording", "ego"]
    chosen = table.reindex(columns=[*names, *columns.values()])
    chosen.columns = Index([*names, *columns])
    try:
        return chosen.astype(dict.fromkeys(columns, float)).dropna().reset_index(drop=True)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"[recorded] of scenario `{scenario}` must name columns of numbers: {error}."
        ) from error


def _nearest(
    events: DataFrame, values: Mapping[str, float], tolerance: Mapping[str, float]
) -> DataFrame:
    """Events whose parameters are within all tolerances of these values, the nearest first."""
    wanted = [values[name] for name in tolerance]
    away = ((events[list(tolerance)] - wanted).abs() / list(tolerance.values())).to_numpy()
    near = np.flatnonzero(np.all(away <= 1.0, axis=1))
    return events.iloc[near[np.argsort(np.linalg.norm(away[near], axis=1), kind="stable")]]


def _aligned(
    track: DataFrame, start: float, concrete: ConcreteScenario, people: People
) -> Trajectory:
    """A track from `start` s on, moved to where the ego starts, up to its first sample past the
    road's end.
    """
    rows = track[track["t"] >= start - _SAME_TIME]
    x = rows["x"] - rows["x"].iloc[0] + concrete.ego.x
    # a sample belongs to the drive while all samples before it are on the road
    on_road = x.cummax().shift(fill_value=-np.inf) < concrete.road.length
    recording = rows["recording"].iloc[0]
    lane = rows["lane"].iloc[0]
    centre = people.centres[recording, lane]
    right, left = (people.centres.get((recording, number), np.nan) for number in (0, 1))
    spacing = left - right  # of lanes 0 and 1; all lanes of a road are alike
    # a lane without a neighbour has spacing nan: it is as wide as the scenario's
    stretch = concrete.road.lane_width / spacing if spacing >= _LEAST_SPACING else 1.0
    y = concrete.ego.y + stretch * (rows["y"] - centre)
    moved = rows.assign(t=rows["t"] - rows["t"].iloc[0], x=x, y=y)
    body = {name: float(rows[name].iloc[0]) for name in ("length", "width")}
    return _trajectory(moved[on_road], **body)


def _trajectory(rows: DataFrame, **body: float) -> Trajectory:
    """A track as a trajectory, with those of its channels that are known.

    body: its length and width, m.
    """
    channels: Any = dict(rows.filter(_MOTION))
    wheel = rows.get("steering")
    return Trajectory(
        rows["t"], rows["x"], rows["y"], **channels, steering_wheel_angle=wheel, **body
    )


def _named_drives(concrete: ConcreteScenario, people: People) -> Reference | None:
    """The drives that were recorded in just this concrete scenario; None where the user names
    none.
    """
    if people.named is None:
        return None
    rows = people.named[people.named["scenario"] == concrete.scenario].copy()
    if rows.empty:
        return None
    path = people.folder / NAMED_CASES
    parameters = list(concrete.values)
    check_known(f"parameter column of {path}", [*map(str, rows)], *parameters)
    make_numbers(rows, parameters, path)
    matching = rows[((rows[parameters] - [*concrete.values.values()]).abs() < 1e-6).all(axis=1)]
    if matching.empty:
        return None
    named = [
        drive
        for file in matching["file"]
        for drive in _drives_in(people.folder / file, concrete.road.line)
    ]
    names, drives = zip(*named, strict=True)
    return Reference(drives, names)


@functools.lru_cache(maxsize=256)
def _table_of(path: Path, changed: int) -> DataFrame:
    """A file of drives, read once for the notes and the drives; changed: as in `_recorded`."""
    table = read_table(path, _PLACES, dtype=DRIVER)
    make_numbers(table, [*_PLACES, *table.filter(_KNOWN)], path, gaps=["steering"])
    return table


def _drives_in(path: Path, line: Line) -> Iterator[tuple[str, Trajectory]]:
    """The drives of a file with columns t, x, y (road coordinates of the scenario) and what else is
    known, by driver.

    line: of a curved road; an unknown speed is then that on its map.
    """
    table = _table_of(path, changed_at(path))
    table = table.assign(driver=table.get("driver"))  # without such a column no driver is named
    for name, rows in table.groupby("driver", sort=False, dropna=False):
        driver = path.stem if isna(name) else str(name)
        try:
            if len(rows) < 2:
                raise InputError("a drive must have at least two samples, got one.")
            drive = _trajectory(rows)  # refuses times that do not grow; `check_motion` needs that
            check_motion(rows.assign(recording=path.name, vehicle=driver))
            if line and "speed" not in rows:
                on_map = Trajectory(rows["t"], *map_places(line, rows["x"], rows["y"])[:2])
                drive = _trajectory(rows.assign(speed=on_map.speed))
            yield driver, drive
        except InputError as error:
            raise InputError(f"Driver `{driver}` in {path}: {error}") from error
