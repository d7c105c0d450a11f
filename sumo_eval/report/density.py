"""Pictures of where all cases of an ADS lie, for a page that does not hold them all.

Users: `report/html.py`.
"""

import json

import numpy as np
from markupsafe import Markup

from sumo_eval.case_table import CaseTable
from sumo_eval.report.words import percent
from sumo_eval.scenario.logical import LogicalScenario, Parameter
from sumo_eval.scoring.map_view import tile_counts
from sumo_eval.trajectory import FloatArray

TILES = 40  # on each axis
_SIDE = 6  # of a tile, px
_FAINTEST = 0.12  # opacity of the faintest tile


def density_maps(
    logical: LogicalScenario, cases: CaseTable, x: int, y: int
) -> list[tuple[str, Markup]]:
    """Captions and pictures of all cases of an ADS over two parameters: number in each tile, and
    share that collided.

    x, y: columns of the parameters.
    """
    across, up = (logical.parameters[column] for column in (x, y))
    number, share = tile_counts((across, up), cases, TILES)
    axes = " against ".join(
        f"{item.name} ({item.low:g} to {item.high:g}{item.unit_suffix})" for item in (up, across)
    )
    most = int(number.max(initial=0))
    return [
        (
            f"how many cases, up to {most:,} in a tile; {axes}",
            _tiles(number / max(most, 1), number, "--c", f"number of cases, {axes}", (across, up)),
        ),
        (
            f"share of them that collided, up to {percent(share.max(initial=0.0))}; {axes}",
            _tiles(share, share, "--hit", f"share that collided, {axes}", (across, up)),
        ),
    ]


def _tiles(
    shade: FloatArray,
    values: FloatArray,
    colour: str,
    words: str,
    axes: tuple[Parameter, Parameter],
) -> Markup:
    """A square for each tile with a shade above 0.

    shade: 0..1, of each tile.
    values: of each tile, saved beside its middle in the chart's table.
    colour: name of a colour in templates/report.css.
    words: label; the text before its first comma heads the values.
    """
    size = TILES * _SIDE
    middle = [
        [item.low + (item.high - item.low) * (k + 0.5) / TILES for k in range(TILES)]
        for item in axes
    ]
    squares = [
        Markup(
            '<rect x="{}" y="{}" width="{}" height="{}" fill="var({})" fill-opacity="{:z.2f}" '
            'data-row="[{:z.6g},{:z.6g},{:z.4g}]"/>'
        ).format(
            index % TILES * _SIDE,
            size - _SIDE - index // TILES * _SIDE,
            _SIDE,
            _SIDE,
            colour,
            _FAINTEST + (1.0 - _FAINTEST) * float(shade[index]),
            middle[0][index % TILES],
            middle[1][index // TILES],
            values[index],
        )
        for index in np.flatnonzero(shade > 0.0).tolist()
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
        Markup().join(squares),
    )
