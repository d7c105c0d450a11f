"""A run in rounds, through SUMO: chosen by what was found, the same bytes for any workers, stopped
or not."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluations import small
from refusals import refusal

import sumo_eval
from sumo_eval.errors import StoppedError
from sumo_eval.record.facts import record_facts, resolve
from sumo_eval.record.only import narrowed, points_only
from sumo_eval.record.points import choose_points, scenario_weights
from sumo_eval.record.run_folder import read_manifest, read_settings
from sumo_eval.report.headline import headline
from sumo_eval.scenario.catalogue import load
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.scoring.steps import Scoring
from sumo_eval.settings import (
    DriverSettings,
    MethodSettings,
    RankingSettings,
    ReportSettings,
    RunSettings,
    SamplingSettings,
)

EVALUATION = tomllib.loads("""
name = "rounds"
scenario = [
    { use = "front_vehicle_low_speed", sampling = { method = "adaptive", count = 40, round = 16 } },
]
ads = [{ name = "careful", controller = "careful_driver" }]
drivers = { count = 2 }
simulation = { step = 0.1 }
method = { zones = { restarts = 0, refinements = 0, grid_points = 1000 } }
""")


def sampling_of(run):
    return read_settings(run).scenario[0].sampling


scorings = []
"""How many points a run had at each scoring of the fixture's run."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        really = Scoring.scores

        def counted(self, rows):
            found = really(self, rows)
            scorings.append(sum(score.cases for score in found.scores))
            return found

        patch.setattr(Scoring, "scores", counted)
        return sumo_eval.evaluate(EVALUATION, tmp_path_factory.mktemp("rounds") / "run", workers=2)


def test_every_round_is_scored_once_the_last_one_too(run):
    assert scorings == [16, 40]
    assert sumo_eval.score(run.folder).scores == run.scores
    assert scorings == [16, 40]


def test_rounds_go_where_cases_differ_and_scores_are_weighted_by_what_points_stand_for(run):
    rounds = sampling_of(run.folder).rounds
    assert [sum(row) for row in rounds] == [16, 24]  # 8 would be left, too few for two rounds
    assert rounds[0] == (4, 4, 4, 4)
    assert len(set(rounds[1])) > 1
    assert min(min(row) for row in rounds) >= 2
    assert len(run.cases) == 40
    settings = read_settings(run.folder)
    points = choose_points(
        run.scenarios[run.zones[0].scenario], settings.scenario[0], Path(), settings
    )
    assert points.stands_for.sum() == pytest.approx(40.0)
    cases = list(run.cases)
    assert [case.exposure for case in cases] == points.exposure.tolist()
    collided = np.array([case.collided for case in cases], dtype=float)
    assert run.scores[0].collision_probability == pytest.approx(
        float(points.exposure @ collided / sum(points.exposure))
    )
    assert (
        run.zones[0]
        .notes[-1]
        .startswith("Adaptive sampling: 40 of at most 40 points in 2 rounds; all it may drive;")
    )


@pytest.mark.campaign
def test_a_run_stopped_in_its_second_round_has_the_same_bytes(run, tmp_path):
    stops = iter([False] * 4 + [True] * 50)
    settings = resolve(EVALUATION, tmp_path / "run", resume=False, workers=1).settings
    settings = replace(settings, run=replace(settings.run, cases_per_child=8, cases_per_pack=8))
    second = lambda: sum(sampling_of(tmp_path / "run").rounds, ()) != () and next(stops)  # noqa: E731
    with pytest.raises(StoppedError, match="--resume continues"):
        sumo_eval.evaluate(settings, tmp_path / "run", stopping=second)
    assert len(sampling_of(tmp_path / "run").rounds) == 2
    again = sumo_eval.evaluate(EVALUATION, tmp_path / "run", workers=1, resume=True)
    assert sampling_of(again.folder).rounds == sampling_of(run.folder).rounds
    assert sumo_eval.open_run(again.folder).digest() == sumo_eval.open_run(run.folder).digest()
    assert again.scores == run.scores
    assert len(read_manifest(again.folder)["resumed"]) == 1
    assert "resumed" not in read_manifest(run.folder)


def test_rounds_of_edited_scenario_keep_their_cells(tmp_path):
    """The number of a point gives its round and cell, whatever the file says now."""
    file = tmp_path / "own.toml"
    text = scenario_files()["front_vehicle_low_speed"].read_text()
    file.write_text(text)
    sampling = {"method": "adaptive", "count": 16, "round": 8, "aim": "boundary"}
    settings = {**EVALUATION, "scenario": [{"use": str(file), "sampling": sampling}]}
    done = sumo_eval.evaluate(settings, tmp_path / "run", engine="serial")
    for rule, sentence in (
        ("ego_speed - 5", "of the space."),
        ("0.01", "choose no points any more"),
    ):
        file.write_text(text.replace('"lead_speed < ego_speed"', f'"lead_speed < {rule}"'))
        again = sumo_eval.score(done.folder)
        assert sentence in "\n".join(again.zones[0].notes)
        assert again.score("careful", done.scores[0].scenario).cases == 16


@pytest.mark.campaign
def test_rounds_that_look_for_the_boundary_of_collisions_go_where_some_collide_and_some_do_not(
    tmp_path,
):
    sampling = {"method": "adaptive", "count": 96, "round": 32, "aim": "boundary"}
    settings = {**EVALUATION, "scenario": [{"use": "cut_in", "sampling": sampling}]}
    done = sumo_eval.evaluate(settings, tmp_path / "run", workers=2)
    rounds = np.array(sampling_of(done.folder).rounds)
    assert rounds.sum() == len(done.cases) == 96
    kept = read_settings(done.folder)
    points = choose_points(done.scenarios[done.zones[0].scenario], kept.scenario[0], Path(), kept)
    cells = rounds.shape[1]
    collided = np.array([case.collided for case in done.cases], dtype=np.float64)
    cell = points.stratum % cells
    share = np.bincount(cell, collided, cells) / np.bincount(cell, minlength=cells)
    both = (share > 0.0) & (share < 1.0)
    assert both.any()
    assert not both.all()
    later = rounds[1:].sum(axis=0)
    assert later[both].mean() > later[~both].mean(), (
        "cells in which outcomes differ get more of the later rounds"
    )
    assert done.scores[0].collision_probability == pytest.approx(
        float(points.stands_for @ collided / 96.0)
    )
    assert "of the space" in done.zones[0].notes[-1]


@pytest.mark.campaign
def test_a_larger_budget_adds_rounds_and_a_width_that_is_reached_none(run):
    entry = read_settings(run.folder).scenario[0]
    reached = replace(entry, sampling=replace(entry.sampling, count=72, until=100.0))
    settings = replace(read_settings(run.folder), scenario=(reached,))
    with refusal("already exists"):
        sumo_eval.evaluate(settings, run.folder)
    wider = sumo_eval.evaluate(settings, run.folder, resume=True)
    assert len(wider.cases) == 40
    assert wider.zones[0].notes[-1].endswith("points of S+, no more than the 100 asked for.")


def test_a_budget_below_what_was_driven_is_refused(run):
    entry = read_settings(run.folder).scenario[0]
    smaller = replace(entry, sampling=replace(entry.sampling, count=32))
    with refusal("must be at least the 40 points that its rounds have, got 32"):
        sumo_eval.evaluate(
            replace(read_settings(run.folder), scenario=(smaller,)), run.folder, resume=True
        )
    assert sampling_of(run.folder) == entry.sampling


def test_shards_cannot_choose_by_all_cases(tmp_path):
    run = replace(resolve(EVALUATION, tmp_path, resume=False), shard=(1, 2))
    with refusal(r"sampled in rounds .* cannot be recorded in shards"):
        record_facts(run, tmp_path / "run")


# --- which points of a space an evaluation drives, and what is said where it drives none ----------


def test_an_empty_sampling_names_the_constraint_that_ruled_out_how_many(tmp_path):
    (tmp_path / "points.csv").write_text(
        "ego_speed,obstacle_speed,gap\n10,10,60\n20,20,60\n20,20,90\n"
    )
    listed = SamplingSettings(method="file", file="points.csv")
    settings = small(scenarios=("front_vehicle_cut_out",), sampling=listed)
    (entry,) = settings.scenario
    with refusal() as refused:
        choose_points(load(entry.use), entry, tmp_path, settings)
    sentence = str(refused.value)
    assert sentence.startswith(
        "The sampling of scenario `front_vehicle_cut_out` must choose at least one possible point"
    )
    assert "Of 3 points, 3 are not `" in sentence


def test_only_knows_cases_of_names_that_hold_numbers(tmp_path):
    shipped = Path(sumo_eval.__file__).parent / "scenario/files/cut_in.toml"
    text = shipped.read_text().replace('"cut_in"', '"cut-in-2026-de"', 1)
    (tmp_path / "mine.toml").write_text(text)
    settings = small(
        {"v-2025-1": "idm", "v-2026-1": "idm"},
        ("mine.toml", "cut_in"),
        run=RunSettings(only=("cut-in-2026-de-0003-v-2026-1",)),
        method=MethodSettings(ranking=RankingSettings({"cut_in": 1.0, "misspelt": 1.0})),
        report=ReportSettings(axes={"cut_in": ("gap", "ego_speed")}),
    )
    kept = narrowed(Resolved.of(settings, tmp_path))
    assert list(kept.scenarios) == ["cut-in-2026-de"]
    assert [ads.name for ads in kept.settings.ads] == ["v-2026-1"]
    assert list(kept.settings.method.ranking.weights) == ["misspelt"]  # which is refused later
    assert not kept.settings.report.axes
    cases = replace(settings.run, only=("cut-in-0001-v-2025-1", "cut-in-2026-de-0003-v-2026-1"))
    both = replace(settings, run=cases)
    assert points_only(range(9), both, "cut-in", 9) == [1]
    assert points_only(range(9), both, "cut-in-2026-de", 9) == [3]


def test_what_only_leaves_of_an_evaluation_can_be_read_again(tmp_path):
    """The run's folder keeps it, and scoring reads it there."""
    settings = small(
        {"idm": "idm"},
        ("cut_in", "bicycle_along"),
        run=RunSettings(only=("cut_in-0001-idm",)),
        method=MethodSettings(ranking=RankingSettings({"cut_in": 0.0})),
    )
    settings = replace(settings, drivers=DriverSettings(tolerance={"headway": 0.5}))
    kept = narrowed(Resolved.of(settings, tmp_path)).settings
    assert list(Resolved.of(kept, tmp_path).scenarios) == ["cut_in"]
    assert scenario_weights(["cut_in"], kept.method.ranking) == {"cut_in": 1.0}


def test_an_exposure_of_0_at_every_point_is_refused(tmp_path):
    settings = small()
    (entry,) = settings.scenario
    with refusal("must be above 0 at one of them, got 0"):
        choose_points(load(entry.use), entry, tmp_path, settings, lambda _: np.zeros(1))


def test_only_drives_and_scores_the_named_cases_alone(tmp_path):
    names = ("front_vehicle_low_speed", "front_vehicle_braking")
    asked = (f"{names[0]}-0003-idm", f"{names[0]}-0004-calm", f"{names[1]}-0001-late")
    ads = dict.fromkeys(("idm", "calm", "late"), "idm")
    settings = small(ads, names, run=RunSettings(only=asked, engine="serial"))
    done = sumo_eval.evaluate(settings, tmp_path / "run")
    assert sorted(done.cases.case) == sorted(asked)
    assert [(one.ads, one.cases) for one in done.scores] == [("idm", 1), ("calm", 1), ("late", 1)]
    assert done.ranking is None  # what was driven at different points has no order
    assert {it for _, it in headline(done).answers} == {
        "not known: the ADSs drove different points."
    }
    wrong = RunSettings(only=(asked[0].replace("-0", "-00"),))
    with refusal(f"Did you mean `{asked[0]}`"):
        resolve(replace(settings, run=wrong), tmp_path, False)
