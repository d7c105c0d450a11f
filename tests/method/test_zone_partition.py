"""Eqs. 7-8: zones against closed forms, laws, and a textbook Gaussian process."""

import math
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from scipy.optimize import minimize
from scipy.spatial import KDTree
from twins.spaces import space, two_hills
from twins.zone_partition import posterior_mean

from sumo_eval.method.collision_avoidance import collision_weight
from sumo_eval.method.criticality import critical_gap, ideal_impact_speed, max_inverse_ttc
from sumo_eval.method.point_criticality import criticality, exact_target, squared_time_target
from sumo_eval.method.zone_partition import boundary_error, partition
from sumo_eval.method.zone_surface import TARGET_TOLERANCE
from sumo_eval.scenario.catalogue import load
from sumo_eval.scenario.logical import ZoneCoordinates
from sumo_eval.settings import ZoneSettings

CUT_OUT = load("front_vehicle_cut_out")
LOW_SPEED = load("front_vehicle_low_speed")
CUT_IN = load("cut_in")
QUICK = ZoneSettings(restarts=1, grid_points=5_000)


def grid(logical, count):
    axes = [np.linspace(parameter.low, parameter.high, count) for parameter in logical.parameters]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def scattered(logical, n, seed=1):
    return logical.from_unit(np.random.default_rng(seed).random((n, len(logical.parameters))))


@pytest.fixture(scope="module")
def cut_out():
    return partition(CUT_OUT)


@pytest.fixture(scope="module")
def hill():
    return partition(two_hills(), QUICK)


# --- zones without a closed form ------------------------------------------------------------------


def test_law_the_hazardous_gaps_of_a_cut_in_are_an_interval_safe_on_both_sides():
    # 60 -> 20 km/h at 0.8 m/s: the bodies overlap after 2 s, in which the ego closes 22.22 m. With
    # both bodies' 8.6 m it has passed below 13.62 m; above 22.22 + critical gap of 11.11 m/s (17.45
    # m) there is time enough.
    gap = np.linspace(0.0, 100.0, 1_001)
    points = np.stack(np.broadcast_arrays(60 / 3.6, 20 / 3.6, gap, 0.8), axis=-1)
    hazardous = gap[exact_target(CUT_IN, points, QUICK) <= 0.0]
    assert (hazardous[0], hazardous[-1]) == pytest.approx((13.7, 39.6))
    assert len(hazardous) == round((39.6 - 13.7) / 0.1) + 1
    assert 2.0 * 40 / 3.6 + critical_gap(40 / 3.6) == pytest.approx(39.67, abs=0.01)


@pytest.mark.campaign
def test_the_partition_of_a_cut_in_finds_the_interval_and_a_most_dangerous_point_that_exists():
    zones = partition(CUT_IN, QUICK)
    assert zones.zones >= 1
    (worst, *_) = zones.most_dangerous
    point = CUT_IN.row(worst)
    assert CUT_IN.feasible(point[None])[0]
    assert zones.hazardous(point[None])[0]
    assert exact_target(CUT_IN, point[None], QUICK)[0] <= 0.0
    # 60 -> 20 km/h at 0.9 m/s: exactly hazardous from 11.2 to 37.2 m
    slice_of_gaps = [[60 / 3.6, 20 / 3.6, gap, 0.9] for gap in (0.0, 27.0, 80.0)]
    assert zones.hazardous(slice_of_gaps).tolist() == [False, True, False]
    assert boundary_error(zones, 5_000).feasible < 0.01
    assert any("coarser than the scenario's own" in note for note in zones.notes)


@pytest.mark.campaign
def test_a_braking_lead_is_evaluated_by_the_search_and_learnt():
    zones = partition(load("front_vehicle_braking"), QUICK)
    # At 9.81 m/s2 the lead stands after 20.4 m; the ego needs 20 + 40 m and has 10 m more. At 1.81
    # it has 110 + 50 m.
    assert zones.hazardous([[20.0, 0.5, 9.81]])[0]
    assert not zones.hazardous([[20.0, 2.5, 1.81]])[0]
    assert boundary_error(zones, 5_000).feasible < 0.02


# --- the paper's scenarios ------------------------------------------------------------------------


def test_cut_out_has_one_hazardous_zone_with_its_worst_at_the_shortest_possible_gap(cut_out):
    # 2 m to the lead, its 4.5 m, and 1.3 s * 30 m/s that the ego closes until the lead is out of
    # the way: 45.5 m
    assert cut_out.zones == 1
    assert cut_out.most_dangerous == ({"ego_speed": 30.0, "obstacle_speed": 0.0, "gap": 45.5},)


@pytest.mark.parametrize("given", [{}, {"target": "label"}, {"target_scale": 0.1}])
def test_low_speed_has_no_hazardous_zone_at_all(given):
    zones = partition(LOW_SPEED, ZoneSettings(**given))
    points = scattered(LOW_SPEED, 2_000)
    assert zones.zones == 0
    assert zones.most_dangerous == ()
    assert zones.zone_shares == ()
    assert not zones.hazardous(points).any()
    assert np.all(zones.boundary_distance(points) == np.inf)
    assert np.all(zones.nearest_zone(points) == -1)
    assert np.all(zones.predicted(points) == 1.0)
    assert np.all(np.isinf(zones.surface.length_scales))
    assert zones.notes == (
        "A zone boundary needs safe and hazardous training points; all 25 are safe, so the whole "
        "space counts as such. If it has a boundary, make `step` smaller or ranges wider.",
    )
    stands = space("x 0 1 0.5", 9.0, ego_speed=0.0)
    assert (
        "let the obstacle come into the ego's path: the ego closes on it at no point"
        in partition(stands).notes[0]
    )


def test_a_scenario_without_zones_reports_it_and_no_gp():
    """Its space has more points than a GP takes, and all of them agree: neither is a reason
    there."""
    logical = load("side_vehicle")
    assert logical.notes == ("It declares no zones, so every point counts as safe.",)
    assert partition(logical).notes == ()


def test_a_space_that_is_hazardous_everywhere_is_one_zone_without_a_boundary():
    everywhere = space("x 10 40 10", lambda x: x)
    zones = partition(everywhere, QUICK)
    points = scattered(everywhere, 100)
    assert zones.zones == 1
    assert zones.zone_shares == (1.0,)
    assert zones.most_dangerous == ({"x": 10.0},)
    assert zones.hazardous(points).all()
    assert np.all(zones.boundary_distance(points) == -np.inf)
    assert np.all(zones.nearest_zone(points) == 0)


def test_the_cut_out_boundary_is_where_the_closed_form_has_it(cut_out):
    error = boundary_error(cut_out)
    assert error.box <= 0.01
    assert error.feasible <= 0.01
    # d = rel + rel^2/10 + 5.102: 65.10 m at 20 m/s; the GP's own boundary lies within 1.5 m
    gap = np.linspace(40, 120, 8001)
    column = np.column_stack([np.full(gap.size, 30.0), np.full(gap.size, 10.0), gap])
    changes = np.flatnonzero(np.diff(cut_out.hazardous(column).astype(int)))
    assert gap[changes] == pytest.approx([critical_gap(20.0, delay=1.0)], abs=1.5)


def test_a_grid_of_nine_puts_less_than_a_thousandth_of_the_space_in_the_wrong_zone():
    zones = partition(CUT_OUT, QUICK, points=grid(CUT_OUT, 9))
    error = boundary_error(zones)
    assert error.box <= 0.001
    assert error.feasible <= 0.001
    assert zones.most_dangerous == ({"ego_speed": 30.0, "obstacle_speed": 0.0, "gap": 45.5},)


def test_labels_serve_too_but_less_well(cut_out):
    zones = partition(CUT_OUT, ZoneSettings(target="label", restarts=0, grid_points=5_000))
    assert boundary_error(cut_out).box < boundary_error(zones).box <= 0.01


# --- laws -----------------------------------------------------------------------------------------


def test_the_partition_does_not_depend_on_sample_order():
    points = grid(CUT_OUT, 5)
    shuffled = np.random.default_rng(7).permutation(np.concatenate([points, points[::3]]))
    first, second = (partition(CUT_OUT, QUICK, points=sample) for sample in (points, shuffled))
    where = scattered(CUT_OUT, 500)
    assert np.array_equal(first.training_points, second.training_points)
    assert np.array_equal(first.predicted(where), second.predicted(where))
    assert first.most_dangerous == second.most_dangerous
    assert np.array_equal(first.boundary_distance(where), second.boundary_distance(where))


def test_the_default_training_points_are_the_own_steps_of_the_space(cut_out):
    own = np.mgrid[10:31:5, 0:21:5, 20:121:10].reshape(3, -1).T
    assert np.array_equal(cut_out.training_points, own)
    by_hand = max_inverse_ttc(own[:, 0], own[:, 1], own[:, 2], delay=1.0)
    assert np.array_equal(criticality(CUT_OUT, own, ZoneSettings()).inverse, by_hand)


def test_the_surface_is_a_textbook_gaussian_process():
    zones = partition(CUT_OUT, QUICK, points=grid(CUT_OUT, 3))
    target = exact_target(CUT_OUT, zones.training_points, QUICK)
    variances = (TARGET_TOLERANCE * target) ** 2 + zones.surface.noise_deviation**2
    assert zones.surface.length_scales == pytest.approx(
        [float(f"{scale:.3g}") for scale in zones.surface.length_scales], rel=1e-12
    )
    for where in scattered(CUT_OUT, 5):
        plain = posterior_mean(
            CUT_OUT.to_unit(where),
            CUT_OUT.to_unit(zones.training_points),
            target,
            zones.surface.length_scales,
            zones.surface.signal_deviation,
            variances,
        )
        assert float(zones.predicted(where)) == pytest.approx(plain, abs=1e-9)


def test_hazardous_is_where_the_surface_is_not_above_zero(cut_out):
    points = scattered(CUT_OUT, 1_000)
    assert np.array_equal(cut_out.hazardous(points), cut_out.predicted(points) <= 0.0)


def test_a_single_row_and_many_rows_agree(cut_out):
    points = scattered(CUT_OUT, 6)
    for method in ("predicted", "hazardous", "nearest_zone", "boundary_distance", "exists"):
        whole = getattr(cut_out, method)(points)
        assert whole.shape == (6,)
        assert getattr(cut_out, method)(points.reshape(2, 3, 3)).shape == (2, 3)
        # the GP's sums run over blocks of rows, whose last digit depends on the block
        alone = [float(getattr(cut_out, method)(row)) for row in points]
        assert alone == pytest.approx(whole.astype(float).tolist(), abs=1e-9)


# --- the target -----------------------------------------------------------------------------------


def test_the_target_by_hand():
    # ITTC 0.5: T = 2 s, T* = 1/0.7 s: tanh((4 - 2.0408)/10) = 0.19345; at the threshold 0; not
    # closing 1
    # impact at 10 m/s under 5 m/s2: T^2 = -4: tanh(-6.0408/10) = -0.53995
    y = squared_time_target([0.5, 0.7, 0.0, np.inf], [0.0, 0.0, 0.0, 10.0])
    assert y == pytest.approx([0.19345, 0.0, 1.0, -0.53995], abs=1e-5)


def test_the_target_runs_smoothly_through_contact():
    # 20 m/s behind a standing vehicle touches at 40 m; one millimetre moves T^2 = 2c/a by 0.0004 s2
    # on either side
    gap = np.array([39.999, 40.001])
    y = squared_time_target(
        max_inverse_ttc(20, 0, gap), ideal_impact_speed(20, 0, gap, deceleration=5.0)
    )
    middle = np.tanh(-(0.7**-2) / 10)
    slope = (1 - middle**2) * 0.0004 / 10
    assert y - middle == pytest.approx([-slope, slope], rel=1e-3)


# --- zones ----------------------------------------------------------------------------------------


def test_two_zones_are_distinguished_and_ordered_by_size(hill):
    assert hill.zones == 2
    assert hill.zone_shares[0] > hill.zone_shares[1]
    assert hill.hazardous([[30, 40], [80, 70], [55, 95]]).tolist() == [True, True, False]
    assert hill.nearest_zone([[30, 40], [80, 70], [80, 95], [5, 95]]).tolist() == [0, 1, 1, 0]
    found = [tuple(map(round, point.values())) for point in hill.most_dangerous]
    assert found == [(30, 40), (80, 70)]


def test_law_a_region_hazardous_for_the_gp_alone_is_not_a_zone():
    # Hazardous is x <= 12 alone. From 60 to 80 the gap is 0.02 m more than the critical one, with a
    # slope on both sides, which the GP rounds to a hazardous hollow. With its worst point on its
    # own edge, it once gave points near it weights of 10^9.
    def gap(x):
        return 45.102 + np.minimum(x - 12.0, np.maximum(np.abs(x - 70.0) - 10.0, 0.02))

    line = space("x 0 100 10", gap)
    zones = partition(line, QUICK, points=np.arange(0.0, 101.0, 10.0)[:, None])
    assert zones.hazardous([[70.0]])[0]
    assert zones.zones == 1
    assert zones.zone_shares[0] == pytest.approx(0.12, abs=0.01)
    assert zones.most_dangerous[0]["x"] == 0.0
    assert "14.51 % of the space is hazardous for the GP alone, and forms no zone." in zones.notes
    assert collision_weight([[100.0]], zones)[0] == pytest.approx(100.0 / 12.0, rel=0.02)


def test_a_constraint_can_cut_a_zone_in_two():
    both = space("x 0 100 5", 30.0, constraints=[lambda x: np.abs(x - 40) >= 10])
    zones = partition(both, QUICK)
    assert zones.zones == 2
    assert zones.zone_shares[0] == pytest.approx(50 / 80, abs=0.01)
    # every point is equally dangerous: the smallest row of each zone stands for it
    assert zones.most_dangerous == ({"x": 50.0}, {"x": 0.0})
    assert zones.exists([[30.0], [40.0], [50.0]]).tolist() == [True, False, True]


def test_equal_impact_speed_and_ittc_are_decided_by_the_smaller_gap():
    # the delay of 1 s at 30 m/s takes all gaps up to 30 m: impact at 30 m/s for each of them; the
    # gap is 105 - x
    box = space(
        "speed 10 30 5, x 0 100 10",
        lambda speed, x: 105 - x,
        ego_speed=lambda speed, x: speed,
        delay=1.0,
    )
    assert partition(box, QUICK).most_dangerous == ({"speed": 30.0, "x": 100.0},)


def test_without_any_impact_the_largest_inverse_ttc_decides():
    # gap = v^2/10 + c leaves c = 4 - 0.3 x, ITTC sqrt(5/(2c)): the largest is at x = 10, where the
    # gap is longest
    box = space(
        "x 0 10 1",
        lambda x: (10 + x) ** 2 / 10 + 4 - 0.3 * x,
        ego_speed=lambda x: 10 + x,
    )
    assert partition(box, QUICK).most_dangerous == ({"x": 10.0},)


def test_the_worst_point_is_found_in_a_corner_that_no_grid_holds():
    cut = 2.0**0.5
    corner = space(
        "x 0 10 1, y 0 10 1",
        lambda x, y: 20 + 5 * x + 4 * y,
        constraints=[lambda x, y: x + cut * y >= 2.7, lambda x, y: y <= 1.3],
    )
    # along the edge 5x + 4y falls with y up to its limit: y = 1.3, x = 2.7 - 1.3*sqrt(2)
    point = partition(corner, QUICK).most_dangerous[0]
    assert (point["x"], point["y"]) == pytest.approx((2.7 - 1.3 * cut, 1.3), abs=1e-6)


def test_boundary_distance_is_the_least_of_all_distances_to_the_surface(cut_out):
    unit = np.random.default_rng(0).random((60, 3))
    mine = np.abs(cut_out.boundary_distance(CUT_OUT.from_unit(unit)))
    inner = 0
    for point, distance, start in zip(
        unit, mine, KDTree(cut_out.boundary).query(unit)[1], strict=True
    ):
        found = minimize(
            lambda x, point=point: np.sum((x - point) ** 2),
            cut_out.boundary[start],
            bounds=[(0.0, 1.0)] * 3,
            constraints={"type": "eq", "fun": lambda x: cut_out.surface.value(x[None])[0]},
            method="SLSQP",
            options={"ftol": 1e-14},
        )
        on_edge = np.any((found.x < 1e-6) | (found.x > 1 - 1e-6)) or not CUT_OUT.feasible(
            CUT_OUT.from_unit(found.x)
        )
        if found.success and not on_edge:
            inner += 1
            assert distance == pytest.approx(math.sqrt(found.fun), abs=1e-6)
        # an edge of the space is nearest: too long by less than a cell's diagonal
        elif found.success:
            assert -1e-6 < distance - math.sqrt(found.fun) < 0.05
    assert inner > 25


def test_boundary_distance_of_a_plane():
    # 20 m/s: hazardous up to 45.102 m, in a box of 0..100 m: the distance is (gap - 45.102) / 100
    plane = space("d 0 100 5, other 0 1 0.25", lambda d, other: d)
    zones = partition(plane, QUICK)
    points = scattered(plane, 50)
    assert zones.boundary_distance(points) == pytest.approx(
        (points[:, 0] - 45.102) / 100, abs=0.005
    )


# --- what is said, and what is refused ------------------------------------------------------------


def test_a_parameter_without_influence_is_noted():
    plane = space("d 0 100 10, other 0 1 0.25", lambda d, other: d)
    zones = partition(plane, QUICK)
    assert (
        "The GP's length scale of `other` reached its upper bound: the zones hardly depend on it."
        in zones.notes
    )
    assert zones.most_dangerous == ({"d": 0.0, "other": 0.0},)


def test_too_few_training_points_are_noted():
    zones = partition(CUT_OUT, QUICK, points=grid(CUT_OUT, 2))
    assert any("% of the space in the wrong zone" in note for note in zones.notes)


@pytest.mark.parametrize("gaps", [[100.0], [0.0], range(0, 101, 10)])
def test_better_coordinates_may_be_constant_or_unlearnt(gaps):
    points = [[20.0, 10.0, gap, 1.0] for gap in gaps]
    zones = partition(load("cut_in"), QUICK, points=points)
    assert zones.hazardous(points).tolist() == zones.exactly_hazardous(points).tolist()
    endless = ZoneCoordinates(("x",), lambda values: (np.full_like(values["gap"], np.inf),))
    with refusal("`zone.coordinates` of scenario `cut_in` must be finite"):
        partition(replace(load("cut_in"), zone_coordinates=endless), QUICK, points=points)


def test_hazard_between_training_points_that_are_all_safe_is_noted():
    zones = partition(CUT_OUT, QUICK, points=[[10.0, 0.0, 120.0], [10.0, 20.0, 20.0]])
    assert zones.zones == 0
    assert any("% of the space in the wrong zone" in note for note in zones.notes)


def test_a_large_grid_of_own_steps_is_thinned_and_reported():
    axes = ", ".join(f"{name} 0 10 1" for name in "abcd")
    fine = space(axes, lambda **values: 30 + sum(values.values()))
    zones = partition(fine, ZoneSettings(restarts=0, grid_points=3_000))
    assert (
        "The zones were learnt from a grid of 1296 points, coarser than the scenario's own of "
        "14641." in zones.notes
    )
    assert len(zones.training_points) == 1296
    assert zones.zones == 1


@pytest.mark.parametrize("many", [10, 11])
def test_a_grid_has_room_for_ten_parameters_and_not_for_eleven(many):
    logical = space(", ".join(f"{name} 0 1 0.5" for name in "abcdefghijk"[:many]), 300.0)
    with refusal("at most 10 parameters, .* got 11: give") if many > 10 else nullcontext():
        assert len(partition(logical, ZoneSettings(restarts=0)).training_points) == 2**10


def test_steps_are_exact_decimals_and_the_last_point_is_high():
    fine = space("x 0 0.3 0.1, y 10 25 10", lambda x, y: 100 * x + y)
    points = partition(fine, QUICK).training_points
    assert sorted(set(points[:, 0])) == [0.0, 0.1, 0.2, 0.3]
    assert sorted(set(points[:, 1])) == [10.0, 20.0, 25.0]


@pytest.mark.parametrize(
    "points, sentence",
    [
        (
            [[30.0, 0.0, 150.0]],
            "`gap` of scenario `front_vehicle_cut_out` must be within 20..120 m, got 150.0",
        ),
        (
            [[np.nan, 0.0, 50.0]],
            "`ego_speed` of scenario `front_vehicle_cut_out` must be within 10..30 m/s, got nan",
        ),
        ([[30.0, 0.0]], "`points` of scenario `front_vehicle_cut_out` must be 3 long"),
    ],
)
def test_points_outside_the_space_are_refused(cut_out, points, sentence):
    for method in ("hazardous", "predicted", "boundary_distance", "nearest_zone"):
        with refusal(sentence):
            getattr(cut_out, method)(points)


@pytest.mark.parametrize(
    "points, sentence",
    [
        (
            [[30.0, 0.0, 150.0]],
            "`gap` of scenario `front_vehicle_cut_out` must be within 20..120 m, got 150.0",
        ),
        (
            np.empty((0, 3)),
            "The training points of scenario `front_vehicle_cut_out` must be an .n, 3. array",
        ),
        (np.full((5_001, 3), 20.0), "with n in 1..5000"),
        (
            [30.0, 0.0, 50.0],
            "The training points of scenario `front_vehicle_cut_out` must be an .n, 3. array",
        ),
    ],
)
def test_training_points_that_cannot_serve_are_refused(points, sentence):
    with refusal(sentence):
        partition(CUT_OUT, QUICK, points=points)


def test_a_space_without_points_and_an_error_over_no_points_are_refused():
    never = space("x 0 5 1", lambda x: x, constraints=[lambda x: x > 9])
    with refusal("must have points that satisfy its constraints"):
        partition(never, QUICK)
    with refusal("`n` of `boundary_error` must be at least 1"):
        boundary_error(partition(LOW_SPEED), 0)


def test_the_zone_of_a_case_is_the_criterions_own_and_certain_contact_is_never_safe(cut_out):
    """The GP may be on the wrong side near the boundary; the zone of a driven case never is."""
    points = scattered(CUT_OUT, 4000, seed=8)
    points = points[CUT_OUT.feasible(points)]
    speed, obstacle, gap = points.T
    exact = cut_out.exactly_hazardous(points)
    assert np.array_equal(
        exact, max_inverse_ttc(speed, obstacle, gap, deceleration=5.0, delay=1.0) >= 0.7
    )
    assert exact[ideal_impact_speed(speed, obstacle, gap, deceleration=5.0, delay=1.0) > 0.0].all()
    assert 0 < np.count_nonzero(exact != cut_out.hazardous(points)) < 0.01 * len(points)
    assert cut_out.exactly_hazardous(points[0]).shape == ()
    assert (
        cut_out.exactly_hazardous(points[:6].reshape(2, 3, 3)).tolist()
        == exact[:6].reshape(2, 3).tolist()
    )
