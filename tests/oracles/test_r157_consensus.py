"""`careful_driver`, through SUMO, where every independent reading of the regulation's human
agrees."""

import random

import pytest
from r157_cases import collides, of_row, table


def disagreements(kind, rows):
    return {
        (kind, *list(row.values())[:-1])
        for row in rows
        if collides(of_row(kind, row), "careful_driver") != (row["crash"] == "1")
    }


@pytest.mark.parametrize("kind, count", [("cut_in", 60), ("cut_out", 40), ("decel", 40)])
def test_the_careful_driver_agrees_on_a_sample(kind, count):
    rows = random.Random(157).sample(table(f"consensus_cc_{kind}.csv"), count)
    assert not disagreements(kind, rows)


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["cut_in", "cut_out", "decel"])
def test_the_careful_driver_agrees_on_all_rows(kind):
    assert not disagreements(kind, table(f"consensus_cc_{kind}.csv"))
