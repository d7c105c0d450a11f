"""The contract as a function: what every controller that ships keeps, and how one that breaks it is told."""

import itertools
import time as clock

import pytest

from sumo_eval.cosim import Command
from sumo_eval.cosim.contract import check_controller
from sumo_eval.cosim.controller import SHIPPED
from sumo_eval.scenario import catalogue
from sumo_eval.settings import SimulationSettings

CASES = [
    catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20.0, lead_speed=5.0),
    catalogue.load("front_vehicle_cut_out").concrete(ego_speed=25.0, obstacle_speed=10.0, gap=60.0),
]
SHORT = SimulationSettings(time_limit=12.0)


def failures(controller, **kwargs):
    return [f for f in check_controller(controller, CASES, SHORT, **kwargs) if f.kind == "FAIL"]


@pytest.mark.parametrize("locator", [*SHIPPED, "sumo:Krauss", "sumo:IDM?tau=1.2"])
def test_every_controller_that_ships_keeps_the_contract(locator):
    assert failures(locator) == []


def test_what_is_remembered_from_case_to_case_is_found():
    count = itertools.count()

    class Remembers:
        def step(self, traci, ego, time):
            return Command(-0.0001 * next(count))

    found = failures(Remembers)
    assert len(found) == 2
    assert "the second drive differs from 0.05 s on" in found[0].text
    assert "forget everything in reset" in found[0].mend


def test_numbers_that_no_vehicle_can_follow_are_found():
    (found,) = failures(lambda seen: -300.0)
    assert "asks for -300 m/s2, the vehicle gives -9" in found.text
    assert "check units" in found.mend


def test_a_command_a_little_too_strong_is_a_note():
    found = check_controller(lambda seen: -12.0, CASES, SHORT)
    assert [f.kind for f in found if "asks for" in f.text] == ["note"]


@pytest.mark.parametrize(
    ("ads", "sentence"),
    [
        (lambda traci, ego, time: Command(float("nan")), "must be a finite number, got nan"),
        (lambda traci, ego, time: 1 / 0, "ZeroDivisionError"),
        (
            lambda traci, ego, time: traci.vehicle.setSpeed("lead", 1.0),
            "The ADS called traci.vehicle.setSpeed for `lead`",
        ),
    ],
)
def test_an_error_is_told_with_its_case(ads, sentence):
    assert len(failures(ads)) == 2
    assert all(sentence in finding.text for finding in failures(ads))


def test_a_slow_step_is_told():
    found = failures(lambda seen: clock.sleep(0.05) or 0.0, step_timeout=0.02)
    assert "must answer within 0.02 s" in found[0].text
    assert "step_timeout" in found[0].mend
