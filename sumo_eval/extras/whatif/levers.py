"""Levers of a case: the settings and parameters that can be moved alone, with their ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings import SimulationSettings

VALUES = 33
"""Values along a lever in the first round."""
_FINE = 1024  # steps of a scenario's parameter
_SETTINGS = {
    "conditions.perception_delay": (0.0, 2.0, 0.0, "s"),
    "conditions.actuation_delay": (0.0, 2.0, 0.0, "s"),
    "conditions.sensor_range": (10.0, 300.0, 0.5, "m"),
    "vehicle.max_deceleration": (1.0, 12.0, 0.01, "m/s2"),
    "vehicle.friction": (0.05, 1.2, 0.002, "1"),
}
"""Lowest and highest value, step (0: one of the simulation) and unit."""


@dataclass(frozen=True, slots=True)
class Lever:
    """A quantity that is moved alone.

    step: to which a change of outcome is located.
    recorded: value in the recorded case; the highest where there is no limit.
    listed: the only values that it has; none: all.
    """

    name: str
    unit: str
    low: float
    high: float
    step: float
    recorded: float
    listed: tuple[float, ...] = ()

    def coarse(self) -> list[float]:
        """Values of the first round."""
        whole = round((self.high - self.low) / self.step)
        places = np.unique(np.round(np.linspace(0, whole, min(VALUES, whole + 1))))
        return list(self.listed) or [self._at(place) for place in places.tolist()]

    def between(self, one: float, two: float) -> list[float]:
        """All steps between two values."""
        if self.listed:
            return []
        first, last = ((it - self.low) / self.step for it in sorted((one, two)))
        inside = range(int(first + 1e-6) + 1, int(np.ceil(last - 1e-6)))
        return [self._at(place) for place in inside]

    def share(self, value: float) -> float:
        """Change to a value as a share of the range."""
        return abs(value - self.recorded) / (self.high - self.low)

    def _at(self, place: float) -> float:
        return round(min(self.low + place * self.step, self.high), 9)


def levers_of(
    logical: LogicalScenario, values: Mapping[str, float], settings: SimulationSettings
) -> list[Lever]:
    """The levers of a case: conditions, brakes, friction, and every parameter of its scenario."""
    levers = []
    for name, (low, high, step, unit) in _SETTINGS.items():
        if name in logical.names:
            continue
        group, _, setting = name.partition(".")
        value = getattr(getattr(settings, group), setting)
        recorded = high if value is None else float(value)
        low, high = min(low, recorded), max(high, recorded)
        levers.append(Lever(name, unit, low, high, step or settings.step, recorded))
    for item in logical.parameters:
        step = (item.high - item.low) / _FINE
        unit, value = item.unit, values[item.name]
        levers.append(
            Lever(item.name, unit, item.low, item.high, step, value, tuple(item.values or ()))
        )
    return levers


def moved(
    logical: LogicalScenario, values: Mapping[str, float], lever: Lever, value: float
) -> ConcreteScenario | None:
    """The case with one lever at a value; None where the scenario has no such point."""
    if lever.name in logical.names:
        try:
            return logical.concrete(**{**values, lever.name: value})
        except InputError:
            return None
    usual = logical.placed(values)
    if value == lever.recorded:
        return usual
    return replace(usual, changes=(*usual.changes, (lever.name, value)))
