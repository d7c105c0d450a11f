"""How outcomes of the shipped drivers move with the simulation's step: hardly, where a step is a small one."""

import os

import numpy as np
import pytest

from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.scenario import catalogue
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording, Trajectory

SHARE = float(os.environ.get("SUMO_EVAL_CAMPAIGN_SHARE", "1"))
SCRIPTED = sorted(name for name, logical in catalogue.SCENARIOS.items() if logical.approach is not None)
"""Scenarios in which what the others do is known before anybody drives."""
DRIVERS = ("careful_driver", "careful_driver_aeb", "fsm", "rss", "idm", "lane_changer", "ideal_braking", "no_reaction")
RELEASING = ("reg157", "eu_2022_1426", "eu_2022_1426_bus")  # they release where TTC is critical, again and again
GRAZE = 0.02  # m


def at(step: float) -> SimulationSettings:
    return SimulationSettings(step=step, record_interval=0.1, time_limit=35.0, end_when_decided=True)


def driven(concrete, ads: str, step: float) -> Recording:
    return simulate(concrete, ads, at(step))


def least_gap(recording: Recording) -> float:
    """Least bumper gap to a vehicle ahead while its body and the ego's share a strip of road, m; 0 with contact. Linear
    between the samples.
    """
    if recording.collision is not None:
        return 0.0
    least, ego = np.inf, recording.ego
    for other in recording.actors.values():
        n = min(len(ego), len(other))
        gap = other.x[:n] - ego.x[:n] - 0.5 * (ego.length + other.length)
        across, reach = ego.y[:n] - other.y[:n], 0.5 * (ego.width + other.width)
        moved = np.diff(across)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort([(side * reach - across[:-1]) / moved for side in (-1.0, 1.0)], axis=0)
        still = moved == 0.0
        begin = np.where(still, 0.0, np.maximum(ends[0], 0.0))
        end = np.where(still, np.where(np.abs(across[:-1]) < reach, 1.0, -1.0), np.minimum(ends[1], 1.0))
        for share in (begin, end):
            found = (gap[:-1] + share * np.diff(gap))[begin < end]
            least = min(least, float(found[found > 0.0].min(initial=np.inf)))
    return least


def gaps(cases, ads: str, step: float) -> np.ndarray:
    """The least gap of each case, which are driven together."""
    return np.array([least_gap(recording) for recording in simulate_many(cases, ads, at(step))])


@pytest.mark.parametrize("step", [0.1, 0.05, 0.02, 0.01])
def test_rss_behind_a_braking_lead_hits_at_every_step(step):
    # A driver that held the level of a step's end for the whole step kept 2.2, 0.21 and 0.16 m at the first three.
    lead = catalogue.load("front_vehicle_braking")
    concrete = lead.concrete(ego_speed=28.785, headway=0.639, lead_deceleration=6.284)
    assert driven(concrete, "rss", step).collision is not None


NEAR = [
    # points at which a driver keeps less than 0.5 m, found by search at a step of 0.005 s
    ("careful_driver", "front_vehicle_braking", (12.0573, 0.566149, 3.41615)),
    ("fsm", "cut_in", (38.1915, 24.2659, 36.8993, 1.63189)),
    ("careful_driver", "r157_cut_out", (12.0573, 3.30747, 1.00192)),
    ("careful_driver_aeb", "r157_cut_out", (20.1107, 4.93227, 2.50469)),
    ("lane_changer", "front_vehicle_braking", (28.3947, 0.520683, 4.0226)),
]


@pytest.mark.parametrize(("ads", "name", "point"), NEAR)
def test_the_least_gap_hardly_moves_with_the_step(ads, name, point):
    logical = catalogue.load(name)
    concrete = logical.concrete(**dict(zip(logical.names, point, strict=True)))
    found = [least_gap(driven(concrete, ads, step)) for step in (0.05, 0.01)]
    assert 0.0 < found[1] < 0.5
    assert found[0] == pytest.approx(found[1], abs=GRAZE)


def drawn(name: str, count: int):
    logical = catalogue.load(name)
    points = logical.from_unit(np.random.default_rng(21).random((8 * count, len(logical.names))))
    return list(logical.concretes(points[logical.feasible(points)][:count]))


def far_flips(name: str, ads: str, count: int) -> list[tuple[str, float]]:
    """Points whose outcome at 0.05 s is not that at 0.005 s, where one of the two runs keeps more than a graze, m."""
    cases = drawn(name, count)
    coarse, fine = (gaps(cases, ads, step) for step in (0.05, 0.005))
    kept = np.maximum(coarse, fine)
    changed = ((coarse > 0.0) != (fine > 0.0)) & (kept > GRAZE)
    return [(cases[row].label, float(kept[row])) for row in np.flatnonzero(changed)]


def test_the_least_gap_is_taken_between_the_samples_too():
    # 2 m/s faster, 5 m behind; 1 m/s to the left: bodies 1.8 m wide share a strip until 1.8 s, the gap then is 1.4 m
    time = np.arange(0.0, 3.0, 0.5)
    ego = Trajectory(time, 12.0 * time, time, speed=np.full(6, 12.0))
    ahead = Trajectory(time, 9.5 + 10.0 * time, np.zeros(6), speed=np.full(6, 10.0))
    recording = Recording(ego, {"ahead": ahead}, None, "road_end")
    assert least_gap(recording) == pytest.approx(5.0 - 2.0 * 1.8)


def test_no_outcome_of_lane_changer_depends_on_the_step():
    assert not far_flips("front_vehicle_braking", "lane_changer", 40)


@pytest.mark.campaign
@pytest.mark.parametrize("ads", [*DRIVERS, *RELEASING])
@pytest.mark.parametrize("name", SCRIPTED)
def test_no_outcome_depends_on_the_step_further_than_a_graze_from_contact(name, ads):
    assert not far_flips(name, ads, max(1, round(1000 * SHARE)))
