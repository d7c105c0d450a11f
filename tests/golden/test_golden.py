"""How golden files are compared, and the table of the README; the scenarios are in four files beside this one."""

from __future__ import annotations

import re
from pathlib import Path

import sumo_eval
from golden import golden
from sumo_eval.scenario.catalogue import SCENARIOS
from sumo_eval.settings.config import PAPER_EVALUATION


def test_every_scenario_is_golden_in_one_part() -> None:
    assert sorted(name for part in golden.PARTS for name in part) == sorted(SCENARIOS)


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


def test_the_table_of_the_readme_is_what_the_papers_evaluation_comes_to(tmp_path: Path) -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    heading, *printed = readme.split("```\nADS ")[1].split("\n```")[0].splitlines()
    names = {
        "avoidable": "avoidable_collisions",
        "unavoidable": "unavoidable_collisions",
        "caused": "caused_collisions",
    }
    names |= {"A": "avoided_share", "H": "human_likeness", "S+": "s_plus", "C": "c", "D": "d", "S": "s"}
    names |= {"T": "task_share", "A'": "avoidance_grade", "collisions in safe zone": "safe_collisions"}
    names |= {"left the road": "departures", "gave up": "gave_up", "not evaluated": "not_evaluated"}
    columns = re.split(r" {2,}", heading.strip())[1:]
    table = {tuple(cells[:2]): cells[2:] for cells in (line.split() for line in printed)}
    scores = sumo_eval.evaluate(PAPER_EVALUATION, tmp_path / "run").scores
    assert set(table) == {(score.ads, score.scenario) for score in scores}
    for score in scores:
        for column, cell in zip(columns, table[score.ads, score.scenario], strict=True):
            value = getattr(score, names.get(column, column))
            digits = len(cell.partition(".")[2])
            assert f"{value:.{digits}f}" == cell, f"{column} of {score.ads} in {score.scenario}"
