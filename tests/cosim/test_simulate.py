"""One case through SUMO: why it ends, what an ADS may and may not do, and what is recorded."""

import json
import math
import sys
import time as clock
from dataclasses import replace

import libsumo
import numpy as np
import pytest
from commands import python
from laid import lay
from refusals import refused
from road_scenes import (
    ROAD,
    assert_ended,
    assert_last,
    case,
    clear_drive,
    clips_of,
    every_point,
    half_second,
    lead,
    once,
)
from tables import rows_of, values_of

import sumo_eval.cosim.sumo.session as session_module
from sumo_eval.cosim import Command, simulate, simulate_many
from sumo_eval.cosim.doors.controller import NativeModel, load_controller
from sumo_eval.errors import InputError
from sumo_eval.scenario import (
    Actor,
    EgoBody,
    Start,
    brake_to_stop,
    catalogue,
    constant_lateral,
    lane_change,
    motion,
)
from sumo_eval.scenario.touch import Body, widest_gap
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Collision

CUT_OUT = catalogue.load("front_vehicle_cut_out")


def nothing(traci, ego, time):
    """Keeps the speed it has."""


def brake(traci, ego, time):
    return Command(-9.0)


# --- why a case ends ------------------------------------------------------------------------------


def test_it_ends_in_contact_at_the_very_instant():
    # 20 m/s, 31.4 m to a standing car: 1.57 s, between two steps of 0.05 s
    found = simulate(case(lead(gap=31.4)), nothing)
    assert_ended(found, "contact")
    poses = (pytest.approx(81.4), 0.0, 0.0), (pytest.approx(85.9), 0.0, 0.0)
    assert found.collision == Collision(
        pytest.approx(1.57), "lead", (20.0, 0.0), (0.0, 0.0), 1.0, "front", *poses
    )
    assert found.ego.time[-1] == found.simulated_time == pytest.approx(1.57)
    assert_last(found, x=81.4)


def test_it_ends_at_a_standstill_of_two_seconds():
    found = clear_drive(case(), brake)
    assert found.end_reason == "standstill"
    # below 0.1 m/s after 0.075 + 19.9/9 = 2.286 s: the first such step ends at 2.30 s, the 40th (2
    # s) at 4.25 s
    assert found.simulated_time == pytest.approx(4.25)


@pytest.mark.parametrize(
    "concrete, limit, reason, time",
    [
        (case(x=590.0), 150.0, "road_end", 0.5),
        (case(), 1.23, "time_limit", 1.25),
        (replace(case(), time_limit=1.0), 150.0, "time_limit", 1.0),
    ],
    ids=["end of the road", "time limit of the settings", "time limit of the scenario"],
)
def test_it_ends_at(concrete, limit, reason, time):
    found = simulate(concrete, nothing, SimulationSettings(time_limit=limit))
    assert found.end_reason == reason
    assert found.simulated_time == pytest.approx(time)


@pytest.mark.parametrize("beyond", [-0.9, -0.4, -0.01, 0.01, 0.1, 0.4, 0.9])
@pytest.mark.parametrize("step", [0.05, 0.005])
def test_nothing_touches_the_ego_after_the_end_of_the_road_within_a_step_either(step, beyond):
    """At 20 m/s a step of 0.05 s is 1 m; this one ends at 600.5 m."""
    found = simulate(
        case(lead(gap=10.5 + beyond, x=589.5), x=589.5), nothing, SimulationSettings(step=step)
    )
    assert found.end_reason == ("contact" if beyond < 0.0 else "road_end")
    assert (found.collision is None) == (beyond > 0.0)


@pytest.mark.parametrize("steering, edge", [(0.5, 5.25), (-0.5, -1.75)])
def test_it_ends_off_the_road_when_the_centre_leaves_it(steering, edge):
    found = simulate(case(), lambda *_: Command(0.0, steering))
    assert found.end_reason == "off_road"
    assert abs(found.ego.y[-1]) > abs(edge)
    assert abs(found.ego.y[-2]) <= abs(edge)


def test_it_ends_in_an_ads_timeout():
    found = simulate(case(), lambda *_: clock.sleep(0.02), step_timeout=0.01)
    assert found.end_reason == "ads_timeout"
    # no digit of the clock's
    assert found.error == "The ADS must answer within 0.01 s, took longer at 0.00 s."
    assert found.controller_latency[1] >= 0.02


def test_a_slow_reset_is_not_a_slow_step():
    class Slow:
        def reset(self, scenario, traci, ego):
            clock.sleep(0.5)

        def step(self, traci, ego, time):
            return None

    found = half_second(Slow(), step_timeout=0.45)
    assert found.end_reason == "time_limit"
    assert found.controller_latency[1] < 0.45


def test_it_ends_in_a_sim_error_when_sumo_refuses_the_start():
    found = simulate(case(speed=70.0), nothing)  # above the ego's top speed of 60 m/s
    assert_ended(found, "sim_error", "Departure speed for vehicle 'ego' is too high")
    assert found.ego.speed[0] == 70.0  # what was asked for is kept


@pytest.mark.parametrize("dx, dy", [(0.1, 0.0), (0.0, 0.1)])
def test_it_ends_in_a_sim_error_when_sumo_shows_the_ego_elsewhere(monkeypatch, dx, dy):
    calls = session_module.vehicles(libsumo)
    place = calls.moveToXY
    askew = lambda name, edge, lane, x, y, angle, keep: place(  # noqa: E731
        name, edge, lane, x + dx, y + dy, angle, keep
    )
    monkeypatch.setattr(calls, "moveToXY", askew)
    found = simulate(case(), lambda *_: Command(0.0))
    assert_ended(found, "sim_error", "SUMO put the ego's front bumper at")


def test_of_two_bodies_hit_in_one_step_the_first_one_counts():
    # 31.4 m and 31.2 m at 20 m/s: 1.57 s and 1.56 s, both between 1.55 s and 1.60 s
    found = simulate(case(lead(gap=31.4), replace(lead(gap=31.2), name="nearer")), nothing)
    assert found.collision.other == "nearer"
    assert found.collision.time == pytest.approx(1.56)


def test_a_foreign_simulation_in_the_process_is_a_sim_error():
    from sumo_eval.cosim.sumo.session import session

    with session(case(), SimulationSettings()) as traci:
        assert simulate(case(), nothing).end_reason == "sim_error"
        assert traci.simulation.isLoaded()


# --- the controller door --------------------------------------------------------------------------


class Counting:
    """A full controller."""

    def __init__(self):
        self.calls = []

    def reset(self, scenario, traci, ego):
        running = traci.vehicle.getSpeed(ego) == libsumo.vehicle.getSpeed(ego)
        self.calls.append(("reset", scenario.scenario, scenario.road, scenario.step, ego, running))

    def step(self, traci, ego, time):
        self.calls.append(("step", ego, time))
        return Command(0.0)

    def close(self):
        self.calls.append(("close",))


def test_answers_for_every_name_do_not_hide_a_step():
    class Answers:
        def __getattr__(self, name):
            return print if name == "act" else None

        def step(self, traci, ego, time):
            return Command(-2.0)

    recording = half_second(Answers)
    assert recording.error is None
    assert recording.ego.speed[-1] < recording.ego.speed[0]


class StepOf:
    """Called itself: its `step` is a number, s."""

    step = 0.05

    def __call__(self, traci, ego, time):
        return Command(-2.0 * self.step)


class Switches:
    """Its first answer changes what is called next."""

    def act(self, seen):
        self.act = lambda seen: -2.0
        return 0.0


@pytest.mark.parametrize("ads, speed", [(StepOf, 19.95), (Switches, 19.1)])
def test_an_object_is_called_by_what_it_has_at_the_step(ads, speed):
    recording = half_second(ads())
    assert recording.error is None
    assert recording.ego.speed[-1] == pytest.approx(speed, abs=0.05)


def test_an_object_is_reset_stepped_and_closed_in_this_order():
    ads = Counting()
    assert simulate(case(), ads, SimulationSettings(time_limit=0.1)).error is None
    assert ads.calls == [
        ("reset", "", replace(ROAD, name="road"), 0.05, "ego", True),
        ("step", "ego", 0.0), ("step", "ego", 0.05), ("close",),
    ]  # fmt: skip


def test_a_module_and_name(tmp_path, monkeypatch):
    (tmp_path / "an_ads_package_for_tests.py").write_text(
        "def drive(traci, ego, time):\n    traci.vehicle.setSpeed(ego, 5.0)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    found = half_second("an_ads_package_for_tests:drive")
    assert_last(found, speed=15.5)


def test_a_file_and_name_relative_to_a_folder_with_its_neighbours(tmp_path, own_path):
    (tmp_path / "neighbour_of_my_ads.py").write_text("SPEED = 15.5\n")
    (tmp_path / "my_ads.py").write_text(
        "from neighbour_of_my_ads import SPEED\n"
        "class MyAds:\n"
        "    def step(self, traci, ego, time):\n"
        "        traci.vehicle.setSpeed(ego, SPEED)\n"
    )
    found = half_second("my_ads.py:MyAds", folder=tmp_path)
    assert_last(found, speed=15.5)


@pytest.mark.parametrize(
    "locator, sentence",
    [
        *rows_of("""
ideal_brakin | Did you mean `ideal_braking`?
idn | Did you mean `idm`?
sumo:IDN | Unknown SUMO car-following model `IDN`. Did you mean `IDM`?
no_such_module_of_mine:Ads | there is no module `no_such_module_of_mine`
no_such_file.py:Ads | There is no file
math:squrt | `math` has no `squrt`. Did you mean `sqrt`?
math:pi
| must be a function (traci, ego, time), a class or an object with a `step` method, got float
needs.py:make | a class or an object with a `step` method, got function (gain=2).
needs.py:drive | a class or an object with a `step` method, got function (traci, ego).
leaves.py:Ads | SystemExit
raises.py:Ads | RuntimeError: not today
needs.py:Ads | making one without arguments failed: TypeError
quits.py:Ads | making one without arguments failed: SystemExit: 2
"""),
        *(
            (f"lazy.py:{it}", f"`lazy.py:{it}` cannot be loaded: RuntimeError: no weights.")
            for it in ("Act", "Batch", "Typed", "Meta")
        ),
        *(
            (f"late.py:{it}", f"`{it.lower()}` of ADS `late.py:{it}` must not be `async`")
            for it in ("Reset", "Act", "Step", "Close")
        ),
        ("late.py:drive", "`drive` of ADS `late.py:drive` must not be `async`"),
        ("late.py:Call", "`__call__` of ADS `late.py:Call` must not be `async`"),
    ],
)
def test_what_cannot_be_a_controller_is_refused_before_a_run(tmp_path, own_path, locator, sentence):
    files = {
        "leaves.py": "import sys\nsys.exit(3)\n",
        "raises.py": "raise RuntimeError('not today')\n",
        "needs.py": "class Ads:\n    def __init__(self, map_file): pass\n    step = None\n"
        "def make(gain=2): pass\ndef drive(traci, ego): pass\n",
        "quits.py": "class Ads:\n    def __init__(self): raise SystemExit(2)\n",
        "lazy.py": "class Act:\n    @property\n    def act(self): raise RuntimeError('no weights')\n"
        "class Batch:\n    act, batch = None, Act.act\n"
        "class Typed:\n    step, vehicle_type = print, Act.act\n"
        "class Kind(type):\n    def __getattr__(cls, name): raise RuntimeError('no weights')\n"
        "class Meta(metaclass=Kind):\n    def act(self, seen): return 0.0\n",
        "late.py": "class Reset:\n    async def reset(self, briefing): pass\n"
        "    def act(self, seen): return 0.0\n"
        "class Close(Reset):\n    reset, close = None, Reset.reset\n"
        "class Act:\n    act = Reset.reset\n"
        "class Step:\n    step = Reset.reset\n"
        "class Call:\n    __call__ = Reset.reset\n"
        "async def drive(seen): pass\n",
    }
    lay(tmp_path, files)
    with refused(sentence):
        simulate(case(), locator, folder=tmp_path)
    with refused(sentence):
        list(simulate_many([case()], locator, folder=tmp_path))


def test_the_same_file_has_the_same_module_name_in_every_process(tmp_path, own_path):
    (tmp_path / "my_ads.py").write_text("def drive(traci, ego, time):\n    pass\n")
    code = (
        "import sys; from pathlib import Path; from sumo_eval.cosim.doors.controller import "
        "find_controller\n"
        f"print(find_controller('my_ads.py:drive', Path({str(tmp_path)!r})).__module__)"
    )
    names = {python(code, env={"PYTHONHASHSEED": seed}).stdout for seed in ("1", "2")}
    assert len(names) == 1


@pytest.mark.parametrize("answer", [-3.0, (-3.0, 0.0), True])
def test_an_answer_that_is_not_a_command_is_the_adss_error(answer):
    found = simulate(case(), lambda traci, ego, time: answer if time > 0.21 else Command(0.0))
    sentence = "must return a Command, Pedals, a Plan or None, got "
    assert_ended(found, "ads_error", sentence + type(answer).__name__)
    assert "at 0.25 s" in found.error
    # what was driven until then is kept, to the instant
    assert_last(found, time=0.25)


class Faulty:
    """Raises in one of its methods."""

    def __init__(self, where, error):
        self.where, self.error, self.closed = where, error, 0

    def _maybe(self, where):
        if where == self.where:
            raise self.error

    def reset(self, scenario, traci, ego):
        self._maybe("reset")

    def step(self, traci, ego, time):
        self._maybe("step")

    def close(self):
        self.closed += 1
        self._maybe("close")


@pytest.mark.parametrize(
    "error", [RuntimeError("boom."), SystemExit(3), InputError("mine"), libsumo.TraCIException("x")]
)
@pytest.mark.parametrize("where", ["reset", "step", "close"])
def test_an_ads_that_raises_ends_its_case_only(where, error):
    ads = Faulty(where, error)
    found = half_second(ads)
    assert_ended(found, "ads_error", type(error).__name__)
    assert ".." not in found.error
    assert type(error).__name__ in found.log
    assert "test_simulate.py" in found.log  # the traceback, for whoever wrote it
    assert ads.closed == 1
    assert not libsumo.simulation.isLoaded()
    assert_last(found, time=0.5 if where == "close" else 0.0)


def test_a_collision_is_kept_when_the_ads_then_raises_in_close():
    found = simulate(case(lead(gap=5.0)), Faulty("close", RuntimeError("late")))
    assert found.end_reason == "contact"
    assert found.collision.other == "lead"
    assert found.error == "The ADS raised in close: RuntimeError: late."


@pytest.mark.parametrize("where", ["reset", "step", "close"])
def test_a_keyboard_interrupt_passes_and_leaves_nothing_running(where):
    ads = Faulty(where, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        half_second(ads)
    assert ads.closed == 1
    assert not libsumo.simulation.isLoaded()


# --- what is SUMO's and the harness's -------------------------------------------------------------


@pytest.mark.parametrize(
    "action, sentence",
    [
        (lambda traci: traci.close(), "The ADS closed the simulation at 0.30 s"),
        (
            lambda traci: traci.simulationStep(),
            "The ADS moved SUMO's clock by +0.05 s at 0.30 s",
        ),
        (lambda traci: traci.simulationStep(7.0), "The ADS moved SUMO's clock by"),
        (
            lambda traci: traci.vehicle.remove("ego"),
            "SUMO cannot move the ego: TraCIException: Vehicle 'ego' is not known",
        ),
        (
            lambda traci: traci.vehicle.setSpeed("nobody", 1.0),
            "TraCIException: Vehicle 'nobody' is not known",
        ),
    ],
)
@pytest.mark.parametrize("answer", [None, Command(0.0)])
def test_an_ads_that_takes_over_the_simulation_is_stopped_and_the_next_case_works(
    action, sentence, answer
):
    def ads(traci, ego, time):
        once(action)(traci, ego, time)
        return answer

    found = simulate(case(lead(gap=50.0)), ads)
    assert_ended(found, "ads_error", sentence)
    assert_last(found, time=0.3)
    assert not libsumo.simulation.isLoaded()
    assert half_second(nothing).end_reason == "time_limit"


def test_last_sample_of_a_discarded_step_is_of_one_instant():
    def ads(traci, ego, time):
        if time < 0.149:
            return Command(0.0)
        traci.vehicle.remove(ego)
        return Command(-5.0, 1.0)

    found = simulate(case(lead(50.0, 10.0, 0.0, brake_to_stop(0.16, 4.0))), ads)
    assert_last(found, time=0.15, x=53.0, speed=20.0, acceleration=0.0, steering_wheel_angle=0.0)
    last = found.actors["lead"]
    assert (last.time[-1], last.speed[-1], last.acceleration[-1]) == (found.ego.time[-1], 10.0, 0.0)


@pytest.mark.parametrize("value", [1e308, -1e308])
def test_two_finite_numbers_are_a_command_though_their_sum_is_not(value):
    assert half_second(lambda traci, ego, time: Command(value, value)).end_reason == "time_limit"


@pytest.mark.parametrize(
    "call, sentence",
    [
        (
            "simulationStep",
            "moved SUMO's clock by +0.05 s at 0.00 s; stepping is the harness's "
            "(a program with a loop of its own runs as `traci:COMMAND`).",
        ),
        ("close", "closed the simulation at 0.00 s; that is the harness's."),
        (
            "start",
            "called traci.start at 0.00 s; that is the harness's (a program that starts SUMO "
            "itself runs as `traci:COMMAND`).",
        ),
    ],
)
def test_taking_over_in_reset_is_named_before_a_step(call, sentence):
    class Eager:
        def reset(self, scenario, traci, ego):
            getattr(traci, call)()

        def step(self, traci, ego, time):
            traci.vehicle.getSpeed(ego)

    assert simulate(case(), Eager()).error == "The ADS " + sentence


# --- an ADS that drives through TraCI stays physical ----------------------------------------------


@pytest.mark.parametrize(
    "speed_at, acceleration, clips",
    [
        (lambda time: 0.0, -9.0, {"vtype_limit": 10}),
        (lambda time: 100.0, 4.0, {"vtype_limit": 10}),
        (lambda time: 20.0 - 2.0 * (time + 0.05), -2.0, {}),
    ],
)
def test_set_speed_is_kept_to_the_vehicles_limits(speed_at, acceleration, clips):
    found = half_second(lambda traci, ego, time: traci.vehicle.setSpeed(ego, speed_at(time)))
    assert_last(found, speed=20.0 + 0.5 * acceleration)
    assert found.ego.acceleration == pytest.approx([0.0, *[acceleration] * 5])
    assert {clip.what: clip.count for clip in found.clips} == clips


def put(x, y):
    return lambda v: v.moveToXY("ego", "", -1, x, y, 90.0, 2)


@pytest.mark.parametrize(
    "trick, sentence",
    [
        (
            lambda v: (
                v.setDecel("ego", 50.0),
                v.setEmergencyDecel("ego", 50.0),
                v.setSpeed("ego", 0.0),
            ),
            "got -50.0 m/s2",
        ),
        (lambda v: (v.setAccel("ego", 30.0), v.setSpeed("ego", 60.0)), "got 30.0 m/s2"),
        (lambda v: v.setPreviousSpeed("ego", 0.0), "must drive its vehicle within -9..4 m/s2"),
        (put(80.0, 0.0), "moved its vehicle 21.75 m in a step that its speed"),
        (put(59.25, 3.5), "moved its vehicle 3.64 m in a step"),  # sideways
        (put(58.25, 0.0), "moved its vehicle 0.00 m in a step"),  # frozen
        (lambda v: v.moveTo("ego", "road_1", 400.0), "moved its vehicle"),
        # sideways as fast as ahead
        (put(58.25, 1.0), "got 628.3 m/s2"),
        # beyond what SUMO's answers can be
        (lambda v: v.setPreviousSpeed("ego", 5000.0), "is responsible: SUMO gave vehicle `ego`"),
    ],
)
def test_motion_that_no_vehicle_can_do_is_the_adss_error(trick, sentence):
    def ads(traci):
        trick(traci.vehicle)

    found = simulate(case(), once(ads))
    assert_ended(found, "ads_error", sentence)
    assert_last(found, time=0.3)


def test_an_ads_with_its_own_vehicle_dynamics_may_use_move_to_xy_with_a_set_speed():
    def own(traci, ego, time):
        v, now = 20.0 - 3.0 * (time + 0.05), time + 0.05
        x = 52.25 + 20.0 * now - 1.5 * now**2
        traci.vehicle.setSpeed(ego, v)
        traci.vehicle.moveToXY(ego, "", -1, x, 0.2 * now, 90.0 - math.degrees(0.2 / v), 2)

    found = half_second(own)
    assert_ended(found)
    assert_last(found, speed=18.5)
    assert_last(found, 1e-3, y=0.1 - 2.25 * 0.2 / 18.5)


def test_a_turn_after_straight_driving_is_measured_from_straight_ahead():
    """At 20 m/s and 0.1 s a step: 1.6, then 3.2 m/s to the left, 0.5 s straight on, 3.2 m/s again.

    The last turn is 2 m / (0.1 s)^2 * asin(0.16) = 32.1 m/s2. From the direction of the motion
    before it drove straight on it would be 0.
    """
    aside = {1: (0.16, 0.16), 2: (0.32, 0.48), 8: (0.32, 0.8)}  # step: m to the left, y in m

    def swerve(traci, ego, time):
        traci.vehicle.setSpeed(ego, 20.0)
        if (step := round(time / 0.1)) in aside:
            left, y = aside[step]
            x = traci.vehicle.getPosition(ego)[0] + math.sqrt(2.0**2 - left**2)
            traci.vehicle.moveToXY(ego, "", -1, x, y, 90.0, 2)

    found = simulate(case(), swerve, SimulationSettings(step=0.1, time_limit=2.0))
    assert_ended(
        found, "ads_error", "must turn its vehicle within 25 m/s2, got 32.1 m/s2 at 0.90 s"
    )
    assert_last(found, y=0.48, speed=20.0)


def changes_to(lane):
    """Change lane at 0.5 s."""
    return once(lambda traci: traci.vehicle.changeLane("ego", lane, 100.0), 0.5)


def test_change_lane_takes_the_lane_change_duration():
    ads = changes_to(1)
    found = simulate(case(), ads, SimulationSettings(time_limit=9.0, lane_change_duration=4.0))
    # 3.5 m at 0.875 m/s for 4 s: the front bumper crosses half way at 0.5 + 2 s; the angle lags a
    # little
    assert np.interp(1.75, found.ego.y, found.ego.time) == pytest.approx(2.5, abs=0.15)
    assert_last(found, 1e-3, y=3.5)
    # never faster than a tenth of a second's share
    assert np.abs(np.diff(found.ego.y)).max() < 0.0875 * 1.3
    assert found.clips == ()
    # over ground, not along the lane
    assert found.ego.speed.max() == pytest.approx(math.hypot(20.0, 0.875))


@pytest.mark.parametrize(
    "speed, y, lane",
    values_of("""
    0.5, 0.0, 1
    2.0, 0.0, 1
    8.0, 0.0, 1
    30.0, 0.0, 1
    30.0, 3.5, 0
    """),
)
def test_a_lane_change_by_sumo_is_driving_at_any_speed(speed, y, lane):
    eight = SimulationSettings(time_limit=8.0)
    found = simulate(case(speed=speed, y=y), changes_to(lane), eight)
    assert_ended(found)
    assert found.clips == ()
    assert np.abs(np.diff(found.ego.heading)).max() < 0.2


def test_an_ads_may_move_its_vehicle_across_the_line_within_a_lane_change():
    """SUMO would crash at the middle of the change."""

    def ads(traci, ego, time):
        changes_to(1)(traci, ego, time)
        x, y = traci.vehicle.getPosition(ego)
        if time > 0.52:
            traci.vehicle.moveToXY(ego, "", -1, x + 1.0, min(y + 0.1, 3.5), 90.0, 2)

    found = simulate(case(), ads, SimulationSettings(time_limit=4.0))
    assert_ended(found)
    assert_last(found, y=3.5)


def test_an_adss_own_lateral_speed_holds_after_its_commands():
    """A Command within a lane change makes SUMO finish that change in one step."""
    limit = []

    def ads(traci, ego, time):
        if time == 0.0:
            traci.vehicle.setMaxSpeedLat(ego, 0.6)
        changes_to(1)(traci, ego, time)
        limit.append(traci.vehicle.getMaxSpeedLat(ego))
        return Command(0.0) if 1.0 < time < 1.12 else None

    simulate(case(), ads, SimulationSettings(time_limit=3.0))
    assert limit[-1] == 0.6
    assert max(limit) == 1000.0


def test_braking_while_sumo_changes_lane_is_within_the_limits():
    def ads(traci, ego, time):
        changes_to(1)(traci, ego, time)
        if time > 0.45:
            traci.vehicle.setSpeed(ego, 0.0)

    found = simulate(case(), ads)
    assert_ended(found, "standstill")
    assert found.ego.acceleration.min() == pytest.approx(-9.0)


@pytest.mark.parametrize("model", ["sumo:IDM", "sumo:krauss", "sumo:EIDM"])
def test_sumos_own_models_drive_the_ego_and_keep_to_its_speed(model):
    free = simulate(case(), model, SimulationSettings(time_limit=8.0))
    assert_ended(free)
    assert np.all(np.isnan(free.ego.steering_wheel_angle))
    assert free.ego.speed.max() < 20.5  # not the road's limit of 60 m/s
    behind = simulate(case(lead(gap=60.0, speed=10.0)), model)
    assert behind.end_reason == "road_end"
    assert_last(behind, 0.5, speed=10.0)
    assert behind.ego.acceleration.min() > -5.0


def test_a_native_model_has_its_attributes():
    gentle = simulate(
        case(), NativeModel("Krauss", {"desiredMaxSpeed": "30"}), SimulationSettings(time_limit=8.0)
    )
    assert_last(gentle, 0.1, speed=30.0)
    assert gentle.ego.acceleration.max() == pytest.approx(2.6)  # SUMO's default for a car


# --- commands and TraCI in turn -------------------------------------------------------------------


def test_commands_and_traci_may_take_turns():
    def ads(traci, ego, time):
        if time < 0.975:
            return Command(-2.0)
        if time < 1.975:
            return None
        return Command(1.0)

    found = simulate(case(), ads, SimulationSettings(time_limit=3.0))
    assert_ended(found)
    assert found.clips[0].what == "acceleration_rate"
    # 20 - 2*1 + 2*2/(2*60) = 18.0333: kept by SUMO, then +1 m/s2 for 1 s less a rise of 0.1 s at 10
    # m/s3: 0.95 m/s
    speeds = found.ego.speed[[10, 20, 30]]
    assert speeds == pytest.approx([18.03333, 18.03333, 18.98333], abs=1e-5)
    steering = found.ego.steering_wheel_angle[[0, 10, 11, 20, 21]]
    assert np.isnan(steering).tolist() == [False, False, True, True, False]


def test_commands_within_a_lane_change_by_sumo_are_carried_out():
    """At the middle of its lane change, 2.5 s after its begin, SUMO would end the process: the ego
    is in the last lane already."""

    def ads(traci, ego, time):
        if 0.29 < time < 1.0:
            return traci.vehicle.changeLane(ego, 1, 5.0) if time < 0.31 else None
        return Command(1.0 if time > 1.0 else -1.0, 0.1 if time < 0.3 else 0.0)

    found = simulate(case(), ads, SimulationSettings(time_limit=3.5))
    assert_ended(found)
    assert found.ego.y[-1] > 1.75


def test_a_body_left_to_sumo_at_an_angle_snaps_to_the_lane_and_that_is_recorded():
    found = simulate(
        case(),
        lambda traci, ego, time: Command(0.0, 0.5) if time < 0.5 else None,
        SimulationSettings(time_limit=1),
    )
    clip = clips_of(found)["heading"]
    assert clip.count == 1
    assert clip.applied == 0.0
    assert clip.requested > 0.05
    assert found.end_reason == "time_limit"


def test_clips_keep_count_first_time_and_worst_request():
    found = half_second(lambda traci, ego, time: Command(-20.0 if time > 0.12 else -10.0))
    clip = clips_of(found)["acceleration"]
    assert clip.count == 10
    assert clip.first_time == 0.0
    assert clip.requested == -20.0
    assert clip.applied == -9.0


# --- recordings -----------------------------------------------------------------------------------


def test_samples_come_ten_times_a_second_from_the_requested_start_to_the_end():
    found = simulate(case(lead(gap=31.4), Actor("beside", Start(50.0, 3.5, 20.0))), nothing)
    # 0.0 .. 1.5, and the contact at 1.57 s
    assert found.ego.time == pytest.approx([*np.arange(16) / 10, 1.57])
    assert np.array_equal(found.actors["beside"].time, found.ego.time)
    assert found.actors["beside"].x == pytest.approx(found.ego.x)
    ego = found.ego
    assert ego.x[0] == 50.0
    assert ego.y[0] == 0.0
    assert ego.heading[0] == 0.0
    assert ego.speed[0] == 20.0
    assert ego.x == pytest.approx(50.0 + 20.0 * ego.time)  # the centre, not the bumper
    assert found.actors["lead"].x == pytest.approx(85.9)  # 50 + 4.5 + 31.4
    assert ego.length == 4.5
    assert ego.width == 1.8


@pytest.mark.parametrize("step, interval", [(0.05, 0.05), (0.02, 0.1), (0.1, 0.1), (0.025, 0.1)])
def test_samples_come_at_the_recording_interval(step, interval):
    settings = SimulationSettings(step=step, record_interval=interval, time_limit=1.0)
    found = simulate(case(), nothing, settings)
    assert found.ego.time == pytest.approx(np.arange(round(1.0 / interval) + 1) * interval)


@pytest.mark.parametrize("jerk", [math.inf, 12.65])
@pytest.mark.parametrize(
    "moves", [(), (lane_change(0.5, 2.0, 3.5),), (constant_lateral(0.33, 1.3, 3.5),)]
)
def test_law_a_scripted_actor_is_where_its_closed_form_says_at_every_sample(jerk, moves):
    mover = Actor("mover", Start(80.0, 0.0, 17.0), (*moves, brake_to_stop(0.42, 4.0, jerk)))
    found = simulate(case(mover, speed=5.0), nothing, SimulationSettings(time_limit=8.0))
    track = found.actors["mover"]
    assert found.error is None
    assert len(track) == 81
    for index, time in enumerate(track.time.tolist()):
        along, across = mover.speed(time), mover.lateral_speed(time)
        assert track.x[index] == pytest.approx(mover.x(time), abs=1e-6)
        assert track.y[index] == pytest.approx(mover.y(time), abs=1e-6)
        assert track.speed[index] == pytest.approx(math.hypot(along, across), abs=1e-6)
        assert track.heading[index] == pytest.approx(math.atan2(across, along), abs=1e-6)
        braking = -min(jerk * (time - 0.42), 4.0) if 0.42 <= time < mover.script_end else 0.0
        sideways = sum(motion.lateral_motion(move, time)[2] for move in moves)
        rise = along * braking + across * sideways
        rate = rise / math.hypot(along, across) if across else braking
        assert track.acceleration[index] == pytest.approx(rate, abs=1e-9)
    assert track.speed[-1] == 0.0
    assert track.acceleration.min() < -3.9


@pytest.mark.parametrize(
    "settings, sentence",
    rows_of(
        """
{"step": 0.0125}
| `step` of the simulation must be a whole number of milliseconds (SUMO rounds it), got 0.0125
{"step": 0.0004, "record_interval": 0.0004} | a whole number of milliseconds
{"step": 1e-10, "record_interval": 1e-10} | a whole number of milliseconds
{"step": 0.04}
| `record_interval` of the simulation must be a multiple of `step` (0.04 s), got 0.1
{"step": 0.1, "record_interval": 0.05} | must be a multiple of `step`
{"record_interval": 1e-12} | must be a multiple of `step`
""",
        json.loads,
    ),
)
def test_steps_and_samples_that_do_not_fit_are_refused(settings, sentence):
    with refused(sentence):
        simulate(case(), nothing, SimulationSettings(**settings))


# --- laws -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [15.0, 20.0, 24.0, 26.0])
def test_law_halving_the_step_hardly_changes_the_impact_speed(gap):
    # the ego brakes from 20 m/s towards a standing car: v^2 = 19.325^2 - 2*9*(gap - 2.96625),
    # brakes built up
    exact = math.sqrt(max(19.325**2 - 18.0 * (gap - 2.96625), 0.0))
    for step in (0.1, 0.05, 0.025):
        found = simulate(case(lead(gap=gap)), brake, SimulationSettings(step=step))
        impact = found.collision.relative_speed if found.collision else 0.0
        assert impact == pytest.approx(exact, abs=0.02)


def test_a_scenarios_ego_body_is_the_one_that_drives_touches_and_is_recorded():
    # centres 4.3 + 10 m apart and bodies of 4.3 m: 10 m to go at 20 m/s, not the 9.8 m of the
    # settings' 4.5 m
    wall = Actor("lead", Start(50.0 + 14.3, 0.0, 0.0), length=4.3, width=1.9)
    sizes = []

    def look(traci, ego, time):
        sizes.append((traci.vehicle.getLength(ego), traci.vehicle.getWidth(ego)))

    found = simulate(replace(case(wall), ego_body=EgoBody(4.3, 1.9)), look)
    assert found.collision.time == pytest.approx(0.5)
    assert found.ego.length == 4.3
    assert found.ego.width == 1.9
    assert set(sizes) == {(4.3, 1.9)}


# --- cut-out: the lead leaves and does not touch what it reveals ----------------------------------


def body(actor, time):
    """The actor's body as its script says."""
    heading = math.atan2(actor.lateral_speed(time), actor.start.speed)
    return Body(
        actor.start.x + actor.start.speed * time,
        actor.y(time),
        heading,
        0.0,
        actor.length,
        actor.width,
    )


def test_law_the_lead_never_touches_the_obstacle_at_any_possible_point_of_the_grid():
    points = every_point(CUT_OUT)
    assert len(points) == 275
    feasible = CUT_OUT.feasible(points)
    assert 100 < feasible.sum() < 275
    for concrete in CUT_OUT.concretes(points[feasible]):
        lead_car, obstacle = concrete.actors
        ego = Actor("ego", concrete.ego)
        for time in np.arange(0.0, 6.0, 0.02):
            assert widest_gap(body(lead_car, time), body(obstacle, time))[0] > 0.0, concrete.label
        assert widest_gap(body(lead_car, 0.0), body(ego, 0.0))[0] >= 2.0 - 1e-9


def test_a_controller_that_was_loaded_may_be_loaded_again():
    ads = load_controller(nothing)
    assert load_controller(ads) is ads


# --- `sumo:` with parameters, and TraCI code that names its vehicle's type ------------------------


TEN = SimulationSettings(time_limit=10.0)


@pytest.mark.parametrize(
    "model",
    ["sumo:CC", "sumo:cc?tauEngine=0.3", "sumo:CACC?gapControlGainGap=0.5", "sumo:EIDM?jerkmax=2"],
)
def test_a_model_follows_a_slower_vehicle_without_a_contact(model):
    found = clear_drive(case(lead(60.0, speed=10.0)), model, SimulationSettings(time_limit=30.0))
    assert found.ego.speed[-1] < 13.0


def test_a_parameter_of_plexe_reaches_its_model():
    """Its cruise control (`ccac` 1) slows down to the 12 m/s that it is told, on an empty road."""
    alone = simulate(case(), "sumo:CC", TEN)
    slower = simulate(case(), "sumo:CC?carFollowModel.ccac=1&carFollowModel.ccds=12", TEN)
    assert slower.error is None
    assert slower.ego.speed[-1] < alone.ego.speed[-1] - 3.0


def test_traci_code_names_its_vehicles_type():
    class Platoon:
        vehicle_type = {"carFollowModel": "CC", "tauEngine": 0.3}  # noqa: RUF012

        def reset(self, scenario, traci, ego):
            traci.vehicle.setParameter(ego, "carFollowModel.ccac", "1")
            traci.vehicle.setParameter(ego, "carFollowModel.ccds", "12")
            traci.vehicle.setSpeedMode(ego, 31)
            traci.vehicle.setSpeed(ego, -1)

        def step(self, traci, ego, time):
            """SUMO drives."""

    found = simulate(case(), Platoon, TEN)
    assert found.error is None
    assert found.ego.speed[-1] < 17.0


@pytest.mark.parametrize(
    "given, sentence",
    rows_of(
        """
{"carFollowModel": "CCC"} | Unknown SUMO car-following model `CCC`
{"length": 1.0} | Unknown vType parameter `length`
{"tau": "soon"} | `tau` of `vehicle_type` of Mine must be a finite number
{"tau": -1} | `tau` of `vehicle_type` of Mine must be greater than 0, got '-1'
{"actionStepLength": -1} | must be at least 0, got '-1'
{"sigma": 1.5} | must be at most 1, got '1.5'
"CC" | must be a dict
""",
        json.loads,
    ),
)
def test_a_type_is_how_the_vehicle_follows_and_nothing_else(given, sentence):
    class Mine:
        vehicle_type = given

        def step(self, traci, ego, time):
            """SUMO drives."""

    with refused(sentence):
        simulate(case(), Mine, TEN)


def test_what_steps_read_has_few_enough_attributes_to_be_fast():
    counts = set()

    def ads(traci, ego, time):
        hook = sys._getframe(1).f_locals["self"]
        counts.update(len(vars(it)) for it in (hook, hook._world))

    half_second(ads)
    assert max(counts) <= 29  # CPython 3.11 keeps so many beside an object, more in a dictionary
