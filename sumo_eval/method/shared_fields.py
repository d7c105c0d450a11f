"""Fields of many trajectories at many points of one road, Eq. 9, without summing every sample at every point.

Away from a sample the field is a smooth function of the place. So the road is divided into boxes, halved again and
again. What lies further than its own length from a box is summed at that box's nodes only, and a polynomial through
the nodes gives it at every point of the box; what is near is summed at the points themselves.

The result is that of `trajectory_field.trajectory_fields` to `ERROR`. The summand's singularities are the sample itself
(along x) and the places above and below it in the complex plane of y. From a box of length L whose far samples begin
one length away they lie on Bernstein ellipses of 3 + sqrt(8) = 5.8 along x and L/h + sqrt((L/h)^2 + 1) >= 5.0 across a
strip of half-width h <= L/2.4: 16 nodes each way leave a small multiple of 5.0^-16 = 7e-12 of each sample's field, and
found is 1e-12 (k1 = 0.5) to 5e-12. Where that does not hold (large constants, vectors), does not pay, or numba is
missing, the plain sum is taken.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_eval.method import trajectory_field
from sumo_eval.method.trajectory_field import samples_of, trajectory_fields
from sumo_eval.settings import FieldSettings
from sumo_eval.trajectory import FloatArray, Trajectory

ERROR = 1e-11  # of the field, relative, at most
NODES = 16  # in a box, each way, at most; as in `field_loops`
REACH = 1.0  # lengths of a box from which on a sample is far from it
SLENDER = 2.4  # a box is at least this much longer than half as wide
LARGEST_K1 = 1.0  # a field that decays faster is summed plainly
LARGEST_EXPONENT = 0.5  # and so is one that grows faster with speed ahead: k2 v
NARROWEST = 0.5  # m; points in a narrower strip are treated as if it were this half-wide


def shared_fields(
    x: FloatArray, y: FloatArray, trajectories: Sequence[Trajectory], constants: FieldSettings
) -> FloatArray:
    """Eq. 9 for m trajectories at s rows of k points across the road, (m, s, k). x: of the rows, (s,), m. y: (s, k), m.

    Errors as in `trajectory_fields`.
    """
    samples = [samples_of(trajectory, constants.k2, constants.sample_interval) for trajectory in trajectories]
    levels = _levels(x, y)
    smooth = constants.k1 <= LARGEST_K1 and all(np.abs(one[:, 4]).max() <= LARGEST_EXPONENT for one in samples)
    if levels == 0 or not smooth or constants.superposition != "magnitude" or trajectory_field.KERNEL != "numba":
        points = np.stack((np.broadcast_to(x[:, None], y.shape), y), axis=-1)
        return trajectory_fields(
            points.reshape(-1, 2),
            trajectories,
            k1=constants.k1,
            k2=constants.k2,
            sample_interval=constants.sample_interval,
            superposition=constants.superposition,
        ).reshape(len(trajectories), *y.shape)
    return _by_boxes(x, y, samples, levels, float(constants.k1))


def _levels(x: FloatArray, y: FloatArray) -> int:
    """How often the road is halved so that least is summed; 0 where nothing is gained."""
    if x.size == 0:
        return 0
    slender = float(x.max() - x.min()) / _half_width(y)
    largest = int(np.log2(max(slender / SLENDER, 1.0)))
    reached = 1.0 + 2.0 * REACH  # what is summed for a box, in its lengths: at its nodes or at its points
    costs = [float(y.size)]
    for levels in range(1, largest + 1):
        nodes = NODES * _counts([slender / 2**level for level in range(levels + 1)]).sum()
        costs.append(reached * (nodes + y.size / 2**levels))
    return int(np.argmin(costs))


def _half_width(y: FloatArray) -> float:
    """Of the strip in which the points lie, m."""
    return max(0.5 * float(y.max() - y.min()), NARROWEST)


def _by_boxes(x: FloatArray, y: FloatArray, samples: Sequence[FloatArray], levels: int, k1: float) -> FloatArray:
    """The fields by 2**levels boxes."""
    from sumo_eval.method.field_loops import far_values, put_field

    fields = np.empty((len(samples), *y.shape))
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    bounds, length = np.array([x[0], x[-1]]), (x[-1] - x[0]) / 2**levels
    box = np.minimum(((x - x[0]) / length).astype(np.int64), 2**levels - 1)
    starts = np.searchsorted(box, np.arange(2**levels + 1))
    middle, half = 0.5 * float(y.max() + y.min()), _half_width(y)

    nodes, halves, series = _nodes()
    west, east = _near(bounds, levels)
    counts, places, finer = _across([length * 2**coarser / half for coarser in range(levels, -1, -1)])
    for one, field in zip(samples, fields, strict=True):
        by_x = one[np.argsort(one[:, 0], kind="stable")]
        near = np.column_stack((np.searchsorted(by_x[:, 0], west), np.searchsorted(by_x[:, 0], east, side="right")))
        far = far_values(by_x, bounds, nodes, halves, counts, middle + half * places, finer, near, k1)
        put_field(x, y, order, starts, by_x, near[-(2**levels) :], far, bounds, middle, half, series, k1, field)
    return fields


def _near(bounds: FloatArray, levels: int) -> tuple[FloatArray, FloatArray]:
    """Between which x a sample is near each box, level after level."""
    west, east = [], []
    for level in range(levels + 1):
        length = (bounds[1] - bounds[0]) / 2**level
        begins = bounds[0] + length * np.arange(2**level)
        west.append(begins - REACH * length)
        east.append(begins + (1.0 + REACH) * length)
    return np.concatenate(west), np.concatenate(east)


@functools.cache
def _nodes() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Chebyshev points; values there to values at those of the left and the right half, (2, p, p); and to the
    coefficients of a Chebyshev series, (p, p).
    """
    nodes: FloatArray = np.polynomial.chebyshev.chebpts1(NODES)
    series = np.array(np.linalg.inv(np.polynomial.chebyshev.chebvander(nodes, NODES - 1)), dtype=np.float64)
    halves: FloatArray = np.array(
        [np.polynomial.chebyshev.chebvander(0.5 * (nodes + side), NODES - 1) @ series for side in (-1, 1)]
    )
    return nodes, halves, series


def _across(slender: Sequence[float]) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Nodes across for each level of boxes: how many, where on -1..1, and what makes values there values at the nodes
    of the next level, or last a Chebyshev series; as `far_values` takes them. slender: length over half-width of the
    boxes of each level.
    """
    counts = _counts(slender)
    places, finer = np.zeros((len(counts), NODES)), np.zeros((len(counts) + 1, NODES, NODES))
    for level, count in enumerate(counts):
        places[level, :count] = np.polynomial.chebyshev.chebpts1(count)
        if level > 0:
            before = counts[level - 1]
            series = np.linalg.inv(np.polynomial.chebyshev.chebvander(places[level - 1, :before], before - 1))
            finer[level, :before, :count] = (
                np.polynomial.chebyshev.chebvander(places[level, :count], before - 1) @ series
            ).T
    last = counts[-1]
    finer[-1, :last, :last] = np.linalg.inv(np.polynomial.chebyshev.chebvander(places[-1, :last], last - 1)).T
    return counts, places, finer


def _counts(slender: Sequence[float]) -> NDArray[np.int64]:
    """How many nodes across the boxes of each level need; the longer a box, the fewer leave what `NODES` leave of the
    shortest.
    """
    bernstein = [REACH * ratio + math.hypot(REACH * ratio, 1.0) for ratio in (SLENDER, *slender)]
    least = NODES * math.log(bernstein[0])
    return np.array([min(NODES, math.ceil(least / math.log(number))) for number in bernstein[1:]])
