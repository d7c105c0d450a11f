"""The reference line of a road: pieces along which curvature changes linearly, and their frame.

The line is the centre line of the right-hand lane. A place in its frame is (s, d): s m along the
line, d m to the left of it. A heading in the frame is the heading on the map minus the line's. On
the map the line begins at the origin and heads along x. Before its beginning and behind its end it
is straight.

A line without pieces is straight: frame and map are the same numbers.

The order of operations decides the last bit of recorded positions, which tests compare.

Users: `ads/`, `cosim/`, `drivers/`, `method/`, `record/`, `report/`, `scenario/`, `extras/`.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, must_be
from sumo_eval.frozen import frozen
from sumo_eval.kernels import Records, fields, kernel, rows
from sumo_eval.scenario.touch import within_a_turn
from sumo_eval.trajectory import FloatArray

# A spiral is cut into stretches from knot to knot, each with at most this turn and this length.
_STRETCH_TURN = 0.2  # rad
_STRETCH_LENGTH = 200.0  # m
_STRAIGHT_BEFORE = 1e9  # m: length of the straight before the line, as a stretch of its own
# Limits of a piece: beyond them a line would take minutes and all memory.
_PIECE_LENGTH = 1e5  # m
_PIECE_TURN = 2000.0 * math.pi  # rad, 1000 times round

# Newton's method for the foot of a perpendicular
_LAST_STEP = 1e-7  # m: it ends with a step shorter than this, with an error of about its square
_MOST_STEPS = 20
# least value of 1 - curvature d, by which a step is divided: at a curve's centre it would be 0
_LEAST_DIVISOR = 0.05

_NODES = (-0.906179845938664, -0.5384693101056831, 0.0, 0.5384693101056831, 0.906179845938664)
_WEIGHTS = (
    0.23692688505618908,
    0.47862867049936647,
    0.5688888888888889,
    0.47862867049936647,
    0.23692688505618908,
)
"""Gauss-Legendre quadrature of five points on -1..1: on a stretch that turns 0.2 rad its error is
below 1e-15."""


class _Knot(NamedTuple):
    """Beginning of a stretch, a part of the line along which the curvature has one rate.

    s: along the line, m. x, y, heading: on the map, m and rad.
    curvature: at the knot, 1/m. rate: of the curvature along the stretch, 1/m2.
    """

    s: float
    x: float
    y: float
    heading: float
    curvature: float
    rate: float


KNOT = np.dtype(fields(*_Knot._fields))
"""A `_Knot` as a record, for kernels."""


@frozen
class Piece:
    """A piece of a reference line, `length` m long. Its curvature, 1/m, positive to the left, goes
    linearly from `begin` to `end`.

    Both are 0 for a straight line, 1/radius for an arc, and different for a spiral (clothoid).
    """

    length: float
    begin: float = 0.0
    end: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.length <= _PIECE_LENGTH:
            must = f"greater than 0 m and at most {_PIECE_LENGTH:g} m"
            raise must_be("`length`", "a piece of a road", must, self.length)
        for name in ("begin", "end"):
            curvature = getattr(self, name)
            if not abs(curvature) * self.length <= _PIECE_TURN:
                must = "a finite curvature, 1/m, that turns the piece at most 1000 times"
                raise must_be(f"`{name}`", "a piece of a road", must, curvature)


def piece_of_file(owner: str, length: float, *ends: float) -> Piece:
    """A piece that a file describes; `ends` are `begin` and `end`, default 0.

    owner: the place in the file, with which an error begins.
    """
    try:
        return Piece(length, *ends)
    except InputError as error:
        raise InputError(f"{owner}: {error}") from None


Line = tuple[Piece, ...]
"""The line that a road follows; empty: a straight one."""


def arc(length: float, radius: float) -> Piece:
    """A piece of constant radius, m; positive: to the left."""
    if not (math.isfinite(radius) and radius != 0.0):
        raise must_be("`radius`", "an arc", "finite and not 0 m", radius)
    return Piece(length, 1.0 / radius, 1.0 / radius)


def end_curvatures(pieces: Sequence[Piece]) -> list[float]:
    """Curvature at both ends of every piece, 1/m: a piece is curved most at one of its ends."""
    return [end for piece in pieces for end in (piece.begin, piece.end)]


def tightest(pieces: Sequence[Piece]) -> float:
    """The smallest radius on a line, m, inf on a straight one."""
    most = max(map(abs, end_curvatures(pieces)), default=0.0)
    return 1.0 / most if most > 0.0 else math.inf


def length_of(pieces: Sequence[Piece]) -> float:
    """The length of a line, m."""
    return sum(piece.length for piece in pieces)


def bends(pieces: Sequence[Piece]) -> bool:
    """Whether a line has a curve."""
    return any(end_curvatures(pieces))


@functools.lru_cache(maxsize=256)
def knots_of(pieces: Line) -> Records:
    """The line as `KNOT` records: the straight before it, its stretches, the straight behind it.

    A line without pieces has no knots.
    """
    knots = [_Knot(-_STRAIGHT_BEFORE, -_STRAIGHT_BEFORE, 0.0, 0.0, 0.0, 0.0)]
    s = x = y = heading = 0.0
    for piece in pieces:
        rate = (piece.end - piece.begin) / piece.length
        count = 1  # of stretches; an arc or a straight line needs one
        if rate != 0.0:
            most_turn = max(abs(piece.begin), abs(piece.end)) * piece.length
            count = math.ceil(max(most_turn / _STRETCH_TURN, piece.length / _STRETCH_LENGTH))
        for part in range(count):
            curvature = piece.begin + rate * (piece.length * part / count)
            knots.append(_Knot(s, x, y, heading, curvature, rate))
            s += piece.length / count
            x, y, heading = stretch_at(knots[-1], piece.length / count)[:3]
    knots.append(_Knot(s, x, y, heading, 0.0, 0.0))
    return np.array(knots if pieces else [], KNOT)


class Position(NamedTuple):
    """A place on the map or in the frame of a line.

    x, y: m; in the frame s and d. heading: rad. curvature: of the line there, 1/m.
    """

    x: float
    y: float
    heading: float
    curvature: float


# -- rules, for one place --------------------------------------------------------------------------


@kernel
def stretch_at(knot: Any, u: float) -> Position:
    """The line on the map, u m after a knot, on the stretch that begins there."""
    if knot.rate != 0.0:
        return _spiral_at(knot, u)
    # an arc: its chord has the heading of the arc's middle, half the arc's turn from its beginning
    half_turn = 0.5 * knot.curvature * u
    chord = u if abs(half_turn) < 1e-9 else u * math.sin(half_turn) / half_turn  # not 0 / 0
    x = knot.x + chord * math.cos(knot.heading + half_turn)
    y = knot.y + chord * math.sin(knot.heading + half_turn)
    return Position(x, y, knot.heading + 2.0 * half_turn, knot.curvature)


@kernel
def _spiral_at(knot: Any, u: float) -> Position:
    """`stretch_at` of a spiral: quadrature of the direction over 0..u."""
    half = 0.5 * u
    east = north = 0.0
    for k in range(len(_NODES)):
        v = half + half * _NODES[k]
        turned = knot.heading + v * (knot.curvature + 0.5 * knot.rate * v)
        east += _WEIGHTS[k] * math.cos(turned)
        north += _WEIGHTS[k] * math.sin(turned)
    heading = knot.heading + u * (knot.curvature + 0.5 * knot.rate * u)
    curvature = knot.curvature + knot.rate * u
    return Position(knot.x + half * east, knot.y + half * north, heading, curvature)


@kernel
def line_at(line: Any, s: float) -> Position:
    """A line (knots) on the map at s, m."""
    low = 0  # the knot at or before s is searched between these two, by halving
    high = len(line)
    while high - low > 1:
        middle = (low + high) // 2
        if line[middle].s <= s:
            low = middle
        else:
            high = middle
    if low == 0:  # on the straight before the line, where s is x
        return Position(s, 0.0, 0.0, 0.0)
    return stretch_at(line[low], s - line[low].s)


@kernel
def to_map(line: Any, s: float, d: float, heading: float) -> Position:
    """The position on the map of a place in the frame of a line (knots)."""
    if not len(line):
        return Position(s, d, heading, 0.0)
    at = line_at(line, s)
    x, y = at.x - d * math.sin(at.heading), at.y + d * math.cos(at.heading)
    return Position(x, y, at.heading + heading, at.curvature)


@kernel
def to_frame(line: Any, x: float, y: float, heading: float, near: float) -> Position:
    """The position in the frame of a line (knots), s, d and heading, of a place on the map.

    near: an s, m, from which Newton's method begins to look for the foot of the perpendicular from
        the place to the line.

    Seen from the line's point at s, the place is `ahead` m along the line and d m to the left. At
    the foot `ahead` is 0. The derivative of `ahead` by s is -(1 - curvature d).
    """
    if not len(line):
        return Position(x, y, heading, 0.0)
    s = near
    d = course = curvature = 0.0
    for _ in range(_MOST_STEPS):
        at = line_at(line, s)
        course, curvature = at.heading, at.curvature  # of the line
        cos, sin = math.cos(course), math.sin(course)
        dx, dy = x - at.x, y - at.y
        ahead, d = dx * cos + dy * sin, dy * cos - dx * sin
        step = ahead / max(1.0 - curvature * d, _LEAST_DIVISOR)
        s += step
        course += step * curvature  # at the new s, to first order
        if abs(step) < _LAST_STEP:
            break
    return Position(s, d, within_a_turn(heading - course), curvature)


# -- many places at once ---------------------------------------------------------------------------


@rows
def _convert_rows(line: Records, places: FloatArray, positions: FloatArray) -> None:
    """`to_map` of places (n, 3), columns s, d, heading, or `to_frame` of places (n, 4), columns x,
    y, heading, near; to `positions`, (n, 4).
    """
    from_map = places.shape[1] == 4
    for i in range(len(places)):
        place = places[i]
        if from_map:
            positions[i] = to_frame(line, place[0], place[1], place[2], place[3])
        else:
            positions[i] = to_map(line, place[0], place[1], place[2])


def map_places(
    pieces: Line, s: ArrayLike, d: ArrayLike, heading: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(x, y, heading) on the map of places in the frame of a line, m and rad.

    s, d, heading: m, m and rad, arrays that broadcast to one shape.
    """
    x, y, mapped_heading = _columns(pieces, s, d, heading)[:3]
    return x, y, mapped_heading


def frame_places(
    pieces: Line,
    x: ArrayLike,
    y: ArrayLike,
    heading: ArrayLike = 0.0,
    near: ArrayLike | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(s, d, heading) in the frame of a line of places on the map, m and rad.

    x, y, heading: m, m and rad, arrays that broadcast to one shape.
    near: s, m, near which the foot of the perpendicular is searched, as a place may have several;
        it broadcasts with x. None: near the nearest of points of the line every 5 m.
    """
    if near is None:
        grid = np.arange(0.0, length_of(pieces) + 5.0, 5.0)
        grid_x, grid_y, _ = map_places(pieces, grid, 0.0)
        # squared distance of every place from every point, (..., points)
        squares = np.subtract.outer(x, grid_x) ** 2 + np.subtract.outer(y, grid_y) ** 2
        near = grid[np.argmin(squares, axis=-1)]
    s, d, framed_heading = _columns(pieces, x, y, heading, near)[:3]
    return s, d, framed_heading


def curvatures(pieces: Line, s: ArrayLike) -> FloatArray:
    """Curvature of a line at s (any shape), 1/m, left positive."""
    return _columns(pieces, s, 0.0, 0.0)[3]  # after x, y, heading


def _columns(pieces: Line, *places: ArrayLike) -> list[FloatArray]:
    """The four fields of each place's `Position`, arrays of the places' common shape.

    places: columns as of `_convert_rows`, arrays that broadcast. On a straight line the first three
        are the result, with curvature 0.
    """
    arrays = np.broadcast_arrays(*(np.asarray(it, float) for it in places))
    rows_of_places = np.stack([it.ravel() for it in arrays], axis=1)
    positions = np.zeros((len(rows_of_places), 4))
    if pieces:
        _convert_rows(knots_of(pieces), rows_of_places, positions)
    else:
        positions[:, :3] = rows_of_places[:, :3]
    return [column.reshape(arrays[0].shape) for column in positions.T]


def drawn_points(pieces: Line, begin: float, end: float, longest: float = 1.0) -> FloatArray:
    """s of the corners of a polyline along a line, m, in order.

    begin, end: s of the polyline's ends, m.
    longest: m between two corners, at most, where the line is curved. Corners also lie where two
        pieces meet.
    """
    corners = [begin, end]
    s = 0.0  # where the next piece begins
    for piece in pieces:
        low, high = max(s, begin), min(s + piece.length, end)
        s += piece.length
        if high <= low:
            continue
        # - 1e-9: rounding must not add a corner
        count = max(math.ceil((high - low) / longest - 1e-9), 1) if bends([piece]) else 1
        corners += [*(low + (high - low) * k / count for k in range(count)), high]
    return np.unique(corners)


@functools.lru_cache(maxsize=64)
def crosses_itself(pieces: Line, length: float, width: float) -> bool:
    """Whether two parts of a road along a line cross, or are about as near as its width.

    length, width: of the road, m.
    """
    # points every 10 m: where two parts of the road touch, a point of each is within `near`
    near = width + 10.0
    s = np.arange(0.0, length, 10.0)
    x, y, _ = map_places(pieces, s, 0.0)
    points = x + 1j * y  # the absolute value of a difference is a distance
    apart = np.abs(np.subtract.outer(points, points))
    # points that are near along the road are near on any curve, and do not count
    are_parts = np.subtract.outer(s, s) > 4.0 * near
    return bool((apart < near)[are_parts].any())
