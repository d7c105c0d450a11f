"""A parametric cubic of OpenDRIVE, `paramPoly3`, as pieces whose curvature is linear in their
length.

Users: `scenario/road/opendrive.py`.
"""

import itertools
import math

import numpy as np

from sumo_eval.errors import InputError, must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario.road.pose import Pose, onto_the_line
from sumo_eval.scenario.road.reference_line import Piece, map_places
from sumo_eval.trajectory import FloatArray

NEAR = 1e-4  # m: largest distance of the pieces from the cubic
_FIRST = 10.0  # m: longest piece of the first try; every further try halves the pieces
_MOST = 12  # tries
_DIFFERENCE = 0.01  # m by which the cubic's own length may differ from the length in the file
_ZEROS = 200  # places at which the derivative is looked at for 0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)  # of Gauss-Legendre quadrature on -1..1


@frozen
class Cubic:
    """A curve (u, v), m, over a parameter p from 0 to `last`: u = aU + bU p + cU p^2 + dU p^3 in
    the direction of its geometry, v to the left of that likewise.

    along, left: (aU, bU, cU, dU) and (aV, bV, cV, dV).
    """

    along: tuple[float, ...]
    left: tuple[float, ...]
    last: float

    def at(self, p: FloatArray, order: int = 0) -> tuple[FloatArray, FloatArray]:
        """u and v at p (any shape); of an order above 0: their derivatives by p."""
        u, v = (np.polynomial.Polynomial(it).deriv(order) for it in (self.along, self.left))
        return u(p), v(p)

    def heading(self, p: FloatArray) -> FloatArray:
        """Direction of the curve at rising p, rad, without jumps by 2 pi."""
        u, v = self.at(p, 1)
        return np.unwrap(np.arctan2(v, u))

    def curvature(self, p: FloatArray) -> FloatArray:
        """(u' v'' - v' u'') / (u'2 + v'2)^1.5, 1/m."""
        (u1, v1), (u2, v2) = self.at(p, 1), self.at(p, 2)
        return (u1 * v2 - v1 * u2) / np.power(u1 * u1 + v1 * v1, 1.5)

    def lengths(self, ends: FloatArray) -> FloatArray:
        """Lengths of the curve between neighbouring p, m: quadrature of |(u', v')|.

        ends: p, (n + 1,), rising; the result is (n,).
        """
        half = 0.5 * np.diff(ends)
        middle = 0.5 * (ends[:-1] + ends[1:])
        u, v = self.at(middle[:, None] + half[:, None] * _NODES, 1)  # (n, nodes)
        return np.hypot(u, v) @ _WEIGHTS * half


def pieces_along(cubic: Cubic, length: float, owner: str) -> list[Piece]:
    """Pieces along a cubic, within `NEAR` of it, apart from the stretch. Each turns exactly as far
    as its part of the cubic.

    length: in the file, m. The pieces are stretched to it from the cubic's own length, so that
        places along the road keep their s.
    Raises InputError where the cubic stands still, or has another length.
    """
    u, v = cubic.at(np.linspace(0.0, cubic.last, _ZEROS), 1)
    if not np.hypot(u, v).min() > 0.0:
        raise InputError(
            f"A <paramPoly3> of {owner} stands still: its derivative is 0 where it should continue."
        )
    count = max(math.ceil(length / _FIRST), 1)
    for _ in range(_MOST):
        ends = np.linspace(0.0, cubic.last, count + 1)
        lengths = cubic.lengths(ends)
        own = float(lengths.sum())
        if not abs(own - length) <= _DIFFERENCE:
            what = "The length of a <paramPoly3>"
            raise must_be(what, owner, f"its curve's, {own:.3f} m", f"{length:g} m")
        curvature = cubic.curvature(ends)
        # curvature to add to a piece, so that it turns as far as its part of the cubic
        missing = np.diff(cubic.heading(ends)) / lengths - 0.5 * (curvature[:-1] + curvature[1:])
        stretch = length / own
        begins, behind = curvature[:-1] + missing, curvature[1:] + missing
        columns = np.array([lengths * stretch, begins / stretch, behind / stretch])
        pieces = list(itertools.starmap(Piece, columns.T.tolist()))
        if _distance(cubic, pieces, stretch) <= NEAR + abs(own - length):
            return pieces
        count *= 2
    raise InputError(
        f"A <paramPoly3> of {owner} curves too sharply for pieces of {length / count:.3f} m."
    )


def _distance(cubic: Cubic, pieces: list[Piece], stretch: float) -> float:
    """Largest distance of a cubic from pieces along it, m, at five places of each piece.

    stretch: length of the pieces over that of the cubic.
    """
    places = np.linspace(0.0, cubic.last, 4 * len(pieces) + 1)
    s = np.append(0.0, np.cumsum(cubic.lengths(places))) * stretch
    x, y, _ = map_places(tuple(pieces), s, 0.0)
    # the pieces begin at the origin along x: move and turn the cubic to that
    points = np.column_stack(cubic.at(places))
    first_x, first_y = points[0]
    axes = Pose(first_x, first_y, cubic.heading(places)[0])
    return float(np.hypot(*(onto_the_line(points, axes).T - (x, y))).max())
