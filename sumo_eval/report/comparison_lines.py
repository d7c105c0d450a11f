"""Lines on two runs, for a terminal or a log: changed cases and quantities, and the gates.

Users: `cli/compare.py`, `nightly/morning.py`, `report/junit.py`, `report/sections.py`.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

from sumo_eval.groups import grouped
from sumo_eval.report.gate_result import GateResult, LimitName, failed
from sumo_eval.report.page import REPORT, case_key
from sumo_eval.report.verdict import verdict
from sumo_eval.report.words import confidence_words, count, number, one_line
from sumo_eval.results import Evaluation
from sumo_eval.scoring.case_terms import SCORES
from sumo_eval.scoring.comparison import (
    BETTER,
    WORSE,
    AdsComparison,
    ChangedCase,
    Comparison,
    QuantityChange,
)
from sumo_eval.text import point_words

MOST_CHANGES = 10  # of one kind on a terminal; `--junit` lists all


def comparison_lines(
    comparison: Comparison, gates: Sequence[GateResult], evaluation: Evaluation
) -> list[str]:
    """Changes between two runs: verdict, flipped cases, quantities, gates."""
    return [
        verdict(comparison, gates, evaluation).sentence,
        *difference_lines(comparison),
        *change_lines(comparison),
        *gate_lines(gates, comparison.new_folder),
    ]


def difference_lines(comparison: Comparison) -> list[str]:
    """Differences in anything but the ADS; one in capitals forbids the comparison."""
    return [
        f"{'DIFFERS' if difference.decides else 'differs'}: {one_line(difference.words)}"
        for difference in comparison.differences
    ]


def change_lines(comparison: Comparison) -> Iterator[str]:
    """Changes between two runs: notes, then for each ADS flipped cases and quantities."""
    yield from map(one_line, comparison_notes(comparison))
    for part in comparison.ads:
        yield f"{one_line(part.ads)} in {part.scenario}: {count(part.pairs, 'case')} side by side"
        yield from _changed_lines(part)
        for name, change in part.quantities.items():
            yield f"  {name}: {quantity_words(name, change, comparison.confidence)}"


def _changed_lines(part: AdsComparison) -> Iterator[str]:
    """Changed cases of an ADS; worse cases come before better cases."""
    for kind in (*WORSE, *BETTER):
        cases = part.changed.of(kind)
        if len(cases):
            yield f"  {kind}: {len(cases)}"
        for item in islice(cases, MOST_CHANGES):
            words = one_line(f"{item.new.case}: {point_words(item.new.values)}")
            moved = moved_words(item, part.units[1])  # unit of U in the new run
            yield "    " + ", ".join([words, *moved])
        if len(cases) > MOST_CHANGES:
            more = len(cases) - MOST_CHANGES
            yield f"    and {more} more; `sumo-eval compare --junit` lists all."


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
    if other := sum(int((paired.base.exposure != paired.new.exposure).sum()) for paired in every):
        yield f"The exposure differs from the base in {count(other, 'case')}."


_LEAST_SHOWN = 5e-4
"""Smaller changes of a case's quantities are not listed."""


def moved_words(item: ChangedCase, unit: str) -> list[str]:
    """Differences of a changed case: of U, if it is harsher or softer, and of what moves a score.

    unit: of U.
    """
    about_impact = item.change in ("harsher", "softer")
    words = [f"U {item.by:+z.3g}{unit}"] if about_impact and item.by is not None else []
    return [
        *words,
        *(f"{name} {by:+z.3g}" for name, by in item.moved.items() if abs(by) >= _LEAST_SHOWN),
    ]


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
        lines.append(_failure_line(gate, (since or {}).get(gate.name)))
        lines += [f"    {line}" for line in worst_lines(gate, run)]
    passed = count(sum(gate.passed is True for gate in gates), "gate")
    return [*lines, *_not_evaluated_lines(gates), *([f"{passed} passed."] if gates else [])]


def _failure_line(gate: GateResult, since: str | None) -> str:
    """A failed limit, the night that it was compared with, and since when it fails."""
    base = f"beside the accepted {gate.against}" if gate.against else ""
    remarks = ", ".join(filter(None, (base, since)))
    words = f"gate FAILED: {one_line(gate.ads)} in {gate.scenario}: {gate.sentence}"
    return f"{words} ({remarks})" if remarks else words


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


def _not_evaluated_lines(gates: Sequence[GateResult]) -> Iterator[str]:
    """Limits that could not be evaluated, those with one reason on one line."""
    # by reason, and by ADS where a gate is `blind` (its cases cannot show a change)
    not_evaluated = grouped(
        ((gate.ads if gate.blind else "", gate.reason or gate.sentence), gate)
        for gate in gates
        if gate.passed is None
    )
    for (ads, reason), alike in not_evaluated.items():
        if ads:
            yield f"{one_line(ads)}: {', '.join(gate.blind for gate in alike)}: {reason}"
        elif len(alike) > 1:
            yield f"{count(len(alike), 'gate')} not evaluated: {reason}"
        else:
            [gate] = alike
            where = f"{one_line(gate.ads)} in {gate.scenario}"
            yield f"gate not evaluated: {where}: {gate.sentence}"


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
    interval = f"({confidence_words(confidence)} interval of the difference: {low} to {high})"
    return f"{old} -> {new}, {moved} {interval}"
