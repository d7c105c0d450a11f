"""How golden files are compared, the table of the README, and drives, people and scores of some
scenarios."""

import pytest
from click import unstyle
from loaded import ROOT

import sumo_eval
from golden import golden
from sumo_eval.report.score_table import score_lines
from sumo_eval.scenario.catalogue import SCENARIOS
from sumo_eval.settings.config import PAPER_EVALUATION


@pytest.mark.parametrize("scenario", [*golden.PARTS[0], *golden.PARTS[1]])
def test_drives_people_and_scores_are_the_golden_ones(scenario):
    golden.check(scenario)


def test_every_scenario_is_golden_in_one_part():
    assert sorted(name for part in golden.PARTS for name in part) == sorted(SCENARIOS)


def test_a_changed_drive_a_changed_score_and_a_lost_drive_are_each_named():
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


@pytest.mark.campaign
def test_the_table_of_the_readme_is_what_the_papers_evaluation_comes_to(tmp_path):
    table = (ROOT / "README.md").read_text().split("```\n      ")[1].split("\n```")[0].splitlines()
    lines = score_lines(sumo_eval.evaluate(PAPER_EVALUATION, tmp_path / "run"))
    assert [line.split() for line in table] == [unstyle(line).split() for line in lines]
