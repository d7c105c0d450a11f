"""The report's section on the drivers: their own scores beside D, thin references, exposure."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from sumo_eval.cases import CaseTable
from sumo_eval.errors import InputError, said
from sumo_eval.input_file import read_input_text
from sumo_eval.report.verdict import Beside
from sumo_eval.report.words import TWO_GROUPS, count, number, percent
from sumo_eval.results import Evaluation
from sumo_eval.scoring.findings import findings, mean_of
from sumo_eval.text import capitalised

MOST_WORST = 10  # cases
STUDY: Final = "study.json"
"""Beside the drives of a study: who took part, what was left out and why."""


def people_context(evaluation: Evaluation, _: Beside) -> dict[str, Any]:
    """Content of templates/sections/people.html.j2."""
    return {
        "mode": evaluation.settings.method.anthropomorphic.mode,
        "rows": people_rows(evaluation),
        "worst": worst_cases(evaluation),
        "study": study_sentences(evaluation),
        "exposures": [
            (name, f"{capitalised(str(found.get('about', 'not recorded')))}.")
            for name, found in evaluation.exposures.items()
        ],
    }


def drawn_words(drawn: Mapping[str, int]) -> str:
    """In which ways the road was drawn for people who drove, each with its number of drives."""
    return ", ".join(f"{words} ({count(drives, 'drive')})" for words, drives in drawn.items())


def study_sentences(evaluation: Evaluation) -> list[str]:
    """Participants of the study that the drivers come from, and the drives it left out with their
    reasons; none without a study.

    Raises InputError where the study's file cannot be read.
    """
    cases = evaluation.settings.drivers.cases
    if not cases:
        return []
    path = evaluation.source / cases / STUDY
    if not path.exists():
        return []
    text = read_input_text(path, "study")
    try:
        told = json.loads(text)
        left = [f"{it['participant']}, {it['case']}: {it['why']}." for it in told["left_out"]]
        drawn = told.get("drawn", {})
        everybody = (
            f"{count(told['people'], 'person', 'people')} took part in the study {told['study']}"
        )
        return [
            f"{everybody}; {count(told['drives'], 'drive')} by {told['with_drives']} of them "
            f"count, {len(left)} {'is' if len(left) == 1 else 'are'} left out by the study's rules "
            "of quality.",
            *(
                [f"The road was drawn for them in these ways: {drawn_words(drawn)}."]
                if drawn
                else []
            ),
            *left,
        ]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path} cannot be read ({said(error)}); `sumo-eval drive STUDY.toml --collect` "
            "writes it again."
        ) from error


def people_rows(evaluation: Evaluation) -> list[dict[str, Any]]:
    """A row for each score whose cases have a D_i: its ADS beside the drivers who were each left
    out once, means weighted by exposure.
    """
    rows = []
    for one in findings(evaluation):
        score, own = one.score, one.cases[one.indexed]
        if not len(own):
            continue
        drivers, banded = own.drivers, np.isfinite(own.human_mean).sum()
        below = (own.index < own.human_low).sum()
        numbers = np.unique(drivers[np.isfinite(drivers)]).astype(int).tolist()
        recorded, everybody = (int(np.nansum(values)) for values in (own.recorded_drivers, drivers))
        range_ = "–".join(dict.fromkeys(str(n) for n in (*numbers[:1], *numbers[-1:]))) or "no"
        low, mean, high = (
            mean_of(getattr(own, f"human_{end}"), own.exposure) for end in ("low", "mean", "high")
        )
        rows.append({
            "scenario": score.scenario, "ads": score.ads, "d": number(score.d, 3),
            "low": number(low, 3), "mean": number(mean, 3), "high": number(high, 3),
            "below": f"{below} of {banded}",
            "drivers": f"{range_} a case, {percent(recorded / everybody if everybody else 0.0)} "
                       "recorded",
            "warnings": _warnings(own),
        })  # fmt: skip
    return rows


def _warnings(cases: CaseTable) -> tuple[str, ...]:
    """Limitations of the numbers on the safe cases with a D_i.

    cases: these.
    """
    said = (
        ("Reference too thin in {}.", sum(note is not None for note in cases.reference_note)),
        ("{} outside the support of the recorded exposure.", (cases.exposure_note != "").sum()),
        (f"In {{}} {TWO_GROUPS}", cases.bimodal.sum()),
        ("In {} no driver made the ADS's manoeuvre.", (cases.manoeuvre_share == 0.0).sum()),
    )
    return tuple(words.format(count(int(number), "case")) for words, number in said if number)


def worst_cases(evaluation: Evaluation) -> CaseTable:
    """The cases in which an ADS scores furthest below the drivers' own mean."""
    cases, below = evaluation.cases, evaluation.cases.index - evaluation.cases.human_mean
    places = np.flatnonzero(below < 0.0)
    return cases[places[np.lexsort((cases.case[places], below[places]))[:MOST_WORST]]]
