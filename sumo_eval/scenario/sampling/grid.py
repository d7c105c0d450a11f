"""Grids on exact decimals: all combinations of the values of each axis.

Binary floats cannot step by 0.1: adding or dividing them duplicates or loses end points. Every axis
is computed in fractions of the decimals that a person typed, and becomes floats at the very end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from numbers import Integral, Real

import numpy as np

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.scenario.sampling.request import MAX_POINTS, Drawn, Levels, Request, owner_of
from sumo_eval.trajectory import FloatArray


def full_grid(logical: LogicalScenario, request: Request) -> Drawn:
    """Every combination, the first parameter slowest.

    An axis without levels or a step keeps the space's own step.
    """
    axes, notes = grid_axes(logical, request)
    return Drawn(mesh(axes), notes=notes)


def mesh(axes: Sequence[Sequence[float]]) -> FloatArray:
    """All combinations (n, k) of the axes' values, the first axis slowest."""
    grids = np.meshgrid(*(np.array(axis, dtype=np.float64) for axis in axes), indexing="ij")
    return np.stack([coordinates.ravel() for coordinates in grids], axis=-1)


def grid_axes(
    logical: LogicalScenario, request: Request
) -> tuple[list[list[float]], tuple[str, ...]]:
    """The values of each axis, and sentences about axes that do not end where their range does."""
    levels, steps = request.levels, request.steps
    owner = owner_of(logical)
    levels_of, step_of = _by_name(logical, levels, owner), dict(steps or {})
    for name in (*levels_of, *step_of):
        if name in levels_of and name in step_of:
            raise InputError(f"`{name}` in {owner} must have levels or a step, got both.")
        if logical.parameters[logical.column(name)].values and (
            name in step_of or isinstance(levels, Mapping)
        ):
            raise InputError(
                f"`{name}` in {owner} has listed values: it takes no levels and no step."
            )
    axes: list[list[float]] = []
    notes: list[str] = []
    for parameter in logical.parameters:
        name = parameter.name
        if parameter.values:
            axes.append(list(parameter.values))
        elif name in levels_of:
            axes.append(evenly(parameter, _checked_levels(levels_of[name], name, owner)))
        else:
            step = _checked_step(step_of.get(name, parameter.step), name, owner)
            values, exact = _stepped(parameter, step, owner)
            axes.append(values)
            if not exact:
                notes.append(
                    f"`{name}`: steps of {step:g}{parameter.behind} from {parameter.low:g} do not "
                    f"end at {parameter.high:g}; the last point is {values[-1]:g}."
                )
    _refuse_if_too_many(math.prod(len(axis) for axis in axes), owner)
    return axes, tuple(notes)


def _by_name(logical: LogicalScenario, levels: Levels, owner: str) -> dict[str, int]:
    if levels is None:
        return {}
    if isinstance(levels, Mapping):
        return dict(levels)
    return dict.fromkeys(logical.names, _checked_levels(levels, "levels", owner))


def _checked_levels(levels: object, name: str, owner: str) -> int:
    if not isinstance(levels, Integral) or levels < 2:
        raise must_be(f"`{name}`", owner, "a whole number of levels, at least 2", levels)
    _refuse_if_too_many(int(levels), owner)
    return int(levels)


def _checked_step(step: object, name: str, owner: str) -> float:
    if isinstance(step, bool) or not isinstance(step, Real) or not math.isfinite(step) or step <= 0:
        raise must_be(f"`{name}`", owner, "a step greater than 0", step)
    return float(step)


def _refuse_if_too_many(count: int, owner: str) -> None:
    if count > MAX_POINTS:
        raise InputError(
            f"The grid in {owner} must have at most {MAX_POINTS:,} points, got {count:,}."
        )


def decimal(value: float) -> Fraction:
    """The decimal that a float is written as: 0.1 becomes 1/10, not 0.1000000000000000055."""
    return Fraction(repr(float(value)))


def evenly(parameter: Parameter, levels: int) -> list[float]:
    """`levels` values from low to high, both included."""
    low, high = decimal(parameter.low), decimal(parameter.high)
    return [float(low + (high - low) * index / (levels - 1)) for index in range(levels)]


def _stepped(parameter: Parameter, step: float, owner: str) -> tuple[list[float], bool]:
    """Values from low in steps, none above high, and whether the last one is high itself."""
    low, high, width = decimal(parameter.low), decimal(parameter.high), decimal(step)
    intervals = (high - low) // width
    _refuse_if_too_many(intervals + 1, owner)
    return [
        float(low + index * width) for index in range(intervals + 1)
    ], low + intervals * width == high
