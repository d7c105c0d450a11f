"""ADSs whose result is known in closed form: one that does nothing, and the ideal vehicle of Eq. 17."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.perception import Sensor, lateral_overlap
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.packed import PackedCommand, PackedScene
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import must_be
from sumo_eval.trajectory import BoolArray


def no_reaction(traci: Any, ego: str, time: float) -> Command:
    """ADS `no_reaction`: keeps its speed and its wheel straight, whatever is ahead."""
    return Command(0.0)


class PackedNoReaction:
    """`no_reaction` in many cases at once."""

    def __init__(self, scenario: Briefing) -> None:
        self._nothing = np.zeros(0)

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """No acceleration, no steering."""
        if len(self._nothing) != len(scene.x):
            self._nothing = np.zeros(len(scene.x))
        return PackedCommand(self._nothing, self._nothing)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """It remembers nothing of a case."""

    def settled(self) -> BoolArray:
        """Always, (n,)."""
        return np.ones(len(self._nothing), dtype=bool)


no_reaction.packed = PackedNoReaction  # type: ignore[attr-defined]
no_reaction.settled = lambda: True  # type: ignore[attr-defined]


class IdealBraking:
    """ADS `ideal_braking`, the reference Ug of Eq. 17: perfect perception, immediate braking at the road's limit.

    It brakes whenever it closes on any vehicle ahead in its path, a hidden one too, until it is as slow as that
    vehicle; it never drives faster again. The pressure build-up is the vehicle model's
    (`VehicleSettings.brake_build_up`, 0.15 s), as far as `deceleration` is the strongest that the vehicle has. So its
    impact speed is `criticality.ideal_impact_speed(..., deceleration=deceleration, delay=0, build_up=0.15)`.
    """

    def __init__(self, deceleration: float = 9.0) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise must_be("`deceleration`", "ADS `ideal_braking`", "a finite number greater than 0 m/s2", deceleration)
        self.deceleration = deceleration

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Open the eyes."""
        self._sensor = Sensor()

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Full braking while closing on anything ahead, else roll."""
        me, others = self._sensor.look(traci, ego)
        for other in others:
            if other.x > me.x and me.along > other.along and lateral_overlap(me, other) > 0.0:
                return Command(-self.deceleration)
        return Command(0.0)

    def packed(self, scenario: Briefing) -> PackedIdealBraking:
        """The same in many cases at once."""
        return PackedIdealBraking(self.deceleration)


class PackedIdealBraking:
    """`ideal_braking` in many cases at once."""

    def __init__(self, deceleration: float) -> None:
        self._deceleration = deceleration
        self._cases = 0

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """Full braking while closing on anything ahead, else roll."""
        self._cases = len(scene.x)
        ahead = scene.other_x > scene.x[:, None]
        closing = scene.along[:, None] > scene.other_along
        overlap = scene.half_width[:, None] + scene.other_half_width - np.abs(scene.y[:, None] - scene.other_y) > 0.0
        brakes = (ahead & closing & overlap).any(axis=1)
        return PackedCommand(np.where(brakes, -self._deceleration, 0.0), np.zeros(self._cases))

    def keep(self, rows: NDArray[np.intp]) -> None:
        """It remembers nothing of a case."""

    def settled(self) -> BoolArray:
        """Never: it is the reference, and drives every case to its end, (n,)."""
        return np.zeros(self._cases, dtype=bool)
