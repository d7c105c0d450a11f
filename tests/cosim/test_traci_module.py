"""The `traci` that an ADS sees: TraCI code as it is, the ego its own, everything else guarded."""

import inspect
import json
import math
import sys
import tomllib
from dataclasses import replace
from fractions import Fraction
from itertools import product
from operator import attrgetter

import libsumo
import numpy as np
import pytest
from road_scenes import (
    HALF_SECOND,
    ROAD,
    assert_ended,
    assert_last,
    case,
    clips_of,
    half_second,
    lead,
    once,
    under,
)
from tables import rows_of
from traci._vehicle import VehicleDomain
from traci._vehicletype import VehicleTypeDomain

from sumo_eval.cosim import Command, simulate
from sumo_eval.cosim.doors.contract import check_controller
from sumo_eval.cosim.doors.traci_module import GUARD, TRACI, RefusedCallError
from sumo_eval.cosim.doors.traci_numbers import ARGUMENTS, IGNORED, LONGEST, breach
from sumo_eval.cosim.sumo.session import session

RECORD = under(interference="record")


def fault(ads, *actors, settings=HALF_SECOND):
    """The error of the ADS that ended its case."""
    found = simulate(case(*actors), ads, settings)
    assert found.end_reason == "ads_error"
    return found.error


def counts(recording):
    return {clip.what: clip.count for clip in recording.clips}


def ads_file(folder, text):
    (folder / "script.py").write_text(text)
    return half_second("script.py:drive", lead(50.0), folder=folder)


def test_code_that_imports_traci_drives_the_running_simulation(tmp_path, own_path):
    found = ads_file(
        tmp_path,
        "import traci\nimport traci.constants as tc\nfrom traci.exceptions import TraCIException\n"
        "def drive(_, ego, time):\n"
        "    traci.vehicle.subscribe(ego, (tc.VAR_SPEED,))\n"
        "    try:\n        traci.vehicle.getSpeed('nobody')\n    except TraCIException:\n"
        "        traci.vehicle.setSpeed('ego', 15.0)\n",
    )
    assert_ended(found)
    assert_last(found, speed=20.0 - 0.5 * 9.0)


def test_an_import_is_the_running_simulation_only_while_driving():
    before = sys.modules["traci"]

    def drive(_, ego, time):
        import traci

        traci.vehicle.setSpeed(ego, 15.0)

    assert_last(half_second(drive), speed=15.5)
    half_second(lambda traci, ego, time: 1 / 0)
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
    found = half_second(listener)
    assert found.error is None
    assert listener.calls == 10
    assert listener.cleaned == 1
    assert_last(found, speed=19.0)


def test_a_listener_that_a_script_adds_is_called_each_step_until_it_says_no():
    class Until(Listener):
        def step(self, t=0):
            return super().step(t) and self.calls < 4

    listener = Until()
    half_second(Script(listener))
    assert listener.calls == 4
    assert listener.cleaned == 1
    half_second(lambda traci, ego, time: None)
    assert listener.calls == 4  # gone with its case


def test_an_ads_that_raises_in_close_still_has_its_listeners_cleaned_up():
    listener = Listener()

    class Raises(Script):
        def close(self):
            raise RuntimeError("no")

    assert fault(Raises(listener)) == "The ADS raised in close: RuntimeError: no."
    assert listener.cleaned == 1


def test_a_listener_that_raises_is_the_adss_error():
    class Broken(TRACI.StepListener):
        def step(self, t=0):
            raise RuntimeError("no")

    assert fault(Broken()) == "The ADS raised at 0.00 s: RuntimeError: no."


TOUCHES = [
    (lambda traci: traci.vehicle.setSpeed("lead", 1.0), "vehicle.setSpeed for `lead`"),
    (lambda traci: traci.vehicle.setSpeed(vehID="lead", speed=1.0), "vehicle.setSpeed for `lead`"),
    (lambda traci: traci.vehicle.add("mine", "along"), "vehicle.add for `mine`"),
    (lambda traci: traci.vehicletype.setLength("lead", 1.0), "vehicletype.setLength for `lead`"),
    (lambda traci: traci.lane.setMaxSpeed("road_0", 9.0), "lane.setMaxSpeed for `road_0`"),
    (lambda traci: traci.simulation.setScale(2.0), "simulation.setScale for `2.0`"),
]


@pytest.mark.parametrize("action, sentence", TOUCHES)
def test_who_touches_what_is_not_the_egos_is_refused_or_put_on_record(action, sentence):
    found = half_second(once(action), lead(50.0))
    assert_ended(found, "ads_error", f"The ADS called traci.{sentence} at 0.30 s")
    assert_last(found, time=0.3)
    found = simulate(case(lead(50.0)), once(action), RECORD)
    assert_ended(found)
    assert counts(found)["touched_" + sentence.partition(".")[0]] == 1


def test_a_refused_call_has_no_effect_and_cannot_be_swallowed():
    def sly(traci, ego, time):
        try:
            traci.vehicle.setSpeed("lead", 0.0)
        except Exception:  # noqa: BLE001 - as such scripts do
            return Command(0.0)

    found = half_second(sly, lead(50.0, speed=20.0))
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
    assert found.end_reason == "time_limit"
    assert found.simulated_time == pytest.approx(0.5)
    assert set(counts(found)) & {"stepped_the_clock", "started_or_closed"}


def test_nothing_that_one_case_did_is_counted_in_the_next():
    half_second(once(TOUCHES[0][0]), lead(50.0))
    found = half_second(lambda traci, ego, time: None, lead(50.0))
    assert found.error is None
    assert found.clips == ()
    assert GUARD.touched == {}


def test_the_egos_own_type_and_new_types_are_the_adss():
    def own(traci):
        traci.vehicletype.setTau("ego", 0.7)
        traci.vehicletype.copy("lead", "like_the_lead")
        traci.vehicletype.setTau("like_the_lead", 0.7)
        traci.vehicle.setColor("ego", (1, 2, 3, 255))

    found = half_second(once(own), lead(50.0))
    assert found.error is None
    assert counts(found) == {"ignored_traci_call": 1}


def test_bypassing_the_door_is_noticed_at_the_other_vehicle():
    found = half_second(
        once(lambda traci: libsumo.vehicle.setSpeed("lead", 1.0)), lead(50.0, speed=20.0)
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
    half_second(lambda traci, ego, time: ahead.append(traci.simulation.getTime() - time))
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

    both = half_second(drive)
    alone = half_second(lambda traci, ego, time: Command(-1.0, 0.0))
    assert counts(both) == {"dropped_traci_call": round(0.1 / HALF_SECOND.step) + 1}
    assert counts(alone) == {}
    assert is_same(both, alone)


def test_calls_without_a_command_are_not_dropped():
    call = once(lambda traci: traci.vehicle.setSpeed("ego", 19.9))
    assert counts(half_second(call)) == {}


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


def driven(name, speed, domain="vehicle", arguments=()):
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
    "speed, name, domain",
    [
        *product([21.0], ALWAYS | BESIDE_A_SPEED, ["vehicle"]),
        *product([-1.0], ALWAYS, ["vehicle"]),
        *product([21.0], OF_TYPES, ["vehicletype"]),
    ],
)
def test_a_call_that_sumo_ignores_does_nothing_and_is_recorded(speed, name, domain):
    arguments = (0.5,) if domain == "vehicletype" else (ALWAYS | BESIDE_A_SPEED)[name]
    found = driven(name, speed, domain, arguments)
    assert counts(found).get("ignored_traci_call") == 1
    assert f"SUMO ignored {name}: " in found.log
    assert is_same(found, driven("", speed))


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


# --- whatever an ADS writes through TraCI is finite and possible ----------------------------------


DOMAINS = {
    "vehicle": (libsumo.vehicle, VehicleDomain),
    "vehicletype": (libsumo.vehicletype, VehicleTypeDomain),
}
NO_NUMBERS = [math.nan, math.inf, -math.inf]
TEXTS = ["nan", "-inf", "INFINITY", "nan(0x1)", "1e999", "0.5 nan", "1,inf"]
OF_TEXT = {
    "edgeID", "routeID", "typeID", "newTypeID", "laneID", "stopID", "parkingAreaID",
    "referenceVehID", "line",
    "fromTaz", "toTaz", "clazz", "shapeClass", "latAlignment", "edgeList", "reservations", "key",
    "param", "departLane",
    "arrivalLane",
}  # fmt: skip
CALLS = [(domain, call) for domain, calls in ARGUMENTS.items() for call in calls]
ARGUMENTS_OF_NUMBERS = [
    (domain, call, place)
    for domain, call in CALLS
    for place, name in enumerate(ARGUMENTS[domain][call])
    if name not in OF_TEXT
]


def writes(domain):
    """Calls that the guarded module wraps, of libsumo's own domain."""
    guarded, own = getattr(TRACI, domain), DOMAINS[domain][0]
    calls = (call for call in dir(own) if not call.startswith("_") and callable(getattr(own, call)))
    return {call for call in calls if getattr(guarded, call) is not getattr(own, call)}


def harmless(domain, call):
    """Arguments that no rule is about, one for each."""
    lane = {"laneID": "road_0", "pos": 60.0, "laneIndex": 0}
    return [
        lane.get(name, "road" if name in OF_TEXT else 0.0 if name != "indexOffset" else 0)
        for name in ARGUMENTS[domain][call]
    ]


@pytest.mark.parametrize("domain", list(DOMAINS))
def test_the_table_has_every_call_of_libsumo_that_writes_and_its_arguments_in_their_order(domain):
    assert set(ARGUMENTS[domain]) == writes(domain)
    of_traci = DOMAINS[domain][1]
    for call, names in ARGUMENTS[domain].items():
        # after `self` and the name
        assert names == tuple(inspect.signature(getattr(of_traci, call)).parameters)[2:], call


@pytest.mark.parametrize("domain, call", CALLS)
def test_numbers_of_the_ordinary_course_are_none_of_the_rules_business(domain, call):
    with session(case(lead(50.0)), HALF_SECOND):
        assert breach(domain, call, "ego", harmless(domain, call), {}) is None


@pytest.fixture
def running():
    with session(case(lead(50.0)), HALF_SECOND) as traci:
        yield traci


@pytest.mark.parametrize("domain, call, place", ARGUMENTS_OF_NUMBERS)
def test_every_call_with_every_number_that_is_none_is_refused(running, domain, call, place):
    name = ARGUMENTS[domain][call][place]
    values = [*NO_NUMBERS, *np.array(NO_NUMBERS), np.float32(math.nan), 10**400, -(10**5000)]
    values += [(1.0, (math.nan, 2.0)), [[math.inf]], np.array([1.0, math.nan])]
    for value in values:
        for how in ("by place", "by name"):
            GUARD.begin(["lead"], 0.05, "record")
            args, kwargs = harmless(domain, call), {}
            args[place] = value
            if how == "by name":
                kwargs = dict(zip(ARGUMENTS[domain][call][place:], args[place:], strict=True))
                del args[place:]
            with pytest.raises(RefusedCallError) as refused:
                getattr(getattr(TRACI, domain), call)("ego", *args, **kwargs)
            assert f"The ADS called traci.{domain}.{call} with `{name}` = " in str(refused.value)
            assert str(refused.value).endswith("it must be a finite number")
            assert len(str(refused.value)) < 250
    GUARD.begin([], 0.05, "refuse")


# what libsumo takes without a word: measured
SILENT = rows_of(
    """
setSpeed | [NaN] | `speed` = nan | a finite number
slowDown | [10.0, -3.0] | `duration` = -3.0 | within 0..2147483648 s
setAcceleration | [1.0, -1.0] | `duration` = -1.0 | within 0..2147483648 s
setActionStepLength | [1000000000000.0] | `actionStepLength` = 1000000000000.0 | within 0..2147483648 s
openGap | [1.0, 1.0, -3.0, 1.0] | `duration` = -3.0 | within 0..2147483648 s
setStop | ["road", 500.0, 0, -4.0] | `duration` = -4.0 | within 0..2147483648 s
setStop | ["road", 500.0, 0, 4.0, 0, 0.0, -5.0] | `until` = -5.0 | within 0..2147483648 s
changeLane | [1000000, 1.0] | `laneIndex` = 1000000 | within 0..1, the lanes of its road
changeLane | [2, 1.0] | `laneIndex` = 2 | within 0..1, the lanes of its road
changeLane | [-1, 1.0] | `laneIndex` = -1 | within 0..1, the lanes of its road
changeLane | [1, -5.0] | `duration` = -5.0 | within 0..2147483648 s
changeLaneRelative | [2, 1.0] | `indexOffset` = 2 | within 0..1, the lanes of its road
changeLaneRelative | [-1, 1.0] | `indexOffset` = -1 | within 0..1, the lanes of its road
moveTo | ["nowhere", 60.0] | `laneID` = 'nowhere' | the id of a lane of the network
moveTo | ["road_0", 1000000.0] | `pos` = 1000000.0 | within 0..6000 m, the length of lane `road_0`
moveToXY | ["", 1000000, 60.0, 0.0] | `laneIndex` = 1000000 | within -1..1, the lanes of its road
setParameter | ["laneChangeModel.lcStrategic", "inf"] | `value` = 'inf' | a finite number
""",
    str,
    json.loads,
)


@pytest.mark.parametrize("call, args, argument, rule", SILENT)
@pytest.mark.parametrize("settings", [HALF_SECOND, RECORD], ids=["refuse", "record"])
def test_what_sumo_takes_in_silence_ends_the_case_with_call_and_argument(
    call, args, argument, rule, settings
):
    def drive(traci):
        try:
            getattr(traci.vehicle, call)("ego", *args)
        except Exception:  # noqa: BLE001 - as such scripts do
            return Command(0.0)

    found = simulate(case(lead(50.0)), once(drive), settings)
    assert found.end_reason == "ads_error"
    assert (
        found.error
        == f"The ADS called traci.vehicle.{call} with {argument} at 0.30 s; it must be {rule}."
    )
    assert_last(found, time=0.3)


@pytest.mark.parametrize("text", TEXTS)
def test_a_parameter_that_reads_as_no_number_is_refused(text):
    for write in (
        lambda traci: traci.vehicle.setParameter("ego", "laneChangeModel.lcStrategic", text),
        lambda traci: traci.vehicletype.setParameter("ego", "lcStrategic", text),
        lambda traci: traci.vehicle.setStopParameter("ego", 0, "duration", text),
    ):
        said = f"with `value` = {text!r} at 0.30 s; it must be a finite number"
        assert said in fault(once(write), lead(50.0))


@pytest.mark.parametrize("domain", ["edge", "lane", "simulation"])
def test_the_world_is_not_given_such_numbers_on_record_either(domain):
    write = {
        "edge": lambda traci: traci.edge.setMaxSpeed("road", math.nan),
        "lane": lambda traci: traci.lane.setMaxSpeed("road_0", math.nan),
        "simulation": lambda traci: traci.simulation.setScale(math.inf),
    }[domain]
    said = fault(once(write), lead(50.0), settings=RECORD)
    assert f"The ADS called traci.{domain}." in said
    assert "must be a finite number" in said


def test_the_type_of_the_ego_cannot_be_changed_by_a_copy():
    for name in ("ego", "like_the_lead"):

        def drive(traci, name=name):
            traci.vehicletype.copy("lead", "like_the_lead")
            traci.vehicletype.setMaxSpeed(name, math.nan)

        words = "traci.vehicletype.setMaxSpeed with `speed` = nan"
        assert words in fault(once(drive), lead(50.0))


ALLOWED = [
    ("changeLane", 1, LONGEST),
    ("changeLane", 1, 2**31 - 1),
    ("vehicle.changeLane", {"vehID": "ego", "laneIndex": 1, "duration": 0.0}),
    ("changeLaneRelative", 1, 3.0),
    ("setSpeed", 20),
    ("setSpeed", np.float64(20.0)),
    ("setSpeed", np.array([20.0], np.float32)),
    ("changeLane", np.int64(1), {"duration": np.float32(2.0)}),
    ("gui.trackVehicle", "View #0", "ego"),
    ("setSpeed", -1.0),
    ("vehicle.setSpeed", {"vehID": "ego", "speed": 1e9}),
    ("setStop", "road", 500.0),
    ("setStop", "road", 500.0, {"duration": -1073741824.0, "until": -1073741824.0}),
    ("setParameter", "my.note", "nancy drives to Infinite Loop"),
    ("setAdaptedTraveltime", "road"),
    ("setRoute", ("road",)),
    ("setColor", (1, 2, 3, 255)),
]


@pytest.mark.parametrize("call", ALLOWED)
def test_what_can_be_meant_goes_through(call):
    name, *args = call
    named = args.pop() if isinstance(args[-1], dict) else {}
    if "ego" not in (*args, *named.values()):
        args, name = ["ego", *args], f"vehicle.{name}"
    write = once(lambda traci: attrgetter(name)(traci)(*args, **named))
    assert_ended(simulate(case(lead(200.0)), write, replace(HALF_SECOND, time_limit=0.4)))


class Sly(Command):
    """A Command whose numbers cannot be read."""

    @property
    def acceleration(self):
        raise RuntimeError("no")


class Number(float):
    """A float that is not to be turned into one."""

    def __float__(self):
        raise RuntimeError("no")


class Mute(str):
    """A text that cannot be shown."""

    def __repr__(self):
        raise RuntimeError("no")


BAD = [
    math.nan, math.inf, -math.inf, 10**400, -(10**5000), Fraction(10**400), "1", None, True,
    np.bool_(True), 1j, [1.0],
    np.array([1.0]), np.array(math.nan), np.float32(math.nan), np.float64(math.inf),
    Number(math.nan),
    Mute("1"), object,
]  # fmt: skip
KINDS = [f"{place} {type(value).__name__}" for place, value in enumerate(BAD)]


@pytest.mark.parametrize("value", BAD, ids=KINDS)
@pytest.mark.parametrize("field", ["acceleration", "steering"])
def test_a_command_that_is_not_finite_is_the_adss_error(value, field):
    said = fault(once(lambda traci: Command(**{"acceleration": 0.0, field: value})))
    assert f"`{field}` of the ADS's Command must be a finite number, got " in said
    assert said.endswith(" at 0.30 s.")
    assert len(said) < 200


@pytest.mark.parametrize(
    "value",
    [1, 1.0, np.float32(1.0), np.float64(1.0), np.int64(1), np.uint8(1), Fraction(1, 1)],
)
def test_a_command_of_any_real_number_drives_as_the_float(value):
    found = half_second(lambda traci, ego, time: Command(value, 0 * value))
    meant = half_second(lambda traci, ego, time: Command(1.0, 0.0))
    assert_ended(found)
    assert found.ego.x.tobytes() == meant.ego.x.tobytes()


@pytest.mark.parametrize("command", [Sly(0.0), Command.__new__(Command)], ids=["raises", "empty"])
def test_a_command_that_cannot_be_read_is_the_adss_error(command):
    said = fault(once(lambda traci: command))
    assert said.startswith("The ADS's Command cannot be read (")
    assert said.endswith(") at 0.30 s.")


@pytest.mark.parametrize(
    "action",
    [10**400, (0.0, 10**400), [math.nan], "1", None, True, [], [1.0, 2.0, 3.0], {}, 1j],
    ids=range(10),
)
def test_an_action_that_is_not_finite_is_the_adss_error(action):
    said = fault(lambda observation: action)
    words = "The action of the ADS must be a Command, an acceleration or (acceleration, steering)"
    assert words in said
    assert said.endswith(" at 0.00 s.")


def test_commands_as_large_as_floats_get_are_clipped_and_on_record():
    found = half_second(lambda traci, ego, time: Command(-1.7e308, 1.7e308))
    assert found.error is None
    clips = clips_of(found)
    assert clips["acceleration"].requested == -1.7e308
    assert clips["steering_angle"].requested == 1.7e308
    assert np.isfinite(found.ego.speed).all()
    assert ROAD.right_edge < found.ego.y.max() < ROAD.left_edge + 1.0


@pytest.mark.parametrize(
    "arguments, sentence",
    [((20.0, 3.0), "vehicle.setSpeed() takes 2 positional arguments"), ((None,), "argument 2")],
)
def test_wrong_arguments_get_the_message_of_traci(arguments, sentence):
    def drive(traci, ego, time):
        traci.vehicle.setSpeed(ego, *arguments)

    assert sentence in fault(drive, lead(50.0))
