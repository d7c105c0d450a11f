"""A Gaussian process's mean from the textbook, one point at a time."""

import numpy as np


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
