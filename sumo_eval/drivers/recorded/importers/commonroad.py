"""CommonRoad scenarios (XML, formats 2018b and 2020a): the dynamic obstacles' trajectories, in
metres and radians.

Positions are of centres, on a map: `recorded.straighten` makes road coordinates of them. Obstacles
without a trajectory (standing, or with an `occupancySet` alone) are left out.

Users: `drivers/recorded/importing.py`.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from lxml import etree
from scipy.spatial import cKDTree

from sumo_eval.drivers.recorded.importers.tables import LARGEST, Samples, reading, require
from sumo_eval.drivers.recorded.straighten import distances
from sumo_eval.errors import InputError
from sumo_eval.groups import grouped
from sumo_eval.input_file import input_file
from sumo_eval.text import number_in
from sumo_eval.trajectory import FloatArray

_SETS = ("time/intervalStart", "position/rectangle", "position/circle", "position/polygon",
    "position/lanelet",
         "orientation/intervalStart", "velocity/intervalStart")  # fmt: skip
"""Elements of states that hold sets instead of exact values."""
_EXACT = {
    "t": "time/exact",
    "x": "position/point/x",
    "y": "position/point/y",
    "heading": "orientation/exact",
    "speed": "velocity/exact",
}


def read(path: Path) -> Samples:
    """The recordings of a file."""
    if path.suffix == ".pb":
        raise InputError(
            f"{path} is a CommonRoad scenario in its binary format (.pb), which is not read: write "
            "it as XML with commonroad-io, CommonRoadFileWriter(..., file_format=FileFormat.XML)."
        )
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    with reading(path):
        root: Any = etree.parse(str(input_file(path, "file")), parser).getroot()
    if root.tag != "commonRoad":
        raise InputError(f"{path} must be a CommonRoad file (<commonRoad>), got <{root.tag}>.")
    step = _number(root.get("timeStepSize"), path, root, "timeStepSize")
    require(step > 0.0, path, "must have a `timeStepSize` above 0 s")
    obstacles = root.iter("dynamicObstacle", "obstacle", "staticObstacle")
    by_reason = grouped((_why_left_out(it), it) for it in obstacles)
    rows = [row for driven in by_reason.pop("", ()) for row in _samples(driven, path)]
    if not rows:
        got = "none"
        if root.find(".//occupancySet") is not None:
            got = (
                "a set-based prediction (`occupancySet`), which says where a vehicle may be, not "
                "where it was"
            )
        raise InputError(
            f"{path} must hold at least one dynamic obstacle with a trajectory, got {got}."
        )
    table = pd.DataFrame(rows).assign(recording=root.get("benchmarkID") or path.stem)
    table["t"] *= step
    centres = _lane_centres(root, path)
    if len(centres):
        table["offset"] = _offsets(table, centres)
    return table, [
        f"{path.name}: {len(left_out)} obstacles are left out, {reason}."
        for reason, left_out in by_reason.items()
    ]


def _why_left_out(obstacle: Any) -> str:
    """Reason why an obstacle is not a driven vehicle; empty: it is one."""
    # standing: `staticObstacle` in 2020a, a `role` in 2018b
    if obstacle.tag == "staticObstacle" or obstacle.findtext("role", "dynamic") != "dynamic":
        return "which stand"
    rectangle = obstacle.find("shape/rectangle")
    if rectangle is None:
        return "whose body is not a rectangle"
    if any(number_in(it.text) != 0.0 for it in rectangle.iter("x", "y", "orientation")):
        return "whose rectangle is shifted or turned"
    if obstacle.find("trajectory/state") is not None:
        return ""
    prediction = "a set-based prediction and " if obstacle.find("occupancySet") is not None else ""
    return f"which have {prediction}no trajectory"


def _samples(obstacle: Any, path: Path) -> list[dict[str, Any]]:
    """Samples of a vehicle, t in time steps.

    Raises InputError if a state is an interval or an area.
    """
    states = obstacle.findall("initialState") + obstacle.findall("trajectory/state")
    for tags in _SETS:
        if any(state.find(tags) is not None for state in states):
            raise InputError(
                f"Obstacle {obstacle.get('id', '')} in row {obstacle.sourceline} of {path} "
                f"must have exact states, got sets of them (`{tags}`): a set-based prediction "
                "says where a vehicle may be, not where it was."
            )
    shape = obstacle.find("shape/rectangle")
    row = {
        "vehicle": obstacle.get("id", ""),
        "class": obstacle.findtext("type", "car"),
        "length": _value(shape, "length", path),
        "width": _value(shape, "width", path),
    }
    return [
        row | {name: _value(state, tags, path) for name, tags in _EXACT.items()} for state in states
    ]


def _lane_centres(root: Any, path: Path) -> FloatArray:
    """Points of the centre lines of all lanelets, at most 1 m apart, with their course: rows of x,
    y, course.
    """
    points = [np.empty((0, 3))]
    for lanelet in root.iterchildren("lanelet"):
        sides = [
            np.array([[_value(it, axis, path) for axis in "xy"] for it in lanelet.findall(bound)])
            for bound in ("leftBound/point", "rightBound/point")
        ]
        if min(len(side) for side in sides) < 2:  # one point has no course
            continue
        longer = max(distances(side)[-1] for side in sides)
        count = max(2, math.ceil(longer) + 1)
        left, right = (_even(side, count) for side in sides)
        middle = (left + right) / 2
        tangent = np.gradient(middle, axis=0)
        points.append(np.column_stack((middle, np.arctan2(tangent[:, 1], tangent[:, 0]))))
    return np.vstack(points)


def _even(line: FloatArray, count: int) -> FloatArray:
    """`count` points along a line (n, 2), all equally far apart."""
    along = distances(line)
    places = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(places, along, column) for column in line.T])


def _offsets(table: pd.DataFrame, centres: FloatArray) -> FloatArray:
    """Offset of each sample from the nearest lanelet's centre line, m, positive to its own left."""
    samples = table[["x", "y", "heading"]].to_numpy()
    near = centres[cKDTree(centres[:, :2]).query(samples[:, :2])[1]]
    dx, dy, turned = (samples - near).T
    course = near[:, 2]
    aside = -dx * np.sin(course) + dy * np.cos(course)
    # an oncoming lane, on which the vehicle overtakes, leads the other way
    return np.asarray(aside * np.sign(np.cos(turned)))


def _value(state: Any, tags: str, path: Path) -> float:
    return _number(state.findtext(tags), path, state, tags)


def _number(text: str | None, path: Path, element: Any, what: str) -> float:
    number = number_in(text)
    if not abs(number) <= LARGEST:  # nan, too
        raise InputError(
            f"`{what}` of the element in row {element.sourceline} of {path} must be a number, got "
            f"{'nothing' if text is None else repr(text)}."
        )
    return number
