"""Repeatability of ADSs, for the verdict on a night: whether two drives of a case are equal, how
far they differ, and how often a case ends badly.

Users: `nightly/judgement.py`, `nightly/night.py`.
"""

import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.evaluation import score
from sumo_eval.nightly.history import ShakyCase
from sumo_eval.record.cases import Case
from sumo_eval.record.engines import run_cases
from sumo_eval.record.facts import record_facts, space_of
from sumo_eval.record.progress import Progress
from sumo_eval.record.recording import Planner, planner
from sumo_eval.record.store import open_store
from sumo_eval.report.gate_result import CaseChange
from sumo_eval.results import Evaluation
from sumo_eval.scoring.comparison import Comparison
from sumo_eval.scoring.gate_settings import TIMED, GateSettings
from sumo_eval.scoring.rule import (
    Ends,
    Noise,
    Repeats,
    floor_of,
    newly_bad,
    severity_floor,
    severity_limit,
    tolerance,
    worse_ends,
)
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.text import point_words

AGAIN = "again"  # folder in the history's folder in which cases are rerun; removed afterwards


def repeats_of(
    evaluation: Evaluation, settings: GateSettings, folder: Path, progress: Progress
) -> dict[str, Repeats]:
    """Drive a sample of each ADS's cases a second time. Return by ADS how many are equal to the
    first drive and, if some are not, the noise floors.

    folder: for a copy of the run with the second drives, which is scored; removed afterwards.
    """
    if not settings.noise.cases:
        return {}
    plan = planner(evaluation.resolved)
    sample = _sample(plan, settings.noise.cases)
    # each case alone: in a batch the cases may share state of their ADS's module
    alone = replace(plan.setup, run=replace(plan.setup.run, cases_per_pack=1))
    alike: dict[str, list[bool]] = {ads.name: [] for ads in evaluation.settings.ads}
    with open_store(evaluation.folder) as store:
        for number, outcome in enumerate(run_cases(sample, alone), 1):
            alike[outcome.case.driver].append(not store.difference(outcome))
            progress("driving some cases twice", number, len(sample))

    noisy = {ads for ads, equal in alike.items() if not all(equal)}
    keys = {case.key for case in sample if case.driver in noisy}
    rows = _rerun(evaluation, keys, folder)
    return {
        ads: Repeats(
            len(equal),
            sum(equal),
            *(_differences(evaluation, ads, rows, settings) if ads in noisy else ()),
        )
        for ads, equal in alike.items()
    }


def _sample(plan: Planner, number: int) -> list[Case]:
    """The cases of all ADSs at `number` points, drawn by the run's seed."""
    spaces = [space_of(plan.run, index) for index in range(len(plan.run.scenarios))]
    # a draw is the number of a point among those of all spaces in order
    ends = np.cumsum([len(space.numbers) for space in spaces])
    stream = random_stream(plan.run.settings.seed, "driven twice")
    drawn = stream.permutation(int(ends[-1]))[:number]
    cases: list[Case] = []
    for space, end in zip(spaces, ends, strict=True):
        first = end - len(space.numbers)
        places = np.sort(drawn[(drawn >= first) & (drawn < end)] - first)
        cases += plan.ads(
            replace(space, numbers=[space.numbers[index] for index in places.tolist()])
        )
    # in reverse order, so that an ADS that carries state from case to case drives differently
    return cases[::-1]


def _rerun(evaluation: Evaluation, cases: Collection[str], folder: Path) -> dict[str, CaseResult]:
    """Rows of cases from a copy of a run in which they were rerun."""
    if not cases:
        return {}
    try:
        shutil.copytree(evaluation.folder, folder)
        with open_store(folder, create=True) as store:
            store.unseal()
            store.remove(cases)
        record_facts(evaluation.resolved, folder, resume=True)
        return {
            row.case: row
            for row in score(folder, resolved=evaluation.resolved).cases
            if row.case in cases
        }
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _differences(
    evaluation: Evaluation, ads: str, rows: Mapping[str, CaseResult], settings: GateSettings
) -> tuple[dict[str, float], dict[str, CaseChange]]:
    """`floors` and `apart` of an ADS's `Repeats`, of every quantity that the rule looks at.

    rows: of the second drives, by case.
    """
    first = [row for row in evaluation.cases if row.ads == ads and row.case in rows]
    once, twice = CaseTable.of(first), CaseTable.of([rows[row.case] for row in first])
    floors = {"severity": severity_floor(Ends.of(once), Ends.of(twice), settings.noise)}
    apart = dict[str, CaseChange]()
    for measure in settings.watched:
        name = measure.quantity
        before, after = (getattr(it, name).astype(np.float64) for it in (once, twice))
        floors[name] = floor_of(after - before, settings.noise)
        far = np.abs(after - before) > tolerance(before, measure)
        # measured times differ in any two drives
        for k in np.flatnonzero(far & (name not in TIMED)):
            change = CaseChange.of(first[k], before[k], after[k], f" {name}")
            apart.setdefault(change.case, change)
    return floors, apart


def bad_again(
    comparisons: Sequence[Comparison],
    evaluation: Evaluation,
    noise: Noise,
    settings: GateSettings,
    folder: Path,
) -> list[dict[str, int]]:
    """For each comparison: newly bad case of a noisy ADS -> number of drives that are bad compared
    with this base. Each such case is driven `settings.outcome.repeats` times more; the first drive
    counts, too.

    comparisons: with the bases.
    noise: only its repeats are used.
    folder: as in `repeats_of`.
    """
    bases = [_newly_bad_cases(comparison, noise, settings) for comparison in comparisons]
    bad = [dict.fromkeys(cases, 1) for cases in bases]
    rerun = set().union(*bases)  # a case that is bad compared with both bases is driven once
    for _ in range(settings.outcome.repeats):
        rows = _rerun(evaluation, rerun, folder)
        for cases, drives in zip(bases, bad, strict=True):
            for case, (base, limit) in cases.items():
                old, new = (Ends.of(CaseTable.of([it])) for it in (base, rows[case]))
                drives[case] += any(flags.any() for flags in worse_ends(old, new, limit).values())
    return bad


def _newly_bad_cases(
    comparison: Comparison, noise: Noise, settings: GateSettings
) -> dict[str, tuple[CaseResult, float]]:
    """Key of each newly bad case of a noisy ADS -> its row in the base, and the rise of U above
    which a drive is bad.
    """
    return {
        part.changed.paired.new[pair].case: (
            part.changed.paired.base[pair],
            severity_limit(settings, noise.of(part.ads), part.units),
        )
        for part in comparison.ads
        if noise.of(part.ads).noisy
        for worse in newly_bad(part, settings, noise.of(part.ads)).values()
        for pair in worse
    }


def shaky_cases(
    evaluation: Evaluation, bad: Sequence[Mapping[str, int]], settings: GateSettings
) -> set[ShakyCase]:
    """Rerun cases that were not bad in all of their drives, compared with any base.

    bad: from `bad_again`.
    """
    # case -> the most bad drives, compared with one of the bases
    most = {case: max(it.get(case, 0) for it in bad) for drives in bad for case in drives}
    # of `repeats` + 1 drives, at least one was not bad
    shaky = {case for case, drives in most.items() if drives <= settings.outcome.repeats}
    return {_without_key(row) for row in evaluation.cases if row.case in shaky} if shaky else set()


def _without_key(row: CaseResult) -> ShakyCase:
    """A case by its point: in a later night it may have another key."""
    return ShakyCase(row.ads, row.scenario, point_words(row.values))


def keys_of(evaluation: Evaluation, shaky: Collection[ShakyCase]) -> frozenset[str]:
    """Tonight's keys of cases that were shaky before."""
    if not shaky:
        return frozenset()
    return frozenset(row.case for row in evaluation.cases if _without_key(row) in shaky)
