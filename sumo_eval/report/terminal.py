"""Lines on a terminal or in a log: the end of a run, the ledger, the nearest cases.

Users: `cli/compare.py`, `cli/finish.py`, `cli/look.py`, `report/notebook.py`, `report/sections.py`.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import CaseResult
from sumo_eval.groups import grouped
from sumo_eval.report.checks import check_lines
from sumo_eval.report.notes import GIVEN_UP, score_note, why_missing
from sumo_eval.report.people import people_sentence
from sumo_eval.report.qualification import qualification_sentence
from sumo_eval.report.score_words import (
    REASON_WITHOUT_T,
    WITHOUT_REFERENCE_CAR,
    missing_term,
    parts_of_total,
    reason_without,
)
from sumo_eval.report.words import count, interval_words, number, one_line, placed
from sumo_eval.results import Evaluation, RankedPair, Ranking, ScenarioResult
from sumo_eval.score_notes import CasesMissing, ReferenceMissing
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.findings import findings_of, unevaluated
from sumo_eval.scoring.ledger import FULL, NOT_COMPUTED, Ledger, LedgerLine, ledger, ledger_plus
from sumo_eval.text import point_words, without_numbers

LONGEST_SENTENCE = 200  # characters of an error on a terminal; the report has all of it
MOST_LISTED = 5  # kinds of cases that could not be evaluated; `cases.csv` has all cases


def closing_lines(evaluation: Evaluation) -> list[str]:
    """Facts beside the table of scores, one sentence a line."""
    lines = [
        *ranking_lines(evaluation.ranking),
        *_not_computed_lines(evaluation.scores),
        *_missing_lines(evaluation),
        *_note_lines(evaluation.scores),
        *check_lines(evaluation),
        *_space_lines(evaluation),
    ]
    if evaluation.settings.drivers.source in ("synthetic", "recorded"):
        lines.append(people_sentence(evaluation))
    if "qualification" in evaluation.manifest:
        lines.append(qualification_sentence(evaluation.manifest))
    return lines


def _not_computed_lines(scores: Sequence[ScenarioResult]) -> Iterator[str]:
    """Scores that are not computed, with the reason."""
    yield from (line for name in ("C", "D", "H") for line in _lines_without(name, scores))
    if without_drivers := [score for score in scores if score.nobody_compared]:
        reason = reason_without("H", without_drivers[0])
        names = _names(without_drivers)
        yield f"D and H are not computed in {names}: {reason}. They count 0 points."
    if taskless := [score for score in scores if score.task_share is None]:
        yield f"T and S+ are not computed in {_names(taskless)}: {REASON_WITHOUT_T}. Read A' there."
    if any(not score.task_reference and score.task_share is not None for score in scores):
        yield WITHOUT_REFERENCE_CAR


def _lines_without(name: str, scores: Sequence[ScenarioResult]) -> Iterator[str]:
    """ADSs and scenarios without C, D or H, except D and H in scenarios without drivers."""
    for score in scores:
        if getattr(score, SCORES[name][0]) is not None or (name != "C" and score.nobody_compared):
            continue
        if reason := reason_without(name, score):
            line = missing_term(f"{name} of {score.ads} in {score.scenario}", reason)
            # H counts in S+ alone: `0 points.` becomes `0 points of S+.`
            yield f"{line[:-1]} of S+." if name == "H" else line


def _names(scores: Sequence[ScenarioResult]) -> str:
    """Names of their scenarios, each once."""
    return ", ".join(dict.fromkeys(score.scenario for score in scores))


def _missing_lines(evaluation: Evaluation) -> Iterator[str]:
    """Cases that could not be evaluated: the first of each of `MOST_LISTED` kinds, and how many
    more there are.

    Cases of one kind have the same ADS, status and place in the ADS's code; without a place, the
    same reason. Numbers in the reason may differ between cases that were driven to their end. Only
    the first case of a kind is kept in memory: a million may be missing.
    """
    first: dict[tuple[str, str, str], CaseResult] = {}
    # by listed kind; None: of all other kinds
    cases = Counter[tuple[str, str, str] | None]()
    for case in chain.from_iterable(unevaluated(evaluation)):
        sentence = why_missing(case)
        alike = without_numbers(sentence) if case.evaluated else case.error_place or sentence
        kind = case.ads, case.status, alike
        if len(first) < MOST_LISTED:
            first.setdefault(kind, case)
        cases[kind if kind in first else None] += 1
    if first:
        missing = count(cases.total(), "case")
        yield f"{missing} could not be evaluated and left the means{GIVEN_UP}:"
    for kind, case in first.items():
        more = f" and {cases[kind] - 1} more" if cases[kind] > 1 else ""
        yield f"  {one_line(case.case)}{more}: {one_line(_missing_words(case))}"
    if cases[None]:
        yield f"  and {cases[None]} more, all in cases.csv."


def _missing_words(case: CaseResult) -> str:
    """Why a case could not be evaluated, cut to fit a terminal, and where in the ADS's code."""
    sentence = why_missing(case)
    if len(sentence) > LONGEST_SENTENCE:
        sentence = f"{sentence[: LONGEST_SENTENCE - 2]} …"
    return placed(sentence, case)


def _note_lines(scores: Sequence[ScenarioResult]) -> list[str]:
    """Notes on scores; ADSs that share a note are on one line."""
    owners = grouped(
        ((score.scenario, score_note(note)), score.ads)
        for score in scores
        for note in score.notes
        if not isinstance(note, CasesMissing | ReferenceMissing)  # in `_missing_lines`
    )
    return [f"{', '.join(ads)} in {name}: {text}" for (name, text), ads in owners.items()]


def _space_lines(evaluation: Evaluation) -> Iterator[str]:
    """Refused points, notes on zones, and files of a catalogue that are not supported."""
    for zone in evaluation.zones:
        if zone.refused:
            points = count(zone.sampled + zone.refused, "point")
            yield (
                f"The sample of {zone.scenario} leaves out {zone.refused} of {points}: impossible "
                "by its constraints."
            )
    for zone in evaluation.zones:
        yield from (f"Zones of {zone.scenario}: {note}" for note in zone.notes)
    for entry in evaluation.settings.scenario:
        for file, why in entry.not_played.items():
            named = Path(file).name in why
            yield (
                f"Not supported in the catalogue: {why}"
                if named
                else f"{file} of the catalogue is not supported: {why}"
            )


def ranking_lines(ranking: Ranking | None) -> list[str]:
    """ADSs in order of S+, each with its difference to the first ADS of its place. The first ADS of
    a place has the difference to the first of the place above. No lines for one ADS.
    """
    if ranking is None or len(ranking.ads) < 2:
        return []
    lines = [_ranking_title(ranking)]
    first = ""  # ADS of the current place
    for ads in ranking.ads:
        if ads.place is None or ads.s_plus is None:
            lines.append(f"  not ranked: {one_line(ads.ads)} has no S+ in some scenario")
            continue
        interval = f" ({interval_words(ads.interval, 1)})" if ads.interval else ""
        words = f"  {ads.place}. {one_line(ads.ads)}  {number(ads.s_plus, 1)}{interval}"
        pair = ranking.pair(first, ads.ads) if first else None
        lines.append(words + _distance_words(pair, ads.s_plus) if pair else words)
        if pair is None or pair.told_apart:
            first = ads.ads
    return lines


def _ranking_title(ranking: Ranking) -> str:
    weights = ", ".join(f"{name} {weight:g}" for name, weight in ranking.weights.items())
    weighed = f" (weights: {weights})" if set(ranking.weights.values()) != {1.0} else ""
    return (
        f"Ranking by S+ over all scenarios{weighed}{parts_of_total(ranking)}; "
        f"{ranking.level:z.0%} intervals:"
    )


def _distance_words(pair: RankedPair, s_plus: float) -> str:
    """Distance of an ADS to the first of a place, and why it shares the place.

    pair: the first and the ADS.
    s_plus: of the ADS.
    """
    low, high = pair.interval or (0.0, 0.0)
    ends = f" ({interval_words((-high, -low), 1)})" if pair.interval else ""
    words = f"  {number(-pair.difference, 1)}{ends} to {one_line(pair.above)}"
    if pair.told_apart:
        return words
    # two ADSs with S+ = 0 in every resample are `scored_alike`, however their cases differ
    alike = pair.scored_alike and s_plus != 0.0
    why = "scored alike in every case" if alike else "not told apart"
    return f"{words}: {why}, the place is shared"


# --- where the points went ------------------------------------------------------------------------

MOST_ENTRIES = 3  # cases of a line of the ledger on a terminal


def ledger_lines(evaluation: Evaluation) -> list[str]:
    """The ledger of every score, with the cases that moved each term most."""
    return [
        line
        for findings in findings_of(evaluation)
        # one ledger at a time is in memory: each has every case's part of every line
        for make in (ledger_plus, ledger)
        for line in _ledger_lines(make(findings))
    ]


def cause_of(line: LedgerLine, score: ScenarioResult) -> str:
    """Reason why a line of the ledger gained or lost its points."""
    if line.cause != NOT_COMPUTED:
        return line.cause
    reason = reason_without(line.term, score)
    return f"{line.term} {line.cause}{': ' if reason else ''}{reason}"


def ledger_sentences(account: Ledger) -> list[str]:
    """The lines that cost points, the costliest first: `H lost 6.1 of 100 points: plausibility in
    14 cases.`
    """
    # most points of a term: in the ledger of S those of its line without cases, in that of S+ FULL
    whole = {
        line.term: line.points for line in account.lines if line.index > 0.0 and not line.entries
    }
    # a smaller loss would print as 0.0
    losses = [line for line in account.lines if line.points <= -0.05]
    return [
        f"{line.term} lost {-line.points:z.1f} of {whole.get(line.term, FULL):g} points: "
        f"{cause_of(line, account.score)}"
        + (f" in {count(line.cases, 'case')}" if line.cases else "")
        + "."
        for line in sorted(losses, key=lambda line: line.points)
    ]


def ledger_words(account: Ledger, digits: int) -> str:
    """`S+ = 63.3`, or that there is none."""
    value = account.score.s_plus if account.name == "S+" else account.score.s
    result = f"= {account.total:z.{digits}f}" if value is not None else "is not computed"
    return f"{account.name} {result}"


def _ledger_lines(account: Ledger) -> list[str]:
    """One ledger, with the cases that moved each of its lines most."""
    subject = f"{one_line(account.score.ads)} in {account.score.scenario}"
    lines = [f"{subject}: {ledger_words(account, 2)}"]
    for line in account.lines:
        cases = f", {count(line.cases, 'case')}" if line.cases else ""
        equation = f"Eq. {line.equation}: " if line.equation else ""
        lines.append(
            f"  {line.points:+z8.2f}  {line.term} {line.index:+z.4f}  {equation}"
            f"{cause_of(line, account.score)}{cases}"
        )
        lines += [
            f"            {points:+z8.2f}  {one_line(f'{case.case}: {point_words(case.values)}')}"
            for case, points in line.worst(MOST_ENTRIES)
        ]
    return [*lines, f"  {account.total:z8.2f}  {account.name}, the sum"]


def nearest_cases(groups: Iterable[tuple[CaseTable, CaseTable]]) -> Iterator[str]:
    """Lines on the nearest cases of each ADS.

    groups: all cases of an ADS, and the nearest of them.
    """
    for cases, near in groups:
        first = cases[0]
        yield f"{one_line(first.ads)} in {first.scenario}, {count(len(cases), 'case')}:"
        for case in near:
            at = f"{one_line(case.case)}: {point_words(case.values)}"
            yield f"  {at}; {case.outcome}, {case.zone} zone"
