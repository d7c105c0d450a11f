"""Nights in a row: good, worse, broken, killed, twice at once; the history only grows, folders go
by a rule."""

import errno
import fcntl
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import junitparser
import pytest
from commands import cli_refuses, sumo_eval
from laid import read_json, replace_in
from record.edited_store import edit
from record.runs import rows
from refusals import refusal
from tables import in_campaign

from cli.nights import evaluation, plant
from sumo_eval import evaluate, open_run
from sumo_eval.errors import InputError, StoppedError
from sumo_eval.evaluation import score
from sumo_eval.nightly import night
from sumo_eval.nightly.history import HISTORY, Accepted, open_history
from sumo_eval.nightly.night import (
    _clear_away,
    _prune,
    _refuse_without_room,
    import_run,
    run_night,
)
from sumo_eval.nightly.repeats import _differences, repeats_of
from sumo_eval.record.store import open_store
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.scoring.gate_settings import GateSettings, NoiseSettings


def run(file, history, **more):
    return run_night(file, history, GateSettings(resamples=100), **more)


def nightly(file, history, *words, status=0):
    return sumo_eval("nightly", file, "--history", history, *words, status=status)


def nights_of(history):
    """The names of its nights' folders."""
    return {path.name for path in (history / "nights").iterdir()}


def nights(history):
    with open_history(history) as lines:
        return lines.nights()


@pytest.fixture(scope="module")
def week(tmp_path_factory):
    """Four nights that keep two folders: good, good, worse, and one in which a case could not be
    evaluated."""
    folder = tmp_path_factory.mktemp("week")
    file, history, outputs = evaluation(folder), folder / "history", []
    for fault, status in (("", 0), ("", 0), ("30, 0:sleeps", 1), ("20, 0:raises", 1)):
        plant(folder, fault)
        outputs.append(nightly(file, history, "--keep", "2", status=status).stdout)
    return file, history, outputs


def test_each_night_is_compared_with_the_last_good_one(week):
    _, history, outputs = week
    found = nights(history)
    assert [night.exit_status for night in found] == [0, 0, 1, 1]
    assert [night.base for night in found] == [None, found[0].night, found[1].night, found[1].night]
    assert outputs[0].startswith("FIRST: there is no earlier good run to compare with")
    assert outputs[1].startswith("THE SAME as")
    assert "6 cases equal to the last bit; no avoidable collision" in outputs[1].splitlines()[0]
    assert outputs[2].startswith("WORSE than")
    assert "1 case collided, not so in the base (new)" in outputs[2]
    assert "ego_speed=30, lead_speed=0: ok -> contact with U 30.0 m/s" in outputs[2]
    assert "  collision_probability: 0.0000 -> 0.1667" in outputs[2], "the last line of the changes"
    assert "1 case gave up, not so in the base (new)" in outputs[3]
    worse = (history / found[2].folder / "report.html").read_text()
    assert "ego_speed=30, lead_speed=0</a>, collision at" in worse, "its levers are drawn"
    assert worse.count('class="whisker lever"') >= 8
    assert "no plan here" in outputs[3]


def test_the_first_good_night_pins_itself_and_keeps_its_folder(week):
    _, history, _ = week
    with open_history(history) as lines:
        (pin,) = lines.accepted()
        first = lines.nights()[0]
    assert (pin.night, pin.itself, pin.reason) == (first.night, True, "the first good night")
    assert (history / first.folder).is_dir()


def test_a_night_leaves_what_people_and_machines_read(week):
    _, history, _ = week
    last = history / nights(history)[-1].folder
    for name in ("report.html", "junit.xml", "scores.json", "cases.csv", "facts.sqlite"):
        assert (last / name).is_file()
    assert junitparser.JUnitXml.fromfile(str(last / "junit.xml")).errors >= 1
    assert "no plan here" in (last / "junit.xml").read_text()
    page = (last / "report.html").read_text()
    top = page[: page.index('id="change"')]
    assert (
        "<b>new</b> mine in <code>front_vehicle_low_speed</code>: 1 case gave up, not so in the "
        "base" in top
    )
    case = read_json(last / "night.json")["failed"][0]["cases"][0]
    assert f'data-opening="{case["case"]}"' in top, "the picture is of the worst new failure"
    assert case["run"] == f"sumo-eval run {last} --only {case['case']}"
    told = read_json(history / "chat.json")["text"]
    assert "1 case gave up, not so in the base" in told
    trend = (history / "trend.html").read_text()
    assert trend.count("<svg data-chart") >= 5
    assert f'href="{nights(history)[-1].folder}/report.html"' in trend


def test_the_newest_nights_and_the_last_good_one_keep_their_folders(week):
    """Two folders are kept, the third and the fourth; the second is the last good one, the first is
    accepted."""
    _, history, _ = week
    found = nights(history)
    assert [(history / night.folder).is_dir() for night in found] == [True] * 4


def test_the_history_cannot_be_changed(week, tmp_path):
    copy = tmp_path / "history.sqlite"
    shutil.copy(week[1] / "history.sqlite", copy)
    connection = sqlite3.connect(copy)
    for table in ("nights", "quantities", "gates", "begun", "accepted"):
        for change in (f"UPDATE {table} SET night = 'x'", f"DELETE FROM {table}"):
            with pytest.raises(sqlite3.IntegrityError, match="only added to"):
                connection.execute(change)
    connection.close()


def test_a_second_night_is_refused_while_one_is_running(week):
    file, history, _ = week
    before = len(nights(history))
    with (history / "lock").open("a+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = nightly(file, history, status=2)
        last = history / nights(history)[-1].folder
        imported = sumo_eval("trend", history, "--import", last, status=2)
    assert "Another night is running" in done.stderr
    assert f"{last} was not added: import it once that night has ended" in imported.stderr
    assert len(nights(history)) == before


def test_a_night_may_begin_while_a_run_is_scored_for_import(week, tmp_path, monkeypatch):
    history = tmp_path / "history"
    history.mkdir()

    def scored(run, **more):
        with (history / "lock").open("a+") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while another has it
        return score(run, **more)

    monkeypatch.setattr(night, "score", scored)
    last = week[1] / nights(week[1])[-1].folder
    assert night.import_run(history, last).folder == str(last)


@pytest.fixture
def file(week):
    """The evaluation of the week, whose ADS has no fault any more."""
    plant(week[0].parent, "")
    return week[0]


@pytest.fixture
def history(week, tmp_path):
    """A copy of the week's history, to continue it."""
    return Path(shutil.copytree(week[1], tmp_path / "history"))


@pytest.fixture
def lost(history):
    """The nights of such a copy without the history itself."""
    (history / "history.sqlite").unlink()
    return history


def test_what_a_killed_night_left_is_removed_and_said(file, history):
    left = history / "nights" / "2026-01-01T00-00-00Z"
    left.mkdir()
    (left / "facts.sqlite").write_bytes(b"half a night")
    foreign = history / "nights" / "my_notes"
    foreign.mkdir()
    with open_history(history, create=True) as lines:
        lines.begin(left.name)
    result = run(file, history, keep=5)
    assert not left.exists()
    assert any("2026-01-01T00-00-00Z was stopped before its end" in note for note in result.notes)
    assert foreign.is_dir()
    assert f"{foreign} is not in the history; it was left as it is." in result.notes
    assert result.night.exit_status == 0


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A folder with an evaluation and a history whose only night was killed while cases were
    driven."""
    folder = tmp_path_factory.mktemp("killed")
    file = evaluation(folder, "{ ego_speed = 8, lead_speed = 6 }", engine="processes")
    replace_in(file, "cases_per_pack = 32", "cases_per_pack = 4")
    stop_when(lambda: recorded(folder / "history") >= 5, file, folder / "history")
    return folder


def copied(folder, tmp_path):
    """A copy of it to go on with: the evaluation, the history, the folder that the killed night
    left."""
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    (left,) = (copy / "history" / "nights").iterdir()
    return copy / "evaluation.toml", copy / "history", left


def stop_when(reached, file, history):
    """Kill a night, and all that it started, once that is reached."""
    command = [sys.executable, "-m", "sumo_eval", "nightly", str(file), "--history", str(history)]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    ) as process:
        deadline = time.monotonic() + 120.0
        while not reached() and time.monotonic() < deadline:
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGKILL)


def recorded(history):
    """How many drives a night that has no line holds."""
    return sum(map(rows, history.glob("nights/*")))


def test_a_killed_night_continues_to_the_digest_of_a_whole_one(killed, tmp_path):
    file, history, left = copied(killed, tmp_path)
    replace_in(file, '"processes"', '"serial"')
    kept = recorded(history)
    assert nights(history) == []

    done = nightly(file, history, "--resume")
    assert f"Night {left.name} was stopped before its end and continued" in done.stdout.replace(
        "\n", " "
    )
    (night,) = nights(history)
    assert night.night == left.name
    assert night.folder == f"nights/{left.name}"
    assert night.wall_time is None
    assert "continued with its recorded cases" in (left / "report.html").read_text()
    assert 0 < kept < rows(left)
    assert len(read_json(left / "manifest.json")["resumed"]) == 1

    after = nightly(file, history, "--resume")
    assert "There is no stopped night to continue; this one is a new one." in after.stdout.replace(
        "\n", " "
    )
    assert after.stdout.startswith("THE SAME as")
    whole = nights(history)[-1]
    assert whole.base == left.name
    assert open_run(left).digest() == open_run(history / whole.folder).digest()


def test_imported_night_is_not_continued(file, history, monkeypatch):
    """Continued, it would be driven with today's ADS and compared with itself."""
    with monkeypatch.context() as patch:
        patch.setattr("sumo_eval.nightly.night.judge_night", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(StoppedError):
            run(file, history)
    imported = import_run(history, max((history / "nights").iterdir())).night
    sumo_eval("accept", history, imported, "--reason", "good")
    plant(file.parent, "30, 0:sleeps")
    result = run(file, history, resume=True)
    assert "There is no stopped night to continue; this one is a new one." in result.notes
    assert (result.night.base, result.night.exit_status) == (imported, 1)


def test_a_night_of_another_evaluation_is_not_continued(tmp_path):
    file, history = evaluation(tmp_path, "3"), tmp_path / "history"
    run(file, history)
    with open_history(history, create=True) as lines:
        lines.begin("2999-01-01T00-00-00Z")
    left = history / "nights" / "2999-01-01T00-00-00Z"
    shutil.copytree(history / nights(history)[0].folder, left)
    replace_in(file, '"mine"', '"theirs"')
    done = nightly(file, history, "--resume", status=2)
    assert f"Night {left.name} was not continued:" in done.stderr.replace("\n", " ")
    assert "It stays; without --resume" in done.stderr.replace("\n", " ")
    assert (left / "facts.sqlite").is_file()
    assert len(nights(history)) == 1


@pytest.mark.parametrize(
    "fault",
    [
        OSError(errno.EIO, "Input/output error"),
        in_campaign(KeyboardInterrupt()),
    ],
)
def test_a_disk_that_fails_without_being_full_and_a_late_ctrl_c_keep_the_night(
    file, history, fault, monkeypatch
):

    def broken(*_):
        raise fault

    monkeypatch.setattr("sumo_eval.nightly.night.write_tables", broken)
    with pytest.raises(
        (InputError, StoppedError), match="The same command with --resume continues"
    ):
        run(file, history)
    monkeypatch.undo()
    before = len(nights(history))
    result = run(file, history, resume=True)
    assert any("before its end and continued" in note for note in result.notes)
    assert len(nights(history)) == before + 1


@pytest.mark.parametrize("fault", [KeyboardInterrupt(), OSError(errno.EIO, "Input/output error")])
def test_a_night_stopped_before_it_recorded_cannot_be_continued(tmp_path, fault, monkeypatch):
    """Ctrl-C while its ADSs load, for example."""

    def stop(*_, **__):
        raise fault

    monkeypatch.setattr("sumo_eval.nightly.night.record_rounds", stop)
    with pytest.raises(
        (InputError, StoppedError), match="recorded nothing; the same command begins a new night"
    ):
        run(evaluation(tmp_path), tmp_path / "history")


def test_a_full_disk_leaves_earlier_nights_alone(file, history, monkeypatch):
    before = nights(history)

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("sumo_eval.nightly.night.write_junit", full)
        with refusal("No space left on device"):
            run(file, history)
    assert nights(history) == before
    assert nights_of(history) == {night.night for night in before}
    monkeypatch.setattr("shutil.disk_usage", lambda _: shutil._ntuple_diskusage(100, 90, 10))
    with refusal("The night was not begun: it may need"):
        run(file, history)


def size_of(folder):
    return sum(path.stat().st_size for path in folder.rglob("*"))


def test_a_night_needs_room_for_the_copy_of_a_noisy_ads(history, monkeypatch):
    """The rerun of its cases copies the whole run."""
    last = history / nights(history)[-1].folder
    free = shutil._ntuple_diskusage(0, 0, 2 * size_of(last))
    monkeypatch.setattr("shutil.disk_usage", lambda _: free)
    with open_history(history) as lines:
        with refusal("The night was not begun: it may need"):
            _refuse_without_room(history, lines, GateSettings(), None)
        _refuse_without_room(history, lines, GateSettings(noise=NoiseSettings(cases=0)), None)


def test_a_night_without_room_leaves_what_a_killed_one_left(file, history, monkeypatch):
    """The killed night may still be continued. The folder that would be removed counts as free."""
    left = history / "nights" / "2026-01-01T00-00-00Z"
    left.mkdir()
    with open_history(history, create=True) as lines:
        lines.begin(left.name)
    monkeypatch.setattr("shutil.disk_usage", lambda _: shutil._ntuple_diskusage(0, 0, 10))
    with refusal("The night was not begun: it may need"):
        run(file, history)
    assert left.is_dir()
    last = history / nights(history)[-1].folder
    (left / "facts.sqlite").write_bytes(bytes(3 * size_of(last)))
    with open_history(history) as lines:
        _refuse_without_room(history, lines, GateSettings(), None)


def test_a_disk_full_of_recorded_cases_is_freed(file, history, monkeypatch):
    """SQLite, not the operating system, reports a disk that fills up while cases are recorded."""
    before = nights(history)

    def full(_, run, **__):
        run.mkdir(parents=True)
        with open_store(run, create=True) as store:
            store._connection.execute("PRAGMA max_page_count = 1")
            store.note("filler", "x" * 1_000_000)

    with monkeypatch.context() as patched:
        patched.setattr("sumo_eval.nightly.night.record_rounds", full)
        with refusal("The night could not be finished: OperationalError: database or disk is full"):
            run(file, history)
    assert nights_of(history) == {it.night for it in before}

    def copy(*_):
        """A copy of the run, made to rerun its cases, fills the disk."""
        raise shutil.Error([("facts.sqlite", "again", str(OSError(errno.ENOSPC, os.strerror(28))))])

    monkeypatch.setattr("sumo_eval.nightly.night.judge_night", copy)
    with refusal("Its recorded cases were removed"):
        run(file, history)
    assert nights_of(history) == {it.night for it in before}


@pytest.mark.parametrize(
    "fault, words",
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/proc/x"), "with --resume continues"),
        (InputError("ADS `mine` cannot be loaded: No space left on device."), "It stays;"),
    ],
)
def test_another_full_disk_leaves_the_night(file, history, fault, words, monkeypatch):
    """A small /tmp, or the ADS's own: the night's folder is on another disk than /proc."""
    run(file, history)
    left = history / "nights" / "2999-01-01T00-00-00Z"
    shutil.copytree(history / nights(history)[-1].folder, left)
    with open_history(history, create=True) as lines:
        lines.begin(left.name)

    def full(*_):
        raise fault

    monkeypatch.setattr("sumo_eval.nightly.night.judge_night", full)
    with refusal(words):
        run(file, history, resume=True)
    assert (left / "facts.sqlite").is_file()


def test_a_damaged_accepted_night_fails_until_another_is(file, history):
    """Without it a slow drift passes night by night, and a note alone wakes no user."""
    first, last = nights(history)[:2]
    (history / first.folder / "facts.sqlite").write_bytes(b"damaged")
    (history / last.folder / "night.json").write_text("{")
    result = run(file, history)
    assert any("Remove this file; the night stays a base." in note for note in result.notes)
    assert result.night.exit_status == 1
    (failed,) = read_json(result.report.parent / "night.json")["failed"]
    assert failed["sentence"].startswith("the accepted night cannot be compared with, so slow")
    assert any(first.night in note for note in result.notes)

    sumo_eval("accept", history, "--reason", "the accepted one was damaged")
    assert run(file, history).night.verdict.startswith("THE SAME as")


def test_lost_pairs_fail_until_they_are_accepted(history, tmp_path):
    """Two levels of three: the middle ones are gone, three of six cases, more than a tenth.

    Both corners are judged.
    """
    file = evaluation(tmp_path, "2")
    result = run(file, history)
    assert result.night.exit_status == 1
    assert result.judgement.bases.comparison.pairs == 3
    told = read_json(result.report.parent / "night.json")
    assert told["verdict"] == "incomplete"
    assert [one["what"] for one in told["differences"]] == [
        "scenario.front_vehicle_low_speed.sampling.levels"
    ]
    (failed,) = told["failed"]
    assert "3 of the base's 6 cases have no partner" in failed["sentence"]
    assert f"sumo-eval accept {history} --reason" in failed["sentence"]
    assert told["unpaired"][0]["lost"] == 3

    done = sumo_eval("accept", history, "--reason", "fewer levels on purpose")
    assert "accepted: every ADS" in done.stdout
    again = run(file, history)
    assert again.night.exit_status == 0
    assert again.night.base == result.night.night
    assert again.night.verdict.startswith("THE SAME as")


def test_texts_that_are_not_utf8_lose_no_night(week, tmp_path):
    """The sentence on lost pairs has the path of the history in it."""
    latin = os.fsdecode(b"caf\xe9")
    history = Path(shutil.copytree(week[1], tmp_path / latin))
    result = run(evaluation(tmp_path, "2"), history)
    assert nights(history)[-1].night == result.night.night
    with open_history(history, create=True) as lines:
        lines.accept(Accepted(result.night.night, "2026", latin, None, itself=False))
        assert lines.accepted()[-1].reason == r"caf\udce9"
    with refusal("The path of an imported run"):
        night.import_run(tmp_path / "other", history / nights(history)[1].folder)


def test_a_mistake_in_the_file_is_said_before_anything_is_touched(tmp_path):
    file = evaluation(tmp_path)
    replace_in(file, "levels", "level")
    assert "Did you mean `levels`?" in nightly(file, tmp_path / "history", status=2).stderr
    assert not (tmp_path / "history").exists()


def test_older_runs_are_imported_as_nights_without_a_verdict(week, tmp_path):
    _, history, _ = week
    run = history / nights(history)[1].folder
    sumo_eval(f"trend {tmp_path}/history --import {run}")
    (imported,) = nights(tmp_path / "history")
    assert imported.imported
    assert not imported.good
    cli_refuses("nothing in it is replaced", f"trend {tmp_path}/history --import {run}")
    partly = ("trend", tmp_path / "partly", "--import", run, "--import", tmp_path)
    assert "Added" in sumo_eval(*partly, status=2).stdout
    sumo_eval("trend", tmp_path, status=2)


def test_failed_import_makes_no_history(file, lost, tmp_path):
    """An empty one would let the next night begin as the first, without the nights that are there."""
    cli_refuses("is not a run folder", f"trend {lost} --import {tmp_path}")
    with refusal("is missing or empty"):
        run(file, lost)


def empty(path):
    path.write_bytes(b"")


def cut_off(path):
    os.truncate(path, path.stat().st_size // 2)


def text(path):
    path.write_text("a note that somebody saved under this name " * 40)


def flipped(path):
    data = bytearray(path.read_bytes())
    data[100] ^= 0xFF  # the kind of the first page
    path.write_bytes(data)


def another_database(path):
    path.unlink()
    edit(path, "CREATE TABLE shopping (what)")


def newer(path):
    edit(path, "PRAGMA user_version = 99")


def unfinish(night):
    change = "UPDATE about SET value = '' WHERE name IN ('complete', 'seal')"
    edit(night / "facts.sqlite", change)


def a_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    "spoil, words",
    [
        (Path.unlink, "is missing or empty"),
        (empty, "is missing or empty"),
        (cut_off, "malformed"),
        (text, "file is not a database"),
        (flipped, "malformed"),
        (another_database, "is a database of something else"),
        (newer, "has format version 99"),
        (a_folder, "unable to open"),
    ],
)
def test_a_history_that_cannot_be_read_removes_no_night(file, history, spoil, words):
    before = sorted(path.relative_to(history) for path in (history / "nights").rglob("*"))
    spoil(history / "history.sqlite")
    done = nightly(file, history, "--keep", "1", status=2)
    assert words in done.stderr
    assert done.stderr.startswith("sumo-eval: ")
    assert sorted(path.relative_to(history) for path in (history / "nights").rglob("*")) == before


def test_locked_history_is_not_called_damaged(file, history, monkeypatch):
    """Another process, a backup for example, holds the file when the night begins, or when it ends.
    The next start with `--resume` adds the night that could not be added."""
    monkeypatch.setattr("sumo_eval.nightly.history.PATIENCE", 0.1)
    before = len(nights(history))
    with closing(sqlite3.connect(history / HISTORY, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with refusal("database is locked. It is as it was: remove the cause and run the command"):
            run(file, history)
        other.execute("ROLLBACK")

        def lock(*given):
            other.execute("BEGIN IMMEDIATE")
            return given[0].folder / "report.html"

        with monkeypatch.context() as patched:
            patched.setattr("sumo_eval.nightly.night._write_results", lock)
            with refusal("database is locked. Earlier nights are as they were. The same command"):
                run(file, history)
    assert len(nights(history)) == before
    run(file, history, resume=True)
    assert len(nights(history)) == before + 1


def test_a_scenario_file_that_goes_during_the_night_costs_only_the_levers(tmp_path, monkeypatch):
    file, history, scenario = evaluation(tmp_path, "2", "30, 0:sleeps"), tmp_path / "h", "own.toml"
    shutil.copy(scenario_files()["front_vehicle_low_speed"], tmp_path / scenario)
    replace_in(file, 'use = "front_vehicle_low_speed"', f'use = "{scenario}"')

    def gone(*_):
        (tmp_path / scenario).unlink()

    monkeypatch.setattr("sumo_eval.nightly.night.write_junit", gone)
    result = run(file, history)
    assert nights(history) == [result.night]
    assert f"There is no scenario file {tmp_path / scenario}" in result.report.read_text()


def test_results_that_cannot_be_written_are_noted(file, history):
    """The history has the night by then, so it ends as any other; copies of cases that a killed
    night left are removed."""
    for name in ("chat.json", "trend.html"):
        (history / name).unlink()
        (history / name).mkdir()
    shutil.copytree(history / nights(history)[0].folder, history / "again")
    done = nightly(file, history, "--keep", "1")
    words = done.stdout.replace("\n", " ")
    assert "This night is in the history. Its results could not all be written: " in words
    assert "This night is in the history. The trend page could not be written: " in words
    assert "removed; their lines stay" in words, words
    assert not (history / "again").exists()


def test_night_stopped_late_gives_its_verdict(file, history, monkeypatch):
    stopped = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr("sumo_eval.nightly.night.write_night", stopped)
    done = nightly(file, history)
    assert done.stdout.startswith("THE SAME as")
    words = done.stdout.replace("\n", " ")
    assert "This night is in the history. Its results could not all be written: Keyboard" in words


def test_night_whose_report_fails_can_continue(file, history, monkeypatch):
    """A limit on the size of files, `ulimit -f`, leaves facts but no report."""
    fault = InputError("The report cannot be written: File too large.")
    with monkeypatch.context() as patch:
        patch.setattr("sumo_eval.nightly.night.write_assessed_report", Mock(side_effect=fault))
        words = nightly(file, history, status=2).stderr.replace("\n", " ")
    name = max(nights_of(history))
    assert f"large. The same command with --resume continues night {name}." in words
    assert run(file, history, resume=True).night.night == name


def test_a_history_without_a_line_keeps_the_folders_that_it_does_not_know(file, lost):
    before = nights_of(lost)
    with open_history(lost, create=True):
        pass
    result = run(file, lost, keep=1)
    assert nights_of(lost) == {*before, result.night.night}
    assert sum(
        "is not in the history; it was left as it is" in note for note in result.notes
    ) == len(before)


def add(lines, name, place):
    """A line of a good night."""
    values = "?, 'x', ?, 1.0, 0, NULL, '', '', '', 0"
    lines._connection.execute(f"INSERT INTO nights VALUES ({values})", (name, place))


@pytest.mark.parametrize("known_lines", [0, 1], ids=["no line", "the oldest line"])
def test_old_history_put_back_keeps_complete_nights(lost, known_lines):
    complete = sorted(nights_of(lost))
    unfinished = lost / "nights" / "2020-01-01T00-00-00Z"
    shutil.copytree(lost / "nights" / complete[0], unfinished)
    unfinish(unfinished)
    with open_history(lost, create=True) as lines:
        for name in (*complete, unfinished.name):
            lines.begin(name)
        for name in complete[:known_lines]:
            add(lines, name, f"nights/{name}")
        notes = _clear_away(lost, lines, None)
    assert nights_of(lost) == set(complete)
    assert (
        sum("is a complete run without a line in the history" in note for note in notes)
        == len(complete) - known_lines
    )
    assert (
        f"Night {unfinished.name} was stopped before its end; its unfinished folder was removed."
        in notes
    )


@pytest.mark.parametrize("seeds", [range(8), in_campaign(range(8, 300))])
def test_no_history_removes_a_complete_night(week, tmp_path, seeds):
    """A fuzz of histories: any begun, finished and lost lines, beside complete, stopped and damaged
    nights."""
    source = min((week[1] / "nights").iterdir())
    for seed in seeds:
        draw, history = random.Random(seed), tmp_path / str(seed)
        kinds = {
            f"2020-01-0{day}T00-00-00Z": draw.choice(["complete", "stopped", "cut"])
            for day in range(1, 5)
        }
        for name, kind in kinds.items():
            night = history / "nights" / name
            night.mkdir(parents=True)
            for file in ("facts.sqlite", "manifest.json"):
                shutil.copy(source / file, night)
            if kind == "stopped":
                unfinish(night)
            elif kind == "cut":
                os.truncate(night / "facts.sqlite", draw.randrange(100_000))
        with open_history(history, create=True) as lines:
            for name in kinds:
                if draw.random() < 0.7:
                    lines.begin(name)
                if draw.random() < 0.3:
                    places = [f"nights/{name}", "nights", "", "..", f"nights/{name}/.."]
                    add(lines, name, draw.choice(places))
            with suppress(InputError):
                _clear_away(history, lines, None)
        left = nights_of(history)
        assert {name for name, kind in kinds.items() if kind == "complete"} <= left, seed


def test_a_line_that_names_another_place_removes_nothing_there(tmp_path):
    history, precious = tmp_path / "history", tmp_path / "precious"
    (history / "nights" / "b").mkdir(parents=True)
    precious.mkdir()
    with open_history(history, create=True) as lines:
        places = str(precious), "nights/b", "nights/../../precious", "nights/..", "nights/d"
        for name, place in zip(("a", "b", "c", "..", "d"), places, strict=True):
            add(lines, name, place)
        notes = _prune(history, lines, keep=1)
    assert precious.is_dir()
    assert not (history / "nights" / "b").exists()
    assert sum("it was left" in note for note in notes) == 3


def test_a_link_in_place_of_a_stopped_night_is_not_followed(tmp_path):
    history, precious = tmp_path / "history", tmp_path / "precious"
    (history / "nights").mkdir(parents=True)
    precious.mkdir()
    (history / "nights" / "a").symlink_to(precious)
    with open_history(history, create=True) as lines:
        lines.begin("a")
        notes = _clear_away(history, lines, None)
    assert precious.is_dir()
    assert notes == ["Night a was stopped before its end; its folder could not be removed."]


@pytest.mark.parametrize("pack, differ", [(1, 2), (32, 3)])
def test_night_finds_what_an_ads_carries_from_case_to_case(tmp_path, pack, differ):
    file, module = evaluation(tmp_path, "2", engine="processes"), tmp_path / "my_ads.py"
    replace_in(file, "pack = 32", f"pack = {pack}")
    counts = "fault, numbers = None, iter(range(99))\n\n    def __init__(self):\n"
    counts += "        self.number = next(self.numbers)"
    ads = module.read_text().replace("fault = None", counts, 1)
    module.write_text(ads.replace("-6.0", "-6.0 + 0.1 * self.number"))
    nights = [run_night(file, tmp_path / "history", GateSettings()) for _ in range(2)]
    assert f"mine drove {differ} of 3 cases differently" in " ".join(nights[1].notes)


def test_failure_in_the_second_drive_alone_is_reported(tmp_path):
    """The ADS fails once, in the second drive of a case: a third drive would hide it. Measured
    times, which differ in any two drives, raise no tolerance."""
    file = evaluation(tmp_path, "2")
    replace_in(tmp_path / "my_ads.py", "raise Runtime", "FAULT.unlink()\n            raise Runtime")
    night = evaluate(file, tmp_path / "night")
    plant(tmp_path, "30, 0:raises")
    repeats = repeats_of(night, GateSettings(), tmp_path / "again", lambda *_: None)["mine"]
    assert (repeats.cases, repeats.alike, len(repeats.apart)) == (3, 2, 1)
    ((key, change),) = repeats.apart.items()
    assert night.case(key).values == {"ego_speed": 30.0, "lead_speed": 0.0}
    assert change.words.startswith("ok -> ads_error; ")
    assert "latency_relative" not in repeats.floors


@pytest.mark.parametrize(
    "first, second, apart",
    [(0.3, None, 1), (None, 0.3, 1), (2.0, None, 0), (1.45, None, 0), (None, None, 0)],
)
def test_ttc_in_one_of_two_drives_only_counts_inside_its_zone(week, first, second, apart):
    """The zone ends at 1.5 s, the tolerance is 0.1 s or a tenth."""
    night = score(week[1] / nights(week[1])[0].folder)
    case = next(iter(night.cases))
    once = SimpleNamespace(cases=[replace(case, min_ttc=first)], settings=night.settings)
    rows = {case.case: replace(case, min_ttc=second)}
    _, differences = _differences(once, case.ads, rows, GateSettings())
    assert len(differences) == apart


def test_a_noisy_ads_is_found_and_its_new_collision_rerun(tmp_path, monkeypatch):
    """At one of three points the ADS sleeps and shakes: no two drives are alike, and all five
    collide. Trajectories that the night does not keep are there until the night is over, so that
    a stopped one can continue."""
    file, history = evaluation(tmp_path, "2"), tmp_path / "history"
    file.write_text(f'{file.read_text()}keep = "none"\n')
    shaking = "Command(acceleration=__import__('random').SystemRandom().uniform(-0.3, 0.3)"
    module = tmp_path / "my_ads.py"
    replace_in(module, "Command(acceleration=0.0", shaking)
    run(file, history)
    plant(tmp_path, "30, 0:sleeps")

    def stop(*_, **__):
        raise KeyboardInterrupt

    def stop_rerun(_, folder, **__):
        raise StoppedError(f"Stopped. 15 drives are recorded in {folder}.")

    with monkeypatch.context() as patched:
        patched.setattr("sumo_eval.nightly.repeats.record_facts", stop_rerun)
        with pytest.raises(StoppedError, match=r"^Stopped. The same command with --resume"):
            run(file, history)
    with monkeypatch.context() as patched:  # the text of `run` names `--out`, which nights lack
        patched.setattr("sumo_eval.nightly.night.record_rounds", stop_rerun)
        with pytest.raises(StoppedError, match=r"^Stopped. The same command with --resume"):
            run(file, history, resume=True)
    with monkeypatch.context() as patched:
        patched.setattr("sumo_eval.nightly.night.write_assessed_report", stop)
        with pytest.raises(StoppedError):
            run(file, history, resume=True)
    result = run(file, history, resume=True)
    told = read_json(result.report.parent / "night.json")
    assert told["verdict"] == "worse"
    assert told["exit_status"] == 1
    assert told["repeats"]["mine"]["cases"] == 3
    assert told["repeats"]["mine"]["alike"] == 2
    assert any("mine drove 1 of 3 cases differently" in note for note in result.notes)
    assert max(told["repeats"]["mine"]["floors"].values()) > 0.0
    assert {*told["repeats"]["mine"]["apart"]} <= {*told["failed"][0]["keys"]}
    assert [(one["quantity"], one["since"]) for one in told["failed"]] == [
        ("collided", told["night"])
    ]
    assert not (history / "again").exists()
    with open_store(result.report.parent) as store:
        assert store.is_discarded(result.judgement.gates[0].cases[0])
    files = size_of(result.report.parent)
    free = shutil._ntuple_diskusage(0, 0, int(2.5 * files))  # without what was discarded
    monkeypatch.setattr("shutil.disk_usage", lambda _: free)
    with refusal("The night was not begun: it may need"):
        run(file, history)
