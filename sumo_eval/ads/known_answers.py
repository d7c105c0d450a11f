"""ADSs whose result is known in closed form: one that does nothing, and the ideal vehicle of Eq.
17.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_eval.ads.braking import switched
from sumo_eval.ads.foresight import evasion, foresee
from sumo_eval.ads.lane_change import (
    PATH,
    curvature_kept,
    lane_kept,
    path_at,
    rear_axle_next,
    steering,
)
from sumo_eval.ads.perception import bumper_gap, lateral_overlap, lead_in_path, safe_gap
from sumo_eval.cosim.compiled import Compiled, each_row
from sumo_eval.cosim.records import MOVER, Records, fields
from sumo_eval.errors import ControllerError, must_be
from sumo_eval.kernels import kernel
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings


@kernel
def _no_reaction(ego: Any, others: Any, own: Any, known: Any, later: Any, scenario: Any) -> None:
    """No acceleration and no steering but the road's own."""
    ego.command.steering = lane_kept(ego, scenario[0])
    ego.settled = 1


class NoReaction(Compiled):
    """ADS `no_reaction`: keeps its speed and its wheel straight, whatever is ahead; on a curve,
    its lane.
    """

    loop = staticmethod(each_row(_no_reaction))


no_reaction = NoReaction()
"""ADS `no_reaction`, ready-made: it holds nothing of a case."""

# m by which somebody who turns into the lane comes to reach further along it than he does now
_TURNED = 0.2
_KNOWN = fields("noticed", "meets", "speed", "hidden")
"""A `Foresight`."""


@kernel
def is_too_close_to_see(
    me: Any, others: Any, known: Any, p: Any, scenario: Any, time: float
) -> bool:
    """Whether the lead vehicle hides a vehicle that the ego would touch, and is nearer than is
    safe.
    """
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
def full_braking(me: Any, others: Any, known: Any, p: Any, scenario: Any, time: float) -> float:
    """Full braking for any vehicle that calls for it, from within the step in which it first does,
    as an acceleration, m/s2.

    Before that, too close behind the vehicle that hides it, it brakes as hard.

    known: a `Foresight` of each actor.
    """
    level = p.deceleration if is_too_close_to_see(me, others, known, p, scenario, time) else 0.0
    began = begins = math.inf
    for j in range(len(others)):
        if known[j].meets > 0.0:
            began = min(began, known[j].noticed)
    for j in range(len(others)):
        other = others[j]
        closes = other.x > me.x and me.along > other.along and lateral_overlap(me, other) > 0.0
        called = closes and time > began
        if known[j].meets > 0.0:
            beside = abs(other.x - me.x) < me.half_length + other.half_length + _TURNED
            called = called or me.along > known[j].speed or beside
        if called:
            begins = min(begins, known[j].noticed)
    return -float(
        switched(level, p.deceleration, begins - time, scenario.vehicle.brake_jerk, scenario.step)
    )


@kernel
def ideal_braking(ego: Any, others: Any, own: Any, known: Any, later: Any, scenario: Any) -> None:
    """`full_braking`, or the lane change of one that steers at the speed it has.

    It has always settled: while nothing comes nearer it does nothing.
    """
    me, command, time = ego.seen, ego.command, ego.time
    if own.path.offset == 0.0:
        command.acceleration = full_braking(me, others, known, own.p, scenario[0], time)
        command.steering = lane_kept(ego, scenario[0])
    else:
        if time == 0.0:
            own.curvature = curvature_kept(own.path, me)
        y, slope, bend = path_at(own.path, rear_axle_next(me, scenario[0]))
        command.steering = steering(own, me, y, slope, bend, scenario[0])
    ego.settled = 1


class IdealBraking(Compiled):
    """ADS `ideal_braking`, the reference Ug of Eq. 17: perfect perception, immediate braking at the
    road's limit.

    It knows what the actors will do (`foresight`). From the first change of state that it can see
    of a vehicle that it would touch if it kept its speed, it brakes as hard as the road allows,
    until it is neither faster than that vehicle will ever be again nor alongside; it never drives
    faster again. Where keeping its speed touches no vehicle, it keeps it: braking may only then
    cause a contact. Once slower it also brakes while it closes on any vehicle in its path: one that
    keeps its speed leaves earlier, and later acts are not foreseen.

    It does not know what a lead vehicle hides, and therefore keeps a safe distance to that vehicle
    (`safe_gap`, with its own brakes and the time that they need): as long as it is nearer it brakes
    as hard. Without that, an ADS that opens such a gap at once, as `idm` does, would be slower when
    what was hidden shows.

    Where what was hidden shows so late that no braking stops short of it, it steers round it
    instead, if the lane on the left is free for sure (`evasion`): `lane_changer` would, and no ADS
    may be gentler.

    The pressure build-up is the vehicle model's (`VehicleSettings.brake_build_up`, 0.15 s), as far
    as `deceleration` is the strongest that the vehicle has. So its impact speed behind a vehicle
    that it sees from the start is `criticality.ideal_impact_speed(..., deceleration=deceleration,
    delay=0, build_up=0.15)`.
    """

    loop = staticmethod(each_row(ideal_braking))
    memory, known, numbers = [("path", PATH), *fields("curvature")], _KNOWN, fields("deceleration")
    """path: to the lane on the left, if it steers. curvature: that is steered now, 1/m."""

    def __init__(self, deceleration: float = 9.0) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise must_be(
                "`deceleration`",
                "ADS `ideal_braking`",
                "a finite number greater than 0 m/s2",
                deceleration,
            )
        self.deceleration = deceleration

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Nothing can be made without the scripts: only the loop tells them, and only to this very
        class.
        """
        raise ControllerError(
            "The ideal vehicle must know the scripts of the actors; only `ideal_braking` does"
        )

    @classmethod
    def foreseeing(
        cls,
        together: Sequence[Any],
        cases: Sequence[ConcreteScenario],
        settings: Sequence[SimulationSettings],
    ) -> tuple[Records, ...]:
        """`arrays`, with the evasion of each case and what is known of its others."""
        known, own = list(map(foresee, cases, settings)), cls.own_records(together)
        of_each = zip(together, cases, settings, known, strict=True)
        for i, (ads, concrete, its, others) in enumerate(of_each):
            own[i]["path"] = evasion(concrete, its, others, ads.deceleration)
        told = np.array([[tuple(other) for other in others] for others in known], dtype=_KNOWN)
        told = told.reshape(len(cases), len(cases[0].actors))
        return own, told, np.zeros(told.shape, MOVER)
