"""Which points of a space an evaluation drives, and what is said where it drives none."""

import pytest

from sumo_eval.errors import InputError
from sumo_eval.record.points import choose_points
from sumo_eval.scenario.catalogue import load
from sumo_eval.settings import AdsSettings, EvaluationSettings, SamplingSettings, ScenarioSettings


def test_an_empty_sampling_names_the_constraint_that_ruled_out_how_many(tmp_path):
    (tmp_path / "points.csv").write_text(
        "ego_speed,obstacle_speed,gap\n10,10,60\n20,20,60\n20,20,90\n"
    )
    entry = ScenarioSettings(
        "front_vehicle_cut_out", SamplingSettings(method="file", file="points.csv")
    )
    settings = EvaluationSettings("x", (entry,), (AdsSettings("idm", "idm"),))
    with pytest.raises(InputError) as refused:
        choose_points(load(entry.use), entry, tmp_path, settings)
    sentence = str(refused.value)
    assert sentence.startswith(
        "The sampling of scenario `front_vehicle_cut_out` must choose at least one possible point"
    )
    assert "Of 3 points are ruled out: 3 by `" in sentence
