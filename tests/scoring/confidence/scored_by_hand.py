"""The hand-made evaluation scored, with the intervals of its scores."""

from dataclasses import replace

import numpy as np

from sumo_eval.scoring.confidence.drivers import NO_DEVIATIONS
from sumo_eval.scoring.confidence.resamples import strata
from sumo_eval.scoring.confidence.scored import with_intervals
from sumo_eval.scoring.quantities import combine


def with_intervals_of(evaluation, partitions, ads):
    """The evaluation with the scores of one of its ADSs alone, as `score` makes them of its
    rows."""
    finished = []
    for name, zones in partitions.items():
        rows = evaluation.cases_of(ads, name)
        unit = zones.logical.to_unit([zones.logical.row(case.values) for case in rows])
        done, _ = with_intervals(
            [combine(ads, name, rows, evaluation.settings.method)],
            [rows],
            [np.arange(len(rows))],
            [NO_DEVIATIONS],
            strata(unit, "grid"),
            evaluation.settings,
        )
        finished += done
    return replace(evaluation, scores=tuple(finished))
