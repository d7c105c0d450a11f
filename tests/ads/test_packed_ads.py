"""`idm` and `lane_changer` decide for many cases at once as they decide alone, to the last bit."""

import math

import numpy as np
import pytest
from road_scenes import BRIEFING
from side_by_side import assert_same_commands, assert_same_recordings, points

from sumo_eval.ads import elementwise
from sumo_eval.ads.car_following import Idm, IdmParameters
from sumo_eval.ads.lane_change import LanePath
from sumo_eval.ads.lane_changer import SMOOTH, LaneChanger
from sumo_eval.ads.packed_lane_change import PackedLanePaths
from sumo_eval.ads.packed_perception import first_least

BRISK = IdmParameters(headway=0.6, standstill_gap=1.5, acceleration=2.5, deceleration=3.0)


@pytest.mark.parametrize("others", [1, 2, 5])
@pytest.mark.parametrize("make", [Idm, LaneChanger, lambda: LaneChanger(SMOOTH, BRISK)])
def test_each_command_is_the_one_it_gives_alone_whatever_the_scene(make, others):
    assert_same_commands([make() for _ in range(90)], make().packed(BRIEFING), others, seed=others, steps=60)


@pytest.mark.parametrize("ads", [Idm, LaneChanger])
def test_a_subclass_which_may_decide_otherwise_has_no_packed_form(ads):
    assert ads().packed(BRIEFING) is not None
    assert type("Own", (ads,), {})().packed(BRIEFING) is None


def test_paths_side_by_side_are_each_the_one_alone():
    paths = [LanePath(0.0), LanePath(3.5), *(LanePath(0.0, 3.5, begin, 80.0) for begin in (0.0, 60.0, 100.0, 140.0))]
    packed = PackedLanePaths(paths)
    for x in (-5.0, 60.0, 77.7, 100.0, 140.0, 180.0, 240.0):
        everywhere = np.full(len(paths), x)
        assert bits(np.stack(packed.at(everywhere), axis=1)) == bits([path.at(x) for path in paths])
        assert bits(packed.y(everywhere)) == bits([path.y(x) for path in paths])
    packed.keep(np.array([1, 0]))
    assert bits(packed.y(np.zeros(2))) == bits([3.5, 0.0])


@pytest.mark.parametrize(
    ("scenario", "every"), [("front_vehicle_cut_out", 29), ("front_vehicle_low_speed", 4), ("cut_in", 331)]
)
@pytest.mark.parametrize("ads", ["idm", "lane_changer"])
def test_its_recordings_are_those_it_leaves_alone(ads, scenario, every):
    assert_same_recordings(points(scenario, every), lambda: ads)


def test_of_equal_keys_the_lowest_rank_counts_then_the_first():
    keys = np.array([[2.0, 1.0, np.inf, 4.0], [2.0, 1.0, np.inf, 3.0]])
    rank = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    assert first_least(keys, rank).tolist() == [1, 0, 0, 1]


def bits(values):
    return np.asarray(values).tobytes()


@pytest.mark.parametrize("agrees", [True, False])
def test_sines_and_cosines_are_those_of_math(agrees, monkeypatch):
    if not agrees:
        monkeypatch.setattr(elementwise, "_exponential_agrees", lambda: False)
    rng = np.random.default_rng(1)
    angles = np.concatenate([rng.uniform(-size, size, 30_000) for size in (1e-3, 2.5, 100.0)] + [[0.0, -0.0]])
    sine, cosine = elementwise.circle(angles.reshape(2, -1))
    assert bits(sine.ravel()) == bits(list(map(math.sin, angles)))
    assert bits(cosine.ravel()) == bits(list(map(math.cos, angles)))


@pytest.mark.campaign
def test_forty_million_sines_and_cosines_are_those_of_math():
    rng = np.random.default_rng(2)
    for size in (1.0, 2.5, 3.0, 100.0) * 10:
        angles = rng.uniform(-size, size, 1_000_000)
        sine, cosine = elementwise.circle(angles)
        assert bits(sine) == bits(list(map(math.sin, angles.tolist())))
        assert bits(cosine) == bits(list(map(math.cos, angles.tolist())))


def test_other_functions_go_number_by_number():
    base, power = np.array([[2.0, 3.0], [0.3, 7.0]]), np.array([[3.0, 0.5], [1.7, 0.0]])
    expected = [2.0**3.0, 3.0**0.5, 0.3**1.7, 7.0**0.0]
    assert elementwise.each(math.pow, base, power).tolist() == [expected[:2], expected[2:]]
