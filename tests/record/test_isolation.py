"""Accidents in the process that serves an ADS: its own row is lost at most, and every other is as
without."""

import json
import os
import signal
import subprocess
import sys
import time as clock
from collections import Counter
from itertools import count
from pathlib import Path

import pytest
from campaign_share import SHARE
from commands import python
from record import hostile_ads
from record.runs import CONCRETE, SPACE, cases_of, command, each_once, limited, write_evaluation
from refusals import refusal
from tables import in_campaign, values_of

from sumo_eval.record import frames, hygiene
from sumo_eval.record.cases import Case
from sumo_eval.record.engines import identify, run_cases
from sumo_eval.record.frames import FrameError, FrameReader, frame
from sumo_eval.record.kept import keep
from sumo_eval.trajectory import Recording

LIMITS = {"case_timeout": 4.0, "step_timeout": 0.5, "memory_limit": 600.0}
INNOCENT = ("faulty_ads.py:coast", "idm", "faulty_ads.py:random_driver")
OF_EACH_KIND = [
    "closes_descriptors",
    "forks_in_a_step",
    "patches_numpy",
    "closes_stdout",
    "begins_a_thread",
    "stops_itself",
    "leaves_a_daemon",
    "dies_with_a_daemon",
    "fills_shared_memory",
    "lets_another_fill_memory",
    "leaves_by_faulthandler",
    "forks_and_leaves",
    "sends_no_values",
    "sends_a_number",
    "sends_odd_rows",
    "sends_much",
]
"""What the suite drives: one accident of each kind. The campaign drives all of them, many times."""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="supervisors need Linux")


def facts(outcome):
    """What the store keeps of it as facts."""
    found = outcome.recording
    kept = keep(found) if isinstance(found, Recording) else found
    return (
        outcome.status,
        outcome.error,
        kept and (kept.drives, kept.collision, kept.end_reason, kept.clips),
    )


def driven(accidents, workers):
    """Outcomes of accidents with innocent ADSs between them."""
    numbers = count()
    cases = [
        Case(next(numbers), CONCRETE, "ads", locator.partition(":")[2] or locator, locator)
        for accident in accidents
        for locator in (INNOCENT[0], f"hostile_ads.py:{accident}", *INNOCENT[1:])
    ]
    return each_once(cases, workers=workers, **LIMITS)


def untouched(found):
    """Check that every innocent row is what it is alone."""
    for locator in INNOCENT:
        case = Case(0, CONCRETE, "ads", locator.partition(":")[2] or locator, locator)
        (alone,) = run_cases([case], limited(workers=1))
        rows = [facts(outcome) for outcome in found if outcome.case.controller == locator]
        assert rows
        assert all(row == facts(alone) for row in rows), locator


def nothing_left():
    """Whether no process is left that an ADS has started."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if hostile_ads.DAEMON.encode() in path.read_bytes():
                return False
        except OSError:
            continue
    return True


@pytest.fixture(scope="module")
def outcomes():
    return driven(OF_EACH_KIND, workers=2)


@pytest.mark.parametrize("accident", OF_EACH_KIND)
def test_an_accident_fails_its_own_row_which_reports_it(outcomes, accident):
    (outcome,) = [outcome for outcome in outcomes if outcome.case.driver == accident]
    assert outcome.status in hostile_ads.ACCIDENTS[accident], outcome.error
    assert outcome.error or outcome.status in ("ok", "collision", "off_road")


def test_every_row_beside_accidents_is_what_it_is_alone(outcomes):
    untouched(outcomes)


def test_processes_in_sessions_of_their_own_end_with_the_child_that_left_them(outcomes):
    assert outcomes
    assert nothing_left()


@pytest.mark.parametrize("accident", ["fills_shared_memory", "lets_another_fill_memory"])
def test_memory_that_is_shared_or_anothers_counts_and_the_row_says_how_much(outcomes, accident):
    (outcome,) = [outcome for outcome in outcomes if outcome.case.driver == accident]
    assert "more than the 600 MB of `run.memory_limit`" in (outcome.error or "")


@pytest.mark.parametrize("ads", ["hoards", "limits_memory", "limits_files", "ClosesStreams"])
def test_an_ads_that_keeps_or_limits_resources_loses_no_case(ads):
    found = run_cases(cases_of(f"hostile_ads.py:{ads}", 20), limited(workers=1, **LIMITS))
    assert [outcome.status for outcome in found] == ["collision"] * 20


# --- one process, one locator ---------------------------------------------------------------------

PLANNER = (
    "from sumo_eval import Command\nimport os\n\ndef plan():\n    print(os.getpid())\n    return "
    "Command({})\n"
)
MINE = "from planner import plan\n\ndef drive(traci, ego, now):\n    return plan()\n"


def two_planners(folder):
    """Cases of `a/my.py` and `b/my.py`, each with a `planner.py` of its own beside it, one after
    the other."""
    for name, acceleration in (("a", -1.0), ("b", -2.0)):
        (folder / name).mkdir(parents=True)
        (folder / name / "planner.py").write_text(PLANNER.format(acceleration))
        (folder / name / "my.py").write_text(MINE)
    return [
        Case(
            point,
            SPACE.concrete(ego_speed=20, lead_speed=speed),
            "ads",
            name,
            f"{name}/my.py:drive",
        )
        for point, speed in enumerate((5, 10))
        for name in ("a", "b")
    ]


def bytes_of(cases, folder, workers):
    found = run_cases(cases, limited(folder, workers=workers))
    return {outcome.case.key: facts(outcome) for outcome in found}


def test_two_adss_that_import_a_helper_of_one_name_drive_with_their_own(tmp_path):
    cases = two_planners(tmp_path)
    alone = {key: row for case in cases for key, row in bytes_of([case], tmp_path, 1).items()}
    assert len({repr(row) for row in alone.values()}) == len(cases), "four different drives"
    for workers, order in ((1, -1), (2, 1), (8, -1)):
        assert bytes_of(cases[::order], tmp_path, workers) == alone


def test_a_child_does_not_get_the_helper_of_an_earlier_ads(tmp_path):
    (tmp_path / "first").mkdir()
    earlier, *_ = two_planners(tmp_path / "first")
    list(run_cases([earlier], limited(tmp_path / "first", engine="serial")))
    rows = bytes_of(two_planners(tmp_path / "second"), tmp_path / "second", 1)
    assert len({repr(row) for row in rows.values()}) == len(rows), "four different drives"


def test_a_process_serves_one_locator_in_its_life(tmp_path):
    cases = two_planners(tmp_path)
    served = {}
    setup = limited(tmp_path, workers=2)
    for outcome in run_cases(cases * 2, setup):
        for pid in outcome.log.split():
            served.setdefault(pid, set()).add(outcome.case.controller)
    assert served
    assert all(len(locators) == 1 for locators in served.values())


def test_the_serial_engine_refuses_a_second_ads_of_the_users_and_takes_one(tmp_path):
    cases = two_planners(tmp_path)
    setup = limited(tmp_path, engine="serial")
    with refusal(r"one ADS of yours, got ADS `a/my.py:drive` and ADS `b/my.py:drive`"):
        list(run_cases(cases, setup))
    with refusal("one ADS of yours"):
        identify([("ADS", "a/my.py:drive"), ("ADS", "b/my.py:drive")], setup)
    assert len(identify([("ADS", "a/my.py:drive"), ("ADS", "idm")], setup)) == 2


def test_of_ads_that_do_not_load_the_first_is_named(tmp_path):
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(0.5)\n")
    setup = limited(tmp_path, workers=2)
    with refusal("ADS `slow.py:a`"):
        identify([("ADS", "slow.py:a"), ("ADS", "none.py:a")], setup)


# --- frames ---------------------------------------------------------------------------------------


def test_a_frame_is_read_byte_by_byte_as_it_was_written():
    message = [1, "two", None, 0.1, b"three", {"four": []}]
    data = frame(message, 4)
    reader = FrameReader(4, len(data) - 24)  # 24: bytes of the header
    found = [reader.feed(data[i : i + 1]) for i in range(len(data))]
    assert found[:-1] == [None] * (len(data) - 1)
    assert found[-1] == message


@pytest.mark.parametrize(
    "change, says",
    [
        (lambda data: b"x" + data, "not a result"),
        (lambda data: data + b"x", "more than one"),
        (lambda data: data[:-1] + b"x", "checksum"),
        (lambda data: frame(None, 5), "another case"),
        (lambda data: frame([b"x" * 1000], 4)[:24], "announced a result of 1010 bytes, over 1000"),
    ],
)
def test_anything_else_is_not_a_frame(change, says):
    with pytest.raises(FrameError, match=says):
        FrameReader(4, 1000).feed(change(frame([1], 4)))


@pytest.mark.parametrize("body", [b"", b"?", b"[\x05\0\0\0N", b"0"])
def test_a_whole_frame_without_values_is_not_a_frame(body, monkeypatch):
    monkeypatch.setattr(frames.marshal, "dumps", lambda values: body)
    with pytest.raises(FrameError, match="gave a result that cannot be read: "):
        FrameReader(4, 1000).feed(frame([1], 4))


def test_values_that_their_reader_refuses_are_not_a_frame():
    with pytest.raises(FrameError, match="cannot be read: TypeError: "):
        FrameReader(4, 1000, lambda values: values[0]).feed(frame(7, 4))


def test_no_bit_of_a_frame_can_flip_unseen():
    data = frame(["ok", b"abc"], 4)
    for i in range(len(data)):
        changed = data[:i] + bytes([data[i] ^ 0x10]) + data[i + 1 :]
        reader = FrameReader(4, 1000)
        try:
            found = reader.feed(changed)
        except FrameError:
            continue
        assert found is None, "a longer length waits for what does not come"


@pytest.mark.parametrize(
    "accident, says",
    values_of("""
    "sends_no_values", "gave a result that cannot be read: ValueError"
    "sends_a_number", "gave a result that cannot be read: TypeError"
    "sends_odd_rows", "gave a result that cannot be read: ValidationError"
    "sends_much", "announced a result of 1073741824 bytes, over 314572800"
    """),
)
def test_a_forged_frame_is_named(outcomes, accident, says):
    (outcome,) = [outcome for outcome in outcomes if outcome.case.driver == accident]
    assert f"The process that ran the case {says}" in outcome.error


# --- process hygiene ------------------------------------------------------------------------------


def test_no_process_of_the_pool_holds_a_descriptor_of_the_owner(tmp_path):
    (tmp_path / "ads.py").write_text(
        "import os, json\nfrom sumo_eval import Command\n\n"
        "def held(pid):\n"
        "    found = []\n"
        "    for name in os.listdir(f'/proc/{pid}/fd'):\n"
        "        try:\n"
        "            found.append(os.readlink(f'/proc/{pid}/fd/{name}'))\n"
        "        except OSError:\n"
        "            pass\n"
        "    return found\n\n"
        "def drive(traci, ego, now):\n"
        "    if now == 0.0:\n"
        "        supervisor = os.getppid()\n"
        "        server = "
        "int(open(f'/proc/{supervisor}/stat').read().rpartition(')')[2].split()[1])\n"
        "        print(json.dumps([held(pid) for pid in (os.getpid(), supervisor, server)]))\n"
        "    return Command(0.0)\n"
    )
    with (tmp_path / "facts.sqlite").open("w") as store:
        os.set_inheritable(store.fileno(), True)
        case = Case(0, CONCRETE, "ads", "x", "ads.py:drive")
        (outcome,) = run_cases([case], limited(tmp_path, workers=1))
    child, supervisor, server = json.loads(outcome.log.splitlines()[0])
    assert child
    assert supervisor
    assert not any("facts" in name for name in child + supervisor + server)
    ours = ("pipe:", "/memfd:", "/dev/null", "/proc/")
    assert all(name.startswith(ours) for name in child), child


def test_folders_of_owners_that_have_gone_are_removed_and_others_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    mine = hygiene.scratch_folder()
    owner = mine.name.removeprefix("sumo_eval_pool_").partition("_")[0]
    pid, begun, space = owner.split("-")
    gone = [f"{pid}-{int(begun) + 1}-{space}", f"4194304-1-{space}"]
    kept = [f"{pid}-1-77", "notes", f"{pid}"]
    for name in gone + kept:
        (tmp_path / f"sumo_eval_pool_{name}_x").mkdir()
    other = hygiene.scratch_folder()
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {mine.name, other.name, *(f"sumo_eval_pool_{name}_x" for name in kept)}


def test_the_process_that_makes_children_leaves_what_its_owner_says_to_the_owner():
    script = (
        "import sys; import sumo_eval.record.loaded_loops\n"
        "for kind in (EOFError, BlockingIOError, ValueError):\n"
        "    sys.excepthook(kind, kind('ended'), None)\n"
    )
    assert python(script).stderr.strip() == "ValueError: ended"


@pytest.mark.parametrize("number", [in_campaign(signal.SIGTERM), signal.SIGKILL])
def test_a_signal_ends_a_run_whatever_its_children_do(tmp_path, number):
    ads = (
        "import os, time\nfrom sumo_eval import Command\n\n"
        "class MyAds:\n"
        "    def reset(self, scenario, traci, ego):\n"
        "        if scenario.step:\n"
        f"            open({str(tmp_path / 'begun')!r}, 'w').close()\n"
        "            if os.fork() == 0:\n"
        "                os.setsid()\n"
        f"                os.execvp('sleep', ['sleep', '{hostile_ads.DAEMON}'])\n"
        "        sum(range(10**18))\n"
        "    def step(self, traci, ego, now):\n"
        "        return Command(0.0)\n"
    )
    path = write_evaluation(tmp_path, ads=ads, case_timeout=10_000.0)
    with subprocess.Popen(
        command("run", path, "--out", tmp_path / "run"), stderr=subprocess.PIPE
    ) as run:
        while not (tmp_path / "begun").exists():
            assert run.poll() is None
            clock.sleep(0.02)
        run.send_signal(number)
        _, said = run.communicate(timeout=60)
    assert run.returncode == (130 if number == signal.SIGTERM else -signal.SIGKILL)
    assert b"Traceback" not in said
    for _ in range(500):
        if nothing_left():
            break
        clock.sleep(0.02)
    assert nothing_left()


# --- the campaign ---------------------------------------------------------------------------------


@pytest.mark.campaign
def test_accidents_again_and_again(capsys):
    accidents = [name for name in hostile_ads.ACCIDENTS for _ in range(max(1, round(20 * SHARE)))]
    found = driven(accidents, workers=2)
    untouched(found)
    ends = Counter(outcome.status for outcome in found if outcome.case.controller not in INNOCENT)
    with capsys.disabled():
        print(f"\n{len(accidents)} accidents {dict(ends)}; all rows beside them as alone")
    for outcome in found:
        allowed = hostile_ads.ACCIDENTS.get(outcome.case.driver)
        assert allowed is None or outcome.status in allowed | hostile_ads.LOST, (
            outcome.case,
            outcome.error,
        )
    assert nothing_left()
