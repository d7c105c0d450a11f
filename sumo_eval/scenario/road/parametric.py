"""A parametric cubic of OpenDRIVE, `paramPoly3`, as pieces whose curvature is linear in their
length.

Users: `scenario/road/opendrive.py`.
"""

import itertools
import math

import numpy as np

from sumo_eval.errors import InputError, must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario.road.reference_line import Piece, map_places
from sumo_eval.trajectory import FloatArray

NEAR = 1e-4  # m that the pieces may lie beside the cubic
_FIRST = 10.0  # m: longest piece of the first try, which is then halved
_MOST = 12  # times that they are halved
# m that the cubic's length may differ from the file's; the pieces get the file's
_BESIDE = 0.01
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@frozen
class Cubic:
    """u = aU + bU p + cU p2 + dU p3 along, v likewise to the left, m, where p goes from 0 to
    `last`.
    """

    along: tuple[float, ...]
    left: tuple[float, ...]
    last: float

    def at(self, p: FloatArray, order: int = 0) -> tuple[FloatArray, FloatArray]:
        """u and v, or their derivatives of that order by p."""
        u, v = (np.polynomial.Polynomial(it).deriv(order) for it in (self.along, self.left))
        return u(p), v(p)

    def heading(self, p: FloatArray) -> FloatArray:
        """Direction of the curve, rad, without jumps."""
        u, v = self.at(p, 1)
        return np.unwrap(np.arctan2(v, u))

    def curvature(self, p: FloatArray) -> FloatArray:
        """(u' v'' - v' u'') / (u'2 + v'2)^1.5, 1/m."""
        (u1, v1), (u2, v2) = self.at(p, 1), self.at(p, 2)
        return (u1 * v2 - v1 * u2) / np.power(u1 * u1 + v1 * v1, 1.5)

    def lengths(self, ends: FloatArray) -> FloatArray:
        """Length of the curve between neighbouring p, m: quadrature of |(u', v')|."""
        half = 0.5 * np.diff(ends)
        middle = 0.5 * (ends[:-1] + ends[1:])
        u, v = self.at(middle[:, None] + half[:, None] * _NODES, 1)
        return np.hypot(u, v) @ _WEIGHTS * half


def pieces_along(cubic: Cubic, length: float, owner: str) -> list[Piece]:
    """Pieces that lie within 0.1 mm of a cubic, each turning exactly as far as the part of it that
    it stands for.

    length: what the file says, m: within 1 cm the cubic's own, to which the pieces are stretched,
        so that places along the road keep their s.
    Raises InputError where the cubic stands still, or is of another length.
    """
    u, v = cubic.at(np.linspace(0.0, cubic.last, 200), 1)
    if not np.hypot(u, v).min() > 0.0:
        raise InputError(
            f"A <paramPoly3> of {owner} stands still: its derivative is 0 where it should continue."
        )
    count = max(math.ceil(length / _FIRST), 1)
    for _ in range(_MOST):
        ends = np.linspace(0.0, cubic.last, count + 1)
        lengths = cubic.lengths(ends)
        own = float(lengths.sum())
        if not abs(own - length) <= _BESIDE:
            what = "The length of a <paramPoly3>"
            raise must_be(what, owner, f"its curve's, {own:.3f} m", f"{length:g} m")
        heading = cubic.heading(ends)
        curvature = cubic.curvature(ends)
        # curvature to add to a piece, so that it turns as far as its part of the cubic
        missing = np.diff(heading) / lengths - 0.5 * (curvature[:-1] + curvature[1:])
        stretch = length / own
        begins, behind = curvature[:-1] + missing, curvature[1:] + missing
        pieces = np.array([lengths * stretch, begins / stretch, behind / stretch])
        drawn = list(itertools.starmap(Piece, pieces.T.tolist()))
        # how far the pieces are off the cubic, at their ends and between them
        looks = np.linspace(0.0, cubic.last, 4 * count + 1)
        s = np.append(0.0, np.cumsum(cubic.lengths(looks))) * stretch
        x, y, _ = map_places(tuple(drawn), s, 0.0)
        u, v = (along - along[0] for along in cubic.at(looks))
        cos = math.cos(heading[0])
        sin = math.sin(heading[0])
        off = np.hypot(x - (u * cos + v * sin), y - (v * cos - u * sin)).max()
        if off <= NEAR + abs(own - length):
            return drawn
        count *= 2
    raise InputError(
        f"A <paramPoly3> of {owner} curves too sharply for pieces of {length / count:.3f} m."
    )
