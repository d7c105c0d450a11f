"""`whatif`: the least change of each lever, against closed forms."""

import json
import math
import re
import tomllib
from dataclasses import replace
from shutil import copytree

import pytest
import tomli_w
from commands import cli_refuses
from commands import sumo_eval as run
from laid import replace_in
from refusals import refusal
from scipy.optimize import brentq

import sumo_eval
from sumo_eval.cosim import simulate
from sumo_eval.cosim.doors.observation import stream_of
from sumo_eval.record.store import open_store
from sumo_eval.report.explain import known_case
from sumo_eval.report.levers_section import effect_words
from sumo_eval.report.sent_drives import contact_of
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.scoring.contact_cause import cause_of_contact
from sumo_eval.settings import SimulationSettings
from sumo_eval.whatif.levers import levers_of, moved
from sumo_eval.whatif.search import WhatIf

USUAL = SimulationSettings()

LATE = '''
class Brakes:
    """Brakes fully from {begin} s on."""

    def act(self, observation):
        return -99.0 if observation.time > {begin} - 1e-6 else 0.0
'''
HOOK = """
def drives(traci, ego, time):
    traci.vehicle.setSpeed(ego, traci.vehicle.getSpeed(ego))
"""


@pytest.fixture(scope="module")
def night(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whatif")
    (folder / "late.py").write_text(LATE.format(begin=1.5))
    (folder / "too_late.py").write_text(LATE.format(begin=3.4))
    (folder / "hook.py").write_text(HOOK)
    evaluation = tomllib.loads(f"""
name = "night"
seed = 1
scenario = [{{ use = "front_vehicle_low_speed", sampling = {{ levels = 3 }} }}]
drivers = {{ count = 2 }}
run = {{ workers = 1 }}
ads = [
    {{ name = "late", controller = "{folder}/late.py:Brakes" }},
    {{ name = "too_late", controller = "{folder}/too_late.py:Brakes" }},
    {{ name = "hook", controller = "{folder}/hook.py:drives" }},
]
""")
    done = sumo_eval.evaluate(evaluation, folder / "run")
    fastest = max(done.cases_of("late", "front_vehicle_low_speed"),
        key=lambda case: case.values["ego_speed"] - case.values["lead_speed"])  # fmt: skip
    return done.folder, fastest.case


@pytest.fixture
def folder(night):
    return night[0]


@pytest.fixture
def hit(night):
    """The case of an ADS that brakes too late."""
    folder, case = night
    return known_case(folder, case.replace("late", "too_late"))


def needed(closing, strongest, ramp=0.15):
    """Gap that full braking with a linear ramp needs, m."""
    return (
        closing * ramp
        - strongest * ramp**2 / 6
        + (closing - strongest * ramp / 2) ** 2 / (2 * strongest)
    )


def test_brakes_and_delay_have_their_closed_forms_within_a_step(night):
    folder, case = night
    fact = known_case(folder, case)
    assert fact.collision is None
    closing = fact.values["ego_speed"] - fact.values["lead_speed"]
    left = 3.5 * fact.values["ego_speed"] - 1.5 * closing
    by_name = {it.lever.name: it for it in WhatIf(folder).answers(fact).answers}
    weakest = brentq(lambda strongest: needed(closing, strongest) - left, 1.0, 9.0)
    brakes = by_name["vehicle.max_deceleration"].flips[0]
    assert brakes.after <= weakest <= brakes.before
    assert brakes.before - brakes.after == pytest.approx(0.01)
    longest = (left - needed(closing, 9.0)) / closing
    delay = by_name["conditions.actuation_delay"].flips[0]
    assert delay.before == pytest.approx(math.floor(longest / 0.05 + 1e-6) * 0.05, abs=0.051)
    assert delay.after == pytest.approx(delay.before + 0.05)
    assert not by_name["conditions.perception_delay"].flips  # it acts by the clock alone
    shortest = 3.5 * fact.values["ego_speed"] - left + needed(closing, 9.0)
    gap = by_name["gap"].flips[0]
    assert gap.after <= shortest <= gap.before
    assert gap.before - gap.after == pytest.approx(0.1)


def test_law_a_longer_delay_saves_no_ads_that_brakes_later_by_it(folder, hit):
    (delay,) = WhatIf(folder).answers(hit, "actuation_delay").answers
    assert not delay.flips


def test_replay_marks_the_last_moment_to_brake(folder, hit):
    with open_store(folder) as store:
        mark = contact_of(hit, store.trajectory(hit.case))
    assert 0.0 < mark["last"] == cause_of_contact(hit).no_return_time < mark["time"]


def test_law_changing_nothing_changes_nothing(night):
    folder, case = night
    usual = catalogue.load("front_vehicle_low_speed").placed(known_case(folder, case).values)
    now = (
        ("conditions.perception_delay", USUAL.conditions.perception_delay),
        ("vehicle.friction", USUAL.vehicle.friction),
    )
    late = f"{folder.parent / 'late.py'}:Brakes"
    assert simulate(usual, late).same_drive(simulate(replace(usual, changes=now), late))


def test_law_a_lever_keeps_the_chance_of_its_case_unless_told(night):
    values = known_case(*night).values
    space = catalogue.load("front_vehicle_low_speed")
    (lever,) = (it for it in levers_of(space, values, USUAL) if it.name == "lead_speed")
    here, there = (moved(space, values, lever, value) for value in (lever.recorded, lever.high))
    assert here.actors != there.actors
    assert stream_of(1, here) == stream_of(1, there)
    assert moved(space, values, lever, lever.high, revealed=True).values["lead_speed"] == lever.high


def test_a_collision_gets_a_table_and_json(folder, hit):
    done = run("whatif", folder, hit.case)
    drives = map(int, re.findall(r"^levers.*: (\d+) done$", done.stderr, re.M))
    assert f"\n{sum(drives)} drives;" in (lines := done.stdout)  # every round is reported
    assert "collision at" in lines
    assert "avoids it" in lines
    assert "conditions.sensor_range      no limit: none of 33 values" in lines
    told = run("whatif", folder, hit.case, "--lever", "lead_speed", "--json")
    assert "levers: " in told.stderr  # a slow ADS takes minutes
    (answer,) = json.loads(told.stdout)[hit.case]
    assert answer["flips"][0]["after"] > answer["lever"]["recorded"]
    every = run(f"whatif {folder} --all-collisions --lever max_deceleration").said
    assert "too_late in front_vehicle_low_speed" in every
    cli_refuses("Did you mean `lead_speed`", "whatif", folder, hit.case, "--lever", "led_speed")


def test_a_case_that_does_not_repeat_is_refused(folder, hit):
    file = folder.parent / "too_late.py"
    before = file.read_text()
    file.write_text(LATE.format(begin=0.0))
    try:
        with refusal("does not repeat: recorded a contact"):
            WhatIf(folder).answers(hit)
        file.write_text(LATE.format(begin="(0.0 if observation.ego.speed > 25.0 else 3.4)"))
        done = run(f"whatif {folder} --all-collisions --lever gap --json", status=0)
        assert hit.case not in json.loads(done.stdout)
        assert "1 collision left out. The first: " in done.stderr
    finally:
        file.write_text(before)


def test_a_case_of_a_missing_ads_is_refused_with_the_reason(folder, hit):
    file = folder.parent / "too_late.py"
    moved_away = file.rename(file.with_suffix(".txt"))
    try:
        with refusal(r"now not evaluated \(ADS .*There is no file .*too_late\.py"):
            WhatIf(folder).answers(hit)
    finally:
        moved_away.rename(file)


@pytest.mark.parametrize("named", ['name = "too_late"', 'use = "front_vehicle_low_speed"'])
def test_a_case_that_left_the_evaluation_is_refused(folder, hit, tmp_path, named):
    edited = copytree(folder, tmp_path / "run")
    file = edited / "evaluation.toml"
    replace_in(file, named, named.split()[0] + ' = "cut_in"')
    with refusal("Unknown .* of the run"):
        WhatIf(edited).answers(known_case(edited, hit.case))


def test_a_case_of_an_edited_scenario_is_refused(tmp_path):
    """Also one without contact, which the edited scenario repeats."""
    file = tmp_path / "mine.toml"
    file.write_text(scenario_files()["front_vehicle_low_speed"].read_text())
    entry = {"use": "mine.toml", "sampling": {"levels": 2}}
    settings = {"name": "mine", "scenario": [entry], "drivers": {"count": 2},
                "ads": [{"name": "idm", "controller": "idm"}], "run": {"workers": 1}}  # fmt: skip
    (tmp_path / "evaluation.toml").write_text(tomli_w.dumps(settings))
    done = sumo_eval.evaluate(tmp_path / "evaluation.toml", tmp_path / "run")
    fact = known_case(done.folder, done.cases[0].case)
    assert fact.collision is None
    assert WhatIf(done.folder).answers(fact, "friction").answers
    replace_in(file, 'about = "', 'about = "Edited: ')
    with refusal("The file of scenario `front_vehicle_low_speed` must be that of the run"):
        WhatIf(done.folder).answers(fact, "friction")


def test_a_delay_that_sumo_does_not_feel_is_named_so(night):
    folder, case = night
    fact = known_case(folder, case.replace("late", "hook"))
    (delay,) = WhatIf(folder).answers(fact, "actuation_delay").answers
    assert effect_words(delay, fact.collision) == "0 s: no effect where SUMO moves the ego"


def test_explain_and_the_cause_name_one_moment_of_braking(folder, hit):
    lines = run("explain", folder, hit.case).stdout
    last = float(re.search(r"Cause: braked \S+ s after .* avoids it, (\S+) s", lines)[1])
    after = float(re.search(r"Cause: braked (\S+) s", lines)[1])
    assert "The ADS braked from 3.40 s on" in lines
    assert last + after == pytest.approx(3.4)
