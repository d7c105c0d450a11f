"""Terms of Eq. 11: similarity of an ADS to drivers at each slice and sample point, and notes on
special rules that were needed.

A driver who did not get as far as a slice has no centre there. A deviation needs two drivers. So if
fewer than two got as far as the slice, all count with their last lateral position. In mixture mode
this happens only if none did, because the deviation is completed from the other manoeuvres.

Users: `method/anthropomorphic.py`, `cases.py`, `case_table.py`, `record/human_reference.py`,
`report/notes.py`. Fixed: kinds of notes, which runs store and `report/notes.py` words; the terms,
from which D_i follows.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.frozen import frozen
from sumo_eval.method.compared_drives import SAME_PLACE, ComparedDrive
from sumo_eval.method.manoeuvres import Choice, Manoeuvre, spread
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.trajectory import BoolArray, FloatArray

# lane widths; a wider gap between drivers who are neighbours in y makes two groups of them
SPLIT_GAP = 0.5
SPLIT_MEMBERS = 2  # fewest drivers of a group
# least deviation of a field: summed as vectors, the field of a standing vehicle is 0 on its place
LEAST_FIELD = 1e-100

NoteKind = Literal[
    "manoeuvre_made_by",  # mixture mode: drivers who made the ADS's manoeuvre
    "manoeuvre_made_by_nobody",  # mixture mode: no driver made it
    "centre_floor",  # slices at which the deviation of y was raised to its floor
    "field_floor",  # points at which the deviation of the field was raised to its floor
    "two_groups",  # slices at which one Gaussian spans two groups of drivers
    "driver_not_so_far",  # slices that some driver did not reach
    "drivers_hold_last_y",  # slices that fewer than two drivers reached (mixture mode: none)
    "ads_off_road",  # slices at which the ADS's centre is off the road
    "past_the_road",  # trajectories that continue past the road's end
    "drivers_start_late",  # drivers who begin ahead of the ADS's start
    "drivers_still_driving",  # drivers who drive at the end of their recording
    "ads_still_driving",
    "ads_left_the_road",
    "drivers_without_operation",  # f_n is 0 because no driver made an operation
]


@frozen
class IndexNote:
    """A special rule that a D_i needed, and how often; `report/notes.py` makes a sentence of it.

    kind: the rule.
    count: number of slices, points, trajectories or drivers for which it was needed.
    of: number of all slices, points, trajectories or drivers.
    manoeuvre: of the ADS, with the first two kinds.
    """

    kind: NoteKind
    count: int = 0
    of: int = 0
    manoeuvre: Manoeuvre = ()


class SlicedDrives(NamedTuple):
    """An ADS and k drivers at m slices. Row 0 of `y` and of `fields` is the ADS's.

    choice: drivers that count; in mixture mode those of the ADS's manoeuvre, else all.
    x: of the slices, (m,), m.
    y: centres at the slices, (1 + k, m), m.
    fields: Eq. 9 at the sample points, (1 + k, m, p); p = 2 `points_per_side` + 1, by default 7.
    """

    ads: ComparedDrive
    drivers: Sequence[ComparedDrive]
    choice: Choice
    x: FloatArray
    y: FloatArray
    fields: FloatArray


def gaussian_similarity(value: ArrayLike, mean: ArrayLike, deviation: ArrayLike) -> FloatArray:
    """Eq. 11: min(1, p(value) / p(mean + 2 deviation)) = min(1, exp(2 - z^2 / 2)).

    value: of the ADS, in any unit; the arguments broadcast.
    mean: of the drivers' values, same unit, from `manoeuvres.spread`.
    deviation: of the drivers' values, same unit, above 0, from `manoeuvres.spread`.

    p: density of the Gaussian; z = (value - mean) / deviation.
    """
    z = (np.asarray(value) - np.asarray(mean)) / np.asarray(deviation)
    similarity: FloatArray = np.exp(np.minimum(2.0 - z * z / 2.0, 0.0))
    return similarity


def centre_term(
    compared: SlicedDrives, road: Road, settings: AnthropomorphicSettings
) -> tuple[FloatArray, list[IndexNote]]:
    """Eq. 11: centre term min(1, pt / pt_2sigma) at each slice, (m,), and notes.

    compared: the ADS and the drivers.
    road: its edges and lane width.
    settings: `[method.anthropomorphic]`: `pooled_drivers`, `centre_deviation_floor`, m.
    """
    ads = compared.y[0]
    humans = compared.y[1:]
    choice = compared.choice
    members = choice.members
    ends = np.array([driver.begin + driver.reach for driver in compared.drivers])
    reached = compared.x <= ends[:, None] + SAME_PLACE  # whether a driver reached a slice, (k, m)
    # Where too few members got that far, all members count, with their last y. In mixture mode one
    # member is enough, because its deviation is pooled with those of the other manoeuvres.
    too_few = np.count_nonzero(reached[members], axis=0) < (1 if choice.manoeuvre else 2)
    counted = reached | (too_few & members[:, None])
    mean, deviation = spread(humans, counted, choice, settings.pooled_drivers)
    floor = settings.centre_deviation_floor
    term = gaussian_similarity(ads, mean, np.maximum(deviation, floor))

    of_members = np.where(counted[members], humans[members], np.nan)
    outside = (ads < road.right_edge_at(compared.x)) | (ads > road.left_edge_at(compared.x))
    return term, [
        *note_on(deviation < floor, "centre_floor"),
        *note_on(_two_groups(of_members, SPLIT_GAP * road.lane_width), "two_groups"),
        *note_on(~reached[members].all(axis=0), "driver_not_so_far"),
        *note_on(too_few, "drivers_hold_last_y"),
        *note_on(outside, "ads_off_road"),
    ]


def _two_groups(y: FloatArray, gap: float) -> BoolArray:
    """Whether drivers form two groups at each slice, (m,): two neighbours in y are more than `gap`
    apart, with at least `SPLIT_MEMBERS` drivers on each side.

    y: centres, (k, m), m; nan for a driver who does not count at the slice.
    gap: m.
    """
    number = np.count_nonzero(np.isfinite(y), axis=0)
    below = np.arange(1, len(y))[:, None]  # drivers on the lower side of each pair of neighbours
    enough = (below >= SPLIT_MEMBERS) & (number - below >= SPLIT_MEMBERS)
    # nan sorts last and makes no gap
    split = enough & (np.diff(np.sort(y, axis=0), axis=0) > gap)
    return np.asarray(split.any(axis=0))


def field_term(
    compared: SlicedDrives, settings: AnthropomorphicSettings
) -> tuple[FloatArray, list[IndexNote]]:
    """Eq. 11: field term min(1, pv / pv_2sigma) at each sample point, (m, p), and notes.

    compared: the ADS and the drivers.
    settings: `[method.anthropomorphic]`: `pooled_drivers`, `field_deviation_floor`, a share.
    """
    # every driver has a field at every point; these flags broadcast to (k, m, p)
    everywhere = np.ones((len(compared.drivers), 1, 1), bool)
    mean, deviation = spread(
        compared.fields[1:], everywhere, compared.choice, settings.pooled_drivers
    )
    floor = np.maximum(settings.field_deviation_floor * mean, LEAST_FIELD)
    term = gaussian_similarity(compared.fields[0], mean, np.maximum(deviation, floor))
    return term, note_on(deviation < floor, "field_floor")


def choice_notes(choice: Choice) -> list[IndexNote]:
    """Notes on the drivers that count in mixture mode; none in gaussian mode."""
    if not choice.manoeuvre:
        return []
    if choice.usual == 0.0:
        return [IndexNote("manoeuvre_made_by_nobody", manoeuvre=choice.manoeuvre)]
    number = int(np.count_nonzero(choice.members))
    return [IndexNote("manoeuvre_made_by", number, choice.members.size, choice.manoeuvre)]


def trajectory_notes(
    ads: ComparedDrive, drivers: Sequence[ComparedDrive], settings: AnthropomorphicSettings
) -> list[IndexNote]:
    """Notes on special rules for the whole trajectories of an ADS and its drivers."""
    latest = ads.begin + settings.slice_spacing  # x, m; a driver who starts ahead of it is late
    return [
        # `on_road` is another object if the trajectory was cut at the road's end
        *note_on([it.on_road is not it.whole for it in (ads, *drivers)], "past_the_road"),
        *note_on([driver.begin > latest for driver in drivers], "drivers_start_late"),
        *note_on([driver.still_driving for driver in drivers], "drivers_still_driving"),
        *note_on(ads.still_driving, "ads_still_driving"),
        *note_on(ads.left_the_road, "ads_left_the_road"),
    ]


def note_on(flags: ArrayLike, kind: NoteKind) -> list[IndexNote]:
    """A note with the number of true flags and the number of all flags; no note if none is true."""
    count = int(np.count_nonzero(flags))
    return [IndexNote(kind, count, np.size(flags))] if count else []
