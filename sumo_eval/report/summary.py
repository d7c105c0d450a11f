"""The report's first screen: which ADS is best, whether the difference is real, whether it is good, what to look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

import numpy as np

from sumo_eval.report.comparison import Comparison
from sumo_eval.report.gates import GateResult
from sumo_eval.report.headline import ranked
from sumo_eval.report.people import people_rows
from sumo_eval.report.terminal import verdict_of
from sumo_eval.report.words import (
    cases_of,
    count,
    interval_words,
    nobody_drove,
    number,
    parts_of_total,
    share_lost,
    unevaluated,
)
from sumo_eval.results import CaseResult, Evaluation, RankedAds, ScenarioResult
from sumo_eval.scoring.kept_rows import arrays, chosen
from sumo_eval.scoring.outcome_columns import OutcomeColumns

WIDE = 20.0  # points of S+: an interval wider than this tells little
MOST_LOOKS = 4


@dataclass(frozen=True, slots=True)
class Answer:
    """One question of the first screen. tone: good, bad, open or plain. looks: (words, key of a case or an anchor)."""

    question: str
    short: str
    sentences: tuple[str, ...]
    tone: str
    looks: tuple[tuple[str, str], ...] = ()


def summary_content(
    evaluation: Evaluation, comparison: Comparison | None, gates: Sequence[GateResult]
) -> Mapping[str, Any]:
    """What templates/sections/summary.html.j2 shows."""
    order = ranked(evaluation)
    best = order[0].ads
    answers = [
        _which(evaluation, order),
        _real(evaluation, order),
        _good(evaluation, best),
        _look(evaluation, best),
    ]
    if comparison is not None or gates:
        failed = any(gate.passed is False for gate in gates)
        verdict = verdict_of(comparison, gates, evaluation)
        answers.insert(
            0,
            Answer(
                "Since the last run", "worse" if failed else "no gate failed", (verdict,), "bad" if failed else "good"
            ),
        )
    scenarios = [zone.scenario for zone in evaluation.zones]
    digits = 0 if any(_wide(one.interval) for one in order) else 1
    return {
        "answers": answers,
        "rows": [_row(evaluation, one, scenarios, digits) for one in order],
        "scenarios": scenarios,
    }


def _which(evaluation: Evaluation, order: Sequence[RankedAds]) -> Answer:
    best = order[0]
    if best.s_plus is None:
        return Answer("Which ADS is best?", "not known", (_without_total(evaluation),), "open")
    parts = "" if evaluation.ranking is None else parts_of_total(evaluation.ranking)
    points = f"S+ is {number(best.s_plus, 1)} of 100 points{_between(best.interval)}{parts}."
    if len(order) == 1:
        return Answer("Which ADS is best?", best.ads, (f"It is the only ADS of this run. Its {points}",), "plain")
    equal = [one.ads for one in order if one.place is not None and one.place == best.place]
    if len(equal) > 1:
        names = ", ".join(equal[:-1]) + f" and {equal[-1]}"
        return Answer(
            "Which ADS is best?",
            f"{len(equal)} share the first place",
            (f"{names} cannot be told apart. The highest {points}",),
            "open",
        )
    return Answer("Which ADS is best?", best.ads, (f"Its {points}",), "plain")


def _without_total(evaluation: Evaluation) -> str:
    if nobody_drove(evaluation):
        return "No scenario has people to compare with and a task to drive: A' and C say how well each ADS avoids harm."
    return "No ADS has an S+ in every logical scenario that has a task to drive."


def _between(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else f", with 95 % confidence between {interval[0]:z.0f} and {interval[1]:z.0f}"


def _real(evaluation: Evaluation, order: Sequence[RankedAds]) -> Answer:
    question = "Is the difference real?"
    if len(order) == 1:
        interval = order[0].interval
        if interval is None:
            return Answer("How sure is it?", "not known", ("There is no interval for this score.",), "open")
        width = interval[1] - interval[0]
        if width > WIDE:
            return Answer(
                "How sure is it?",
                "not very",
                (f"The interval of S+ is {width:z.0f} points wide: more cases would narrow it.",),
                "open",
            )
        return Answer("How sure is it?", "rather sure", (f"The interval of S+ is {width:z.0f} points wide.",), "good")
    ranking = evaluation.ranking
    pairs = [] if ranking is None else [pair for pair in ranking.pairs if pair.above == order[0].ads]
    pair = next((pair for pair in pairs if pair.below == order[1].ads), None)
    if pair is None or pair.interval is None:
        return Answer(question, "not known", ("The ADSs were not compared with intervals.",), "open")
    between = interval_words(pair.interval, 1).replace("..", " to ")
    ahead = f"{number(pair.difference, 1)} points above {pair.below} ({between})"
    words = f"{pair.above} is {ahead}, over the same points and drivers."
    told = sum(pair.told_apart for pair in pairs)
    more = (
        (f"It is told apart from {told} of {count(len(pairs), 'other ADS', 'other ADSs')}.",) if len(pairs) > 1 else ()
    )
    if pair.told_apart:
        return Answer(question, "yes", (words, *more), "good")
    if pair.drove_alike:
        return Answer(question, "there is none", (f"{pair.below} drove every case as {pair.above} did.", *more), "open")
    return Answer(question, "it may be chance", (words, *more), "open")


def _good(evaluation: Evaluation, best: str) -> Answer:
    question = f"Is {best} good?"
    scores = [score for score in evaluation.scores if score.ads == best]
    avoidable = sum(score.avoidable_collisions for score in scores)
    caused = sum(score.caused_collisions for score in scores)
    cases = sum(score.cases for score in scores)
    missing = sum(score.not_evaluated for score in scores)
    if missing == cases:
        return Answer(question, "not known", ("None of its cases could be evaluated.",), "open")
    sentences = [_collisions(avoidable, caused, cases)]
    below = [row for row in people_rows(evaluation) if row.ads == best and row.d != "–" and row.below.split()[0] != "0"]
    if below:
        told = "; ".join(f"{row.below} cases in {row.scenario}" for row in below)
        sentences.append(f"It drives less like people than every driver in {told}.")
    else:
        likeness = [score.human_likeness for score in scores if score.human_likeness is not None]
        if likeness:
            sentences.append(
                f"Human-likeness H is {number(min(likeness), 2)}"
                + (" in its worst scenario." if len(likeness) > 1 else ".")
            )
    if missing:
        sentences.append(f"{count(missing, 'case')} could not be evaluated.")
    if avoidable:
        return Answer(question, "it has avoidable collisions", tuple(sentences), "bad")
    if below or missing:
        return Answer(question, "safe here, with questions", tuple(sentences), "open")
    return Answer(question, "no avoidable collision", tuple(sentences), "good")


def _collisions(avoidable: int, caused: int, cases: int) -> str:
    if not avoidable:
        return f"In {count(cases, 'case')} it has no collision that the ideal vehicle avoids."
    own = f" {count(caused, 'of them was', 'of them were')} caused by it." if caused else ""
    return f"The ideal vehicle avoids {count(avoidable, 'collision')} that it has in {count(cases, 'case')}.{own}"


def _look(evaluation: Evaluation, best: str) -> Answer:
    looks: list[tuple[str, str]] = []
    missing = unevaluated(evaluation)
    if missing:
        looks.append((f"{count(len(missing), 'case')} that could not be evaluated", "#missing"))
    others = [score.ads for score in evaluation.scores if score.ads != best]
    for ads in dict.fromkeys((best, *others)):
        hit = _worst_collision(evaluation, ads)
        if hit is not None:
            looks.append((f"the collision of {ads} that costs most: {_at(hit)}", _address(hit)))
            break
    least = _least_human(evaluation, best)
    if least is not None:
        looks.append((f"the least human-like case of {best}: {_at(least)}", _address(least)))
    if any(_failed(evaluation, score) for score in evaluation.scores):
        looks.append(("failures that are alike, in the maps", "#maps"))
    if not looks:
        looks.append(("the maps: nothing failed", "#maps"))
    return Answer("What to look at first", "", (), "plain", tuple(looks[:MOST_LOOKS]))


def _failed(evaluation: Evaluation, score: ScenarioResult) -> bool:
    """Whether a case collided or could not be evaluated."""
    there = OutcomeColumns.of(cases_of(evaluation, score))
    return bool((there.collided | ~there.evaluated).any())


def _worst_collision(evaluation: Evaluation, ads: str) -> CaseResult | None:
    """The avoidable collision of an ADS that lost most of A."""
    found: list[tuple[float, CaseResult]] = []
    for score in evaluation.scores:
        if score.ads == ads:
            cases = cases_of(evaluation, score)
            losses = np.nan_to_num(share_lost(cases, evaluation.settings))
            avoidable = OutcomeColumns.of(cases).avoidable
            if avoidable.any():
                most = float(losses[avoidable].max())
                worst = max(chosen(cases, avoidable & (losses == most)), key=lambda case: case.case)
                found.append((most, worst))
    return max(found, key=lambda pair: (pair[0], pair[1].case))[1] if found else None


def _least_human(evaluation: Evaluation, ads: str) -> CaseResult | None:
    """The case without a collision in which an ADS is least human-like."""
    found: list[CaseResult] = []
    for score in evaluation.scores:
        if score.ads == ads:
            cases = cases_of(evaluation, score)
            read = arrays(cases, "human_likeness", "collided")
            likeness = np.where(read["collided"] == 1.0, np.nan, read["human_likeness"])
            if np.isfinite(likeness).any():
                found.append(min(chosen(cases, likeness == np.nanmin(likeness)), key=lambda case: case.case))
    return min(found, key=lambda case: (case.human_likeness or 0.0, case.case), default=None)


def _at(case: CaseResult) -> str:
    """A point in few digits."""
    return ", ".join(f"{name} {value:z.4g}" for name, value in case.values.items())


def _address(case: CaseResult) -> str:
    return f"#case:{quote(case.case, safe='')}"


def _row(evaluation: Evaluation, one: RankedAds, scenarios: Sequence[str], digits: int) -> dict[str, Any]:
    scores = [score for score in evaluation.scores if score.ads == one.ads]
    return {
        "ads": one.ads,
        "place": "–" if one.place is None else str(one.place),
        "s_plus": number(one.s_plus, digits),
        "interval": interval_words(one.interval, 0).replace("..", " to "),
        "whisker": _whisker(one.s_plus, one.interval),
        "collisions": sum(score.collisions for score in scores),
        "avoidable": sum(score.avoidable_collisions for score in scores),
        "cases": sum(score.cases for score in scores),
        "missing": sum(score.not_evaluated for score in scores),
        "scenarios": [_cell(scores, name) for name in scenarios] if len(scenarios) > 1 else [],
    }


def _cell(scores: Sequence[ScenarioResult], scenario: str) -> str:
    value = next((score.s_plus for score in scores if score.scenario == scenario), None)
    return number(value, 0)


def _wide(interval: tuple[float, float] | None) -> bool:
    """Whether an interval says too little for decimals."""
    return interval is None or interval[1] - interval[0] > WIDE


def _whisker(value: float | None, interval: tuple[float, float] | None) -> dict[str, str] | None:
    """Places of a score and its interval on a rail of 100 units."""
    if value is None:
        return None
    low, high = (value, value) if interval is None else interval
    return {
        "low": f"{max(0.0, low):z.1f}",
        "width": f"{max(0.6, min(100.0, high) - max(0.0, low)):z.1f}",
        "at": f"{min(max(value, 0.0), 100.0):z.1f}",
    }
