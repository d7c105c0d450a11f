"""The reference line of a road that follows a polyline of a SUMO network, by least squares; its
curvature is linear from knot to knot.

Curvatures are rounded, so that all machines get the same road: a changed digit changes recorded
drives.

Users: `scenario/sumo_network.py`.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.scenario.road.pose import Pose, onto_the_line
from sumo_eval.scenario.road.reference_line import Line, Piece, map_places
from sumo_eval.trajectory import FloatArray

WITHIN = 0.25  # m, largest allowed distance of the line from the polyline
_KNOTS = (10.0, 5.0, 2.5, 1.25)  # m between knots, tried in order until the line is near enough
_SAMPLES = 2.0  # m, at most, between places of the polyline that the line is fitted to
_STEP = 1.25  # m, at most, of an integration step; two steps or more from knot to knot
_ROUNDS = 12  # Gauss-Newton rounds, at most
# The rounds end when a round shifts the line's beginning by less than this, m, and changes each
# curvature by less than this over the line's length, rad.
_SETTLED = 1e-3
# Weight of smoothness in the least squares: a second difference of the curvatures counts like a
# place that is off the line by _SMOOTH * (distance of the knots)^2 * difference, m.
_SMOOTH = 0.05
_DIGITS = 8  # decimals of a curvature in 1/m; rounded, it is the same on all machines


class FittedLine(NamedTuple):
    """A line fitted to a polyline.

    begins: pose of its beginning on the map.
    off: largest distance of the polyline's places from it, m.
    """

    line: Line
    begins: Pose
    off: float


def fitted_line(polyline: FloatArray) -> FittedLine:
    """The line along a polyline (n, 2), m, in which no two neighbouring vertices are equal.

    The fit finds the curvatures at knots and the pose at the beginning. It takes the fewest knots
    (of `_KNOTS`) that keep the line within `WITHIN` of the polyline; if none do, as at corners, the
    nearest line. Where no fit succeeds there are no pieces, and the distance is inf.
    """
    places = _resampled(polyline)
    best = FittedLine((), Pose(0.0, 0.0, 0.0), math.inf)
    for apart in _KNOTS:
        try:
            best = min(best, _fitted(places, apart), key=lambda fit: fit.off)
        # the rounds diverged, as they may between corners, to no line or to no possible `Piece`
        except (np.linalg.LinAlgError, InputError):
            continue
        if best.off <= WITHIN:
            break
    return best


def _resampled(polyline: FloatArray) -> FloatArray:
    """Vertices of a polyline, and evenly spaced places between them, at most `_SAMPLES` apart."""
    parts = [polyline[:1]]
    for begin, end in itertools.pairwise(polyline):
        count = math.ceil(np.hypot(*(end - begin)) / _SAMPLES)
        shares = np.arange(1, count + 1) / count  # of the way from `begin` to `end`
        parts.append(begin + (end - begin) * shares[:, None])
    return np.concatenate(parts)


class _Grid(NamedTuple):
    """Integration steps along a line, by which curvatures at knots become a line.

    length: of the line, m.
    step: length of a step, m.
    s: ends of the steps, (count + 1,).
    middle: s of their middles, (count,).
    knots: s of the knots, (k,).
    turned: matrix (count, k), m; times the curvatures at the knots it gives the headings at the
        middles, less the first heading.
    smooth: matrix (k - 2, k), m2; times these curvatures it gives their weighted second
        differences.
    """

    length: float
    step: float
    s: FloatArray
    middle: FloatArray
    knots: FloatArray
    turned: FloatArray
    smooth: FloatArray


class _Feet(NamedTuple):
    """Feet of the perpendiculars from n places to a line.

    s: along the line, m, (n,).
    to_left: unit vectors to the left of the line, (n, 2).
    off: vectors from the feet to the places, m, (n, 2).
    """

    s: FloatArray
    to_left: FloatArray
    off: FloatArray


class _GridLine(NamedTuple):
    """A line on a grid.

    heading: at the middles of steps, rad, (count,).
    steps: how far each step goes east and north, m, (count, 2).
    ends: x and y at the ends of steps, m, (count + 1, 2).
    """

    grid: _Grid
    heading: FloatArray
    steps: FloatArray
    ends: FloatArray

    def at(self, s: FloatArray) -> FloatArray:
        """Its places at s, (n, 2)."""
        return np.column_stack([np.interp(s, self.grid.s, axis) for axis in self.ends.T])


def _fitted(places: FloatArray, apart: float) -> FittedLine:
    """The line with knots about `apart` m apart along places (n, 2), by Gauss-Newton rounds."""
    east, north = np.diff(places, axis=0).T
    s = np.concatenate([[0.0], np.cumsum(np.hypot(east, north))])
    headings = np.unwrap(np.arctan2(north, east))
    grid = _grid(float(s[-1]), apart)
    first = np.array([*places[0], headings[0]])  # pose of the beginning: x, y, heading
    curvature = _curvatures(grid, s, headings)
    for _ in range(_ROUNDS):
        line = _integrated(grid, first, curvature)
        feet = _feet(line, places, s)
        s = feet.s
        # the beginning is shifted across the line alone, so that it stays beside the first place
        across = np.array([-np.sin(first[2]), np.cos(first[2])])
        shift, turn, *changes = _improvement(line, feet, across, curvature)
        first = first + np.array([*(shift * across), turn])
        curvature = curvature + changes
        if abs(shift) < _SETTLED and np.abs(changes).max() < _SETTLED / grid.length:
            break
    curvature = np.round(curvature, _DIGITS) + 0.0  # + 0.0 makes -0.0 positive
    return _line_of(grid.length, curvature.tolist(), Pose(*map(float, first)), places, s)


def _improvement(
    line: _GridLine, feet: _Feet, across: FloatArray, curvature: FloatArray
) -> FloatArray:
    """Changes that bring the line nearest to the places, to first order: shift of the beginning
    along `across`, m, turn of its heading, rad, and change of each curvature, 1/m; (2 + k,).

    across: unit vector, (2,). curvature: at the knots, (k,).
    """
    smooth = line.grid.smooth
    # Equations: rows @ changes = wanted. A row for each place: its distance from the line. A row
    # for each second difference of the curvatures: it should become 0.
    by_shift = feet.to_left @ across[:, None]
    rows = np.hstack([by_shift, *_derivatives(line, feet.s, feet.to_left)])
    rows = np.vstack([rows, np.hstack([np.zeros((len(smooth), 2)), smooth])])
    distances = np.einsum("ij,ij->i", feet.off, feet.to_left)
    wanted = np.concatenate([distances, -smooth @ curvature])
    # least squares by QR of rows and `wanted` side by side: R of the rows, and in the last
    # column Q' wanted
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows, wanted]), mode="r"))
    return np.linalg.solve(triangle[:-1, :-1], triangle[:-1, -1])


def _line_of(
    length: float, at_knots: list[float], begins: Pose, places: FloatArray, near: FloatArray
) -> FittedLine:
    """The line of known curvatures, and its distance from places (n, 2).

    at_knots: curvatures at the evenly spaced knots, 1/m: the pieces lie between them.
    begins: pose of the line's beginning. near: s of the places' feet, about, m, (n,).
    """
    piece = length / (len(at_knots) - 1)
    pieces = tuple(Piece(piece, begin, end) for begin, end in itertools.pairwise(at_knots))
    x, y, heading = map_places(pieces, near, 0.0)
    off_x, off_y = onto_the_line(places, begins).T - (x, y)
    across = off_y * np.cos(heading) - off_x * np.sin(heading)
    return FittedLine(pieces, begins, float(np.abs(across).max()))


def _grid(length: float, apart: float) -> _Grid:
    """The grid of a line of a length, m, with knots about `apart` m apart."""
    pieces = max(round(length / apart), 1)
    count = pieces * max(math.ceil(apart / _STEP), 2)
    step = length / count
    s = np.linspace(0.0, length, count + 1)
    middle = 0.5 * (s[:-1] + s[1:])
    knots = np.linspace(0.0, length, pieces + 1)
    unit = np.eye(pieces + 1)  # row k: curvature 1 at knot k, 0 at the others
    # hat functions: column k has the curvature at each middle if it is 1 at knot k alone
    hats = np.array([np.interp(middle, knots, curvatures) for curvatures in unit]).T
    # their integrals up to the ends of the steps; at a middle the mean of both ends
    at_ends = np.concatenate([np.zeros((1, pieces + 1)), np.cumsum(hats, axis=0) * step])
    turned = 0.5 * (at_ends[:-1] + at_ends[1:])
    smooth = _SMOOTH * apart**2 * np.diff(unit, 2, axis=0)
    return _Grid(length, step, s, middle, knots, turned, smooth)


def _curvatures(grid: _Grid, along: FloatArray, headings: FloatArray) -> FloatArray:
    """First guess of the curvatures at the knots, 1/m, (k,): change of a polyline's heading from
    half a piece before each knot to half a piece after it.

    along: s of the polyline's vertices, m. headings: of its sides, rad.
    """
    count = len(grid.knots) - 1  # number of pieces
    middles = 0.5 * (along[:-1] + along[1:])
    half = 0.5 * grid.length / count
    before = np.interp(grid.knots - half, middles, headings)
    after = np.interp(grid.knots + half, middles, headings)
    return (after - before) * count / grid.length


def _integrated(grid: _Grid, first: FloatArray, curvature: FloatArray) -> _GridLine:
    """The line that begins at `first`, (x, y, heading), with these curvatures at the knots."""
    heading = first[2] + grid.turned @ curvature
    steps = np.column_stack([np.cos(heading), np.sin(heading)]) * grid.step
    ends = first[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return _GridLine(grid, heading, steps, ends)


def _feet(line: _GridLine, places: FloatArray, near: FloatArray) -> _Feet:
    """Feet of places on a line, one step nearer than approximate feet.

    near: s of the approximate feet, m, (n,); `to_left` of the result is taken there.
    """
    heading = np.interp(near, line.grid.middle, line.heading)
    cos = np.cos(heading)
    sin = np.sin(heading)
    off = places - line.at(near)
    s = np.clip(near + off[:, 0] * cos + off[:, 1] * sin, 0.0, line.grid.length)
    return _Feet(s, np.column_stack([-sin, cos]), places - line.at(s))


def _derivatives(
    line: _GridLine, s: FloatArray, to_left: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """How far the line's points at s, (n,), move to the left: derivatives by the first heading,
    (n, 1), and by the curvatures at the knots, (n, k).

    to_left: unit vectors to the left at s, (n, 2).
    """
    grid = line.grid
    # the step in which each s lies, and the share of that step up to s
    below = np.clip(np.searchsorted(grid.s, s, side="right") - 1, 0, len(grid.middle) - 1)
    share = ((s - grid.s[below]) / grid.step)[:, None]

    def moved(steps: FloatArray) -> FloatArray:
        """Derivatives of one coordinate at s by the curvatures, (n, k).

        steps: by how much each step moves what follows it if the step turns by 1 rad, m, (count,).
        """
        swept = np.cumsum(steps[:, None] * grid.turned, axis=0)
        sums = np.concatenate([np.zeros((1, len(grid.knots))), swept])  # at the ends of the steps
        return np.asarray(sums[below] + share * (sums[below + 1] - sums[below]))

    to_left_x, to_left_y = to_left[:, :1], to_left[:, 1:]
    east, north = line.steps.T
    by_curvature = to_left_x * moved(-north) + to_left_y * moved(east)
    # a turn of the first heading turns the whole line about its beginning
    arm = line.at(s) - line.ends[0]
    by_heading = to_left_x * -arm[:, 1:] + to_left_y * arm[:, :1]
    return by_heading, by_curvature
