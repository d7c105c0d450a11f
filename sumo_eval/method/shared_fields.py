"""Fields of many trajectories at many points of one road, Eq. 9, without summing every sample at
every point.

Away from a sample the field is a smooth function of the place. So the road is divided into boxes,
halved again and again. What lies further than its own length from a box is summed at that box's
nodes only, and a polynomial through the nodes gives it at every point of the box; what is near is
summed at the points themselves.

The result is that of `trajectory_field.trajectory_fields` to 1e-11, relative. The summand is
singular at the sample itself (along x) and above and below it in the complex plane of y. Far
samples of a box of length L begin one length away, in a strip of half-width h <= L/3.2. So these
places lie on Bernstein ellipses of

- along x: 3 + sqrt(8) = 5.8, for which 16 nodes are enough,
- across: L/h + sqrt((L/h)^2 + 1) >= 6.5, for which at most 14 are.

They leave 6.5e-12 of each sample's field, about; found is 2.6e-12 (k1 = 0.5) to 6e-12 (k1 = 1).
Where that does not hold (large constants, vectors, points off it), or does not pay, the plain sum
is taken.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from sumo_eval.method.trajectory_field import samples_of, trajectory_fields
from sumo_eval.settings import FieldSettings
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray, Trajectory

NODES = 16  # in a box, along x
REACH = 1.0  # lengths of a box from which on a sample is far from it
# least length of a box over the strip's half-width; shorter ones cost more than they save
SLENDER = 3.2
LEFT = 6.5e-12  # of a sample's field, about, is what the nodes across leave
LARGEST_K1 = 1.0  # a field that decays faster is summed plainly
LARGEST_EXPONENT = 0.5  # and so is one that grows faster with speed ahead: k2 v
NARROWEST = 0.5  # m; a narrower strip is treated as if it were this half-wide


class Stretch(NamedTuple):
    """The part of a road that is divided into boxes: between which x and which y, m."""

    west: float
    east: float
    south: float
    north: float

    @property
    def length(self) -> float:
        """Along x, m."""
        return self.east - self.west

    @property
    def middle(self) -> float:
        """The y half-way across, m."""
        return 0.5 * (self.south + self.north)

    @property
    def half(self) -> float:
        """Half of the width, m."""
        return max(0.5 * (self.north - self.south), NARROWEST)

    @property
    def levels(self) -> int:
        """Number of times that the strip is halved into boxes; 0: it is too short."""
        return int(np.log2(max(self.length / self.half / SLENDER, 1.0)))

    def holds(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether it holds all points of each row across.

        x: (s,), m.
        y: (s, k), m.
        """
        inside: BoolArray = (
            np.all((y >= self.south) & (y <= self.north), axis=1)
            & (x >= self.west)
            & (x <= self.east)
        )
        return inside


class Grid(NamedTuple):
    """Boxes of a stretch of road, halved again and again, and the nodes in each.

    bounds: of all boxes together, x.
    nodes: p Chebyshev points on -1..1, the x of a box.
    halves: (2, p, p), values at the nodes of a box to values at those of its halves.
    counts: how many nodes each level has across, (levels + 1,), at most q.
    across: their y, (levels + 1, q).
    finer: (levels + 2, q, q), values at the nodes across of one level to those of the next; last,
        to the series.
    """

    bounds: FloatArray
    nodes: FloatArray
    halves: FloatArray
    counts: IntArray
    across: FloatArray
    finer: FloatArray


class PointRows(NamedTuple):
    """Rows of points across, box after box.

    points: (s, k, 2), m.
    order: which row of the field each is, (s,).
    starts: the first row of each box, and s.
    shares: of the values at the nodes of its box in those at a row, (p, s).
    across: y of the points on -1..1, the strip, (k, s).
    """

    points: FloatArray
    order: IntArray
    starts: IntArray
    shares: FloatArray
    across: FloatArray


def prepare() -> None:
    """Have the compiled loops there before they are needed: loaded, and on a machine's first time
    compiled, for 4 s.
    """
    time = np.arange(0.0, 20.0, 0.1)
    drive = Trajectory(time, 20.0 * time, np.zeros_like(time), speed=np.full_like(time, 20.0))
    rows, across = np.arange(0.0, 400.0, 0.5), np.linspace(-1.5, 1.5, 7)
    fields = SharedFields(
        [drive], Stretch(0.0, 400.0, -2.0, 2.0), FieldSettings(), len(rows) * len(across)
    )
    fields.at(rows, np.broadcast_to(across, (len(rows), len(across))), [0])


class _BoxedSamples(NamedTuple):
    """A trajectory for its sums by boxes.

    samples: by x.
    near: the first and last (exclusive) of those near each of the smallest boxes.
    far: the sum of all others there.
    """

    samples: FloatArray
    near: IntArray
    far: FloatArray


class SharedFields:
    """The fields of some trajectories on a stretch of road, for many requests.

    Far samples are summed once for a trajectory. Their sum depends on the trajectory and the
    stretch alone, not on the requested points.

    points: how many a request is expected to have. This decides whether boxes are used, for every
        request alike, so that no answer depends on earlier ones.
    """

    def __init__(
        self,
        trajectories: Sequence[Trajectory],
        stretch: Stretch,
        constants: FieldSettings,
        points: int,
    ) -> None:
        self._trajectories, self._stretch, self._constants = trajectories, stretch, constants
        boxes = constants.k1 <= LARGEST_K1 and constants.superposition == "magnitude"
        self._by_boxes = boxes and _pays(points, stretch)
        self._prepare = functools.cache(self._prepared)

    def at(self, x: FloatArray, y: FloatArray, places: Sequence[int]) -> FloatArray:
        """Eq. 9 for m of the trajectories at s rows of k points across the road, (m, s, k).

        x: of the rows, (s,), m.
        y: (s, k), m.

        Errors as in `trajectory_fields`.
        """
        from sumo_eval.method.field_loops import put_field

        inside, everywhere = self._stretch.holds(x, y), np.full(len(x), True)
        points = np.stack((np.broadcast_to(x[:, None], y.shape), y), axis=-1)
        into = None
        if self._by_boxes and inside.any():
            into = _point_rows(self._stretch, points, np.flatnonzero(inside))
        fields = np.empty((len(places), *y.shape))
        for place, field in zip(places, fields, strict=True):
            one = None if into is None else self._prepare(place)
            if one is not None:
                put_field(into, one.samples, one.near, one.far, float(self._constants.k1), field)
            rest = everywhere if one is None else ~inside
            if rest.any():
                drives = [self._trajectories[place]]
                plain = trajectory_fields(points[rest].reshape(-1, 2), drives, self._constants)
                field[rest] = plain.reshape(-1, y.shape[1])
        return fields

    def _prepared(self, place: int) -> _BoxedSamples | None:
        """One trajectory; None where the field grows too fast with its speed for boxes."""
        from sumo_eval.method.field_loops import far_values

        constants, boxes = self._constants, _boxes(self._stretch)
        samples = samples_of(self._trajectories[place], constants.k2, constants.sample_interval)
        if np.abs(samples[:, 4]).max() > LARGEST_EXPONENT:
            return None
        samples = samples[np.argsort(samples[:, 0], kind="stable")]
        first = np.searchsorted(samples[:, 0], boxes.west)
        near = np.column_stack((first, np.searchsorted(samples[:, 0], boxes.east, side="right")))
        far = far_values(samples, boxes.grid, near, float(constants.k1))
        return _BoxedSamples(samples, near[-(2**self._stretch.levels) :], far)


def _point_rows(stretch: Stretch, points: FloatArray, rows: IntArray) -> PointRows:
    """Some rows of points (s, k, 2), all inside the stretch, box after box."""
    number = 2**stretch.levels
    order = rows[np.argsort(points[rows, 0, 0], kind="stable")]
    points = points[order]
    x, y = points[:, 0, 0], points[..., 1]
    boxes = (x - stretch.west) / (stretch.length / number)
    box = np.minimum(boxes.astype(np.int64), number - 1)
    starts = np.searchsorted(box, np.arange(number + 1))
    along = chebyshev.chebvander(2.0 * (boxes - box) - 1.0, NODES - 1) @ _nodes()[2]
    across = np.ascontiguousarray((y.T - stretch.middle) / stretch.half)
    return PointRows(points, order, starts, np.ascontiguousarray(along.T), across)


def _pays(points: int, stretch: Stretch) -> bool:
    """Whether less is summed by boxes than at the points."""
    levels = stretch.levels
    if levels == 0:
        return False
    # each box sums, at its nodes and at its points, the samples over this many of its lengths
    reached = 1.0 + 2.0 * REACH
    nodes = NODES * sum(_boxes(stretch).grid.counts.tolist())
    return bool(reached * (nodes + points / 2**levels) < points)


class _Boxes(NamedTuple):
    """The boxes of a stretch.

    west, east: between which x a sample is near each box, level after level.
    """

    grid: Grid
    west: FloatArray
    east: FloatArray


@functools.lru_cache(maxsize=1)
def _boxes(stretch: Stretch) -> _Boxes:
    lengths = [stretch.length / 2**level for level in range(stretch.levels + 1)]
    counts, places, finer = _across([length / stretch.half for length in lengths])
    bounds, across = np.array([stretch.west, stretch.east]), stretch.middle + stretch.half * places
    begins = [bounds[0] + length * np.arange(2**level) for level, length in enumerate(lengths)]
    placed = list(zip(begins, lengths, strict=True))
    return _Boxes(
        Grid(bounds, *_nodes()[:2], counts, across, finer),
        np.concatenate([begin - REACH * length for begin, length in placed]),
        np.concatenate([begin + (1.0 + REACH) * length for begin, length in placed]),
    )


@functools.cache
def _nodes() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Chebyshev points; values there to values at those of the left and the right half, (2, p, p);
    and to the coefficients of a Chebyshev series, (p, p).
    """
    nodes = chebyshev.chebpts1(NODES)
    series = _to_series(nodes)
    halves = [chebyshev.chebvander(0.5 * (nodes + side), NODES - 1) @ series for side in (-1, 1)]
    return nodes, np.array(halves), series


def _to_series(nodes: FloatArray) -> FloatArray:
    """Values at n nodes to the coefficients of a Chebyshev series, (n, n)."""
    inverse = np.linalg.inv(chebyshev.chebvander(nodes, len(nodes) - 1))
    return np.array(inverse, dtype=float)


def _across(slender: Sequence[float]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Nodes across for each level of boxes: how many, where on -1..1, and the matrices that make
    values there values at the nodes of the next level, or last a Chebyshev series; as `far_values`
    takes them.

    slender: length over half-width of the boxes of each level.
    """
    # the longer a box, the fewer nodes it needs
    bernstein = [REACH * ratio + math.hypot(REACH * ratio, 1.0) for ratio in slender]
    counts = np.array([math.ceil(-math.log(LEFT) / math.log(number)) for number in bernstein])
    most = counts.max()
    nodes = [chebyshev.chebpts1(count) for count in counts.tolist()]
    places, finer = np.zeros((len(counts), most)), np.zeros((len(counts) + 1, most, most))
    for level, here in enumerate(nodes):
        places[level, : len(here)] = here
        series = _to_series(here)
        if level + 1 < len(nodes):
            series = chebyshev.chebvander(nodes[level + 1], len(here) - 1) @ series
        finer[level + 1, : len(here), : len(series)] = series.T
    return counts, places, finer
