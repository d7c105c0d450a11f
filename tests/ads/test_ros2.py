"""docs/examples/ros2_node.py with a stack behind it, without ROS: a stand-in carries the same
messages."""

import sys
from pathlib import Path

import numpy as np
from ads_cases import EXAMPLES, SLOWER
from road_scenes import assert_last, clips_of

from sumo_eval.cosim import simulate
from sumo_eval.settings import SimulationSettings

STAND_IN = Path(__file__).parent / "ros_stand_in"


def drive(seconds, *variables, option=""):
    environment = " ".join((f"PYTHONPATH={STAND_IN}", "STACK=stack", *variables))
    locator = f"exec:env {environment} {sys.executable} ros2_node.py {option}"
    found = simulate(
        SLOWER, locator, SimulationSettings(time_limit=seconds), folder=EXAMPLES, step_timeout=20.0
    )
    assert found.error is None, found.log
    return found


def test_a_stack_drives_by_controls_in_lockstep():
    """The stack is the ten-line ACC, kept from accelerating; its controls of an earlier stamp do
    not count."""
    stack = drive(8.0)

    def acc(seen):
        gap, speed = seen.lead.gap, seen.lead.speed
        wanted = 0.15 * (gap - 3.0 - 1.5 * seen.ego.speed) + 0.9 * (speed - seen.ego.speed)
        return max(-6.0, min(0.0, wanted))

    here = simulate(SLOWER, acc, SimulationSettings(time_limit=8.0))
    assert here.ego.speed[-1] < 12.0
    np.testing.assert_allclose(stack.ego.speed, here.ego.speed, atol=1e-6)


def test_a_control_may_be_a_speed():
    assert_last(drive(6.0, option="--follow speed"), 0.2, speed=10.0)


def test_a_path_is_a_plan():
    """1 m/s slower at every step's plan: the tracker follows within its error, straight on."""
    found = drive(2.0, "STACK_PLANS=1")
    assert found.ego.speed[-1] < 19.0
    assert float(np.abs(found.ego.y).max()) < 1e-6
    assert "plan_error" in clips_of(found)
