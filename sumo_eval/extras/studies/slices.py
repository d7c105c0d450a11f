"""A slice through a space: the same logical scenario with some of its parameters held fixed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sumo_eval.errors import InputError, must_be, unknown
from sumo_eval.scenario.logical import Constraint, LogicalScenario


@dataclass(frozen=True)
class _Filled:
    """A function of all parameters as one of those that are left; arrays stay arrays of one
    shape.
    """

    function: Callable[[Mapping[str, Any]], Any]
    fixed: Mapping[str, float]

    def __call__(self, values: Mapping[str, Any]) -> Any:
        shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
        held = {
            name: np.full(shape, value) if shape else value for name, value in self.fixed.items()
        }
        return self.function({**values, **held})


def slice_of(logical: LogicalScenario, fixed: Mapping[str, float]) -> LogicalScenario:
    """The scenario over the parameters that are not in `fixed`.

    Raises InputError for unknown names and values.
    """
    items = {item.name: item for item in logical.parameters}
    for name, value in fixed.items():
        if name not in items:
            raise unknown(f"parameter of scenario `{logical.name}`", name, logical.names)
        item = items.pop(name)
        if not item.low <= value <= item.high or (item.values and value not in item.values):
            allowed = f"within {item.low:g}..{item.high:g}{item.behind}"
            if item.values:
                values = ", ".join(f"{known:g}" for known in item.values)
                allowed = f"one of {values}{item.behind}"
            raise must_be(f"`{name}`", f"the slice of scenario `{logical.name}`", allowed, value)
    if not items:
        raise InputError(
            f"The slice of scenario `{logical.name}` must leave at least one parameter free."
        )
    if not fixed:
        return logical
    functions: dict[str, Any] = {
        name: _Filled(function, fixed)
        for name in ("place", "approach", "margin", "exposure")
        if (function := getattr(logical, name)) is not None
    }
    if logical.search is not None:
        delay = _Filled(logical.search.delay, fixed)
        functions["search"] = replace(logical.search, delay=delay)
    constraints = [Constraint(it.about, _Filled(it.holds, fixed)) for it in logical.constraints]
    return replace(
        logical,
        parameters=tuple(items.values()),
        constraints=tuple(constraints),
        zone_coordinates=None,  # one of them may be constant on the slice
        samples=(),
        default_sample="grid",
        **functions,
    )
