"""From keys, wheel and stick to commands: the law's numbers by hand, a scripted driver who changes
lanes."""

import math

import pytest
from road_scenes import advance

from sumo_eval.cosim.vehicle_model import Command, EgoState
from sumo_eval.extras.wheel.hands import (
    BRAKE,
    BRAKES,
    BRAKES_HARD,
    DRIVE,
    DRIVES,
    EVADE,
    HARD,
    LEFT,
    RIGHT,
    WIDEST,
    Given,
    Hands,
    angle_of,
)  # fmt: skip
from sumo_eval.settings import VehicleSettings

CAR = VehicleSettings()
STEP = 0.02


def test_the_limit_gives_the_stated_acceleration_across_the_road():
    """At 20 m/s: 16 atan(3 * 2.7 / 400) = 0.32396 rad; v^2 tan(angle / 16) / 2.7 = 3 m/s2."""
    angle = angle_of(3.0, 20.0, CAR)
    assert angle == pytest.approx(0.32396, abs=1e-5)
    assert 400.0 * math.tan(angle / 16.0) / 2.7 == pytest.approx(3.0)
    assert angle_of(3.0, 0.0, CAR) == WIDEST == math.radians(450.0)


def test_a_held_key_turns_to_the_limit_in_its_time_and_back_in_its_own():
    hands, limit = Hands(CAR, STEP), angle_of(3.0, 20.0, CAR)
    angles = [hands.command(Given(keys=LEFT), 20.0).steering for _ in range(20)]
    assert angles[14] == pytest.approx(limit)  # 0.3 s are 15 steps
    assert angles[13] < limit
    assert angles[-1] == pytest.approx(limit)
    back = [hands.command(Given(), 20.0).steering for _ in range(9)]
    assert back[6] > 0.0
    assert back[7] == 0.0  # 0.15 s are 7.5 steps
    assert hands.command(Given(keys=LEFT | RIGHT), 20.0).steering == 0.0
    for _ in range(30):
        hands.command(Given(keys=RIGHT | EVADE), 20.0)
    assert hands.angle == pytest.approx(-angle_of(6.0, 20.0, CAR))


def test_no_hand_is_faster_than_the_vehicle_lets_it():
    hands = Hands(CAR, STEP)
    before = 0.0
    for step in range(200):
        angle = hands.command(Given(keys=LEFT | EVADE if step % 40 < 20 else RIGHT), 1.0).steering
        assert abs(angle - before) <= math.radians(CAR.max_steering_wheel_rate_deg) * STEP
        before = angle


def test_pedals_and_keys_ask_for_what_they_say():
    hands = Hands(CAR, STEP)
    for keys, wanted in (
        (0, 0.0),
        (DRIVE, DRIVES),
        (BRAKE, -BRAKES),
        (BRAKE | HARD | DRIVE, -BRAKES_HARD),
    ):
        assert hands.command(Given(keys=keys), 20.0).acceleration == wanted
    assert (
        hands.command(Given("stick", 0, 0.0, 0.5, 0.0), 20.0).acceleration
        == 0.5 * CAR.max_acceleration
    )
    assert hands.command(Given("wheel", 0, 0.25, 0.0, 1.0), 20.0) == Command(
        -CAR.max_deceleration, 0.25
    )


@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0, 40.0])
def test_a_driver_with_two_keys_changes_lanes_and_keeps_them(speed):
    """Preview 1.2 s, deadband 0.35 m, reaction 0.26 s: over 3.5 m within 4 s, less than 1 m beyond,
    and kept."""
    hands, state = Hands(CAR, STEP), EgoState(0.0, 0.0, 0.0, speed)
    seen = []
    ys = []
    for _ in range(round(12.0 / STEP)):
        seen.append((state.y, state.heading))
        y, heading = seen[max(len(seen) - 14, 0)]
        off = 3.5 - (y + 1.2 * speed * heading)
        keys = LEFT if off > 0.35 else RIGHT if off < -0.35 else 0
        state, clips = advance(state, hands.command(Given(keys=keys), speed), CAR, STEP)
        assert not clips
        ys.append(state.y)
    assert max(ys) < 4.5
    assert min(ys[round(4.0 / STEP) :]) > 2.5
