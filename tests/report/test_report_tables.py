"""cases.csv and scores.json: what machines read is complete, valid and equal to the results."""

import json
import math
from dataclasses import asdict, replace

import pandas as pd
import pytest
from builders import DRIVERS
from refusals import refusal

from sumo_eval.report.notes import exposure_note_words, index_note_words, reference_note_words
from sumo_eval.report.tables import cases_csv, scores_json
from sumo_eval.report.words import count


@pytest.fixture(scope="module")
def table(evaluation, tmp_path_factory):
    path = tmp_path_factory.mktemp("csv") / "cases.csv"
    cases_csv(evaluation, path)
    return pd.read_csv(path, keep_default_na=False, na_values=[""])


def test_every_case_is_a_row_and_every_field_comes_back(evaluation, table):
    assert len(table) == len(evaluation.cases)
    for (_, row), case in zip(table.iterrows(), evaluation.cases, strict=True):
        plain = asdict(case) | {
            "index_note": index_note_words(case),
            "reference_note": reference_note_words(case),
            "exposure_note": exposure_note_words(case),
        }
        values = plain.pop("values")
        for name, value in {**plain, **values}.items():
            if value is None or value == "":
                assert pd.isna(row[name]), name
            else:
                assert row[name] == value, name


def test_parameters_of_another_scenario_are_empty(table):
    low_speed = table[table["scenario"] == "front_vehicle_low_speed"]
    assert low_speed["gap"].isna().all()
    assert low_speed["lead_speed"].notna().all()


def test_a_parameter_that_is_called_like_a_column_keeps_its_values(evaluation, tmp_path):
    odd = replace(evaluation, cases=(replace(evaluation.cases[0], values={"zone": 3.5}),))
    cases_csv(odd, tmp_path / "odd.csv")
    row = pd.read_csv(tmp_path / "odd.csv").iloc[0]
    assert row["parameter_zone"] == 3.5
    assert row["zone"] == evaluation.cases[0].zone


def test_a_folder_that_cannot_be_is_refused(evaluation, tmp_path):
    (tmp_path / "file").write_text("")
    with refusal("cannot be written"):
        cases_csv(evaluation, tmp_path / "file" / "cases.csv")


def test_scores_json_is_strictly_valid_and_holds_the_scores(evaluation):
    plain = scores_json(evaluation)
    again = json.loads(json.dumps(plain, allow_nan=False))
    assert again == plain
    assert [row["c"] for row in again["scores"]] == [score.c for score in evaluation.scores]
    without = [row for row in again["scores"] if row["d"] is None]
    assert [(row["ads"], row["d_reason"]) for row in without] == [
        (score.ads, f"not computed: {count(score.safe_collisions, 'collision')} in the safe zone")
        for score in evaluation.scores
        if score.d is None
    ]
    assert without
    assert again["drivers"] == {"source": "synthetic", "count": DRIVERS}
    assert again["not_evaluated"] == evaluation.not_evaluated == 2


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_json_does_not_know_become_null(evaluation, value):
    odd = replace(evaluation, scores=(replace(evaluation.scores[0], collision_probability=value),))
    plain = scores_json(odd)
    json.dumps(plain, allow_nan=False)
    assert plain["scores"][0]["collision_probability"] is None


def test_a_score_that_is_not_there_is_refused_by_name(evaluation):
    known = evaluation.scores[0]
    with refusal(f"Unknown ADS `nobody` of scenario `{known.scenario}`"):
        evaluation.score("nobody", known.scenario)
    with refusal("Unknown scenario `nowhere` of this evaluation"):
        evaluation.score(known.ads, "nowhere")
