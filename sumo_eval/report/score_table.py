"""The scores as text: a first table that fits the terminal, and with `--all` every other number in
tables below it.

Users: `cli/finish.py`, `report/notebook.py`.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby

import click

from sumo_eval.report.words import interval_words, number, one_line
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import SCORES

AVOIDABLE, S_PLUS = "avoidable\nof all\ncollisions", "S+ (95 %)"
FIRST = AVOIDABLE, "T", "A'", "H", S_PLUS, "S"
"""Headings of the first table, after the ADS and the scenario."""
BY_IMPORTANCE = S_PLUS, AVOIDABLE, "T", "A'", "H", "S"
"""The same headings by importance: a terminal with room for one column has the first."""
FAULTS = (
    "caused\ncollisions",
    "collided in\nsafe zone",
    "left\nthe road",
    "gave\nup",
    "not\nevaluated",
)
MORE = (
    "cases", "unavoidable\ncollisions", *FAULTS, "T (95 %)", "A' (95 %)", "A (95 %)", "H (95 %)",
    "C (95 %)", "D (95 %)", "S (95 %)"
)  # fmt: skip
"""Headings of the tables that `--all` adds."""
BAD = frozenset((AVOIDABLE, *FAULTS))
"""Headings of counts that are red unless they are 0."""
WIDTH = 100
"""Characters of a line where the output goes to no terminal."""
LONGEST_NAME = 24
"""A column is left out only where it does not fit beside ADS names of this many characters."""
SHORTEST_NAME = 8
"""Least characters of a name, even if they make a line too long."""
GAP = "  "
LEGEND = (
    "Avoidable: the ideal vehicle has no collision there. T: share of the driving task done. A': "
    "grade of the avoidable harm, 1 as the ideal vehicle, 0 as doing nothing. H: human-likeness, 0 "
    "to 1. S+ = T A' (a + b H), of 100 points. S: the paper's score."
)

Row = tuple[str, str, Mapping[str, str]]
"""ADS, scenario, and a cell for each heading."""


def score_lines(evaluation: Evaluation, width: int = WIDTH, everything: bool = False) -> list[str]:
    """The lines of the tables, a row an ADS and scenario; none is wrapped.

    width: characters of the terminal. A row is longer where not even one column fits, and the
        sentence on the columns left out may be longer.
    everything: whether the tables of `MORE` follow.
    """
    rows = [(one_line(score.ads), score.scenario, cells_of(score)) for score in evaluation.scores]
    lines, left_out = _first(rows, width)
    if everything:
        for columns in _parts(rows, (*left_out, *MORE), width):
            lines += ["", *_fitting(rows, columns, width)]
    elif left_out:
        names = ", ".join(heading.replace("\n", " ") for heading in left_out)
        lines.append(f"Not shown for want of room: {names}; `--all` prints them.")
    return lines


def cells_of(score: ScenarioResult) -> dict[str, str]:
    """The cell of every heading."""
    scores = {
        heading: _score(score, heading)
        for heading in (*FIRST, *MORE)
        if heading.partition(" (")[0] in SCORES
    }
    return {
        AVOIDABLE: f"{score.avoidable_collisions} of {score.collisions}",
        "cases": str(score.cases),
        "unavoidable\ncollisions": str(score.unavoidable_collisions),
        "caused\ncollisions": str(score.caused_collisions),
        "collided in\nsafe zone": str(score.safe_collisions),
        "left\nthe road": str(score.departures),
        "gave\nup": str(score.gave_up),
        "not\nevaluated": str(score.not_evaluated),
        **scores,
    }


def _score(score: ScenarioResult, heading: str) -> str:
    """A score in its digits, behind it the interval where the heading has one."""
    name, _, wants_interval = heading.partition(" (")
    field, digits = SCORES[name]
    interval = interval_words(getattr(score, f"{field}_interval"), digits) if wants_interval else ""
    return number(getattr(score, field), digits) + (f" ({interval})" if interval else "")


def _first(rows: Sequence[Row], width: int) -> tuple[list[str], tuple[str, ...]]:
    """The first table with as many columns as fit, at least one, and the headings that do not."""
    for most in range(len(FIRST), 0, -1):
        columns = [heading for heading in FIRST if heading in BY_IMPORTANCE[:most]]
        if _least_width(rows, columns) <= width:
            break
    left_out = tuple(heading for heading in FIRST if heading not in columns)
    return list(_fitting(rows, columns, width)), left_out


def _parts(rows: Sequence[Row], headings: Sequence[str], width: int) -> list[list[str]]:
    """Headings in their order, as many to a table as fit."""
    tables: list[list[str]] = [[]]
    for heading in headings:
        if tables[-1] and _least_width(rows, [*tables[-1], heading]) > width:
            tables.append([])
        tables[-1].append(heading)
    return tables


def _least_width(rows: Sequence[Row], columns: Sequence[str]) -> int:
    """Characters of the narrowest table of these columns: scenarios above their rows, long names
    shortened.
    """
    longest = min(LONGEST_NAME, max(len("ADS"), *(len(ads) for ads, _, _ in rows)))
    return longest + sum(len(GAP) + column for column in _widths(rows, columns))


def _widths(rows: Sequence[Row], columns: Sequence[str]) -> list[int]:
    headings = [max(map(len, heading.split("\n"))) for heading in columns]
    cells = [max(len(cells[heading]) for _, _, cells in rows) for heading in columns]
    return list(map(max, headings, cells))


def _fitting(rows: Sequence[Row], columns: Sequence[str], width: int) -> Iterator[str]:
    """A table of these columns: names whole and scenarios in a column of their own, as far as there
    is room.

    rows: those of one scenario follow each other.
    """
    widths = _widths(rows, columns)
    room = width - sum(len(GAP) + column for column in widths)
    ads = max(len("ADS"), *(len(name) for name, _, _ in rows))
    scenario = max(len("scenario"), *(len(name) for _, name, _ in rows))
    whole = ads + len(GAP) + scenario <= room
    # one column of names: scenarios stand above their rows
    names = [ads, scenario] if whole else [min(ads, max(room, SHORTEST_NAME))]
    yield from _heading(columns, widths, names)
    for name, own in groupby(rows, key=lambda row: "" if whole else row[1]):
        if name:
            yield click.style(_shortened(name, width), bold=True)
        yield from _body(own, columns, widths, names)


def _heading(columns: Sequence[str], widths: Sequence[int], names: Sequence[int]) -> Iterator[str]:
    """The lines above a table.

    widths: characters of its columns.
    names: characters of the ADS's column, and of the scenario's where it has one.
    """
    depth = max(heading.count("\n") + 1 for heading in columns)
    # empty lines above the shorter headings
    heads = [
        [""] * (depth - 1 - heading.count("\n")) + heading.split("\n")
        for heading in ("ADS", "scenario")[: len(names)] + tuple(columns)
    ]
    for words in zip(*heads, strict=True):
        own = map(str.ljust, words, names)
        yield GAP.join((*own, *map(str.rjust, words[len(names) :], widths))).rstrip()


def _body(
    rows: Iterable[Row], columns: Sequence[str], widths: Sequence[int], names: Sequence[int]
) -> Iterator[str]:
    for *named, cells in rows:
        own = [  # the ADS alone where `names` has no width for the scenario
            _shortened(str(name), size).ljust(size)
            for name, size in zip(named, names, strict=False)
        ]
        shown = [
            _styled(cells[heading], heading, size)
            for heading, size in zip(columns, widths, strict=True)
        ]
        yield GAP.join(own + shown)


def _styled(cell: str, heading: str, size: int) -> str:
    """A cell at its width: bold for S+ and S, red for what must be looked into.

    cell: of a heading in `BAD` a count, `2` or `2 of 5`.
    """
    text = cell.rjust(size)
    if heading in BAD and not cell.startswith("0"):
        return click.style(text, fg="red")
    return click.style(text, bold=True) if heading in (S_PLUS, "S") else text


def _shortened(name: str, size: int) -> str:
    """A name of at most `size` characters: its start and its end."""
    if len(name) <= size:
        return name
    begin = size // 2
    return f"{name[:begin]}…{name[begin + 1 - size :]}"  # the … takes one
