"""Recorded people beside bad driving in their own concrete scenarios: what D and H make of them
(docs/trust.md)."""

import pytest
from drivers.real_data import HUMAN, needs_recordings
from loaded import load
from tables import rows_of

pytestmark = [pytest.mark.campaign, needs_recordings]


@pytest.fixture(scope="module")
def tool():
    return load("tools/people_evidence.py")


@pytest.fixture(scope="module")
def table(tool):
    pytest.importorskip("duckdb")
    return tool.evidence(tool.recorded_people(HUMAN), seed=1)


def test_recorded_people_have_the_d_of_a_driver_left_out(table):
    assert (table["who"] == "recorded person").sum() == 80
    means = table.groupby("who")["D"].mean()
    assert means["recorded person"] >= 0.95 * means["left out"]


@pytest.mark.parametrize(
    "who, least",
    rows_of(
        """
brakes hard | 0.9
crawls | 0.9
tailgates at 0.2 s | 0.8
tailgates at 0.3 s | 0.8
swerves at a TTC of 1.5 s | 0.8
swerves at a TTC of 1 s | 0.8
""",
        str,
        float,
    ),
)
def test_h_tells_bad_driving_from_people(tool, table, who, least):
    assert (table["who"] == who).sum() >= 40
    assert tool.areas(table, "H")[who] >= least


def test_driving_through_the_lead_is_less_human_than_all_drivers(table):
    people = table.loc[table["who"] == "recorded person", "H"]
    through = table.loc[table["who"] == "drives through its leader", "H"]
    assert len(through) >= 40
    assert through.max() < people.min()


def test_the_papers_d_alone_does_not_tell_these(tool, table):
    """Why H has a plausibility and the mixture: in the paper's mode D puts all four above
    people."""
    found = tool.areas(table, "D")
    for who in ("tailgates at 0.3 s", "swerves at a TTC of 1.5 s", "drives through its leader"):
        assert found[who] < 0.5
