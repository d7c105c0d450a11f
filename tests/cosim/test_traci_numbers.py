"""No silent number: whatever an ADS writes through TraCI is finite, a lane that is there, a time
that can be meant."""

import inspect
import json
import math
from dataclasses import replace
from fractions import Fraction
from operator import attrgetter

import libsumo
import numpy as np
import pytest
from cosim_cases import HALF_SECOND, ROAD, assert_whole, case, lead, once
from tables import rows_of
from traci._vehicle import VehicleDomain
from traci._vehicletype import VehicleTypeDomain

from sumo_eval.cosim.doors.traci_module import GUARD, TRACI, RefusedCallError
from sumo_eval.cosim.doors.traci_numbers import ARGUMENTS, LONGEST, breach
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.sumo.session import session
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.settings import ConditionSettings

RECORD = replace(HALF_SECOND, conditions=ConditionSettings(interference="record"))
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
        told = tuple(inspect.signature(getattr(of_traci, call)).parameters)[2:]
        assert names == told, call


@pytest.mark.parametrize("domain, call", CALLS, ids=[f"{domain}.{call}" for domain, call in CALLS])
def test_numbers_of_the_ordinary_course_are_none_of_the_rules_business(domain, call):
    with session(case(lead(50.0)), HALF_SECOND):
        assert breach(domain, call, "ego", harmless(domain, call), {}) is None


@pytest.fixture
def running():
    with session(case(lead(50.0)), HALF_SECOND) as traci:
        yield traci


@pytest.mark.parametrize(
    "domain, call, place",
    ARGUMENTS_OF_NUMBERS,
    ids=["-".join(map(str, one)) for one in ARGUMENTS_OF_NUMBERS],
)
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


@pytest.mark.parametrize(
    "call, args, argument, rule", SILENT, ids=[f"{it[0]}-{it[2]}" for it in SILENT]
)
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
    assert found.ego.time[-1] == pytest.approx(0.3)


@pytest.mark.parametrize("text", TEXTS)
def test_a_parameter_that_reads_as_no_number_is_refused(text):
    for write in (
        lambda traci: traci.vehicle.setParameter("ego", "laneChangeModel.lcStrategic", text),
        lambda traci: traci.vehicletype.setParameter("ego", "lcStrategic", text),
        lambda traci: traci.vehicle.setStopParameter("ego", 0, "duration", text),
    ):
        found = simulate(case(lead(50.0)), once(write), HALF_SECOND)
        assert found.end_reason == "ads_error"
        assert f"with `value` = {text!r} at 0.30 s; it must be a finite number" in found.error


@pytest.mark.parametrize("domain", ["edge", "lane", "simulation"])
def test_the_world_is_not_given_such_numbers_on_record_either(domain):
    write = {
        "edge": lambda traci: traci.edge.setMaxSpeed("road", math.nan),
        "lane": lambda traci: traci.lane.setMaxSpeed("road_0", math.nan),
        "simulation": lambda traci: traci.simulation.setScale(math.inf),
    }[domain]
    found = simulate(case(lead(50.0)), once(write), RECORD)
    assert found.end_reason == "ads_error"
    assert f"The ADS called traci.{domain}." in found.error
    assert "must be a finite number" in found.error


def test_the_type_of_the_ego_cannot_be_changed_by_a_copy():
    for name in ("ego", "like_the_lead"):

        def drive(traci, name=name):
            traci.vehicletype.copy("lead", "like_the_lead")
            traci.vehicletype.setMaxSpeed(name, math.nan)

        found = simulate(case(lead(50.0)), once(drive), HALF_SECOND)
        assert found.end_reason == "ads_error"
        assert "traci.vehicletype.setMaxSpeed with `speed` = nan" in found.error


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


@pytest.mark.parametrize("call", ALLOWED, ids=range(len(ALLOWED)))
def test_what_can_be_meant_goes_through(call):
    name, *args = call
    named = args.pop() if isinstance(args[-1], dict) else {}
    if "ego" not in (*args, *named.values()):
        args, name = ["ego", *args], f"vehicle.{name}"
    write = once(lambda traci: attrgetter(name)(traci)(*args, **named))
    assert_whole(simulate(case(lead(200.0)), write, replace(HALF_SECOND, time_limit=0.4)))


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
    found = simulate(
        case(), once(lambda traci: Command(**{"acceleration": 0.0, field: value})), HALF_SECOND
    )
    assert found.end_reason == "ads_error"
    assert f"`{field}` of the ADS's Command must be a finite number, got " in found.error
    assert found.error.endswith(" at 0.30 s.")
    assert len(found.error) < 200


@pytest.mark.parametrize(
    "value",
    [1, 1.0, np.float32(1.0), np.float64(1.0), np.int64(1), np.uint8(1), Fraction(1, 1)],
    ids=lambda it: repr(it),
)
def test_a_command_of_any_real_number_drives_as_the_float(value):
    found = simulate(case(), lambda traci, ego, time: Command(value, 0 * value), HALF_SECOND)
    meant = simulate(case(), lambda traci, ego, time: Command(1.0, 0.0), HALF_SECOND)
    assert_whole(found)
    assert found.ego.x.tobytes() == meant.ego.x.tobytes()


@pytest.mark.parametrize("command", [Sly(0.0), Command.__new__(Command)], ids=["raises", "empty"])
def test_a_command_that_cannot_be_read_is_the_adss_error(command):
    found = simulate(case(), once(lambda traci: command), HALF_SECOND)
    assert found.end_reason == "ads_error"
    assert found.error.startswith("The ADS's Command cannot be read (")
    assert found.error.endswith(") at 0.30 s.")


@pytest.mark.parametrize(
    "action",
    [10**400, (0.0, 10**400), [math.nan], "1", None, True, [], [1.0, 2.0, 3.0], {}, 1j],
    ids=range(10),
)
def test_an_action_that_is_not_finite_is_the_adss_error(action):
    found = simulate(case(), lambda observation: action, HALF_SECOND)
    assert found.end_reason == "ads_error"
    assert (
        "The action of the ADS must be a Command, an acceleration or (acceleration, steering)"
        in found.error
    )
    assert found.error.endswith(" at 0.00 s.")


def test_commands_as_large_as_floats_get_are_clipped_and_on_record():
    found = simulate(case(), lambda traci, ego, time: Command(-1.7e308, 1.7e308), HALF_SECOND)
    assert found.error is None
    clips = {clip.what: clip for clip in found.clips}
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

    found = simulate(case(lead(50.0)), drive, HALF_SECOND)
    assert found.end_reason == "ads_error"
    assert sentence in found.error
