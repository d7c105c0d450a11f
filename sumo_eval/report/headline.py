"""The first words of a run, on terminal and page alike: safest, most human, best by S+, and what
must not be missed.

Users: `cli/finish.py`, `report/notebook.py`, `report/summary.py`.
"""

from collections.abc import Sequence
from typing import NamedTuple

from sumo_eval.report.score_words import REASON_WITHOUT_A, REASON_WITHOUT_T, parts_of_total
from sumo_eval.report.words import count, number, span
from sumo_eval.results import Evaluation, RankedAds, Ranking
from sumo_eval.scoring.behaviour import Behaviour, behaviour_of, harm_beside, ranked

SELDOM = 2.0 / 3.0
"""With at most this many contacts a case the text says "one every n cases", n at least 1.5; with
more, how many a case has.
"""
MOST_NAMED = 3
"""ADSs that share the first place and are named; the rest is a number."""
LITTLE = 0.5
"""T of the safest ADS below which the text says how much of the driving task it did."""
_WITHOUT_GRADE = "no ADS has A' in every scenario"


class Headline(NamedTuple):
    """First words of a run.

    order: the ADSs in their order, each with its behaviour.
    answers: (question, answer).
    alarms: (ADS, a fault for which its cases must be looked at).
    """

    order: tuple[tuple[RankedAds, Behaviour], ...]
    answers: tuple[tuple[str, str], ...]
    alarms: tuple[tuple[str, str], ...]


def headline(evaluation: Evaluation) -> Headline:
    """Answers to three questions, and an alarm for each ADS that needs one."""
    order = ranked(evaluation)
    behaviours = [behaviour_of(evaluation, ads.ads) for ads in order]
    questions = "Safety", "Human-likeness", "S+"
    if len(order) > 1:
        questions = "Safest", "Most human", "Best by S+"
    # without a ranking: `run.only` names different points for the ADSs
    texts = 3 * ("not known: the ADSs drove different points.",)
    if evaluation.ranking is not None:
        texts = (
            _safest(evaluation, behaviours),
            _most_human(behaviours),
            _best(evaluation.ranking, order),
        )
    answers = tuple(zip(questions, texts, strict=True))
    alarmed = tuple(
        (behaviour.ads, words)
        for behaviour in behaviours
        if (words := "; ".join(alarms(behaviour)))
    )
    return Headline(tuple(zip(order, behaviours, strict=True)), answers, alarmed)


def alarms(counts: Behaviour) -> list[str]:
    """Findings on an ADS that need a look, the gravest first; empty for an ADS without any."""
    given_up = ", those given up among them" if counts.gave_up else ""
    causes = (
        (counts.departures, f"left the road in {count(counts.departures, 'case')}"),
        (counts.gave_up, f"gave up {count(counts.gave_up, 'case')}"),
        (counts.avoidable_collisions, count(counts.avoidable_collisions, "avoidable collision")),
        # not "drivers": a scenario without people has the reference car alone
        (
            counts.stands,
            f"stands in {count(counts.stands, 'safe case')} where the references drive on",
        ),
        (
            counts.slower,
            f"slower than the slowest reference in {count(counts.slower, 'safe case')}",
        ),
        (
            counts.implausible,
            f"unlike any recorded person in {count(counts.implausible, 'safe case')}",
        ),
        (counts.not_evaluated, f"{count(counts.not_evaluated, 'case')} not evaluated{given_up}"),
    )
    return [words for cases, words in causes if cases]


def safety_words(evaluation: Evaluation, behaviour: Behaviour) -> str:
    """Harm of an ADS: `3 avoidable collisions in 192 cases, worst 43 km/h; as much excess impact
    speed as one 50 km/h contact every 24 cases of this grid`.
    """
    collides = behaviour.avoidable_collisions > 0
    words = count(behaviour.avoidable_collisions, "avoidable collision")
    words = words if collides else "no avoidable collision"
    words += f" in {count(behaviour.cases, 'case')}"
    words += f", worst {3.6 * behaviour.worst:z.0f} km/h" if behaviour.worst else ""
    # an excess of losses has no unit, and so no contact at 50 km/h to compare it with
    if not (behaviour.excess > 0.0 and evaluation.settings.method.collision.regret_unit):
        return words
    grids = "this grid" if len(evaluation.scenario_names) == 1 else "these grids"
    contacts = f"one 50 km/h contact every {1.0 / behaviour.contacts:z.0f} cases"
    if behaviour.contacts > SELDOM:
        contacts = f"{behaviour.contacts:z.1f} contacts at 50 km/h a case"
    excess = (
        "; as much excess impact speed"
        if collides
        else ", yet as much impact speed above the ideal vehicle's"
    )
    return f"{words}{excess} as {contacts} of {grids}"


def _safest(evaluation: Evaluation, behaviours: Sequence[Behaviour]) -> str:
    graded = sorted(
        (behaviour for behaviour in behaviours if behaviour.grade is not None),
        key=lambda behaviour: -(behaviour.grade or 0.0),  # `or 0.0` for the type checker alone
    )
    if not graded:
        evaluated = any(it.cases > it.not_evaluated for it in behaviours)
        return f"not known: {_WITHOUT_GRADE if evaluated else REASON_WITHOUT_A}."
    best = graded[0]
    if len(graded) > 1 and round(best.grade or 0.0, 2) <= 0.0:
        return "no ADS, no A' is above 0.00."
    words = f"{best.ads} with {safety_words(evaluation, best)}."
    if best.task is not None and best.task < LITTLE:
        words += f" It did {number(best.task, 2)} of the driving task (T)."
    if len(graded) == 1:
        return words
    other = graded[1].ads
    pair = harm_beside(evaluation, best.ads, other)
    if pair.less == pair.more == 0:
        # `run.only` may name cases of which the two have none in common
        alike = f"{other} does the same harm in each of {count(pair.common, 'compared case')}."
        return f"{words} {alike}" if pair.common else words
    apart = "Told apart" if pair.told_apart else "Not told apart"
    return (
        f"{words} {apart} from {other}: less harm in {count(pair.less, 'case')}, more in "
        f"{pair.more} (sign test, p = {pair.chance:z.2g})."
    )


def _most_human(behaviours: Sequence[Behaviour]) -> str:
    # (-H, ADS), so that the highest H is first; equal ones by name
    likeness = sorted(
        (-behaviour.human, behaviour.ads) for behaviour in behaviours if behaviour.human is not None
    )
    if not likeness:
        return "not known: no safe case could be compared with drivers."
    best, *others = likeness
    if others and not round(best[0], 2):
        return "no ADS, every H is 0.00."
    second = f"; next {others[0][1]}, {number(-others[0][0], 2)}" if others else ""
    return f"{best[1]} with H {number(-best[0], 2)} of 1{second}."


def _best(ranking: Ranking, order: Sequence[RankedAds]) -> str:
    best, *others = order
    parts = parts_of_total(ranking)
    if best.s_plus is None and ranking.without_task:
        return f"none: {REASON_WITHOUT_T}{parts}. Read A' instead."
    if best.s_plus is None:
        return f"none: {_WITHOUT_GRADE}{parts}."
    if others and not round(best.s_plus, 1):
        return f"no ADS, every S+ is 0.0{parts}."
    interval = f" ({span(best.interval, 1)})" if best.interval else ""
    points = f"{best.ads} with {number(best.s_plus, 1)} of 100 points{interval}{parts}."
    if not others or others[0].s_plus is None:
        return points
    pair = ranking.pair(best.ads, others[0].ads)  # `below` is the second
    equal = [it.ads for it in others if it.place == best.place]
    if not equal:
        return f"{points} Told apart from {pair.below}, {number(others[0].s_plus, 1)}."
    if pair.scored_alike:
        return f"{points} {pair.below} scored alike in every case."
    more = f" and {len(equal) - MOST_NAMED} more" if equal[MOST_NAMED:] else ""
    return f"{points} Not told apart from {', '.join(equal[:MOST_NAMED])}{more}."
