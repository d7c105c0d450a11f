"""Bands that a run's folder keeps: taken over only while they are what computing them again would give."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import sumo_eval
from sumo_eval.batch import bands
from sumo_eval.batch.bands import KEPT, BandJob, compute_bands
from sumo_eval.batch.store import open_store
from sumo_eval.scenario.catalogue import load
from sumo_eval.settings import (
    AdsSettings,
    AnthropomorphicSettings,
    DriverSettings,
    EvaluationSettings,
    SamplingSettings,
    ScenarioSettings,
)

SETTINGS = AnthropomorphicSettings(slice_spacing=5.0)
Job = tuple[Path, BandJob]


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    folder = tmp_path_factory.mktemp("bands") / "run"
    one_point = SamplingSettings(steps={"ego_speed": 100.0, "lead_speed": 100.0})
    evaluation = EvaluationSettings(
        name="bands",
        scenario=(ScenarioSettings("front_vehicle_low_speed", one_point),),
        ads=(AdsSettings("idm", "idm"),),
        drivers=DriverSettings(count=4),
    )
    sumo_eval.evaluate(evaluation, folder)
    with open_store(folder / "facts.sqlite") as store:
        point = store.facts("human")[0].point
        drivers = tuple(fact.case for fact in store.facts("human") if fact.point == point)
    return folder / "facts.sqlite", BandJob(drivers, load("front_vehicle_low_speed").road)


def computed(job: Job, settings: AnthropomorphicSettings = SETTINGS) -> bands.HumanBand:
    (band,) = compute_bands(job[0], [job[1]], settings, 1, lambda done: None)
    return band


def test_a_kept_band_is_what_was_computed_to_the_last_digit(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    first = computed(job)

    def nothing_to_do(*_: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(bands, "human_band", nothing_to_do)
    assert computed(job) == first
    with pytest.raises(AssertionError, match="computed again"):
        computed(job, replace(SETTINGS, slice_spacing=10.0))


def test_other_settings_and_other_drives_are_not_taken_for_the_same(job: Job) -> None:
    facts, whole = job
    assert computed(job) != computed(job, replace(SETTINGS, centre_deviation_floor=0.5))
    fewer = computed((facts, BandJob(whole.drivers[1:], whole.road)))
    assert len(fewer.values) == len(whole.drivers) - 1


@pytest.mark.parametrize("damage", ["", "[1, 2]", '{"a": {"values": 3}}', '{"half": '])
def test_a_damaged_file_of_bands_costs_only_the_time_to_compute_them(job: Job, damage: str) -> None:
    first = computed(job)
    (job[0].parent / KEPT).write_text(damage, encoding="utf-8")
    assert computed(job) == first
    assert len(json.loads((job[0].parent / KEPT).read_text(encoding="utf-8"))) == 1
