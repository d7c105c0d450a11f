"""Tables of numbers that users write: a CSV file with a column for each parameter.

`joint.events` of a scenario file and `sampling.file` of an evaluation name such files, so the
format is public.

Users: `scenario/file_tables.py`, `scenario/sampling/listed_points.py`.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import InputError, did_you_mean, doubled, must_be
from sumo_eval.input_file import input_file
from sumo_eval.scenario.units import factor_to, in_own_unit
from sumo_eval.text import from_cell, number_in, shown
from sumo_eval.trajectory import FloatArray

# title of a column with a unit: `ego_speed (km/h)` or `ego_speed [km/h]`; groups: name, unit
_WITH_UNIT = re.compile(r"([\w.]+)\s*[(\[]([^()\[\]]*)[)\]]")
_TOO_LARGE = 1e100  # numbers from here on are refused: the squares of larger ones are infinite


class NumberTable(NamedTuple):
    """Numbers of a file.

    rows: (n, k), a column for each requested name, in its requested unit.
    ignored: names of the columns that were not read.
    converted: titles of the columns that were read from another unit.
    """

    rows: FloatArray
    ignored: list[str]
    converted: list[str]


def read_numbers(path: Path, what: str, units: Mapping[str, str], further: str = "") -> NumberTable:
    """Read some columns of a CSV file, which must have a row at least.

    what: noun for the rows in errors, as `points`.
    units: unit of each column that the file must have, by name.
    further: name of a column that is read too if the file has it; it has no unit. "": none.
    """
    owner = f"the {what} {path}"
    head, *lines = _lines(path, what)
    # tables that this package writes have a quote before what a spreadsheet would execute
    titles = [from_cell(title.strip()) for title in head.cells]
    columns = [_column(title, units, owner) for title in titles]
    names = [column.name for column in columns]
    if missing := [name for name in units if name not in names]:
        column = "a column" if len(missing) == 1 else "the columns"
        listed = ", ".join(f"`{name}`" for name in missing)
        near = did_you_mean(missing[0], names)
        raise InputError(f"The {what} {path} must have {column} {listed}.{near}")
    if not lines:
        raise InputError(f"The {what} {path} must have at least one row.")
    if double := doubled(names):
        raise InputError(
            f"The {what} {path} must have every column once, got {shown(double[0])} twice."
        )
    wanted = list(units)
    # pandas writes its index as a column whose title is ""; so is `further` if it is not given
    if further and further in names and further not in units:
        wanted.append(further)
    read = [columns[names.index(name)] for name in wanted]
    table = [_values(line, names, read, owner) for line in lines]
    ignored = [name for name in names if name not in wanted]
    converted = [
        title for title, column in zip(titles, columns, strict=True) if column.factor != 1.0
    ]
    return NumberTable(np.array(table), ignored, converted)


class _Line(NamedTuple):
    """A line of a CSV file: its number, from 1, and its cells."""

    number: int
    cells: list[str]


class _Column(NamedTuple):
    """A column: its name, and the factor from its numbers to the requested unit."""

    name: str
    factor: float


def _lines(path: Path, what: str) -> list[_Line]:
    """The lines that are not empty; of an empty file one line without cells."""
    try:
        with input_file(path, f"file of {what}").open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            return [_Line(reader.line_num, row) for row in reader if row] or [_Line(0, [])]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"The {what} {path} cannot be read: {error}.") from error


def _column(title: str, units: Mapping[str, str], owner: str) -> _Column:
    """The column of a title, which may name a unit if the column is requested."""
    match = _WITH_UNIT.fullmatch(title)
    if not match or match[1] not in units:
        return _Column(title, 1.0)
    name, unit = match.groups()
    return _Column(name, factor_to(units[name], unit, f"column {shown(title)} of {owner}"))


def _values(line: _Line, names: Sequence[str], read: Sequence[_Column], owner: str) -> list[float]:
    """The numbers in some cells of a line, in the requested units.

    names: of all columns. read: the columns to read.
    """
    if len(line.cells) > len(names):
        raise InputError(f"Line {line.number} of {owner} must have {len(names)} values, got more.")
    cells = dict(zip(names, line.cells, strict=False))  # a short line lacks its last cells
    values = []
    for name, factor in read:
        value = number_in(cells.get(name))
        if not abs(value) < _TOO_LARGE:  # true of nan, too
            place = f"`{name}` in line {line.number}"
            raise must_be(place, owner, "a number below 1e100 in size", cells.get(name))
        values.append(in_own_unit(value, factor))
    return values
