"""JUnit: a failure is the ADS doing badly, an error is a harness that could not tell; junitparser
reads it back."""

from dataclasses import replace

import junitparser
import numpy as np
import pytest
from report_cases import HIT, pick, with_case, with_settings

from sumo_eval.nightly.gates import judge
from sumo_eval.report.junit import comparison_suites, run_suites, write_junit
from sumo_eval.report.words import number
from sumo_eval.scoring.comparison import compare
from sumo_eval.scoring.findings import unevaluated
from sumo_eval.scoring.gate_settings import GateSettings, LimitSettings
from sumo_eval.settings import ReportSettings
from sumo_eval.text import point_words


def suites_of(evaluation, folder):
    path = write_junit(run_suites(evaluation), folder / "junit.xml")
    return junitparser.JUnitXml.fromfile(str(path))


def read(suites):
    """Suite -> test -> what junitparser says of it: passed, failure, error or skipped."""
    return {
        suite.name: {
            case.name: type(case.result[0]).__name__.lower() if case.result else "passed"
            for case in suite
        }
        for suite in suites
    }


def with_report(evaluation, **values):
    return with_settings(evaluation, report=ReportSettings(**values))


def test_every_case_is_a_test_with_the_verdict_of_the_table(evaluation, tmp_path):
    found = read(suites_of(evaluation, tmp_path))
    missing = {case.case for table in unevaluated(evaluation) for case in table}
    assert sum(len(tests) for tests in found.values()) == len(evaluation.cases)
    for score in evaluation.scores:
        tests = found[f"{score.ads} in {score.scenario}"]
        for case in evaluation.cases:
            if (case.ads, case.scenario) != (score.ads, score.scenario):
                continue
            expected = (
                "error"
                if not case.evaluated
                else "failure"
                if (case.collided and not case.unavoidable) or case.status == "off_road"
                else "error"
                if case.case in missing
                else "passed"
            )
            assert tests[point_words(case.values)] == expected, case.case


def test_a_suite_names_s_plus_and_its_parts(evaluation, tmp_path):
    """Departures and giving up are told with what they cost. junitparser reads properties back."""
    safe, other = (
        pick(evaluation, collided=hits, zone=zone)
        for hits, zone in ((False, "safe"), (True, "hazardous"))
    )
    left = {"departure_time": 2.5, "departure_speed": 20.0, "departure_severity": 20.0}
    odd = with_case(evaluation, safe, **left, task_share=0.0)
    odd = with_case(odd, other, status="ads_error", no_reaction_severity=7.5)
    xml = suites_of(odd, tmp_path)
    for suite, score in zip(xml, odd.scores, strict=True):
        said = {one.name: one.value for one in suite.properties()}
        assert said["T"] == number(score.task_share, 4)
        assert said["S+ of its parts"].startswith("S+ ")
    left, gave_up = (
        next(case.result[0] for suite in xml for case in suite
             if suite.name == f"{one.ads} in {one.scenario}" and case.name == point_words(one.values))
        for one in (safe, other)
    )  # fmt: skip
    assert isinstance(left, junitparser.Failure)
    assert "left the road at 2.5 s, 20.0 m/s: U = 20.00 m/s" in left.text
    assert "t of T = 0.000" in left.text
    assert isinstance(gave_up, junitparser.Error)
    assert "giving up counts as doing nothing: U = 7.50 m/s" in gave_up.text


def test_the_folder_of_the_file_is_made(evaluation, tmp_path):
    assert write_junit(run_suites(evaluation), tmp_path / "reports" / "compare.xml").is_file()


def test_the_totals_are_the_sums(evaluation, tmp_path):
    xml = suites_of(evaluation, tmp_path)
    stated = xml.tests, xml.failures, xml.errors
    xml.update_statistics()
    assert stated == (xml.tests, xml.failures, xml.errors)
    assert xml.failures > 0
    assert xml.errors > 0


def test_an_unavoidable_collision_passes_unless_the_setting_says_any(evaluation, tmp_path):
    hard = with_report(evaluation, junit_failures="any")
    mild, strict = (read(suites_of(one, tmp_path)) for one in (evaluation, hard))
    softened = 0
    for case in evaluation.cases:
        suite, name = f"{case.ads} in {case.scenario}", point_words(case.values)
        if case.collided and case.zone == "hazardous" and case.ideal_severity:
            assert strict[suite][name] == "failure"
            assert mild[suite][name] == "passed"
            softened += 1
        elif case.collided and case.ideal_severity == 0.0:
            assert mild[suite][name] == "failure"
    assert softened


def test_a_failure_says_whether_the_collision_was_avoidable_or_caused(evaluation, tmp_path):
    struck = next(
        case for case in evaluation.cases if case.unavoidable and case.no_reaction_severity
    )
    evaluation = with_case(evaluation, struck, ideal_severity=0.0)
    said = {
        (suite.name, case.name): case.result[0].message
        for suite in suites_of(evaluation, tmp_path)
        for case in suite
        if case.result
    }
    kinds = set()
    for case in evaluation.cases:
        if case.avoidable:
            kind = "caused" if case.caused else "avoidable"
            kinds.add(kind)
            message = said[f"{case.ads} in {case.scenario}", point_words(case.values)]
            assert message.startswith(f"{kind} collision of {case.ads} in the {case.zone} zone")
    assert kinds == {"caused", "avoidable"}


def test_a_cell_fails_when_a_case_in_it_does(evaluation, tmp_path):
    """Two cells an axis over three levels: at most 2 x 2 x 2 tests a scenario instead of one a
    case."""
    celled = with_report(evaluation, junit="cell", junit_cells=2)
    by_case, cases = (suites_of(one, tmp_path) for one in (evaluation, celled))
    by_case, by_cell = read(by_case), read(cases)
    for suite, tests in by_cell.items():
        assert len(tests) <= 8
        assert ("failure" in tests.values()) == ("failure" in by_case[suite].values())
    said = [case.result[0].message for suite in cases for case in suite if case.result]
    assert any("cases failed" in message for message in said)


def test_the_cells_are_those_of_the_space_whatever_was_sampled(evaluation, tmp_path):
    """Their names followed the sample: CI lost the history of the tests."""
    celled = with_report(evaluation, junit="cell", junit_cells=2)
    part = replace(celled, cases=celled.cases[np.arange(len(celled.cases)) % 3 == 1])
    whole, fewer = (read(suites_of(one, tmp_path)) for one in (celled, part))
    for suite, tests in fewer.items():
        assert tests.keys() <= whole[suite].keys()
        assert tests


def test_a_comparison_has_a_suite_of_gates_and_one_test_a_case(evaluation, tmp_path):
    case = pick(evaluation, collided=False)
    other = with_case(evaluation, case, **HIT)
    settings = GateSettings(resamples=100)
    limited = replace(settings, limit=(LimitSettings("new_collisions", at_most=0.0),))

    def compared(comparison, settings):
        suites = comparison_suites(comparison, judge(other, comparison, settings))
        return read(junitparser.JUnitXml.fromfile(str(write_junit(suites, tmp_path / "junit.xml"))))

    found = compared(compare(evaluation, other, settings), settings)
    assert found["gates"][f"collided of {case.ads} in {case.scenario}"] == "failure"
    beside = found[f"{case.ads} in {case.scenario} beside the base"]
    assert [name for name, verdict in beside.items() if verdict == "failure"] == [
        point_words(case.values)
    ]
    assert set(compared(None, limited)["gates"].values()) == {"skipped"}


def test_a_case_that_neither_run_evaluated_is_an_error(evaluation, tmp_path):
    """It passed, while `compare` exited with 3."""
    lost = next(case for case in evaluation.cases if not case.evaluated)
    suites = comparison_suites(compare(evaluation, evaluation, GateSettings(resamples=100)), [])
    xml = junitparser.JUnitXml.fromfile(str(write_junit(suites, tmp_path / "junit.xml")))
    (result,) = next(
        case.result
        for suite in xml
        for case in suite
        if suite.name == f"{lost.ads} in {lost.scenario} beside the base"
        and case.name == point_words(lost.values)
    )
    assert isinstance(result, junitparser.Error)
    assert result.message.startswith("not evaluated, as in the base: ")


@pytest.mark.parametrize("text", ["\x00\x1b[31m", "]]><x>&", "\ud800", "line\nline"])
def test_whatever_a_controller_says_the_file_stays_xml(evaluation, text, tmp_path):
    broken = next(case for case in evaluation.cases if case.status == "crashed")
    found = read(suites_of(with_case(evaluation, broken, error=text), tmp_path))
    assert found[f"{broken.ads} in {broken.scenario}"][point_words(broken.values)] == "error"
