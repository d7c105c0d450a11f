"""Tables of numbers that users write: a CSV file with a column for each parameter.

`joint.events` of a scenario file and `sampling.file` read theirs here.

Users: `scenario/file_tables.py`, `scenario/sampling/listed_points.py`.
"""

import csv
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import InputError, did_you_mean, must_be
from sumo_eval.input_file import input_file
from sumo_eval.scenario.units import factor_to, in_own_unit
from sumo_eval.text import from_cell, number_in, shown
from sumo_eval.trajectory import FloatArray

# a column's name and unit: `ego_speed (km/h)`
_WITH_UNIT = re.compile(r"(\w+)\s*[(\[]([^()\[\]]*)[)\]]")


class NumberTable(NamedTuple):
    """Numbers of a file.

    rows: (n, k), a column for each name asked for, in the units asked for.
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
    further: name of a column that is read too where the file has it; it has no unit.
    """
    owner = f"the {what} {path}"
    try:
        with input_file(path, f"file of {what}").open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            # (number of the line, its cells) of each line that is not empty, the head first
            (_, head), *lines = [(reader.line_num, row) for row in reader if row] or [(0, [])]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"The {what} {path} cannot be read: {error}.") from error
    # written tables have a quote before what a spreadsheet would execute
    titles = [from_cell(title.strip()) for title in head]
    header = []
    factors = {}
    for title in titles:
        name = title
        factor = 1.0
        match = _WITH_UNIT.fullmatch(title)
        if match and match[1] in units:
            name = match[1]
            factor = factor_to(units[name], match[2], f"column {shown(title)} of {owner}")
        header.append(name)
        factors[name] = factor
    if missing := [name for name in units if name not in header]:
        column = "a column" if len(missing) == 1 else "the columns"
        listed = ", ".join(f"`{name}`" for name in missing)
        near = did_you_mean(missing[0], header)
        raise InputError(f"The {what} {path} must have {column} {listed}.{near}")
    if not lines:
        raise InputError(f"The {what} {path} must have at least one row.")
    if double := [name for name, times in Counter(header).items() if times > 1]:
        raise InputError(
            f"The {what} {path} must have every column once, got {shown(double[0])} twice."
        )
    names = list(units)
    # "" is no name: pandas writes its index as a column without a title, which is not read
    if further and further in header and further not in units:
        names.append(further)
    table = []
    for number, line in lines:
        if len(line) > len(header):
            raise InputError(
                f"Line {number} of the {what} {path} must have {len(header)} values, got more."
            )
        row = dict(zip(header, line, strict=False))
        values = []
        for name in names:
            value = number_in(row.get(name))
            if not abs(value) < 1e100:  # the squares of larger ones are infinite
                place = f"`{name}` in line {number}"
                raise must_be(place, owner, "a number below 1e100 in size", row.get(name))
            values.append(in_own_unit(value, factors[name]))
        table.append(values)
    ignored = [name for name in header if name not in names]
    converted = [title for title, name in zip(titles, header, strict=True) if factors[name] != 1.0]
    return NumberTable(np.array(table), ignored, converted)
