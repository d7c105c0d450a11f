"""Real SUMO runs in child processes: one fault costs one case, the rest is untouched, every case
ends once."""

import os
import signal
import subprocess
import sys
import threading
import time as clock
from dataclasses import replace
from pathlib import Path

import pytest
from commands import python
from record.runs import CONCRETE, cases_of, each_once, limited
from refusals import refusal
from tables import rows_of, values_of

from sumo_eval.cli.stopping import heard
from sumo_eval.cosim import Command, simulate
from sumo_eval.record import children
from sumo_eval.record.batches import LATE
from sumo_eval.record.cases import Case
from sumo_eval.record.claims import affinity_of_ads
from sumo_eval.record.engines import is_late_by_chance, run_batches, run_cases
from sumo_eval.record.kept import KeptRecording, packed
from sumo_eval.record.pool import Ended
from sumo_eval.settings import RunSettings

LIMITS = {"case_timeout": 2.0, "step_timeout": 0.2, "memory_limit": 700.0}

FAULTS = {
    name: row
    for name, *row in rows_of("""
raises | ads_error | The ADS raised at 0.00 s: ValueError: no path found.
gives_nan | ads_error
| `acceleration` of the ADS's Command must be a finite number, got nan at 0.00 s.
wrong_type | ads_error | The ADS must return a Command, Pedals, a Plan or None, got str at 0.00 s.
leaves | ads_error | The ADS raised at 0.00 s: SystemExit: 3.
interrupts | ads_error | The ADS raised at 0.00 s: RuntimeError: it raised KeyboardInterrupt.
InterruptsWhenMade | ads_error | making one failed: it raised KeyboardInterrupt.
vanishes | crashed | The process that ran the case died with exit code 7.
segfaults | crashed | The process that ran the case died with exit code -11 (SIGSEGV).
hangs | ads_timeout | The ADS must answer within 0.2 s, took longer at 0.00 s.
hangs_in_c | timeout | The case took longer than 2 s of wall time.
slow | ads_timeout | The ADS must answer within 0.2 s, took longer at 0.00 s.
fills_memory | ads_error | MemoryError: more than the 700 MB of `run.memory_limit`.
NeedsArguments | rejected | making one without arguments failed
RaisesInClose | collision | The ADS raised in close: RuntimeError: late.
""")
} | {
    "chatters": ("collision", ""),
    "leaves_threads": ("collision", ""),
    "leaves_a_process": ("collision", ""),
}
INNOCENT = ("coast", "idm")


@pytest.fixture(scope="module")
def outcomes():
    names = [name for fault in FAULTS for name in (fault, *INNOCENT)]
    cases = [
        Case(number, CONCRETE, "ads", name, name if name == "idm" else f"faulty_ads.py:{name}")
        for number, name in enumerate(names)
    ]
    found = each_once(cases, workers=2, **LIMITS)
    by_name = {
        outcome.case.driver: outcome for outcome in found if outcome.case.driver not in INNOCENT
    }
    innocent = [outcome for outcome in found if outcome.case.driver in INNOCENT]
    return by_name | {outcome.case.key: outcome for outcome in innocent}


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_ads_costs_its_own_case_and_the_row_says_why(outcomes, name):
    status, sentence = FAULTS[name]
    assert outcomes[name].status == status
    assert sentence in (outcomes[name].error or "")


def test_cases_beside_faulty_ones_are_what_they_are_alone(outcomes):
    alone = {"coast": simulate(CONCRETE, lambda *_: Command(0.0)), "idm": simulate(CONCRETE, "idm")}
    innocent = [outcome for key, outcome in outcomes.items() if key.startswith("front_vehicle")]
    assert len(innocent) == len(FAULTS) * len(INNOCENT)
    for outcome in innocent:
        expected = alone[outcome.case.driver]
        assert (outcome.status, outcome.error) == (
            "ok" if outcome.case.driver == "idm" else "collision",
            None,
        )
        assert packed(outcome.recording.ego) == packed(expected.ego), "bit for bit"


LATE_ADS = """
import time
from pathlib import Path
from sumo_eval import Command

DRIVES = Path(__file__).with_name("drives")

def loads_late(traci, ego, now):
    if now == 0.0 and not DRIVES.exists():
        DRIVES.touch()
        time.sleep(0.5)
    return Command(0.0)

def waits(traci, ego, now):
    if now > 0.35:
        with DRIVES.open("a") as file:
            file.write("x")
        time.sleep(0.5)
    return Command(0.0)
"""


@pytest.mark.parametrize(
    "name, status, drives", [("loads_late", "collision", ""), ("waits", "ads_timeout", "xx")]
)
def test_late_case_is_driven_once_more_alone(tmp_path, name, status, drives):
    (tmp_path / "late.py").write_text(LATE_ADS)
    setup = limited(tmp_path, workers=1, **LIMITS)
    cases = [Case(n, CONCRETE, "ads", ads, ads) for n, ads in enumerate((f"late.py:{name}", "idm"))]
    found = {outcome.case.driver: outcome for outcome in run_cases(cases, setup)}
    late = found.pop(f"late.py:{name}")
    assert late.status == status
    assert (tmp_path / "drives").read_text() == drives
    assert late.alone.why == LATE
    assert "took longer" in late.alone.detail
    assert "driven once more with no other case" in late.log
    assert found["idm"].alone is None


@pytest.mark.parametrize(
    "status, simulated, idle, again",
    values_of("""
    "ads_timeout", 0.0, 0.0, True
    "ads_timeout", 2.0, 0.1, False
    "ads_timeout", 2.0, 0.5, True
    "timeout", None, 0.1, False
    "timeout", None, 0.5, True
    "ads_error", 0.0, 0.9, False
    """),
)
def test_only_lateness_without_a_processor_is_chance(outcomes, status, simulated, idle, again):
    kept = outcomes["raises"].recording
    assert isinstance(kept, KeptRecording)
    recording = None if simulated is None else kept._replace(simulated_time=simulated)
    outcome = replace(outcomes["raises"], status=status, recording=recording)
    ended = Ended((outcome.case,), "done", None, "", idle=idle)
    assert is_late_by_chance(outcome, ended, limited()) is again


@pytest.mark.parametrize(
    "name, words",
    values_of("""
    "raises", 'faulty_ads.py", line'
    "hangs", "in hangs"
    "segfaults", "Fatal Python error: Segmentation fault"
    "hangs_in_c", "in hangs_in_c"
    "vanishes", "last words before vanishing"
    """),
)
def test_the_log_shows_where_it_happened(outcomes, name, words):
    assert words in outcomes[name].log


def test_what_a_case_prints_is_its_own_log_bounded_and_never_on_our_stdout(outcomes, capfd):
    log = outcomes["chatters"].log
    assert "xxxx" in log
    assert "zzzz" in log
    assert "bytes left out" in log
    assert len(log) < 20_000
    assert all(
        not outcome.log for key, outcome in outcomes.items() if key.startswith("front_vehicle")
    )
    (outcome,) = run_cases(cases_of("faulty_ads.py:chatters"), limited(workers=1))
    assert outcome.status == "collision"
    assert capfd.readouterr() == ("", "")


def test_no_child_is_left_and_no_zombie():
    outcomes = run_cases(cases_of("idm", 6), limited(workers=2))
    next(outcomes)
    assert _pool_children()
    outcomes.close()
    assert not _pool_children()


def _pool_children():
    """Processes that multiprocessing's fork server has made for this process."""
    from multiprocessing import forkserver

    server = forkserver._forkserver._forkserver_pid
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == server:
            found.append(int(path.parent.name))
    return found


def test_the_least_memory_that_is_accepted_is_enough():
    with refusal("must be at least 512"):
        RunSettings(memory_limit=511.0)
    (outcome,) = run_cases(cases_of("idm"), limited(memory_limit=512.0))
    assert outcome.status == "ok"


@pytest.mark.parametrize(
    "ads, share, cases", [("PrintsPid", 2, [2, 2, 1]), ("PrintsPidBesideAThread", 5, [1] * 5)]
)
def test_a_child_is_replaced_after_its_share_or_a_thread(ads, share, cases):
    setup = limited(workers=1, cases_per_child=share)
    pids = [outcome.log for outcome in run_cases(cases_of(f"faulty_ads.py:{ads}", 5), setup)]
    assert [pids.count(pid) for pid in dict.fromkeys(pids)] == cases
    assert str(os.getpid()) not in pids


@pytest.mark.parametrize("ads", ["interrupts", "InterruptsWhenMade"])
@pytest.mark.parametrize("number", [1, 2])
def test_ctrl_c_ends_the_serial_engine(ads, number):
    with pytest.raises(KeyboardInterrupt):
        list(run_cases(cases_of(f"faulty_ads.py:{ads}", number), limited(engine="serial")))
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_shipped_ads_with_an_entry_runs_no_users_code():
    assert affinity_of_ads("reg157?batch=false", limited()) == affinity_of_ads("idm", limited())
    assert affinity_of_ads("mine.py:Ads?batch=false", limited()).startswith("ADS `mine.py:Ads")


def test_stopping_lets_running_cases_end_and_begins_no_more():
    setup = limited(workers=2, cases_per_pack=1)
    asked = []

    def stopping():
        asked.append(True)
        return len(asked) > 5

    assert sum(map(len, run_batches(cases_of("idm", 50), setup, stopping))) == 5


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere children are spawned")
def test_warming_up_begins_the_process_that_makes_the_children_and_they_come_from_it():
    code = (
        "from multiprocessing import forkserver\n"
        "from sumo_eval.record.children import child_context, warm_up\n"
        "if __name__ == '__main__':\n"
        "    warm_up()\n"
        "    begun = forkserver._forkserver._forkserver_pid\n"
        "    child = child_context().Process(target=print, args=('a child',))\n"
        "    child.start()\n"
        "    child.join()\n"
        "    assert begun is not None and begun == forkserver._forkserver._forkserver_pid\n"
        "    assert child.exitcode == 0\n"
    )
    assert python(code).stdout == "a child\n"


def imported(number, error=None):
    """Imports amid which a signal comes."""
    with heard():
        signal.raise_signal(number)
        if error is not None:
            raise error


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere children are spawned")
def test_two_threads_that_start_children_leave_the_script(monkeypatch):
    script = sys.modules["__main__"]
    begun, both = [], threading.Event()

    def begin():
        begun.append(None)
        if len(begun) == 2:  # without a lock at once, and left after the first thread
            both.set()
            first.join()
        both.wait(0.2)

    monkeypatch.setattr(children, "_begin_forkserver", begin)
    first, second = (threading.Thread(target=children.warm_up) for _ in range(2))
    first.start()
    second.start()
    second.join()
    left = sys.modules["__main__"]
    sys.modules["__main__"] = script
    assert left is script


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_amid_imports_is_raised_when_they_are_done(number):
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt):
        imported(number)
    with pytest.raises(ImportError):  # what goes wrong by itself comes first
        imported(number, ImportError)
    assert signal.getsignal(number) is before


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere children are spawned")
def test_ctrl_c_while_the_simulator_is_being_loaded_shows_no_traceback(tmp_path):
    command = [sys.executable, "-m", "sumo_eval", "run", "--out", str(tmp_path / "run")]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as running:
        family = Path(f"/proc/{running.pid}/task/{running.pid}/children")
        # the process that makes the children, and the one that watches it
        while len(family.read_text().split()) < 2:
            clock.sleep(0.01)
        clock.sleep(0.1)  # it has begun to import
        os.killpg(running.pid, signal.SIGINT)
        _, said = running.communicate(timeout=60)
    # Python ends itself by the signal where it came amid the making of a dataclass; a shell says
    # 130 of that, too.
    assert running.returncode in (130, -signal.SIGINT)
    assert "Traceback" not in said
    assert "Stopped" in said


def test_a_child_imports_no_more_than_it_needs():
    # Every child of every run pays for it: numpy, libsumo and numba, whose loops drive, and none of
    # the packages that only scoring needs. numba imports scipy's outermost package, which holds
    # nothing.
    code = (
        "import sys, sumo_eval.record.worker, sumo_eval.ads.lane_changer\n"
        "import sumo_eval.drivers.synthetic.driver\n"
        "heavy = {'pandas', 'sklearn', 'pydantic', 'covertable', 'fmpy', 'plotly', 'jinja2'}\n"
        "heavy |= {f'scipy.{part}' for part in ('linalg', 'optimize', 'sparse', 'spatial', "
        "'special', 'stats')}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    python(code)
