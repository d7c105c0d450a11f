"""An OpenSCENARIO file at one point as an equal scenario file of this project: `import --out`.

Users: `extras/openscenario/command.py`.
"""

import math
import re
from collections.abc import Sequence
from keyword import iskeyword
from pathlib import Path
from typing import Any

import tomli_w

from sumo_eval.errors import InputError, must_be
from sumo_eval.extras.openscenario.describe import VERBS
from sumo_eval.extras.openscenario.logical import Read, concrete
from sumo_eval.extras.openscenario.scene import distinct
from sumo_eval.report.page import write_page
from sumo_eval.scenario import played
from sumo_eval.scenario.concrete import (
    Actor,
    ConcreteScenario,
    Numbers,
    Road,
    Start,
    constant_lateral,
)
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.logical import ONLY
from sumo_eval.scenario.road.reference_line import Piece
from sumo_eval.scenario.road.table import bend_name
from sumo_eval.scenario.trigger import OF_ONE, OF_TWO
from sumo_eval.text import point_words

Table = dict[str, Any]
"""A table of a scenario file."""
# Operation of a program -> its word in scenario files
_OF_ONE = {op: name for name, op in OF_ONE.items()}  # of a vehicle
_OF_TWO = {op: name for name, op in OF_TWO.items()}  # of two vehicles
# between two numbers or truths
_JOINED = {
    played.ADD: "+", played.SUBTRACT: "-", played.MULTIPLY: "*", played.DIVIDE: "/",
    played.BELOW: "<", played.AT_MOST: "<=", played.AND: "and", played.OR: "or",
}  # fmt: skip
_OF_A_NUMBER = {played.NEGATE: "-", played.ABSOLUTE: "abs"}
# before two numbers in brackets
_OF_NUMBERS = {played.SMALLER: "min", played.LARGER: "max"}


def scenario_content(read: Read, point: Numbers) -> Table:
    """The content of the scenario file for one point of an OpenSCENARIO file.

    Raises InputError where `point` leaves parameters open, and for a case that a scenario file
    cannot express.
    """
    missing = [axis.name for axis in read.space.axes if axis.name not in point]
    if missing:
        raise InputError(
            f"`import --out` must have `--set` for {', '.join(missing)}: it writes one point. The "
            'whole space plays from the OpenSCENARIO file itself: `use = "FILE.xosc"`.'
        )
    case = concrete(read, point)
    for what, occurs in _inexpressible(case).items():
        if occurs:
            raise InputError(
                f"A scenario file has no words for {what} of {case.scenario}: it plays from the "
                "OpenSCENARIO file itself."
            )
    label, body = point_words(point), case.ego_body
    names = _names(case.actors)
    ends = {
        "x": case.road.length, "time": case.time_limit, "standstill": case.standstill_time,
    }  # fmt: skip
    content = {
        "name": re.sub(r"\W", "_", read.logical.name),
        "about": read.space.about,
        "source": f"{read.space.file.name}, OpenSCENARIO "
                  f"{read.space.version}" + (f", at {label}" if label else ""),
        "zone": "none",
        "people": "drivers" if read.logical.has_drivers else "none",
        "parameter": [{"name": ONLY, "unit": "1", "low": 0.0, "high": 1.0, "step": 1.0,
                       "about": "nothing: this is one case"}],
        "sample": [{"name": "the_case", "points": [[0.0]]}],
        "default_sample": "the_case",
        "road": _road(case.road),
        "end": {key: value for key, value in ends.items() if value is not None},
        # `+ 0 *`: a file must use each of its parameters
        "ego": {"speed": f"{case.ego.speed!r} + 0 * {ONLY}", "x": case.ego.x, "y": case.ego.y}
               | ({} if body is None else {"length": body.length, "width": body.width}),
        "vehicle": [_vehicle(actor, name, names)
                    for actor, name in zip(case.actors, names, strict=True)],
    }  # fmt: skip
    try:
        scenario_from(content, "`import --out`", Path())
    except InputError as error:  # such as a condition that is too long
        raise InputError(f"{error} The case plays from the OpenSCENARIO file itself.") from None
    return content


def _inexpressible(case: ConcreteScenario) -> dict[str, bool]:
    """For each thing that a scenario file cannot express, whether the case has it.

    Only files of `sumo-eval export` can lead to such cases.
    """
    road, ego = case.road, case.ego
    return {
        "the lanes, which are not the same throughout,": road.shaped or road.network is not None,
        # it has more than a position and a speed
        "the start of the ego": ego != Start(ego.x, ego.y, ego.speed),
        "actors that SUMO drives": any(actor.model for actor in case.actors),
        "the conditions": bool(case.changes),  # of perception, actuation, vehicle
    }


def write_scenario(content: Table, path: Path) -> None:
    """Write a scenario file.

    Raises InputError where that cannot be done.
    """
    if path.suffix != ".toml":
        raise must_be("`--out`", "import", "a file that ends with .toml", str(path))
    write_page(path, tomli_w.dumps(content), "The scenario file")


def _names(actors: Sequence[Actor]) -> list[str]:
    """Names of the actors, in order, made identifiers, as conditions require."""
    names = (re.sub(r"\W", "_", actor.name) for actor in actors)
    return distinct(
        it if it.isidentifier() and not iskeyword(it) and it != "ego" else f"other_{it}"
        for it in names
    )


def _road(road: Road) -> Table:
    """The table of a road."""
    name = road.name
    # without the ending for its curves, in both forms: reading the scenario file adds it again
    for named in (False, True):
        name = name.removesuffix(bend_name(road.line, named=named))
    return {
        "name": name, "lanes": road.lanes, "lane_width": road.lane_width,
        # `length` of a road's table is where its lanes end; a case ends before, at `end.x`
        "length": road.end, "line": [_piece(piece) for piece in road.line],
    }  # fmt: skip


def _piece(piece: Piece) -> dict[str, float]:
    """The table of a piece of a road's line: its length, and the radii of its ends where curved."""
    keys = ("radius",) if piece.begin == piece.end else ("begin_radius", "end_radius")
    # curvatures, 1/m; one key takes only the first
    ends = zip(keys, (piece.begin, piece.end), strict=False)
    # an end with the curvature 0 is straight and has no radius
    return {"length": piece.length} | {key: 1.0 / curvature for key, curvature in ends if curvature}


def _vehicle(actor: Actor, name: str, names: Sequence[str]) -> Table:
    """The table of an actor; names: of all actors, for conditions."""
    x, y, heading = actor.on_map or (actor.start.x, actor.start.y, actor.heading)
    table = {
        "name": name, "speed": actor.start.speed, "x": x, "y": y, "body": actor.body,
        "length": actor.length, "width": actor.width, "slides": actor.slides,
        "on_map": actor.on_map is not None,
    }  # fmt: skip
    if actor.lively:  # all others point along the road
        table["heading"] = math.degrees(heading)
    # the last act, `concrete.keeps_on`, never begins
    acts = [act for act in actor.acts if math.isfinite(act.begin)]
    table["manoeuvre"] = [_act(act, f"act{k}", names) for k, act in enumerate(acts)]
    return table


def _act(act: played.Act, name: str, names: Sequence[str]) -> Table:
    """The table of a move; names: of all actors, for its condition."""
    table = {"name": name, "begin": act.begin}
    if act.program:
        table["when"] = condition_text(act.program, names)
    if act.jerk < math.inf:  # of a change of speed in an exported case
        table["jerk"] = act.jerk
    match act.kind:
        case played.KEEP:
            return {"do": "keep_speed", **table}
        case played.SMOOTH | played.COSINE:
            table |= {"duration": act.duration, "offset": act.offset}
            verb = "change_lane" if act.kind == played.SMOOTH else "change_lane_cosine"
            return {"do": verb, **table}
        case played.CONSTANT:
            even = constant_lateral(act.begin, act.speed, act.offset, act.acceleration)
            # a scenario file has no duration of such a move: only one that follows from the other
            # values, to the last bit, can be written
            if even.duration == act.duration:
                table |= {"speed": act.speed, "offset": act.offset}
                if act.acceleration < math.inf:  # else at once
                    table["acceleration"] = act.acceleration
                return {"do": "move_sideways", **table}
        case played.SPEED if act.timed:  # to standstill, from a known time on
            return {"do": "brake", **table, "deceleration": act.acceleration}
        case played.SPEED if math.isfinite(act.acceleration):
            table |= {"speed": act.speed, "acceleration": act.acceleration}
            return {"do": "accelerate", **table}
        case played.BY_TIME:
            times, speeds = zip(*act.table, strict=True)
            return {"do": "speed_profile", **table, "times": list(times), "speeds": list(speeds)}
    raise InputError(
        f"`import --out` cannot write {name}, by which an actor {VERBS[act.kind]}: the case "
        "plays from the OpenSCENARIO file itself."
    )


def condition_text(program: played.Program, names: Sequence[str]) -> str:
    """The condition that a program of `scenario.played` computes, in the language of scenario
    files.

    names: of the actors.
    """

    def vehicle(number: int) -> str:
        return "ego" if number == played.EGO else names[number]

    stack = []  # texts of the values on the program's stack
    for op, first, second, value in program:
        if op == played.VALUE:
            stack.append(repr(float(value)))
        elif op == played.TIME:
            stack.append("time")
        elif op in _OF_ONE:
            stack.append(f"{_OF_ONE[op]}({vehicle(first)})")
        elif op in _OF_TWO:
            stack.append(f"{_OF_TWO[op]}({vehicle(first)}, {vehicle(second)})")
        elif op == played.ENDED:
            stack.append(f"ended({vehicle(first)}, act{second})")
        elif op in _OF_A_NUMBER:
            stack.append(f"{_OF_A_NUMBER[op]}({stack.pop()})")
        else:
            right, left = stack.pop(), stack.pop()
            named = _OF_NUMBERS.get(op)
            stack.append(
                f"{named}({left}, {right})" if named else f"({left} {_JOINED[op]} {right})"
            )
    (text,) = stack
    return text
