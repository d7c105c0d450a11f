"""Intervals of every score, from two sources of error: which points were driven, and with which
drivers H and D compare. `scored.py` puts the intervals into the results.

- Bootstrap. Each replicate draws the points again (`resamples.py`), the same points for every ADS.
  To D and H it adds an error of the drivers, whose size a jackknife over drivers gives
  (`drivers.py`).
- Balance. Some methods of sampling leave no part of the space out. The mean of their points is the
  centre of the space, so a trend of a score's terms along a parameter makes no error. Their
  replicates are balanced in the same way (`Balance`). Collisions are few, and no method of sampling
  spreads them over the space. So C, a mean over collisions, comes from draws without balance; so
  does the question whether a replicate has a D, which a collision in the safe zone voids.
- Unseen collisions. If k of n hazardous points have a collision, points that were not driven may
  have one too. So the bad end of an interval has e unseen collisions, as hard as those of
  `no_reaction`, where e is exponential with mean 1. Together with the drawn collisions, their
  number has a gamma distribution of shape k + 1, as in the exact interval of a Poisson count. Its
  95 % point for k = 0 is 3.0, the rule of three. A and regret, sums over points, lose with each
  unseen collision. C, a mean over collisions, loses all that it can lose by the first one. So C
  loses this much with the probability of at least one unseen collision.
- One more case. T, A' and S+ fall steeply at their good end. Their lower ends have one more case
  instead of unseen collisions, as bad as doing nothing (t = 0, lost = the mean at stake). It weighs
  e cases, where e is exponential with mean 0.5. Every ADS receives the same case, so in a
  difference of two ADSs it cancels as far as its effect on both is equal.
- A mean over safe cases (T, D, H) that comes from a single case lies anywhere between 0 and 1.
- Limits are percentiles of the replicates. With few cases they are widened as much as Student's t
  is wider than the normal distribution (Hesterberg 2015). A collision keeps its weight r (Eq. 16)
  in every replicate.
- Random streams are named by scenario, driver or ADS, never numbered by a position in a list. So
  the interval of an ADS does not depend on what else is evaluated.

Users: `report/evidence.py`, `scoring/comparison.py`, `scoring/confidence/assessment.py`,
`scoring/confidence/next_round.py`, `scoring/confidence/ranking.py`, `scoring/confidence/scored.py`,
`scoring/steps.py`. Fixed: names of the random streams and order of the draws. After a change run
tests/campaign/test_interval_coverage.py.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.special import chdtri, ndtr, stdtrit

from sumo_eval.frozen import frozen
from sumo_eval.method.score_terms import (
    AskedTerms,
    KnownSums,
    avoidance_grade,
    excess,
    once,
    ordering_score,
    paper_score,
)
from sumo_eval.record.progress import Progress, quiet
from sumo_eval.score_notes import Bounds
from sumo_eval.scoring.case_terms import (
    COMPUTED,
    CaseTerms,
    ScoreSamples,
    point_values,
    ratios,
    scores_of,
)
from sumo_eval.scoring.confidence.drivers import DriverDeviations
from sumo_eval.scoring.confidence.resamples import Resampled, Strata, resamples
from sumo_eval.settings import MethodSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray

LEVEL = 0.95  # probability with which an interval covers its score
REPLICATES = 2_000  # of the bootstrap
ONE_MORE = 0.5  # mean weight of the one more case, in cases
LEAST = 2  # fewest cases that show how far cases differ
UNSEEN = 3.0  # rule of three: after 0 collisions at n points, at most 3/n with 95 % confidence
# scores with an interval from here; `assessment.py` has that of the collision probability
SCORED = tuple(name for name in COMPUTED if name != "collision_probability")
BAD_SIDE_UP = frozenset({"regret"})  # scores of which more is worse


@frozen
class Interval:
    """A value and the limits between which it lies with the probability `level`."""

    value: float
    low: float
    high: float
    level: float = LEVEL


class AdsCases(NamedTuple):
    """The n cases of one ADS in one scenario, for which intervals are computed.

    terms: contributions of the cases to the scores.
    points: index of each case's point among the scenario's points, (n,), all different.
    hazardous: whether each case is in a hazardous zone, (n,).
    drivers: errors of D and H by the choice of drivers.
    missing: how far missing cases may move S+, down (at most 0) and up (at least 0).
    """

    ads: str
    terms: CaseTerms
    points: IntArray
    hazardous: BoolArray
    drivers: DriverDeviations
    missing: Bounds = (0.0, 0.0)


class ScoreIntervals(NamedTuple):
    """The intervals of one ADS in one scenario, and what a ranking needs.

    limits: name of a score in `ScenarioResult` -> its low and high, for scores that exist.
    sources: score (`s`, `s_plus`) -> source (`cases`, `drivers`) -> half-width from this source.
    worse: S+ of every replicate with one more case, (m,).
    better: S+ of every replicate without this case, (m,).
    freedom: degrees of freedom of S+.
    missing: as in `AdsCases`.
    """

    limits: Mapping[str, Bounds]
    sources: Mapping[str, Mapping[str, float]]
    worse: FloatArray
    better: FloatArray
    freedom: int
    missing: Bounds


def score_intervals(
    ads_cases: Sequence[AdsCases],
    groups: Strata,
    seed: int,
    scenario: str,
    *,
    replicates: int = REPLICATES,
    progress: Progress = quiet,
) -> list[ScoreIntervals]:
    """The intervals of all ADSs in one scenario.

    ads_cases: of every ADS that gets intervals.
    groups: lists of all points of the scenario (`resamples.strata`).
    seed, scenario: of the random streams.
    replicates: m.
    """
    sums = [_Sums(ads, groups.points) for ads in ads_cases]

    def done(points: int, of: int) -> None:
        """Report a number of points as a number of replicates."""
        progress(f"{scenario}: resamples for the intervals", points * replicates // of, replicates)

    for part in resamples(groups, replicates, seed, ("intervals", scenario), done=done):
        for ads_sums in sums:
            ads_sums.add(part)
    return [ads_sums.intervals(groups, seed, scenario) for ads_sums in sums]


class _Sums:
    """Sums over the cases of one ADS, in each of m replicates, from which its scores follow.

    ads: its cases.
    points: number of points of the scenario.

    `add` adds the cases at some of the points. In the end `intervals` computes all scores from the
    sums. So no table of all cases and replicates is in memory.
    """

    def __init__(self, ads: AdsCases, points: int) -> None:
        self._ads = ads
        # index of the case at each of the points, -1: the ADS has no case there
        self._rows = np.full(points, -1)
        self._rows[ads.points] = np.arange(len(ads.points))
        self._unseen = UnseenCollisions.of(ads)
        # sums by balanced counts, and by drawn counts, (m, terms) each
        self._balanced: Any = 0.0
        self._drawn: Any = 0.0

    def add(self, part: Resampled) -> None:
        """Add the cases at some of the points."""
        counts, drawn, rows = part.counts, part.drawn, self._rows[part.places]
        has_case = rows >= 0
        if not has_case.all():
            counts, drawn, rows = counts[:, has_case], drawn[:, has_case], rows[has_case]
        # terms to sum by balanced counts (of the scores, then of unseen collisions), and by drawn
        # counts; their number and order do not depend on the cases
        asked, hits = AskedTerms(), AskedTerms()
        scores_of(self._ads.terms, asked, hits, rows=rows)
        balanced = [*asked.terms, *(terms[rows] for terms in self._unseen.terms)]
        self._balanced += counts @ np.column_stack(balanced)
        self._drawn += drawn @ np.column_stack(hits.terms)

    def intervals(self, groups: Strata, seed: int, scenario: str) -> ScoreIntervals:
        """The intervals, once all points have been added."""
        ads, terms, m = self._ads, self._ads.terms, len(self._balanced)
        plain, of_unseen = self._scores()
        # in each replicate: number of unseen collisions, and weight of the one more case, (m,)
        unseen = _stream(seed, "unseen", scenario, ads.ads).standard_exponential(m)
        weight = _stream(seed, "one more", scenario).exponential(ONE_MORE, m)
        deviates = driver_deviates(ads.drivers, seed, m)

        # replicates for the good end of each interval, then for the bad end
        better = _with_drivers(plain, ads, deviates)
        worse = _with_losses(better, self._unseen.losses(of_unseen, unseen))
        worse = _with_one_more(worse, better, terms, weight)
        single = single_means(terms)
        worse = _with_open_means(worse, single, 0.0, terms.method)
        better = _with_open_means(better, single, 1.0, terms.method)

        values = point_values(terms)
        freedom = _freedom(ads, groups)
        limits = self._limits(values, worse, better, freedom)
        # every replicate has the scores themselves, so that only the drivers vary
        fixed = {
            name: np.full(m, np.nan if value is None else value) for name, value in values.items()
        }
        by_source = {"cases": plain, "drivers": _with_drivers(fixed, ads, deviates)}
        sources: dict[str, Mapping[str, float]] = {
            name: {
                source: _half(scores[name], freedom[name]) for source, scores in by_source.items()
            }
            for name in ("s", "s_plus")
            if name in limits and not single
        }
        return ScoreIntervals(
            limits, sources, worse["s_plus"], better["s_plus"], freedom["s_plus"], ads.missing
        )

    def _scores(self) -> tuple[ScoreSamples, FloatArray]:
        """The scores in each replicate, (m,) each, without errors of the drivers; and the sums of
        the terms of unseen collisions, (k, m).
        """
        sums = self._balanced.T
        of_scores = len(sums) - len(self._unseen.terms)
        known, drawn = KnownSums(sums[:of_scores]), KnownSums(self._drawn.T)
        # scores from known sums: `slice(0, 0)`, because no case is read
        return scores_of(self._ads.terms, known, drawn, rows=slice(0, 0)), sums[of_scores:]

    def _limits(
        self,
        values: Mapping[str, float | None],
        worse: ScoreSamples,
        better: ScoreSamples,
        freedom: Mapping[str, int],
    ) -> dict[str, Bounds]:
        """Name of a score that exists -> its low and high.

        values: the scores themselves.
        worse, better: replicates for the bad and for the good end, (m,) each.
        freedom: degrees of freedom of each score.
        """
        terms = self._ads.terms
        lost = {}
        limits = {}
        if not terms.collided.any():
            # Without a collision the rule of three gives the losses, and no draw is needed.
            whole = np.array([once(len(each)) @ each for each in self._unseen.terms])
            lost = self._unseen.losses(whole, np.array([UNSEEN]))
        for name in SCORED:
            value = values[name]
            up = name in BAD_SIDE_UP
            low, high = (better, worse) if up else (worse, better)
            ends = percentiles(low[name], high[name], freedom[name])
            if value is None or ends is None:
                continue
            # Without any incident this loss alone is the interval. For C no collision is enough,
            # because it counts collisions alone.
            if name in lost and (name == "c" or not terms.incident.any()):
                moved = float(lost[name][0])
                ends = (value, value + moved) if up else (value - moved, value)
            limits[name] = min(ends[0], value), max(ends[1], value)
        return limits


def _stream(seed: int, *names: str) -> np.random.Generator:
    """A random stream by its names."""
    return random_stream(seed, "intervals", *names)


def driver_deviates(drivers: DriverDeviations, seed: int, replicates: int) -> FloatArray:
    """Random numbers of Student's t distribution, (m, k), a column for each name in `drivers`.

    A driver has the same numbers in every scenario and for every ADS. So in the difference of two
    ADSs' scores the drivers' errors cancel as far as they are common.
    """
    normal = [_stream(seed, "driver", name).standard_normal(replicates) for name in drivers.names]
    if not normal:
        return np.zeros((replicates, 0))
    share = _stream(seed, "spread of drivers").uniform(size=replicates)
    # a number of Student's t is a normal number divided by the root of chi^2 / freedom
    wider = np.sqrt(drivers.freedom / chdtri(drivers.freedom, share))
    return np.column_stack(normal) * wider[:, None]


def _with_drivers(scores: ScoreSamples, ads: AdsCases, deviates: FloatArray) -> ScoreSamples:
    """The scores with the drivers' errors added to D and H, which stay within 0..1.

    deviates: as from `driver_deviates`.
    """
    index, likeness = deviates @ ads.drivers.index, deviates @ ads.drivers.likeness
    d = np.clip(scores["d"] + index, 0.0, 1.0)
    human = np.clip(scores["human_likeness"] + likeness, 0.0, 1.0)
    return _summed({**scores, "d": d, "human_likeness": human}, ads.terms.method)


def _with_losses(scores: ScoreSamples, losses: ScoreSamples) -> ScoreSamples:
    """The scores, but those of `losses` moved to their bad side by their loss."""
    moved = {
        name: scores[name] + lost if name in BAD_SIDE_UP else scores[name] - lost
        for name, lost in losses.items()
    }
    return {**scores, **moved}


def _with_open_means(
    scores: ScoreSamples, single: Sequence[str], end: float, method: MethodSettings
) -> ScoreSamples:
    """The scores, but those of `single` at one end of 0..1 where they exist.

    single: as from `single_means`.
    """
    open_means = {name: np.where(np.isnan(scores[name]), np.nan, end) for name in single}
    return _summed({**scores, **open_means}, method)


def _summed(scores: ScoreSamples, method: MethodSettings) -> ScoreSamples:
    """The scores in each replicate, with S and S+ computed again from their parts."""
    s = paper_score(scores["c"], scores["d"], method.score)
    plus = ordering_score(
        scores["task_share"], scores["avoidance_grade"], scores["human_likeness"], method.score
    )
    return {**scores, "s": s, "s_plus": plus}


def _with_one_more(
    worse: ScoreSamples, better: ScoreSamples, terms: CaseTerms, weight: FloatArray
) -> ScoreSamples:
    """The scores `worse`, but T, A' and S+ from `better` with one more case, which is as bad as
    doing nothing.

    worse, better: scores in each replicate, (m,) each.
    terms: of the cases.
    weight: e, weight of the one more case, in cases, (m,).

    Its share of a mean over n cases is e / (n + e). T loses this share of itself. If anything is at
    stake, 1 - A goes this share of the way to 1.
    """
    comparable, stake = _stake(terms)
    # numbers of cases in the means T and A
    in_task = int(np.isfinite(terms.task).sum())
    in_harm = int(comparable.sum()) if stake.any() else 0
    of_task, of_harm = (
        weight / (n + weight) if n else np.zeros(len(weight)) for n in (in_task, in_harm)
    )
    moved = dict(worse)
    moved["task_share"] = better["task_share"] * (1.0 - of_task)
    harm = (1.0 - better["avoided_share"]) * (1.0 - of_harm) + of_harm
    moved["avoidance_grade"] = avoidance_grade(1.0 - harm, terms.method.task.sharpness)
    return _summed(moved, terms.method)


class UnseenCollisions(NamedTuple):
    """Losses of an ADS's scores by collisions that its cases do not show.

    points: number of points that count: hazardous ones; all evaluated ones, if none is hazardous.
    terms: two arrays for each score of `losses`, of each case, (n,). The sum of the first over the
        sum of the second is the score's loss if every free point had a collision.

    A free point is one that counts and has no incident. An unseen collision there is as hard as the
    collision of `no_reaction`, so A and regret lose max(0, U0 - Ug). C is 1 without a collision,
    and Ug/U0 after the first one. If the cases show a collision, C is a mean over collisions, which
    unseen ones need not lower: then C has no loss. If all cases that can be compared have the
    weight 0, each has the weight 1.
    """

    points: int
    terms: tuple[FloatArray, ...]

    @classmethod
    def of(cls, ads: AdsCases) -> Self:
        """Unseen collisions of an ADS, from all its cases."""
        terms = ads.terms
        comparable, stake = _stake(terms)
        among = comparable & ads.hazardous  # the points that count
        if not among.any():
            among = comparable
        weight, exposure = (  # 1 each if all comparable cases weigh 0
            np.where(comparable, weights if (weights * comparable).any() else 1.0, 0.0)
            for weights in map(np.nan_to_num, (terms.weight, terms.exposure))
        )
        free = stake * (among & ~terms.incident)
        # pairs of terms in the order of `losses`; the last pair, of C, only without a collision
        losses = [
            weight * free, weight * stake, exposure * free, exposure * stake, weight * free, weight
        ]  # fmt: skip
        if not terms.collided.any():
            ratio = ratios(terms.unreacting, terms.ideal, terms.method)
            lost_ratio = np.nan_to_num(1.0 - ratio) * among
            losses += [weight * lost_ratio, weight * among]
        points = int(among.sum())
        return cls(points, tuple(losses) if points else ())

    def losses(self, sums: FloatArray, unseen: FloatArray) -> ScoreSamples:
        """Score -> its mean loss, (m,).

        sums: of the terms in each replicate, (k, m).
        unseen: expected number of unseen collisions, (m,).

        A point has an unseen collision with probability p = unseen / points. A and regret lose the
        share p of what they would lose if every free point had one. C loses all of it by the first
        collision, so its share is the probability of at least one, 1 - (1 - p)^points.
        """
        chance = np.minimum(unseen / max(self.points, 1), 1.0)
        names = "avoided_share", "avoided_share_exposure", "regret", "c"
        losses = {}
        # strict=False: if the cases show a collision, there are no sums of C
        for name, over, under in zip(names, sums[::2], sums[1::2], strict=False):
            # the loss if every free point had a collision
            whole = np.divide(over, under, out=np.zeros(over.shape), where=under > 0.0)
            losses[name] = (1.0 - (1.0 - chance) ** self.points if name == "c" else chance) * whole
        return losses


def single_means(terms: CaseTerms) -> list[str]:
    """Names of the means over safe cases, 0..1, that come from a single case with exposure. It does
    not show how far cases differ, so the mean may be anything.
    """
    means = {"task_share": terms.task, "d": terms.index, "human_likeness": terms.likeness}
    numbers = {
        name: np.count_nonzero(np.isfinite(values) & (terms.exposure > 0.0))
        for name, values in means.items()
    }
    return [name for name, number in numbers.items() if 0 < number < LEAST]


def _stake(terms: CaseTerms) -> tuple[BoolArray, FloatArray]:
    """Whether each case counts and has both references, (n,); and max(0, U0 - Ug) there, 0
    elsewhere, (n,).
    """
    stake = excess(terms.unreacting, terms.ideal)
    comparable = terms.counted & np.isfinite(stake)
    return comparable, np.where(comparable, stake, 0.0)


def _freedom(ads: AdsCases, groups: Strata) -> dict[str, int]:
    """Score -> degrees of freedom of its error: the number of points with a part in it, less one
    for each list. For C with collisions: the number of collisions less one.

    groups: lists of points that may replace each other.
    """
    group = groups.numbers()

    def free(part: BoolArray) -> int:
        """Degrees of freedom of the cases with a part in a score, (n,), at least 1."""
        places = group[ads.points[part]]
        return max(len(places) - len(np.unique(places)), 1)

    terms = ads.terms
    all_counted = free(terms.counted)
    return {
        **dict.fromkeys(SCORED, all_counted),
        "s": free(terms.evaluated),
        "task_share": free(np.isfinite(terms.task)),
        "c": free(terms.evaluated)
        if not terms.collided.any()
        else max(int(np.isfinite(terms.ratio).sum()) - 1, 1),
        "d": free(np.isfinite(terms.index)),
        "human_likeness": free(np.isfinite(terms.likeness)),
    }


def percentiles(
    low: FloatArray, high: FloatArray, freedom: float, level: float = LEVEL
) -> Bounds | None:
    """Low end of an interval from the replicates `low`, high end from `high`, (m,) each; None if
    one of them has no finite number.

    freedom: degrees of freedom.
    level: probability with which the interval covers its score.

    Each end cuts off the share that the normal distribution has beyond the limit of Student's t.
    This share is less than (1 - level) / 2, so that few degrees of freedom widen the interval.
    """
    low, high = low[np.isfinite(low)], high[np.isfinite(high)]
    if not low.size * high.size:
        return None
    tail = float(ndtr(stdtrit(freedom, (1.0 - level) / 2.0)))
    return float(np.quantile(low, tail)), float(np.quantile(high, 1.0 - tail))


def _half(values: FloatArray, freedom: int) -> float:
    """Half the width of the interval of replicates (m,); 0 without an interval."""
    ends = percentiles(values, values, freedom)
    return 0.0 if ends is None else (ends[1] - ends[0]) / 2.0
