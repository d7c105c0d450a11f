"""A use case as a logical scenario: its rows are the points of its own sample, its `Then` lines requirements.

Columns whose values differ are the space, with the units that the table has; the rest are definitions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError, did_you_mean, must_be
from sumo_eval.scenario.file import scenario_from
from sumo_eval.scenario.logical import LogicalScenario, Option
from sumo_eval.scenario.usecase.gherkin import Column, Outline, read_outline
from sumo_eval.scenario.usecase.steps import BY_NAME, LANE_WIDTH, Other, Story, si_name, understood

ENDINGS = (".feature.md", ".feature")
ROWS = "rows"
GOAL = 150.0  # m from where the ego starts to where it has to come
STANDS_LONGEST = 30.0  # s that an ego may wait that has to go on
_ROW = "row"
_OPTIONS = {
    "goal": "how far ahead of the ego's start its goal is, m",
    "distance_npc0": "how far Npc0 (or another, by its name) is from the ego at the start, where no step says, m",
}


@dataclass(frozen=True, slots=True)
class UseCase:
    """A use case that was read. rows: the number of each row of its tables among the points, from 1 on."""

    outline: Outline
    story: Story
    logical: LogicalScenario
    rows: tuple[int, ...]


def read_use_case(path: Path, given: Mapping[str, str] | None = None) -> UseCase:
    """The use case in a file. given: options by name, as written. Raises InputError with file, line and step."""
    outline = read_outline(path)
    story = understood(outline, path.name)
    options = _numbers(path.name, given or {}, story)
    for column in outline.columns:
        if column.name not in story.used and column.name not in BY_NAME:
            raise InputError(
                f"{path.name}: the header of the table is doubtful: no step uses column `{column.name}`, and its name "
                f"alone says nothing here.{did_you_mean(column.name, BY_NAME)}"
            )
    goal = options.pop("goal", None)
    table, rows = _table(path, story, GOAL if goal is None else goal, options)
    if goal is not None:
        table["name"] += f"_goal_{goal:g}".replace(".", "_")
    logical = scenario_from(table, f"use case {path.name}", path.parent)
    logical = replace(
        logical, options=tuple(Option(name, "m", about) for name, about in _OPTIONS.items()), notes=tuple(_notes(rows))
    )
    return UseCase(outline, story, logical, rows)


def _numbers(file: str, given: Mapping[str, str], story: Story) -> dict[str, float]:
    known = ["goal", *(f"distance_{name.lower()}" for name in story.others)]
    found = {}
    for name, text in given.items():
        if name not in known:
            raise InputError(f"Unknown option `{name}` of {file}.{did_you_mean(name, known)}")
        try:
            value = float(text)
        except ValueError:
            value = -1.0
        if not 0.0 < value <= 2_000.0:
            raise must_be(f"`{name}`", file, "a number above 0 and up to 2000 m", text)
        found[name] = value
    return found


def _table(
    path: Path, story: Story, goal: float, options: Mapping[str, float]
) -> tuple[dict[str, Any], tuple[int, ...]]:
    """The scenario file that the use case is, and the number of every row among its points."""
    outline = story.outline
    if story.ego_speed is None:
        raise InputError(f"{path.name}: no step says how fast Ego drives at the start.")
    if not story.others:
        raise InputError(f"{path.name}: no step tells of anybody besides Ego.")
    moving = [item for item in outline.columns if len(set(item.values)) > 1 and _changes(item, story)]
    points = list(zip(*(item.values for item in moving), strict=True)) or [(1.0,)] * len(outline.titles)
    kept = list(dict.fromkeys(points))
    table: dict[str, Any] = {
        "name": re.sub(r"\W", "_", path.name.removesuffix(".md").removesuffix(".feature")).lower(),
        "about": outline.name,
        "source": f"{path.name}: {outline.feature}",
        "zone": "none",
        "people": "none",
        "parameter": [_parameter(item) for item in moving] or [_row()],
        "define": _definitions(outline, moving),
        "road": {"lanes": 2, "lane_width": _lane_width(outline, path.name)},
        "end": {"x": 50.0 + goal, **({"standstill": STANDS_LONGEST} if story.stops else {})},
        "ego": {"speed": story.ego_speed if moving else f"{story.ego_speed} + 0 * {_ROW}"},
        "vehicle": [_vehicle(other, story, path.name, options) for other in story.others.values()],
        "require": [{"name": text, "check": check} for text, check in _checks(story)],
        "sample": [{"name": ROWS, "about": "the rows of the table", "points": kept}],
        "default_sample": ROWS,
    }
    return table, tuple(kept.index(point) + 1 for point in points)


def _changes(column: Column, story: Story) -> bool:
    return column.name in story.used and column.name != "w"


def _row() -> dict[str, Any]:
    return {"name": _ROW, "unit": "1", "values": (1.0, 2.0), "about": "nothing: all rows of the table are alike"}


def _parameter(column: Column) -> dict[str, Any]:
    return {"name": column.name, "unit": column.unit.replace("^", ""), "values": sorted(set(column.values)),
            "about": "a column of the table"}  # fmt: skip


def _definitions(outline: Outline, moving: list[Column]) -> dict[str, str | float]:
    """Every column in units of SI, by the names that expressions have for them; and the width of the lane."""
    found: dict[str, str | float] = {}
    for column in outline.columns:
        if column not in moving:
            found[si_name(column.name, column.factor)] = column.values[0] * column.factor
        elif column.factor != 1.0:
            found[si_name(column.name, column.factor)] = f"{column.name} * {column.factor!r}"
    found["lane_width"] = next((item.values[0] for item in outline.columns if item.name == "w"), LANE_WIDTH)
    return found


def _lane_width(outline: Outline, file: str) -> float:
    column = outline.column("w")
    if column is None:
        return LANE_WIDTH
    if len(set(column.values)) > 1:
        raise must_be("Column `w`", file, "one width, as a scenario has one road", ", ".join(map(str, column.values)))
    return column.values[0]


def _checks(story: Story) -> list[tuple[str, str]]:
    """Names and conditions; the same words twice have their line behind them."""
    texts = [check.text for check in story.checks]
    return [
        (check.text.replace(";", ",") + (f" (line {check.line})" if texts.count(check.text) > 1 else ""), check.check)
        for check in story.checks
    ]


def _vehicle(other: Other, story: Story, file: str, options: Mapping[str, float]) -> dict[str, Any]:
    given = options.get(f"distance_{other.name.lower()}")
    ahead: str | float | None = other.ahead if other.ahead is not None else given
    if other.ahead is not None and given is not None:
        raise InputError(f"Option `distance_{other.name.lower()}` of {file}: a step has said how far {other.name} is.")
    if ahead is None:
        raise InputError(
            f"{file}, line {other.line}: no step and no column says how far {other.name} is from Ego at the start; "
            f'`use = "{file}?distance_{other.name.lower()}=35"` would.'
        )
    found: dict[str, Any] = {
        "name": other.name,
        "speed": "0" if other.speed is None else other.speed,
        "body": "pedestrian" if other.walks else "car",
        "manoeuvre": other.moves,
    }
    if other.after is not None:
        first = story.others[other.after]
        before = first.ahead if first.ahead is not None else options.get(f"distance_{first.name.lower()}")
        if before is None:
            raise InputError(f"{file}, line {first.line}: no step and no column says how far {first.name} is from Ego "
                             f'at the start; `use = "{file}?distance_{first.name.lower()}=35"` would.')  # fmt: skip
        found["gap"] = f"{before} + {_LENGTH} + {ahead}"
    else:
        found["gap_behind" if other.behind else "gap"] = ahead
    if other.side:
        found["y"], found["heading"] = f"{other.side} * parking_offset", 0.0
    if other.next_lane:
        found["y"] = "lane_width"
    if other.walks:
        found["heading"] = -90.0
    return found


_LENGTH = 4.5  # m of a car


def _notes(rows: tuple[int, ...]) -> list[str]:
    doubles = [f"row {place} is row {rows.index(row) + 1} again" for place, row in enumerate(rows, start=1)
               if rows.index(row) + 1 != place]  # fmt: skip
    return [f"Rows that are alike are driven once: {', '.join(doubles)}."] if doubles else []
