"""Which points of a space become concrete scenarios: a grid on exact decimals, and what was left out of it.

Binary floats cannot step by 0.1: adding or dividing them duplicates or loses end points. Every axis is computed in
fractions of the decimals that a person typed, and becomes floats at the very end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from numbers import Integral, Real

import numpy as np

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.trajectory import FloatArray

MAX_POINTS = 1_000_000
"""More points than any machine will simulate; a larger grid is a slip of the pen."""

Levels = int | Mapping[str, int] | None
Steps = Mapping[str, float] | None


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Chosen points of a space, one row each, columns in the order of `logical.parameters`.

    points: (n, k), those that exist. refused: (m, k), those that a constraint of the scenario rules out. notes:
    sentences about what the choice could not do as asked.
    """

    points: FloatArray
    refused: FloatArray
    notes: tuple[str, ...] = ()


def sample(logical: LogicalScenario, method: str | None = None, levels: Levels = None, steps: Steps = None) -> Sample:
    """Choose points of a space.

    method: `grid`, all combinations of the values of each axis; or the name of one of the scenario's own samples. None:
    the grid where levels or steps are given, else what the scenario has as its default.
    levels: points on each axis, evenly spaced with both ends; one number for all axes, or by parameter name.
    steps: distance between the points of an axis, by parameter name. An axis in neither keeps the space's own step.
    Raises InputError for an unknown method or parameter, for levels and steps that make no grid, and for levels and
    steps of a prescribed sample, which has none.
    """
    given = levels is not None or bool(steps)
    notes: tuple[str, ...] = ()
    if method is None:
        method = "grid" if given else logical.default_sample
    prescribed = {item.name: item for item in logical.samples}
    if method not in METHODS and method not in prescribed:
        raise unknown("sampling method", method, (*METHODS, *prescribed))
    if method in prescribed:
        if given:
            raise InputError(f"Sample `{method}` of scenario `{logical.name}` is a list: it has no levels or steps.")
        points = np.array(prescribed[method].points, dtype=np.float64)
    else:
        points, notes = METHODS[method](logical, levels, steps)
    feasible = logical.feasible(points)
    return Sample(points[feasible], points[~feasible], notes)


def grid(logical: LogicalScenario, *, levels: Levels = None, steps: Steps = None) -> FloatArray:
    """Every point (n, k) of the grid, possible or not, the first parameter slowest; arguments as in `sample`."""
    return _grid(logical, levels, steps)[0]


def central_point(logical: LogicalScenario) -> FloatArray:
    """The point (k,) of the space's default sample nearest to the centre of the unit box; of equals, the first."""
    points = sample(logical).points
    distance = np.linalg.norm(logical.to_unit(points) - 0.5, axis=-1)
    point: FloatArray = points[int(np.argmin(np.round(distance, 12)))]  # rounded: equals must stay equal
    return point


def _grid(logical: LogicalScenario, levels: Levels, steps: Steps) -> tuple[FloatArray, tuple[str, ...]]:
    owner = f"the sampling of scenario `{logical.name}`"
    levels_of, step_of = _by_name(logical, levels, owner), dict(steps or {})
    for name in (*levels_of, *step_of):
        if name not in logical.names:
            raise unknown(f"parameter of scenario `{logical.name}`", name, logical.names)
        if name in levels_of and name in step_of:
            raise InputError(f"`{name}` in {owner} must have levels or a step, got both.")
    axes: list[list[float]] = []
    notes: list[str] = []
    for parameter in logical.parameters:
        if parameter.name in levels_of:
            axes.append(_evenly(parameter, _checked_levels(levels_of[parameter.name], parameter.name, owner)))
            continue
        step = _checked_step(step_of.get(parameter.name, parameter.step), parameter.name, owner)
        values, exact = _stepped(parameter, step, owner)
        axes.append(values)
        if not exact:
            notes.append(
                f"`{parameter.name}`: steps of {step:g} {parameter.unit} from {parameter.low:g} do not end at "
                f"{parameter.high:g}; the last point is {values[-1]:g}."
            )
    _refuse_if_too_many(math.prod(len(axis) for axis in axes), owner)
    mesh = np.meshgrid(*(np.array(axis, dtype=np.float64) for axis in axes), indexing="ij")
    return np.stack([coordinates.ravel() for coordinates in mesh], axis=-1), tuple(notes)


METHODS: dict[str, Callable[[LogicalScenario, Levels, Steps], tuple[FloatArray, tuple[str, ...]]]] = {"grid": _grid}
"""Ways to choose points, by the name they have in an evaluation file."""


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
        raise InputError(f"The grid in {owner} must have at most {MAX_POINTS:,} points, got {count:,}.")


def _decimal(value: float) -> Fraction:
    """The decimal that a float is written as: 0.1 becomes 1/10, not 0.1000000000000000055."""
    return Fraction(repr(float(value)))


def _evenly(parameter: Parameter, levels: int) -> list[float]:
    """`levels` values from low to high, both included."""
    low, high = _decimal(parameter.low), _decimal(parameter.high)
    return [float(low + (high - low) * index / (levels - 1)) for index in range(levels)]


def _stepped(parameter: Parameter, step: float, owner: str) -> tuple[list[float], bool]:
    """Values from low in steps, none above high, and whether the last one is high itself."""
    low, high, width = _decimal(parameter.low), _decimal(parameter.high), _decimal(step)
    intervals = (high - low) // width
    _refuse_if_too_many(intervals + 1, owner)
    return [float(low + index * width) for index in range(intervals + 1)], low + intervals * width == high
