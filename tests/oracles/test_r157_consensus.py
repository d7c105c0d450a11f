"""`careful_driver`, through SUMO, where every independent reading of the regulation's human agrees."""

from __future__ import annotations

import random

import pytest
from r157_cases import Row, collides, of_row, table

KNOWN = {
    # clear by 0.03 m in the tables' continuous time; the build-up of the vehicle model's brakes costs 0.1 m
    ("decel", "90", "1.5", "0.8"),
    # below 5 m/s2 the lead's braking is no event; it becomes one as the approach needs 3 m/s2, seen one step later
    ("decel", "40", "0.8", "0.4"),
}
"""The rows of disagreement, each with its reason."""


def disagreements(kind: str, rows: list[Row]) -> set[tuple[str, ...]]:
    return {
        (kind, *list(row.values())[:-1])
        for row in rows
        if collides(of_row(kind, row), "careful_driver") != (row["crash"] == "1")
    }


@pytest.mark.parametrize(("kind", "count"), [("cut_in", 150), ("cut_out", 100), ("decel", 100)])
def test_the_careful_driver_agrees_on_a_sample(kind, count):
    rows = random.Random(157).sample(table(f"consensus_cc_{kind}.csv"), count)
    assert disagreements(kind, rows) <= KNOWN


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["cut_in", "cut_out", "decel"])
def test_the_careful_driver_agrees_on_all_rows(kind):
    rows = table(f"consensus_cc_{kind}.csv")
    found = disagreements(kind, rows)
    assert found == {row for row in KNOWN if row[0] == kind}
    assert len(found) <= 0.01 * len(rows)
