"""Lanes that open, end, come in from a ramp or leave as one; roads that cross.

A lane that is not there throughout is the outermost one of its side. It opens and ends over a
taper, along which the road's edge moves in a straight line. Where it is a ramp, a line that must
not be crossed separates it from the adjacent lane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, must_be
from sumo_eval.kernels import kernel
from sumo_eval.scenario.road.reference_line import Piece, curvatures
from sumo_eval.settings import About, Checked, Positive
from sumo_eval.text import capitalised
from sumo_eval.trajectory import FloatArray


@dataclass(frozen=True, slots=True)
class LaneSpan:
    """Part of the road on which the outermost lane of a side exists, by its number (0: the
    right-hand one).

    It has its full width from `begin` to `end`, m along the road; it opens over `opening` m before
    that and narrows over `closing` m behind it.

    parted_until, parted_from: before the one and behind the other it is a ramp.
    """

    lane: int
    begin: float = -math.inf
    end: float = math.inf
    opening: float = 0.0
    closing: float = 0.0
    parted_until: float = -math.inf
    parted_from: float = math.inf

    @property
    def places(self) -> tuple[float, float, float, float]:
        """Positions where it begins to open, is open, begins to narrow and is gone, m."""
        return self.begin - self.opening, self.begin, self.end, self.end + self.closing


@dataclass(frozen=True, slots=True)
class Crossing:
    """A straight road that crosses at a right angle: its middle at x = `at`, `width` m wide,
    `reach` m to both sides of the right lane's centre line. It is straight on the map even where
    this road is curved: x stays the same along it.
    """

    at: float
    width: float = 7.0
    reach: float = 100.0


EVERYWHERE = LaneSpan(-1)


@dataclass(frozen=True, slots=True)
class LaneTable(Checked):
    """A lane that is not there throughout: the outermost one of its side."""

    lane: Annotated[int, About("its number; 0: the right-hand one")]
    begin: Annotated[
        float | None,
        About("from there on it has its full width; default: from the road's start", "m"),
    ] = None
    end: Annotated[
        float | None, About("to there it has its full width; default: to the road's end", "m")
    ] = None
    taper: Annotated[float, Positive, About("length over which it opens and narrows", "m")] = 50.0
    ramp_until: Annotated[
        float | None,
        About(
            "an on-ramp until there: its line must not be crossed; behind it an acceleration lane",
            "m",
        ),
    ] = None
    ramp_from: Annotated[
        float | None,
        About(
            "an exit ramp from there: its line must not be crossed; before it a deceleration lane",
            "m",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class CrossingTable(Checked):
    """A straight road that crosses this one at a right angle, on which others may start."""

    x: Annotated[float, Positive, About("its middle along this road", "m")]
    width: Annotated[float, Positive, About("its width", "m")] = 7.0
    reach: Annotated[
        float, Positive, About("how far it goes to both sides of the right lane's centre line", "m")
    ] = 100.0


def spans_of(
    tables: Sequence[LaneTable], lanes: int, length: float, where: str
) -> tuple[LaneSpan, ...]:
    """The lanes that are not there throughout.

    Raises InputError for what no road can be.
    """
    found: list[LaneSpan] = []
    for table in tables:
        owner = f"lane {table.lane} of the road of {where}"
        if lanes < 2 or table.lane not in (0, lanes - 1):
            outer = (
                f"0 or {lanes - 1}, of a road of at least 2 lanes: lanes keep their distance to "
                "the line, and the "
                "edges of a road whose inner lane runs into another are those of one whose "
                "outermost lane ends"
            )
            raise must_be("`lane`", f"[[road.lane]] of {where}", outer, table.lane)
        if any(other.lane == table.lane for other in found):
            raise InputError(f"[[road.lane]] of {where} must have lane {table.lane} once.")
        if table.begin is None and table.end is None:
            raise InputError(
                f"{capitalised(owner)} must have a `begin` or an `end`, or need no [[road.lane]]."
            )
        begin = -math.inf if table.begin is None else table.begin
        end = math.inf if table.end is None else table.end
        last = length if table.end is None else end + table.taper
        first = 0.0 if table.begin is None else begin - table.taper
        if not (0.0 <= first < last <= length and begin < end):
            raise must_be(
                "`begin`, `end` and `taper`",
                owner,
                f"in order within 0..{length:g} m",
                f"{first:g}..{last:g} m",
            )
        for key, within in (("ramp_until", table.begin is None), ("ramp_from", table.end is None)):
            place = getattr(table, key)
            if place is None:
                continue
            if not within:
                side = "begins with" if key == "ramp_until" else "continues to the end of"
                raise InputError(
                    f"{capitalised(owner)} has a `{key}`, so it must be one that {side} the road."
                )
            if not first < place < min(end, length):
                raise must_be(
                    f"`{key}`",
                    owner,
                    f"within {first:g}..{min(end, length):g} m, where the lane is",
                    place,
                )
        found.append(
            LaneSpan(
                table.lane, begin, end, 0.0 if table.begin is None else table.taper,
                0.0 if table.end is None else table.taper,
                -math.inf if table.ramp_until is None else table.ramp_until,
                math.inf if table.ramp_from is None else table.ramp_from,
            )
        )  # fmt: skip
    if len(found) == lanes:
        raise InputError(f"The road of {where} must have a lane that is there throughout.")
    return tuple(sorted(found, key=lambda span: span.lane))


INNERMOST = 0.9  # of a curve's radius: how far into the curve a road that crosses may go


def crossings_of(
    tables: Sequence[CrossingTable], length: float, line: tuple[Piece, ...], where: str
) -> tuple[Crossing, ...]:
    """The roads that cross.

    Raises InputError for one that is not within the road, or goes beyond a curve's centre.
    """
    for table in tables:
        owner, half = f"[[road.crossing]] of {where}", 0.5 * table.width
        if not half <= table.x <= length - half:
            raise must_be("`x`", owner, f"within the road's {length:g} m", table.x)
        sharpest = float(np.abs(curvatures(line, [table.x - half, table.x, table.x + half])).max())
        if table.reach * sharpest > INNERMOST:
            most = f"at most {INNERMOST / sharpest:.1f} m, {INNERMOST:g} of the radius there"
            raise must_be("`reach`", owner, most, table.reach)
    return tuple(Crossing(table.x, table.width, table.reach) for table in tables)


@kernel
def missing(x: float, opens: float, is_open: float, closes: float, is_gone: float) -> float:
    """The share of a lane's width that is not there at x."""
    if is_open <= x <= closes:
        return 0.0
    if x < is_open:
        return 1.0 if x <= opens else (is_open - x) / (is_open - opens)
    return 1.0 if x >= is_gone else (x - closes) / (is_gone - closes)


@kernel
def right_edge_at(road: Any, x: float) -> float:
    """y of the right road edge at x, m.

    road: a record that holds where the outermost lanes are.
    """
    if road.shaped == 0:
        return float(road.right_edge)
    gone = missing(x, road.right_opens, road.right_is_open, road.right_closes, road.right_is_gone)
    return float(road.right_edge + road.lane_width * gone)


@kernel
def left_edge_at(road: Any, x: float) -> float:
    """y of the left road edge at x, m.

    road: as in `right_edge_at`.
    """
    if road.shaped == 0:
        return float(road.left_edge)
    gone = missing(x, road.left_opens, road.left_is_open, road.left_closes, road.left_is_gone)
    return float(road.left_edge - road.lane_width * gone)


def missing_at(span: LaneSpan, x: ArrayLike) -> FloatArray:
    """The share of the width of a lane that is not there at x (any shape)."""
    if span is EVERYWHERE:
        return np.zeros(np.shape(x))
    places = np.asarray(x, dtype=np.float64)
    return np.asarray(np.vectorize(missing, otypes=[float])(places, *span.places))
