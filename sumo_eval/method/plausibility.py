"""Plausibility of a case, a factor of H: are its extremes within what recorded people do?

Fields and lateral positions show where and how fast a vehicle drove. They do not show how close to
other vehicles it drove, nor how abruptly. Seven extremes of a drive show this: the least time to
collision and time headway, the strongest braking, the largest jerk, unrest, lateral speed and
lateral acceleration. Each is compared with the same extreme of recorded drives. Both sides are
measured by the same rules (`measures.py`): distances at the recorded samples, derivatives of speed
and y by `smooth_motion`.

A recorded drive is one vehicle in one encounter: it approaches a slower vehicle, a vehicle cuts in
ahead of it, or its lead vehicle leaves the lane. It is 10 to 32 s long, as most cases of the
motorway scenarios. A longer drive would have more chances of an extreme.

Users: `scoring/` (`drive_results` computes the extremes of every case), `report/`. Fixed: names and
arguments (docs/reference/python.md); names of the extremes, which `report/` words;
`MOTORWAY_PEOPLE`, measured by `tools/motorway_people.py`.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.frozen import frozen
from sumo_eval.method.measures import Course, largest, least
from sumo_eval.trajectory import FloatArray

USUAL_SHARE = 0.05
"""An extreme that at least this share of people reach lowers nothing."""
LEAST_PEOPLE = 20
"""Fewest people of a table. Fewer cannot show a share of 5 %, because one of them is more."""
EXTREMES: Mapping[str, int] = {
    "min_ttc": -1,
    "min_thw": -1,
    "max_deceleration": 1,
    "max_jerk": 1,
    "max_unrest": 1,
    "max_lateral_speed": 1,
    "max_lateral_acceleration": 1,
}
"""The extremes that count: 1 if a larger value is more extreme, -1 if a smaller one is."""
LEVELS = (0.01, 0.02, 0.03, 0.04, 0.05, 0.1, 0.25, 0.5)
"""Shares of people at which a table holds values, after the share of its most extreme person."""


@frozen
class Quantiles:
    """Table of how extreme people drive: the share `shares[name][k]` of them reaches
    `values[name][k]` or more extreme values.

    values: s, m/s, m/s2 or m/s3 as in `extremes_of`, the most extreme first, which only one person
        reached.
    shares: 0..1, ascending.
    people: number of persons, who weigh 1 each.
    drives: number of their drives.
    source: whose drives, in words.
    """

    values: Mapping[str, tuple[float, ...]]
    shares: Mapping[str, tuple[float, ...]]
    people: int
    drives: int
    source: str

    def share(self, name: str, value: float) -> float:
        """Share of people at least as extreme as `value`, 0..1, linear between the table's values.

        name: of the extreme.
        value: of a drive, in the extreme's unit.

        The share is 1 if the table does not have the extreme, if the value is nan (a drive without
        this extreme, as without a lead vehicle), and if it is milder than the table's last value.
        Beyond the most extreme person the share falls to 0 over the distance between the table's
        first two values, because one more person could have gone there.
        """
        if name not in self.values or math.isnan(value):
            return 1.0
        side = EXTREMES[name]
        values = np.asarray(self.values[name])
        if (value - values[-1]) * side < 0.0:  # milder than the last
            return 1.0
        # before the first value one of share 0, as far beyond it as the second value is milder
        extended = np.append(2.0 * values[0] - values[1], values)
        # times -side the values ascend, as `interp` needs them
        return float(np.interp(-side * value, -side * extended, (0.0, *self.shares[name])))


MOTORWAY_PEOPLE = Quantiles(
    values={
        "min_ttc": (1.332, 1.887, 2.343, 2.717, 3.19, 3.606, 4.819, 7.947, 12.218),
        "min_thw": (0.203, 0.304, 0.331, 0.369, 0.394, 0.451, 0.557, 0.792, 1.287),
        "max_deceleration": (5.764, 2.778, 2.66, 2.533, 2.163, 2.005, 1.42, 0.998, 0.575),
        "max_jerk": (2.819, 1.593, 1.474, 1.401, 1.353, 1.328, 1.07, 0.814, 0.556),
        "max_unrest": (5.253, 2.704, 2.535, 2.334, 2.116, 2.011, 1.786, 1.341, 0.93),
        "max_lateral_speed": (1.627, 1.154, 1.064, 1.015, 0.994, 0.967, 0.854, 0.695, 0.31),
        "max_lateral_acceleration": (0.933, 0.589, 0.486, 0.458, 0.446, 0.387, 0.338, 0.265, 0.181),
    },
    shares={
        name: (least, *LEVELS)
        for name, least in zip(
            EXTREMES,
            (0.00067, 0.00117, 0.00156, 0.00156, 0.00156, 0.00117, 0.00156),
            strict=True,
        )
    },
    people=213,
    drives=674,
    source="DLR Highway Traffic v1.1.0, motorway near Braunschweig, 2024-10-07",
)
"""213 people on a free-flowing motorway of two lanes, 674 encounters, from
`tools/motorway_people.py`. One drive is left out, a ghost of the tracker (3.5 m/s across the road).
Not for towns: no vehicle of these recordings stops, turns or meets pedestrians.
"""


def extremes_of(course: Course) -> dict[str, float]:
    """The seven extremes of a drive, by the names of `EXTREMES`.

    course: of the drive, from `measures.course_of`.

    min_ttc, min_thw: s. max_deceleration: m/s2, 0 if the ego never braked. max_jerk: m/s3.
    max_unrest: m/s2. max_lateral_speed: m/s. max_lateral_acceleration: m/s2. min_ttc is inf if the
    ego never closes. nan: the drive has no such extreme, as without a lead vehicle, or if it is too
    short for a derivative.
    """
    motion = course.motion
    return {
        "min_ttc": least(course.ttc),
        "min_thw": least(course.thw),
        "max_deceleration": largest(np.maximum(-motion.acceleration, 0.0)),
        "max_jerk": largest(np.abs(motion.jerk)),
        "max_unrest": largest(motion.unrest),
        "max_lateral_speed": largest(np.abs(motion.lateral_speed)),
        "max_lateral_acceleration": largest(np.abs(motion.lateral_acceleration)),
    }


def plausibility(extremes: Mapping[str, float], people: Quantiles) -> float:
    """Plausibility = min over the extremes of min(1, share of people at least as extreme / 5 %),
    0..1.

    extremes: of one drive, from `extremes_of`.
    people: the table to compare with, `MOTORWAY_PEOPLE` or from `quantiles_of`.
    """
    return min(1.0, least_plausible(extremes, people)[1] / USUAL_SHARE)


def least_plausible(extremes: Mapping[str, float], people: Quantiles) -> tuple[str, float]:
    """The extreme that decides the plausibility, and the share of people at least as extreme. Of
    equal shares the first one counts.

    extremes, people: as in `plausibility`.
    """
    shares = {name: people.share(name, value) for name, value in extremes.items()}
    name = min(shares, key=shares.__getitem__)
    return name, shares[name]


def quantiles_of(
    drives: Sequence[Mapping[str, float]],
    people: Sequence[str],
    *,
    source: str = "recorded drivers",
) -> Quantiles:
    """The table of some people's drives.

    drives: extremes of each drive, from `extremes_of`.
    people: name of the driver of each drive.
    source: whose drives, in words.

    Every person weighs 1, shared by the person's drives. A drive without an extreme (nan) does not
    count in this extreme. An extreme that fewer than 20 people have is not in the table.

    Raises InputError for fewer than 20 people, who cannot show a share of 5 %.
    """
    if (persons := len(set(people))) < LEAST_PEOPLE:
        raise InputError(
            f"The recorded drives must be of at least {LEAST_PEOPLE} people, because fewer cannot "
            f"show a share of 5 %, got {persons}."
        )
    values: dict[str, tuple[float, ...]] = {}
    shares: dict[str, tuple[float, ...]] = {}
    for name, side in EXTREMES.items():
        extreme = np.array([drive[name] for drive in drives], float)
        valid = np.flatnonzero(~np.isnan(extreme))
        names = [people[index] for index in valid.tolist()]
        drives_of = Counter(names)
        if len(drives_of) < LEAST_PEOPLE:
            continue
        weights = np.array([1.0 / drives_of[person] for person in names]) / len(drives_of)
        table = _table(side * extreme[valid], weights)
        if table is not None:
            shares[name], signed = table
            values[name] = tuple(side * value for value in signed)
    return Quantiles(values, shares, persons, len(drives), source)


def _table(
    extreme: FloatArray, weights: FloatArray
) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Shares of people, ascending, and the value that each share reaches. None if fewer than two
    values differ.

    extreme: of n drives, (n,); a larger value is more extreme.
    weights: of the drives, (n,), together 1.
    """
    order = np.argsort(-extreme, kind="stable")
    values = extreme[order]
    share = np.cumsum(weights[order])
    # of equal values the last one counts: its share is that of all who are as extreme
    is_last = np.append(values[1:] < values[:-1], True) & np.isfinite(values)
    values = values[is_last]
    share = share[is_last]
    if values.size < 2:
        return None
    between = [level for level in LEVELS if share[0] < level <= share[-1]]
    # `Quantiles.share` interpolates between at least two levels
    levels = np.array([share[0], *(between or share[-1:])])
    return tuple(levels.tolist()), tuple(np.interp(levels, share, values).tolist())
