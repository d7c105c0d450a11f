"""The rule that decides whether a build got worse than its base, in three parts: outcome, near
miss, shift. `nightly/` makes limits of it; the numbers below are the defaults of a gate file.

d is the amount by which a quantity of a case got worse. A case is worse if d is above its
tolerance, better if -d is.

Users: `nightly/gates.py`, `nightly/judgement.py`, `nightly/repeats.py`, `nightly/rule_limits.py`,
`scoring/behaviour.py`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.special import bdtr

from sumo_eval.case_table import CaseTable, Column
from sumo_eval.scoring.comparison import AdsComparison, Comparison
from sumo_eval.scoring.gate_settings import (
    ENDS,
    LAST_DIGIT,
    SEVERITY_BY,
    TIMED,
    GateSettings,
    MeasureSettings,
    NoiseSettings,
    change_of_u,
)
from sumo_eval.trajectory import BoolArray, FloatArray


class Repeats(NamedTuple):
    """Result of driving cases of an ADS twice with one build.

    cases: number of cases that were driven twice.
    alike: number of these that were equal to the last bit.
    floors: least tolerance that covers the random variation, by quantity.
    apart: cases that differed by more than a tolerance, with the change, by key.
    """

    cases: int
    alike: int
    floors: Mapping[str, float] = {}
    apart: Mapping[str, Any] = {}

    @property
    def noisy(self) -> bool:
        """Whether the ADS drives one case in more than one way."""
        return self.alike < self.cases


class Noise(NamedTuple):
    """Random variation of the ADSs in a night.

    repeats: of each ADS that was driven twice, by its name.
    bad: number of tonight's bad drives, the first included, of each newly bad case of a noisy ADS.
    shaky: cases that in an earlier good night were bad in some drives and not in others.
    steady: ADSs that drove every repeated case of the base alike to the last bit: none of their
        newly bad cases is chance.
    """

    repeats: Mapping[str, Repeats] = {}
    bad: Mapping[str, int] = {}
    shaky: frozenset[str] = frozenset()
    steady: frozenset[str] = frozenset()

    def of(self, ads: str) -> Repeats:
        """Repeats of one ADS; an ADS that was not driven twice is assumed to repeat itself."""
        return self.repeats.get(ads, Repeats(0, 0))


QUIET = Noise()  # no ADS was driven twice


# --- equations ------------------------------------------------------------------------------------


def worsening(base: FloatArray, new: FloatArray, measure: MeasureSettings) -> FloatArray:
    """d: amount by which a quantity got worse, (n,); nan where it has no value in a run."""
    return measure.sign * (base - new)


def tolerance(base: FloatArray, measure: MeasureSettings, floor: float = 0.0) -> FloatArray:
    """max(absolute, share |base|, floor), (n,).

    floor: from the random variation of an ADS that does not repeat itself.
    """
    return np.maximum(np.maximum(measure.absolute, measure.share * np.abs(base)), floor)


def floor_of(differences: FloatArray, settings: NoiseSettings) -> float:
    """Floor of a tolerance: 1.5 q95(|d|); 0 without any difference.

    differences: between two drives of each case with one build, (n,); nan where not known.
    """
    sizes = np.abs(differences[np.isfinite(differences)])
    return float(settings.factor * np.quantile(sizes, settings.quantile)) if len(sizes) else 0.0


def sign_test(worse: int, better: int) -> float:
    """P(Bin(W + B, 1/2) >= W): chance of W or more worse cases if nothing changed."""
    # bdtr(B, ...) is P(Bin <= B), the same by symmetry
    return float(bdtr(better, worse + better, 0.5))


def kept_margin(base: FloatArray, new: FloatArray, measure: MeasureSettings) -> FloatArray:
    """Share of its distance to an accident that each case kept, (n,).

    It is new / base, or base / new of a quantity that rises with danger, such as DRAC. It is 1
    where the divisor is 0 or less.
    """
    kept, whole = (new, base) if measure.sign > 0.0 else (base, new)
    return np.divide(kept, whole, out=np.ones_like(kept), where=whole > 0.0)


def holm(chances: Sequence[tuple[float, float]], level: float) -> list[bool]:
    """Holm's method: whether each test is rejected, so that the probability of any false alarm is
    at most `level`.

    Tests whose least P is too large for a rejection are left out first, as Tarone does.

    chances: (P, least P that was possible) of each test.
    """
    # indices; with m tests left, the least P of each must be at most level / m
    possible = list(range(len(chances)))
    while any(chances[i][1] > level / len(possible) for i in possible):
        possible.remove(max(possible, key=lambda i: chances[i][1]))

    rejected = [False] * len(chances)
    for rank, i in enumerate(sorted(possible, key=lambda i: chances[i][0])):
        if chances[i][0] > level / (len(possible) - rank):
            break
        rejected[i] = True
    return rejected


# --- cases ----------------------------------------------------------------------------------------


class Ends(NamedTuple):
    """Ends of cases: arrays (n,).

    missed: a requirement of the scenario was missed.
    severity: U of the contact or of the departure, in the run's unit of U; 0 without one.
    """

    collided: BoolArray
    departed: BoolArray
    gave_up: BoolArray
    not_evaluated: BoolArray
    missed: BoolArray
    severity: FloatArray

    @classmethod
    def of(cls, cases: CaseTable) -> Self:
        """Ends of the cases of a table."""
        return cls(
            collided=cases.collided,
            departed=cases.departed | cases.off_road,
            gave_up=cases.gave_up,
            not_evaluated=~cases.counted,
            missed=cases.requirements_missed != "",
            severity=np.maximum(
                np.nan_to_num(cases.severity), np.nan_to_num(cases.departure_severity)
            ),
        )

    @property
    def bad(self) -> BoolArray:
        """Cases with any of these ends."""
        return np.asarray(np.any(self[:-1], axis=0))


def both_ends(part: AdsComparison) -> tuple[Ends, Ends]:
    """Ends of the paired cases in the base and in the new run."""
    return Ends.of(part.changed.paired.base), Ends.of(part.changed.paired.new)


class Worse(NamedTuple):
    """Cases of an ADS in one scenario that are worse in a quantity, the worst first.

    part: comparison of the ADS in the scenario.
    which: indices of their pairs, (w,).
    before, after: the quantity of all pairs in the base and in the new run, (n,).
    """

    part: AdsComparison
    which: Sequence[int]
    before: Column
    after: Column


def _worst_first(flags: BoolArray, by: FloatArray) -> list[int]:
    """Indices of the pairs with a flag, the worst first.

    by: amount by which each pair is worse, (n,).
    """
    return sorted(np.flatnonzero(flags).tolist(), key=lambda pair: -by[pair])


def worse_ends(base: Ends, new: Ends, severity_by: float) -> dict[str, BoolArray]:
    """Part one: flags of the cases that ended worse, (n,), by end: a name of `ENDS`, or `severity`
    for a higher U.

    An end counts if the case did not have it in the base. A case is flagged once.

    severity_by: rise of U that counts, in its unit.
    """
    flagged = np.zeros_like(base.collided)
    ends = {}
    for name in ENDS:
        ends[name] = getattr(new, name) & ~getattr(base, name) & ~flagged
        flagged |= ends[name]
    harder = new.severity - base.severity > severity_by * (1.0 + LAST_DIGIT)
    return ends | {"severity": harder & ~flagged}


def severity_floor(once: Ends, twice: Ends, settings: NoiseSettings) -> float:
    """Floor of U from two drives of one build, in its unit.

    Only cases with a U in either drive count: zeros of all others would hide how much it varies.
    """
    harmed = (once.severity > 0.0) | (twice.severity > 0.0)
    return floor_of((twice.severity - once.severity)[harmed], settings)


def severity_limit(settings: GateSettings, repeats: Repeats, units: tuple[str, str]) -> float:
    """Rise of U that counts: max(0.5 m/s, 2 floors of U); max(0.01, 2 floors) if U is a loss
    without unit; inf, so none, if the runs have U in different units.

    units: of U in the base and in the new run.
    """
    if units[0] != units[1]:
        return math.inf
    rule = settings.outcome
    least = change_of_u(rule.severity_by, SEVERITY_BY, units[1])
    return max(least, rule.floors * repeats.floors.get("severity", 0.0))


def newly_bad(
    part: AdsComparison, settings: GateSettings, repeats: Repeats
) -> dict[str, list[int]]:
    """Part one: indices of the pairs that ended worse, the worst first, by the names of
    `worse_ends`.
    """
    base, new = both_ends(part)
    ends = worse_ends(base, new, severity_limit(settings, repeats, part.units))
    rise = new.severity - base.severity
    return {name: _worst_first(flags, rise) for name, flags in ends.items()}


class Tally(NamedTuple):
    """Worse and better cases of one ADS in all scenarios by one measure, for the sign test.

    near: True: of part two, near misses; False: of part three, shifts.
    worse: of each scenario.
    better: number of better cases.
    cases: number of all cases that have the measure.
    least_kept: least `kept_margin` of a worse case; 1 if no case is worse.
    most, furthest: largest d of a worse case, and in tolerances; 0 if no case is worse.
    """

    ads: str
    measure: MeasureSettings
    near: bool
    worse: tuple[Worse, ...]
    better: int
    cases: int
    least_kept: float
    most: float
    furthest: float

    @property
    def number(self) -> int:
        """W, the worse cases."""
        return sum(len(worse.which) for worse in self.worse)

    @property
    def chance(self) -> float:
        """P of the sign test."""
        return sign_test(self.number, self.better)


def tally(
    ads: str, compared: Sequence[AdsComparison], measure: MeasureSettings, floor: float, near: bool
) -> Tally:
    """Count worse and better cases of an ADS.

    compared: of the ADS, of each scenario.
    floor: least tolerance.
    near: True for part two. A missing value then counts as one at the limit of the measure's
        `zone`, and only cases with a value inside the zone in a run count.
    """
    worse, kept, most = [], 1.0, 0.0
    furthest, better, cases = 0.0, 0, 0
    for part in compared:
        before, after, counts = values_of(part, measure, fill=near)
        by = worsening(before, after, measure)
        limit = tolerance(before, measure, floor)
        beyond = limit * (1.0 + LAST_DIGIT)
        if near and measure.zone is not None:
            # times the sign, a smaller value is worse: the worse of the two is inside the zone
            sign = measure.sign
            counts &= np.fmin(sign * before, sign * after) < sign * measure.zone
        flags = counts & (by > beyond)
        kept = kept_margin(before, after, measure)[flags].min(initial=kept)
        most = by[flags].max(initial=most)
        furthest = (by / np.maximum(limit, LAST_DIGIT))[flags].max(initial=furthest)
        better += int(np.sum(counts & (by < -beyond)))
        cases += int(np.sum(counts))
        worse.append(Worse(part, _worst_first(flags, by), before, after))
    return Tally(ads, measure, near, tuple(worse), better, cases, kept, most, furthest)


def values_of(
    part: AdsComparison, measure: MeasureSettings, *, fill: bool
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """A quantity of all pairs, (n,) each: in the base, in the new run, and whether it counts.

    It counts where it is finite and the status is `ok`, in both runs.

    fill: a missing value becomes the limit of the measure's `zone`.
    """
    paired, (before, after) = part.changed.paired, part.comparable(measure.quantity)
    if fill and measure.zone is not None:
        before, after = (np.where(np.isnan(it), measure.zone, it) for it in (before, after))
    counts = (paired.base.status == "ok") & (paired.new.status == "ok")
    return before, after, counts & np.isfinite(before) & np.isfinite(after)


# --- the parts ------------------------------------------------------------------------------------


def got_worse(total: Tally, settings: GateSettings) -> bool:
    """Whether a tally of an ADS that repeats itself fails, with W worse and B better cases.

    Part two: W > B, and one of: P < 0.1; B = 0; a worse case kept at most 60 % of its margin.
    Part three: W >= max(3, 5 % of all cases) and P < 0.02; or B = 0 and one of: W >= max(3, 15 % of
    all cases); W >= 3, one by 5 tolerances of anything but a time; a case lost 0.3 of its task.
    """
    if total.near:
        rule = settings.near_miss
        certain = total.chance < rule.chance or not total.better
        return total.number > total.better and (certain or total.least_kept <= rule.kept_margin)
    shift = settings.shift
    # 0.7 - 0.4 is below 0.3 by rounding
    task = total.measure.quantity == "task_share"
    lost = task and total.most >= shift.lost * (1.0 - LAST_DIGIT)
    enough = many(total, settings, 0.0 if is_far(total, settings) else shift.share_alone)
    if (lost or enough) and not total.better:
        return True
    return many(total, settings, shift.share) and total.chance < shift.chance


def is_far(total: Tally, settings: GateSettings) -> bool:
    """Whether a case is worse by many tolerances; not of times."""
    # a drive takes longer where it no longer crashes, and measured times vary
    is_time = total.measure.quantity in (*TIMED, "simulated_time")
    return total.furthest >= settings.shift.far * (1.0 - LAST_DIGIT) and not is_time


def many(total: Tally, settings: GateSettings, share: float) -> bool:
    """Whether at least 3 cases, and at least `share` of all cases, are worse."""
    least = share * total.cases * (1.0 - LAST_DIGIT)  # 0.07 * 100 is above 7 by rounding
    return total.number >= max(settings.shift.cases, least)


def can_fail(total: Tally, settings: GateSettings, *, noisy: bool) -> bool:
    """Whether a tally could fail if all of its cases were worse.

    noisy: the ADS does not repeat itself, so that P must be small.
    """
    alone = total.near or total.measure.quantity == "task_share"  # one case can fail it
    enough = total.cases >= (1 if alone else settings.shift.cases)
    return enough and (not noisy or 0.5**total.cases <= settings.noise.chance)


def tallies(comparison: Comparison, settings: GateSettings, noise: Noise) -> list[Tally]:
    """Tallies of parts two and three of every ADS: near misses, then shifts."""
    return [
        tally(ads, [part for part in comparison.ads if part.ads == ads], measure,
              noise.of(ads).floors.get(measure.quantity, 0.0), near)
        for near, rule in ((True, settings.near_miss), (False, settings.shift))
        for ads in dict.fromkeys(part.ads for part in comparison.ads)
        for measure in (rule.measure if rule.on else ())
    ]  # fmt: skip


def only_improved(comparison: Comparison, settings: GateSettings) -> bool:
    """Whether no paired case is worse in any quantity, not even within a tolerance, and at least
    one is better beyond its tolerance.
    """
    measures = [measure for measure in settings.watched if measure.quantity not in TIMED]
    better = False
    for part in comparison.ads:
        base, new = both_ends(part)
        least = 0.0 if part.one_unit else math.inf  # U in two units cannot be compared
        if any(flags.any() for flags in worse_ends(base, new, least).values()):
            return False
        better |= bool((base.bad & ~new.bad).any())
        for measure in measures:
            before, after, counts = values_of(part, measure, fill=True)
            by = worsening(before, after, measure)[counts]
            if (by > LAST_DIGIT * np.abs(before[counts])).any():  # by more than rounding
                return False
            better |= bool((-by > tolerance(before[counts], measure)).any())
    return better
