"""Recorded people, exposure and mixture mode through a whole evaluation, with SUMO."""

import csv
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import cli_refuses, sumo_eval
from drivers.test_reference import write_people
from evaluations import small
from laid import read_json
from refusals import refusal

from sumo_eval.cases import ThinReference
from sumo_eval.evaluation import score
from sumo_eval.extras.studies.calibration import calibrate
from sumo_eval.extras.studies.opinion import compare_opinion, read_ratings
from sumo_eval.extras.studies.sensitivity import (
    K3_IS_IDLE,
    _most,
    sensitivity,
    sensitivity_lines,
)
from sumo_eval.method.plausibility import LEAST_PEOPLE, MOTORWAY_PEOPLE
from sumo_eval.record.cases import Case, Outcome
from sumo_eval.record.facts import record_facts
from sumo_eval.record.run_folder import read_settings
from sumo_eval.record.store import RECORDED, open_store
from sumo_eval.report.notes import score_note
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.score_notes import PlausibleTo
from sumo_eval.scoring.likeness import references
from sumo_eval.scoring.plausible_people import plausible_people
from sumo_eval.settings import (
    DeclaredDistribution,
    DriverSettings,
    ExposureSettings,
    PlausibilitySettings,
    SamplingSettings,
    ScenarioSettings,
)
from sumo_eval.trajectory import Recording, Trajectory

EVALUATION = """
name = "people"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
steps = { ego_speed = 10.0, lead_speed = 15.0 }
[scenario.exposure]
kind = "recorded"
[[ads]]
name = "idm"
controller = "idm"
[[ads]]
name = "lane_changer"
controller = "lane_changer"
[drivers]
source = "recorded"
recordings = ["people.csv"]
least = 4
too_thin = "TOO_THIN"
[method.anthropomorphic]
mode = "mixture"
slice_spacing = 2.0
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A run in which a thin reference is filled, and one in which it is left out; what each said at
    the end."""
    folder = tmp_path_factory.mktemp("people")
    speeds = np.concatenate([np.linspace(29.0, 31.0, 6), np.linspace(20.0, 26.0, 6)])
    write_people(folder, speeds.tolist(), lead_step=0.8)
    found = {}
    for too_thin in ("fill", "leave_out"):
        (folder / "evaluation.toml").write_text(EVALUATION.replace("TOO_THIN", too_thin))
        out = folder / too_thin
        result = sumo_eval(f"run {folder}/evaluation.toml --out {out} --workers 1", status=None)
        assert (out / "cases.csv").is_file(), result.said
        with (out / "cases.csv").open() as file:
            found[too_thin] = out, result, list(csv.DictReader(file))
    return found


def test_recorded_people_are_the_reference_and_a_thin_one_is_filled_and_said(runs):
    out, result, rows = runs["fill"]
    assert result.returncode == 0, result.said
    at = {(row["ads"], float(row["ego_speed"]), float(row["lead_speed"])): row for row in rows}
    rich = at["lane_changer", 30.0, 15.0]
    assert rich["drivers"] == "6"
    assert rich["recorded_drivers"] == "6"
    assert rich["reference_note"] == ""
    thin = at["lane_changer", 10.0, 0.0]
    assert thin["drivers"] == "4"
    assert thin["recorded_drivers"] == "0"
    assert (
        thin["reference_note"]
        == "Reference too thin: 0 of at least 4 recorded drivers; filled with 4 synthetic ones."
    )
    assert "Reference too thin in" in result.said
    terms = "likeness_length_factor", "operation_tolerance", "mixture_similarity", "plausibility"
    for row in rows:  # in mixture mode f_L of D_i is among other drivers than that of H
        if float(row["human_likeness"] or 0.0):
            product = math.prod(float(row[name]) for name in terms)
            assert float(row["human_likeness"]) == pytest.approx(product)
    page = (out / "report.html").read_text()
    assert "The drivers themselves" in page
    assert "Reference too thin in" in page


def test_how_many_recorded_people_stand_behind_the_scores_is_said_everywhere(runs):
    out, result, rows = runs["fill"]
    behind = {
        (row["ego_speed"], row["lead_speed"]): int(row["recorded_drivers"])
        for row in rows
        if row["zone"] == "safe"
    }
    drives, points = sum(behind.values()), sum(number > 0 for number in behind.values())
    assert 0 < points < len(behind)
    (told,) = read_json(out / "scores.json")["recorded_people"]
    assert told == {
        "scenario": "front_vehicle_low_speed", "points": len(behind), "with_people": points,
        "drives": drives,
    }  # fmt: skip
    sentence = f"{points} of {len(behind)} safe concrete scenarios, {drives} recorded drives"
    assert sentence in " ".join(result.said.split())
    assert sentence in (out / "report.html").read_text()


def test_a_merged_run_reports_which_limit_left_recorded_drives_out(tmp_path):
    write_people(tmp_path, [28.0, 30.0], seconds=20.0)
    text = EVALUATION.replace("TOO_THIN", "fill").replace('kind = "recorded"', 'kind = "uniform"')
    (tmp_path / "evaluation.toml").write_text(text)
    for part in (1, 2):
        place = "--out", tmp_path / f"{part}", "--shard", f"{part}/2", "--workers", "1"
        sumo_eval("run", tmp_path / "evaluation.toml", *place)
    result = sumo_eval(f"merge {tmp_path}/1 {tmp_path}/2 --out {tmp_path}/whole")
    limit = "of the road covered, at least 80 % asked (`drivers.coverage`)."
    assert limit in " ".join(result.said.split())


def test_a_recorded_person_has_one_name_at_every_point(runs):
    out, _, _ = runs["fill"]
    with open_store(out) as store:
        facts = store.facts("human", "front_vehicle_low_speed")
        drives = [fact for fact in facts if fact.controller == RECORDED]
    found = references(drives, read_settings(out).drivers).values()
    person = {fact.case: fact.log for fact in drives}
    names = {
        (person[case], name)
        for it in found
        for case, name in zip(it.cases, it.drivers, strict=True)
    }
    assert len(found) > 1
    for column in zip(*names, strict=True):
        assert len(set(column)) == len(names), "one name a person, one person a name"


def test_people_of_references_that_are_left_out_stand_behind_nothing(runs):
    out, _, rows = runs["leave_out"]
    behind = {(row["ego_speed"], row["lead_speed"]): row for row in rows if row["zone"] == "safe"}
    compared = [
        int(row["recorded_drivers"]) for row in behind.values() if int(row["recorded_drivers"]) >= 4
    ]
    assert any(0 < int(row["recorded_drivers"]) < 4 for row in behind.values())
    (told,) = read_json(out / "scores.json")["recorded_people"]
    assert (told["with_people"], told["drives"]) == (len(compared), sum(compared))


NOBODY = """
name = "slow"
[[parameter]]
name = "ego_speed"
unit = "m/s"
low = 8.0
high = 12.0
step = 4.0
[[parameter]]
name = "lead_speed"
unit = "m/s"
low = 2.0
high = 6.0
step = 4.0
[ego]
speed = "ego_speed"
[[vehicle]]
name = "lead"
speed = "lead_speed"
gap = "3.5 * ego_speed"
[zone]
obstacle = "lead"
[recorded]
event = "approach"
tolerance = { ego_speed = 2.5, lead_speed = 2.5 }
"""


def said_of(runs, name, scenario, status=0):
    """What `check` says of an evaluation of a scenario file."""
    folder = runs["fill"][0].parent
    (folder / f"{name}.toml").write_text(scenario.replace('"slow"', f'"{name}"'))
    text = EVALUATION.replace("TOO_THIN", "fill")
    for old, new in (
        ("front_vehicle_low_speed", f"{name}.toml"),
        ("steps = { ego_speed = 10.0, lead_speed = 15.0 }", "levels = 2"),
        ('[scenario.exposure]\nkind = "recorded"\n', ""),
    ):
        text = text.replace(old, new)
    (folder / f"{name}_evaluation.toml").write_text(text)
    return sumo_eval("check", folder / f"{name}_evaluation.toml", status=status).said


def test_a_scenario_file_names_its_own_event(runs):
    said = said_of(runs, "slow", NOBODY)
    assert "recorded people of slow: 12 events like it" in said
    assert "WARN  recorded people of slow: none count at any of its 4 safe points" in said
    # The same file at the speeds of the recording has its people.
    fast = NOBODY.replace("low = 8.0\nhigh = 12.0", "low = 28.0\nhigh = 32.0")
    said = said_of(runs, "fast", fast.replace("low = 2.0\nhigh = 6.0", "low = 13.0\nhigh = 17.0"))
    assert "recorded people of fast: 12 events like it" in said
    assert "WARN" not in said


def test_an_event_s_column_that_does_not_exist_is_refused(runs):
    said = said_of(runs, "odd", f'{NOBODY}columns = {{ lead_speed = "leed_speed" }}\n', status=2)
    assert "leed_speed" in said
    assert "lead_speed" in said


def test_the_band_of_the_drivers_and_the_manoeuvre_stand_beside_every_index(runs):
    _, _, rows = runs["fill"]
    for row in rows:
        assert (
            0.0
            <= float(row["human_low"])
            <= float(row["human_mean"])
            <= float(row["human_high"])
            <= 1.0
        )
        assert row["manoeuvre"]
        assert 0.0 <= float(row["manoeuvre_share"]) <= 1.0


def test_the_exposure_is_kept_and_unsupported_cases_report_it(runs):
    out, _, rows = runs["fill"]
    kept = read_json(out / "scores.json")["exposure"]["front_vehicle_low_speed"]
    assert kept["events"] == 12
    assert set(kept["held_out_log_likelihood"]) == {
        "scott",
        "cross_validated",
        "single_gaussian",
        "uniform",
    }
    assert 0.0 < kept["unsupported_share"] <= 1.0
    at = {(float(row["ego_speed"]), float(row["lead_speed"])): row for row in rows}
    assert at[10.0, 0.0]["exposure_note"].startswith("Outside the data's support")
    assert at[30.0, 15.0]["exposure_note"] == ""
    assert float(at[30.0, 15.0]["exposure"]) > float(at[10.0, 0.0]["exposure"])


def test_a_thin_reference_may_be_left_out_and_the_case_is_counted_as_missing(runs):
    _, result, rows = runs["leave_out"]
    assert result.returncode == 3
    thin = [row for row in rows if row["reference_note"]]
    assert thin
    assert all(row["index"] == "" and row["reference_note"].endswith("left out.") for row in thin)
    assert all(row["index"] for row in rows if not row["reference_note"])


def test_a_lone_recorded_driver_is_left_out_and_not_called_filled():
    """Synthetic drivers do not know the scenario, or all of their drives failed."""
    settings = DriverSettings(source=RECORDED, recordings=("people.csv",), too_thin="fill")
    lone = SimpleNamespace(
        point=0, status="ok", controller=RECORDED, case="c-0000", driver="recorded_00", log="ann"
    )
    reference = references([lone], settings)[0]
    assert not reference.usable
    assert reference.note == ThinReference(recorded=1, least=10, filled=None)


def test_a_run_is_scored_again_without_its_recordings(runs):
    out, _, rows = runs["fill"]
    assert read_json(out / "manifest.json")["files"].keys() == {"people.csv"}
    (out.parent / "people.csv").rename(out.parent / "gone.csv")
    try:
        again = score(out)
    finally:
        (out.parent / "gone.csv").rename(out.parent / "people.csv")
    assert [case.index for case in again.cases] == pytest.approx(
        [float(row["index"]) for row in rows]
    )


def test_k6_gives_the_middle_ads_half_of_the_points(runs):
    out, _, _ = runs["fill"]
    evaluation = score(out)
    found = calibrate([evaluation], by="mean")
    d = [result.d for result in evaluation.scores]
    assert found.k6 == pytest.approx(0.5 / np.mean(d))
    scaled = score(out, [f"method.score.k6={found.k6}"])
    assert np.mean([result.d_points for result in scaled.scores]) == pytest.approx(25.0)


def test_peoples_opinion_beside_the_scores(runs, tmp_path):
    out, _, _ = runs["fill"]
    path = tmp_path / "ratings.csv"
    path.write_text(
        "rater,ads,scenario,score\n"
        + "".join(
            f"{rater},{ads},front_vehicle_low_speed,{given}\n"
            for rater, scores in (("ann", (4, 8)), ("bob", (3, 9)))
            for ads, given in zip(("idm", "lane_changer"), scores, strict=True)
        )
    )
    run = score(out)
    found = compare_opinion(run, read_ratings(path))
    assert [(row.ads, row.opinion) for row in found.rows] == [("idm", 3.5), ("lane_changer", 8.5)]
    assert found.correlations["D"] is None  # two scores make no correlation
    assert found.concordance.value == pytest.approx(1.0)
    sumo_eval(f"humans opinion {out} {path} --out {tmp_path}/plot.html")
    assert (tmp_path / "plot.html").stat().st_size > 1000
    alike = read_ratings(path).assign(score=5.0)
    assert compare_opinion(run, alike).concordance is None
    with refusal("Rating 2 of the file: Unknown ADS `lane_changer` of scenario `front_vehicle_low"):
        compare_opinion(replace(run, scores=run.scores[:1]), alike)
    path.write_text("rater,ads,scenario,score\nann,idm,front_vehicle_low_speed,11\n")
    cli_refuses("`score` in row 2 of", f"humans opinion {out} {path}")


def test_raters_are_names_and_none_is_empty(tmp_path):
    path, head = tmp_path / "ratings.csv", "rater,ads,scenario,score\n"
    path.write_text(f"{head}01,idm,cut_in,8\n1,idm,cut_in,2\n")
    assert read_ratings(path)["rater"].tolist() == ["01", "1"]
    path.write_text(f"{head},idm,cut_in,8\n")
    with refusal("`rater` in row 2 of .* must be a name, got nothing"):
        read_ratings(path)


def test_a_table_of_the_runs_own_drivers_needs_twenty(runs):
    out, _, _ = runs["fill"]
    for one in score(out, ["method.plausibility.table=recorded"]).scores:
        (note,) = [
            words for words in map(score_note, one.notes) if words.startswith("Plausibility")
        ]
        assert note.startswith("Plausibility compares with 213 people on a motorway: the run has ")
    assert not any(isinstance(note, PlausibleTo) for one in score(out).scores for note in one.notes)


def test_the_ranking_under_other_constants(runs):
    out, _, _ = runs["fill"]
    rows = sensitivity(out, lambda stage, done, total: None, constants=("k2", "a", "k2"))
    settings = read_settings(out)
    for constants, idle in (((), True), (("a", "k3"), True), (("k2",), False)):
        assert (sensitivity_lines(rows, constants, settings)[-1] == K3_IS_IDLE) is idle
    # k3 is a threshold of turns of the wheel, unless a lateral acceleration is one
    for acceleration, idle in ((None, False), (1.0, True)):
        turns = replace(
            settings.method.anthropomorphic, steering_rule="wheel",
            steering_lateral_acceleration=acceleration,
        )  # fmt: skip
        ruled = replace(settings, method=replace(settings.method, anthropomorphic=turns))
        assert (sensitivity_lines(rows, ("k3",), ruled)[-1] == K3_IS_IDLE) is idle
    assert {(row.constant, row.index) for row in rows} == {
        ("k2", "D"),
        ("k2", "H"),
        ("a", "S"),
        ("a", "S+"),
    }
    k2 = [row for row in rows if (row.constant, row.index) == ("k2", "D")]
    assert [row.value for row in k2] == pytest.approx([0.0025, 0.005, 0.01])
    assert k2[1].tau == 1.0
    assert k2[0].scores != k2[1].scores
    assert "nan" not in str(sensitivity_lines([k2[0]._replace(tau=np.nan)], (), settings))
    a = [row for row in rows if (row.constant, row.index) == ("a", "S")]
    assert [row.value for row in a] == [10.0, 25.0, 50.0, 75.0, 90.0]
    assert all(row.ranking[0] == "lane_changer" for row in a)
    most = [_most(settings, f"method.anthropomorphic.field.{name}") for name in ("k1", "k2")]
    assert most == [20.0, 1.0]


DRAWN = SamplingSettings("exposure", count=16)
NARROW = {"ego_speed": DeclaredDistribution("normal", 28.0, 1.0)}


@pytest.mark.parametrize(
    "sampling, exposure",
    [
        (DRAWN, ExposureSettings("declared", declared=NARROW)),
        (DRAWN, ExposureSettings("recorded", recordings=("people.csv",))),
        (SamplingSettings("file", file="points.csv"), ExposureSettings()),
        (
            SamplingSettings("file", file="points.csv"),
            ExposureSettings("recorded", recordings=("people.csv",)),
        ),
    ],
)
def test_points_are_scored_as_they_were_driven(sampling, exposure, tmp_path):
    write_people(tmp_path, np.linspace(24.0, 30.0, 12).tolist(), lead_step=0.8)
    (tmp_path / "points.csv").write_text("ego_speed,lead_speed\n20,5\n25,5\n")
    entry = ScenarioSettings("front_vehicle_low_speed", sampling, exposure)
    settings = replace(small(["idm"], drivers=2), scenario=(entry,))
    record_facts(Resolved.of(settings, tmp_path), tmp_path / "run")
    (tmp_path / "people.csv").unlink()
    (tmp_path / "points.csv").write_text("ego_speed,lead_speed\n20,5\n")
    done = score(tmp_path / "run")
    (zones,), (idm,) = done.zones, done.scores
    assert zones.sampled == idm.cases == len(list(done.cases))
    assert any("other points now" in note for note in zones.notes) == (sampling.file is not None)
    (tmp_path / "points.csv").write_text("ego_speed,lead_speed\n20,x\n")
    told = [note for note in score(tmp_path / "run").zones[0].notes if "in line 2" in note]
    assert len(told) == (sampling.file is not None), "a file with a mistake is told"


# --- whom plausibility is judged by: people on a motorway, or the recorded drivers of the run -----


LOGICAL = catalogue.load("front_vehicle_low_speed")
RECORDED_TABLE = PlausibilitySettings(table="recorded")


def people(folder, count, settings):
    """Person i follows for 20 s, (1 + i / 10) s behind a lead of 10 m/s that started 3.5 * 20 = 70
    m ahead."""
    concrete = LOGICAL.concrete(ego_speed=20.0, lead_speed=10.0)
    time = np.arange(201) / 10.0
    (lead,) = concrete.actors
    with open_store(folder, create=True) as store:
        for index in range(count):
            gap = 10.0 * (1.0 + index / 10.0)
            x = np.array([lead.x(t) for t in time]) - 0.5 * (lead.length + 4.5) - gap
            add(store, concrete, index, Trajectory(time, x, 0.0 * x, speed=0.0 * x + 10.0))
        return plausible_people(LOGICAL, store, settings)


def add(store, concrete, index, drive):
    case = Case(0, concrete, "human", f"recorded_{index:02d}", RECORDED)
    store.add(Outcome(case, "ok", Recording(drive, {}, None, "recorded"), log=f"person {index}"))


def test_the_default_is_the_people_of_the_motorway_and_says_nothing(tmp_path):
    found = people(tmp_path, 3, PlausibilitySettings())
    assert found == (MOTORWAY_PEOPLE, ())


def test_the_recorded_drivers_of_the_run_are_measured_among_its_other_vehicles(tmp_path):
    found, notes = people(tmp_path, 40, RECORDED_TABLE)
    assert tuple(map(score_note, notes)) == (
        "Plausibility compares with 40 recorded drivers of the run (40 drives).",
    )
    assert found.people == 40
    assert found.drives == 40
    assert found.values["min_thw"][0] == pytest.approx(1.0, abs=0.01)
    # ten of forty: 1.0 to 1.9 s
    assert found.share("min_thw", 1.9) == pytest.approx(0.25, abs=0.01)
    assert found.share("min_thw", 0.5) == 0.0


def test_people_meet_an_actor_where_it_crosses(tmp_path):
    """At 10 m/s over x = 300 m at y = 0 after 5.315 s, 4.5 m x 1.8 m: in a 1.8 m wide way until 5.6
    s. The nearest front, at 290 + 5.6 + 2.25 m, is then 1.25 m away, at 1 m/s."""
    logical, time = catalogue.load("crossing_path"), np.arange(61) / 10.0
    concrete = logical.concrete(ego_speed=14.0, other_speed=10.0, arrival=1.0)
    with open_store(tmp_path, create=True) as store:
        for index in range(LEAST_PEOPLE):
            add(store, concrete, index, Trajectory(time, 290.0 - index + time, 0.0 * time))
        found = plausible_people(logical, store, RECORDED_TABLE)[0]
    assert found.values["min_ttc"][0] == pytest.approx(1.25)


def test_too_few_recorded_drivers_give_no_table_and_a_note(tmp_path):
    found, notes = people(tmp_path, LEAST_PEOPLE - 1, RECORDED_TABLE)
    assert found is MOTORWAY_PEOPLE
    assert tuple(map(score_note, notes)) == (
        "Plausibility compares with 213 people on a motorway: the run has 19 recorded drivers in "
        "`front_vehicle_low_speed`, and a table needs 20.",
    )
