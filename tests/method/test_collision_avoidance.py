"""Eqs. 14-17 against hand-worked numbers, laws, and a plain walk along the ray."""

import json

import numpy as np
import pytest
from refusals import refusal
from tables import rows_of
from twins.collision_avoidance import walked_weight
from twins.spaces import space, two_hills

from sumo_eval.method.collision_avoidance import (
    collision_avoidance_index,
    collision_loss,
    collision_weight,
    impact_severity,
)
from sumo_eval.method.zone_partition import partition
from sumo_eval.scenario.catalogue import load
from sumo_eval.settings import ZoneSettings

CUT_OUT = load("front_vehicle_cut_out")
QUICK = ZoneSettings(restarts=0, grid_points=5_000)


@pytest.fixture(scope="module")
def cut_out():
    return partition(CUT_OUT, QUICK)


@pytest.fixture(scope="module")
def ring():
    """A zone around a safe middle, most dangerous at (50, 15): the ray from there to (50, 85)
    leaves and comes back."""

    def gap(x, y):
        return 25.0 + np.abs(np.hypot(x - 50, y - 50) - 35) + 0.05 * y

    return partition(space("x 0 100 10, y 0 100 10", gap), QUICK)


def star_of(zones, index=0):
    return zones.logical.row(zones.most_dangerous[index])


def on_ray(zones, towards, share, index=0):
    """The point at a share of the way from x* to another point, in the parameters' units."""
    return star_of(zones, index) + share * (np.asarray(towards, float) - star_of(zones, index))


# --- Eqs. 14 and 15 -------------------------------------------------------------------------------


def test_loss_classes_and_their_edges():
    u = [0.0, 1e-9, 8.0, 8.0 + 1e-9, 15.0, 15.0 + 1e-9, 40.0]
    assert collision_loss(u).tolist() == [0.1, 0.4, 0.4, 0.7, 0.7, 1.0, 1.0]
    assert collision_loss(10.0) == 0.7


def test_severity_by_hand():
    # |(20, 0) - (5, 0)| = 15 m/s over 3/4 of the width: 20; |(20, 3) - (16, 0)| = 5 at full width:
    # 5
    assert impact_severity((20, 0), (5, 0), 0.75) == 20.0
    assert impact_severity([[20, 0], [20, 3]], [[5, 0], [16, 0]], [0.75, 1.0]).tolist() == [
        20.0,
        5.0,
    ]


def test_less_than_half_an_overlap_counts_as_half():
    # 15 / 0.5 = 30 for every overlap from 0 to 0.5
    assert impact_severity((20, 0), (5, 0), [0.0, 0.2, 0.5]).tolist() == [30.0, 30.0, 30.0]


# --- Eq. 16 ---------------------------------------------------------------------------------------


def test_the_weight_is_0_at_the_most_dangerous_point(cut_out):
    assert collision_weight(cut_out.most_dangerous[0], cut_out) == 0.0


def test_a_ray_that_meets_no_boundary_ends_at_the_edge_of_the_space(cut_out):
    # at 30 m/s the zone reaches 125.1 m, beyond the box: b is (30, 0, 120), r = (80 - 45.5) / (120
    # - 45.5)
    assert collision_weight([30, 0, 80], cut_out) == pytest.approx(
        (80 - 45.5) / (120 - 45.5), abs=1e-9
    )
    assert collision_weight([30, 0, 120], cut_out) == pytest.approx(1.0, abs=1e-12)


def test_a_ray_that_crosses_a_constraint_ends_there():
    # hazardous everywhere, worst at (0, 0); the ray through (2, 1) leaves x + 2y <= 8 at (4, 2): r
    # = 1/2
    cut = space(
        "x 0 10 2, y 0 10 2",
        lambda x, y: 10 + x + y,
        constraints=[lambda x, y: x + 2 * y <= 8],
    )
    zones = partition(cut, QUICK)
    assert zones.most_dangerous == ({"x": 0.0, "y": 0.0},)
    assert collision_weight([2.0, 1.0], zones) == pytest.approx(0.5, abs=1e-8)


def test_a_ray_along_a_constraint_stays_in_the_space(cut_out):
    # gap = 6.5 + 1.3 * closing speed is an edge of the space; rounding must not end the ray at its
    # start
    edge = [[speed, 0.0, 6.5 + 1.3 * speed] for speed in (29.0, 27.5, 25.0)]
    ray = np.array(collision_weight(edge, cut_out))
    assert np.all(ray < 1.0)
    assert ray / ray[0] == pytest.approx([1.0, 2.5, 5.0], rel=1e-6)


def test_the_weight_is_what_a_plain_walk_finds(cut_out):
    points = CUT_OUT.from_unit(np.random.default_rng(4).random((60, 3)))
    points = points[CUT_OUT.feasible(points)][:10]
    star = CUT_OUT.to_unit(star_of(cut_out))

    def inside(unit):
        ego, obstacle, gap = CUT_OUT.from_unit(unit).T
        exists = np.all((unit >= -1e-12) & (unit <= 1 + 1e-12), axis=1) & (
            gap >= 6.5 + 1.3 * (ego - obstacle) - 1e-9
        )
        exists &= obstacle < ego
        hazardous = np.zeros(len(unit), dtype=bool)
        hazardous[exists] = cut_out.predicted(CUT_OUT.from_unit(np.clip(unit[exists], 0, 1))) <= 0
        return hazardous

    plain = [walked_weight(CUT_OUT.to_unit(point), star, inside) for point in points]
    assert collision_weight(points, cut_out) == pytest.approx(plain, rel=1e-8)


def test_names_a_row_and_rows_give_the_same_weight(cut_out):
    row = [25.0, 5.0, 50.0]
    named = collision_weight({"gap": 50.0, "ego_speed": 25.0, "obstacle_speed": 5.0}, cut_out)
    assert named == collision_weight(row, cut_out)
    assert collision_weight([row, row], cut_out) == pytest.approx([named, named], abs=1e-12)
    assert isinstance(named, float)


def test_without_a_hazardous_zone_every_collision_weighs_1():
    zones = partition(load("front_vehicle_low_speed"))
    assert collision_weight({"ego_speed": 20.0, "lead_speed": 0.0}, zones) == 1.0
    assert collision_weight([[20.0, 0.0], [30.0, 5.0]], zones).tolist() == [1.0, 1.0]


def test_the_nearest_of_several_zones_counts():
    # (80, 85) is 15 m from the middle of the small zone, (30, 75) 35 m from that of the large one
    two_zones = partition(two_hills(), QUICK)
    small, large = star_of(two_zones, 1), star_of(two_zones, 0)
    weights = collision_weight([[80, 85], [30, 75]], two_zones)
    assert collision_weight(on_ray(two_zones, [80, 85], 0.1, index=1), two_zones) == pytest.approx(
        weights[0] / 10
    )
    assert collision_weight(on_ray(two_zones, [30, 75], 0.1, index=0), two_zones) == pytest.approx(
        weights[1] / 10
    )
    assert np.all(collision_weight([small, large], two_zones) == 0.0)


def test_the_first_exit_counts_where_a_ray_enters_the_zone_again(ring):
    star = star_of(ring)
    across = np.array([100.0, 100.0]) - star
    assert star == pytest.approx([50, 15], abs=0.5)
    assert ring.zones == 1
    assert ring.hazardous(star)
    assert ring.hazardous(across)
    assert not ring.hazardous((star + across) / 2)
    weight = collision_weight(across, ring)
    unit = ring.logical.to_unit

    def inside(points):
        return ring.hazardous(ring.logical.from_unit(points))

    assert weight > 1.0
    assert weight == pytest.approx(
        walked_weight(unit(across), unit(star), inside, farthest=0.5), rel=1e-9
    )


@pytest.mark.parametrize(
    "point, sentence",
    rows_of(
        """
{"ego_speed": 30.0, "gap": 50.0}
| Parameter `obstacle_speed` of scenario `front_vehicle_cut_out` is missing
{"ego_speed": 30.0, "obstacle_sped": 0.0, "gap": 50.0}
| Unknown parameter `obstacle_sped` of scenario `front_vehicle_cut_out`. Did you mean `obstacle_speed`
[30.0, 0.0, 150.0] | `gap` of scenario `front_vehicle_cut_out` must be within 20..120 m, got 150.0
[30.0, 0.0] | `points` of scenario `front_vehicle_cut_out` must be 3 long
30.0 | `point` of scenario `front_vehicle_cut_out` must be values by name, a row or rows
""",
        json.loads,
    ),
)
def test_points_outside_the_space_have_no_weight(cut_out, point, sentence):
    with refusal(sentence):
        collision_weight(point, cut_out)


# --- Eq. 17 ---------------------------------------------------------------------------------------


def test_the_index_by_hand():
    # (1 * 5/10 + 3 * 0/20) / (1 + 3) = 0.125
    assert collision_avoidance_index([10, 20], [5, 0], [1, 3]) == 0.125


def test_the_index_of_loss_classes_by_hand():
    # L of the ADS 1, 0.7, 0.4; of the ideal vehicle 0.1 (it avoids), 0.7, 0.4: (0.1/1 + 0.7/0.7 +
    # 0.4/0.4) / 3
    assert collision_avoidance_index(
        [16, 10, 5], [0, 9, 1], [1, 1, 1], loss="class"
    ) == pytest.approx(2.1 / 3)


def test_no_collision_scores_1():
    assert collision_avoidance_index([], [], []) == 1.0
    assert collision_avoidance_index([], [], [], loss="class") == 1.0


def test_weights_of_0_throughout_mean_an_unweighted_mean():
    # (5/10 + 0/20) / 2
    assert collision_avoidance_index([10, 20], [5, 0], [0, 0]) == 0.25


def test_hitting_no_harder_than_the_ideal_vehicle_counts_1():
    u, ideal = [4, 5, 6, 0, 0], [5, 5, 5, 5, 0]
    # 1, 1, 5/6, 1, and 1 for a touch at 0 m/s that the ideal vehicle has, too
    assert collision_avoidance_index(u, ideal, [1] * 5) == pytest.approx((4 + 5 / 6) / 5)


@pytest.mark.parametrize(
    "arguments, sentence",
    rows_of(
        """
[[1, 2], [1], [1, 1]] | `u`, `u_ideal` and `weights` of the collisions must be of one length
[1.0, 1.0, 1.0] | `u`, `u_ideal` and `weights` of the collisions must be of one length
[[-1], [1], [1]] | `u` of a collision must be at least 0, got -1.0
[[1], [NaN], [1]] | `u_ideal` of a collision must be finite, got nan
[[1], [1], [Infinity]] | `weights` of a collision must be finite, got inf
[[1], [1], [1], "l"]
| `loss` of `collision_avoidance_index` must be 'severity' or 'class', got 'l'
""",
        json.loads,
    ),
)
def test_impossible_collisions_are_refused(arguments, sentence):
    with refusal(sentence):
        collision_avoidance_index(*arguments)


@pytest.mark.parametrize(
    "arguments, sentence",
    rows_of(
        """
[[20, 0], [5, 0], 1.01] | `overlap` of a collision must be within 0..1, got 1.01
[[20, 0], [5, 0], -0.1] | `overlap` of a collision must be at least 0, got -0.1
[[20, 0, 0], [5, 0, 0], 1.0] | `ego_velocity` of a collision must be finite with a last axis of 2
[[20, 0], [5, NaN], 1.0] | `obstacle_velocity` of a collision must be finite with a last axis of 2
""",
        json.loads,
    ),
)
def test_impossible_impacts_are_refused(arguments, sentence):
    with refusal(sentence):
        impact_severity(*arguments)


def test_a_negative_severity_has_no_loss():
    with refusal(r"`u` of a collision must be at least 0, got -1\.0"):
        collision_loss([3.0, -1.0])
