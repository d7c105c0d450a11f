"""Fields of many trajectories at many points of one road, Eq. 9, without summing every sample at
every point.

Away from a sample the field is a smooth function of the position. So the road is divided into
boxes: one of its whole length, which is halved again and again. A sample is far from a box if it is
further away than the box's length, else near. Far samples are summed at the box's nodes only, and a
polynomial through the nodes gives their field at every point of the box. Near samples are summed at
the points themselves.

The result equals `trajectory_field.trajectory_fields` to 1e-11, relative. The error of a
polynomial through n nodes on -1..1 falls like rho^-n. Here rho is the sum of the half-axes of the
largest ellipse with foci -1 and 1 (Bernstein's) in which the function has no singularity. A
sample's field is singular at the sample itself (along x), and above and below it in the complex
plane of y. Far samples of a box of length L begin one length away. The strip, the road from its
right to its left edge, has the half-width h <= L/3.2. So rho is

- along x, where a box is -1..1 and far samples begin at 3: 3 + sqrt(3^2 - 1) = 5.8, for which 16
  nodes are enough,
- across, where the strip is -1..1 and singularities begin at i L/h: L/h + sqrt((L/h)^2 + 1) >= 6.5,
  for which at most 14 nodes are enough.

The error is then about 6.5e-12 of each sample's field; measured are 2.6e-12 (k1 = 0.5) to 6e-12
(k1 = 1). The plain sum is used where this does not hold (large constants, superposition "vector",
points off the stretch), and where boxes save nothing.

Users: `anthropomorphic`; `record/`, which calls `prepare`. Fixed: the order of all sums, so that
D_i keeps its bits.
"""

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
REACH = 1.0  # a sample is far from a box beyond this distance, in lengths of the box
# least length of a box, in half-widths of the strip; shorter boxes would cost more than they save
SLENDER = 3.2
ERROR_ACROSS = 6.5e-12  # largest relative error across; the number of nodes across follows from it
LARGEST_K1 = 1.0  # a field that decays faster is summed plainly
LARGEST_EXPONENT = 0.5  # largest k2 v; a field that grows faster with speed is summed plainly
NARROWEST = 0.5  # m, least half-width of a strip


class Stretch(NamedTuple):
    """The part of a road that is divided into boxes: its limits in x and in y, m."""

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
        """The y of the middle between both edges, m."""
        return 0.5 * (self.south + self.north)

    @property
    def half(self) -> float:
        """Half of the width, m."""
        return max(0.5 * (self.north - self.south), NARROWEST)

    @property
    def levels(self) -> int:
        """Number of times that the stretch is halved into boxes; 0: it is too short for halves."""
        return int(np.log2(max(self.length / self.half / SLENDER, 1.0)))

    def holds(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether all points of each row across the road lie inside, (s,).

        x: of the rows, (s,), m.
        y: of the points, (s, k), m.
        """
        inside: BoolArray = (
            np.all((y >= self.south) & (y <= self.north), axis=1)
            & (x >= self.west)
            & (x <= self.east)
        )
        return inside


class Grid(NamedTuple):
    """Boxes of a stretch of road, and the nodes in each.

    Level 0 is one box, the whole stretch. Each further level has twice as many boxes.

    bounds: least and largest x of the stretch, m.
    nodes: p Chebyshev points along x, where a box is -1..1, (p,).
    halves: matrices from values at the nodes of a box to values at the nodes of its left and right
        half, (2, p, p).
    counts: number of nodes across on each level, (levels + 1,), at most q.
    across: y of these nodes, (levels + 1, q), m.
    finer: matrices, transposed, (levels + 2, q, q). finer[l], 1 <= l <= levels: from values at the
        nodes across of level l - 1 to values at the nodes across of level l. finer[levels + 1]:
        from values at the nodes of the last level to a Chebyshev series. finer[0]: zeros.
    """

    bounds: FloatArray
    nodes: FloatArray
    halves: FloatArray
    counts: IntArray
    across: FloatArray
    finer: FloatArray


class PointRows(NamedTuple):
    """Rows of points across the road, sorted by the smallest boxes that they lie in.

    points: x and y, (s, k, 2), m.
    order: index of each row in the request, (s,).
    starts: first row of each box, and s at the end, (boxes + 1,).
    shares: weight of each of the p nodes of a row's box in the value at this row, (p, s).
    across: y of the points, where the strip is -1..1, (k, s).
    """

    points: FloatArray
    order: IntArray
    starts: IntArray
    shares: FloatArray
    across: FloatArray


def prepare() -> None:
    """Load the compiled loops before they are needed; the first time on a machine they are
    compiled, which takes 4 s.
    """
    time = np.arange(0.0, 20.0, 0.1)
    drive = Trajectory(time, 20.0 * time, np.zeros_like(time), speed=np.full_like(time, 20.0))
    rows = np.arange(0.0, 400.0, 0.5)
    across = np.linspace(-1.5, 1.5, 7)
    fields = SharedFields(
        [drive], Stretch(0.0, 400.0, -2.0, 2.0), FieldSettings(), len(rows) * len(across)
    )
    fields.at(rows, np.broadcast_to(across, (len(rows), len(across))), [0])


class SharedFields:
    """The fields of some trajectories on a stretch of road, for many requests.

    trajectories: of the vehicles.
    stretch: part of the road in which boxes are used; points off it take longer.
    constants: k1, k2, sample interval and superposition of Eqs. 9-10.
    points: expected number of points of a request. It decides for all requests whether boxes are
        used, so that no result depends on another request.

    Far samples of a trajectory are summed once for all requests, because their sum depends on the
    trajectory and the stretch alone.
    """

    def __init__(
        self,
        trajectories: Sequence[Trajectory],
        stretch: Stretch,
        constants: FieldSettings,
        points: int,
    ) -> None:
        self._trajectories, self._stretch, self._constants = trajectories, stretch, constants
        smooth = constants.k1 <= LARGEST_K1 and constants.superposition == "magnitude"
        self._by_boxes = smooth and _pays(points, stretch)
        self._prepared_once = functools.cache(self._prepared)

    def at(self, x: FloatArray, y: FloatArray, indices: Sequence[int]) -> FloatArray:
        """Eq. 9: S of m trajectories at s rows of k points across the road, (m, s, k).

        x: of the rows, (s,), m.
        y: of the points, (s, k), m.
        indices: of the trajectories, (m,).

        Raises InputError as `trajectory_fields`.
        """
        from sumo_eval.method.field_loops import put_field

        inside = self._stretch.holds(x, y)
        points = np.stack((np.broadcast_to(x[:, None], y.shape), y), axis=-1)
        rows = None
        if self._by_boxes and inside.any():
            rows = _point_rows(self._stretch, points, np.flatnonzero(inside))
        fields = np.empty((len(indices), *y.shape))
        for index, field in zip(indices, fields, strict=True):
            boxed = None if rows is None else self._prepared_once(index)
            if boxed is not None:
                put_field(rows, *boxed, float(self._constants.k1), field)  # writes into `fields`
            plainly = np.ones_like(inside) if boxed is None else ~inside
            if plainly.any():
                drives = [self._trajectories[index]]
                plain = trajectory_fields(points[plainly].reshape(-1, 2), drives, self._constants)
                field[plainly] = plain.reshape(-1, y.shape[1])
        return fields

    def _prepared(self, index: int) -> tuple[FloatArray, IntArray, FloatArray] | None:
        """Arguments of `put_field` for one trajectory: its `samples`, `near` and `far`. None where
        its field grows too fast with speed for boxes.

        index: of the trajectory.
        """
        from sumo_eval.method.field_loops import far_values

        constants = self._constants
        grid, west, east = _boxes(self._stretch)
        samples = samples_of(self._trajectories[index], constants.k2, constants.sample_interval)
        if np.abs(samples[:, 4]).max() > LARGEST_EXPONENT:  # column 4: k2 v
            return None
        samples = samples[np.argsort(samples[:, 0], kind="stable")]
        first = np.searchsorted(samples[:, 0], west)
        near = np.column_stack((first, np.searchsorted(samples[:, 0], east, side="right")))
        far = far_values(samples, grid, near, float(constants.k1))
        smallest = 2**self._stretch.levels  # boxes of the last level
        return samples, near[-smallest:], far


def _point_rows(stretch: Stretch, points: FloatArray, rows: IntArray) -> PointRows:
    """Rows of points, sorted by their boxes.

    points: x and y, (s, k, 2), m.
    rows: indices of the rows that are inside the stretch.
    """
    number = 2**stretch.levels
    order = rows[np.argsort(points[rows, 0, 0], kind="stable")]
    points = points[order]
    x, y = points[:, 0, 0], points[..., 1]
    position = (x - stretch.west) / (stretch.length / number)  # in lengths of a box
    box = np.minimum(position.astype(np.int64), number - 1)
    starts = np.searchsorted(box, np.arange(number + 1))
    # weight of each node of a row's box in the value at this row, (s, p); 2 (position - box) - 1 is
    # the row's position where its box is -1..1
    series = _nodes()[2]
    along = chebyshev.chebvander(2.0 * (position - box) - 1.0, NODES - 1) @ series
    across = np.ascontiguousarray((y.T - stretch.middle) / stretch.half)
    return PointRows(points, order, starts, np.ascontiguousarray(along.T), across)


def _pays(points: int, stretch: Stretch) -> bool:
    """Whether boxes need fewer terms than the plain sum at this number of points."""
    levels = stretch.levels
    if levels == 0:
        return False
    # Numbers of terms, divided by the number of samples on the stretch. A point sums the samples
    # near its smallest box: those of `near` lengths of this box. A node of a box sums samples that
    # are near the parent and far from the box: also those of `near` lengths of the box. Level l has
    # 2**l boxes, each 2**-l of the stretch long, so l cancels in the sum over nodes.
    near = 1.0 + 2.0 * REACH
    nodes = NODES * sum(_boxes(stretch)[0].counts.tolist())
    return bool(near * (nodes + points / 2**levels) < points)


@functools.lru_cache(maxsize=1)
def _boxes(stretch: Stretch) -> tuple[Grid, FloatArray, FloatArray]:
    """The boxes of a stretch, and the least and largest x, m, of samples near each box, level after
    level, (2**(levels + 1) - 1,) each. Cached for the last stretch alone.
    """
    lengths = [stretch.length / 2**level for level in range(stretch.levels + 1)]
    counts, places, finer = _across([length / stretch.half for length in lengths])
    bounds = np.array([stretch.west, stretch.east])
    across = stretch.middle + stretch.half * places
    # length and first x of each box, level after level; 2^l - 1 boxes precede level l
    boxes = 2 ** np.arange(len(lengths))
    length = np.repeat(lengths, boxes)
    begin = bounds[0] + length * (np.arange(boxes.sum()) - np.repeat(boxes - 1, boxes))
    grid = Grid(bounds, *_nodes()[:2], counts, across, finer)
    return grid, begin - REACH * length, begin + (1.0 + REACH) * length


@functools.cache
def _nodes() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Chebyshev points of -1..1, (p,), and two kinds of matrices from values at these points: to
    values at the points of the left and the right half, (2, p, p), and to the coefficients of a
    Chebyshev series, (p, p).
    """
    nodes = chebyshev.chebpts1(NODES)
    series = _to_series(nodes)
    halves = [chebyshev.chebvander(0.5 * (nodes + side), NODES - 1) @ series for side in (-1, 1)]
    return nodes, np.array(halves), series


def _to_series(nodes: FloatArray) -> FloatArray:
    """Matrix from values at n nodes to the coefficients of a Chebyshev series, (n, n)."""
    inverse = np.linalg.inv(chebyshev.chebvander(nodes, len(nodes) - 1))
    return np.array(inverse, float)


def _across(slender: Sequence[float]) -> tuple[IntArray, FloatArray, FloatArray]:
    """`counts`, `across` (on -1..1) and `finer` of a `Grid`: the nodes across of each level.

    slender: length over half-width of the boxes of each level.
    """
    # rho of the file's docstring: the longer a box, the larger is rho, and the fewer the nodes
    ellipses = [REACH * ratio + math.hypot(REACH * ratio, 1.0) for ratio in slender]
    counts = np.array([math.ceil(-math.log(ERROR_ACROSS) / math.log(size)) for size in ellipses])
    most = counts.max()
    nodes = [chebyshev.chebpts1(count) for count in counts.tolist()]
    places, finer = np.zeros((len(counts), most)), np.zeros((len(counts) + 1, most, most))
    for level, positions in enumerate(nodes):
        places[level, : len(positions)] = positions
        matrix = _to_series(positions)
        if level + 1 < len(nodes):
            matrix = chebyshev.chebvander(nodes[level + 1], len(positions) - 1) @ matrix
        finer[level + 1, : len(positions), : len(matrix)] = matrix.T
    return counts, places, finer
