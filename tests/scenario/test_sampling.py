"""The grid: exact decimals, both ends, C order, nothing silently missing."""

import json
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from refusals import refusal, refused
from road_scenes import every_point
from tables import rows_of

from sumo_eval.scenario import catalogue
from sumo_eval.scenario.joint import Joint
from sumo_eval.scenario.sampling.drawn_points import steadily
from sumo_eval.scenario.sampling.samples import central_point, sample
from tests.scenario.test_samplers import axis
from tests.scenario.test_samplers import space as box

CUT_OUT = catalogue.load("front_vehicle_cut_out")
LOW_SPEED = catalogue.load("front_vehicle_low_speed")


def space(*ranges):
    """A space without constraints: (low, high, step) of a, b, c."""
    return box(*(axis(name, *it) for name, it in zip("abc", ranges, strict=False)))


def test_the_first_parameter_is_the_slowest():
    assert every_point(space((0, 1, 1), (5, 7, 1))).tolist() == [
        [0, 5],
        [0, 6],
        [0, 7],
        [1, 5],
        [1, 6],
        [1, 7],
    ]


def test_levels_and_steps_by_name_leave_other_axes_as_they_are():
    points = every_point(CUT_OUT, levels={"ego_speed": 2}, steps={"gap": 50.0})
    assert np.unique(points[:, 0]).tolist() == [10.0, 30.0]
    assert np.unique(points[:, 1]).tolist() == [0.0, 5.0, 10.0, 15.0, 20.0]
    assert np.unique(points[:, 2]).tolist() == [20.0, 70.0, 120.0]


def test_every_grid_of_tenths_has_every_tenth_once():
    for low in range(30):
        for high in range(low + 1, 31):
            chosen = sample(space((low / 10, high / 10, 0.1)))
            assert chosen.points.ravel().tolist() == [tenth / 10 for tenth in range(low, high + 1)]
            assert chosen.notes == ()


decimals = st.decimals(min_value=-50, max_value=50, places=2)


@given(decimals, decimals, st.decimals(min_value="0.05", max_value=5, places=2))
def test_law_a_step_grid_is_that_of_decimal_arithmetic(low, high, step):
    assume(low < high)
    chosen = sample(space((float(low), float(high), float(step))))
    count = int((high - low) / step) + 1
    assert chosen.points.ravel().tolist() == [float(low + step * i) for i in range(count)]
    assert (chosen.notes == ()) == ((high - low) % step == 0)


@given(decimals, decimals, st.integers(2, 40))
def test_law_levels_start_at_low_end_at_high_and_grow(low, high, levels):
    assume(high - low > Decimal("0.05"))
    values = every_point(space((float(low), float(high), 1.0)), levels=levels).ravel()
    assert len(values) == levels
    assert values[0] == float(low)
    assert values[-1] == float(high)
    assert np.all(np.diff(values) > 0)
    assert np.diff(values) == pytest.approx((float(high) - float(low)) / (levels - 1), abs=1e-9)


def test_a_step_that_does_not_divide_the_range_is_said():
    chosen = sample(CUT_OUT, steps={"gap": 30.0})
    assert chosen.notes == (
        "`gap`: steps of 30 m from 20 do not end at 120; the last point is 110.",
    )
    assert np.unique(chosen.points[:, 2]).tolist() == [20.0, 50.0, 80.0, 110.0]
    assert np.unique(chosen.refused[:, 2]).tolist() == [20.0, 50.0, 80.0, 110.0]


def test_a_step_longer_than_the_range_leaves_one_point():
    chosen = sample(space((2.0, 3.0, 5.0)))
    assert chosen.points.tolist() == [[2.0]]
    assert "the last point is 2." in chosen.notes[0]


def test_possible_and_refused_points_are_the_whole_grid():
    chosen = sample(CUT_OUT)
    assert len(chosen.points) + len(chosen.refused) == 275
    assert CUT_OUT.feasible(chosen.points).all()
    assert not CUT_OUT.feasible(chosen.refused).any()
    merged = np.concatenate([chosen.points, chosen.refused])
    assert {tuple(row) for row in merged} == {tuple(row) for row in every_point(CUT_OUT)}
    # low speed: lead slower than the ego; of 5 x 5 the pairs (10, >=10), (15, >=15), (20, 20): 3 +
    # 2 + 1 are not
    assert len(sample(LOW_SPEED).points) == 19
    assert len(sample(LOW_SPEED).refused) == 6


def test_points_keep_the_grids_order():
    points = sample(CUT_OUT).points
    assert points.tolist() == sorted(points.tolist())


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        *rows_of(
            """
{"method": "gird"} | Unknown sampling method `gird`. Did you mean `grid`?
{"levels": {"gpa": 3}}
| Unknown parameter `gpa` of scenario `front_vehicle_cut_out`. Did you mean `gap`?
{"steps": {"ego_sped": 3}} | Did you mean `ego_speed`?
{"levels": 1} | must be a whole number of levels, at least 2, got 1
{"levels": {"gap": 1}}
| `gap` of the sampling of scenario `front_vehicle_cut_out` must be a whole number
{"levels": 2.5} | must be a whole number of levels, at least 2, got 2.5
{"levels": true} | must be a whole number of levels, at least 2, got True
{"steps": {"gap": 0.0}}
| `gap` of the sampling of scenario `front_vehicle_cut_out` must be a step greater than 0, got 0.0
{"steps": {"gap": -5}} | must be a step greater than 0, got -5
{"steps": {"gap": "10"}} | must be a step greater than 0, got '10'
{"levels": 3, "steps": {"gap": 10.0}} | must have levels or a step, got both
{"levels": {"gap": 3}, "steps": {"gap": 10.0}} | must have levels or a step, got both
{"steps": {"gap": 1e-07}} | must have at most 1,000,000 points, got 1,000,000,001
{"levels": 1000} | must have at most 1,000,000 points, got 1,000,000,000
""",
            json.loads,
        ),
        ({"steps": {"gap": float("nan")}}, "must be a step greater than 0, got nan"),
        ({"levels": 10**12}, "must have at most 1,000,000 points"),
    ],
)
def test_what_makes_no_grid_is_refused(arguments, sentence):
    with refused(sentence):
        sample(CUT_OUT, **arguments)


def test_the_central_point_is_on_the_grid_possible_and_nearest_to_the_centre():
    assert central_point(CUT_OUT).tolist() == [20.0, 10.0, 70.0]
    assert central_point(LOW_SPEED).tolist() == [20.0, 10.0]
    # 1 and 2 are as near to 1.5: the first
    assert central_point(space((0.0, 3.0, 1.0))).tolist() == [1.0]


def test_the_central_point_steps_aside_where_the_centre_is_impossible():
    from dataclasses import replace

    from sumo_eval.scenario import Constraint

    narrowed = replace(CUT_OUT, constraints=(Constraint("fast", lambda v: v["ego_speed"] > 22.0),))
    assert central_point(narrowed).tolist() == [25.0, 10.0, 70.0]


def test_the_additive_recurrence_fills_the_box_evenly():
    """1,000 points over 10 x 10 cells: 10 each on the mean, and nowhere fewer than 6 or more than
    14."""
    cells = np.floor(steadily(2, 1000) * 10.0).astype(int)
    counts = np.bincount(10 * cells[:, 0] + cells[:, 1], minlength=100)
    assert (counts.min() >= 6, counts.max() <= 14, counts.sum()) == (True, True, 1000)


def test_one_draw_of_a_joint_density_with_little_mass_inside():
    events = tuple((float(number), float(number % 3)) for number in range(20))
    stream = np.random.default_rng(0)
    narrow = Joint("kde", ("a", "b"), events, (8.9, 0.9), (9.1, 1.1))
    (point,) = narrow.draw(1, stream)
    assert (point >= narrow.low).all()
    assert (point <= narrow.high).all()
    nowhere = Joint("kde", ("a", "b"), events, (800.0, 0.9), (900.0, 1.1))
    with refusal("No draw of the joint distribution"):
        nowhere.draw(1, stream)


def test_law_a_copula_knows_no_order_of_equal_events():
    # every combination of two values equally often: independent, so the density is flat
    rows = [(a, b) for a in (0.25, 0.75) for b in (0.25, 0.75) for _ in range(50)]
    joint = Joint("copula", ("a", "b"), tuple(rows), (0.0, 0.0), (1.0, 1.0))
    assert joint.density([[0.25, 0.75]]) == pytest.approx(joint.density([[0.25, 0.25]]))
