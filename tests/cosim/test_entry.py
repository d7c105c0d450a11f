"""What stands beside a controller: how often it is asked, what it is made with, what it loads
once."""

import math
import random
import shlex
from pathlib import Path

import pytest
from refusals import refusal, refused
from road_scenes import HALF_SECOND, case, clips_of, half_second, lead, under
from tables import rows_of

from sumo_eval import Command
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.doors.controller import find_controller
from sumo_eval.cosim.doors.entry import (
    Entry,
    made_absolute,
    read_query,
    split_entry,
    take_load_report,
)
from sumo_eval.record.recording import planner
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import (
    AdsSettings,
    EvaluationSettings,
    FmuSettings,
    ScenarioSettings,
)
from sumo_eval.settings.config import read_evaluation, settings_from, to_plain

MODULE = """
import sumo_eval

asked, made, loaded = [], [], []


class Counting:
    def __init__(self, gain=1.0, path=""):
        made.append((gain, path))
        self.gain = gain

    def act(self, seen):
        asked.append(round(seen.time, 2))
        return -self.gain * (1.0 + seen.time)


class Planning:
    def act(self, seen):
        asked.append(round(seen.time, 2))
        return sumo_eval.Plan([seen.time, seen.time + 9.0], [seen.ego.x, seen.ego.x + 90.0], [0.0, 0.0])


class Network:
    @classmethod
    def load_once(cls, size=1):
        loaded.append(size)

    def __init__(self, size=1):
        assert loaded

    def act(self, seen):
        return 0.0


def function(seen):
    return 0.0


function.options = {"gain": 1}  # its own, which no entry replaces
"""


@pytest.fixture
def folder(tmp_path, own_path):
    (tmp_path / "mine.py").write_text(MODULE)
    return tmp_path


def test_an_entry_in_one_text_and_back():
    entry = AdsSettings(
        "a",
        "mine.py:Mine",
        period=0.2,
        batch=False,
        options={"gain": 2.5, "path": "w/a b?&:x.onnx", "deep": [1, 2]},
    )
    bare, found = split_entry(entry.locator)
    assert bare == "mine.py:Mine"
    assert found.period == 0.2
    assert dict(found.options) == entry.options
    assert not found.batch
    assert split_entry("exec:./a --b?c")[0] == "exec:./a --b?c"
    fmu = AdsSettings("a", "fmu:a.fmu", FmuSettings(inputs={"v": "ego_speed"}), period=0.1).locator
    assert split_entry(fmu)[0] == "fmu:a.fmu?inputs.v=ego_speed"
    absolute = made_absolute(entry.locator, Path("/x"))
    assert absolute.startswith("/x/mine.py:Mine?")
    assert split_entry(absolute)[1] == found


@pytest.mark.parametrize("seed", range(200))
def test_any_locator_stays_whole_with_its_entry(seed, tmp_path):
    """A fuzz of locators: schemes, spaces, quotes, colons, letters beyond ASCII, question marks,
    with an entry."""
    draw = random.Random(seed)
    name = (
        "".join(draw.choice("ab é:?='\" ß中") for _ in range(draw.randint(1, 8))).strip(" ?") or "a"
    )
    bare = draw.choice(
        [
            f"{name}.py:Mine",
            f"exec:python {shlex.quote(name)}.py",
            f"traci:{shlex.quote(name)} --a b",
        ]
    )
    entry = AdsSettings(
        "a",
        bare,
        period=draw.choice([None, 0.2]),
        options={"q": "".join(draw.choices('?&=:é "', k=4))},
    )
    assert split_entry(entry.locator) == (bare, Entry(entry.period or 0.0, entry.options))
    assert split_entry(made_absolute(entry.locator, tmp_path / "é: b"))[1].options == entry.options


def test_files_of_a_locator_are_found_from_another_folder(folder):
    assert made_absolute("mine:Counting", folder) == f"{folder}/mine.py:Counting"
    assert made_absolute("json:loads", folder) == "json:loads"
    network = made_absolute("onnx:a.onnx?features=/x/f.toml", folder)
    assert network == f"onnx:{folder}/a.onnx?features=/x/f.toml"
    mapping = "inputs.v=ego_speed&parameters.source=http://a/b"
    assert made_absolute(f"fmu:a.fmu?{mapping}", folder) == f"fmu:{folder}/a.fmu?{mapping}"
    assert split_entry('mine.py:Mine?options.path="a?b:c"')[1].options == {"path": "a?b:c"}


def test_a_file_named_sumo_takes_no_model_of_sumo_over(folder):
    (folder / "sumo.py").write_text("class IDM: pass")
    for locator in ("sumo:IDM", "sumo:IDM?tau=2"):
        assert made_absolute(locator, folder) == locator


def test_a_table_of_features_may_lie_in_any_folder():
    absolute = made_absolute("onnx:a.onnx?features=f%26.toml&output=b", Path("/c++ & 100%25"))
    query = read_query(absolute.partition("?")[2], "ADS `a`", "name=value")
    assert query == {"features": "/c++ & 100%25/f&.toml", "output": "b"}


def test_an_option_nested_too_deep_for_json_is_a_text():
    text = 100_000 * "["
    assert split_entry(f"mine.py:Mine?options.a={text}")[1].options == {"a": text}


@pytest.mark.parametrize(
    "text, value",
    [("1e+3", 1000.0), ("+5", 5), ("[1e+3,2]", [1000.0, 2]), ("a+b", "a b"), ("1+e", "1 e")],
)
def test_a_plus_in_a_locator_is_that_of_a_number_else_a_space(text, value):
    assert split_entry(f"mine.py:Mine?options.a={text}")[1].options == {"a": value}


def test_an_ads_with_a_period_is_asked_that_often_and_its_answer_holds(folder):
    found = half_second("mine.py:Counting?period=0.2", folder=folder)
    # asked at 0, 0.2 and 0.4 s: -1, -1.2, -1.4; samples are every 0.1 s
    assert found.ego.acceleration.tolist() == pytest.approx([0.0, -1.0, -1.0, -1.2, -1.2, -1.4])
    together = list(simulate_many([case(lead(g)) for g in (100.0, 90.0)],
        "mine.py:Counting?period=0.2", HALF_SECOND,
                                  folder=folder))  # fmt: skip
    assert [one.ego.speed.tolist() for one in together] == [found.ego.speed.tolist()] * 2


def test_between_calls_a_plan_is_tracked_at_every_step(folder):
    found = half_second("mine.py:Planning?period=0.25", folder=folder)
    assert clips_of(found)["plan_error"].count == 10
    assert found.controller_latency[1] > 0.0


def test_traci_code_is_asked_so_often_too_and_told_its_period():
    """Its listeners hear every step, as in TraCI."""
    asked, told, heard = [], [], []

    class Mine:
        def reset(self, scenario, traci, ego):
            told.append(scenario.period)
            listener = traci.StepListener()
            listener.step = lambda _: heard.append(traci.simulation.getTime()) or True
            traci.addStepListener(listener)

        def step(self, traci, ego, time):
            asked.append(round(time, 2))
            return Command(-1.0)

    found = half_second(Mine, period=0.1)
    assert asked == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert told == [0.1]
    assert heard == pytest.approx([0.05 * step for step in range(1, 11)])
    assert (found.ego.acceleration[1:] == -1.0).all()


def test_a_late_answer_is_late_once_and_not_at_every_step_that_it_holds():
    import time as clock

    def slow(seen):
        clock.sleep(0.03)
        return -1.0

    budget = under(step_budget=0.02)
    assert clips_of(simulate(case(), slow, budget, period=0.25))["late_command"].count == 2


@pytest.mark.parametrize(
    "locator, sentence",
    [
        *rows_of("""
mine.py:Counting?period=0.07
| `period` of ADS `mine.py:Counting?period=0.07` must be a multiple of
mine.py:Counting?period=-1 | must be a number greater than 0 s, got -1
mine.py:Counting?period=soon | must be a number greater than 0 s, got 'soon'
mine.py:Counting?options.gian=2
| Unknown option `gian` of ADS `mine.py:Counting`. Did you mean `gain`?
mine.py:function?options.gain=2 | takes no `options`
mine.py:Counting?gain=2
| The options of ADS `mine.py:Counting?gain=2` must be of the form period=SECONDS&options.NAME=VALUE
mine.py:Counting?perod=0.2&options.gain=2
| must be of the form period=SECONDS&options.NAME=VALUE, got 'perod=0.2'
idm?headway=1 | of ADS `idm?headway=1` must be of the form period=SECONDS&options.NAME=VALUE, got
idm?period=0.2 | ADS `idm` drives at every step; it takes no `period`
sumo:IDM?tau=2&period=0.2 | drives at every step; it takes no `period`
sumo:IDM?options.tau=2 | takes no `options`
mine.py:Counting?period=1&period=2
| The options of ADS `mine.py:Counting?period=1&period=2` must be of the form
mine.py:Counting?options.gain=1&options.%67ain=2
| must be of the form period=SECONDS&options.NAME=VALUE, each name once, got
sumo:IDM?tau=1&tau=2 | must be of the form name=value&name=value, each name once, got 'tau=1&tau=2'
"""),
        ("mine.py:Counting?period=" + 400 * "9", "must be a number greater than 0 s, got 999"),
    ],
)
def test_an_entry_that_cannot_be_is_refused(folder, locator, sentence):
    with refused(sentence):
        half_second(locator, folder=folder)


@pytest.mark.parametrize("period", [math.nan, math.inf, -0.05, 0.01])
def test_a_period_that_is_no_multiple_of_the_step_is_refused(period):
    with refusal("must be a multiple of"):
        half_second(lambda seen: 0.0, period=period)


def test_options_are_handed_to_the_constructor(folder):
    found = half_second("mine.py:Counting?options.gain=2.5&options.path=a.onnx", folder=folder)
    assert found.ego.acceleration[1] == pytest.approx(-2.625)  # -2.5 (1 + 0.05 s)


def test_a_program_receives_its_options(folder):
    text = "exec:sh -c 'read x; echo \"$x\" >&2; echo no'?options.gain=2"
    assert '"options":{"gain":2}' in half_second(text).log


def test_what_a_class_loads_is_loaded_once_in_a_process(folder):
    take_load_report()
    locator = "mine.py:Network?options.size=7"
    for _ in simulate_many(
        [case(lead(100.0)), case(lead(90.0))], locator, HALF_SECOND, folder=folder
    ):
        pass
    half_second(locator, folder=folder)
    assert take_load_report().startswith("Loading Network took 0.0")
    assert take_load_report() == ""
    half_second("mine.py:Network?options.size=8", folder=folder)
    assert find_controller(locator, folder).load_once.__globals__["loaded"] == [7, 8]


def test_a_retrained_network_is_another_ads_and_a_file_that_is_not_there_is_refused(folder):
    ads = AdsSettings("a", "mine.py:Counting", files=("weights.bin",))
    settings = EvaluationSettings("x", (ScenarioSettings("cut_in"),), (ads,))
    with refusal(r"`files` of ADS `a` must be files that are there, got 'weights\.bin'"):
        planner(Resolved(settings, folder, {}))
    found = []
    for content in (b"1", b"2", b"1"):
        (folder / "weights.bin").write_bytes(content)
        found.append(planner(Resolved(settings, folder, {})).identities[ads.locator])
    assert found[0] == found[2] != found[1]


def test_the_entry_is_read_from_the_file_and_a_misspelt_key_is_named(folder):
    text = (
        'name = "x"\n[[scenario]]\nuse = "cut_in"\n[[ads]]\nname = "a"\ncontroller = '
        '"mine.py:Counting"\n'
    )
    (folder / "e.toml").write_text(
        text + 'period = 0.2\nfiles = ["w.bin"]\n[ads.options]\ngain = 2.0\n'
    )
    (ads,) = read_evaluation(folder / "e.toml").ads
    assert ads.period == 0.2
    assert ads.files == ("w.bin",)
    assert ads.options == {"gain": 2.0}
    assert settings_from(to_plain(read_evaluation(folder / "e.toml")), "again").ads == (ads,)
    (folder / "e.toml").write_text(text + "perod = 0.2\n")
    with refusal("Did you mean `period`"):
        read_evaluation(folder / "e.toml")
