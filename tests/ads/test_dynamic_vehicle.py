"""Shipped ADSs at the wheel of the dynamic vehicle model: where little is asked of tyres, as with
the kinematic one."""

import math

import numpy as np
import pytest
from road_scenes import at_values
from tables import values_of

from sumo_eval import Command, Plan
from sumo_eval.cosim import simulate_many
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.scenario import catalogue
from sumo_eval.settings import SimulationSettings, VehicleSettings

CURVE = at_values("curve_following", ego_speed=26.0, lead_speed=20.0)


def driven(cases, ads, model):
    return list(simulate_many(cases, ads, SimulationSettings(vehicle=VehicleSettings(model=model))))


def apart(one, other):
    """The largest distances along and across the road of two drives, m, at the samples of the
    shorter one."""
    time = one.time[one.time <= other.time[-1]]
    pairs = ((one.x, other.x), (one.y, other.y))
    return [
        float(np.abs(np.interp(time, other.time, there) - here[: len(time)]).max())
        for here, there in pairs
    ]


@pytest.mark.parametrize("ads", SHIPPED)
def test_a_lane_change_that_everybody_has_to_make_is_the_same_by_both_vehicle_models_within_a_hands_breadth(
    ads,
):
    # 0.06 and 0.15 g across; measured: 0.015 m along, 0.175 and 0.293 m across
    logical = catalogue.load("lane_drop")
    cases = [
        logical.concrete(ego_speed=speed, other_speed=24.0, offset=offset, other_acceleration=rate)
        for speed, offset, rate in ((20.0, 60.0, 0.0), (32.0, -60.0, -2.0))
    ]
    for one, other, across in zip(
        driven(cases, ads, "kinematic"), driven(cases, ads, "dynamic"), (0.2, 0.3), strict=True
    ):
        assert one.end_reason == other.end_reason == "road_end"
        along, beside = apart(one.ego, other.ego)
        assert along < 0.02
        assert 0.1 < beside < across
        assert not any(clip.what == "beyond_kinematic" for clip in one.clips)


@pytest.mark.parametrize(
    "ads, along, across",
    values_of("""
    "idm", 0.5, 0.5
    "fsm", 0.2, 0.8
    "no_reaction", 1.2, 0.8
    "lane_changer", 1.7, 0.9
    """),
)
def test_on_a_curve_at_0_28_g_the_models_differ_by_the_slip(ads, along, across):
    # R = 250 m, 26 m/s: the rear axle slips 0.275 g / (20.9 * 0.92 / rad) = 0.0143 rad
    one, other = (driven([CURVE], ads, model)[0] for model in ("kinematic", "dynamic"))
    assert one.end_reason == other.end_reason
    found = apart(one.ego, other.ego)
    assert found[0] < along
    assert 0.2 < found[1] < across


class Swerves:
    """0.2 rad at the steering wheel at 30 m/s: 900 tan(0.2 / 16) / 2.7 = 4.17 m/s2 or 0.42 g
    across."""

    def act(self, seen):
        return Command(0.0, 0.2)


def test_above_four_tenths_of_g_across_the_kinematic_model_says_in_its_case_that_it_is_beyond_itself():
    concrete = at_values("front_vehicle_low_speed", ego_speed=30.0, lead_speed=20.0)
    for model, says in (("kinematic", True), ("dynamic", False)):
        recording = driven([concrete], Swerves, model)[0]
        assert recording.end_reason == "off_road"
        assert any(clip.what == "beyond_kinematic" for clip in recording.clips) is says


@pytest.mark.parametrize("model", ["kinematic", "dynamic"])
@pytest.mark.parametrize("begin", [0.0, 2.0])
def test_held_wheel_keeps_an_ego_on_its_curve(begin, model):
    # `begin`: until then SUMO moves it
    wheel = 16.0 * math.atan(2.7 / 250.0)
    hook = lambda traci, ego, time: None if time < begin else Command(0.0, wheel)  # noqa: E731
    (recording,) = driven([CURVE], hook, model)
    assert recording.ego.time[-1] > 5.0
    assert np.ptp(recording.ego.y) < 0.02


def test_plan_of_a_hook_begins_in_a_curve_as_a_policys():
    plan = Plan([0.0, 4.0], [CURVE.ego.x, CURVE.ego.x + 104.0], [0.0, 0.0])
    policy, hook = (
        driven([CURVE], ads, "kinematic")[0].ego
        for ads in (lambda seen: plan, lambda traci, ego, time: plan)
    )
    assert hook.y == pytest.approx(policy.y, abs=1e-9)
