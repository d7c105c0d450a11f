"""A table says of a case what its record says, wherever its columns lie."""

from dataclasses import replace
from itertools import product

import builders
import numpy as np
import pytest
from builders import SCENARIOS

from sumo_eval.case_table import CaseTable, point_numbers
from sumo_eval.cases import ThinReference
from sumo_eval.method.index_terms import IndexNote
from sumo_eval.method.zone_partition import partition
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.scenario import catalogue
from sumo_eval.scoring.kept_scores import KeptScoring

FLAGS = ("evaluated", "avoidable", "unavoidable", "caused", "voids_index", "counts_for_index")


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Every combination of what the rules look at, of one scenario and ADS; a text in some rows
    alone."""
    spaces = {name: partition(catalogue.load(name)) for name in SCENARIOS}
    row = builders.evaluation(tmp_path_factory.mktemp("rows") / "hand", spaces).cases[0]
    every = product(
        ("safe", "hazardous"), (False, True), (False, True), (None, 0.0, 3.0), (None, 0.0, 3.0),
        ("ok", "collision", "off_road", "timeout"),
    )  # fmt: skip
    return [
        replace(
            row, case=f"c-{number}", zone=zone, collided=collided, struck_from_behind=struck,
            ideal_severity=ideal, no_reaction_severity=nothing, status=status,
            requirements_missed="late" if number > 200 else None,
        )
        for number, (zone, collided, struck, ideal, nothing, status) in enumerate(every)
    ]  # fmt: skip


def test_flags_of_a_table_are_those_of_its_records(rows):
    table = CaseTable.of(rows)
    for name in FLAGS:
        assert getattr(table, name).tolist() == [getattr(row, name) for row in rows], name
        assert 0 < np.count_nonzero(getattr(table, name)) < len(rows), name
    np.testing.assert_array_equal(table.incident_severity, [row.incident_severity for row in rows])
    assert not len(CaseTable.of([]).avoidable)


def test_law_columns_and_records_are_the_same_whatever_the_chunks(rows, tmp_path):
    writer = KeptScoring(KeptResults(tmp_path), b"key")
    for first in range(0, len(rows), 100):
        writer.add(rows[first : first + 100])
    kept, held = writer.rows(rows[0].ads, rows[0].scenario), CaseTable.of(rows)
    for name in (
        "case",
        "status",
        "ideal_severity",
        "requirements_missed",
        "collided",
        "index_note",
    ):
        np.testing.assert_array_equal(getattr(kept, name), getattr(held, name))
    assert list(kept) == list(held) == rows
    assert kept[-1] == kept[np.intp(len(rows) - 1)] == rows[-1]
    some = kept[kept.avoidable]
    assert list(some) == [row for row in rows if row.avoidable]
    assert list(some[2:4]) == list(some)[2:4]
    assert some.case.tolist() == [row.case for row in some]
    assert list(kept[np.array([250, 3, 3])]) == [rows[250], rows[3], rows[3]]
    with pytest.raises(IndexError):
        some[len(some)]
    with pytest.raises(AttributeError):
        kept.no_such_column()


def test_rows_come_back_as_they_were(rows):
    odd = [
        replace(
            rows[0], severity=-0.0, error="a ü\ud800 line\n",
            index_note=(IndexNote("two_groups", 3, 7),),
            reference_note=ThinReference(1, 5, None), values={"a b": 1.5, "c": 2.0},
        ),
        replace(rows[1], values={"a b": 0.1 + 0.2, "c": float("inf")}, index=None),
    ]  # fmt: skip
    for some in (odd, odd[:1], [*odd, *rows[:2]]):
        assert list(CaseTable.of(some)) == some
    part = CaseTable.of(odd)[1:]  # no row of which becomes a record
    assert CaseTable.of(part) is part
    assert str(CaseTable.of(odd)[0].severity) == "-0.0"
    np.testing.assert_array_equal(
        CaseTable.of(odd).parameters(["c", "a b"]), [[2.0, 1.5], [np.inf, 0.1 + 0.2]]
    )


def test_points_have_one_number_in_all_tables(rows):
    here = [
        replace(rows[0], values={"a": a, "b": b}) for a, b in ((1.0, 2.0), (2.0, 1.0), (1.0, 2.0))
    ]
    there = [replace(rows[0], values={"b": b, "a": a}) for a, b in ((2.0, 1.0), (3.0, 1.0))]
    first, second = point_numbers([CaseTable.of(here), CaseTable.of(there)])
    assert first[0] == first[2] != first[1] == second[0]
    assert second[1] not in first
