"""A Gaussian process's mean from the textbook, one point at a time; the nearest boundary by looking
all around."""

import numpy as np
from scipy.optimize import minimize_scalar


def posterior_mean(point, points, targets, length_scales, signal_deviation, variances):
    """k(x, X) (K + diag(variances))^-1 y with k = sf^2 exp(-sum(((a - b) / l)^2) / 2), at one
    point."""

    def covariance(a, b):
        return signal_deviation**2 * np.exp(
            -0.5 * np.sum(((np.asarray(a) - np.asarray(b)) / length_scales) ** 2)
        )

    matrix = np.array([[covariance(a, b) for b in points] for a in points]) + np.diag(variances)
    return float(
        np.array([covariance(point, b) for b in points]) @ np.linalg.solve(matrix, targets)
    )


def distance_to_change(point, label, reach=1.5, directions=180, steps=300):
    """Distance from a point of the unit square to the nearest change of a label, seen along
    rays."""
    angles = np.linspace(0.0, 2 * np.pi, directions, endpoint=False)
    radii = np.linspace(0.0, reach, steps + 1)
    rays = (
        point
        + radii[None, :, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None, :]
    )
    within = np.all((rays >= 0.0) & (rays <= 1.0), axis=-1)
    seen = np.zeros(within.shape, dtype=bool)
    seen[within] = label(rays[within])
    changed = within & (seen != label(point[None, :])[0])
    first = np.where(changed.any(axis=1), np.argmax(changed, axis=1), steps + 1)
    nearest = int(first.min())
    here = label(point[None, :])[0]

    def radius(angle):
        heading = np.array([np.cos(angle), np.sin(angle)])
        low, high = radii[max(nearest - 3, 0)], radii[min(nearest + 3, steps)]
        for _ in range(45):
            middle = (low + high) / 2
            same = label(np.clip(point + middle * heading, 0.0, 1.0)[None, :])[0] == here
            low, high = (middle, high) if same else (low, middle)
        return high

    best = min(angles[first <= nearest + 1], key=radius)
    turn = 2 * np.pi / directions
    found = minimize_scalar(
        radius, bounds=(best - turn, best + turn), method="bounded", options={"xatol": 1e-9}
    )
    return float(found.fun)
