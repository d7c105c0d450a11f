"""Agreement of the shipped UN R157 drivers with another implementation: `python tools/r157_agreement.py FOLDER [ROWS]`.

FOLDER holds cut_in.csv, cut_out.csv and decel.csv of single implementations (columns model, crash, robust_dt and the
scenario's own). Of each model and scenario a seeded sample of ROWS rows (default 300) with robust_dt = 1 is driven
through SUMO, and the table says how often the outcomes agree. `cut_in` is driven twice: as it ships, and with the
lateral run-up that the other implementation has (`cut_in + run-up`).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sumo_eval.ads.fuzzy_safety_model import FuzzySafetyModel

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "oracles"))
from r157_cases import collides, of_row  # type: ignore[import-not-found]


class FsmAsCoded(FuzzySafetyModel):
    """`fsm` with CFS and without a resting gap, as the other program has it."""

    def __init__(self) -> None:
        super().__init__(standstill_gap=0.0, as_coded=True)


NAMES: tuple[tuple[str, str, Any], ...] = (
    ("CC_human_driver", "careful_driver", "careful_driver"),
    ("FSM", "fsm", "fsm"),
    ("FSM", "fsm, as coded", FsmAsCoded),
    ("RSS", "rss", "rss"),
    ("Reg157", "reg157", "reg157"),
)
SEED = 1


def agreement(folder: Path, rows: int) -> pd.DataFrame:
    """One row for each controller and scenario: rows, agreement, false and missed crashes."""
    lines = []
    for kind, run_up in (("cut_in", False), ("cut_in", True), ("cut_out", False), ("decel", False)):
        table = pd.read_csv(folder / f"{kind}.csv", dtype=str)
        table = table[table["robust_dt"] == "1"]
        for model, name, controller in NAMES:
            mine = table[table["model"] == model]
            mine = mine.sample(min(rows, len(mine)), random_state=SEED)
            theirs = (mine["crash"] == "1").to_numpy()
            scenes = [
                of_row(kind, {str(name): str(value) for name, value in row.items()}, run_up=run_up)
                for row in mine.to_dict("records")
            ]
            ours = np.array([collides(scene, controller) for scene in scenes])
            false, missed = int((ours & ~theirs).sum()), int((theirs & ~ours).sum())
            agree = 100.0 * (1.0 - (false + missed) / len(mine))
            lines.append((name, kind + " + run-up" * run_up, len(mine), f"{agree:.1f} %", false, missed))
    return pd.DataFrame(lines, columns=["controller", "scenario", "rows", "agree", "false crash", "missed crash"])


if len(sys.argv) < 2:
    sys.exit(__doc__)
print(agreement(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 300).to_string(index=False))
