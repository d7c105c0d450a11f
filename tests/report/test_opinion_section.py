"""People's opinion stands in the report of a run once somebody has been asked."""

import json

import pytest
from refusals import refusal

from sumo_eval.extras.studies.opinion import Opinion, RatedScore, opinion_json
from sumo_eval.report.opinion_section import OPINION, opinion_content


def test_the_section_is_there_only_where_people_were_asked(tmp_path):
    assert opinion_content(tmp_path) is None
    rated = RatedScore(
        "idm", "cut_out", 6.5, 0.5, 4, {"S+": 70.0, "A": -0.5, "S": 80.0, "D": None, "C": 0.25}
    )
    told = Opinion((rated,), {"S+": None, "A": None, "S": None, "D": None, "C": None}, None)
    (tmp_path / OPINION).write_text(json.dumps(opinion_json(told)))
    content = opinion_content(tmp_path)
    dots = {panel["name"]: [dot["share"] for dot in panel["dots"]] for panel in content["panels"]}
    # 70 of 100; below 0; 80 of 100; no D
    assert dots == {"S+": [0.7], "A": [0.0], "S": [0.8], "D": [], "C": [0.25]}
    assert content["rows"][0]["opinion"] == 6.5


@pytest.mark.parametrize(
    "damage",
    [
        "",
        "[1]",
        '{"rows": [{}], "correlations": {}}',
        '{"rows": [], "correlations": {"A": 1}, "intervals": [1]}',
        '{"rows": [], "correlations": {"A": 1}, "intervals": {"A": 0.0}}',
        '{"rows": [{"opinion": 1, "deviation": "x", "scores": {}}], "correlations": {}}',
        "[" * 100_000,
    ],
)
def test_a_damaged_file_of_opinions_is_said_and_not_passed_over(tmp_path, damage):
    (tmp_path / OPINION).write_text(damage)
    with refusal("ask again with: sumo-eval humans opinion"):
        opinion_content(tmp_path)
