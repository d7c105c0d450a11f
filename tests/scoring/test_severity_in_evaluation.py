"""A severity of one's own from the evaluation file to the scores, on real SUMO runs."""

from dataclasses import replace

import pytest
from laid import read_json
from refusals import refusal

import sumo_eval
from sumo_eval.method.severity import injury_risk
from sumo_eval.report.tables import write_tables
from sumo_eval.score_notes import BeyondRange
from sumo_eval.scoring.comparability import differences
from sumo_eval.scoring.quantities import combine

OWN = """
def by_speed(contact):
    return min(contact.closing_speed / 50.0, 1.0) * contact.ego_mass / (contact.ego_mass + contact.other_mass)

def none_below_100_m_s(contact):
    return float(contact.closing_speed > 100.0)

def example_only(contact):
    return 0.5 if contact.other == "example" else float("nan")
"""


def evaluation_file(folder, severity):
    (folder / "own.py").write_text(OWN)
    path = folder / "evaluation.toml"
    path.write_text(f"""
name = "severities"
[[scenario]]
use = "front_vehicle_cut_out"
[scenario.sampling]
levels = 3
[[ads]]
name = "idm"
controller = "idm"
[[ads]]
name = "no_reaction"
controller = "no_reaction"
[drivers]
count = 3
[run]
engine = "serial"
[method.collision]
severity = "{severity}"
ego_mass = 3000.0
""")
    return path


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("severity")
    evaluation = sumo_eval.evaluate(evaluation_file(folder, "own.py:by_speed"), folder / "run")
    write_tables(evaluation)
    return evaluation


def test_an_own_severity_replaces_u_in_every_score(found):
    hits = [case for case in found.cases if case.collided]
    assert len(hits) >= 3
    for case in hits:  # 3,000 kg against 1,500 kg: two thirds
        assert case.severity == pytest.approx(min(case.impact_speed / 50.0, 1.0) * 2.0 / 3.0)
        assert case.loss in (0.4, 0.7, 1.0), "L stays the class of U"
    for score in found.scores:
        cases = [case for case in found.cases if case.ads == score.ads]
        rows = combine(score.ads, score.scenario, cases, found.settings.method)
        for name in ("c", "avoided_share", "regret"):
            assert getattr(score, name) == pytest.approx(getattr(rows, name))


def test_the_scores_tell_which_severity_they_were_made_with(found):
    made_with = read_json(found.folder / "scores.json")["severity"]
    assert made_with["name"] == "own.py:by_speed"
    assert made_with["unit"] == "loss"
    assert len(made_with["sha256"]) == 64
    manifest = found.manifest | {"severity": made_with | {"sha256": "0" * 64}}
    edited = replace(found, manifest=manifest)
    assert [item.what for item in differences(found, edited) if item.decides] == [
        "file of the severity"
    ]


def test_another_severity_needs_no_simulation_and_says_where_its_range_ends(found):
    again = sumo_eval.score(found.folder, ["method.collision.severity=injury:cyclist"])
    for case in again.cases:
        if case.collided:
            assert case.severity == pytest.approx(float(injury_risk("cyclist", case.impact_speed)))
    fast = sum(case.collided and case.impact_speed > 100.0 / 3.6 for case in again.cases)
    said = [note for score in again.scores for note in score.notes if isinstance(note, BeyondRange)]
    assert fast > 0
    assert sum(number for note in said for _, number in note.reasons) == fast
    assert {note.severity for note in said} == {"injury:cyclist"}
    by_class = sumo_eval.score(found.folder, ["method.collision.severity=eq14"])
    as_before = sumo_eval.score(
        found.folder, ["method.collision.severity=severity", "method.collision.loss=class"]
    )
    assert by_class.scores[0].c == as_before.scores[0].c


CLOSE = """
name = "close"
parameter = [{ name = "gap0", unit = "m", low = 3.0, high = 6.0, step = 3.0 }]
ego = { speed = 30.0 }
vehicle = [{ name = "lead", speed = 5.0, gap = "gap0" }]
zone = { obstacle = "lead" }
end = { x = 200.0 }
"""


def test_contact_without_loss_is_a_contact_of_the_ideal_vehicle(tmp_path):
    (tmp_path / "close.toml").write_text(CLOSE)
    path = evaluation_file(tmp_path, "own.py:none_below_100_m_s")
    text = path.read_text().replace("front_vehicle_cut_out", "close.toml")
    path.write_text(text.replace("levels = 3", "levels = 2"))
    evaluation = sumo_eval.evaluate(path, tmp_path / "run")
    for score in evaluation.scores:
        assert score.unavoidable_collisions == score.collisions == 2
    assert not any(case.beats_ideal for case in evaluation.cases)


def test_a_wrong_loss_names_the_case_and_loses_nothing(found):
    with refusal(r"`own.py:example_only` must return .* got nan for front_vehicle_cut_out"):
        sumo_eval.score(found.folder, ["method.collision.severity=own.py:example_only"])
    assert sumo_eval.score(found.folder).scores[0].c == found.scores[0].c


def test_a_wrong_severity_is_refused_before_the_first_case(tmp_path):
    with refusal("Did you mean `by_speed`"):
        sumo_eval.evaluate(evaluation_file(tmp_path, "own.py:by_sped"), tmp_path / "run")
    assert not (tmp_path / "run").exists()
