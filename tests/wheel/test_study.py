"""A study from the first code to the scores: participants over the real window, without a browser,
step by step."""

import asyncio
import csv
import json
import shutil
import tomllib
from contextlib import suppress

import pytest
from laid import read_json
from refusals import refusal, refused

pytest.importorskip("websockets")
from test_window import known, run
from unpaced import UnpacedWindow
from websockets.exceptions import ConnectionClosed

import sumo_eval
from sumo_eval.extras.studies.opinion import compare_opinion, read_ratings
from sumo_eval.extras.wheel.messages import MOST_A_SECOND
from sumo_eval.extras.wheel.outcome import collect, evaluation_of
from sumo_eval.extras.wheel.page import page, sheet
from sumo_eval.extras.wheel.plan import read_study
from sumo_eval.extras.wheel.study import (
    CONTINUE,
    SCORE,
    asked_of,
    enter,
    participants,
    scale,
    study,
)
from sumo_eval.record.store import Store
from sumo_eval.report.people import study_sentences

RUN = """
name = "base"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
method = "grid"
levels = { ego_speed = 2, lead_speed = 3 }
[[ads]]
name = "follower"
controller = "idm"
[[ads]]
name = "asleep"
controller = "no_reaction"
[drivers]
count = 2
[run]
workers = 1
"""
STUDY = """
name = "afternoon"
run = "run"
consent = "I agree to be measured."
count = 2
rate = 20
[practice]
seconds = 3.0
[[question]]
key = "effort"
text = "How much effort was it?"
"""


class CrashError(Exception):
    """The browser goes away in the middle."""


async def participant(window, code, *, leaves_at=None, quits="", stops_at=""):
    """Answer every sheet and drive gently until the thanks.

    leaves_at: the step of the first real drive at which the window is closed for good.
    quits: title of a drive that is ended.
    stops_at: title of a sheet where they stop.
    """
    titles = []
    number, view = 0, {}
    async with await known(window) as peer:
        with suppress(ConnectionClosed):
            async for text in peer:
                message = json.loads(text)
                if "state" in message:
                    state = message["state"]
                    if quits and view["title"].startswith(quits) and state[0] > 5:
                        await peer.send('{"quit": true}')
                        continue
                    if (
                        leaves_at is not None
                        and view["title"].startswith("Drive")
                        and state[0] >= leaves_at
                    ):
                        raise CrashError
                    x, speed = state[3][0], state[3][3]
                    ahead = min(
                        (it[1] - x - 4.5 - 2.5 * (speed - it[3]) for it in state[4] if it[1] > x),
                        default=1e3,
                    )
                    pedal = -0.3 if ahead < 4.0 + 1.2 * speed else 0.05
                    number += 1
                    given = ["stick", 0, 0.0, max(pedal, 0.0), max(-pedal, 0.0)]
                    # a quick machine would be shut out for flooding
                    await asyncio.sleep(1.0 / MOST_A_SECOND)
                    await peer.send(json.dumps({"input": [number, state[0], *given]}))
                    continue
                view = message
                titles.append(view.get("title", view["show"]))
                if view["show"] == "drive":
                    await peer.send('{"ready": true}')
                elif view["show"] == "sheet":
                    if view["title"] == "Thank you":
                        await peer.send('{"answers": {"button": "end"}}')
                        break
                    stops = bool(quits) and "ended" in view["title"]
                    names = [name for name, _ in view["buttons"]]
                    given = {
                        "button": "leave"
                        if stops
                        else "stop"
                        if view["title"] == stops_at
                        else names[0]
                    }
                    assert given["button"] in names
                    for it in view.get("questions", ()):
                        mark = (
                            3 if view.get("replay", {}).get("views", [{}])[0].get("contact") else 8
                        )
                        given[it["key"]] = {"scale": mark, "yes": True, "code": code}[it["kind"]]
                    await peer.send(json.dumps({"answers": given}))
    assert not window.faults
    return titles


def take_part(plan, code, **more):
    async def body():
        async with UnpacedWindow(page("Drive"), countdown=0.0) as window:
            team = asyncio.create_task(study(window, plan, lambda line: None))
            try:
                return await asyncio.wait_for(participant(window, code, **more), 120.0)
            except CrashError:
                return []
            finally:
                if more.get("leaves_at") is not None:
                    window.stop()
                    team.cancel()
                with suppress(asyncio.CancelledError):
                    await asyncio.wait_for(team, 30.0)

    return asyncio.run(body())


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "base.toml").write_text(RUN)
    (folder / "study.toml").write_text(STUDY)
    sumo_eval.evaluate(folder / "base.toml", out=folder / "run")
    return read_study(folder / "study.toml")


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.campaign
def test_participants_drive_and_rate_and_a_run_takes_them_as_its_people(plan, tmp_path):
    """Three people, two cases: one by one to the end, one who comes back after a crash, one who
    ends a drive."""
    titles = take_part(plan, "P01")
    assert titles[:2] == ["Welcome", "Before you begin"]
    # the drive, and its question
    assert [it for it in titles if it.startswith("Drive ")].count("Drive 1 of 2") == 2
    take_part(plan, "P02", leaves_at=9)
    assert not [step for step in participants(plan)[1].done if step.startswith("drive:")]
    assert "Before you begin" not in take_part(plan, "P02")  # what was done is done
    # of the practice; who comes back goes on there
    assert "Thank you" in take_part(plan, "P03", stops_at="Well done")
    assert list(participants(plan)[2].done)[-2:] == ["practice:1", "stopped"]
    take_part(plan, "P03", quits="Drive 2")
    orders = [
        [step for step in person.done if step.startswith("drive:")] for person in participants(plan)
    ]
    assert orders[0] == list(reversed(orders[1])) == orders[2]

    found = collect(plan)
    assert found.people == 3
    assert found.with_drives == 3
    assert found.drives == 5
    assert found.ratings == 6
    assert sorted((it.participant, it.why) for it in found.discarded) == [
        ("P02", "the drive broke off, and was rerun"), ("P03", "ended before its end"),
    ]  # fmt: skip
    assert len(rows_of(plan.folder / "drives" / "cases.csv")) == 5
    quality = rows_of(plan.folder / "quality.csv")
    assert [row["left_out"] for row in quality if row["left_out"]] == ["ended before its end"]
    assert [row["end"] for row in quality].count("quit") == 1
    assert all(row["pauses"] == "0" for row in quality)
    answers = rows_of(plan.folder / "answers.csv")
    assert {row["question"] for row in answers} == {"agrees", "effort", "score"} - {"agrees"}
    before = (plan.folder / "drives" / "cases.csv").read_bytes()
    assert collect(plan) == found
    assert (plan.folder / "drives" / "cases.csv").read_bytes() == before
    # a tape that cannot be read marks no finished drive of its case
    stray = plan.folder / "participants" / "P01" / f"{found.discarded[0].case}-009.jsonl"
    stray.write_text("nonsense")
    assert len(collect(plan).discarded) == 3
    assert rows_of(plan.folder / "quality.csv") == quality
    stray.unlink()
    assert collect(plan) == found

    evaluation = sumo_eval.evaluate(plan.folder / "evaluation.toml", out=tmp_path / "with_people")
    driven = [case for case in evaluation.cases if case.recorded_drivers]
    assert {case.ads for case in driven} == {"follower", "asleep"}
    assert all(case.recorded_drivers == case.drivers for case in driven)
    opinion = compare_opinion(evaluation, read_ratings(plan.folder / "ratings.csv"))
    assert {(row.ads, row.raters) for row in opinion.rows} == {("follower", 3), ("asleep", 3)}
    sentences = study_sentences(evaluation)
    assert (
        "3 people took part in the study afternoon; 5 drives by 3 of them count, 2 are left out."
        in sentences[0]
    )
    assert sentences[1:] == [f"{it.participant}, {it.case}: {it.why}." for it in found.discarded]
    study = plan.folder / "drives" / "study.json"
    content = read_json(study)
    study.write_text(json.dumps(content | {"drawn": {"in 3-D": 5}}))
    first, *left = study_sentences(evaluation)
    assert first.endswith("in these ways: in 3-D (5 drives).")
    assert left == sentences[1:]
    study.write_text(json.dumps(content | {"drawn": ["from above"]}))
    with refusal("study.json cannot be read"):
        study_sentences(evaluation)


def test_an_evaluation_with_people_finds_the_files_of_its_run(plan, tmp_path, monkeypatch):
    monkeypatch.setattr("sumo_eval.record.trust._trust_all", True)  # as `--trust` does
    run = tmp_path / "run"
    shutil.copytree(plan.run, run)
    text = (run / "evaluation.toml").read_text()
    for key, value in (
        ('severity = "severity"', 'severity = "harm.py:loss"'),
        ("recordings = []", 'recordings = ["people.csv"]'),
        ('qualification = ""', 'qualification = "tool"'),
    ):
        assert key in text
        text = text.replace(key, value)
    (run / "evaluation.toml").write_text(text)
    found = tomllib.loads(evaluation_of(plan._replace(run=run), 3))
    source = plan.run.parent
    assert found["method"]["collision"]["severity"] == f"{source / 'harm.py'}:loss"
    assert found["run"]["qualification"] == str(source / "tool")
    assert found["drivers"]["recordings"] == []
    exposures = [entry["exposure"]["recordings"] for entry in found["scenario"]]
    assert exposures == [[str(source / "people.csv")]] * len(exposures)


def test_a_study_file_with_a_mistake_gets_a_sentence(plan):
    path = plan.run.parent / "wrong.toml"
    for text, words in (
        (STUDY.replace("consent", "consnt"), "Did you mean `consent`"),
        (
            STUDY + '[[question]]\nkey = "x"\ntext = "?"\nafter = "lunch"\n',
            "must be one of 'drive', 'replay', got 'lunch'",
        ),
        (
            STUDY.replace("count = 2", 'cases = ["front_vehicle_low_speed-9999"]'),
            "low_speed-9999` of the run",
        ),
        (STUDY.replace("count = 2", 'ads = ["followr"]'), "Did you mean `follower`"),
        (STUDY.replace("count = 2", 'ads = ["asleep", "asleep"]'), "`ads` of study `afternoon`"),
        (STUDY.replace('run = "run"', 'run = "nowhere"'), "nowhere"),
        (STUDY.replace("afternoon", "/tmp/elsewhere"), "a folder next to the file, got '/tmp"),
    ):
        path.write_text(text)
        with refused(words):
            read_study(path)


def test_a_run_without_trajectories_is_refused_for_that(plan, monkeypatch):
    """It was refused for unknown ADSs and cases, or for points without drivers."""
    monkeypatch.setattr(Store, "trajectories", lambda store, case: {})
    path, case = plan.run.parent / "study.toml", plan.cases[0].key
    for change, unseen in (
        ("", "ADSs"),
        ('ads = ["asleep"]\n', "asleep"),
        (f'cases = ["{case}"]\n', case),
    ):
        path.write_text(change + STUDY)
        with refusal(f'{unseen} of the run .* must have trajectories to replay.* `keep = "all"`'):
            read_study(path)
    path.write_text(STUDY)


def test_a_damaged_journal_is_refused_and_a_whole_line_stays(plan):
    person = enter(plan, "P09")
    journal = person.folder / "journal.jsonl"
    journal.write_text(whole := journal.read_text().strip())  # an editor took the last newline away
    enter(plan, "P09").finish("consent", agrees=True)
    assert journal.read_text().startswith(whole + "\n")
    for line in (
        "{}",
        '{"step": "rate:x:y", "ads": "y", "scenario": "x", "answers": {"score": NaN}}',
        '{"step": "practice:1", "passed": true, "tape": ["a"]}',
    ):
        journal.write_text(f"{whole}\n{line}\n")
        with refusal("journal.jsonl"):
            collect(plan)
    journal.write_text(f"{whole}\r{whole}\r")
    with refusal("journal.jsonl must end with LF, got CR"):
        collect(plan)
    entry = {"step": "drive:gone", "tape": "gone.jsonl", "answers": {}, "quality": {}}
    journal.write_text(f"{whole}\n{json.dumps(entry)}\n")
    (person.folder / "x-001.jsonl").write_text('{"format": 1}\n')
    assert ("P09", "gone", "gone.jsonl", "no case of the study now") in collect(plan).discarded
    assert ("P09", "x", "x-001.jsonl", "the drive broke off") in collect(plan).discarded
    later = enter(plan, "P10")
    shutil.rmtree(person.folder)
    assert enter(plan, "P11").number == person.number, "its order of cases is free again"
    for folder in later.folder, later.folder.with_name("P11"):
        shutil.rmtree(folder)


@run
async def test_answers_that_are_on_no_scale_are_asked_for_again():
    async with UnpacedWindow(page("Drive")) as window, await known(window) as peer:
        view = sheet("Rate", questions=[scale(SCORE)], buttons=[CONTINUE])
        answers = asyncio.create_task(asked_of(window, view))
        for score in (99, "8", True, None, 8):
            await asyncio.wait_for(peer.recv(), 10.0)
            given = {} if score is None else {"score": score}
            await peer.send(json.dumps({"answers": {"button": "go", **given}}))
        assert await asyncio.wait_for(answers, 10.0) == {"score": 8.0}
