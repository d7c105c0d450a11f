"""The line of a road along a polyline: its curvature is linear from knot to knot."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from sumo_eval.scenario.road.pose import Pose
from sumo_eval.scenario.road.reference_line import Piece, map_places
from sumo_eval.trajectory import FloatArray

WITHIN = 0.25  # m that the line may be off the polyline
_KNOTS = (10.0, 5.0, 2.5, 1.25)  # m between knots: the first that is near enough
_SAMPLES = 2.0  # m between places of the polyline that the line is held against, at most
_STEP = 1.25  # m of an integration step, at most; at least two between two knots
_ROUNDS = 12  # of Gauss and Newton's, at most
# m by which a round moves the beginning, and as little of a curvature over the length: the last one
_SETTLED = 1e-3
# by which, times the square of the knots' distance, the curvature's second difference counts as off
_SMOOTH = 0.05
_DIGITS = 8  # of a curvature, 1/m: the last digit of a machine's arithmetic decides nothing


def fitted_line(polyline: FloatArray) -> tuple[tuple[Piece, ...], Pose, float]:
    """The line along a polyline (n, 2): its pieces, where it begins (x, y, heading), and how far
    off it is at most, m.

    Least squares over the curvatures at knots and the pose at the beginning, with as few knots as
    keep it within `WITHIN`; the result may be further off, where the polyline has corners.
    """
    places = _resampled(polyline)
    best: tuple[tuple[Piece, ...], Pose, float] | None = None
    for apart in _KNOTS:
        try:
            found = _fitted(places, apart)
        except np.linalg.LinAlgError:  # it went astray between corners
            continue
        if best is None or found[2] < best[2]:
            best = found
        if best[2] <= WITHIN:
            break
    return best or ((), Pose(0.0, 0.0, 0.0), math.inf)


def onto_the_line(points: FloatArray, begins: Pose) -> FloatArray:
    """Places (n, 2) seen from where a line begins, its beginning at the origin and heading along
    x.
    """
    x, y, heading = begins
    east, north = points[:, 0] - x, points[:, 1] - y
    c, s = np.cos(heading), np.sin(heading)
    return np.column_stack([east * c + north * s, north * c - east * s])


def _resampled(polyline: FloatArray) -> FloatArray:
    """Its vertices, and places between them that are `_SAMPLES` apart at most."""
    found = [polyline[:1]]
    for begin, end in itertools.pairwise(polyline):
        count = max(int(np.ceil(np.hypot(*(end - begin)) / _SAMPLES)), 1)
        found.append(begin + (end - begin) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(found)


class _Grid(NamedTuple):
    """Steps along a line of `length` m, by which curvatures at knots become a line.

    s: (count + 1,), ends of the steps; middle: (count,); step: their length, m.
    knots: s of the knots, (k,). turned: heading at the middles for a curvature of 1 at each knot,
    (count, k). smooth: rows that keep the second difference of the curvatures small, (k - 2, k).
    """

    length: float
    step: float
    s: FloatArray
    middle: FloatArray
    knots: FloatArray
    turned: FloatArray
    smooth: FloatArray


class _Line(NamedTuple):
    """A line on a grid: heading at the middles, what each step goes east and north, x and y."""

    heading: FloatArray
    east: FloatArray
    north: FloatArray
    x: FloatArray
    y: FloatArray

    def at(self, grid: _Grid, s: FloatArray) -> FloatArray:
        """Its places at s, (n, 2)."""
        return np.column_stack([np.interp(s, grid.s, self.x), np.interp(s, grid.s, self.y)])


def _fitted(places: FloatArray, apart: float) -> tuple[tuple[Piece, ...], Pose, float]:
    """The line with knots `apart` m apart, by Gauss and Newton's rounds, and how far off it is."""
    segments = np.diff(places, axis=0).T
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*segments))])
    headings = np.unwrap(np.arctan2(*segments[::-1]))
    grid = _grid(float(s[-1]), apart)
    first, curvature = np.array([*places[0], headings[0]]), _curvatures(grid, s, headings)
    for _ in range(_ROUNDS):
        line = _integrated(grid, first, curvature)
        s, left, off = _feet(grid, line, places, s)
        # it begins beside the first place, not along from it
        aside = np.array([-np.sin(first[2]), np.cos(first[2])])
        rows = np.hstack([left @ aside[:, None], *_derivatives(grid, line, s, left)])
        rows = np.vstack([rows, np.hstack([np.zeros((len(grid.smooth), 2)), grid.smooth])])
        wanted = np.concatenate([np.einsum("ij,ij->i", off, left), -grid.smooth @ curvature])
        triangle = np.asarray(np.linalg.qr(np.column_stack([rows, wanted]), mode="r"))
        change = np.linalg.solve(triangle[:-1, :-1], triangle[:-1, -1])
        first = first + np.array([*(change[0] * aside), change[1]])
        curvature = curvature + change[2:]
        if abs(change[0]) < _SETTLED and np.abs(change[2:]).max() < _SETTLED / grid.length:
            break

    ends = (np.round(curvature, _DIGITS) + 0.0).tolist()
    width = grid.length / (len(ends) - 1)
    pieces = tuple(Piece(width, begin, end) for begin, end in itertools.pairwise(ends))
    begins = Pose(*map(float, first))
    return pieces, begins, _off(pieces, onto_the_line(places, begins), s)


def _grid(length: float, apart: float) -> _Grid:
    """The grid of a line, with knots about `apart` m apart."""
    knots = max(round(length / apart), 1)
    count = knots * max(math.ceil(apart / _STEP), 2)
    step, s = length / count, np.linspace(0.0, length, count + 1)
    middle, at = 0.5 * (s[:-1] + s[1:]), np.linspace(0.0, length, knots + 1)
    each = np.eye(knots + 1)
    hat = np.array([np.interp(middle, at, one) for one in each]).T
    turned = np.concatenate([np.zeros((1, knots + 1)), np.cumsum(hat, axis=0) * step])
    smooth = np.zeros((0, knots + 1))
    if knots > 1:
        smooth = _SMOOTH * apart**2 * np.diff(each, 2, axis=0)
    return _Grid(length, step, s, middle, at, 0.5 * (turned[:-1] + turned[1:]), smooth)


def _curvatures(grid: _Grid, along: FloatArray, headings: FloatArray) -> FloatArray:
    """Curvatures at the knots by the headings of a polyline, whose corners are at `along`."""
    count, middles = len(grid.knots) - 1, 0.5 * (along[:-1] + along[1:])
    before, behind = (
        np.interp(grid.knots + 0.5 * side * grid.length / count, middles, headings)
        for side in (-1, 1)
    )
    return (behind - before) * count / grid.length


def _integrated(grid: _Grid, first: FloatArray, curvature: FloatArray) -> _Line:
    """The line that begins at `first`, (x, y, heading)."""
    heading = first[2] + grid.turned @ curvature
    east, north = np.cos(heading) * grid.step, np.sin(heading) * grid.step
    x = first[0] + np.concatenate([[0.0], np.cumsum(east)])
    return _Line(heading, east, north, x, first[1] + np.concatenate([[0.0], np.cumsum(north)]))


def _feet(
    grid: _Grid, line: _Line, places: FloatArray, s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """s of the feet of places, a step nearer; the line's left there, and how far off it is."""
    toward = np.interp(s, grid.middle, line.heading)
    c, n = np.cos(toward), np.sin(toward)
    off = places - line.at(grid, s)
    s = np.clip(s + off[:, 0] * c + off[:, 1] * n, 0.0, grid.length)
    return s, np.column_stack([-n, c]), places - line.at(grid, s)


def _derivatives(
    grid: _Grid, line: _Line, s: FloatArray, left: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the positions at s, to the left: by the first heading, (n, 1), and by the
    curvatures, (n, k).
    """
    below = np.clip(np.searchsorted(grid.s, s, side="right") - 1, 0, len(grid.middle) - 1)
    share = ((s - grid.s[below]) / grid.step)[:, None]

    def moved(steps: FloatArray) -> FloatArray:
        swept = np.cumsum(steps[:, None] * grid.turned, axis=0)
        sums = np.concatenate([np.zeros((1, len(grid.knots))), swept])
        return np.asarray(sums[below] + share * (sums[below + 1] - sums[below]))

    by_curvature = left[:, :1] * moved(-line.north) + left[:, 1:] * moved(line.east)
    arm = line.at(grid, s) - np.array([line.x[0], line.y[0]])
    return left[:, :1] * -arm[:, 1:] + left[:, 1:] * arm[:, :1], by_curvature


def _off(pieces: tuple[Piece, ...], places: FloatArray, near: FloatArray) -> float:
    """The largest distance of places (n, 2) from a line, m."""
    x, y, heading = map_places(pieces, near, 0.0)
    across = (places[:, 1] - y) * np.cos(heading) - (places[:, 0] - x) * np.sin(heading)
    return float(np.abs(across).max())
