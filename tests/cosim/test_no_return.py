"""The point of no return: closed forms, monotone in time, and when there is none."""

import itertools
import math
from dataclasses import replace

import pytest
from road_scenes import ROAD, actor, case, lead

from sumo_eval.cosim import Command, no_return
from sumo_eval.cosim.ego_control import Replay
from sumo_eval.cosim.no_return import with_no_return
from sumo_eval.cosim.simulation import simulate, simulate_many, simulate_together
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.road.reference_line import arc
from sumo_eval.scenario.sampling.samples import Request, sample
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import NEVER, NO_RETURN

USUAL = SimulationSettings()
STRONGEST, RAMP = USUAL.vehicle.max_deceleration, USUAL.vehicle.brake_build_up


def clip_of(recording):
    (clip,) = (clip for clip in recording.clips if clip.what == NO_RETURN)
    return clip


def drives_on(traci, ego, time):
    traci.vehicle.setSpeed(ego, 25.0)


def changes_lane(traci, ego, time):
    """By SUMO's own control: to the left, and more slowly from 1.5 s on."""
    traci.vehicle.setSpeed(ego, 25.0 if time < 1.5 else 20.0)
    if time == 0.5:
        traci.vehicle.changeLane(ego, 1, 2.0)


@pytest.mark.parametrize("closing", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("controller", ["no_reaction", drives_on])
def test_constant_speeds_have_the_closed_form(controller, closing):
    """Braking with a linear ramp needs D Tr - a Tr^2 / 6 + (D - a Tr / 2)^2 / (2 a)."""
    needed = (
        closing * RAMP
        - STRONGEST * RAMP**2 / 6
        + (closing - STRONGEST * RAMP / 2) ** 2 / (2 * STRONGEST)
    )
    concrete = case(lead(60.0, speed=25.0 - closing), speed=25.0)
    (found,) = with_no_return([simulate(concrete, controller)], [concrete], USUAL)
    exact = (60.0 - needed) / closing
    assert exact - USUAL.step - 1e-6 <= clip_of(found).first_time <= exact
    assert clip_of(found).requested == NEVER


def test_braking_avoids_up_to_the_point_and_not_afterwards():
    cut_in = catalogue.load("cut_in")
    drawn = sample(cut_in, "latin_hypercube", request=Request(count=60, seed=1)).points
    cases = cut_in.concretes(drawn)
    drives = list(simulate_many(cases, "careful_driver", USUAL))
    looked_at = 0
    for concrete, found in zip(cases, with_no_return(drives, cases, USUAL), strict=True):
        if found.collision is None or clip_of(found).first_time < 0.0 or looked_at == 3:
            continue
        looked_at += 1
        steps = len(found.commands)
        last = round(clip_of(found).first_time / USUAL.step)
        every = [Replay(found.commands, step) for step in range(steps + 1)]
        braked = list(simulate_together([concrete] * len(every), every, USUAL))
        assert [it.collision is None for it in braked] == [
            step <= last for step in range(steps + 1)
        ]
        assert repr(braked[-1].collision) == repr(found.collision)
        assert braked[-1].ego.x.tobytes() == found.ego.x.tobytes()
    assert looked_at == 3


def test_an_ego_that_sumo_moves_is_replayed_where_it_was():
    concrete = case(lead(60.0, speed=5.0, y=3.5), speed=25.0)
    drive = simulate(concrete, changes_lane)
    (found,) = with_no_return([drive], [concrete], USUAL)
    steps, last = len(drive.commands), round(clip_of(found).first_time / USUAL.step)
    tried = [last, last + 1, steps]
    braked = list(
        simulate_together([concrete] * 3, [Replay(drive.commands, step) for step in tried], USUAL)
    )
    assert [it.collision is None for it in braked] == [True, False, False]
    assert repr(braked[-1].collision) == repr(drive.collision)
    assert braked[-1].ego.x.tobytes() == drive.ego.x.tobytes()
    assert clip_of(found).requested == 1.5


def test_an_ego_that_is_turned_between_two_steps_is_replayed():
    """The ADS's command takes over from SUMO in the step of the contact, on a curve."""
    steps = itertools.count()

    def alternates(traci, ego, time):
        if next(steps) % 2:
            return Command(0.0, 16.0 * math.atan(2.7 / 100.0))
        traci.vehicle.setSpeedMode(ego, 0)
        traci.vehicle.setSpeed(ego, 20.0)
        return None

    road = replace(ROAD, name="curve", run_out=900.0, line=(arc(1000.0, 100.0),))
    concrete = replace(case(lead(60.0, 5.0)), road=road)
    drive = simulate(concrete, alternates)
    (found,) = with_no_return([drive], [concrete], USUAL)
    assert 3.0 < clip_of(found).first_time < drive.collision.time


def test_without_room_nothing_helps():
    tight = case(lead(2.0, speed=5.0), speed=25.0)
    for controller in ("no_reaction", drives_on):
        (found,) = with_no_return([simulate(tight, controller)], [tight], USUAL)
        assert repr(clip_of(found).first_time) == repr(NEVER)


@pytest.mark.parametrize("standstill_time", [None, 0.1])
def test_braking_to_a_stop_does_not_avoid_a_vehicle_behind(standstill_time):
    """It comes when the ego has stood for longer than a case lasts."""
    concrete = replace(
        case(lead(100.0, speed=5.0), actor("chaser", -39.0, speed=10.0), speed=20.0),
        standstill_time=standstill_time,
    )
    (found,) = with_no_return([simulate(concrete, "idm")], [concrete], USUAL)
    assert found.collision.other == "chaser"
    assert clip_of(found).first_time == NEVER


@pytest.mark.parametrize("hole", [1, 3, 8, 9])
def test_other_contacts_of_a_batch_do_not_move_the_point(hole, monkeypatch):
    """Even where braking at a step, `hole` before the point, does not avoid the contact."""
    concrete = case(lead(60.0, speed=5.0), speed=25.0)
    drive = simulate(concrete, "no_reaction")
    last = round(clip_of(with_no_return([drive], [concrete], USUAL)[0]).first_time / USUAL.step)

    def braked(contacts, trials, settings):
        return [None if step <= last and step != last - hole else drive.collision
                for _, step in trials]  # fmt: skip

    monkeypatch.setattr(no_return, "_braked", braked)
    alone, *together = (
        clip_of(found).first_time
        for count in (1, 12)
        for found in with_no_return([drive] * count, [concrete] * count, USUAL)
    )
    assert together == [alone] * 12
