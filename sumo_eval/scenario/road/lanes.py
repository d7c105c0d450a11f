"""Lanes that open, end, come in from a ramp or leave as one; roads that cross.

The tables of scenario files and the readers of OpenDRIVE and SUMO networks make the spans and
crossings of a `Road` of these; the kernels here compute the road's edges from them.

A lane that does not exist throughout is the outermost one of its side. It opens and ends over a
taper, along which the road's edge moves in a straight line. Where the lane is a ramp, a line that
must not be crossed separates it from the adjacent lane.

Users: `cosim/openscenario.py`, `cosim/step_rules.py`, `scenario/concrete.py`,
`scenario/file_tables.py`, `scenario/road/opendrive.py`, `scenario/sumo_network.py`.
"""

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import InputError, must_be
from sumo_eval.frozen import frozen, required
from sumo_eval.kernels import kernel
from sumo_eval.scenario.road.reference_line import Line, curvatures
from sumo_eval.settings.checked import Checked, PositiveFloat, optional, setting
from sumo_eval.text import capitalised
from sumo_eval.trajectory import FloatArray


@frozen
class LaneSpan:
    """Part of the road on which the outermost lane of a side exists.

    lane: its number, 0 for the right-hand one.
    begin, end: x between which it has its full width, m.
    opening, closing: lengths over which it opens before `begin` and narrows behind `end`, m.
    parted_until: x up to which it is an on-ramp, m; -inf: it is none.
    parted_from: x from which on it is an exit ramp, m; inf: it is none.
    """

    lane: int
    begin: float = -inf
    end: float = inf
    opening: float = 0.0
    closing: float = 0.0
    parted_until: float = -inf
    parted_from: float = inf

    @property
    def places(self) -> tuple[float, float, float, float]:
        """Positions where it begins to open, is open, begins to narrow and is gone, m."""
        return self.begin - self.opening, self.begin, self.end, self.end + self.closing


@frozen
class Crossing:
    """A straight road that crosses at a right angle.

    at: x of its middle, m; the same everywhere along it, as it is straight on the map even where
        this road is curved.
    width: m.
    reach: its length to each side of the right lane's centre line, m.
    """

    at: float
    width: float = 7.0
    reach: float = 100.0


EVERYWHERE = LaneSpan(-1)
"""The span of any lane that exists throughout; `missing_at` knows it by identity."""
_INNERMOST = 0.9  # share of a curve's radius that a crossing road may reach, at most


@frozen
class LaneTable(Checked):
    """A lane that is not there throughout: the outermost one of its side."""

    lane: int = required("its number; 0: the right-hand one")
    begin: float | None = optional(
        "from there on it has its full width; default: from the road's start", "m"
    )
    end: float | None = optional("to there it has its full width; default: to the road's end", "m")
    taper: PositiveFloat = setting(50.0, "length over which it opens and narrows", "m")
    ramp_until: float | None = optional(
        "an on-ramp until there: its line must not be crossed; behind it an acceleration lane",
        "m",
    )
    ramp_from: float | None = optional(
        "an exit ramp from there: its line must not be crossed; before it a deceleration lane",
        "m",
    )


@frozen
class CrossingTable(Checked):
    """A straight road that crosses this one at a right angle, on which actors may start."""

    x: PositiveFloat = required("its middle along this road", "m")
    width: PositiveFloat = setting(7.0, "its width", "m")
    reach: PositiveFloat = setting(
        100.0, "how far it goes to both sides of the right lane's centre line", "m"
    )


def spans_of(
    tables: Sequence[LaneTable], lanes: int, length: float, where: str
) -> tuple[LaneSpan, ...]:
    """The lanes of a road that do not exist throughout, from the right.

    lanes: number of lanes of the road. length: of the road, m.
    where: the scenario, for messages.

    Raises InputError for an impossible road.
    """
    spans: list[LaneSpan] = []
    for table in tables:
        owner = f"lane {table.lane} of the road of {where}"
        if lanes < 2 or table.lane not in (0, lanes - 1):
            outer = (
                f"0 or {lanes - 1}, of a road of at least 2 lanes: where an inner lane runs into "
                "another, let the outermost lane end, as the edges of the road are the same"
            )
            raise must_be("`lane`", f"[[road.lane]] of {where}", outer, table.lane)
        if any(other.lane == table.lane for other in spans):
            raise InputError(f"[[road.lane]] of {where} must have lane {table.lane} once.")
        if table.begin is None and table.end is None:
            raise InputError(
                f"{capitalised(owner)} must have a `begin` or an `end`, or need no [[road.lane]]."
            )

        spans.append(_span(table, length, owner))
    if len(spans) == lanes:
        raise InputError(f"The road of {where} must have a lane that is there throughout.")
    return tuple(sorted(spans, key=lambda span: span.lane))


def _span(table: LaneTable, length: float, owner: str) -> LaneSpan:
    """The span of a lane that has a `begin` or an `end`.

    length: of the road, m.
    """
    # without `begin` it exists from the road's start, without `end` to the road's end: no taper
    begin = -inf if table.begin is None else table.begin
    end = inf if table.end is None else table.end
    opening = 0.0 if table.begin is None else table.taper
    closing = 0.0 if table.end is None else table.taper
    first = 0.0 if table.begin is None else begin - opening
    last = length if table.end is None else end + closing
    if not (0.0 <= first < last <= length and begin < end):
        # where it begins to open, is open, begins to narrow and is gone
        places = f"{first:g}, {max(begin, first):g}, {min(end, last):g}, {last:g} m"
        must = f"in order within 0..{length:g} m"
        raise must_be("`begin`, `end` and `taper`", owner, must, places)
    # an on-ramp must begin with the road, an exit ramp must continue to its end
    for key, possible, side in (
        ("ramp_until", table.begin is None, "begins with"),
        ("ramp_from", table.end is None, "continues to the end of"),
    ):
        x = getattr(table, key)
        if x is None:
            continue
        if not possible:
            raise InputError(
                f"{capitalised(owner)} has a `{key}`, so it must be one that {side} the road."
            )
        if not first < x < min(end, length):
            must = f"within {first:g}..{min(end, length):g} m, where the lane is"
            raise must_be(f"`{key}`", owner, must, x)
    until = -inf if table.ramp_until is None else table.ramp_until
    onwards = inf if table.ramp_from is None else table.ramp_from
    return LaneSpan(table.lane, begin, end, opening, closing, until, onwards)


def crossings_of(
    tables: Sequence[CrossingTable], length: float, line: Line, where: str
) -> tuple[Crossing, ...]:
    """The roads that cross.

    length: of this road, m. line: that it follows.
    where: the scenario, for messages.
    Raises InputError for one that is not within the road, or goes beyond a curve's centre.
    """
    for table in tables:
        owner = f"[[road.crossing]] of {where}"
        half = 0.5 * table.width
        if not half <= table.x <= length - half:
            within = f"{half:g} to {length - half:g} m with its width"
            raise must_be("`x`", owner, f"within the road's {length:g} m, {within}", table.x)
        # 1/m, at both edges and in the middle of the crossing road
        sharpest = float(np.abs(curvatures(line, [table.x - half, table.x, table.x + half])).max())
        if table.reach * sharpest > _INNERMOST:
            most = f"at most {_INNERMOST / sharpest:.1f} m, {_INNERMOST:g} of the radius there"
            raise must_be("`reach`", owner, most, table.reach)
    return tuple(Crossing(table.x, table.width, table.reach) for table in tables)


@kernel
def missing(x: float, opens: float, is_open: float, closes: float, is_gone: float) -> float:
    """The share of a lane's width that is not there at x, m.

    opens, is_open, closes, is_gone: as `LaneSpan.places`.
    """
    if is_open <= x <= closes:
        return 0.0
    if x < is_open:
        return 1.0 if x <= opens else (is_open - x) / (is_open - opens)
    return 1.0 if x >= is_gone else (x - closes) / (is_gone - closes)


@kernel
def right_edge_at(road: Any, x: float) -> float:
    """y of the right road edge at x, m.

    road: `road` of `cosim.records.SCENARIO`, with `places` of both outermost lanes.
    """
    if road.shaped == 0:
        return float(road.right_edge)
    share = missing(x, road.right_opens, road.right_is_open, road.right_closes, road.right_is_gone)
    return float(road.right_edge + road.lane_width * share)


@kernel
def left_edge_at(road: Any, x: float) -> float:
    """y of the left road edge at x, m.

    road: as in `right_edge_at`.
    """
    if road.shaped == 0:
        return float(road.left_edge)
    share = missing(x, road.left_opens, road.left_is_open, road.left_closes, road.left_is_gone)
    return float(road.left_edge - road.lane_width * share)


def missing_at(span: LaneSpan, x: ArrayLike) -> FloatArray:
    """`missing` of a span at x (any shape), m."""
    if span is EVERYWHERE:
        return np.zeros(np.shape(x))
    places = np.asarray(x, float)
    return np.asarray(np.vectorize(missing, otypes=[float])(places, *span.places))
