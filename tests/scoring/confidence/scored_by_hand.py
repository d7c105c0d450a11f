"""The hand-made evaluation scored, with the intervals of its scores."""

from dataclasses import replace

import numpy as np
from builders import CALM

from sumo_eval.scoring.case_terms import CaseTerms
from sumo_eval.scoring.confidence.drivers import NO_DEVIATIONS
from sumo_eval.scoring.confidence.resamples import strata
from sumo_eval.scoring.confidence.scored import with_intervals
from sumo_eval.scoring.quantities import combine
from sumo_eval.settings import MethodSettings


def terms_of(n, **changes):
    """The terms of n cases without an incident, in all of which doing nothing hits at 10 m/s."""
    ones, zeros, spread = np.ones(n), np.zeros(n), np.linspace(0.2, 0.8, n)
    never, always = zeros > 0.0, ones > 0.0
    plain = {
        "method": MethodSettings(),
        "exposure": ones,
        "weight": ones,
        "severity": zeros,
        "ideal": zeros,
        "unreacting": 10.0 * ones,
        "ratio": np.nan * ones,
        "collided": never,
        "evaluated": always,
        "index": spread,
        "likeness": spread,
        "voids": never,
        "counted": always,
        "task": ones,
    }
    return CaseTerms(**plain | {"incident": changes.get("collided", never)} | changes)


def with_intervals_of_calm(evaluation, partitions):
    """The evaluation with the scores of `calm` alone, as `score` makes them of its
    rows."""
    finished = []
    for name, zones in partitions.items():
        rows = evaluation.cases_of(CALM, name)
        unit = zones.logical.to_unit([zones.logical.row(case.values) for case in rows])
        done, _ = with_intervals(
            [combine(CALM, name, rows, evaluation.settings.method)],
            [rows],
            [np.arange(len(rows))],
            [NO_DEVIATIONS],
            strata(unit, "grid"),
            evaluation.settings,
        )
        finished += done
    return replace(evaluation, scores=tuple(finished))
