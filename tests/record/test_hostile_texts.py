"""A run of ADSs whose exceptions hold anything: a row each, a run folder of ordinary size, files
that can be read."""

import csv
import shutil
from pathlib import Path

import hostile_texts
import pytest
from laid import read_json
from lxml import etree
from runs import sumo_eval_cli

from sumo_eval.record.store import open_store
from sumo_eval.text import LOG, SENTENCE

ADSS = {
    "Long": "ValueError: xxxxxxxx",
    "Speechless": "SpeechlessError: (its text is not available: __str__ raised ValueError)",
    "Surrogate": r"SurrogateError: lost \ud800 half",
    "Controls": r"ValueError: nul \x00 escape \x1b[31m turned \u202e <script>alert(1)</script> "
    r"second line",
    "Formula": "two arguments at 0.05 s.",
    "Leaves": "SystemExit: =HYPERLINK()",
    "Interrupts": "RuntimeError: it raised KeyboardInterrupt",
    "OwnBase": "Own: not an Exception",
}
FORMULA_NAME = "=1+2"
POINTS = 3  # of 2 x 2, one of which a constraint refuses
EVALUATION = """
name = "hostile"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[drivers]
count = 2
[run]
workers = 2
[[ads]]
name = "=1+2"
controller = "idm"
""" + "".join(
    f'[[ads]]\nname = "{name}"\ncontroller = "hostile_texts.py:{name}"\n' for name in ADSS
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile")
    shutil.copy(Path(__file__).with_name("hostile_texts.py"), folder)
    (folder / "evaluation.toml").write_text(EVALUATION)
    done = sumo_eval_cli("run", folder / "evaluation.toml", "--out", folder / "out", status=3)
    assert "Traceback" not in done.said
    return done.stdout, folder / "out"


def rows(folder):
    with (folder / "cases.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_module_of_this_test_drives_every_ads():
    assert {name for name, item in vars(hostile_texts).items() if hasattr(item, "step")} == set(
        ADSS
    )


@pytest.mark.parametrize("name", ADSS)
def test_every_such_exception_is_a_row_with_message_and_place(run, name):
    _, folder = run
    found = [row for row in rows(folder) if row["ads"] == name]
    assert len(found) == POINTS
    for row in found:
        assert row["status"] == "ads_error"
        assert ADSS[name] in row["error"]
        assert len(row["error"]) <= SENTENCE
        assert row["error_place"].startswith("hostile_texts.py:")
        assert row["error_place"].endswith(" in step")


def test_the_run_folder_has_an_ordinary_size_and_logs_are_bounded(run):
    _, folder = run
    # one message of 40 MB alone would be 20 times that
    assert (folder / "facts.sqlite").stat().st_size < 2_000_000
    assert sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) < 10_000_000
    with open_store(folder) as store:
        for fact in store.facts("ads"):
            assert len(fact.log) <= LOG
            assert "\x1b" not in fact.log


def test_every_file_of_the_run_can_be_read(run):
    _, folder = run
    scores = read_json(folder / "scores.json")
    assert {score["ads"] for score in scores["scores"]} == {FORMULA_NAME, *ADSS}
    errors = etree.parse(folder / "junit.xml").findall(".//error")
    assert len(errors) >= POINTS * len(ADSS)
    for name in ADSS:
        messages = [
            item.get("message")
            for item in errors
            if item.getparent().get("classname").endswith(f".{name}")
        ]
        assert messages
        assert all("At hostile_texts.py:" in message for message in messages), messages
    page = (folder / "report.html").read_text()
    assert "<script>alert(1)" not in page
    assert "\x1b" not in page
    assert "<code>hostile_texts.py:" in page


def test_the_names_that_a_spreadsheet_would_run_are_quoted(run):
    _, folder = run
    text = (folder / "cases.csv").read_text()
    assert "'=1+2" in text
    assert ",=1+2" not in text


def test_the_terminal_names_the_first_of_each_kind_and_counts(run):
    said, _ = run
    lines = [line for line in said.splitlines() if " At hostile_texts.py:" in line]
    assert len(lines) == 5  # kinds; the report has the others
    assert all(
        " and 2 more: The ADS " in line or " and 2 more: two arguments" in line for line in lines
    ), lines
    assert "  and 9 more, all in cases.csv." in said.splitlines()  # 3 kinds of 3 cases
    assert "\x1b" not in said


def test_such_a_run_can_be_resumed_scored_reported_explained_and_exported(run, tmp_path):
    _, folder = run
    case = next(row["case"] for row in rows(folder) if row["ads"] == "Controls")
    for status, arguments in (
        (3, ("run", "--out", folder, "--resume")),
        (3, ("score", folder)),
        (3, ("report", folder)),
        (0, ("explain", folder, case)),
        (0, ("export", folder, "--format", "csv", "--out", tmp_path)),
    ):
        done = sumo_eval_cli(*arguments, status=None)
        assert done.returncode in (status, 0), (arguments, done.stderr)
        if arguments[0] == "explain":
            assert " At hostile_texts.py:" in done.stdout
    for name in ("cases.csv", "drives.csv"):
        assert "'=1+2" in (tmp_path / name).read_text()
