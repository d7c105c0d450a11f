"""The drivers that D and H compare with: their source, their own D compared with the D of each
ADS, thin references, exposure, and the study that they took part in.

Users: `extras/wheel/outcome.py`, `report/assessed.py`, `report/evidence.py`, `report/html.py`,
`report/sections.py`, `report/terminal.py`.
"""

import json
from collections.abc import Mapping

from sumo_eval.input_file import read_input_text, taking_apart
from sumo_eval.report.page import Json
from sumo_eval.report.score_words import TWO_GROUPS
from sumo_eval.report.verdict import Additions
from sumo_eval.report.words import count, percent
from sumo_eval.results import Evaluation
from sumo_eval.scoring.driver_bands import below_drivers, driver_bands
from sumo_eval.scoring.findings import people_behind
from sumo_eval.settings import DriverSettings
from sumo_eval.text import capitalised

MOST_WORST = 10  # cases in the table of the worst, at most
STUDY = "study.json"
"""File beside the drives of a study, written by `extras/wheel/outcome.py`: number of participants,
drives left out and why.
"""


def people_context(evaluation: Evaluation, _: Additions) -> Json:
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
            f"them count, {len(left_out)} {'is' if len(left_out) == 1 else 'are'} left out."
        )
        if drawn := study.get("drawn"):
            words += f" The road was drawn for them in these ways: {drawn_words(drawn)}."
        return [words, *left_out]


def people_rows(evaluation: Evaluation) -> list[Json]:
    """A row for each score whose cases have a D_i: its ADS beside the drivers."""
    return [
        {
            "of": band,
            # Fewest and most drivers of a case: `3–10`; `10` where both are equal, as
            # `dict.fromkeys` drops the second; `no` without any.
            "drivers": f"{'–'.join(dict.fromkeys(map(str, band.drivers))) or 'no'} a case",
            "recorded": f"{percent(band.recorded)} recorded",
            "warnings": [
                words.format(count(cases, "case"))
                for words, cases in (
                    ("Reference too thin in {}.", band.thin),
                    ("{} outside the support of the recorded exposure.", band.outside),
                    ("In {} " + TWO_GROUPS, band.bimodal),
                    ("In {} no driver made the ADS's manoeuvre.", band.unlike)
                )
                if cases
            ]
        }
        for band in driver_bands(evaluation)
    ]  # fmt: skip


def nobody_recorded(evaluation: Evaluation) -> bool:
    """Whether recorded drivers were asked for, and none stands behind any D_i."""
    recorded = evaluation.settings.drivers.source == "recorded"
    return recorded and not any(people.drives for people in people_behind(evaluation))


def nobody_drove(evaluation: Evaluation) -> bool:
    """Whether no scenario has drivers to compare an ADS with: synthetic drivers cannot drive it,
    and it has no others.
    """
    return bool(evaluation.scores) and all(score.nobody_compared for score in evaluation.scores)


def people_sentence(evaluation: Evaluation) -> str:
    """The drivers that D and H compare with, how many of them are recorded people, and how many
    drives of these each limit leaves out.
    """
    drivers = evaluation.settings.drivers
    recorded = drivers.source == "recorded"
    without = dict.fromkeys(score.scenario for score in evaluation.scores if score.nobody_compared)
    if nobody_drove(evaluation):
        others = {
            "synthetic": "this evaluation names no recorded ones",
            "recorded": "no recorded driver matches them",
        }.get(drivers.source, f"`{drivers.source}` returns no drive in them")
        words = (
            "D and H have no drivers to compare with: synthetic drivers do not cover these scenes, "
            f"and {others}."
        )
    else:
        words = _recorded_drivers(evaluation) if recorded else _other_drivers(drivers)
        words += f" There are none in {', '.join(without)}." if without else ""
    # the settings are asked: a run that was resumed with other drivers may have earlier counts
    if recorded and (short := sum(drives for drives, _, _ in evaluation.left_out)):
        most = max(share for _, share, _ in evaluation.left_out)
        words += (
            f" {count(short, 'recorded drive')} left out: at most {percent(most)} "
            f"of the road covered, at least {percent(drivers.coverage)} asked "
            "(`drivers.coverage`)."
        )
    if recorded and (astray := sum(drives for _, _, drives in evaluation.left_out)):
        words += f" {count(astray, 'recorded drive')} left out: they leave the road."
    return words


def _other_drivers(drivers: DriverSettings) -> str:
    """Drivers that are not recorded people."""
    return (
        f"The {drivers.count} human drivers of each concrete scenario are synthetic: "
        "drawn from distributions fitted to recorded traffic. They are not recorded people."
        if drivers.source == "synthetic"
        else f"The human drivers come from `{drivers.source}`, which this evaluation names as "
        "its reference."
    )


def _recorded_drivers(evaluation: Evaluation) -> str:
    """Recorded drivers of each scenario, and the treatment of points with too few of them."""
    drivers, behind = evaluation.settings.drivers, people_behind(evaluation)
    source = ", ".join(drivers.recordings) or drivers.cases
    fills = drivers.too_thin == "fill"
    if not any(people.drives for people in behind):
        instead = "D and H compare with synthetic drivers alone" if fills else "there is no D_i"
        who = (
            "no drive counts in any"
            if fills
            else f"fewer than {drivers.least} drives count in each"
        )
        points = count(sum(people.points for people in behind), "safe concrete scenario")
        return (
            f"D and H use no recorded driver: of {source}, {who} of these {points}; "
            f"{instead}. `recorded_drivers` in cases.csv counts them."
        )
    fill = "synthetic drivers fill up, in scenes that they know"
    rest = fill if fills else "the point is left out"
    each = "; ".join(
        f"{people.scenario}: {people.with_people} of "
        f"{count(people.points, 'safe concrete scenario')}, "
        f"{count(people.drives, 'recorded drive')}"
        for people in behind
    )
    return (
        f"Recorded people ({source}) stand behind D and H in {each}. Where they are fewer than "
        f"{drivers.least}, {rest}."
    )
