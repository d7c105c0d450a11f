"""What a search for an ADS's failure boundary found, as files: every trial, a summary, and a
picture.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.extras.studies.boundary import FailureBoundary
from sumo_eval.report.page import write_csv, write_page
from sumo_eval.report.study_page import write_study
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

TRIALS, PLAIN, CHANCES = "trials.csv", "boundary.json", "chances.csv"
CELLS = 80  # on each axis of a map
PANELS = (0.1, 0.3, 0.5, 0.7, 0.9)  # shares of the third parameter's range, one map each
COUNTED = 8_192  # evenly spread points by which shares of the space are counted


def summary(found: FailureBoundary) -> dict[str, Any]:
    """The result in plain values."""
    logical = found.logical
    points = evenly(logical, COUNTED, random_stream(0, "counted", logical.name))
    points = points[logical.feasible(points)]
    exposure = np.broadcast_to(logical.exposure(logical.columns(points)), len(points))
    collides = found.search.classify(points)
    return {
        "scenario": logical.name,
        "ads": found.ads,
        "parameters": [
            {"name": p.name, "low": p.low, "high": p.high, "unit": p.unit}
            for p in logical.parameters
        ],
        "simulations": found.rounds[-1].simulations,
        "collisions": int(found.search.outcomes.sum()),
        "not_evaluated": found.not_evaluated,
        "stopped": found.stopped,
        "expected_change": found.rounds[-1].expected_change,
        "doubt": found.rounds[-1].doubt,
        "collision_share_of_space": float(np.mean(collides)),
        "collision_share_of_exposure": float(exposure[collides].sum() / exposure.sum()),
        "rounds": [asdict(one) for one in found.rounds],
    }


def write_boundary(
    found: FailureBoundary, folder: Path, held: Mapping[str, float] | None = None
) -> tuple[Path, ...]:
    """Write `trials.csv`, `boundary.json` and `boundary.html` into a folder and return their paths.

    held: the parameters that the search held fixed, by name.
    """
    held = dict(held or {})
    table, plain, page = folder / TRIALS, folder / PLAIN, folder / "boundary.html"
    chances = folder / CHANCES
    names = found.logical.names
    trials = [
        [*row, int(hit)]
        for row, hit in zip(found.search.points.tolist(), found.search.outcomes, strict=True)
    ]
    write_csv(table, [*names, "collided"], trials)
    write_csv(
        chances,
        [*names, "chance"],
        (
            [*(f"{value:z.9g}" for value in row), "" if np.isnan(chance) else f"{chance:z.4g}"]
            for share in shares(found)
            for row, chance in zip(*chances_on(found, share), strict=True)
        ),
    )
    told = {**summary(found), "held": held}
    write_page(plain, json.dumps(told, indent=2, allow_nan=False) + "\n", "The boundary")
    title, panels = edge_panels(folder)
    write_study(
        page,
        kicker="The boundary of failure",
        title=title,
        sentences=[*sentences(found, held), "The line is where both outcomes are equally likely."],
        figures={title: on_page(panels, len(panels), 560)},
        rows=[[*names, "collided"], *([f"{value:g}" for value in row] for row in trials)],
        least_width=340 * len(PANELS) if len(names) > 2 else 300,
    )
    return table, plain, page, chances


def shares(found: FailureBoundary) -> tuple[float, ...]:
    """Where in the third parameter's range a map lies, one share a map; one map where there is no
    third.
    """
    return PANELS if len(found.logical.parameters) > 2 else (0.5,)


def chances_on(found: FailureBoundary, share: float) -> tuple[FloatArray, FloatArray]:
    """The points of a map, row by row, (n, k), and the chance of a collision there, (n,), nan where
    nothing can be.

    A map has CELLS values of the first parameter by as many of the second, where there is one;
    parameters behind the third are in the middle of their ranges.
    """
    logical = found.logical
    k = len(logical.parameters)
    ticks = np.linspace(0.0, 1.0, CELLS)
    across = ticks if k > 1 else np.array([0.5])
    unit = np.full((len(across), CELLS, k), 0.5)
    unit[..., 0] = ticks
    if k > 1:
        unit[..., 1] = across[:, None]
    if k > 2:
        unit[..., 2] = share
    rows = logical.from_unit(unit.reshape(-1, k))
    return rows, np.where(logical.feasible(rows), found.search.probability(rows), np.nan)


def sentences(found: FailureBoundary, held: Mapping[str, float]) -> list[str]:
    """What the search says.

    held: the parameters that it held fixed, by name.
    """
    told, change = summary(found), found.rounds[-1].expected_change
    said = [
        f"{found.logical.name}: {found.ads} collides in {told['collision_share_of_space']:z.1%} "
        "of the space "
        f"({told['collision_share_of_exposure']:z.1%} of the exposure), from "
        f"{told['simulations']} simulations."
    ]
    if found.stopped == "settled":
        said.append(f"The next round is expected to move {change:z.2%} of the space: settled.")
    elif change < 1.0:
        said.append(
            f"The search ended with its {found.stopped}. A further round may move {change:z.2%} "
            "of the space."
        )
    else:
        said.append(
            f"The search ended with its {found.stopped}. The change by a further round is "
            "unknown: too few rounds saw "
            "both outcomes, or the boundary still contradicts some trials."
        )
    if held:
        said.append(
            f"Held fixed: {', '.join(f'{name} = {value:g}' for name, value in held.items())}."
        )
    if not found.search.outcomes.any() or found.search.outcomes.all():
        said.append(
            "Every trial ended alike: there is no boundary that these simulations could find."
        )
    for status, number in found.not_evaluated.items():
        said.append(f"Not evaluated: {number} ({status}). The search continued without them.")
    return said


def edge_panels(folder: Path) -> tuple[str, list[Panel]]:
    """The title, and trials over the likelier outcome: one map for two parameters, one for each of
    some values of a third, on the nearest of which a trial is drawn.

    Parameters behind the third are in the middle of their ranges.

    Raises InputError where a file is missing.
    """
    try:
        told = json.loads((folder / PLAIN).read_text(encoding="utf-8"))
        tables = [
            np.genfromtxt(folder / name, delimiter=",", skip_header=1, ndmin=2)
            for name in (CHANCES, TRIALS)
        ]
    except OSError as error:
        raise InputError(
            f"The boundary in {folder} cannot be drawn: {error}. Search it again."
        ) from error
    chances, trials = tables
    items = told["parameters"]
    k = len(items)
    maps = np.split(chances, np.flatnonzero(np.diff(chances[:, 2])) + 1) if k > 2 else [chances]
    third = np.array([rows[0, 2] for rows in maps]) if k > 2 else np.zeros(1)
    nearest = (
        np.argmin(np.abs(trials[:, 2:3] - third), axis=1)
        if k > 2
        else np.zeros(len(trials), dtype=int)
    )
    x, y = (
        [
            *(
                f"{it['name']} ({it['unit']})" if it["unit"] not in ("", "1") else it["name"]
                for it in items
            ),
            "",
        ]
    )[:2]
    panels = []
    for number, rows in enumerate(maps):
        across, along = (
            np.unique(rows[:, column]) if column < k else np.array([-1.0, 1.0]) for column in (0, 1)
        )
        chance = np.broadcast_to(rows[:, -1].reshape(-1, len(across)), (len(along), len(across)))
        marks = []
        for hit, (words, marker) in enumerate((("no collision", "o"), ("collision", "X"))):
            here = trials[(trials[:, -1] == hit) & (nearest == number)]
            marks.append(
                Marks(
                    words,
                    here[:, 0],
                    here[:, 1] if k > 1 else np.zeros(len(here)),
                    COLOURS[hit],
                    marker=marker,
                )
            )
        title = ", ".join(
            f"{it['name']} = {value:z.3g}"
            for it, value in zip(items[2:], rows[0, 2:k], strict=True)
        )
        panels.append(Panel(marks, x, y, title, chance=(across, along, chance)))
    return f"{told['scenario'].replace('_', ' ')}: where {told['ads']} collides", panels
