"""The examples of docs/ads: each drives two cases as its page says, and a whole evaluation takes
ADSs by locator."""

import shutil
import subprocess
import sys
from dataclasses import replace

import pytest
from ads_cases import CUT_OUT, EXAMPLES, SLOWER
from evaluations import small
from refusals import refusal
from road_scenes import assert_last, clear_drive, clips_of, need_sumo

import sumo_eval
from sumo_eval.cosim import simulate
from sumo_eval.settings import ConditionSettings, RunSettings, SimulationSettings

pytestmark = pytest.mark.usefixtures("own_path")


def drive(locator, concrete=SLOWER, **kwargs):
    return clear_drive(concrete, locator, folder=EXAMPLES, step_timeout=10.0, **kwargs)


FOLLOWERS = [
    "ten_line_acc.py:acc", "step_listener.py:KeepDistance", "policy.py:LinearPolicy",
    "simpla_gap.py:OpenGap",
    "speed_controller.py:follow", "pedals.py:drive",
]  # fmt: skip


@pytest.mark.parametrize("concrete", [SLOWER, CUT_OUT], ids=["slower", "cut_out"])
@pytest.mark.parametrize("locator", FOLLOWERS)
def test_who_follows_ends_at_the_leads_speed_in_its_lane(locator, concrete):
    found = drive(locator, concrete)
    assert_last(found, 0.2, speed=5.0 if concrete is SLOWER else 10.0)
    assert abs(found.ego.y).max() == 0.0


@pytest.mark.parametrize("concrete", [SLOWER, CUT_OUT], ids=["slower", "cut_out"])
def test_the_overtaking_planner_overtakes(concrete):
    found = drive("overtaking_planner.py:Overtaker", concrete)
    assert_last(found, 0.1, y=3.5)
    assert (
        found.ego.x[-1] > found.actors["obstacle" if concrete is CUT_OUT else "lead"].x[-1] + 20.0
    )
    assert_last(found, speed=20.0)


def test_the_trajectory_planner_overtakes_close_to_its_plans():
    found = drive("trajectory_planner.py:Planner")
    assert_last(found, 0.01, y=3.5)
    assert found.ego.x[-1] > found.actors["lead"].x[-1] + 20.0
    assert clips_of(found)["plan_error"].applied < 0.05


def test_the_c_program_drives_as_the_ten_lines_do(tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    subprocess.run([compiler, "-O2", "-o", tmp_path / "acc", EXAMPLES / "acc.c"], check=True)
    short = SimulationSettings(time_limit=20.0)
    in_c = drive(f"exec:{tmp_path / 'acc'}", CUT_OUT, settings=short)
    in_python = drive("ten_line_acc.py:acc", CUT_OUT, settings=short)
    assert in_c.ego.speed.tolist() == pytest.approx(in_python.ego.speed.tolist(), abs=1e-9)


def test_the_client_of_its_own_drives_as_the_step_listener_does():
    need_sumo()
    short = SimulationSettings(time_limit=15.0)
    client = drive(f"traci:{sys.executable} traci_client.py", SLOWER, settings=short)
    listener = drive("step_listener.py:KeepDistance", SLOWER, settings=short)
    assert client.ego.speed.tolist() == listener.ego.speed.tolist()


def test_simplas_platoon_needs_leave_to_touch_the_lead_and_then_closes_up():
    short = SimulationSettings(time_limit=20.0)
    refused = simulate(SLOWER, "simpla_platoon.py:Platoon", short, folder=EXAMPLES)
    assert "The ADS called traci.vehicle.setSpeedFactor for `lead` at 0.00 s" in refused.error
    recorded = replace(short, conditions=ConditionSettings(interference="record"))
    found = drive("simpla_platoon.py:Platoon", SLOWER, settings=recorded)
    assert "touched_vehicle" in clips_of(found)
    gap = found.actors["lead"].x[-1] - found.ego.x[-1] - 4.5
    assert 0.0 < gap < 10.0  # a follower of tau 0.5 s at 5 m/s
    assert_last(found, 0.2, speed=5.0)


def test_a_published_planner_overtakes_by_sampling_and_its_wrapper_is_short():
    pytest.importorskip("fiss_planner")
    assert len((EXAMPLES / "fiss.py").read_text().splitlines()) < 40
    found = drive("fiss.py:Fiss", SLOWER)
    assert found.ego.x[-1] > found.actors["lead"].x[-1] + 20.0
    assert found.ego.y.max() > 3.0


@pytest.mark.parametrize(
    "locator", ["exec:./nowhere", "nowhere.py:acc", "fmu:nowhere.fmu", "traci:./nowhere"]
)
def test_a_locator_that_names_nothing_is_refused_before_anything_is_simulated(tmp_path, locator):
    with refusal():
        sumo_eval.evaluate(None, tmp_path / "run", ads=[locator])
    assert not (tmp_path / "run").exists()


def test_an_evaluation_takes_adss_by_locator_and_conditions_hold_for_them_alone(tmp_path):
    conditions = ConditionSettings(perception_delay=0.5, position_noise=0.2)
    simulation = SimulationSettings(conditions=conditions)
    settings = small(drivers=2, levels=2, simulation=simulation, run=RunSettings())
    locators = [str(EXAMPLES / "ten_line_acc.py") + ":acc", "sumo:IDM?tau=2", "exec:sh -c 'exit 3'"]
    found = sumo_eval.evaluate(settings, tmp_path / "run", ads=locators)
    assert [ads.name for ads in found.settings.ads] == locators
    status = {name: {case.status for case in found.cases if case.ads == name} for name in locators}
    assert status == {locators[0]: {"ok"}, locators[1]: {"ok"}, locators[2]: {"ads_error"}}
    clips = {
        name: "".join(case.clips for case in found.cases if case.ads == name) for name in locators
    }
    assert "perception_not_limited" not in clips[locators[0]]
    assert "perception_not_limited" in clips[locators[1]]
    assert "perception_delay = 0.5" in (tmp_path / "run" / "evaluation.toml").read_text()
    from sumo_eval.record.store import open_store

    with open_store(tmp_path / "run") as store:
        assert all(
            fact.clips == () or "perception" not in fact.clips[0].what
            for fact in store.facts("human")
        )
