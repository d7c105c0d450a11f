"""Gates: limits that a run passes or fails, by its own values or compared with an earlier run. For
nights and `sumo-eval compare`.

Users: `cli/compare.py`, `nightly/judgement.py`.
"""

from collections.abc import Iterator
from functools import partial
from itertools import islice, product

import numpy as np

from sumo_eval.errors import did_you_mean
from sumo_eval.nightly.rule_limits import EVERYWHERE, WORDS, end_change, judge_rule
from sumo_eval.report.gate_result import MOST_KEYS, MOST_NAMED, CaseChange, GateResult, in_order
from sumo_eval.report.score_words import not_computed
from sumo_eval.report.words import confidence_words, count, number
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.comparison import AdsComparison, Comparison, QuantityChange, column_values
from sumo_eval.scoring.gate_settings import (
    HIGHER_COLUMNS,
    HIGHER_IS_BETTER,
    OF_THE_COMPARISON,
    OF_U,
    QUANTITIES,
    GateSettings,
    LimitSettings,
)
from sumo_eval.scoring.rule import QUIET, Noise
from sumo_eval.trajectory import FloatArray


def judge(
    new: Evaluation, comparison: Comparison | None, settings: GateSettings, noise: Noise = QUIET
) -> tuple[GateResult, ...]:
    """The rule, then every limit of a gate, for every ADS and logical scenario it is about.

    comparison: with an earlier run; None without a base.
    noise: random variation of the ADSs.

    A limit on missed requirements that names no scenario is about the scenarios with requirements,
    if there are any. A limit on an ADS or a scenario that the run does not have is not evaluated.
    """
    compared = {(part.ads, part.scenario): part for part in comparison.ads} if comparison else {}
    requiring = {score.scenario for score in new.scores if score.requirements_missed is not None}
    results = judge_rule(comparison, settings, noise) if comparison else []
    for score, limit in product(new.scores, settings.limit):
        required = limit.scenario is None and limit.quantity == "requirements_missed" and requiring
        scenarios = requiring if required else {limit.scenario or score.scenario}
        if limit.ads not in (None, score.ads) or score.scenario not in scenarios:
            continue
        part = compared.get((score.ads, score.scenario))
        if limit.quantity in QUANTITIES:
            unit = new.settings.method.collision.regret_unit if limit.quantity == "regret" else ""
            results += _judge(limit, score, part, settings.confidence, unit)
        else:
            results += _judge_cases(limit, score, new, part)
    return in_order([*results, *_without_cases(new, settings)], {})


def _without_cases(new: Evaluation, settings: GateSettings) -> Iterator[GateResult]:
    """Limits on an ADS or a scenario that the run does not have."""
    # None in a limit means every ADS, or every scenario
    known = {
        it for score in new.scores for it in product((score.ads, None), (score.scenario, None))
    }
    ads, scenarios = (
        dict.fromkeys(getattr(score, name) for score in new.scores) for name in ("ads", "scenario")
    )
    for limit in settings.limit:
        if (limit.ads, limit.scenario) not in known:
            where = limit.ads or "every ADS", limit.scenario or EVERYWHERE
            of, within = limit.ads or "any ADS", limit.scenario or "any scenario"
            none = f"the run has no case of {of} in {within}."
            for name, names in ((limit.ads, ads), (limit.scenario, scenarios)):
                if name is not None and name not in names:
                    none += did_you_mean(name, names)
            yield GateResult(limit.quantity, *where, None, f"{limit.quantity}: {none}", reason=none)


# --- numbers of an ADS ----------------------------------------------------------------------------


def _judge(
    limit: LimitSettings,
    score: ScenarioResult,
    part: AdsComparison | None,
    confidence: float,
    unit: str,
) -> Iterator[GateResult]:
    """Every bound of a limit on a number of an ADS in a scenario.

    part: comparison of the ADS in the scenario; None without a base.
    unit: of the number, after a space, or empty.
    """
    quantity = limit.quantity
    why = "there is no base to compare with"
    result = partial(GateResult, quantity, score.ads, score.scenario)
    without_base = partial(result, None, f"{quantity}: {why}", reason=why)
    # the quantity is a value of the new run, or a number of cases that changed against the base
    if quantity not in OF_THE_COMPARISON:
        field, _ = SCORES.get(quantity, (quantity, 0))
        value = getattr(score, field)
    elif part is None:
        yield without_base(threshold=limit.at_most)
        return
    else:
        value = float(len(part.changed.of(OF_THE_COMPARISON[quantity])))

    for bound, sign, words in ((limit.at_least, 1.0, "least"), (limit.at_most, -1.0, "most")):
        if bound is None:
            continue
        got = "not computed" if value is None or np.isnan(value) else _number(quantity, value, unit)
        asked = f"it must be at {words} {bound:g}{unit}"
        sentence = f"{quantity} is {got}; {asked}"
        # it passes if it is beyond the bound by at most the tolerance, a share of the bound
        ok = value is not None and sign * (value - bound) >= -limit.tolerance * max(1.0, abs(bound))
        keys, worst = ((), ()) if ok or value is None else _worst(quantity, part)
        if keys:
            more = len(keys) - MOST_NAMED
            sentence += f": {', '.join(f'{change.case} ({change.point})' for change in worst)}"
            sentence += f" and {count(more, 'other')}" if more > 0 else ""
        yield result(
            ok,
            sentence,
            value,
            bound,
            keys[:MOST_KEYS],
            worst,
            own=quantity not in OF_THE_COMPARISON,
            bound=asked,
        )
    for bound, percent in ((limit.worse_by, ""), (limit.worse_by_percent, " %")):
        if bound is None:
            continue
        if part is None:
            yield without_base(value=value)
        else:
            yield _judge_change(limit, score, part, bound, percent, unit, confidence)


def _judge_change(
    limit: LimitSettings,
    score: ScenarioResult,
    part: AdsComparison,
    most: float,
    percent: str,
    unit: str,
    confidence: float,
) -> GateResult:
    """A limit on how much a number may become worse than in the base.

    most: how much worse it may become.
    percent: " %" if that is a share of the base's value, else "".
    unit: of the quantity.
    """
    quantity = limit.quantity
    asked = _asked(limit, most, percent or unit)
    result = partial(GateResult, quantity, score.ads, score.scenario, bound=asked)
    if quantity in part.quantities:
        change = part.quantities[quantity]
    else:
        old, now = map(float, part.counts[quantity])
        change = QuantityChange(old, now, now - old)
    if change.base is None:
        never = f"{quantity} was not computed in the base, so it cannot have become worse"
        return result(True, never, change.new)
    if change.new is None:
        was, why = _number(quantity, change.base, unit), _why_missing(quantity, score)
        return result(False, f"{quantity} was {was} and is not computed any more: {why}")
    if change.difference is None:
        return result(None, f"{quantity} has another unit in the base", change.new)

    sign = 1.0 if quantity in HIGHER_IS_BETTER else -1.0
    allowed = abs(change.base) * most / 100.0 if percent else most
    slack = limit.tolerance * max(1.0, abs(change.base))
    excused = limit.only_if_certain and not change.certain
    ok = excused or sign * (change.base - change.new) <= allowed + slack
    worst = () if ok else _worst(quantity, part)[1]
    keys = tuple(change.case for change in worst)
    sentence = f"{quantity} {_moved(quantity, change, unit, confidence)}; {asked}"
    return result(ok, sentence, change.new, change.base - sign * allowed, keys, worst)


def _asked(limit: LimitSettings, most: float, unit: str) -> str:
    """`it may fall by at most 2 %`."""
    way = "fall" if limit.quantity in HIGHER_IS_BETTER else "rise"
    asked = f"it may {way} by at most {most:g}{unit}" if most else f"it must not {way}"
    if limit.only_if_certain:
        larger = "a larger" if most else "a"
        asked += f"; {larger} {way} counts only where the interval leaves out 0"
    return asked


def _moved(quantity: str, change: QuantityChange, unit: str, confidence: float) -> str:
    """`went from 60.0 to 55.0`, with the interval of the difference."""
    before, after = (_number(quantity, value, unit) for value in (change.base, change.new))
    if change.base == change.new and not change.low and not change.high:
        return f"is {before} as in the base"
    moved = f"went from {before} to {after}"
    if change.low is not None and change.high is not None:
        moved += (
            f", difference within {change.low:+z.4g} to {change.high:+z.4g} "
            f"({confidence_words(confidence)})"
        )
    return moved


def _why_missing(quantity: str, score: ScenarioResult) -> str:
    """Reason, in words, why a score was not computed."""
    # of a sum of terms, the term that is missing
    name = {"S": "D", "S+": "T" if score.task_share is None else ""}.get(quantity, quantity)
    return not_computed(name, score) or "no case could be evaluated"


def _worst(
    quantity: str, part: AdsComparison | None
) -> tuple[tuple[str, ...], tuple[CaseChange, ...]]:
    """Keys of the cases that a quantity counts; and the worst of these, with their changes.

    A quantity that counts no cases has no keys, and the worst of all cases that got worse.
    """
    if part is None:
        return (), ()
    about = part.changed.of(OF_THE_COMPARISON[quantity]) if quantity in OF_THE_COMPARISON else ()
    worst = islice(about or part.changed.worse, MOST_NAMED)
    return tuple(item.new.case for item in about), tuple(
        end_change(it.base, it.new, part.units) for it in worst
    )


def _number(quantity: str, value: float | None, unit: str) -> str:
    """A quantity in words, a score with one digit more than in tables; with its unit."""
    if quantity in SCORES:
        _, table_digits = SCORES[quantity]
        digits = 1 + table_digits
    else:
        digits = 6 if quantity == "collision_probability" else 0
    return number(value, digits) + unit


# --- columns of cases.csv -------------------------------------------------------------------------


def _judge_cases(
    limit: LimitSettings, score: ScenarioResult, new: Evaluation, part: AdsComparison | None
) -> Iterator[GateResult]:
    """Every bound of a limit on a column of cases.csv, in every case of the new run by itself."""
    cases = new.cases_behind(score)
    _, unit = WORDS.get(limit.quantity, ("", ""))
    if limit.quantity in OF_U:
        unit = new.settings.method.collision.unit
    name = "index" if limit.quantity == "d_i" else limit.quantity
    after, before = column_values(cases, name), np.full(len(cases), np.nan)
    if part is not None:
        before[part.changed.paired.new_rows], _ = part.comparable(name)
    for beyond, scale, words in _column_bounds(limit, before, after, unit):
        # whether the bound is on the new run's values alone: the scale of a bound on a change is
        # the base's values
        own = scale is not before
        known = int(np.isfinite(beyond).sum())
        result = partial(
            GateResult, limit.quantity, score.ads, score.scenario, own=own, bound=words
        )
        if known:
            bad = np.flatnonzero(beyond > limit.tolerance * np.maximum(1.0, np.abs(scale)))
            worst = bad[np.argsort(-beyond[bad], kind="stable")]
            where = f"{words} in {len(bad)} of {count(known, 'case')}"
            lone = 0 if own else int(np.sum(np.isnan(before) != np.isnan(after)))
            if lone:
                where += f", and {lone} with a value in one run alone, not compared"
            yield result(
                not len(bad), f"{limit.quantity} is {where}", float(len(bad)), None,
                tuple(cases.case[worst[:MOST_KEYS]].tolist()),
                tuple(
                    CaseChange.of(
                        cases[k],
                        None if np.isnan(before[k]) else float(before[k]),
                        float(after[k]),
                        unit
                    )
                    for k in worst[:MOST_NAMED].tolist()
                )
            )  # fmt: skip
        elif not own and part is not None and name in OF_U and not part.one_unit:
            yield result(None, f"{limit.quantity} has another unit in the base")
        else:
            why = "no case has a value to compare"
            yield result(None, f"{limit.quantity}: {why}", reason=why)


def _column_bounds(
    limit: LimitSettings, before: FloatArray, after: FloatArray, unit: str
) -> Iterator[tuple[FloatArray, FloatArray | float, str]]:
    """Bounds on a column, each as (beyond, scale, words).

    before, after: values of the base and of the new run, (n,), nan where there is none.

    beyond: how far each case is beyond the bound, (n,).
    scale: value of which the tolerance is a share: the bound, or (n,) the base's values.
    words: what a case beyond the bound is, e.g. `below 5 m`.
    """
    worse = before - after if limit.quantity in HIGHER_COLUMNS else after - before
    if (least := limit.at_least) is not None:
        yield least - after, least, f"below {least:g}{unit}"
    if (most := limit.at_most) is not None:
        yield after - most, most, f"above {most:g}{unit}"
    if (by := limit.worse_by) is not None:
        yield worse - by, before, f"worse by more than {by:g}{unit}"
    if (share := limit.worse_by_percent) is not None:
        yield worse - np.abs(before) * share / 100.0, before, f"worse by more than {share:g} %"
