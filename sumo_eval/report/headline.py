"""The first words of a run, on terminal and page alike: safest, most human, best by S+, and what
must not be missed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import bdtr

from sumo_eval.cases import point_numbers
from sumo_eval.method.score_terms import excess, exposure_mean, once
from sumo_eval.report.words import (
    REASON_WITHOUT_T,
    count,
    number,
    parts_of_total,
    severity_unit,
    span,
)
from sumo_eval.results import Evaluation, RankedAds
from sumo_eval.scoring.case_terms import case_terms
from sumo_eval.scoring.findings import Findings, findings

CONTACT = 50.0 / 3.6
"""Impact speed that excess impact speed is counted in, m/s."""
BY_CHANCE = 0.05
"""Probability of a sign test below which two ADSs count as different."""
MOST_NAMED = 3
"""ADSs that share the first place and are named; the rest is a number."""


@dataclass(frozen=True, slots=True)
class Behaviour:
    """One ADS in one scenario, or in all scenarios of a run; counts are numbers of cases.

    stands, slower: safe cases in which it stands, or is slower, where the references drive.
    worst: impact speed of the hardest avoidable collision, m/s; 0 without one.
    excess: mean of max(0, U - Ug) by exposure, m/s; nan where nothing could be evaluated.
    grade, human: A' and H; None where they do not exist.
    """

    ads: str
    cases: int
    avoidable: int
    departures: int
    stands: int
    slower: int
    gave_up: int
    not_evaluated: int
    worst: float
    excess: float
    grade: float | None
    human: float | None


@dataclass(frozen=True, slots=True)
class Headline:
    """answers: (question, answer).
    alarms: (ADS, what its cases must be looked at for).
    """

    answers: tuple[tuple[str, str], ...]
    alarms: tuple[tuple[str, str], ...]


def headline(evaluation: Evaluation) -> Headline:
    """Three answers, and an alarm for each ADS that needs one."""
    order = ranked(evaluation)
    known = [finding(evaluation, one.ads) for one in order]
    many = len(order) > 1
    answers = (
        ("Safest" if many else "Safety", _safest(evaluation, known)),
        ("Most human" if many else "Human-likeness", _most_human(known)),
        ("Best by S+" if many else "S+", _best(evaluation, order)),
    )
    return Headline(
        answers, tuple((one.ads, words) for one in known if (words := "; ".join(alarms(one))))
    )


def ranked(evaluation: Evaluation) -> tuple[RankedAds, ...]:
    """The ADSs in their order; without a ranking by their only score, or as they stand in the
    evaluation.
    """
    if evaluation.ranking is not None and evaluation.ranking.ads:
        return evaluation.ranking.ads
    order = []
    for ads in dict.fromkeys(score.ads for score in evaluation.scores):
        scores = [score for score in evaluation.scores if score.ads == ads]
        interval = scores[0].s_plus_interval if len(scores) == 1 else None
        order.append(RankedAds(ads, None, _mean((it.s_plus, 1.0) for it in scores), interval))
    return tuple(sorted(order, key=lambda one: -1.0 if one.s_plus is None else -one.s_plus))


# --- what was found -------------------------------------------------------------------------------


def finding(evaluation: Evaluation, ads: str) -> Behaviour:
    """Behaviour of one ADS in all scenarios: sums, and means by the weights of the ranking."""
    parts = [one for one in findings(evaluation) if one.score.ads == ads]
    scores = [one.score for one in parts]
    by_scenario = {} if evaluation.ranking is None else evaluation.ranking.weights
    weights = [by_scenario.get(score.scenario, 1.0) for score in scores]
    stands = sum(int(one.stands.sum()) for one in parts)

    def total(field: str) -> int:
        return sum(getattr(score, field) for score in scores)

    def mean(values: Iterable[float | None], *, known: bool = False) -> float | None:
        pairs = zip(values, weights, strict=True)
        return _mean(pair for pair in pairs if not known or pair[0] is not None)

    return Behaviour(
        ads,
        cases=total("cases"),
        avoidable=total("avoidable_collisions"),
        departures=total("departures"),
        stands=stands,
        slower=sum(int(one.slow.sum()) for one in parts) - stands,
        gave_up=total("gave_up"),
        not_evaluated=total("not_evaluated"),
        worst=max(
            float(one.cases.impact_speed[one.cases.avoidable].max(initial=0.0)) for one in parts
        ),
        excess=mean(map(_excess, parts)) or 0.0,
        grade=mean(score.avoidance_grade for score in scores),
        human=mean((score.human_likeness for score in scores), known=True),
    )


def _mean(values: Iterable[tuple[float | None, float]]) -> float | None:
    """The mean of (value, weight); None where a value is missing or nothing weighs."""
    pairs = list(values)
    whole = sum(weight for _, weight in pairs)
    if not whole or any(value is None for value, weight in pairs if weight):
        return None
    return sum((value or 0.0) * weight for value, weight in pairs) / whole


def _excess(found: Findings) -> float:
    """Mean of max(0, U - Ug) by exposure, m/s; nan where nothing could be evaluated."""
    terms = case_terms(found.cases, found.settings.method)
    beyond = excess(terms.severity, terms.ideal)
    return float(exposure_mean(beyond, terms.exposure, once(len(beyond)))[0])


# --- in words -------------------------------------------------------------------------------------


def alarms(found: Behaviour) -> list[str]:
    """Findings on an ADS that need a look, the gravest first; empty for an ADS without any."""
    given_up = ", those given up among them" if found.gave_up else ""
    said = (
        (found.departures, f"left the road in {count(found.departures, 'case')}"),
        (found.gave_up, f"gave up {count(found.gave_up, 'case')}"),
        (found.avoidable, count(found.avoidable, "avoidable collision")),
        (found.stands, f"stands in {count(found.stands, 'safe case')} where drivers drive on"),
        (found.slower, f"slower than the slowest driver in {count(found.slower, 'safe case')}"),
        (found.not_evaluated, f"{count(found.not_evaluated, 'case')} not evaluated{given_up}"),
    )
    return [words for number_of, words in said if number_of]


def safety_words(evaluation: Evaluation, found: Behaviour) -> str:
    """`3 avoidable collisions in 192 cases, worst 43 km/h`, and how much excess impact speed that
    is.
    """
    hit = found.avoidable > 0
    hits = count(found.avoidable, "avoidable collision") if hit else "no avoidable collision"
    hits += f" in {count(found.cases, 'case')}"
    hits += f", worst {3.6 * found.worst:z.0f} km/h" if found.worst else ""
    if not found.excess > 0.0 or not severity_unit(evaluation.settings):
        return hits
    spaces = {score.scenario for score in evaluation.scores}
    grids = "this grid" if len(spaces) == 1 else "these grids"
    every = max(CONTACT / found.excess, 1.0)
    speed = (
        "; as much excess impact speed"
        if hit
        else ", yet as much impact speed above the ideal vehicle's"
    )
    return f"{hits}{speed} as one 50 km/h contact every {every:z.0f} cases of {grids}"


def _safest(evaluation: Evaluation, every: Sequence[Behaviour]) -> str:
    known = sorted(
        (one for one in every if one.grade is not None), key=lambda one: -(one.grade or 0.0)
    )
    if not known:
        return "not known: no case could be evaluated."
    words = f"{known[0].ads} with {safety_words(evaluation, known[0])}."
    if len(known) == 1:
        return words
    other = known[1].ads
    less, more = harm_beside(evaluation, known[0].ads, other)
    if less == more == 0:
        return f"{words} {other} does the same harm in every case."
    chance = min(1.0, 2.0 * float(bdtr(min(less, more), less + more, 0.5)))
    apart = "Told apart" if chance < BY_CHANCE and less > more else "Not told apart"
    return (
        f"{words} {apart} from {other}: less harm in {count(less, 'case')}, more in {more} (sign "
        f"test, p = {chance:z.2g})."
    )


def harm_beside(evaluation: Evaluation, first: str, second: str) -> tuple[int, int]:
    """In how many cases of both ADSs the first does less and more avoidable harm than the
    second.
    """
    less = more = 0
    for scenario in dict.fromkeys(score.scenario for score in evaluation.scores):
        tables = [evaluation.cases_of(ads, scenario) for ads in (first, second)]
        own_points, other_points = point_numbers(tables)
        places = np.intersect1d(own_points, other_points, return_indices=True)[1:]
        terms = [case_terms(table, evaluation.settings.method) for table in tables]
        own, other = (
            excess(one.severity, one.ideal)[place] for one, place in zip(terms, places, strict=True)
        )
        less += int((own < other).sum())
        more += int((own > other).sum())
    return less, more


def _most_human(every: Sequence[Behaviour]) -> str:
    known = sorted((-one.human, one.ads) for one in every if one.human is not None)
    if not known:
        return "not known: no safe case could be compared with drivers."
    beside = f"; next {known[1][1]}, {number(-known[1][0], 2)}" if len(known) > 1 else ""
    return f"{known[0][1]} with H {number(-known[0][0], 2)} of 1{beside}."


def _best(evaluation: Evaluation, order: Sequence[RankedAds]) -> str:
    best, ranking = order[0], evaluation.ranking
    parts = "" if ranking is None else parts_of_total(ranking)
    if best.s_plus is None:
        return f"none: {REASON_WITHOUT_T}{parts}. Read A' instead."
    interval = f" ({span(best.interval, 1)})" if best.interval else ""
    points = f"{best.ads} with {number(best.s_plus, 1)} of 100 points{interval}{parts}."
    if ranking is None or len(order) == 1 or order[1].s_plus is None:
        return points
    pair = ranking.pair(best.ads, order[1].ads)
    equal = [one.ads for one in order[1:] if one.place == best.place]
    if not equal:
        return f"{points} Told apart from {pair.below}, {number(order[1].s_plus, 1)}."
    if pair.scored_alike and best.s_plus:
        return f"{points} {pair.below} scored alike in every case."
    more = f" and {len(equal) - MOST_NAMED} more" if equal[MOST_NAMED:] else ""
    return f"{points} Not told apart from {', '.join(equal[:MOST_NAMED])}{more}."
