"""Columns say of a case what its row says."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import builders
import numpy as np
import pytest

from sumo_eval.method.zone_partition import partition
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.results import CaseResult
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.case_terms import case_terms
from sumo_eval.scoring.kept_rows import Made, arrays, chosen, keys_by_place, name_ranks, names_at, point_numbers
from sumo_eval.scoring.kept_scores import RowWriter
from sumo_eval.scoring.outcome_columns import OutcomeColumns
from sumo_eval.settings import MethodSettings

FLAGS = ("evaluated", "avoidable", "unavoidable", "caused", "voids_index", "counts_for_index")


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[CaseResult]:
    """Every combination of what the rules look at, of one scenario and ADS; a text in some rows alone."""
    spaces = {name: partition(catalogue.load(name)) for name in builders.SCENARIOS}
    row = builders.evaluation(tmp_path_factory.mktemp("rows") / "hand", spaces).cases[0]
    every = product(
        ("safe", "hazardous"), (False, True), (False, True), (None, 0.0, 3.0), (None, 0.0, 3.0),
        ("ok", "collision", "off_road", "timeout"),
    )  # fmt: skip
    return [
        replace(
            row, case=f"c-{number}", zone=zone, collided=collided, struck_from_behind=struck,  # type: ignore[arg-type]
            ideal_severity=ideal, no_reaction_severity=nothing, status=status,
            requirements_missed="late" if number > 200 else None,
        )
        for number, (zone, collided, struck, ideal, nothing, status) in enumerate(every)
    ]  # fmt: skip


def test_columns_hold_by_the_rules_of_the_properties(rows: list[CaseResult]) -> None:
    there = OutcomeColumns.of(rows)
    for name in FLAGS:
        assert getattr(there, name).tolist() == [bool(getattr(row, name)) for row in rows], name
        assert 0 < np.count_nonzero(getattr(there, name)) < len(rows), name
    assert not len(OutcomeColumns.of([]).avoidable)


def test_kept_rows_give_the_columns_of_held_ones_whatever_the_chunks(rows: list[CaseResult], tmp_path: Path) -> None:
    writer = RowWriter(KeptResults(tmp_path), b"key")
    for first in range(0, len(rows), 100):
        writer.add(rows[0].scenario, rows[0].ads, rows[first : first + 100])
    kept = writer.rows(rows[0].ads, rows[0].scenario)
    for name, column in arrays(rows, "status", "ideal_severity", "requirements_missed").items():
        np.testing.assert_array_equal(arrays(kept, name)[name], column)
    method = MethodSettings()
    np.testing.assert_array_equal(case_terms(kept, method).voids, case_terms(rows, method).voids)
    some = chosen(kept, OutcomeColumns.of(kept).avoidable)
    assert list(some) == [row for row in rows if row.avoidable]
    assert list(some[2:4]) == [row for row in rows if row.avoidable][2:4]
    places = np.array([250, 3, 3, 101])
    assert names_at(kept, places).tolist() == [rows[place].case for place in places]
    found = keys_by_place(kept, {rows[250].case, rows[3].case, "nobody"})
    assert list(found.items()) == [(3, rows[3].case), (250, rows[250].case)]
    assert not keys_by_place(kept, [])
    made = Made((some, lambda row, place: (row.case, place)), (kept, lambda row, place: (row.case, place)))
    assert len(made) == len(some) + len(rows)
    assert made[len(some)] == made[-len(rows)] == (rows[0].case, 0)
    assert list(made)[:2] == made[:2] == [(some[0].case, 0), (some[1].case, 1)]
    with pytest.raises(IndexError):
        made[len(made)]


def test_law_ranks_order_cases_as_their_keys_do(rows: list[CaseResult], tmp_path: Path) -> None:
    """Keys that ascend, that do not (`c-10` stands before `c-2`), and that have other letters than ASCII."""
    ascending = [replace(row, case=f"c-{number:04d}") for number, row in enumerate(rows)]
    foreign = [replace(row, case=f"{'äz😀ﬀ'[number % 4]}-{number:04d}") for number, row in enumerate(rows)]
    places = np.array([250, 3, 17, 101, 0])
    for name, some in (("ascending", ascending), ("plain", rows), ("foreign", foreign)):
        writer = RowWriter(KeptResults(tmp_path), name.encode())
        for first in range(0, len(some), 100):
            writer.add(some[0].scenario, some[0].ads, some[first : first + 100])
        for cases in (some, writer.rows(some[0].ads, some[0].scenario)):
            keys = [some[place].case for place in places]
            ranks = name_ranks(cases, places)
            assert [keys[one] for one in np.argsort(ranks)] == sorted(keys), name
    assert not len(name_ranks([], np.empty(0, dtype=np.intp)))


def test_points_have_one_number_in_all_tables(rows: list[CaseResult]) -> None:
    here = [replace(rows[0], values={"a": a, "b": b}) for a, b in ((1.0, 2.0), (2.0, 1.0), (1.0, 2.0))]
    there = [replace(rows[0], values={"b": b, "a": a}) for a, b in ((2.0, 1.0), (3.0, 1.0))]
    first, second = point_numbers([here, there])
    assert first[0] == first[2] != first[1] == second[0]
    assert second[1] not in first
