"""What a run says at its end on a terminal or in a log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

from sumo_eval.report.comparison import BETTER, WORSE, Comparison, QuantityChange
from sumo_eval.report.gates import GateResult
from sumo_eval.report.ledger import ledger
from sumo_eval.report.words import (
    REASON_WITHOUT_C,
    count,
    drivers_are_synthetic,
    drivers_sentence,
    number,
    point,
    reason_without_d,
    unevaluated,
)
from sumo_eval.results import CaseResult, Evaluation, ScenarioResult

COLUMNS = (
    "ADS", "scenario", "collisions", "avoidable", "in safe zone", "A", "H", "S+", "C", "D", "S", "cases",
    "not evaluated",
)  # fmt: skip
NOT_COMPUTED = "not computed"
LONGEST_SENTENCE = 200  # characters of an error on a terminal; the report has all of it
MOST_LISTED = 5  # kinds of cases that could not be evaluated; the report lists the cases


def score_table(evaluation: Evaluation) -> Table:
    """The scores of every ADS in every logical scenario, for a terminal."""
    title = f"{evaluation.name}: A at most 1, H, C and D within 0..1, S+ and S of 100 points"
    table = Table(title=Text(title), title_justify="left")
    for index, heading in enumerate(COLUMNS):
        table.add_column(heading, justify="left" if index < 2 else "right", overflow="fold")
    for position, score in enumerate(evaluation.scores):
        last_of_scenario = (
            position + 1 < len(evaluation.scores) and evaluation.scores[position + 1].scenario != score.scenario
        )
        # Text, because an ADS may be called `[red]`: rich would read that as a colour.
        table.add_row(
            *(Text(cell, _style(cell, heading)) for cell, heading in _row(score)), end_section=last_of_scenario
        )
    return table


def plain_table(evaluation: Evaluation) -> str:
    """The same table as aligned text without lines, for logs and pipes."""
    rows = [COLUMNS, *(tuple(cell for cell, _ in _row(score)) for score in evaluation.scores)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def closing_lines(evaluation: Evaluation) -> list[str]:
    """What a person must know besides the table, one sentence a line."""
    lines = [
        f"C of {score.ads} in {score.scenario} is not computed: {REASON_WITHOUT_C}. Its term counts 0 points."
        for score in evaluation.scores
        if score.c is None
    ]
    lines += [
        f"D of {score.ads} in {score.scenario} is not computed: {reason_without_d(score)}. Its term counts 0 points."
        for score in evaluation.scores
        if score.d is None
    ]
    lines += [
        f"H of {score.ads} in {score.scenario} is {score.h_reason}. Its term counts 0 points of S+."
        for score in evaluation.scores
        if score.human_likeness is None and score.h_reason
    ]
    missing = unevaluated(evaluation)
    if missing:
        lines.append(f"{count(len(missing), 'case')} could not be evaluated and left the means:")
        kinds = _by_kind(missing)
        lines += [f"  {_of_a_kind(kind)}" for kind in kinds[:MOST_LISTED]]
        rest = sum(len(kind) for kind in kinds[MOST_LISTED:])
        if rest:
            lines.append(f"  and {rest} more, all in the report.")
    lines += [
        f"{score.ads} in {score.scenario}: {note}"
        for score in evaluation.scores
        for note in score.notes
        if "could not be evaluated" not in note  # said above, with the cases
    ]
    lines += [f"Zones of {zone.scenario}: {note}" for zone in evaluation.zones for note in zone.notes]
    if drivers_are_synthetic(evaluation.settings):
        lines.append(drivers_sentence(evaluation.settings))
    lines.append(f"The report is {evaluation.folder / 'report.html'}")
    return lines


def _by_kind(missing: Sequence[tuple[CaseResult, str]]) -> list[list[tuple[CaseResult, str]]]:
    """The cases that could not be evaluated, those together that one ADS lost at one place of its code, or with one
    sentence; in the order of the first of each kind.
    """
    kinds: dict[tuple[str, str, str], list[tuple[CaseResult, str]]] = {}
    for case, sentence in missing:
        kinds.setdefault((case.ads, case.status, case.error_place or sentence), []).append((case, sentence))
    return list(kinds.values())


def _of_a_kind(kind: Sequence[tuple[CaseResult, str]]) -> str:
    """The first case of a kind and its sentence, how many more there are, and where in the ADS's code it happened."""
    case, sentence = kind[0]
    more = f" and {len(kind) - 1} more" if len(kind) > 1 else ""
    place = f" At {_one_line(case.error_place)}." if case.error_place else ""
    return f"{_one_line(case.case)}{more}: {_shortened(_one_line(sentence))}{place}"


def _row(score: ScenarioResult) -> list[tuple[str, str]]:
    cells = (
        score.ads,
        score.scenario,
        str(score.collisions),
        str(score.avoidable_collisions),
        str(score.safe_collisions),
        _or_not_computed(score.avoided_share, 3),
        _or_not_computed(score.human_likeness, 3),
        _or_not_computed(score.s_plus, 1),
        _with_interval(_or_not_computed(score.c, 3), score.c_interval, 3),
        _with_interval(_or_not_computed(score.d, 3), score.d_interval, 3),
        _with_interval(_or_not_computed(score.s, 1), score.s_interval, 1),
        str(score.cases),
        str(score.not_evaluated),
    )
    return [(_one_line(cell), heading) for cell, heading in zip(cells, COLUMNS, strict=True)]


def _or_not_computed(value: float | None, digits: int) -> str:
    return NOT_COMPUTED if value is None else number(value, digits)


def _with_interval(cell: str, interval: tuple[float, float] | None, digits: int) -> str:
    """A value whose cases are not all there is never shown without what it could have been."""
    if interval is None:
        return cell
    return f"{cell} ({number(interval[0], digits)}..{number(interval[1], digits)})"


def _style(cell: str, heading: str) -> str:
    """Bold for the score, yellow for what a person should look into."""
    warns = cell.startswith(NOT_COMPUTED) or (heading in {"avoidable", "in safe zone", "not evaluated"} and cell != "0")
    if warns:
        return "yellow"
    return "bold" if heading in {"S+", "S"} else ""


def _shortened(sentence: str) -> str:
    return sentence if len(sentence) <= LONGEST_SENTENCE else f"{sentence[: LONGEST_SENTENCE - 2]} …"


def _one_line(text: str) -> str:
    """Without line breaks and without control characters, which would repaint a terminal."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


# --- two runs ---------------------------------------------------------------------------------------------------------

MOST_CHANGES = 10  # of one kind on a terminal; the report has all of them
_COMPARED = {"S": 2, "C": 4, "D": 4, "collision_probability": 6}


def comparison_lines(comparison: Comparison, gates: Sequence[GateResult]) -> list[str]:
    """What changed between two runs: verdict first, then what flipped, then the quantities, then the gates."""
    lines = [verdict_of(comparison, gates)]
    lines += [
        f"{'DIFFERS' if other.decides else 'differs'}: {_one_line(other.words)}" for other in comparison.differences
    ]
    lines += [_one_line(note) for note in comparison.notes]
    for one in comparison.ads:
        lines.append(f"{_one_line(one.ads)} in {one.scenario}: {count(one.pairs, 'case')} side by side")
        for kind in (*WORSE, *BETTER):
            found = [item for item in one.changed if item.change == kind]
            if not found:
                continue
            lines.append(f"  {kind}: {len(found)}")
            for item in found[:MOST_CHANGES]:
                by = "" if item.by is None else f", {item.by:+.3g} {'m/s' if kind in ('harsher', 'softer') else ''}"
                lines.append(f"    {_one_line(item.new.case)}: {_one_line(point(item.new.values))}{by.rstrip()}")
            if len(found) > MOST_CHANGES:
                lines.append(f"    and {len(found) - MOST_CHANGES} more, all in the report.")
        for name, change in one.quantities.items():
            lines.append(f"  {name}: {quantity_words(name, change, comparison.confidence)}")
    return [*lines, *gate_lines(gates)]


def gate_lines(gates: Sequence[GateResult]) -> list[str]:
    """A line for each gate that failed or could not be judged, and the number of those that passed."""
    marks = {False: "FAILED", None: "not judged"}
    lines = [
        f"gate {marks[gate.passed]}: {_one_line(gate.ads)} in {gate.scenario}: {gate.sentence}"
        for gate in gates
        if gate.passed is not True
    ]
    return [*lines, f"{count(sum(gate.passed is True for gate in gates), 'gate')} passed."]


def quantity_words(name: str, change: QuantityChange, confidence: float) -> str:
    """`71.20 -> 70.10, -1.10 (95 %: -2.00 to -0.40)`."""
    digits = _COMPARED.get(name, 3)
    values = " -> ".join(
        NOT_COMPUTED if value is None else f"{value:.{digits}f}" for value in (change.base, change.new)
    )
    if change.difference is None or change.low is None or change.high is None:
        return values
    if change.difference == change.low == change.high == 0.0:
        return f"{change.new:.{digits}f}, unchanged"
    interval = f"{change.low:+.{digits}f} to {change.high:+.{digits}f}"
    return f"{values}, {change.difference:+.{digits}f} ({confidence:.0%} interval of the difference: {interval})"


def verdict_of(comparison: Comparison | None, gates: Sequence[GateResult]) -> str:
    """One sentence for somebody who reads no further."""
    bad = sum(gate.passed is False for gate in gates)
    if comparison is None:
        beside = "there is no earlier good run to compare with"
        return f"NOT GOOD: {count(bad, 'gate')} failed; {beside}." if bad else f"NO GATE FAILED; {beside}."
    base = Path(comparison.base_folder).name
    worse, better = len(comparison.worse), len(comparison.better)
    moved = f"{count(worse, 'case')} got worse, {better} better"
    if bad:
        return f"WORSE than {base}: {count(bad, 'gate')} failed; {moved}."
    if not worse and not better:
        return f"THE SAME as {base}: no case changed, and every gate holds."
    return f"NO GATE FAILED beside {base}: {moved}."


# --- where the points went --------------------------------------------------------------------------------------------

MOST_ENTRIES = 3  # cases of a line of the ledger on a terminal


def ledger_lines(evaluation: Evaluation) -> list[str]:
    """The ledger of every score, with the cases that moved each term most."""
    lines = []
    for score in evaluation.scores:
        found = ledger(evaluation, score)
        lines.append(f"{_one_line(score.ads)} in {score.scenario}: S = {found.total:.2f}")
        for line in found.lines:
            cases = f", {count(line.cases, 'case')}" if line.entries else ""
            lines.append(
                f"  {line.points:+8.2f}  {line.term} {line.index:+.4f}  Eq. {line.equation}: {line.words}{cases}"
            )
            lines += [
                f"            {entry.points:+8.2f}  {_one_line(entry.case.case)}: {_one_line(point(entry.case.values))}"
                for entry in line.entries[:MOST_ENTRIES]
                if entry.points < 0.0
            ]
        lines.append(f"  {found.total:8.2f}  S, the sum")
    return lines
