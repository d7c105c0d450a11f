"""Rounds of an adaptive sample: their state after scoring, and the number of points that the next
round takes from each cell of the space.

Users: `scoring/steps.py` (state), `evaluation.py` (next round).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from sumo_eval.case_table import CaseTable
from sumo_eval.method.score_terms import Stakes, grade_slope
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.adaptive import (
    capacity_of_cells,
    size_of_next,
    size_of_round,
    spread,
)
from sumo_eval.scenario.sampling.samples import Sample
from sumo_eval.scoring.case_terms import CaseTerms, case_terms, point_values
from sumo_eval.scoring.confidence.intervals import LEVEL, UNSEEN
from sumo_eval.settings import SamplingSettings
from sumo_eval.trajectory import FloatArray, IntArray

ADAPTIVE = "adaptive"


class Standing(NamedTuple):
    """State of the rounds of an adaptive sample.

    rounds: number of rounds so far.
    size: number of points of a round.
    further: number of points of the next round; 0: there is no next round.
    sentence: the state in words, for the report.
    """

    rounds: int
    size: int
    further: int
    sentence: str


def standing(
    sampling: SamplingSettings,
    points: Sample,
    scores: Sequence[ScenarioResult],
    rows: Sequence[CaseTable],
    places: Sequence[IntArray],
) -> Standing:
    """State of a scenario's rounds.

    sampling: `count` (most points), `round`, `aim`, `until` (half-width at which sampling ends).
    points: of all rounds so far.
    scores: results of the ADSs, with intervals.
    rows: cases of each ADS.
    places: of each ADS the indices of its cases' points.
    """
    budget = sampling.count or 0
    owner = f"the sampling of scenario `{scores[0].scenario}`"
    size = size_of_round(budget, sampling.round, owner)
    rounds, number = max(len(sampling.rounds), 1), len(points.points)
    further, until = size_of_next(budget, size, number), sampling.until
    if sampling.aim == "boundary":
        half = max(
            _collided_half_width(_collides(cases), points, place)
            for cases, place in zip(rows, places, strict=True)
        )
        width = f"{half:.2g} of the space"
    else:
        intervals = [score.s_plus_interval or (0.0, math.inf) for score in scores]
        half = max(high - low for low, high in intervals) / 2.0
        width = f"{half:.2f} points of S+"
    state = f"half the widest 95 % interval is {width}"
    if half == math.inf:
        state = "an ADS has no interval"
    target = "" if until is None else f"more than the {until:g} asked for"
    # reason: why there is no further round; if there is one, why it was not driven
    if until is not None and half <= until:
        further, reason = 0, f"{state}, no {target}"
    elif further:
        reason = f"{state}; it was stopped, `--resume` drives more rounds"
    else:
        reason = ", ".join(filter(None, (f"all it may drive; {state}", target)))
    sentence = (
        f"Adaptive sampling: {number} of at most {budget} points in {rounds} rounds; {reason}."
    )
    return Standing(rounds, size, further, sentence)


def further_round(
    logical: LogicalScenario, sampling: SamplingSettings, points: Sample, evaluation: Evaluation
) -> SamplingSettings:
    """The settings of a scored run's sampling with one more round; unchanged if there is no further
    round.

    points: of all rounds so far.
    evaluation: the scored run.

    A cell gets the more points, the more its cases differ (Neyman's allocation) in how much they
    move S+; with the aim "boundary", in whether they collide.
    """
    assert points.stratum is not None  # every adaptive sample has both
    assert points.stands_for is not None
    method = evaluation.settings.method
    scores = evaluation.scores_in(logical.name)
    rows = [evaluation.cases_behind(score) for score in scores]
    places = [np.arange(len(points.points))] * len(scores)  # every ADS drove every point
    state = standing(sampling, points, scores, rows, places)
    if not state.further:
        return sampling
    capacity = capacity_of_cells(logical, state.size, evaluation.settings.seed)
    cells = len(capacity)
    variance = np.zeros(cells)  # of each cell, summed over the ADSs
    # The number of a stratum is round * cells + cell, so `% cells` gives the cell.
    for cases in rows:
        moved = (
            _collides(cases)
            if sampling.aim == "boundary"
            else plus_influence(case_terms(cases, method), points.stands_for)
        )
        variance += variance_in_cells(moved, points.stratum % cells, cells)
    # points of each round, by cell
    counts = np.bincount(points.stratum, minlength=state.rounds * cells).reshape(-1, cells)
    # Neyman: in proportion to volume times deviation. Cells have equally many candidates, so their
    # volumes are equal.
    further = spread(state.further, np.sqrt(variance), capacity - counts.sum(axis=0))
    return replace(sampling, rounds=(*map(tuple, counts.tolist()), further))


def variance_in_cells(values: FloatArray, cell: IntArray, cells: int) -> FloatArray:
    """Variance of the values in each cell, (cells,).

    values: (n,), in any unit.
    cell: number of each value's cell, (n,).
    cells: number of cells.

    The variance of few values may be 0 by chance. So the common variance of all cells counts as one
    more squared deviation in each cell: n + 1 values have n degrees of freedom.
    """
    number = np.maximum(np.bincount(cell, minlength=cells), 1)
    mean = np.bincount(cell, values, cells) / number
    squares = np.bincount(cell, (values - mean[cell]) ** 2, cells)
    common = float(squares.sum()) / max(len(values) - cells, 1)
    return (squares + common) / number


def plus_influence(terms: CaseTerms, stands_for: FloatArray) -> FloatArray:
    """Influence of each case on S+, (n,): to first order, n times the points by which the case
    would move S+ if it stood for one point of an even sample.

    terms: of the n cases of an ADS.
    stands_for: number of points that each case stands for, (n,).

    S+ = T A' (a + b H). A case moves T by p (t - T) / sum(p), H likewise, and A by
    w ((1 - A) stake - lost) / sum(w stake). Each is multiplied by the slope of S+ along T, H or A.
    The sum of the influences, weighted by `stands_for`, is 0.
    """
    values, method = point_values(terms), terms.method
    task, human = values["task_share"] or 0.0, values["human_likeness"] or 0.0
    avoided, grade = values["avoided_share"], max(values["avoidance_grade"] or 0.0, 0.0)
    manner = method.score.a + method.score.b * human
    n, moved = len(stands_for), np.zeros(len(stands_for))

    stakes = Stakes.of(terms.severity, terms.ideal, terms.unreacting, terms.weight)
    at_stake = float(stakes.weight @ stakes.at_stake)
    # weight and exposure contain the factor `stands_for`, which is divided out
    if at_stake > 0.0 and avoided is not None:
        part = (1.0 - avoided) * stakes.at_stake - stakes.lost
        slope = task * manner * grade_slope(avoided, method.task.sharpness)
        moved += slope * n * stakes.weight / stands_for * part / at_stake

    for value, slope, cases in (
        (human, task * grade * method.score.b, terms.likeness),
        (task, grade * manner, terms.task),
    ):
        exposure = np.where(np.isfinite(cases), terms.exposure, 0.0)
        if exposure.sum() > 0.0:
            away = np.where(np.isfinite(cases), cases, 0.0) - value
            moved += slope * n * exposure / stands_for * away / float(exposure.sum())
    return moved


def _collides(cases: CaseTable) -> FloatArray:
    """1 for each case that collides, else 0, (n,)."""
    return np.where(cases.evaluated & cases.collided, 1.0, 0.0)


def _collided_half_width(hit: FloatArray, points: Sample, place: IntArray) -> float:
    """Half the 95 % interval of the share of the space in which an ADS collides.

    hit: 1 for each case that collides, else 0, (n,).
    points: of all rounds so far.
    place: index of each case's point, (n,).

    The share is a stratified mean, with the cells of each round as strata. The variance of the mean
    of n points in a cell is s^2 / n. A round's weight is its share of all points. Rounds are
    uncorrelated, because the expected value of each is the mean of the space, whatever the earlier
    rounds were.

    Where the points of each cell end alike, this variance is 0. But n points without a collision
    leave open a share of 3/n, so half the interval is at least half of that.
    """
    assert points.stratum is not None  # every adaptive sample has both
    assert points.stands_for is not None
    stratum, weight = points.stratum[place], points.stands_for[place] / len(points.points)
    number = np.maximum(np.bincount(stratum), 1)
    mean = np.bincount(stratum, hit) / number
    # A stratum adds (weight n)^2 s^2 / n, with s^2 = sum((hit - mean)^2) / (n - 1). All its n
    # points have one weight.
    squares = np.bincount(stratum, (weight * (hit - mean[stratum])) ** 2)
    variance = float(np.sum(squares * number / np.maximum(number - 1, 1)))
    half = float(ndtri(0.5 + LEVEL / 2.0)) * math.sqrt(variance)
    return max(half, 0.5 * UNSEEN / len(hit))
