"""Each class of encounters as a scenario file: parameters, vehicles, moves.

In every scene a vehicle from the next lane comes from the left, one from a ramp from the right:
`measured` mirrors recorded encounters from the other side. `learned` fills in the ranges.

Users: `extras/rates/learn_page.py`, `extras/rates/learned.py`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from sumo_eval.extras.rates.measured import APPROACH_WINDOW

# constants of all learnt scenarios
CAR_LENGTH = 4.5  # m, of every vehicle
EGO_X = 200.0  # m, where the ego starts
END_X, END_TIME = 1500.0, 45.0  # m along the road, and s, at which a case ends
ROAD_LENGTH = 5000.0  # m
# of the default grid, at most; more for a single narrow parameter, as steps are rounded to 1e-6
GRID_POINTS = 1500
SLOWEST, FASTEST = 0.5, 60.0  # m/s at t = 0; roads of scenario files allow no more


class Quantity(NamedTuple):
    """A parameter of a class.

    about: its description in the file.
    floor, ceiling: bounds of its learnt range, in `unit`; a lower recorded value lowers the floor.
    """

    name: str
    unit: str
    about: str
    floor: float = -math.inf
    ceiling: float = math.inf


class SceneActor(NamedTuple):
    """A vehicle of a scene.

    name: in the file. Formulas call its speed at t = 0 `NAME_speed`.
    speed: formula of this speed, m/s.
    words: its name in sentences.
    place: position, as keys of the vehicle's table in the file.
    moves: manoeuvres, as tables of the file.
    """

    name: str
    speed: str
    words: str
    place: Mapping[str, Any]
    moves: tuple[Mapping[str, Any], ...] = ()


class EncounterScene(NamedTuple):
    """A class as a scenario.

    about: its description in the file.
    quantities: its parameters.
    obstacle: name of the actor by which points are safe or hazardous.
    replayed: name of the actor whose motion is compared with the recorded motion.
    ego: keys of the ego's table in the file, in addition to its speed.
    define: name -> formula; those of the speeds are added.
    constraints: conditions, each with its description; those of the speeds are added.
    lanes: number of lanes.
    level: index of the ego's lane; 0 is the right-most lane.
    behind: whether the replayed actor comes from behind the ego.
    """

    about: str
    quantities: tuple[Quantity, ...]
    actors: tuple[SceneActor, ...]
    obstacle: str = "lead"
    replayed: str = "lead"
    ego: Mapping[str, Any] = {}
    define: Mapping[str, str] = {}
    constraints: tuple[tuple[str, str], ...] = ()
    lanes: int = 2
    level: int = 0
    behind: bool = False


EGO_SPEED = Quantity("ego_speed", "m/s", "speed of the ego at t = 0", SLOWEST, FASTEST)
DURATION = Quantity("duration", "s", "of the move to the side", 0.5)


def _closing(name: str, words: str) -> Quantity:
    """The speed of the ego less that of an actor, as a parameter.

    words: for the actor's speed.
    """
    return Quantity(name, "m/s", f"speed of the ego less {words}")


def _speed_change(
    duration: str | float, later: str, slowest: str = f"{SLOWEST:g}"
) -> dict[str, Any]:
    """The manoeuvre that changes a vehicle's speed from t = 0 on.

    duration: s, a number or a formula.
    later: formula of the speed afterwards, m/s.
    slowest: least speed afterwards, m/s.
    """
    return {"do": "speed_profile", "times": [duration], "speeds": [f"max({later}, {slowest})"]}


def _side_move(offset: str, speed: str, acceleration: str) -> tuple[dict[str, Any], ...]:
    """The manoeuvres of a vehicle that moves to the side with constant acceleration along the road.

    offset: to the left, a formula, m.
    speed, acceleration: names of its speed at t = 0 and of its acceleration.
    """
    return (
        {"do": "change_lane", "duration": "duration", "offset": offset},
        _speed_change("duration", f"{speed} + {acceleration} * duration"),
    )


def _moves_in(about: str, gap_about: str, *, ramp: bool = False) -> EncounterScene:
    """The scene of a vehicle that moves into the ego's lane.

    gap_about: description of the gap.
    ramp: whether it comes from a ramp on the right; else from the lane on the left.
    """
    return EncounterScene(
        about,
        (
            EGO_SPEED,
            _closing("closing_speed", "that of the other at t = 0"),
            Quantity("gap", "m", gap_about),
            DURATION,
            Quantity("acceleration", "m/s2", "of the other along the road while it moves to the "
                                             "side"),
        ),
        (
            SceneActor(
                "other", "ego_speed - closing_speed", "the other",
                {"gap": "gap", "y": 0.0 if ramp else "lane"},
                _side_move("lane" if ramp else "-lane", "other_speed", "acceleration"),
            ),
        ),
        obstacle="other",
        replayed="other",
        ego={"y": "lane"} if ramp else {},
        lanes=3 if ramp else 2,
        level=int(ramp),
    )  # fmt: skip


BEGINS_TO_MOVE = "bumper to bumper along the road when the other begins to move"
SCENES = {
    "cut_in": _moves_in(
        "A vehicle in the next lane, which the ego comes up to, moves into the ego's lane.",
        f"{BEGINS_TO_MOVE} to the side",
    ),
    "overtaken_and_cut_off": _moves_in(
        "A faster vehicle overtakes and moves into the ego's lane ahead of it.",
        f"{BEGINS_TO_MOVE}; below 0: it is still beside or behind",
    ),
    "merging": _moves_in(
        "A vehicle on the ramp to the right of the ego's lane moves into it.",
        f"{BEGINS_TO_MOVE} to the side",
        ramp=True,
    ),
    "cut_out": EncounterScene(
        "The lead leaves the lane and reveals a vehicle.",
        (
            EGO_SPEED,
            _closing("lead_closing", "that of the lead at t = 0"),
            Quantity("lead_gap", "m", "bumper to bumper to the lead when it begins to move to the "
                                      "side", 1.0),
            Quantity("lead_acceleration", "m/s2", "of the lead along the road while it moves to "
                                                  "the side"),
            DURATION,
            _closing("closing_speed", "the constant one of the revealed vehicle"),
            Quantity("gap", "m", "bumper to bumper to the revealed vehicle at t = 0", 6.5),
        ),
        (
            SceneActor(
                "lead", "ego_speed - lead_closing", "the lead", {"gap": "lead_gap"},
                _side_move("lane", "lead_speed", "lead_acceleration"),
            ),
            SceneActor("revealed", "ego_speed - closing_speed", "the revealed vehicle",
                {"gap": "gap"}),
        ),
        obstacle="revealed",
        constraints=(
            # the lead's length, and 1 m between both
            (f"gap >= lead_gap + {CAR_LENGTH + 1.0:g}", "one where the revealed vehicle is ahead "
                                                        "of the lead"),
        ),
    ),
    "braking": EncounterScene(
        "The lead brakes for a while.",
        (
            EGO_SPEED,
            _closing("closing_speed", "that of the lead at t = 0"),
            Quantity("headway", "s", "bumper gap over ego speed when the lead begins to "
                                     "brake", 0.05),
            Quantity("deceleration", "m/s2", "mean deceleration of the lead", 0.05),
            Quantity("duration", "s", "of the braking", 0.3),
        ),
        (
            SceneActor(
                "lead", "ego_speed - closing_speed", "the lead", {"gap": "headway * ego_speed"},
                # for `braking` s, as defined below: up to a standstill at most
                (_speed_change("braking", "lead_speed - deceleration * duration", "0.0"),),
            ),
        ),
        define={"braking": "min(duration, lead_speed / deceleration)"},
    ),
    "approach": EncounterScene(
        "The ego comes up to a slower vehicle: the gap falls through 3.5 s.",
        (
            EGO_SPEED,
            _closing("closing_speed", "that of the lead at t = 0"),
            Quantity(
                "acceleration", "m/s2", f"of the lead in the first {APPROACH_WINDOW:g} s; then it "
                                        "keeps its speed"
            ),
        ),
        (
            SceneActor(
                "lead", "ego_speed - closing_speed", "the lead", {"gap": "3.5 * ego_speed"},
                (_speed_change(APPROACH_WINDOW, "lead_speed + acceleration * "
                                                f"{APPROACH_WINDOW:g}"),),
            ),
        ),
    ),
    "lane_change": EncounterScene(
        "A slower vehicle is ahead of the ego, and in the lane on its left a vehicle comes from "
        "behind.",
        (
            EGO_SPEED,
            _closing("lead_closing", "the constant one of the lead"),
            Quantity("lead_gap", "m", "bumper to bumper to the lead at t = 0", 1.0),
            Quantity("rear_closing", "m/s", "speed of the vehicle behind less that of the ego at "
                                            "t = 0"),
            Quantity("rear_gap", "m", "bumper to bumper to the vehicle behind at t = 0", 0.5),
            Quantity("rear_acceleration", "m/s2", "of the vehicle behind while the ego changed "
                                                  "lane ahead of it"),
            Quantity("duration", "s", "of that lane change", 0.5),
        ),
        (
            SceneActor("lead", "ego_speed - lead_closing", "the lead", {"gap": "lead_gap"}),
            SceneActor(
                "rear", "ego_speed + rear_closing", "the vehicle behind",
                {"gap_behind": "rear_gap", "y": "lane"},
                (_speed_change("duration", "rear_speed + rear_acceleration * duration"),),
            ),
        ),
        replayed="rear",
        ego={"x": 600.0},  # m, so that the road behind it has room for the vehicle
        behind=True,
    ),
}  # fmt: skip
"""The scene of each class of `encounters.CLASSES`."""


def content_of(
    name: str,
    class_: str,
    ranges: Mapping[str, tuple[float, float]],
    constants: Mapping[str, float],
    lane_width: float,
    source: str,
) -> dict[str, Any]:
    """A scenario file as plain tables, for TOML.

    name: of the scenario.
    class_: of the encounters, a key of `SCENES`.
    ranges: parameter that varies -> its least and largest value.
    constants: parameter that does not vary -> its value.
    lane_width: m.
    source: of the recordings.
    """
    scene = SCENES[class_]
    speeds, bounds, vehicles = {}, [], []
    for actor in scene.actors:
        speed, words = actor.speed, actor.words
        bounds += [
            (f"{speed} >= {SLOWEST:g}", f"one where {words} moves"),
            (f"{speed} <= {FASTEST:g}", f"one where {words} drives at most {FASTEST:g} m/s"),
        ]
        # `max`: the search for zones needs a valid speed even where the constraints do not hold
        speeds[f"{actor.name}_speed"] = f"max({speed}, {SLOWEST:g})"
        moves = {"manoeuvre": [*actor.moves]} if actor.moves else {}
        vehicles.append(
            {"name": actor.name, "speed": f"{actor.name}_speed", **actor.place, **moves}
        )
    return {
        "name": name,
        "about": scene.about,
        "source": source,
        "define": {"lane": lane_width, **constants, **speeds, **scene.define},
        "parameter": _parameters(scene.quantities, ranges),
        "constraint": [
            {"require": require, "about": about} for require, about in (*bounds, *scene.constraints)
        ],
        "road": {"lanes": scene.lanes, "lane_width": lane_width, "length": ROAD_LENGTH},
        "end": {"x": END_X, "time": END_TIME},
        "ego": {"x": EGO_X, "speed": "ego_speed", **scene.ego},
        "vehicle": vehicles,
        "zone": {"obstacle": scene.obstacle},
    }


def _parameters(
    quantities: Sequence[Quantity], ranges: Mapping[str, tuple[float, float]]
) -> list[dict[str, Any]]:
    """Tables of the parameters, with steps for a grid of about `GRID_POINTS` points or fewer.

    ranges: as in `content_of`.
    """
    # values of each parameter: at least 2, as there are at most 7 parameters
    levels = math.floor(GRID_POINTS ** (1.0 / len(ranges)))
    return [
        {
            "name": item.name,
            "low": low,
            "high": high,
            "step": round((high - low) / (levels - 1), 6),
            "unit": item.unit,
            "about": item.about,
        }
        for item in quantities
        if item.name in ranges
        for low, high in [ranges[item.name]]
    ]
