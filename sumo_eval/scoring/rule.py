"""The nightly rule: whether a build got worse than its base. Its three parts:

1. Outcome: a single case ended worse.
2. Near miss: more cases lost than gained distance to an accident.
3. Shift: many cases became a little worse.

d is the amount by which a quantity of a case got worse. A case is worse if d is above its
tolerance, better if -d is above it. `nightly/` makes limits of the rule. Numbers in these
docstrings are the defaults of a gate file (`gate_settings.py`).

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
    floors: quantity -> least tolerance that covers the random variation.
    apart: key of a case that ended differently, or differed by more than a tolerance -> its change.
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

    repeats: ADS that was driven twice -> its repeats.
    bad: newly bad case of a noisy ADS -> number of its drives tonight, the first included, that are
        bad compared with one base.
    shaky: cases that in an earlier good night were bad in some drives and not in others.
    steady: ADSs that in the base drove every repeated case alike to the last bit. None of their
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
    """d, the amount by which a quantity got worse, (n,); nan if it has no value in a run.

    base, new: the quantity of the paired cases, (n,).
    """
    return measure.sign * (base - new)


def tolerance(base: FloatArray, measure: MeasureSettings, floor: float = 0.0) -> FloatArray:
    """Tolerance max(absolute, share |base|, floor), in the quantity's unit, (n,).

    base: the quantity in the base, (n,).
    floor: from the random variation of an ADS that does not repeat itself, from `floor_of`.
    """
    return np.maximum(np.maximum(measure.absolute, measure.share * np.abs(base)), floor)


def floor_of(differences: FloatArray, settings: NoiseSettings) -> float:
    """Floor of a tolerance: 1.5 times the 95 % quantile of |d|; 0 without any difference.

    differences: d between two drives of each case with one build, (n,); nan if not known.
    """
    sizes = np.abs(differences[np.isfinite(differences)])
    return float(settings.factor * np.quantile(sizes, settings.quantile)) if len(sizes) else 0.0


def sign_test(worse: int, better: int) -> float:
    """P(Bin(W + B, 1/2) >= W): probability of W or more worse cases if nothing changed.

    worse, better: W and B, numbers of cases.
    """
    # bdtr(B, n, 1/2) is P(Bin(n, 1/2) <= B), which is the same by symmetry
    return float(bdtr(better, worse + better, 0.5))


def kept_margin(base: FloatArray, new: FloatArray, measure: MeasureSettings) -> FloatArray:
    """Share of its distance to an accident that each case kept, (n,).

    base, new: the quantity of the paired cases, (n,).

    The share is new / base; for a quantity that rises with danger, such as DRAC, base / new. It is
    1 if the divisor is 0 or less.
    """
    kept, whole = (new, base) if measure.sign > 0.0 else (base, new)
    return np.divide(kept, whole, out=np.ones_like(kept), where=whole > 0.0)


def holm(chances: Sequence[tuple[float, float]], level: float) -> list[bool]:
    """Holm's method: whether each test is rejected, so that the probability of any false alarm is
    at most `level`.

    chances: P of each test, and the least P that it could have.

    Tests whose least P is too large for any rejection are left out first (Tarone's method).
    """
    # indices of tests that can be rejected: with m of them, the least P of each is <= level / m
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
    """How n cases ended, arrays (n,). All but the last are flags of bad ends.

    missed: whether a requirement of the scenario was missed.
    severity: the larger U of contact and departure, in the run's unit of U; 0 without either.
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
        """Whether each case has any bad end, (n,)."""
        return np.asarray(np.any(self[:-1], axis=0))  # all fields but `severity`

    def differ(self, other: Self) -> BoolArray:
        """Whether each case has a bad end in one of two drives only, (n,)."""
        return np.asarray(np.any(np.not_equal(self[:-1], other[:-1]), axis=0))


def both_ends(part: AdsComparison) -> tuple[Ends, Ends]:
    """Ends of the paired cases in the base and in the new run."""
    return Ends.of(part.changed.paired.base), Ends.of(part.changed.paired.new)


class Worse(NamedTuple):
    """Cases of an ADS in one scenario that are worse in a quantity.

    part: comparison of the ADS in the scenario, with n pairs.
    which: indices of the pairs of these cases, the worst first.
    before, after: the quantity of all pairs in the base and in the new run, (n,).
    rank: by which the cases are ordered: of a near miss the share of its distance to an accident
        that it lost, else d in multiples of the tolerance, (n,).
    """

    part: AdsComparison
    which: Sequence[int]
    before: Column
    after: Column
    rank: FloatArray


def _worst_first(flags: BoolArray, by: FloatArray) -> list[int]:
    """Indices of the flagged pairs, the worst first.

    flags: of all pairs, (n,).
    by: how much worse each pair is, (n,).
    """
    return sorted(np.flatnonzero(flags).tolist(), key=lambda pair: -by[pair])


def worse_ends(base: Ends, new: Ends, severity_by: float) -> dict[str, BoolArray]:
    """Part one: bad end (a name of `ENDS`, or `severity` for a higher U) -> whether each case ended
    worse in this way, (n,).

    severity_by: a rise of U above this counts, in the unit of U.

    An end counts if the case did not have it in the base. A case is flagged for one end only.
    """
    flagged = np.zeros_like(base.collided)
    ends = {}
    for name in ENDS:
        ends[name] = getattr(new, name) & ~getattr(base, name) & ~flagged
        flagged |= ends[name]
    harder = new.severity - base.severity > severity_by * (1.0 + LAST_DIGIT)
    return ends | {"severity": harder & ~flagged}


def severity_floor(once: Ends, twice: Ends, settings: NoiseSettings) -> float:
    """Floor of U from two drives of one build, in the unit of U.

    once, twice: ends of the cases in the first and in the second drive.

    Only cases with a U above 0 in one of the drives count: the zeros of all other cases would hide
    how much U varies. Cases without an outcome in one of the drives have no U there.
    """
    harmed = (once.severity > 0.0) | (twice.severity > 0.0)
    for ends in (once, twice):
        harmed &= ~(ends.gave_up | ends.not_evaluated)
    return floor_of((twice.severity - once.severity)[harmed], settings)


def severity_limit(settings: GateSettings, repeats: Repeats, units: tuple[str, str]) -> float:
    """Rise of U above which a case failed: max(0.5 m/s, 2 floors of U). If U is a loss without
    unit: max(0.01, 2 floors). If the runs have U in different units: inf, so that no rise counts.

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
    """Part one: bad end, as in `worse_ends` -> indices of the pairs that ended worse in this way,
    the worst first.
    """
    base, new = both_ends(part)
    ends = worse_ends(base, new, severity_limit(settings, repeats, part.units))
    rise = new.severity - base.severity
    return {name: _worst_first(flags, rise) for name, flags in ends.items()}


class Tally(NamedTuple):
    """Worse and better cases of one ADS in all scenarios by one measure, for the sign test.

    near: True: part two of the rule, near misses; False: part three, shifts.
    worse: worse cases of each scenario.
    better: number of better cases.
    cases: number of all cases that count.
    least_kept: least `kept_margin` of a worse case; 1 if no case is worse.
    most: largest d of a worse case; 0 if no case is worse.
    furthest: largest d of a worse case in multiples of its tolerance; 0 if no case is worse.
    lone: number of further cases that have the quantity in one of the runs alone.
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
    lone: int = 0

    @property
    def number(self) -> int:
        """W, the number of worse cases."""
        return sum(len(worse.which) for worse in self.worse)

    @property
    def chance(self) -> float:
        """P of the sign test."""
        return sign_test(self.number, self.better)


def tally(
    ads: str, compared: Sequence[AdsComparison], measure: MeasureSettings, floor: float, near: bool
) -> Tally:
    """Count worse and better cases of an ADS by a measure.

    compared: comparison of the ADS in each scenario.
    floor: least tolerance.
    near: True for part two. Then a missing value becomes the limit of the measure's `zone`, and
        only cases whose value is worse than this limit in one of the runs count.
    """
    worse, least_kept = [], 1.0
    most, furthest = 0.0, 0.0
    better, cases, lone = 0, 0, 0
    for part in compared:
        before, after, counts = values_of(part, measure, fill=near)
        by = worsening(before, after, measure)
        limit = tolerance(before, measure, floor)
        beyond = limit * (1.0 + LAST_DIGIT)
        if near and measure.zone is not None:
            # sign * value: smaller is worse. The worse of the two values is inside the zone.
            sign = measure.sign
            counts &= np.fmin(sign * before, sign * after) < sign * measure.zone
        flags = counts & (by > beyond)
        kept = kept_margin(before, after, measure)
        far = by / np.maximum(limit, LAST_DIGIT)
        least_kept = kept[flags].min(initial=least_kept)
        most = by[flags].max(initial=most)
        furthest = far[flags].max(initial=furthest)
        better += int(np.sum(counts & (by < -beyond)))
        lone += int(np.sum(_both_ok(part) & (np.isnan(before) != np.isnan(after))))
        cases += int(np.sum(counts))
        # the cases that the rule looks at alone come first
        rank = 1.0 - kept if near else far
        worse.append(Worse(part, _worst_first(flags, rank), before, after, rank))
    return Tally(ads, measure, near, tuple(worse), better, cases, least_kept, most, furthest, lone)


def values_of(
    part: AdsComparison, measure: MeasureSettings, *, fill: bool
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """A quantity of all pairs, (n,) each: in the base, in the new run, and whether it counts.

    fill: whether a missing value becomes the limit of the measure's `zone`.

    The quantity counts if it is finite and the status is `ok`, in both runs.
    """
    before, after = part.comparable(measure.quantity)
    if fill and measure.zone is not None:
        before, after = (
            np.where(np.isnan(values), measure.zone, values) for values in (before, after)
        )
    return before, after, _both_ok(part) & np.isfinite(before) & np.isfinite(after)


def _both_ok(part: AdsComparison) -> BoolArray:
    """Whether the status of each pair is `ok` in both runs, (n,)."""
    paired = part.changed.paired
    return np.asarray((paired.base.status == "ok") & (paired.new.status == "ok"))


# --- the parts ------------------------------------------------------------------------------------


def got_worse(total: Tally, settings: GateSettings) -> bool:
    """Whether a tally of an ADS that repeats itself fails. W: worse cases, B: better cases, P: of
    the sign test.

    Part two fails if W > B and one of these holds:
    - P < 0.1,
    - B = 0,
    - a worse case kept at most 60 % of its margin.

    Part three fails if one of these holds:
    - W >= max(3, 5 % of all cases), and P < 0.02,
    - B = 0, and W >= max(3, 15 % of all cases),
    - B = 0, W >= 3, and a case is worse by 5 tolerances of anything but a time,
    - B = 0, and a case lost 0.3 of its task.
    """
    if total.near:
        rule = settings.near_miss
        certain = total.chance < rule.chance or not total.better
        return total.number > total.better and (certain or total.least_kept <= rule.kept_margin)
    shift = settings.shift
    # `LAST_DIGIT`: 0.7 - 0.4 is below 0.3 by rounding
    task = total.measure.quantity == "task_share"
    lost = task and total.most >= shift.lost * (1.0 - LAST_DIGIT)
    enough = many(total, settings, 0.0 if is_far(total, settings) else shift.share_alone)
    if (lost or enough) and not total.better:
        return True
    return many(total, settings, shift.share) and total.chance < shift.chance


def is_far(total: Tally, settings: GateSettings) -> bool:
    """Whether a case is worse by many (5) tolerances of anything but a time."""
    # a drive takes longer where it no longer crashes, and measured times vary
    is_time = total.measure.quantity in (*TIMED, "simulated_time")
    return total.furthest >= settings.shift.far * (1.0 - LAST_DIGIT) and not is_time


def many(total: Tally, settings: GateSettings, share: float) -> bool:
    """Whether at least 3 cases, and at least `share` of all cases that count, are worse."""
    least = share * total.cases * (1.0 - LAST_DIGIT)  # 0.07 * 100 is above 7 by rounding
    return total.number >= max(settings.shift.cases, least)


def can_fail(total: Tally, settings: GateSettings, *, noisy: bool) -> bool:
    """Whether a tally could fail if all of its cases were worse.

    noisy: the ADS does not repeat itself, so that P must be small.
    """
    # whether one worse case can be enough
    alone = total.near or total.measure.quantity == "task_share"
    enough = total.cases >= (1 if alone else settings.shift.cases)
    return enough and (not noisy or 0.5**total.cases <= settings.noise.chance)


def tallies(comparison: Comparison, settings: GateSettings, noise: Noise) -> list[Tally]:
    """Tallies of parts two and three: near misses of every ADS, then shifts of every ADS."""
    return [
        tally(ads, [part for part in comparison.ads if part.ads == ads], measure,
              noise.of(ads).floors.get(measure.quantity, 0.0), near)
        for near, rule in ((True, settings.near_miss), (False, settings.shift))
        for ads in dict.fromkeys(part.ads for part in comparison.ads)
        for measure in (rule.measure if rule.on else ())
    ]  # fmt: skip


def only_improved(comparison: Comparison, settings: GateSettings) -> bool:
    """Whether at least one paired case is better beyond its tolerance, and none is worse in any
    quantity, not even within a tolerance. Measured times do not count.
    """
    measures = [measure for measure in settings.watched if measure.quantity not in TIMED]
    better = False
    for part in comparison.ads:
        base, new = both_ends(part)
        least = 0.0 if part.one_unit else math.inf  # U in two units is not compared
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
