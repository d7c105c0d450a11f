"""ADSs whose result is known in closed form: one that does nothing, and the ideal vehicle of Eq. 17."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.braking import switched
from sumo_eval.ads.foresight import Foresight, foresee
from sumo_eval.ads.perception import Sensor, lateral_overlap
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.packed import PackedCommand, PackedScene
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import ControllerError, must_be
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
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

    It knows what the others will do (`foresight`). From the first change of state that it can see of a vehicle that it
    would touch if it kept its speed, it brakes as hard as the road allows, until it is neither faster than that vehicle
    will ever be again nor beside it; it never drives faster again. Where keeping its speed touches nobody, it keeps
    it: braking may only then cause a contact. Once slower it brakes, besides, while it closes on anybody in its path.

    The pressure build-up is the vehicle model's (`VehicleSettings.brake_build_up`, 0.15 s), as far as `deceleration` is
    the strongest that the vehicle has. So its impact speed behind a vehicle that it sees from the start is
    `criticality.ideal_impact_speed(..., deceleration=deceleration, delay=0, build_up=0.15)`.
    """

    def __init__(self, deceleration: float = 9.0) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise must_be("`deceleration`", "ADS `ideal_braking`", "a finite number greater than 0 m/s2", deceleration)
        self.deceleration = deceleration
        self._known: dict[str, Foresight] | None = None

    def foresee(self, concrete: ConcreteScenario, settings: SimulationSettings) -> None:
        """Be told the case; only the harness does that, and only to this class."""
        names = [actor.name for actor in concrete.actors]
        self._known = dict(zip(names, foresee(concrete, settings), strict=True))

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Open the eyes."""
        if self._known is None:
            raise ControllerError("The ideal vehicle must be told the scripts of the others; only `ideal_braking` is")
        self._sensor = Sensor()
        self._rate = scenario.vehicle.brake_jerk
        self._step = scenario.step

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Full braking for anybody who calls for it, from within the step in which he first does."""
        me, others = self._sensor.look(traci, ego)
        assert self._known is not None
        began = min((known.noticed for known in self._known.values() if known.meets), default=math.inf)
        begins = math.inf
        for other in others:
            noticed, meets, slowest = self._known[other.name]
            if meets:
                called = me.along > slowest or abs(other.x - me.x) < me.half_length + other.half_length
            else:
                called = time > began and other.x > me.x and me.along > other.along and lateral_overlap(me, other) > 0.0
            if called:
                begins = min(begins, noticed)
        return Command(-switched(0.0, self.deceleration, begins - time, self._rate, self._step))

    def settled(self) -> bool:
        """Always: while nothing comes nearer it does nothing."""
        return True

    def packed(self, scenario: Briefing) -> PackedIdealBraking:
        """The same in many cases at once."""
        return PackedIdealBraking(self.deceleration, scenario)


class PackedIdealBraking:
    """`ideal_braking` in many cases at once."""

    def __init__(self, deceleration: float, scenario: Briefing) -> None:
        self._deceleration = deceleration
        self._rate = scenario.vehicle.brake_jerk
        self._step = scenario.step
        self._cases = 0

    def foresee(self, cases: Sequence[ConcreteScenario], settings: SimulationSettings) -> None:
        """Be told the cases, as `IdealBraking.foresee` is told one."""
        known = np.array([foresee(concrete, settings) for concrete in cases], dtype=np.float64)
        self._noticed, meets, self._slowest = np.moveaxis(known, 2, 0)
        self._meets = meets > 0.0
        self._began = np.where(self._meets, self._noticed, np.inf).min(axis=1)

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """Full braking for anybody who calls for it, from within the step in which he first does."""
        self._cases = len(scene.x)
        x, along = scene.x[:, None], scene.along[:, None]
        half_length, half_width = scene.half_length[:, None], scene.half_width[:, None]
        beside = np.abs(scene.other_x - x) < half_length + scene.other_half_length
        overlap = half_width + scene.other_half_width - np.abs(scene.y[:, None] - scene.other_y) > 0.0
        closes = (scene.other_x > x) & (along > scene.other_along) & overlap & (time > self._began)[:, None]
        called = np.where(self._meets, (along > self._slowest) | beside, closes)
        begins = np.where(called, self._noticed, np.inf).min(axis=1)
        wait = begins - time
        level = np.where(wait <= 0.0, self._deceleration, 0.0)
        for row in np.flatnonzero((wait > 0.0) & (wait < self._step)).tolist():
            level[row] = switched(0.0, self._deceleration, float(wait[row]), self._rate, self._step)
        return PackedCommand(-level, np.zeros(self._cases))

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Remember these cases alone."""
        for name in ("_noticed", "_slowest", "_meets", "_began"):
            setattr(self, name, getattr(self, name)[rows])

    def settled(self) -> BoolArray:
        """Always: while nothing comes nearer it does nothing, (n,)."""
        return np.ones(self._cases, dtype=bool)
