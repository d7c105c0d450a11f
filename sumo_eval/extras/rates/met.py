"""How often the points of a scenario occur: their exposure as a density, and its resamples.

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


class Met(NamedTuple):
    """How often a scenario's points occur: their exposure as a density p with the integral 1.

    `base` draws points by the parameters' distributions, but disregards constraints and the file's
    `exposure`. `base_density` is their density.

    joint: distribution of all parameters; None: each parameter has its own.
    scale: integral of the exposure over the possible points, by which p is divided.
    heaviest: largest ratio of p to `base_density`: the largest weight of a point drawn by `base`.
    """

    logical: LogicalScenario
    joint: Joint | None
    scale: float = 1.0
    heaviest: float = 1.0

    def base(self, count: int, stream: np.random.Generator) -> FloatArray:
        """Draw points (count, k), some of which may be impossible."""
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
        # of those in the box, which also meet the constraints
        possible[possible] = self.logical.feasible(points[possible])
        density[possible] = self.logical.exposure(self.logical.columns(points[possible]))
        return density / self.scale


def how_met(logical: LogicalScenario) -> Met:
    """The exposure of a scenario's points.

    Raises InputError for a scenario with listed values or without possible points.
    """
    listed = [item.name for item in logical.parameters if item.values]
    if listed:
        raise InputError(
            f"Scenario `{logical.name}` must have ranges, from which a campaign draws, got listed "
            f"values of `{listed[0]}`."
        )
    joint = logical.exposure.joint if isinstance(logical.exposure, ExposureDensity) else None
    unscaled = Met(logical, joint)
    points = unscaled.base(NORMALISED, random_stream(0, "normalised", logical.name))
    # 1e-300: a drawn point whose density is rounded to 0 must not divide by it
    ratio = unscaled.density(points) / np.maximum(unscaled.base_density(points), 1e-300)
    scale = ratio.mean()
    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError(f"Scenario `{logical.name}` must have possible points, got none.")
    return unscaled._replace(scale=scale, heaviest=ratio.max() / scale)


def resampled(met: Met, count: int, seed: int) -> list[tuple[Any, float]]:
    """Joint distributions over resampled events; none where the scenario has no joint distribution.

    count: number of resamples.

    Each comes with the ratio of its number of events to the recorded number. The number of times
    that an event counts is a Poisson draw of mean 1, as another stretch of road might have shown
    it.
    """
    if met.joint is None:
        return []
    stream = random_stream(seed, "events", met.logical.name)
    weights = stream.poisson(1.0, (count, len(met.joint.events))).astype(np.float64)
    return [
        # 1e-9: all may be drawn 0 times
        (replace(met.joint, weights=tuple((row + 1e-9).tolist())), row.mean())
        for row in weights
    ]
