"""Print a digest of what ten pairs of scenario and ADS record: a change of the code that moves no
bit moves no line.

python tools/bits.py > before.txt; ...; python tools/bits.py | diff before.txt -
"""

from __future__ import annotations

import hashlib

import numpy as np

from sumo_eval.cosim import simulate_many
from sumo_eval.extras.wheel.tape import digest
from sumo_eval.scenario.catalogue import load

PAIRS = [
    ("cut_in", "idm"), ("front_vehicle_low_speed", "sumo:IDM"),
    ("front_vehicle_cut_out", "lane_changer"),
    ("curve_braking", "ideal_braking"), ("ramp_merge", "attentive"),
    ("stop_and_go_stream", "careful_driver"),
    ("pedestrian_crossing", "rss"), ("oncoming_in_lane", "idm"), ("turn_across_path", "fsm"),
    ("swerving_lead", "no_reaction"),
]  # fmt: skip
CASES = 12


def main() -> None:
    """Drive each pair at points drawn with a fixed seed, and print its line."""
    for scenario, ads in PAIRS:
        logical = load(scenario)
        drawn = logical.from_unit(np.random.default_rng(1).random((20 * CASES, len(logical.names))))
        cases = logical.concretes(drawn[logical.feasible(drawn)][:CASES])
        bits = hashlib.sha256()
        for recording in simulate_many(cases, ads):
            bits.update(digest(recording).encode())
        print(f"{scenario:28} {ads:20} {len(cases):3} {bits.hexdigest()[:16]}", flush=True)


if __name__ == "__main__":
    main()
