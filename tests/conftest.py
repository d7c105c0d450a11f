"""How all tests run: in which order, on how many cores and examples each."""

import gc
import json
import os
import random
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

STATE = tempfile.TemporaryDirectory(prefix="sumo_eval_state_")
os.environ["XDG_STATE_HOME"] = STATE.name  # notes on the runs of tests are nobody's
# Processes whose linear algebra takes all cores wait for each other in circles: together they took
# twice as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything imports numpy

TESTS = Path(__file__).resolve().parent
DURATIONS = Path(__file__).with_name("durations.json")
NEW = 5.0  # s, of a file that has not been measured
settings.register_profile("suite", max_examples=25, derandomize=True, deadline=None)
settings.register_profile("campaign", settings.get_profile("suite"), max_examples=500)
settings.load_profile("suite")


def pytest_addoption(parser):
    parser.addoption(
        "--shuffle",
        metavar="SEED",
        help="files, and the tests of each, in the random order of a seed",
    )


def pytest_configure(config):
    """Let each test process begin with another folder, so that it reads what the others have
    compiled."""
    gc.disable()  # until all is collected: nothing of it goes
    process = getattr(config, "workerinput", None)
    if process is not None and [Path(argument).resolve() for argument in config.args] == [TESTS]:
        parts = sorted(
            str(path) for path in TESTS.iterdir() if path.is_dir() or path.match("test_*.py")
        )
        first = len(parts) * int(process["workerid"][2:]) // process["workercount"]
        config.args = parts[first:] + parts[:first]


def pytest_collection_modifyitems(config, items):
    """Let the files that take longest begin first, so that no process waits long for another at the
    end."""
    seed = config.getoption("shuffle")
    if seed is not None:
        chance = random.Random(seed)  # the same in every test process
        items.sort(key=lambda item: item.nodeid)
        chance.shuffle(items)
        files = {file: chance.random() for file in sorted({_file(item) for item in items})}
        items.sort(key=lambda item: files[_file(item)])
    else:
        seconds = json.loads(DURATIONS.read_text()) if DURATIONS.is_file() else {}
        items.sort(key=lambda item: (-seconds.get(_file(item), NEW), _file(item)))


def pytest_collection_finish():
    """Leave what the tests are made of out of every look for garbage."""
    gc.enable()
    gc.collect()
    gc.freeze()


def _file(item):
    return item.nodeid.partition("::")[0]


@pytest.fixture
def own_path(monkeypatch):
    """What a test adds to the places of modules is gone after it."""
    monkeypatch.setattr(sys, "path", list(sys.path))
