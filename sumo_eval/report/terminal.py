"""Lines on a terminal or in a log: at the end of a run, of two runs, of the ledger.

Users: `cli/`, `nightly/morning.py`, `report/`.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path

from sumo_eval.cases import CaseTable
from sumo_eval.groups import grouped
from sumo_eval.report.checks import check_lines
from sumo_eval.report.gate_result import GateResult, LimitName, failed
from sumo_eval.report.page import REPORT, case_key
from sumo_eval.report.qualification import qualification_sentence
from sumo_eval.report.verdict import verdict
from sumo_eval.report.words import (
    GIVEN_UP,
    REASON_WITHOUT_C,
    REASON_WITHOUT_T,
    WITHOUT_REFERENCE_CAR,
    count,
    interval_words,
    missing_term,
    number,
    one_line,
    parts_of_total,
    people_sentence,
    placed,
    reason_without,
    score_note,
    why_missing,
)
from sumo_eval.results import (
    CasesMissing,
    Evaluation,
    Ranking,
    ReferenceMissing,
    ScenarioResult,
)
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.comparison import BETTER, WORSE, ChangedCase, Comparison, QuantityChange
from sumo_eval.scoring.findings import findings_of, unevaluated
from sumo_eval.scoring.ledger import FULL, NOT_COMPUTED, Ledger, LedgerLine, ledger, ledger_plus
from sumo_eval.text import point_words, without_numbers

LONGEST_SENTENCE = 200  # characters of an error on a terminal; the report has all of it
MOST_LISTED = 5  # kinds of cases that could not be evaluated; the report lists the cases


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
    without_drivers = [score for score in scores if score.nobody_compared]
    for name, field in (("C", "c"), ("D", "d"), ("H", "human_likeness")):
        for score in scores:
            reason = REASON_WITHOUT_C if name == "C" else reason_without(name, score)
            has_line_below = name != "C" and score in without_drivers
            if getattr(score, field) is not None or has_line_below or not reason:
                continue
            line = missing_term(f"{name} of {score.ads} in {score.scenario}", reason)
            # H counts in S+ alone: `0 points.` becomes `0 points of S+.`
            yield f"{line[:-1]} of S+." if name == "H" else line
    if without_drivers:
        reason = reason_without("H", without_drivers[0])
        names = _names(without_drivers)
        yield f"D and H are not computed in {names}: {reason}. They count 0 points."
    taskless = [score for score in scores if score.task_share is None]
    if taskless:
        yield f"T and S+ are not computed in {_names(taskless)}: {REASON_WITHOUT_T}. Read A' there."
    if any(not score.task_reference and score.task_share is not None for score in scores):
        yield WITHOUT_REFERENCE_CAR


def _names(scores: Sequence[ScenarioResult]) -> str:
    return ", ".join(dict.fromkeys(score.scenario for score in scores))


def _missing_lines(evaluation: Evaluation) -> Iterator[str]:
    """Cases that could not be evaluated: the first of each of `MOST_LISTED` kinds, and how many
    more there are.

    Cases of one kind have the same ADS, status and place in the ADS's code (without one: reason).
    Of cases that were driven to their end, numbers in the reason may differ. Only the first case of
    a kind is kept in memory: a million may be missing.
    """
    first: dict[tuple[str, str, str], tuple[str, str]] = {}
    # number of further cases by listed kind; None: of all other kinds
    more: Counter[tuple[str, str, str] | None] = Counter()
    for case in chain.from_iterable(unevaluated(evaluation)):
        sentence = why_missing(case)
        alike = without_numbers(sentence) if case.evaluated else case.error_place or sentence
        key = case.ads, case.status, alike
        if key in first or len(first) == MOST_LISTED:
            more[key if key in first else None] += 1
            continue
        if len(sentence) > LONGEST_SENTENCE:
            sentence = f"{sentence[: LONGEST_SENTENCE - 2]} …"
        first[key] = one_line(case.case), one_line(placed(sentence, case))
    if first:
        cases = count(len(first) + more.total(), "case")
        yield f"{cases} could not be evaluated and left the means{GIVEN_UP}:"
    for key, (name, words) in first.items():
        others = f" and {more[key]} more" if more[key] else ""
        yield f"  {name}{others}: {words}"
    if more[None]:
        yield f"  and {more[None]} more, all in the report."


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
    """ADSs in order of S+, each with the difference to the first of its place; the first of a
    place has it to the first of the place above. No lines for one ADS.
    """
    if ranking is None or len(ranking.ads) < 2:
        return []
    weights = ", ".join(f"{name} {weight:g}" for name, weight in ranking.weights.items())
    weighed = f" (weights: {weights})" if set(ranking.weights.values()) != {1.0} else ""
    lines = [
        f"Ranking by S+ over all scenarios{weighed}{parts_of_total(ranking)}; "
        f"{ranking.level:z.0%} intervals:"
    ]
    first = ""  # in the current place
    for ads in ranking.ads:
        if ads.place is None or ads.s_plus is None:
            lines.append(f"  not ranked: {one_line(ads.ads)} has no S+ in some scenario")
            continue
        interval = f" ({interval_words(ads.interval, 1)})" if ads.interval else ""
        words = f"  {ads.place}. {one_line(ads.ads)}  {number(ads.s_plus, 1)}{interval}"
        if first:
            pair = ranking.pair(first, ads.ads)  # S+ of the first minus that of this one
            low, high = pair.interval or (0.0, 0.0)
            ends = f" ({interval_words((-high, -low), 1)})" if pair.interval else ""
            words += f"  {number(-pair.difference, 1)}{ends} to {one_line(first)}"
            # two ADSs with S+ = 0 in every resample are `scored_alike`, however their cases differ
            alike = pair.scored_alike and ads.s_plus != 0.0
            why = "scored alike in every case" if alike else "not told apart"
            words += "" if pair.told_apart else f": {why}, the place is shared"
        lines.append(words)
        first = first if first and not pair.told_apart else ads.ads
    return lines


# --- two runs -------------------------------------------------------------------------------------

MOST_CHANGES = 10  # of one kind on a terminal; the report has all of them


def comparison_lines(
    comparison: Comparison, gates: Sequence[GateResult], evaluation: Evaluation
) -> list[str]:
    """Changes between two runs: verdict, flipped cases, quantities, gates."""
    lines = [verdict(comparison, gates, evaluation).sentence]
    lines += [*difference_lines(comparison), *change_lines(comparison)]
    return [*lines, *gate_lines(gates, Path(comparison.new_folder))]


def difference_lines(comparison: Comparison) -> list[str]:
    """Differences in anything but the ADS; one in capitals forbids the comparison."""
    return [
        f"{'DIFFERS' if difference.decides else 'differs'}: {one_line(difference.words)}"
        for difference in comparison.differences
    ]


def change_lines(comparison: Comparison) -> list[str]:
    """Changes between two runs: notes, then for each ADS flipped cases and quantities."""
    lines = [*map(one_line, comparison_notes(comparison))]
    for part in comparison.ads:
        lines.append(
            f"{one_line(part.ads)} in {part.scenario}: {count(part.pairs, 'case')} side by side"
        )
        for kind in (*WORSE, *BETTER):
            cases = part.changed.of(kind)
            if not len(cases):
                continue
            lines.append(f"  {kind}: {len(cases)}")
            for item in islice(cases, MOST_CHANGES):
                unit = part.units[1]  # of U
                by = "".join(f", {words}" for words in moved_words(item, unit))
                lines.append(
                    f"    {one_line(item.new.case)}: {one_line(point_words(item.new.values))}{by}"
                )
            if len(cases) > MOST_CHANGES:
                lines.append(f"    and {len(cases) - MOST_CHANGES} more, all in the report.")
        for name, change in part.quantities.items():
            lines.append(f"  {name}: {quantity_words(name, change, comparison.confidence)}")
    return lines


def comparison_notes(comparison: Comparison) -> Iterator[str]:
    """Notes on ADSs and cases that are left out, or have another name or zone in the base."""
    for new, base in comparison.supposed.items():
        yield f"`{new}` is compared with `{base}`: each run has one ADS only."
    for name in comparison.only_new:
        yield f"ADS `{name}` is not in the base, so nothing is said of how it changed."
    for name in comparison.only_base:
        yield f"ADS `{name}` of the base is not in the new run."
    every = [part.changed.paired for part in comparison.ads]
    if unpaired := sum(len(paired.lost) + len(paired.added) for paired in every):
        cases = count(unpaired, "case")
        yield f"{cases} exist in one run only and are left out; every value is over the rest."
    if moved := sum(int((paired.base.safe != paired.new.safe).sum()) for paired in every):
        yield f"{count(moved, 'case')} lie in another zone than in the base."


_SEEN = 5e-4
"""Smaller changes of the quantities that move a score are not listed."""


def moved_words(item: ChangedCase, unit: str) -> list[str]:
    """Differences of a changed case: of U, if it is harsher or softer, and of what moves a score.

    unit: of U.
    """
    about_impact = item.change in ("harsher", "softer")
    words = [f"U {item.by:+z.3g}{unit}"] if about_impact and item.by is not None else []
    return [*words, *(f"{name} {by:+z.3g}" for name, by in item.moved.items() if abs(by) >= _SEEN)]


def gate_lines(
    gates: Sequence[GateResult],
    run: Path | None = None,
    since: Mapping[LimitName, str] | None = None,
) -> list[str]:
    """Limits that failed with their worst cases, those not evaluated, and how many passed.

    run: folder of the cases, for commands that replay and drive one of them.
    since: name of a limit -> since when it fails, in words.
    """
    lines = []
    for gate in failed(gates):
        beside = [f"beside the accepted {gate.against}"] if gate.against else []
        beside += [since[gate.name]] if since and gate.name in since else []
        when = f" ({', '.join(beside)})" if beside else ""
        where = f"{one_line(gate.ads)} in {gate.scenario}"
        lines.append(f"gate FAILED: {where}: {gate.sentence}{when}")
        lines += [f"    {line}" for line in worst_lines(gate, run)]
    passed = count(sum(gate.passed is True for gate in gates), "gate")
    return [*lines, *_unjudged_lines(gates), *([f"{passed} passed."] if gates else [])]


def worst_lines(gate: GateResult, run: Path | None) -> list[str]:
    """The worst cases of a failed limit, before and after, and how the first of them is seen again.

    run: the folder whose cases they are.
    """
    lines = [one_line(f"{change.case}: {change.point}: {change.words}") for change in gate.worst]
    ways = ways_to(run, gate.worst[0].case) if gate.worst and run is not None else {}
    return [*lines, *(f"{name}: {way}" for name, way in ways.items())]


def ways_to(run: Path, case: str) -> dict[str, str]:
    """Commands that show a case again and drive it alone, and its place in the report."""
    return {
        "again": shlex.join(["sumo-eval", "replay", str(run), case]),
        "alone": shlex.join(["sumo-eval", "run", str(run), "--only", case]),
        "page": f"{run / REPORT}#case:{case_key(case)}",
    }


def _unjudged_lines(gates: Sequence[GateResult]) -> Iterator[str]:
    """Limits that could not be evaluated, those with one reason on one line."""
    # by reason, and by ADS where a gate is `blind` (its cases cannot show a change)
    unjudged = grouped(
        ((gate.ads if gate.blind else "", gate.reason or gate.sentence), gate)
        for gate in gates
        if gate.passed is None
    )
    for (ads, reason), alike in unjudged.items():
        first = alike[0]
        if ads:
            yield f"{one_line(ads)}: {', '.join(gate.blind for gate in alike)}: {reason}"
        elif len(alike) > 1:
            yield f"{count(len(alike), 'gate')} not evaluated: {reason}"
        else:
            where = f"{one_line(first.ads)} in {first.scenario}"
            yield f"gate not evaluated: {where}: {first.sentence}"


def quantity_words(name: str, change: QuantityChange, confidence: float) -> str:
    """`71.20 -> 70.10, -1.10 (95% interval of the difference: -2.00 to -0.40)`; without an
    interval `71.20 -> 70.10`; `71.20, unchanged`; `not computed in either run`.
    """
    # one digit more than the table has
    digits = 1 + (SCORES[name][1] if name in SCORES else 3)
    old, new = (
        "not computed" if value is None else number(value, digits)
        for value in (change.base, change.new)
    )
    if change.base is None and change.new is None:
        return f"{new} in either run"
    if change.difference is None or change.low is None or change.high is None:
        return f"{old} -> {new}"
    if change.unchanged:
        return f"{new}, unchanged"
    moved, low, high = (
        f"{value:+z.{digits}f}" for value in (change.difference, change.low, change.high)
    )
    interval = f"({confidence:z.0%} interval of the difference: {low} to {high})"
    return f"{old} -> {new}, {moved} {interval}"


# --- where the points went ------------------------------------------------------------------------

MOST_ENTRIES = 3  # cases of a line of the ledger on a terminal


def ledger_lines(evaluation: Evaluation) -> list[str]:
    """The ledger of every score, with the cases that moved each term most."""
    return [
        line
        for findings in findings_of(evaluation)
        # made in turn, never both in memory: each holds what every case adds to every line
        for make in (ledger_plus, ledger)
        for line in _ledger_lines(make(findings))
    ]


def cause_of(line: LedgerLine, score: ScenarioResult) -> str:
    """Reason why a line of the ledger gained or lost its points."""
    if line.cause != NOT_COMPUTED:
        return line.cause
    cause = f"{line.term} {line.cause}"
    if line.term == "T":
        return f"{cause}: {REASON_WITHOUT_T}"
    reason = reason_without(line.term, score) if line.term in ("H", "D") else ""
    return f"{cause}: {reason}" if reason else cause


def ledger_sentences(account: Ledger) -> list[str]:
    """The lines that cost points, the costliest first: `H lost 6.1 of 100 points: plausibility in
    14 cases.`
    """
    # all points that a term can give: in the ledger of S its line without cases, in that of S+ FULL
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
    subject = f"{one_line(account.score.ads)} in {account.score.scenario}"
    lines = [f"{subject}: {ledger_words(account, 2)}"]
    for line in account.lines:
        cases = f", {count(line.cases, 'case')}" if line.entries else ""
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
