"""Scripted motion of one vehicle at one time is, to the last bit, what the array functions say."""

from hypothesis import example, given
from hypothesis import strategies as st

from sumo_eval.scenario import Actor, Start, brake_to_stop, lane_change, motion
from sumo_eval.scenario.concrete import braked_distance, braked_speed, smooth_step

TIMES = st.floats(-1.0, 60.0)


@given(TIMES, st.floats(0.0, 5.0), st.floats(0.1, 10.0), st.floats(-4.0, 4.0))
def test_a_lane_change_is_the_smooth_step_to_the_last_bit(time, begin, duration, offset):
    move = lane_change(begin, duration, offset)
    share = min(max((time - begin) / duration, 0.0), 1.0)
    assert motion.lateral_motion(move, time) == (
        float(offset * smooth_step(share)),
        float(offset / duration * motion.quintic_rate(share)),
        float(offset / duration**2 * motion.quintic_bend(share)),
    )


@given(TIMES, st.floats(0.0, 5.0), st.floats(0.0, 60.0), st.floats(0.1, 12.0))
@example(1.0, 0.0, 1.175494351e-38, 0.1)  # t to the power of 2 is not t times t there
def test_a_brake_is_the_braked_motion_to_the_last_bit(time, begin, speed, deceleration):
    brake, since = brake_to_stop(begin, deceleration), time - begin
    assert motion.time_to_stand(brake, speed) == speed / deceleration
    distance = speed * begin + float(braked_distance(speed, deceleration, since))
    assert motion.braked(brake, speed, time) == (
        distance,
        float(braked_speed(speed, deceleration, since)),
    )


def test_a_brake_that_never_begins_keeps_the_speed():
    actor = Actor("a", Start(5.0, 0.0, 10.0), (brake_to_stop(float("inf"), 5.0),))
    assert actor.x(2.0) == 25.0
    assert actor.speed(2.0) == 10.0


def test_a_lane_change_of_next_to_no_time_moves_at_once():
    actor = Actor("a", Start(5.0, 0.0, 10.0), (lane_change(1.0, 1e-300, 3.5),))
    assert [actor.y(time) for time in (1.0, 1.01)] == [0.0, 3.5]
    assert actor.lateral_speed(1.0) == actor.lateral_speed(1.01) == 0.0
