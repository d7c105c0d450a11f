"""`sumo-eval check` as a user has it: what it prints and its exit status."""

import os
import subprocess
import sys

import pytest
from commands import ROOT, sumo_eval
from tables import values_of


def check(what, folder, *options, status=0):
    return sumo_eval("check", what, *options, cwd=folder, status=status)


@pytest.fixture
def mine(tmp_path):
    """Write mine.py and check something of it."""

    def check_text(text, name="acc", *options, status=0):
        (tmp_path / "mine.py").write_text(text)
        return check(f"mine.py:{name}", tmp_path, *options, status=status)

    return check_text


def test_a_good_controller(mine, tmp_path):
    done = mine("def acc(seen):\n    return -1.0 if seen.lead else 0.0\n")
    assert "mine.py:acc: keeps the contract" in done.stdout
    assert "us a step" in done.stdout
    (tmp_path / "mine.py").write_text("def acc(seen):\n    return -1.0 if seen.lead.gap else 0.0\n")
    assert "FAIL  empty_road (" in check("mine.py:acc", tmp_path, status=1).stdout


def test_a_bad_controller(mine):
    done = mine(
        "memory = []\ndef acc(seen):\n    memory.append(1)\n    return -0.001 * len(memory)\n",
        status=1,
    )
    assert "FAIL" in done.stdout
    assert "-> forget everything in reset, keep state on the object alone" in done.stdout
    assert done.stdout.count("FAIL  ") == done.stdout.count("the second drive differs from") == 1, (
        "a cause is said once"
    )
    assert "FAIL  12 of 12 cases, e.g. front_vehicle_low_speed (" in done.stdout
    assert "mine.py:acc: breaks the contract in 1 point" in done.stdout


@pytest.mark.parametrize("where", ["__init__", "act"])
def test_an_interrupt_by_the_ads_is_reported_as_its_own(mine, where):
    done = mine(
        f"class Mine:\n    def {where}(self, seen=None):\n        raise KeyboardInterrupt\n    "
        "reset = print\n",
        "Mine",
        status=1,
    )
    assert "Traceback" not in done.said
    assert (
        f"FAIL  ADS `mine.py:Mine`: it raised KeyboardInterrupt. At mine.py:3 in {where}."
        in done.stdout
    )


def test_an_exception_is_reported_by_its_place_in_the_users_file(mine):
    done = mine(
        "class Brake:\n    def act(self, seen):\n        return self.brake()\n    def "
        "brake(self):\n"
        "        raise RuntimeError('brake')\n",
        "Brake",
        status=1,
    )
    assert "Traceback" not in done.said
    assert "The ADS raised at 0.00 s: RuntimeError: brake. At " in done.said
    assert "mine.py:5 in brake.\n" in done.said
    assert "loop.py" not in done.said
    assert done.said.count("-> fix what the message names") == 1
    # what a drive that broke off took says nothing of a whole one
    assert "case_timeout" not in done.said


def test_what_a_run_would_lose_to_the_clock_fails(mine):
    """A first step of 0.3 s where 0.1 s are allowed."""
    done = mine(
        "import time\ndef acc(seen):\n    time.sleep(0.3 if seen.time == 0 else 0)\n    return "
        "0.0\n",
        "acc",
        "--step-timeout",
        "0.1",
        status=1,
    )
    assert "FAIL  `run` would lose" in done.said
    assert "cases to step_timeout = 0.1 s" in done.said
    assert "Traceback" not in done.said


def test_a_speed_controller_that_run_drives_is_warned_and_not_failed(mine):
    done = mine("def acc(seen):\n    return (15.0 - seen.ego.speed) / 0.05\n")
    assert "warn  asks for " in done.stdout
    assert "return Command(speed=wanted)" in done.stdout


def test_a_plan_in_the_egos_own_coordinates_is_warned_of(mine):
    done = mine(
        "import sumo_eval\n\ndef plan(seen):\n"
        "    t = [seen.time, seen.time + 5.0]\n"
        "    return sumo_eval.Plan(t, [0.0, 5.0 * seen.ego.speed], [0.0, 0.0], speed=[5.0, 5.0])\n",
        "plan",
    )
    assert "m from its plan" in done.stdout
    assert "-> a Plan is in road coordinates" in done.stdout


def test_an_exception_of_many_lines_is_cut_to_a_few(tmp_path):
    """A constructor, and a step, that raise with the weights of a network in their text."""
    (tmp_path / "mine.py").write_text(
        "WEIGHTS = '\\n'.join('%d 0.123456' % i for i in range(400))\n"
        "class Made:\n    def __init__(self):\n        raise ValueError(WEIGHTS)\n"
        "    def act(self, seen):\n        return 0.0\n"
        "def step(seen):\n    raise ValueError(WEIGHTS)\n"
    )
    made = check("mine.py:Made", tmp_path, status=2)
    assert made.stdout == ""
    assert "making one without arguments failed: ValueError: 0 0.123456" in made.stderr
    assert len(made.stderr.splitlines()) < 5
    assert len(made.stderr) < 1000
    driven = check("mine.py:step", tmp_path, status=1)
    assert driven.stdout.count("The ADS raised at 0.00 s: ValueError") == 1
    assert "12 of 12 cases, e.g. " in driven.stdout
    assert len(driven.stdout.splitlines()) < 6
    assert "left out]. At mine.py:8 in step." in driven.stdout


@pytest.mark.parametrize("method", ["run_step", "compute_planner_trajectory", "predict"])
def test_a_class_of_another_tool_gets_advice_on_act(mine, method):
    done = mine(
        f"class Agent:\n    def {method}(self, data):\n        return 0.0\n", "Agent", status=2
    )
    assert f"It has `{method}`, as " in done.stderr
    assert "put it in a class with `act(observation)` that calls it" in done.stderr


def test_what_cannot_be_loaded_is_refused(tmp_path):
    done = check("mine.py:acc", tmp_path, status=2)
    assert done.stdout == ""
    assert done.stderr.startswith("sumo-eval: ADS `mine.py:acc`: There is no file")
    (tmp_path / "mime.py").touch()
    assert "mime.py`?" in check("mine.py:acc", tmp_path, status=2).stderr
    for name, near in (("cutin", "cut_in"), ("idn", "idm")):
        assert f"`{near}`?" in check(name, tmp_path, status=2).stderr


def test_last_words_of_an_ads_that_ends_on_import_are_shown(mine):
    done = mine("import sys\nprint('no licence')\nsys.exit(1)\n", "acc", status=2)
    assert done.stderr.endswith("failed: SystemExit: 1.\nIt printed:\nno licence\n")


GOOD = (
    'name = "x"\n[[scenario]]\nuse = "front_vehicle_low_speed"\n[[ads]]\nname = "a"\ncontroller = '
    '"{}"\n'
)


@pytest.mark.parametrize(
    "controller, status, words",
    values_of("""
    "idm", 0, "ok    ADS a: idm"
    "idn", 2, "Did you mean `idm`?"
    "mine.py:Nothing", 2, "an object with a `step` method, got Nothing"
    "mine.py:Loads", 2, "TypeError: missing a required argument: 'weights'"
    "mine.py:Late", 0, "ok    ADS a: mine.py:Late"
    """),
)
def test_an_evaluation_file(tmp_path, controller, status, words):
    (tmp_path / "mine.py").write_text(
        "class Nothing:\n    pass\n\n"
        "class Loads:\n    def __init__(self, weights):\n        self.act = print\n\n"
        "class Late:\n    def __init__(self):\n        self.act = print\n"
    )
    (tmp_path / "e.toml").write_text(GOOD.format(controller))
    done = check("e.toml", tmp_path, status=status)
    assert words in done.said
    assert "scenario front_vehicle_low_speed: 19 points of ego_speed, lead_speed" in done.said


@pytest.mark.parametrize(
    "body, words",
    [
        ("    os._exit(7)", "The process that drove it died with exit code 7."),
        ("    os.closerange(3, 100)", "The process that drove it"),
        ("    [shout(n) for n in range(3, 20)]", "something that is not a result"),
    ],
)
def test_an_ads_that_ends_or_overwrites_the_process_it_is_checked_in_is_a_finding(
    mine, body, words
):
    done = mine(
        "import os, stat\n\n"
        "def shout(n):\n    try:\n        if stat.S_ISFIFO(os.fstat(n).st_mode):\n"
        "            os.write(n, b'x' * 50)\n    except OSError:\n        pass\n\n"
        f"def acc(seen):\n{body}\n    return 0.0\n",
        status=1,
    )
    assert words in done.stdout
    # the child's own traceback, as its words
    assert not done.stderr or done.stderr.startswith("It printed:")


def test_a_shipped_scenario_is_checked_by_its_name_without_a_fit(tmp_path, monkeypatch):
    def fit(*_):
        raise AssertionError("whether zones can be found takes no Gaussian process")

    monkeypatch.setattr("sumo_eval.method.zone_training.fit", fit)
    done = check("front_vehicle_low_speed", tmp_path)
    assert "Logical scenario `front_vehicle_low_speed`: ego_speed" in done.stdout


def test_a_path_beyond_ascii_works_in_the_locale_c(tmp_path):
    from sumo_eval.scenario.shipped_files import scenario_files

    folder = tmp_path / "Zürich – 東京"
    folder.mkdir()
    file = folder / "völlig_neu.toml"
    file.write_bytes(scenario_files()["front_vehicle_low_speed"].read_bytes())
    plain = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("LC_", "LANG", "PYTHON"))
    }
    done = subprocess.run(
        [sys.executable, "-m", "sumo_eval", "check", os.fsencode(file)],
        cwd=ROOT, check=False,
        env={**plain, "LC_ALL": "C", "LANG": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
        capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"Logical scenario" in done.stdout
