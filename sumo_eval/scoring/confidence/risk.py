"""Risk: how probable a collision is, and how much loss to expect, over the space as it occurs on
the road.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.errors import must_be
from sumo_eval.scoring.confidence.intervals import LEVEL, REPLICATES, Interval
from sumo_eval.scoring.confidence.resamples import one_list, resamples
from sumo_eval.trajectory import FloatArray


@dataclass(frozen=True, slots=True)
class Risk:
    """Exposure-weighted collision probability and expected loss L (Eq. 14) of an encounter.

    effective_cases: how many equally frequent cases would tell as much (Kish).
    """

    collision_probability: Interval
    expected_loss: Interval
    effective_cases: float


def risk(exposure: FloatArray, loss: FloatArray, seed: int, name: Sequence[str] = ()) -> Risk:
    """exposure: p (n,) of the evaluated cases.
    loss: L (n,), 0 without a collision.
    name: of the random stream.

    A bootstrap over the cases. Where no case, or every case, collided, a bootstrap knows no doubt:
    there the upper
    (lower) limit is the exact binomial one for the effective number of cases, 1 - (1 - level)/2 to
    the power 1/n.
    """
    n = len(exposure)
    if n < 2 or not exposure.sum() > 0.0:
        raise must_be("The cases", "a risk", "at least 2, with exposure above 0", n)
    hit = (loss > 0.0).astype(np.float64)
    terms, sums = (
        np.column_stack([exposure, exposure * hit, exposure * loss]),
        np.zeros((REPLICATES, 3)),
    )
    for part in resamples(one_list(n), REPLICATES, seed, ("risk", *name)):
        sums += part.counts @ terms[part.places]
    over, hits, losses = sums.T
    drawn = over > 0.0
    effective = float(exposure.sum() ** 2 / np.sum(exposure**2))
    tail = (1.0 - LEVEL) / 2.0
    unseen = 1.0 - tail ** (1.0 / effective)

    def interval(values: FloatArray, sums: FloatArray) -> Interval:
        low, high = np.quantile(sums[drawn] / over[drawn], [tail, 1.0 - tail])
        if not hit.any():
            high = unseen  # a loss is at most 1
        elif hit.all():
            low = float(low) * (1.0 - unseen)
        return Interval(float(exposure @ values / exposure.sum()), float(low), float(high))

    return Risk(interval(hit, hits), interval(loss, losses), effective)
