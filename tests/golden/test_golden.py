"""Every shipped scenario, driven by every shipped ADS, comes to what the golden files keep."""

from __future__ import annotations

from pathlib import Path

import pytest

from golden import golden
from sumo_eval.scenario.catalogue import SCENARIOS


@pytest.mark.parametrize("scenario", sorted(SCENARIOS))
def test_drives_people_and_scores_are_the_golden_ones(scenario: str, tmp_path: Path) -> None:
    found = list(golden.differences(golden.kept(scenario), golden.measured(scenario, tmp_path / "run")))
    assert not found, "\n".join([*found[:20], "If this is meant: python tests/golden/golden.py --write"])


def test_a_changed_drive_a_changed_score_and_a_lost_drive_are_each_named() -> None:
    kept = golden.kept("front_vehicle_low_speed")
    case, drive = next(iter(kept["drives"].items()))
    ads, score = next(iter(kept["scores"].items()))
    other = {
        **kept,
        "drives": {**kept["drives"], case: {**drive, "end": "sim_error", "trajectories": "0"}},
        "scores": {**kept["scores"], ads: {**score, "s": score["s"] + 1e-6}},
    }
    assert list(golden.differences(kept, kept)) == []
    assert list(golden.differences(kept, other)) == [
        f"drives: {case}: end was {drive['end']}, is sim_error.",
        f"drives: {case}: the trajectories differ in some bit.",
        f"scores: {ads}: s was {score['s']}, is {score['s'] + 1e-6}.",
    ]
    fewer = {**kept, "drives": {name: row for name, row in kept["drives"].items() if name != case}}
    assert list(golden.differences(kept, fewer)) == [f"drives: {case} is gone."]
