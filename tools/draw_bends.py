"""Draw the shipped scenarios that play on bends, or check that the drawings in the tree are up to date.

    python tools/draw_bends.py [--check]

Each is drawn from above, to scale, at its central point: road and vehicles as they start, and where each of them would
be a few seconds later if nobody reacted.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from sumo_eval.scenario.catalogue import SCENARIOS
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.scenario.sampling.samples import central_point
from sumo_eval.settings import VehicleSettings
from sumo_eval.trajectory import FloatArray

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
WIDTH = 900.0  # px
LATER = (0.0, 1.5, 3.0)  # s
EGO, OTHER = "#0072b2", "#b26a00"


def drawings() -> dict[str, str]:
    """The drawing of every shipped scenario with a bend, by file name."""
    found = {}
    for logical in SCENARIOS.values():
        if logical.road.bent:
            concrete = logical.concretes(central_point(logical)[None])[0]
            found[f"{logical.name}.svg"] = drawing(concrete)
    return found


def drawing(concrete: ConcreteScenario) -> str:
    """One scenario as SVG."""
    road, ego = concrete.road, concrete.ego
    body = concrete.ego_vehicle(VehicleSettings())
    boxes = []
    for time in LATER:
        boxes.append(_box(road, ego.x + ego.speed * time, ego.y, body.length, body.width, EGO, time))
        for actor in concrete.actors:
            x, y = actor.x(time), actor.y(time)
            boxes.append(_box(road, x, y, actor.length, actor.width, OTHER, time))
    corners = np.concatenate([points for points, _ in boxes])
    ends = [ego.x - 15.0, max(actor.x(LATER[-1]) for actor in concrete.actors) + 25.0]
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
    words = f"blue: the ego, orange: the others, at 0, 1.5 and 3 s if nobody reacts ({concrete.label})"
    parts.append(f'<text x="8" y="{height - 8:.0f}" font-family="sans-serif" font-size="13">{words}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _line(road: Road, s: FloatArray, d: float) -> FloatArray:
    x, y, _ = map_places(road.line, s, d)
    return np.stack([x, y], axis=1)


def _box(
    road: Road, s: float, d: float, length: float, width: float, colour: str, time: float
) -> tuple[FloatArray, str]:
    """Corners on the map, (4, 2) m, and how the body is painted."""
    x, y, heading = (float(it) for it in map_places(road.line, s, d))
    ahead, left = np.array([1, 1, -1, -1]) * length / 2, np.array([1, -1, -1, 1]) * width / 2
    points = np.stack(
        [x + ahead * np.cos(heading) - left * np.sin(heading), y + ahead * np.sin(heading) + left * np.cos(heading)], 1
    )
    return points, f'fill="{colour}" fill-opacity="{1.0 - 0.28 * time:.2f}" stroke="{colour}"'


def main() -> int:
    """Write them, or say which are stale."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if one is missing or stale")
    arguments = parser.parse_args()
    stale = 0
    for name, text in drawings().items():
        path = FOLDER / name
        if not arguments.check:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"docs/pictures/{name} is stale; run tools/draw_bends.py.")
            stale = 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
