"""Cases of the evaluation made by hand, picked and changed: what the tests of comparison, gates and
JUnit share."""

from collections.abc import Callable
from dataclasses import replace

import builders

from sumo_eval.cases import CaseResult
from sumo_eval.results import Evaluation


def with_case(
    evaluation: Evaluation, key: str, change: Callable[[CaseResult], CaseResult]
) -> Evaluation:
    """The evaluation with one case changed."""
    return replace(
        evaluation,
        cases=tuple(change(case) if case.case == key else case for case in evaluation.cases),
    )


def pick(evaluation: Evaluation, *, collided: bool, zone: str = "hazardous") -> CaseResult:
    return next(
        case
        for case in evaluation.cases
        if case.ads == builders.CALM
        and case.evaluated
        and (case.collided, case.zone) == (collided, zone)
    )


def hit(case: CaseResult) -> CaseResult:
    return replace(
        case, status="collision", collided=True, impact_speed=5.0, overlap=1.0, side="front",
        severity=5.0, loss=0.4,
        ideal_severity=0.0, weight=0.5, end_reason="contact",
    )  # fmt: skip
