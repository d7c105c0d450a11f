"""Errors of an ADS's D and H by the choice of drivers, for `intervals`: a jackknife (each driver is
left out once) that respects how drivers are drawn.

The synthetic drivers are not a simple random sample. Of any n drivers n * `overtake_share`
overtake, rounded down or up (`drivers/synthetic/population.py`). So drivers are in two groups,
those who overtake and those who follow. Each is compared with its own group, and the rounding adds
an error. Recorded drivers are one group.

Users: `scoring/confidence/intervals.py`, `scoring/confidence/scored.py`, `scoring/likeness.py`,
`scoring/steps.py`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.case_table import CaseTable
from sumo_eval.drivers.synthetic.population import draw_driver
from sumo_eval.frozen import frozen
from sumo_eval.record.human_reference import LeftOut, Varied
from sumo_eval.record.store import RECORDED
from sumo_eval.settings import DriverSettings, PopulationSettings
from sumo_eval.trajectory import FloatArray

INCLINATION = "share who overtake"  # name of the rounding's error, after the drivers' names
_SYNTHETIC = re.compile(r"driver_(\d+)")  # name of a synthetic driver, with its index


@frozen(eq=False)
class DriverDeviations:
    """Errors of D and H by the choice of drivers.

    names: of the drivers, and `INCLINATION` last, k in all; empty: the errors are not known.
    index: signed standard deviation of D by each name, (k,).
    likeness: signed standard deviation of H by each name, (k,).
    freedom: degrees of freedom.

    A replicate of a score gets the sum over the names of the deviation times a random number of the
    name (`intervals.driver_deviates`).
    """

    names: tuple[str, ...]
    index: FloatArray
    likeness: FloatArray
    freedom: int


NO_DEVIATIONS = DriverDeviations((), np.zeros(0), np.zeros(0), 1)


def driver_deviations(
    cases: CaseTable,
    left_out: Mapping[str, tuple[LeftOut, Sequence[str]]],
    settings: DriverSettings,
    seed: int,
) -> DriverDeviations:
    """The errors of one ADS in one scenario.

    cases: of the ADS.
    left_out: case -> results without each driver, and the names of the drivers, for some cases.
    settings: `[drivers]`.
    seed: of the run, from which synthetic drivers are drawn.

    A driver is left out of all cases at once, because it is one person.
    """
    # whether each case has results without each driver
    jackknifed = np.isin(
        cases.case, [case for case, (results, _) in left_out.items() if results.index.without]
    )
    pairs = [left_out[case] for case in cases.case[jackknifed].tolist()]
    weights = cases.exposure[jackknifed]
    names = sorted({*chain(*(drivers for _, drivers in pairs))})
    # without one driver, two must remain, because a deviation needs two
    if len(names) < 3 or not weights.any():
        return NO_DEVIATIONS
    groups = [_group(name, settings, seed) for name in names]
    share = 1.0 if None in groups else settings.population.overtake_share

    def mean(values: ArrayLike) -> FloatArray:
        """Mean over the cases, by exposure, of values (..., cases)."""
        return np.asarray((np.array(values) @ weights) / weights.sum())

    def errors(values: Sequence[Varied], factor: FloatArray) -> FloatArray:
        """Errors of a score by each name, (k,).

        values: of each case, with and without each driver.
        factor: of each case, by which its values are multiplied, (cases,).
        """
        # (drivers, cases): value of each case without each driver; with all drivers if the driver
        # does not drive there
        without = [
            [
                value.without[drivers.index(name)] if name in drivers else value.everyone
                for value, (_, drivers) in zip(values, pairs, strict=True)
            ]
            for name in names
        ]
        change = mean(factor * [value.exchanged - value.everyone for value in values])
        return stratified_deviations(mean(factor * without), groups, share, float(change))

    likened = cases.safe & np.isfinite(cases.human_likeness)
    # exposure of the cases in H, and of the cases in H without an incident
    whole = sum(cases.exposure[likened].tolist())
    calm = sum(cases.exposure[likened & ~cases.incident].tolist())
    index = errors([case.index for case, _ in pairs], np.ones(len(pairs)))
    plausibility = np.nan_to_num(cases.plausibility[jackknifed])
    likeness = errors([case.likeness for case, _ in pairs], plausibility)
    # H is 0 in cases with an incident, so drivers move it only in this share of the cases
    compared = calm / whole if whole else 0.0
    freedom = max(len(names) - len(set(groups)), 1)
    return DriverDeviations((*names, INCLINATION), index, compared * likeness, freedom)


def exchanges(
    names: Sequence[str], settings: DriverSettings, seed: int
) -> tuple[tuple[int, int], ...]:
    """Exchanges of drivers that imitate rounding the number of overtakers the other way: index of a
    driver who is left out, and index of a driver of the other group who counts twice instead.

    names: of the drivers.
    settings: `[drivers]`: population of the synthetic drivers.
    seed: of the run.

    If the number of overtakers was rounded up, each overtaker is left out once, else each follower.
    The drivers of the other group count twice one after another. Empty unless all drivers are
    synthetic, some overtake and some follow.
    """
    groups = [_group(name, settings, seed) for name in names]
    if set(groups) != {True, False}:
        return ()
    overtakers = sum(
        _overtakes(index, seed, settings.population) for index in range(settings.count)
    )
    rounded_up = overtakers > settings.count * settings.population.overtake_share
    leave = [index for index, group in enumerate(groups) if group == rounded_up]
    stay = [index for index, group in enumerate(groups) if group != rounded_up]
    return tuple((index, stay[turn % len(stay)]) for turn, index in enumerate(leave))


def stratified_deviations(
    without: FloatArray, groups: Sequence[bool | None], share: float = 1.0, change: float = 0.0
) -> FloatArray:
    """Errors of a value by each of n drivers, and by the rounding of the number of overtakers,
    (n + 1,).

    without: the value without each driver, (n,).
    groups: of each driver: True: overtakes; False: follows; None: not synthetic.
    share: share of drivers who overtake, before rounding, 0..1.
    change: change of the value if one driver changes from one group to the other (`exchanges`).

    Error by driver j, in a group h of n_h drivers: sqrt(n_h/(n_h - 1)) (n - 1)/n (value without
    j - mean of these values in the group). The squares add up to the variance of a stratified
    sample. With one group this is the variance of the plain jackknife.

    Error by the rounding: n * share is rounded at random, so the number of overtakers has the
    deviation sqrt(f (1 - f)), f the fractional part of n * share. The error is this deviation times
    `change`. `change` cannot be computed from `without`: a population in which one of two followers
    is left out and not replaced is never drawn.
    """
    n = len(without)
    errors = np.zeros(n + 1)
    members = {group: np.array([member == group for member in groups]) for group in set(groups)}
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
    """Whether a synthetic driver overtakes; None for any other driver.

    name: of the driver.
    """
    match = _SYNTHETIC.fullmatch(name)
    if match is None or settings.source not in ("synthetic", RECORDED):
        return None
    return _overtakes(int(match[1]), seed, settings.population)


@lru_cache(4096)
def _overtakes(index: int, seed: int, population: PopulationSettings) -> bool:
    """Whether the synthetic driver of this index overtakes."""
    return draw_driver(index, seed, population).overtakes
