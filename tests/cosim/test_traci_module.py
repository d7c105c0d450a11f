"""The `traci` that an ADS sees: TraCI code as it is, the ego its own, everything else guarded."""

import sys
import tomllib
from dataclasses import replace
from itertools import product

import libsumo
import numpy as np
import pytest
from cosim_cases import HALF_SECOND, assert_whole, case, lead, once

from sumo_eval.cosim.doors.contract import check_controller
from sumo_eval.cosim.doors.traci_module import GUARD, TRACI
from sumo_eval.cosim.doors.traci_numbers import IGNORED
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.settings import ConditionSettings

RECORD = replace(HALF_SECOND, conditions=ConditionSettings(interference="record"))


def counts(recording):
    return {clip.what: clip.count for clip in recording.clips}


def ads_file(folder, text):
    (folder / "script.py").write_text(text)
    return simulate(case(lead(50.0)), "script.py:drive", HALF_SECOND, folder=folder)


def test_code_that_imports_traci_drives_the_running_simulation(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    found = ads_file(
        tmp_path,
        "import traci\nimport traci.constants as tc\nfrom traci.exceptions import TraCIException\n"
        "def drive(_, ego, time):\n"
        "    traci.vehicle.subscribe(ego, (tc.VAR_SPEED,))\n"
        "    try:\n        traci.vehicle.getSpeed('nobody')\n    except TraCIException:\n"
        "        traci.vehicle.setSpeed('ego', 15.0)\n",
    )
    assert_whole(found)
    assert found.ego.speed[-1] == pytest.approx(20.0 - 0.5 * 9.0)


def test_an_import_is_the_running_simulation_only_while_driving():
    before = sys.modules["traci"]

    def drive(_, ego, time):
        import traci

        traci.vehicle.setSpeed(ego, 15.0)

    assert simulate(case(), drive, HALF_SECOND).ego.speed[-1] == pytest.approx(15.5)
    simulate(case(), lambda traci, ego, time: 1 / 0, HALF_SECOND)
    assert sys.modules["traci"] is before


def test_reading_is_libsumos_own_function_and_costs_nothing():
    for call in ("getSpeed", "getPosition", "getLeader", "getIDList", "subscribe", "getNeighbors"):
        assert getattr(TRACI.vehicle, call) is getattr(libsumo.vehicle, call)
    assert TRACI.simulation.getTime is libsumo.simulation.getTime


class Listener(TRACI.StepListener):
    """Counts and slows down."""

    def __init__(self):
        self.calls = self.cleaned = 0

    def step(self, t=0):
        self.calls += 1
        TRACI.vehicle.setSpeed("ego", 20.0 - 0.1 * self.calls)
        return True

    def cleanUp(self):
        self.cleaned += 1


class Script:
    """Adds a listener, which drives."""

    def __init__(self, listener):
        self.listener = listener

    def reset(self, scenario, traci, ego):
        assert traci.addStepListener(self.listener) == 0

    def step(self, traci, ego, time):
        """Leave it to the listener."""


def test_a_step_listener_is_a_controller_and_is_called_every_step():
    listener = Listener()
    found = simulate(case(), listener, HALF_SECOND)
    assert found.error is None
    assert (listener.calls, listener.cleaned) == (10, 1)
    assert found.ego.speed[-1] == pytest.approx(19.0)


def test_a_listener_that_a_script_adds_is_called_each_step_until_it_says_no():
    class Until(Listener):
        def step(self, t=0):
            return super().step(t) and self.calls < 4

    listener = Until()
    simulate(case(), Script(listener), HALF_SECOND)
    assert (listener.calls, listener.cleaned) == (4, 1)
    simulate(case(), lambda traci, ego, time: None, HALF_SECOND)
    assert listener.calls == 4  # gone with its case


def test_an_ads_that_raises_in_close_still_has_its_listeners_cleaned_up():
    listener = Listener()

    class Raises(Script):
        def close(self):
            raise RuntimeError("no")

    found = simulate(case(), Raises(listener), HALF_SECOND)
    assert found.end_reason == "ads_error"
    assert found.error == "The ADS raised in close: RuntimeError: no."
    assert listener.cleaned == 1


def test_a_listener_that_raises_is_the_adss_error():
    class Broken(TRACI.StepListener):
        def step(self, t=0):
            raise RuntimeError("no")

    found = simulate(case(), Broken(), HALF_SECOND)
    assert found.end_reason == "ads_error"
    assert found.error == "The ADS raised at 0.00 s: RuntimeError: no."


TOUCHES = [
    (lambda traci: traci.vehicle.setSpeed("lead", 1.0), "vehicle.setSpeed for `lead`"),
    (lambda traci: traci.vehicle.setSpeed(vehID="lead", speed=1.0), "vehicle.setSpeed for `lead`"),
    (lambda traci: traci.vehicle.add("mine", "along"), "vehicle.add for `mine`"),
    (lambda traci: traci.vehicletype.setLength("lead", 1.0), "vehicletype.setLength for `lead`"),
    (lambda traci: traci.lane.setMaxSpeed("road_0", 9.0), "lane.setMaxSpeed for `road_0`"),
    (lambda traci: traci.simulation.setScale(2.0), "simulation.setScale for `2.0`"),
]


@pytest.mark.parametrize("action, sentence", TOUCHES, ids=[words for _, words in TOUCHES])
def test_who_touches_what_is_not_the_egos_is_refused_or_put_on_record(action, sentence):
    found = simulate(case(lead(50.0)), once(action), HALF_SECOND)
    assert found.end_reason == "ads_error"
    assert f"The ADS called traci.{sentence} at 0.30 s" in found.error
    assert found.ego.time[-1] == pytest.approx(0.3)
    found = simulate(case(lead(50.0)), once(action), RECORD)
    assert_whole(found)
    assert counts(found)["touched_" + sentence.partition(".")[0]] == 1


def test_a_refused_call_has_no_effect_and_cannot_be_swallowed():
    def sly(traci, ego, time):
        try:
            traci.vehicle.setSpeed("lead", 0.0)
        except Exception:  # noqa: BLE001 - as such scripts do
            return Command(0.0)

    found = simulate(case(lead(50.0, speed=20.0)), sly, HALF_SECOND)
    assert "The ADS called traci.vehicle.setSpeed for `lead` at 0.00 s" in found.error


@pytest.mark.parametrize(
    "action",
    [
        lambda traci: traci.simulationStep(),
        lambda traci: traci.simulation.step(),
        lambda traci: traci.close(),
        lambda traci: traci.load(["-n", "nothing"]),
    ],
)
def test_stepping_and_closing_on_record_are_left_out(action):
    found = simulate(case(lead(50.0)), once(action), RECORD)
    assert (found.end_reason, found.simulated_time) == ("time_limit", pytest.approx(0.5))
    assert set(counts(found)) & {"stepped_the_clock", "started_or_closed"}


def test_nothing_that_one_case_did_is_counted_in_the_next():
    simulate(case(lead(50.0)), once(TOUCHES[0][0]), HALF_SECOND)
    found = simulate(case(lead(50.0)), lambda traci, ego, time: None, HALF_SECOND)
    assert (found.error, found.clips, GUARD.touched) == (None, (), {})


def test_the_egos_own_type_and_new_types_are_the_adss():
    def own(traci):
        traci.vehicletype.setTau("ego", 0.7)
        traci.vehicletype.copy("lead", "like_the_lead")
        traci.vehicletype.setTau("like_the_lead", 0.7)
        traci.vehicle.setColor("ego", (1, 2, 3, 255))

    found = simulate(case(lead(50.0)), once(own), HALF_SECOND)
    assert (found.error, counts(found)) == (None, {"ignored_traci_call": 1})


def test_bypassing_the_door_is_noticed_at_the_other_vehicle():
    found = simulate(
        case(lead(50.0, speed=20.0)),
        once(lambda traci: libsumo.vehicle.setSpeed("lead", 1.0)),
        HALF_SECOND,
    )
    assert "actor_off_its_script" in counts(found)
    remove, one = once(lambda traci: libsumo.vehicle.remove("lead")), case(lead(50.0))
    removed = "The ADS removed vehicle `lead` before 0.35 s"
    assert removed in simulate(one, remove, HALF_SECOND).error
    found = simulate(one, remove, RECORD)
    assert "actor_left_the_network" in counts(found)
    assert found.actors["lead"].time[-1] == pytest.approx(0.3)


def test_the_clock_of_sumo_is_a_step_ahead_of_what_is_seen():
    ahead = []
    simulate(
        case(),
        lambda traci, ego, time: ahead.append(traci.simulation.getTime() - time),
        HALF_SECOND,
    )
    assert ahead == pytest.approx([HALF_SECOND.step] * len(ahead))
    assert ahead


@pytest.mark.parametrize(
    "write",
    [
        lambda traci, ego: traci.vehicle.setSpeed(ego, 1.0),
        lambda traci, ego: traci.vehicle.slowDown(ego, 1.0, 2.0),
        lambda traci, ego: traci.vehicle.changeLane(ego, 1, 1.0),
    ],
)
def test_a_call_beside_a_command_is_dropped_and_recorded(write):
    def drive(traci, ego, time):
        if 0.19 < time < 0.31:
            write(traci, ego)
        return Command(-1.0, 0.0)

    both = simulate(case(), drive, HALF_SECOND)
    alone = simulate(case(), lambda traci, ego, time: Command(-1.0, 0.0), HALF_SECOND)
    assert counts(both) == {"dropped_traci_call": round(0.1 / HALF_SECOND.step) + 1}
    assert counts(alone) == {}
    assert is_same(both, alone)


def test_calls_without_a_command_are_not_dropped():
    call = once(lambda traci: traci.vehicle.setSpeed("ego", 19.9))
    assert counts(simulate(case(), call, HALF_SECOND)) == {}


ALWAYS = tomllib.loads("""
changeSublane = [0.5]
setLateralAlignment = ["left"]
setMinGapLat = [2.0]
setLength = [9.0]
setWidth = [3.0]
setApparentDecel = [1.0]
setImpatience = [1.0]
setSpeedFactor = [0.01]
setRoutingMode = [1]
rerouteTraveltime = []
rerouteEffort = []
setVia = [[]]
setAdaptedTraveltime = ["road", 5.0]
setEffort = ["road", 5.0]
""")
BESIDE_A_SPEED = tomllib.loads("""
openGap = [3.0, 20.0, 5.0, 0.5]
deactivateGapControl = []
setActionStepLength = [1.0]
setImperfection = [1.0]
setTau = [3.0]
setMinGap = [9.0]
setStop = ["road", 80.0, 0, 2.0]
insertStop = [0, "road", 80.0, 0, 2.0]
""")
OF_TYPES = "setMinGapLat", "setSpeedDeviation", "setTau", "setImperfection"


def driven(name, speed, domain="vehicle", arguments=(0.5,)):
    """Closing in on another for 6 s.

    name: of a call at 0.1 s.

    speed: that is set at every step, or once, to hand over to SUMO's model.
    """

    def drive(traci, ego, time):
        if speed > 0.0 or time < 0.01:
            traci.vehicle.setSpeed(ego, speed)
        if name and abs(time - 0.1) < 1e-9:
            getattr(getattr(traci, domain), name)(ego, *arguments)

    return simulate(case(lead(60.0, speed=15.0)), drive, replace(HALF_SECOND, time_limit=6.0))


def is_same(one, two):
    one, two = (np.concatenate([it.ego.speed, it.ego.y]).tobytes() for it in (one, two))
    return one == two


def test_every_call_that_sumo_ignores_is_tried_here():
    assert {*ALWAYS, *BESIDE_A_SPEED, *OF_TYPES} == set(IGNORED)


@pytest.mark.parametrize(
    "speed, name", [*product([21.0], ALWAYS | BESIDE_A_SPEED), *product([-1.0], ALWAYS)]
)
def test_a_call_that_sumo_ignores_does_nothing_and_is_recorded(speed, name):
    found = driven(name, speed, arguments=(ALWAYS | BESIDE_A_SPEED)[name])
    assert counts(found).get("ignored_traci_call") == 1
    assert f"SUMO ignored {name}: " in found.log
    assert is_same(found, driven("", speed))


@pytest.mark.parametrize("name", OF_TYPES)
def test_a_call_on_the_type_that_sumo_ignores_is_recorded(name):
    found = driven(name, 21.0, "vehicletype")
    assert counts(found).get("ignored_traci_call") == 1
    assert is_same(found, driven("", 21.0))


@pytest.mark.parametrize(
    "name", [name for name in BESIDE_A_SPEED if name != "deactivateGapControl"]
)
def test_calls_that_sumos_own_model_heeds_are_not_clips(name):
    found = driven(name, -1.0, arguments=BESIDE_A_SPEED[name])
    assert "ignored_traci_call" not in counts(found)
    assert not is_same(found, driven("", -1.0))


def test_check_says_which_calls_are_ignored():
    def drive(traci, ego, time):
        traci.vehicle.setTau(ego, 2.0)
        traci.vehicle.setSpeed(ego, 20.0)

    said = [finding.text for finding in check_controller(drive, [case()], settings=HALF_SECOND)]
    (found,) = [text for text in said if "SUMO ignored" in text]
    assert found.startswith(
        "makes TraCI calls that SUMO ignores, 10 in a case; SUMO ignored setTau: only SUMO's own "
        "model"
    )
