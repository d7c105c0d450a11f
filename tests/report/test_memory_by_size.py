"""What the process that scores and reports holds of a case: at most what a million of them may take
in 500 MB."""

import tracemalloc
from functools import lru_cache

import pytest
from loaded import load
from tables import in_campaign

from sumo_eval import case_table as tables
from sumo_eval.scoring.confidence import resamples
from sumo_eval.scoring.steps import POINTS_AT_ONCE

MANY, MOST = 1_000_000, 500.0  # cases, and MB that they may take
# of these, for Python, for what it imports, and for buffers whose size does not hang on the cases
FIXED = 200.0
# cases: two chunks of rows are held while one is read
SMALL, LARGE = 3 * POINTS_AT_ONCE, 7 * POINTS_AT_ONCE
LONG = ("cases.csv", "junit.xml", "ledgers", "terminal")
OF_ROWS_ALONE = (
    "scores", "intervals of 20 replicates", "preventability", "people", "why", "found cases",
    *(in_campaign(name) for name in LONG),
)  # fmt: skip


SIZES = load("tools/run_sizes.py")  # makes rows up and names what is made of them


@pytest.fixture
def small_buffers(monkeypatch):
    """What is held at any number of cases is made small, so that a few of them fill it already."""
    monkeypatch.setattr(tables, "records_of", lru_cache(2)(tables.records_of.__wrapped__))
    monkeypatch.setattr(resamples, "AT_ONCE", 64_000)


@pytest.fixture(scope="module")
def made_up(tmp_path_factory):
    place = tmp_path_factory.mktemp("sizes")
    for cases in (SMALL, LARGE):
        SIZES.made_up_run(place / str(cases), cases)
    return {cases: place / str(cases) for cases in (SMALL, LARGE)}


@pytest.mark.usefixtures("small_buffers")
@pytest.mark.parametrize("name", OF_ROWS_ALONE)
def test_law_no_part_holds_more_of_a_case_than_a_million_cases_allow(name, made_up, tmp_path):
    def make(cases):
        SIZES.PARTS[name](SIZES.of_rows_alone(made_up[cases], cases), tmp_path)

    def most(cases):
        tracemalloc.start()
        try:
            make(cases)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    make(SMALL)  # what is imported, compiled or kept at the first use
    assert (most(LARGE) - most(SMALL)) / (LARGE - SMALL) <= (MOST - FIXED) * 1e6 / MANY, (
        "bytes a case"
    )


@pytest.mark.campaign
@pytest.mark.parametrize(
    "name", [name for name in SIZES.PARTS if name != "intervals of 20 replicates"]
)
def test_law_a_million_cases_fit_into_memory(name, campaign_folder):
    """The line through what a process of its own holds at most at two sizes, both beyond every
    buffer."""
    small, large = (
        SIZES.measured(campaign_folder, cases, name)["most"] for cases in (40_000, 120_000)
    )
    assert large + (large - small) / 80_000 * (MANY - 120_000) <= MOST, (
        f"MB: {small} at 40,000, {large} at 120,000"
    )


@pytest.fixture(scope="module")
def campaign_folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("sizes")
    for cases in (40_000, 120_000):
        SIZES.prepare(place, cases)
    return place
