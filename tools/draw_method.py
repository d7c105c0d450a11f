"""Draw the figures of the formulas' page from the functions that compute them, or check that they
are up to date.

    python tools/draw_method.py [--check]

Each curve is what a function of `sumo_eval.method` gives for the values on its axis.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from sumo_eval.method.collision_avoidance import collision_loss
from sumo_eval.method.criticality import critical_gap, required_gap
from sumo_eval.method.index_terms import gaussian_similarity
from sumo_eval.method.trajectory_field import trajectory_field
from sumo_eval.trajectory import FloatArray, Trajectory

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
WIDTH, HEIGHT = 560.0, 260.0  # px
LEFT, RIGHT, TOP, BOTTOM = 56.0, 16.0, 14.0, 44.0  # px around the axes
COLOURS, DASHES = ("#0072b2", "#b34700", "#007a59", "#8f3f75"), ("", "7 4", "2 3", "9 3 2 3")
INK, GRID = "#1b1f24", "#d5dbe0"


@dataclass(frozen=True)
class Curve:
    """A named line.

    at: where its name begins, in the units of both axes.
    """

    name: str
    x: FloatArray
    y: FloatArray
    at: tuple[float, float]


@dataclass(frozen=True)
class Chart:
    """Lines over an axis.

    x, y: what is on the axes, with its unit;
    ends: x from, x to, y from, y to.
    """

    about: str
    x: str
    y: str
    ends: tuple[float, float, float, float]
    steps: tuple[float, float]
    curves: Sequence[Curve]


def charts() -> dict[str, Chart]:
    """The figures by file name."""
    closing = np.linspace(0.0, 30.0, 121)
    away = np.linspace(-80.0, 80.0, 321)
    places = np.column_stack([away, np.zeros(len(away))])
    deviations = np.linspace(-5.0, 5.0, 201)
    severity = np.linspace(0.0, 20.0, 401)
    fields = [
        Curve(
            f"{speed:g} m/s",
            away,
            trajectory_field(places, Trajectory([0.0], [0.0], [0.0], heading=[0.0], speed=[speed])),
            at,
        )
        for speed, at in ((10.0, (-42.0, 0.3)), (40.0, (14.0, 0.42)))
    ]
    return {
        "method_criticality.svg": Chart(
            "Gap to an obstacle over the speed at which the ego closes in on it: braking with 5 "
            "m/s2 hits below the "
            "lower line; between the lines the case is hazardous; above the upper line it is safe.",
            "relative speed, m/s", "gap, m", (0.0, 30.0, 0.0, 140.0), (5.0, 20.0),
            [
                Curve("largest ITTC is 0.7 1/s", closing, critical_gap(closing), (12.5, 56.0)),
                Curve("ideal braking just "
                      "avoids", closing, required_gap(closing, deceleration=5.0), (19.0, 18.0)),
            ],
        ),
        "method_field.svg": Chart(
            "The field of one moment ahead of a vehicle (right) and behind it (left), at two "
            "speeds.",
            "distance ahead, m", "s", (-80.0, 80.0, 0.0, 1.3), (20.0, 0.2), fields,
        ),
        "method_similarity.svg": Chart(
            "How alike a value is to the drivers', over how many of their standard deviations it "
            "lies from their mean: "
            "1 within two deviations.",
            "deviations from the mean", "similarity", (-5.0, 5.0, 0.0, 1.1), (1.0, 0.2),
            [Curve("Eq. 11", deviations, gaussian_similarity(deviations, 0.0, 1.0), (2.7, 0.5))],
        ),
        "method_loss.svg": Chart(
            "Loss of a collision over its severity: four classes.",
            "severity U, m/s", "loss L", (0.0, 20.0, 0.0, 1.1), (2.0, 0.2),
            [Curve("Eq. 14", severity, np.array(collision_loss(severity)), (10.0, 0.75))],
        ),
    }  # fmt: skip


def drawing(chart: Chart) -> str:
    """A chart as SVG."""
    x0, x1, y0, y1 = chart.ends
    wide, high = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def across(x: float) -> float:
        return LEFT + (x - x0) / (x1 - x0) * wide

    def up(y: float) -> float:
        return TOP + (y1 - y) / (y1 - y0) * high

    parts = [f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" fill="#fff"/>']
    for x in np.arange(x0, x1 + 1e-9, chart.steps[0]):
        parts.append(f'<path d="M{across(x):.1f} {TOP:g}V{TOP + high:g}" stroke="{GRID}"/>')
        parts.append(
            f'<text x="{across(x):.1f}" y="{TOP + high + 16:g}" text-anchor="middle">{x:g}</text>'
        )
    for y in np.arange(y0, y1 + 1e-9, chart.steps[1]):
        parts.append(f'<path d="M{LEFT:g} {up(y):.1f}H{LEFT + wide:g}" stroke="{GRID}"/>')
        parts.append(
            f'<text x="{LEFT - 6:g}" y="{up(y) + 4:.1f}" text-anchor="end">{round(y, 9):g}</text>'
        )
    parts.append(
        f'<text x="{LEFT + wide / 2:g}" y="{HEIGHT - 8:g}" '
        f'text-anchor="middle">{escape(chart.x)}</text>'
    )
    middle = TOP + high / 2
    parts.append(
        f'<text x="14" y="{middle:g}" text-anchor="middle" transform="rotate(-90 14 '
        f'{middle:g})">{chart.y}</text>'
    )
    for number, curve in enumerate(chart.curves):
        points = " ".join(
            f"{across(x):.1f},{up(y):.1f}" for x, y in zip(curve.x, curve.y, strict=True) if y <= y1
        )
        colour, dash = (
            COLOURS[number],
            f' stroke-dasharray="{DASHES[number]}"' if DASHES[number] else "",
        )
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>'
        )
        place = f'x="{across(curve.at[0]):.1f}" y="{up(curve.at[1]):.1f}"'
        parts.append(
            f'<text {place} fill="{colour}" font-weight="bold">{escape(curve.name)}</text>'
        )
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        'font-family="sans-serif" font-size="12" '
        f'fill="{INK}">\n<title>{escape(chart.about)}</title>\n{body}\n</svg>\n'
    )


def main() -> int:
    """Write the drawings, or with --check say which of them are stale: exit status 1."""
    check, stale = sys.argv[1:] == ["--check"], 0
    for name, chart in charts().items():
        text = drawing(chart)
        path = FOLDER / name
        if not check:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"docs/pictures/{name} is stale; run tools/draw_method.py.")
            stale = 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
