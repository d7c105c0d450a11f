"""Tables of numbers that users write: a CSV file with a column for each parameter."""

from __future__ import annotations

import csv
import math
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

# as tables are headed: `ego_speed (km/h)`
_WITH_UNIT = re.compile(r"(\w+)\s*[(\[]([^()\[\]]*)[)\]]")


class NumberTable(NamedTuple):
    """Numbers of a file.

    names: of its columns.
    rows: (n, k), in the units asked for.
    ignored, converted: headings of columns that were not read, and of those in other units.
    """

    names: list[str]
    rows: FloatArray
    ignored: list[str]
    converted: list[str]


def read_numbers(path: Path, what: str, units: Mapping[str, str], further: str = "") -> NumberTable:
    """The columns of a CSV file that have these names, at least one row.

    what: the rows are, in errors.
    units: of the columns by name.
    further: a column without a unit that may be missing.
    """
    owner = f"the {what} {path}"
    try:
        with input_file(path, f"file of {what}").open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            (_, head), *lines = [(rows.line_num, line) for line in rows if line] or [(0, [])]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"The {what} {path} cannot be read: {error}.") from error
    titles = [from_cell(title.strip()) for title in head]
    header, factors = [], {}
    for title in titles:
        found = _WITH_UNIT.fullmatch(title)
        name = found[1] if found and found[1] in units else title
        header.append(name)
        if found and name in units:
            factors[name] = factor_to(units[name], found[2], f"column {shown(title)} of {owner}")
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
    # `further` is "" by default, which is also the name of a pandas index: it is not read
    names = [*units, *({further} & set(header) - {*units, ""})]
    table = []
    for number, line in lines:
        if len(line) > len(header):
            raise InputError(
                f"Line {number} of the {what} {path} must have {len(header)} values, got more."
            )
        row = dict(zip(header, line, strict=False))
        table.append(
            [in_own_unit(number_in(row.get(name)), factors.get(name, 1.0)) for name in names]
        )
        for name, value in zip(names, table[-1], strict=True):
            if math.isnan(value):
                raise must_be(f"`{name}` in line {number}", owner, "a number", row.get(name))
    converted = [
        title for title, name in zip(titles, header, strict=True) if factors.get(name, 1.0) != 1.0
    ]
    return NumberTable(names, np.array(table), [it for it in header if it not in names], converted)
