"""Two usual measures of how alike trajectories are, beside D for comparison (tslearn, extra `similarity`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import needs_extra
from sumo_eval.trajectory import FloatArray, Trajectory

STEP = 0.5  # s between compared positions
NEAR = 1.0  # m; positions nearer than this are common (LCSS)


class Similarity(NamedTuple):
    """dtw: root mean square distance along the best alignment in time, m, 0 for the same path at the same pace.
    lcss: longest common subsequence over the shorter trajectory, 0..1.
    """

    dtw: float
    lcss: float


def trajectory_similarity(ads: Trajectory, drivers: Sequence[Trajectory]) -> Similarity:
    """Mean DTW distance and mean LCSS similarity of an ADS to each driver, on positions every `STEP` s.

    Raises InputError where tslearn is not installed.
    """
    try:
        from tslearn.metrics import dtw, lcss
    except ImportError as error:
        raise needs_extra("DTW and LCSS", "similarity") from error
    mine = _positions(ads)
    theirs = [_positions(driver) for driver in drivers]
    distances = [dtw(mine, other) / np.sqrt(max(len(mine), len(other))) for other in theirs]
    common = [lcss(mine, other, eps=NEAR) for other in theirs]
    return Similarity(float(np.mean(distances)), float(np.mean(common)))


def _positions(trajectory: Trajectory) -> FloatArray:
    times = np.arange(trajectory.time[0], trajectory.time[-1] + 1e-9, STEP)
    return np.column_stack([np.interp(times, trajectory.time, channel) for channel in (trajectory.x, trajectory.y)])
