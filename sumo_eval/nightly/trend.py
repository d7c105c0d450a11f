"""The trend page: every quantity of every ADS over the nights, with the gates, as plain SVG in one
offline file.

Users: `cli/compare.py`, `nightly/night.py`.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import cycle, groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_eval.nightly.history import (
    GATE_FAILED,
    REGRET_OF_LOSSES,
    GateLine,
    History,
    Night,
    QuantityLine,
)
from sumo_eval.report.page import REPORT, Json, write_filled

TREND = "trend.html"
CHARTS = (
    ("collisions", "Collisions", "cases"),
    ("avoidable_collisions", "Avoidable collisions", "cases"),
    ("unavoidable_collisions", "Unavoidable collisions", "cases"),
    ("caused_collisions", "Collisions that the ADS caused", "cases"),
    ("departures", "Left the road", "cases"),
    ("gave_up", "Gave up", "cases"),
    ("near_misses", "Near misses", "cases"),
    ("T", "Share of the driving task T", ""),
    ("A'", "Grade of avoided harm A'", ""),
    ("A", "Avoided share A", ""),
    ("S+", "Score S+", "points"),
    ("H", "Human-likeness H", ""),
    ("regret", "Regret", "m/s"),
    (REGRET_OF_LOSSES, "Regret of losses in 0..1", ""),
    ("C", "Collision avoidance C of the paper", ""),
    ("D", "Human-likeness D of the paper", ""),
    ("S", "Score S of the paper", "points"),
    ("collision_probability", "Collision probability", ""),
    ("not_evaluated", "Not evaluated", "cases"),
    ("run_time", "Run time of the cases", "s"),
)
"""The charts in order, one for each quantity of the history: quantity, title, unit."""
# of ADSs, as variables of the page's style
COLOURS = "var(--c)", "var(--actor)", "var(--d)", "var(--off)", "var(--muted)", "var(--bad)"
# 6 colours and 5 dashes repeat independently: the first 30 ADSs look different
DASHES = "", "7 3", "2 3", "9 3 2 3", "4 4"
# size and margins of a chart, in units of the SVG
WIDTH, HEIGHT = 560, 210
LEFT, RIGHT = 68, 36  # RIGHT: room for half of the last night's date
TOP, BOTTOM = 12, 40
_AXIS = WIDTH - LEFT - RIGHT  # length of the axis of nights
MOST_LABELS = 3  # dates under a chart
TICKS = 5  # approximate number of values on the vertical axis


class Point(NamedTuple):
    """One night on a chart.

    x, y: in units of the SVG, y downwards.
    words: shown while the mouse is over the point.
    row: night, series and value, for the table that can be saved from the page.
    """

    x: float
    y: float
    words: str
    row: tuple[str, str, float]


class TrendLine(NamedTuple):
    """One ADS on a chart.

    parts: runs of consecutive nights with a value, each drawn as one line.
    last: value of the last night, in words.
    """

    ads: str
    colour: str
    dash: str
    parts: tuple[tuple[Point, ...], ...]
    last: str


class TrendChart(NamedTuple):
    """One quantity in one logical scenario.

    gates: for each gate of a night, its limit as a point, and the colour of its ADS.
    ticks: y and label of each value on the vertical axis.
    """

    title: str
    unit: str
    lines: tuple[TrendLine, ...]
    gates: tuple[tuple[Point, str], ...]
    ticks: tuple[tuple[float, str], ...]


def write_trend(folder: Path, database: History) -> Path:
    """Write `trend.html` beside the history and return its path."""
    nights, values, gates = database.in_time(), database.values(), database.gates()
    scenarios = dict.fromkeys(value.scenario for value in values)
    # Nights whose report is still there: the folder of an old one may have been removed. An
    # imported night is a run anywhere on this machine: its link would break in a copy of the
    # history.
    reports = {
        night.night: f"{night.folder}/{REPORT}"
        for night in nights
        if not night.imported and (folder / night.folder / REPORT).is_file()
    }
    return write_filled(
        folder / TREND, "trend.html.j2", "The trend page",
        failed=failed_nights(nights),
        nights=nights[::-1],
        dates={night.night: _date(night.night) for night in nights},
        reports=reports,
        accepted={acceptance.night: acceptance.words for acceptance in database.accepted()},
        builds=database.builds(),
        groups=[(scenario, charts(scenario, nights, values, gates)) for scenario in scenarios],
        labels=_dates(nights),
        # half the width of a gate's stroke, nearly half of a night's part of the axis: strokes of
        # neighbours do not touch
        half=round(0.42 * _step(nights), 2),
        width=WIDTH, height=HEIGHT, left=LEFT, right=WIDTH - RIGHT, top=TOP, bottom=HEIGHT - BOTTOM
    )  # fmt: skip


def failed_nights(nights: Sequence[Night]) -> list[Json]:
    """A bar for each failed night, on every chart: x, width (80 % of a night's), and the reason."""
    step = _step(nights)
    return [
        {
            "x": round(LEFT + step * (index + 0.1), 2),
            "width": round(0.8 * step, 2),
            "words": f"{_date(night.night)} failed: {night.verdict}",
        }
        for index, night in enumerate(nights)
        if night.exit_status == GATE_FAILED
    ]


def charts(
    scenario: str,
    nights: Sequence[Night],
    values: Sequence[QuantityLine],
    gates: Sequence[GateLine],
) -> list[TrendChart]:
    """The charts of one logical scenario; a quantity that was never computed has none.

    Unavoidable collisions have one only with a gate: they are all collisions less the avoidable
    ones, and both of these have a chart.
    """
    of_scenario = [value for value in values if value.scenario == scenario]
    names = list(dict.fromkeys(value.ads for value in of_scenario))
    drawn = []
    for quantity, title, unit in CHARTS:
        series = {
            (value.night, value.ads): value.value
            for value in of_scenario
            if value.quantity == quantity and value.value is not None
        }
        # The regret has two charts, one in m/s and one of losses without unit. Its gates have one
        # name for both: a gate is drawn on the chart that has a value in the gate's night.
        gated = "regret" if quantity == REGRET_OF_LOSSES else quantity
        nights_of_chart = {night for night, _ in series}
        limits = [
            (gate.night, gate.ads, gate.threshold)
            for gate in gates
            if (gate.scenario, gate.quantity) == (scenario, gated)
            and gate.threshold is not None
            and (gated != "regret" or gate.night in nights_of_chart)
        ]
        if series and (limits or quantity != "unavoidable_collisions"):
            drawn.append(_chart(title, unit, names, nights, series, limits))
    return drawn


Series = Mapping[tuple[str, str], float]
"""Values by night and ADS."""


def _step(nights: Sequence[Night]) -> float:
    """Width of a night's part of the axis, in units of the SVG."""
    return _AXIS / max(len(nights), 1)


def _middles(nights: Sequence[Night]) -> dict[str, float]:
    """x by night: the middle of its part of the axis."""
    return {it.night: round(LEFT + _step(nights) * (k + 0.5), 2) for k, it in enumerate(nights)}


class _Axes(NamedTuple):
    """Axes of a chart.

    nights: x of each night, in order.
    ticks: values on the vertical axis, from below.
    """

    nights: Mapping[str, float]
    ticks: list[float]
    unit: str

    def y(self, value: float) -> float:
        """y of a value."""
        share = (value - self.ticks[0]) / (self.ticks[-1] - self.ticks[0])
        return round(HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM), 2)

    def point(self, night: str, name: str, value: float) -> Point:
        """Point of a series by its name."""
        # z: no minus before a 0
        words = f"{name}, {_date(night)}: {value:z.6g} {self.unit}".rstrip()
        return Point(self.nights[night], self.y(value), words, (night, name, value))

    def parts(self, ads: str, series: Series) -> tuple[tuple[Point, ...], ...]:
        """Runs of nights in which an ADS has a value."""
        runs = groupby(self.nights, key=lambda night: (night, ads) in series)
        return tuple(
            tuple(self.point(night, ads, series[night, ads]) for night in run)
            for computed, run in runs
            if computed
        )


def _chart(
    title: str,
    unit: str,
    names: Sequence[str],
    nights: Sequence[Night],
    series: Series,
    limits: Sequence[tuple[str, str, float]],
) -> TrendChart:
    """A chart of one quantity.

    names: of the ADSs, in the order of their colours.
    limits: night, ADS and bound of each gate.
    """
    values = [*series.values(), *(bound for _, _, bound in limits)]
    ticks = _ticks(min(values), max(values), least=1.0 if unit == "cases" else 0.0)
    axes = _Axes(_middles(nights), ticks, unit)
    colours = dict(zip(names, cycle(COLOURS)))
    latest = {
        ads: f"{value:z.4g}" for (night, ads), value in series.items() if night == nights[-1].night
    }
    lines = (
        TrendLine(ads, colour, dash, axes.parts(ads, series), latest.get(ads, "not computed"))
        for (ads, colour), dash in zip(colours.items(), cycle(DASHES))
    )
    gates = (
        (axes.point(night, f"gate of {ads}", limit), colours[ads])
        for night, ads, limit in limits
        if ads in colours
    )
    labels = tuple((axes.y(tick), f"{tick:g}") for tick in ticks)
    return TrendChart(title, unit, tuple(lines), tuple(gates), labels)


def _dates(nights: Sequence[Night]) -> tuple[tuple[float, str], ...]:
    """x and label of at most `MOST_LABELS` nights: every n-th one back from the last.

    Labels are days; if any two nights began on one day, all are month, day and time.
    """
    every = math.ceil(len(nights) / MOST_LABELS) or 1
    repeated = len({night.night[:10] for night in nights}) < len(nights)
    middles = _middles(nights).items()
    return tuple((x, _date(it)[5:] if repeated else it[:10]) for it, x in middles)[::-every]


def _ticks(low: float, high: float, least: float) -> list[float]:
    """Round numbers around a range, at least two of them, at least `least` apart."""
    if max(abs(low), abs(high)) < 1e-9:  # all values 0, up to rounding
        low, high = 0.0, 0.5
    elif high - low < 1e-9 * max(1.0, abs(high)):  # one value: half of it to each side
        pad = 0.5 * abs(high)
        low, high = low - pad, high + pad
    rough = (high - low) / (TICKS - 1)  # between two ticks, before it is made a round number
    magnitude = 10.0 ** math.floor(math.log10(rough))
    steps = magnitude * np.array([1.0, 2.0, 2.5, 5.0, 10.0])
    step = max(least, steps[steps >= rough * 0.999][0])  # 0.1 % covers rounding
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [round(float(value), 12) for value in np.arange(first, last + 1) * step]


def _date(night: str) -> str:
    """A night's name, `2026-11-21T06-30...`, as `2026-11-21 06:30`."""
    day, _, clock = night.partition("T")
    return f"{day} {clock[:5].replace('-', ':')}"
