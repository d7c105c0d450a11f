"""The report's section on confidence: there with its numbers, or not there at all."""

import json
import shutil
from dataclasses import replace

import pytest
from lxml import html
from refusals import refusal
from report_cases import with_settings
from scoring.confidence.scored_by_hand import with_intervals_of_calm

from sumo_eval.extras.studies.opinion import Opinion, RatedScore, opinion_json
from sumo_eval.record.run_folder import FACTS
from sumo_eval.report.confidence_section import write_confidence
from sumo_eval.report.html import write_report
from sumo_eval.report.opinion_section import OPINION, opinion_content
from sumo_eval.report.verdict import Additions
from sumo_eval.scoring.confidence.assessment import Confidence, assess
from sumo_eval.settings import RunSettings


@pytest.fixture(scope="module")
def assessed(evaluation, partitions, tmp_path_factory):
    folder = tmp_path_factory.mktemp("section")
    shutil.copy(evaluation.folder / FACTS, folder)
    calm = with_intervals_of_calm(evaluation, partitions).scores
    moved = replace(evaluation, folder=folder)
    copy = with_settings(replace(moved, scores=calm), run=RunSettings(workers=1))
    return moved, assess(copy, partitions)


def test_the_section_has_the_numbers_of_the_assessment(assessed, partitions):
    evaluation, confidence = assessed
    page = write_report(evaluation, partitions, Additions(confidence=confidence)).read_text()
    (section,) = html.fromstring(page).xpath("//section[@id='confidence']")
    words = " ".join(section.text_content().split())
    for item in confidence.assessments:
        s, p = item.intervals["s"], item.risk.collision_probability
        assert f"{s.value:.1f}{s.low:.1f} to {s.high:.1f}" in words
        assert f"{100 * p.value:.1f} %{100 * p.low:.1f} to {100 * p.high:.1f} %" in words
    for space in confidence.coverage.values():
        assert f"{space.pairs_hit[0]} of {space.pairs_hit[1]}" in words
        assert f"radius {space.empty_radius:.3f}" in words


def test_a_score_without_an_interval_says_why(assessed, partitions):
    evaluation, confidence = assessed
    first, *others = confidence.assessments
    none = first._replace(
        intervals={}, risk=None, further=None, reason="fewer than two evaluated cases"
    )
    beside = Additions(confidence=Confidence((none, *others), confidence.coverage))
    page = write_report(evaluation, partitions, beside).read_text()
    assert "no interval: fewer than two evaluated cases" in page


def test_an_ads_that_gave_up_everywhere_keeps_the_intervals_that_it_has(
    evaluation, partitions, assessed
):
    """Its cases given up count in S+, which has an interval, but not in the collision share."""
    score = replace(
        with_intervals_of_calm(evaluation, partitions).scores[0], c=None, d=None, s=None
    )
    rows = [replace(case, status="ads_error") for case in evaluation.cases_behind(score)]
    given_up = replace(evaluation, cases=tuple(rows), scores=(score,))
    (alone,) = assess(given_up, {score.scenario: partitions[score.scenario]}).assessments
    assert set(alone.intervals) >= {"task_share", "avoided_share", "s_plus"}
    assert alone.risk is None
    shown, confidence = assessed
    others = [item for item in confidence.assessments if item.scenario != score.scenario]
    beside = Additions(confidence=Confidence((alone, *others), confidence.coverage))
    page = write_report(shown, partitions, beside).read_text()
    low, high = score.s_plus_interval
    assert f"{low:.1f} to {high:.1f}" in page
    assert "not computed</span>: fewer than two evaluated cases with exposure" in page


def test_a_report_without_an_assessment_has_no_such_section(assessed, partitions):
    evaluation, _ = assessed
    page = write_report(evaluation, partitions).read_text()
    assert 'id="confidence"' not in page
    assert "How far these numbers can be trusted" not in page


def test_the_file_has_the_same_numbers(assessed, tmp_path):
    _, confidence = assessed
    found = json.loads(write_confidence(confidence, tmp_path).read_text())
    for plain, item in zip(found["scores"], confidence.assessments, strict=True):
        assert plain["ads"] == item.ads
        assert plain["scenario"] == item.scenario
        assert plain["s"]["low"] == item.intervals["s"].low
        assert plain["collision_probability"]["high"] == item.risk.collision_probability.high
        assert len(plain["further_cases"]["points"]) == len(item.further.points)
    assert set(found["coverage"]) == set(confidence.coverage)


# --- people's opinion stands in the report of a run once somebody has been asked ------------------


def test_the_section_is_there_only_where_people_were_asked(tmp_path):
    assert opinion_content(tmp_path) is None
    rated = RatedScore(
        "idm", "cut_out", 6.5, 0.5, 4,
        {"T": 0.5, "S+": 70.0, "A": -0.5, "S": 80.0, "D": None, "C": 0.25}
    )  # fmt: skip
    told = Opinion((rated,), dict.fromkeys(rated.scores), None)
    (tmp_path / OPINION).write_text(json.dumps(opinion_json(told)))
    content = opinion_content(tmp_path)
    dots = {panel["name"]: [dot["share"] for dot in panel["dots"]] for panel in content["panels"]}
    # 70 of 100; below 0; 80 of 100; no D
    assert dots == {"T": [0.5], "S+": [0.7], "A": [0.0], "S": [0.8], "D": [], "C": [0.25]}
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
        '{"rows": [{"opinion": 1, "deviation": 1, "scores": {}}], "correlations": {},'
        ' "concordance": null}',
        "[" * 100_000,
    ],
)
def test_a_damaged_file_of_opinions_is_said_and_not_passed_over(tmp_path, damage):
    (tmp_path / OPINION).write_text(damage)
    with refusal("ask again with: sumo-eval humans opinion"):
        opinion_content(tmp_path)
