"""Repeatability of ADSs, for the verdict on a night: whether two drives of a case are equal, how
far they differ, and how often a case ends badly.

Users: `nightly/judgement.py`, `nightly/night.py`.
"""

import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.evaluation import score
from sumo_eval.nightly.history import ShakyCase
from sumo_eval.nightly.rule_limits import WORDS, end_change
from sumo_eval.record.cases import Case, Outcome
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
    """Drive a sample of each ADS's cases a second time, and compare with the first drives; by ADS.

    folder: for a copy of the run with the second drives, which is scored; removed afterwards.
    """
    if not settings.noise.cases:
        return {}
    plan = planner(evaluation.resolved)
    # So that an ADS that carries state from case to case drives differently, the cases come in
    # another order, and each is driven alone: in a batch they may share state of the ADS's module.
    # Only a policy over arrays keeps its fixed batches, on which its drives may depend.
    sample = _sample(plan, settings.noise.cases)[::-1]
    alone = replace(plan.setup, run=replace(plan.setup.run, cases_per_pack=1))
    alike: dict[str, list[bool]] = {ads.name: [] for ads in evaluation.settings.ads}
    different: list[Outcome] = []
    with open_store(evaluation.folder) as store:
        for number, outcome in enumerate(run_cases(sample, alone), 1):
            equal = not store.difference(outcome)
            alike[outcome.case.driver].append(equal)
            different += [] if equal else [outcome]
            progress("driving some cases twice", number, len(sample))

    rows = _rows_with(evaluation, different, folder) if different else {}
    noisy = {outcome.case.driver for outcome in different}
    twice = {case.key: rows[case.key] for case in sample if case.driver in noisy}
    return {
        ads: Repeats(
            len(equal),
            sum(equal),
            *(_differences(evaluation, ads, twice, settings) if ads in noisy else ()),
        )
        for ads, equal in alike.items()
    }


def _sample(plan: Planner, number: int) -> list[Case]:
    """The cases of all ADSs at `number` points, drawn by the run's seed; at all points of the run
    if it has fewer.
    """
    spaces = [space_of(plan.run, index) for index in range(len(plan.run.scenarios))]
    stream = random_stream(plan.run.settings.seed, "driven twice")
    drawn = set(stream.permutation(sum(len(space.numbers) for space in spaces))[:number].tolist())
    cases: list[Case] = []
    first = 0  # place of the space's first point among those of all spaces
    for space in spaces:
        numbers = [point for place, point in enumerate(space.numbers, first) if place in drawn]
        cases += plan.ads(replace(space, numbers=numbers))
        first += len(space.numbers)
    return cases


def _rows_with(
    evaluation: Evaluation, outcomes: Sequence[Outcome], folder: Path
) -> dict[str, CaseResult]:
    """Rows of all cases by key, from a copy of a run in which these outcomes replace earlier
    ones.
    """
    with _copy_without(evaluation, [outcome.case.key for outcome in outcomes], folder):
        with open_store(folder, create=True) as store:
            store.add(*outcomes)
            store.seal()
        return _rows(evaluation, folder)


def _rerun(evaluation: Evaluation, cases: Collection[str], folder: Path) -> dict[str, CaseResult]:
    """Rows of all cases by key, from a copy of a run in which some were rerun."""
    if not cases:
        return {}
    with _copy_without(evaluation, cases, folder):
        record_facts(evaluation.resolved, folder, resume=True)
        return _rows(evaluation, folder)


@contextmanager
def _copy_without(evaluation: Evaluation, cases: Iterable[str], folder: Path) -> Iterator[None]:
    """A copy of a run without some of its cases, in a folder that is removed afterwards."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        shutil.copytree(evaluation.folder, folder)
        with open_store(folder, create=True) as store:
            store.unseal()
            store.remove(cases)
        yield
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _rows(evaluation: Evaluation, folder: Path) -> dict[str, CaseResult]:
    """Rows of a copy of a run, by key of the case."""
    return {row.case: row for row in score(folder, resolved=evaluation.resolved).cases}


def _differences(
    evaluation: Evaluation, ads: str, rows: Mapping[str, CaseResult], settings: GateSettings
) -> tuple[dict[str, float], dict[str, CaseChange]]:
    """`floors` and `apart` of an ADS's `Repeats`, from bad ends and the quantities that the rule
    watches, except measured times, which differ in any two drives. In `apart`, a quantity that only
    one of the drives has counts if its measure has a `zone` (`GateSettings`).

    rows: of the second drives, by case.
    """
    first = [row for row in evaluation.cases if row.ads == ads and row.case in rows]
    second = [rows[row.case] for row in first]
    once, twice = CaseTable.of(first), CaseTable.of(second)
    ends, ends_again = Ends.of(once), Ends.of(twice)
    floors = {"severity": severity_floor(ends, ends_again, settings.noise)}
    units = (evaluation.settings.method.collision.unit,) * 2
    apart = {
        first[k].case: end_change(first[k], second[k], units)
        for k in np.flatnonzero(ends.differ(ends_again))
    }
    for measure in settings.watched:
        name = measure.quantity
        if name in TIMED:
            continue
        before, after = (getattr(it, name).astype(np.float64) for it in (once, twice))
        floors[name] = floor_of(after - before, settings.noise)
        if measure.zone is not None:
            limit = measure.sign * measure.zone
            # As in the rule, the zone's limit replaces the missing one of two values. If the other
            # lies outside the zone, the limit replaces it too: the rule does not count such a case.
            lone = np.isnan(before) != np.isnan(after)
            before, after = (
                np.where(lone, measure.sign * np.fmin(measure.sign * it, limit), it)
                for it in (before, after)
            )
        far = np.abs(after - before) > tolerance(before, measure)
        for k in np.flatnonzero(far):
            words, unit = WORDS.get(name, (name, ""))
            change = CaseChange.of(first[k], before[k], after[k], unit)._replace(name=words)
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
    cases = {}
    for part in comparison.ads:
        repeats = noise.of(part.ads)
        if not repeats.noisy:
            continue
        limit = severity_limit(settings, repeats, part.units)
        paired = part.changed.paired
        for pairs in newly_bad(part, settings, repeats).values():
            for pair in pairs:  # index of the two rows
                cases[paired.new[pair].case] = paired.base[pair], limit
    return cases


def shaky_cases(
    evaluation: Evaluation, bad: Sequence[Mapping[str, int]], settings: GateSettings
) -> set[ShakyCase]:
    """Rerun cases that, compared with each of the bases, were not bad in at least one drive.

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
