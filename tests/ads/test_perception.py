"""The sensor turns SUMO's poses into bodies on the road, and hides what is hidden."""

import math

import numpy as np
import pytest
from road_scenes import FakeTraci, mover

from sumo_eval.ads.perception import (
    Sensor,
    bumper_gap,
    gap_behind,
    lateral_overlap,
    lead_in_path,
    neighbours,
    visible,
)
from sumo_eval.cosim import Command, simulate
from sumo_eval.scenario import catalogue


def test_the_front_bumper_and_the_compass_angle_become_a_body_centre_and_a_heading():
    traci = FakeTraci({"ego": (100.0, 0.0, 90.0, 20.0), "other": (200.0, 3.0, 60.0, 10.0)}, length=4.0, width=2.0)
    me, (other,) = Sensor().look(traci, "ego")
    assert me == ("ego", 98.0, 0.0, 0.0, 20.0, 0.0, 2.0, 1.0, 0.0)
    assert other.heading == pytest.approx(math.radians(30.0))
    assert (other.x, other.y) == pytest.approx((200.0 - 2.0 * math.cos(math.pi / 6), 3.0 - 2.0 * math.sin(math.pi / 6)))
    assert (other.along, other.across) == pytest.approx((10.0 * math.cos(math.pi / 6), 5.0))
    assert other.half_length == pytest.approx(2.0 * math.cos(math.pi / 6) + 0.5)
    assert other.half_width == pytest.approx(1.0 + math.cos(math.pi / 6))


def test_the_sensor_sees_what_the_harness_records():
    seen = {}

    class Watcher:
        def reset(self, scenario, traci, ego):
            self.sensor = Sensor()

        def step(self, traci, ego, time):
            seen[round(time, 3)] = self.sensor.look(traci, ego)
            return Command(-1.0, 0.1)

    concrete = catalogue.load("front_vehicle_cut_out").concrete(ego_speed=20.0, obstacle_speed=5.0, gap=60.0)
    recording = simulate(concrete, Watcher())
    tracks = {"ego": recording.ego, **recording.actors}
    for index, time in enumerate(recording.ego.time[:-1]):
        me, others = seen[round(float(time), 3)]
        for body in (me, *others):
            track = tracks[body.name]
            recorded = [track.x[index], track.y[index], track.heading[index], track.speed[index]]
            assert [body.x, body.y, body.heading, body.speed] == pytest.approx(recorded, abs=1e-6)


def test_gaps_run_from_bumper_to_bumper():
    me = mover("ego", 100.0)
    assert bumper_gap(me, mover("ahead", 130.0)) == pytest.approx(25.5)
    assert gap_behind(me, mover("behind", 70.0)) == pytest.approx(25.5)
    assert bumper_gap(me, mover("beside", 102.0)) < 0.0


@pytest.mark.parametrize(("y", "overlap"), [(0.0, 1.8), (1.0, 0.8), (-1.0, 0.8), (1.8, 0.0), (3.5, -1.7)])
def test_lateral_overlap_is_the_shared_strip(y, overlap):
    assert lateral_overlap(mover("a", 0.0), mover("b", 10.0, y)) == pytest.approx(overlap)


def test_a_narrow_body_shares_no_more_than_its_own_width():
    narrow = mover("narrow", 10.0)._replace(half_width=0.2)
    assert lateral_overlap(mover("a", 0.0), narrow) == pytest.approx(0.4)


def test_the_lead_is_the_nearest_vehicle_in_the_strip_ahead():
    me = mover("ego", 100.0)
    behind, beside = mover("behind", 90.0), mover("beside", 110.0, 3.5)
    lead, obstacle = mover("lead", 130.0, 1.7), mover("obstacle", 160.0)
    assert lead_in_path(me, (obstacle, behind, lead, beside)) is lead
    assert lead_in_path(me, (obstacle, lead._replace(y=1.81))) is obstacle
    assert lead_in_path(me, (behind, beside)) is None


@pytest.mark.parametrize(
    ("lead_y", "share", "seen"),
    [(0.0, 0.0, False), (1.79, 0.0, False), (1.81, 0.0, True), (0.89, 0.5, False), (0.91, 0.5, True)],
)
def test_a_nearer_vehicle_hides_what_it_covers(lead_y, share, seen):
    lead, obstacle = mover("lead", 130.0, lead_y), mover("obstacle", 160.0)
    assert (obstacle in visible(mover("ego", 100.0), (obstacle, lead), share)) is seen


def test_nothing_behind_the_ego_hides_what_is_ahead():
    behind, ahead = mover("behind", 80.0), mover("ahead", 160.0)
    assert visible(mover("ego", 100.0), (behind, ahead), 0.0) == (behind, ahead)


def test_neighbours_are_the_nearest_in_the_strip_and_one_beside_is_both():
    me = mover("ego", 100.0)
    far, near, rear, right = (
        mover("far", 180.0, 3.5),
        mover("near", 130.0, 3.5),
        mover("r", 60.0, 3.5),
        mover("x", 110.0),
    )
    found = neighbours(me, (far, right, near, rear), centre=3.5, width=2.2)
    assert (found.ahead, found.behind) == (near, rear)
    beside = mover("beside", 103.0, 3.5)
    found = neighbours(me, (far, beside, rear), centre=3.5, width=2.2)
    assert (found.ahead, found.behind) == (beside, beside)
    assert neighbours(me, (right,), centre=3.5, width=2.2) == (None, None)


def test_a_vehicle_carried_on_moves_at_its_velocity():
    later = mover("a", 10.0, 1.0, along=20.0, across=-0.5).after(2.0)
    assert np.allclose((later.x, later.y, later.along), (50.0, 0.0, 20.0))
