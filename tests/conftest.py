"""How all tests run: in which order, and each process on one core, as the commands do.

Files that take longest begin first, so that no process waits long for another at the end. Processes whose linear
algebra takes all cores wait for each other in circles: together they took nearly twice as long.
"""

from __future__ import annotations

import os
import tempfile

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
