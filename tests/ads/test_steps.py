"""How outcomes of the shipped drivers move with the simulation's step: hardly, where a step is a
small one."""

from dataclasses import replace

import numpy as np
import pytest
from ads.ads_cases import SCRIPTED
from campaign_share import SHARE
from road_scenes import ROAD, at_point, drawn_cases

from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording, Trajectory

DRIVERS = (
    "careful_driver",
    "careful_driver_aeb",
    "fsm",
    "rss",
    "idm",
    "lane_changer",
    "ideal_braking",
    "no_reaction",
)
# they release where TTC is critical, again and again
RELEASING = ("reg157", "eu_2022_1426", "eu_2022_1426_bus")
GRAZE = 0.02  # m


def at(step):
    return SimulationSettings(
        step=step, record_interval=0.1, time_limit=35.0, end_when_decided=True
    )


def driven(concrete, ads, step):
    return simulate(concrete, ads, at(step))


def least_gap(recording):
    """Least bumper gap to a vehicle ahead while its body and the ego's share a strip of road, m; 0
    with contact. Linear between the samples.
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
        end = np.where(
            still, np.where(np.abs(across[:-1]) < reach, 1.0, -1.0), np.minimum(ends[1], 1.0)
        )
        for share in (begin, end):
            found = (gap[:-1] + share * np.diff(gap))[begin < end]
            least = min(least, float(found[found > 0.0].min(initial=np.inf)))
    return least


def corners(trajectory, road, times):
    """The corners of a body on the map as complex numbers, (n, 4) m.

    Places and headings are linear between the samples.
    """
    x, y, heading = map_places(road.line, trajectory.x, trajectory.y, trajectory.heading)
    x, y, heading = (np.interp(times, trajectory.time, it) for it in (x, y, np.unwrap(heading)))
    half = 0.5 * complex(trajectory.length, trajectory.width)
    around = np.array([half, -half.conjugate(), -half, half.conjugate()])
    return (x + 1j * y)[:, None] + np.exp(1j * heading)[:, None] * around


def to_edges(points, boxes):
    """The least distance of any of a body's corners to the edges of another, m."""
    edge = (np.roll(boxes, -1, axis=1) - boxes)[:, None]
    away = points[:, :, None] - boxes[:, None]
    share = np.clip((away * edge.conj()).real / np.abs(edge) ** 2, 0.0, 1.0)
    return np.abs(away - share * edge).min()


def clearance(recording, road):
    """How far from contact a drive without contact stayed: the least distance of the bodies on the
    map, m."""
    least = np.inf
    for other in recording.actors.values():
        times = np.arange(0.0, min(recording.ego.time[-1], other.time[-1]), 0.005)
        mine, its = corners(recording.ego, road, times), corners(other, road, times)
        least = min(least, to_edges(mine, its), to_edges(its, mine))
    return float(least)


def outcomes(cases, ads, step):
    """The drives of cases, which are driven together, whether each ends in contact, and its least
    gap, m."""
    recordings = list(simulate_many(cases, ads, at(step)))
    return (
        recordings,
        np.array([recording.collision is not None for recording in recordings]),
        np.array([least_gap(recording) for recording in recordings]),
    )


@pytest.mark.parametrize("step", [0.1, 0.05, 0.02, 0.01])
def test_rss_behind_a_braking_lead_hits_at_every_step(step):
    # A driver that held the level of a step's end for the whole step kept 2.2, 0.21 and 0.16 m at
    # the first three.
    braking = at_point("front_vehicle_braking", 28.785, 0.639, 6.284)
    assert driven(braking, "rss", step).collision is not None


NEAR = [
    # points at which a driver keeps less than 0.5 m, found by search at a step of 0.005 s
    ("careful_driver", "front_vehicle_braking", (12.0573, 0.566149, 3.41615)),
    ("fsm", "cut_in", (38.1915, 24.2659, 36.8993, 1.63189)),
    ("careful_driver", "r157_cut_out", (12.0573, 3.30747, 1.00192)),
    ("careful_driver_aeb", "r157_cut_out", (20.1107, 4.93227, 2.50469)),
    ("lane_changer", "front_vehicle_braking", (28.3947, 0.520683, 4.0226)),
]


@pytest.mark.parametrize("ads, name, point", NEAR)
def test_the_least_gap_hardly_moves_with_the_step(ads, name, point):
    found = [least_gap(driven(at_point(name, *point), ads, step)) for step in (0.05, 0.01)]
    assert 0.0 < found[1] < 0.5
    assert found[0] == pytest.approx(found[1], abs=GRAZE)


def far_flips(name, ads, count):
    """Points whose outcome at 0.05 s is not that at 0.005 s, and by how much more than a graze one
    run is clear, m."""
    cases = drawn_cases(name, count, 21)
    (coarse, hit, gap), (fine, hit_fine, gap_fine) = (
        outcomes(cases, ads, step) for step in (0.05, 0.005)
    )
    near = (gap_fine < 0.5) & (gap < np.inf) & ~hit & ~hit_fine
    moves = np.abs(gap[near] - gap_fine[near]) if near.any() else np.zeros(1)
    flips = [
        (cases[row].label, clearance((fine if hit[row] else coarse)[row], cases[row].road))
        for row in np.flatnonzero(hit != hit_fine)
    ]
    print(
        f"{name} {ads}: {len(cases)} points, {hit_fine.sum()} contacts, {len(flips)} outcomes "
        "change, where bodies are "
        f"at most {max((kept for _, kept in flips), default=0.0):.4f} m apart; {near.sum()} gaps "
        "below 0.5 m move by "
        f"{np.median(moves):.4f} m, at most {moves.max():.4f} m"
    )
    return [(label, kept) for label, kept in flips if kept > GRAZE]


@pytest.mark.parametrize("step", [0.1, 0.05, 0.005])
@pytest.mark.parametrize("ads", ["idm", "lane_changer", "no_reaction"])
def test_law_on_a_curve_none_leaves_the_line_without_reason(ads, step):
    # A wheel that is taken to be straight when the drive begins was turned anew: 4 mm to the left
    # at a step of 0.05 s.
    settings = replace(at(step), time_limit=0.3, end_when_decided=False)
    ego = simulate(at_point("curve_braking", 20.0, 2.4, 2.0), ads, settings).ego
    assert len(ego) == 4
    assert np.abs(ego.y - ego.y[0]).max() < 2e-5
    assert np.abs(ego.steering_wheel_angle - ego.steering_wheel_angle[0]).max() < 1e-4


HUNG_ON_MILLIMETRES = [
    ("curve_braking", (24.6705, 1.55017, 8.78243)),
    ("curve_braking", (24.733, 2.13913, 6.52766)),
    ("curve_cut_in", (20.7896, 6.40342, 28.0572, 1.51642)),
]


@pytest.mark.parametrize("name, point", HUNG_ON_MILLIMETRES)
def test_lane_changer_on_a_curve_ends_the_same_at_every_step(name, point):
    coarse, fine = (driven(at_point(name, *point), "lane_changer", step) for step in (0.05, 0.01))
    assert coarse.end_reason == fine.end_reason
    assert (coarse.collision is None) == (fine.collision is None)


def test_the_clearance_of_bodies_on_the_map_by_hand():
    # 10 m behind a standing vehicle of 4.5 m that is turned by a right angle, to the side for 1.8 m:
    # 10 - 0.9 - 2.25 m. Turned by 45 degrees: a corner (2.25 + 0.9) / sqrt 2 nearer, (2.25 - 0.9) /
    # sqrt 2 to the side of the ego's axis
    def standing(x, heading):
        return Trajectory([0.0, 1.0], [x, x], [0.0, 0.0], [heading, heading], [0.0, 0.0])

    for heading, least in (
        (0.5 * np.pi, 10.0 - 0.9 - 2.25),
        (0.25 * np.pi, np.hypot(10.0 - 2.25 - 3.15 / 2**0.5, 1.35 / 2**0.5 - 0.9)),
    ):
        actors = {"turned": standing(10.0, heading)}
        found = clearance(Recording(standing(0.0, 0.0), actors, None, "road_end"), ROAD)
        assert found == pytest.approx(least)


def test_the_least_gap_is_taken_between_the_samples_too():
    # 2 m/s faster, 5 m behind; 1 m/s to the left: bodies 1.8 m wide share a strip until 1.8 s, the
    # gap then is 1.4 m
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
