"""Gherkin as text: a feature, one scenario outline with its steps, and its tables of examples.

Both spellings are read, plain (`Given ...`, `.feature`) and in Markdown (`* Given ...`, `.feature.md`). A table whose
header leaves doubt about what a column is has no meaning that could be trusted, so it is refused.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from sumo_eval.errors import InputError, did_you_mean, must_be
from sumo_eval.input_file import read_input_text

_LARGEST = 1_000_000  # characters of a file
_UNITS = {
    "km/h": ("m/s", 1.0 / 3.6), "m/s": ("m/s", 1.0), "m": ("m", 1.0), "meters": ("m", 1.0), "s": ("s", 1.0),
    "m/s^2": ("m/s2", 1.0), "m/s2": ("m/s2", 1.0), "m/s²": ("m/s2", 1.0), "%": ("1", 0.01),
}  # fmt: skip
"""Units that a cell may have: the one of SI, and what a number is multiplied by."""
_KINDS = {"given": "given", "when": "when", "then": "then"}
PLACEHOLDER = re.compile(r"<(\w+)>")
QUANTITY = re.compile(r"(-?\d+(?:\.\d+)?)\s*([^\s\d|]\S*)")


@dataclass(frozen=True, slots=True)
class Step:
    """One step. kind: given, when or then, also where it is written as `And`. line: in the file."""

    kind: str
    text: str
    line: int


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the examples: numbers as they are written, their unit, and by how much it is one of SI."""

    name: str
    values: tuple[float, ...]
    unit: str
    si: str
    factor: float


@dataclass(frozen=True, slots=True)
class Outline:
    """A scenario outline. columns: of all its tables, one below the other. titles: of the table of each row."""

    feature: str
    name: str
    steps: tuple[Step, ...]
    columns: tuple[Column, ...]
    titles: tuple[str, ...]

    def column(self, name: str) -> Column | None:
        """The column of that name."""
        return next((item for item in self.columns if item.name == name), None)


@dataclass(frozen=True, slots=True)
class _Table:
    title: str
    line: int
    rows: tuple[tuple[int, tuple[str, ...]], ...]


def read_outline(path: Path) -> Outline:
    """The one scenario outline of a file. Raises InputError with file, line and what is doubtful."""
    text = read_input_text(path, "use case")
    if len(text) > _LARGEST:
        raise must_be("The text", f"use case {path.name}", f"at most {_LARGEST:,} characters", len(text))
    feature, name = "", ""
    steps: list[Step] = []
    tables: list[tuple[str, int, list[tuple[int, tuple[str, ...]]]]] = []
    kind, outlines = "", 0
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        bare = line.lstrip("#*- ").strip()
        word, _, rest = bare.partition(" ")
        title, colon, after = bare.partition(":")
        if colon and title in (
            "Feature",
            "Scenario Outline",
            "Scenario Template",
            "Scenario",
            "Background",
            "Examples",
        ):
            kind = ""
            if title == "Feature":
                feature = after.strip()
            elif title.startswith("Scenario"):
                outlines += 1
                name = after.strip()
        if bare == "Examples" or (colon and title == "Examples"):
            tables.append((after.strip() if colon else "", number, []))
        elif line.startswith("|"):
            if not tables:
                raise InputError(f"{path.name}, line {number}: a table stands before `Examples`.")
            cells = tuple(cell.strip() for cell in line.removeprefix("|").removesuffix("|").split("|"))
            if not all(re.fullmatch(r":?-+:?", cell) for cell in cells):
                tables[-1][2].append((number, cells))
        elif word.lower() in (*_KINDS, "and", "but") and (line[0] in "*-" or not path.name.endswith(".md")):
            kind = _KINDS.get(word.lower(), kind)
            if not kind:
                raise InputError(f"{path.name}, line {number}: `{word}` must follow Given, When or Then.")
            steps.append(Step(kind, " ".join(rest.split()), number))
    if outlines != 1:
        raise must_be("The scenario outlines", f"use case {path.name}", "one", outlines)
    if not steps or not tables:
        raise InputError(f"Use case {path.name} must have steps and a table of examples.")
    whole = [_Table(title, line, tuple(rows)) for title, line, rows in tables]
    columns, titles = _columns(path.name, whole, steps)
    return Outline(feature, name, tuple(steps), columns, titles)


def _columns(file: str, tables: list[_Table], steps: list[Step]) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    headers = []
    for table in tables:
        where = f"table `{table.title}` of {file}, line {table.line}," if table.title else f"{file}, line {table.line}:"
        if len(table.rows) < 2:
            raise InputError(f"{where} has no rows." if table.title else f"{where} the table has no rows.")
        line, header = table.rows[0]
        names = tuple(cell.removeprefix("<").removesuffix(">") for cell in header)
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise InputError(
                f"{file}, line {line}: the header of the table{_called(table)} is doubtful: column `{twice[0]}` stands "
                f"in it {names.count(twice[0])} times, so nobody can tell which is which."
            )
        for name in names:
            if not name.isidentifier():
                raise must_be(f"Column `{name}`", f"the table in {file}, line {line}", "a name such as vx_npc0", name)
        for number, cells in table.rows[1:]:
            if len(cells) != len(names):
                raise must_be(f"The row in line {number}", file, f"{len(names)} cells, as its header", len(cells))
        headers.append(names)
    for table, names in zip(tables[1:], headers[1:], strict=True):
        if names != headers[0]:
            raise must_be(f"The header of the table{_called(table)} in line {table.line}", file,
                          f"that of the first table, {', '.join(headers[0])}", ", ".join(names))  # fmt: skip
    for step in steps:
        for asked in PLACEHOLDER.findall(step.text):
            if asked not in headers[0]:
                raise InputError(
                    f"{file}, line {step.line}: the header of the table is doubtful: `<{asked}>` of step "
                    f"`{step.text}` has no column in it.{did_you_mean(asked, headers[0])}"
                )
    columns = []
    for place, name in enumerate(headers[0]):
        below = [(number, row[place]) for table in tables for number, row in table.rows[1:]]
        columns.append(_column(file, name, below))
    titles = tuple(table.title for table in tables for _ in table.rows[1:])
    return tuple(columns), titles


def _called(table: _Table) -> str:
    return f" `{table.title}`" if table.title else ""


def _column(file: str, name: str, cells: list[tuple[int, str]]) -> Column:
    values, units = [], []
    for line, cell in cells:
        value, unit = quantity(cell, f"column `{name}`", f"{file}, line {line}")
        values.append(value)
        units.append(unit)
    if len(set(units)) > 1:
        raise must_be(f"The unit of column `{name}`", file, "one throughout", ", ".join(dict.fromkeys(units)))
    si, factor = _UNITS[units[0]]
    return Column(name, tuple(values), units[0], si, factor)


def quantity(text: str, what: str, where: str) -> tuple[float, str]:
    """The number and the unit of `20 km/h`."""
    found = QUANTITY.fullmatch(text)
    if found is None:
        raise must_be(what[:1].upper() + what[1:], where, "a number with a unit, such as `20 km/h`", text)
    if found[2] not in _UNITS:
        raise must_be(f"The unit of {what}", where, f"one of {', '.join(_UNITS)}", found[2])
    return float(found[1]), found[2]


def in_si(text: str, what: str, where: str) -> tuple[float, str]:
    """The value of `20 km/h` in units of SI, and that unit."""
    value, unit = quantity(text, what, where)
    si, factor = _UNITS[unit]
    return value * factor, si
