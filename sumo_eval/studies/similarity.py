"""DTW and LCSS beside D_i, case by case."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sumo_eval.method.agreement import rank_correlation
from sumo_eval.method.trajectory_similarity import trajectory_similarity
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import open_store
from sumo_eval.results import Evaluation


@dataclass(frozen=True, slots=True)
class SimilarityRow:
    """One safe-zone case: D_i, its similarity factor, and two usual measures against the same drivers."""

    case: str
    ads: str
    scenario: str
    index: float
    similarity: float
    dtw: float
    lcss: float


def similarity_rows(evaluation: Evaluation, progress: Callable[[str, int, int], None]) -> list[SimilarityRow]:
    """A row for every case that has a D_i."""
    cases = [case for case in evaluation.cases if case.index is not None and case.similarity is not None]
    rows = []
    with open_store(evaluation.folder / FACTS) as store:
        points = {fact.case: fact.point for fact in store.facts("ads")}
        drivers: dict[tuple[str, int], list[str]] = {}
        for fact in store.facts("human"):
            if fact.status == "ok":
                drivers.setdefault((fact.scenario, fact.point), []).append(fact.case)
        for done, case in enumerate(cases, start=1):
            theirs = drivers[case.scenario, points[case.case]]
            found = trajectory_similarity(store.trajectory(case.case), [store.trajectory(name) for name in theirs])
            assert case.index is not None
            assert case.similarity is not None
            rows.append(
                SimilarityRow(case.case, case.ads, case.scenario, case.index, case.similarity, found.dtw, found.lcss)
            )
            progress("DTW and LCSS", done, len(cases))
    return rows


def similarity_lines(rows: Sequence[SimilarityRow]) -> list[str]:
    """How the measures rank the cases, against D_i."""
    if len(rows) < 3:
        return ["Fewer than 3 cases have a D_i: no rank correlation."]
    indexes = [row.index for row in rows]
    near = rank_correlation(indexes, [-row.dtw for row in rows])
    common = rank_correlation(indexes, [row.lcss for row in rows])
    return [
        f"D_i and nearness by DTW: Spearman's rho {near.value:z.3f} over {near.n} cases.",
        f"D_i and LCSS: Spearman's rho {common.value:z.3f} over {common.n} cases.",
    ]
