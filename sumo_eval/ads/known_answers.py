"""ADSs whose result is known in closed form: one that does nothing, and the ideal vehicle of Eq. 17."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_eval.ads.braking import switched
from sumo_eval.ads.foresight import foresee
from sumo_eval.ads.lane_change import lane_kept
from sumo_eval.ads.perception import bumper_gap, lateral_overlap, lead_in_path
from sumo_eval.cosim.compiled import Compiled, records
from sumo_eval.cosim.world import Records, fields
from sumo_eval.errors import ControllerError, must_be
from sumo_eval.kernels import kernel, rows
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings


@rows
def no_reaction_rows(egos: Records, seen: Records, scenario: Records, time: float) -> None:
    """No acceleration and no steering but the road's own, for every row."""
    for i in range(len(egos)):
        if egos[i].live:
            egos[i].command.steering = lane_kept(egos[i], scenario[0])
        egos[i].settled = 1


class NoReaction(Compiled):
    """ADS `no_reaction`: keeps its speed and its wheel straight, whatever is ahead; where the road bends, its lane."""

    loop = staticmethod(no_reaction_rows)

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """It remembers nothing."""
        return ()


no_reaction = NoReaction()
"""ADS `no_reaction`, ready-made: it holds nothing of a case."""

_PARAMETERS = fields("deceleration")
_KNOWN = fields("noticed", "meets", "speed", "hidden")
"""A `Foresight`."""
LEAST_GAP = 2.0  # m to a vehicle that hides the road ahead: the least distance of the following gaps of UN R157


@kernel
def safe_gap(speed: float, lead_speed: float, deceleration: float, response: float) -> float:
    """Gap from which two vehicles that brake equally hard come to rest `LEAST_GAP` apart, m.

    d = max(0, v rho + (v^2 - w^2) / (2 b)) + 2 m: the longitudinal distance of Responsibility-Sensitive Safety for one
    that does not speed up in between (Shalev-Shwartz et al. 2017, Definition 1).
    speed: v, lead_speed: w, m/s. deceleration: b, m/s2. response: rho, s.
    """
    rolled = speed * response + (speed * speed - lead_speed * lead_speed) / (2.0 * deceleration)
    return max(rolled, 0.0) + LEAST_GAP


@kernel
def is_too_close_to_see(me: Any, others: Any, known: Any, p: Any, scenario: Any, time: float) -> bool:
    """Whether the vehicle ahead hides somebody whom it would touch, and is nearer than is safe."""
    lead = lead_in_path(me, others)
    if lead < 0:
        return False
    for j in range(len(others)):
        if known[j].meets > 0.0 and known[j].hidden > 0.0 and time < known[j].noticed:
            response = p.deceleration / scenario.vehicle.brake_jerk
            safe = safe_gap(me.along, others[lead].along, p.deceleration, response)
            return bool(bumper_gap(me, others[lead]) < safe)
    return False


@kernel
def ideal_braking(me: Any, others: Any, known: Any, p: Any, scenario: Any, time: float) -> float:
    """Full braking for anybody who calls for it, from within the step in which he first does, as an acceleration, m/s2.

    Before that, too close behind the vehicle that hides him, it brakes as hard. known: of each of the others, a
    `Foresight`.
    """
    level = p.deceleration if is_too_close_to_see(me, others, known, p, scenario, time) else 0.0
    began = begins = math.inf
    for j in range(len(others)):
        if known[j].meets > 0.0:
            began = min(began, known[j].noticed)
    for j in range(len(others)):
        other = others[j]
        if known[j].meets > 0.0:
            beside = abs(other.x - me.x) < me.half_length + other.half_length
            called = me.along > known[j].speed or beside
        else:
            closes = other.x > me.x and me.along > other.along and lateral_overlap(me, other) > 0.0
            called = closes and time > began
        if called:
            begins = min(begins, known[j].noticed)
    return -float(switched(level, p.deceleration, begins - time, scenario.vehicle.brake_jerk, scenario.step))


@rows
def ideal_braking_rows(
    egos: Records, seen: Records, known: Records, parameters: Records, scenario: Records, time: float
) -> None:
    """`ideal_braking` for every row. It has always settled: while nothing comes nearer it does nothing."""
    for i in range(len(egos)):
        if egos[i].live:
            egos[i].command.acceleration = ideal_braking(
                egos[i].seen, seen[i], known[i], parameters[i], scenario[0], time
            )
            egos[i].command.steering = lane_kept(egos[i], scenario[0])
            egos[i].settled = 1


class IdealBraking(Compiled):
    """ADS `ideal_braking`, the reference Ug of Eq. 17: perfect perception, immediate braking at the road's limit.

    It knows what the others will do (`foresight`). From the first change of state that it can see of a vehicle that it
    would touch if it kept its speed, it brakes as hard as the road allows, until it is neither faster than that vehicle
    will ever be again nor beside it; it never drives faster again. Where keeping its speed touches nobody, it keeps
    it: braking may only then cause a contact. Once slower it brakes, besides, while it closes on anybody in its path.

    What a vehicle ahead hides it does not know, and therefore keeps a safe distance to that vehicle (`safe_gap`, with
    its own brakes and the time that they need): as long as it is nearer it brakes as hard. Without that, whoever opens
    such a gap at once, as `idm` does, is slower than it when what was hidden shows.

    The pressure build-up is the vehicle model's (`VehicleSettings.brake_build_up`, 0.15 s), as far as `deceleration` is
    the strongest that the vehicle has. So its impact speed behind a vehicle that it sees from the start is
    `criticality.ideal_impact_speed(..., deceleration=deceleration, delay=0, build_up=0.15)`.
    """

    loop = staticmethod(ideal_braking_rows)

    def __init__(self, deceleration: float = 9.0) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise must_be("`deceleration`", "ADS `ideal_braking`", "a finite number greater than 0 m/s2", deceleration)
        self.deceleration = deceleration

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Nothing can be made without the scripts: only the loop tells them, and only to this very class."""
        raise ControllerError("The ideal vehicle must be told the scripts of the others; only `ideal_braking` is")

    @classmethod
    def foreseeing(
        cls, together: Sequence[Any], cases: Sequence[ConcreteScenario], settings: SimulationSettings
    ) -> tuple[Records, ...]:
        """What is known of the others of each case, and parameters."""
        known = [[tuple(other) for other in foresee(concrete, settings)] for concrete in cases]
        shape = len(cases), len(cases[0].actors)
        return np.array(known, dtype=_KNOWN).reshape(shape), records(together, _PARAMETERS)
