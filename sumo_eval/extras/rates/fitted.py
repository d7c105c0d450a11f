"""Speeds and paths for a scenario file: a recorded drive, described by few points.

Users: `extras/rates/recorded_scene.py`.
"""

import math

import numpy as np

from sumo_eval.trajectory import FloatArray

KNOTS = 0.5  # s between two knots, the times at which the file has a speed


def fit_speeds(time: FloatArray, driven: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times of knots, s, and speeds at these times, m/s, none below 0.

    The speed is linear between knots, and its integral is the least squares fit to `driven`.

    time: s, (n,); the first knot is at the first time.
    driven: distance driven at these times, m, (n,).
    """
    from scipy.interpolate import make_interp_spline
    from scipy.optimize import lsq_linear

    begin, end = time[0], time[-1]
    count = max(round((end - begin) / KNOTS), 1) + 1
    knots = np.linspace(begin, end, count)
    # Column k of `unit_speeds` is a speed that is 1 m/s at knot k and 0 at all other knots. Column
    # k of `distances` is the distance driven at this speed.
    unit_speeds = make_interp_spline(knots, np.eye(count), k=1)
    distances = unit_speeds.antiderivative()(time)
    return knots, lsq_linear(distances, driven - driven[0], bounds=(0.0, np.inf)).x


def thinned(x: FloatArray, y: FloatArray, tolerance: float) -> list[int]:
    """Indices of the points that a line needs to stay within `tolerance` of all its points.

    x, y: points of the line, m, (n,).
    tolerance: m.

    Source: Douglas and Peucker (1973).
    """
    end = len(x) - 1
    needed = {0, end}
    parts = [(0, end)]  # indices of the first and last point of each part that is to be examined
    while parts:
        first, last = parts.pop()
        dx, dy = x[last] - x[first], y[last] - y[first]
        length = math.hypot(dx, dy)
        px, py = x[first + 1 : last] - x[first], y[first + 1 : last] - y[first]
        # Distances of the points between from the straight line through first and last, or from
        # both where these are one place.
        off = np.abs(px * dy - py * dx) / length if length > 0.0 else np.hypot(px, py)
        if off.size and off.max() > tolerance:
            farthest = first + 1 + int(off.argmax())
            needed.add(farthest)
            parts += [(first, farthest), (farthest, last)]
    return sorted(needed)
