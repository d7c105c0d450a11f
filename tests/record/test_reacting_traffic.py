"""Runs with vehicles that react: whose collision one from behind is, and the same facts however
they are made."""

import shutil

import pytest

import sumo_eval
from sumo_eval.evaluation import zone_partitions
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import Store
from sumo_eval.report.explain import explain_case, known_case
from sumo_eval.scoring.findings import unevaluated

SCENARIO = """
name = "chased"
zone = "none"
people = "none"
parameter = [{ name = "gap", unit = "m", low = 2.0, high = 30.0, step = 4.0 }]
ego = { speed = 20.0, x = 120.0 }
end = { x = 500.0, time = 8.0 }
[[vehicle]]
name = "rear"
gap_behind = "gap"
speed = 30.0
manoeuvre = [{ do = "follow", model = "IDM" }]
[[vehicle]]
name = "ahead"
gap = 60.0
speed = 15.0
manoeuvre = [{ do = "brake", when = "gap(ego, ahead) < 50", deceleration = 4.0 }]
"""
EVALUATION = """
name = "chased"
[[scenario]]
use = "chased.toml"
[[ads]]
name = "idm"
controller = "idm"
[method.zones]
grid_points = 1000
"""


def chased(folder, workers):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "chased.toml").write_text(SCENARIO)
    (folder / "chased.evaluation.toml").write_text(EVALUATION)
    return sumo_eval.evaluate(folder / "chased.evaluation.toml", folder / "run", workers=workers)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    return chased(tmp_path_factory.mktemp("chased"), 1)


def test_a_collision_from_behind_is_counted_apart_by_default(done):
    (score,) = done.scores
    struck = [case for case in done.cases if case.struck_from_behind]
    assert 0 < len(struck) == score.struck_from_behind < len(done.cases)
    assert score.collisions == 0
    assert score.c == 1.0
    assert score.avoided_share == 1.0
    assert all(
        case.side == "rear" and not case.collided and case.severity is None for case in struck
    )
    assert all(case.impact_speed and case.impact_speed > 0.0 for case in struck)
    fact = known_case(done.folder, struck[0].case)
    words = "\n".join(explain_case(done, zone_partitions(done), fact))
    assert words.count("ran into the ego's rear") > 2
    assert "ideal vehicle has as well" not in words
    assert "no contact" not in words
    (again,) = sumo_eval.score(done.folder, ['method.collision.rear_end="counts"']).scores
    assert again.struck_from_behind == 0
    assert again.collisions == len(struck)


def test_where_no_drivers_know_the_scene_d_and_h_report_it(done):
    (score,) = done.scores
    assert score.d is None
    assert score.human_likeness is None
    assert score.not_evaluated == 0
    assert score.d_reason.why == "no_drivers"
    assert score.h_reason.why == "no_drivers"
    assert not any(map(len, unevaluated(done)))


def test_law_facts_of_reacting_traffic_are_the_same_for_two_workers_and_after_a_resume(
    done, tmp_path
):
    first = sumo_eval.open_run(done.folder).digest()
    assert sumo_eval.open_run(chased(tmp_path / "two", 2).folder).digest() == first
    shutil.copytree(done.folder, tmp_path / "half")
    store = Store(tmp_path / "half" / FACTS, create=True)
    store.unseal()
    store.remove([fact.case for fact in store.facts("ads")][::2])
    store.close()
    sumo_eval.evaluate(None, tmp_path / "half", resume=True, workers=1)
    assert sumo_eval.open_run(tmp_path / "half").digest() == first


STREAM = """
name = "stream"
[[scenario]]
use = "stop_and_go_stream"
[scenario.sampling]
method = "sobol"
count = 6
[[scenario]]
use = "ramp_merge?follower=1.5"
[scenario.sampling]
method = "sobol"
count = 4
[method.zones]
grid_points = 1000
[[ads]]
name = "idm"
controller = "idm"
[[ads]]
name = "lane_changer"
controller = "lane_changer"
[[ads]]
name = "mine"
controller = "mine.py:Mine"
[drivers]
count = 2
"""
MINE = """
class Mine:
    def act(self, seen):
        return -2.0 if seen.lead and seen.lead.gap < 30 else 0.0
"""


@pytest.mark.campaign
def test_law_facts_of_a_stream_and_of_a_follower_at_a_ramp_are_the_same_for_one_two_and_eight_workers(
    tmp_path,
):
    digests = set()
    for workers in (1, 2, 8):
        folder = tmp_path / str(workers)
        folder.mkdir()
        (folder / "mine.py").write_text(MINE)
        (folder / "stream.toml").write_text(STREAM)
        done = sumo_eval.evaluate(folder / "stream.toml", folder / "run", workers=workers)
        assert {case.status for case in done.cases} <= {"ok", "collision", "off_road"}
        digests.add(sumo_eval.open_run(done.folder).digest())
    assert len(digests) == 1
