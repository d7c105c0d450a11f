"""Trajectory field of a vehicle, Eqs. 9-10: how strongly a driven trajectory is felt at points of
the road.

Readings of the paper (docs/method.md):
- Magnitudes are summed. With the printed unit vectors the terms would cancel on the path itself,
  where the paper draws the peak.
- Nearer than 1 m the distance counts as 1 m. The angle stays.
- A point on the vehicle itself counts as straight ahead of it (cos theta = 1), so the field never
  rises with the distance from the vehicle.
- The velocity points along the heading.

The sum of magnitudes is compiled by numba. It is imported at first use, because that takes time.

Users: `shared_fields` for the fields behind D_i, `operations`, figures and studies in `extras/`.
Fixed: name and arguments of `trajectory_field` (docs/reference/python.md); its values, from which
D_i follows.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import must_be
from sumo_eval.method.checks import finite, quotient
from sumo_eval.settings import FieldSettings
from sumo_eval.trajectory import FloatArray, Trajectory

Superposition = Literal["magnitude", "vector"]

# m; a point nearer than this to a sample has no direction, only rounding of the coordinates.
# `field_loops` has the same constant: it cannot be imported here, as it imports numba.
COINCIDENT = 1e-9
SAME_TIME = 1e-6  # s; a smaller difference of two times is rounding
LARGEST_EXPONENT = 700.0  # largest k2 v; exp(710) is beyond float64


def trajectory_field(
    points: ArrayLike,
    trajectory: Trajectory,
    *,
    k1: float = 0.5,
    k2: float = 0.005,
    sample_interval: float = 0.1,
    superposition: Superposition = "magnitude",
) -> FloatArray:
    """Eqs. 9-10: S(p) = sum of s(p), s = exp(k2 v cos theta) / max(|r|, 1)^k1, over the samples of
    a trajectory, (n,).

    r: vector from the sample to p, m; v: speed of the sample, m/s; theta: angle between its heading
    and r.

    points: p, x and y, (n, 2), m.
    trajectory: of a vehicle. Its samples are `sample_interval` apart, interpolated if necessary.
    k1: decay with distance, at least 0, by default that of `[method.anthropomorphic.field]`.
    k2: growth with the speed towards p, s/m, by default that of the same settings.
    sample_interval: s.
    superposition: "magnitude" sums |s|; "vector" gives |sum of s r/|r||, where a sample on the
        point itself has no direction and adds nothing.

    Raises InputError for points that are not finite or not (n, 2), and for constants out of range.
    """
    constants = FieldSettings(k1, k2, sample_interval, superposition)
    field: FloatArray = trajectory_fields(points, [trajectory], constants)[0]
    return field


def trajectory_fields(
    points: ArrayLike, trajectories: Sequence[Trajectory], constants: FieldSettings
) -> FloatArray:
    """Eqs. 9-10: S of several trajectories at the same n points, (trajectories, n).

    points: p, (n, 2), m.
    trajectories: as in `trajectory_field`.
    constants: k1, k2, sample interval and superposition.
    """
    places = _checked_points(points)
    k1 = float(constants.k1)
    if constants.superposition == "magnitude":
        from sumo_eval.method.field_loops import magnitude_sum as field
    else:
        field = _vector_sum
    fields = np.empty((len(trajectories), len(places)))
    for row, trajectory in enumerate(trajectories):
        samples = samples_of(trajectory, constants.k2, constants.sample_interval)
        fields[row] = field(places, samples, k1)
    return fields


# --- samples --------------------------------------------------------------------------------------


def samples_of(trajectory: Trajectory, k2: float, interval: float) -> FloatArray:
    """Samples of a trajectory for the loops: rows of x, y, m, k2 vx, k2 vy, k2 v and weight,
    (k, 6).

    trajectory: of a vehicle.
    k2: growth with speed, s/m.
    interval: between samples, s.

    The weight is the number of samples that a row stands for. The samples of a standing vehicle are
    equal and become one row.
    """
    motion = _resampled(trajectory, interval)  # x, y, heading, speed
    # index of the first of each run of equal rows
    begins = np.flatnonzero(np.append(True, np.any(motion[1:] != motion[:-1], axis=1)))
    weight = np.diff(np.append(begins, len(motion)))
    motion = motion[begins]
    heading = motion[:, 2]
    exponent = k2 * motion[:, 3]
    largest = float(np.max(np.abs(exponent)))
    if largest > LARGEST_EXPONENT:
        raise must_be(
            "`k2` times the speed", "the trajectory field", f"at most {LARGEST_EXPONENT:g}", largest
        )
    along = exponent * np.cos(heading), exponent * np.sin(heading)
    return np.column_stack((motion[:, :2], *along, exponent, weight))


def _resampled(trajectory: Trajectory, interval: float) -> FloatArray:
    """x, y, heading and speed every `interval` s from the first time on, (k, 4)."""
    motion = np.column_stack((trajectory.x, trajectory.y, trajectory.heading, trajectory.speed))
    count = math.floor((trajectory.duration + SAME_TIME) / interval) + 1
    times = trajectory.time[0] + interval * np.arange(count)
    if count == len(trajectory) and np.all(np.abs(times - trajectory.time) <= SAME_TIME):
        return motion
    # column 2, the heading: without unwrapping, between -pi and pi it would be interpolated to 0
    motion[:, 2] = np.unwrap(motion[:, 2])
    return np.column_stack([np.interp(times, trajectory.time, channel) for channel in motion.T])


# --- sums and checks ------------------------------------------------------------------------------


def _vector_sum(points: FloatArray, samples: FloatArray, k1: float) -> FloatArray:
    """Eq. 10: |sum of s r/|r|| at points, (n,).

    points: (n, 2), m.
    samples: from `samples_of`.
    k1: decay with distance.
    """
    total = np.zeros(points.T.shape)
    for sample in samples:
        away = points.T - sample[:2, None]
        distance = np.linalg.norm(away, axis=0)
        unit = quotient(away, distance, distance > COINCIDENT, 0.0)
        # columns 2 and 3: k2 vx and k2 vy, so the exponent is k2 v cos theta; column 5: the weight
        magnitude = np.exp(sample[2:4] @ unit) / np.maximum(distance, 1.0) ** k1
        total += sample[5] * magnitude * unit
    return np.asarray(np.linalg.norm(total, axis=0))


def _checked_points(points: ArrayLike) -> FloatArray:
    """Points as an array (n, 2). Raises InputError for anything else."""
    owner = "the trajectory field"
    # A new array, because numba would compile the loops again for a read-only one.
    places = np.array(finite(owner, "points", points), order="C")
    if places.ndim != 2 or places.shape[1] != 2:
        wanted = "an (n, 2) array of x, y in m"
        raise must_be("`points`", owner, wanted, f"shape {places.shape}")
    return places
