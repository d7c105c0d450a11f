"""The line of a road along a polyline: its curvature is linear from knot to knot."""

from __future__ import annotations

import itertools
import math

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


def _fitted(places: FloatArray, apart: float) -> tuple[tuple[Piece, ...], Pose, float]:
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])
    length = float(along[-1])
    knots = max(round(length / apart), 1)
    count = knots * max(math.ceil(apart / _STEP), 2)
    step, grid = length / count, np.linspace(0.0, length, count + 1)
    middle = 0.5 * (grid[:-1] + grid[1:])
    at = np.linspace(0.0, length, knots + 1)
    # (count, knots + 1)
    hat = np.array([np.interp(middle, at, one) for one in np.eye(knots + 1)]).T
    # of the heading, at the grid
    turned = np.concatenate([np.zeros((1, knots + 1)), np.cumsum(hat, axis=0) * step])
    headings = np.unwrap(np.arctan2(*np.diff(places, axis=0).T[::-1]))
    half = 0.5 * (turned[:-1] + turned[1:])
    first = np.array([*places[0], headings[0]])
    bends = (
        _SMOOTH * apart**2 * np.diff(np.eye(knots + 1), 2, axis=0)
        if knots > 1
        else np.zeros((0, knots + 1))
    )
    sides = [
        np.interp(at + 0.5 * side * length / knots, 0.5 * (along[:-1] + along[1:]), headings)
        for side in (-1, 1)
    ]
    curvature = (sides[1] - sides[0]) * knots / length
    s = along.copy()
    for _ in range(_ROUNDS):
        heading = first[2] + half @ curvature
        c, n = np.cos(heading) * step, np.sin(heading) * step
        x = first[0] + np.concatenate([[0.0], np.cumsum(c)])
        y = first[1] + np.concatenate([[0.0], np.cumsum(n)])
        toward = np.interp(s, middle, heading)
        off = places - np.column_stack([np.interp(s, grid, x), np.interp(s, grid, y)])
        s = np.clip(s + off[:, 0] * np.cos(toward) + off[:, 1] * np.sin(toward), 0.0, length)
        left = np.column_stack([-np.sin(toward), np.cos(toward)])
        off = places - np.column_stack([np.interp(s, grid, x), np.interp(s, grid, y)])
        east = np.concatenate([np.zeros((1, knots + 1)), np.cumsum(-n[:, None] * half, axis=0)])
        north = np.concatenate([np.zeros((1, knots + 1)), np.cumsum(c[:, None] * half, axis=0)])
        below = np.clip(np.searchsorted(grid, s, side="right") - 1, 0, count - 1)
        share = ((s - grid[below]) / step)[:, None]
        by_curvature = left[:, :1] * (east[below] + share * (east[below + 1] - east[below]))
        by_curvature += left[:, 1:] * (north[below] + share * (north[below + 1] - north[below]))
        arm = np.column_stack([np.interp(s, grid, x) - first[0], np.interp(s, grid, y) - first[1]])
        by_heading = left[:, :1] * -arm[:, 1:] + left[:, 1:] * arm[:, :1]
        # it begins beside the first place, not along from it
        aside = np.array([-np.sin(first[2]), np.cos(first[2])])
        rows = np.hstack([left @ aside[:, None], by_heading, by_curvature])
        wanted = np.einsum("ij,ij->i", off, left)
        rows = np.vstack([rows, np.hstack([np.zeros((len(bends), 2)), bends])])
        wanted = np.concatenate([wanted, -bends @ curvature])
        triangle = np.asarray(np.linalg.qr(np.column_stack([rows, wanted]), mode="r"))
        change = np.linalg.solve(triangle[:-1, :-1], triangle[:-1, -1])
        first, curvature = (
            first + np.array([*(change[0] * aside), change[1]]),
            curvature + change[2:],
        )
        if abs(change[0]) < _SETTLED and np.abs(change[2:]).max() < _SETTLED / length:
            break
    curvature = np.round(curvature, _DIGITS) + 0.0
    pieces = tuple(
        Piece(length / knots, begin, end) for begin, end in itertools.pairwise(curvature.tolist())
    )
    begins = Pose(*map(float, first))
    seen = onto_the_line(places, begins)
    return pieces, begins, _off(pieces, seen, s)


def _off(pieces: tuple[Piece, ...], places: FloatArray, near: FloatArray) -> float:
    """The largest distance of places (n, 2) from a line, m."""
    x, y, heading = map_places(pieces, near, 0.0)
    across = (places[:, 1] - y) * np.cos(heading) - (places[:, 0] - x) * np.sin(heading)
    return float(np.abs(across).max())
