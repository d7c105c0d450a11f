"""The sections of the report, in their order.

To add one: a `Section` in SECTIONS, and a template `templates/sections/<name>.html.j2` with
`<section id="<name>">`; if it has data of its own, also a function that makes them, its `content`.

A section's template sees what all sections share (`html._context`) and, as `content.<name>`, what
its own function returned. A section whose function returns None is left out, so optional data has a
section only where it exists.

Users: `report/html.py`.
"""

from collections.abc import Callable, Mapping
from itertools import islice
from typing import Any, NamedTuple

from sumo_eval.cases import CaseResult
from sumo_eval.report.checks import checks_content
from sumo_eval.report.comparison_lines import comparison_notes, moved_words, quantity_words, ways_to
from sumo_eval.report.confidence_section import confidence_content
from sumo_eval.report.gate_result import failed
from sumo_eval.report.levers_section import levers_content
from sumo_eval.report.opinion_section import opinion_content
from sumo_eval.report.page import Json
from sumo_eval.report.people import people_context
from sumo_eval.report.qualification import qualification_content
from sumo_eval.report.readings import settings_content
from sumo_eval.report.score_words import parts_of_total
from sumo_eval.report.summary import summary_content
from sumo_eval.report.terminal import cause_of, ledger_sentences, ledger_words
from sumo_eval.report.verdict import Additions, verdict
from sumo_eval.report.words import number, severity_words
from sumo_eval.results import Evaluation
from sumo_eval.scoring.comparison import BETTER, WORSE, AdsComparison, QuantityChange
from sumo_eval.scoring.findings import findings_of
from sumo_eval.scoring.gate_settings import HIGHER_IS_BETTER
from sumo_eval.scoring.ledger import Ledger, ledger, ledger_plus
from sumo_eval.scoring.preventability import preventability, reference_ads

MOST_LEDGER_CASES = 5  # of one line of the ledger
MOST_CHANGED = 200  # cases in the table of changes


Content = Callable[[Evaluation, Additions], Mapping[str, Any] | None]
"""Makes what the template of a section sees as `content.<name>`; None: the section is left out."""


class Section(NamedTuple):
    """One section.

    name: of its template, and of its anchor in the page.
    title: words in the navigation.
    about: its content in a few words, next to its title while it is folded.
    content: makes its data; default: no data of its own, so it is in every report.
    folded: whether it opens on demand.
    """

    name: str
    title: str
    about: str = ""
    content: Content = lambda *_: {}
    folded: bool = True


def change_content(evaluation: Evaluation, additions: Additions) -> Json | None:
    """Verdict, gates, changed cases and changed quantities; None without a comparison, gates and
    notes.
    """
    comparison = additions.comparison
    if comparison is None and not additions.gates and not additions.notes:
        return None
    ads = comparison.ads if comparison else ()
    changed = (
        (case, *part.units)
        for direction in ("worse", "better")
        for part in ads
        for case in getattr(part.changed, direction)
    )
    return {
        "verdict": verdict(comparison, additions.gates, evaluation).sentence,
        "failed": bool(failed(additions.gates)),
        "comparison": comparison,
        "notes": (*additions.notes, *(comparison_notes(comparison) if comparison else ())),
        "gates": [
            (
                gate,
                additions.since.get(gate.name, ""),
                # the command that drives its worst case alone
                ways_to(comparison.new_folder, gate.worst[0].case)["alone"]
                if comparison and gate.worst
                else "",
            )
            for gate in additions.gates
        ],
        "counts": [_counts(part, comparison.confidence if comparison else 0.0) for part in ads],
        "cases": [
            {
                "it": item,
                "by": ", ".join(moved_words(item, new_unit)),
                "base": _outcome(item.base, base_unit),
                "new": _outcome(item.new, new_unit),
            }
            for item, base_unit, new_unit in islice(changed, MOST_CHANGED)
        ],
        "more": max(0, sum(len(part.changed) for part in ads) - MOST_CHANGED),
    }


def _counts(part: AdsComparison, confidence: float) -> tuple[Any, ...]:
    """One ADS in one scenario, as four values for the template.

    The comparison; (kind, number of cases, whether for the worse) of each kind of change; (name,
    words, CSS class) of each moved quantity; names of the unchanged quantities.
    """
    kinds = [(kind, len(part.changed.of(kind)), kind in WORSE) for kind in (*WORSE, *BETTER)]
    values = part.quantities
    moved = [
        (name, quantity_words(name, it, confidence).replace("->", "→"), _standing(name, it))
        for name, it in values.items()
        if not it.unchanged
    ]
    unchanged = [name.replace("_", " ") for name, it in values.items() if it.unchanged]
    return part, [kind for kind in kinds if kind[1]], moved, unchanged


def _standing(name: str, value: QuantityChange) -> str:
    """CSS class of a change: `good` or `bad`; "" where the change is not certain."""
    if not value.certain or value.difference is None:
        return ""
    return "good" if (value.difference > 0.0) == (name in HIGHER_IS_BETTER) else "bad"


def _outcome(case: CaseResult, unit: str) -> str:
    if case.severity is not None:
        return f"U {severity_words(case.severity, unit)}"
    values = ("H_i", case.human_likeness), ("D_i", case.index)
    likeness = [f"{name} {number(value, 3)}" for name, value in values if value is not None]
    return ", ".join([case.status, *likeness])


def ledger_content(evaluation: Evaluation, additions: Additions) -> Json:
    """The ledgers of every S+ and S, each with its sentences and the cases that cost most."""
    return {
        "ledgers": [
            (_ledger(ledger_plus(findings)), _ledger(ledger(findings)))
            for findings in findings_of(evaluation)
        ]
    }


def _ledger(item: Ledger) -> Json:
    return {
        "of": item,
        "sentences": ledger_sentences(item),
        "lines": [
            (line, cause_of(line, item.score), list(line.worst(MOST_LEDGER_CASES)))
            for line in item.lines
        ],
        "words": ledger_words(item, 1),  # its heading, `S+ = 63.3`
    }


def preventability_content(evaluation: Evaluation, _: Additions) -> Json:
    """Cases of every ADS beside those of the reference."""
    return {"rows": preventability(evaluation), "reference": reference_ads(evaluation.settings)}


def ranking_content(evaluation: Evaluation, additions: Additions) -> Json | None:
    """The ADSs in order of S+ over all scenarios; None where they were not ranked."""
    ranking = evaluation.ranking
    if ranking is None:
        return None
    weights = {name: f"{weight:g}" for name, weight in ranking.weights.items()}
    return {
        "weights": weights if len(set(weights.values())) > 1 else {},
        "level": f"{100.0 * ranking.level:g} %",
        "parts": parts_of_total(ranking),
        "order": ranking.ads,
        "pairs": ranking.pairs,
    }


SECTIONS = (
    Section("summary", "In short", content=summary_content, folded=False),
    Section("change", "Change", content=change_content, folded=False),
    Section("levers", "Levers", content=levers_content, folded=False),
    Section("verdict", "Scores", "every score with its interval, and why it is what it is"),
    Section(
        "ranking",
        "Ranking",
        "the order of the ADSs, and which differences may be chance",
        ranking_content,
    ),
    Section("ledger", "Ledger", "where the points of each score went", ledger_content),
    Section(
        "maps",
        "Maps and cases",
        "every case in its place; choose axes and slices, filter, groups of failures",
    ),
    Section("case", "One case", "replay, paths, speed, fields and measures of a case"),
    Section("likeness", "Human-likeness", "H, D and their factors, case by case"),
    Section("people", "The drivers", "how human the humans are", people_context),
    Section(
        "opinion",
        "Opinion",
        "what people gave the ADSs",
        lambda run, _: opinion_content(run.folder),
    ),
    Section("checks", "Checks", "what must hold in every drive, row by row", checks_content),
    Section("collisions", "Collisions", "every collision and what it cost"),
    Section(
        "preventability",
        "Preventability",
        "which collisions the reference avoids",
        preventability_content,
    ),
    Section("missing", "Not evaluated", "cases that left the means, and why"),
    Section(
        "confidence",
        "Confidence",
        "where the intervals come from, what the cases cover",
        confidence_content,
    ),
    Section(
        "qualification",
        "Qualification",
        "whether the tool found known answers again on this machine",
        qualification_content,
    ),
    Section("zones", "Zones", "safe and hazardous parts of each space"),
    Section("glossary", "Glossary", "every term in plain words"),
    Section(
        "settings",
        "Settings",
        "readings of the method, every setting, how to reproduce",
        settings_content,
    ),
)
