"""Crash shares on the public grids of the UN R157 models, beside ours: `python tools/r157_grids.py FOLDER [CASES]`.

FOLDER holds stock_grid_counts.csv: crashes of another implementation by grid, model and speeds. Of each grid a seeded
sample of CASES points (default 1000; 0: all) is driven through SUMO with the shipped driver of the same model, the
same share of each pair of speeds, and both crash shares are printed. Points without lateral motion cannot crash and are
counted without a run.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "oracles"))
from r157_cases import collides, of_row  # type: ignore[import-not-found]

NAMES = {"CC_human_driver": "careful_driver", "FSM": "fsm", "RSS": "rss", "Reg157": "reg157"}
SEED = 1
Row = dict[str, str]


def following_gap(model: str, speed: float) -> float:
    """The gap that a model itself would keep, m, with which the grids without a cut-in begin. speed: m/s."""
    if model == "FSM":  # where PFS begins to be above 0
        return speed * 0.75 + speed * speed * (1.0 / 8.0 - 1.0 / 14.0) + 4.0
    if model == "RSS":  # safe again after a reaction time in which the lead brakes at 6 m/s2
        own = speed * 0.75 + 3.0 * 0.75**2 / 2.0 + (speed + 2.25) ** 2 / 12.0
        return own - max(speed - 4.5, 0.0) ** 2 / 12.0 + 6.0 * 0.75**2 / 2.0
    return 2.0 * speed


def _cut_in(gaps: range) -> Callable[[Any], list[Row]]:
    def rows(pair: Any) -> list[Row]:
        return [
            {"ve_kmh": str(pair.ve_kmh), "vo_kmh": str(pair.vo_kmh), "dx0_m": str(gap), "vy_mps": f"{0.1 * step:.1f}"}
            for gap in gaps
            for step in range(18)
        ]

    return rows


def _cut_out(pair: Any) -> list[Row]:
    return [
        {
            "ve_kmh": str(pair.ve_kmh),
            "dx0_m": str(following_gap(pair.model, pair.ve_kmh / 3.6)),
            "dx0_f_m": str(gap),
            "vy_mps": f"{0.1 + 0.2 * step:.1f}",
        }
        for gap in range(2, 152, 5)
        for step in range(15)
    ]


def _braking(pair: Any) -> list[Row]:
    gap = str(following_gap(pair.model, pair.ve_kmh / 3.6))
    return [{"ve_kmh": str(pair.ve_kmh), "dx0_m": gap, "lead_decel_g": f"{0.05 * step:.2f}"} for step in range(1, 20)]


GRIDS: dict[str, tuple[str, Callable[[Any], list[Row]]]] = {
    "cut_in_low": ("cut_in", _cut_in(range(1, 60))),
    "cut_in_high": ("cut_in", _cut_in(range(1, 120, 2))),
    "cut_out": ("cut_out", _cut_out),
    "car_following": ("decel", _braking),
}


def _some(rows: list[Row], every: int, rng: np.random.Generator) -> list[Row]:
    """One in `every` rows."""
    return [rows[index] for index in rng.permutation(len(rows))[::every]]


def crashes(task: tuple[str, Row, str]) -> bool:
    """Whether the driver hits anything in a point of a grid."""
    kind, row, controller = task
    if kind == "cut_in" and float(row["vy_mps"]) == 0.0:
        return False
    return bool(collides(of_row(kind, row, bounded=False), controller))


def shares(counts: pd.DataFrame, cases: int) -> Iterator[tuple[Any, ...]]:
    """Grid, controller, their crashes and share, our cases, share and its standard error."""
    rng = np.random.default_rng(SEED)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for (grid, model), theirs in counts.groupby(["grid", "model"]):
            kind, points = GRIDS[str(grid)]
            every = max(1, math.ceil(theirs["n_scenarios"].sum() / cases)) if cases else 1
            rows = [row for pair in theirs.itertuples() for row in _some(points(pair), every, rng)]
            hits = list(pool.map(crashes, [(kind, row, NAMES[str(model)]) for row in rows], chunksize=50))
            share = float(np.mean(hits))
            error = math.sqrt(share * (1.0 - share) / len(hits)) if every > 1 else 0.0
            their_share = theirs["n_crash"].sum() / theirs["n_scenarios"].sum()
            yield grid, NAMES[str(model)], f"{their_share:.1%}", len(hits), f"{share:.1%}", f"{error:.1%}"


def main() -> None:
    """Print the table."""
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    counts = pd.read_csv(Path(sys.argv[1]) / "stock_grid_counts.csv")
    cases = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    names = ["grid", "controller", "their share", "our cases", "our share", "standard error"]
    print(pd.DataFrame(shares(counts, cases), columns=names).to_string(index=False))


if __name__ == "__main__":
    main()
