"""Cases of the evaluation made by hand, picked and changed: what the tests of comparison, gates and
JUnit share."""

from dataclasses import replace

import builders


def with_case(evaluation, key, change):
    """The evaluation with one case changed."""
    return replace(
        evaluation,
        cases=tuple(change(case) if case.case == key else case for case in evaluation.cases),
    )


def calm(evaluation, **values):
    """A run in which every case of `calm` that ended well has these values."""
    cases = [
        replace(case, **values) if case.ads == builders.CALM and case.status == "ok" else case
        for case in evaluation.cases
    ]
    return replace(evaluation, cases=tuple(cases))


def pick(evaluation, *, collided, zone="hazardous"):
    return next(
        case
        for case in evaluation.cases
        if case.ads == builders.CALM
        and case.evaluated
        and (case.collided, case.zone) == (collided, zone)
    )


def hit(case):
    return replace(
        case, status="collision", collided=True, impact_speed=5.0, overlap=1.0, side="front",
        severity=5.0, loss=0.4,
        ideal_severity=0.0, weight=0.5, end_reason="contact",
    )  # fmt: skip
