"""Exposure of a scenario's points: how often they occur, as a density, and its resamples.

A campaign draws points with it (`importance`), and resamples the recorded events behind it.

Users: `extras/rates/campaign.py`, `extras/rates/importance.py`.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.scenario.formulas import ExposureDensity
from sumo_eval.scenario.joint import Joint
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

NORMALISED = 65_536  # draws that estimate the integral of the exposure


class Exposure(NamedTuple):
    """How often a scenario's points occur: their exposure as a density p with the integral 1.

    `base` draws points by the parameters' distributions. It disregards constraints and the
    `exposure` of the scenario's file. `base_density` is the density of these points.

    joint: distribution of all parameters; None: each parameter has its own.
    scale: integral of the exposure over the possible points, by which p is divided.
    heaviest: largest ratio of p to `base_density`: the largest weight of a point drawn by `base`.
    """

    logical: LogicalScenario
    joint: Joint | None
    scale: float = 1.0
    heaviest: float = 1.0

    def base(self, count: int, stream: np.random.Generator) -> FloatArray:
        """Draw points (count, k), some of which may be impossible.

        k: number of parameters.
        """
        if self.joint is not None:
            return self.joint.draw(count, stream)
        shares = stream.uniform(size=(count, len(self.logical.names)))
        points = self.logical.from_unit(shares)
        for column, item in enumerate(self.logical.parameters):
            if item.distribution is not None:
                points[:, column] = item.distribution.quantile(
                    shares[:, column], item.low, item.high
                )
        return points

    def base_density(self, points: FloatArray) -> FloatArray:
        """The density (n,) of `base` at points (n, k)."""
        if self.joint is not None:
            return self.joint.density(points) / self.joint.mass()
        density = self.logical.in_box(points).astype(np.float64)
        for column, item in zip(points.T, self.logical.parameters, strict=True):
            if item.distribution is None:
                density /= item.high - item.low
            else:
                density *= item.distribution.density(column, item.low, item.high)
        return density

    def density(self, points: FloatArray) -> FloatArray:
        """p (n,) at points (n, k): 0 outside the box and where a constraint forbids them."""
        density = np.zeros(len(points))
        possible = self.logical.in_box(points)
        # only points in the box can be checked against the constraints
        possible[possible] = self.logical.feasible(points[possible])
        density[possible] = self.logical.exposure(self.logical.columns(points[possible]))
        return density / self.scale


def normalised_exposure(logical: LogicalScenario) -> Exposure:
    """The exposure of a scenario's points, with its scale and largest weight estimated.

    Raises InputError for a scenario with listed values or without possible points.
    """
    listed = [item.name for item in logical.parameters if item.values]
    if listed:
        raise InputError(
            f"Scenario `{logical.name}` must have ranges, from which a campaign draws, got listed "
            f"values of `{listed[0]}`."
        )
    joint = logical.exposure.joint if isinstance(logical.exposure, ExposureDensity) else None
    unscaled = Exposure(logical, joint)
    points = unscaled.base(NORMALISED, random_stream(0, "normalised", logical.name))
    # p over the density of the draws: its mean estimates the integral of p.
    # 1e-300: a drawn point whose density is rounded to 0 must not divide by 0.
    ratio = unscaled.density(points) / np.maximum(unscaled.base_density(points), 1e-300)
    scale = ratio.mean()
    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError(f"Scenario `{logical.name}` must have possible points, got none.")
    return unscaled._replace(scale=scale, heaviest=ratio.max() / scale)


def resampled(exposure: Exposure, count: int, seed: int) -> list[tuple[Any, float]]:
    """Resamples of the recorded events, each as a joint distribution and the ratio of its number of
    events to the recorded number. None where the scenario has no joint distribution.

    An event counts a number of times that is a Poisson draw of mean 1: as often as an equal stretch
    of road might have shown it.

    count: number of resamples.
    """
    if exposure.joint is None:
        return []
    stream = random_stream(seed, "events", exposure.logical.name)
    weights = stream.poisson(1.0, (count, len(exposure.joint.events))).astype(np.float64)
    return [
        # 1e-9: a distribution needs weights above 0, also where every event is drawn 0 times
        (replace(exposure.joint, weights=tuple((row + 1e-9).tolist())), row.mean())
        for row in weights
    ]
