"""The rule by which a build got worse, in three parts: outcome, near miss, shift.

d is by how much a quantity of a case got worse. A case is worse where d is above its tolerance,
better where -d is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import bdtr

from sumo_eval.cases import CaseTable, Column
from sumo_eval.scoring.comparison import AdsComparison, Comparison, Paired
from sumo_eval.scoring.gate_settings import (
    LAST_DIGIT,
    SEVERITY_BY,
    TIMED,
    GateSettings,
    MeasureSettings,
    NoiseSettings,
    change_of_u,
)
from sumo_eval.trajectory import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Repeats:
    """Result of driving cases of an ADS twice.

    cases: driven twice;
    alike: equal to the last bit;
    floors: by quantity.
    """

    cases: int
    alike: int
    floors: Mapping[str, float] = field(default_factory=dict)

    @property
    def noisy(self) -> bool:
        """Whether the ADS drives one case in more than one way."""
        return self.alike < self.cases


@dataclass(frozen=True, slots=True)
class Noise:
    """Random variation in a night, by ADS.

    repeats: of each ADS that was driven twice.
    bad: by case, how many of its drives tonight were bad, the first among them.
    shaky: cases that were bad before in some drives of one build.
    """

    repeats: Mapping[str, Repeats] = field(default_factory=dict)
    bad: Mapping[str, int] = field(default_factory=dict)
    shaky: frozenset[str] = frozenset()

    def of(self, ads: str) -> Repeats:
        """Of one ADS; of one that was not driven twice, that it repeats."""
        return self.repeats.get(ads, Repeats(0, 0))


QUIET = Noise()


# --- equations ------------------------------------------------------------------------------------


def worsening(base: FloatArray, new: FloatArray, measure: MeasureSettings) -> FloatArray:
    """d: by how much a quantity got worse, (n,); nan where it has no value in a run."""
    return np.asarray(base - new if measure.higher_is_better else new - base)


def tolerance(base: FloatArray, measure: MeasureSettings, floor: float = 0.0) -> FloatArray:
    """max(absolute, share |base|, floor), (n,)."""
    return np.maximum(np.maximum(measure.absolute, measure.share * np.abs(base)), floor)


def floor_of(differences: FloatArray, settings: NoiseSettings) -> float:
    """1.5 q95(|d|) of differences between two drives of one build, (n,); 0 where there are none."""
    known = np.abs(differences[np.isfinite(differences)])
    return float(settings.factor * np.quantile(known, settings.quantile)) if len(known) else 0.0


def sign_test(worse: int, better: int) -> float:
    """P(Bin(W + B, 1/2) >= W): chance of W or more worse cases if nothing changed."""
    return float(bdtr(better, worse + better, 0.5))


def kept_margin(base: FloatArray, new: FloatArray, measure: MeasureSettings) -> FloatArray:
    """Share of its distance to an accident that a case kept: new / base, of a rate such as DRAC
    base / new, (n,).
    """
    kept, of = (new, base) if measure.higher_is_better else (base, new)
    return np.divide(kept, of, out=np.ones_like(kept), where=of > 0.0)


def holm(chances: Sequence[tuple[float, float]], level: float) -> list[bool]:
    """Holm's method: which tests are rejected so that one false alarm has at most the probability
    `level`.

    chances: of each test its P and the least P that it could have had. Tests that could not be
        rejected with any result do not count (Tarone).
    """
    able = list(range(len(chances)))
    while any(chances[i][1] > level / len(able) for i in able):
        able.remove(max(able, key=lambda i: chances[i][1]))

    rejected = [False] * len(chances)
    for place, i in enumerate(sorted(able, key=lambda i: chances[i][0])):
        if chances[i][0] > level / (len(able) - place):
            break
        rejected[i] = True
    return rejected


# --- cases ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """How cases ended, (n,) each.

    severity: U of the contact or of the departure, 0 without one, m/s.
    """

    collided: BoolArray
    departed: BoolArray
    gave_up: BoolArray
    not_evaluated: BoolArray
    missed: BoolArray
    severity: FloatArray

    @classmethod
    def of(cls, cases: CaseTable) -> Ends:
        """Those of some cases."""
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
        return self.collided | self.departed | self.gave_up | self.not_evaluated | self.missed


ENDS = {
    "collided": "collided", "departed": "left the road", "gave_up": "gave up",
    "not_evaluated": "not evaluated", "missed": "missed a requirement",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Worse:
    """Cases of an ADS in one scenario that are worse in a quantity, the worst first.

    which: their pairs, (w,).
    before, after: values of all pairs, (n,).
    """

    one: AdsComparison
    which: Sequence[int]
    before: Column
    after: Column

    @classmethod
    def of(
        cls, one: AdsComparison, flags: BoolArray, by: FloatArray, values: tuple[Column, Column]
    ) -> Worse:
        """Those with a flag.

        by: how much worse each pair is, (n,).
        values: before and after.
        """
        which = np.flatnonzero(flags)
        return cls(one, which[np.argsort(-by[which], kind="stable")].tolist(), *values)


def worse_ends(base: Ends, new: Ends, severity_by: float) -> dict[str, BoolArray]:
    """Part one: cases that ended in a way in which they did not end before, and those with a higher
    U, (n,) each.

    A case stands under the first of its new ends.

    severity_by: rise of U that counts, in its unit.
    """
    fresh = np.zeros(len(base.collided), dtype=np.bool_)
    ends = {}
    for name in ENDS:
        ends[name] = getattr(new, name) & ~getattr(base, name) & ~fresh
        fresh |= ends[name]
    harder = new.severity - base.severity > severity_by * (1.0 + LAST_DIGIT)
    return ends | {"severity": harder & ~fresh}


def severity_floor(once: Ends, twice: Ends, settings: NoiseSettings) -> float:
    """Floor of U, m/s, of two drives of one build: among cases with a U.

    All others would hide how much it varies.
    """
    contact = (once.severity > 0.0) | (twice.severity > 0.0)
    return floor_of((twice.severity - once.severity)[contact], settings)


def severity_limit(settings: GateSettings, repeats: Repeats, unit: str) -> float:
    """max(0.5 m/s, 2 floors of U); of a loss, which has no unit, max(0.01, 2 floors)."""
    rule = settings.outcome
    least = change_of_u(rule.severity_by, SEVERITY_BY, unit)
    return max(least, rule.floors * repeats.floors.get("severity", 0.0))


def newly_bad(one: AdsComparison, settings: GateSettings, repeats: Repeats) -> dict[str, Worse]:
    """The pairs of part one, by quantity."""
    base, new = (Ends.of(cases) for cases in (one.changed.paired.base, one.changed.paired.new))
    limit = severity_limit(settings, repeats, one.units[1])
    ends = worse_ends(base, new, limit if one.units[0] == one.units[1] else math.inf)
    harm = base.severity, new.severity
    return {name: Worse.of(one, flags, harm[1] - harm[0], harm) for name, flags in ends.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """Cases of one ADS in all scenarios, by one measure: worse ones by scenario, numbers, and what
    the sign test says.

    near: part two, near misses; else part three, shifts.
    cases: looked at.
    least_kept: the least share of its margin that a worse case kept.
    """

    ads: str
    measure: MeasureSettings
    near: bool
    worse: tuple[Worse, ...]
    better: int
    cases: int
    least_kept: float

    @property
    def number(self) -> int:
        """W, the worse cases."""
        return sum(len(one.which) for one in self.worse)

    @property
    def chance(self) -> float:
        """P of the sign test."""
        return sign_test(self.number, self.better)

    @property
    def least_chance(self) -> float:
        """The least P that this number of changed cases could have had."""
        return float(0.5 ** (self.number + self.better))


def tally(
    ads: str, compared: Sequence[AdsComparison], measure: MeasureSettings, floor: float, near: bool
) -> Tally:
    """Worse and better cases of an ADS.

    floor: of the tolerance.
    near: a value that is missing counts as one at the zone's limit.
    """
    worse, kept = [], 1.0
    better = cases = 0
    for one in compared:
        before, after, there = values_of(one.changed.paired, measure, fill=near)
        by = worsening(before, after, measure)
        limit = tolerance(before, measure, floor) * (1.0 + LAST_DIGIT)
        if near and measure.zone is not None:
            sign = 1.0 if measure.higher_is_better else -1.0
            there &= np.fmin(sign * before, sign * after) < sign * measure.zone
        flags = there & (by > limit)
        kept = float(kept_margin(before, after, measure)[flags].min(initial=kept))
        better += int(np.sum(there & (by < -limit)))
        cases += int(np.sum(there))
        worse.append(Worse.of(one, flags, by, (before, after)))
    return Tally(ads, measure, near, tuple(worse), better, cases, kept)


def values_of(
    paired: Paired, measure: MeasureSettings, *, fill: bool
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """A quantity of all pairs, before and after, and which pairs have it and ended without contact
    in both runs.
    """
    tables = paired.base, paired.new
    before, after = (getattr(cases, measure.quantity).astype(np.float64) for cases in tables)
    if fill and measure.zone is not None:
        before, after = (np.where(np.isnan(it), measure.zone, it) for it in (before, after))
    there = (paired.base.status == "ok") & (paired.new.status == "ok")
    return before, after, there & np.isfinite(before) & np.isfinite(after)


# --- the parts ------------------------------------------------------------------------------------


def got_worse(found: Tally, settings: GateSettings) -> bool:
    """Whether a tally of an ADS that repeats fails.

    Part two: W > B and (P < 0.1, or B = 0, or a case kept at most 60 % of its margin). Part three:
    W >= max(3, 5 %) and P < 0.02, or B = 0 and W >= max(3, 15 %).
    """
    if found.near:
        rule = settings.near_miss
        certain = found.chance < rule.chance or not found.better
        return found.number > found.better and (certain or found.least_kept <= rule.kept_margin)
    shift = settings.shift
    alone = not found.better and many(found, settings, shift.share_alone)
    return alone or (many(found, settings, shift.share) and found.chance < shift.chance)


def many(found: Tally, settings: GateSettings, share: float) -> bool:
    """Whether at least 3 cases, and at least a share of all, are worse."""
    return found.number >= max(settings.shift.cases, share * found.cases)


def can_fail(found: Tally, settings: GateSettings, *, noisy: bool) -> bool:
    """Whether a part could fail at all if all of its cases were worse."""
    least = 1 if found.near else settings.shift.cases
    return found.cases >= least and (not noisy or 0.5**found.cases <= settings.noise.chance)


def tallies(comparison: Comparison, settings: GateSettings, noise: Noise) -> list[Tally]:
    """Tallies of parts two and three of every ADS: near misses, then shifts."""
    return [
        tally(ads, [one for one in comparison.ads if one.ads == ads], item,
              noise.of(ads).floors.get(item.quantity, 0.0), near)
        for near, part in ((True, settings.near_miss), (False, settings.shift))
        for ads in dict.fromkeys(one.ads for one in comparison.ads)
        for item in (part.measure if part.on else ())
    ]  # fmt: skip


def only_improved(comparison: Comparison, settings: GateSettings) -> bool:
    """Whether no paired case is worse in anything, not even below a tolerance, and one is better
    beyond one.
    """
    watched = (*settings.near_miss.measure, *settings.shift.measure)
    measures = [one for one in watched if one.quantity not in TIMED]
    better = False
    for one in comparison.ads:
        base, new = (Ends.of(cases) for cases in (one.changed.paired.base, one.changed.paired.new))
        if any(flags.any() for flags in worse_ends(base, new, 0.0).values()):
            return False
        better |= bool((base.bad & ~new.bad).any())
        for measure in measures:
            before, after, there = values_of(one.changed.paired, measure, fill=True)
            by = worsening(before, after, measure)[there]
            if (by > LAST_DIGIT * np.abs(before[there])).any():
                return False
            better |= bool((-by > tolerance(before[there], measure)).any())
    return better
