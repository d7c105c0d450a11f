"""Risk, coverage and further cases, against numbers worked by hand."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_eval.method.zone_partition import partition
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.logical import Constraint
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.scoring.confidence.assessment import risk
from sumo_eval.scoring.confidence.coverage import space_coverage
from sumo_eval.scoring.confidence.further_cases import further_cases

LOW_SPEED, CUT_OUT = (
    catalogue.load("front_vehicle_low_speed"),
    catalogue.load("front_vehicle_cut_out"),
)


def test_probability_and_loss_are_weighted_by_exposure():
    # collisions with p = 1 and 3 of 10 in all, losses 0.4 and 1: (0.4 + 3) / 10
    found = risk(np.array([1.0, 3.0, 2.0, 4.0]), np.array([0.4, 1.0, 0.0, 0.0]), 5)
    assert found.collision_probability.value == pytest.approx(0.4)
    assert found.expected_loss.value == pytest.approx(0.34)
    # Kish: 10^2 / (1 + 9 + 4 + 16)
    assert found.effective_cases == pytest.approx(100 / 30)


def test_the_interval_of_a_probability_is_about_the_binomial_one():
    # 60 of 200: 0.3 +- 1.96 sqrt(0.21 / 200) = 0.0635
    loss = np.where(np.arange(200) < 60, 0.7, 0.0)
    found = risk(np.ones(200), loss, 5).collision_probability
    assert (found.high - found.low) / 2.0 == pytest.approx(0.0635, rel=0.1)


def test_no_collision_in_100_cases_does_not_exclude_3_per_cent():
    found = risk(np.ones(100), np.zeros(100), 5)
    # 1 - 0.025^(1/100) = 0.0362
    assert found.collision_probability.high == pytest.approx(1 - 0.025**0.01)
    assert found.collision_probability.low == 0.0
    assert found.expected_loss.value == 0.0


def test_a_collision_never_lowers_the_upper_end():
    """None in 20 leaves 0.168 open, so one in 20 cannot leave less."""
    ends = [risk(np.ones(20), np.where(np.arange(20) < hits, 0.4, 0.0), 5) for hits in range(4)]
    for name in ("collision_probability", "expected_loss"):
        highs = [getattr(found, name).high for found in ends]
        assert highs == sorted(highs), name


@pytest.mark.parametrize("loss", [0.0, 1.0])
def test_a_case_without_exposure_changes_no_risk(loss):
    found, cases = risk(np.ones(9), np.full(9, loss), 5), np.append(np.full(9, loss), 1.0 - loss)
    more = risk(np.append(np.ones(9), 0.0), cases, 5)
    assert more.collision_probability == found.collision_probability


def test_without_exposure_there_is_no_risk():
    assert risk(np.zeros(3), np.zeros(3), 5) is None


@pytest.fixture(scope="module")
def zones():
    return partition(CUT_OUT)


def test_a_grid_hits_every_bucket_and_pair_and_resolves_the_boundary(zones):
    covered = space_coverage(zones, sample(CUT_OUT).points)
    assert covered.buckets == {"ego_speed": (5, 5), "obstacle_speed": (5, 5), "gap": (5, 5)}
    hit, possible = covered.pairs_hit
    # beside a constraint a bucket may have no point of the grid
    assert 0.9 * possible < hit <= possible
    # of steps of a quarter, a quarter and a tenth the cell's half diagonal is sqrt(2 * 0.125^2 +
    # 0.05^2) = 0.184; beside a constraint a corner of a cell can be missing
    assert 0.15 < covered.empty_radius < 0.36
    assert covered.exposure_inside is None


def test_one_point_leaves_nearly_everything_open(zones):
    covered = space_coverage(zones, np.array([[10.0, 0.0, 120.0]]))
    assert covered.buckets["gap"] == (1, 5)
    assert covered.pairs_hit[0] == 3
    assert covered.empty_radius > 1.2  # the far corner of a unit cube is sqrt(3) away
    assert covered.boundary_resolved == 0.0


def test_a_space_as_narrow_as_its_points_is_covered():
    def holds(values):
        return np.abs(values["ego_speed"] - 2.0 * values["lead_speed"] - 2.0) < 1e-6

    line = replace(LOW_SPEED, constraints=(Constraint("on a line", holds),))
    points = np.array([[14.0, 6.0], [18.0, 8.0], [22.0, 10.0]])
    covered = space_coverage(partition(line), points)
    assert covered.empty_radius == 0.0
    assert covered.pairs_hit == (3, 3)


def test_pairs_that_no_point_can_have_are_not_missing():
    covered = space_coverage(partition(LOW_SPEED), sample(LOW_SPEED).points)
    # ego_speed 10..14 with lead_speed 16..20 does not exist: the lead is slower
    assert covered.pairs[0].counts[4, 0] == -1.0
    assert covered.boundary_resolved is None


def test_further_cases_go_where_neighbours_differ():
    points = sample(LOW_SPEED, levels=9).points
    influence = np.where(points[:, 0] > 25.0, np.where(np.arange(len(points)) % 2, 1.0, -1.0), 0.0)
    found = further_cases(LOW_SPEED, points, influence, 12)
    assert len(found.points) == 12
    assert LOW_SPEED.feasible(found.points).all()
    assert (found.points[:, 0] > 21.0).all()
    assert 0.5 < found.shrink < 1.0
    assert further_cases(LOW_SPEED, points, influence, 60).shrink < found.shrink


def test_where_all_cases_agree_further_ones_tell_nothing():
    points = sample(LOW_SPEED).points
    found = further_cases(LOW_SPEED, points, np.zeros(len(points)), 5)
    assert len(found.points) == 0
    assert found.shrink == 1.0
