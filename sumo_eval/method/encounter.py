"""Criticality of an encounter with an actor that moves in two dimensions, under ideal braking: Eqs.
2 and 5-6 searched.

The ego keeps its path and brakes ideally to a standstill from the obstacle's first move plus the
scenario's delay on; the obstacle follows its script. While both overlap across the road and the
obstacle is ahead, its inverse TTC counts; where the bodies touch it is infinite. An actor that
reacts is assumed to keep its speed. Where ways conflict (`conflict = true`) the time until both
would touch on them counts instead (`method.conflict`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sumo_eval.method.conflict import conflict_criticality, ego_size
from sumo_eval.scenario import ConcreteScenario, LogicalScenario
from sumo_eval.scenario.undisturbed import meetings
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import FloatArray

STEP = 0.02  # s between two looks
_AT_ONCE = 500  # points searched together
_LONGEST = 60.0  # s that are looked at, at most


def encounter(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """Eqs. 2 and 5-6: max ITTC, 1/s, impact speed, m/s, and the smallest gap in the ego's way, m,
    (3, n).

    logical: a scenario with a `search`.
    points: (n, k), in the parameters' units.
    settings: `[method.zones]`.

    Max ITTC is inf where ideal braking hits, 0 where the obstacle is never closed upon in the ego's
    way; the gap is inf where it is never in the way. Sampled every 0.02 s, so an ITTC below its
    peak by the motion of half a step.
    """
    parts = (points[begin : begin + _AT_ONCE] for begin in range(0, len(points), _AT_ONCE))
    return np.concatenate(
        [np.empty((3, 0)), *(_of(logical, part, settings) for part in parts)], axis=1
    )


def _of(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    search = logical.search
    assert search is not None
    size = ego_size(logical)
    values = [dict(zip(logical.names, row, strict=True)) for row in points.tolist()]
    placed = [logical.placed(point) for point in values]
    delays = [float(search.delay(point)) for point in values]
    if search.conflict:
        return conflict_criticality(placed, search.obstacle, delays, size, settings)
    fastest = max(concrete.ego.speed for concrete in placed)
    slowest_begin = logical.time_limit or _LONGEST
    until = min(
        slowest_begin,
        _LONGEST,
        max(delays) + fastest / settings.deceleration + _waits(logical, placed),
    )
    met = meetings(
        placed, [size] * len(placed), STEP, until, settings.deceleration, search.obstacle, delays
    )
    return met[:, :3].T


def _waits(logical: LogicalScenario, placed: Sequence[ConcreteScenario]) -> float:
    """How long the obstacle may take to begin, s: until the ego has come to the end of the road at
    its speed.
    """
    slowest = min(max(concrete.ego.speed, 1.0) for concrete in placed)
    longest = max((logical.road.length - concrete.ego.x) / slowest for concrete in placed)
    return min(longest, _LONGEST) if math.isfinite(longest) else _LONGEST
