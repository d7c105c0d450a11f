"""Settings: every default is within its bounds, every bound refuses, every setting explains
itself."""

import dataclasses
import hashlib
import json
import tomllib
from dataclasses import fields
from functools import partial
from typing import Annotated, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from annotated_types import Ge
from refusals import refusal, refused
from tables import rows_of

import sumo_eval.settings as settings_module
from sumo_eval.errors import InputError
from sumo_eval.frozen import frozen
from sumo_eval.scoring.gate_settings import GateSettings, LimitSettings
from sumo_eval.settings import (
    About,
    AnthropomorphicSettings,
    Checked,
    DriverSettings,
    FieldSettings,
    PopulationSettings,
    RankingSettings,
    ReportSettings,
    SamplingSettings,
    ScoreSettings,
    SimulationSettings,
    VehicleSettings,
    ZoneSettings,
    about,
)
from sumo_eval.settings.checked import _rule, read_table, setting
from sumo_eval.settings.config import SUITES, settings_from

CLASSES = [
    c
    for c in vars(settings_module).values()
    if isinstance(c, type) and issubclass(c, Checked) and c is not Checked
]
each = pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)


@each
def test_settings_are_frozen_dataclasses_with_a_docstring(cls):
    assert cls.__dataclass_params__.frozen
    assert cls.__doc__
    assert not cls.__doc__.startswith(cls.__name__ + "(")  # the one that dataclass writes


@each
def test_every_number_explains_itself_and_its_unit(cls):
    hints = get_type_hints(cls, include_extras=True)
    for item in dataclasses.fields(cls):
        base = hints[item.name]
        base = (
            get_args(base)[0]
            if get_origin(base) is not None and hasattr(base, "__metadata__")
            else base
        )
        if base in (float, int, str):
            assert about(cls, item.name).text, f"{cls.__name__}.{item.name}"


def test_about_knows_unit_symbol_and_equation():
    assert about(ZoneSettings, "deceleration") == About(
        "ideal braking deceleration of the zones", "m/s2", "a", "5"
    )
    assert about(SimulationSettings, "vehicle") == About("")


@pytest.mark.parametrize(
    "cls, values, sentence",
    rows_of("""
SimulationSettings | {"step": 0.0} | `step` of `SimulationSettings` must be greater than 0, got 0.0
SimulationSettings | {"step": 0.2} | `step` of `SimulationSettings` must be at most 0.1, got 0.2
SimulationSettings | {"step": NaN} | `step` of `SimulationSettings` must be a number, got nan
SimulationSettings | {"step": "0.1"} | `step` of `SimulationSettings` must be a number, got '0.1'
SimulationSettings | {"step": null} | `step` of `SimulationSettings` must be a number, got None
SimulationSettings | {"time_limit": true}
| `time_limit` of `SimulationSettings` must be a number, got True
SimulationSettings | {"time_limit": -1}
| `time_limit` of `SimulationSettings` must be greater than 0, got -1
VehicleSettings | {"friction": 0} | `friction` of `VehicleSettings` must be greater than 0, got 0
VehicleSettings | {"max_deceleration": -9.0} | must be greater than 0, got -9.0
VehicleSettings | {"steering_ratio": 6.0} | must be less than 540 deg, 90 times `steering_ratio`, got
ConditionSettings | {"actuation_delay": 1e9} | must be at most 100, got 1000000000.0
VehicleSettings | {"width": 1e300} | `width` of `VehicleSettings` must be at most 100, got 1e+300
FieldSettings | {"k1": -0.1} | `k1` of `FieldSettings` must be at least 0, got -0.1
FieldSettings | {"k1": 1000000000000.0}
| `k1` of `FieldSettings` must be at most 20, got 1000000000000
FieldSettings | {"k2": 1000000000000.0}
| `k2` of `FieldSettings` must be at most 1, got 1000000000000
AnthropomorphicSettings | {"centre_deviation_floor": 1e-300} | must be at least 1e-06, got 1e-300
AnthropomorphicSettings | {"field_deviation_floor": 1e-300} | must be at least 1e-06, got 1e-300
ZoneSettings | {"deceleration": 1e-300} | must be at least 0.01, got 1e-300
ZoneSettings | {"critical_inverse_ttc": 1e-300} | must be at least 0.001, got 1e-300
FieldSettings | {"sample_interval": 1e-300} | must be at least 0.01, got 1e-300
AnthropomorphicSettings | {"slice_spacing": 1e-300} | must be at least 0.01, got 1e-300
FieldSettings | {"superposition": "sum"} | must be one of 'magnitude', 'vector', got 'sum'
AnthropomorphicSettings | {"points_per_side": 0}
| `AnthropomorphicSettings` must be at least 1, got 0
AnthropomorphicSettings | {"points_per_side": 2.5} | must be a whole number, got 2.5
ScoreSettings | {"a": 100.1} | `a` of `ScoreSettings` must be at most 100, got 100.1
DriverSettings | {"count": 1} | `count` of `DriverSettings` must be at least 2, got 1
SamplingSettings | {"count": "5"} | `count` of `SamplingSettings` must be a whole number, got '5'
SamplingSettings | {"aim": "risk"} | must be one of 's_plus', 'boundary', got 'risk'
DriverSettings | {"source": 3} | `source` of `DriverSettings` must be a text, got 3
AdsSettings | {"name": "", "controller": "idm"} | `name` of `AdsSettings` must be non-empty, got ''
RunSettings | {"workers": 0} | `workers` of `RunSettings` must be at least 1, got 0
ZoneSettings | {"target": "labels"}
| `target` of `ZoneSettings` must be one of 'squared_time', 'label'
""", partial(getattr, settings_module), json.loads),
)  # fmt: skip
def test_a_value_outside_its_bounds_is_refused(cls, values, sentence):
    with refused(sentence):
        cls(**values)


def test_keys_of_tables_and_large_bounds_are_checked_and_shown():
    with refused("`weights` of `RankingSettings` must be a table with a text as each key, got 1."):
        RankingSettings(weights={1: 2.0})
    with refused("`resamples` of `GateSettings` must be at most 1000000, got 2000000."):
        GateSettings(resamples=2_000_000)
    for key in ("worse_by", "worse_by_percent"):
        with refused(f"`{key}` of `LimitSettings` must be at least 0, got -1.0."):
            LimitSettings("S", **{key: -1.0})


@frozen
class Inner(Checked):
    a: int = setting(0, "")
    b: int = setting(0, "")

    def __post_init__(self):
        Checked.__post_init__(self)
        if self.a > self.b:
            raise InputError("`a` must be at most `b`.")


@frozen
class Outer(Checked):
    inner: Inner | Literal["none"] = setting("none", "")


@pytest.mark.parametrize(
    "inner, sentence",
    [
        ({"a": 1}, "`inner` in f.toml: `a` must be at most `b`."),
        ([{"a": 1}], "`inner` in f.toml must be 'none' or one table: write [inner], with one "
        "bracket, not [[inner]], got [{'a': 1}]."),
    ],
)  # fmt: skip
def test_mistakes_in_a_table_that_may_be_a_word(inner, sentence):
    mistakes = []
    read_table({"inner": inner}, Outer, (), mistakes)
    assert [it.sentence("in f.toml") for it in mistakes] == [sentence]


def test_a_bound_of_a_whole_union_is_a_programming_error():
    with pytest.raises(AssertionError, match="write a bound at each kind"):
        _rule(Annotated[int | dict[str, int], Ge(2)])


@pytest.mark.parametrize(
    "key, cls, values, place, demand",
    [
        ("sampling", SamplingSettings, {"levels": -3}, "levels", "at least 2 or a table, got -3"),
        ("sampling", SamplingSettings, {"levels": {"v": 1.5}}, "levels.v", "a whole number"),
        ("sampling", SamplingSettings, {"steps": {"v": -1.0}}, "steps.v", "greater than 0"),
        ("sampling", SamplingSettings, {"rounds": [[1], ["x"]]}, "rounds[1][0]", "a whole number"),
        ("drivers", DriverSettings, {"tolerance": {"v": 0.0}}, "tolerance.v", "greater than 0"),
        ("drivers", DriverSettings, {"recordings": "a.csv"}, "recordings", "a list, got 'a.csv'"),
        ("simulation", SimulationSettings, {"vehicle": 3}, "vehicle", "a table"),
        ("report", ReportSettings, {"axes": {"c": ["x"]}}, "axes.c", "a list of 2, got ['x']"),
        ("drivers", DriverSettings, {"too_thin": "fil"}, "too_thin", "one of 'fill', 'leave_out'"),
    ],
)
def test_python_refuses_what_a_file_refuses(key, cls, values, place, demand):
    content = {"name": "x", "scenario": [{"use": "cut_in"}], key: values}
    if key == "sampling":
        content["scenario"][0][key] = content.pop(key)
    with refused(f"`{place}` of `{cls.__name__}` must be {demand}"):
        cls(**values)
    with refused(f".{place}` in mine.toml must be {demand}"):
        settings_from(content, "mine.toml")


@each
def test_law_every_numeric_bound_refuses_what_lies_outside(cls):
    hints = get_type_hints(cls, include_extras=True)
    for item in dataclasses.fields(cls):
        for extra in getattr(hints[item.name], "__metadata__", ()):
            for attribute, outside in (
                ("gt", lambda b: b),
                ("ge", lambda b: b - 1),
                ("lt", lambda b: b),
                ("le", lambda b: b + 1),
            ):
                bound = getattr(extra, attribute, None)
                if bound is not None:
                    required = {
                        f.name: () if f.name == "scenario" else "x"
                        for f in dataclasses.fields(cls)
                        if _has_no_default(f) and f is not item
                    }
                    with refusal(f"`{item.name}` of `{cls.__name__}` must be"):
                        cls(**required, **{item.name: outside(bound)})


def _has_no_default(item):
    return item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING


@pytest.mark.parametrize("value", [1, 0.05, np.float64(0.05), np.float32(0.05), np.int64(1)])
def test_any_real_number_is_a_number(value):
    assert VehicleSettings(friction=value).friction == value


def test_derived_values():
    assert VehicleSettings().brake_jerk == pytest.approx(60.0)  # 9 m/s2 in 0.15 s
    assert VehicleSettings(max_deceleration=6.0, brake_build_up=0.5).brake_jerk == pytest.approx(
        12.0
    )
    assert ScoreSettings(a=30.0).b == 70.0


def test_the_papers_constants():
    zones = ZoneSettings()
    assert zones.deceleration == 5.0
    assert zones.critical_inverse_ttc == 0.7
    field = FieldSettings()
    assert field.k1 == 0.5
    assert field.k2 == 0.005
    assert field.sample_interval == 0.1
    assert field.superposition == "magnitude"
    index = AnthropomorphicSettings()
    assert index.slice_spacing == 0.5
    assert index.side_width == 1.5
    assert index.points_per_side == 3
    assert index.steering_threshold_deg == 10.0
    assert index.acceleration_threshold == 0.5
    assert index.neutral_time == 0.5
    assert index.centre_deviation_floor == 0.15
    assert index.field_deviation_floor == 0.01
    assert SimulationSettings().ideal_deceleration == 9.0
    assert SimulationSettings().ideal_build_up == 0.15


def test_names_given_in_python_are_cleaned_as_those_of_a_file_are_refused():
    ads = settings_module.AdsSettings("mine\x1b[2J\u202e\ud800", "idm")
    assert ads.name == r"mine\x1b[2J\u202e\ud800"
    assert dataclasses.replace(ads).name == ads.name, "cleaning what is clean changes nothing"
    scenario = settings_module.ScenarioSettings("cut_in", settings_module.SamplingSettings(count=1))
    evaluation = settings_module.EvaluationSettings("a\nb\x00", (scenario,), (ads,))
    assert evaluation.name == r"a b\x00"


# --- a frozen suite brings its scenarios, seed and drivers ----------------------------------------


FROZEN = {"2026.1": "f660e94226140e0c", "2026.2": "f0090414fbbef5c5"}


def asked(**more):
    ads = [{"name": "idm", "controller": "idm"}]
    return {"name": "mine", "scenario": [{"use": "suite:2026.1"}], "ads": ads, **more}


def test_a_suite_brings_its_scenarios_seed_and_drivers():
    settings = settings_from(asked(), "here")
    assert [one.use for one in settings.scenario] == [
        "front_vehicle_low_speed", "front_vehicle_cut_out", "front_vehicle_braking", "cut_in",
    ]  # fmt: skip
    assert settings.seed == 20261
    assert settings.drivers.count == 6
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
{"scenario": [5, {"use": "suite:2026.1"}]} | stands alone
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
