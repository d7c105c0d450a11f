"""Findings of a scored run: what one ADS did in one scenario, and what each case took from the
ADS's scores.

Reports and figures read findings and compute nothing themselves.

Users: `report/`, `scoring/`, `extras/figures/of_scores.py`.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np

from sumo_eval.case_table import CaseTable, point_numbers
from sumo_eval.cases import CaseResult
from sumo_eval.frozen import frozen
from sumo_eval.method.score_terms import (
    Stakes,
    avoided_share_losses,
    excess,
    exposure_mean,
    mean_shares,
    once,
)
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.case_terms import CaseTerms, case_terms
from sumo_eval.settings import MethodSettings
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

FACTORS = {"length": "length_factor", "operations": "operation_factor", "similarity": "similarity"}
"""The factors of D_i: name -> field of CaseResult."""
LIKENESS_FACTORS = {
    "length": "likeness_length_factor",
    "operations": "operation_tolerance",
    "similarity": "mixture_similarity",
    "plausibility": "plausibility",
}
"""The factors of a case's part in H: name -> field of CaseResult."""
NOTICEABLE = 0.01
"""A case is slow if its task share t_i is below 1, the slowest reference's, by more than this."""


class Part(NamedTuple):
    """One case in a weighted mean over cases.

    cases: number of cases in the mean.
    total: sum of their weights.
    share: weight of this case divided by the total.
    value: of this case, 0..1.
    """

    cases: int
    total: float
    share: float
    value: float

    @property
    def gives(self) -> float:
        """The case's term of the mean."""
        return self.share * self.value

    @property
    def takes(self) -> float:
        """By how much the case lowers the mean below 1."""
        return self.share * (1.0 - self.value)


class Harm(NamedTuple):
    """One case in A.

    u: U of the ADS, m/s, or its loss class.
    ideal: Ug of the ideal vehicle, or its loss class.
    nothing: U0 of `no_reaction`, or its loss class.
    lost: w max(0, U - Ug).
    at_stake: w max(0, U0 - Ug).
    taken: loss of A by this case.
    """

    u: float
    ideal: float
    nothing: float
    lost: float
    at_stake: float
    taken: float


class Findings(NamedTuple):
    """One ADS in one scenario: its result, its cases, and the settings of the method that they were
    scored with.
    """

    score: ScenarioResult
    cases: CaseTable
    method: MethodSettings

    @classmethod
    def of(cls, evaluation: Evaluation, score: ScenarioResult) -> Self:
        """Findings of one result of a run, with its rows."""
        return cls(score, evaluation.cases_behind(score), evaluation.settings.method)

    @property
    def missing(self) -> BoolArray:
        """Whether each case is missing from a mean, (n,): from all means, or from D alone."""
        reason = self.score.d_reason
        has_index = reason is None or reason.why not in ("collisions", "no_drivers")
        return missing_cases(self.cases, has_index=has_index)

    @property
    def slow(self) -> BoolArray:
        """Whether each case counts for D, has no incident, and is noticeably slower than the
        slowest reference, (n,).
        """
        cases = self.cases
        late = cases.counts_for_index & (cases.task_share < 1.0 - NOTICEABLE)
        return np.asarray(late & ~cases.incident)

    @property
    def stands(self) -> BoolArray:
        """Whether each case is slow and ends at a standstill, (n,)."""
        return np.asarray(self.slow & (self.cases.end_reason == "standstill"))

    @property
    def terms(self) -> CaseTerms:
        """Contributions of each case to the scores."""
        return case_terms(self.cases, self.method)

    @property
    def weighted(self) -> bool:
        """Whether a point with a part in A has r above 0. If none has, each weighs 1."""
        terms = self.terms
        return bool(
            Stakes.of(terms.severity, terms.ideal, terms.unreacting, terms.weight).weight.any()
        )

    @property
    def beyond(self) -> FloatArray:
        """How much harder than the ideal vehicle the ADS hit in each case, max(0, U - Ug), (n,);
        nan where U or Ug is not known.
        """
        terms = self.terms
        return excess(terms.severity, terms.ideal)

    @property
    def share_lost(self) -> FloatArray:
        """Share that each case takes from A, (n,), together 1 - A; nan if it has no part in A."""
        terms = self.terms
        return avoided_share_losses(terms.severity, terms.ideal, terms.unreacting, terms.weight)

    @property
    def lost_of_c(self) -> FloatArray:
        """Part that each case takes from C (Eq. 17), (n,), together 1 - C; nan if it has no ratio
        Ug/U, and so no part in C.
        """
        ratio = self.terms.ratio
        known = np.isfinite(ratio)
        return np.where(known, self.shares(known, self.cases.weight) * (1.0 - ratio), np.nan)

    @property
    def collisions(self) -> IntArray:
        """Rows of the h collisions, (h,), the largest loss of C first; a collision without a known
        loss comes last.
        """
        places = np.flatnonzero(self.cases.collided)
        lost = self.lost_of_c[places]
        # lexsort: the last key counts first, so collisions of equal loss are sorted by name
        names = self.cases.case[places]
        return places[np.lexsort((names, -np.nan_to_num(lost), np.isnan(lost)))]

    @property
    def indexed(self) -> BoolArray:
        """Whether each case is safe and has a D_i, (n,)."""
        return np.asarray(self.cases.safe & np.isfinite(self.cases.index))

    @property
    def likened(self) -> BoolArray:
        """Whether each case has a human-likeness, (n,); only safe cases have one."""
        return np.isfinite(self.cases.human_likeness)

    @property
    def tasked(self) -> BoolArray:
        """Whether each case enters the mean T, (n,)."""
        return np.asarray(self.cases.safe & np.isfinite(self.cases.task_share))

    def harm(self, case: CaseResult) -> Harm:
        """The terms of a case in A."""
        terms, row = self.terms, self._row_of(case)
        u, ideal, nothing = terms.severity[row], terms.ideal[row], terms.unreacting[row]
        weight = terms.weight[row] if self.weighted else 1.0
        lost, at_stake = (float(weight * excess(severity, ideal)) for severity in (u, nothing))
        return Harm(u, ideal, nothing, lost, at_stake, self.share_lost[row])

    def _row_of(self, case: CaseResult) -> int:
        """Index of a case among `cases`."""
        return int(np.flatnonzero(self.cases.case == case.case)[0])

    def part(
        self, case: CaseResult, counted: BoolArray, weights: FloatArray, values: FloatArray
    ) -> Part:
        """The part of a case in a weighted mean over the counted cases.

        counted, weights: as in `shares`.
        values: of all cases, (n,), 0..1.
        """
        row = self._row_of(case)
        of_counted = np.nan_to_num(weights[counted]).tolist()
        share = self.shares(counted, weights)[row]
        return Part(len(of_counted), math.fsum(of_counted), share, values[row])

    def shares(self, counted: BoolArray, weights: FloatArray) -> FloatArray:
        """Share of each case in a weighted mean over the counted cases, (n,); 0 for other cases.

        counted: whether a case is in the mean, (n,).
        weights: of all cases, (n,); nan counts 0.
        """
        shares = np.zeros(len(counted))
        shares[counted] = mean_shares(np.nan_to_num(weights[counted]))
        return shares

    @property
    def factor_means(self) -> dict[str, float]:
        """Mean of every factor of D_i over the safe cases that have a D_i, by exposure; empty
        without such cases.
        """
        return self._means(self.indexed, FACTORS)

    @property
    def likeness_means(self) -> dict[str, float]:
        """Mean of every factor of a case's human-likeness over the safe cases without an incident,
        by exposure.
        """
        return self._means(self.likened & ~self.cases.incident, LIKENESS_FACTORS)

    def _means(self, counted: BoolArray, factors: Mapping[str, str]) -> dict[str, float]:
        """The mean of every factor over the counted cases, by exposure.

        counted: whether a case is in the mean, (n,).
        factors: name -> field of CaseResult.
        """
        cases = self.cases[counted]
        means = {
            name: mean_of(getattr(cases, field), cases.exposure) for name, field in factors.items()
        }
        return {name: mean for name, mean in means.items() if mean is not None}


def missing_cases(cases: CaseTable, *, has_index: bool) -> BoolArray:
    """Whether each case of an ADS is missing from a mean, (n,): from all means, or from D alone.

    has_index: whether there is a D from which a case without D_i could be missing: the scenario has
        drivers, and no collision voids D.
    """
    missing = cases.missing
    if has_index:
        missing = missing | (cases.counts_for_index & np.isnan(cases.index))
    return np.asarray(missing)


def mean_of(values: FloatArray, exposure: FloatArray) -> float | None:
    """The mean of values by exposure, (n,) each; None if no case has both."""
    # `once`: each case counts once, because nothing is resampled
    mean = float(exposure_mean(values, exposure, once(len(values)))[0])
    return None if np.isnan(mean) else mean


def findings_of(evaluation: Evaluation, ads: str | None = None) -> list[Findings]:
    """Findings of every ADS (or of this ADS alone) in every scenario."""
    return [
        Findings.of(evaluation, score) for score in evaluation.scores if ads in (None, score.ads)
    ]


def unevaluated(evaluation: Evaluation) -> list[CaseTable]:
    """The cases that are missing from a mean, of each ADS in each scenario."""
    return [findings.cases[findings.missing] for findings in findings_of(evaluation)]


@frozen
class PeopleBehind:
    """Number of recorded drivers behind the D_i and H of a scenario.

    points: number of safe points.
    with_people: number of these at which D_i compares with recorded drivers.
    drives: number of drives of recorded drivers at these. With `too_thin = "leave_out"`, points
        with fewer than `drivers.least` recorded drivers do not count.
    """

    scenario: str
    points: int
    with_people: int
    drives: int


def people_behind(evaluation: Evaluation) -> list[PeopleBehind]:
    """The recorded drivers of every scenario; empty where the evaluation asks for none."""
    drivers = evaluation.settings.drivers
    if drivers.source != "recorded":
        return []
    # fewest recorded drivers of a reference that counts
    fewest = drivers.least if drivers.too_thin == "leave_out" else 1
    scenarios = []
    for name in evaluation.scenario_names:
        cases = evaluation.cases_in(name)
        safe = cases.safe
        if not safe.any():
            continue
        recorded = np.nan_to_num(cases.recorded_drivers[safe])
        points, group = np.unique(point_numbers([cases])[0][safe], return_inverse=True)
        # Each ADS has a case at a point. Of their numbers of recorded drivers the largest counts.
        most = np.zeros(len(points))
        np.maximum.at(most, group, np.where(recorded >= fewest, recorded, 0.0))
        scenarios.append(
            PeopleBehind(name, len(points), int(np.count_nonzero(most)), int(most.sum()))
        )
    return scenarios
