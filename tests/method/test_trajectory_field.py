"""Laws and worked numbers of the trajectory field, Eqs. 9-10."""

import json
import math

import numpy as np
import pytest
from commands import python
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal
from tables import rows_of, values_of
from twins import trajectory_field as twin

from sumo_eval import Trajectory
from sumo_eval.method import trajectory_field as module
from sumo_eval.method.field_loops import magnitude_sum
from sumo_eval.method.trajectory_field import trajectory_field, trajectory_fields
from sumo_eval.settings import FieldSettings

STEP = 0.1


def one_sample(speed):
    return Trajectory([0.0], [0.0], [0.0], heading=[0.0], speed=[speed])


def winding(seed, n=40, step=STEP):
    """A drive that turns through more than a full circle, speeds up, and stands for a while."""
    rng = np.random.default_rng(seed)
    speed = np.clip(rng.normal(12.0, 6.0) + np.cumsum(rng.normal(0.0, 1.0, n)), 0.0, None)
    heading = np.cumsum(rng.normal(0.2, 0.3, n))
    speed[n // 2 : n // 2 + 5], heading[n // 2 : n // 2 + 5] = 0.0, heading[n // 2]
    x, y = np.cumsum(speed * np.cos(heading) * step), np.cumsum(speed * np.sin(heading) * step)
    wrapped = np.arctan2(np.sin(heading), np.cos(heading))
    return Trajectory(step * np.arange(n), x, y, heading=wrapped, speed=speed)


def around(trajectory, n, seed=7):
    """Points near and far, and some exactly on samples."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-60.0, 60.0, (n, 2))
    points[::5] = np.column_stack((trajectory.x, trajectory.y))[
        rng.integers(0, len(trajectory), len(points[::5]))
    ]
    points[1::5] = points[::5][: len(points[1::5])] + rng.normal(0.0, 0.3, (len(points[1::5]), 2))
    return points


# --- worked numbers -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "point, k1, k2, expected",
    values_of("""
    # v = 20 m/s, k2 v = 0.1; 4 m away, 4^0.5 = 2.
    (4.0, 0.0), 0.5, 0.005, 0.5525854590378238  # ahead: exp(0.1) / 2
    (-4.0, 0.0), 0.5, 0.005, 0.4524187090179798  # behind: exp(-0.1) / 2
    (0.0, 4.0), 0.5, 0.005, 0.5  # beside: exp(0) / 2
    (3.0, 4.0), 0.5, 0.005, 0.4748677398138  # 5 m, cos theta = 0.6: exp(0.06) / sqrt(5)
    # k2 v = 1; 10 m away.
    (10.0, 0.0), 1.0, 0.05, 0.2718281828459045  # e / 10
    (-10.0, 0.0), 2.0, 0.05, 0.0036787944117144  # exp(-1) / 100
    # Nearer than 1 m the distance counts as 1 m, the angle as it is.
    (0.25, 0.0), 0.5, 0.005, 1.1051709180756477  # exp(0.1)
    (-0.25, 0.0), 0.5, 0.005, 0.9048374180359595  # exp(-0.1)
    (-1e-6, 0.0), 0.5, 0.005, 0.9048374180359595
    (0.0, 0.0), 0.5, 0.005, 1.1051709180756477  # on the vehicle: dead ahead of it
    # on it but for the rounding of coordinates
    (-1e-10, 0.0), 0.5, 0.005, 1.1051709180756477
    """),
)
def test_one_vehicle_at_the_origin_at_20_metres_per_second(point, k1, k2, expected):
    assert trajectory_field([point], one_sample(20.0), k1=k1, k2=k2) == pytest.approx(
        [expected], rel=1e-12
    )


# --- laws of a trajectory -------------------------------------------------------------------------


@given(
    turn=st.floats(-math.pi, math.pi),
    east=st.floats(-1e4, 1e4),
    north=st.floats(-1e4, 1e4),
    seed=st.integers(0, 100),
)
def test_moving_or_rotating_the_world_moves_nothing(turn, east, north, seed):
    drive = winding(seed, n=20)
    points = around(drive, 20)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    x, y = rotation @ np.array([drive.x, drive.y]) + np.array([[east], [north]])
    moved = Trajectory(drive.time + 17.0, x, y, heading=drive.heading + turn, speed=drive.speed)
    elsewhere = points @ rotation.T + [east, north]
    # 1e4 m are known to 2e-12 m, so angles to a point 1e-3 m away are known to 2e-9.
    assert trajectory_field(elsewhere, moved) == pytest.approx(
        trajectory_field(points, drive), rel=1e-8
    )


def test_many_trajectories_at_once_are_each_alone_to_the_last_bit():
    drives = [winding(seed, n=10 + seed) for seed in range(5)]
    points = around(drives[0], 300)
    together = trajectory_fields(points, drives, FieldSettings(k1=1.0, k2=0.02))
    assert together.shape == (5, 300)
    for row, drive in zip(together, drives, strict=True):
        np.testing.assert_array_equal(row, trajectory_field(points, drive, k1=1.0, k2=0.02))


def test_same_input_same_bytes_whatever_other_points_there_are():
    drive = winding(3)
    points = around(drive, 700)
    field = trajectory_field(points, drive)
    assert trajectory_field(points, drive).tobytes() == field.tobytes()
    assert trajectory_field(points[::-1], drive)[::-1] == pytest.approx(field, rel=1e-14)
    assert trajectory_field(points[400:401], drive) == pytest.approx(field[400:401], rel=1e-14)


def test_no_points_and_no_trajectories_are_empty_answers():
    assert trajectory_field(np.empty((0, 2)), winding(1)).shape == (0,)
    assert trajectory_fields([(0.0, 0.0)], [], FieldSettings()).shape == (0, 1)


# --- sampling -------------------------------------------------------------------------------------


def test_a_trajectory_on_the_grid_is_used_as_it_is_to_the_last_bit():
    drive = winding(5)
    jitter = np.random.default_rng(0).uniform(-4e-7, 4e-7, len(drive)) * (np.arange(len(drive)) > 0)
    unsteady = Trajectory(
        drive.time + jitter, drive.x, drive.y, heading=drive.heading, speed=drive.speed
    )
    points = around(drive, 50)
    assert trajectory_field(points, unsteady).tobytes() == trajectory_field(points, drive).tobytes()


@pytest.mark.parametrize(
    "times, grid",
    [([0.0, 0.15, 0.2], [0.0, 0.1, 0.2]), ([0.0, 0.1, 0.15], [0.0, 0.1])],
    ids=["uneven, though their number fits", "a remainder shorter than the interval"],
)
def test_law_the_sum_is_over_the_samples_of_the_grid(times, grid):
    found, expected = (
        trajectory_field(
            [(6.0, 1.0), (9.0, 1.0)],
            Trajectory(
                t, 20.0 * np.array(t), *np.multiply.outer([0.0, 0.0, 20.0], np.ones(len(t)))
            ),
        )
        for t in (times, grid)
    )
    assert found == pytest.approx(expected, rel=1e-14)


def test_another_sample_interval_sums_other_samples():
    drive = winding(8, n=41)
    points = around(drive, 20)
    every_other = [twin.trajectory_field(point, drive, interval=0.2) for point in points]
    assert trajectory_field(points, drive, sample_interval=0.2) == pytest.approx(
        every_other, rel=1e-9
    )


# --- the clever against the plain -----------------------------------------------------------------


@pytest.mark.parametrize(
    "k1, k2",
    values_of("""
    0.5, 0.005
    0.0, 0.005
    1.0, 0.05
    2.0, 0.05
    0.7, 0.005
    0.5, 0.0
    3.0, 1.0
    0.5, 1.0
    """),
)
@pytest.mark.parametrize("step", [STEP, 0.04, 0.23])
@pytest.mark.parametrize("superposition", ["magnitude", "vector"])
def test_the_kernels_are_the_plain_loops(k1, k2, step, superposition):
    drive = winding(int(100 * step), n=25, step=step)
    points = around(drive, 30)
    loops = {"magnitude": twin.trajectory_field, "vector": twin.vector_field}[superposition]
    plain = [loops(point, drive, k1, k2) for point in points]
    field = trajectory_field(points, drive, k1=k1, k2=k2, superposition=superposition)
    assert field == pytest.approx(plain, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("n", [1, 255, 256, 257, 900])
def test_compiled_sum_is_the_plain_loops_for_any_number_of_points(n):
    drive = winding(n, n=12)
    points = around(drive, n)
    samples = module.samples_of(drive, 0.005, STEP)
    for k1 in (0.5, 1.0, 2.0, 0.3):
        plain = [twin.trajectory_field(point, drive, k1) for point in points]
        np.testing.assert_allclose(magnitude_sum(points, samples, k1), plain, rtol=1e-12)
    few = points[:3]
    np.testing.assert_allclose(magnitude_sum.py_func(few, samples, k1), plain[:3], rtol=1e-12)


def test_far_from_all_points_of_a_block_the_field_is_exact_to_1e_13():
    # Points that lie together and samples beside them take the loop without decisions, up to 40 m/s
    # at 0.005 s/m.
    points = np.random.default_rng(3).uniform((0.0, -3.0), (5.0, 3.0), (300, 2))
    for place in values_of("""
        6.2, 0.0
        -2.0, 40.0
        3e3, -4.0
        -1e7, 1e7
        -3.0, -4.1
        """):
        for speed in (0.0, 5.0, 39.9, 40.0, 40.1, 69.0, 71.0):
            ends = [*zip(place, (1e4, 3.0), strict=True)]
            drive = Trajectory([0.0, 0.1], *ends, [0.3, 2.0], [speed, 30.0])
            plain = [twin.trajectory_field(point, drive) for point in points[:40]]
            np.testing.assert_allclose(trajectory_field(points, drive)[:40], plain, rtol=1e-13)


def test_the_inlined_exponential_is_exact_to_1e_13():
    speeds = np.concatenate((np.linspace(-70.0, 70.0, 281), np.geomspace(1e-6, 60.0, 50)))
    for k2 in (0.005, 0.05):
        field = [trajectory_field([(0.5, 0.0)], one_sample(v), k2=k2)[0] for v in speeds]
        np.testing.assert_allclose(field, np.exp(k2 * speeds), rtol=1e-13)
    # exp amplifies the rounding of its argument, 700 * 1.1e-16 = 8e-14, so more cannot be asked for
    # here.
    large = -700.0, -99.9, 333.3, 700.0
    field = [trajectory_field([(0.5, 0.0)], one_sample(v), k2=1.0)[0] for v in large]
    np.testing.assert_allclose(field, np.exp(large), rtol=1e-12)


# --- vectors --------------------------------------------------------------------------------------


def test_vectors_cancel_on_the_path_where_magnitudes_peak():
    # Standing at 0, then at 10 m (there for one sample each): half way the two pull in opposite
    # directions.
    two = Trajectory([0.0, 0.1], [0.0, 10.0], [0.0, 0.0], speed=[0.0, 0.0], heading=[0.0, 0.0])
    assert trajectory_field([(5.0, 0.0)], two, superposition="vector") == pytest.approx(
        [0.0], abs=1e-15
    )
    assert trajectory_field([(5.0, 0.0)], two) == pytest.approx([2 / math.sqrt(5.0)], rel=1e-14)
    # On a sample only the other one, 10 m away, has a direction.
    assert trajectory_field([(0.0, 0.0)], two, superposition="vector") == pytest.approx(
        [10.0**-0.5], rel=1e-14
    )


def test_numba_is_imported_late():
    python("import sys, sumo_eval.method.trajectory_field; sys.exit('numba' in sys.modules)")


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change, words",
    [
        *rows_of(
            r"""
{"points": [1.0, 2.0]} | `points` .* \(n, 2\)
{"k1": -0.1} | `k1` .* at least 0, got -0.1
{"k1": Infinity} | `k1` .* finite
{"k2": -0.1} | `k2` .* at least 0
{"k2": NaN} | `k2` .* got nan
{"k2": 1.5} | `k2` .* at most 1, got 1.5
{"sample_interval": 0.0} | `sample_interval` .* greater than 0
{"sample_interval": NaN} | `sample_interval` .* got nan
{"sample_interval": Infinity} | `sample_interval` .* got inf
{"superposition": "sum"} | `superposition` .* 'magnitude', 'vector', got 'sum'
""",
            json.loads,
        ),
        ({"points": [(1.0, 2.0, 3.0)]}, r"`points` .* \(n, 2\)"),
        ({"points": [(1.0, math.nan)]}, r"`points` .* finite, got nan"),
        (
            {"k2": 1.0, "trajectory": one_sample(720.0)},
            r"`k2` times the speed .* at most 700, got 720",
        ),
    ],
)
def test_a_field_refuses(change, words):
    arguments = {"points": [(1.0, 2.0)], "trajectory": one_sample(20.0)}
    trajectory_field(**arguments)
    with refusal(words):
        trajectory_field(**(arguments | change))
