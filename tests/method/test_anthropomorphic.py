"""Laws and worked numbers of the anthropomorphic index D, Eqs. 11-13."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal
from tables import rows_of, values_of
from twins import anthropomorphic as twin

from sumo_eval import Trajectory
from sumo_eval.method import anthropomorphic as module
from sumo_eval.method.anthropomorphic import (
    anthropomorphic_index,
    count_operations,
    exposure_weighted_index,
    operation_tolerance,
)
from sumo_eval.method.compared_drives import (
    ComparedDrive,
    lateral_position,
    slice_points,
    slice_positions,
)
from sumo_eval.method.index_terms import IndexNote, gaussian_similarity
from sumo_eval.method.operations import most_operations
from sumo_eval.scenario.concrete import Road, smooth_step
from sumo_eval.settings import AnthropomorphicSettings, FieldSettings

# y from -1.75 to 5.25 m
ROAD = Road(name="test", length=60.0, lanes=2, lane_width=3.5, run_out=100.0)


def drive(
    speed=15.0,
    y=0.0,
    *,
    until=60.0,
    start=0.0,
    lane_change=None,
    acceleration=0.0,
    steering_deg=0.0,
):
    """At one speed to the first sample at or past x = `until`; a lane change is (begin s, duration
    s, offset m)."""
    n = math.ceil((until - start) / speed / 0.1 - 1e-9) + 1
    time = 0.1 * np.arange(n)
    begin, duration, offset = lane_change or (0.0, 1.0, 0.0)
    return Trajectory(
        time,
        start + speed * time,
        y + offset * smooth_step((time - begin) / duration),
        speed=np.full(n, speed),
        acceleration=np.broadcast_to(acceleration, n),
        steering_wheel_angle=np.radians(np.broadcast_to(steering_deg, n)),
    )


def stopping(at, y=0.0, *, standing=20, start=0.0):
    """From 10 m/s to a stop at x = `at`, then standing for some samples."""
    duration = 2.0 * (at - start) / 10.0
    time = 0.1 * np.arange(math.ceil(duration / 0.1) + standing)
    run = np.minimum(time, duration)
    x = start + 10.0 * run * (1.0 - run / (2.0 * duration))
    return Trajectory(
        time,
        x,
        np.full(time.size, y),
        speed=10.0 * (1.0 - run / duration),
        heading=np.zeros(time.size),
        acceleration=np.zeros(time.size),
        steering_wheel_angle=np.zeros(time.size),
    )


def humans(seed=0, n=4):
    rng = np.random.default_rng(seed)
    return [
        drive(rng.uniform(12, 18), rng.normal(0.0, 0.3), lane_change=(1.0, 2.5, rng.uniform(0, 2)))
        for _ in range(n)
    ]


# --- laws of D_i ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "same",
    [
        drive(),
        drive(17.0, -0.4, lane_change=(0.5, 3.0, 3.5), steering_deg=20.0, acceleration=1.0),
        drive(y=-1.9),
        stopping(33.3),
        stopping(33.3, standing=1),
        drive(until=31.7),
        drive(until=200.0),
        Trajectory([0.0], [0.0], [0.0]),
        Trajectory(0.1 * np.arange(5), np.full(5, 3.0), np.zeros(5)),
    ],
    ids=[
        "keeps the lane",
        "changes it",
        "off the road",
        "stops",
        "just stopped",
        "ends early",
        "goes on",
        "one",
        "stands",
    ],
)
@pytest.mark.parametrize("mode", ["gaussian", "mixture"])
def test_identical_driving_scores_1(same, mode):
    index = anthropomorphic_index(same, [same] * 3, ROAD, AnthropomorphicSettings(mode=mode))
    made = index.ingredients
    assert index.value == index.length_factor == index.operation_factor == index.similarity == 1.0
    assert made.centre_similarity == made.field_similarity == made.lowest == 1.0


@pytest.mark.filterwarnings("error")
def test_a_standing_drive_scores_1_among_its_like_when_fields_are_vectors():
    stand = Trajectory([0.0], [20.0], [0.0])
    settings = AnthropomorphicSettings(field=FieldSettings(superposition="vector"))
    assert anthropomorphic_index(stand, [stand, stand], ROAD, settings).value == 1.0
    moves = Trajectory([0.0, 1.0], [20.0, 30.0], [0.0, 0.0])
    assert anthropomorphic_index(moves, [stand, stand], ROAD, settings).value < 1.0


def test_no_pairings_are_an_empty_answer():
    assert module.indexes_by_group(humans(1), [[]], ROAD) == [[]]


@given(shift=st.floats(-5e3, 5e3), wait=st.floats(-100.0, 100.0))
def test_moving_the_world_moves_nothing(shift, wait):
    def moved(t):
        return replace(t, time=t.time + wait, x=t.x + shift)

    road = Road("moved", ROAD.length + shift, 2, 3.5, 100.0)
    ads, drivers = drive(24.0, 0.2), humans(1)
    there = anthropomorphic_index(moved(ads), [moved(driver) for driver in drivers], road)
    assert there.value == pytest.approx(anthropomorphic_index(ads, drivers, ROAD).value, rel=1e-6)


def test_what_lies_past_the_roads_end_changes_nothing():
    speeds, offsets = [14.0, 15.0, 17.0], [0.1, -0.2, 0.3]
    short = [drive(v, y) for v, y in zip(speeds, offsets, strict=True)]
    long = [drive(v, y, until=400.0) for v, y in zip(speeds, offsets, strict=True)]
    # At 24 m/s the road ends at sample 25; from sample 30 on the ADS that drives on also brakes.
    far = drive(24.0, until=400.0, acceleration=[0.0] * 30 + [-2.0] * 138)
    here = anthropomorphic_index(drive(24.0), short, ROAD)
    there = anthropomorphic_index(far, long, ROAD)
    assert 0.0 < there.value == here.value < 1.0
    assert there.ingredients.ads_operations == 0
    assert IndexNote("past_the_road", 4, 4) in there.notes


# --- the clever against the plain -----------------------------------------------------------------


@pytest.mark.parametrize(
    "ads, chosen",
    [
        (drive(16.0, 0.2, lane_change=(1.0, 2.0, 3.0)), AnthropomorphicSettings()),
        (
            drive(14.0, -1.0, steering_deg=12.0),
            AnthropomorphicSettings(field=FieldSettings(k1=1.0, k2=0.05), steering_rule="wheel"),
        ),
        (
            stopping(41.3, 0.3),
            AnthropomorphicSettings(slice_spacing=3.0, points_per_side=2, side_width=1.0),
        ),
        (
            drive(12.0, 5.4),
            AnthropomorphicSettings(centre_deviation_floor=1.8, field_deviation_floor=0.2),
        ),
        (
            drive(19.0, 0.9, until=43.0),
            AnthropomorphicSettings(field=FieldSettings(sample_interval=0.2)),
        ),
    ],
    ids=["changes lane", "k1 k2", "stops", "off the road", "ends early"],
)
def test_the_index_is_the_plain_loops(ads, chosen):
    drivers = [
        *humans(5, 2),
        drive(13.0, 0.3, steering_deg=11.0, acceleration=0.6),
        stopping(48.0, -0.1),
    ]
    plain = twin.anthropomorphic_index(ads, drivers, ROAD, chosen)
    assert 1e-6 < plain < 1.0
    index = anthropomorphic_index(ads, drivers, ROAD, chosen)
    assert index.value == pytest.approx(plain, rel=1e-9)
    assert index.value == index.length_factor * index.operation_factor * index.similarity
    assert index.ingredients.lowest <= index.similarity


@given(
    st.lists(st.sampled_from([0.0, 0.0, 0.0, 0.4, 0.5, 0.51, -0.6, 2.0]), min_size=1, max_size=60)
)
def test_counting_operations_is_the_plain_state_machine(signal):
    t = recorded(acceleration=signal, steering_wheel_angle=signal)
    chosen = AnthropomorphicSettings(steering_rule="wheel", steering_threshold_deg=20.0)
    assert count_operations(t, chosen) == twin.count_operations(t, chosen)


# --- worked numbers: terms ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "z, expected",
    values_of("""
    0.0, 1.0
    1.0, 1.0
    2.0, 1.0
    2.5, 0.32465246735834974  # exp(2 - 3.125) = exp(-1.125)
    3.0, 0.0820849986238988  # exp(2 - 4.5) = exp(-2.5)
    4.0, 0.0024787521766663585  # exp(2 - 8) = exp(-6)
    1e200, 0.0
    """),
)
def test_a_value_z_deviations_off(z, expected):
    for mean, deviation, sign in ((0.0, 1.0, 1), (3.0, 0.25, -1)):
        with np.errstate(over="ignore"):
            similarity = gaussian_similarity(mean + sign * z * deviation, mean, deviation)
        assert similarity == pytest.approx(expected, rel=1e-9)


def test_centre_three_floors_off():
    # Drivers all at y = 0: deviation 0, floor 0.15 m. The ADS at 0.45 m is z = 3: exp(-2.5) at
    # every slice.
    index = anthropomorphic_index(drive(y=0.45), [drive()] * 3, ROAD)
    assert index.ingredients.centre_similarity == pytest.approx(math.exp(-2.5), rel=1e-9)
    assert IndexNote("centre_floor", 121, 121) in index.notes
    wider = AnthropomorphicSettings(centre_deviation_floor=0.225)  # z = 2
    index = anthropomorphic_index(drive(y=0.45), [drive()] * 3, ROAD, wider)
    assert index.ingredients.centre_similarity == 1.0


@pytest.mark.parametrize(
    "own, others, expected",
    [
        (1.03, [1.0, 1.0, 1.0], math.exp(-2.5)),  # deviation 0, floor 1 % of 1: z = 3
        (103.0, [100.0, 100.0, 100.0], math.exp(-2.5)),
        (1.02, [1.0, 1.0, 1.0], 1.0),  # z = 2
        (7.0, [2.0, 4.0, 6.0], 1.0),  # mean 4, deviation 2: z = 1.5
        (12.0, [2.0, 4.0, 6.0], math.exp(2.0 - 8.0)),  # z = 4
    ],
)
def test_field_with_known_values(own, others, expected, monkeypatch):

    def fields(shared, x, y, places):
        return np.multiply.outer([own, *others], np.ones(y.shape))

    monkeypatch.setattr(module.SharedFields, "at", fields)
    index = anthropomorphic_index(drive(), [drive()] * 3, ROAD)
    assert index.ingredients.field_similarity == pytest.approx(expected, rel=1e-9)
    assert index.similarity == index.ingredients.field_similarity


# --- worked numbers: lengths ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "trajectory, expected",
    [
        (drive(), 60.0),
        (drive(until=61.0), 60.0),  # past the end: the road's end counts
        (drive(start=12.0), 48.0),
        (drive(15.0, until=57.0), 60.0),  # still driving when the time is up
        (drive(15.0, y=6.0, until=57.0), 57.0),  # off the road: what it drove
        (stopping(41.25), 41.25),
        *(
            (
                Trajectory(
                    range(4), [0.0, 9.0, 8.5, 8.5], np.zeros(4), speed=[9.0, 1.0, 0.0, last]
                ),
                far,
            )
            for last, far in ((0.0, 8.5), (1.0, 60.0))
        ),
        # rolled back
        (Trajectory([0.0, 1.0, 2.0], [0.0, -1.0, -1.0], np.zeros(3), speed=[1.0, 0.0, 0.0]), 0.0),
        (Trajectory([0.0], [5.0], [0.0]), 0.0),
        (drive(start=70.0, until=90.0), 0.0),
    ],
)
def test_driven_length(trajectory, expected):
    length = ComparedDrive.of(trajectory, ROAD, AnthropomorphicSettings()).length
    assert length == pytest.approx(expected, abs=1e-9)


def test_a_shorter_drive_scales_the_score_and_a_longer_one_does_not():
    # The ADS stops at 30 m; the drivers at 30, 60 (the road's end) and 60 m: L = 30, mean 50, f_L =
    # 0.6.
    drivers = [stopping(30.0), drive(), drive(14.0)]
    index = anthropomorphic_index(stopping(30.0), drivers, ROAD)
    assert index.ingredients.ads_length == 30.0
    assert index.ingredients.mean_length == 50.0
    assert index.length_factor == pytest.approx(0.6, rel=1e-12)
    assert index.ingredients.slices == 61  # 0 .. 30
    beyond = anthropomorphic_index(drive(), drivers, ROAD)
    assert beyond.length_factor == 1.0
    assert beyond.ingredients.slices == 101  # 0 .. 50
    assert IndexNote("driver_not_so_far", 40, 101) in beyond.notes  # 30.5 .. 50


def test_drivers_that_ended_earlier_hold_their_last_position():
    # Two stop at 20 m at y = 0, one passes at 1.5 m: mean length 33.3 m. Everywhere mean 0.5,
    # deviation 0.866.
    drivers = [stopping(20.0), stopping(20.0), drive(y=1.5)]
    index = anthropomorphic_index(drive(y=0.5 + 2.5 * math.sqrt(0.75)), drivers, ROAD)
    assert index.ingredients.slices == 68  # 0 .. 33, and 33.33
    assert index.ingredients.centre_similarity == pytest.approx(math.exp(2.0 - 3.125), rel=1e-9)
    # 20.5, 21, .. 33 and 33.33
    assert IndexNote("drivers_hold_last_y", 27, 68) in index.notes


# --- worked numbers: slices -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "start, length, expected",
    [
        *values_of("""
    0.0, 1.5, [0.0, 0.5, 1.0, 1.5]
    2.0, 1.2, [2.0, 2.5, 3.0, 3.2]  # the last interval is shorter: the end itself
    0.0, 0.3, [0.0, 0.3]
    7.0, 0.0, [7.0]
    """),
        (0.0, 1.0 - 1e-9, [0.0, 0.5, 1.0]),  # rounding is no interval
        (0.0, 1.0 + 1e-9, [0.0, 0.5, 1.0]),
        (0.0, 540.0, np.arange(1081) / 2.0),
    ],
)
def test_slices_every_half_metre(start, length, expected):
    assert slice_positions(start, length, 0.5) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    "x, y, positions, expected",
    values_of("""
    [0, 10, 20], [0, 1, 3], [5, 15, 10, 25], [0.5, 2, 1, 3]  # at last beyond its end
    [0, 10, 20], [0.5, 1, 3], [-4], [0.5]  # before its start
    # stands: where it first got there, and goes on from where it stood last
    [0, 10, 10, 10, 20], [0, 1, 2, 3, 4], [10, 15], [1, 3.5]
    # rolls back: first crossing; 9 -> 12 after rolling back
    [0, 10, 9, 12], [0, 1, 2, 5], [9.5, 11], [0.95, 4]
    [3], [7], [3, 4], [7, 7]
    [0, 0, 0], [1, 2, 3], [0, 0.5], [1, 3]  # never moves
    """),
)
def test_lateral_position_at_the_first_crossing(x, y, positions, expected):
    t = Trajectory(np.arange(len(x)), x, y)
    assert lateral_position(t, positions) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "centre, expected",
    values_of("""
    # 1.2 m to the right edge: three parts of 0.4
    -0.55, [-1.75, -1.35, -0.95, -0.55, -0.05, 0.45, 0.95]
    # 0.6 m to the left edge: three parts of 0.2
    4.65, [3.15, 3.65, 4.15, 4.65, 4.85, 5.05, 5.25]
    -2.0, [-2.0, -2.0, -2.0, -2.0, -1.5, -1.0, -0.5]  # off the road on the right
    6.0, [4.5, 5.0, 5.5, 6.0, 6.0, 6.0, 6.0]  # and on the left
    """),
)
def test_seven_points_a_slice(centre, expected):
    points = slice_points(np.array([3.0, 4.0]), np.array([1.0, centre]), ROAD)
    assert points.shape == (2, 7, 2)
    np.testing.assert_array_equal(points[:, :, 0], [[3.0] * 7, [4.0] * 7])
    assert points[1, :, 1] == pytest.approx(expected, abs=1e-12)


# --- operations -----------------------------------------------------------------------------------


def signal(*parts):
    """(value, seconds) parts at 0.1 s."""
    return [value for value, seconds in parts for _ in range(round(seconds / 0.1))]


def recorded(**channels):
    n = len(next(iter(channels.values())))
    quiet = {"acceleration": np.zeros(n), "steering_wheel_angle": np.zeros(n)}
    return Trajectory(0.1 * np.arange(n), 2.0 * np.arange(n), np.zeros(n), **(quiet | channels))


OUT, BACK, NONE = (12.0, 1.0), (-12.0, 1.0), (0.0, 1.0)


WHEEL = AnthropomorphicSettings(steering_rule="wheel")


@pytest.mark.parametrize("pause, moves", [(0.5, 1), (1.0, 2)])
def test_moves_aside_are_two_with_a_rest_between(pause, moves):
    """Twice 1.2 m at 0.3 m/s. Its mean over 1 s stays above 0.12 m/s in a pause of 0.5 s; in one of
    1 s it is not, for 0.8 s."""
    time = np.arange(0.0, 10.05, 0.1)
    y = 0.3 * (np.minimum(time, 4.0) + np.clip(time - 4.0 - pause, 0.0, 4.0))
    aside = Trajectory(time, 20.0 * time, y, speed=np.full(len(time), 20.0))
    assert count_operations(aside) == moves


@pytest.mark.parametrize(
    "degrees, expected",
    [
        (signal((10.0, 3.0)), 0),  # at the threshold: neutral
        (signal((10.01, 3.0)), 1),  # still running at the end
        (signal(OUT, BACK, NONE), 1),  # a lane change
        (signal(OUT, (0.0, 0.4), BACK, NONE), 1),  # through neutral for 0.4 s
        (signal(OUT, (0.0, 0.5), BACK, NONE), 2),  # for 0.5 s: ended
        (signal(OUT, (9.0, 1.0), OUT), 2),  # 9 deg is neutral
        (signal((11.0, 0.1), (0.0, 0.4), (11.0, 0.1), (0.0, 0.4), (11.0, 0.1)), 1),  # chatter
    ],
)
def test_steering_operations(degrees, expected):
    assert count_operations(recorded(steering_wheel_angle=np.radians(degrees)), WHEEL) == expected
    # it never leaves its line
    assert count_operations(recorded(steering_wheel_angle=np.radians(degrees))) == 0


@pytest.mark.parametrize(
    "acceleration, expected",
    [
        (signal((0.5, 2.0)), 0),
        (signal((2.0, 1.0), (0.6, 0.5), (2.0, 1.0)), 2),  # Eq. 12: one
        (signal((2.0, 1.0), (0.6, 0.4), (-2.0, 1.0)), 1),
        (signal((2.0, 1.0), (1.7, 0.5), (2.0, 1.0)), 1),  # not moved back: above 0.8 of 2
        (signal((1.0, 0.5), NONE, (1.0, 0.5), NONE, (3.0, 0.5)), 3),  # at the level of 1
        (signal((3.0, 0.5), (3.0 + 1e-12, 0.1), (2.0, 1.0)), 1),
    ],
)
def test_most_operations_at_any_level_by_hand(acceleration, expected):
    assert most_operations(recorded(acceleration=acceleration)) == expected


@given(st.lists(st.integers(-256, 256), min_size=1, max_size=120), st.integers(64, 640))
def test_law_a_stronger_signal_never_has_fewer_operations(steps, factor):
    """Up to 4 m/s2 in steps of 1/64, one to ten times as strong: products without rounding."""
    weak, strong = (np.array(steps) / 64.0 * scale for scale in (1.0, factor / 64.0))
    assert most_operations(recorded(acceleration=strong)) >= most_operations(
        recorded(acceleration=weak)
    )


def test_steering_and_pedals_add_up_by_their_settings():
    t = recorded(
        steering_wheel_angle=np.radians(signal(OUT, NONE, OUT)),
        acceleration=signal((1.0, 1.5), (0.0, 1.5)),
    )
    for changes, expected in values_of("""
    {}, 3
    {"steering_threshold_deg": 12.5}, 1
    {"acceleration_threshold": 1.5}, 2
    {"neutral_time": 1.1}, 2
    {"neutral_time": 0.0}, 3
    """):
        assert count_operations(t, replace(WHEEL, **changes)) == expected


def test_the_wheels_threshold_may_be_a_lateral_acceleration():
    # a = v^2 tan(angle / 16) / 2.7 m: at 10 m/s 2 m/s2 needs 16 atan(2.7 * 2 / 100) = 49.5 deg, at
    # 30 m/s 5.5 deg.
    chosen = replace(WHEEL, steering_lateral_acceleration=2.0)
    for speed, degrees, expected in values_of("""
    10.0, 49.4, 0
    10.0, 49.6, 1
    30.0, 5.4, 0
    30.0, 5.6, 1
    0.0, 500.0, 0
    """):
        turned = recorded(
            steering_wheel_angle=np.radians(signal((degrees, 1.0))), speed=np.full(10, speed)
        )
        assert count_operations(turned, chosen) == expected


def test_the_wheel_rule_is_refused_unless_both_sides_have_a_steering_signal():
    with_signal, without = drive(), without_steering([0.0] * 30)
    for ads, drivers in ((without, [with_signal] * 2), (with_signal, [with_signal, without])):
        with refusal("needs the steering wheel angle of the ADS and of all drivers"):
            anthropomorphic_index(ads, drivers, ROAD, WHEEL)


def test_the_same_drive_has_the_same_index_with_and_without_its_steering_signal():
    """A lane change at 25 m/s, with a wheel that turns by 30 degrees or with one that nobody
    recorded."""
    y = np.array(lateral((5.0, 6.0, 3.5)))
    road = Road("test", 900.0, 2, 3.5, 100.0)
    angles = np.where((y > 0.01) & (y < 3.49), np.radians(30.0), 0.0)
    unknown, *drivers = (without_steering(y + offset) for offset in (0.0, -0.2, 0.1, 0.3))
    known = replace(unknown, steering_wheel_angle=angles)
    values = [anthropomorphic_index(ads, drivers, road).value for ads in (known, unknown)]
    assert values[0] == values[1] > 0.9


def test_half_a_second_is_half_a_second_at_any_time():
    # 0.1 * 43 - 0.1 * 38 is 0.4999999999999996.
    for before in range(60):
        acceleration = [0.0] * before + signal((1.0, 0.1), (0.0, 0.5), (1.0, 0.1))
        assert count_operations(recorded(acceleration=acceleration)) == 2


def test_neutral_time_is_seconds_not_samples():
    # 0.04 s samples: 12 neutral ones last 0.48 s, 13 last 0.52 s.
    for neutral, expected in ((12, 1), (13, 2)):
        t = recorded(acceleration=[1.0] * 5 + [0.0] * neutral + [1.0] * 5)
        assert count_operations(replace(t, time=0.4 * t.time)) == expected


def test_unknown_steering_samples_are_left_out():
    angles = np.radians(signal(OUT, (math.nan, 1.0), OUT, NONE, (math.nan, 1.0), OUT))
    assert count_operations(recorded(steering_wheel_angle=angles), WHEEL) == 2


def without_steering(y, seed=None):
    n = len(y)
    noise = np.zeros(n) if seed is None else np.random.default_rng(seed).normal(0.0, 0.02, n)
    return Trajectory(
        0.1 * np.arange(n), 2.5 * np.arange(n), np.asarray(y) + noise, acceleration=np.zeros(n)
    )


def lateral(*moves):
    """y of moves (begin, duration, offset) over 40 s."""
    time = 0.1 * np.arange(400)
    return list(
        sum((offset * smooth_step((time - t) / d) for t, d, offset in moves), np.zeros(400))
    )


@pytest.mark.parametrize("seed", [None, 4])
@pytest.mark.parametrize(
    "y, expected",
    [
        (lateral(), 0),
        (lateral((5.0, 8.5, 3.5)), 1),  # a motorway lane change
        (lateral((5.0, 4.0, -3.5)), 1),
        (lateral((5.0, 8.0, 3.5), (20.0, 8.0, -3.5)), 2),  # overtakes and returns
        (lateral((5.0, 8.0, 3.5), (13.0, 8.0, -3.5)), 2),
        (lateral((5.0, 3.0, 3.5), (8.0, 3.0, -3.5)), 2),  # evades
        (lateral((5.0, 8.0, 0.9)), 0),  # makes room within its lane
        (lateral((5.0, 30.0, 1.5)), 0),  # drifts: 0.05 m/s on average, 0.09 at most
        (list(0.25 * np.sin(0.3 * np.arange(400) * 0.1)), 0),  # wanders
    ],
)
def test_without_steering_a_lateral_manoeuvre_is_one_operation(y, expected, seed):
    assert count_operations(without_steering(y, seed)) == expected


def test_one_sample_without_steering_is_not_a_manoeuvre():
    assert count_operations(Trajectory([0.0], [0.0], [0.0])) == 0


def test_more_operations_than_the_humans_lower_the_score_and_fewer_do_not_raise_it():
    # Drivers: 1 and 3 operations, mean 2. The ADS: 0, 1, 2, 4.
    def pressing(times):
        return drive(5.0, acceleration=(signal((1.0, 1.0), NONE) * times + [0.0] * 121)[:121])

    drivers = [pressing(1), pressing(3)]
    for times, factor in ((0, 1.0), (1, 1.0), (2, 1.0), (4, 0.5)):
        index = anthropomorphic_index(pressing(times), drivers, ROAD)
        made = index.ingredients
        assert made.ads_operations == times
        assert made.mean_operations == 2.0
        assert index.operation_factor == factor
        assert index.value == factor * index.similarity


def test_operations_where_drivers_make_none_give_0_and_a_note():
    index = anthropomorphic_index(drive(acceleration=1.0), [drive(), drive()], ROAD)
    assert index.value == 0.0
    assert index.operation_factor == 0.0
    assert IndexNote("drivers_without_operation", 1, 1) in index.notes


# --- the human-likeness of a case -----------------------------------------------------------------


def test_operations_have_the_tolerance_of_everything_else():
    # Drivers make 1, 2 and 3: mean 2, deviation 1. Up to 4 is within two deviations; 5: exp(2 -
    # 9/2), 6: exp(2 - 8).
    expected = [1.0, 1.0, 1.0, math.exp(-2.5), math.exp(-6.0)]
    found = [operation_tolerance(operations, [1, 2, 3]) for operations in (0, 2, 4, 5, 6)]
    assert found == pytest.approx(expected, rel=1e-12)
    # All make none: the deviation is at least 0.5, so one is within two of them, two are not: exp(2
    # - 16/2).
    assert operation_tolerance(1, [0, 0]) == 1.0
    assert operation_tolerance(2, [0, 0]) == pytest.approx(math.exp(-6.0), rel=1e-12)


def test_the_likeness_has_the_similarity_of_mixture_mode_in_either_mode():
    """Drivers of two manoeuvres: one Gaussian calls the ADS between both usual, mixture mode does
    not."""
    change = (1.0, 2.0, 3.5)
    changing = [drive(5.0, y, until=64.5, lane_change=change) for y in (0.0, 0.1)]
    keeping = [drive(5.0, y, until=64.5) for y in (0.0, 0.1, 0.2)]
    ads = drive(5.0, 1.5, until=64.5)
    gaussian, mixture = (
        anthropomorphic_index(ads, [*changing, *keeping], ROAD, AnthropomorphicSettings(mode=mode))
        for mode in ("gaussian", "mixture")
    )
    assert gaussian.likeness == mixture.likeness
    assert gaussian.likeness.mixture_similarity == mixture.similarity < 0.1 * gaussian.similarity
    assert gaussian.likeness.value == mixture.similarity  # f_L and f_n+ are 1


# --- notes ----------------------------------------------------------------------------------------


def test_an_ordinary_case_has_no_notes():
    drivers = [drive(v, y) for v, y in ((13.0, -0.4), (15.0, 0.0), (17.0, 0.4))]
    assert anthropomorphic_index(drive(), drivers, ROAD).notes == ()


@pytest.mark.parametrize(
    "ads, drivers, note",
    [
        (drive(), [drive(y=y) for y in (0.0, 0.1, 3.4, 3.5)], IndexNote("two_groups", 121, 121)),
        (drive(), [drive()] * 2, IndexNote("field_floor", 847, 847)),
        (drive(y=-2.0), [drive()] * 2, IndexNote("ads_off_road", 121, 121)),
        (drive(until=30.0), [drive()] * 2, IndexNote("ads_still_driving", 1, 1)),
        (drive(y=6.0, until=30.0), [drive()] * 2, IndexNote("ads_left_the_road", 1, 1)),
        (drive(), [drive(), drive(until=30.0)], IndexNote("drivers_still_driving", 1, 2)),
        (drive(), [drive(), drive(start=5.0)], IndexNote("drivers_start_late", 1, 2)),
    ],
)
def test_a_reading_that_applies_is_noted(ads, drivers, note):
    assert note in anthropomorphic_index(ads, drivers, ROAD).notes


@pytest.mark.parametrize(
    "offsets",
    values_of("""
    0.0, 0.1, 0.2, 3.5
    0.0, 3.3, 3.4, 3.5
    0.0, 0.1, 1.8, 1.9
    0.0, 3.5
    """),
)
def test_one_outlier_or_a_small_gap_is_not_bimodal(offsets):
    notes = anthropomorphic_index(drive(), [drive(y=y) for y in offsets], ROAD).notes
    assert not [note for note in notes if note.kind == "two_groups"]


def test_a_group_that_did_not_get_there_does_not_make_it_bimodal():
    drivers = [drive(y=0.0), drive(y=0.1), stopping(30.0, 3.4), stopping(30.0, 3.5)]
    notes = anthropomorphic_index(drive(), drivers, ROAD).notes
    # Mean length 45 m: 91 slices, 61 of them up to 30 m.
    assert IndexNote("two_groups", 61, 91) in notes


# --- Eq. 13 ---------------------------------------------------------------------------------------


def test_the_index_over_the_safe_zone():
    # (0.5 * 3 + 1.0 * 1) / 4 = 0.625
    assert exposure_weighted_index([0.5, 1.0], [3.0, 1.0]) == pytest.approx(0.625, rel=1e-14)
    assert exposure_weighted_index([0.5, 1.0], [0.0, 2.0]) == 1.0


@pytest.mark.parametrize(
    "values, exposure, words",
    rows_of(
        """
[0.5, 1.0] | [1.0] | equally long
[[0.5, 1.0]] | [[1.0, 1.0]] | equally long
[0.5, NaN] | [1.0, 1.0] | `values` .* finite, got nan
[0.5, 1.0] | [1.0, -1.0] | `exposure` .* at least 0, got -1.0
[0.5, 1.0] | [1.0, NaN] | `exposure` .* got nan
[0.5, 1.0] | [1.0, Infinity] | `exposure` .* got inf
[0.5, 1.0] | [0.0, 0.0] | sum of `exposure` .* greater than 0
[] | [] | sum of `exposure` .* greater than 0
""",
        json.loads,
        json.loads,
    ),
)
def test_the_weighted_index_refuses(values, exposure, words):
    with refusal(words):
        exposure_weighted_index(values, exposure)


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize("drivers", [[], [drive()]])
def test_fewer_than_two_drivers_are_not_a_reference(drivers):
    with refusal(f"at least 2, got {len(drivers)}"):
        anthropomorphic_index(drive(), drivers, ROAD)


def test_an_ads_that_starts_past_the_roads_end_is_refused():
    with refusal(r"start of road `test` must be before its end at x = 60 m, got 60.0"):
        anthropomorphic_index(drive(start=60.0, until=80.0), [drive()] * 2, ROAD)
