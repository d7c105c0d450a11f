"""Draw the shipped scenarios on roads whose lanes open, end or cross, or check that the drawings are up to date.

    python tools/draw_shapes.py [--check]

Each is drawn from above, to scale, at its central point: the road, and the vehicles at three times around the one at
which the first of the others begins to do something, if nobody reacts: the ego then keeps its speed on its way.
"""

from __future__ import annotations

import sys

import numpy as np
from pictures import write_or_check

from sumo_eval.report.page_data import drawn_shape
from sumo_eval.scenario.catalogue import SCENARIOS
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.sampling.samples import central_point
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import VehicleSettings

WIDTH = 900.0  # px
LATER = (0.0, 2.0, 4.0)  # s after the first move
LOOK = 0.05  # s between two places of a vehicle
EGO, OTHER, ROAD, GRASS, LINE = "#0072b2", "#b26a00", "#d9dde1", "#f5f7f9", "#57606a"

Points = list[tuple[float, float]]


def drawings() -> dict[str, str]:
    """The drawing of every shipped scenario on such a road, by file name."""
    return {
        f"{logical.name}.svg": drawing(logical.concretes(central_point(logical)[None])[0])
        for logical in SCENARIOS.values()
        if logical.road.shaped
    }


def drawing(concrete: ConcreteScenario) -> str:
    """One scenario as SVG."""
    road, body = concrete.road, concrete.ego_vehicle(VehicleSettings())
    found = tracks([concrete], [(body.length, body.width)], LOOK, concrete.time_limit or 40.0)
    begin = float(min(found.begins[0].min(), 20.0)) if not road.crossings else 4.0
    rows = [min(round((begin + later) / LOOK), found.egos.shape[1] - 1) for later in LATER]
    boxes: list[tuple[Points, str]] = []
    for time, k in zip(LATER, rows, strict=True):
        x = concrete.ego.x + concrete.ego.speed * k * LOOK
        y, ahead = concrete.ego.y_at(np.array([x, x + 0.01])).tolist()
        boxes.append((_box(x, y, float(np.arctan2(ahead - y, 0.01)), body.length, body.width), _paint(EGO, time)))
        for j, actor in enumerate(concrete.actors):
            x, y, heading = found.others[0, j, k, :3].tolist()
            boxes.append((_box(x, y, heading, actor.length, actor.width), _paint(OTHER, time)))
    xs = [concrete.ego.x + concrete.ego.speed * k * LOOK for k in rows]
    left, right = min(xs) - 40.0, max(xs) + 60.0
    if road.crossings:
        left, right = road.crossings[0].at - 70.0, road.crossings[0].at + 40.0
    boxes = [box for box in boxes if left - 5.0 < box[0][0][0] < right + 5.0 and abs(box[0][0][1]) < 40.0]
    reach = 25.0 if road.crossings else 0.0
    low, high = min(road.right_edge, -reach) - 2.0, max(road.left_edge, reach) + 2.0
    scale = WIDTH / (right - left)

    def at(points: Points) -> str:
        return " ".join(f"{(x - left) * scale:.1f},{(high - y) * scale:.1f}" for x, y in points)

    def rectangle(x0: float, x1: float, y0: float, y1: float, paint: str) -> str:
        return f'<polygon points="{at([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])}" fill="{paint}"/>'

    def line(points: Points, paint: str, more: str = "") -> str:
        return f'<polyline points="{at(points)}" fill="none" stroke="{paint}" stroke-width="2"{more}/>'

    height = (high - low) * scale + 24.0  # px, with a line of words
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height:.0f}" role="img">',
        f"<title>{concrete.scenario}: {concrete.label}</title>",
        f'<rect width="{WIDTH:g}" height="{height:.0f}" fill="{GRASS}"/>',
    ]
    parts += [rectangle(it.at - it.width / 2, it.at + it.width / 2, low, high, ROAD) for it in road.crossings]
    parts.append(rectangle(left, right, road.right_edge, road.left_edge, ROAD))
    parts += [line([(left, y), (right, y)], LINE) for y in (road.right_edge, road.left_edge)]
    for lane in range(1, road.lanes):
        y = road.right_edge + lane * road.lane_width
        parts.append(line([(left, y), (right, y)], "#fff", ' stroke-dasharray="14 20"'))
    shape = drawn_shape(road)
    parts += [line([(x0, y), (x1, y)], "#fff") for x0, x1, y in shape["solid"]]
    for gone in shape["gone"]:
        outwards = -0.5 if gone[0][1] < gone[1][1] else 0.5
        corners = [(gone[0][0], gone[0][1] + outwards), *map(tuple, gone[1:3]), (gone[3][0], gone[3][1] + outwards)]
        parts += [f'<polygon points="{at(corners)}" fill="{GRASS}"/>', line([tuple(it) for it in gone[1:]], LINE)]
    parts += [rectangle(it.at - it.width / 2, it.at + it.width / 2, road.right_edge, road.left_edge, ROAD)
              for it in road.crossings]  # fmt: skip
    parts += [f'<polygon points="{at(points)}" {paint}/>' for points, paint in boxes]
    times = ", ".join(f"{begin + later:.1f}" for later in LATER)
    words = f"blue: the ego, orange: the others, at {times} s if nobody reacts ({concrete.label})"
    parts.append(f'<text x="8" y="{height - 8:.0f}" font-family="sans-serif" font-size="12">{words}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _box(x: float, y: float, heading: float, length: float, width: float) -> Points:
    c, s = float(np.cos(heading)), float(np.sin(heading))
    corners = [(length / 2, width / 2), (length / 2, -width / 2), (-length / 2, -width / 2), (-length / 2, width / 2)]
    return [(x + a * c - b * s, y + a * s + b * c) for a, b in corners]


def _paint(colour: str, time: float) -> str:
    return f'fill="{colour}" fill-opacity="{1.0 - 0.2 * time:.2f}" stroke="{colour}"'


if __name__ == "__main__":
    sys.exit(write_or_check(drawings(), __file__, __doc__ or ""))
