"""The six steps on real SUMO runs: scores follow from facts, facts from the configuration, nothing
is lost between."""

import csv
import html
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from builders import SCENARIOS
from commands import program
from evaluations import small
from laid import read_json
from record.edited_store import edit
from refusals import refusal
from tables import in_campaign

import sumo_eval
from sumo_eval.evaluation import zone_partitions
from sumo_eval.record.facts_file import FORMAT_VERSION
from sumo_eval.record.store import open_store
from sumo_eval.report.html import write_report
from sumo_eval.report.notes import score_note
from sumo_eval.report.tables import scores_json, write_tables
from sumo_eval.report.terminal import closing_lines
from sumo_eval.score_notes import CasesMissing, Counted, DrivesLeftOut, ReferenceMissing
from sumo_eval.settings import AdsSettings, MethodSettings, RunSettings, ZoneSettings
from sumo_eval.settings.config import read_evaluation


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Four ADSs: `no_reaction` collides in the safe zone, `ideal_braking` is the ideal vehicle."""
    ads = "ideal_braking", "idm", "lane_changer", "no_reaction"
    settings = small(ads, SCENARIOS, run=RunSettings(workers=2))
    return sumo_eval.evaluate(settings, tmp_path_factory.mktemp("runs") / "small")


@pytest.mark.parametrize(
    "name",
    [
        in_campaign("curve_cut_in"),
        in_campaign("cut_in"),
        "r157_cut_out",
    ],
)
def test_the_ideal_vehicle_scores_c_1_where_it_collides_itself(name, tmp_path):
    """It hits somebody at corners of these scenarios alone; golden files hold others."""
    # C asks the criterion
    coarse = MethodSettings(zones=ZoneSettings(grid_points=1_000, restarts=0, refinements=0))
    everywhere = small(["ideal_braking"], [name], 2, levels=2, method=coarse)
    (score,) = sumo_eval.evaluate(everywhere, tmp_path / "run").scores
    assert (score.c, score.collisions > 0) == (1.0, True)


def test_no_case_is_lost(done):
    for entry in done.settings.scenario:
        (zone,) = [zone for zone in done.zones if zone.scenario == entry.use]
        for ads in done.settings.ads:
            rows = [
                case for case in done.cases if (case.scenario, case.ads) == (entry.use, ads.name)
            ]
            assert len(rows) == zone.sampled
            assert len({case.case for case in rows}) == len(rows)


@pytest.mark.parametrize(
    "change",
    [
        "simulation.step=0.1",
        "run.only=[]",
        "run.case_timeout=9",
        'method.task.task_reference="idm"',
    ],
)
def test_scoring_refuses_changes_that_the_facts_depend_on(done, change):
    with refusal(f"`{change.partition('=')[0]}` cannot be changed by scoring"):
        sumo_eval.score(done.folder, [change])
    with refusal("must have the form KEY=VALUE"):
        sumo_eval.score(done.folder, [change.partition("=")[0]])
    with refusal("Unknown setting `x"):
        sumo_eval.score(done.folder, [f"x{change}"])


@pytest.mark.parametrize("gone", ["scenario = 'front_vehicle_cut_out'", "point = 1"])
def test_no_ranking_mixes_rows_with_and_without_reference_car(done, tmp_path, gone):
    """Without one of its drives the whole run has none, as one recorded earlier: T is beside the
    drivers everywhere."""
    assert {score.task_reference for score in done.scores} == {"attentive"}
    found = []
    for number, where in enumerate((gone, "1")):
        folder = tmp_path / str(number)
        shutil.copytree(done.folder, folder)
        cars = f"""SELECT "case" FROM facts WHERE role = 'task_reference' AND {where}"""
        # the facts last: they tell which cases
        for table in ("trajectories", "circumstances", "facts"):
            edit(
                folder / "facts.sqlite",
                f'DELETE FROM {table} WHERE "case" IN ({cars})',
                hashes=table == "facts",
            )
        found.append(sumo_eval.score(folder))
    part, none = found
    assert {score.task_reference for score in part.scores} == {""}
    assert part.scores == none.scores
    assert part.ranking == none.ranking
    assert "reference car" in "\n".join(closing_lines(part))


def test_drives_that_cannot_be_a_reference_are_named(done, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(done.folder, folder)
    one = """SELECT "case" FROM facts WHERE role = 'human' AND scenario = 'front_vehicle_low_speed' LIMIT 1"""
    edit(
        folder / "facts.sqlite",
        f"""UPDATE facts SET status = 'collision' WHERE "case" = ({one})""",
        hashes=True,
    )
    again = sumo_eval.score(folder)
    note = again.score("idm", "front_vehicle_low_speed").notes[0]
    assert note == DrivesLeftOut(1, note.drives, (("collision", 1),))
    unsafe = again.score("idm", "front_vehicle_low_speed").notes[1]
    assert isinstance(unsafe, Counted)
    assert unsafe.number == 1 <= unsafe.of
    assert "check `zone.obstacle`" in score_note(unsafe)
    assert any(score_note(unsafe) in line for line in closing_lines(again))
    page = write_report(again, zone_partitions(again)).read_text()
    assert "drivers or the reference car collide at 1 of them" in page
    assert done.score("idm", "front_vehicle_low_speed").notes == ()


def test_why_reference_drives_could_not_be_evaluated_is_said_by_reason_with_counts_and_an_example(
    done, tmp_path
):
    """Three ideal drives of nine fail: two for one reason that differs in its numbers, one for
    another."""
    folder = tmp_path / "copy"
    shutil.copytree(done.folder, folder)
    for point, status, error in (
        (0, "sim_error", "SUMO gave vehicle `lead` the speed 5000 m/s at 0.45 s."),
        (3, "sim_error", "SUMO gave vehicle `lead` the speed 6000 m/s at 1.5 s."),
        (4, "timeout", "The case took longer than 60 s of wall time."),
    ):
        edit(
            folder / "facts.sqlite",
            f"UPDATE facts SET status = '{status}', error = '{error}', collision = NULL, "
            "end_reason = NULL "
            f"WHERE role = 'ideal' AND scenario = 'front_vehicle_low_speed' AND point = {point}",
            hashes=point == 4,
        )
    again = sumo_eval.score(folder)
    for ads in ("idm", "no_reaction"):
        key = f"front_vehicle_low_speed-{{:04d}}-{ads}"
        found = [
            note
            for note in again.score(ads, "front_vehicle_low_speed").notes
            if isinstance(note, ReferenceMissing)
        ]
        assert found == [
            ReferenceMissing(
                "ideal", "SUMO gave vehicle `lead` the speed 5000 m/s at 0.45 s.", 2, key.format(0)
            ),
            ReferenceMissing(
                "ideal", "The case took longer than 60 s of wall time.", 1, key.format(4)
            ),
        ]
    assert not [
        note
        for note in again.score("idm", "front_vehicle_cut_out").notes
        if isinstance(note, ReferenceMissing)
    ]
    said = (
        "In 2 cases, e.g. front_vehicle_low_speed-0000-idm, the ideal vehicle's drive could not "
        "be evaluated, so Ug is "
        "not known. Recorded of it: SUMO gave vehicle `lead` the speed 5000 m/s at 0.45 s."
    )
    scores = {(row["ads"], row["scenario"]): row for row in scores_json(again)["scores"]}
    assert said in scores["idm", "front_vehicle_low_speed"]["notes"]
    page = html.unescape(write_report(again, zone_partitions(again)).read_text())
    assert said.replace("`lead`", "<code>lead</code>") in page
    write_tables(again)
    told = "\n".join(closing_lines(again))
    assert (
        "front_vehicle_low_speed-0000-idm and 1 more: The ideal vehicle's case here could not be "
        "evaluated, so Ug" in told
    )
    assert "Recorded of it: The case took longer than 60 s of wall time." in told
    rows = {
        row["case"]: row for row in csv.DictReader((folder / "cases.csv").read_text().splitlines())
    }
    assert (
        rows["front_vehicle_low_speed-0004-idm"]["ideal_error"]
        == "The case took longer than 60 s of wall time."
    )
    assert rows["front_vehicle_low_speed-0001-idm"]["ideal_error"] == ""


def test_the_run_folder_holds_what_the_contract_names(done):
    for name in ("evaluation.toml", "manifest.json", "facts.sqlite"):
        assert (done.folder / name).is_file()
    assert read_evaluation(done.folder / "evaluation.toml") == done.settings
    manifest = read_json(done.folder / "manifest.json")
    assert manifest["format_version"] == FORMAT_VERSION
    assert {"sumo_eval", "libsumo", "numpy"} <= set(manifest["versions"])
    assert len(list((done.folder / "networks").glob("*.net.xml"))) == 1
    assert len(list((done.folder / "routes").glob("*.rou.xml"))) == 2


@pytest.mark.parametrize("ads", [(), ("idm",)])
def test_a_deleted_working_folder_is_refused(ads, tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with refusal("The working folder must exist, but it was deleted"):
        sumo_eval.evaluate(small(["idm"], SCENARIOS), tmp_path / "run", ads=ads)


def test_a_run_folder_is_never_written_over(done):
    with refusal("already exists and is not empty"):
        sumo_eval.evaluate(small(("idm",), SCENARIOS), done.folder)


def test_an_ads_may_be_called_like_the_ideal_vehicle_or_a_driver(tmp_path):
    settings = replace(
        small(("idm",)), ads=(AdsSettings("ideal", "no_reaction"), AdsSettings("driver_00", "idm"))
    )
    evaluation = sumo_eval.evaluate(settings, tmp_path / "run")
    assert [result.ads for result in evaluation.scores] == ["ideal", "driver_00"]


UNGUARDED = """
import sumo_eval
print("the script runs")
evaluation = sumo_eval.evaluate("evaluation.toml", out="run")
print("D is there" if evaluation.scores[0].d is not None else "no D")
"""


def test_a_plain_script_without_a_main_guard_runs_once(tmp_path):
    (tmp_path / "evaluation.toml").write_text(
        'name = "plain"\n[[scenario]]\nuse = '
        '"front_vehicle_low_speed"\n[scenario.sampling]\nlevels = 2\n'
        '[[ads]]\nname = "idm"\ncontroller = "idm"\n[drivers]\ncount = 2\n'
    )
    (tmp_path / "plain.py").write_text(UNGUARDED)
    done = program(sys.executable, "plain.py", cwd=tmp_path, timeout=300)
    assert done.stdout.split("\n")[:2] == ["the script runs", "D is there"], done.stderr


HALF_BROKEN = """
from sumo_eval import Command

class Flaky:
    def reset(self, scenario, traci, ego):
        self.fast = traci.vehicle.getSpeed(ego) > 25
    def step(self, traci, ego, time):
        if self.fast:
            raise RuntimeError("lost the lane")
        return Command(-1.0)
"""


def test_cases_that_cannot_be_evaluated_are_counted_and_named_not_dropped(tmp_path):
    (tmp_path / "flaky.py").write_text(HALF_BROKEN)
    (tmp_path / "evaluation.toml").write_text(
        'name = "flaky"\n[[scenario]]\nuse = '
        '"front_vehicle_low_speed"\n[scenario.sampling]\nlevels = 3\n'
        '[[ads]]\nname = "flaky"\ncontroller = "flaky.py:Flaky"\n[drivers]\ncount = 3\n'
    )
    evaluation = sumo_eval.evaluate(tmp_path / "evaluation.toml", tmp_path / "run")
    (result,) = evaluation.scores
    broken = [case for case in evaluation.cases if case.status == "ads_error"]
    assert {case.values["ego_speed"] for case in broken} == {30.0}
    assert all("lost the lane" in (case.error or "") for case in broken)
    assert result.not_evaluated == evaluation.not_evaluated == len(broken) == 3
    assert result.cases == len(broken) + sum(case.evaluated for case in evaluation.cases)
    assert any(isinstance(note, CasesMissing) and note.cases == 3 for note in result.notes)


RECORDED = """
import numpy as np
from sumo_eval import Trajectory

def drivers(concrete):
    time = np.arange(0, 40, 0.1)
    return [
        Trajectory(time, concrete.ego.x + speed * time, np.full(time.size, offset))
        for speed, offset in ((9.0, 0.1), (10.0, 0.0), (11.0, -0.1))
    ]
"""


def test_the_human_reference_is_a_door(tmp_path):
    (tmp_path / "recorded.py").write_text(RECORDED)
    (tmp_path / "evaluation.toml").write_text(
        'name = "own drivers"\n[[scenario]]\nuse = '
        '"front_vehicle_low_speed"\n[scenario.sampling]\nlevels = 2\n'
        '[[ads]]\nname = "idm"\ncontroller = "idm"\n[drivers]\nsource = "recorded.py:drivers"\n'
    )
    evaluation = sumo_eval.evaluate(tmp_path / "evaluation.toml", tmp_path / "run")
    with open_store(evaluation.folder) as store:
        humans = list(store.facts("human"))
    assert {human.controller for human in humans} == {"recorded.py:drivers"}
    assert len(humans) == 3 * len(evaluation.cases)
    assert evaluation.scores[0].d is not None


def test_every_evaluated_case_carries_its_criticality_and_no_cell_is_garbage(done):
    names = [
        "min_ttc",
        "max_ittc",
        "min_thw",
        "min_gap",
        "max_drac",
        "pet",
        "max_deceleration",
        "max_jerk",
        "delta_v",
    ]
    for case in done.cases:
        values = [getattr(case, name) for name in names]
        assert all(value is None or np.isfinite(value) for value in values)
        assert case.max_deceleration is not None
        assert (case.delta_v is not None) == case.collided
        if case.collided and case.side == "front":
            assert case.min_ttc == 0.0
            assert case.min_gap == 0.0
            assert case.pet == 0.0
            assert case.max_ittc is None
            assert case.delta_v == pytest.approx(-case.impact_speed / 2.0, rel=0.02), (
                "along the road, nearly"
            )
        elif case.min_ttc:
            assert case.max_ittc == pytest.approx(1.0 / case.min_ttc)
    no_reaction = [case for case in done.cases if case.ads == "no_reaction"]
    assert {case.max_deceleration for case in no_reaction} == {0.0}


def test_the_ideal_vehicle_has_an_outcome_wherever_an_ads_collided(done):
    hits = [case for case in done.cases if case.collided]
    assert hits
    assert all(case.ideal_collided == (case.ideal_severity > 0.0) for case in hits)
    struck = {(case.scenario, *case.values.values()) for case in hits}
    for case in done.cases:
        assert (case.ideal_collided is None) == (
            (case.scenario, *case.values.values()) not in struck
        )


def test_what_was_preventable_follows_the_reference_and_needs_no_simulation(done):
    from sumo_eval.scoring.preventability import preventability

    ideal = {(row.ads, row.scenario): row for row in preventability(done)}
    for score in done.scores:
        assert ideal[score.ads, score.scenario].preventable == score.avoidable_collisions
    by_idm = sumo_eval.score(done.folder, ["report.reference=idm"])
    assert by_idm.scores == done.scores, "the reference moves no score"
    hits = {(c.ads, c.scenario, tuple(c.values.values())) for c in by_idm.cases if c.collided}
    for row in preventability(by_idm):
        own = {hit for hit in hits if hit[:2] == (row.ads, row.scenario)}
        assert row.preventable == sum(("idm", *hit[1:]) not in hits for hit in own)
        assert row.unpreventable == sum(("idm", *hit[1:]) in hits for hit in own)
