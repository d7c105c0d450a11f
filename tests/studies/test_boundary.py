"""The search through SUMO: a small one, whose answer the closed form knows."""

import json
import re
import sqlite3
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import cli_refuses
from laid import read_json
from refusals import refusal, refused
from tables import rows_of, values_of

from sumo_eval.errors import StoppedError
from sumo_eval.extras.studies.boundary import FailureBoundary, Round, find_boundary, slice_of
from sumo_eval.extras.studies.boundary_page import (
    check_columns,
    edge_panels,
    sentences,
    summary,
    write_boundary,
)
from sumo_eval.extras.studies.straddle import BoundarySearch
from sumo_eval.extras.studies.trials import KEPT, trials_in
from sumo_eval.method.criticality import required_gap
from sumo_eval.record.cases import Setup
from sumo_eval.scenario import Constraint, catalogue
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import RunSettings, SimulationSettings

CUT_OUT = catalogue.load("front_vehicle_cut_out")
ROOT = Path(__file__).parents[2]
SETUP = Setup(SimulationSettings(), RunSettings(workers=2), Path.cwd())


def test_a_slice_is_the_scenario_with_parameters_held():
    at_25 = slice_of(CUT_OUT, {"ego_speed": 25.0})
    assert at_25.names == ("obstacle_speed", "gap")
    held, free = (
        at_25.concrete(obstacle_speed=5.0, gap=60.0),
        CUT_OUT.concrete(ego_speed=25.0, obstacle_speed=5.0, gap=60.0),
    )
    assert held.ego == free.ego
    assert held.actors == free.actors
    assert held.road == free.road
    points = sample(at_25, levels=5).points
    assert CUT_OUT.feasible(np.column_stack([np.full(len(points), 25.0), points])).all()
    assert slice_of(CUT_OUT, {}) is CUT_OUT
    for fixed, sentence in values_of("""
        {"ego_sped": 25.0}, "Did you mean `ego_speed`?"
        {"ego_speed": 99.0}, "within 10..30 m/s"
        {"ego_speed": 20.0, "obstacle_speed": 5.0, "gap": 60.0}, "at least one parameter free"
        """):
        with refused(sentence):
            slice_of(CUT_OUT, fixed)


def test_a_slice_keeps_fixed_values_and_settings():
    perceived = catalogue.find("docs/examples/cut_in_perceived.toml", ROOT)
    settings = {"conditions.sensor_range": 20.0, "conditions.perception_delay": 1.0}
    held = slice_of(slice_of(perceived, settings), {"lateral_speed": 1.0})
    point = {"ego_speed": 30.0, "cut_in_speed": 20.0, "gap": 40.0}
    concrete, whole = held.concrete(**point), perceived.concrete(**point, **dict(held.fixed))
    assert dict(concrete.changes) == dict(whole.changes) == settings
    assert dict(concrete.values) == dict(whole.values)
    assert concrete.actors == whole.actors
    gaps = [held.approach(held.columns([30.0, 20.0, gap])).gap for gap in (40.0, 80.0)]
    assert gaps == [40.0, 80.0]


def test_the_ideal_vehicles_collisions_are_those_of_its_braking_distance(tmp_path):
    # a slower vehicle ahead that is seen from the start, through the one that hides it: braking at
    # 9 m/s2 with 0.15 s of build-up needs `required_gap`
    sees_through = replace(SETUP, simulation=replace(SETUP.simulation, ideal_visible_share=0.0))
    logical = slice_of(catalogue.load("front_vehicle_cut_out"), {"ego_speed": 30.0})
    with trials_in(tmp_path, sees_through, ["ideal_braking"], "", resume=False) as trials:
        found = find_boundary(logical, "ideal_braking", trials, budget=80, seed=2)
    middle = (np.arange(60) + 0.5) / 60
    points = logical.from_unit(np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2))
    points = points[logical.feasible(points)]
    needed = required_gap(30.0 - points[:, 0], deceleration=9.0, build_up=0.15)
    assert found.rounds[-1].simulations <= 80
    assert np.mean(found.search.classify(points) == (points[:, 1] < needed)) >= 0.98
    content = summary(found, {})
    assert content["collision_share_of_space"] == pytest.approx(
        np.mean(points[:, 1] < needed), abs=0.02
    )
    paths = write_boundary(found, content, tmp_path)
    assert [path.name for path in paths] == [
        "trials.csv",
        "boundary.json",
        "boundary.html",
        "chances.csv",
    ]
    rows = paths[0].read_text().splitlines()
    assert rows[0] == "obstacle_speed,gap,collided"
    assert len(rows) == 1 + len(found.search.points)
    assert read_json(paths[1])["simulations"] == found.rounds[-1].simulations
    assert "http" not in paths[2].read_text().split("<script", 1)[0].replace("http-equiv", "")
    chances = paths[3].read_text()
    for file, damage in ((paths[3], chances[: len(chances) // 2]), (paths[0], "a,b\n1,2\n")):
        file.write_text(damage)
        with refusal(f"{re.escape(str(file))} cannot be read or is damaged .* Search it again"):
            edge_panels(tmp_path)


class _Drives:
    """Trials without a simulation: a collision below 60 m, safe above 70 m, no answer between."""

    def at(self, points, logical, ads, *, first, ended):
        gaps = points[:, logical.column("gap")]
        names = np.select([gaps < 60.0, gaps > 70.0], ["collision", "ok"], "ads_error")
        return [SimpleNamespace(status=name) for name in names.tolist()]


def test_rounds_with_few_answers_settle_nothing():
    logical = slice_of(CUT_OUT, {"ego_speed": 30.0, "obstacle_speed": 5.0})
    result = find_boundary(logical, "stub", _Drives(), budget=96)
    assert result.not_evaluated["ads_error"] > 45
    assert result.stopped == "budget"
    assert {it.expected_change for it in result.rounds} == {1.0}


def test_no_exposure_is_named_where_none_is_known():
    logical = slice_of(CUT_OUT, {"ego_speed": 30.0, "obstacle_speed": 5.0})
    content = summary(find_boundary(logical, "stub", _Drives(), budget=32), {})
    assert "exposure" not in next(sentences(content))
    known = replace(CUT_OUT, exposure=lambda values: values["gap"] < 60.0)
    content = summary(
        find_boundary(
            slice_of(known, {"ego_speed": 30.0, "obstacle_speed": 5.0}),
            "stub", _Drives(), budget=32,
        ), {},
    )  # fmt: skip
    assert "of the exposure)" in next(sentences(content))


def test_slice_that_never_occurs_has_no_share_of_exposure(tmp_path):
    never = replace(CUT_OUT, exposure=lambda values: np.zeros(np.shape(values["gap"])))
    logical = slice_of(never, {"ego_speed": 30.0, "obstacle_speed": 5.0})
    result = find_boundary(logical, "stub", _Drives(), budget=32)
    content = summary(result, {})
    assert content["collision_share_of_exposure"] is None
    assert "(an unknown share of the exposure)" in next(sentences(content))
    write_boundary(result, content, tmp_path)
    possible = Constraint("none", lambda values: np.zeros(np.shape(values["gap"]), bool))
    nowhere = result._replace(logical=replace(logical, constraints=(possible,)))
    content = summary(nowhere, {})
    assert content["collision_share_of_space"] is None
    assert "collides in an unknown share of the space" in next(sentences(content))


def test_an_ads_that_never_answers_has_no_boundary(tmp_path):
    logical = slice_of(CUT_OUT, {"ego_speed": 30.0})
    with (
        trials_in(tmp_path, broken(), ["broken.py:drive"], "", resume=False) as trials,
        refusal("None of 32 cases"),  # of the first round; the rest of the budget is not spent
    ):
        find_boundary(logical, "broken.py:drive", trials, budget=64)


def test_a_point_without_a_fact_is_an_error(tmp_path, monkeypatch):
    with trials_in(tmp_path, SETUP, ["idm"], "", resume=False) as trials:
        monkeypatch.setattr(trials.recorder.store, "fact", lambda key: None)
        points = CUT_OUT.from_unit(np.full((1, 3), 0.5))
        with pytest.raises(RuntimeError, match="-0000-ads was driven, but has no fact in"):
            trials.at(points, CUT_OUT, ("ads", "idm"), first=0, ended=lambda done: None)


def test_a_stopped_search_goes_on_where_it_was(tmp_path):
    logical, kept = slice_of(CUT_OUT, {"ego_speed": 30.0}), []

    def found(folder, watch, *, resume=False):
        folder.mkdir(exist_ok=True)
        with trials_in(folder, SETUP, ["idm"], "idm", resume=resume) as trials:
            kept.append(len(list(trials.recorder.store.facts("ads"))))
            return find_boundary(logical, "idm", trials, budget=48, seed=3, watch=watch)

    def stop(done, total):
        if done > 32:  # in the second round
            raise KeyboardInterrupt

    whole = found(tmp_path / "whole", lambda done, total: None)
    with pytest.raises(
        StoppedError, match=r"^Stopped\. \d+ drives are kept in .* --out .*stopped --resume"
    ):
        found(tmp_path / "stopped", stop)
    with refusal("a study that was stopped; --resume continues it"):
        found(tmp_path / "stopped", stop)
    again = found(tmp_path / "stopped", lambda done, total: None, resume=True)
    assert kept[-1] > 32
    assert np.array_equal(again.search.points, whole.search.points)
    assert np.array_equal(again.search.outcomes, whole.search.outcomes)
    with refusal("the folder of a stopped study in --out, got .*: there is nothing to resume"):
        found(tmp_path / "stopped", stop, resume=True)


def test_a_stopped_study_loses_no_drive_to_another_one(tmp_path):
    def study(name, work, *, resume=False):
        with trials_in(tmp_path, SETUP, ["idm"], name, resume=resume) as trials:
            work(trials)

    def stop(trials):
        raise KeyboardInterrupt

    def stop_after_two(trials):
        points = CUT_OUT.from_unit(np.full((2, 3), 0.5))
        trials.at(points, CUT_OUT, ("ads", "idm"), first=0, ended=lambda done: None)
        stop(trials)

    with refusal("is being written by another process"):
        study("first", lambda trials: study("first", stop, resume=True))
    with pytest.raises(StoppedError, match="2 drives are kept"):
        study("second", stop_after_two)  # the first one holds no drive, so nothing is lost
    with refusal("`second`; `third` needs another folder"):
        study("third", stop, resume=True)
    with sqlite3.connect(tmp_path / KEPT) as kept:
        kept.execute("UPDATE facts SET status = 'off_road'")
    with refusal("is not as it was recorded"):
        study("second", stop, resume=True)


def broken():
    import tempfile

    folder = Path(tempfile.mkdtemp())
    (folder / "broken.py").write_text(
        "def drive(traci, ego, time):\n    raise RuntimeError('no')\n"
    )
    return Setup(SimulationSettings(), RunSettings(workers=1), folder)


@pytest.mark.parametrize("resume", [False, True])
def test_a_finished_study_is_not_written_over(tmp_path, resume):
    (tmp_path / "boundary.html").touch()
    with (
        refusal("holds the results of a study, boundary.html: name another folder"),
        trials_in(tmp_path, SETUP, ["idm"], "idm", resume=resume),
    ):
        pass


def test_files_have_each_column_once_and_each_value(tmp_path):
    gap = CUT_OUT.parameters[-1]
    chance = replace(CUT_OUT, parameters=(replace(gap, name="chance"),))
    with refusal("must not be named `chance`"):
        check_columns(chance)
    narrow = replace(gap, low=1e9, high=1e9 + 5.0)
    far = replace(CUT_OUT, parameters=(narrow,), constraints=())
    search = BoundarySearch(far)
    search.tell(search.ask(4), [False] * 4)
    last = Round(4, 0, 1.0, 1.0)
    result = FailureBoundary(far, "stub", search, (last,), {}, "no point left")
    content = summary(result, {})
    write_boundary(result, content, tmp_path)
    lines = (tmp_path / "chances.csv").read_text().splitlines()
    assert len({line.split(",")[0] for line in lines}) == 81
    assert list(sentences(content))[1] == "The search ended (no point left)."


@pytest.mark.parametrize(
    "arguments, sentence",
    rows_of(
        """
["cut_in", "careful_drivr", "--fix", "ego_speed=30"] | Did you mean `careful_driver`?
["cut_inn", "idm"] | Did you mean `cut_in`?
["cut_in", "idm", "--fix", "ego_speed"] | --fix must have the form NAME=VALUE
["cut_in", "idm", "--fix", "ego_sped=3"] | Did you mean `ego_speed`?
["cut_in", "idm", "--tolerance", "1"] | 1.0 is not in the range 0.0<=x<1.0
["cut_in", "idm", "--tolerance", "nan"] | nan is not a number
""",
        json.loads,
    ),
)
def test_the_command_refuses(tmp_path, arguments, sentence):
    cli_refuses(sentence, "boundary", *arguments, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
