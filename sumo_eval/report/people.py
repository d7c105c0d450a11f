"""The report's section on the drivers: their own D compared with that of each ADS, thin references,
exposure, and the study that they took part in.

Users: `extras/wheel/outcome.py`, `report/assessed.py`, `report/sections.py`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from sumo_eval.input_file import read_input_text, taking_apart
from sumo_eval.report.verdict import Additions
from sumo_eval.report.words import TWO_GROUPS, count, percent
from sumo_eval.results import Evaluation
from sumo_eval.scoring.driver_bands import below_drivers, driver_bands
from sumo_eval.text import capitalised

MOST_WORST = 10  # cases in the table of the worst, at most
STUDY: Final = "study.json"
"""File beside the drives of a study, written by `extras/wheel/outcome.py`: number of participants,
drives left out and why.
"""


def people_context(evaluation: Evaluation, _: Additions) -> dict[str, Any]:
    """Content of templates/sections/people.html.j2. `_`: a page calls all sections alike."""
    return {
        "mode": evaluation.settings.method.anthropomorphic.mode,
        "rows": people_rows(evaluation),
        "worst": below_drivers(evaluation, MOST_WORST),
        "study": study_sentences(evaluation),
        "exposures": [
            (name, f"{capitalised(str(exposure.get('about', 'not recorded')))}.")
            for name, exposure in evaluation.exposures.items()
        ],
    }


def drawn_words(drawn: Mapping[str, int]) -> str:
    """Ways in which the participants' screens showed the road, each with its number of drives.

    drawn: description of a way -> number of drives.
    """
    return ", ".join(f"{words} ({count(drives, 'drive')})" for words, drives in drawn.items())


def study_sentences(evaluation: Evaluation) -> list[str]:
    """The study that the drivers come from: its participants and how the road was drawn, then a
    sentence for each drive left out, with the reason. Empty without a study.

    Raises InputError where the study's file cannot be read.
    """
    cases = evaluation.settings.drivers.cases
    path = evaluation.source / cases / STUDY
    if not cases or not path.exists():
        return []
    text = read_input_text(path, "study")
    with taking_apart(path, "`sumo-eval drive STUDY.toml --collect` writes it again."):
        study = json.loads(text)
        left_out = [f"{it['participant']}, {it['case']}: {it['why']}." for it in study["left_out"]]
        words = (
            f"{count(study['people'], 'person', 'people')} took part in the study "
            f"{study['study']}; {count(study['drives'], 'drive')} by {study['with_drives']} of "
            f"them count, {len(left_out)} {'is' if len(left_out) == 1 else 'are'} left out by the "
            "study's rules of quality."
        )
        if drawn := study.get("drawn"):
            words += f" The road was drawn for them in these ways: {drawn_words(drawn)}."
        return [words, *left_out]


def people_rows(evaluation: Evaluation) -> list[dict[str, Any]]:
    """A row for each score whose cases have a D_i: its ADS beside the drivers."""
    return [
        {
            "of": band,
            # `band.drivers`: fewest and most of a case, or empty. Becomes `3–10`, `10` where both
            # are equal (`dict.fromkeys` keeps one of them), `no` where empty
            "drivers": f"{'–'.join(dict.fromkeys(map(str, band.drivers))) or 'no'} a case, "
            f"{percent(band.recorded)} recorded",
            "warnings": [
                words.format(count(cases, "case"))
                for words, cases in (
                    ("Reference too thin in {}.", band.thin),
                    ("{} outside the support of the recorded exposure.", band.outside),
                    ("In {} " + TWO_GROUPS, band.bimodal),
                    ("In {} no driver made the ADS's manoeuvre.", band.unlike),
                )
                if cases
            ],
        }
        for band in driver_bands(evaluation)
    ]  # fmt: skip
