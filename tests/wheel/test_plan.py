"""Orders that are balanced, and study files that say what they mean."""

import itertools
import shutil
from collections import Counter
from types import SimpleNamespace

import pytest
from refusals import refusal

from sumo_eval.extras.wheel import plan
from sumo_eval.extras.wheel.plan import (
    QuestionSettings,
    StudySettings,
    balanced_orders,
    read_study,
)
from sumo_eval.extras.wheel.study import Participant
from sumo_eval.extras.wheel.tape import json_lines
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings.config import settings_from

STUDY = 'name = "x"\nrun = "r"\nconsent = "c"\n'


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8])
def test_everything_stands_everywhere_and_follows_everything_equally_often(n):
    rows = balanced_orders(n)
    assert len(rows) == (n if n % 2 == 0 else 2 * n)
    assert all(sorted(row) == list(range(n)) for row in rows)
    for place in range(n):
        assert set(Counter(row[place] for row in rows).values()) == {len(rows) // n}
    after = Counter(pair for row in rows for pair in itertools.pairwise(row))
    assert len(after) == n * (n - 1)
    assert len(set(after.values())) <= 1


def test_a_journal_continues_after_a_line_that_was_cut_off(tmp_path):
    journal, person = tmp_path / "journal.jsonl", Participant("P01", 0, tmp_path)
    person.finish("begun", number=0)
    journal.write_bytes(journal.read_bytes() + b'{"step": "con')
    person.finish("consent", agrees=True)
    assert [entry["step"] for entry in json_lines(journal, "journal")] == ["begun", "consent"]


def test_a_text_for_the_rate_is_refused(tmp_path):
    (tmp_path / "study.toml").write_text('name = "x"\nrun = "r"\nrate = "50"\n')
    with refusal(r"`rate` in .* \(line 3\) must be one of 20, 50, 100, got '50'"):
        read_study(tmp_path / "study.toml")


@pytest.mark.parametrize(
    "questions, words",
    [
        ([("score", "replay")], r"after a replay must be distinct \(button, score, score\)"),
        ([("button", "drive")], "after a drive must be distinct"),
        ([("effort", "drive"), ("effort", "drive")], "got 'effort'"),
    ],
)
def test_questions_of_one_sheet_have_keys_of_their_own(tmp_path, questions, words):
    """One answer replaced the other; a question `button` was asked for ever."""
    tables = (f"[[question]]\nkey='{key}'\ntext='a'\nafter='{after}'\n" for key, after in questions)
    (tmp_path / "study.toml").write_text(STUDY + "".join(tables))
    with refusal(words):
        read_study(tmp_path / "study.toml")


def test_one_key_stands_after_the_drive_and_after_the_replay():
    questions = QuestionSettings("effort", "a"), QuestionSettings("effort", "b", "replay")
    own_score = QuestionSettings("score", "How well did you drive?")
    StudySettings("x", "r", "c", question=(*questions, own_score))


def test_more_passes_than_trials_are_refused(tmp_path):
    """No participant could pass."""
    (tmp_path / "study.toml").write_text(f"{STUDY}[practice]\npasses = 7\n")
    with refusal(r"`passes` of `practice` must be at most `most` \(6\), got 7"):
        read_study(tmp_path / "study.toml")


def test_a_case_names_a_scenario_file_with_options_wherever_its_tape_lies(tmp_path, monkeypatch):
    """The path stayed relative to the run's evaluation: `drive TAPE` did not find the scenario."""
    shutil.copy(scenario_files()["cut_in"], tmp_path / "mine.toml")
    entry = {"use": "mine.toml?lateral_acceleration=1.5"}
    settings = settings_from({"name": "x", "scenario": [entry]}, "x", own_ads=False)
    resolved = Resolved.of(settings, tmp_path)
    monkeypatch.setattr(plan, "resolved_run", lambda run: resolved)
    (logical,) = resolved.scenarios.values()
    values = {it.name: it.low for it in logical.parameters}
    fact = SimpleNamespace(scenario=logical.name, values=values, driver="idm")
    (case,) = plan._cases_of(tmp_path, {"x-0000": [fact]})
    assert find(case.use, tmp_path / "participants").name == logical.name
