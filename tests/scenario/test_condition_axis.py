"""A condition as a parameter of a scenario file."""

from pathlib import Path

import numpy as np

import sumo_eval
from sumo_eval.cosim.simulation import simulate
from sumo_eval.scenario import catalogue

SHIPPED = Path(sumo_eval.__file__).parent / "scenario" / "files" / "cut_in.toml"
AXES = """
[[parameter]]
name = "conditions.perception_delay"
low = 0.0
high = 1.0
step = 0.5
unit = "s"

[[parameter]]
name = "conditions.sensor_range"
low = 20.0
high = 120.0
step = 50.0
unit = "m"

[define]
"""
POLICY = """
class Keeps:
    def act(self, observation):
        lead = observation.lead
        return 0.0 if lead is None or lead.gap > 1.5 * observation.ego.speed else -6.0
"""


def test_delay_and_range_are_axes_that_only_the_ads_feels(tmp_path):
    text = SHIPPED.read_text().replace("[define]\n", AXES.lstrip(), 1)
    (tmp_path / "seen_late.toml").write_text(text.replace('"cut_in"', '"seen_late"', 1))
    (tmp_path / "keeps.py").write_text(POLICY)
    logical = catalogue.find("seen_late.toml", tmp_path)
    here = {"ego_speed": 30.0, "cut_in_speed": 15.0, "gap": 40.0, "lateral_speed": 0.9}
    worst = {"conditions.perception_delay": 1.0, "conditions.sensor_range": 20.0}
    late = logical.concrete(**here, **worst)
    assert dict(late.changes) == worst
    assert not late.without_ads.changes
    sharp = logical.concrete(
        **here, **dict.fromkeys(worst, 0.0) | {"conditions.sensor_range": 120.0}
    )
    keeps = f"{tmp_path / 'keeps.py'}:Keeps"
    assert not simulate(late, keeps).same_motion(simulate(sharp, keeps))
    assert simulate(late, "no_reaction").same_motion(simulate(sharp, "no_reaction"))

    evaluation = """
name = "seen"
seed = 3
[[scenario]]
use = "seen_late.toml"
[scenario.sampling]
method = "latin_hypercube"
count = 24
[[ads]]
name = "keeps"
controller = "keeps.py:Keeps"
[drivers]
count = 2
[run]
workers = 1
"""
    (tmp_path / "night.toml").write_text(evaluation)
    done = sumo_eval.evaluate(tmp_path / "night.toml", tmp_path / "run")
    cases = done.cases_of("keeps", "seen_late")
    assert not cases.missing.any()
    points = np.array([[30.0, 15.0, 40.0, 0.9, delay, 120.0] for delay in (0.0, 1.0)])
    approach = logical.approach(logical.columns(points))
    assert np.ptp(approach.gap) == 0.0
