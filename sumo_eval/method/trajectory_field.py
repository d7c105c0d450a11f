"""Trajectory field of a vehicle, Eqs. 9-10: how strongly a driven trajectory is felt at points of
the road.

Readings of the paper (docs/method.md) that this file is built on:
- Magnitudes are summed. The printed unit vector would cancel on the path itself, where the paper
  draws the peak.
- Nearer than 1 m the distance counts as 1 m; the angle is unchanged.
- A point on the vehicle itself counts as straight ahead of it (cos theta = 1), so the field never
  rises with the distance from the vehicle.
- The velocity points along the heading.

The sum of magnitudes is compiled by numba, which is imported at first use, because that takes a
while. Users: `shared_fields` for the fields behind D_i, `operations`, figures and studies in
`extras/`.
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

# m; nearer than this a direction is only the rounding of the coordinates, as in `field_loops`
COINCIDENT = 1e-9
SAME_TIME = 1e-6  # s by which times of samples may differ from the wanted ones
LARGEST_EXPONENT = 700.0  # exp(710) is beyond float64


def trajectory_field(
    points: ArrayLike,
    trajectory: Trajectory,
    *,
    k1: float = 0.5,
    k2: float = 0.005,
    sample_interval: float = 0.1,
    superposition: Superposition = "magnitude",
) -> FloatArray:
    """Eqs. 9-10: S(p) = sum of s(p), s = exp(k2 v cos theta) / max(|r|, 1)^k1, over a trajectory's
    samples.

    r: from a sample to p, m; v: its speed, m/s; theta: between its heading and r.

    points: p, (n, 2), m; (n,) comes back.
    trajectory: resampled every `sample_interval` s from its first time on, unless it already is so.
    k1: decay with distance.
    k2: growth with the speed towards p, s/m.
    sample_interval: s.
    superposition: "magnitude" sums |s|; "vector" gives |sum of s r/|r||, where a sample on the
        point itself has no direction and adds nothing.

    Raises InputError for arguments outside these meanings.
    """
    constants = FieldSettings(k1, k2, sample_interval, superposition)
    field: FloatArray = trajectory_fields(points, [trajectory], constants)[0]
    return field


def trajectory_fields(
    points: ArrayLike, trajectories: Sequence[Trajectory], constants: FieldSettings
) -> FloatArray:
    """Eqs. 9-10 for several trajectories on the same n points, (trajectories, n).

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
    """Samples of a trajectory for the kernels: rows of x, y, k2 vx, k2 vy, k2 v and weight.

    The weight is the number of samples that a row stands for: samples of a standing vehicle, which
    are equal, are one row.
    """
    motion = _resampled(trajectory, interval)
    # the first of equal rows that follow each other
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
    """x, y, heading, speed at exactly `interval` steps from the first time, (k, 4)."""
    motion = np.column_stack((trajectory.x, trajectory.y, trajectory.heading, trajectory.speed))
    count = math.floor((trajectory.duration + SAME_TIME) / interval) + 1
    times = trajectory.time[0] + interval * np.arange(count)
    if count == len(trajectory) and np.all(np.abs(times - trajectory.time) <= SAME_TIME):
        return motion
    # interpolated without this, a heading between -pi and pi would be near 0
    motion[:, 2] = np.unwrap(motion[:, 2])
    return np.column_stack([np.interp(times, trajectory.time, channel) for channel in motion.T])


# --- kernels and checks ---------------------------------------------------------------------------


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
        # k2 v cos theta, from k2 vx and k2 vy
        magnitude = np.exp(sample[2:4] @ unit) / np.maximum(distance, 1.0) ** k1
        weight = sample[5]
        total += weight * magnitude * unit
    return np.asarray(np.linalg.norm(total, axis=0))


def _checked_points(points: ArrayLike) -> FloatArray:
    """Points as an array (n, 2). Raises InputError for anything else."""
    owner = "the trajectory field"
    # A fresh array, because numba compiles once more for a read-only one.
    places = np.array(finite(owner, "points", points), order="C")
    if places.ndim != 2 or places.shape[1] != 2:
        wanted = "an (n, 2) array of x, y in m"
        raise must_be("`points`", owner, wanted, f"shape {places.shape}")
    return places
