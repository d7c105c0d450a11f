"""Confidence put together from rows and facts: influence, the drivers' error, and where there is no interval."""

import math
from dataclasses import replace

import builders
import numpy as np
import pytest

from sumo_eval.batch.run_folder import FACTS
from sumo_eval.batch.store import open_store
from sumo_eval.confidence.assessment import assess, driver_error, influence
from sumo_eval.confidence.intervals import CaseTerms
from sumo_eval.method.anthropomorphic import anthropomorphic_index
from sumo_eval.method.zone_partition import partition
from sumo_eval.scenario import catalogue
from sumo_eval.settings import MethodSettings, RunSettings, ZoneSettings

QUICK = ZoneSettings(restarts=1, grid_points=5_000)
CUT_OUT = "front_vehicle_cut_out"


@pytest.fixture(scope="module")
def partitions():
    return {name: partition(catalogue.load(name), QUICK) for name in builders.SCENARIOS}


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory, partitions):
    found = builders.evaluation(tmp_path_factory.mktemp("assessed") / "run", partitions)
    return replace(found, settings=replace(found.settings, run=RunSettings(workers=1)))


def four_cases(**changes):
    nan = math.nan
    plain = {
        "exposure": np.array([2.0, 2.0, 1.0, 4.0]),
        "collided": np.array([True, True, False, False]),
        "avoided": np.array([0.2, 0.8, nan, nan]),
        "weight": np.array([1.0, 3.0, nan, nan]),
        "index": np.array([nan, nan, 0.4, 0.9]),
        "y": np.array([-1.0, -1.0, 1.0, 1.0]),
        "boundary": np.zeros((4, 0)),
        "driver_error": 0.0,
        "drivers": 0,
    }
    return CaseTerms(**(plain | changes))


def test_influence_by_hand():
    # C = (0.2 + 3 * 0.8) / 4 = 0.65: 50 * 1 * (0.2 - 0.65) / 4 = -5.625, 50 * 3 * (0.8 - 0.65) / 4 = +5.625
    # D = (0.4 + 4 * 0.9) / 5 = 0.8: 50 * 1 * (0.4 - 0.8) / 5 = -4, 50 * 4 * (0.9 - 0.8) / 5 = +4
    assert influence(four_cases(), MethodSettings()) == pytest.approx([-5.625, 5.625, -4.0, 4.0])


def test_a_collision_in_the_safe_zone_leaves_no_d_to_move():
    moved = influence(four_cases(y=np.array([1.0, -1.0, 1.0, 1.0])), MethodSettings())
    assert moved == pytest.approx([-5.625, 5.625, 0.0, 0.0])


def test_collisions_of_no_weight_at_all_count_alike():
    # r = 0 everywhere: C = (0.2 + 0.8) / 2, each moves 50 * 0.3 / 2
    moved = influence(four_cases(weight=np.array([0.0, 0.0, math.nan, math.nan])), MethodSettings())
    assert moved[:2] == pytest.approx([-7.5, 7.5])


def test_the_drivers_error_is_a_plain_loops(evaluation, partitions):
    zones, settings = partitions[CUT_OUT], evaluation.settings
    score = next(item for item in evaluation.scores if (item.ads, item.scenario) == (builders.CALM, CUT_OUT))
    safe = [
        case
        for case in evaluation.cases
        if (case.ads, case.scenario, case.zone) == (builders.CALM, CUT_OUT, "safe") and case.index is not None
    ][:4]
    fine = settings.method.anthropomorphic
    coarse = replace(fine, slice_spacing=fine.band_slice_spacing)
    assert fine.band_slice_spacing > fine.slice_spacing
    with open_store(evaluation.folder / FACTS) as store:
        error, drivers = driver_error(score, safe, store, settings, zones)
        without = []
        for left_out in range(builders.DRIVERS):
            over = under = 0.0
            for case in safe:
                number = case.case.split("-")[1]
                others = [
                    store.trajectory(f"{CUT_OUT}-{number}-~driver_{index:02d}")
                    for index in range(builders.DRIVERS)
                    if index != left_out
                ]
                own = store.trajectory(case.case)
                found = anthropomorphic_index(own, others, zones.logical.road, coarse)
                over += case.exposure * found.value
                under += case.exposure
            without.append(over / under)
    mean = sum(without) / 3
    assert drivers == builders.DRIVERS == 3
    assert error == pytest.approx(math.sqrt(2 / 3 * sum((value - mean) ** 2 for value in without)), rel=1e-9)
    assert error > 0.0


def test_fewer_than_two_evaluated_cases_have_no_interval_and_a_reason(evaluation, partitions):
    first = next(case for case in evaluation.cases if case.evaluated and case.ads == builders.CALM)
    score = next(s for s in evaluation.scores if (s.ads, s.scenario) == (first.ads, first.scenario))
    found = assess(replace(evaluation, cases=(first,), scores=(score,)), {first.scenario: partitions[first.scenario]})
    alone = found.of(first.ads, first.scenario)
    assert (alone.intervals, alone.risk, alone.further) == (None, None, None)
    assert alone.reason == "fewer than two evaluated cases with exposure"


def test_every_score_lies_in_its_interval_and_risk_is_what_the_rows_say(evaluation, partitions):
    calm = replace(evaluation, scores=tuple(score for score in evaluation.scores if score.ads == builders.CALM))
    found = assess(calm, partitions)
    for score in calm.scores:
        item = found.of(score.ads, score.scenario)
        assert item.intervals.c.value == pytest.approx(score.c)
        assert item.intervals.s.low <= item.intervals.s.value <= item.intervals.s.high
        rows = [
            case for case in calm.cases if (case.ads, case.scenario) == (score.ads, score.scenario) and case.evaluated
        ]
        p = sum(case.exposure for case in rows if case.collided) / sum(case.exposure for case in rows)
        assert item.risk.collision_probability.value == pytest.approx(p)
    assert set(found.coverage) == set(partitions)
