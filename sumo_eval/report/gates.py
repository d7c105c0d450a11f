"""Gates: whether a run, beside the one before it, may pass."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from sumo_eval.report.case_limits import judge_cases
from sumo_eval.report.comparison import (
    AdsComparison,
    Change,
    ChangedCase,
    Comparison,
    QuantityChange,
)
from sumo_eval.report.gate_result import MOST_KEYS, MOST_NAMED, CaseChange
from sumo_eval.report.gate_result import GateResult as GateResult
from sumo_eval.report.gate_settings import (
    HIGHER_IS_BETTER,
    OF_THE_COMPARISON,
    QUANTITIES,
    GateSettings,
    LimitSettings,
)
from sumo_eval.report.rule import QUIET, Noise
from sumo_eval.report.rule_limits import end_words, judge_rule
from sumo_eval.report.words import (
    REASON_WITHOUT_T,
    count,
    not_computed,
    number,
    point,
    reason_without_d,
    reason_without_h,
)
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import SCORES

_CHANGES: dict[str, Change] = {
    "new_collisions": "new collision",
    "harsher": "harsher",
    "less_human": "less human",
    "newly_off_road": "left the road",
    "newly_not_evaluated": "not evaluated any more",
}


def judge(
    new: Evaluation, comparison: Comparison | None, settings: GateSettings, noise: Noise = QUIET
) -> tuple[GateResult, ...]:
    """The rule, then every limit of a gate, for every ADS and logical scenario it is about.

    comparison None: there is no base.

    noise: what is known of ADSs that do not repeat. A limit on missed requirements in all scenarios
        is about those that have some, if any has.
    """
    compared = {(one.ads, one.scenario): one for one in comparison.ads} if comparison else {}
    requiring = {score.scenario for score in new.scores if score.requirements_missed is not None}
    results = judge_rule(comparison, settings, noise) if comparison else []
    for score in new.scores:
        for limit in settings.limit:
            everywhere = (
                limit.scenario is None and limit.quantity == "requirements_missed" and requiring
            )
            scenarios = requiring if everywhere else {limit.scenario or score.scenario}
            if limit.ads in (None, score.ads) and score.scenario in scenarios:
                beside = compared.get((score.ads, score.scenario))
                if limit.quantity in QUANTITIES:
                    results += _judge(limit, score, beside, settings.confidence)
                else:
                    results += judge_cases(
                        limit, new.cases_of(score.ads, score.scenario), score, beside
                    )
    return tuple(results)


def failed(results: Sequence[GateResult]) -> tuple[GateResult, ...]:
    """The gates that did not hold."""
    return tuple(result for result in results if result.passed is False)


def _judge(
    limit: LimitSettings, score: ScenarioResult, compared: AdsComparison | None, confidence: float
) -> Iterator[GateResult]:
    quantity, where = limit.quantity, (limit.quantity, score.ads, score.scenario)
    if quantity in OF_THE_COMPARISON and compared is None:
        yield GateResult(
            *where, None, f"{quantity}: there is no base to compare with", None, limit.at_most
        )
        return
    value = _value(quantity, score, compared)
    changed, own = _cases(quantity, compared), quantity not in OF_THE_COMPARISON
    for bound, sign, words in ((limit.at_least, 1.0, "at least"), (limit.at_most, -1.0, "at most")):
        if bound is None:
            continue
        if value is None:
            yield GateResult(
                *where,
                False,
                f"{quantity} is not computed; it must be {words} {bound:g}",
                None,
                bound,
                own=own,
            )
            continue
        ok = sign * (value - bound) >= -limit.tolerance * max(1.0, abs(bound))
        sentence = f"{quantity} is {_number(quantity, value)}; it must be {words} {bound:g}"
        keys = () if ok else tuple(item.new.case for item in changed[:MOST_KEYS])
        named = () if ok else _worst(quantity, compared)
        sentence += "" if ok else _named(changed)
        yield GateResult(*where, ok, sentence, value, bound, keys, named, own=own)
    for bound, percent in ((limit.worse_by, False), (limit.worse_by_percent, True)):
        if bound is not None:
            yield _judge_change(limit, score, compared, bound, percent, confidence)


def _judge_change(
    limit: LimitSettings,
    score: ScenarioResult,
    compared: AdsComparison | None,
    bound: float,
    percent: bool,
    confidence: float,
) -> GateResult:
    quantity, where = limit.quantity, (limit.quantity, score.ads, score.scenario)
    if compared is None:
        return GateResult(
            *where,
            None,
            f"{quantity}: there is no base to compare with",
            _value(quantity, score, None),
            None,
        )
    change = _quantity_change(quantity, compared)
    higher = quantity in HIGHER_IS_BETTER
    if change.base is None:
        return GateResult(
            *where,
            True,
            f"{quantity} was not computed in the base, so it cannot have become worse",
            change.new,
            None,
        )
    if change.new is None:
        return GateResult(
            *where, False, f"{quantity} was {_number(quantity, change.base)} and is not computed "
                           f"any more: {_why_missing(quantity, score)}",
        )  # fmt: skip
    allowed = abs(change.base) * bound / 100.0 if percent else bound
    loss = change.base - change.new if higher else change.new - change.base
    threshold = change.base - allowed if higher else change.base + allowed
    excused = limit.only_if_certain and not change.certain
    ok = loss <= allowed + limit.tolerance * max(1.0, abs(change.base)) or excused
    spread = (
        f", difference within {change.low:+z.4g} to {change.high:+z.4g} ({confidence:z.0%})"
        if change.low is not None and change.high is not None
        else ""
    )
    moved = (
        f"is {_number(quantity, change.new)} as in the base"
        if change.base == change.new and not change.low and not change.high
        else f"went from {_number(quantity, change.base)} to "
        f"{_number(quantity, change.new)}{spread}"
    )
    worst = () if ok else _worst(quantity, compared)
    keys = tuple(one.case for one in worst)
    return GateResult(
        *where,
        ok,
        f"{quantity} {moved}; {_may(limit, bound, percent)}",
        change.new,
        threshold,
        keys,
        worst,
    )


def _may(limit: LimitSettings, bound: float, percent: bool) -> str:
    """The bound of a limit on a change, in words."""
    way = "fall" if limit.quantity in HIGHER_IS_BETTER else "rise"
    asked = (
        f"it may {way} by at most {bound:g}{' %' if percent else ''}"
        if bound
        else f"it must not {way}"
    )
    if not limit.only_if_certain:
        return asked
    return (
        f"{asked}; {'a larger' if bound else 'a'} {way} counts only where the interval leaves out 0"
    )


def _value(quantity: str, score: ScenarioResult, compared: AdsComparison | None) -> float | None:
    if quantity in _CHANGES:
        return None if compared is None else float(compared.count(_CHANGES[quantity]))
    value: float | None = getattr(score, SCORES[quantity][0] if quantity in SCORES else quantity)
    return value


def _why_missing(quantity: str, score: ScenarioResult) -> str:
    reason = ""
    if quantity in ("D", "S"):
        reason = reason_without_d(score)
    elif quantity == "H":
        reason = reason_without_h(score)
    elif quantity == "T" or (quantity == "S+" and score.task_share is None):
        return not_computed(REASON_WITHOUT_T)
    elif quantity == "requirements_missed":
        return "the scenario requires nothing"
    return not_computed(reason) or "no case could be evaluated"


def _quantity_change(quantity: str, compared: AdsComparison) -> QuantityChange:
    """A quantity in both runs; counts have no interval."""
    if quantity in compared.quantities:
        return compared.quantities[quantity]
    base, new = map(float, compared.counts[quantity])
    return QuantityChange(base, new, new - base)


def _cases(quantity: str, compared: AdsComparison | None) -> Sequence[ChangedCase]:
    """The cases that a limit on a change is about."""
    if compared is None or quantity not in _CHANGES:
        return ()
    return compared.changed.of(_CHANGES[quantity])


def _worst(quantity: str, compared: AdsComparison | None) -> tuple[CaseChange, ...]:
    """The worst cases that a failed limit is about, or else of all that got worse."""
    if compared is None:
        return ()
    changed = _cases(quantity, compared) or compared.changed.worse
    return tuple(
        CaseChange(item.new.case, point(item.new.values), end_words(item.base), end_words(item.new))
        for item in changed[:MOST_NAMED]
    )


def _named(cases: Sequence[ChangedCase]) -> str:
    if not len(cases):
        return ""
    more = len(cases) - MOST_NAMED
    named = ", ".join(f"{item.new.case} ({point(item.new.values)})" for item in cases[:MOST_NAMED])
    return f": {named} and {count(more, 'other')}" if more > 0 else f": {named}"


def _number(quantity: str, value: float) -> str:
    digits = (
        SCORES[quantity][1] + 1
        if quantity in SCORES
        else 6
        if quantity == "collision_probability"
        else 0
    )
    return number(value, digits)
