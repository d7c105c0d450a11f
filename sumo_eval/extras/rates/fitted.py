"""Speeds and paths of a scenario file, fitted to a recorded drive with few points.

Users: `extras/rates/recorded_scene.py`.
"""

import math

import numpy as np

from sumo_eval.trajectory import FloatArray

KNOTS = 0.5  # s between two knots, times for which the file has a speed


def fit_speeds(time: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times of knots, s, and speeds there, m/s, none below 0.

    Speed is linear between knots, and its integral is the least squares fit to `way`.

    time: s, (n,); the first knot is at the first time.
    way: distance driven at these times, m, (n,).
    """
    from scipy.interpolate import make_interp_spline
    from scipy.optimize import lsq_linear

    begin, end = time[0], time[-1]
    count = max(round((end - begin) / KNOTS), 1) + 1
    knots = np.linspace(begin, end, count)
    # Column k of `hats`: a speed that is 1 m/s at knot k and 0 at all others. Column k of
    # `distances`: the distance driven at this speed.
    hats = make_interp_spline(knots, np.eye(count), k=1)
    distances = hats.antiderivative()(time)
    return knots, lsq_linear(distances, way - way[0], bounds=(0.0, np.inf)).x


def thinned(x: FloatArray, y: FloatArray, tolerance: float) -> list[int]:
    """Indices of the points that a line needs to stay within `tolerance` of its former course.

    x, y: points of the line, m, (n,).
    tolerance: m.

    Source: Douglas and Peucker (1973).
    """
    end = len(x) - 1
    kept = {0, end}
    parts = [(0, end)]  # first and last point of each part of the line that is to be examined
    while parts:
        a, b = parts.pop()
        dx, dy = x[b] - x[a], y[b] - y[a]
        length = math.hypot(dx, dy)
        px, py = x[a + 1 : b] - x[a], y[a + 1 : b] - y[a]
        # distances of the points between from the straight line; from its ends if these coincide
        off = np.abs(px * dy - py * dx) / length if length > 0.0 else np.hypot(px, py)
        if off.size and off.max() > tolerance:
            middle = a + 1 + int(off.argmax())
            kept.add(middle)
            parts += [(a, middle), (middle, b)]
    return sorted(kept)
