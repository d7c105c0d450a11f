"""The ego as a machine: worked numbers, closed forms, and laws over random states and commands."""

import cmath
import itertools
import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from road_scenes import advance

from sumo_eval.cosim.vehicle_model import (
    GRAVITY,
    KINEMATIC_UP_TO,
    LIMITED,
    Command,
    EgoState,
    drive,
    grip_steering_wheel_angle,
    move_dynamic,
    slip_rates,
)
from sumo_eval.settings import VehicleSettings

CAR = VehicleSettings()
STEPS = (0.01, 0.05, 0.1)
at_every_step = pytest.mark.parametrize("step", STEPS)
GRIP = CAR.friction * GRAVITY  # 0.92 * 9.81 = 9.0252 m/s2


def driving(*motion):
    """The ego at the start of the road, with its speed, acceleration and wheel angle."""
    return EgoState(0.0, 0.0, 0.0, *motion)


def run(state, command, step, duration, limits=CAR):
    """Every state from the start to `duration`, and the names of all clips."""
    states, names = [state], set()
    for _ in range(round(duration / step)):
        state, clips = advance(state, command, limits, step)
        states.append(state)
        names |= {clip[0] for clip in clips}
    return states, names


# --- braking --------------------------------------------------------------------------------------


@at_every_step
@pytest.mark.parametrize("speed", [5.0, 13.9, 20.0, 30.0])
def test_the_braking_distance_is_build_up_plus_plateau_at_any_step(step, speed):
    # build-up: a falls to -9 m/s2 within 0.15 s at -60 m/s3:
    #   distance v*0.15 - 60*0.15^3/6 = 0.15 v - 0.03375 m, speed v - 60*0.15^2/2 = v - 0.675 m/s
    # plateau: (v - 0.675)^2 / (2*9); at 20 m/s: 2.96625 + 19.325^2/18 = 2.96625 + 20.74753 =
    # 23.71378 m
    expected = 0.15 * speed - 0.03375 + (speed - 0.675) ** 2 / 18.0
    states, _ = run(driving(speed), Command(-9.0), step, 5.0)
    assert states[-1].speed == 0.0
    assert states[-1].x == pytest.approx(expected, abs=1e-9)


@at_every_step
def test_a_stop_inside_the_build_up_is_exact_too(step):
    # v = 0.3 m/s: 0.3 = 60 t^2/2, t = 0.1 s; distance 0.3*0.1 - 60*0.001/6 = 0.03 - 0.01 = 0.02 m
    states, _ = run(driving(0.3), Command(-9.0), step, 0.5)
    assert states[-1].x == pytest.approx(0.02, abs=1e-12)
    assert states[-1].speed == 0.0


def test_a_standing_vehicle_does_not_reverse_however_long_it_brakes():
    states, names = run(EgoState(3.0, 1.0, 0.2, 0.0), Command(-9.0), 0.05, 2.0)
    assert {(state.x, state.y, state.speed, state.acceleration) for state in states} == {
        (3.0, 1.0, 0.0, 0.0)
    }
    assert names == set()  # holding a standing vehicle is granted


@at_every_step
def test_brakes_are_released_as_fast_as_they_build_up_and_drive_begins_only_then(step):
    # from -6 m/s2 to +2: release 6/60 = 0.1 s, then drive 2/10 = 0.2 s. Speed after 0.3 s:
    #   20 - 6*0.1/2 + 2*0.2/2 = 20 - 0.3 + 0.2 = 19.9 m/s; before it has reached 2 m/s2 it must not
    # have it
    states, _ = run(driving(20.0, -6.0), Command(2.0), step, 0.3)
    assert states[-1].speed == pytest.approx(19.9, abs=1e-9)
    assert states[-1].acceleration == pytest.approx(2.0)
    after_release = states[round(0.2 / step)]  # 0.1 s of drive at 10 m/s3
    assert after_release.acceleration == pytest.approx(1.0)


def test_releasing_the_brakes_within_a_step_does_not_skip_the_drive_jerk():
    # -0.5 m/s2 is released in 0.5/60 = 0.00833 s; the 0.09167 s left of the step bring 10*0.09167 =
    # 0.9167 m/s2, not 4
    state, clips = advance(driving(20.0, -0.5), Command(4.0), CAR, 0.1)
    assert state.acceleration == pytest.approx(0.916667, abs=1e-6)
    assert ("acceleration_rate", 4.0, state.acceleration) in clips


# --- drive ----------------------------------------------------------------------------------------


@at_every_step
@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_drive_rises_with_its_jerk(step, speed):
    # 0 -> 4 m/s2 at 10 m/s3 takes 0.4 s and brings 4*0.4/2 = 0.8 m/s; distance v*0.4 + 10*0.4^3/6
    states, _ = run(driving(speed), Command(4.0), step, 0.4)
    assert states[-1].speed == pytest.approx(speed + 0.8)
    assert states[-1].x == pytest.approx(0.4 * speed + 0.1066667)
    accelerations = [state.acceleration for state in states]
    assert max(b - a for a, b in itertools.pairwise(accelerations)) <= 10.0 * step + 1e-12


def test_drive_has_a_limit_and_more_is_recorded():
    state, clips = advance(driving(10.0, 4.0), Command(9.0), CAR, 0.1)
    assert state.acceleration == 4.0
    assert clips == (("acceleration", 9.0, 4.0),)


@at_every_step
def test_a_vehicle_that_stops_while_its_brakes_are_released_starts_again_gently(step):
    # 0.03 m/s with the brakes at -6: it stands after 0.005 s, and from there drive rises at 10
    # m/s3:
    #   after 0.1 s: v = 10*(0.1 - t)^2/2 with t = 0.005 s to within a hair (release at 60 m/s3
    # shifts t by < 2 us)
    states, _ = run(driving(0.03, -6.0), Command(4.0), step, 0.1)
    assert states[-1].speed == pytest.approx(5.0 * 0.095**2, rel=1e-2)


def test_the_top_speed_is_kept_and_recorded():
    states, names = run(driving(59.9), Command(4.0), 0.05, 2.0)
    assert states[-1].speed == CAR.max_speed
    assert "speed" in names
    assert max(state.speed for state in states) == CAR.max_speed


# --- steering -------------------------------------------------------------------------------------


def test_the_steady_turning_radius_of_the_rear_axle_is_wheelbase_over_tan_of_the_road_wheel_angle():
    # steering wheel 160 deg / 16 = 10 deg at the road wheel: R = 2.7 / tan(10 deg) = 2.7/0.176327 =
    # 15.3125 m
    wheel = math.radians(160.0)
    states, _ = run(driving(3.0, 0.0, wheel), Command(0.0, wheel), 0.05, 10.0)
    half = CAR.wheelbase / 2
    rear = [(s.x - half * math.cos(s.heading), s.y - half * math.sin(s.heading)) for s in states]
    # heading 0, turning left: the centre is straight to the left
    centre = (rear[0][0], rear[0][1] + 15.3125)
    assert all(math.dist(point, centre) == pytest.approx(15.3125, abs=1e-3) for point in rear)


def test_a_full_circle_closes():
    # circumference of the rear axle's circle 2 pi 15.3125 = 96.2114 m; driven at just the speed
    # that takes 10 s
    wheel = math.radians(160.0)
    circumference = 2 * math.pi * CAR.wheelbase / math.tan(math.radians(10.0))
    states, _ = run(
        EgoState(7.0, -3.0, 0.4, circumference / 10.0, 0.0, wheel), Command(0.0, wheel), 0.05, 10.0
    )
    end = states[-1]
    assert end.x == pytest.approx(7.0, abs=1e-9)
    assert end.y == pytest.approx(-3.0, abs=1e-9)
    assert end.heading == pytest.approx(0.4 + math.tau)


def test_the_steering_wheel_stops_at_its_end_stop():
    states, names = run(driving(0.0), Command(0.0, 100.0), 0.05, 1.0)
    assert states[-1].steering_wheel_angle == pytest.approx(math.radians(540.0))
    assert "steering_angle" in names


def test_the_steering_wheel_turns_no_faster_than_its_rate():
    # 720 deg/s * 0.05 s = 36 deg a step
    state, clips = advance(driving(0.0), Command(0.0, -2.0), CAR, 0.05)
    assert state.steering_wheel_angle == pytest.approx(-math.radians(36.0))
    assert [clip[0] for clip in clips] == ["steering_rate"]


@at_every_step
def test_cornering_stays_within_the_friction_limit(step):
    # v^2/R <= mu g = 9.0252 m/s2; at 20 m/s the tightest radius is 400/9.0252 = 44.32 m
    states, names = run(driving(20.0), Command(0.0, 9.0), step, 3.0)
    last, end = states[-2], states[-1]
    assert 20.0 * abs(end.heading - last.heading) / step == pytest.approx(GRIP, rel=1e-9)
    assert "lateral_friction" in names


def test_the_grip_angle_is_the_one_whose_cornering_needs_all_the_grip():
    angle = grip_steering_wheel_angle(20.0, CAR)
    radius = CAR.wheelbase / math.tan(angle / CAR.steering_ratio)
    assert 20.0**2 / radius == pytest.approx(GRIP)
    # no limit, standing
    assert grip_steering_wheel_angle(0.0, CAR) > math.radians(CAR.max_steering_wheel_angle_deg)


def test_the_grip_angle_beside_braking_needs_only_what_braking_leaves():
    # sqrt(9.0252^2 - 7^2) = sqrt(81.454 - 49) = 5.6969 m/s2
    angle = grip_steering_wheel_angle(20.0, CAR, 7.0)
    assert 20.0**2 * math.tan(angle / CAR.steering_ratio) / CAR.wheelbase == pytest.approx(
        5.6969, abs=1e-3
    )


@at_every_step
@pytest.mark.parametrize(
    "start, command",
    [
        (driving(30.0, -9.0), Command(-9.0, 3.0)),  # steering while braking hard
        (driving(30.0), Command(-9.0, 3.0)),  # both at once
        (driving(5.0, 4.0), Command(4.0, 9.0)),  # driving out of a corner
    ],
)
def test_braking_and_cornering_together_stay_within_the_friction_circle(step, start, command):
    states, names = run(start, command, step, 2.0)
    for state in states[1:]:
        bend = math.tan(state.steering_wheel_angle / CAR.steering_ratio) / CAR.wheelbase
        assert math.hypot(state.acceleration, state.speed**2 * bend) <= GRIP * (1 + 1e-9)
    assert names & {"friction", "lateral_friction"}


# --- laws -----------------------------------------------------------------------------------------

states = st.builds(
    EgoState,
    x=st.floats(-100, 100),
    y=st.floats(-10, 10),
    heading=st.floats(-3.1, 3.1),
    speed=st.floats(0, 60),
    acceleration=st.floats(-9, 4),
    steering_wheel_angle=st.just(0.0),
)
commands = st.builds(Command, acceleration=st.floats(-30, 30), steering=st.floats(-20, 20))
steps = st.sampled_from(STEPS)


@given(states, commands, steps)
def test_law_speed_and_acceleration_stay_within_the_limits(state, command, step):
    after, _ = advance(state, command, CAR, step)
    assert 0.0 <= after.speed <= CAR.max_speed
    assert -CAR.max_deceleration - 1e-9 <= after.acceleration <= CAR.max_acceleration + 1e-9
    gained = (after.speed - state.speed) / step
    assert -CAR.max_deceleration - 1e-9 <= gained <= CAR.max_acceleration + 1e-9


@given(st.floats(0, 55), st.floats(-9, 4), st.floats(-9, 4))
def test_law_ten_short_steps_drive_as_far_as_one_long_one(speed, acceleration, target):
    a, v, far = acceleration, speed, 0.0
    for _ in range(10):
        a, v, distance = drive(v, a, target, CAR, 0.01)
        far += distance
    once = drive(speed, acceleration, target, CAR, 0.1)
    assert v == pytest.approx(once[1], abs=1e-9)
    assert far == pytest.approx(once[2], abs=1e-9)


@given(states, commands, steps)
def test_law_a_clip_is_recorded_exactly_when_a_request_is_not_granted(state, command, step):
    after, clips = advance(state, command, CAR, step)
    standing = after.speed == 0.0  # brakes that hold a standing vehicle are granted
    granted_acceleration = standing or abs(after.acceleration - command.acceleration) <= 1e-9
    granted_steering = after.steering_wheel_angle == command.steering
    named = {clip[0] for clip in clips}
    if not standing:
        assert bool(named & {"acceleration", "acceleration_rate", "friction", "speed"}) == (
            not granted_acceleration
        )
    assert bool(named & {"steering_angle", "steering_rate", "lateral_friction"}) == (
        not granted_steering
    )


@given(states, commands, steps, st.floats(-3, 3), st.floats(-500, 500), st.floats(-500, 500))
def test_law_moving_and_turning_the_world_moves_nothing_else(state, command, step, turn, dx, dy):
    def moved(it):
        return complex(dx, dy) + complex(it.x, it.y) * cmath.rect(1.0, turn)

    start = moved(state)
    elsewhere = state._replace(x=start.real, y=start.imag, heading=state.heading + turn)
    here, _ = advance(state, command, CAR, step)
    there, _ = advance(elsewhere, command, CAR, step)
    assert there.speed == here.speed
    assert complex(there.x, there.y) == pytest.approx(moved(here), abs=1e-6)


# --- beyond the kinematic model -------------------------------------------------------------------


def test_a_curve_above_0_4_g_is_beyond_the_kinematic_model():
    # 20 m/s on 1 / R: 400 / R = 0.4 g at R = 101.9 m; road wheel atan(2.7 / R), times 16
    for radius, beyond in ((105.0, False), (98.0, True)):
        wheel = 16.0 * math.atan(2.7 / radius)
        _, clips = advance(driving(20.0, 0.0, wheel), Command(0.0, wheel), CAR, 0.05)
        assert ("beyond_kinematic" in {clip[0] for clip in clips}) == beyond
        assert all(clip[2] == KINEMATIC_UP_TO for clip in clips if clip[0] == "beyond_kinematic")


FOOT, POUND = 0.3048, 4.4482216152605
BMW = SimpleNamespace(
    friction=1.0489, cornering_stiffness=21.92 / 1.0489, wheelbase=FOOT * (3.793293 + 4.667707),
    front_share=3.793293 / (3.793293 + 4.667707), centre_height=FOOT * 2.01355,
    mass=POUND / FOOT * 74.91452,
    yaw_inertia=POUND * FOOT * 1321.416,
)  # fmt: skip
"""Vehicle 2 of commonroad-vehicle-models."""


def test_slip_and_yaw_rates_of_linear_tyres_are_the_published_ones():
    # test_st of commonroad-vehicle-models: x_st, u and f_st, whose last two are the rates of yaw
    # rate and of slip
    state = 15.7216236334290116, 0.0033012170610298, 0.0529001056654038, 0.0197545248559617
    slipping, turning, used = slip_rates(*state, 5.3536773276413925, BMW, math.inf)
    assert turning == pytest.approx(0.6435589397748606, abs=1e-12)
    assert slipping == pytest.approx(0.0313297971641291, abs=1e-12)
    assert used == 0.0


DYNAMIC = VehicleSettings(model="dynamic")


def drive_dynamic(speed, wheel, duration, step=0.05, wanted=0.0, limits=DYNAMIC, **start):
    clips = [SimpleNamespace(count=0, first=0.0, requested=0.0, applied=0.0) for _ in LIMITED]
    names = ("x", "y", "heading", "speed", "acceleration", "steering", "slip", "yaw_rate")
    ego = SimpleNamespace(**dict.fromkeys(names, 0.0) | {"speed": speed, "time": 0.0} | start)
    for _ in range(round(duration / step)):
        move_dynamic(ego, ego, wanted, wheel, limits, step, clips)
    met = {name: clip for name, clip in zip(LIMITED, clips, strict=True) if clip.count}
    return [getattr(ego, name) for name in names], met


def test_a_gentle_curve_has_the_yaw_rate_of_the_linear_model():
    # yaw rate = v delta / (L + K v^2), K = m (l_r / (C F_zr share ...)): equal stiffness over load:
    # K = 0, neutral
    (*_, yaw_rate), clips = drive_dynamic(20.0, 16.0 * math.radians(0.3), 6.0)
    assert yaw_rate == pytest.approx(20.0 * math.radians(0.3) / 2.7, rel=0.01)
    assert not clips


@pytest.mark.parametrize(
    "changes", [{"mass": 3000.0}, {"cornering_stiffness": 90.0}, {"yaw_inertia": 300.0}]
)
def test_slow_curve_does_not_depend_on_the_step(changes):
    limits = VehicleSettings(model="dynamic", **changes)
    coarse, fine = (drive_dynamic(2.3, 0.8, 4.0, step, limits=limits)[0] for step in (0.1, 0.01))
    assert coarse == pytest.approx(fine, abs=1e-2)


@pytest.mark.parametrize("friction, left", [(0.8, 0.0), (1.0, math.sqrt(GRAVITY**2 - 9.0**2))])
def test_law_a_clip_names_the_grip_that_full_braking_leaves(friction, left):
    limits = VehicleSettings(model="dynamic", friction=friction)
    braking = -min(9.0, friction * GRAVITY)
    _, clips = drive_dynamic(
        30.0, 0.5, 0.05, wanted=braking, limits=limits, acceleration=braking, steering=0.5
    )
    clip = clips["lateral_friction"]
    # m/s2: linear tyres at the angle of the front wheels
    linear = friction * limits.cornering_stiffness * GRAVITY * 0.5 / limits.steering_ratio
    assert clip.requested == pytest.approx(linear, rel=0.01)
    assert clip.applied == pytest.approx(left)


def test_tyres_of_the_dynamic_model_slip_at_the_friction_circle():
    wheel = 16.0 * math.radians(8.0)
    courses = []
    for steps in range(1, 41):
        (_, _, heading, _, _, _, slip, _), clips = drive_dynamic(25.0, wheel, 0.05 * steps)
        courses.append(heading + slip)
    # m/s2: v times the turn of its course
    across = [25.0 * (b - a) / 0.05 for a, b in itertools.pairwise(courses)]
    assert "lateral_friction" in clips
    assert 0.9 * GRIP < max(across) <= 1.001 * GRIP
    fine, _ = drive_dynamic(15.0, 16.0 * math.radians(2.0), 2.0, step=0.01)
    coarse, _ = drive_dynamic(15.0, 16.0 * math.radians(2.0), 2.0, step=0.05)
    assert math.dist(fine[:2], coarse[:2]) < 0.1
    stop, _ = drive_dynamic(10.0, 0.0, 3.0, wanted=-9.0)
    straight, _ = run(driving(10.0), Command(-9.0), 0.05, 3.0)
    assert stop[0] == pytest.approx(straight[-1].x, abs=1e-9)


@pytest.mark.parametrize(
    "given_to_it, got",
    [({"acceleration": 1.0, "speed": 2.0}, "both"), ({"steering": 0.2}, "neither")],
)
def test_a_command_says_whether_it_got_both_or_neither(given_to_it, got):
    with pytest.raises(TypeError, match=f"takes an acceleration or a speed, got {got}"):
        Command(**given_to_it)
