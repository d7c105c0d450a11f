"""When the lane change begins, how quick it is, and when it does not begin."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refusal
from road_scenes import BRIEFING, fresh, mover
from tables import values_of

from sumo_eval.ads.car_following import IdmParameters, enhanced_idm_acceleration
from sumo_eval.ads.lane_change import path_y, share_of_duration, smooth_step
from sumo_eval.ads.overtaking import CLEARANCE, OVERTAKING, WATCHED, OvertakingHabits, overtake
from sumo_eval.scenario import Road

WILLING = OvertakingHabits(inclined=np.True_, onset_headway=2.5, onset_ttc=10.0, duration=8.0)
UNWILLING = OvertakingHabits(inclined=False, onset_headway=2.5, onset_ttc=10.0, duration=8.0)
IDM = IdmParameters()
STAYS = SimpleNamespace(asked=0)  # the way of an ego that need not change lanes


class Ego:
    """An ego that decides step by step: the memory of the rule, and what it remembers of each
    vehicle by its name."""

    def __init__(self, habits, briefing):
        self.habits, self.briefing = habits, briefing
        self.memory = fresh(OVERTAKING)
        self.memory.began = 0
        self.watched = {}

    def acceleration(self, me, others, desired_speed, free):
        watched = [
            self.watched.setdefault((i, it.name), fresh(WATCHED)) for i, it in enumerate(others)
        ]
        self.memory.desired_speed, self.memory.free = desired_speed, free
        p = SimpleNamespace(habits=self.habits, idm=IDM)
        return overtake(self.memory, me, others, watched, p, STAYS, self.briefing)

    @property
    def changing(self):
        return bool(self.memory.changing)

    @property
    def passing(self):
        return bool(self.memory.passing)

    @property
    def path(self):
        return self.memory.path

    def y(self, x):
        return path_y(self.memory.path, x)


def decide(*others, speed=20.0, habits=WILLING, road=BRIEFING.road):
    """What is decided in the first step of an ego at x = 0 on the right lane that drives at
    `speed`."""
    briefing = type(BRIEFING)("test", road, BRIEFING.vehicle, BRIEFING.step)
    overtaking, me = Ego(habits, briefing), mover("ego", 0.0, along=speed)
    return overtaking, overtaking.acceleration(me, others, speed, 0.3)


def ahead(gap, speed, y=0.0, name="lead"):
    return mover(name, 4.5 + gap, y, along=speed)


@pytest.mark.parametrize(
    "gap, speed, begins",
    values_of("""
    99.0, 10.0, True
    101.0, 10.0, False
    49.9, 17.0, True
    50.1, 17.0, False
    """),
    ids=["TTC below 10 s", "TTC above 10 s", "headway below 2.5 s", "headway above 2.5 s"],
)
def test_it_begins_at_the_first_of_headway_and_ttc(gap, speed, begins):
    overtaking, wanted = decide(ahead(gap, speed))
    assert overtaking.changing is begins
    if not begins:
        assert wanted == 0.3  # nothing to follow: it is going to overtake


def test_a_lead_hardly_slower_is_followed():
    overtaking, wanted = decide(ahead(30.0, 18.1))
    assert not overtaking.changing
    assert wanted == enhanced_idm_acceleration(20.0, 20.0, 30.0, 18.1, IDM)


def test_who_does_not_overtake_follows():
    overtaking, wanted = decide(ahead(60.0, 10.0), habits=UNWILLING)
    assert not overtaking.changing
    assert wanted == enhanced_idm_acceleration(20.0, 20.0, 60.0, 10.0, IDM) < 0.0


def test_without_hurry_it_takes_the_habitual_duration():
    overtaking, _ = decide(ahead(99.0, 10.0))
    assert overtaking.path.length == pytest.approx(8.0 * 20.0)
    assert overtaking.path.start + overtaking.path.offset == 3.5


def test_in_a_hurry_it_is_just_clear_of_the_lead_when_it_reaches_it():
    overtaking, _ = decide(ahead(60.0, 0.0))
    assert overtaking.y(20.0 * 3.0) == pytest.approx(1.8 + CLEARANCE, abs=1e-6)


def test_when_the_lane_change_would_be_uncomfortable_it_brakes():
    # 1.6 s to the lead, 6.7 m/s2 needed: smooth_step(1.6 / 3.18) < 0.6
    overtaking, wanted = decide(ahead(32.0, 0.0))
    assert smooth_step(1.6 / 3.18) < 2.1 / 3.5
    assert not overtaking.changing
    assert wanted < -6.0


@pytest.mark.parametrize("habits", [WILLING, UNWILLING], ids=["willing", "unwilling"])
def test_when_braking_will_not_do_it_evades_if_that_is_possible(habits):
    # 11 m/s2 needed, 1.5 s to the obstacle
    evading, _ = decide(ahead(45.0, 0.0), speed=30.0, habits=habits)
    assert evading.changing
    assert evading.y(45.0) >= 1.8 + CLEARANCE - 1e-6
    assert 2.25 * 30.0 - 0.5 < evading.path.length < 3.18 * 30.0
    too_late, wanted = decide(ahead(30.0, 0.0), speed=30.0, habits=habits)
    assert not too_late.changing
    assert wanted < -9.0


def test_in_danger_it_brakes_though_it_is_not_near_enough_to_overtake():
    late = OvertakingHabits(inclined=True, onset_headway=0.5, onset_ttc=0.5, duration=8.0)
    overtaking, wanted = decide(ahead(30.0, 0.0), speed=30.0, habits=late)
    assert not overtaking.changing
    assert wanted < -9.0


@pytest.mark.parametrize(
    "x, y, speed, free",
    values_of("""
    14.5, 3.5, 20.0, False
    18.5, 3.5, 20.0, True
    34.5, 3.5, 15.0, False
    -20.0, 3.5, 20.0, False
    -25.0, 3.5, 20.0, True
    -60.0, 3.5, 35.0, False
    -120.0, 3.5, 35.0, True
    1.0, 3.5, 20.0, False
    -1.0, 3.5, 20.0, False
    1.0, 7.0, 20.0, True
    """),
)
def test_the_left_lane_must_be_free_ahead_and_behind(x, y, speed, free):
    overtaking, _ = decide(ahead(60.0, 10.0), mover("other", x, y, along=speed))
    assert overtaking.changing is free


def test_the_gap_behind_is_that_of_un_r79():
    # The regulation reckons from when the ego's side is at the line: 0.85 m of 3.5 m, by a smooth
    # step. Until then, and 0.4 s more, whoever is behind comes nearer undiminished.
    closing, speed = 12.0, 20.0
    to_the_line = decide(ahead(60.0, 10.0))[0].path.length / speed * share_of_duration(0.85 / 3.5)
    assert 1.0 < to_the_line < 3.0
    critical = closing * (to_the_line + 0.4) + closing**2 / (2.0 * 3.0) + speed * 1.0
    for margin, free in ((-0.01, False), (0.01, True)):
        rear = mover("rear", -4.5 - critical - margin, 3.5, along=speed + closing)
        assert decide(ahead(60.0, 10.0), rear)[0].changing is free


@pytest.mark.parametrize("habits", [WILLING, UNWILLING], ids=["willing", "unwilling"])
@pytest.mark.parametrize("gap", [150.0, 60.0])
def test_oncoming_vehicles_are_neither_overtaken_nor_approached(habits, gap):
    evading, wanted = decide(ahead(gap, -15.0), speed=30.0, habits=habits)
    assert not evading.changing
    assert wanted < -3.0, "it brakes"
    back, still = (
        decide(ahead(gap, speed), speed=30.0, habits=habits)[0].changing for speed in (-0.5, 0.0)
    )
    assert back is still, "who rolls back does not come towards it"


def test_an_evasion_needs_only_room_not_comfort():
    for x, speed, evades in values_of("""
    9.5, 30.0, True
    6.4, 30.0, False
    1.0, 30.0, False
    -15.0, 35.0, False
    """):  # fmt: skip
        other = mover("left", x, 3.5, along=speed)
        assert decide(ahead(45.0, 0.0), other, speed=30.0)[0].changing is evades


def test_on_the_leftmost_lane_it_follows():
    one_lane = Road(name="narrow", length=600.0, lanes=1, lane_width=3.5, run_out=100.0)
    overtaking, wanted = decide(ahead(60.0, 10.0), road=one_lane)
    assert not overtaking.changing
    assert wanted < 0.0


def test_no_vehicle_changes_lane_at_a_crawl():
    me = mover("ego", 0.0, along=20.0)
    overtaking = Ego(WILLING, BRIEFING)
    overtaking.acceleration(me, [], 20.0, 0.3)
    overtaking.acceleration(me._replace(along=1.9), [ahead(6.0, 1.0)], 20.0, 0.3)
    assert not overtaking.changing
    overtaking.acceleration(me._replace(along=2.1), [ahead(6.0, 1.0)], 20.0, 0.3)
    assert overtaking.changing
    assert overtaking.path.length == 20.0


def test_it_gains_no_speed_until_it_is_sure_to_be_clear_of_what_it_passes():
    lead = ahead(60.0, 0.0)
    overtaking, wanted = decide(lead)
    assert (overtaking.passing, wanted) == (True, 0.0)
    clear = mover("ego", 55.0, 2.45, along=20.0)
    assert overtaking.acceleration(clear, [lead], 20.0, 0.3) == 0.3
    assert not overtaking.passing


def test_behind_the_lane_change_it_follows_the_new_lead():
    overtaking, wanted = decide(ahead(99.0, 10.0), ahead(60.0, 18.0, y=3.5, name="new"))
    assert overtaking.changing
    assert wanted == min(0.0, enhanced_idm_acceleration(20.0, 20.0, 60.0, 18.0, IDM))
    me = mover("ego", 150.0, 3.5, along=20.0)
    near = mover("new", 150.0 + 4.5 + 15.0, 3.5, along=12.0)
    assert overtaking.acceleration(me, [near], 20.0, 0.3) < -2.0


def test_a_lead_that_brakes_during_the_lane_change_is_braked_for():
    lead = ahead(99.0, 10.0)
    overtaking, _ = decide(lead)
    me = mover("ego", 40.0, overtaking.y(40.0), along=20.0)
    assert overtaking.acceleration(me, [lead._replace(x=84.5)], 20.0, 0.3) > -0.1
    assert overtaking.acceleration(me, [lead._replace(x=64.5, along=0.0)], 20.0, 0.3) < -5.0


@pytest.mark.parametrize("name", ["onset_headway", "onset_ttc", "duration", "worth"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_habits_are_positive_numbers(name, value):
    habits = {"inclined": True, "onset_headway": 2.5, "onset_ttc": 10.0, "duration": 8.0}
    with refusal(f"`{name}` of `OvertakingHabits` must be a finite number greater than 0"):
        OvertakingHabits(**(habits | {name: value}))
    with refusal("`inclined` of `OvertakingHabits` must be true or false"):
        OvertakingHabits(**(habits | {"inclined": "no"}))
