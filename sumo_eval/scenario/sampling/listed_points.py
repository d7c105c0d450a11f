"""Points that the user chose: a CSV file, or a Python function."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError, did_you_mean, must_be, said
from sumo_eval.input_file import input_file
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.scenario.units import factor_to
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
    try:
        with input_file(path, "file of points").open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            titles = [from_cell(str(name).strip()) for name in reader.fieldnames or ()]
            header, factors = _columns(logical, titles, f"the points {path}")
            reader.fieldnames = header
            rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"The points {path} cannot be read: {error}.") from error
    if missing := [name for name in logical.names if name not in header]:
        what = "a column" if len(missing) == 1 else "the columns"
        listed = ", ".join(f"`{name}`" for name in missing)
        raise InputError(
            f"The points {path} must have {what} {listed}.{did_you_mean(missing[0], header)}"
        )
    if not rows:
        raise InputError(f"The points {path} must have at least one row.")
    for name in header:
        if header.count(name) > 1:
            raise InputError(
                f"The points {path} must have every column once, got {shown(name)} twice."
            )
    for number, row in enumerate(rows, 2):
        if None in row:  # where DictReader puts what is too much
            raise InputError(
                f"Line {number} of the points {path} must have {len(header)} values, got more."
            )
    columns = [*logical.names, *([EXPOSURE] if EXPOSURE in header else [])]
    table = np.array(
        [
            [_real(row[name], name, number, path) for name in columns]
            for number, row in enumerate(rows, 2)
        ]
    )
    points = table[:, : len(logical.names)] * [factors.get(name, 1.0) for name in logical.names]
    _check_box(logical, points, str(path))
    exposure = table[:, -1] if EXPOSURE in header else None
    if exposure is not None and not (np.all(exposure >= 0.0) and exposure.sum() > 0.0):
        raise must_be(
            "`exposure`", f"the points {path}", "at least 0, and above 0 somewhere", exposure.min()
        )
    ignored = [name for name in header if name not in columns]
    notes: tuple[str, ...] = (
        (f"Columns of {path.name} that name no parameter: {clean(', '.join(ignored))}.",)
        if ignored
        else ()
    )
    converted = [
        title for title, name in zip(titles, header, strict=True) if factors.get(name, 1.0) != 1.0
    ]
    notes += (
        f"Converted to the parameters' units from {path.name}: {clean(', '.join(converted))}.",
    ) * bool(converted)
    return Drawn(points, exposure=exposure, notes=notes)


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
    count = request.wanted(logical)
    function = load_object(locator, request.folder, "Sampler")
    if not callable(function):
        raise must_be(
            f"Sampler `{locator}`",
            f"scenario `{logical.name}`",
            "a function",
            type(function).__name__,
        )
    try:
        found = function(logical, count, request.stream(logical, locator))
        points = np.asarray(found, dtype=np.float64)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(f"Sampler `{locator}` failed: {said(error)}.") from error
    if points.ndim != 2 or points.shape[1] != len(logical.names) or not len(points):
        wanted = (
            f"an (n, {len(logical.names)}) array with a column for each of "
            f"{', '.join(logical.names)}"
        )
        raise must_be("The result", f"sampler `{locator}`", wanted, points.shape)
    _check_box(logical, points, f"sampler `{locator}`")
    notes = (
        ()
        if len(points) == count
        else (f"Sampler `{locator}` was asked for {count} points, returned {len(points)}.",)
    )
    return Drawn(points, notes=notes)


def _real(text: str | None, name: str, line: int, path: Path) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise must_be(f"`{name}` in line {line}", f"the points {path}", "a number", text)
    return value


def _check_box(logical: LogicalScenario, points: np.ndarray, owner: str) -> None:
    """Points that leave the space are a mistake of the list, unlike points that a constraint
    excludes.
    """
    outside = np.flatnonzero(~logical.in_box(points))
    if len(outside):
        row = points[outside[0]]
        for item, value in zip(logical.parameters, row, strict=True):
            if not item.low <= value <= item.high:
                what = f"`{item.name}` of point {outside[0] + 1}"
                raise must_be(what, owner, f"within {item.low:g}..{item.high:g}", float(value))
