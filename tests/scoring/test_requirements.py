"""Requirements of scenario files: conditions on the whole drive."""

import csv
import json
import tomllib

import numpy as np
import pytest
from laid import read_json
from refusals import refusal
from road_scenes import ROAD, scenario_of
from tables import rows_of

from sumo_eval import Trajectory, evaluate
from sumo_eval import score as score_run
from sumo_eval.nightly.gates import judge
from sumo_eval.report.checks import checked_cases
from sumo_eval.report.junit import run_suites
from sumo_eval.report.notes import score_note
from sumo_eval.report.tables import write_tables
from sumo_eval.scenario.requirement import requirement
from sumo_eval.scoring.gate_settings import GateSettings, LimitSettings
from sumo_eval.scoring.requirements import missed_in, series_of

SCENE = tomllib.loads("""
name = "approach"
parameter = [{ name = "gap0", unit = "m", low = 20.0, high = 60.0, step = 40.0 }]
ego = { speed = 20.0 }
vehicle = [{ name = "lead", speed = 10.0, gap = "gap0" }]
zone = { obstacle = "lead" }
end = { x = 300.0 }
""")


def drive(y=0.0):
    """At 10 m/s for 1 s, then braking with 2 m/s2 for 1 s: 10, 8 m/s at the ends."""
    x, speeds, rates = [0.0, 10.0, 19.0], [10.0, 10.0, 8.0], [0.0, 0.0, -2.0]
    return Trajectory(range(3), x, [0.0, 0.1, y], np.zeros(3), speeds, rates, length=4.0)


def ahead():
    """Its rear is 16, 10 and 5 m ahead of that one's front: 20 - 4 m, then 24 - 14, 28 - 23."""
    return Trajectory(range(3), [20.0, 24.0, 28.0], np.zeros(3), length=4.0)


@pytest.mark.parametrize(
    "text, holds",
    rows_of("""
min(gap) >= 5 - 1e-9 | true
min(gap) > 5.01 | false
at_end(speed) == 8 | true
max(abs(offset)) < 0.15 | true
min(acceleration) >= -2 | true
min(jerk) >= -1.9 | false
min(ttc) >= 1.25 - 1e-9 | true
min(ttc) > 1.26 | false
min(thw) >= 0.625 - 1e-9 | true
at_end(time) <= limit | true
max(speed - 2 * time) <= 10 and collided == 0 | true
min(3, limit) < 3 or max(x) > 18 | true
""", str, json.loads),
)  # fmt: skip
def test_a_requirement_by_hand(text, holds):
    """TTC at the end 5 m / (8 - 4) m/s = 1.25 s, THW 5 / 8 s, jerk -2 m/s3."""
    series = series_of(drive(), {"lead": ahead()}, None, ROAD)
    one = requirement("r", text, "", "a test", ["limit"])
    verdict = one.check(series, {"limit": 2.5, "collided": 0.0, "reached_end": 0.0})
    assert verdict == (holds, None)


def test_a_parameter_may_have_the_name_of_a_placeholder():
    one = requirement("r", "max(time) < over_time_0", "", "a test", ["over_time_0"])
    assert one.check({"time": np.arange(2.0)}, {"over_time_0": 1.5}).holds
    text = "max(speed(lead) - speed_of_lead) <= 0.5"
    one = requirement("r", text, "", "a test", ["speed_of_lead"], ["lead"])
    ((placeholder, _, _),) = one.asks
    series = {"time": np.arange(2.0), placeholder: np.array([5.0, 20.0])}
    assert not one.check(series, {"speed_of_lead": 10.0}).holds


def test_without_a_lead_the_gap_is_infinite():
    one = requirement(
        "r", "min(gap) > 1000 and min(ttc) > 1000 and min(thw) > 1000", "", "a test", []
    )
    outcomes = {"collided": 0.0, "reached_end": 0.0}
    assert one.check(series_of(drive(), {}, None, ROAD), outcomes).holds


@pytest.mark.parametrize(
    "text, verdict",
    rows_of("""
min(gap - 2 * ttc) > -1000 | [false, 0.0]
at_end(gap - ttc) < 1 | [false, 2.0]
max(where(gap < 1000, gap - ttc, 1)) < 2 | [true, null]
max(gap - ttc > 2) < 1 | [false, 0.0]
at_end(where(gap - ttc > 2, 1, 0)) < 1 | [false, 2.0]
min(gap) - min(ttc) >= 0 | [false, 2.0]
not (min(gap) - min(ttc) < 0) | [false, 2.0]
min(gap) > max(thw) or collided == 0 | [true, null]
"""),
)  # fmt: skip
def test_a_requirement_without_a_number_is_undecided(text, verdict):
    """Without a lead, gap and TTC are infinite, and inf - inf is not a number."""
    one = requirement("r", text, "", "a test", [])
    outcomes = {"collided": 0.0, "reached_end": 0.0}
    check = one.check(series_of(drive(), {}, None, ROAD), outcomes)
    assert list(check) == json.loads(verdict)


@pytest.mark.parametrize(
    "text, sentence",
    rows_of(r"""
min(gab) > 2 | Did you mean `gap`
gap > 2 | `gap` of requirement .* must be within min\(\), max\(\)
min(gap) | `min\(gap\)` of .* must be a condition
max(gap0) < 2 | must be of time, x, offset, .* x\(lead\), y\(lead\), speed\(lead\), lateral_speed\(lead\)
min(x(lead) - foo) > 2 | Unknown name `foo` .* x\(lead\)
min(x(led) - x) > 2 | Unknown vehicle `led`
x(lead) > 2 | `x\(lead\)` of requirement .* must be within min\(\), max\(\)
min(gap) > | cannot be read
at_the_end(gap) > 2 | Unknown function
min(gap.x) > 2 | language does not have
"""),
)  # fmt: skip
def test_a_requirement_that_cannot_be_is_refused(text, sentence):
    with refusal(sentence):
        scenario_of({**SCENE, "require": [{"check": text}]})


def test_names_of_requirements_differ():
    both = [{"check": "min(gap) > 1", "name": "a"}, {"check": "min(gap) > 2", "name": "a"}]
    with refusal("`a` twice"):
        scenario_of({**SCENE, "require": both})


def test_requirements_stand_beside_the_scores_of_a_run(tmp_path):
    """A car that does nothing hits a lead 10 m/s slower within 300 m: 20 m after 2 s, 60 m after 6
    s."""
    (tmp_path / "approach.toml").write_text(
        '''name = "approach"
[[parameter]]
name = "gap0"
unit = "m"
low = 20.0
high = 60.0
step = 40.0
[ego]
speed = 20.0
[[vehicle]]
name = "lead"
speed = 10.0
gap = "gap0"
[zone]
obstacle = "lead"
[end]
x = 300.0
[[require]]
name = "keeps clear"
check = "collided == 0 and min(gap) > 2"
[[require]]
check = "at_end(time) > gap0 / 10 - 0.01"
[[require]]
name = "no number"
check = "max(0 * x / (gap0 - 60)) < 1"
''')  # fmt: skip
    content = tomllib.loads(f"""
name = "n"
drivers = {{ count = 2 }}
scenario = [{{ use = "{tmp_path}/approach.toml" }}]
ads = [{{ name = "nothing", controller = "no_reaction" }}]
""")
    result = evaluate(content, tmp_path / "run", workers=1)
    (score,) = result.scores
    assert score.requirements_missed == 2
    said = [score_note(note) for note in score.notes]
    assert (
        "2 of 2 cases miss the requirement keeps clear (`collided == 0 and min(gap) > 2`)." in said
    )
    assert not any("at_end(time)" in note for note in said)
    without_number = result.cases[1]
    assert without_number.values["gap0"] == 60.0
    note = next(note for note in said if "no number" in note)
    assert note.startswith("1 of 2 cases miss the requirement no number (`max(0 * x / (gap0")
    moment = "0.00 s"
    assert note.endswith(f"such as inf - inf), first in `{without_number.case}` at {moment}.")
    assert [it.missed for it in checked_cases(result)] == [
        ["keeps clear"],
        ["keeps clear", "no number"],
    ]
    write_tables(result)
    with (result.folder / "cases.csv").open() as file:
        missed = [row["requirements_missed"] for row in csv.DictReader(file)]
    assert missed == ["keeps clear", f"keeps clear; no number: undecided at {moment}"]
    assert read_json(result.folder / "scores.json")["scores"][0]["requirements_missed"] == 2
    tests = [test for suite, _ in run_suites(result).values() for test in suite]
    assert [test.verdict for test in tests] == ["failure", "failure"]
    for most, passes in ((1.0, False), (2.0, True)):
        (gate,) = judge(
            result, None, GateSettings(limit=(LimitSettings("requirements_missed", at_most=most),))
        )
        assert gate.passed == passes
        assert gate.value == 2.0
    # the file of a driven scenario may only change what needs no other drives
    text = (file := tmp_path / "approach.toml").read_text()
    for old, new, sentence in (
        ("gap0", "gap1", "was driven with the parameters gap0, and has gap1 now"),
        ('"lead"', '"truck"', "requires something of `truck`"),
    ):
        more = '[[require]]\ncheck = "min(x(truck)) > 0"\n' if "truck" in new else ""
        file.write_text(text.replace(old, new) + more)
        with refusal(sentence):
            score_run(result.folder)


@pytest.mark.parametrize("name", ["calm", "gap: undecided at night", "a: undecided at 2 s"])
def test_the_name_of_a_missed_requirement_is_read_whole(name):
    assert missed_in(f"{name}; other") == [(name, ""), ("other", "")]
    assert missed_in(f"{name}: undecided at 1.50 s") == [(name, "1.50 s")]
