"""The search for a boundary, on sets that are known exactly: intervals, discs, islands.

No simulation.
"""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from scenario.test_samplers import axis, space
from tables import in_campaign

from sumo_eval.extras.studies.straddle import POOL, BoundarySearch
from sumo_eval.scenario import Constraint, Parameter


def square(*names, **changes):
    return replace(space(*(axis(name, 0.0, 10.0, 1.0) for name in names)), **changes)


def slanting_interval(points):
    """Neither a larger nor a smaller b is always worse: a cut-in's collisions are such a set."""
    a, b = points[:, 0], points[:, 1]
    return (b > 1.0 + 0.3 * a) & (b < 4.0 + 0.2 * a)


def two_pieces(points):
    a, b = points[:, 0], points[:, 1]
    return (np.hypot(a - 2.5, b - 7.0) < 1.8) | (a + 0.3 * b > 9.0)


def test_a_space_without_an_untried_point_asks_for_none():
    search = BoundarySearch(square("a", "b"))
    points = search.ask(POOL)
    search.tell(points[::40], slanting_interval(points[::40]))
    assert not len(search.ask(1))


def run(logical, truth, budget, seed=1):
    search = BoundarySearch(logical, seed)
    points = search.ask(32)
    search.tell(points, truth(points))
    while len(search.points) < budget:
        points = search.ask(16)
        search.tell(points, truth(points))
    return search


def grid_of(logical, side=100):
    middle = (np.arange(side) + 0.5) / side
    unit = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)
    points = logical.from_unit(unit)
    return points[logical.feasible(points)]


@pytest.mark.campaign
@pytest.mark.parametrize("truth", [in_campaign(slanting_interval), two_pieces])
def test_160_trials_class_99_per_cent_of_10000_points_rightly_whatever_the_shape(truth):
    logical = square("a", "b")
    search, points = run(logical, truth, 160), grid_of(logical)
    wrong = np.mean(search.classify(points) != truth(points))
    assert wrong <= 0.01
    # the same number of evenly spread trials, with the same classifier, leaves more
    even = BoundarySearch(logical, 1)
    trials = even.ask(160)
    even.tell(trials, truth(trials))
    assert wrong < np.mean(even.classify(points) != truth(points))


def test_the_search_looks_at_the_boundary_and_the_expected_change_falls():
    search = run(square("a", "b"), slanting_interval, 192)
    a, b = search.points[32:].T
    edge = np.minimum(np.abs(b - 1.0 - 0.3 * a), np.abs(b - 4.0 - 0.2 * a))
    # of evenly spread trials about a quarter would lie within 0.6 of an edge
    assert np.mean(edge < 0.6) > 0.5
    assert search.expected_change < 0.01
    assert search.doubt < 0.2


def test_same_seed_same_questions_another_seed_others():
    logical = square("a", "b")
    first, again, other = (run(logical, two_pieces, 48, seed).points for seed in (3, 3, 4))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_only_possible_points_are_asked_for_and_none_twice():
    logical = square("a", "b", constraints=(Constraint("low", lambda v: v["b"] <= v["a"]),))
    search = run(logical, slanting_interval, 96)
    assert logical.feasible(search.points).all()
    assert len(np.unique(search.points, axis=0)) == len(search.points)


def test_points_without_an_outcome_are_not_asked_for_again():
    search = BoundarySearch(square("a", "b"))
    lost = search.ask(10)
    assert not {tuple(row) for row in lost.tolist()} & {
        tuple(row) for row in search.ask(20).tolist()
    }
    assert len(search.points) == 0


def test_while_everything_ends_alike_the_trials_are_spread_evenly_and_nothing_is_expected_to_be_settled():
    search = BoundarySearch(square("a", "b"))
    for _ in range(6):
        search.tell(search.ask(16), np.zeros(16))
    assert search.expected_change == 1.0
    assert not search.classify(grid_of(square("a", "b"), 10)).any()
    assert len({(int(a / 2.5001), int(b / 2.5001)) for a, b in search.points}) == 16


def test_rounds_without_outcomes_are_no_change():
    search = run(square("a", "b"), two_pieces, 48)
    for _ in range(4):
        search.tell(np.empty((0, 2)), [])
    assert search.expected_change == 1.0


@pytest.mark.campaign
def test_three_parameters():
    logical = square("a", "b", "c")
    truth = lambda p: np.linalg.norm(p - 5.0, axis=1) < 3.5  # noqa: E731
    search = run(logical, truth, 240)
    points = np.random.default_rng(1).uniform(0.0, 10.0, (4000, 3))
    assert np.mean(search.classify(points) != truth(points)) < 0.02


def test_between_listed_values_there_is_no_boundary():
    listed = (
        Parameter("a", 0.0, 1.0, 1.0, "m", "-", values=(0.0, 1.0)),
        Parameter("b", 0.0, 1.0, 0.5, "m", "-"),
    )
    with refusal("hold it fixed"):
        BoundarySearch(square("a", "b", parameters=listed))
    with refusal("must have a possible point"):
        BoundarySearch(square("a", constraints=(Constraint("none", lambda v: v["a"] < -1.0),)))
