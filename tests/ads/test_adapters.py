"""ADSs with the interfaces of other tools drive through their adapters, unchanged; without one they
are refused."""

import sys
from pathlib import Path

import pytest
from refusals import refusal, refused
from road_scenes import assert_last, at_values, clear_drive
from tables import rows_of

from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.settings import SimulationSettings

HERE = Path(__file__).parent
SLOWER = at_values("front_vehicle_low_speed", ego_speed=20.0, lead_speed=10.0)


@pytest.fixture(autouse=True)
def _path(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, str(HERE)])
    monkeypatch.chdir(HERE.parents[1] / "docs" / "examples" / "adapters")


def drive(locator, seconds=40.0):
    settings = SimulationSettings(time_limit=seconds)
    return clear_drive(SLOWER, locator, settings, step_timeout=10.0)


FOLLOWERS = [
    "carla_agent.py:CarlaAgent?options.agent=foreign_agents:BasicAgent",
    "carla_agent.py:CarlaAgent?options.agent=foreign_agents:RadarAgent",
    "smarts_agent.py:SmartsAgent?options.agent=foreign_agents:Follower",
    "nuplan_planner.py:NuPlanPlanner?period=0.2&options.agent=foreign_agents.py:SimplePlanner",
    "commonroad_planner.py:CommonRoadPlanner?period=0.2&options.agent=foreign_agents:LanePlanner",
]


@pytest.mark.parametrize("locator", FOLLOWERS)
def test_a_follower_of_another_tool_ends_at_the_leads_speed_and_its_own_gap(locator):
    needed = {"nuplan_planner": "nuplan", "commonroad_planner": "commonroad"}
    pytest.importorskip(needed.get(locator.partition(".")[0], "numpy"))
    # at rest behind the lead: lead_speed = lead_speed + 0.3 (gap - 5 - 1.2 v), so gap = 5 + 1.2 x
    # 10 = 17 m
    found = drive(locator)
    assert_last(found, 0.2, speed=10.0)
    assert found.actors["lead"].x[-1] - found.ego.x[-1] - 4.5 == pytest.approx(17.0, abs=1.0)
    assert abs(found.ego.y).max() < 1e-6


def test_carlas_steer_is_to_the_right():
    found = drive("carla_agent.py:CarlaAgent?options.agent=foreign_agents:LeaderboardAgent", 2.0)
    assert found.ego.y[-1] < -0.05


@pytest.mark.parametrize(
    "agent, action, until, quantity, last",
    [
        ("LaneChanger", "LaneWithContinuousSpeed", 6.0, "y", 3.5),
        ("Tracker", "Trajectory", 4.0, "speed", 12.0),
    ],
    ids=["a lane action is to the left", "a trajectory is a path with speeds"],
)
def test_smartss_actions(agent, action, until, quantity, last):
    options = f"options.agent=foreign_agents:{agent}&options.action={action}"
    found = drive(f"smarts_agent.py:SmartsAgent?{options}", until)
    assert getattr(found.ego, quantity)[-1] == pytest.approx(last, abs=0.1)


_IDM = (
    "nuplan.planning.simulation.planner.idm_planner:IDMPlanner&options.target_velocity=20.0"
    "&options.min_gap_to_lead_agent=1.0&options.headway_time=1.5&options.accel_max=1.0"
    "&options.decel_max=3.0&options.planned_trajectory_samples=16"
    "&options.planned_trajectory_sample_interval=0.5&options.occupancy_map_radius=100.0"
)


@pytest.mark.filterwarnings("default")  # of the packages' own
@pytest.mark.parametrize(
    "package, locator, seconds, speed",
    [
        ("nuplan", f"nuplan_planner.py:NuPlanPlanner?period=0.1&options.agent={_IDM}", 40.0, 10.0),
        (
            "agents",
            "carla_agent.py:CarlaAgent?options.agent=agents.navigation.basic_agent:BasicAgent",
            40.0,
            10.0,
        ),
        (
            "commonroad_rp",
            "commonroad_planner.py:CommonRoadPlanner?period=0.3"
            "&options.agent=commonroad_rp.reactive_planner:ReactivePlanner",
            2.0,
            20.0,
        ),
    ],
)
def test_a_planner_drives_as_its_own_package_has_it(package, locator, seconds, speed):
    pytest.importorskip(package)
    assert_last(drive(locator, seconds), 1.0, speed=speed)


@pytest.mark.parametrize(
    "name, method, adapter, page",
    rows_of("""
BasicAgent | run_step | carla_agent.py:CarlaAgent | CARLA
LeaderboardAgent | run_step | carla_agent.py:CarlaAgent | CARLA
Follower | act | smarts_agent.py:SmartsAgent | SMARTS
SimplePlanner | compute_planner_trajectory | nuplan_planner.py:NuPlanPlanner | nuPlan
LanePlanner | plan | commonroad_planner.py:CommonRoadPlanner | CommonRoad
"""),
)
def test_without_its_adapter_it_is_refused_by_a_sentence_that_names_it(name, method, adapter, page):
    with refusal() as refused:
        load_controller(f"foreign_agents:{name}")
    said = str(refused.value)
    assert f"It has `{method}`, as " in said
    assert (
        f"`{adapter}?options.agent=foreign_agents:{name}` with the files of "
        "docs/examples/adapters drives it" in said
    )
    assert "(docs/ads/other_simulators.md)" in said
    assert (
        f"\n## {page}\n" in (HERE.parents[1] / "docs" / "ads" / "other_simulators.md").read_text()
    )


def test_ads_with_a_property_named_as_another_tools_method_loads():
    class Planned:
        plan = property(lambda self: {}["no plan before the first case"])

        def act(self, observation):
            return 0.0

    assert load_controller(Planned()).is_policy


@pytest.mark.parametrize(
    "locator, sentence",
    [
        (
            "carla_agent.py:CarlaAgent?options.agent=foreign_agents:LanePlanner",
            "`agent` of carla_agent.py:CarlaAgent must be a class or an object with a method "
            "`run_step`, got "
            "LanePlanner. `commonroad_planner.py:CommonRoadPlanner` drives it.",
        ),
        (
            "smarts_agent.py:SmartsAgent",
            "smarts_agent.py:SmartsAgent needs the ADS that it drives: "
            "`smarts_agent.py:SmartsAgent?options.agent=my_agent.py:Agent`.",
        ),
        (
            "carla_agent.py:CarlaAgent?options.agent=foreign_agents:Photographer",
            "Sensor `Left` of Photographer must be one of sensor.speedometer",
        ),
        ("carla_agent.py:CarlaAgent?options.agent=nowhere:Agent", "there is no module `nowhere`"),
        (
            "smarts_agent.py:SmartsAgent?options.agent=foreign_agents:Follower&options.action=Continous",
            "Did you mean `Continuous`?",
        ),
        (
            "smarts_agent.py:SmartsAgent?options.agent=foreign_agents:Follower&options.steering=up",
            "`right` or `left`",
        ),
    ],
)
def test_what_an_adapter_cannot_drive_is_refused(locator, sentence):
    with refused(sentence):
        load_controller(locator)


@pytest.mark.parametrize(
    "locator, sentence",
    rows_of("""
carla:my.py:Agent
| `carla_agent.py:CarlaAgent?options.agent=my.py:Agent` with the files of docs/examples/adapters drives it
policy.onnx | `onnx:policy.onnx` drives it
Car.fmu | `fmu:Car.fmu` drives it
my_ads.py | `my_ads.py:NAME` names what it holds, `sumo-eval check my_ads.py` lists it
ppo.zip | weights alone do not drive; as ONNX they do (docs/ads/onnx.md)
python my_ads.py | `exec:python my_ads.py` runs it as a program
my/a.xosc | `sumo-eval import my/a.xosc` checks it
./my_ads | `exec:./my_ads` runs it as a program
ros2:my_stack | a node that `exec:` starts drives a ROS 2 stack (docs/ads/ros2.md)
grpc:localhost:50051 | a class with `act(observation)` that asks the server drives it
"""),
)
def test_a_wrong_locator_names_the_right_one(locator, sentence):
    with refusal() as refused:
        load_controller(locator)
    assert (
        f"ADS `{locator}` must be one that ships, or of the form `module:name` or `file.py:name`: "
        in str(refused.value)
    )
    assert sentence in str(refused.value)
