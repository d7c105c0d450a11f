"""Criticality measures against hand-worked numbers, a plain twin, and laws."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from road_scenes import ROAD
from twins.contact import overlap
from twins.measures import plain_measures

from sumo_eval.method import measures as module
from sumo_eval.method.measures import conflict_pet, course_of, lane_keeping, velocity_change
from sumo_eval.method.plausibility import extremes_of
from sumo_eval.scenario.road.reference_line import arc
from sumo_eval.scenario.touch import Body
from sumo_eval.trajectory import Collision, Trajectory

TIME = np.arange(0.0, 4.05, 0.1)


def constant(x, speed, *, y=0.0, time=TIME, heading=0.0, **body):
    """A body whose centre is at (x, y) at t = 0 and keeps its speed along the road."""
    n = len(time)
    return Trajectory(
        time,
        x + speed * time,
        np.full(n, y),
        np.full(n, heading),
        np.full(n, speed),
        np.zeros(n),
        **body,
    )


def front_contact(time, ego_speed, other_speed, *, heading=0.0, other="lead", side="front"):
    along = np.array([math.cos(heading), math.sin(heading)])
    return Collision(
        time,
        other,
        tuple(ego_speed * along),
        tuple(other_speed * along),
        1.0,
        side,
        (0.0, 0.0, heading),
        (4.5, 0.0, 0.0),
    )


def measures(ego, actors, collision=None, road=ROAD):
    return module.measures(ego, actors, collision, course_of(ego, actors, collision, road))


def test_constant_speeds_by_hand():
    # Centres 104.5 m apart, bodies 4.5 m: 100 m bumper to bumper, closing at 30 - 10 = 20 m/s for 4
    # s: 20 m are left, TTC = 20/20, THW = 20/30 s, DRAC = 20^2/(2 * 20) m/s2.
    # At t = 4 s the ego's front is 120 m from where it began. The lead's rear, 100 m from there at
    # t = 0, was at that place after (120 - 100)/10 = 2 s, so 2 s ago.
    found = astuple(measures(constant(0.0, 30.0), {"lead": constant(104.5, 10.0)}))
    assert found[:6] == pytest.approx((1.0, 1.0, 20.0 / 30.0, 20.0, 10.0, 2.0))
    assert found[6:8] == (0.0, 0.0)  # it neither brakes nor has a jerk
    assert math.isnan(found[8])  # nor a contact to change its speed


def test_a_car_across_the_road_is_in_the_way_as_it_lies():
    # 4.5 m x 1.8 m: its end is 3 - 4.5/2 = 0.75 m aside, within 0.9 m; its flank is 100 - 1.8/2 =
    # 99.1 m ahead, and 99.1 - 2.25 - 4 s * 10 m/s = 56.85 m are left.
    across = constant(100.0, 0.0, y=3.0, heading=math.pi / 2.0)
    found = measures(constant(0.0, 10.0), {"car": across})
    assert (found.min_gap, found.min_ttc) == pytest.approx((56.85, 5.685))


CHANNELS = ("time", "x", "y", "heading", "speed", "acceleration")


def test_equal_velocities_have_delta_v_0_and_the_struck_ego_is_slowed_or_pushed_on():
    assert velocity_change(front_contact(1.0, 15.0, 15.0)) == 0.0
    assert velocity_change(front_contact(1.0, 20.0, 5.0)) == -7.5  # slowed by half of 15 m/s
    # hit from behind and pushed on
    assert velocity_change(front_contact(1.0, 5.0, 20.0, side="rear")) == 7.5
    assert velocity_change(front_contact(1.0, 20.0, 5.0, heading=0.7)) == pytest.approx(-7.5)
    assert velocity_change(front_contact(1.0, 20.0, -20.0)) == -20.0  # head on


def test_a_frontal_contact_at_an_angle_is_contact_although_the_boxes_along_the_road_are_apart():
    # beside its path by width, but a corner sticks out
    ego, lead = constant(0.0, 20.0), constant(94.6, 0.0, y=1.9)
    assert math.isnan(measures(ego, {"lead": lead}).min_gap)
    assert measures(ego, {"lead": lead}, front_contact(4.0, 20.0, 0.0)).min_gap == 0.0


def test_who_is_beside_or_behind_does_not_count():
    # a contact at the side: the bodies touch, and rounding decides nothing
    beside, behind = constant(20.0, 5.0, y=math.nextafter(1.8, 0.0)), constant(-30.0, 9.0)
    found = measures(constant(0.0, 10.0), {"beside": beside, "behind": behind})
    assert all(math.isnan(value) for value in astuple(found)[:5])


def test_one_sample_has_no_jerk():
    assert math.isnan(measures(constant(0.0, 10.0, time=np.zeros(1)), {}).max_jerk)


def test_lateral_jerk_is_that_of_the_turn():
    """20 m/s, heading 0.05 t^2: 20 m/s * 0.1 rad/s2. A sample of a contact, 1 ms late, adds none. A
    weave of 5 cm at 1.5 Hz has 0.05 (3 pi)^3 = 42 m/s3."""
    time = np.append(TIME, TIME[-1] + 1e-3)
    weave = 0.0075 * math.pi * np.cos(3.0 * math.pi * time)
    for heading, jerk in ((0.05 * time**2, 2.0), (weave, 42.0)):
        turn = replace(constant(0.0, 20.0, time=time), heading=heading)
        assert measures(turn, {}).max_lateral_jerk == pytest.approx(jerk, rel=0.15)


def test_jerk_ignores_how_soon_a_contact_follows_a_sample():
    """Braking rises by 60 m/s3: by 6 m/s2 in 0.1 s. A contact 1 ms after a sample, within the next
    step, has 3 m/s2 more: not 3 / 0.001 = 3,000 m/s3."""
    time = np.append(TIME, TIME[-1] + 1e-3)
    braking = -np.minimum(np.arange(len(time)) * 6.0, 6.0)
    braking[-1] -= 3.0
    ego = replace(constant(0.0, 20.0, time=time), acceleration=braking)
    assert measures(ego, {}).max_jerk == pytest.approx(6.0 / (TIME[1] - TIME[0]))


def scene(seed):
    """An ego that wanders and brakes among three vehicles, one of which leaves or enters its lane."""
    rng = np.random.default_rng(seed)
    begin = rng.uniform(-5.0, 5.0)
    time = begin + np.append(np.arange(0.0, 4.0, 0.1), 4.0 + 0.09 * rng.random())

    def drive(x, speed, y):
        acceleration = np.repeat(rng.normal(-1.0, 2.0, 9), 5)[: len(time)]
        speeds = np.maximum(
            speed + np.concatenate([[0.0], np.cumsum(acceleration[:-1] * np.diff(time))]), 0.0
        )
        xs = 99.0 * begin + x + np.concatenate([[0.0], np.cumsum(speeds[:-1] * np.diff(time))])
        ys = y + rng.uniform(-3.5, 3.5) / (
            1.0 + np.exp(-3.0 * (time - begin - rng.uniform(0.0, 4.0)))
        )
        return Trajectory(
            time,
            xs,
            ys + begin,
            speed=speeds,
            acceleration=acceleration,
            length=rng.uniform(3.5, 12.0),
        )

    ego = drive(0.0, rng.uniform(5.0, 35.0), 0.0)
    actors = {
        f"actor {i}": drive(
            rng.uniform(-20.0, 60.0), rng.uniform(0.0, 30.0), rng.choice([0.0, 0.0, 0.0, 3.5])
        )
        for i in range(3)
    }
    if seed % 2:
        actors["actor 0"] = Trajectory(
            *(getattr(actors["actor 0"], name)[5:-4] for name in CHANNELS), width=2.5
        )
    collision = (
        front_contact(time[-1], 9.0, 3.0, heading=0.1, other="actor 1") if seed % 3 == 0 else None
    )
    return ego, actors, collision


@pytest.mark.parametrize("seed", range(24))
def test_the_measures_are_the_plain_loops(seed):
    *_, speed, acceleration = extremes_of(course_of(*scene(seed), ROAD)).values()
    found = [*astuple(measures(*scene(seed))), speed, acceleration]
    np.testing.assert_allclose(found, plain_measures(*scene(seed)), rtol=1e-9, atol=1e-9)


def test_the_scenes_define_every_measure_somewhere():
    found = np.array([astuple(measures(*scene(seed))) for seed in range(24)])
    assert np.isfinite(found).any(axis=0).all()


def test_on_a_curve_speeds_are_those_along_its_line():
    """20 m at 30 - 10 m/s over the ground, of which the line, 1.5 m aside, has 1 / 0.994."""
    bend = replace(ROAD, line=(arc(400.0, 250.0),))
    ego, lead = (constant(x, speed, y=1.5) for x, speed in ((0.0, 30.0), (104.5, 10.0)))
    assert measures(ego, {"lead": lead}, road=bend).min_ttc == pytest.approx(0.994)


def test_a_contact_from_behind_has_no_gap_ahead():
    ego, chaser = constant(0.0, 10.0), constant(-30.0, 16.0)
    hit = front_contact(4.0, 10.0, 16.0, other="chaser", side="rear")
    found = measures(ego, {"chaser": chaser}, hit)
    assert math.isnan(found.min_gap)
    assert found.delta_v == 3.0


@pytest.mark.parametrize("last, settling", [(0.05, 5.0), (0.2, np.inf)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_lane_keeping_by_hand(last, settling, side):
    # 0.2 m to one side, 1.0 and 0.9 m to the other, 1.8 m wide in 3.5 m: over the line from 2 to 5 s
    time = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 6.0])
    y = side * np.array([0.0, 0.2, -1.0, -0.9, 0.1, last])
    found = lane_keeping(
        Trajectory(time, 10.0 * time, y, speed=np.full(6, 10.0), length=4.5, width=1.8), 3.5
    )
    assert found.largest_offset == 1.0
    assert found.overshoot == 1.0
    assert found.over_line_time == 3.0
    assert found.settling_time == settling
    straight = lane_keeping(
        Trajectory(time, 10.0 * time, 0.0 * y + 3.6, speed=np.full(6, 10.0), width=1.8), 3.5
    )
    assert straight.largest_offset == pytest.approx(0.1)
    assert straight.overshoot == 0.0
    assert straight.over_line_time == 0.0
    assert straight.settling_time == 0.0


def straight(x, y, speed, heading=0.0, duration=10.0):
    time = np.arange(0.0, duration + 0.05, 0.1)
    way = speed * time
    return Trajectory(
        time, x + way * math.cos(heading), y + way * math.sin(heading),
        heading=np.full(len(time), heading),
        speed=np.full(len(time), speed), length=4.5, width=1.8,
    )  # fmt: skip


def test_the_pet_of_a_crossing_by_hand_in_either_order():
    # The ego drives along y = 0 from x = 0 at 10 m/s, the other upwards along x = 53.15 m at 10
    # m/s: the area is
    # x 52.25..54.05 m, y -0.9..0.9 m. The ego is in it from (52.25 - 2.25) / 10 = 5 s to (54.05 +
    # 2.25) / 10 = 5.63 s.
    ego = straight(0.0, 0.0, 10.0)
    # The other is in it from (-3.15 - start) / 10 to (3.15 - start) / 10: 3 to 3.63 s, 6 to 6.63 s,
    # 9 to 9.63 s.
    for start, least in ((-33.15, 5.0 - 3.63), (-63.15, 6.0 - 5.63), (-93.15, 9.0 - 5.63)):
        other = straight(53.15, start, 10.0, math.pi / 2.0)
        assert conflict_pet(ego, other) == pytest.approx(least, abs=0.01)
        assert conflict_pet(other, ego) == pytest.approx(least, abs=0.01), (
            "the order of both does not matter"
        )


def test_the_pet_of_conflicting_ways_is_0_with_contact_and_none_apart_and_the_headway_behind_one_another():
    ego = straight(0.0, 0.0, 10.0)
    assert conflict_pet(ego, straight(53.15, -53.15, 10.0, math.pi / 2.0)) == 0.0
    assert math.isnan(conflict_pet(ego, straight(0.0, 5.0, 10.0)))
    # 15 m between the bumpers at 10 m/s: the front is where the rear was 1.5 s before
    assert conflict_pet(ego, straight(19.5, 0.0, 10.0)) == pytest.approx(1.5, abs=0.01)


@pytest.mark.parametrize("angle", [20.0, 70.0, 125.0])
def test_the_pet_of_slanted_ways_beside_a_plain_search(angle):
    """The least time between instants at which the bodies' polygons overlap, 0.02 s apart."""
    turn, times = math.radians(angle), np.arange(0.0, 9.0, 0.02)

    def bodies(one):
        places = zip(*(np.interp(times, one.time, it) for it in (one.x, one.y)), strict=True)
        return [Body(*it, one.heading[0], one.speed[0], 4.5, 1.8) for it in places]

    ego = straight(0.0, 0.0, 12.0)
    other = straight(60.0 - 34.0 * math.cos(turn), -34.0 * math.sin(turn), 9.0, turn)
    mine, its = bodies(ego), bodies(other)
    near = [(i, j) for i in range(450) for j in range(max(i - 200, 0), min(i + 200, 450), 2)
        if abs(mine[i].x - its[j].x) < 5.0 and abs(mine[i].y - its[j].y) < 5.0]  # fmt: skip
    found = min(abs(times[i] - times[j]) for i, j in near if overlap(mine[i], its[j]))
    assert found > 0.1
    assert conflict_pet(ego, other) == pytest.approx(found, abs=0.05)


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.2, -2.8])
def test_law_turning_and_moving_the_scene_leaves_its_pet(angle):
    def turned(one):
        c, s = math.cos(angle), math.sin(angle)
        return replace(
            one,
            x=7.0 + c * one.x - s * one.y,
            y=-3.0 + s * one.x + c * one.y,
            heading=one.heading + angle + math.tau * (np.arange(len(one)) % 2),
        )

    ego, other = straight(0.0, 0.0, 12.0), straight(53.0, -40.0, 6.0, math.radians(70.0))
    assert conflict_pet(turned(ego), turned(other)) == pytest.approx(
        conflict_pet(ego, other), abs=0.006
    )
