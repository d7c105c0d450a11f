"""The sections of the report, in their order.

A new one is a line in SECTIONS and a file in templates/sections/.

A section's template sees what all sections share (`html._context`) and, as `content.<name>`, what
its own function returned. A section whose function returns None is left out, so optional data has a
section only where it exists.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from sumo_eval.cases import CaseResult
from sumo_eval.report.checks import checks_content
from sumo_eval.report.comparison import (
    BETTER,
    WORSE,
    AdsComparison,
    ChangedCase,
    Comparison,
    QuantityChange,
)
from sumo_eval.report.confidence_section import confidence_content
from sumo_eval.report.gate_settings import HIGHER_IS_BETTER
from sumo_eval.report.gates import GateResult
from sumo_eval.report.ledger import Ledger, ledger, ledger_plus, sentences
from sumo_eval.report.opinion_section import opinion_content
from sumo_eval.report.people import people_context
from sumo_eval.report.qualification import qualification_content
from sumo_eval.report.summary import summary_content
from sumo_eval.report.terminal import moved_words, quantity_words, ways_to
from sumo_eval.report.verdict import verdict
from sumo_eval.report.words import number, parts_of_total
from sumo_eval.results import Evaluation
from sumo_eval.scoring.confidence.assessment import Confidence
from sumo_eval.scoring.findings import findings

MOST_LEDGER_CASES = 5  # of one line of the ledger
MOST_CHANGED = 200  # cases in the table of changes


@dataclass(frozen=True, slots=True)
class Beside:
    """Content of a report in addition to the evaluation; without its part, a section is left out.

    comparison, gates: the change since an earlier run.
    since: when failed limits began to fail, in words, by their names.
    notes: whole sentences about it.
    confidence: how far the scores can be trusted.
    """

    comparison: Comparison | None = None
    gates: tuple[GateResult, ...] = ()
    since: Mapping[tuple[str, str, str], str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    confidence: Confidence | None = None


Content = Callable[[Evaluation, Beside], Mapping[str, Any] | None]


@dataclass(frozen=True, slots=True)
class Section:
    """One section: name of its template and anchor, words in the navigation, and what only it needs
    to know.

    about: what a reader finds in it, beside its title while it is folded.
    folded: whether it opens on demand.
    """

    name: str
    title: str
    content: Content
    about: str = ""
    folded: bool = True


def always(evaluation: Evaluation, beside: Beside) -> Mapping[str, Any]:
    """A section that is there in every report and needs nothing of its own."""
    return {}


def summary_section(evaluation: Evaluation, beside: Beside) -> Mapping[str, Any]:
    """The first screen."""
    return summary_content(evaluation, beside.comparison, beside.gates, beside.since)


def change_content(evaluation: Evaluation, beside: Beside) -> Mapping[str, Any] | None:
    """Verdict, gates, flipped cases and differences; nothing where no earlier run was looked
    for.
    """
    comparison = beside.comparison
    if comparison is None and not beside.gates and not beside.notes:
        return None
    ads, confidence = (comparison.ads, comparison.confidence) if comparison else ((), 0.0)
    found = [one.changed for one in ads]
    changed = [
        *islice((case for one in found for case in one.worse), MOST_CHANGED),
        *islice((case for one in found for case in one.better), MOST_CHANGED),
    ]
    of = sum(map(len, found))
    return {
        "verdict": verdict(comparison, beside.gates, evaluation).sentence,
        "failed": any(gate.passed is False for gate in beside.gates),
        "comparison": comparison,
        "notes": (*beside.notes, *(comparison.notes if comparison else ())),
        "gates": [
            (gate, beside.since.get(gate.name, ""), _alone(gate, comparison))
            for gate in sorted(
                beside.gates, key=lambda gate: (gate.passed is not False, gate.passed is None)
            )
        ],
        "counts": [_counts(one, confidence) for one in ads],
        "cases": [_changed(item) for item in changed[:MOST_CHANGED]],
        "more": max(0, of - MOST_CHANGED),
    }


def _counts(one: AdsComparison, confidence: float) -> tuple[Any, ...]:
    """One ADS in one scenario: itself, its changes by kind, moved and unchanged quantities."""
    kinds = [(kind, len(one.changed.of(kind)), kind in WORSE) for kind in (*WORSE, *BETTER)]
    values = one.quantities
    moved = [
        (name, quantity_words(name, it, confidence).replace("->", "→"), _standing(name, it))
        for name, it in values.items()
        if not it.unchanged
    ]
    unchanged = [name.replace("_", " ") for name, it in values.items() if it.unchanged]
    return one, [kind for kind in kinds if kind[1]], moved, unchanged


def _alone(gate: GateResult, comparison: Comparison | None) -> str:
    """The command that drives the worst case of a limit alone."""
    if comparison is None or not gate.worst:
        return ""
    return ways_to(Path(comparison.new_folder), gate.worst[0].case)["alone"]


def _standing(name: str, value: QuantityChange) -> str:
    """Whether a change is certain, and for better or for worse: the class of its word."""
    if not value.certain or value.difference is None:
        return ""
    return "good" if (value.difference > 0.0) == (name in HIGHER_IS_BETTER) else "bad"


def _changed(item: ChangedCase) -> dict[str, Any]:
    return {
        "it": item,
        "by": ", ".join(moved_words(item)),
        "base": _outcome(item.base),
        "new": _outcome(item.new),
    }


def _outcome(case: CaseResult) -> str:
    if case.severity is not None:
        return f"U {number(case.severity, 1)} m/s"
    likeness = [
        f"{name} {number(value, 3)}"
        for name, value in (("H_i", case.human_likeness), ("D_i", case.index))
        if value is not None
    ]
    return ", ".join([case.status, *likeness])


def ledger_content(evaluation: Evaluation, beside: Beside) -> Mapping[str, Any]:
    """The ledgers of every S+ and S."""
    return {
        "ledgers": [
            (_ledger(ledger_plus(one)), _ledger(ledger(one))) for one in findings(evaluation)
        ]
    }


def _ledger(found: Ledger) -> dict[str, Any]:
    return {
        "name": found.name,
        "ads": found.ads,
        "scenario": found.scenario,
        "total": found.total,
        "sentences": sentences(found),
        "lines": [
            {
                "term": line.term,
                "equation": line.equation,
                "words": line.words,
                "index": line.index,
                "points": line.points,
                "number": line.cases if line.entries else "",
                "cases": list(line.worst(MOST_LEDGER_CASES)),
            }
            for line in found.lines
        ],
    }


def confidence_section(evaluation: Evaluation, beside: Beside) -> Mapping[str, Any] | None:
    """Intervals, risk, coverage and the most telling further cases, where they were assessed."""
    return None if beside.confidence is None else confidence_content(evaluation, beside.confidence)


def ranking_content(evaluation: Evaluation, beside: Beside) -> Mapping[str, Any] | None:
    """The ADSs in order of S+ over all scenarios; nothing where they were not ranked."""
    found = evaluation.ranking
    if found is None:
        return None
    weights = {name: f"{weight:g}" for name, weight in found.weights.items()}
    return {
        "weights": weights if len(set(weights.values())) > 1 else {},
        "level": f"{100.0 * found.level:g} %",
        "parts": parts_of_total(found),
        "found": found,
    }


SECTIONS = (
    Section("summary", "In short", summary_section, folded=False),
    Section("change", "Change", change_content, folded=False),
    Section("verdict", "Scores", always, "every score with its interval, and why it is what it is"),
    Section(
        "ranking",
        "Ranking",
        ranking_content,
        "the order of the ADSs, and which differences may be chance",
    ),
    Section("ledger", "Ledger", ledger_content, "where the points of each score went"),
    Section(
        "maps",
        "Maps and cases",
        always,
        "every case in its place; choose axes and slices, filter, groups of failures",
    ),
    Section("case", "One case", always, "replay, paths, speed, fields and measures of a case"),
    Section("likeness", "Human-likeness", always, "H, D and their factors, case by case"),
    Section(
        "people",
        "The drivers",
        lambda evaluation, _: people_context(evaluation),
        "how human the humans are",
    ),
    Section(
        "opinion",
        "Opinion",
        lambda evaluation, _: opinion_content(evaluation.folder),
        "what people gave the ADSs",
    ),
    Section(
        "checks",
        "Checks",
        lambda evaluation, _: checks_content(evaluation),
        "what must hold in every drive, row by row",
    ),
    Section("collisions", "Collisions", always, "every collision and what it cost"),
    Section("preventability", "Preventability", always, "which collisions the reference avoids"),
    Section("missing", "Not evaluated", always, "cases that left the means, and why"),
    Section(
        "confidence",
        "Confidence",
        confidence_section,
        "where the intervals come from, what the cases cover",
    ),
    Section(
        "qualification",
        "Qualification",
        lambda evaluation, _: qualification_content(evaluation),
        "whether the tool found known answers again on this machine",
    ),
    Section("zones", "Zones", always, "safe and hazardous parts of each space"),
    Section("glossary", "Glossary", always, "every term in plain words"),
    Section(
        "settings", "Settings", always, "readings of the method, every setting, how to reproduce"
    ),
)
