"""CommonRoad scenarios (XML, formats 2018b and 2020a): the dynamic obstacles' trajectories, in
metres and radians.

Positions are centres. The samples lie on a map, so they are straightened. Obstacles without a
trajectory (standing, or described by sets) are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from lxml import etree
from scipy.spatial import cKDTree

from sumo_eval.drivers.recorded.importers.found import ImportedSamples
from sumo_eval.errors import InputError
from sumo_eval.input_file import input_file
from sumo_eval.trajectory import FloatArray

_SETS = ("time/intervalStart", "position/rectangle", "position/circle", "position/polygon",
    "position/lanelet",
         "orientation/intervalStart", "velocity/intervalStart")  # fmt: skip
"""Elements of states that hold sets instead of exact values."""


def read(path: Path) -> Iterator[ImportedSamples]:
    """The recordings of a file."""
    if path.suffix == ".pb":
        raise InputError(
            f"{path} is a CommonRoad scenario in its binary format (.pb), which is not read: "
            "write it as XML with "
            "commonroad-io, CommonRoadFileWriter(..., file_format=FileFormat.XML)."
        )
    root = parse_xml(path)
    if root.tag != "commonRoad":
        raise InputError(f"{path} must be a CommonRoad file (<commonRoad>), got <{root.tag}>.")
    step = _number(root.get("timeStepSize"), path, root, "timeStepSize")
    rows: list[dict[str, Any]] = []
    left_out: Counter[str] = Counter()
    standing = root.iter("staticObstacle")
    for obstacle in [*root.iter("dynamicObstacle"), *root.iter("obstacle"), *standing]:
        shape, states = obstacle.find("shape/rectangle"), obstacle.findall("trajectory/state")
        if (why := _why_left_out(obstacle, shape, states)) is not None:
            left_out[why] += 1
            continue
        known = [state for state in (obstacle.find("initialState"), *states) if state is not None]
        vague = next(
            (place for state in known for place in _SETS if state.find(place) is not None), None
        )
        if vague is not None:
            raise InputError(
                f"Obstacle {obstacle.get('id', '')} in row {obstacle.sourceline} of {path} must "
                "have exact states, got "
                f"sets of them (`{vague}`): a set-based prediction says where a vehicle may be, "
                "not where it was."
            )
        body = {
            name: _number(shape.findtext(name), path, shape, name) for name in ("length", "width")
        }
        kind = obstacle.findtext("type", "car")
        for state in known:
            rows.append(
                {
                    "vehicle": obstacle.get("id", ""),
                    "t": step * _value(state, "time/exact", path),
                    "x": _value(state, "position/point/x", path),
                    "y": _value(state, "position/point/y", path),
                    "heading": _value(state, "orientation/exact", path),
                    "speed": _value(state, "velocity/exact", path),
                    "class": kind.lower(),
                    **body,
                }
            )
    if not rows and root.find(".//occupancySet") is not None:
        raise InputError(
            f"{path} must hold a dynamic obstacle with a trajectory, got a set-based prediction "
            "(`occupancySet`), "
            "which says where a vehicle may be, not where it was."
        )
    if not rows:
        raise InputError(
            f"{path} must hold at least one dynamic obstacle with a trajectory, got none."
        )
    table = pd.DataFrame(rows).assign(recording=root.get("benchmarkID") or path.stem)
    centres = _lane_centres(root, path)
    if len(centres):
        table["offset"] = _offsets(table, centres)
    notes = tuple(
        f"{path.name}: {number} obstacles are left out, {why}." for why, number in left_out.items()
    )
    yield ImportedSamples(table, planar=True, notes=notes)


def _why_left_out(obstacle: Any, shape: Any, states: list[Any]) -> str | None:
    """Why an obstacle is not a vehicle that was driven; None: it is one."""
    if obstacle.tag == "staticObstacle" or obstacle.findtext("role", "dynamic") != "dynamic":
        return "which stand"
    if shape is None:
        return "whose body is not a rectangle"
    if states:
        return None
    sets = obstacle.find("occupancySet") is not None
    return (
        "which have a set-based prediction and no trajectory"
        if sets
        else "which have no trajectory"
    )


def _lane_centres(root: Any, path: Path) -> FloatArray:
    """Points of the centre lines of all lanelets, at most 1 m apart, with their course: rows of x,
    y, course.
    """
    points = []
    for lanelet in root.iterchildren("lanelet"):
        sides = [
            np.array(
                [
                    (_value(point, "x", path), _value(point, "y", path))
                    for point in lanelet.iterfind(f"{side}/point")
                ]
            )
            for side in ("leftBound", "rightBound")
        ]
        if min(len(side) for side in sides) < 2:
            continue
        even = [
            _evenly(side, max(2, int(max(_length(side) for side in sides)) + 1)) for side in sides
        ]
        middle = (even[0] + even[1]) / 2
        tangent = np.gradient(middle, axis=0)
        points.append(np.column_stack((middle, np.arctan2(tangent[:, 1], tangent[:, 0]))))
    return np.vstack(points) if points else np.empty((0, 3))


def _offsets(table: pd.DataFrame, centres: FloatArray) -> FloatArray:
    """How far to the left of the nearest lanelet's centre line each sample is, m."""
    places = table[["x", "y"]].to_numpy()
    near = centres[cKDTree(centres[:, :2]).query(places)[1]]
    dx, dy = (places - near[:, :2]).T
    aside: FloatArray = -dx * np.sin(near[:, 2]) + dy * np.cos(near[:, 2])
    return aside


def _length(line: FloatArray) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _evenly(line: FloatArray, count: int) -> FloatArray:
    """`count` points evenly along a line (n, 2)."""
    moved = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    places = np.linspace(0.0, moved[-1], count)
    return np.column_stack([np.interp(places, moved, line[:, column]) for column in (0, 1)])


def parse_xml(path: Path) -> Any:
    """The root of an XML file; a damaged one is refused with its line."""
    try:
        return etree.parse(
            str(input_file(path, "file")),
            etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True),
        ).getroot()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {str(error).rstrip('.')}.") from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path} is not well-formed XML: {str(error.msg).rstrip('.')}.") from error


def _value(state: Any, place: str, path: Path) -> float:
    return _number(state.findtext(place), path, state, place)


def _number(text: str | None, path: Path, element: Any, what: str) -> float:
    try:
        return float(text or "")
    except ValueError:
        raise InputError(
            f"`{what}` of the element in row {element.sourceline} of {path} must be a number, got "
            f"{text!r}."
        ) from None
