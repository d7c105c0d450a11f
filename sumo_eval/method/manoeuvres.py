"""Manoeuvres of drivers, for D_i in the mixture mode of Eq. 11 and for H, which always uses it:
drivers who overtake and drivers who follow are not averaged.

The paper puts one Gaussian over all drivers. Where some overtake and some follow, this Gaussian is
so wide that a car driving straight through the slower vehicle counts as human
(docs/explanation/drivers.md, Mixture mode).

A manoeuvre is the lane in which a vehicle begins, and the first lane to which it changes, if any. A
lane counts once it is kept for `manoeuvre_time`. Later changes (back to the right, or to the left
again for the next vehicle) are left out, because they depend on the length of the recording. The
trajectory beyond the end of the case, x = `Road.length`, counts too: it may show the end of a lane
change.

Users: `method/anthropomorphic.py`, `method/compared_drives.py`, `method/index_terms.py`,
`report/notes.py`, `scoring/likeness.py`. Fixed: the values of `manoeuvre_of`, `chosen` and
`spread`, from which D_i and H follow; `words`, which runs store.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.scenario.concrete import Road
from sumo_eval.trajectory import BoolArray, FloatArray, Trajectory

ROUNDING = 1e-6  # s, of sample times
Manoeuvre = tuple[int, ...]
"""The lane of the start, then the lane of the first change, if any; 0 is the right lane."""


class Choice(NamedTuple):
    """The manoeuvre of an ADS among those of k drivers.

    manoeuvre: of the ADS; empty in gaussian mode.
    members: whether each driver made the ADS's manoeuvre, (k,). All are true if no driver did.
    groups: number of each driver's manoeuvre, (k,).
    share: share of drivers who made the ADS's manoeuvre, 0..1.
    usual: `share` divided by the share of the most frequent manoeuvre, 0..1.
    """

    manoeuvre: Manoeuvre
    members: BoolArray
    groups: np.ndarray
    share: float
    usual: float


def manoeuvre_of(trajectory: Trajectory, road: Road, keeping_time: float) -> Manoeuvre:
    """The lane in which a vehicle begins, and the first lane to which it changes, if any.

    trajectory: whole, in road coordinates.
    road: `lane_width`, m.
    keeping_time: s; a shorter visit to a lane does not count. The first lane always counts.
    """
    lane = np.round(trajectory.y / road.lane_width).astype(np.int64)
    # first sample of each visit to a lane; the sample at which the next visit starts, or the last
    starts = np.flatnonzero(np.append(True, np.diff(lane) != 0))
    ends = np.append(starts[1:], lane.size - 1)
    long_enough = trajectory.time[ends] - trajectory.time[starts] >= keeping_time - ROUNDING
    # sample 0 first, as the lane of the start counts however short the visit
    lanes = lane[np.append(0, starts[long_enough])].tolist()
    return (lanes[0], *[lane for lane in lanes if lane != lanes[0]][:1])


def chosen(own: Manoeuvre, theirs: Sequence[Manoeuvre]) -> Choice:
    """Drivers that an ADS is compared with in mixture mode.

    own: manoeuvre of the ADS.
    theirs: manoeuvre of each of k drivers, at least one.
    """
    counts = Counter(theirs)
    numbers = {manoeuvre: number for number, manoeuvre in enumerate(sorted(counts))}
    groups = np.array([numbers[manoeuvre] for manoeuvre in theirs])
    members = (groups == numbers[own]) if own in numbers else np.ones(len(theirs), bool)
    share = counts[own] / len(theirs)
    return Choice(own, members, groups, share, counts[own] / max(counts.values()))


def everyone(drivers: int) -> Choice:
    """All drivers without regard to their manoeuvres, as gaussian mode compares with them."""
    return Choice((), np.ones(drivers, bool), np.zeros(drivers), 1.0, 1.0)


def spread(
    values: FloatArray, counted: BoolArray, choice: Choice, pooled_drivers: float
) -> tuple[FloatArray, FloatArray]:
    """Eq. 11: mean and deviation of the members' values, in the values' unit, (...) each.

    values: of all k drivers at each position, (k, ...).
    counted: whether each of these values exists, (k, ...).
    choice: which drivers are members.
    pooled_drivers: weight of the pooled variance, in drivers, from `[method.anthropomorphic]`.

    One or two members alone say little about how much drivers of their manoeuvre differ. So in
    mixture mode their variance is averaged with the pooled one, which is the variance within each
    manoeuvre, over all of them.
    """
    mean, own, freedom = _moments(values, counted, choice.members)
    # 1e-9 avoids a division by 0: with 0 degrees of freedom the squares are 0, and so is the result
    if not choice.manoeuvre:
        return mean, np.sqrt(own / np.maximum(freedom, 1e-9))
    by_group = [
        _moments(values, counted, choice.groups == group)[1:] for group in np.unique(choice.groups)
    ]
    squares, degrees = map(sum, zip(*by_group, strict=True))  # over the manoeuvres
    pooled = pooled_drivers * (squares / np.maximum(degrees, 1))
    return mean, np.sqrt((own + pooled) / np.maximum(freedom + pooled_drivers, 1e-9))


def _moments(
    values: FloatArray, counted: BoolArray, flags: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean of the flagged drivers' values, sum of squares about it, degrees of freedom, (...) each.

    values, counted: as in `spread`.
    flags: of the drivers, (k,).
    """
    inside = counted & flags.reshape(-1, *[1] * (values.ndim - 1))
    number = np.count_nonzero(inside, axis=0)
    mean = np.sum(values, axis=0, where=inside) / np.maximum(number, 1)
    squares = np.sum((values - mean) ** 2, axis=0, where=inside)
    return mean, squares, np.maximum(number - 1, 0)


def words(manoeuvre: Manoeuvre) -> str:
    """A manoeuvre in words: `keeps lane 0`, `changes from lane 0 to 1`."""
    lane, *changes = manoeuvre
    return f"changes from lane {lane} to {changes[0]}" if changes else f"keeps lane {lane}"
