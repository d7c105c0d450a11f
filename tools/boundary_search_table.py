"""The boundary search beside random, grid and Sobol trials of the same number: the table of docs/space.md.

python tools/boundary_search_table.py [--budget 500] [--cache FOLDER]: three slices of 10,000 points, each simulated
once for the truth (some minutes), then every method through SUMO with the same budget and the same classifier.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.engines import run_cases
from sumo_eval.results import EVALUATED
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings import RunSettings, SimulationSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.studies.boundary import find_boundary
from sumo_eval.studies.slices import slice_of
from sumo_eval.studies.straddle import BoundarySearch
from sumo_eval.trajectory import BoolArray, FloatArray

SIDE = 100
SLICES = (
    ("cut_in", {"ego_speed": 30.0, "lateral_speed": 1.0}, "careful_driver"),
    ("front_vehicle_cut_out", {"ego_speed": 30.0}, "idm"),
    ("r157_cut_out", {"lateral_speed": 1.0}, "fsm"),
)


def collided(logical: LogicalScenario, ads: str, points: FloatArray) -> BoolArray:
    """Outcomes of an ADS at points (n, 2), through SUMO."""
    cases = [Case(i, concrete, "ads", "ads", ads) for i, concrete in enumerate(logical.concretes(points))]
    statuses = [outcome.status for outcome in run_cases(cases, setup())]
    if any(status not in EVALUATED for status in statuses):
        raise SystemExit(f"{logical.name}: some cases could not be evaluated")
    return np.array([status == "collision" for status in statuses])


def setup() -> Setup:
    """Two workers, everything else at its default."""
    return Setup(SimulationSettings(), RunSettings(workers=2), Path.cwd())


def truth(logical: LogicalScenario, ads: str, cache: Path | None) -> tuple[FloatArray, BoolArray]:
    """The possible ones of SIDE x SIDE cell centres, and what happens there."""
    middle = (np.arange(SIDE) + 0.5) / SIDE
    points = logical.from_unit(np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2))
    points = points[logical.feasible(points)]
    file = None if cache is None else cache / f"{logical.name}-{ads}.npy"
    if file is not None and file.is_file():
        return points, np.load(file)
    found = collided(logical, ads, points)
    if file is not None:
        np.save(file, found)
    return points, found


def trials(logical: LogicalScenario, method: str, budget: int) -> FloatArray:
    """`budget` possible points (fewer for the grid, which has to be one)."""
    if method == "grid":
        for side in range(200, 1, -1):
            ticks = np.linspace(0.0, 1.0, side)
            points = logical.from_unit(np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2))
            points = points[logical.feasible(points)]
            if len(points) <= budget:
                return points
    stream = random_stream(1, "table", method, logical.name)
    points = (
        evenly(logical, 4 * budget, stream)
        if method == "Sobol"
        else logical.from_shares(stream.random((4 * budget, 2)))
    )
    return points[logical.feasible(points)][:budget]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--budget", type=int, default=500)
    parser.add_argument("--cache", type=Path)
    arguments = parser.parse_args()
    print("| slice | ADS | collides in | search, settled | search, budget | random | grid | Sobol |")
    print("|---|---|---|---|---|---|---|---|")
    for name, fixed, ads in SLICES:
        logical = slice_of(catalogue.load(name), fixed)
        points, hit = truth(logical, ads, arguments.cache)
        cells = []
        for tolerance in (0.001, 0.0):
            found = find_boundary(logical, ads, setup(), budget=arguments.budget, tolerance=tolerance)
            cells.append(f"{np.mean(found.collides(points) != hit):.2%} ({found.rounds[-1].trials})")
        for method in ("random", "grid", "Sobol"):
            tried = trials(logical, method, arguments.budget)
            search = BoundarySearch(logical)
            search.tell(tried, collided(logical, ads, tried))
            cells.append(f"{np.mean(search.classify(points) != hit):.2%} ({len(tried)})")
        where = ", ".join(f"{key} = {value:g}" for key, value in fixed.items())
        print(f"| `{name}`, {where} | `{ads}` | {np.mean(hit):.1%} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
