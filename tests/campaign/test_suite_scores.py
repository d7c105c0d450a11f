"""The leaderboard's scores of what ships are what the program comes to: a suite that is cited can
be run again."""

import pytest
from laid import read_json
from loaded import ROOT

import sumo_eval
from sumo_eval.cosim.doors.controller import SHIPPED

BOARD = ROOT / "docs" / "leaderboard"


@pytest.mark.campaign
@pytest.mark.parametrize("suite", ["2026.1", "2026.2"])
def test_the_kept_scores_of_the_suite_are_found_again(tmp_path, suite):
    """S+ of 2026.1 was another score; C, D and S are as they were."""
    ads = [{"name": name, "controller": name} for name in SHIPPED]
    evaluation = {"name": f"suite {suite}", "scenario": [{"use": f"suite:{suite}"}], "ads": ads}
    found = sumo_eval.evaluate(evaluation, tmp_path / "run")
    content = read_json(BOARD / suite / "shipped.json")
    kept = {(one["ads"], one["scenario"]): one for one in content["scores"]}
    assert len(found.scores) == len(kept) == 4 * len(SHIPPED)
    for score in found.scores:
        one = kept[score.ads, score.scenario]
        if suite != "2026.1":
            assert score.s_plus == pytest.approx(one["s_plus"], abs=1e-6), (
                score.ads,
                score.scenario,
            )
        assert score.s == pytest.approx(one["s"], abs=1e-6), (score.ads, score.scenario)
        assert score.collisions == one["collisions"], (score.ads, score.scenario)
