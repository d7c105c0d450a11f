"""A slice through a space: the same logical scenario with some of its parameters held fixed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario.logical import Constraint, LogicalScenario


@dataclass(frozen=True, slots=True)
class _Filled:
    """A function of all parameters as one of those that are left; arrays stay arrays of one
    shape.
    """

    function: Callable[[Mapping[str, Any]], Any]
    fixed: tuple[tuple[str, float], ...]

    def __call__(self, values: Mapping[str, Any]) -> Any:
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        held = {name: np.full(shape, value) if shape else value for name, value in self.fixed}
        return self.function({**values, **held})


@dataclass(frozen=True, slots=True)
class HeldSearch:
    """What zones are searched from, with some parameters held; a `Search`."""

    obstacle: int
    conflict: bool
    delay: _Filled


def slice_of(logical: LogicalScenario, fixed: Mapping[str, float]) -> LogicalScenario:
    """The scenario over the parameters that are not in `fixed`.

    Raises InputError for unknown names and values.
    """
    for name, value in fixed.items():
        if name not in logical.names:
            raise unknown(f"parameter of scenario `{logical.name}`", name, logical.names)
        item = next(item for item in logical.parameters if item.name == name)
        if not item.low <= value <= item.high or (item.values and value not in item.values):
            within = f"within {item.low:g}..{item.high:g}{item.behind}"
            values = ", ".join(f"{known:g}" for known in item.values)
            allowed = f"one of {values}{item.behind}" if item.values else within
            raise must_be(f"`{name}`", f"the slice of scenario `{logical.name}`", allowed, value)
    left = tuple(item for item in logical.parameters if item.name not in fixed)
    if not left:
        raise InputError(
            f"The slice of scenario `{logical.name}` must leave at least one parameter free."
        )
    if not fixed:
        return logical
    held = tuple(sorted((name, float(value)) for name, value in fixed.items()))
    search = logical.search
    return replace(
        logical,
        parameters=left,
        constraints=tuple(
            Constraint(item.about, _Filled(item.holds, held)) for item in logical.constraints
        ),
        place=_Filled(logical.place, held),
        approach=None if logical.approach is None else _Filled(logical.approach, held),
        search=None
        if search is None
        else HeldSearch(search.obstacle, search.conflict, _Filled(search.delay, held)),
        margin=None if logical.margin is None else _Filled(logical.margin, held),
        exposure=_Filled(logical.exposure, held),
        zone_coordinates=None,  # one of them may be constant on the slice
        samples=(),
        default_sample="grid",
    )
