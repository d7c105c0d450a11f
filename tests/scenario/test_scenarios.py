"""The shipped logical scenarios and what a logical scenario promises about its space."""

import itertools
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_eval.errors import InputError
from sumo_eval.scenario import (
    Actor,
    Approach,
    Constraint,
    LaneChange,
    LogicalScenario,
    Parameter,
    Road,
    Start,
    catalogue,
)
from sumo_eval.scenario.concrete import ConcreteScenario, smooth_step, smooth_step_rate
from sumo_eval.scenario.sampling import sample

LOW_SPEED, CUT_OUT = catalogue.load("front_vehicle_low_speed"), catalogue.load("front_vehicle_cut_out")
ALL = sorted(catalogue.SCENARIOS.values(), key=lambda logical: logical.name)
each = pytest.mark.parametrize("logical", ALL, ids=lambda logical: logical.name)


# --- what ships -------------------------------------------------------------------------------------------------------


def test_the_papers_scenarios_ship_with_the_agreed_parameters():
    agreed = {
        "front_vehicle_low_speed": [("ego_speed", 10, 30, 5, "m/s"), ("lead_speed", 0, 20, 5, "m/s")],
        "front_vehicle_cut_out": [
            ("ego_speed", 10, 30, 5, "m/s"), ("obstacle_speed", 0, 20, 5, "m/s"), ("gap", 20, 120, 10, "m"),
        ],
    }  # fmt: skip
    for name, parameters in agreed.items():
        shipped = catalogue.load(name).parameters
        assert [(p.name, p.low, p.high, p.step, p.unit) for p in shipped] == parameters


@each
def test_every_scenario_is_filed_under_its_name_and_explains_itself(logical):
    assert catalogue.SCENARIOS[logical.name] is logical
    assert all((logical.about, logical.source, logical.exposure_about))
    assert all(parameter.about and parameter.unit for parameter in logical.parameters)
    assert len(set(logical.names)) == len(logical.names)


@each
def test_the_default_steps_end_where_the_range_ends(logical):
    assert sample(logical).notes == ()


def test_an_unknown_scenario_is_answered_with_the_nearest_name():
    with pytest.raises(InputError, match=r"Unknown logical scenario .* Did you mean `front_vehicle_cut_out`"):
        catalogue.load("front_vehicle_cutout")


def test_a_scenario_may_be_a_module_or_a_file_of_the_users(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from sumo_eval.scenario.catalogue import FRONT_VEHICLE_CUT_OUT as MINE\nOTHER = 3\n"
    )
    assert catalogue.find("mine.py:MINE", tmp_path) is CUT_OUT
    assert catalogue.find("front_vehicle_cut_out") is CUT_OUT
    with pytest.raises(InputError, match="must be a LogicalScenario, got int"):
        catalogue.find("mine.py:OTHER", tmp_path)


# --- where everybody starts -------------------------------------------------------------------------------------------


def test_low_speed_starts_3_5_s_of_ego_speed_behind_the_lead():
    concrete = LOW_SPEED.concrete(ego_speed=20.0, lead_speed=5.0)
    (lead,) = concrete.actors
    # 3.5 * 20 = 70 m from bumper to bumper: centres 70 + 4.5 m apart
    assert lead.start.x - concrete.ego.x == pytest.approx(74.5)
    assert (concrete.ego.speed, lead.start.speed, concrete.ego.y, lead.start.y) == (20.0, 5.0, 0.0, 0.0)
    assert lead.lane_changes == ()


def test_cut_out_measures_the_gap_from_the_ego_to_the_obstacle():
    concrete = CUT_OUT.concrete(ego_speed=20.0, obstacle_speed=10.0, gap=70.0)
    lead, obstacle = concrete.actors
    assert obstacle.start.x - concrete.ego.x == pytest.approx(74.5)
    # the lead: 1 s * 20 m/s = 20 m ahead, since there is room: 70 - 4.5 - 1.3*10 = 52.5 m
    assert lead.start.x - concrete.ego.x == pytest.approx(24.5)
    assert (lead.start.speed, obstacle.start.speed) == (20.0, 10.0)
    assert lead.lane_changes == (LaneChange(0.0, 2.0, 3.5),)
    assert lead.y(2.0) == 3.5


def test_cut_out_keeps_the_lead_nearer_where_there_is_less_room():
    # 40 - 4.5 - 1.3*(20 - 0) = 9.5 m, less than 1 s of 20 m/s
    lead, _ = CUT_OUT.concrete(ego_speed=20.0, obstacle_speed=0.0, gap=40.0).actors
    assert lead.start.x - 50.0 - 4.5 == pytest.approx(9.5)


@each
def test_every_concrete_scenario_starts_within_the_road_and_apart(logical):
    for concrete in logical.concretes(sample(logical).points):
        starts = sorted([concrete.ego, *(actor.start for actor in concrete.actors)], key=lambda start: start.x)
        assert all(0.0 < start.x < logical.road.length for start in starts)
        assert all(b.x - a.x >= 4.5 for a, b in itertools.pairwise(starts) if a.y == b.y)
        assert concrete.road is logical.road


@each
def test_the_approach_describes_what_is_placed(logical):
    points = sample(logical).points
    approach = logical.approach(logical.columns(points))
    for index, concrete in enumerate(logical.concretes(points)):
        ahead = concrete.actors[-1]  # the one that matters: the lead, or the revealed obstacle
        assert approach.ego_speed[index] == concrete.ego.speed
        assert approach.obstacle_speed[index] == ahead.start.speed
        assert approach.gap[index] == pytest.approx(ahead.start.x - concrete.ego.x - 4.5)


# --- refusals ---------------------------------------------------------------------------------------------------------

GOOD = {"ego_speed": 20.0, "obstacle_speed": 10.0, "gap": 70.0}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"gap": 150}, "`gap` of scenario `front_vehicle_cut_out` must be within 20..120 m, got 150"),
        ({"gap": np.float64(19.0)}, "must be within 20..120 m, got 19.0."),
        ({"ego_speed": math.nan}, "`ego_speed` of scenario `front_vehicle_cut_out` must be within 10..30 m/s, got nan"),
        ({"ego_speed": "20"}, "`ego_speed` of scenario `front_vehicle_cut_out` must be a number, got '20'"),
        ({"ego_speed": True}, "must be a number, got True"),
        ({"gpa": 70.0}, "Unknown parameter of scenario `front_vehicle_cut_out` `gpa`. Did you mean `gap`?"),
        ({"gap": None}, "must be a number, got None"),
        (
            {"ego_speed": 10.0, "obstacle_speed": 15.0},
            "The point of scenario `front_vehicle_cut_out` must be one where the obstacle is slower than the ego "
            "(obstacle_speed < ego_speed), got 'ego_speed=10, obstacle_speed=15, gap=70'",
        ),
        (
            {"ego_speed": 30.0, "obstacle_speed": 0.0, "gap": 40.0},
            "must be one where the lead can leave the lane before it reaches the obstacle "
            "(gap >= 6.5 m + 1.3 s * (ego_speed - obstacle_speed)), got 'ego_speed=30, obstacle_speed=0, gap=40'",
        ),
    ],
)
def test_a_point_that_is_not_one_is_refused_with_its_sentence(change, sentence):
    with pytest.raises(InputError) as caught:
        CUT_OUT.concrete(**{**GOOD, **change})
    assert sentence in str(caught.value)


def test_a_missing_parameter_is_named():
    with pytest.raises(InputError, match="Parameter `gap` of scenario `front_vehicle_cut_out` is missing"):
        CUT_OUT.concrete(ego_speed=20.0, obstacle_speed=10.0)


def test_points_of_another_space_are_refused():
    with pytest.raises(InputError, match="must be 3 long"):
        CUT_OUT.columns(np.zeros((5, 2)))


@pytest.mark.parametrize(
    ("low", "high", "step"),
    [(3.0, 3.0, 1.0), (4.0, 3.0, 1.0), (0.0, math.inf, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, math.nan)],
)
def test_a_parameter_without_a_range_or_a_step_is_refused(low, high, step):
    with pytest.raises(InputError, match="of parameter `p` must be"):
        Parameter("p", low, high, step, "m", "a test")


def test_two_vehicles_of_one_name_are_refused():
    road = Road("r", 100.0, 1, 3.5, 0.0)
    for names in (("ego",), ("a", "a")):
        actors = tuple(Actor(name, Start(50.0 + 10 * i, 0.0, 1.0)) for i, name in enumerate(names))
        with pytest.raises(InputError, match="The names of the vehicles of scenario `s` must be distinct"):
            ConcreteScenario("s", {}, 1.0, road, Start(10.0, 0.0, 1.0), actors)


# --- the space --------------------------------------------------------------------------------------------------------


@each
def test_law_the_unit_box_and_back_is_the_same_point(logical):
    points = sample(logical).points
    assert logical.from_unit(logical.to_unit(points)) == pytest.approx(points)
    assert logical.to_unit(np.array([logical.low, logical.high])) == pytest.approx(
        np.array([[0.0] * len(logical.names), [1.0] * len(logical.names)])
    )


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)))
def test_law_a_point_is_feasible_exactly_when_it_can_be_made_concrete(unit):
    point = CUT_OUT.from_unit(unit)
    possible = bool(CUT_OUT.feasible(point[None])[0])
    try:
        CUT_OUT.concretes(point[None])
    except InputError:
        assert not possible
    else:
        assert possible


def test_feasible_and_columns_take_one_point_as_well_as_many():
    point = np.array([20.0, 10.0, 70.0])
    assert CUT_OUT.feasible(point).shape == ()
    assert CUT_OUT.feasible(point[None]).shape == (1,)
    assert CUT_OUT.feasible(np.broadcast_to(point, (2, 4, 3))).shape == (2, 4)
    assert CUT_OUT.columns(point)["gap"] == 70.0
    assert list(CUT_OUT.row({"gap": 70.0, "obstacle_speed": 10.0, "ego_speed": 20.0})) == [20.0, 10.0, 70.0]


def test_the_box_includes_its_edges():
    inside = CUT_OUT.in_box([[10.0, 0.0, 20.0], [30.0, 20.0, 120.0], [30.0, 20.0, 120.1], [9.9, 0.0, 20.0]])
    assert inside.tolist() == [True, True, False, False]


def test_exposure_is_uniform_unless_a_scenario_says_otherwise():
    assert CUT_OUT.concrete(**GOOD).exposure == 1.0
    columns = CUT_OUT.columns(sample(CUT_OUT).points)
    assert CUT_OUT.exposure(columns).tolist() == [1.0] * len(columns["gap"])


def test_a_scenario_of_ones_own_has_its_exposure_and_constraints():
    mine = LogicalScenario(
        name="mine", about="a", source="b",
        parameters=(Parameter("gap", 1.0, 9.0, 1.0, "m", "g"),),
        constraints=(Constraint("even", lambda v: v["gap"] % 2 == 0),),
        road=Road("r", 100.0, 1, 3.5, 0.0),
        place=lambda v: (Start(10.0, 0.0, 5.0), (Actor("a", Start(20.0 + v["gap"], 0.0, 1.0)),)),
        approach=lambda v: Approach(v["gap"], v["gap"], v["gap"], 0.0),
        exposure=lambda v: 2.0 * v["gap"],
    )  # fmt: skip
    assert sample(mine).points.ravel().tolist() == [2.0, 4.0, 6.0, 8.0]
    assert sample(mine).refused.ravel().tolist() == [1.0, 3.0, 5.0, 7.0, 9.0]
    assert mine.concrete(gap=4).exposure == 8.0
    with pytest.raises(InputError, match="must be even, got 'gap=3'"):
        mine.concrete(gap=3)


def test_a_concrete_scenario_travels_to_a_child_process():
    concrete = CUT_OUT.concrete(**GOOD)
    again = pickle.loads(pickle.dumps(concrete))
    assert again == concrete
    assert again.label == "ego_speed=20, obstacle_speed=10, gap=70"


# --- roads and lateral moves ------------------------------------------------------------------------------------------


def test_the_road_lies_to_the_left_of_its_right_lane():
    road = Road("r", 100.0, 2, 3.5, 0.0)
    assert (road.right_edge, road.left_edge) == (-1.75, 5.25)
    assert [road.lane_centre(lane) for lane in (0, 1)] == [0.0, 3.5]


def test_a_lateral_move_starts_and_ends_at_rest_and_is_half_done_half_way():
    move = LaneChange(begin=1.0, duration=4.0, offset=-3.5)
    assert [move.lateral(t) for t in (0.0, 1.0, 3.0, 5.0, 9.0)] == pytest.approx([0.0, 0.0, -1.75, -3.5, -3.5])
    assert [move.lateral_speed(t) for t in (0.0, 1.0, 5.0, 9.0)] == [0.0, 0.0, 0.0, 0.0]
    assert move.lateral_speed(3.0) == pytest.approx(-3.5 / 4.0 * 1.875)


def test_law_the_rate_is_the_derivative_of_the_smooth_step():
    share = np.linspace(0.0, 1.0, 10_001)
    assert np.gradient(smooth_step(share), share) == pytest.approx(smooth_step_rate(share), abs=1e-3)
    assert np.all(np.diff(smooth_step(share)) >= 0)


def test_moves_of_one_vehicle_add_up():
    actor = Actor("a", Start(0.0, 0.0, 10.0), (LaneChange(0.0, 2.0, 3.5), LaneChange(3.0, 2.0, -3.5)))
    assert [actor.y(t) for t in (0.0, 2.0, 2.5, 5.0)] == pytest.approx([0.0, 3.5, 3.5, 0.0])
