"""An ADS that does nothing, and the ideal vehicle of Eq. 17. `record/` drives both in every
concrete scenario, for U0 and Ug.

The kernels take the arguments of every rule (`cosim.compiled.each_row`). In a `MOVER`, x is the
position and `along` the speed, both along the road.

Users: `cosim/doors/controller.py`, `record/worker.py`; `foreseeing`: `cosim/ego_control.py`,
`record/loops.py`.
"""

from collections.abc import Sequence
from math import inf, isfinite
from typing import Any

import numpy as np

from sumo_eval.ads.braking import switched
from sumo_eval.ads.foresight import Foresight, evasion, foresee
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
from sumo_eval.cosim.records import MOVER
from sumo_eval.errors import ControllerError, must_be
from sumo_eval.kernels import Records, fields, kernel
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings


@kernel
def _no_reaction(
    ego: Any, others: Any, own: Any, watched: Any, others_then: Any, scenario: Any
) -> None:
    """No acceleration and no steering but the road's own."""
    ego.command.steering = lane_kept(ego, scenario[0])
    ego.settled = 1  # the drive may end once its outcome is decided


class NoReaction(Compiled):
    """ADS `no_reaction`: keeps its speed, whatever is ahead, and its wheel straight or, on a curve,
    its lane.
    """

    loop = each_row(_no_reaction)


no_reaction = NoReaction()
"""ADS `no_reaction`, one object for all cases: it has no memory."""

# m; allowance for a vehicle that is turning into the lane: once it is straight, its body reaches
# further along the road
_TURNED = 0.2
_KNOWN = fields(*Foresight._fields)
"""A `Foresight` as a record, for kernels; its flags are 0.0 or 1.0."""


@kernel
def is_too_close_to_hider(
    me: Any, others: Any, watched: Any, p: Any, scenario: Any, time: float
) -> bool:
    """Whether an actor that the ego would touch is still hidden, and the gap to the lead vehicle,
    which may hide it, is not safe.

    p: parameters of `IdealBraking`. Other arguments as in `full_braking`.
    """
    lead = lead_in_path(me, others)
    if lead < 0:
        return False
    for j in range(len(others)):
        known = watched[j]
        if known.meets > 0.0 and known.hidden > 0.0 and time < known.noticed:
            build_up = p.deceleration / scenario.vehicle.brake_jerk  # s until it brakes fully
            return bumper_gap(me, others[lead]) < safe_gap(
                me.along, others[lead].along, p.deceleration, build_up
            )
    return False


@kernel
def full_braking(me: Any, others: Any, watched: Any, p: Any, scenario: Any, time: float) -> float:
    """Acceleration, m/s2: full braking from the instant within the step at which an actor first
    calls for it.

    Before that instant the ego brakes fully, too, where it is too close to a vehicle that hides
    another.

    watched: a `_KNOWN` of each actor.
    time: now, s.
    """
    level = p.deceleration if is_too_close_to_hider(me, others, watched, p, scenario, time) else 0.0
    first_noticed = inf  # time of the first sight of an actor that the ego would touch, s
    for j in range(len(others)):
        if watched[j].meets > 0.0:
            first_noticed = min(first_noticed, watched[j].noticed)
    begins = inf  # time of the first call for braking, s
    for j in range(len(others)):
        other, known = others[j], watched[j]
        # an actor ahead, in the ego's path, that the ego comes nearer to: the ego calls from its
        # first sight, even if it would not touch that actor at a constant speed
        closes = other.x > me.x and me.along > other.along and lateral_overlap(me, other) > 0.0
        calls = closes and time > first_noticed
        if known.meets > 0.0:
            is_faster = me.along > known.speed  # than the actor's lowest speed in the case
            alongside = abs(other.x - me.x) < me.half_length + other.half_length + _TURNED
            calls = calls or is_faster or alongside
        if calls:
            begins = min(begins, known.noticed)
    return -switched(
        level, p.deceleration, begins - time, scenario.vehicle.brake_jerk, scenario.step
    )


@kernel
def ideal_braking(
    ego: Any, others: Any, own: Any, watched: Any, others_then: Any, scenario: Any
) -> None:
    """Full braking, or, at a constant speed, the lane change of `foresight.evasion`.

    The ego counts as settled in every step, as it never accelerates again.
    """
    me, command, time = ego.seen, ego.command, ego.time
    shared = scenario[0]
    if own.path.offset == 0.0:  # it does not steer
        command.acceleration = full_braking(me, others, watched, own.p, shared, time)
        command.steering = lane_kept(ego, shared)
    else:
        if time == 0.0:
            own.curvature = curvature_kept(own.path, me)
        y, slope, curvature = path_at(own.path, rear_axle_next(me, shared))
        command.steering = steering(own, me, y, slope, curvature, shared)
    ego.settled = 1


class IdealBraking(Compiled):
    """ADS `ideal_braking`, the reference Ug of Eq. 17: perfect perception, immediate braking at the
    road's limit.

    It knows what the actors will do (`ads/foresight.py`). It keeps its speed where that causes no
    contact: braking could only cause one.

    Where it would touch an actor, it brakes as hard as the road allows, from the first change of
    that actor's motion that it can see. It brakes as long as it is alongside that actor or faster
    than the actor's lowest speed in the case; it never speeds up again. From the first change on it
    also brakes while it closes on any vehicle in its path: the foresight is for an ego of constant
    speed, and an ego that has braked meets vehicles that it would have passed.

    While an actor that it would touch is hidden, it keeps a safe distance to the lead vehicle
    (`safe_gap`, with its own brakes and the time that they need): while it is nearer, it brakes
    fully. Otherwise an ADS that opens such a gap at once, as `idm` does, would be slower when the
    hidden actor comes in sight.

    Where the hidden vehicle comes in sight so late that no braking stops short of it, the ideal
    vehicle steers round it, if the lane on the left is certainly free (`foresight.evasion`). The
    ADS `lane_changer` would, and no ADS may have a smaller U than the reference.

    The brake pressure builds up as in the vehicle model (`VehicleSettings.brake_build_up`, 0.15 s),
    if `deceleration` is the strongest that the vehicle has. So its impact speed behind a vehicle
    that it sees from the start is `criticality.ideal_impact_speed(..., deceleration=deceleration,
    delay=0, build_up=0.15)`.

    deceleration: at which it brakes, m/s2.
    """

    loop = each_row(ideal_braking)
    memory, watched = [("path", PATH), *fields("curvature")], _KNOWN
    """path: to the lane on the left, if it steers. curvature: of its present steering, 1/m.
    watched: `_KNOWN` of each actor.
    """
    numbers = fields("deceleration")

    def __init__(self, deceleration: float = 9.0) -> None:
        if not (isfinite(deceleration) and deceleration > 0.0):
            raise must_be(
                "`deceleration`",
                "ADS `ideal_braking`",
                "a finite number greater than 0 m/s2",
                deceleration,
            )
        self.deceleration = deceleration

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Always an error: the loop calls `foreseeing` instead for this class. A subclass may be a
        user's ADS, which must not know the scripts: for it the loop calls this.
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
        """`arrays` of a rule that knows the scripts: with the evasion of each case and a
        `Foresight` of each actor, (cases, actors). All cases have the same number of actors.
        """
        own, foresights = cls.own_records(together), list(map(foresee, cases, settings))
        own["path"] = [
            evasion(concrete, case_settings, foreseen, ads.deceleration)
            for ads, concrete, case_settings, foreseen in zip(
                together, cases, settings, foresights, strict=True
            )
        ]
        known = np.array(list(map(list, foresights)), _KNOWN)
        unused = np.zeros(known.shape, MOVER)  # scratch records of other rules (`others_then`)
        return own, known, unused
