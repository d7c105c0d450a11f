"""A road's line as it stands in a scenario file, `[[road.line]]`, one table a piece; and the check
that the ego can drive a line.

Users: `extras/openscenario/logical.py`, `extras/openscenario/written.py`, `record/facts.py`,
`scenario/file_tables.py`, `scenario/sumo_network.py`.
"""

import math
from collections.abc import Mapping, Sequence

from sumo_eval.errors import InputError, must_be
from sumo_eval.frozen import frozen, required
from sumo_eval.input_file import sha256
from sumo_eval.scenario.expression import checked_names, number
from sumo_eval.scenario.road.reference_line import (
    Line,
    Piece,
    bends,
    end_curvatures,
    length_of,
    piece_of_file,
    tightest,
)
from sumo_eval.settings import VehicleSettings
from sumo_eval.settings.checked import Checked, PositiveFloat, optional
from sumo_eval.text import capitalised

_LEAST_EDGE = 1.0  # m from the centre of a curve to the road's inner edge, at least


@frozen
class PieceTable(Checked):
    """A piece of the right lane's centre line: straight, an arc with `radius`, or a spiral between
    two radii.
    """

    length: PositiveFloat = required("length of the piece", "m")
    radius: str | float | None = optional(
        "of an arc, positive to the left; a number or an expression of the options", "m"
    )
    begin_radius: str | float | None = optional(
        "of a spiral, at its beginning; default: straight there", "m"
    )
    end_radius: str | float | None = optional(
        "of a spiral, at its end; default: straight there", "m"
    )


def line_of(
    tables: Sequence[PieceTable],
    options: Mapping[str, float],
    lanes: int,
    lane_width: float,
    length: float,
    where: str,
) -> Line:
    """The line of a road; () where all of it is straight.

    options: the value of every option. lanes: number of lanes. lane_width, length: m.
    where: how errors call the file.
    Raises InputError for a line that cannot be driven.
    """
    pieces = []
    for index, table in enumerate(tables, 1):
        owner = f"piece {index} of the road of {where}"
        ends = table.begin_radius, table.end_radius
        if table.radius is not None:
            if ends != (None, None):
                raise InputError(
                    f"{capitalised(owner)} must have either `radius` or `begin_radius` and "
                    "`end_radius`."
                )
            ends = table.radius, table.radius
        curvatures = (_curvature(radius, options, owner) for radius in ends)
        pieces.append(piece_of_file(capitalised(owner), table.length, *curvatures))
        check_line(pieces[-1:], lanes, lane_width, owner)
    total = length_of(pieces)
    if total > length + 1e-9:  # m: rounding of the sum is no fault
        must = f"at most as long as the road ({length:g} m)"
        raise must_be("The pieces", f"the road of {where}", must, total)
    return tuple(pieces) if bends(pieces) else ()


def _curvature(radius: str | float | None, options: Mapping[str, float], owner: str) -> float:
    """Curvature of a radius as in the file, 1/m; None: straight."""
    if radius is None:
        return 0.0
    formula = checked_names(number(radius, f"the radius of {owner}"), options, owner)
    metres = float(formula.at(options))
    if math.isnan(metres) or metres == 0.0:
        raise must_be("The radius", owner, "a number other than 0 m", metres)
    return 1.0 / metres  # 0 if it is infinite, as an option without a default is


def check_line(
    pieces: Sequence[Piece],
    lanes: int,
    lane_width: float,
    owner: str,
    vehicle: VehicleSettings | None = None,
) -> None:
    """Raise InputError unless the ego can turn as tightly as every lane does.

    lanes: number of lanes, to the left of the line's lane, which is one of them.
    vehicle: settings of the ego; None (outside an evaluation): the defaults.
    """
    vehicle = vehicle or VehicleSettings()
    # largest angle of the front wheels, rad, and the ego's smallest radius, m
    wheel = math.radians(vehicle.max_steering_wheel_angle_deg) / vehicle.steering_ratio
    smallest = vehicle.wheelbase / math.tan(wheel)
    for curvature in filter(None, end_curvatures(pieces)):
        radius = abs(1.0 / curvature)
        # lanes lie left of the line, so in a left curve the leftmost is the innermost
        inner = radius - lane_width * (lanes - 1) if curvature > 0.0 else radius
        for needed, why in (
            (smallest, "so that the ego can drive its innermost lane"),
            (0.5 * lane_width + _LEAST_EDGE, f"the inner edge {_LEAST_EDGE:g} m from the centre"),
        ):
            if inner < needed:
                must = f"at least {needed + radius - inner:.1f} m, {why}"
                raise must_be("The radius", owner, must, round(radius, 3))


def bend_name(line: Sequence[Piece], *, named: bool) -> str:
    """The part of a road's name for its curves, as `_left_250m`; "" for a straight road.

    named: whether the user has named the road, or its network: then no hash of the line is added.
    """
    if not line:
        return ""
    # curvature, 1/m, positive to the left
    sharpest = max(end_curvatures(line), key=abs)
    words = f"_{'left' if sharpest > 0.0 else 'right'}_{tightest(line):g}m"
    return words if named else f"{words}_{sha256(repr(tuple(line)))[:6]}"
