"""What an ADS may ask for in place of an acceleration: a plan and its tracker, a speed, pedals."""

import json
import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from road_scenes import HALF_SECOND, assert_as_alone, assert_last, case, clips_of, half_second, lead

from sumo_eval import Command, Plan
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.plans import Executor
from sumo_eval.settings import SimulationSettings, TrackerSettings

LONG = SimulationSettings(time_limit=12.0)


def once(make):
    """A policy that gives one plan, and then lets it hold."""

    class Once:
        def act(self, seen):
            return make(seen) if seen.time == 0.0 else None

    return Once


class ReadOnce(Command):
    """A Command that changes with every reading."""

    @property
    def acceleration(self):
        values = vars(self)
        values["readings"] = values.get("readings", 0) + 1
        return -1.0 * values["readings"]


def test_a_command_is_read_once_a_step():
    assert (
        Executor(LONG, print).command(ReadOnce(0.0), (0.0, 0.0, 0.0, 9.0), 0.0).acceleration == -1.0
    )


def _path():
    t = np.arange(0.0, 10.0, 0.25)
    u = np.clip((t - 1.0) / 4.0, 0.0, 1.0)
    return t, 3.5 * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)


def to_the_left(seen):
    """20 m/s, 3.5 m to the left within 4 s, after 1 s: a quintic, at rest across at both ends."""
    t, y = _path()
    return Plan(t, seen.ego.x + 20.0 * t, seen.ego.y + y)


def slower(seen):
    """20 m/s, then from 2 s on -2 m/s2 until 10 m/s: 40 m, and (400 - 100) / 4 = 75 m, at 7 s."""
    t = np.arange(0.0, 9.01, 0.5)
    v = np.clip(20.0 - 2.0 * (t - 2.0), 10.0, 20.0)
    x = np.where(
        t <= 2.0,
        20.0 * t,
        np.where(t <= 7.0, 40.0 + 20.0 * (t - 2.0) - (t - 2.0) ** 2, 115.0 + 10.0 * (t - 7.0)),
    )
    return Plan(t, seen.ego.x + x, np.zeros_like(t), speed=v)


def test_a_lane_change_is_tracked_within_two_centimetres_and_the_worst_error_is_on_record():
    found = simulate(case(), once(to_the_left), LONG)
    assert found.error is None
    assert_last(found, 1e-4, y=3.5)
    error = clips_of(found)["plan_error"]
    assert error.count == 240
    assert error.requested == 0.0
    assert 0.001 < error.applied < 0.02
    worst = max(
        abs(y - np.interp(t, *_path())) for t, y in zip(found.ego.time, found.ego.y, strict=True)
    )
    assert worst <= error.applied + 1e-9


def test_a_speed_profile_is_tracked_and_the_plans_end_is_on_record():
    found = simulate(case(), once(slower), LONG)
    at = dict(zip(found.ego.time.round(6).tolist(), found.ego.x.tolist(), strict=True))
    assert at[7.0] - 50.0 == pytest.approx(115.0, abs=0.05)
    assert_last(found, 0.01, speed=10.0)
    # the last point is at 9 s: the steps from 9.05 s to 11.95 s, 59 of them, are driven straight on
    assert clips_of(found)["plan_ended"].count == 59
    assert clips_of(found)["plan_ended"].requested == 9.0


def test_who_is_behind_the_plan_catches_up():
    ahead = once(lambda seen: Plan([0.0, 20.0], [seen.ego.x + 2.0, seen.ego.x + 402.0], [0.0, 0.0]))
    found = simulate(case(), ahead, LONG)
    assert clips_of(found)["plan_error"].applied == pytest.approx(2.0)
    assert_last(found, 0.01, x=50.0 + 2.0 + 240.0)


def test_a_plan_holds_until_it_is_replaced_and_any_other_answer_replaces_it():
    def act(seen):
        if seen.time == 0.0:
            return to_the_left(seen)
        return None if seen.time < 0.19 else -2.0

    found = half_second(act)
    assert clips_of(found)["plan_error"].count == 4
    assert found.ego.acceleration[-1] == -2.0


@pytest.mark.parametrize("other", [-2.0, Command(-2.0)])
def test_a_plan_that_was_replaced_does_not_come_back(other):
    def act(seen):
        if seen.time == 0.0:
            return to_the_left(seen)
        return other if seen.time < 0.06 else None

    assert "got None" in half_second(act).error


def test_nothing_to_hold_is_an_error():
    assert "must be a Command" in half_second(lambda seen: None).error


def test_alone_and_beside_others_a_plan_is_driven_to_the_same_bits():
    cases = [case(lead(gap)) for gap in (150.0, 170.0, 200.0)]
    ads = once(to_the_left)
    together = list(simulate_many(cases, ads, LONG))
    assert [one.error for one in together] == [None] * 3
    assert_as_alone(cases, together, ads, LONG)


@pytest.mark.parametrize(
    "plan, sentence",
    [
        (
            Plan([0.0, 1.0], [0.0, math.nan], [0.0, 0.0]),
            "`x` of the ADS's Plan must be a finite number, got nan",
        ),
        (
            Plan([0.0, 1.0], [0.0, True], [0.0, 0.0]),
            "`x` of the ADS's Plan must be a finite number, got True",
        ),
        (
            Plan([0.0, 1.0], [0.0, 10**400], [0.0, 0.0]),
            "`x` of the ADS's Plan must be a finite number",
        ),
        (
            Plan([0.0, 1.0, 2.0], [1e308, -1e308, 0.0], [0.0, 0.0, 0.0]),
            "`x` of the ADS's Plan must be within -1e+09..1e+09, got 1e+308",
        ),
        pytest.param(
            Plan([0.0, 5e-324], [0.0, 1.0], [0.0, 0.0]),
            "`acceleration` of the ADS's Plan must be a finite number, got nan",
            marks=pytest.mark.filterwarnings("ignore:overflow"),
        ),
        (
            Plan([1.0, 1.0], [0.0, 1.0], [0.0, 0.0]),
            "`time` of the ADS's Plan must increase, got 1 s behind 1 s",
        ),
        (
            Plan([0.0, 1.0], [0.0], [0.0, 0.0]),
            "`x` of the ADS's Plan must have as many values as `time`, 2, got 1",
        ),
        (Plan([], [], []), "`time` of the ADS's Plan must be a sequence of numbers, got []"),
        (Plan(0.0, 1.0, 2.0), "`time` of the ADS's Plan must be a sequence of numbers, got 0.0"),
        (
            Plan([0.0], [1.0], [0.0], speed=["fast"]),
            "`speed` of the ADS's Plan must be a finite number, got 'fast'",
        ),
        (Command(speed=math.inf), "`speed` of the ADS's Command must be a finite number, got inf"),
        (Command.pedals(1.2), "`throttle` of the ADS's pedals must be within 0..1, got 1.2"),
        (Command.pedals(steer=-1.5), "`steer` of the ADS's pedals must be within -1..1, got -1.5"),
        (
            Command.pedals(brake="hard"),
            "`brake` of the ADS's pedals must be a finite number, got 'hard'",
        ),
    ],
)
def test_a_meaningless_value_fails_its_case_alone(plan, sentence):
    wrong = lambda seen: plan if seen.lead.gap < 101.0 else 0.0  # noqa: E731
    found = list(simulate_many([case(lead(100.0)), case(lead(300.0))], wrong, HALF_SECOND))
    error = found[0].error
    assert found[0].end_reason == "ads_error"
    assert error.startswith(sentence)
    assert error.endswith("at 0.00 s.")
    assert found[1].error is None
    hook = half_second(lambda traci, ego, time: plan, lead(100.0))
    assert hook.error == error


def test_a_wanted_speed_is_taken_up_by_the_stated_first_order_law():
    # dv/dt = (19 - 20) / 2 s at first, each step of 0.05 s takes 2.5 % of what is left
    slow = replace(LONG, tracker=TrackerSettings(speed_time=2.0))
    found = simulate(case(), lambda seen: Command(speed=19.0), slow)
    assert found.ego.acceleration[1:4].max() < 0.0
    assert_last(found, 0.01, speed=19.0)
    left = found.ego.speed[21:41:10] - 19.0
    assert left[1] / left[0] == pytest.approx(0.975**20, rel=1e-4)  # the brakes let go at 60 m/s3
    backwards = lambda seen: Plan([0.0, 9.0], [50.0, 60.0], [0.0, 0.0], speed=[-5.0, -5.0])  # noqa: E731
    for ads in (backwards, lambda seen: Command(speed=-5.0)):
        found = half_second(ads)
        clip = clips_of(found)["negative_speed"]
        assert (clip.requested, clip.applied) == (-5.0, 0.0)


def test_pedals_are_shares_of_what_the_vehicle_can_do():
    # brake 0.5 of 9 m/s2; steer -0.01 of 540 deg
    found = half_second(lambda seen: Command.pedals(0.0, 0.5, -0.01))
    assert_last(found, acceleration=-4.5, steering_wheel_angle=math.radians(-5.4))
    assert_last(half_second(lambda seen: Command.pedals(0.25)), acceleration=1.0)


def test_a_command_takes_an_acceleration_or_a_speed():
    for wrong in ({}, {"acceleration": 1.0, "speed": 2.0}):
        with pytest.raises(TypeError):
            Command(**wrong)
    assert replace(Command(speed=2.0), steering=0.5) == Command(steering=0.5, speed=2.0)


@pytest.mark.parametrize(
    "answer, python",
    [
        ({"speed": 15.0}, lambda seen: Command(speed=15.0)),
        ({"throttle": 0.1, "steer": 0.01}, lambda seen: Command.pedals(0.1, 0.0, 0.01)),
        (
            {"plan": {"time": [0, 9], "x": [50, 200], "y": [0, 1]}},
            lambda seen: Plan(range(0, 10, 9), deque([50, 200]), (0, 1)),
        ),
    ],
)
def test_a_program_may_answer_so_too(answer, python):
    line = json.dumps(answer).replace('"', '\\"')
    text = f'exec:sh -c \'read x; echo "{{}}"; while read x; do echo "{line}"; done\''
    found = half_second(text, step_timeout=5.0)
    assert found.error is None
    expected = half_second(python)
    for channel in ("speed", "y"):
        assert getattr(found.ego, channel).tolist() == getattr(expected.ego, channel).tolist()
