"""`check` of a scenario file, `check` of an evaluation that uses it, and `run` say the same, in the
same sentence."""

import random
import re

import pytest
from commands import sumo_eval
from tables import in_campaign, rows_of

GOOD = """
name = "own"
[[parameter]]
name = "ego_speed"
unit = "m/s"
low = 15.0
high = 25.0
step = 10.0
[[parameter]]
name = "lead_speed"
unit = "m/s"
values = [5.0, 10.0]
[[constraint]]
require = "lead_speed < ego_speed"
[define]
room = "2.0 * ego_speed"
[ego]
speed = "ego_speed"
[[vehicle]]
name = "lead"
speed = "lead_speed"
gap = "room"
[[vehicle.manoeuvre]]
do = "brake"
begin = 1.0
deceleration = 3.0
[zone]
obstacle = "lead"
"""

CHANGES = {
    name: row
    for name, *row in rows_of(r"""
another gap | 2.0 * ego_speed | 3.0 * ego_speed
a vehicle off the road | gap = "room" | gap = 7000.0
a vehicle beside the lanes | gap = "room" | gap = "room"\ny = 30.0
the ego beside the lanes | [ego] | [ego]\ny = -9.0
a vehicle off the road at one point | gap = "room" | gap = "where(ego_speed > 20, 9000, 20)"
a negative speed at one point | speed = "lead_speed" | speed = "lead_speed - 6.0"
division by zero at one point | 2.0 * ego_speed | 1.0 / (ego_speed - 15.0)
no deceleration | deceleration = 3.0 | deceleration = 0.0
an approach that is no number | [zone] | [zone]\ndelay = "0.0 / 0.0"
a negative delay | [zone] | [zone]\ndelay = -1.0
no possible point | lead_speed < ego_speed | lead_speed > ego_speed
an unknown key | [ego] | [ego]\nspede = 1.0
an unknown name | gap = "room" | gap = "rom"
an unknown function | gap = "room" | gap = "open(1)"
an unknown obstacle | obstacle = "lead" | obstacle = "led"
a negative exposure | name = "own" | name = "own"\nexposure = "-1.0 * ego_speed"
a network that is not there | [ego] | [road]\nnetwork = 'no.net.xml'\n[ego]
a low end above the high one | low = 15.0 | low = 35.0
an unknown sample | name = "own" | name = "own"\ndefault_sample = "grd"
""")
} | {
    "as it is": ("", ""),
    "no ego": ('[ego]\nspeed = "ego_speed"', ""),
}

EVALUATION = """
name = "x"
[[scenario]]
use = "own.toml"
[[ads]]
name = "a"
controller = "idm"
[drivers]
count = 2
[run]
workers = 1
engine = "serial"
"""


def said(done):
    return " ".join(done.said.split())


def alike(folder):
    """The verdict of all three; the sentence of the run the other two must say as well."""
    evaluation = folder / "evaluation.toml"
    evaluation.write_text(EVALUATION)
    run = sumo_eval(f"run {evaluation} --dry-run", status=None)
    by_file = sumo_eval(f"check {folder}/own.toml", status=None)
    by_evaluation = sumo_eval("check", evaluation, status=None)
    verdicts = [run.returncode, by_file.returncode, by_evaluation.returncode]
    text = said(run)
    assert len(set(verdicts)) == 1, (verdicts, text, said(by_file), said(by_evaluation))
    if run.returncode == 0:
        return 0
    sentence = re.sub(r"^(sumo-eval|Error): ", "", text)
    assert sentence in said(by_file)
    assert sentence in said(by_evaluation)
    return run.returncode


@pytest.fixture(autouse=True)
def sentences(monkeypatch):
    """Sentences are not wrapped."""
    monkeypatch.setenv("COLUMNS", "400")


@pytest.mark.parametrize(
    "name",
    [in_campaign(it) if it == "another gap" else it for it in CHANGES],
)
def test_check_and_run_have_one_verdict_and_one_sentence(tmp_path, name):
    old, new = CHANGES[name]
    assert old in GOOD
    (tmp_path / "own.toml").write_text(GOOD.replace(old, new, 1))
    assert alike(tmp_path) == (0 if name in ("as it is", "another gap") else 2)


@pytest.mark.parametrize("seed", [in_campaign(0), *range(1, 8)])
def test_damaged_files_are_evaluated_alike(tmp_path, seed):
    rng = random.Random(seed)
    lines = GOOD.strip().splitlines()
    if seed % 2:
        del lines[rng.randrange(len(lines))]
    else:
        place = rng.choice([n for n, line in enumerate(lines) if re.search(r"\d", line)])
        lines[place] = re.sub(
            r"\d+\.\d",
            rng.choice(["-1.0", "1e300", "0.0", "1e-9", "nan", "inf"]),
            lines[place],
            count=1,
        )
    (tmp_path / "own.toml").write_text("\n".join(lines))
    assert alike(tmp_path) in (0, 2)


def test_two_scenarios_of_one_name_are_refused_alike(tmp_path):
    (tmp_path / "own.toml").write_text(GOOD)
    (tmp_path / "other.toml").write_text(GOOD)
    evaluation = tmp_path / "evaluation.toml"
    evaluation.write_text(
        EVALUATION.replace("[[ads]]", '[[scenario]]\nuse = "other.toml"\n[[ads]]')
    )
    refused_alike(evaluation, "must differ in their names, got `own` twice")


def test_axes_of_an_unknown_scenario_are_refused_alike(tmp_path):
    (tmp_path / "own.toml").write_text(GOOD)
    evaluation = tmp_path / "evaluation.toml"
    evaluation.write_text(EVALUATION + '[report]\naxes = { onw = ["ego_speed", "lead_speed"] }\n')
    refused_alike(evaluation, "Unknown scenario `onw` in `report.axes`. Did you mean `own`?")


def refused_alike(evaluation, words):
    for command in (["run", str(evaluation), "--dry-run"], ["check", str(evaluation)]):
        assert words in said(sumo_eval(*command, status=2))
