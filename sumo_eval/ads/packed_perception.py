"""What many egos see at once: `ads.perception` on arrays, to the last bit.

Of the egos arrays are (n,), of the other vehicles (m, n): one row for each of the m others of a case, so that an ego's
value stands beside those of its own others.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.elementwise import each
from sumo_eval.ads.perception import Mover
from sumo_eval.cosim.packed_controller import PackedScene
from sumo_eval.trajectory import BoolArray, FloatArray


class PackedEgos(NamedTuple):
    """The egos at an instant, (n,); fields as in `Mover`, speed along the heading."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    along: FloatArray
    across: FloatArray
    half_length: FloatArray
    half_width: FloatArray
    speed: FloatArray

    def of(self, case: int) -> Mover:
        """The ego of one case."""
        return Mover("ego", *(float(values[case]) for values in self[:7]))


class PackedMovers(NamedTuple):
    """The other vehicles at an instant, (m, n); fields as in `Mover`."""

    x: FloatArray
    y: FloatArray
    along: FloatArray
    across: FloatArray
    half_length: FloatArray
    half_width: FloatArray
    braking: FloatArray

    def of(self, index: int, case: int) -> Mover:
        """One of the other vehicles of a case, whose heading nobody asks for; its name is its index."""
        x, y, *motion = (float(values[index, case]) for values in self)
        return Mover(str(index), x, y, math.nan, *motion)


class PackedNeighbours(NamedTuple):
    """As `Neighbours`, by index, where there is one; (n,)."""

    ahead: NDArray[np.intp]
    has_ahead: BoolArray
    behind: NDArray[np.intp]
    has_behind: BoolArray


def look(scene: PackedScene) -> tuple[PackedEgos, PackedMovers]:
    """Egos and others of a scene."""
    speed = each(math.hypot, scene.along, scene.across)
    egos = PackedEgos(
        scene.x, scene.y, scene.heading, scene.along, scene.across, scene.half_length, scene.half_width, speed
    )
    others = np.array(
        (
            scene.other_x, scene.other_y, scene.other_along, scene.other_across,
            scene.other_half_length, scene.other_half_width, np.zeros(scene.other_x.shape),
        )
    ).transpose(0, 2, 1).copy()  # fmt: skip
    return egos, PackedMovers(*others)


def bumper_gap(me: PackedEgos, others: PackedMovers) -> FloatArray:
    """Free road from the ego's front to the rear of each other, m, (m, n)."""
    return others.x - me.x - others.half_length - me.half_length


def gap_behind(me: PackedEgos, others: PackedMovers) -> FloatArray:
    """Free road from the front of each other to the ego's rear, m, (m, n)."""
    return me.x - others.x - others.half_length - me.half_length


def visible(me: PackedEgos, others: PackedMovers, hiding_share: float) -> BoolArray:
    """Which vehicles no single nearer vehicle ahead covers by more than `hiding_share` of their width, (m, n)."""
    x, y, half_width = others.x, others.y, others.half_width
    seen = np.ones(x.shape, dtype=bool)
    if len(x) == 1:
        return seen
    ahead = x > me.x
    for index in range(len(x)):
        for nearer in range(len(x)):
            between = ahead[nearer] & (x[nearer] < x[index])
            if nearer == index or not np.count_nonzero(between):
                continue
            hiding, hidden = half_width[nearer], half_width[index]
            overlap = hiding + hidden - np.abs(y[nearer] - y[index])
            overlap = np.minimum(np.minimum(overlap, 2.0 * hiding), 2.0 * hidden)
            seen[index] &= ~(between & (overlap > 2.0 * hidden * hiding_share))
    return seen


def neighbours(
    me: PackedEgos, others: PackedMovers, known: BoolArray, rank: FloatArray, centre: FloatArray, width: float
) -> PackedNeighbours:
    """As `perception.neighbours` among the known others; of two at the same place the one of lower rank comes first."""
    inside = known & (np.abs(others.y - centre) < 0.5 * width + others.half_width)
    if not np.count_nonzero(inside):
        return PackedNeighbours(*_nearest(inside, others.x, rank), *_nearest(inside, others.x, rank))
    beside = np.abs(others.x - me.x) < others.half_length + me.half_length
    return PackedNeighbours(
        *_nearest(inside & ((others.x > me.x) | beside), others.x, rank),
        *_nearest(inside & ((others.x <= me.x) | beside), -others.x, rank),
    )


def _nearest(among: BoolArray, x: FloatArray, rank: FloatArray) -> tuple[NDArray[np.intp], BoolArray]:
    if not np.count_nonzero(among):
        return np.zeros(among.shape[1], dtype=np.intp), np.zeros(among.shape[1], dtype=bool)
    return first_least(np.where(among, x, np.inf), rank), np.asarray(among.any(axis=0))


def of_each(values: FloatArray, index: NDArray[np.intp]) -> FloatArray:
    """Of each case the value of the other with that index, (n,). values: (m, n)."""
    return values[0] if len(values) == 1 else np.asarray(values[index, np.arange(len(index))])


def first_least(keys: FloatArray, rank: FloatArray) -> NDArray[np.intp]:
    """For each case the index of its smallest key, (n,); of equal ones that of the lowest rank, then the first.

    As `min` gives it over the others in the order of their ranks. keys, rank: (m, n), inf for those out of question.
    """
    if len(keys) == 1:
        return np.zeros(keys.shape[1], dtype=np.intp)
    least: NDArray[np.intp] = keys.argmin(axis=0)
    smallest = of_each(keys, least)
    equal = (keys == smallest) & (keys < np.inf)
    if np.count_nonzero(equal) > np.count_nonzero(smallest < np.inf):
        for case in np.flatnonzero(equal.sum(axis=0) > 1).tolist():
            indexes = np.flatnonzero(equal[:, case]).tolist()
            least[case] = min(indexes, key=lambda index: float(rank[index, case]))
    return least
