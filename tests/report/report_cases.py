"""Cases of the evaluation made by hand, picked and changed: what the tests of comparison, gates and
JUnit share."""

import tomllib
from dataclasses import replace

import builders
from builders import CALM

from sumo_eval.nightly.history import Night
from sumo_eval.scoring.findings import Findings
from sumo_eval.settings import CollisionSettings


def every(evaluation, which=lambda case: True, **values):
    """The evaluation with all cases, or some, changed."""
    cases = (replace(case, **values) if which(case) else case for case in evaluation.cases)
    return replace(evaluation, cases=tuple(cases))


def with_case(evaluation, case, **values):
    return every(evaluation, lambda it: it.case == case.case, **values)


def calm(evaluation, **values):
    """A run in which every case of `calm` that ended well has these values."""
    return every(evaluation, lambda it: it.ads == CALM and it.status == "ok", **values)


def pick(evaluation, *, collided, zone="hazardous"):
    return next(
        case
        for case in evaluation.cases
        if case.ads == CALM and case.evaluated and (case.collided, case.zone) == (collided, zone)
    )


def with_scores(evaluation, **values):
    """The evaluation with every score changed."""
    scores = (replace(score, **values) for score in evaluation.scores)
    return replace(evaluation, scores=tuple(scores))


def with_settings(evaluation, **values):
    return replace(evaluation, settings=replace(evaluation.settings, **values))


def with_losses(evaluation, **collision):
    """The run with another loss of a collision."""
    method = replace(evaluation.settings.method, collision=CollisionSettings(**collision))
    return with_settings(evaluation, method=method)


def findings(evaluation, ads, place):
    """The score of an ADS in the scenario of this place, and its findings."""
    score = evaluation.score(ads, builders.SCENARIOS[place])
    return score, Findings.of(evaluation, score)


def night(name, status=0, verdict="", wall_time=1.0):
    place = f"nights/{name}"
    return Night(name, "made", place, wall_time, status, None, verdict, "0.1", "1.28", False)


HIT = tomllib.loads("""
status = "collision"
collided = true
impact_speed = 5.0
overlap = 1.0
side = "front"
severity = 5.0
loss = 0.4
ideal_severity = 0.0
weight = 0.5
end_reason = "contact"
""")  # fmt: skip
