"""A hundred thousand rows: what the parent holds does not grow with them."""

import tracemalloc

import pytest
from record.synthetic_store import use

pytestmark = pytest.mark.campaign


def peak(path, rows):
    tracemalloc.start()
    try:
        assert use(path, rows) == (rows, rows, rows // 10)
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def test_the_memory_of_the_parent_is_bounded(tmp_path):
    small, large = peak(tmp_path / "a", 300), peak(tmp_path / "b", 3_000)
    assert large - small < 2.0, (
        "MB for ten times the rows; the numbers of the struck points are all that grows"
    )


def test_the_memory_of_the_parent_is_bounded_at_100_000_rows(tmp_path):
    assert peak(tmp_path / "c", 100_000) < 20.0, "MB"
