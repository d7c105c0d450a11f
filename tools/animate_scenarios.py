"""Moving pictures of scenarios for the docs' gallery: SUMO drives one point of each, and the drive becomes an SVG.

    python tools/animate_scenarios.py docs/pictures/moving                 every one that ships on a plain straight road
    python tools/animate_scenarios.py docs/pictures/moving a.toml b.toml   these files

The picture runs by itself in any browser, without a script. Seen from above; the camera goes with the ego.
"""

from __future__ import annotations

import argparse
import sys
from html import escape
from pathlib import Path

import numpy as np

from sumo_eval.cosim.simulate import simulate
from sumo_eval.scenario.catalogue import SCENARIOS, find
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import central_point
from sumo_eval.trajectory import Trajectory

SCALE = 5.0  # SVG units to a metre
AHEAD, BEHIND = 100.0, 20.0  # m that are seen
FRAME = 0.2  # s between two key frames
WAIT = 1.0  # s on the last frame
COLOURS = {"ego": "#0072b2", "other": "#b26a00"}
DASH = 9.0  # m of a lane line and of its gap, together twice this


def picture(name: str, about: str, road: Road, vehicles: dict[str, Trajectory]) -> str:
    """The drive as SVG text. vehicles: the ego first."""
    ego = next(iter(vehicles.values()))
    times = np.arange(0.0, float(ego.time[-1] - ego.time[0]), FRAME)
    times = np.append(times, [times[-1], times[-1] + WAIT]) if len(times) else np.array([0.0, WAIT])
    at = np.minimum(times, float(ego.time[-1] - ego.time[0]))
    duration = float(times[-1]) or WAIT
    keys = ";".join(f"{time / duration:.4f}" for time in times)
    width, height = (AHEAD + BEHIND) * SCALE, (road.left_edge - road.right_edge) * SCALE + 16.0
    camera = _along(ego, at, "x")

    def y(across: float) -> float:
        return 8.0 + (road.left_edge - across) * SCALE

    def animated(attribute: str, values: list[str], kind: str = "") -> str:
        how = f'attributeName="{attribute}" values="{";".join(values)}" keyTimes="{keys}"'
        tag = "animateTransform" if kind else "animate"
        more = f' type="{kind}" additive="sum"' if kind else ""
        return f'<{tag} {how}{more} dur="{duration:.1f}s" repeatCount="indefinite"/>'

    lines = [
        f'<path d="M0 {y(road.right_edge + lane * road.lane_width):.1f}H{width:.0f}" stroke="#fff" stroke-width="1.5" '
        f'stroke-dasharray="{DASH * SCALE:.0f}">'
        + animated("stroke-dashoffset", [f"{value * SCALE % (2e3 * DASH * SCALE):.0f}" for value in camera])
        + "</path>"
        for lane in range(1, road.lanes)
    ]
    bodies = []
    for number, trajectory in enumerate(vehicles.values()):
        x = (_along(trajectory, at, "x") - camera + BEHIND) * SCALE
        across = [y(value) for value in _along(trajectory, at, "y")]
        turned = -np.degrees(_along(trajectory, at, "heading"))
        long, wide = trajectory.length * SCALE, trajectory.width * SCALE
        colour = COLOURS["ego" if number == 0 else "other"]
        places = [f"{a:.1f} {b:.1f}" for a, b in zip(x, across, strict=True)]
        bodies.append(
            f"<g>{animated('transform', places, 'translate')}"
            f"{animated('transform', [f'{angle:.1f}' for angle in turned], 'rotate')}"
            f'<rect x="{-long / 2:.1f}" y="{-wide / 2:.1f}" width="{long:.1f}" height="{wide:.1f}" rx="3" '
            f'fill="{colour}"/>'
            "</g>"
        )
    title = f"<title>{escape(name)}</title><desc>{escape(about)} Blue: the ADS. Ochre: the others.</desc>"
    road_shape = f'<rect y="{y(road.left_edge):.1f}" width="{width:.0f}" height="{height - 16:.1f}" fill="#8b939b"/>'
    body = "\n".join((title, road_shape, *lines, *bodies))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img">\n{body}\n</svg>\n'
    )


def _along(trajectory: Trajectory, at: np.ndarray, channel: str) -> np.ndarray:
    """A channel at times since the recording began; before and after it, where it began and ended."""
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
    for use in given.scenarios or [name for name, one in SCENARIOS.items() if not (one.road.bent or one.road.shaped)]:
        logical = find(use, Path.cwd())
        path = given.folder / f"{logical.name}.svg"
        path.write_text(drawn(logical), encoding="utf-8")
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
