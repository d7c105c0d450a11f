"""Moving pictures of scenarios for the docs' gallery: SUMO drives one point of each, and the drive
becomes an SVG.

    python tools/animate_scenarios.py docs/pictures/moving                 every one that ships
    python tools/animate_scenarios.py docs/pictures/moving a.toml b.toml   these files

The picture runs by itself in any browser, without a script. Seen from above; the camera goes with
the ego, and turns with it on a bend.
"""

from __future__ import annotations

import argparse
import sys
from html import escape
from pathlib import Path

import numpy as np

from sumo_eval.cosim.simulation import simulate
from sumo_eval.report.page_data import drawn_shape
from sumo_eval.scenario.catalogue import SCENARIOS, find
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.scenario.sampling.samples import central_point
from sumo_eval.trajectory import FloatArray, Trajectory

SCALE = 5.0  # SVG units to a metre
AHEAD, BEHIND = 100.0, 20.0  # m that are seen
FRAME = 0.2  # s between two key frames
WAIT = 1.0  # s on the last frame
COLOURS = {"ego": "#0072b2", "other": "#b26a00"}
DASH = 9.0  # m of a lane line and of its gap, together twice this
ROAD, GRASS = "#8b939b", "#dfe6dc"
# m to each side of the ego that are seen where the road bends or is crossed, and elsewhere
ASIDE, BESIDE = 30.0, 12.0
BETWEEN = 4.0  # m between two points of what is drawn along a bend


class Film:
    """Key frames of a drive: their times `at`, s since it began, and what an element does at them
    as SVG text.
    """

    def __init__(self, ego: Trajectory) -> None:
        lasts = float(ego.time[-1] - ego.time[0])
        times = np.arange(0.0, lasts, FRAME)
        times = (
            np.append(times, [times[-1], times[-1] + WAIT]) if len(times) else np.array([0.0, WAIT])
        )
        self.at = np.minimum(times, lasts)
        self.duration = float(times[-1]) or WAIT
        self.keys = ";".join(f"{time / self.duration:.4f}" for time in times)

    def animated(self, attribute: str, values: list[str], kind: str = "") -> str:
        """The element that gives an attribute these values, one a key frame;

        kind: of a transform.
        """
        how = f'attributeName="{attribute}" values="{";".join(values)}" keyTimes="{self.keys}"'
        tag = "animateTransform" if kind else "animate"
        more = f' type="{kind}" additive="sum"' if kind else ""
        return f'<{tag} {how}{more} dur="{self.duration:.1f}s" repeatCount="indefinite"/>'


def _svg(name: str, about: str, width: float, height: float, parts: list[str]) -> str:
    title = (
        f"<title>{escape(name)}</title><desc>{escape(about)} Blue: the ADS. Ochre: the "
        "others.</desc>"
    )
    body = "\n".join((title, *parts))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'role="img">\n{body}\n</svg>\n'
    )


def picture(name: str, about: str, road: Road, vehicles: dict[str, Trajectory]) -> str:
    """The drive on any road as SVG text, its shapes in metres on the map.

    vehicles: the ego first.
    """
    ego = next(iter(vehicles.values()))
    film = Film(ego)
    aside = ASIDE if road.bent or road.crossings else BESIDE
    width, height = (AHEAD + BEHIND) * SCALE, 2.0 * aside * SCALE
    bodies = []
    around = map_places(road.line, _along(ego, film.at, "x"), _along(ego, film.at, "y"))
    for number, trajectory in enumerate(vehicles.values()):
        x, y, turned = map_places(
            road.line, _along(trajectory, film.at, "x"), _along(trajectory, film.at, "y")
        )
        heading = np.degrees(np.unwrap(turned) + _along(trajectory, film.at, "heading"))
        long, wide = trajectory.length, trajectory.width
        bodies.append(
            f"<g>{film.animated('transform', _pairs(x, y), 'translate')}"
            f"{film.animated('transform', [f'{angle:.1f}' for angle in heading], 'rotate')}"
            f'<rect x="{-long / 2:.2f}" y="{-wide / 2:.2f}" width="{long:.2f}" '
            f'height="{wide:.2f}" rx="0.5" '
            f'fill="{COLOURS["ego" if number == 0 else "other"]}"/>'
            "</g>"
        )
    x, y, turned = around  # the ego's place, and how its road runs there
    parts = [
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="{GRASS}"/>',
        f'<g transform="translate({BEHIND * SCALE:.0f} {height / 2:.0f}) scale({SCALE:g} '
        f'{-SCALE:g})">',
        f"<g>{film.animated('transform', [f'{-angle:.2f}' for angle in np.degrees(np.unwrap(turned))], 'rotate')}",
        f"<g>{film.animated('transform', _pairs(-x, -y), 'translate')}",
        *_road_shapes(
            road, float(ego.x.min()) - BEHIND - ASIDE, float(ego.x.max()) + AHEAD + ASIDE
        ),
        *bodies,
        "</g></g></g>",
    ]
    return _svg(name, about, width, height, parts)


def _pairs(x: FloatArray, y: FloatArray) -> list[str]:
    return [f"{a:.2f} {b:.2f}" for a, b in zip(x, y, strict=True)]


def _road_shapes(road: Road, first: float, last: float) -> list[str]:
    """The road between two places along it: its surface, lanes that are not there, lines, and roads
    that cross.
    """

    def path(points: list[list[float]], paint: str, *, closed: bool = False) -> str:
        """A line through places (s, d), which follows the road."""
        s, d = np.array([[min(max(s, first), last), d] for s, d in points]).T
        if road.bent:
            corners = np.arange(len(s))
            many = np.maximum(np.ceil(np.abs(np.diff(s)) / BETWEEN).astype(int), 1)
            fine = [
                begin + np.arange(parts) / parts
                for begin, parts in zip(corners, many, strict=False)
            ]
            between = np.append(np.concatenate(fine), corners[-1])
            s, d = np.interp(between, corners, s), np.interp(between, corners, d)
        x, y, _ = map_places(road.line, s, d)
        drawn = " ".join(f"{a:.2f},{b:.2f}" for a, b in zip(x, y, strict=True))
        return f'<poly{"gon" if closed else "line"} points="{drawn}" {paint}/>'

    def surface(points: list[list[float]], colour: str) -> str:
        return path(points, f'fill="{colour}"', closed=True)

    def line(points: list[list[float]], more: str = "") -> str:
        return path(points, f'fill="none" stroke="#fff" stroke-width="0.3"{more}')

    def across(at: float, wide: float, reach: float) -> str:
        return surface(
            [[at + a * wide / 2, b * reach] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))], ROAD
        )

    low, high, shape = road.right_edge, road.left_edge, drawn_shape(road)
    parts = [across(*crossing) for crossing in shape["crossings"]]
    parts.append(surface([[first, low], [last, low], [last, high], [first, high]], ROAD))
    for lane in range(1, road.lanes):
        y = low + lane * road.lane_width
        parts.append(line([[first, y], [last, y]], f' stroke-dasharray="{DASH:g}"'))
    parts += [
        line([[begin, y], [end, y]])
        for begin, end, y in shape["solid"]
        if begin < last and end > first
    ]
    for gone in shape["gone"]:
        outwards = -0.5 if gone[0][1] < gone[1][1] else 0.5
        outside = [
            [gone[0][0], gone[0][1] + outwards],
            gone[1],
            gone[2],
            [gone[3][0], gone[3][1] + outwards],
        ]
        parts.append(surface(outside, GRASS))
    # no lane lines in a crossing
    parts += [across(at, wide, high - low) for at, wide, _ in shape["crossings"]]
    return parts


def _along(trajectory: Trajectory, at: np.ndarray, channel: str) -> np.ndarray:
    """A channel at times since the recording began; before and after it, where it began and
    ended.
    """
    time = trajectory.time - trajectory.time[0]
    values = getattr(trajectory, channel)
    return np.asarray(np.interp(at, time, np.unwrap(values) if channel == "heading" else values))


def drawn(logical: LogicalScenario) -> str:
    """The middle of a scenario's space, driven by `idm`."""
    values = dict(zip(logical.names, np.ravel(central_point(logical)).tolist(), strict=True))
    recording = simulate(logical.concrete(**values), "idm")
    vehicles = {"ego": recording.ego, **recording.actors}
    return picture(logical.name, logical.about, logical.road, vehicles)


def main() -> int:
    """Write a picture for each scenario that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenarios", nargs="*")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    for use in given.scenarios or SCENARIOS:
        logical = find(use, Path.cwd())
        path = given.folder / f"{logical.name}.svg"
        path.write_text(drawn(logical), encoding="utf-8")
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
