"""Two runs side by side, case by case: what flipped, what got harsher, softer, less human, and how sure that is.

Cases are paired by logical scenario and parameter values, never by their order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.method.score_terms import excess
from sumo_eval.report.bootstrap import paired_differences, quantities
from sumo_eval.report.comparability import Difference, differences, refuse_unless_comparable
from sumo_eval.report.gate_settings import GateSettings
from sumo_eval.report.words import count
from sumo_eval.results import CaseResult, Evaluation
from sumo_eval.scoring.case_terms import case_terms

Change = Literal[
    "new collision", "left the road", "not evaluated any more", "harsher", "less human",
    "collision gone", "back on the road", "evaluated again", "softer", "more human",
]  # fmt: skip

WORSE: Final[tuple[Change, ...]] = (
    "new collision", "left the road", "not evaluated any more", "harsher", "less human",
)  # fmt: skip
BETTER: Final[tuple[Change, ...]] = ("collision gone", "back on the road", "evaluated again", "softer", "more human")


@dataclass(frozen=True, slots=True)
class ChangedCase:
    """One concrete scenario in which the two runs differ.

    by: new minus base of what the change is about, U (m/s), the case's human-likeness or D_i; None for a flip. moved:
    new minus base of everything in the case that moves a score, without what did not move: `regret` max(0, U - Ug),
    `H_i` its human-likeness, `D_i`.
    """

    change: Change
    base: CaseResult
    new: CaseResult
    by: float | None
    moved: Mapping[str, float] = field(default_factory=dict)

    @property
    def worse(self) -> bool:
        """Whether the new run did worse here."""
        return self.change in WORSE


@dataclass(frozen=True, slots=True)
class QuantityChange:
    """A quantity in both runs. low, high: interval of the DIFFERENCE; None where the quantity is missing in a run."""

    base: float | None
    new: float | None
    difference: float | None
    low: float | None
    high: float | None

    @property
    def certain(self) -> bool:
        """Whether the interval of the difference leaves out 0."""
        return self.low is not None and self.high is not None and (self.low > 0.0 or self.high < 0.0)

    @property
    def unchanged(self) -> bool:
        """Whether both runs have one value, in every resample."""
        return self.difference == self.low == self.high == 0.0


@dataclass(frozen=True, slots=True)
class AdsComparison:
    """One ADS of the new run in one logical scenario beside what it is compared with.

    pairs: cases that both runs have. changed: the worst first. quantities: those of `bootstrap.COMPARED` over the
    pairs. unpaired: cases that only one of the runs has. undecided: pairs without an outcome in at least one run.
    """

    ads: str
    base_ads: str
    scenario: str
    pairs: int
    unpaired: int
    undecided: int
    changed: tuple[ChangedCase, ...]
    quantities: Mapping[str, QuantityChange]
    base_cases: tuple[CaseResult, ...]
    new_cases: tuple[CaseResult, ...]

    def count(self, change: Change) -> int:
        """Number of cases with a change."""
        return sum(item.change == change for item in self.changed)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs side by side. notes: sentences on what a reader would otherwise take for granted."""

    base_name: str
    base_folder: str
    base_created: str
    new_name: str
    new_folder: str
    confidence: float
    differences: tuple[Difference, ...]
    ads: tuple[AdsComparison, ...]
    notes: tuple[str, ...]

    @property
    def worse(self) -> tuple[ChangedCase, ...]:
        """Every case in which the new run did worse."""
        return tuple(item for one in self.ads for item in one.changed if item.worse)

    @property
    def better(self) -> tuple[ChangedCase, ...]:
        """Every case in which the new run did better."""
        return tuple(item for one in self.ads for item in one.changed if not item.worse)


def compare(
    base: Evaluation,
    new: Evaluation,
    settings: GateSettings,
    *,
    pairs: Mapping[str, str] | None = None,
    accept_differences: bool = False,
) -> Comparison:
    """Compare two runs. pairs: ADS of the base -> ADS of the new run, where their names differ.

    Raises InputError where more than the ADS differs, unless `accept_differences`.
    """
    found = differences(base, new)
    if not accept_differences:
        refuse_unless_comparable(found)
    partners, notes = _partners(base, new, pairs or {})
    compared = tuple(
        one
        for score in new.scores
        if score.ads in partners
        and (one := _compare_ads(base, new, partners[score.ads], score.ads, score.scenario, settings)) is not None
    )
    if not compared:
        raise InputError(
            f"{base.folder} and {new.folder} have no ADS in a common logical scenario; name the ADSs that belong "
            "together with --pair BASE=NEW."
        )
    unpaired = sum(one.unpaired for one in compared)
    if unpaired:
        notes.append(f"{count(unpaired, 'case')} exist in one run only and are left out; every value is over the rest.")
    moved = sum(
        before.zone != after.zone
        for one in compared
        for before, after in zip(one.base_cases, one.new_cases, strict=True)
    )
    if moved:
        notes.append(f"{count(moved, 'case')} lie in another zone than in the base.")
    return Comparison(
        base_name=base.name,
        base_folder=str(base.folder),
        base_created=str(base.manifest.get("created", "")),
        new_name=new.name,
        new_folder=str(new.folder),
        confidence=settings.confidence,
        differences=found,
        ads=compared,
        notes=tuple(notes),
    )


def _partners(base: Evaluation, new: Evaluation, pairs: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
    """ADS of the new run -> ADS of the base, and notes on ADSs that have no partner."""
    olds = list(dict.fromkeys(score.ads for score in base.scores))
    news = list(dict.fromkeys(score.ads for score in new.scores))
    for old, now in pairs.items():
        for name, known in ((old, olds), (now, news)):
            if name not in known:
                raise unknown("ADS", name, known)
    partners = {now: old for old, now in pairs.items()}
    partners |= {name: name for name in news if name in olds and name not in partners}
    notes = []
    if not partners and len(olds) == len(news) == 1:
        partners = {news[0]: olds[0]}
        notes.append(f"`{news[0]}` is compared with `{olds[0]}`: each run has one ADS only.")
    for name in news:
        if name not in partners:
            notes.append(f"ADS `{name}` is not in the base, so nothing is said of how it changed.")
    gone = [name for name in olds if name not in partners.values()]
    notes += [f"ADS `{name}` of the base is not in the new run." for name in gone]
    return partners, notes


def _compare_ads(
    base: Evaluation, new: Evaluation, base_ads: str, ads: str, scenario: str, settings: GateSettings
) -> AdsComparison | None:
    before, after = _by_point(base, base_ads, scenario), _by_point(new, ads, scenario)
    both = [key for key in after if key in before]
    if not both:
        return None
    old, now = [before[key] for key in both], [after[key] for key in both]
    lost = [_lost(cases, run) for cases, run in ((old, base), (now, new))]
    changed = [
        replace(change, moved=_moved(change, *regrets))
        for before_now, regrets in zip(zip(old, now, strict=True), zip(*lost, strict=True), strict=True)
        if (change := _change(*before_now, settings)) is not None
    ]
    order: tuple[Change, ...] = (*WORSE, *BETTER)
    changed.sort(key=lambda item: (order.index(item.change), -abs(item.by or 0.0), item.new.case))
    return AdsComparison(
        ads=ads,
        base_ads=base_ads,
        scenario=scenario,
        pairs=len(both),
        unpaired=len(before) + len(after) - 2 * len(both),
        undecided=sum(not (one.evaluated and other.evaluated) for one, other in zip(old, now, strict=True)),
        changed=tuple(changed),
        quantities=_quantity_changes(old, now, base, new, settings),
        base_cases=tuple(old),
        new_cases=tuple(now),
    )


def _by_point(evaluation: Evaluation, ads: str, scenario: str) -> dict[tuple[tuple[str, float], ...], CaseResult]:
    return {tuple(sorted(case.values.items())): case for case in evaluation.cases_of(ads, scenario)}


def _change(base: CaseResult, new: CaseResult, settings: GateSettings) -> ChangedCase | None:
    """What is different in one concrete scenario, None for nothing that counts."""
    flips: tuple[tuple[bool, bool, Change, Change], ...] = (
        (not base.evaluated, not new.evaluated, "not evaluated any more", "evaluated again"),
        (base.collided, new.collided, "new collision", "collision gone"),
        (base.status == "off_road", new.status == "off_road", "left the road", "back on the road"),
    )
    for before, after, worse, better in flips:
        if before != after:
            return ChangedCase(worse if after else better, base, new, None)
    if base.severity is not None and new.severity is not None:
        by = new.severity - base.severity
        if abs(by) > settings.harsher_by:
            return ChangedCase("harsher" if by > 0.0 else "softer", base, new, by)
    for before_value, after_value in ((base.human_likeness, new.human_likeness), (base.index, new.index)):
        if before_value is not None and after_value is not None:
            by = after_value - before_value
            if abs(by) > settings.less_human_by:
                return ChangedCase("less human" if by < 0.0 else "more human", base, new, by)
    return None


def _lost(cases: Sequence[CaseResult], run: Evaluation) -> list[float]:
    """max(0, U - Ug) of cases, m/s; nan where one of both is not known."""
    terms = case_terms(cases, run.settings.method)
    return [float(value) for value in excess(terms.severity, terms.ideal)]


def _moved(change: ChangedCase, regret_before: float, regret_now: float) -> dict[str, float]:
    pairs = {
        "regret": (regret_before, regret_now),
        "H_i": (change.base.human_likeness, change.new.human_likeness),
        "D_i": (change.base.index, change.new.index),
    }
    moved = {name: now - before for name, (before, now) in pairs.items() if before is not None and now is not None}
    return {name: by for name, by in moved.items() if np.isfinite(by) and by}


def _quantity_changes(
    old: Sequence[CaseResult], now: Sequence[CaseResult], base: Evaluation, new: Evaluation, settings: GateSettings
) -> dict[str, QuantityChange]:
    before, after = case_terms(old, base.settings.method), case_terms(now, new.settings.method)
    once = np.ones((1, len(old)))
    values = quantities(before, once, base.settings.method), quantities(after, once, new.settings.method)
    drawn = paired_differences(
        before, after, base.settings.method, new.settings.method, resamples=settings.resamples, seed=settings.seed
    )
    tail = (1.0 - settings.confidence) / 2.0
    changes = {}
    for name in values[0]:
        then, here = (None if (value := one[name]) is None else float(value[0]) for one in values)
        spread = drawn.get(name)
        low = high = None
        if spread is not None and spread.size:
            low, high = (float(value) for value in np.quantile(spread, (tail, 1.0 - tail)))
        changes[name] = QuantityChange(then, here, None if then is None or here is None else here - then, low, high)
    return changes
