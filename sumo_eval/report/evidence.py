"""Evidence for a safety case: what a run claims of each ADS, why that follows, what it rests on,
and what stays open.

Claim - argument - evidence, as assessors of type approval ask for it. A claim that the facts do not
bear out is written down as such: `supported`, `not supported`, or `open` where nothing could be
evaluated.

Users: `cli/look.py`.
"""

from collections.abc import Iterator
from dataclasses import asdict, replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.frozen import frozen
from sumo_eval.input_file import MANIFEST, hash_of
from sumo_eval.record.run_folder import EVALUATION, EXPOSURES
from sumo_eval.record.store import FACTS
from sumo_eval.report.checks import FAILED, PASSED, checked_cases
from sumo_eval.report.page import write_filled, write_json
from sumo_eval.report.people import people_sentence
from sumo_eval.report.qualification import holds, qualification_sentence
from sumo_eval.report.words import count, reference_sentence, sampling_words
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.confidence.assessment import risk_of
from sumo_eval.scoring.confidence.intervals import LEVEL
from sumo_eval.scoring.preventability import preventability_of, reference_ads, verdicts

FORMAT_VERSION = 1
PAGE, PLAIN = "evidence.html", "evidence.json"
MOST_CASES = 50  # at most, in a claim; cases.csv has all
Support = Literal["supported", "not supported", "open"]


@frozen
class Claim:
    """One claim, its argument and its evidence.

    interval: of the number that the claim is about, with its level; None: it is about none.
    cases: keys of the cases that speak against the claim, at most `MOST_CASES`.
    assumptions: conditions that must hold and that the run does not show.
    """

    id: str
    ads: str
    scenario: str
    claim: str
    verdict: Support
    argument: str
    evidence: tuple[str, ...] = ()
    interval: dict[str, float] | None = None
    cases: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()


@frozen
class Evidence:
    """Evidence that a run gives.

    claims: of every ADS in every scenario.
    run: what identifies it.
    hashes: SHA-256 of its files.
    """

    run: dict[str, str]
    hashes: dict[str, str]
    qualification: str
    qualified: bool
    reference: str
    people: str
    claims: tuple[Claim, ...]


def evidence_of(evaluation: Evaluation) -> Evidence:
    """The evidence that a scored run gives."""
    manifest, folder = evaluation.manifest, evaluation.folder
    hashes = {
        name: hash_of(folder / name, "file")
        for name in (MANIFEST, EVALUATION, FACTS, EXPOSURES)
        if (folder / name).is_file()
    }
    run = {
        "id": hashes[MANIFEST][:16], "name": evaluation.name, "folder": str(folder),
        "created": str(manifest.get("created", "")), "seed": str(evaluation.settings.seed),
        **{name: str(value) for part in ("versions", "machine")
           for name, value in manifest.get(part, {}).items()}
    }  # fmt: skip
    claims = tuple(claim for score in evaluation.scores for claim in _claims(evaluation, score))
    return Evidence(
        run, hashes, qualification_sentence(manifest), holds(manifest),
        reference_sentence(evaluation.settings),
        people_sentence(evaluation), claims
    )  # fmt: skip


def write_evidence(evaluation: Evaluation, out: Path) -> tuple[Path, Path]:
    """Write `evidence.html` and `evidence.json` into a folder and return their paths."""
    evidence = evidence_of(evaluation)
    html = write_filled(out / PAGE, "evidence.html.j2", "The file", evidence=evidence)
    content = {"format_version": FORMAT_VERSION, **asdict(evidence)}
    return html, write_json(out / PLAIN, content, "The file")


def _claims(evaluation: Evaluation, score: ScenarioResult) -> Iterator[Claim]:
    """The claims about one ADS in one scenario."""
    cases = evaluation.cases_behind(score)
    about = f"{score.ads} in {score.scenario}"
    yield _complete(about, score, cases)
    assumptions = tuple(_assumptions(evaluation, score))
    makers = [_collisions, _preventable, _avoided]
    if score.scenario in evaluation.checks:
        makers.append(_checked)
    for make in makers:
        yield replace(make(evaluation, about, score, cases), assumptions=assumptions)


def _claim(
    score: ScenarioResult, kind: str, against: CaseTable | None = None, **parts: Any
) -> Claim:
    """A claim with its id.

    kind: last part of the id.
    against: cases that speak against it.
    """
    named = () if against is None else tuple(case.case for case in against[:MOST_CASES])
    return Claim(
        f"{score.scenario}/{score.ads}/{kind}", score.ads, score.scenario, cases=named, **parts
    )  # fmt: skip


def _complete(about: str, score: ScenarioResult, cases: CaseTable) -> Claim:
    missing = cases[~cases.evaluated]
    return _claim(
        score, "complete",
        claim=f"Every concrete scenario that was chosen for {about} was driven and evaluated.",
        verdict="not supported" if len(missing) else "supported",
        argument="Cases are counted when they are planned and when they are stored; one without "
                 "an outcome is named.",
        evidence=(f"{len(cases) - len(missing)} of {count(len(cases), 'case')} have an outcome "
                  "that counts.",),
        against=missing
    )  # fmt: skip


def _collisions(
    evaluation: Evaluation, about: str, score: ScenarioResult, cases: CaseTable
) -> Claim:
    """Collision share < p: p is the upper end of its interval."""
    under = (
        "this exposure"
        if evaluation.exposure_known(score.scenario)
        else "equal weights of its points"
    )
    evaluated = cases[cases.evaluated]
    hit = evaluated[evaluated.collided]
    risk = risk_of(evaluated, score, evaluation.settings.seed)
    if risk is None:
        return _claim(
            score, "collisions", claim=f"The collision share of {about} is known.", verdict="open",
            argument="An interval needs two evaluated cases with exposure.",
            evidence=(f"{count(len(evaluated), 'case')} evaluated.",), against=hit
        )  # fmt: skip
    share = risk.collision_probability
    return _claim(
        score, "collisions",
        claim=f"The collision share of {about} is below "
              f"{_outward(share.high, ROUND_CEILING)} in this space under {under}.",
        verdict=(  # a case that was not evaluated may have collided
            "not supported" if score.not_evaluated else "open" if share.high >= 1.0 else "supported"
        ),
        argument="Upper end of the two-sided interval of the weighted share: a bootstrap over the "
                 "cases, but at least the exact binomial limit of no collision in as many equally "
                 "frequent cases as tell as much.",
        evidence=(
            f"{count(len(hit), 'collision')} in {count(len(evaluated), 'evaluated case')}.",
            f"As informative as {risk.effective_cases:z.1f} equally frequent cases."
        ),
        interval={"estimate": share.value, "low": share.low, "high": share.high,
                  "level": share.level},
        against=hit
    )  # fmt: skip


def _preventable(
    evaluation: Evaluation, about: str, score: ScenarioResult, cases: CaseTable
) -> Claim:
    """In the words of assessors: unpreventable for a skilled driver, preventable for the ADS."""
    row = preventability_of(evaluation, score)
    skilled = reference_ads(evaluation.settings) or "the ideal vehicle"
    undecided = row.undecided + row.not_evaluated
    return _claim(
        score, "preventability",
        claim=f"{about} has no incident that is preventable for a skilled driver.",
        verdict="not supported" if row.preventable else "open" if undecided else "supported",
        argument=f"The skilled driver is {skilled}, driven through each concrete scenario beside "
                 "the ADS: an incident (collision, leaving the road, giving up) is unpreventable "
                 "for it where it has one as well.",
        evidence=(
            f"{count(row.incidents, 'incident')}: {row.preventable} preventable for a skilled "
            "driver, "
            f"{row.unpreventable} unpreventable for a skilled driver, {row.undecided} undecided.",
            f"{count(row.better, 'case')} unpreventable for a skilled driver, preventable for the "
            "ADS.",
            f"{row.off_road} left the road, {row.gave_up} given up, {row.not_evaluated} not "
            f"evaluated, of {count(row.cases, 'case')}."
        ),
        against=cases[np.isin(verdicts(evaluation, score), ["preventable", "undecided"])]
    )  # fmt: skip


def _avoided(evaluation: Evaluation, about: str, score: ScenarioResult, cases: CaseTable) -> Claim:
    """The avoided share A is above the lower end of its interval."""
    ends = score.avoided_share_interval
    # where harm is at stake, collisions that the points may have missed keep this end below 1
    if ends is not None and ends[0] >= 1.0:
        return _claim(
            score, "avoided", claim=f"{about} had harm to avoid.", verdict="open",
            argument="Where a car that does nothing hits no harder than the ideal vehicle, A is 1 "
                     "for every ADS.",
            evidence=(f"In none of {count(len(cases), 'case')} a car that does nothing does more "
                      "harm.",)
        )  # fmt: skip
    if score.avoided_share is None or ends is None:
        return _claim(
            score, "avoided", claim=f"The avoided share A of {about} is known.", verdict="open",
            argument="A needs evaluated cases, its interval two of them."
        )  # fmt: skip
    return _claim(
        score, "avoided",
        claim=f"{about} avoids at least {_outward(ends[0], ROUND_FLOOR)} of the harm that the "
              "ideal vehicle avoids and a car that does nothing does not.",
        verdict="supported" if ends[0] > 0.0 else "open",
        argument="Lower end of the interval of A = 1 - sum w max(0, U - Ug) / sum w max(0, U0 - "
                 "Ug) over all evaluated cases; cases without an outcome count as worst.",
        evidence=(
            f"A = {score.avoided_share:z.3g}; "
            f"{count(score.avoidable_collisions, 'avoidable collision')}, "
            f"{score.unavoidable_collisions} unavoidable.",
        ),
        interval={"estimate": score.avoided_share, "low": ends[0], "high": ends[1],
                  "level": LEVEL},
        against=cases[cases.avoidable]
    )  # fmt: skip


def _outward(end: float, rounding: str) -> str:
    """An end of an interval in three digits, rounded outward: a claim never exceeds it."""
    return f"{float(Context(prec=3, rounding=rounding).create_decimal(repr(float(end)))):z.3g}"


def _checked(evaluation: Evaluation, about: str, score: ScenarioResult, cases: CaseTable) -> Claim:
    verdicts_of = [checked.verdict for checked in checked_cases(evaluation, (score,))]
    failed = cases[np.array(verdicts_of) == FAILED]
    number, passed = len(verdicts_of), verdicts_of.count(PASSED)
    checks = evaluation.checks[score.scenario]
    return _claim(
        score, "checks",
        claim=f"{about} passes every check of the scenario in every case that was driven.",
        verdict=(
            "not supported" if len(failed) else "supported" if passed == number else "open"
        ),
        argument=f"{count(len(checks), 'condition')} on the whole drive, each evaluated on the "
                 "recorded trajectories.",
        evidence=(
            f"{passed} of {count(number, 'case')} pass all.",
            *(f"{name}: {text}" for name, text in checks.items())
        ),
        against=failed
    )  # fmt: skip


def _assumptions(evaluation: Evaluation, score: ScenarioResult) -> Iterator[str]:
    """Conditions of the claims on a scenario that the run does not show."""
    entry, logical = next(
        pair for pair in evaluation.resolved.entries if pair[1].name == score.scenario
    )
    zone = next(it for it in evaluation.zones if it.scenario == score.scenario)
    yield (
        f"{count(zone.sampled, 'point')} ({sampling_words(entry.sampling, logical)}) stand for the "
        "space; what lies outside of it is not claimed."
    )
    if not evaluation.exposure_known(score.scenario):
        yield "The frequency of concrete scenarios is not known: every point counts the same."
    yield (
        "Vehicles are rectangles on a single-track model, and SUMO moves actors by their scripts."
    )
    conditions = evaluation.settings.simulation.conditions
    varied = any(name.startswith("conditions.") for name in logical.names)
    if conditions == type(conditions)() and not varied:  # all of them are the defaults
        yield "The ADS perceives without error and without delay: no conditions are set."
    if zone.zones == 0:
        yield "No hazardous zone was found or could be defined: every case counts as safe."
    if not holds(evaluation.manifest):
        yield qualification_sentence(evaluation.manifest)
    if score.not_evaluated:
        yield f"{count(score.not_evaluated, 'case')} could not be evaluated."
