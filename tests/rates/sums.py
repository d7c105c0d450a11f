"""Campaigns of three scenarios whose rates are known: collisions beyond a line of a plane of two
normal parameters."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Literal

import numpy as np
from scipy.special import ndtri

from sumo_eval.extras.rates.campaign import MILLION, EncounterSpace, part_of, summed
from sumo_eval.extras.rates.exposure import Exposure
from sumo_eval.extras.rates.importance import DEFENSIVE, estimated
from sumo_eval.scenario.joint import Joint
from sumo_eval.scenario.logical import Occurrence

Known = Literal["given", "counted", "fitted"]
"""How often a scenario is met, and with which parameters: both given, events counted, or both from
the events."""

# how often each is met, 1/km, and P of a collision in it
SCENARIOS = ((0.05, 3e-2), (0.2, 5e-3), (0.3, 2e-3))
EVENTS = 100  # of the first scenario, on average; the vehicle-km follow
REACH = 8.0  # the box of both parameters, in deviations


def normal_density(points, middle=0.0):
    """Of two normal parameters with deviation 1, the first around `middle`."""
    return np.exp(-0.5 * ((points[:, 0] - middle) ** 2 + points[:, 1] ** 2)) / (2.0 * np.pi)


@dataclass(frozen=True)
class Normal:
    """Points that are met as two independent normal parameters are."""

    joint: Joint | None = None
    heaviest: float = 1.0

    def base(self, count, stream):
        return stream.standard_normal((count, 2))

    def base_density(self, points):
        return normal_density(points)

    density = base_density


def rate_of(known, drives, seed):
    """One campaign: new recordings where they matter, new drives, and the rate that comes of them.

    A fifth of the drives is drawn as points are met, the others around the place where collisions
    begin.
    """
    stream = np.random.default_rng([seed, drives])
    kilometres = EVENTS / SCENARIOS[0][0]
    parts = []
    for number, (per_km, probability) in enumerate(SCENARIOS):
        edge = -float(ndtri(probability))
        events = None if known == "given" else int(stream.poisson(per_km * kilometres))
        exposure = Normal()
        if known == "fitted":
            rows = tuple(map(tuple, stream.standard_normal((events or 0, 2)).tolist()))
            joint = Joint("kde", ("a", "b"), rows, (-REACH,) * 2, (REACH,) * 2)
            exposure = Exposure(SimpleNamespace(name=str(number)), joint, 1.0, 1.0)
        space = EncounterSpace(
            str(number), SimpleNamespace(name=f"{seed} {number}"), exposure,
            per_km if events is None else events / kilometres,
            None if events is None else Occurrence(events, kilometres),
        )  # fmt: skip
        points = np.where(
            stream.uniform(size=(drives, 1)) < DEFENSIVE, exposure.base(drives, stream),
            stream.standard_normal((drives, 2)) + np.array([edge, 0.0]),
        )  # fmt: skip
        p = exposure.base_density(points)
        weights = p / (DEFENSIVE * p + (1.0 - DEFENSIVE) * normal_density(points, edge))
        collided = points[:, 0] > edge
        loss = np.minimum(0.2 + 0.2 * (points[:, 0] - edge), 1.0) * collided
        told = estimated(
            weights[collided], loss[collided], drives, 1.0, int(collided.sum()), drives
        )
        search = SimpleNamespace(
            estimate=lambda told=told: told, in_estimate=np.ones(drives, dtype=np.bool_),
            collided=collided,
            weights=weights, loss=loss, drawn=drives, points=points,
        )  # fmt: skip
        parts.append(part_of(space, search, seed, "budget", {}))
    return summed("x", "x", parts)


def truth():
    """Collisions per million km of such a campaign."""
    return MILLION * sum(per_km * probability for per_km, probability in SCENARIOS)
