"""`exec:`: a program in any language, its protocol, its deadline, its end."""

import json
import os
import sys
import time as clock
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from refusals import refused
from road_scenes import HALF_SECOND, ROAD, assert_ended, at_values, case, half_second, lead, under
from tables import rows_of, values_of

from sumo_eval import Command
from sumo_eval.cosim import simulate
from sumo_eval.cosim.doors import json_lines
from sumo_eval.settings import AdsSettings
from sumo_eval.trajectory import CHANNELS

pytestmark = pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs process groups")


def shell(text, step_timeout=5.0, settings=HALF_SECOND):
    quoted = text.replace("'", "'\\''")
    return simulate(
        case(lead(100.0)), f"exec:sh -c '{quoted}'", settings, step_timeout=step_timeout
    )


def alive(pid):
    """Whether a killed process lives for 5 s more: on a busy machine it takes a while to die."""
    for _ in range(500):
        with suppress(FileNotFoundError, ProcessLookupError), open(f"/proc/{pid}/stat") as file:
            if file.read().rsplit(")", 1)[1].split()[0] != "Z":
                clock.sleep(0.01)
                continue
        return False
    return True


@pytest.mark.parametrize("step_timeout", [1e10, 0.0, float("nan")])
def test_an_impossible_time_for_a_step_is_refused(step_timeout):
    with refused("`step_timeout` of `RunSettings` must be"):
        shell("cat", step_timeout)


def test_a_shell_script_drives():
    found = shell(
        'read brief; echo "{}"; while read seen; do echo "{\\"acceleration\\": -2}"; done'
    )
    assert_ended(found)
    assert found.ego.speed[-1] == half_second(lambda seen: -2.0, lead(100.0)).ego.speed[-1]


def test_law_every_door_drives_alike_in_a_curve():
    """A policy's ego, a program's and a hook's begin as if they had driven the curve before."""
    bend = at_values("curve_following", ego_speed=20.0, lead_speed=5.0)
    reader = 'while read x; do echo "{\\"acceleration\\": -1, \\"steering\\": 0.2}"; done'
    doors = lambda seen: (-1.0, 0.2), lambda traci, ego, time: Command(-1.0, 0.2)
    by_policy, by_hook, by_program = (
        simulate(bend, door, HALF_SECOND) for door in (*doors, f"exec:sh -c '{reader}'")
    )
    assert by_policy.ego.steering_wheel_angle[0] > 0.0
    assert by_program.same_drive(by_policy)
    for channel in CHANNELS:
        assert np.array_equal(getattr(by_hook.ego, channel), getattr(by_policy.ego, channel))


def test_the_protocol_line_by_line(tmp_path):
    log = tmp_path / "lines"
    found = shell(
        f'while read line; do echo "$line" >> {log}; echo '
        f'"{{\\"acceleration\\": 0, \\"steering\\": 0}}"; done'
    )
    import json

    assert found.error is None
    brief, *steps = [json.loads(line) for line in log.read_text().splitlines()]
    assert brief["type"] == "reset"
    assert brief["protocol"] == 1
    assert brief["step"] == 0.05
    lines = brief["road"].pop("lane_borders")
    assert brief["road"] == {
        "lanes": 2,
        "lane_width": 3.5,
        "length": 600.0,
        "speed_limit": 60.0,
        "line": [],
    }
    end = 600.0 + ROAD.run_out
    assert lines[1] == {"centre": [[0, 3.5], [end, 3.5]], "left": [[0, 5.25], [end, 5.25]],
                        "right": [[0, 1.75], [end, 1.75]]}  # fmt: skip
    assert brief["desired_speed"] == 20.0
    assert brief["goal"] == [600.0, 0.0]
    assert brief["vehicle"]["wheelbase"] == 2.7
    assert "scenario" not in brief
    assert [step["time"] for step in steps] == pytest.approx([0.05 * i for i in range(10)])
    first = steps[0]
    ahead = first["lead"]
    assert first["ego"]["speed"] == 20.0
    assert ahead["gap"] == pytest.approx(100.0)
    assert ahead["x"] == 154.5
    assert ahead["y"] == 0.0
    assert ahead["kind"] == "car"
    assert set(first["neighbours"]) == {
        "left_ahead",
        "left_behind",
        "right_ahead",
        "right_behind",
        "behind",
    }
    assert set(first) == {"type", "time", "ego", "lead", "second_lead", "neighbours",
        "vehicles", "lanes",
                             "left_edge", "right_edge", "curvature"}  # fmt: skip


def test_every_name_of_a_reset_stands_in_the_docs():
    found = shell('read brief; echo "$brief" >&2; echo no', settings=under(reveal_scenario=True))
    page = (Path(__file__).parents[2] / "docs/ads/exec.md").read_text()
    assert [name for name in json.loads(found.log) if f'"{name}"' not in page] == []


def test_the_scenario_is_named_when_it_is_revealed():
    found = shell('read brief; echo "$brief" >&2; echo no', settings=under(reveal_scenario=True))
    assert '"scenario":"test","values":{}' in found.log


def test_a_hung_program_is_killed_at_its_deadline_with_everything_it_started(tmp_path):
    pids = tmp_path / "pids"
    began = clock.monotonic()
    found = shell(
        f"read x; echo {{}}; echo $$ > {pids}; sleep 60 & echo $! >> {pids}; wait", step_timeout=0.3
    )
    assert found.error == (
        "The ADS's program must answer within 0.3 s, got nothing (it must flush its output after "
        "every line), and was ended at 0.00 s."
    )
    assert found.end_reason == "ads_timeout"
    assert clock.monotonic() - began < 30.0  # not the 60 s that it sleeps
    if sys.platform == "linux":
        assert not any(alive(int(pid)) for pid in pids.read_text().split())


def test_a_program_that_reads_nothing_is_ended(monkeypatch):
    """200 kB are more than a pipe holds."""
    monkeypatch.setattr(json_lines, "START_TIMEOUT", 0.3)
    ads = AdsSettings("a", "exec:sleep 60", options={"map": "x" * 200_000})
    found = half_second(ads.locator, lead(100.0), step_timeout=0.3)
    assert found.end_reason == "ads_timeout"
    found = shell("printf '{}'; sleep 60", step_timeout=0.3)
    assert "within 0.3 s, got b'{}' without an end of line" in found.error


def test_a_script_that_the_system_cannot_start_gets_a_sentence(tmp_path, monkeypatch):
    (tmp_path / "ads.sh").write_bytes(b"#!/bin/sh\r\n")
    (tmp_path / "ads.sh").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    found = half_second("exec:./ads.sh", folder=Path())  # which drops the `./`
    assert "ends without a carriage return" in found.error
    assert found.log == ""
    assert found.error_place == ""


def test_a_program_that_works_on_after_its_case_is_killed_too(tmp_path):
    pids = tmp_path / "pids"
    text = (
        f'echo $$ > {pids}; read x; echo {{}}; while read s; do echo "{{\\"acceleration\\":0}}"; '
        f"done; sleep 60"
    )
    assert shell(text).error is None
    if sys.platform == "linux":
        assert not alive(int(pids.read_text()))


@pytest.mark.parametrize(
    "text, sentence",
    [
        *rows_of(r"""
exit 3 | The ADS's program ended before its case did, with status 3 in reset.
read x; echo {}; read x; echo oh >&2; exit 4 | ended before its case did, with status 4 at 0.00 s.
read x; exec <&-; echo {}; sleep 5 | ended before its case did, closing its input at 0.00 s.
read x; echo {}; read x; echo brake
| answer with a JSON object on one line, got 'brake' at 0.00 s.
read x; echo {}; read x; echo 3 | answer with a JSON object on one line, got '3' at 0.00 s.
read x; echo {}; read x; echo {} | must have an `acceleration`, got {} at 0.00 s.
read x; echo {}; read x; echo "{\"honk\": 1}"
| unknown `honk`, and not only acceleration and steering
read x; echo {}; read x; echo "{\"brake\":1,\"speed\":1}"
| `brake`, and not only speed and steering
read x; echo {}; read x; echo "{\"brake\": 2}"
| `brake` of the ADS's pedals must be within 0..1, got 2
read x; echo {}; read x; echo "{\"plan\": null}" | must give a plan before one can hold at 0.00 s.
read x; echo {}; read x; echo "{\"speed\": null}"
| must have an `acceleration`, got {"speed": null} at 0.00 s.
read x; echo {}; read x; echo "{\"acceleration\": NaN}"
| must be a finite number, got nan at 0.00 s.
read x; echo {}; read x; echo "{\"acceleration\": \"1\"}"
| must be a finite number, got '1' at 0.00 s.
"""),
        ("read x; printf '%09999d\n' 0 | tr 0 '['; sleep 5", "a JSON object on one line, got '[["),
        ("read x; printf '{}\\n{}\\n'; sleep 5", "must answer with one line, got more"),
        (
            "read x; printf 'loading\\n{}\\n'; sleep 5",
            "answer with a JSON object on one line, got 'loading' in reset.",
        ),
    ],
)
def test_what_is_not_an_answer_is_the_adss_error(text, sentence):
    found = shell(text)
    assert_ended(found, "ads_error", sentence)


def test_what_a_program_says_on_stderr_is_in_the_log():
    assert "oh dear" in shell("echo oh dear >&2; exit 1").log


def test_every_case_has_a_program_of_its_own():
    text = (
        'n=0; read x; echo {}; while read s; do n=$((n+1)); echo "{\\"acceleration\\": -$n}"; done'
    )
    assert shell(text).ego.speed.tolist() == shell(text).ego.speed.tolist()


@pytest.mark.parametrize(
    "locator, sentence",
    values_of("""
    "exec:", "must be a program and its arguments"
    "exec:no_such_program_here --fast", "there is no program `no_such_program_here`"
    "exec:./not_here", "there is no program `./not_here`"
    "exec:sh -c 'x", "one that a shell could split"
    """),
)
def test_a_command_that_cannot_be_run_is_refused_before_anything_runs(locator, sentence):
    with refused(sentence):
        simulate(case(), locator)


def test_a_program_that_may_not_be_executed_is_refused_with_the_remedy(tmp_path):
    (tmp_path / "mine.py").write_text("print('{}')\n")
    with refused("the file `./mine.py` must be executable; `chmod +x` makes it so"):
        simulate(case(), "exec:./mine.py --fast", folder=tmp_path)


def test_a_file_named_as_a_program_is_refused_with_the_locator_meant(tmp_path):
    (tmp_path / "mine.py").write_text("print('{}')\n")
    with refused("that can be run. Is it `./mine.py`, or `exec:python3 mine.py --fast`?"):
        simulate(case(), "exec:mine.py --fast", folder=tmp_path)
