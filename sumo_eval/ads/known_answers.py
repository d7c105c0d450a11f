"""ADSs whose result is known in closed form: one that does nothing, and the ideal vehicle of Eq. 17."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sumo_eval.ads.perception import lateral_overlap
from sumo_eval.cosim.compiled import Compiled, records
from sumo_eval.cosim.world import Records, fields
from sumo_eval.errors import must_be
from sumo_eval.kernels import kernel, rows


@rows
def no_reaction_rows(egos: Records, seen: Records, scenario: Records, time: float) -> None:
    """No acceleration, no steering, for every row."""
    for i in range(len(egos)):
        egos[i].settled = 1


class NoReaction(Compiled):
    """ADS `no_reaction`: keeps its speed and its wheel straight, whatever is ahead."""

    loop = staticmethod(no_reaction_rows)

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """It remembers nothing."""
        return ()


no_reaction = NoReaction()
"""ADS `no_reaction`, ready-made: it holds nothing of a case."""

_PARAMETERS = fields("deceleration")


@kernel
def ideal_braking(me: Any, others: Any, p: Any) -> float:
    """Full braking while closing on anything ahead, else roll, as an acceleration, m/s2."""
    for j in range(len(others)):
        other = others[j]
        if other.x > me.x and me.along > other.along and lateral_overlap(me, other) > 0.0:
            return float(-p.deceleration)
    return 0.0


@rows
def ideal_braking_rows(egos: Records, seen: Records, parameters: Records, scenario: Records, time: float) -> None:
    """`ideal_braking` for every row."""
    for i in range(len(egos)):
        if egos[i].live:
            egos[i].command.acceleration = ideal_braking(egos[i].seen, seen[i], parameters[i])


class IdealBraking(Compiled):
    """ADS `ideal_braking`, the reference Ug of Eq. 17: perfect perception, immediate braking at the road's limit.

    It brakes whenever it closes on any vehicle ahead in its path, a hidden one too, until it is as slow as that
    vehicle; it never drives faster again. The pressure build-up is the vehicle model's
    (`VehicleSettings.brake_build_up`, 0.15 s), as far as `deceleration` is the strongest that the vehicle has. So its
    impact speed is `criticality.ideal_impact_speed(..., deceleration=deceleration, delay=0, build_up=0.15)`. It is the
    reference, and drives every case to its end: it never settles.
    """

    loop = staticmethod(ideal_braking_rows)

    def __init__(self, deceleration: float = 9.0) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise must_be("`deceleration`", "ADS `ideal_braking`", "a finite number greater than 0 m/s2", deceleration)
        self.deceleration = deceleration

    @classmethod
    def arrays(cls, together: Sequence[Any], scenario: Records, others: int) -> tuple[Records, ...]:
        """Parameters."""
        return (records(together, _PARAMETERS),)
