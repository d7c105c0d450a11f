"""Anthropomorphic index D, Eqs. 11-13: how closely an ADS drives as skilled humans do in the same
concrete scenario.

`compared_drives.py` has the drives at the slices, `index_terms.py` the terms of Eq. 11. A slice
here is a cross-section of the road.

Readings of the paper (docs/method.md):
- The slices go as far as the ADS, or as the drivers on average if that is shorter: each drive
  counts by the distance from its own start (`ComparedDrive.reach`).
- In mixture mode (`settings.mode`) the drivers are those who made the ADS's manoeuvre
  (`manoeuvres.py`), and the similarity is multiplied by how usual this manoeuvre is. If no driver
  made it, all drivers count, and D_i is 0.
- `operations.py` defines an operation.
- The human-likeness of a case (`Likeness`) is computed together with D_i. Its similarity is always
  that of mixture mode.

Users: `extras/bench/costs.py`, `extras/studies/qualification/table.py`,
`record/human_reference.py`, `report/explain.py`, `scoring/drive_beside.py`,
`tools/people_evidence.py`. Fixed: names and arguments of `anthropomorphic_index`,
`count_operations` and `exposure_weighted_index`, which users call; D_i to the last bit.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.method import score_terms
from sumo_eval.method.checks import finite, not_negative
from sumo_eval.method.compared_drives import (
    DEFAULTS,
    ComparedDrive,
    lateral_position,
    slice_points,
    slice_positions,
)
from sumo_eval.method.index_terms import (
    IndexNote,
    SlicedDrives,
    centre_term,
    choice_notes,
    field_term,
    gaussian_similarity,
    note_on,
    trajectory_notes,
)
from sumo_eval.method.manoeuvres import Choice, Manoeuvre, chosen, everyone
from sumo_eval.method.operations import count_operations as count_operations  # re-exported
from sumo_eval.method.shared_fields import SharedFields, Stretch
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.trajectory import FloatArray, Trajectory

Mode = Literal["gaussian", "mixture"]

# Least deviation of the drivers' numbers of operations. Drivers who all make the same number would
# have a deviation of 0.
OPERATION_DEVIATION_FLOOR = 0.5


@frozen
class Likeness:
    """Three factors of a safe case's part in H, 0..1 each, named as in the case's row.
    `scoring/quantities.py` multiplies them by a fourth one, plausibility.

    likeness_length_factor: f_L, by the mean length of all drivers.
    operation_tolerance: f_n+, from the function `operation_tolerance`.
    mixture_similarity: of mixture mode.
    """

    likeness_length_factor: float
    operation_tolerance: float
    mixture_similarity: float

    @property
    def value(self) -> float:
        """The product of the three factors."""
        return self.likeness_length_factor * self.operation_tolerance * self.mixture_similarity


@frozen
class Ingredients:
    """Quantities behind the factors of a D_i, for `report.explain`.

    drivers: number of drivers that count; in mixture mode those of the ADS's manoeuvre, or all if
        no driver made it.
    ads_length, mean_length: L of the ADS, and its mean over these drivers, m.
    ads_operations, mean_operations: n of the ADS, and its mean over these drivers.
    slices: number of slices.
    centre_similarity, field_similarity: mean of each term of Eq. 11 over all sample points.
    lowest: smallest similarity of a slice.
    lowest_at: x of that slice, m.
    """

    drivers: int
    ads_length: float
    mean_length: float
    ads_operations: int
    mean_operations: float
    slices: int
    centre_similarity: float
    field_similarity: float
    lowest: float
    lowest_at: float


@frozen
class AnthropomorphicIndex:
    """D_i of one ADS in one concrete scenario, Eqs. 11-12, and its ingredients.

    value: D_i = length_factor * operation_factor * similarity, 0..1.
    length_factor: f_L.
    operation_factor: f_n.
    similarity: mean over all sample points of centre term times field term. In mixture mode this is
        multiplied by (share of the manoeuvre) / (share of the most frequent manoeuvre).
    notes: special rules that were needed.
    manoeuvre: of the ADS in mixture mode, else empty.
    share: share of drivers who made this manoeuvre; 1 in gaussian mode.
    likeness: None if the `Pairing` does not ask for it.
    """

    value: float
    length_factor: float
    operation_factor: float
    similarity: float
    notes: tuple[IndexNote, ...]
    manoeuvre: Manoeuvre
    share: float
    ingredients: Ingredients
    likeness: Likeness | None = None


class Pairing(NamedTuple):
    """An ADS and the drivers it is compared with, as indices of a list of trajectories.

    ads: index of the ADS's trajectory.
    drivers: indices of the drivers' trajectories, at least two.
    spacing: of the slices, m.
    likeness: whether to compute `Likeness` together with D_i.
    """

    ads: int
    drivers: tuple[int, ...]
    spacing: float
    likeness: bool = False


def anthropomorphic_index(
    ads: Trajectory,
    drivers: Sequence[Trajectory],
    road: Road,
    settings: AnthropomorphicSettings = DEFAULTS,
) -> AnthropomorphicIndex:
    """Eqs. 11-12: D_i = f_L f_n mean(min(1, pt/pt_2sigma) min(1, pv/pv_2sigma)), one ADS in one
    concrete scenario.

    f_L = min(1, L / mean of the drivers' L); f_n = min(1, mean of the drivers' n / n).

    The similarity, mean(...), is over all points of all slices. The slices begin at the ADS's start
    and go as far as the ADS, or as the drivers on average if that is shorter.

    ads: trajectory of the ADS in road coordinates.
    drivers: trajectories of at least two drivers in the same concrete scenario.
    road: its end ends the slices, its edges narrow them.
    settings: `[method.anthropomorphic]`.

    Raises InputError for fewer than two drivers, and for an ADS that starts past the road's end.
    """
    pairing = Pairing(0, tuple(range(1, 1 + len(drivers))), settings.slice_spacing, likeness=True)
    ((index,),) = indexes_by_group([ads, *drivers], [[pairing]], road, settings)
    return index


def indexes_by_group(
    trajectories: Sequence[Trajectory],
    groups: Sequence[Sequence[Pairing]],
    road: Road,
    settings: AnthropomorphicSettings = DEFAULTS,
) -> list[list[AnthropomorphicIndex]]:
    """Eqs. 11-12: D_i of each pairing among the trajectories of one concrete scenario, by group.

    trajectories: in road coordinates.
    groups: pairings whose fields are computed together.
    road, settings: as in `anthropomorphic_index`.

    Lengths, operations and far fields of each trajectory are computed once for all groups. The
    fields are summed in boxes (`shared_fields.py`) that divide the stretch of road where any driver
    was. So a driver that extends this stretch changes the last bits of all groups. Further groups
    change no bit of a group that has all their drivers.

    Raises InputError as `anthropomorphic_index`.
    """
    pairings = [pairing for group in groups for pairing in group]
    for pairing in pairings:
        _refuse_unusable(pairing, trajectories, road)
    if not pairings:
        return [[] for _ in groups]
    vehicles = [ComparedDrive.of(trajectory, road, settings) for trajectory in trajectories]
    # the part of the road that is divided into boxes: where any driver was
    drivers = [vehicles[index] for pairing in pairings for index in pairing.drivers]
    stretch = Stretch(
        west=min(driver.begin for driver in drivers),
        east=max(driver.begin + driver.reach for driver in drivers),
        south=road.right_edge,
        north=road.left_edge,
    )
    points_per_slice = 2 * settings.points_per_side + 1
    # about the number of points of the longest comparison; it decides whether boxes are used
    points = int(stretch.length / settings.slice_spacing) * points_per_slice
    shared = SharedFields(
        [vehicle.on_road for vehicle in vehicles], stretch, settings.field, points
    )
    return [_indexes(group, vehicles, shared, road, settings) for group in groups]


def _refuse_unusable(pairing: Pairing, trajectories: Sequence[Trajectory], road: Road) -> None:
    """Raise InputError for fewer than two drivers, or an ADS that starts past the road's end."""
    if (n := len(pairing.drivers)) < 2:
        raise must_be("The number of drivers", "the anthropomorphic index", "at least 2", n)
    if (start := float(trajectories[pairing.ads].x[0])) >= road.length:
        wanted = f"before its end at x = {road.length:g} m"
        raise must_be("The ADS's start", f"road `{road.name}`", wanted, start)


_Slices = tuple[float, float, float]
"""Slices of a comparison: start, length and spacing, m, the arguments of `slice_positions`."""


def _indexes(
    pairings: Sequence[Pairing],
    vehicles: Sequence[ComparedDrive],
    shared: SharedFields,
    road: Road,
    settings: AnthropomorphicSettings,
) -> list[AnthropomorphicIndex]:
    """The indexes of one group, in the order of its pairings.

    vehicles: of all trajectories.
    shared: fields of all trajectories.
    """
    if not pairings:
        return []
    # `Likeness` needs the similarity of mixture mode as well
    modes: tuple[Mode, Mode] = settings.mode, "mixture"
    # (pairing, mode) -> drivers that count, and slices
    choices = {
        (pairing, mode): _choice(pairing, mode, vehicles)
        for mode in modes
        for pairing in pairings
        if pairing.likeness or mode == settings.mode
    }

    @cache
    def centres(index: int, slices: _Slices) -> FloatArray:
        """Centres of a trajectory at m slices, (m,), m."""
        return lateral_position(vehicles[index].on_road, slice_positions(*slices))

    # (ADS, slices) -> sample points, (m, p, 2); pairings with the same key share them
    points = {
        (pairing.ads, slices): slice_points(
            slice_positions(*slices), centres(pairing.ads, slices), road, settings
        )
        for (pairing, _mode), (_choice, slices) in choices.items()
    }
    used = sorted({index for pairing in pairings for index in (pairing.ads, *pairing.drivers)})
    fields = dict(zip(points, _fields_at(list(points.values()), used, shared), strict=True))

    @cache
    def index_of(pairing: Pairing, mode: Mode) -> AnthropomorphicIndex:
        """D_i of a pairing in a mode."""
        choice, slices = choices[pairing, mode]
        compared = (pairing.ads, *pairing.drivers)
        ads, *drivers = (vehicles[index] for index in compared)
        y = np.array([centres(index, slices) for index in compared])
        field = fields[pairing.ads, slices][[used.index(index) for index in compared]]
        return _index(
            SlicedDrives(ads, drivers, choice, slice_positions(*slices), y, field), road, settings
        )

    indexes = []
    for pairing in pairings:
        index = index_of(pairing, settings.mode)
        if pairing.likeness:
            similarity = index_of(pairing, "mixture").similarity
            index = replace(index, likeness=_likeness(pairing, vehicles, similarity))
        indexes.append(index)
    return indexes


def _fields_at(
    points: Sequence[FloatArray], trajectories: Sequence[int], shared: SharedFields
) -> list[FloatArray]:
    """Eq. 9: fields of t trajectories at the sample points of each comparison, (t, m, p) each, all
    computed together.

    points: of each comparison, (m, p, 2), m; the points of a slice have one x.
    trajectories: indices, (t,).
    """
    together = np.concatenate(points)
    ends = np.cumsum([len(each) for each in points])[:-1]
    return np.split(shared.at(together[:, 0, 0], together[..., 1], trajectories), ends, axis=1)


def _choice(
    pairing: Pairing, mode: Mode, vehicles: Sequence[ComparedDrive]
) -> tuple[Choice, _Slices]:
    """The drivers that count in a mode, and the slices of the comparison."""
    ads = vehicles[pairing.ads]
    drivers = [vehicles[index] for index in pairing.drivers]
    choice = everyone(len(drivers))
    if mode == "mixture":
        choice = chosen(ads.manoeuvre, [driver.manoeuvre for driver in drivers])
    mean_reach = float(np.array([driver.reach for driver in drivers])[choice.members].mean())
    return choice, (ads.begin, min(ads.reach, mean_reach), pairing.spacing)


def _index(
    compared: SlicedDrives, road: Road, settings: AnthropomorphicSettings
) -> AnthropomorphicIndex:
    """Eqs. 11-12: D_i = f_L f_n mean(min(1, pt/pt_2sigma) min(1, pv/pv_2sigma)).

    f_L = min(1, L / mean of the drivers' L); f_n = min(1, mean of the drivers' n / n).

    compared: the ADS and its drivers at the slices.
    road: its edges and lane width.
    settings: `[method.anthropomorphic]`.
    """
    ads, drivers, choice = compared.ads, compared.drivers, compared.choice
    lengths = np.array([driver.length for driver in drivers])[choice.members]
    operations = np.array([driver.operations for driver in drivers])[choice.members]

    length_factor = _capped_ratio(ads.length, lengths.mean())
    operation_factor = _capped_ratio(operations.mean(), ads.operations)
    centre, centre_notes = centre_term(compared, road, settings)
    field, field_notes = field_term(compared, settings)
    terms = centre[:, None] * field
    similarity = choice.usual * float(terms.mean())  # `usual` is 1 in gaussian mode

    of_slices = terms.mean(axis=1)
    worst = np.argmin(of_slices)
    return AnthropomorphicIndex(
        length_factor * operation_factor * similarity,
        length_factor,
        operation_factor,
        similarity,
        (
            *choice_notes(choice),
            *centre_notes,
            *field_notes,
            *trajectory_notes(ads, drivers, settings),
            *note_on(operation_factor == 0.0, "drivers_without_operation"),
        ),
        choice.manoeuvre,
        choice.share,
        Ingredients(
            drivers=len(lengths),
            ads_length=ads.length,
            mean_length=float(lengths.mean()),
            ads_operations=ads.operations,
            mean_operations=float(operations.mean()),
            slices=len(compared.x),
            centre_similarity=float(centre.mean()),
            field_similarity=float(field.mean()),
            lowest=float(of_slices[worst]),
            lowest_at=float(compared.x[worst]),
        ),
    )


def _likeness(pairing: Pairing, vehicles: Sequence[ComparedDrive], similarity: float) -> Likeness:
    """The human-likeness of a case.

    similarity: of mixture mode.
    """
    ads = vehicles[pairing.ads]
    drivers = [vehicles[index] for index in pairing.drivers]
    return Likeness(
        _capped_ratio(ads.length, np.mean([driver.length for driver in drivers])),
        operation_tolerance(ads.most_operations, [driver.most_operations for driver in drivers]),
        similarity,
    )


def exposure_weighted_index(values: ArrayLike, exposure: ArrayLike) -> float:
    """Eq. 13: D = sum(p_i D_i) / sum(p_i) over the concrete scenarios of the safe zone.

    values: D_i, (n,), from `anthropomorphic_index`.
    exposure: p_i, naturalistic probability of each concrete scenario, (n,), at least 0, not all 0,
        from the logical scenario.

    Raises InputError for values that are not finite, negative exposure, arrays of other shapes, and
    exposure that is 0 everywhere.
    """
    owner = "the exposure-weighted index"
    indices = finite(owner, "values", values)
    weights = not_negative(owner, "exposure", exposure)
    if indices.ndim != 1 or indices.shape != weights.shape:
        shapes = f"{indices.shape} and {weights.shape}"
        raise must_be("`values` and `exposure`", owner, "one list each, equally long", shapes)
    if weights.sum() <= 0.0:
        raise must_be("The sum of `exposure`", owner, "greater than 0", float(weights.sum()))
    once = score_terms.once(len(indices))  # every scenario counts once: no resampling
    return float(score_terms.exposure_mean(indices, weights, once)[0])


# --- lengths and operations -----------------------------------------------------------------------


def operation_tolerance(operations: int, of_drivers: Sequence[int]) -> float:
    """f_n+ of H, the tolerant form of Eq. 12's f_n: 1 up to the drivers' mean n, above it
    min(1, exp(2 - z^2 / 2)).

    z = (n - mean) / max(deviation, 0.5), with mean and sample deviation over the drivers. Eq. 11
    has the same tolerance for centre and field.

    operations: `most_operations` of the ADS.
    of_drivers: `most_operations` of each driver, at least two.
    """
    drivers = np.asarray(of_drivers, float)
    deviation = max(float(drivers.std(ddof=1)), OPERATION_DEVIATION_FLOOR)
    return float(gaussian_similarity(max(operations, drivers.mean()), drivers.mean(), deviation))


def _capped_ratio(value: float | np.floating, reference: float | np.floating) -> float:
    """min(1, value / reference), and 1 where the reference is 0."""
    return 1.0 if value >= reference else float(value / reference)
