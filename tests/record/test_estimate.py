"""A dry run of many ADSs or points: it looks at a few of them, and counts them all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sumo_eval.record import facts
from sumo_eval.settings import AdsSettings, EvaluationSettings, SamplingSettings, ScenarioSettings

HALTON = ScenarioSettings("cut_in", sampling=SamplingSettings("halton", count=2000))


def test_an_estimate_looks_at_some_points_and_counts_all(monkeypatch: pytest.MonkeyPatch) -> None:
    placed = []
    monkeypatch.setattr(facts, "check_points", lambda logical, points: placed.append(len(points)))
    settings = EvaluationSettings("x", (HALTON,), (AdsSettings("idm", "idm"),))
    whole = facts.space_of(HALTON, settings, Path())
    some = facts.space_of(HALTON, settings, Path(), looked_at=200)
    assert placed == [len(whole.points), -(-len(whole.points) // -(-len(whole.points) // 200))]
    np.testing.assert_array_equal(some.points, whole.points)
    assert len(some.hazardous) == len(whole.hazardous)
    assert some.hazardous.mean() == pytest.approx(whole.hazardous.mean(), abs=0.1)


def test_an_estimate_of_many_ads_times_a_few_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    timed = {}

    def seconds_a_drive(kinds, setup):
        timed.update(kinds)
        return {"ads": 2.0, "references": 0.0, "humans": 0.0}, 1

    monkeypatch.setattr(facts, "_seconds_a_drive", seconds_a_drive)
    ads = tuple(AdsSettings(f"a{number}", "idm") for number in range(300))
    found = facts.estimate(EvaluationSettings("x", (HALTON,), ads), Path(), None, facts.WHOLE)
    points = found.references // 3
    assert found.ads == 300 * points
    assert found.seconds == pytest.approx(2.0 * found.ads / found.workers)
    assert len(timed["ads"]) == 12
    assert {len({case.driver for case in cases}) for cases in timed["ads"]} == {1}
    assert len({cases[0].driver for cases in timed["ads"]}) == 12


def test_kinds_that_time_ran_out_for_take_what_the_others_took(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(facts, "_TIMED_FOR", -1.0)
    monkeypatch.setattr(facts, "run_cases", lambda cases, setup: iter(()))
    monkeypatch.setattr(facts, "run_packs", lambda cases, setup: (list(cases) for _ in range(1)))
    a_drive, timed = facts._seconds_a_drive({"ads": [[1, 2, 3]], "references": [[4], [5]], "humans": []}, None)
    assert timed == 3
    assert a_drive["ads"] == a_drive["references"] == a_drive["humans"] > 0.0
