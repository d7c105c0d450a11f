"""`sumo-eval campaign`: rare collisions are counted right, and rates are in the order that is
known."""

from types import SimpleNamespace

import numpy as np
import pytest
from commands import cli_refuses, sumo_eval
from laid import read_json
from rates.rare import estimate, logical

from sumo_eval.extras.rates.campaign import EncounterSpace, part_of, summed
from sumo_eval.extras.rates.campaign_page import lost_words, unseen_words
from sumo_eval.extras.rates.exposure import normalised_exposure
from sumo_eval.extras.rates.importance import DEFENSIVE, RareEvents, estimated
from sumo_eval.scenario.shipped_files import scenario_files

FILE = """
name = "two drivers"
seed = 2
budget = 48

[run]
engine = "serial"

[[scenario]]
use = "front_vehicle_low_speed"
per_km = 0.2

[[ads]]
name = "asleep"
controller = "no_reaction"

[[ads]]
name = "awake"
controller = "idm"
"""


@pytest.mark.campaign
def test_one_collision_in_a_million_encounters_is_found_with_400_drives():
    found = estimate(1e-6, 400, 1)
    assert found.drives <= 400
    value, low, high = found.probability
    assert low <= 1e-6 <= high < 2.0 * low
    # every collision of this scenario has L = 0.5
    assert found.loss[0] == pytest.approx(0.5 * value)


@pytest.mark.campaign
def test_intervals_of_one_in_a_million_hold_it():
    held = sum(
        found.probability[1] <= 1e-6 <= found.probability[2]
        for found in (estimate(1e-6, 1000, s) for s in range(40))
    )
    print(f"{held} of 40")
    assert held >= 35  # of 95 %, less three deviations of a count of 40


def test_a_density_of_encounters_integrates_to_one():
    exposure = normalised_exposure(logical())
    points = exposure.base(4000, np.random.default_rng(1))
    assert np.mean(exposure.density(points) / exposure.base_density(points)) == pytest.approx(
        1.0, abs=1e-6
    )
    assert exposure.density(np.array([[99.0, 15.0, 2.5]]))[0] == 0.0


def test_impossible_points_end_no_search():
    """1 point of 400 is possible, where 2.8 deviations less than the mean close in on the lead."""
    narrow = {"require": "ego_speed - lead_speed < 4", "about": "one that hardly closes in"}
    search = RareEvents(normalised_exposure(logical(constraint=[narrow])), 40)
    while len((draw := search.ask()).points):
        search.tell(draw, np.zeros(len(draw.points), bool), np.zeros(len(draw.points)))
    assert search.drives == 40
    assert search.drawn >= search.in_estimate.sum()


def test_without_a_collision_the_limit_is_that_of_drawn_drives():
    # 3.0 / (0.2 * 300): (1 - P)^60 = 5 % at P = 0.0487, and -ln(0.05) / 60 = 0.0499 is just above
    # it.
    none = estimated(np.empty(0), np.empty(0), 300, 1.0, 0, 500)
    assert none.probability == pytest.approx((0.0, 0.0, 2.9957 / (DEFENSIVE * 300)), rel=1e-4)
    # 9 hits: half of chi-squared's 95 % with 20 degrees of freedom, 31.41
    hit = estimated(np.ones(9), np.ones(9), 300, 1.0, 9, 500)
    assert hit.upper_limit == pytest.approx(15.705 / 60.0, rel=1e-4)


def test_a_sum_is_as_wide_as_its_largest_scenario():
    def part(name, weights):
        ones, loss = np.ones(len(weights), dtype=bool), np.full(len(weights), 0.5)
        told = estimated(weights, loss, 100, 1.0, len(weights), 100)
        search = SimpleNamespace(
            estimate=lambda: told,
            in_estimate=ones,
            collided=ones,
            weights=weights,
            loss=loss,
            drawn=100,
        )
        search.points = np.zeros((len(weights), 3))
        return part_of(
            EncounterSpace(name, logical(), normalised_exposure(logical()), 0.1, None),
            search,
            1,
            "budget",
            {},
        )

    # one of ten collisions makes nearly all of the rate
    doubtful = part("doubtful", np.array([1e-3, *[1e-6] * 9]))
    certain = part("certain", np.full(90, 1e-6))
    for kind in ("collisions", "loss"):
        value, low, high = getattr(summed("x", "x", [doubtful, certain]), kind)
        one, other = getattr(doubtful, kind), getattr(certain, kind)
        assert value == pytest.approx(one[0] + other[0])
        assert other[1] < low < one[0]
        assert one[2] <= 1.1 * high <= 1.1 * 1.1 * (one[2] + other[2])
    assert unseen_words(summed("x", "x", [doubtful, certain])) == ""
    unseen = part("unseen", np.empty(0))
    rate = summed("x", "x", [certain, unseen])
    assert rate.collisions == certain.collisions
    # 0.1 encounters a km; 3.0 over the 20 of 100 drives that were drawn as points are met.
    assert (
        "do not include rare: no collision was seen there, at most 15,000 (95 %)"
        in unseen_words(rate)
    )
    assert unseen_words(summed("x", "x", [unseen])) == ""
    alone = summed("x", "x", [certain, certain])
    # errors average
    assert alone.collisions[2] / alone.collisions[0] < certain.collisions[2] / certain.collisions[0]


def test_terms_that_are_alike_have_the_interval_of_a_share():
    # 90 of 100 with weight 1e-6: the mean is 9e-7, its relative error sqrt(0.1 / 0.9 / 99) = 3.35
    # %.
    found = estimated(np.full(90, 1e-6), np.full(90, 0.4), 100, 1.0, 90, 100)
    assert found.probability[0] == pytest.approx(9e-7)
    assert found.deviation == pytest.approx(np.sqrt(0.1 / 0.9 / 99.0), rel=1e-6)
    assert found.loss[0] == pytest.approx(3.6e-7)


def test_the_limits_of_a_probability_hold_its_value():
    # every drive collides; by chance, the mean of the weights is above 1: 1.05
    weights = np.repeat([1.0, 1.1], 100)
    value, low, high = estimated(weights, np.ones(200), 200, 1.0, 200, 200).probability
    assert value == high == 1.0
    assert 0.95 < low < 1.0


@pytest.mark.campaign
def test_a_driver_who_sleeps_has_a_higher_rate_than_one_who_does_not(tmp_path):
    file = tmp_path / "campaign.toml"
    file.write_text(FILE)
    sumo_eval(f"campaign {file} --out {tmp_path}/out")
    asleep, awake = read_json(tmp_path / "out" / "campaign.json")["ads"]
    assert awake["collisions"] < asleep["collisions"]
    assert awake["collisions_interval"][1] > 0.0  # an upper limit, where none was seen
    (part,) = asleep["by_scenario"]
    # Doing nothing, every encounter ends in a collision: the lead is slower, and the road long
    # enough for most.
    assert part["collision_probability"] > 0.5
    assert asleep["collisions"] == pytest.approx(2e5 * part["collision_probability"])
    page = (tmp_path / "out" / "campaign.html").read_text()
    assert "rates per million km by scenario" in page  # the unit of its column `collisions`
    assert "Outside these rates" in page
    assert "as given" in page


def test_a_scenario_without_a_frequency_is_refused(tmp_path):
    file = tmp_path / "campaign.toml"
    file.write_text(FILE.replace("per_km = 0.2\n", ""))
    cli_refuses(
        "Scenario `front_vehicle_low_speed` needs an encounter rate",
        f"campaign {file} --out {tmp_path}/out",
    )


def test_two_scenarios_of_one_name_are_refused(tmp_path):
    shipped = scenario_files()["front_vehicle_low_speed"]
    (tmp_path / "own.toml").write_text(shipped.read_text())
    file = tmp_path / "campaign.toml"
    file.write_text(FILE + '[[scenario]]\nuse = "own.toml"\nper_km = 0.1\n')
    cli_refuses(
        "must differ in their names, got `front_vehicle_low_speed` twice",
        f"campaign {file} --out {tmp_path}/out",
    )


def test_drives_that_could_not_be_evaluated_are_listed_by_reason():
    assert lost_words({"sim_error": 2, "ads_error": 1}) == (
        "3 drives could not be evaluated (ads_error 1, sim_error 2) and count as without a "
        "collision."
    )
    assert lost_words({"x": 1}).startswith("1 drive could not be evaluated (x 1) and counts as")
