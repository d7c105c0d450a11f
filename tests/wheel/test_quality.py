"""How good a drive by a person is as a measurement: reactions by hand, and each bound with the
drive that breaks it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tables import rows_of

from sumo_eval.extras.wheel.quality import Quality, QualitySettings, first_event, reaction
from sumo_eval.scenario.catalogue import load
from sumo_eval.settings import VehicleSettings
from sumo_eval.trajectory import Recording, Trajectory

CAR = VehicleSettings()
TIME = np.arange(0.0, 5.0, 0.1)
GOOD = Quality(
    end="road_end", dropped=0.0, latency_ms=40.0, stalls=0, pauses=0, paused=0.0, event=1.0,
    reaction=0.5,
    unanswered=0.1, stepped_down=0, drawn="WebGL",
)  # fmt: skip


def drive(*, brakes=np.inf, steers=np.inf, bend=0.0):
    """At 20 m/s; from `brakes`, s, -0.6 m/s2; from `steers` the wheel at 0.04 rad;

    bend: the heading's rate, rad/s.
    """
    acceleration = np.where(brakes - 1e-9 <= TIME, -0.6, 0.0)
    angle = np.where(steers - 1e-9 <= TIME, 0.04, 0.0)
    ego = Trajectory(
        TIME, 20.0 * TIME, np.zeros(len(TIME)), heading=-bend * TIME,
        speed=np.full(len(TIME), 20.0),
        acceleration=acceleration, steering_wheel_angle=angle,
    )  # fmt: skip
    return Recording(ego, {}, None, "road_end")


@pytest.mark.parametrize(
    "recording, after",
    [
        (drive(brakes=2.3), 1.3),
        (drive(steers=1.8), 0.8),  # 400 tan(0.04 / 16) / 2.7 = 0.37 m/s2 across, beyond 0.35
        (drive(brakes=2.3, steers=1.8), 0.8),
        (drive(brakes=0.5, steers=0.5), None),  # what was there before the event answers nothing
        (drive(), None),
        (drive(bend=0.08), None),  # the road bends by 1.6 m/s2 across, and nobody moves the wheel
    ],
)
def test_a_reaction_is_what_hands_and_feet_did_after_the_event(recording, after):
    assert reaction(recording, 1.0, CAR) == (None if after is None else pytest.approx(after))


@pytest.mark.parametrize(
    "name, time",
    [
        ("front_vehicle_braking", 0.0),
        ("motorway_braking", 0.0),  # to a lower speed, not to 0
        ("swerving_lead", 0.5),
        ("front_vehicle_low_speed", None),
        ("turn_across_path", None),  # it turns along its path from the start
    ],
)
def test_first_event_is_the_first_change_of_motion_at_a_known_time(name, time):
    logical = load(name)
    case = logical.concrete(**logical.point(0.5 * (logical.low + logical.high)))
    assert first_event(case) == time


def test_each_bound_marks_the_drive_that_breaks_it_and_no_other():
    rule = QualitySettings()
    assert GOOD.against(rule) == ()
    for change, words in rows_of(
        """
{"dropped": 0.21} | share of late pictures 0.21, at most 0.2
{"latency_ms": 151.0} | input to picture, 95 %, ms 151, at most 150
{"stalls": 3} | steps so late that the clock was reset 3, at most 2
{"pauses": 2} | pauses 2, at most 1
{"unanswered": 1.1} | no answer of the window, s 1.1, at most 1
{"stepped_down": 1} | times that the road was drawn more cheaply in mid-drive 1, at most 0
{"end": "off_road"} | left the road
{"end": "quit"} | ended before its end
{"end": "contact"} | touched another vehicle
{"end": "sim_error"} | a fault of the simulation
""",
        json.loads,
    ):
        assert replace(GOOD, **change).against(rule) == (words,)
    assert replace(GOOD, end="quit").against(replace(rule, quit=True)) == ()
    assert (
        replace(GOOD, stepped_down=None, unanswered=None, drawn=None).against(rule) == ()
    )  # a tape that does not tell


def test_the_participant_reads_the_share_of_late_pictures():
    assert "100 % of the pictures came late." in replace(GOOD, dropped=1.0).sentences()
