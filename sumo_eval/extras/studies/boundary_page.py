"""Files of `sumo-eval boundary`: trials, summary, chances, and a page with maps.

The page and `sumo-eval plot` draw the maps from these files, the latter possibly years later.
So the names of the files are fixed, and:

| file | fixed |
|---|---|
| `trials.csv` | a column for each parameter, in the order of the space, then `collided`, 0 or 1 |
| `chances.csv` | the same columns of parameters, then `chance`, empty at an impossible point |
| `boundary.json` | the keys of `summary`; the maps need `scenario`, `ads` and `parameters` |

`boundary.html` is for people: only its name is fixed.

Users: `extras/figures/of_studies.py`, `extras/studies/boundary_command.py`.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from sumo_eval.drivers.recorded.importers.tables import read_table
from sumo_eval.errors import InputError
from sumo_eval.extras.panels import COLOURS, Marks, Panel, on_page
from sumo_eval.extras.studies.boundary import FailureBoundary
from sumo_eval.input_file import taking_apart
from sumo_eval.report.page import Json, write_csv, write_json
from sumo_eval.report.study_page import Table, write_study
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.text import point_words
from sumo_eval.trajectory import FloatArray

TRIALS, CHANCES = "trials.csv", "chances.csv"
SUMMARY, PAGE = "boundary.json", "boundary.html"
COLLIDED, CHANCE = "collided", "chance"  # columns after those of the parameters
CELLS = 80  # on each axis of a map
PANELS = 0.1, 0.3, 0.5, 0.7, 0.9  # shares of the third parameter's range, one map each
SHARE_POINTS = 8_192  # evenly spread points with which shares of the space are measured
MAP_WIDTH = 340  # px on the page, of each of several maps


def summary(boundary: FailureBoundary, held: Mapping[str, float]) -> Json:
    """The result as the content of `boundary.json`.

    held: the parameters that the search held fixed, by name.
    """
    logical, last = boundary.logical, boundary.rounds[-1]
    points = evenly(logical, SHARE_POINTS, random_stream(0, "counted", logical.name))
    points = points[logical.feasible(points)]
    exposure = logical.exposures(points)
    collides = boundary.search.classify(points)
    # None where no counted point is possible, or none occurs on the road
    of_space = float(np.mean(collides)) if len(points) else None
    occurring = exposure.sum()
    of_exposure = float(exposure[collides].sum() / occurring) if occurring > 0.0 else None
    return {
        "scenario": logical.name,
        "ads": boundary.ads,
        "parameters": [
            {key: getattr(it, key) for key in ("name", "low", "high", "unit")}
            for it in logical.parameters
        ],
        **last._asdict(),  # simulations, collisions, expected_change, doubt
        "not_evaluated": boundary.not_evaluated,
        "stopped": boundary.stopped,
        "collision_share_of_space": of_space,
        "collision_share_of_exposure": of_exposure,
        "rounds": [item._asdict() for item in boundary.rounds],
        "held": held,
    }


def check_columns(logical: LogicalScenario) -> None:
    """Raise InputError for a parameter with the name of a further column of the files."""
    for name in (COLLIDED, CHANCE):
        if name in logical.names:
            raise InputError(
                f"A free parameter of scenario `{logical.name}` must not be named `{name}`, which "
                "is a column of the results: hold it fixed, or rename it."
            )


def write_boundary(boundary: FailureBoundary, content: Json, folder: Path) -> tuple[Path, ...]:
    """Write the files of the search; return the paths of `trials.csv`, `boundary.json`,
    `boundary.html` and `chances.csv`.

    content: its `summary`.
    """
    names, search = boundary.logical.names, boundary.search
    trials = [
        [*row, int(hit)] for row, hit in zip(search.points.tolist(), search.outcomes, strict=True)
    ]
    write_csv(folder / TRIALS, [*names, COLLIDED], trials)
    # one map at each of these shares of the third parameter's range; without a third, one map
    shares = PANELS if len(names) > 2 else (0.5,)
    maps = np.concatenate([chances_on(boundary, share) for share in shares])
    chances = [
        [*(f"{value:z.15g}" for value in point), "" if np.isnan(chance) else f"{chance:z.4g}"]
        for *point, chance in maps.tolist()
    ]  # an impossible point has an empty chance
    write_csv(folder / CHANCES, [*names, CHANCE], chances)
    write_json(folder / SUMMARY, content, "The boundary")
    # drawn from the files, which must be enough for `sumo-eval plot` to draw the maps again
    title, panels = edge_panels(folder)
    write_study(
        folder / PAGE,
        kicker="The boundary of failure",
        title=title,
        sentences=[*sentences(content), "The line is where both outcomes are equally likely."],
        figures={title: on_page(panels, len(panels), 560)},  # in one row, 560 px high
        data=Table([*names, COLLIDED], [[f"{value:g}" for value in row] for row in trials], TRIALS),
        least_width=MAP_WIDTH * len(panels) if len(panels) > 1 else 300,  # px
    )
    return tuple(folder / name for name in (TRIALS, SUMMARY, PAGE, CHANCES))


def chances_on(boundary: FailureBoundary, share: float) -> FloatArray:
    """Points of one map, each followed by the probability of a collision there, (n, k + 1). An
    impossible point has nan.

    share: of the third parameter's range, at which the map lies; ignored without a third parameter.

    A map has CELLS values of the first parameter by CELLS of the second, if there is a second
    parameter. The first varies fastest from point to point. Parameters after the third are in the
    middle of their ranges.
    """
    logical = boundary.logical
    k = len(logical.parameters)
    ticks = np.linspace(0.0, 1.0, CELLS)
    # points in the unit box: (second parameter, first parameter, k coordinates)
    unit = np.full((CELLS if k > 1 else 1, CELLS, k), 0.5)
    unit[..., 0] = ticks
    if k > 1:
        unit[..., 1] = ticks[:, None]
    if k > 2:
        unit[..., 2] = share
    rows = logical.from_unit(unit.reshape(-1, k))
    chances = np.where(logical.feasible(rows), boundary.search.probability(rows), np.nan)
    return np.column_stack([rows, chances])


def sentences(content: Json) -> Iterator[str]:
    """The result of the search in words; content: its `summary`."""
    change = content["expected_change"]
    shares = content["collision_share_of_space"], content["collision_share_of_exposure"]
    of_space, of_exposure = (
        "an unknown share" if share is None else f"{share:z.1%}" for share in shares
    )
    # without a known exposure both shares are the same number
    weighted = "" if len(set(shares)) == 1 else f" ({of_exposure} of the exposure)"
    yield (
        f"{content['scenario']}: {content['ads']} collides in {of_space} of the space{weighted}, "
        f"from {content['simulations']} simulations."
    )
    ended = f"The search ended ({content['stopped']})."
    if content["stopped"] == "settled":
        yield f"The next round is expected to move {change:z.2%} of the space: settled."
    elif content["stopped"] == "no point left":
        yield ended
    elif change < 1.0:  # 1 stands for unknown
        yield f"{ended} A further round may move {change:z.2%} of the space."
    else:
        yield (
            f"{ended} The change by a further round is unknown: too few rounds saw both outcomes, "
            "or the boundary still contradicts some trials."
        )
    if content["held"]:
        yield f"Held fixed: {point_words(content['held'])}."
    not_evaluated = content["not_evaluated"]
    evaluated = content["simulations"] - sum(not_evaluated.values())
    if content["collisions"] in (0, evaluated):
        yield "Every trial ended alike: these simulations could not find a boundary."
    for status, number in not_evaluated.items():
        yield f"Not evaluated: {number} ({status}). The search continued without them."


def edge_panels(folder: Path) -> tuple[str, list[Panel]]:
    """Title and maps of the probability of a collision, with the trials on them.

    Up to two parameters have one map. More have a map for each value of the third parameter in
    `chances.csv`. A trial is drawn on the map nearest to its own value of the third parameter.

    folder: that `write_boundary` filled.

    Raises InputError where a file is missing or damaged.
    """
    fix = "Search it again."
    with taking_apart(folder / SUMMARY, fix):
        content = json.loads((folder / SUMMARY).read_text("utf-8"))
        title = f"{content['scenario']}: where {content['ads']} collides"
        items = content["parameters"]
        labels = [
            it["name"] + ("" if it["unit"] in ("", "1") else f" ({it['unit']})") for it in items
        ]
        k = len(items)
    tables = []
    for name in (CHANCES, TRIALS):
        with taking_apart(folder / name, fix):
            # no column is required by name: only their number and order count
            tables.append(read_table(folder / name, required=()).to_numpy(float))
            if tables[-1].shape[1] != k + 1:
                raise ValueError(f"it must have {k + 1} columns")
    chances, trials = tables
    # a fault from here on is one of the chances, whose points must form a grid: trials may be any
    with taking_apart(folder / CHANCES, fix):
        chances = chances[np.lexsort(chances[:, :k].T)]  # the first parameter varies fastest
        if k == 1:
            # One parameter has a strip as map. The strip's second axis has no name; the chances are
            # the same at its ends, -1 and 1, and the trials lie at 0.
            labels.append("")
            trials = np.insert(trials, 1, 0.0, axis=1)
            chances = np.vstack([np.insert(chances, 1, y, axis=1) for y in (-1.0, 1.0)])
        # values of the third parameter; without one all are 0, which makes one map
        third, third_of_trials = (
            rows[:, 2] if k > 2 else np.zeros(len(rows)) for rows in (chances, trials)
        )
        # a new map begins where the third parameter changes
        maps = np.split(chances, np.flatnonzero(np.diff(third)) + 1)
        # index of each trial's map, (trials,)
        nearest = np.argmin(np.abs(third_of_trials[:, None] - np.unique(third)), axis=1)
        panels = [
            _edge_panel(rows, trials[nearest == number], items, labels)
            for number, rows in enumerate(maps)
        ]
        return title, panels


def _edge_panel(
    rows: FloatArray, trials: FloatArray, items: Sequence[Json], labels: Sequence[str]
) -> Panel:
    """One map with its trials.

    rows: of the map, as in `chances.csv`.
    trials: on the map, as in `trials.csv`.
    items: the parameters.
    labels: of the map's axes.
    """
    x, y = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    marks = []
    for collided, words, marker in ((0, "no collision", "o"), (1, "collision", "X")):
        at = trials[trials[:, -1] == collided]
        marks.append(Marks(words, at[:, 0], at[:, 1], COLOURS[collided], marker=marker))
    fixed = zip(items[2:], rows[0, 2 : len(items)], strict=True)
    title = ", ".join(f"{it['name']} = {value:z.3g}" for it, value in fixed)
    chance = x, y, rows[:, -1].reshape(len(y), len(x))
    return Panel(marks, labels[0], labels[1], title, chance=chance)
