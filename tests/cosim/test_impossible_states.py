"""No impossible position: what SUMO answers for a vehicle that it has lost is never recorded as its
state."""

import math
from collections import Counter
from dataclasses import replace

import libsumo
import numpy as np
import pytest
from road_scenes import (
    HALF_SECOND,
    ROAD,
    assert_as_alone,
    assert_ended,
    case,
    clips_of,
    lead,
    once,
    under,
)

from sumo_eval.cosim import Command, simulate, simulate_many
from sumo_eval.scenario import Actor, Start, brake_to_stop, constant_lateral, lane_change
from sumo_eval.scenario.played import CONSTANT, PATH, Act
from sumo_eval.settings import SimulationSettings

FOUR_SECONDS = SimulationSettings(time_limit=4.0)
LOST = -1073741824.0  # SUMO's place and speed of a vehicle that is on no lane
OFF_ROAD = {
    "right": (lane_change(0.5, 1.0, -4.5),),
    "left": (lane_change(0.5, 1.5, 9.0),),
    "twice": (lane_change(0.2, 1.0, -4.0), lane_change(2.0, 1.0, -3.0)),
    "and back": (lane_change(0.2, 1.0, -4.0), lane_change(2.0, 1.0, 4.0)),
    "sliding": (constant_lateral(0.5, 3.0, -4.5),),
}


def leaver(moves, **keywords):
    slides = moves[0].kind == CONSTANT
    return Actor("leaver", Start(120.0, 0.0, 15.0), moves, slides=slides, **keywords)


def follow(traci, ego, time):
    return Command(0.0)


def alone(*actors, controller=follow, settings=FOUR_SECONDS, **start):
    return simulate(case(*actors, **start), controller, settings)


def physical(recording):
    """Whether every sample is a state that a vehicle on this road can have."""
    channels = [
        (getattr(one, name), most)
        for one in (recording.ego, *recording.actors.values())
        for name, most in (("x", 7000.0), ("y", 50.0), ("heading", math.pi), ("speed", 70.0))
    ]
    return all((np.abs(values) <= most).all() for values, most in channels)


@pytest.mark.parametrize("kind", list(OFF_ROAD))
@pytest.mark.parametrize("controller", [follow, lambda traci, ego, time: None, "sumo:IDM"])
def test_a_vehicle_that_its_script_takes_off_the_lanes_stays_on_its_script(kind, controller):
    actor = leaver(OFF_ROAD[kind])
    found = alone(actor, controller=controller)
    assert_ended(found)
    track = found.actors["leaver"]
    np.testing.assert_allclose(track.x, [actor.x(time) for time in track.time], rtol=0, atol=0.02)
    np.testing.assert_allclose(track.y, [actor.y(time) for time in track.time], rtol=0, atol=0.02)
    assert "actor_off_its_script" not in clips_of(found)


def test_a_long_vehicle_turns_back_in_a_short_step():
    turns = leaver((Act(PATH, 0.2, table=((100.0, 0.0),)),), length=12.0)
    assert_ended(alone(turns, settings=replace(HALF_SECOND, step=0.01)))


def test_a_vehicle_that_brakes_to_a_stand_off_the_lanes_stays_there():
    actor = leaver((lane_change(0.2, 1.0, -4.5), brake_to_stop(0.5, 8.0)))
    found = alone(actor)
    assert found.error is None
    track = found.actors["leaver"]
    np.testing.assert_allclose(track.x[-1], actor.x(4.0), rtol=0, atol=1e-3)
    assert track.speed[-1] == 0.0


def test_batches_hold_vehicles_off_the_lanes_to_the_last_bit():
    cases = [
        case(leaver(moves), speed=15.0 + place) for place, moves in enumerate(OFF_ROAD.values())
    ]
    left = Counter()
    packed = list(simulate_many(cases, "no_reaction", FOUR_SECONDS, alone=left))
    assert not left
    for together in packed:
        assert physical(together)
        assert_ended(together)
    assert_as_alone(cases, packed, "no_reaction", FOUR_SECONDS)


def test_a_vehicle_7_cm_before_the_end_of_the_lanes_has_left():
    """SUMO removes it within 0.1 m of the end: no ADS has."""
    actor = Actor("early", Start(ROAD.end - 2.25 - 0.07 - 5.5, 0.0, 5.5))
    assert_ended(alone(actor, controller=lambda traci, ego, time: None))


def test_a_braking_vehicle_that_passes_the_end_of_the_lanes_has_left_the_network():
    short = replace(case(lead(100.0)), road=replace(ROAD, length=300.0, run_out=0.0))
    actor = Actor("gone", Start(280.0, 0.0, 20.0), (brake_to_stop(0.1, 8.0),))  # stands beyond it
    found = simulate(
        replace(short, actors=(actor,)), lambda traci, ego, time: Command(0.0), FOUR_SECONDS
    )
    assert found.error is None
    assert "actor_left_the_network" in clips_of(found)
    assert physical(found)


# --- the ego --------------------------------------------------------------------------------------


def crabs_off(traci, ego, time):
    """An ADS of moveToXY that turns right as sharply as is possible, then lets go where SUMO has
    the front bumper beside the lanes."""
    x, y = traci.vehicle.getPosition(ego)
    if time < 1.15:
        traci.vehicle.setSpeed(ego, 8.0)
        degrees = min(60.0, 140.0 * (time + 0.05))
        angle = math.radians(degrees)
        x, y = x + 0.4 * math.cos(angle), y - 0.4 * math.sin(angle)
        traci.vehicle.moveToXY(ego, "", -1, x, y, 90.0 + degrees, 2)


@pytest.mark.parametrize("y", [0.0, 3.5])
def test_an_ego_of_traci_calls_that_sumo_has_lost_beside_the_road_ended_off_the_road(y):
    found = alone(controller=crabs_off, y=y, speed=8.0)
    assert physical(found)
    # from the left lane SUMO loses it first
    assert (found.ego.y[-1] > ROAD.right_edge) == (y > 0.0)
    assert_ended(found, "off_road")


def test_an_ego_discarded_beside_the_lanes_ended_off_the_road():
    def drive(traci, ego, time):
        return Command(0.0, -8.0) if traci.vehicle.getPosition(ego)[1] > -2.7 else None

    found = alone(controller=drive, speed=4.0)
    # its centre is on the road, and SUMO has lost it all the same
    assert ROAD.right_edge < found.ego.y[-1]
    assert physical(found)
    assert_ended(found, "off_road")


@pytest.mark.parametrize(
    "controller", [lambda seen: 0.0, lambda traci, ego, time: Command(0.0, 1.0)]
)
def test_an_ego_of_commands_never_gets_where_sumo_would_lose_it(controller):
    found = alone(leaver(OFF_ROAD["right"]), controller=controller)
    assert physical(found)
    assert found.error is None
    assert found.end_reason in ("off_road", "time_limit")


def lose(name):
    """Put a vehicle where SUMO has no lane, and leave it there."""
    x, y = libsumo.vehicle.getPosition(name)
    libsumo.vehicle.moveToXY(name, "road", 0, x, y - 40.0, 90.0, 2)


@pytest.mark.parametrize("call", ["changeLane", "moveToXY", "setLateralLanePosition", "add"])
def test_law_sumo_alone_may_put_an_ego_on_a_lanes_centre(call):
    """A lane change that began 0.4 m beside the centre ends with a shift by 0.4 m."""

    def shifts(traci, ego, time):
        v, x = traci.vehicle, traci.vehicle.getPosition(ego)[0]
        speed = v.getSpeed(ego)
        v.setSpeed(ego, speed)
        if call == "changeLane" and time == 0.0:
            v.changeLane(ego, 1, 2.0)
        if call == "moveToXY" and time == 1.0:
            v.moveToXY(ego, "", -1, x + 0.05 * speed, 0.0, 90.0, 2)
        if call == "setLateralLanePosition" and time == 1.0:
            v.setLateralLanePosition(ego, 0.0)
        if call == "add" and time == 1.0:
            route, kind = v.getRouteID(ego), v.getTypeID(ego)
            v.remove(ego)
            v.add(ego, route, typeID=kind, departPos=f"{x + 2.0}", departSpeed="20")

    found = alone(controller=shifts, settings=SimulationSettings(time_limit=8.0), y=-0.4)
    innocent = call == "changeLane"
    assert (found.end_reason == "ads_error") != innocent
    assert ("jump" in clips_of(found)) == innocent


def test_a_vehicle_that_sumo_has_lost_ends_the_case_with_its_name_its_place_and_the_time():
    found = alone(lead(50.0, speed=20.0), controller=once(lambda traci: lose("lead")))
    assert found.end_reason == "sim_error"
    assert (
        "SUMO gave vehicle `lead` the place (-1.07374e+09, -1.07374e+09) m, a step after ("
        in found.error
    )
    assert found.error.endswith(" m, at 0.40 s, which no vehicle can have.")
    assert (np.abs(found.actors["lead"].y) < 50.0).all()


def test_a_jump_no_vehicle_can_do_ends_the_case_also_where_touching_others_is_on_record():
    settings = under(interference="record")

    far = once(lambda traci: traci.vehicle.moveTo("lead", "road_0", 4000.0))
    found = alone(lead(50.0, speed=20.0), controller=far, settings=settings)
    assert_ended(found, "sim_error", "SUMO gave vehicle `lead` the place (40")


@pytest.mark.parametrize(
    "name, answer", [("ego", None), ("lead", None), ("lead", Command(0.0))], ids=str
)
def test_a_place_that_is_not_a_number_is_sumos_error(name, answer):
    """Also beside an ego that its own commands place."""

    def drive(traci, ego, time):
        if abs(time - 0.3) < 1e-9:
            libsumo.vehicle.setLateralLanePosition(name, math.nan)
        return answer

    found = alone(lead(50.0, speed=20.0), controller=drive)
    assert_ended(found, "sim_error", f"SUMO gave vehicle `{name}` the place (")
    assert "nan" in found.error
    assert physical(found)


def test_a_native_ego_that_sumo_has_lost_in_mid_road_is_sumos_error():
    """`sumo:` models run no code of a user's, so the loss is made by a listener of libsumo's
    own."""

    found = after_a_listener(
        lambda: libsumo.vehicle.setLateralLanePosition("ego", math.nan), "sumo:IDM"
    )
    assert_ended(found, "sim_error", "SUMO gave vehicle `ego` the place (")
    assert physical(found)


def after_a_listener(action, controller=follow):
    """What a drive comes to when a listener of libsumo's does something between SUMO's step at 0.5
    s and our look."""

    class Acts(libsumo.StepListener):
        def step(self, t=0):
            if abs(libsumo.simulation.getTime() - 0.5) < 1e-9:
                action()
            return True

    number = libsumo.addStepListener(Acts())
    try:
        return alone(lead(50.0, speed=20.0), controller=controller)
    finally:
        libsumo.removeStepListener(number)


def too_fast(name):
    libsumo.vehicle.setPreviousSpeed(name, 5000.0)


def turned_to_nan(name):
    place = libsumo.vehicle.getPosition(name)
    libsumo.vehicle.moveToXY(name, "road", 0, *place, math.nan, 2)


IMPOSSIBLE = {too_fast: "speed 5000 m/s at 0.45 s", turned_to_nan: "angle nan deg at 0.50 s"}


@pytest.mark.parametrize("act", IMPOSSIBLE)
@pytest.mark.parametrize(
    "name, controller", [("lead", follow), ("lead", "sumo:IDM"), ("ego", "sumo:IDM")]
)
def test_a_speed_or_an_angle_no_vehicle_can_have_ends_the_case(act, name, controller):
    """The place of the vehicle is possible."""
    found = after_a_listener(lambda: act(name), controller)
    assert found.end_reason == "sim_error"
    said = f"SUMO gave vehicle `{name}` the {IMPOSSIBLE[act]}, which no vehicle can have."
    assert found.error == said
    assert physical(found)


def test_a_native_ego_that_jumps_further_than_anything_drives_ends_the_case():
    found = after_a_listener(lambda: libsumo.vehicle.moveTo("ego", "road_0", 4000.0), "sumo:IDM")
    assert found.end_reason == "sim_error"
    # 20 m/s for 0.45 s from the start, then to 4,000 m: the words name the way of that one step
    assert "SUMO moved vehicle `ego` 39" in found.error
    assert found.error.endswith(" m in the step after 0.45 s.")
    assert found.ego.x[-1] < 100.0, "the jump is no sample"
