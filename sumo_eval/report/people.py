"""The report's section on the drivers: their own scores beside D, thin references, exposure."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from sumo_eval.errors import InputError, said
from sumo_eval.input_file import read_input_text
from sumo_eval.report.verdict import Beside
from sumo_eval.report.words import TWO_GROUPS, count, percent
from sumo_eval.results import Evaluation
from sumo_eval.scoring.driver_bands import DriverBand, below_drivers, driver_bands
from sumo_eval.text import capitalised

MOST_WORST = 10  # cases
STUDY: Final = "study.json"
"""Beside the drives of a study: who took part, what was left out and why."""


def people_context(evaluation: Evaluation, _: Beside) -> dict[str, Any]:
    """Content of templates/sections/people.html.j2."""
    return {
        "mode": evaluation.settings.method.anthropomorphic.mode,
        "rows": people_rows(evaluation),
        "worst": below_drivers(evaluation, MOST_WORST),
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
    """A row for each score whose cases have a D_i: its ADS beside the drivers."""
    return [
        {
            "of": band,
            "drivers": f"{'–'.join(dict.fromkeys(map(str, band.drivers))) or 'no'} a case, "
            f"{percent(band.recorded)} recorded",
            "warnings": _warnings(band),
        }
        for band in driver_bands(evaluation)
    ]  # fmt: skip


def _warnings(band: DriverBand) -> list[str]:
    """Limitations of the numbers."""
    said = (
        ("Reference too thin in {}.", band.thin),
        ("{} outside the support of the recorded exposure.", band.outside),
        (f"In {{}} {TWO_GROUPS}", band.bimodal),
        ("In {} no driver made the ADS's manoeuvre.", band.unlike),
    )
    return [words.format(count(number, "case")) for words, number in said if number]
