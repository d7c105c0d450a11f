"""Reading evaluation.toml: what is right comes through unchanged, what is wrong is named."""

import tomllib
from dataclasses import fields

import numpy as np
import pytest
from refusals import refusal, refused
from tables import rows_of, values_of

from sumo_eval.settings import PlantSettings, RunSettings
from sumo_eval.settings.config import (
    PAPER_EVALUATION,
    read_evaluation,
    settings_from,
    to_toml,
    with_changes,
)

SMALLEST = """
name = "nightly"
seed = 1
[[scenario]]
use = "front_vehicle_cut_out"
[scenario.sampling]
method = "grid"
levels = 4
[[ads]]
name = "mine"
controller = "my_ads.py:MyAds"
[drivers]
count = 10
[run]
workers = 2
case_timeout = 20.0
step_timeout = 1.0
"""


def read(tmp_path, text):
    path = tmp_path / "evaluation.toml"
    path.write_text(text)
    return read_evaluation(path)


def message(tmp_path, text):
    with refusal() as refused:
        read(tmp_path, text)
    return str(refused.value)


def test_the_smallest_evaluation_file_of_the_contract_is_read(tmp_path):
    settings = read(tmp_path, SMALLEST)
    assert settings.name == "nightly"
    assert settings.seed == 1
    assert settings.run.case_timeout == 20.0
    assert settings.scenario[0].sampling.levels == 4
    assert settings.ads[0].controller == "my_ads.py:MyAds"


def test_settings_survive_a_round_trip_through_toml():
    settings = read_evaluation(PAPER_EVALUATION)
    assert settings_from(tomllib.loads(to_toml(settings)), "round trip") == settings


def test_numbers_of_numpy_are_numbers():
    plain = tomllib.loads(SMALLEST)
    content = plain | {"seed": np.int64(1), "run": {**plain["run"], "workers": np.int32(2),
                       "case_timeout": np.float32(20.0)}}  # fmt: skip
    content["method"] = {"score": {"a": np.array(60)}}
    plain["method"] = {"score": {"a": 60}}
    assert settings_from(content, "it") == settings_from(plain, "it")


@pytest.mark.parametrize(
    "before, after, sentence",
    [
        *rows_of(r"""
workers = 2 | workers = 0 | `run.workers`
workers = 2 | workers = true | `run.workers`
case_timeout = 20.0 | case_timeout = nan | `run.case_timeout`
case_timeout = 20.0 | case_timeout = -1.0 | `run.case_timeout`
case_timeout = 20.0 | case_timeout = "20" | `run.case_timeout`
method = "grid" | method = 3 | `scenario[0].sampling.method`
count = 10 | count = 1 | `drivers.count`
name = "mine" | name = "~ideal" | must not begin with `~`
name = "mine" | name = "" | `ads[0].name` in
[drivers] | [[ads]]\nname = "mine"\ncontroller = "idm"\n[drivers]
| must differ from each other, got 'mine' twice
[run] | [simulation]\nstep = 0.0333\n[run] | `step` of the simulation must be a whole number of
"""),
        ('name = "nightly"', "", "`name` in"),
        ('name = "nightly"', "name = ", "is not valid TOML"),
    ],
)
def test_a_wrong_value_is_refused_with_its_path(tmp_path, before, after, sentence):
    assert sentence in message(tmp_path, SMALLEST.replace(before, after))


def test_a_missing_file_and_a_binary_one_are_refused(tmp_path):
    with refusal("There is no evaluation file"):
        read_evaluation(tmp_path / "none.toml")
    (tmp_path / "evaluation.toml").write_text(SMALLEST)
    with refusal(r"Did you mean `.*evaluation\.toml`"):
        read_evaluation(tmp_path / "evaluatoin.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    with refusal("cannot be read"):
        read_evaluation(tmp_path / "binary.toml")


def test_a_change_reaches_the_setting_it_names_and_no_other():
    settings = read_evaluation(PAPER_EVALUATION)
    changed = with_changes(settings, ["method.score.a=60", "method.anthropomorphic.field.k2=0.05"])
    assert changed.method.score.a == 60.0
    assert changed.method.score.b == 40.0
    assert changed.method.anthropomorphic.field.k2 == 0.05
    assert (
        with_changes(changed, ["method.score.a=50", "method.anthropomorphic.field.k2=0.005"])
        == settings
    )


def test_a_change_reaches_a_table_that_is_not_set():
    changes = ["drivers.tolerance.gap=3", "simulation.plant.file=car.fmu"]
    changed = with_changes(read_evaluation(PAPER_EVALUATION), changes)
    assert changed.drivers.tolerance == {"gap": 3.0}
    assert changed.simulation.plant == PlantSettings(file="car.fmu")


@pytest.mark.parametrize(
    "change, sentence",
    values_of("""
    "method.scor.a=60", "Did you mean `score`?"
    "method.score.aa=60", "Unknown key `method.score.aa`"
    "method.score.a=600", "`method.score.a`"
    "method.score.a", "KEY=VALUE"
    "method.score.a.b=3", "Unknown setting"
    "=5", "Unknown key `` in --set. Known: name"
    """),
)
def test_a_wrong_change_is_refused(change, sentence):
    with refusal(sentence.replace(".", r"\.").replace("?", r"\?")):
        with_changes(read_evaluation(PAPER_EVALUATION), [change])


def test_a_change_has_one_value():
    with refused(r"must be a number, got '60\nb = 5'"):
        with_changes(read_evaluation(PAPER_EVALUATION), ["method.score.a=60\nb = 5"])


def test_a_key_is_changed_once():
    with refused("--set must give a key one value, got `method.score.a` twice"):
        with_changes(
            read_evaluation(PAPER_EVALUATION), ["method.score.a=60", "method.score.a = 50"]
        )


def test_a_scenario_file_is_named_as_one(tmp_path):
    text = message(tmp_path, 'name = "lorry"\n[[parameter]]\nname = "gap"\n')
    assert text.endswith(
        'is a scenario file: name it in an evaluation, `use = "evaluation.toml"` in [[scenario]].'
    )


def test_a_mistake_is_reported_with_its_line(tmp_path):
    text = (
        'name = "n"\nsead = 1\n[[scenario]]\nuse = "cut_in"\n[scenario.sampling]\nlevels = '
        '"three"\n'
    )
    text += (
        '[[ads]]\nname = "a"\ncontroller = "idm"\n[[ads]]\nname = "b"\ncontroller = '
        "3\n[run]\nmethod.a = 3\n"
    )
    assert message(tmp_path, text).splitlines() == [
        f"`scenario[0].sampling.levels` in {tmp_path / 'evaluation.toml'} (line 6) must be a "
        "whole number or a table, "
        "got 'three'.",
        f"`ads[1].controller` in {tmp_path / 'evaluation.toml'} (line 12) must be a text, got 3.",
        f"Unknown key `run.method` in {tmp_path / 'evaluation.toml'} (line 14). Known: "
        + ", ".join(field.name for field in fields(RunSettings))
        + ".",
        f"Unknown key `sead` in {tmp_path / 'evaluation.toml'} (line 2). Did you mean `seed`?",
    ]


def test_a_folder_in_place_of_the_file_gets_advice(tmp_path):
    with refusal("it is a folder") as caught:
        read_evaluation(tmp_path)
    assert "Did you mean" not in str(caught.value)
    (tmp_path / "mine.toml").write_text(SMALLEST)
    with refusal(r"mine\.toml"):
        read_evaluation(tmp_path)
    (tmp_path / "manifest.json").write_text("{}")
    with refusal("It holds a run: `sumo-eval score"):
        read_evaluation(tmp_path)


def test_a_number_in_place_of_tables_is_refused_in_our_words():
    with refusal("`scenario` in it must be a list, got 5"):
        settings_from({"name": "x", "scenario": 5}, "it")


def test_a_whole_number_beyond_all_floats_is_refused():
    ads = {"name": "a", "controller": "idm", "period": 10**400}
    with refusal(r"`ads\[0\]\.period` in it must be a finite number, got 1000"):
        settings_from({"name": "x", "scenario": [{"use": "cut_in"}], "ads": [ads]}, "it")


def _in_itself():
    table = {}
    table["run"] = table
    return table


@pytest.mark.parametrize(
    "content, why",
    [
        ({"name": "\ud800"}, "surrogates not allowed"),
        ({("a", "b"): 1}, "keys must be str"),
        (_in_itself(), "Circular reference"),
    ],
    ids=["half a pair", "a key of two texts", "in itself"],
)
def test_what_json_cannot_hold_is_refused(content, why):
    with refusal(f"Keys and values in it must be texts, numbers, lists and tables: .*{why}"):
        settings_from(content, "it")
