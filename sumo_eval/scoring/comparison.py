"""Comparison of two runs case by case: flipped outcomes, harsher, softer and less human cases, and
how certain the differences are.

Cases are paired by logical scenario and parameter values, never by their order. The comparison
works on columns of the tables. A `ChangedCase` is made only when it is read.

`sumo-eval compare`, the nightly rule (`scoring/rule.py`, `nightly/`), the terminal, pages and JUnit
read the comparison.

Users: `cli/compare.py`, `nightly/`, `report/`, `scoring/rule.py`. Fixed: names of changes
(`gate_settings.Change`) and of quantities, which gate files name.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np

from sumo_eval.case_table import CaseTable, counts, point_numbers
from sumo_eval.cases import CaseResult
from sumo_eval.errors import InputError, check_known
from sumo_eval.frozen import frozen
from sumo_eval.method.score_terms import excess
from sumo_eval.record.store import FACTS, open_store
from sumo_eval.results import Evaluation
from sumo_eval.scoring.case_terms import CaseTerms, case_terms, point_values
from sumo_eval.scoring.comparability import (
    BATCHES,
    Difference,
    differences,
    refuse_unless_comparable,
)
from sumo_eval.scoring.confidence.paired_differences import COMPARED, paired_differences
from sumo_eval.scoring.findings import Findings
from sumo_eval.scoring.gate_settings import (
    HARSHER_BY,
    OF_HARM,
    OF_U,
    TIMED,
    Change,
    GateSettings,
    change_of_u,
)
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

_ORDER: tuple[Change, ...] = get_args(Change)
WORSE, BETTER = _ORDER[:5], _ORDER[5:]  # `Change` lists five changes for the worse, then the rest


class ChangedCase(NamedTuple):
    """One concrete scenario in which the two runs differ.

    change: kind of the difference.
    base, new: the case in each run.
    by: new minus base of the quantity that the change is about: U (m/s), human-likeness or D_i of
        the case; None for a flip of the outcome.
    moved: name -> new minus base of quantities that enter a score, if they differ: `regret`
        (max(0, U - Ug)), `H_i` (the case's human-likeness), `D_i`.
    """

    change: Change
    base: CaseResult
    new: CaseResult
    by: float | None
    moved: Mapping[str, float] = {}

    @property
    def worse(self) -> bool:
        """Whether the new run did worse here."""
        return self.change in WORSE


class Paired(NamedTuple):
    """Cases of an ADS in a logical scenario, paired by their points.

    base, new: cases of the n pairs; row i of both tables is pair i, at one point.
    new_rows: indices of these cases in the new run's table, (n,).
    lost: cases of the base at points that the new run does not have.
    added: cases of the new run at points that the base does not have.
    """

    base: CaseTable
    new: CaseTable
    new_rows: IntArray
    lost: CaseTable
    added: CaseTable


class Unpaired(NamedTuple):
    """Cases of an ADS in a logical scenario that have no partner.

    ads: its name in the base; its name in the new run if the base does not have it.
    lost: number of cases that only the base has.
    added: number of cases that only the new run has.
    of: number of all cases of the base.
    examples: keys of lost cases, at most `MOST_EXAMPLES`.
    """

    ads: str
    scenario: str
    lost: int
    added: int
    of: int
    examples: tuple[str, ...]


@frozen(eq=False)
class Changes:
    """The c changed cases of an ADS in a scenario, the worst first, as a sequence of `ChangedCase`.

    kinds: index of each change in `Change`, ascending, (c,); changes for the worse come first.
    which: row of its pair in `paired`, (c,).
    by: as in `ChangedCase`, nan for None, (c,).
    moved: name -> as in `ChangedCase`, nan if the quantity is the same in both runs, (c,).
    """

    paired: Paired
    kinds: IntArray
    which: IntArray
    by: FloatArray
    moved: Mapping[str, FloatArray]

    def of(self, change: Change) -> Changes:
        """Changes of one kind."""
        return self._with(self.kinds == _ORDER.index(change))

    @property
    def worse(self) -> Changes:
        """Cases in which the new run did worse."""
        return self._with(self.kinds < len(WORSE))

    @property
    def better(self) -> Changes:
        """Cases in which the new run did better."""
        return self._with(self.kinds >= len(WORSE))

    def _with(self, flags: BoolArray) -> Changes:
        """The flagged changes, (c,)."""
        moved = {name: values[flags] for name, values in self.moved.items()}
        return Changes(self.paired, self.kinds[flags], self.which[flags], self.by[flags], moved)

    def __len__(self) -> int:
        return len(self.kinds)

    def __getitem__(self, index: int) -> ChangedCase:
        pair, by = int(self.which[index]), float(self.by[index])
        moved = {name: float(values[index]) for name, values in self.moved.items()}
        return ChangedCase(
            _ORDER[int(self.kinds[index])],
            self.paired.base[pair],
            self.paired.new[pair],
            None if math.isnan(by) else by,
            {name: value for name, value in moved.items() if math.isfinite(value)},
        )

    def __iter__(self) -> Iterator[ChangedCase]:
        return map(self.__getitem__, range(len(self)))


class QuantityChange(NamedTuple):
    """A quantity in both runs.

    base, new: its value; None if a run does not have it.
    difference: new minus base; None if a value is missing, or if the units differ.
    low, high: interval of the difference; None without an interval.
    """

    base: float | None
    new: float | None
    difference: float | None
    low: float | None = None
    high: float | None = None

    @property
    def certain(self) -> bool:
        """Whether the interval of the difference excludes 0."""
        # ends that are None count as 0, which makes this false
        return (self.low or 0.0) > 0.0 or (self.high or 0.0) < 0.0

    @property
    def unchanged(self) -> bool:
        """Whether the difference and both ends of its interval are 0."""
        return self.difference == self.low == self.high == 0.0


def column_values(cases: CaseTable, column: str) -> FloatArray:
    """A column as numbers, nan where a case has no value. Harm that did not occur is 0."""
    values: FloatArray = getattr(cases, column).astype(np.float64)
    if column in OF_HARM:
        values[np.isnan(values) & cases.evaluated] = 0.0
    return values


class AdsComparison(NamedTuple):
    """Comparison of one ADS of the new run in one logical scenario with its partner in the base.

    ads, base_ads: names of the ADS in the new run and in the base.
    identical: number of pairs that are equal to the last bit, except for measured times.
    changed: changed cases, the worst first.
    quantities: name -> change of a score of `paired_differences.COMPARED`, from the paired cases.
    counts: outcome -> number of paired cases with it in the base, and in the new run.
    units: unit of U in the base, and in the new run. If they differ, changes of U do not count.
    one_batch_size: whether batches are as large in both runs. If not, measured times do not count.
    """

    ads: str
    base_ads: str
    scenario: str
    identical: int
    changed: Changes
    quantities: Mapping[str, QuantityChange]
    counts: Mapping[str, tuple[int, int]]
    units: tuple[str, str]
    one_batch_size: bool

    @property
    def pairs(self) -> int:
        """Number of cases that both runs have."""
        return len(self.changed.paired.new_rows)

    @property
    def one_unit(self) -> bool:
        """Whether U has one unit in both runs."""
        return self.units[0] == self.units[1]

    def comparable(self, column: str) -> tuple[FloatArray, FloatArray]:
        """A column of all pairs in the base and in the new run, (n,) each. nan for a column in the
        unit of U if the units differ, and for a measured time if the sizes of batches differ.
        """
        sides = self.changed.paired.base, self.changed.paired.new
        unlike = (column in OF_U and not self.one_unit) or (
            column in TIMED and not self.one_batch_size
        )
        # added to all values: 0, or nan, which makes them nan
        unknown = np.nan if unlike else 0.0
        before, after = (column_values(cases, column) + unknown for cases in sides)
        return before, after


class Comparison(NamedTuple):
    """Comparison of two runs.

    confidence: level of the intervals.
    differences: settings and versions in which the runs differ.
    ads: comparison of each ADS in each scenario.
    supposed: ADS of the new run -> ADS of the base, if the names differ and both are compared only
        because each run has a single ADS.
    only_base, only_new: ADSs without a partner.
    unpaired: cases without a partner.
    """

    base_folder: Path
    base_created: str
    new_folder: Path
    confidence: float
    differences: tuple[Difference, ...]
    ads: tuple[AdsComparison, ...]
    supposed: Mapping[str, str]
    only_base: tuple[str, ...]
    only_new: tuple[str, ...]
    unpaired: tuple[Unpaired, ...]

    @property
    def pairs(self) -> int:
        """Number of cases that both runs have."""
        return sum(part.pairs for part in self.ads)

    @property
    def identical(self) -> bool:
        """Whether every case of the base has a partner that is equal to the last bit."""
        lost = any(group.lost for group in self.unpaired)
        return not lost and all(part.identical == part.pairs for part in self.ads)

    @property
    def worse(self) -> int:
        """Number of cases in which the new run did worse."""
        return sum(len(part.changed.worse) for part in self.ads)

    @property
    def better(self) -> int:
        """Number of cases in which the new run did better."""
        return sum(len(part.changed.better) for part in self.ads)


def builds_besides(builds: Mapping[str, str], comparison: Comparison | None) -> list[str]:
    """Text of each ADS's build, `build of ADS: build`, without builds that the comparison's
    differences already list.

    builds: ADS -> its build.
    """
    listed = {difference.what for difference in comparison.differences} if comparison else set()
    named = [(f"build of {ads}", build) for ads, build in builds.items()]
    return [f"{what}: {build}" for what, build in named if what not in listed]


def compare(
    base: Evaluation,
    new: Evaluation,
    settings: GateSettings,
    *,
    pairs: Mapping[str, str] | None = None,
    accept_differences: bool = False,
) -> Comparison:
    """Compare two runs.

    settings: the gate file.
    pairs: ADS of the base -> ADS of the new run, for ADSs whose names differ.
    accept_differences: whether settings and versions that decide may differ. If not, they raise
        InputError.

    Raises InputError also if no ADS is in a logical scenario of both runs.
    """
    if not accept_differences:
        refuse_unless_comparable(differences(base, new))
    comparison = side_by_side(base, new, settings, pairs=pairs)
    if not comparison.ads:
        raise InputError(
            f"{base.folder} and {new.folder} have no ADS in a common logical scenario; name the "
            "ADSs that belong together with --pair BASE=NEW."
        )
    return comparison


def side_by_side(
    base: Evaluation,
    new: Evaluation,
    settings: GateSettings,
    *,
    pairs: Mapping[str, str] | None = None,
) -> Comparison:
    """Compare the cases that two runs have in common, if any. Differences of settings and versions
    are listed, not refused.

    settings, pairs: as in `compare`.
    """
    olds, news = base.ads_names, new.ads_names
    partners = _partners(olds, news, pairs or {})
    supposed = {}
    if not partners and len(olds) == len(news) == 1:
        supposed = {news[0]: olds[0]}
    partners |= supposed
    # (ADS in the base, ADS in the new run, scenario); "": the run does not have it
    groups = [(partners.get(score.ads, ""), score.ads, score.scenario) for score in new.scores]
    in_new = {(old, scenario) for old, _, scenario in groups}
    groups += [
        (score.ads, "", score.scenario)
        for score in base.scores
        if (score.ads, score.scenario) not in in_new
    ]
    compared, unpaired = [], []
    for old, name, scenario in groups:
        cases = base.cases_of(old, scenario)
        paired = _paired(cases, new.cases_of(name, scenario))
        if len(paired.new_rows):
            compared.append(_compare_ads(base, new, paired, settings))
        lost, added = len(paired.lost), len(paired.added)
        if lost or added:
            examples = tuple(paired.lost[:MOST_EXAMPLES].case.tolist())
            unpaired.append(Unpaired(old or name, scenario, lost, added, len(cases), examples))
    return Comparison(
        base.folder,
        str(base.manifest.get("created", "")),
        new.folder,
        settings.confidence,
        differences(base, new),
        tuple(compared),
        supposed,
        tuple(name for name in olds if name not in partners.values()),
        tuple(name for name in news if name not in partners),
        tuple(unpaired),
    )


MOST_EXAMPLES = 5  # most keys of lost cases that are named


def _partners(olds: Sequence[str], news: Sequence[str], pairs: Mapping[str, str]) -> dict[str, str]:
    """ADS of the new run -> ADS of the base, by `pairs`, else by name.

    olds, news: names of the ADSs of the base and of the new run.
    pairs: as in `compare`.

    Raises InputError for unknown names in `pairs`.
    """
    for old, now in pairs.items():
        check_known("ADS", olds, old)
        check_known("ADS", news, now)
    return {name: name for name in news if name in olds} | {now: old for old, now in pairs.items()}


def _compare_ads(
    base: Evaluation, new: Evaluation, paired: Paired, settings: GateSettings
) -> AdsComparison:
    """Compare the cases of an ADS in a scenario, pair by pair."""
    case, old = paired.new[0], paired.base[0]
    tables = paired.base, paired.new
    scores = base.score(old.ads, old.scenario), new.score(case.ads, case.scenario)
    methods = base.settings.method, new.settings.method
    runs = case_terms(paired.base, methods[0]), case_terms(paired.new, methods[1])
    base_counts, new_counts = (
        counts(cases)
        | {
            "requirements_missed": int(np.sum(cases.requirements_missed != "")),
            # as the score counts them, where a missing reference or D_i counts too
            "not_evaluated": int(Findings(score, cases, method).missing.sum()),
        }
        for score, cases, method in zip(scores, tables, methods, strict=True)
    )
    return AdsComparison(
        case.ads,
        old.ads,
        case.scenario,
        identical_pairs(paired, base.folder, new.folder),
        _changes(paired, runs, settings),
        _quantity_changes(runs, settings),
        {name: (base_counts[name], new_counts[name]) for name in base_counts},
        (methods[0].collision.unit, methods[1].collision.unit),
        all(getattr(base.settings.run, it) == getattr(new.settings.run, it) for it in BATCHES),
    )


def _paired(base: CaseTable, new: CaseTable) -> Paired:
    """Pair the cases of two tables by their points.

    Of several cases at one point the last one counts. Pairs have the order in which their points
    first occur in the new run.
    """
    no_rows = np.empty(0, np.intp)
    # without cases in a run, or with different parameters, nothing is paired
    if not (len(base) and len(new)) or base[0].values.keys() != new[0].values.keys():
        return Paired(base[no_rows], new[no_rows], no_rows, base, new)
    base_points, new_points = point_numbers([base, new])
    olds, _, last_old = _cases_at(base_points)
    news, first_new, last_new = _cases_at(new_points)
    # indices of the common points in `olds` and in `news`
    in_old, in_new = np.intersect1d(olds, news, assume_unique=True, return_indices=True)[1:]
    order = np.argsort(first_new[in_new])
    base_rows, new_rows = last_old[in_old[order]], last_new[in_new[order]]
    lost, added = np.delete(last_old, in_old), np.delete(last_new, in_new)
    return Paired(base[base_rows], new[new_rows], new_rows, base[lost], new[added])


def _cases_at(points: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Each different point of some cases, ascending, (p,), with the rows of its first and last
    case, (p,) each.

    points: number of each case's point, (n,).
    """
    distinct, first = np.unique(points, return_index=True)
    # `unique` gives first rows; the first row of the reversed list is the last row
    return distinct, first, len(points) - 1 - np.unique(points[::-1], return_index=True)[1]


Terms = tuple[CaseTerms, CaseTerms]
"""Terms of the paired cases, in the base and in the new run."""

_NOT_DRIVEN = frozenset((
    "case", "scenario", "ads", "values", "exposure", "weight", *TIMED,
    "index_note", "reference_note", "batched"
))  # fmt: skip
"""Fields of a row that `identical_pairs` leaves out: those that do not describe the drive, measured
times, and those whose values are records."""


def identical_pairs(paired: Paired, base: Path, new: Path) -> int:
    """Number of pairs that are equal to the last bit, except for measured times.

    base, new: folders of the runs.

    If the rows of all pairs are equal, the recorded drives are compared too, with those
    trajectories that both runs have.
    """
    same = np.ones(len(paired.new_rows), np.bool_)
    for name in {item.name for item in fields(CaseResult)} - _NOT_DRIVEN:
        before, after = getattr(paired.base, name), getattr(paired.new, name)
        # nan counts as equal to nan; only nan differs from itself
        same &= (before == after) | ((before != before) & (after != after))

    if not same.all() or base == new or not all((run / FACTS).is_file() for run in (base, new)):
        return int(same.sum())
    alike = 0
    with open_store(base) as old, open_store(new) as now:
        for before, after in zip(paired.base.case.tolist(), paired.new.case.tolist(), strict=True):
            # whether the trajectory is compared too
            whole = not (old.is_discarded(before) or now.is_discarded(after))
            alike += old.drive(before, whole=whole) == now.drive(after, whole=whole)
    return alike


def _changes(paired: Paired, terms: Terms, settings: GateSettings) -> Changes:
    """The changed cases.

    settings: `harsher_by`, `less_human_by`.
    """
    old, now = paired.base, paired.new
    unit, new_unit = (run.method.collision.unit for run in terms)  # of U
    # New minus base. Adding nan makes a difference in two units nan, so that it does not count.
    harder = now.severity - old.severity + (0.0 if unit == new_unit else np.nan)
    likeness, index = now.human_likeness - old.human_likeness, now.index - old.index
    regrets = [excess(run.severity, run.ideal) for run in terms]
    rises = {
        "regret": regrets[1] - regrets[0] + (0.0 if _one_regret(terms) else np.nan),
        "H_i": likeness,
        "D_i": index,
    }
    least_of_u = change_of_u(settings.harsher_by, HARSHER_BY, new_unit)
    kind, by = _kinds(paired, harder, least_of_u, (likeness, index), settings.less_human_by)
    which = np.flatnonzero(kind >= 0)
    # by kind of change, then the largest first, then by name (lexsort: the last key counts first)
    order = np.lexsort((now.case[which], -np.abs(np.nan_to_num(by[which])), kind[which]))
    which = which[order]
    moved = {name: np.where(rise != 0.0, rise, np.nan)[which] for name, rise in rises.items()}
    return Changes(paired, kind[which], which, by[which], moved)


def _kinds(
    paired: Paired,
    harder: FloatArray,
    least_of_u: float,
    more_human: Sequence[FloatArray],
    less_human_by: float,
) -> tuple[IntArray, FloatArray]:
    """Index in `Change` of each pair's change, -1: none, and its size, nan for a flip, (n,) each.
    Of several changes of a pair the first one below counts.

    harder: rise of U from the base to the new run, (n,).
    least_of_u: change of U that counts, in the unit of U.
    more_human: rises of human-likeness and of D_i, (n,) each.
    less_human_by: change of these that counts.
    """
    old, now = paired.base, paired.new
    kind, by = np.full(len(old), -1, np.intp), np.full(len(old), np.nan)

    def mark(flags: BoolArray, change: Change, size: FloatArray | None = None) -> None:
        """Give a change, and its size, to the flagged pairs that have none so far."""
        unmarked = flags & (kind < 0)
        kind[unmarked] = _ORDER.index(change)
        if size is not None:
            by[unmarked] = size[unmarked]

    left_before, left_now = (cases.off_road | cases.departed for cases in (old, now))
    flips: tuple[tuple[BoolArray, BoolArray, Change, Change], ...] = (
        (~old.evaluated, ~now.evaluated, "not evaluated any more", "evaluated again"),
        (old.collided, now.collided, "new collision", "collision gone"),
        (left_before, left_now, "left the road", "back on the road"),
    )
    # the worse first: a case that leaves the road instead of colliding is not better
    for before, after, worse, _ in flips:
        mark(after & ~before, worse)
    for before, after, _, better in flips:
        mark(before & ~after, better)
    mark(harder > least_of_u, "harsher", harder)
    mark(harder < -least_of_u, "softer", harder)
    for rise in more_human:
        mark(rise < -less_human_by, "less human", rise)
        mark(rise > less_human_by, "more human", rise)
    return kind, by


def _one_regret(terms: Terms) -> bool:
    """Whether the regret has one unit in both runs."""
    old, now = (run.method.collision.regret_unit for run in terms)
    return old == now


def _quantity_changes(terms: Terms, settings: GateSettings) -> dict[str, QuantityChange]:
    """Name -> a score in both runs, with the interval of its difference.

    settings: `confidence`, `resamples`, `seed`.
    """
    # imported here: it loads scipy and libsumo, which reading earlier results does not need
    from sumo_eval.scoring.confidence.intervals import LEAST, percentiles, single_means

    # scores that a single pair changes: it does not show how far pairs differ
    single = {name for run in terms for name in single_means(run)}
    if single:  # S and S+ follow from these means
        single |= {"s", "s_plus"}
    pairs = len(terms[0].collided)
    if pairs < LEAST:
        single = set(COMPARED.values())
    old, now = map(point_values, terms)
    resampled = paired_differences(*terms, settings.resamples, settings.seed)
    freedom = max(pairs - 1, 1)  # degrees of freedom
    changes = {}
    for name, score in COMPARED.items():
        before, after = old[score], now[score]
        changes[name] = QuantityChange(before, after, None)
        if (name != "regret" or _one_regret(terms)) and before is not None and after is not None:
            replicates = resampled[name]
            ends = percentiles(replicates, replicates, freedom, settings.confidence) or ()
            if score in single and before != after:
                ends = ()
            changes[name] = QuantityChange(before, after, after - before, *ends)
    return changes
