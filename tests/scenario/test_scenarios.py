"""The shipped logical scenarios and what a logical scenario promises about its space."""

import csv
import itertools
import json
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from loaded import SHARED
from refusals import refusal, refused
from road_scenes import at_values
from scipy.integrate import cumulative_trapezoid
from tables import rows_of, values_of

from sumo_eval.errors import InputError
from sumo_eval.method.conflict import encounter
from sumo_eval.scenario import (
    Actor,
    Approach,
    ConcreteScenario,
    Constraint,
    LogicalScenario,
    Parameter,
    Road,
    Start,
    brake_to_stop,
    catalogue,
    constant_lateral,
    lane_change,
    motion,
)
from sumo_eval.scenario.file import check_points
from sumo_eval.scenario.logical import Search
from sumo_eval.scenario.resolved import find_with
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import SimulationSettings, VehicleSettings, ZoneSettings

LOW_SPEED, CUT_OUT = (
    catalogue.load("front_vehicle_low_speed"),
    catalogue.load("front_vehicle_cut_out"),
)
ZONES = ZoneSettings()
ALL = [catalogue.load(name) for name in catalogue.SCENARIOS]
each = pytest.mark.parametrize("logical", ALL, ids=lambda logical: logical.name)


# --- what ships -----------------------------------------------------------------------------------


@each
def test_every_scenario_is_filed_under_its_name_and_explains_itself(logical):
    assert catalogue.load(logical.name) is logical
    assert all((logical.about, logical.source, logical.exposure_about))
    assert all(parameter.about and parameter.unit for parameter in logical.parameters)
    assert len(set(logical.names)) == len(logical.names)


@each
def test_the_default_steps_end_where_the_range_ends(logical):
    assert sample(logical).notes == ()


@pytest.mark.parametrize("name", ["front_vehicle_cutout", "front_vehicle_cut_out.toml"])
def test_an_unknown_scenario_is_answered_with_the_nearest_name(name):
    with refusal(r"Unknown logical scenario .* Did you mean `front_vehicle_cut_out`"):
        catalogue.load(name)


def test_a_scenario_may_be_a_module_or_a_file_of_the_users(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from sumo_eval.scenario.catalogue import load\nMINE = "
        "load('front_vehicle_cut_out')\nOTHER = 3\n"
    )
    assert catalogue.find("mine.py:MINE", tmp_path) is CUT_OUT
    assert catalogue.find("front_vehicle_cut_out") is CUT_OUT
    with refusal("must be a LogicalScenario, got int"):
        catalogue.find("mine.py:OTHER", tmp_path)


# --- where everybody starts -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, point, placed",
    [
        *values_of("""
    # 3.5 * 20 = 70 m from bumper to bumper: centres 70 + 4.5 m apart
    "front_vehicle_low_speed", (20.0, 5.0), [(74.5, 5.0)]
    # the lead: 1 s * 20 m/s = 20 m ahead, since there is room: 70 - 4.5 - 1.3*10 = 52.5 m
    "front_vehicle_cut_out", (20.0, 10.0, 70.0), [(24.5, 20.0), (74.5, 10.0)]
    # 40 - 4.5 - 1.3*(20 - 0) = 9.5 m, less than 1 s of 20 m/s
    "front_vehicle_cut_out", (20.0, 0.0, 40.0), [(14.0, 20.0), (44.5, 0.0)]
    """),
        ("front_vehicle_braking", (20.0, 2.0, 5.0), [(40.0 + 4.3, 20.0)]),
        ("r157_cut_out", (20.0, 30.0, 1.0), [(40.0 + 4.3, 20.0), (40.0 + 4.3 + 34.3, 0.0)]),
    ],
)
def test_places_and_speeds_by_hand(name, point, placed):
    logical = catalogue.load(name)
    case = logical.concrete(**dict(zip(logical.names, point, strict=True)))
    found = [(actor.start.x - case.ego.x, actor.start.speed) for actor in case.actors]
    assert (case.ego.speed, np.array(found)) == (20.0, pytest.approx(np.array(placed)))


def test_the_gap_is_from_the_bumper_of_the_vehicle_settings():
    cut_out = find_with(VehicleSettings(length=6.0), "front_vehicle_cut_out", Path())
    case = cut_out.concrete(ego_speed=20.0, obstacle_speed=0.0, gap=40.0)
    obstacle = case.actors[-1]
    assert case.simulation(SimulationSettings()).vehicle.length == 6.0
    assert obstacle.start.x - case.ego.x - 0.5 * (6.0 + obstacle.length) == pytest.approx(40.0)


def test_a_start_is_checked_with_the_width_of_the_vehicle_settings(tmp_path):
    # centres 2 m apart across the road: clear at widths 1.8 and 1.8 m, not at 2.5 and 1.8 m
    (tmp_path / "beside.toml").write_text("""
name = "beside"
zone = "none"
ego = { speed = "v" }
parameter = [{ name = "v", unit = "m/s", low = 10.0, high = 30.0, step = 10.0 }]
vehicle = [{ name = "other", speed = 5.0, x = 50.0, y = 2.0 }]
""")
    check_points(find_with(VehicleSettings(), "beside.toml", tmp_path), [[20.0]])
    with refusal("`other` .* must be clear of `ego` at the start"):
        check_points(find_with(VehicleSettings(width=2.5), "beside.toml", tmp_path), [[20.0]])


def test_zones_of_an_own_place_have_the_width_of_the_vehicle_settings(tmp_path):
    # a standing car 2 m beside the ego's path: only an ego wider than 2.2 m meets it
    (tmp_path / "beside.py").write_text("""
from sumo_eval.scenario import Actor, LogicalScenario, Parameter, Road, Start
from sumo_eval.scenario.logical import Search

def place(values):
    return Start(50.0, 0.0, values["v"]), (Actor("car", Start(150.0, 2.0, 0.0)),)

BESIDE = LogicalScenario(
    "beside", "a", "b", (Parameter("v", 10.0, 30.0, 10.0, "m/s", "v"),), (),
    Road("r", 600.0, 2, 3.5, 100.0), place, search=Search(0),
)
""")
    use, point = "beside.py:BESIDE", np.array([[20.0]])
    of_width = {
        width: encounter(find_with(VehicleSettings(width=width), use, tmp_path), point, ZONES)
        for width in (1.8, 2.5)
    }
    max_inverse_ttc, impact_speed, gap = of_width[1.8].ravel()
    assert (max_inverse_ttc, impact_speed, gap) == (0.0, 0.0, math.inf)
    assert 0.0 < of_width[2.5][0, 0] < math.inf  # 20^2 / 2 / 5 = 40 m of braking are enough


@pytest.mark.parametrize(
    "search, sentence",
    [
        (Search(3), "`obstacle` of the zone of scenario `pedestrian_crossing` must be an actor, 0"),
        (Search(0, lambda values: 1.0 / 0.0), "`pedestrian_crossing` failed: ZeroDivisionError"),
        (Search(0, lambda values: "soon"), "`pedestrian_crossing` failed: ValueError"),
    ],
)
def test_a_zone_rule_of_ones_own_that_fails_has_a_message(search, sentence):
    """An index of no actor was read beyond the arrays; an exception was a traceback."""
    crossing = replace(catalogue.load("pedestrian_crossing"), search=search)
    with refusal(sentence):
        encounter(crossing, sample(crossing).points[:2], ZONES)


@each
def test_every_concrete_scenario_starts_within_the_road_and_apart(logical):
    for concrete in logical.concretes(sample(logical).points):
        bodies = sorted(
            [Actor("ego", concrete.ego, length=ego_length(concrete)), *concrete.actors],
            key=lambda body: body.start.x,
        )
        assert 0.0 < concrete.ego.x < logical.road.length
        assert all(
            0.0 < body.start.x < logical.road.length + logical.road.run_out for body in bodies
        )
        for a, b in itertools.pairwise(bodies):
            if a.start.y == b.start.y:
                assert b.start.x - a.start.x >= (a.length + b.length) / 2 - 1e-9
        assert concrete.road is logical.road


def ego_length(concrete):
    return concrete.simulation(SimulationSettings()).vehicle.length


@pytest.mark.parametrize(
    "logical", [it for it in ALL if it.approach is not None], ids=lambda logical: logical.name
)
def test_the_approach_describes_what_is_placed(logical):
    points = sample(logical).points
    approach = logical.approach(logical.columns(points))
    for index, concrete in enumerate(logical.concretes(points)):
        ahead = concrete.actors[-1]  # the one that matters: the lead, or the revealed obstacle
        assert approach.ego_speed[index] == concrete.ego.speed
        assert approach.obstacle_speed[index] == ahead.start.speed
        apart = (ego_length(concrete) + ahead.length) / 2
        assert approach.gap[index] == pytest.approx(ahead.start.x - concrete.ego.x - apart)
        slowing = np.broadcast_to(approach.obstacle_deceleration, len(points))[index]
        assert slowing == (ahead.braking.acceleration if ahead.braking else 0.0)
        begin = np.broadcast_to(approach.conflict_begin, len(points))[index]
        if begin > 0.0:  # the bodies begin to overlap across the road
            width = (concrete.simulation(SimulationSettings()).vehicle.width + ahead.width) / 2
            assert ahead.y(begin) - concrete.ego.y == pytest.approx(width)


def test_a_prescribed_ego_body_and_time_limit_take_the_settings_place():
    concrete = at_values("cut_in", ego_speed=20, cut_in_speed=10, gap=30, lateral_speed=1)
    given = SimulationSettings(
        time_limit=150.0, vehicle=VehicleSettings(length=4.5, width=1.8, wheelbase=2.5)
    )
    inside = concrete.simulation(given)
    assert inside.vehicle.length == 4.3
    assert inside.vehicle.width == 1.9
    assert inside.vehicle.wheelbase == 2.5
    assert inside.time_limit == 35.0
    assert concrete.simulation(SimulationSettings(time_limit=5.0)).time_limit == 5.0
    assert concrete.simulation(inside) == inside
    assert CUT_OUT.concrete(**GOOD).simulation(given) == given


MATRIX = SHARED / "r157" / "ncap_c2c_matrix.csv"


@pytest.mark.skipif(not MATRIX.is_file(), reason="the reference tables are not here")
@pytest.mark.parametrize("edition", ["2023", "2026"])
@pytest.mark.parametrize("name", ["ccrs", "ccrm", "ccrb"])
def test_the_named_samples_are_the_euro_ncap_matrices(name, edition):
    logical = catalogue.load(f"ncap_{name}")
    # of the impact, in the 2026 edition
    location = {"0": -0.5, "25": -0.75, "50": 1.0, "75": 0.75, "100": 0.5}
    wanted = set()
    with MATRIX.open() as file:
        for row in csv.DictReader(file):
            if row["scenario"].lower() != name or not row["edition"].startswith(edition):
                continue
            share = row["overlap_or_impact_location_pct"]
            ego = float(row["vut_speed_kmh"]) / 3.6
            point = [ego, location[share] if edition == "2026" else float(share) / 100.0]
            if name == "ccrm":
                point.append(float(row["gvt_speed_kmh"]) / 3.6)
            if name == "ccrb":
                point += [
                    float(row["headway_m"] or float(row["headway_s"]) * ego),
                    float(row["gvt_decel_mps2"]),
                ]
            wanted.add(tuple(round(value, 9) for value in point))
    chosen = sample(logical, f"ncap_{edition}")
    assert {tuple(row) for row in chosen.points.round(9).tolist()} == wanted
    assert len(chosen.points) == len(wanted)
    assert len(chosen.refused) == 0
    if edition == "2026":
        assert np.array_equal(sample(logical).points, chosen.points)


def test_a_named_sample_has_no_levels_and_levels_mean_the_grid():
    logical = catalogue.load("ncap_ccrs")
    with refusal("Sample `ncap_2023` of scenario `ncap_ccrs` is a list: it takes no `levels`.$"):
        sample(logical, "ncap_2023", levels=2)
    with refusal(r"Unknown sampling method `ncap_2025`. Did you mean `ncap_202"):
        sample(logical, "ncap_2025")
    assert (
        sample(logical, levels=2).points.tolist()
        == sample(logical, "grid", levels=2).points.tolist()
    )
    assert len(sample(logical, "grid").points) == 9 * 6


# --- refusals -------------------------------------------------------------------------------------

GOOD = {"ego_speed": 20.0, "obstacle_speed": 10.0, "gap": 70.0}


@pytest.mark.parametrize(
    "change, sentence",
    [
        *rows_of(
            """
{"gap": 150} | `gap` of scenario `front_vehicle_cut_out` must be within 20..120 m, got 150
{"ego_speed": NaN}
| `ego_speed` of scenario `front_vehicle_cut_out` must be within 10..30 m/s, got nan
{"ego_speed": "20"} | `ego_speed` of scenario `front_vehicle_cut_out` must be a number, got '20'
{"ego_speed": true} | must be a number, got True
{"gpa": 70.0} | Unknown parameter `gpa` of scenario `front_vehicle_cut_out`. Did you mean `gap`?
{"gap": null} | must be a number, got None
""",
            json.loads,
        ),
        ({"gap": np.float64(19.0)}, "must be within 20..120 m, got 19.0."),
        (
            {"ego_speed": 10.0, "obstacle_speed": 15.0},
            "The point of scenario `front_vehicle_cut_out` must be one where the obstacle is "
            "slower than the ego "
            "(obstacle_speed < ego_speed), got 'ego_speed=10, obstacle_speed=15, gap=70'",
        ),
        (
            {"ego_speed": 30.0, "obstacle_speed": 0.0, "gap": 40.0},
            "must be one where the lead can leave the lane before it reaches the obstacle "
            "(gap >= 6.5 m + 1.3 s * (ego_speed - obstacle_speed)), got 'ego_speed=30, "
            "obstacle_speed=0, gap=40'",
        ),
    ],
)
def test_a_point_that_is_not_one_is_refused_with_its_sentence(change, sentence):
    with refused(sentence):
        CUT_OUT.concrete(**{**GOOD, **change})


def test_a_missing_parameter_is_named():
    with refusal("Parameter `gap` of scenario `front_vehicle_cut_out` is missing"):
        CUT_OUT.concrete(ego_speed=20.0, obstacle_speed=10.0)


def test_points_of_another_space_are_refused():
    for use in (CUT_OUT.columns, CUT_OUT.concretes):
        with refusal("must be 3 long"):
            use(np.zeros((5, 2)))
    assert CUT_OUT.concretes([]) == []
    points = sample(CUT_OUT).points[:4]
    assert CUT_OUT.concretes(points.reshape(2, 2, 3)) == CUT_OUT.concretes(points)


@pytest.mark.parametrize(
    "low, high, step",
    [(3.0, 3.0, 1.0), (4.0, 3.0, 1.0), (0.0, math.inf, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, math.nan)],
)
def test_a_parameter_without_a_range_or_a_step_is_refused(low, high, step):
    with refusal("of parameter `p` must be"):
        Parameter("p", low, high, step, "m", "a test")


def test_two_vehicles_of_one_name_are_refused():
    road = Road("r", 100.0, 1, 3.5, 0.0)
    for names in (("ego",), ("a", "a")):
        actors = tuple(Actor(name, Start(50.0 + 10 * i, 0.0, 1.0)) for i, name in enumerate(names))
        with refusal("The names of the vehicles of scenario `s` must be distinct"):
            ConcreteScenario("s", {}, 1.0, road, Start(10.0, 0.0, 1.0), actors)


# --- the space ------------------------------------------------------------------------------------


@each
def test_law_the_unit_box_and_back_is_the_same_point(logical):
    points = sample(logical).points
    assert logical.from_unit(logical.to_unit(points)) == pytest.approx(points)
    assert logical.to_unit([logical.low, logical.high]) == pytest.approx(
        np.array([[0.0] * len(logical.names), [1.0] * len(logical.names)])
    )


@given(st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)))
def test_law_a_point_is_feasible_exactly_when_it_can_be_made_concrete(unit):
    point = CUT_OUT.from_unit(unit)
    possible = bool(CUT_OUT.feasible(point[None])[0])
    try:
        CUT_OUT.concretes(point)
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
    assert list(CUT_OUT.row({"gap": 70.0, "obstacle_speed": 10.0, "ego_speed": 20.0})) == [
        20.0,
        10.0,
        70.0,
    ]


def test_the_box_includes_its_edges():
    inside = CUT_OUT.in_box(
        [[10.0, 0.0, 20.0], [30.0, 20.0, 120.0], [30.0, 20.0, 120.1], [9.9, 0.0, 20.0]]
    )
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
    with refusal("must be even, got 'gap=3'"):
        mine.concrete(gap=3)


def test_a_concrete_scenario_travels_to_a_child_process():
    concrete = CUT_OUT.concrete(**GOOD)
    again = pickle.loads(pickle.dumps(concrete))
    assert again == concrete
    assert again.label == "ego_speed=20, obstacle_speed=10, gap=70"


# --- roads and lateral moves ----------------------------------------------------------------------


def test_the_road_lies_to_the_left_of_its_right_lane():
    road = Road("r", 100.0, 2, 3.5, 0.0)
    assert road.right_edge == -1.75
    assert road.left_edge == 5.25
    assert [road.lane_centre(lane) for lane in (0, 1)] == [0.0, 3.5]


def test_moves_of_one_vehicle_add_up():
    actor = Actor(
        "a", Start(0.0, 0.0, 10.0), (lane_change(0.0, 2.0, 3.5), lane_change(3.0, 2.0, -3.5))
    )
    assert [actor.y(t) for t in (0.0, 2.0, 2.5, 5.0)] == pytest.approx([0.0, 3.5, 3.5, 0.0])


# --- braking actors -------------------------------------------------------------------------------


def test_braking_with_a_ramp_by_hand():
    # 6 m/s2 at 12 m/s3: 0.5 s of ramp take 1.5 m/s, then (20 - 1.5)/6 = 3.0833 s on the plateau
    brake = brake_to_stop(begin=0.0, deceleration=6.0, jerk=12.0)
    assert brake.begin + motion.time_to_stand(brake, 20.0) == pytest.approx(0.5 + 18.5 / 6.0)
    assert motion.braked(brake, 20.0, 0.5)[1] == pytest.approx(18.5)
    assert motion.braked(brake, 20.0, 0.5)[0] == pytest.approx(10.0 - 12.0 * 0.125 / 6.0)
    assert motion.braked(brake, 20.0, 99.0)[0] == pytest.approx(9.75 + 18.5**2 / 12.0)


def test_braking_that_stands_before_the_ramp_ends_by_hand():
    # 0.5 m/s at 12 m/s3: stands after sqrt(2 * 0.5 / 12) s, having driven 2/3 of 0.5 m/s times that
    brake = brake_to_stop(begin=0.0, deceleration=6.0, jerk=12.0)
    stop = math.sqrt(1.0 / 12.0)
    assert brake.begin + motion.time_to_stand(brake, 0.5) == pytest.approx(stop)
    assert motion.braked(brake, 0.5, 9.0)[0] == pytest.approx(2.0 / 3.0 * 0.5 * stop)
    assert motion.braked(brake, 0.5, 9.0)[1] == 0.0


@given(
    st.floats(0.0, 40.0),
    st.floats(0.5, 10.0),
    st.floats(1.0, 100.0) | st.just(math.inf),
    st.floats(0.0, 3.0),
)
def test_law_braking_never_reverses_and_the_distance_is_the_integral_of_the_speed(
    speed, strength, jerk, begin
):
    brake = brake_to_stop(begin, strength, jerk)
    times = np.linspace(0.0, brake.begin + motion.time_to_stand(brake, speed) + 1.0, 20_001)
    x, v = np.array([motion.braked(brake, speed, time)[:2] for time in times.tolist()]).T
    assert np.all(v >= 0.0)
    assert np.all(np.diff(v) <= 1e-12)
    assert np.abs(x - cumulative_trapezoid(v, times, initial=0.0)).max() <= 1e-3


@pytest.mark.parametrize(
    "make, sentence",
    [
        (
            lambda: brake_to_stop(0.0, 0.0),
            "`deceleration` of a brake must be finite and greater than 0 m/s2, got 0.0",
        ),
        (
            lambda: brake_to_stop(0.0, 4.0, math.nan),
            "`jerk` of a brake must be greater than 0 m/s3, got nan",
        ),
        (
            lambda: constant_lateral(0.0, 0.0, 3.5),
            "`speed` of a lateral move must be finite and greater than 0 m/s",
        ),
        (
            lambda: lane_change(1.0, 0.0, 3.5),
            "`duration` of a lateral move must be finite and greater than 0 s, got 0.0",
        ),
        (
            lambda: Actor(
                "a", Start(0.0, 0.0, 10.0), (lane_change(0.0, 3.0, 3.5), brake_to_stop(0.0, 5.0))
            ),
            "The lane changes of vehicle `a` must be over when it stands, at 2.00 s, got 3.0",
        ),
    ],
)
def test_scripts_that_no_vehicle_can_follow_are_refused(make, sentence):
    with refused(sentence):
        make()
