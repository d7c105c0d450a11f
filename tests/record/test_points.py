"""Which points of a space an evaluation drives, and what is said where it drives none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluations import small
from refusals import refusal

import sumo_eval
from sumo_eval.errors import InputError
from sumo_eval.record.facts import resolve
from sumo_eval.record.only import narrowed, points_only
from sumo_eval.record.points import choose_points
from sumo_eval.report.headline import headline
from sumo_eval.scenario.catalogue import load
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import (
    MethodSettings,
    RankingSettings,
    ReportSettings,
    RunSettings,
    SamplingSettings,
)


def test_an_empty_sampling_names_the_constraint_that_ruled_out_how_many(tmp_path):
    (tmp_path / "points.csv").write_text(
        "ego_speed,obstacle_speed,gap\n10,10,60\n20,20,60\n20,20,90\n"
    )
    listed = SamplingSettings(method="file", file="points.csv")
    settings = small(scenarios=("front_vehicle_cut_out",), sampling=listed)
    (entry,) = settings.scenario
    with pytest.raises(InputError) as refused:
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


def test_axes_of_an_unknown_scenario_are_refused(tmp_path):
    axes = ReportSettings(axes={"cut_im": ("gap", "ego_speed")})
    settings = small(scenarios=("cut_in",), report=axes)
    with refusal(r"Unknown scenario `cut_im` in `report\.axes`"):
        resolve(settings, tmp_path / "run", resume=False)


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
