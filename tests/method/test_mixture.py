"""Mixture mode and the leave-one-driver-out band: laws, worked numbers, and real motorway
drivers."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from drivers.real_data import needs_recordings, recording
from scipy.integrate import cumulative_trapezoid

from sumo_eval import Trajectory
from sumo_eval.method.anthropomorphic import anthropomorphic_index, indexes_by_group
from sumo_eval.method.index_terms import IndexNote
from sumo_eval.method.manoeuvres import chosen, manoeuvre_of, spread
from sumo_eval.record.human_reference import band_pairings
from sumo_eval.report.explain import _factors
from sumo_eval.scenario.concrete import Road, smooth_step
from sumo_eval.settings import AnthropomorphicSettings

ROAD = Road("straight", 300.0, 2, 3.5, 0.0)
MIXTURE = AnthropomorphicSettings(mode="mixture", slice_spacing=2.0)
GAUSSIAN = replace(MIXTURE, mode="gaussian")


def human_band(drivers, road, settings):
    pairings = band_pairings(range(len(drivers)), settings)
    return indexes_by_group(drivers, [pairings], road, settings)[0]


def drive(*, begin=None, speed=25.0, y=0.0, slow=0.0, to=3.5):
    """At `speed`, losing `slow` m/s2 from 3 s on for 3 s; a lane change of 5 s from `begin` s
    on."""
    time = np.arange(0.0, 20.0, 0.1)
    speeds = speed - slow * np.clip(time - 3.0, 0.0, 3.0)
    x = cumulative_trapezoid(speeds, dx=0.1, initial=0.0)
    lateral = np.full(time.size, y) if begin is None else y + to * smooth_step((time - begin) / 5.0)
    return Trajectory(time, x, lateral, speed=speeds)


OVERTAKERS = [drive(begin=1.0 + 0.3 * n, speed=25.0 + 0.2 * n, y=0.05 * n) for n in range(6)]
FOLLOWERS = [drive(speed=25.0, slow=2.0 + 0.1 * n, y=-0.1 * n) for n in range(2)]


def test_a_manoeuvre_is_the_first_change_of_lane_and_a_touch_does_not_count():
    assert manoeuvre_of(drive(), ROAD, 1.0) == (0,)
    assert manoeuvre_of(drive(begin=2.0), ROAD, 1.0) == (0, 1)
    there_and_back = drive(begin=1.0)
    y = there_and_back.y - 3.5 * smooth_step((there_and_back.time - 10.0) / 5.0)
    assert manoeuvre_of(replace(there_and_back, y=y), ROAD, 1.0) == (0, 1)
    further = Trajectory(np.arange(9.0), np.arange(9.0), 3.5 * (np.arange(9) // 3))
    assert manoeuvre_of(further, ROAD, 1.0) == (0, 1), "a second change does not count"
    for begin in range(60):
        for samples, visited in ((10, (0, 1)), (9, (0,))):
            y = np.zeros(100)
            y[begin + 1 : begin + 1 + samples] = 3.5
            visit = Trajectory(0.1 * np.arange(100), 2.0 * np.arange(100), y)
            assert manoeuvre_of(visit, ROAD, 1.0) == visited
    time = there_and_back.time
    touch = replace(there_and_back, y=np.where((time > 5.0) & (time < 5.8), 2.0, 0.0))
    assert manoeuvre_of(touch, ROAD, 1.0) == (0,)


def test_one_manoeuvre_only_and_no_pooling_to_speak_of_is_the_gaussian_mode():
    ads = drive(begin=1.2, speed=25.3)
    mixture = anthropomorphic_index(ads, OVERTAKERS, ROAD, replace(MIXTURE, pooled_drivers=1e-9))
    gaussian = anthropomorphic_index(ads, OVERTAKERS, ROAD, GAUSSIAN)
    assert mixture.similarity == pytest.approx(gaussian.similarity, abs=1e-6)


def test_the_ads_is_compared_with_those_who_did_as_it_did_times_how_usual_that_is():
    people = [*OVERTAKERS, *FOLLOWERS]
    follows = anthropomorphic_index(drive(slow=2.05, y=-0.05), people, ROAD, MIXTURE)
    # 2 of 8 follow, 6 of 8 overtake: the follower's manoeuvre is 2/6 as usual as the most usual
    # one.
    assert follows.manoeuvre == (0,)
    assert follows.share == 2 / 8
    alone = anthropomorphic_index(drive(slow=2.05, y=-0.05), FOLLOWERS, ROAD, MIXTURE)
    assert follows.similarity == pytest.approx(alone.similarity / 3.0, rel=0.1)
    of_both = [(it.ingredients.drivers, it.ingredients.mean_operations) for it in (follows, alone)]
    assert of_both[0] == of_both[1], "the means that `explain` shows are those of f_L and f_n"
    one = anthropomorphic_index(FOLLOWERS[0], [*OVERTAKERS, FOLLOWERS[0]], ROAD, MIXTURE)
    assert "mean L of 1 driver)" in next(_factors(one))
    manoeuvres = [manoeuvre_of(one, ROAD, MIXTURE.manoeuvre_time) for one in people]
    assert chosen((0,), manoeuvres).usual == 2 / 6
    assert chosen((0, 1), manoeuvres).usual == 1.0


def test_a_manoeuvre_that_no_driver_made_scores_zero_with_a_note():
    found = anthropomorphic_index(drive(), OVERTAKERS, ROAD, MIXTURE)
    assert found.value == 0.0
    assert IndexNote("manoeuvre_made_by_nobody", manoeuvre=(0,)) in found.notes


def test_the_car_that_drives_through_fools_one_gaussian_but_not_the_mixture():
    people = [*OVERTAKERS, *FOLLOWERS]
    through = drive()
    gaussian = anthropomorphic_index(through, people, ROAD, GAUSSIAN)
    assert gaussian.similarity > 0.8
    assert any(note.kind == "two_groups" for note in gaussian.notes)
    assert anthropomorphic_index(through, people, ROAD, MIXTURE).similarity < 0.15


def test_the_deviation_is_completed_by_the_pooled_one_by_hand():
    # Groups {0, 2} and {10}: the pooled variance within is ((0-1)^2 + (2-1)^2) / 1 = 2. Of the pair
    # with 2 pooled drivers: (2 + 2 * 2) / (1 + 2) = 2; of the single one: (0 + 2 * 2) / (0 + 2) =
    # 2.
    people = [drive(begin=1.0), drive(begin=1.1), drive()]
    values, there = np.array([[0.0], [2.0], [10.0]]), np.ones((3, 1), dtype=bool)
    for ads, mean in ((drive(begin=1.2), 1.0), (drive(), 10.0)):
        own, *others = (manoeuvre_of(it, ROAD, MIXTURE.manoeuvre_time) for it in (ads, *people))
        middle, deviation = spread(values, there, chosen(own, others), 2.0)
        assert (middle[0], deviation[0]) == (pytest.approx(mean), pytest.approx(np.sqrt(2.0)))


@pytest.mark.parametrize("settings", [GAUSSIAN, MIXTURE])
def test_the_band_compares_each_driver_with_the_rest(settings):
    people = [*OVERTAKERS[:3], *FOLLOWERS]
    band = human_band(people, ROAD, replace(settings, band_slice_spacing=2.0))
    for place, driver in enumerate(people):
        others = [*people[:place], *people[place + 1 :]]
        assert band[place].value == pytest.approx(
            anthropomorphic_index(driver, others, ROAD, settings).value
        )


def test_coarse_slices_move_the_band_by_less_than_two_hundredths():
    people = [*OVERTAKERS, *FOLLOWERS]
    fine = human_band(people, ROAD, AnthropomorphicSettings(band_slice_spacing=0.5))
    pairs = zip(fine, human_band(people, ROAD, AnthropomorphicSettings()), strict=True)
    assert max(abs(one.value - other.value) for one, other in pairs) < 0.02


# --- real drivers ---------------------------------------------------------------------------------


def _real_bins():
    """Motorway bins of approaches with at least 7 drivers: label, mean speeds and gap, drives from
    t = 0."""
    duckdb = pytest.importorskip("duckdb")
    bins = pd.read_csv(recording("dlr_ht", "concrete_scenarios.csv"))
    series = duckdb.sql(f"select * from '{recording('dlr_ht', 'approach_series.parquet')}'").df()
    series = series[series["t"] >= -1e-6]
    chosen = bins[(bins["n_drivers"] >= 7) & (bins["scenario"] == "front_vehicle_low_speed")]
    for _, row in chosen.iterrows():
        drives = []
        for name in row["event_ids"].split(";"):
            event = series[series["event_id"] == name]
            x = event["ego_x"] - event["ego_x"].iloc[0]
            channels = {"speed": event["ego_v"], "acceleration": event["ego_a"]}
            drives.append(Trajectory(event["t"], x, event["ego_y"], **channels))
        yield row, drives


def _cars(speed, lead_speed):
    """Cars that start as the bin's mean driver does, over 60 s."""
    time = np.arange(0.0, 60.0, 0.1)

    def along(speeds, y=0.0):
        x = cumulative_trapezoid(speeds, dx=0.1, initial=0.0)
        return Trajectory(time, x, np.broadcast_to(y, time.shape), speed=speeds)

    steady = np.full(time.size, speed)
    return {
        "through": along(steady),
        "overtakes": along(steady, 3.7 * smooth_step((time - 4.0) / 8.5)),
        "brakes hard": along(np.maximum(speed - 8.0 * np.maximum(time - 1.0, 0.0), lead_speed)),
        "slows to 10 m/s": along(np.maximum(speed - 3.0 * time, 10.0)),
    }


@needs_recordings
def test_real_drivers_are_distinguished_from_extreme_cars():
    """On 350 m of road, with whole recordings: they show who was about to overtake.

    The figures are in docs/explanation/drivers.md.
    """
    road = Road("motorway", 350.0, 2, 3.7, 0.0)
    bins = list(_real_bins())
    assert len(bins) == 6
    for row, drives in bins:
        mean = float(np.mean([one.similarity for one in human_band(drives, road, MIXTURE)]))
        cars = _cars(float(np.mean([one.speed[0] for one in drives])), row["v_lead_mean"])
        share = {
            name: anthropomorphic_index(car, drives, road, MIXTURE).similarity / mean
            for name, car in cars.items()
        }
        assert share["overtakes"] > 0.9, row["event_ids"]
        for name in ("through", "brakes hard", "slows to 10 m/s"):
            assert share[name] < 0.4, (name, row["event_ids"])
