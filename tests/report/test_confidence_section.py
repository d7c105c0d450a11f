"""The report's section on confidence: there with its numbers, or not there at all."""

import json
import shutil
from dataclasses import replace

import builders
import pytest
from lxml import html
from scoring.confidence.scored_by_hand import with_intervals_of

from sumo_eval.record.run_folder import FACTS
from sumo_eval.report.confidence_section import write_confidence
from sumo_eval.report.html import write_report
from sumo_eval.report.sections import Additions
from sumo_eval.scoring.confidence.assessment import Confidence, assess
from sumo_eval.settings import RunSettings


@pytest.fixture(scope="module")
def assessed(evaluation, partitions, tmp_path_factory):
    folder = tmp_path_factory.mktemp("section")
    shutil.copy(evaluation.folder / FACTS, folder)
    calm = with_intervals_of(evaluation, partitions, builders.CALM).scores
    copy = replace(
        evaluation,
        folder=folder,
        scores=calm,
        settings=replace(evaluation.settings, run=RunSettings(workers=1)),
    )
    return replace(evaluation, folder=folder), assess(copy, partitions)


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


def test_a_report_without_an_assessment_has_no_such_section(assessed, partitions):
    evaluation, _ = assessed
    page = write_report(evaluation, partitions).read_text()
    assert 'id="confidence"' not in page
    assert "How far these numbers can be trusted" not in page


def test_the_file_has_the_same_numbers(assessed, tmp_path):
    _, confidence = assessed
    found = json.loads(write_confidence(confidence, tmp_path).read_text())
    for plain, item in zip(found["scores"], confidence.assessments, strict=True):
        assert (plain["ads"], plain["scenario"]) == (item.ads, item.scenario)
        assert plain["s"]["low"] == item.intervals["s"].low
        assert plain["collision_probability"]["high"] == item.risk.collision_probability.high
        assert len(plain["further_cases"]["points"]) == len(item.further.points)
    assert set(found["coverage"]) == set(confidence.coverage)
