"""How all tests run: in which order, and each process on one core, as the commands do.

Files that take longest begin first, so that no process waits long for another at the end. Processes whose linear
algebra takes all cores wait for each other in circles: together they took nearly twice as long.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

STATE = tempfile.TemporaryDirectory(prefix="sumo_eval_state_")
os.environ["XDG_STATE_HOME"] = STATE.name  # notes on the runs of tests are nobody's
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything imports numpy

LONG = (
    "golden/",
    "record/test_cluster",
    "record/test_resume",
    "wheel/",
    "test_evaluation",
    "scenario/test_sumo_network",
    "cli/",
    "campaign/",
    "record/",
    "docs/",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def place(item: pytest.Item) -> int:
        return next((number for number, name in enumerate(LONG) if item.nodeid.startswith(f"tests/{name}")), len(LONG))

    items.sort(key=place)


@pytest.fixture(scope="session")
def _standard_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from standard_run import recorded_once  # only where a test asks for it: it imports the package

    base = tmp_path_factory.getbasetemp()
    return recorded_once((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "standard")


@pytest.fixture
def standard_run_read_only(_standard_run: Path) -> Iterator[Path]:
    """The run folder that all tests share (see tests/standard_run.py): a test that changes it fails."""
    from standard_run import state

    before = state(_standard_run)
    yield _standard_run
    assert state(_standard_run) == before, "a test of this session wrote to the shared run: use `standard_run`"


@pytest.fixture
def standard_run(_standard_run: Path, tmp_path: Path) -> Path:
    """A copy of the shared run for one test to write to; times of the files are those of the original."""
    return Path(shutil.copytree(_standard_run, tmp_path / "standard_run"))
