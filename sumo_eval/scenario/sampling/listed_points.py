"""Points that the user chose: a CSV file, or a Python function."""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError, did_you_mean, must_be, said
from sumo_eval.input_file import input_file
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.scenario.units import factor_to, in_own_unit
from sumo_eval.settings.locators import load_object
from sumo_eval.text import clean, from_cell, shown

EXPOSURE = "exposure"
# as tables are headed: `ego_speed (km/h)`
_WITH_UNIT = re.compile(r"(\w+)\s*[(\[]([^()\[\]]*)[)\]]")


def from_csv(logical: LogicalScenario, request: Request) -> Drawn:
    """The rows of a CSV file with a column for each parameter, and, if it likes, one called
    `exposure`.
    """
    if request.file is None:
        raise InputError(f"`file` of {owner_of(logical)} is missing.")
    path = (request.folder or Path.cwd()) / request.file
    owner = f"the points {path}"
    try:
        with input_file(path, "file of points").open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            (_, head), *lines = [(rows.line_num, line) for line in rows if line] or [(0, [])]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"The points {path} cannot be read: {error}.") from error
    titles = [from_cell(title.strip()) for title in head]
    header, factors = _columns(logical, titles, owner)
    if missing := [name for name in logical.names if name not in header]:
        what = "a column" if len(missing) == 1 else "the columns"
        listed = ", ".join(f"`{name}`" for name in missing)
        near = did_you_mean(missing[0], header)
        raise InputError(f"The points {path} must have {what} {listed}.{near}")
    if not lines:
        raise InputError(f"The points {path} must have at least one row.")
    if double := [name for name, times in Counter(header).items() if times > 1]:
        raise InputError(
            f"The points {path} must have every column once, got {shown(double[0])} twice."
        )
    names = [*logical.names, *({EXPOSURE} & set(header))]
    table = []
    for number, line in lines:
        if len(line) > len(header):
            raise InputError(
                f"Line {number} of the points {path} must have {len(header)} values, got more."
            )
        row = dict(zip(header, line, strict=False))
        table.append(
            [
                in_own_unit(
                    _real(row.get(name), f"`{name}` in line {number}", owner),
                    factors.get(name, 1.0),
                )
                for name in names
            ]
        )
    points, exposure = np.hsplit(np.array(table), [len(logical.names)])
    _check_box(logical, points, str(path))
    if exposure.size and not (np.all(exposure >= 0.0) and exposure.sum() > 0.0):
        raise must_be("`exposure`", owner, "at least 0, and above 0 somewhere", exposure.min())
    ignored = [name for name in header if name not in names]
    converted = [
        title for title, name in zip(titles, header, strict=True) if factors.get(name, 1.0) != 1.0
    ]
    notes = [
        f"{what}: {clean(', '.join(columns))}."
        for what, columns in (
            (f"Columns of {path.name} that name no parameter", ignored),
            (f"Converted to the parameters' units from {path.name}", converted),
        )
        if columns
    ]
    return Drawn(points, exposure[:, 0] if exposure.size else None, tuple(notes))


def _columns(
    logical: LogicalScenario, titles: Sequence[str], owner: str
) -> tuple[list[str], dict[str, float]]:
    """Names of columns of which some have a unit, `gap (m)`; by what the numbers of these have to
    be multiplied.
    """
    own, names, factors = {item.name: item.unit for item in logical.parameters}, [], {}
    for title in titles:
        found = _WITH_UNIT.fullmatch(title)
        if found is None or found[1] not in own:
            names.append(title)
            continue
        names.append(found[1])
        factors[found[1]] = factor_to(own[found[1]], found[2], f"column {shown(title)} of {owner}")
    return names, factors


def from_function(logical: LogicalScenario, request: Request, locator: str) -> Drawn:
    """The points that the user's function `(space, n, rng) -> points` returns."""
    count, owner = request.wanted(logical), f"sampler `{locator}`"
    function = load_object(locator, request.folder, "Sampler")
    if not callable(function):
        kind = type(function).__name__
        raise must_be(f"Sampler `{locator}`", f"scenario `{logical.name}`", "a function", kind)
    try:
        found = function(logical, count, request.stream(logical, locator))
        points = np.asarray(found, dtype=np.float64)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(f"Sampler `{locator}` failed: {said(error)}.") from error
    k = len(logical.names)
    if points.ndim != 2 or points.shape[1] != k or not len(points):
        must = f"an (n, {k}) array with a column for each of {', '.join(logical.names)}"
        raise must_be("The result", owner, must, points.shape)
    _check_box(logical, points, owner)
    note = f"Sampler `{locator}` was asked for {count} points, returned {len(points)}."
    return Drawn(points, notes=(note,) if len(points) != count else ())


def _real(text: str | None, what: str, owner: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise must_be(what, owner, "a number", text)
    return value


def _check_box(logical: LogicalScenario, points: np.ndarray, owner: str) -> None:
    """Points that leave the space are a mistake of the list, unlike points that a constraint
    excludes.
    """
    outside = np.argwhere((points < logical.low) | (points > logical.high))
    for row, column in outside[:1].tolist():
        item = logical.parameters[column]
        what, must = f"`{item.name}` of point {row + 1}", f"within {item.low:g}..{item.high:g}"
        raise must_be(what, owner, must, float(points[row, column]))
