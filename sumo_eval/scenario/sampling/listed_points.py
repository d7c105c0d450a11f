"""Points that the user chose: the rows of a CSV file (the method `file` of `sampling`), or the
result of a Python function (the locator of the function as the method).

Users: `scenario/sampling/samples.py`.
"""

from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError, must_be, users_code
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.number_table import read_numbers
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.settings.locators import load_object
from sumo_eval.text import clean
from sumo_eval.trajectory import FloatArray

EXPOSURE = "exposure"


def from_csv(logical: LogicalScenario, request: Request) -> Drawn:
    """The rows of a CSV file: a column for each parameter, and optionally one named `exposure`."""
    if request.file is None:
        raise InputError(f"`file` of {owner_of(logical)} is missing.")
    path = (request.folder or Path.cwd()) / request.file
    units = {item.name: item.unit for item in logical.parameters}
    table = read_numbers(path, "points", units, EXPOSURE)
    # exposure: (n, 1), or (n, 0) without that column
    points, exposure = np.hsplit(table.rows, [len(units)])
    check_on_axes(logical, points, str(path))
    if exposure.size and not (np.all(exposure >= 0.0) and exposure.sum() > 0.0):
        got = float(exposure.min())
        raise must_be("`exposure`", f"the points {path}", "at least 0, and above 0 somewhere", got)
    repeated = len(points) - len(np.unique(points, axis=0))
    notes = {
        f"Columns of {path.name} that name no parameter": ", ".join(table.ignored),
        f"Converted to the parameters' units from {path.name}": ", ".join(table.converted),
        f"Points of {path.name} that a row above has, too; they count again": str(repeated or ""),
    }
    return Drawn(
        points,
        exposure[:, 0] if exposure.size else None,
        tuple(f"{what}: {clean(words)}." for what, words in notes.items() if words),
    )


def from_function(logical: LogicalScenario, request: Request, locator: str) -> Drawn:
    """The points that the user's function `(space, n, rng) -> points` returns.

    locator: of the function, `module:name` or `file.py:name`.
    """
    count = request.wanted(logical)
    owner = f"sampler `{locator}`"
    function = load_object(locator, request.folder, "Sampler")
    if not callable(function):
        raise must_be(
            f"Sampler `{locator}`", f"scenario `{logical.name}`", "a function",
            type(function).__name__,
        )  # fmt: skip
    with users_code(f"Sampler `{locator}` failed"):
        points = np.asarray(function(logical, count, request.stream(logical, locator)), float)
    k = len(logical.names)
    if points.ndim != 2 or points.shape[1] != k or not len(points):
        must = f"an (n, {k}) array with a column for each of {', '.join(logical.names)}"
        raise must_be("The result", owner, must, points.shape)
    check_on_axes(logical, points, owner)
    note = f"Sampler `{locator}` was asked for {count} points, returned {len(points)}."
    return Drawn(points, notes=(note,) if len(points) != count else ())


def check_on_axes(logical: LogicalScenario, points: FloatArray, owner: str) -> None:
    """Raise InputError for a point that is not on the parameters' axes, or nan: that is a mistake,
    while a point that a constraint excludes is only refused.
    """
    for item, values in zip(logical.parameters, points.T, strict=False):
        on_axis = (values >= item.low) & (values <= item.high)  # false for nan
        if item.values:
            on_axis = np.isin(values, item.values)
        for row in np.flatnonzero(~on_axis)[:1].tolist():  # the error names the first
            item.check(float(values[row]), f"point {row + 1} of {owner}")
