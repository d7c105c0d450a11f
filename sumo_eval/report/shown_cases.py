"""Which cases a page has where a run has more than a page can hold, and where all of them lie:
density and shares.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from sumo_eval.cases import CaseResult, CaseTable
from sumo_eval.results import Evaluation
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.trajectory import FloatArray

# cases that the page has, of all ADSs and scenarios together: with more it would be over 10 MB
MOST_SHOWN = 5_000
TILES = 40  # on each axis
_SIDE = 6  # of a tile, px
# a case of a failed limit, not evaluated, collided; others at most 1
_NAMED, _LOST, _HIT = 5.0, 4.0, 2.0
_FAINTEST = 0.12  # how dark a tile is that holds the least

IntArray = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """Which cases of a scenario the page has.

    places: of each ADS's cases, in their order; None: all.
    of: how many there are.
    """

    places: IntArray | None
    of: int

    def among(self, cases: CaseTable) -> Iterator[tuple[int, CaseResult]]:
        """Those of one ADS, each with its place among all of them."""
        places = range(len(cases)) if self.places is None else self.places.tolist()
        return ((place, cases[place]) for place in places if place < len(cases))

    def number(self, cases: CaseTable) -> int:
        """How many of one ADS's there are."""
        return (
            len(cases) if self.places is None else int(np.count_nonzero(self.places < len(cases)))
        )


def shown_cases(evaluation: Evaluation, named: Collection[str] = ()) -> dict[str, Shown]:
    """By scenario.

    Half of those that the page has tell most: not evaluated, collisions by U, the least human-like;
    the other half lie evenly among the rest. The ADSs of a scenario are shown at the same points.

    named: cases of failed limits, which tell more than all others.
    """
    every = {zone.scenario: evaluation.scores_in(zone.scenario) for zone in evaluation.zones}
    numbers = {
        name: sum(len(evaluation.cases_of(one.ads, name)) for one in scores)
        for name, scores in every.items()
    }
    if sum(numbers.values()) <= MOST_SHOWN:
        return {name: Shown(None, number) for name, number in numbers.items()}
    quota = max(MOST_SHOWN // max(len(evaluation.scores), 1), 2)
    found = {}
    for name, scores in every.items():
        told = [_telling(evaluation.cases_of(one.ads, name), named) for one in scores]
        tells = np.zeros(max(map(len, told), default=0))
        for one in told:
            tells[: len(one)] = np.maximum(tells[: len(one)], one)
        if len(tells) <= quota:
            found[name] = Shown(None, numbers[name])
            continue
        order = np.argsort(-tells, kind="stable")
        most, rest = order[: quota // 2], np.sort(order[quota // 2 :])
        evenly = rest[np.arange(quota - quota // 2) * len(rest) // (quota - quota // 2)]
        found[name] = Shown(np.sort(np.concatenate([most, evenly])), numbers[name])
    return found


def _telling(cases: CaseTable, named: Collection[str]) -> FloatArray:
    """How much each case tells, (n,)."""
    collided, severity = cases.collided, np.nan_to_num(cases.severity)
    tells = np.nan_to_num(1.0 - cases.human_likeness)
    tells[collided] = _HIT + severity[collided] / max(float(severity.max(initial=0.0)), 1.0)
    tells = np.where(cases.evaluated, tells, _LOST)
    if named:
        tells[[name in named for name in cases.case.tolist()]] = _NAMED
    return tells


def density_maps(
    logical: LogicalScenario, cases: CaseTable, x: int, y: int
) -> list[tuple[str, Markup]]:
    """Pictures of where all cases of an ADS lie in two parameters, with what each shows: how many
    there are in each part of the plane, and which share of them collided.

    x, y: columns of the parameters.
    """
    across, up = (logical.parameters[column] for column in (x, y))
    tile = []
    for item, values in zip((across, up), cases.parameters([across.name, up.name]).T, strict=True):
        share = (values - item.low) / (item.high - item.low)
        tile.append(np.clip((share * TILES).astype(np.intp), 0, TILES - 1))
    place = tile[1] * TILES + tile[0]
    number = np.bincount(place, minlength=TILES * TILES)
    hits = np.bincount(place, cases.collided, TILES * TILES)
    share = np.divide(hits, number, out=np.zeros(len(hits)), where=number > 0)
    axes = " against ".join(
        f"{item.name} ({item.low:g} to {item.high:g}{item.behind})" for item in (up, across)
    )
    most = int(number.max(initial=0))
    return [
        (
            f"how many cases, up to {most:,} in a tile; {axes}",
            _tiles(
                number / max(most, 1),
                number,
                number,
                "--c",
                f"number of cases, {axes}",
                (across, up),
            ),
        ),
        (
            f"share of them that collided, up to {share.max(initial=0.0):z.0%}; {axes}",
            _tiles(share, hits, share, "--hit", f"share that collided, {axes}", (across, up)),
        ),
    ]


def _tiles(
    shade: FloatArray,
    number: FloatArray | IntArray,
    said: FloatArray | IntArray,
    colour: str,
    words: str,
    axes: tuple[Parameter, Parameter],
) -> Markup:
    """A square for each tile with something in it, which carries its middle and what it says for
    the saved table.
    """
    size = TILES * _SIDE
    middle = [
        [item.low + (item.high - item.low) * (k + 0.5) / TILES for k in range(TILES)]
        for item in axes
    ]
    made = [
        Markup(
            '<rect x="{}" y="{}" width="{}" height="{}" fill="var({})" fill-opacity="{:z.2f}" '
            'data-row="[{:z.6g},{:z.6g},{:z.4g}]"/>'
        ).format(
            place % TILES * _SIDE,
            size - _SIDE - place // TILES * _SIDE,
            _SIDE,
            _SIDE,
            colour,
            _FAINTEST + (1.0 - _FAINTEST) * float(shade[place]),
            middle[0][place % TILES],
            middle[1][place // TILES],
            said[place],
        )
        for place in np.flatnonzero(number > 0).tolist()
    ]
    return Markup(
        '<svg class="density" data-chart="{}" data-head="{}" role="img" aria-label="{}" '
        'viewBox="0 0 {} {}">{}</svg>'
    ).format(
        words,
        json.dumps([*(item.name for item in axes), words.partition(",")[0]]),
        words,
        size,
        size,
        Markup().join(made),
    )
