"""A dry run of many ADSs or points: it looks at a few of them, and counts them all."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drivers.test_reference import write_people
from evaluations import small

from sumo_eval.record import estimate as costs
from sumo_eval.record import facts
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import DriverSettings, RunSettings, SamplingSettings, ScenarioSettings

HERE = Path()
HALTON = ScenarioSettings("cut_in", sampling=SamplingSettings("halton", count=2000))
FEW = ScenarioSettings("front_vehicle_low_speed", sampling=SamplingSettings("halton", count=9))


def estimated(ads, source=HERE, scenarios=(HALTON,), **run):
    settings = small(ads, run=RunSettings(**run))
    return costs.estimate(Resolved.of(replace(settings, scenario=scenarios), source), None)


def test_an_estimate_looks_at_some_points_and_counts_all(monkeypatch):
    placed = []
    monkeypatch.setattr(facts, "check_points", lambda logical, points: placed.append(len(points)))
    run = Resolved.of(replace(small(), scenario=(HALTON,)), HERE)
    whole, some = facts.space_of(run, 0), facts.space_of(run, 0, looked_at=200)
    assert placed == [len(whole.points), -(-len(whole.points) // -(-len(whole.points) // 200))]
    np.testing.assert_array_equal(some.points, whole.points)
    assert len(some.hazardous) == len(whole.hazardous)
    assert some.hazardous.mean() == pytest.approx(whole.hazardous.mean(), abs=0.1)


@pytest.mark.parametrize("count, scenarios", [(300, (HALTON,)), (12, (HALTON, FEW))])
def test_an_estimate_of_many_ads_times_a_few_of_them(count, scenarios, monkeypatch):
    timed = []

    def seconds_a_drive(kinds, setup, loading):
        timed.extend(cases for sort, cases in kinds if sort == "ads")
        return {"ads": 2.0, "references": 0.0, "humans": 0.0}, 1, False

    monkeypatch.setattr(costs, "_seconds_a_drive", seconds_a_drive)
    found = estimated({f"a{number}": "idm" for number in range(count)}, scenarios=scenarios)
    points = found.drives["references"] // 3
    assert found.drives["ads"] == count * points
    assert found.seconds == pytest.approx(2.0 * found.drives["ads"] / found.workers)
    assert len(timed) == 12
    assert {len({case.driver for case in cases}) for cases in timed} == {1}
    assert len({cases[0].driver for cases in timed}) == 12


@pytest.mark.parametrize("ads, scenarios", [(12, 11), (5, 7), (1, 30), (3, 2)])
def test_ads_and_scenarios_are_timed_equally_often(ads, scenarios):
    settings = replace(small({f"a{number}": "idm" for number in range(ads)}), scenario=(HALTON,))
    plan, (space,) = facts.planned(Resolved.of(settings, HERE), looked_at=10)
    spaces = [replace(space, numbers=[number]) for number in space.numbers[:scenarios]]
    pairs = [
        (cases[0].driver, cases[0].concrete.label)
        for sort, cases in costs._kinds(plan, spaces)
        if sort == "ads"
    ]
    assert len(set(pairs)) == len(pairs) == min(ads * scenarios, 12)
    for names, number in zip(zip(*pairs, strict=True), (ads, scenarios), strict=True):
        often = Counter(names)
        assert len(often) == min(number, 12)
        assert max(often.values()) - min(often.values()) <= 1


def test_estimate_of_a_run_to_resume_counts_all_its_rounds(tmp_path):
    sampling = SamplingSettings("adaptive", count=40)
    settings = small(scenarios=("front_vehicle_cut_out",), sampling=sampling)
    found = costs.estimate(Resolved.of(settings, HERE), tmp_path)
    assert found.drives["ads"] == 40
    assert found.recorded == 0


def test_kinds_without_a_time_take_that_of_measured_ones(monkeypatch):
    monkeypatch.setattr(costs, "_ALL_TIME", -1.0)
    found = estimated(["idm"])
    assert found.timed == 1
    assert found.untimed == ("references", "human drivers")
    assert found.seconds * found.workers / found.drives.total() > 1e-4
    assert (
        "Drives of the references and human drivers were not timed: they count as the rest."
        in str(found)
    )


def test_slow_drives_of_a_baseline_end_when_the_time_is_up(monkeypatch):
    """Each is a batch of its own, so the rest need not be driven."""
    clock = iter(range(10_000))
    monkeypatch.setattr(costs, "perf_counter", lambda: 0.15 * next(clock))
    found = estimated(["idm"], cases_per_pack=1)
    assert 2 < found.timed < 15


@pytest.mark.parametrize("too_thin", ["fill", "leave_out"])
def test_drivers_that_fill_up_are_not_counted_and_reported(tmp_path, too_thin):
    write_people(tmp_path, [29.0, 30.0], lead_step=0.8)
    drivers = DriverSettings(source="recorded", recordings=("people.csv",), too_thin=too_thin)
    settings = replace(small(run=RunSettings()), drivers=drivers)
    found = costs.estimate(Resolved.of(settings, tmp_path), None)
    assert found.drives["humans"] == 0
    words = "Drives of synthetic drivers, where too few are recorded, are not counted."
    assert (words in str(found)) == (too_thin == "fill")


def test_drives_of_a_batch_count_although_the_time_is_up():
    settings = replace(small(run=RunSettings(workers=1)), scenario=(FEW,))
    plan, (space,) = facts.planned(Resolved.of(settings, HERE))
    cases = list(plan.ads(space))
    assert costs._timed_drives(cases, plan.setup, until=0.0).number == len(cases) > 1


SLOW = """
import time
from sumo_eval import Command
class Slow:
    def __init__(self, number=0):
        time.sleep(0.3)
    def act(self, seen):
        time.sleep(0.3)
        return Command(0.0)
"""


def test_estimate_of_slow_ads_loads_a_few_and_drives_a_few(tmp_path):
    (tmp_path / "slow.py").write_text(SLOW)
    ads = {f"a{number}": f"slow.py:Slow?options.number={number}" for number in range(1000)}
    found = estimated(ads, tmp_path)
    assert found.loaded == (12, 1000)
    assert "At most 12 of the 1000 ADSs were timed; a run loads them all." in str(found)
    assert found.timed == 1
    assert "A drive was broken off after 3 s: the run takes longer than estimated." in str(found)


LOADS_SLOWLY = """
import time
from sumo_eval import Command
time.sleep(3.2)
class Quick:
    def act(self, seen):
        return Command(0.0)
"""


def test_loading_an_ads_does_not_count_as_driving(tmp_path):
    (tmp_path / "quick.py").write_text(LOADS_SLOWLY)
    found = estimated(["quick.py:Quick"], tmp_path)
    assert not found.broken_off
    assert found.seconds * found.workers / found.drives.total() < 3.0
