"""Confidence put together from rows and facts: influence, the drivers' error, and where there is no
interval."""

import tomllib
from dataclasses import replace

import builders
import numpy as np
import pytest
from builders import CALM, DRIVERS, SCENARIOS
from scoring.confidence.scored_by_hand import with_intervals_of_calm

from sumo_eval.case_table import CaseTable
from sumo_eval.drivers.synthetic.population import draw_driver
from sumo_eval.method.anthropomorphic import anthropomorphic_index
from sumo_eval.method.zone_partition import partition
from sumo_eval.record.human_reference import PointJob, compute_points
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.record.store import open_store
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.case_terms import CaseTerms
from sumo_eval.scoring.confidence.assessment import assess, influence
from sumo_eval.scoring.confidence.drivers import driver_deviations, exchanges, stratified_deviations
from sumo_eval.settings import MethodSettings, RunSettings, ZoneSettings

QUICK = ZoneSettings(restarts=1, grid_points=5_000)
CUT_OUT = "front_vehicle_cut_out"


@pytest.fixture(scope="module")
def partitions():
    return {name: partition(catalogue.load(name), QUICK) for name in SCENARIOS}


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory, partitions):
    found = builders.evaluation(tmp_path_factory.mktemp("assessed") / "run", partitions)
    return replace(found, settings=replace(found.settings, run=RunSettings(workers=1)))


def four_cases(**changes):
    plain = tomllib.loads("""
exposure = [2.0, 2.0, 1.0, 4.0]
weight = [1.0, 3.0, 1.0, 1.0]
severity = [10.0, 10.0, 0.0, 0.0]
ideal = [2.0, 8.0, 0.0, 0.0]
unreacting = [10.0, 10.0, 10.0, 10.0]
ratio = [0.2, 0.8, nan, nan]
collided = [true, true, false, false]
evaluated = [true, true, true, true]
index = [nan, nan, 0.4, 0.9]
likeness = [nan, nan, 0.4, 0.9]
voids = [false, false, false, false]
incident = [true, true, false, false]
counted = [true, true, true, true]
task = [nan, nan, 1.0, 1.0]
""")
    arrays = {name: np.array(of) for name, of in (plain | changes).items()}
    return CaseTerms(MethodSettings(), **arrays)


def test_influence_by_hand():
    # C = (0.2 + 3 * 0.8) / 4 = 0.65: 50 * 1 * (0.2 - 0.65) / 4 = -5.625, 50 * 3 * (0.8 - 0.65) / 4
    # = +5.625
    # D = (0.4 + 4 * 0.9) / 5 = 0.8: 50 * 1 * (0.4 - 0.8) / 5 = -4, 50 * 4 * (0.9 - 0.8) / 5 = +4
    assert influence(four_cases()) == pytest.approx([-5.625, 5.625, -4.0, 4.0])


def test_a_collision_in_the_safe_zone_leaves_no_d_to_move():
    moved = influence(four_cases(voids=np.array([True, False, False, False])))
    assert moved == pytest.approx([-5.625, 5.625, 0.0, 0.0])


def test_collisions_of_no_weight_at_all_count_alike():
    # r = 0 everywhere: C = (0.2 + 0.8) / 2, each moves 50 * 0.3 / 2
    moved = influence(four_cases(weight=np.array([0.0, 0.0, 1.0, 1.0])))
    assert moved[:2] == pytest.approx([-7.5, 7.5])


def test_the_drivers_errors_are_those_of_a_plain_loop(evaluation, partitions):
    zones, settings = partitions[CUT_OUT], evaluation.settings
    safe = [
        replace(case, plausibility=0.5, human_likeness=0.3)
        for case in evaluation.cases
        if (case.ads, case.scenario, case.zone) == (CALM, CUT_OUT, "safe")
        and case.index is not None
    ][:2]
    fine = settings.method.anthropomorphic
    coarse = replace(fine, slice_spacing=fine.band_slice_spacing)
    assert fine.band_slice_spacing > fine.slice_spacing
    names = [f"driver_{index:02d}" for index in range(DRIVERS)]
    with open_store(evaluation.folder) as store:
        drives = {
            case.case: tuple(f"{CUT_OUT}-{case.case.split('-')[1]}-~{name}" for name in names)
            for case in safe
        }
        swaps = exchanges(names, settings.drivers, settings.seed)
        assert swaps, "some of them overtake and some follow"
        jobs = [
            PointJob(drives[case.case], zones.logical.road, left_out=(case.case,), exchanges=swaps)
            for case in safe
        ]
        kept = KeptResults(evaluation.folder)
        found = compute_points(evaluation.folder, jobs, fine, map, lambda done: None, kept)
        kept.close()
        left_out = {case: (one, names) for case, one in found.left_out.items()}
        everybody = list(range(DRIVERS))
        without = [[place for place in everybody if place != absent] for absent in everybody]
        exchanged = [[*without[leaves], stays] for leaves, stays in swaps]
        values = []
        for present in (everybody, *without, *exchanged):
            over = under = 0.0
            for case in safe:
                others = [store.trajectory(drives[case.case][place]) for place in sorted(present)]
                own = store.trajectory(case.case)
                over += (
                    case.exposure
                    * anthropomorphic_index(own, others, zones.logical.road, coarse).value
                )
                under += case.exposure
            values.append(over / under)
        whole, fewer, swapped = (
            values[0],
            values[1 : 1 + DRIVERS],
            values[1 + DRIVERS :],
        )
    found = driver_deviations(
        CaseTable.of(safe),
        left_out,
        settings.drivers,
        settings.seed,
    )
    population = settings.drivers.population
    groups = [draw_driver(index, settings.seed, population).overtakes for index in range(DRIVERS)]
    change = float(np.mean(swapped)) - whole
    expected = stratified_deviations(np.array(fewer), groups, population.overtake_share, change)
    assert found.names[:-1] == tuple(names)
    assert found.index == pytest.approx(expected, rel=1e-9)
    assert np.any(found.index != 0.0)


def test_fewer_than_two_evaluated_cases_have_no_interval_and_a_reason(evaluation, partitions):
    first = next(case for case in evaluation.cases if case.evaluated and case.ads == CALM)
    score = next(s for s in evaluation.scores if (s.ads, s.scenario) == (first.ads, first.scenario))
    found = assess(
        replace(evaluation, cases=(first,), scores=(score,)),
        {first.scenario: partitions[first.scenario]},
    )
    (alone,) = found.assessments
    assert alone.intervals == {}
    assert alone.risk is None
    assert alone.further is None
    assert alone.reason == "fewer than two evaluated cases with exposure"


def test_every_score_lies_in_its_interval_and_risk_is_what_the_rows_say(evaluation, partitions):
    calm = with_intervals_of_calm(evaluation, partitions)
    found = assess(calm, partitions)
    for score, item in zip(calm.scores, found.assessments, strict=True):
        assert set(item.intervals) >= {"c", "s"}
        for name, interval in item.intervals.items():
            assert interval.value == getattr(score, name)
            assert interval.low <= interval.value <= interval.high
        assert item.sources["s"]["cases"] > 0.0
        rows = [
            case
            for case in calm.cases
            if (case.ads, case.scenario) == (score.ads, score.scenario) and case.evaluated
        ]
        p = sum(case.exposure for case in rows if case.collided) / sum(
            case.exposure for case in rows
        )
        assert item.risk.collision_probability.value == pytest.approx(p)
    assert set(found.coverage) == set(partitions)
