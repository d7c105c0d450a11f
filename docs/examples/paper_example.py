"""Draw the paper's two scenarios from one run, and write the scores of its two ADSs.

    python docs/examples/paper_example.py results/paper docs/pictures/paper docs/measurements/paper_example.json

The first folder is the run: it is made where it does not exist.
"""

import json
import sys
from pathlib import Path

import sumo_eval
from sumo_eval.extras.figures.drawn import draw

LOW_SPEED, CUT_OUT = "front_vehicle_low_speed", "front_vehicle_cut_out"
FIGURES = {
    "zones_low_speed": ("zone_map", {"scenario": LOW_SPEED, "ads": "lane_changer"}),
    "zones_cut_out": ("zone_map", {"scenario": CUT_OUT, "ads": "lane_changer"}),
    "field": ("field", {"ads": "lane_changer", "case": f"{LOW_SPEED}-0014-lane_changer"}),
    "drives_low_speed": ("trajectories", {"scenario": LOW_SPEED}),
    "collisions_cut_out": ("collisions", {"scenario": CUT_OUT}),
}


def main(folder: Path, pictures: Path, figures: Path) -> None:
    run = sumo_eval.score(folder) if folder.is_dir() else sumo_eval.evaluate(out=folder)
    pictures.mkdir(parents=True, exist_ok=True)
    for name, (figure, options) in FIGURES.items():
        draw(run, figure, **options).savefig(pictures / f"{name}.png", dpi=100)

    rows = [
        {"ads": one.ads, "scenario": one.scenario, "points": one.cases,
            "collisions": one.collisions,
         "d": round(one.d, 2), "c": round(one.c, 2), "s": round(one.s, 1)}
        for one in run.scores
    ]  # fmt: skip
    figures.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(
        {"command": "python docs/examples/paper_example.py", "scores": rows}, indent=1
    )
    figures.write_text(text + "\n")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
