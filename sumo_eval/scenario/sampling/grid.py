"""Grids on exact decimals: all combinations of the values of each axis. The method `grid` of
`sampling`.

Binary floats cannot step by 0.1: adding or dividing them duplicates or loses end points. So every
axis is computed in exact fractions of the decimals in the file, which become floats at the end.

Users: `extras/openscenario/space.py`, `method/zone_partition.py`, `method/zone_search.py`,
`method/zone_training.py`, `scenario/sampling/combinations.py`, `scenario/sampling/samples.py`.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from numbers import Integral, Real
from typing import Any

import numpy as np

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.scenario.sampling.request import MAX_POINTS, Drawn, Request, owner_of
from sumo_eval.trajectory import FloatArray


def full_grid(logical: LogicalScenario, request: Request) -> Drawn:
    """Every combination of the axes' values, the first parameter slowest."""
    axes, notes = grid_axes(logical, request)
    return Drawn(mesh(axes), notes=notes)


def mesh(axes: Sequence[Sequence[float]]) -> FloatArray:
    """All combinations (n, k) of the axes' values, the first axis slowest."""
    grids = np.meshgrid(*(np.array(axis, float) for axis in axes), indexing="ij")
    return np.stack([coordinates.ravel() for coordinates in grids], axis=-1)


def grid_axes(
    logical: LogicalScenario, request: Request
) -> tuple[list[list[float]], tuple[str, ...]]:
    """The values of each axis, and sentences about axes that do not end where their range does.

    An axis with listed values has exactly these. Any other axis has the levels or the step that the
    request gives it, else the space's own step.
    """
    owner = owner_of(logical)
    steps = dict(request.steps or {})
    # one number of levels is for all axes except those with listed values
    levels: dict[str, Any] = dict.fromkeys(logical.names, request.levels)
    if by_name := isinstance(request.levels, Mapping):
        levels = dict(request.levels)
    for name in (*levels, *steps):
        if name in steps and levels.get(name) is not None:
            raise InputError(f"`{name}` in {owner} must have levels or a step, got both.")
        if (by_name or name in steps) and logical.parameters[logical.column(name)].values:
            raise InputError(
                f"`{name}` in {owner} has listed values: it takes no levels and no step."
            )
    axes: list[list[float]] = []
    notes: list[str] = []
    for item in logical.parameters:
        values = list(item.values)
        if (count := levels.get(item.name)) is not None:
            _check_levels(count, item.name if by_name else "levels", owner)
            values = values or evenly(item, count)
        if not values:
            step = steps.get(item.name, item.step)
            values = _stepped(item, step, owner)
            if values[-1] != item.high:
                notes.append(
                    f"`{item.name}`: steps of {step:g}{item.unit_suffix} from {item.low:g} do not "
                    f"end at {item.high:g}; the last point is {values[-1]:g}."
                )
        axes.append(values)
    _refuse_if_too_many(math.prod(map(len, axes)), owner)
    return axes, tuple(notes)


def _stepped(parameter: Parameter, step: float, owner: str) -> list[float]:
    """Values from low, `step` apart, up to high at most."""
    if isinstance(step, bool) or not isinstance(step, Real) or not 0 < step < math.inf:
        raise must_be(f"`{parameter.name}`", owner, "a step greater than 0", step)
    low, width = decimal(parameter.low), decimal(step)
    count = (decimal(parameter.high) - low) // width
    _refuse_if_too_many(count + 1, owner)
    return [float(low + index * width) for index in range(count + 1)]


def _check_levels(levels: object, name: str, owner: str) -> None:
    """Refuse a number of levels that no axis can have; `name` is its key."""
    if not isinstance(levels, Integral) or levels < 2:
        raise must_be(f"`{name}`", owner, "a whole number of levels, at least 2", levels)
    _refuse_if_too_many(int(levels), owner)


def _refuse_if_too_many(count: int, owner: str) -> None:
    """Refuse a grid of more than `MAX_POINTS` points."""
    if count > MAX_POINTS:
        raise InputError(
            f"The grid in {owner} must have at most {MAX_POINTS:,} points, got {count:,}."
        )


def decimal(value: float) -> Fraction:
    """The decimal that a float is written as: 0.1 becomes 1/10, not 0.1000000000000000055."""
    return Fraction(repr(float(value)))


def evenly(parameter: Parameter, levels: int) -> list[float]:
    """`levels` values at equal distances from low to high, both included."""
    low, high = decimal(parameter.low), decimal(parameter.high)
    return [float(low + (high - low) * index / (levels - 1)) for index in range(levels)]
