"""The rules that are compiled over rows: what may stand in them, and that compiling changes no
bit."""

import ast
import hashlib
import importlib
import itertools
import os
import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import python
from road_scenes import points
from tables import in_campaign

import sumo_eval
from sumo_eval import kernels
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.world import World
from sumo_eval.drivers.synthetic.driver import human_controller
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import CHANNELS

PACKAGE = Path(sumo_eval.__file__).parent
ADS = ("idm", "attentive", "lane_changer", "careful_driver", "careful_driver_aeb", "fsm", "rss",
    "reg157",
       "eu_2022_1426", "eu_2022_1426_bus", "no_reaction", "ideal_braking", "people")  # fmt: skip
SCENARIOS = {
    "cut_in": 331,
    "front_vehicle_cut_out": 67,
    "front_vehicle_braking": 97,
    "ncap_ccrb": 23,
    "curve_cut_in": 130,
}
SETTINGS = SimulationSettings(step=0.1, end_when_decided=True)


def controllers(ads, cases):
    """An ADS, or a driver for each case."""
    if ads != "people":
        return ads
    return [human_controller(number % 10, 10, 1, concrete) for number, concrete in enumerate(cases)]


def everything(recording):
    """All of a recording that is no wall time, to the last bit."""
    vehicles = {"ego": recording.ego, **recording.actors}
    channels = b"".join(
        getattr(it, channel).tobytes() for it in vehicles.values() for channel in CHANNELS
    )
    return (
        repr((recording.end_reason, recording.error, recording.collision, recording.clips)).encode()
        + channels
    )


def digest(ads, sparse):
    """What an ADS does in a few cases of every kind of script;

    sparse: of so many points one is driven.
    """
    found = hashlib.sha256()
    for name, every in SCENARIOS.items():
        cases = points(name, sparse * every)
        for recording in simulate_many(cases, controllers(ads, cases), SETTINGS):
            found.update(everything(recording))
    return found.hexdigest()


# -- what may stand in a kernel --------------------------------------------------------------------


MARKS = ("kernel", "rows", "compiled_rows")


def kernels_of(path):
    text = path.read_text()
    if not any(f"@{mark}\n" in text for mark in MARKS):
        return []
    functions = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
    return [
        it
        for it in functions
        if any(isinstance(mark, ast.Name) and mark.id in MARKS for mark in it.decorator_list)
    ]


KERNELS = {
    path.relative_to(PACKAGE).as_posix(): found
    for path in sorted(PACKAGE.rglob("*.py"))
    if (found := kernels_of(path))
}


def test_there_are_kernels():
    assert sum(map(len, KERNELS.values())) > 100


@pytest.mark.parametrize("file", KERNELS)
def test_a_kernel_holds_nothing_that_compiles_to_other_bits_or_not_at_all(file):
    """`x ** 2` and math.hypot differ in the last bit; remainder and fmod, raise and try do not
    compile or lose rows."""
    for node in (node for function in KERNELS[file] for node in ast.walk(function)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            power = node.right.value if isinstance(node.right, ast.Constant) else None
            assert not isinstance(power, int), (node.lineno, "integer power")
            assert power not in (2.0, 0.5), (node.lineno, "a power that is a product or a root")
        if isinstance(node, ast.Attribute):
            assert node.attr not in ("hypot", "remainder", "fmod"), (node.lineno, node.attr)
        raises = isinstance(node, ast.Raise | ast.Try | ast.Assert)
        assert not raises, (node.lineno, "a kernel does not raise: a row would cost all")


# -- bits ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ads", ADS)
def test_a_case_alone_has_the_bits_that_it_has_beside_others(ads):
    for name, every in SCENARIOS.items():
        cases = points(name, every)
        drivers = controllers(ads, cases)
        together = list(simulate_many(cases, drivers, SETTINGS))
        for number in range(0, len(cases), 5):
            its_own = drivers if isinstance(drivers, str) else drivers[number]
            assert everything(simulate(cases[number], its_own, SETTINGS)) == everything(
                together[number]
            )


needs_numba = pytest.mark.skipif(kernels.INTERPRETED, reason="nothing is compiled")


@pytest.mark.skipif(kernels.INTERPRETED, reason="this is the interpreted run")
@pytest.mark.parametrize(
    "sparse, drivers",
    [(8192, ("lane_changer", "people")), in_campaign(4, ADS)],
)
def test_interpreted_and_compiled_rules_drive_alike_to_the_bit(sparse, drivers):
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_kernels as it; "
        f"print(*(it.digest(ads, {sparse}) for ads in {drivers}))"
    )
    environment = {**os.environ, "SUMO_EVAL_INTERPRETED": "1"}
    assert python(script, Path(__file__).parent, env=environment).stdout.split() == [
        digest(ads, sparse) for ads in drivers
    ]


class OnTraci:
    """A baseline that its user has wrapped: it sees the case through TraCI."""

    def __init__(self):
        self.inner = load_controller("idm").target

    def reset(self, scenario, traci, ego):
        self.inner.reset(scenario, traci, ego)

    def step(self, traci, ego, time):
        return self.inner.step(traci, ego, time)


def leaving(name):
    """Why the case ends in which the lead drives beyond the road's end after 2 s."""
    case = points(name, 997)[0]
    lead = case.actors[0]
    start = replace(lead.start, x=case.road.end - 30.0, speed=20.0)
    recording = simulate(replace(case, actors=(replace(lead, start=start),)), OnTraci)
    return recording.end_reason, recording.error


@pytest.mark.skipif(kernels.INTERPRETED, reason="this is the interpreted run")
def test_interpreted_baseline_on_traci_drives_on_after_an_actor_has_left():
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_kernels as it; "
        "print(*it.leaving('front_vehicle_braking'), *it.leaving('curve_braking'))"
    )
    environment = {**os.environ, "SUMO_EVAL_INTERPRETED": "1"}
    interpreted = python(script, Path(__file__).parent, env=environment).stdout
    assert interpreted.split() == 2 * ["time_limit", "None"]


# -- machine code ----------------------------------------------------------------------------------


@pytest.mark.campaign  # compiles all that the run needs, once more
@needs_numba
def test_small_evaluation_scores_alike_without_borrowed_insides(tmp_path):
    (tmp_path / "small.toml").write_text(
        'name = "small"\n[[scenario]]\nuse = '
        '"front_vehicle_low_speed"\n[scenario.sampling]\nlevels = 2\n'
        '[[ads]]\nname = "idm"\ncontroller = "idm"\n[drivers]\ncount = 2\n'
    )
    for plain in ("", "1"):
        command = [sys.executable, "-m", "sumo_eval", "run", "small.toml", "--out", f"run{plain}"]
        environment = {**os.environ, "SUMO_EVAL_PLAIN": plain}
        subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True)
    assert (tmp_path / "run" / "scores.json").read_bytes() == (
        tmp_path / "run1" / "scores.json"
    ).read_bytes()


@needs_numba
def test_every_loop_is_compiled_for_one_kind_of_arguments():
    """Another type of array compiles a loop again: one and three other vehicles, one case and many
    are one type."""
    for name in ("cut_in", "front_vehicle_cut_out"):
        cases = points(name, 997)
        for ads in ADS:
            assert list(simulate_many(cases, controllers(ads, cases), SETTINGS))
    rules = importlib.import_module("sumo_eval.cosim.step_rules")
    for loop in (rules.begin_rows, rules.move_rows, rules.see_rows):
        assert len(loop.compiled.signatures) == 1, loop.__name__


@kernels.rows
def _grow(values, by):
    """A loop that is compiled in a moment; what it does has a last bit to get wrong."""
    for i in range(len(values)):
        values[i] = 0.1 * values[i] * values[i] * values[i] + by
    return len(values)


@needs_numba
def test_a_bound_loop_has_the_bits_of_the_plain_call():
    """Who calls bound code says of which arrays it is: those of another type or layout must get
    code of their own."""
    numbers = np.random.default_rng(5).normal(size=50)
    wide = np.repeat(numbers, 2)
    codes = []
    for values in (numbers, numbers.astype(np.float32), wide[::2]):
        plain, by_code = values.copy(), values.copy()
        if not values.flags.contiguous:
            plain, by_code = wide.copy()[::2], wide.copy()[::2]
        code = kernels.bound(_grow, by_code, 0.7)
        assert code(by_code, 0.7) == 50
        assert _grow(plain, 0.7) == 50
        assert by_code.tobytes() == plain.tobytes() != values.tobytes()
        assert (
            kernels.bound(_grow, values[:5] if values.flags.contiguous else wide[:10:2], -1.0)
            is code
        )
        codes.append(code)
    assert len(set(codes)) == 3


def test_what_is_bound_where_nothing_is_compiled_is_the_loop_itself():
    def loop(values):
        return len(values)

    assert kernels.bound(loop, np.zeros(2)) is loop


def test_machine_code_of_other_sources_lies_elsewhere(tmp_path, monkeypatch):
    """numba looks at the loop's own file and its place; an edited rule in another file must not go
    on as before."""
    before = kernels.cache_folder()
    copy = tmp_path / "sumo_eval"
    for room in kernels._ROOMS:
        for path in [PACKAGE / room] if room.endswith(".py") else (PACKAGE / room).rglob("*.py"):
            there = copy / path.relative_to(PACKAGE)
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(path.read_bytes())
    monkeypatch.setattr(kernels, "_PACKAGE", copy)
    kernels.cache_folder.cache_clear()
    copied = kernels.cache_folder()
    assert copied != before
    rule = copy / "ads" / "perception.py"
    rule.write_text(rule.read_text() + "# another\n")
    kernels.cache_folder.cache_clear()
    assert kernels.cache_folder() not in (copied, before)
    monkeypatch.undo()
    kernels.cache_folder.cache_clear()


def test_records_are_written_back_when_a_loop_is_interpreted():
    def loop(rows, times):
        for i in range(len(rows)):
            rows[i].before.x += times[i]
            rows[i].told = i

    rows = World(points("cut_in", 997), SETTINGS).others[:, 0].copy()
    expected = rows["before"]["x"] + 1.0
    kernels._interpreted(loop)(rows, np.ones(len(rows)))
    assert rows["before"]["x"].tolist() == expected.tolist()
    assert rows["told"].tolist() == list(range(len(rows)))


# -- code on disk ----------------------------------------------------------------------------------


def found_on_disk():
    """Whether a process that begins now finds the small loop's machine code; else it has compiled
    and kept it."""
    loop = kernels.rows(_grow.__wrapped__)
    values = np.array([1.0, 2.0])
    assert loop(values, 0.5) == 2
    assert values.tolist() == [0.1 * 1.0 + 0.5, 0.1 * 2.0 * 2.0 * 2.0 + 0.5]
    return bool(loop.compiled.stats.cache_hits)


SPOILT = (
    "cut",
    "bits",
    "more",
    "text",
    "pipe",
    "link",
    "loop",
    "device",
    "unreadable",
    "sealed",
    "seal",
)


def spoil(path, how, draw):
    """Make anything of a file of machine code that may become of one."""
    content = bytearray(path.read_bytes())
    if how in ("pipe", "link", "loop", "device"):
        path.unlink()
        places = {"link": "nowhere", "loop": path, "device": "/dev/zero"}
        os.mkfifo(path) if how == "pipe" else path.symlink_to(places[how])
    elif how == "unreadable":
        path.chmod(0)
    elif how in ("sealed", "seal"):
        noise = draw.randbytes(len(content)) if how == "sealed" else b""
        path.write_bytes(hashlib.sha256(noise).digest() + noise)
    elif how == "text":
        path.write_text("a note saved under this name " * draw.randint(1, 1000))
    else:
        for _ in range(draw.randint(1, 50) if how == "bits" else 0):
            content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
        cut = draw.randrange(len(content)) if how == "cut" else len(content)
        path.write_bytes(
            bytes(content[:cut]) + draw.randbytes(draw.randint(1, 99) if how == "more" else 0)
        )


@needs_numba
@pytest.mark.parametrize("seeds", [range(1), in_campaign(range(1, 10))])
def test_whatever_becomes_of_machine_code_is_compiled_again(tmp_path, monkeypatch, seeds):
    """A fuzz of the compile cache."""
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path)
    found_on_disk()
    for seed, how in itertools.product(seeds, SPOILT):
        (file,) = tmp_path.iterdir()
        spoil(file, how, random.Random(seed))
        found_on_disk()  # the numbers are right
        assert found_on_disk() or not file.is_file(), (seed, how)
        if not file.is_file():
            file.unlink()
            found_on_disk()


@needs_numba
@pytest.mark.parametrize("place", ["a file", "a folder of that name", "closed"])
def test_code_that_cannot_be_kept_is_compiled_in_each_process(tmp_path, monkeypatch, place):
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path / "kernels")
    if place == "a file":
        (tmp_path / "kernels").write_bytes(b"")
    elif place == "closed":
        tmp_path.chmod(0o500)
        monkeypatch.setattr(os, "replace", refused)  # nothing is closed to root
    else:
        assert not found_on_disk()
        (file,) = (tmp_path / "kernels").iterdir()
        file.unlink()
        file.mkdir()
    assert [found_on_disk(), found_on_disk()] == [False, False]
    tmp_path.chmod(0o700)


def refused(*_):
    """What a closed folder answers."""
    raise PermissionError


@needs_numba
def test_processors_pythons_and_numbas_keep_their_code_apart(monkeypatch):
    folders = {kernels.cache_folder.__wrapped__()}
    monkeypatch.setattr(kernels.sys, "version", "3.99")
    folders.add(kernels.cache_folder.__wrapped__())
    monkeypatch.setattr(kernels, "_processor", lambda: "another")
    folders.add(kernels.cache_folder.__wrapped__())
    monkeypatch.setattr(kernels.importlib.metadata, "version", lambda name: "0.0")
    folders.add(kernels.cache_folder.__wrapped__())
    assert len(folders) == 4


@needs_numba
@pytest.mark.campaign
def test_processes_that_compile_at_once_keep_whole_files(tmp_path):
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import numpy as np; import test_kernels as "
        "it\n"
        "print(it._grow(np.ones(2, sys.argv[2]), 0.5), len(it._grow.compiled.stats.cache_hits), "
        "end=' ')\n"
        "print('numba.np.arraymath' in sys.modules)"
    )

    def begin(kind):
        return subprocess.Popen(
            [sys.executable, "-c", script, str(Path(__file__).parent), kind],
            stdout=subprocess.PIPE, text=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        )  # fmt: skip

    kinds = ["float64", "float32"]
    # to load takes nothing that numba imports to compile
    for hits, has_compiled in ((0, True), (1, False)):
        answers = [
            process.communicate(timeout=300)[0] for process in [begin(kind) for kind in kinds]
        ]
        assert answers == [f"2 {hits} {has_compiled}\n"] * 2


TWO_RULES = """
import math, sys
import numpy as np
from sumo_eval.kernels import kernel, rows

def loop_of(number):
    @kernel
    def rule(x):  # too long to be put into the loop
        for n in range(9):
            x += math.sin(x) + math.cos(x * n) + math.exp(-x * x) + math.atan2(x, n + 1.0)
            if x > 3.0:
                x = math.sqrt(x) + math.tan(x) + math.sinh(x / 10.0) + math.tanh(x)
        return 0.0 * x + number
    @rows
    def loop(values):
        for i in range(len(values)):
            values[i] = rule(values[i]) + 0.0 * rule(values[i] + 1.0) + 0.0 * rule(values[i] + 2.0)
    return loop

values = np.zeros(len(sys.argv) - 1)
for i, number in enumerate(sys.argv[1:]):
    loop_of(float(number))(values[i : i + 1])
print(*values)
"""


@needs_numba
def test_rules_compiled_by_two_processes_stay_two(tmp_path):
    (tmp_path / "rules.py").write_text(TWO_RULES)
    for numbers in ("1.0", "2.0", "1.0 2.0"):
        command = [sys.executable, "rules.py", *numbers.split()]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True)
        assert done.stdout.decode().split() == numbers.split()


OF_A_USER = """
import numba, numpy as np
from sumo_eval.record import loops
loops.load(["no_reaction"])

@numba.njit
def even(n): return True if n == 0 else odd(n - 1)
@numba.njit
def odd(n): return False if n == 0 else even(n - 1)
@numba.njit
def of(function, x): return function(x)
@numba.njit
def square(x): return x * x
@numba.vectorize(["float64(float64)"])
def more(x): return x + 1.0
@numba.cfunc("float64(float64)")
def triple(x): return 3.0 * x
@numba.njit
def refuse(x):
    if x > 1: raise ValueError("too much", x)
    return x

assert even(10) and odd(3) and of(square, 3.0) == 9.0 and triple.ctypes(2.0) == 6.0
assert list(more(np.arange(2.0))) == [1.0, 2.0]
try:
    refuse(2)
except ValueError as error:
    assert error.args == ("too much", 2)
"""


@pytest.mark.campaign  # compiles for ten seconds
def test_functions_of_a_users_own_compile_beside_ours():
    python(OF_A_USER)
