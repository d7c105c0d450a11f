"""The order of the files: those that take longest begin first, so that no process waits long for another at the end."""

from __future__ import annotations

import pytest

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
