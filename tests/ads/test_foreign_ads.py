"""ADSs that nobody here wrote, as docs/foreign.md brings them in.

What is not installed is skipped: the wrappers of MetaDrive's expert and FLOW's controllers are also
held against published formulas, without their packages.
"""

import math
import os
import sys
from importlib.util import find_spec
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from ads_cases import CUT_OUT, EXAMPLES, SLOWER
from road_scenes import assert_last, clear_drive, clips_of

from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.scenario import Road
from sumo_eval.scenario.touch import Body
from sumo_eval.settings import SimulationSettings

ROAD = Road("road", 1000.0, 2, 3.5, 60.0)


def drive(locator, concrete=CUT_OUT, seconds=20.0):
    settings = SimulationSettings(time_limit=seconds)
    return clear_drive(concrete, locator, settings, folder=EXAMPLES, step_timeout=60.0)


def seen(*others, speed=20.0, x=100.0):
    ego = (*Body(x, 0.0, 0.0, speed, 4.5, 1.8), 0.0)
    look = ego, [(*body, 0.0) for body in others]
    return Observation(0.0, ROAD, ego, look, None, ["car"] * len(others))


@pytest.fixture
def expert(monkeypatch, tmp_path):
    """MetaDrive's wrapper around a network whose weights are all 0."""
    monkeypatch.syspath_prepend(EXAMPLES)
    import metadrive_expert

    sizes = {"fc_1": (275, 8), "fc_2": (8, 8), "fc_out": (8, 4)}
    weights = {f"default_policy/{name}/kernel": np.zeros(shape) for name, shape in sizes.items()}
    weights |= {f"default_policy/{name}/bias": np.zeros(shape[1]) for name, shape in sizes.items()}
    weights["default_policy/fc_out/bias"] = np.array([0.5, -0.1, 0.0, 0.0])
    np.savez(tmp_path / "weights.npz", **weights)
    made = metadrive_expert.Expert(str(tmp_path / "weights.npz"))
    made.reset(SimpleNamespace(vehicle=SimpleNamespace(steering_ratio=15.0)))
    yield made
    sys.modules.pop("metadrive_expert")


def test_metadrives_expert_is_shown_what_metadrive_shows(expert):
    """State 9, two checkpoints of 5, four vehicles of 4, 240 rays: 275 numbers in 0..1."""
    shown = expert.observed(seen(Body(130.0, 0.0, 0.0, 10.0, 4.5, 1.8)))
    assert shown.shape == (275,)
    assert 0.0 <= shown.min() <= shown.max() <= 1.0
    # 5.25 m to the left edge and 1.75 m to the right one of 4 lanes of 4.5 m; straight; 73 of 81
    # km/h; no pedals yet
    assert shown[:9] == pytest.approx([5.25 / 18, 1.75 / 18, 0.5, 73 / 81, 0.5, 0.5, 0.5, 0.0, 0.5])
    # the road's end, 900 m ahead, cropped to 50 m; its middle, 1.75 m to the left, which counts
    # downwards; no bend
    assert shown[9:14] == pytest.approx([1.0, 0.5 - 0.5 * 1.75 / 900, 0.0, 0.5, 0.5], abs=1e-5)
    # 30 m ahead of 50, 10 m/s slower of 80 km/h
    assert shown[19:23] == pytest.approx([0.8, 0.5, 0.5 - 0.5 * 36 / 80, 0.5])
    assert shown[23:35].tolist() == [0.0] * 12
    rays = shown[35:]
    assert rays[0] == pytest.approx((30.0 - 2.25) / 50.0)  # its rear
    # 0.9 m aside at 27.75 m: 1.86 degrees, and a ray every 1.5 degrees
    assert (rays < 1.0).sum() == 3
    assert rays[1] == rays[-1] == pytest.approx(27.75 / 50.0 / math.cos(math.radians(1.5)))


def test_metadrives_pedals_are_its_default_vehicles(expert):
    """-0.1 of the brakes of 4 x 7500 N on 1100 kg: -2.73 m/s2; half of 40 degrees to the left at
    the wheels."""
    acceleration, steering = expert.act(seen())
    assert acceleration == pytest.approx(-0.1 * 4 * 7500.0 / 1100.0, abs=5e-3)
    assert steering == pytest.approx(15.0 * math.radians(20.0))


@pytest.mark.skipif(
    find_spec("metadrive") is None, reason="metadrive-simulator, with the weights, is not installed"
)
def test_metadrives_expert_follows_a_slower_vehicle_near_its_lane():
    found = drive("metadrive_expert.py:Expert", SLOWER)
    assert_last(found, 0.5, speed=5.0)
    assert np.abs(found.ego.y).max() < 1.2


@pytest.fixture
def flow(monkeypatch):
    """FLOW, or where it is not on the path a module with one controller that asks as FLOW's do."""
    if find_spec("flow") is not None and find_spec("flow.controllers") is not None:
        return

    class IDMController:
        """IDM (Treiber, Hennecke, Helbing 2000) with FLOW's constants: T 1, a 1, b 1.5, delta 4, s0
        2."""

        def __init__(self, veh_id, v0=30.0, *, car_following_params):
            self.me, self.v0 = veh_id, v0
            assert car_following_params.controller_params["accel"] > 0.0

        def get_action(self, env):
            vehicles = env.k.vehicle
            v, lead, gap = (
                vehicles.get_speed(self.me),
                vehicles.get_leader(self.me),
                vehicles.get_headway(self.me),
            )
            wanted = 0.0
            if lead:
                wanted = 2.0 + max(
                    0.0, v + v * (v - vehicles.get_speed(lead)) / (2.0 * math.sqrt(1.5))
                )
            return float(1.0 - (v / self.v0) ** 4 - (wanted / gap) ** 2)

    package, controllers = ModuleType("flow"), ModuleType("flow.controllers")
    controllers.IDMController = IDMController
    package.controllers = controllers
    monkeypatch.setitem(sys.modules, "flow", package)
    monkeypatch.setitem(sys.modules, "flow.controllers", controllers)


def test_a_controller_of_flow_sees_its_environment(flow):
    """20 m/s, wanted 20, 45.5 m behind 10 m/s: 1 - 1 - ((2 + 20 + 20 x 10/(2 sqrt 1.5))/45.5)^2 =
    -5.27 m/s2."""
    found = drive("flow_drivers.py:Driver")
    assert_last(found, 0.7, speed=10.0)
    assert np.abs(found.ego.y).max() == 0.0
    from sumo_eval.cosim.doors.controller import load_controller

    driver = load_controller("flow_drivers.py:Driver", EXAMPLES).target
    driver.reset(SimpleNamespace(desired_speed=20.0, step=0.05, speed_limit=60.0))
    wanted = 2.0 + 20.0 + 20.0 * 10.0 / (2.0 * math.sqrt(1.5))
    answer = driver.act(seen(Body(150.0, 0.0, 0.0, 10.0, 4.5, 1.8)))
    assert answer == pytest.approx(-((wanted / 45.5) ** 2))


@pytest.mark.skipif(
    find_spec("acados") is None or "OPENPILOT" not in os.environ,
    reason="comma-deps-acados or a checkout of openpilot, named by OPENPILOT, is not here",
)
@pytest.mark.filterwarnings("default")  # of acados
def test_openpilots_longitudinal_mpc_follows_gently():
    """Its own limit is -3.5 m/s2."""
    found = drive(
        f"openpilot_long.py:Longitudinal?options.source={os.environ['OPENPILOT']}", seconds=30.0
    )
    assert_last(found, 0.5, speed=10.0)
    assert found.ego.acceleration.min() > -3.6
    assert not found.clips


@pytest.mark.skipif(
    "REACTIVE_PLANNER" not in os.environ,
    reason="no Python with commonroad-reactive-planner, named by REACTIVE_PLANNER",
)
def test_the_reactive_planner_passes_by_in_an_environment_of_its_own():
    found = drive(f"exec:{os.environ['REACTIVE_PLANNER']} reactive_planner.py", seconds=6.0)
    assert clips_of(found)["plan_error"].applied < 0.5
