"""The compiled loops of the trajectory field: the direct sum of Eq. 9, and far samples interpolated
over boxes.

A sample of a trajectory has the field s = exp(k2 v cos theta) / max(r, 1)^k1 at distance r
(`trajectory_field.py`). Boxes, nodes and levels are explained in `shared_fields.py`.

The compiler may contract a * b + c, which rounds once instead of twice. It may reorder no sum, so
each run gives the same bits on the same machine.

Users: `method/shared_fields.py`, `method/trajectory_field.py`; both import this file at first use,
because it imports numba, which takes time. Fixed: the order of all sums. After a change run
`python -m sumo_eval.record.loops`, which compiles the loops.
"""

from collections.abc import Callable
from math import inf, sqrt
from typing import Any, TypeVar, cast

import numba
import numpy as np

from sumo_eval.kernels import keep_code
from sumo_eval.trajectory import FloatArray, IntArray

Loops = TypeVar("Loops", bound=Callable[..., Any])

# m; a point nearer than this to a sample has no direction, as in `trajectory_field`
COINCIDENT = 1e-9
POINTS_AT_ONCE = 256  # points of a block, which stays in the first-level cache
LANES = 16  # a block is filled up to a multiple of this, so that vector instructions take all of it

QUICK_EXPONENT = 0.2  # largest |f| of the polynomial `EXP`
# Coefficients of a polynomial for exp(f), from 1 to f^8, through its values at the Chebyshev points
# of |f| <= QUICK_EXPONENT; its error is 6e-15.
EXP = tuple(
    np.polynomial.Chebyshev.interpolate(np.exp, 8, [-QUICK_EXPONENT, QUICK_EXPONENT])
    .convert(kind=np.polynomial.Polynomial)
    .coef.tolist()
)
QUICK_DISTANCE = 1e15  # m; its square is far within single precision
QUARTER = np.float32(0.25)  # in single precision, so that the guess is in single precision too
ROOT_OF_TWO = sqrt(2.0)


def compiled(loops: Loops) -> Loops:
    """The loops as machine code, kept on disk if possible, else compiled in each process."""
    return cast("Loops", keep_code(numba.njit(fastmath={"contract"}, error_model="numpy")(loops)))


@compiled
def magnitude_sum(points: FloatArray, samples: FloatArray, k1: float) -> FloatArray:
    """Eq. 9: S of a trajectory at points, (n,).

    points: x and y, (n, 2), m.
    samples: rows of x, y, m, k2 vx, k2 vy, k2 v and weight, (k, 6), from
        `trajectory_field.samples_of`.
    k1: decay with distance.

    Every inner loop is over the points of a block and becomes vector instructions. A sample is
    quick if it is more than 1 m away from all points of the block and k1 = 0.5: its field needs no
    decisions. It is exp(f) / sqrt(r), with f = k2 (v . r) / r of the vectors v and r.

    The loop computes u = 1 / sqrt(2 r): a guess in single precision, improved by one Newton step in
    double precision, u + u (1/4 - r^2 u^4). The factor 2 saves a multiplication in this step. With
    u, f = 2 k2 (v . r) u^2, and the field is sqrt(2) u exp(f). While the polynomial of one sample
    is summed, u of the next sample is guessed, because the processor does both at once.
    """
    field = np.empty(points.shape[0])
    px, py, total = np.empty(POINTS_AT_ONCE), np.empty(POINTS_AT_ONCE), np.empty(POINTS_AT_ONCE)
    # of each point: r^2 to the sample, m2, and the guess of u
    square, guess = np.empty(POINTS_AT_ONCE), np.empty(POINTS_AT_ONCE, np.float32)
    quick = np.empty(samples.shape[0], np.int64)
    for first in range(0, points.shape[0], POINTS_AT_ONCE):
        n = min(POINTS_AT_ONCE, points.shape[0] - first)
        filled = (n + LANES - 1) // LANES * LANES
        # the block's points, the last one repeated up to `filled`, and the block's bounds
        west = inf
        east = -inf
        south = inf
        north = -inf
        for i in range(filled):
            x, y = points[first + min(i, n - 1), 0], points[first + min(i, n - 1), 1]
            west = min(west, x)
            east = max(east, x)
            south = min(south, y)
            north = max(north, y)
            px[i] = x
            py[i] = y
            total[i] = 0.0
        wide = east - west + north - south > QUICK_DISTANCE
        # add samples that are not quick now, list the quick ones
        count = 0
        for j in range(samples.shape[0]):
            x, y, ahead = samples[j, 0], samples[j, 1], samples[j, 4]
            # distance of the sample from the block's bounds, m
            apart = max(max(west - x, x - east), max(south - y, y - north))
            if (
                k1 == 0.5
                and abs(ahead) <= QUICK_EXPONENT
                and 1.0 < apart < QUICK_DISTANCE
                and not wide
            ):
                quick[count] = j
                count += 1
            else:
                _add_terms(px, py, samples, j, k1, total, filled)
        if count:
            # the guess for the first quick sample
            x, y = samples[quick[0], 0], samples[quick[0], 1]
            for i in range(filled):
                dx = px[i] - x
                dy = py[i] - y
                square[i] = dx * dx + dy * dy
                guess[i] = sqrt(sqrt(QUARTER / np.float32(square[i])))
            for j in range(count):
                row = quick[j]
                x = samples[row, 0]
                y = samples[row, 1]
                weight = samples[row, 5] * ROOT_OF_TWO
                along_x, along_y = 2.0 * samples[row, 2], 2.0 * samples[row, 3]
                e0, e1, e2 = weight * EXP[0], weight * EXP[1], weight * EXP[2]
                e3, e4, e5 = weight * EXP[3], weight * EXP[4], weight * EXP[5]
                e6, e7, e8 = weight * EXP[6], weight * EXP[7], weight * EXP[8]
                following = quick[min(j + 1, count - 1)]
                next_x, next_y = samples[following, 0], samples[following, 1]
                for i in range(filled):
                    next_dx = px[i] - next_x
                    next_dy = py[i] - next_y
                    next_square = next_dx * next_dx + next_dy * next_dy
                    next_guess = sqrt(sqrt(QUARTER / np.float32(next_square)))
                    u = np.float64(guess[i])
                    u2 = u * u
                    u += u * (0.25 - square[i] * (u2 * u2))  # Newton's step
                    f = (along_x * (px[i] - x) + along_y * (py[i] - y)) * (u * u)
                    e = e4 + f * (e5 + f * (e6 + f * (e7 + f * e8)))
                    total[i] += u * (e0 + f * (e1 + f * (e2 + f * (e3 + f * e))))
                    square[i] = next_square
                    guess[i] = next_guess
        for i in range(n):
            field[first + i] = total[i]
    return field


@compiled
def _add_terms(
    px: FloatArray,
    py: FloatArray,
    samples: FloatArray,
    j: int,
    k1: float,
    total: FloatArray,
    filled: int,
) -> None:
    """Eq. 9: add one sample's field at the points of a block to `total`.

    px, py: x and y of the points, m.
    samples: as in `magnitude_sum`.
    j: row of the sample.
    k1: decay with distance.
    total: field so far, at least (filled,).
    filled: number of points.

    exp(f) is the Taylor polynomial to f^12 on |f| <= 0.35 (remainder 2e-16). A larger f is halved
    until it is in this range, and the result squared as often. At k2 = 0.005 s/m this happens above
    70 m/s only.
    """
    growth, nearness = np.empty(POINTS_AT_ONCE), np.empty(POINTS_AT_ONCE)
    x, y, weight = samples[j, 0], samples[j, 1], samples[j, 5]
    along_x, along_y, ahead = samples[j, 2], samples[j, 3], samples[j, 4]
    halvings = 0
    while abs(ahead) > 0.35:
        ahead *= 0.5
        along_x *= 0.5
        along_y *= 0.5
        halvings += 1
    for i in range(filled):
        dx = px[i] - x
        dy = py[i] - y
        square = dx * dx + dy * dy
        apart = square > COINCIDENT * COINCIDENT
        inverse = 1.0 / sqrt(square if apart else 1.0)
        # k2 v cos theta; a point on the sample counts as straight ahead of it
        f = (along_x * dx + along_y * dy) * inverse if apart else ahead
        # from the inside out: the coefficients are 1 / 12!, 1 / 11!, ... 1 / 0!
        e = 1.0 / 3628800.0 + f * (1.0 / 39916800.0 + f * (1.0 / 479001600.0))
        e = 1.0 / 40320.0 + f * (1.0 / 362880.0 + f * e)
        e = 1.0 / 720.0 + f * (1.0 / 5040.0 + f * e)
        e = 1.0 / 24.0 + f * (1.0 / 120.0 + f * e)
        e = 1.0 / 2.0 + f * (1.0 / 6.0 + f * e)
        growth[i] = 1.0 + f * (1.0 + f * e)
        nearness[i] = inverse if inverse < 1.0 else 1.0
    for _ in range(halvings):
        for i in range(filled):
            growth[i] *= growth[i]
    if k1 == 0.5:
        for i in range(filled):
            total[i] += weight * growth[i] * sqrt(nearness[i])
    else:
        for i in range(filled):
            total[i] += weight * growth[i] * nearness[i] ** k1


@compiled
def far_values(samples: FloatArray, grid: Any, near: IntArray, k1: float) -> FloatArray:
    """Eq. 9: the field of far samples in each of the smallest boxes, (2**levels, p, q): at p nodes
    along x, as Chebyshev series of q terms across the road.

    samples: as in `magnitude_sum`, sorted by x.
    grid: `shared_fields.Grid`, with p nodes in each box.
    near: first and last (exclusive) of the samples that are near each box, level after level,
        (2**(levels + 1) - 1, 2). All other samples are far from the box.
    k1: decay with distance.

    Samples far from a box's parent are far from the box too: their field is interpolated between
    the parent's nodes. Samples that are near the parent, but far from the box, are added.
    """
    bounds, nodes, halves = grid.bounds, grid.nodes, grid.halves
    counts, across, finer = grid.counts, grid.across, grid.finer
    levels = counts.shape[0] - 1
    p = nodes.shape[0]
    q = across.shape[1]
    places = np.empty((p * q, 2))
    values = np.zeros((1, p, q))
    for level in range(levels + 1):
        boxes, n = 2**level, counts[level]  # boxes of the level, and nodes across in each
        width = (bounds[1] - bounds[0]) / boxes  # of a box along x, m
        # the parents' values, at this level's nodes across
        inherited = _across(values, counts[max(level - 1, 0)], finer[level], n)
        values = np.zeros((boxes, p, q))
        for box in range(boxes):
            parent, place = box // 2, boxes - 1 + box  # place: row of the box in `near`
            left, right = near[place, 0], near[place, 1]
            first = 0
            last = samples.shape[0]
            if level > 0:
                first, last = near[boxes // 2 - 1 + parent, 0], near[boxes // 2 - 1 + parent, 1]
                for a in range(p):
                    for b in range(p):
                        share = halves[box % 2, a, b]
                        for c in range(n):
                            values[box, a, c] += share * inherited[parent, b, c]
            west = bounds[0] + box * width
            for a in range(p):
                for c in range(n):
                    places[a * n + c, 0] = west + 0.5 * width * (1.0 + nodes[a])
                    places[a * n + c, 1] = across[level, c]
            # the samples near the parent, west and east of those near the box
            for begin, end in ((first, left), (right, last)):
                if end > begin:
                    added = magnitude_sum(places[: p * n], samples[begin:end], k1)
                    for a in range(p):
                        for c in range(n):
                            values[box, a, c] += added[a * n + c]
    return _across(values, counts[levels], finer[levels + 1], q)


@compiled
def _across(values: FloatArray, count: int, finer: FloatArray, n: int) -> FloatArray:
    """Values at n nodes across, or n terms of a series, from values at `count` nodes across,
    (boxes, p, q).

    values: at the nodes, (boxes, p, q), of which the first `count` across are used.
    finer: matrix from the values to the result, transposed, (q, q).
    """
    result = np.zeros(values.shape)
    for box in range(values.shape[0]):
        for a in range(values.shape[1]):
            for b in range(count):
                for c in range(n):
                    result[box, a, c] += finer[b, c] * values[box, a, b]
    return result


@compiled
def put_field(
    rows: Any, samples: FloatArray, near: IntArray, far: FloatArray, k1: float,
    field: FloatArray,
) -> None:  # fmt: skip
    """Eq. 9: put the field at rows of k points across the road into `field`. Near samples are
    summed, far ones interpolated.

    rows: `shared_fields.PointRows`.
    samples: as in `far_values`.
    near: as in `far_values`, of the smallest boxes alone.
    far: from `far_values`.
    k1: decay with distance.
    field: (s, k). Rows of points that are in no box stay as they are.

    Every inner loop is over the rows of a box and becomes vector instructions.
    """
    points, order, starts = rows.points, rows.order, rows.starts
    shares, across = rows.shares, rows.across
    k = across.shape[0]
    p = far.shape[1]
    q = far.shape[2]
    for box in range(near.shape[0]):
        first, last = starts[box], starts[box + 1]
        n = last - first
        if n == 0:
            continue
        sums = magnitude_sum(
            points[first:last].reshape(n * k, 2), samples[near[box, 0] : near[box, 1]], k1
        )
        series = np.zeros((q, n))
        for b in range(q):
            into = series[b]
            for a in range(p):
                value = far[box, a, b]
                share = shares[a, first:last]
                for row in range(n):
                    into[row] += value * share[row]
        # the field of far samples is Clenshaw's sum of a Chebyshev series; now, before: the two
        # last terms of its recurrence
        now, before, interpolated = np.empty(n), np.empty(n), np.empty(n)
        for point in range(k):
            place = across[point, first:last]
            for row in range(n):
                now[row] = series[q - 1, row]
                before[row] = 0.0
            for b in range(q - 2, 0, -1):
                term = series[b]
                for row in range(n):
                    following = term[row] + (2.0 * place[row] * now[row] - before[row])
                    before[row] = now[row]
                    now[row] = following
            for row in range(n):
                interpolated[row] = series[0, row] + (place[row] * now[row] - before[row])
            for row in range(n):
                field[order[first + row], point] = sums[row * k + point] + interpolated[row]
