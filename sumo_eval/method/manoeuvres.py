"""Manoeuvre that a driver chose, so that `anthropomorphic` does not average drivers who overtake
and drivers who follow into one.

The paper puts one Gaussian over all drivers. Where some overtake and some follow, that Gaussian is
so wide that a car which drives straight through the slower one counts as human (docs/method.md).
A manoeuvre is the lane in which a vehicle begins and the first one to which it changes, if it does;
a lane counts once it is kept for `manoeuvre_time`. Later changes (back to the right, or to the left
again for the next vehicle) make no manoeuvre of their own: they depend on the length of the
recording. The whole trajectory counts, also past the end of the road: that part shows the
manoeuvre that a driver was about to make.

Users: `method/anthropomorphic.py`, `method/compared_drives.py`, `method/index_terms.py`,
`report/notes.py`, `scoring/likeness.py`.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.scenario.concrete import Road
from sumo_eval.trajectory import BoolArray, FloatArray, Trajectory

ROUNDING = 1e-6  # s, of sample times
Manoeuvre = tuple[int, ...]
"""The lane of the start, and the first other one; 0 is the right lane."""


class Choice(NamedTuple):
    """The manoeuvre of an ADS among those of k drivers.

    manoeuvre: the ADS's; empty in gaussian mode.
    members: which drivers made the ADS's manoeuvre, (k,); all where none did.
    groups: every driver's manoeuvre as a number, (k,).
    share: of the drivers who made the ADS's manoeuvre, 0..1.
    usual: this share over that of the most usual manoeuvre, 0..1.
    """

    manoeuvre: Manoeuvre
    members: BoolArray
    groups: np.ndarray
    share: float
    usual: float


def manoeuvre_of(trajectory: Trajectory, road: Road, keeping_time: float) -> Manoeuvre:
    """The lane in which a vehicle begins and the first to which it changes; later visits shorter
    than `keeping_time` (s) do not count.
    """
    lane = np.round(trajectory.y / road.lane_width).astype(np.int64)
    starts = np.flatnonzero(np.append(True, np.diff(lane) != 0))
    ends = np.append(starts[1:], lane.size - 1)
    kept = trajectory.time[ends] - trajectory.time[starts] >= keeping_time - ROUNDING
    # the lane of the start counts, however soon it is left
    visited = lane[np.append(0, starts[kept])].tolist()
    return (visited[0], *[lane for lane in visited if lane != visited[0]][:1])


def chosen(own: Manoeuvre, theirs: Sequence[Manoeuvre]) -> Choice:
    """Drivers that an ADS is compared with, by its `own` manoeuvre and `theirs`, at least one."""
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

    values: of all k drivers at each place, (k, ...).
    counted: which of these values exist, (k, ...).
    choice: which drivers are members.
    pooled_drivers: weight of the pooled variance, in drivers.

    In mixture mode the members' own variance is completed by the variance within manoeuvres, pooled
    over all manoeuvres, which counts as much as `pooled_drivers` drivers: one or two members alone
    say little of how much such drivers differ.
    """

    def moments(flags: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mean of the flagged drivers' values, sum of squares about it, degrees of freedom."""
        inside = counted & flags.reshape(-1, *[1] * (values.ndim - 1))
        number = np.count_nonzero(inside, axis=0)
        mean = np.sum(values, axis=0, where=inside) / np.maximum(number, 1)
        squares = np.sum((values - mean) ** 2, axis=0, where=inside)
        return mean, squares, np.maximum(number - 1, 0)

    mean, own, freedom = moments(choice.members)
    # 1e-9, not 0: with 0 degrees of freedom the squares are 0, and so is the deviation
    if not choice.manoeuvre:
        return mean, np.sqrt(own / np.maximum(freedom, 1e-9))
    by_group = [moments(choice.groups == group)[1:] for group in np.unique(choice.groups)]
    squares, degrees = map(sum, zip(*by_group, strict=True))  # over the manoeuvres
    pooled = pooled_drivers * (squares / np.maximum(degrees, 1))
    return mean, np.sqrt((own + pooled) / np.maximum(freedom + pooled_drivers, 1e-9))


def words(manoeuvre: Manoeuvre) -> str:
    """`keeps lane 0`, `changes from lane 0 to 1`."""
    lane, *to = manoeuvre
    return f"changes from lane {lane} to {to[0]}" if to else f"keeps lane {lane}"
