"""How sure the zone boundary is: the posterior of the Gaussian process of Eqs. 7-8 beside its mean."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from sumo_eval.method.zone_partition import TARGET_TOLERANCE, ZonePartition
from sumo_eval.trajectory import FloatArray

NEAR = 4.0  # posterior deviations from the boundary beyond which a point is on its side for sure
SMALLEST = 1e-9  # variance that is rounding
AT_ONCE = 1024  # points whose covariances with all training points are held at a time


def posterior_factor(zones: ZonePartition, points: ArrayLike) -> FloatArray:
    """A matrix (n, m) that makes m standard normal numbers into a draw of y - mean(y) at points (n, k).

    Only the points whose side is open have entries; for all others, and where no GP was fitted, the rows are 0.
    """
    rows = np.asarray(points, dtype=np.float64)
    surface = zones.surface
    nothing = np.zeros((len(rows), 0))
    if not len(surface.points) or not len(rows):
        return nothing
    scale = surface.length_scales

    def covariance(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.asarray(surface.signal_deviation**2 * np.exp(-0.5 * cdist(a / scale, b / scale, "sqeuclidean")))

    noise = surface.noise_deviation**2 + (TARGET_TOLERANCE * zones.training_target) ** 2
    known = cho_factor(covariance(surface.points, surface.points) + np.diag(noise), lower=True)
    unit = surface.coordinates(zones.logical.to_unit(rows))
    variance = np.empty(len(rows))
    for first in range(0, len(rows), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        cross = covariance(unit[some], surface.points)
        variance[some] = surface.signal_deviation**2 - np.einsum("ij,ji->i", cross, cho_solve(known, cross.T))
    y = zones.predicted(rows)
    open_ = np.abs(y) < NEAR * np.sqrt(np.maximum(variance, SMALLEST))
    if not open_.any():
        return nothing
    cross = covariance(unit[open_], surface.points)
    joint = covariance(unit[open_], unit[open_])
    joint -= cross @ cho_solve(known, cross.T)
    joint = joint + joint.T
    joint /= 2.0
    values, vectors = np.linalg.eigh(joint)
    kept = values > SMALLEST
    factor = np.zeros((len(rows), int(kept.sum())))
    factor[open_] = vectors[:, kept] * np.sqrt(values[kept])
    return factor
