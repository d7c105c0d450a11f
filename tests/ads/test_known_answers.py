"""ADSs whose crashes are known in closed form are reproduced through SUMO."""

import math

import numpy as np
import pytest
from refusals import refusal
from road_scenes import ROAD, actor, case, grid, low_speed

from sumo_eval.ads import IdealBraking
from sumo_eval.cosim import simulate
from sumo_eval.method.criticality import ideal_impact_speed
from sumo_eval.scenario import catalogue
from sumo_eval.settings import SimulationSettings, VehicleSettings

CUT_OUT = catalogue.load("front_vehicle_cut_out")


def ideal_impact(values):
    """Ug of points of the cut-out, m/s."""
    return ideal_impact_speed(
        values["ego_speed"],
        values["obstacle_speed"],
        values["gap"],
        deceleration=9.0,
        build_up=0.15,
    )


def cut_outs():
    """A coarse grid, points at which the ideal vehicle hits, and points at which it would with a
    gap 5 % smaller."""
    points = CUT_OUT.from_unit(np.random.default_rng(3).random((40_000, 3)))
    points = points[CUT_OUT.feasible(points)]
    hits = ideal_impact(CUT_OUT.columns(points)) > 0.0
    almost = ~hits & (ideal_impact(CUT_OUT.columns(points * np.array([1.0, 1.0, 0.95]))) > 0.0)
    return CUT_OUT.concretes(
        np.concatenate([grid(CUT_OUT)[::8], points[hits][:20], points[almost][:20]])
    )


SEES_THROUGH = SimulationSettings(ideal_visible_share=0.0)


@pytest.mark.campaign
def test_ideal_braking_that_sees_through_hits_exactly_as_fast_as_the_closed_form_says():
    hits = 0
    for concrete in cut_outs():
        expected = float(ideal_impact(concrete.values))
        recording = simulate(concrete, "ideal_braking", SEES_THROUGH)
        got = recording.collision.relative_speed if recording.collision else 0.0
        assert recording.error is None
        assert (got > 0.0) == (expected > 0.0), concrete.label
        assert got == pytest.approx(expected, abs=0.1), concrete.label
        hits += got > 0.0
    assert hits >= 15


@pytest.mark.parametrize("gap", [20.0, 30.0, 44.0])
def test_the_closed_form_holds_for_another_deceleration(gap):
    weak = SimulationSettings(vehicle=VehicleSettings(max_deceleration=6.0))
    recording = simulate(case(actor("lead", gap, 0.0), speed=25.0), IdealBraking(6.0), weak)
    expected = ideal_impact_speed(25.0, 0.0, gap, deceleration=6.0, build_up=0.15)
    assert recording.collision.relative_speed == pytest.approx(expected, abs=0.1)


def test_ideal_braking_sees_a_hidden_obstacle_at_once_and_stays_as_slow():
    hidden = CUT_OUT.concrete(ego_speed=20.0, obstacle_speed=10.0, gap=60.0)
    recording = simulate(hidden, "ideal_braking", SEES_THROUGH)
    ego = recording.ego
    assert ego.acceleration[2] == -9.0
    assert np.diff(ego.speed).max() < 1e-9
    assert 9.0 < ego.speed[-1] <= 10.0
    assert recording.end_reason == "road_end"


def test_ideal_braking_does_not_brake_for_the_other_lane_nor_for_what_drives_away():
    others = actor("left", 30.0, 0.0, y=3.5), actor("faster", 10.0, 25.0)
    recording = simulate(case(*others, speed=20.0), "ideal_braking")
    assert recording.end_reason == "road_end"
    assert recording.ego.speed == pytest.approx(20.0)


@pytest.mark.parametrize("deceleration", [0.0, -9.0, math.inf, math.nan])
def test_ideal_braking_needs_a_deceleration(deceleration):
    with refusal("`deceleration` of ADS `ideal_braking` must be a finite number greater than 0"):
        IdealBraking(deceleration)


NEAR_MISSES = [(20.0, 70.0, 17.40), (20.0, 70.0, 17.50), (30.0, 60.0, 26.70), (30.0, 60.0, 26.75)]


@pytest.mark.parametrize(
    "concrete",
    low_speed() + [case(actor("lead", gap, lead), speed=speed) for speed, gap, lead in NEAR_MISSES],
    ids=lambda c: c.label,
)
def test_no_reaction_collides_exactly_when_the_gap_closes_on_the_road(concrete):
    (lead,) = concrete.actors
    closing = concrete.ego.speed - lead.start.speed
    contact = (lead.start.x - concrete.ego.x - 4.5) / closing
    on_the_road = contact < (ROAD.length - concrete.ego.x) / concrete.ego.speed
    recording = simulate(concrete, "no_reaction")
    assert recording.end_reason == ("contact" if on_the_road else "road_end")
    if on_the_road:
        assert recording.collision.time == pytest.approx(contact, abs=1e-6)
        assert recording.collision.relative_speed == pytest.approx(closing, abs=1e-9)


def test_the_near_misses_lie_on_both_sides():
    ends = {
        simulate(case(actor("lead", gap, lead), speed=v), "no_reaction").end_reason
        for v, gap, lead in NEAR_MISSES
    }
    assert ends == {"contact", "road_end"}
