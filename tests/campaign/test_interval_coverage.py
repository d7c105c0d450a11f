"""The coverage campaign: whole evaluations over seeds, and how often their 95 % intervals hold the
mean over all seeds.

`pytest -m campaign tests/campaign/test_interval_coverage.py -s`. Every seed draws other points
(Sobol) and drivers. The truth is the mean of a score over all seeds: what an evaluation of this
size gives on average. SUMO_EVAL_CAMPAIGN_SHARE, default 1, is the share of the 20 seeds that is
run. tests/scoring/confidence/test_intervals.py is the small version, on a problem whose answer is
known.
"""

from collections import defaultdict

import numpy as np
import pytest
from campaign_share import SHARE
from evaluations import small

import sumo_eval
from sumo_eval.settings import DriverSettings, RunSettings, SamplingSettings

SEEDS, POINTS = 20, 32
SCENARIOS = ("front_vehicle_cut_out", "cut_in", "front_vehicle_low_speed")
ADSS = ("idm", "lane_changer", "careful_driver")
NAMES = (
    "c",
    "avoided_share",
    "avoidance_grade",
    "task_share",
    "d",
    "human_likeness",
    "s",
    "s_plus",
)


@pytest.mark.campaign
def test_95_per_cent_intervals_hold_the_mean_over_seeds(tmp_path):
    found = defaultdict(list)
    for seed in range(1, max(3, round(SHARE * SEEDS)) + 1):
        sampling, drivers = SamplingSettings("sobol", count=POINTS), DriverSettings().count
        settings = small(ADSS, SCENARIOS, drivers, sampling=sampling, seed=seed, run=RunSettings())
        for score in sumo_eval.evaluate(settings, tmp_path / str(seed)).scores:
            for name in NAMES:
                if getattr(score, name) is not None:
                    low, high = getattr(score, f"{name}_interval")
                    found[score.scenario, score.ads, name].append((getattr(score, name), low, high))
    held = defaultdict(list)
    for (scenario, ads, name), rows in found.items():
        if len(rows) < 2:
            print(f"{scenario} {ads} {name}: too few seeds have it")
            continue
        value, low, high = np.array(rows).T
        truth, deviation, width = value.mean(), value.std(ddof=1), (high - low).mean()
        inside = (low - 1e-9 <= truth) & (truth <= high + 1e-9)
        held[name] += inside.tolist()
        print(
            f"{scenario} {ads} {name}: {truth:.3f} +- {deviation:.3f}, held {inside.mean():.2f}, "
            f"width {width:.3f}"
        )
    shares = {name: float(np.mean(inside)) for name, inside in held.items()}
    print(shares)
    if SHARE >= 1.0:
        assert all(share >= 0.9 for share in shares.values()), shares
