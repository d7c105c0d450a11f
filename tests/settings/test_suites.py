"""A frozen suite brings its scenarios, seed and drivers, and nothing about it can be changed."""

import hashlib
import json
import tomllib
from dataclasses import fields

import pytest
from refusals import refusal
from tables import rows_of

from sumo_eval.settings import PopulationSettings
from sumo_eval.settings.config import SUITES, settings_from

FROZEN = {"2026.1": "f660e94226140e0c", "2026.2": "f0090414fbbef5c5"}


def asked(**more):
    ads = [{"name": "idm", "controller": "idm"}]
    return {"name": "mine", "scenario": [{"use": "suite:2026.1"}], "ads": ads, **more}


def test_a_suite_brings_its_scenarios_seed_and_drivers():
    settings = settings_from(asked(), "here")
    assert [one.use for one in settings.scenario] == [
        "front_vehicle_low_speed", "front_vehicle_cut_out", "front_vehicle_braking", "cut_in",
    ]  # fmt: skip
    assert (settings.seed, settings.drivers.count) == (20261, 6)
    assert settings_from(asked(scenario=({"use": "suite:2026.1"},)), "here") == settings
    assert settings.drivers.population == PopulationSettings(0.771, 1.0, 1.0, 1.0, "recorded")


def test_a_suite_says_everything_of_its_drivers_so_that_no_default_moves_its_scores():
    for path in SUITES.glob("*.toml"):
        said = tomllib.loads(path.read_text())["drivers"]["population"]
        assert set(said) == {item.name for item in fields(PopulationSettings)}, path.name


@pytest.mark.parametrize(
    "more, sentence",
    rows_of(
        """
{"seed": 2} | `seed` in here is fixed by the suite
{"drivers": {"count": 3}} | `drivers` in here is fixed
{"method": {"score": {"a": 60.0}}} | `method` in here is fixed
{"scenario": [{"use": "suite:2026.1"}, {"use": "cut_in"}]} | stands alone
{"scenario": [{"use": "suite:2026.1", "sampling": {"levels": 2}}]} | stands alone
{"scenario": [{"use": "suite:2025.1"}]} | Unknown suite `2025.1`
""",
        json.loads,
    ),
)
def test_nothing_about_a_suite_can_be_changed(more, sentence):
    with refusal(sentence):
        settings_from(asked(**more), "here")


def test_suites_are_frozen():
    found = {
        path.stem: hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        for path in SUITES.glob("*.toml")
    }
    assert found == FROZEN
