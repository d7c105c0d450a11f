"""Synthetic drivers at the wheel: what they know and when, what they do, and that they do it
again."""

from dataclasses import replace

import numpy as np
import pytest
from drivers.populations import draw_population, synthetic_reference
from refusals import refusal
from road_scenes import (
    Mover,
    actor,
    assert_last,
    at_point,
    case,
    clear_drive,
    cut_outs_at_the_edge,
    fresh,
    low_speed,
    mover,
    safe_cut_outs,
)

from sumo_eval.ads.perception import carry_on
from sumo_eval.cosim import simulate
from sumo_eval.cosim.records import MOVER
from sumo_eval.drivers.synthetic.driver import (
    ATTENTION,
    LOOK,
    LOOKS,
    Mind,
    SyntheticDriver,
    attend,
    human_controller,
)
from sumo_eval.drivers.synthetic.population import draw_driver
from sumo_eval.method.anthropomorphic import count_operations
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.trajectory import CHANNELS

DRIVERS = draw_population(10, seed=1)
DRIVER = replace(DRIVERS[0], reaction_time=1.0)  # alerted: 0.56 s
CUT_OUT = at_point("front_vehicle_cut_out", 25.0, 10.0, 80.0)
STEP = 0.05


class Attention:
    """One driver's attention: what he remembers of each vehicle by its name."""

    def __init__(self, driver):
        self.driver = driver
        self.state, self.memories = fresh(ATTENTION), {}
        self.state.attends = 0

    def known(self, me, others, time):
        """The vehicles that he acts upon; those that were seen and are out of sight now stand where
        nobody is."""
        for other in others:
            self.memories.setdefault(
                other.name, (fresh(LOOKS), [fresh(LOOK) for _ in range(60)], fresh(MOVER))
            )
        here = {other.name: other for other in others}
        away = mover("", float("nan"))
        scene = [here.get(name, away) for name in self.memories]
        memories, looks, known = zip(*self.memories.values(), strict=True)
        attend(self.state, me, scene, Mind(looks, memories, known, None, None), self.driver, time)
        found = zip(self.memories, known, strict=True)
        return [
            Mover(name=name, **{k: v for k, v in vars(it).items() if k != "speed"})
            for name, it in found
            if it.x == it.x
        ]


def known_since(scenes, name):
    """Time at which the driver first acts upon a vehicle.

    scenes: time -> the others, with the ego at 20 m/s.
    """
    attention = Attention(DRIVER)
    for count in range(80):
        time = count * STEP
        me = mover("ego", 20.0 * time)
        if any(other.name == name for other in attention.known(me, scenes(time), time)):
            return time
    return None


def same_speed(time):
    return mover("lead", 30.0 + 20.0 * time)


def test_a_steady_scene_is_taken_in_within_the_reaction_time():
    assert known_since(lambda time: (same_speed(time),), "lead") == pytest.approx(1.0)


def test_a_vehicle_that_is_closed_upon_is_taken_in_within_the_alerted_reaction_time():
    assert known_since(
        lambda time: (mover("slow", 80.0 + 10.0 * time, along=10.0),), "slow"
    ) == pytest.approx(0.6)


def test_a_vehicle_that_crosses_is_taken_in_within_the_alerted_reaction_time():
    def scenes(time):
        return (same_speed(time)._replace(y=0.4 * time, across=0.4),)

    assert known_since(scenes, "lead") == pytest.approx(0.6)


def test_a_vehicle_that_appears_is_known_one_alerted_reaction_time_later():
    def scenes(time):
        return (
            (same_speed(time), mover("new", 90.0 + 20.0 * time, y=3.5))
            if time > 1.99
            else (same_speed(time),)
        )

    assert known_since(scenes, "new") == pytest.approx(2.0 + 0.6)


def test_a_hidden_vehicle_is_unknown_until_a_lamp_of_it_shows():
    def scenes(time):
        lead = same_speed(time)._replace(y=0.5 * time, across=0.5)
        return lead, mover("hidden", 90.0 + 20.0 * time)

    shows = 2.0 * 0.9 * 0.3 / 0.5  # s, when the lead has moved by 30 % of the width
    assert known_since(scenes, "hidden") == pytest.approx(shows + 0.56, abs=2 * STEP)


def test_an_oncoming_vehicle_that_speeds_up_keeps_coming():
    attention = Attention(DRIVER)
    for time in STEP * np.arange(41):
        other = mover("oncoming", 200.0 - 10.0 * time - 0.5 * time * time, along=-10.0 - time)
        known = attention.known(mover("ego", 0.0), (other,), time)
    assert known[0].x == pytest.approx(other.x, abs=0.5)


def test_a_steady_vehicle_is_perceived_exactly_and_braking_one_reaction_time_late():
    attention = Attention(DRIVER)
    x, speed, speeds = 30.0, 20.0, []
    for count in range(71):
        time = count * STEP
        speeds.append(speed)
        lead = mover("lead", x, along=speed)
        known = attention.known(mover("ego", 20.0 * time), (lead,), time)
        if count >= 20:  # 1 s
            # m/s, once a second-old look showed the braking
            carried_on = 0.9 * 1.0 if count - 20 > 30 else 0.0
            assert known[0].along == pytest.approx(speeds[count - 20] - carried_on, abs=1e-9)
        if 20 <= count <= 30:
            assert known[0].x == pytest.approx(lead.x)
        # brakes gently from 1.5 s on: never closed upon by 2 m/s, so nothing alerts
        if count >= 30:
            speed -= 0.9 * STEP
        x += speed * STEP
    assert speeds[-1] < 18.3


def without_a_crash(concrete, drivers, seed):
    recordings = synthetic_reference(concrete, drivers, seed=seed)
    for recording in recordings:
        assert (recording.collision, recording.error) == (None, None), concrete.label
    return recordings


@pytest.mark.parametrize("concrete", low_speed()[::8] + safe_cut_outs(10), ids=lambda c: c.label)
def test_skilled_drivers_do_not_crash_in_the_safe_zone(concrete):
    for recording in without_a_crash(concrete, DRIVERS, 1):
        assert recording.end_reason in ("road_end", "standstill")


@pytest.mark.parametrize("concrete", cut_outs_at_the_edge(6, seed=3), ids=lambda c: c.label)
def test_skilled_drivers_do_not_crash_at_the_very_edge_of_the_safe_zone(concrete):
    slowest = sorted(draw_population(40, seed=2), key=lambda driver: driver.reaction_time)[-4:]
    without_a_crash(concrete, slowest, 2)


@pytest.mark.campaign
def test_skilled_drivers_do_not_crash_anywhere_in_the_safe_zone():
    for concrete in low_speed() + safe_cut_outs(1) + cut_outs_at_the_edge(60, seed=4):
        without_a_crash(concrete, DRIVERS, 1)


def test_drivers_inclined_to_overtake_do_the_rest_follow():
    concrete = at_point("front_vehicle_low_speed", 25.0, 15.0)
    recordings = synthetic_reference(concrete, DRIVERS, seed=1)
    for driver, recording in zip(DRIVERS, recordings, strict=True):
        ends_left = recording.ego.y[-1] > 1.75
        assert ends_left == driver.overtakes
        assert recording.ego.y[0] == 0.0
        if not driver.overtakes:
            assert_last(recording, 1.5, speed=15.0)
    assert sum(driver.overtakes for driver in DRIVERS) == 8


def until_the_lane_change(ego):
    """How many samples there are until the centre has left the lane; all where it stays."""
    left = np.flatnonzero(ego.y > 1.75)
    return int(left[0]) + 1 if left.size else len(ego)


def test_ordinary_approaches_are_as_gentle_and_as_varied_as_recorded():
    concretes = (
        at_point("front_vehicle_low_speed", *speeds)
        for speeds in ((30.0, 20.0), (25.0, 20.0), (25.0, 15.0))
    )
    recordings = [it for one in concretes for it in synthetic_reference(one, DRIVERS, seed=1)]
    strongest = [
        recording.ego.acceleration[: until_the_lane_change(recording.ego)].min()
        for recording in recordings
    ]
    # of recorded approaches, which end there too
    assert np.median(strongest) == pytest.approx(-0.37, abs=0.12)
    left = [recording for recording in recordings if recording.ego.y[-1] > 1.75]
    assert np.std(
        [recording.ego.speed[-1] / recording.ego.speed[0] for recording in left]
    ) == pytest.approx(0.087, abs=0.03)
    onsets = [float(recording.ego.time[np.argmax(recording.ego.y > 1.75)]) for recording in left]
    assert np.std(onsets) > 0.5
    assert np.mean([count_operations(recording.ego) for recording in recordings]) < 3.0


def test_a_driver_alone_wanders_about_its_own_line():
    wander, lines, operations = [], [], []
    for driver in draw_population(16, seed=5):
        recording = simulate(case(speed=20.0), SyntheticDriver(driver, case(speed=20.0), seed=5))
        ego = recording.ego
        assert recording.end_reason == "road_end"
        assert ego.y[0] == 0.0
        assert ego.acceleration[0] == 0.0
        settled = ego.time > 5.0
        wander.append(ego.y[settled].var())
        lines.append(ego.y[settled].mean() - driver.lane_offset)
        operations.append(count_operations(ego))
    # the mean of 20 s still holds some of the wander
    assert np.sqrt(np.mean(wander) + np.var(lines)) == pytest.approx(0.25, rel=0.15)
    assert np.mean(operations) < 2.0


def test_an_overtaker_does_not_wander_back_to_what_it_passes():
    concrete = at_point("front_vehicle_low_speed", 20.0, 0.0)
    for driver in (driver for driver in DRIVERS if driver.overtakes):
        recording = simulate(concrete, SyntheticDriver(driver, concrete, seed=1))
        beside = np.abs(recording.ego.x - recording.actors["lead"].x) < 4.5
        assert beside.any()
        assert recording.ego.y[beside].min() > 1.9


def channels(recording):
    return b"".join(getattr(recording.ego, name).tobytes() for name in CHANNELS)


def test_the_same_seed_driver_and_case_drive_the_same_to_the_last_bit_in_any_order():
    first = [channels(recording) for recording in synthetic_reference(CUT_OUT, DRIVERS[:4], seed=1)]
    again = [
        channels(simulate(CUT_OUT, human_controller(index, 10, 1, CUT_OUT)))
        for index in (3, 1, 2, 0)
    ]
    assert first == [again[3], again[1], again[2], again[0]]
    assert len(set(first)) == 4


def test_the_size_of_the_population_does_not_change_a_driver():
    five, ten = (simulate(CUT_OUT, human_controller(4, count, 1, CUT_OUT)) for count in (5, 10))
    assert channels(five) == channels(ten)


def test_another_seed_or_another_case_is_another_drive():
    driver = DRIVERS[0]
    base = case(speed=20.0, gap=1.0)
    runs = [
        channels(simulate(concrete, SyntheticDriver(driver, concrete, seed)))
        for concrete, seed in ((base, 1), (base, 2), (case(speed=20.0, gap=1.0 + 1e-12), 1))
    ]
    assert len(set(runs)) == 3


def test_a_drive_does_not_depend_on_the_order_of_the_values():
    one, other = case(speed=20.0, a=1.0, b=2.0), case(speed=20.0, b=2.0, a=1.0)
    assert channels(simulate(one, SyntheticDriver(DRIVER, one, 1))) == channels(
        simulate(other, SyntheticDriver(DRIVER, other, 1))
    )


@pytest.mark.parametrize("index", [-1, 10])
def test_a_driver_outside_the_population_is_refused(index):
    with refusal(r"`index` of a population of 10 drivers must be within 0\.\.9"):
        human_controller(index, 10, 1, CUT_OUT)


def test_a_follower_in_danger_evades_when_braking_is_not_enough():
    follower = next(driver for driver in draw_population(40, seed=1) if not driver.overtakes)
    follower = replace(follower, reaction_time=0.6)
    concrete = case(actor("wall", 58.0, 0.0), speed=30.0)
    recording = clear_drive(concrete, SyntheticDriver(follower, concrete, 1))
    assert recording.ego.y[-1] > 2.5


def test_driver_numbers_are_stable():
    assert draw_driver(0, seed=1).reaction_time == pytest.approx(0.8917902667644364, abs=1e-12)


def test_a_braking_lead_is_expected_to_brake_until_it_stands():
    attention = Attention(replace(DRIVER, reaction_time=1.0))
    me = mover("ego", 0.0, along=20.0)
    speeds = [20.0 - 4.0 * STEP * step for step in range(61)]
    places = [60.0 + 20.0 * STEP * step - 2.0 * (STEP * step) ** 2 for step in range(61)]
    for step, (speed, place) in enumerate(zip(speeds, places, strict=True)):
        (known,) = attention.known(me, (mover("lead", place, along=speed),), step * STEP) or [None]
        if step == 60:  # long after its first look, the driver knows the braking and carries it on
            assert known.along == pytest.approx(speed, abs=1e-9)
            assert known.x == pytest.approx(place, abs=0.1)
    stopped = mover("lead", 60.0, along=1.0)._replace(braking=4.0)
    carry_on(stopped, 10.0)
    assert stopped.along == 0.0
    assert stopped.x == pytest.approx(60.0 + 1.0 / 8.0)


def test_skilled_drivers_stop_behind_a_lead_that_brakes_as_in_the_consumer_test():
    logical = catalogue.load("ncap_ccrb")
    for concrete in logical.concretes(sample(logical).points)[::6]:
        for recording in synthetic_reference(concrete, DRIVERS[:3], seed=1):
            assert (recording.end_reason, recording.error) == ("standstill", None), concrete.label
