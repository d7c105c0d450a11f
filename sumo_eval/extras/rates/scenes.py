"""What each class of encounters looks like as a scenario file: parameters, vehicles, moves.

Where a scene needs the left, the lane beside the ego's is on its left; encounters to the other side are mirrored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from sumo_eval.extras.rates.encounters import APPROACH_WINDOW

CAR_LENGTH: Final = 4.5  # m, of every vehicle of a learnt scenario
END_X, END_TIME, ROAD_LENGTH = 1500.0, 45.0, 5000.0  # m, s, m: when a case of a learnt scenario is over
GRID_POINTS: Final = 1500  # about so many has the default grid of a learnt scenario
SLOWEST, FASTEST = 0.5, 60.0
"""m/s; no vehicle of a learnt scenario begins slower, nor faster than roads of scenario files allow."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of a class. floor, ceiling: below and above it there is none, in `unit`; None: no such bound."""

    name: str
    unit: str
    about: str
    floor: float | None = None
    ceiling: float | None = None


@dataclass(frozen=True, slots=True)
class Scene:
    """A class as a scenario. content: the file's tables but for parameters, with `{lane}` for the lane's width.

    replayed: the vehicle whose motion is compared with the recorded one. level: where the lane is that its recorded
    place is told from, in lanes to the left of the right one.
    """

    about: str
    quantities: tuple[Quantity, ...]
    ego: Mapping[str, Any]
    vehicles: tuple[Mapping[str, Any], ...]
    define: Mapping[str, str]
    constraints: tuple[tuple[str, str], ...]
    replayed: str
    obstacle: str
    lanes: int = 2
    level: int = 0
    behind: bool = False


EGO_SPEED: Final = Quantity("ego_speed", "m/s", "speed of the ego at t = 0", SLOWEST, FASTEST)
DURATION: Final = Quantity("duration", "s", "of the move to the side", 0.5)


def _bounds(speed: str, who: str) -> tuple[tuple[str, str], ...]:
    """Constraints that keep a vehicle's speed at t = 0 between `SLOWEST` and `FASTEST`."""
    return (
        (f"{speed} >= {SLOWEST:g}", f"one where {who} moves"),
        (f"{speed} <= {FASTEST:g}", f"one where {who} is no faster than {FASTEST:g} m/s"),
    )


def _moving(speed: str) -> str:
    """A speed that is one at points too that a constraint rules out, and that zones are searched over."""
    return f"max({speed}, {SLOWEST:g})"


def _side_move(offset: str, speed: str, acceleration: str) -> list[dict[str, Any]]:
    later = f"max({speed} + {acceleration} * duration, {SLOWEST:g})"
    return [
        {"do": "change_lane", "duration": "duration", "offset": offset},
        {"do": "speed_profile", "times": ["duration"], "speeds": [later]},
    ]


def _moves_in(about: str, gap_about: str, level: int, sign: str) -> Scene:
    """A vehicle beside the ego's lane moves into it. level: the lane it comes from; sign: of its way."""
    at_the_side = {} if level == 1 else {"y": "lane"}
    y = "lane" if level == 1 else 0.0
    return Scene(
        about,
        (
            EGO_SPEED,
            Quantity("closing_speed", "m/s", "speed of the ego less that of the other at t = 0"),
            Quantity("gap", "m", gap_about),
            DURATION,
            Quantity("acceleration", "m/s2", "of the other along the road while it moves to the side"),
        ),
        {"speed": "ego_speed", **at_the_side},
        (
            {
                "name": "other",
                "speed": "other_speed",
                "gap": "gap",
                "y": y,
                "manoeuvre": _side_move(f"{sign}lane", "other_speed", "acceleration"),
            },
        ),
        {"other_speed": _moving("ego_speed - closing_speed")},
        _bounds("ego_speed - closing_speed", "the other"),
        "other",
        "other",
        lanes=2 if level == 1 else 3,
        level=0 if level == 1 else 1,
    )


SCENES: Final[Mapping[str, Scene]] = {
    "cut_in": _moves_in(
        "A vehicle in the next lane, which the ego comes up to, moves into the ego's lane.",
        "bumper to bumper along the road when the other begins to move to the side",
        1,
        "-",
    ),
    "overtaken_and_cut_off": _moves_in(
        "A faster vehicle overtakes and moves into the ego's lane ahead of it.",
        "bumper to bumper along the road when the other begins to move; below 0: it is still beside or behind",
        1,
        "-",
    ),
    "merging": _moves_in(
        "A vehicle on the ramp to the right of the ego's lane moves into it.",
        "bumper to bumper along the road when the other begins to move to the side",
        0,
        "",
    ),
    "cut_out": Scene(
        "The vehicle ahead leaves the lane and reveals another one.",
        (
            EGO_SPEED,
            Quantity("lead_closing", "m/s", "speed of the ego less that of the lead at t = 0"),
            Quantity("lead_gap", "m", "bumper to bumper to the lead when it begins to move to the side", 1.0),
            Quantity("lead_acceleration", "m/s2", "of the lead along the road while it moves to the side"),
            DURATION,
            Quantity("closing_speed", "m/s", "speed of the ego less the constant one of the revealed vehicle"),
            Quantity("gap", "m", "bumper to bumper to the revealed vehicle at t = 0", 6.5),
        ),
        {"speed": "ego_speed"},
        (
            {
                "name": "lead",
                "speed": "lead_speed",
                "gap": "lead_gap",
                "manoeuvre": _side_move("lane", "lead_speed", "lead_acceleration"),
            },
            {"name": "revealed", "speed": "revealed_speed", "gap": "gap"},
        ),
        {"lead_speed": _moving("ego_speed - lead_closing"), "revealed_speed": _moving("ego_speed - closing_speed")},
        (
            *_bounds("ego_speed - lead_closing", "the lead"),
            *_bounds("ego_speed - closing_speed", "the revealed vehicle"),
            (f"gap >= lead_gap + {CAR_LENGTH + 1.0:g}", "one where the revealed vehicle is ahead of the lead"),
        ),
        "lead",
        "revealed",
    ),
    "braking": Scene(
        "The vehicle ahead brakes for a while.",
        (
            EGO_SPEED,
            Quantity("closing_speed", "m/s", "speed of the ego less that of the lead at t = 0"),
            Quantity("headway", "s", "bumper gap over ego speed when the lead begins to brake", 0.05),
            Quantity("deceleration", "m/s2", "mean deceleration of the lead", 0.05),
            Quantity("duration", "s", "of the braking", 0.3),
        ),
        {"speed": "ego_speed"},
        (
            {
                "name": "lead",
                "speed": "lead_speed",
                "gap": "headway * ego_speed",
                "manoeuvre": [
                    {
                        "do": "speed_profile",
                        "times": ["braking"],
                        "speeds": ["max(lead_speed - deceleration * duration, 0.0)"],
                    }
                ],
            },
        ),
        {"lead_speed": _moving("ego_speed - closing_speed"), "braking": "min(duration, lead_speed / deceleration)"},
        _bounds("ego_speed - closing_speed", "the lead"),
        "lead",
        "lead",
    ),
    "approach": Scene(
        "The ego comes up to a slower vehicle: the gap falls through 3.5 s.",
        (
            EGO_SPEED,
            Quantity("closing_speed", "m/s", "speed of the ego less that of the lead at t = 0"),
            Quantity(
                "acceleration", "m/s2", f"of the lead in the first {APPROACH_WINDOW:g} s; then it keeps its speed"
            ),
        ),
        {"speed": "ego_speed"},
        (
            {
                "name": "lead",
                "speed": "lead_speed",
                "gap": "3.5 * ego_speed",
                "manoeuvre": [
                    {
                        "do": "speed_profile",
                        "times": [APPROACH_WINDOW],
                        "speeds": [f"max(lead_speed + acceleration * {APPROACH_WINDOW:g}, {SLOWEST:g})"],
                    }
                ],
            },
        ),
        {"lead_speed": _moving("ego_speed - closing_speed")},
        _bounds("ego_speed - closing_speed", "the lead"),
        "lead",
        "lead",
    ),
    "lane_change": Scene(
        "A slower vehicle is ahead of the ego, and in the lane on its left somebody comes from behind.",
        (
            EGO_SPEED,
            Quantity("lead_closing", "m/s", "speed of the ego less the constant one of the lead"),
            Quantity("lead_gap", "m", "bumper to bumper to the lead at t = 0", 1.0),
            Quantity("rear_closing", "m/s", "speed of the vehicle behind less that of the ego at t = 0"),
            Quantity("rear_gap", "m", "bumper to bumper to the vehicle behind at t = 0", 0.5),
            Quantity("rear_acceleration", "m/s2", "of the vehicle behind while somebody changed lane ahead of it"),
            Quantity("duration", "s", "of that lane change", 0.5),
        ),
        {"speed": "ego_speed", "x": 600.0},
        (
            {"name": "lead", "speed": "lead_speed", "gap": "lead_gap"},
            {
                "name": "rear",
                "speed": "rear_speed",
                "gap_behind": "rear_gap",
                "y": "lane",
                "manoeuvre": [
                    {
                        "do": "speed_profile",
                        "times": ["duration"],
                        "speeds": [f"max(rear_speed + rear_acceleration * duration, {SLOWEST:g})"],
                    }
                ],
            },
        ),
        {"lead_speed": _moving("ego_speed - lead_closing"), "rear_speed": _moving("ego_speed + rear_closing")},
        (
            *_bounds("ego_speed - lead_closing", "the lead"),
            *_bounds("ego_speed + rear_closing", "the vehicle behind"),
        ),
        "rear",
        "lead",
        level=0,
        behind=True,
    ),
}
"""What each class of `encounters.CLASSES` looks like."""


def content_of(
    name: str,
    class_: str,
    ranges: Mapping[str, tuple[float, float]],
    constants: Mapping[str, float],
    lane_width: float,
    source: str,
) -> dict[str, Any]:
    """A scenario file as plain tables, for TOML. ranges: of the parameters that vary; constants: of the others."""
    scene = SCENES[class_]
    levels = max(2, math.floor(GRID_POINTS ** (1.0 / max(len(ranges), 1))))
    parameters = [
        {
            "name": item.name,
            "low": ranges[item.name][0],
            "high": ranges[item.name][1],
            "step": round((ranges[item.name][1] - ranges[item.name][0]) / (levels - 1), 6),
            "unit": item.unit,
            "about": item.about,
        }
        for item in scene.quantities
        if item.name in ranges
    ]
    return {
        "name": name,
        "about": scene.about,
        "source": source,
        "define": {"lane": lane_width, **{key: float(value) for key, value in constants.items()}, **scene.define},
        "parameter": parameters,
        "constraint": [{"require": require, "about": about} for require, about in scene.constraints],
        "road": {"lanes": scene.lanes, "lane_width": lane_width, "length": ROAD_LENGTH},
        "end": {"x": END_X, "time": END_TIME},
        "ego": {"x": 200.0, **scene.ego},
        "vehicle": [dict(vehicle) for vehicle in scene.vehicles],
        "zone": {"obstacle": scene.obstacle},
    }
