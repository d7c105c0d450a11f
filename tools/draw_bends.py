"""Draw the shipped scenarios on bends and with moves of their own, or check that the drawings are up to date.

    python tools/draw_bends.py [--check]

Each is drawn from above, to scale, at its central point: road and vehicles as they start, and where each of them would
be a few seconds later if nobody reacted. Where moves wait for a condition, the times are those around the first one.
"""

from __future__ import annotations

import sys

import numpy as np
from pictures import write_or_check

from sumo_eval.scenario.bodies import VULNERABLE
from sumo_eval.scenario.catalogue import SCENARIOS
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.scenario.sampling.samples import central_point
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import VehicleSettings
from sumo_eval.trajectory import FloatArray

WIDTH = 900.0  # px
LATER = (0.0, 1.5, 3.0)  # s
EGO, OTHER, ON_FOOT = "#0072b2", "#b26a00", "#a3174e"
LOOK = 0.05  # s between two places of a vehicle whose moves depend on what happens
AHEAD = 110.0  # m ahead of the ego that are drawn at most where such moves are


def drawings() -> dict[str, str]:
    """The drawing of every shipped scenario with a bend or a condition, by file name."""
    found = {}
    for logical in SCENARIOS.values():
        concrete = logical.concretes(central_point(logical)[None])[0]
        if not logical.road.shaped and (logical.road.bent or concrete.lively or concrete.ego.lateral_speed):
            found[f"{logical.name}.svg"] = drawing(concrete)
    return found


def drawing(concrete: ConcreteScenario) -> str:
    """One scenario as SVG."""
    road = concrete.road
    body = concrete.ego_vehicle(VehicleSettings())
    times, ways, turns = _places(concrete)
    boxes = []
    sizes = [(body.length, body.width), *((actor.length, actor.width) for actor in concrete.actors)]
    for k in range(len(times)):
        fade = 1.5 * k
        for j, (length, width) in enumerate(sizes):
            on_foot = j > 0 and concrete.actors[j - 1].body in VULNERABLE
            colour = EGO if j == 0 else ON_FOOT if on_foot else OTHER
            if on_foot:  # as large as can be seen
                length, width = max(length, 0.6), max(width, 0.6)
            x, y = ways[j][k]
            boxes.append(_box(road, x, y, length, width, colour, fade, turns[j][k]))
    first, last = ways[0][0][0] - 15.0, max(way[-1][0] for way in ways[1:]) + 25.0
    if concrete.lively:
        first, last = min(first, min(way[0][0] for way in ways[1:]) - 10.0), max(last, ways[0][-1][0] + 10.0)
        first, last = max(first, ways[0][0][0] - 60.0), min(last, ways[0][0][0] + AHEAD)
        boxes = [box for box in boxes if first - 20.0 < box[0][:, 0].min() and box[0][:, 0].max() < last + 20.0]
    corners = np.concatenate([points for points, _ in boxes])
    ends = [first, last]
    s = np.linspace(ends[0], ends[1], 121)
    edges = [_line(road, s, y) for y in (road.right_edge, road.left_edge)]
    drawn = np.concatenate([*edges, corners])
    low, high = drawn.min(axis=0) - 2.0, drawn.max(axis=0) + 2.0
    scale = WIDTH / (high[0] - low[0])

    def at(points: FloatArray) -> str:
        shown = np.stack([(points[:, 0] - low[0]) * scale, (high[1] - points[:, 1]) * scale], axis=1)
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in shown)

    height = (high[1] - low[1]) * scale + 24.0  # px, with a line of words
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height:.0f}" role="img">',
        f"<title>{concrete.scenario}: {concrete.label}</title>",
        f'<polygon points="{at(np.concatenate([edges[0], edges[1][::-1]]))}" fill="#d9dde1"/>',
    ]
    parts += [f'<polyline points="{at(edge)}" fill="none" stroke="#57606a" stroke-width="2"/>' for edge in edges]
    for lane in range(1, road.lanes):
        between = _line(road, s, road.right_edge + lane * road.lane_width)
        parts.append(
            f'<polyline points="{at(between)}" fill="none" stroke="#fff" stroke-width="2" stroke-dasharray="14 20"/>'
        )
    parts += [f'<polygon points="{at(points)}" {style}/>' for points, style in boxes]
    when = f"{times[0]:g}, {times[1]:g} and {times[2]:g} s"
    words = f"blue: the ego, orange: vehicles, red: people, at {when} if nobody reacts ({concrete.label})"
    if not concrete.lively:
        words = f"blue: the ego, orange: the others, at {when} if nobody reacts ({concrete.label})"
    parts.append(f'<text x="8" y="{height - 8:.0f}" font-family="sans-serif" font-size="13">{words}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _places(
    concrete: ConcreteScenario,
) -> tuple[list[float], list[list[tuple[float, float]]], list[list[float]]]:
    """Times, s, and places and headings of the ego and of every other one at them, in the road's frame."""
    ego, body = concrete.ego, concrete.ego_vehicle(VehicleSettings())
    if not concrete.lively:
        straight = [[(ego.x + ego.speed * t, ego.y + ego.lateral_speed * t) for t in LATER]]
        straight += [[(actor.x(t), actor.y(t)) for t in LATER] for actor in concrete.actors]
        return list(LATER), straight, [[ego.heading] * 3, *([0.0] * 3 for _ in concrete.actors)]
    found = tracks([concrete], [(body.length, body.width)], LOOK, concrete.time_limit or 30.0)
    begin = min((float(it) for it in found.begins[0] if np.isfinite(it)), default=0.0)
    times = [round(begin + later, 1) for later in LATER]
    rows = [min(round(time / LOOK), found.egos.shape[1] - 1) for time in times]
    everybody = [found.egos[0], *found.others[0]]
    ways = [[(float(way[k, 0]), float(way[k, 1])) for k in rows] for way in everybody]
    return times, ways, [[float(way[k, 2]) for k in rows] for way in everybody]


def _line(road: Road, s: FloatArray, d: float) -> FloatArray:
    x, y, _ = map_places(road.line, s, d)
    return np.stack([x, y], axis=1)


def _box(
    road: Road, s: float, d: float, length: float, width: float, colour: str, time: float, turn: float
) -> tuple[FloatArray, str]:
    """Corners on the map, (4, 2) m, and how the body is painted."""
    x, y, heading = (float(it) for it in map_places(road.line, s, d, turn))
    ahead, left = np.array([1, 1, -1, -1]) * length / 2, np.array([1, -1, -1, 1]) * width / 2
    points = np.stack(
        [x + ahead * np.cos(heading) - left * np.sin(heading), y + ahead * np.sin(heading) + left * np.cos(heading)], 1
    )
    return points, f'fill="{colour}" fill-opacity="{1.0 - 0.28 * time:.2f}" stroke="{colour}"'


if __name__ == "__main__":
    sys.exit(write_or_check(drawings(), __file__, __doc__ or ""))
