"""Effect of the choice of drivers on an ADS's D and H: a jackknife that respects how drivers are
drawn.

The synthetic drivers are not a simple random sample: of any n, the recorded share overtakes,
rounded down or up (`sumo_eval.drivers.synthetic.population`). So followers are compared with
followers and overtakers with overtakers, and the rounding is an error of its own. Recorded people
are one group.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.cases import CaseTable
from sumo_eval.drivers.synthetic.population import draw_driver
from sumo_eval.record.human_reference import LeftOut
from sumo_eval.record.store import RECORDED
from sumo_eval.settings import DriverSettings, PopulationSettings
from sumo_eval.trajectory import FloatArray

INCLINATION = "share who overtake"  # the name of the error that the rounding makes
_SYNTHETIC = re.compile(r"driver_(\d+)")


@dataclass(frozen=True, slots=True, eq=False)
class DriverDeviations:
    """Standard errors of D (index) and H (likeness) by driver, (k,), with their signs: the error of
    a score is the sum over drivers of so much times a standard normal number.

    freedom: degrees of freedom. Empty: not known.
    """

    names: tuple[str, ...]
    index: FloatArray
    likeness: FloatArray
    freedom: int


NO_DEVIATIONS = DriverDeviations((), np.zeros(0), np.zeros(0), 1)


def driver_deviations(
    cases: CaseTable,
    left_out: Mapping[str, LeftOut],
    present: Mapping[str, Sequence[str]],
    settings: DriverSettings,
    seed: int,
) -> DriverDeviations:
    """Of one ADS in one scenario.

    left_out: what some of its cases get without each driver;
    present: who drove there, both by case.

    The same driver is left out of all cases at once, because it is the same person.
    """
    there = np.isin(cases.case, [case for case, one in left_out.items() if one.without])
    chosen, weights = cases.case[there].tolist(), cases.exposure[there]
    names = sorted({name for case in chosen for name in present[case]})
    if len(names) < 3 or not weights.any():  # a deviation needs two that stay
        return NO_DEVIATIONS
    found, drove = [left_out[case] for case in chosen], [list(present[case]) for case in chosen]
    plausible = np.nan_to_num(cases.plausibility[there])

    def mean(values: ArrayLike) -> FloatArray:
        """Over the cases, of values (..., cases)."""
        return np.asarray((np.array(values) @ weights) / weights.sum())

    index = [
        [
            one.without[who.index(name)] if name in who else one.everyone
            for one, who in zip(found, drove, strict=True)
        ]
        for name in names
    ]
    likeness = np.array(
        [
            [
                one.likeness_without[who.index(name)] if name in who else one.likeness
                for one, who in zip(found, drove, strict=True)
            ]
            for name in names
        ]
    )
    index_change = mean([one.exchanged - one.everyone for one in found])
    likeness_change = mean(plausible * [one.likeness_exchanged - one.likeness for one in found])
    likened = cases.safe & np.isfinite(cases.human_likeness)
    whole, calm = (
        sum(cases.exposure[part].tolist()) for part in (likened, likened & ~cases.incident)
    )
    groups = [_group(name, settings, seed) for name in names]
    share = settings.population.overtake_share if groups.count(None) == 0 else 1.0
    errors, likeness_errors = (
        stratified_deviations(mean(values), groups, share, float(change))
        for values, change in ((index, index_change), (likeness * plausible, likeness_change))
    )
    compared = calm / whole if whole else 0.0
    freedom = max(len(names) - len(set(groups)), 1)
    return DriverDeviations((*names, INCLINATION), errors, compared * likeness_errors, freedom)


def exchanges(
    names: Sequence[str], settings: DriverSettings, seed: int
) -> tuple[tuple[int, int], ...]:
    """Other results that rounding the number of overtaking drivers could give, as near as the
    drivers who are there can show it: places of one who is left out and of one of the other group
    who counts twice.

    With overtakers rounded up each of them leaves once, with followers rounded up each follower;
    who counts twice goes round. Empty unless all drivers are synthetic, and some of them overtake
    and some follow.
    """
    groups = [_group(name, settings, seed) for name in names]
    if set(groups) != {True, False}:
        return ()
    overtakers = sum(
        _overtakes(index, seed, settings.population) for index in range(settings.count)
    )
    rounded_up = overtakers > settings.count * settings.population.overtake_share
    leave = [place for place, group in enumerate(groups) if group == rounded_up]
    stay = [place for place, group in enumerate(groups) if group != rounded_up]
    return tuple((place, stay[turn % len(stay)]) for turn, place in enumerate(leave))


def stratified_deviations(
    without: FloatArray, groups: Sequence[bool | None], share: float = 1.0, change: float = 0.0
) -> FloatArray:
    """Errors of a value from what it is without each of n drivers, (n + 1,): each driver's, and
    that of the rounding.

    In a group h of n_h drivers: sqrt(n_h/(n_h - 1)) (n - 1)/n (value without driver j - their mean
    in the group); their squares add up to the variance of a stratified sample, and to the plain
    jackknife's if there is one group. The number of those who overtake (True) is n times `share`,
    rounded at random: a deviation of sqrt(f (1 - f)) drivers, f its fraction, times `change`: what
    one driver instead of one of the other group does to the value, told by one who counts
    twice (`exchanges`). Leaving out alone does not tell it: no driver replaces them, and with
    one of two followers gone it speaks of a population that is never drawn.
    """
    n = len(without)
    errors = np.zeros(n + 1)
    members = {group: np.array([one == group for one in groups]) for group in set(groups)}
    for inside in members.values():
        size = int(inside.sum())
        if size > 1:
            off = without[inside] - without[inside].mean()
            errors[:-1][inside] = math.sqrt(size / (size - 1)) * (n - 1) / n * off
    if members.keys() == {True, False}:
        fraction = (n * share) % 1.0
        errors[-1] = math.sqrt(fraction * (1.0 - fraction)) * change
    return errors


def _group(name: str, settings: DriverSettings, seed: int) -> bool | None:
    """Whether a synthetic driver overtakes; None for everybody else."""
    found = _SYNTHETIC.fullmatch(name)
    if found is None or settings.source not in ("synthetic", RECORDED):
        return None
    return _overtakes(int(found[1]), seed, settings.population)


@lru_cache(maxsize=4096)
def _overtakes(index: int, seed: int, population: PopulationSettings) -> bool:
    return draw_driver(index, seed, population).overtakes
