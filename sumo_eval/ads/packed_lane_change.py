"""Paths across the road and the steering along them for many egos at once: `ads.lane_change`, to the last bit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.elementwise import circle, each
from sumo_eval.ads.lane_change import LanePath, Steering
from sumo_eval.ads.packed_perception import PackedEgos
from sumo_eval.cosim.controller import Briefing
from sumo_eval.trajectory import FloatArray


class PackedPathPoints(NamedTuple):
    """One point of each path, fields as in `PathPoint`; (n,)."""

    y: FloatArray
    slope: FloatArray
    bend: FloatArray


class PackedLanePaths:
    """A `LanePath` for each case; arrays (n,).

    target: y at the end, m. any_change: whether any of them changes lane.
    """

    def __init__(self, paths: Sequence[LanePath]) -> None:
        self.start, self.offset, self.begin, self.length = np.array(
            [(path.start, path.offset, path.begin, path.length) for path in paths]
        ).T.copy()
        self._look_over()

    def replace(self, case: int, path: LanePath) -> None:
        """From now on a case has another path."""
        self.start[case], self.offset[case] = path.start, path.offset
        self.begin[case], self.length[case] = path.begin, path.length
        self._look_over()

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these cases, in this order."""
        self.start, self.offset = self.start[rows], self.offset[rows]
        self.begin, self.length = self.begin[rows], self.length[rows]
        self._look_over()

    def _look_over(self) -> None:
        self.target = self.start + self.offset
        self.any_change = bool(self.offset.any())

    def y(self, x: FloatArray) -> FloatArray:
        """y at x, m; (n,) or (m, n). Without an offset `start + 0 * share` is the start."""
        if not self.any_change:
            return np.broadcast_to(self.start, x.shape)
        return np.asarray(self.start + self.offset * smooth_step((x - self.begin) / self.length))

    def at(self, x: FloatArray) -> PackedPathPoints:
        """y, slope and bend at x, (n,)."""
        if not self.any_change:
            nothing = np.zeros(x.shape)
            return PackedPathPoints(self.start, nothing, nothing)
        s = np.minimum(np.maximum((x - self.begin) / self.length, 0.0), 1.0)
        left = 1.0 - s
        scale = self.offset / self.length
        return PackedPathPoints(
            self.start + self.offset * (s * s * s * (10.0 + s * (-15.0 + 6.0 * s))),
            scale * (30.0 * s * s * left * left),
            scale / self.length * (60.0 * s * left * (1.0 - 2.0 * s)) + 0.0,  # 0, not -0, at the end
        )


def smooth_step(share: FloatArray) -> FloatArray:
    """As `lane_change.smooth_step`."""
    s = np.minimum(np.maximum(share, 0.0), 1.0)
    return np.asarray(s * s * s * (10.0 + s * (-15.0 + 6.0 * s)))


class PackedSteering:
    """`Steering` for n egos."""

    def __init__(self, scenario: Briefing, count: int) -> None:
        self._wheelbase = scenario.vehicle.wheelbase
        self._ratio = scenario.vehicle.steering_ratio
        self._step = scenario.step
        self._curvature = np.zeros(count)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these cases, in this order."""
        self._curvature = self._curvature[rows]

    def rear_axle_next(self, me: PackedEgos) -> FloatArray:
        """x of the rear axle at the end of the coming step, m: where the path is asked for."""
        return me.x - 0.5 * self._wheelbase + me.along * self._step

    def angle(self, me: PackedEgos, point: PackedPathPoints) -> FloatArray:
        """Steering wheel angles, rad, for egos `me` whose paths are `point` at `rear_axle_next(me)`."""
        columns = me.y, me.heading, me.speed, self._curvature, point.y, point.slope, point.bend
        if np.count_nonzero(point.slope) == len(me.y):
            self._curvature = self._wanted(*columns)
            return self._ratio * each(math.atan, self._wheelbase * self._curvature)
        turning = (me.heading != 0.0) | (self._curvature != 0.0) | (me.y != point.y)
        turning |= (point.slope != 0.0) | (point.bend != 0.0)
        angle = np.zeros(len(turning))  # of those that are on their straight path
        if np.count_nonzero(turning):
            rows = np.flatnonzero(turning)
            curvature = self._wanted(*(column[rows] for column in columns))
            self._curvature[rows] = curvature
            angle[rows] = self._ratio * each(math.atan, self._wheelbase * curvature)
        return angle

    def _wanted(
        self, y: FloatArray, heading: FloatArray, speed: FloatArray, curvature: FloatArray,
        path_y: FloatArray, slope: FloatArray, bend: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """Curvature to be steered, 1/m."""
        turned = heading + 0.5 * speed * self._step * curvature
        wanted = each(math.atan, slope)
        turns = circle(np.array((heading, turned, wanted)))
        moved = speed * self._step
        y = y - 0.5 * self._wheelbase * turns.sine[0] + moved * turns.sine[1]
        heading = heading + moved * curvature
        per_metre = Steering.RATE / np.maximum(speed, Steering.SLOW)
        return np.asarray(
            bend * each(math.pow, turns.cosine[2], 3.0)
            + per_metre * per_metre * (path_y - y)
            + 2.0 * per_metre * (wanted - heading)
        )
