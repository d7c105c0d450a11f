"""Tables for machines: one CSV row a case, and the scores as JSON.

Users: `nightly/night.py`, `report/junit.py`.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path

from pydantic_core import from_json, to_json

from sumo_eval.cases import CaseResult
from sumo_eval.report.checks import checked_cases
from sumo_eval.report.notes import (
    exposure_note_words,
    index_note_words,
    reference_note_words,
    score_note,
)
from sumo_eval.report.page import Json, write_csv, write_json
from sumo_eval.report.score_words import not_computed
from sumo_eval.results import Evaluation
from sumo_eval.scoring.findings import people_behind
from sumo_eval.scoring.preventability import preventability, reference_ads
from sumo_eval.text import cell, point_words

CHECKS = "checks.csv"
_DERIVED = "d_i", "departed", "gave_up", "incident_severity"
"""Columns behind the fields of `CaseResult`, which follow from these."""
_IN_WORDS: dict[str, Callable[[CaseResult], str]] = {
    "index_note": index_note_words,
    "reference_note": reference_note_words,
    "exposure_note": exposure_note_words,
}
# the parameters come behind these, everything else behind the parameters
_FIRST = "case", "scenario", "ads"
_REST = tuple(item.name for item in fields(CaseResult) if item.name not in (*_FIRST, "values"))


def cases_csv(evaluation: Evaluation, path: Path) -> None:
    """Write one row a case, empty where a value does not apply.

    SI units, as in `sumo_eval.results.CaseResult`.

    Parameters have a column each under their own name; one that is called like another column is
    `parameter_<name>`. Text that a spreadsheet would run as a formula begins with `'`.
    """
    # the first case of each ADS and scenario names the scenario's parameters
    firsts = [next(iter(evaluation.cases_behind(it)), None) for it in evaluation.scores]
    parameters = list(dict.fromkeys(name for case in firsts if case for name in case.values))
    columns = (*_FIRST, *_REST, *_DERIVED)
    headings = [f"parameter_{name}" if name in columns else name for name in parameters]
    cases = evaluation.cases
    severities = (
        None if math.isnan(value) else value for value in cases.incident_severity.tolist()
    )
    # of each case the values of `_DERIVED` behind the first, `d_i`
    derived = zip(cases.departed.tolist(), cases.gave_up.tolist(), severities, strict=True)
    rows = (
        (
            *(getattr(case, name) for name in _FIRST),
            *(case.values.get(name) for name in parameters),
            *(
                _IN_WORDS[name](case) if name in _IN_WORDS else getattr(case, name)
                for name in _REST
            ),
            case.index,
            *rest,
        )
        for case, rest in zip(cases, derived, strict=True)
    )
    names = (*_FIRST, *headings, *_REST, *_DERIVED)
    write_csv(path, map(cell, names), (map(cell, it) for it in rows))


def write_tables(evaluation: Evaluation) -> None:
    """Write scores.json and cases.csv into the evaluation's folder; checks.csv where a scenario has
    requirements.
    """
    write_json(evaluation.folder / "scores.json", scores_json(evaluation), "The scores")
    cases_csv(evaluation, evaluation.folder / "cases.csv")
    if evaluation.checks:
        rows = (
            map(cell, (it.case, it.scenario, it.ads, point_words(it.values), name, text,
                checked.verdict_of(name)))
            for checked in checked_cases(evaluation)
            for it in [checked.case]
            for name, text in evaluation.checks[it.scenario].items()
        )  # fmt: skip
        write_csv(
            evaluation.folder / CHECKS,
            ("case", "scenario", "ads", "point", "check", "condition", "verdict"),
            rows,
        )


def scores_json(evaluation: Evaluation) -> Json:
    """The scores as plain values that are valid JSON: None where a number is not known or was not
    computed.
    """
    settings = evaluation.settings
    content = {
        "name": evaluation.name,
        "format_version": evaluation.manifest.get("format_version"),
        "versions": evaluation.manifest.get("versions", {}),
        "seed": settings.seed,
        "severity": evaluation.manifest.get("severity", {}),
        "points": {"a": settings.method.score.a, "b": settings.method.score.b},
        "drivers": {"source": settings.drivers.source, "count": settings.drivers.count},
        "recorded_people": people_behind(evaluation),
        "not_evaluated": evaluation.not_evaluated,
        "scores": [
            asdict(score)
            | {
                "d_reason": not_computed("D", score),
                "h_reason": not_computed("H", score),
                "notes": [score_note(note) for note in score.notes],
            }
            for score in evaluation.scores
        ],
        "ranking": evaluation.ranking,
        "preventability": {
            "reference": reference_ads(settings) or "ideal vehicle",
            "rows": preventability(evaluation),
        },
        "exposure": evaluation.exposures,
        "zones": evaluation.zones,
    }
    plain: Json = from_json(to_json(content, inf_nan_mode="null"))
    return plain
