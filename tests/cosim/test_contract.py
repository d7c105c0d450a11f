"""The contract as a function: what every controller that ships keeps, and how one that breaks it is
told."""

import math
import time as clock

import pytest
from refusals import refusal
from road_scenes import HALF_SECOND, at_values, case

from sumo_eval.cosim.doors.contract import check_controller
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.settings import SimulationSettings

CASES = [
    at_values("front_vehicle_low_speed", ego_speed=20.0, lead_speed=5.0),
    at_values("front_vehicle_cut_out", ego_speed=25.0, obstacle_speed=10.0, gap=60.0),
]
SHORT = SimulationSettings(time_limit=12.0)


def failures(controller, **kwargs):
    return [f for f in check_controller(controller, CASES, SHORT, **kwargs) if f.kind == "FAIL"]


@pytest.mark.parametrize("locator", [*SHIPPED, "sumo:Krauss", "sumo:IDM?tau=1.2"])
def test_every_controller_that_ships_keeps_the_contract(locator):
    assert failures(locator) == []


def test_a_check_needs_a_case():
    with refusal("`cases` of `check_controller` must be at least one"):
        check_controller("idm", [])


@pytest.mark.parametrize("asked", [-300.0, -12.0])
def test_commanding_more_than_the_vehicle_can_do_is_a_warning_with_the_clip(asked):
    ads = lambda seen: asked if seen.desired_speed == 20.0 else -10.0  # noqa: E731 - the worst counts
    found = check_controller(ads, CASES, SHORT)
    (warning,) = [f for f in found if f.kind == "warn"]
    assert f"asks for {asked:g} m/s2, the vehicle gives -9" in warning.text
    assert "counts that as clips" in warning.mend
    assert not any(f.kind == "FAIL" for f in found)


def test_losses_to_case_timeout_are_reported_with_the_pace():
    """55 ms a step at 20 steps a second: 1.1 s of wall time a simulated second, so 2 s reach for
    less than 2 s."""
    short = SimulationSettings(time_limit=2.5)
    (lost,
        ) = [f for f in check_controller(lambda seen: clock.sleep(0.055) or 0.0, CASES, short,
            case_timeout=2.0)
               if f.kind == "FAIL"]  # fmt: skip
    assert (
        "`run` would lose 2 of these 2 cases to case_timeout = 2 s, e.g. front_vehicle_low_speed"
        in lost.text
    )
    assert "a case may simulate" in lost.text


def test_a_case_as_long_as_the_time_limit_is_projected():
    """At 20 ms a step, 20 steps a second, a second takes 0.4 s of wall time: 600 s as the time
    limit take 240 s."""
    case, slow = CASES[:1], lambda seen: clock.sleep(0.02) or -8.0
    (note,) = [
        f
        for f in check_controller(slow, case, SimulationSettings(time_limit=600.0))
        if "time limit" in f.text
    ]
    assert note.kind == "note"
    assert "`run` would lose a case that lasts until the time limit of 600 s" in note.text
    (fine,) = [
        f for f in check_controller(lambda seen: -8.0, case, SHORT) if "would lose none" in f.text
    ]
    assert fine.kind == "ok"


class Faulty:
    """Answers that cannot be used, by the number of the fault."""

    def __init__(self, fault):
        self.fault = fault

    def act(self, seen):
        return [
            lambda: "fast",
            lambda: math.nan,
            lambda: seen.leed.gap,
            lambda: 1 / 0,
            lambda: [1, 2, 3],
            lambda: seen.speed,
        ][self.fault]()


@pytest.mark.parametrize("fault", range(6))
def test_a_cause_is_reported_once_with_count_and_line(fault):
    speeds = (10.0, 20.0, 30.0)
    cases = [case(speed=speed) for speed in speeds]
    found = [
        one for one in check_controller(Faulty(fault), cases, HALF_SECOND) if one.kind == "FAIL"
    ]
    assert len(found) == 1
    assert "3 of 3 cases" in found[0].text
    assert "test_contract.py:" in found[0].text
    assert "Traceback" not in found[0].text
    assert "loop.py" not in found[0].text
    meant = {2: "lead", 5: "ego.speed"}.get(fault)
    assert meant is None or f"(did you mean `{meant}`?)" in found[0].text


def nothing(seen):
    return 0.0


def test_hints_name_what_traci_code_is_written_with():
    def stranger(traci, ego, time):
        traci.vehicle.setSpeed("veh0", 3.0)

    def typed(traci, ego, time):
        traci.vehicle.setType(ego, "CC")

    def sensing(traci, ego, time):
        traci.vehicle.getParameter(ego, "device.ssm.minTTC")

    def still(traci, ego, time):
        traci.vehicle.getSpeed(ego)

    def decorated(*args):
        return nothing(*args)

    hints = {stranger: "`ego`", typed: "`vehicle_type`", sensing: "device", still: "(ego, -1)"}
    hints[decorated] = "functools.wraps"
    for code, word in hints.items():
        found = check_controller(code, [case()], HALF_SECOND)
        assert word in next(it.mend for it in found if it.kind in ("FAIL", "note")), found
