"""Anthropomorphic index D, Eqs. 11-13: how closely an ADS drives as skilled humans do in the same
concrete scenario.

Users: `record/`, `scoring/`, `report/`, `cases.py`, `case_table.py`, `extras/`.

Readings of the paper (docs/method.md) that this file is built on:
- A trajectory's centre at a slice is the vehicle's own lateral position where it first gets there.
- A trajectory ends at its first sample at or past the road's end. If its last sample lies before
  the end, but the next one would lie past it, the vehicle has reached the end.
- The length L ends where the vehicle stopped or left the road. Otherwise it ends at the road's end,
  also for a vehicle that still drives at the end of the recording.
- Slices end where the ADS was last seen, or earlier, at the drivers' mean reach: the distance from
  a driver's own start to where this driver was last seen.
- A driver who did not get as far as a slice has no centre there. A deviation needs two drivers:
  where fewer than two got there (in mixture mode, none), all count with their last lateral
  position.
- In mixture mode (`settings.mode`) the drivers are those who made the ADS's manoeuvre
  (`method.manoeuvres`), and the similarity is multiplied by how usual that manoeuvre is.
- `method.operations` defines an operation.
- The human-likeness of a case (`Likeness`) is computed together with D_i. Its similarity is always
  that of mixture mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.method import score_terms
from sumo_eval.method.checks import finite, not_negative, quotient
from sumo_eval.method.manoeuvres import Choice, Manoeuvre, chosen, everyone, manoeuvre_of, spread
from sumo_eval.method.operations import count_operations as count_operations  # re-exported
from sumo_eval.method.operations import most_operations
from sumo_eval.method.shared_fields import SharedFields, Stretch
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.trajectory import CHANNELS, BoolArray, FloatArray, Trajectory

DEFAULTS = AnthropomorphicSettings()
Mode = Literal["gaussian", "mixture"]

SAME_PLACE = 1e-6  # m; a smaller difference of two x is rounding
# Operations; drivers who all make the same number of operations would have a deviation of 0.
OPERATION_DEVIATION_FLOOR = 0.5
SPLIT_GAP = 0.5  # lane widths; a wider gap between neighbouring drivers makes two groups of them
SPLIT_MEMBERS = 2  # fewest drivers of a group


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
    """A special rule that a D_i needed, and how often; `report.notes` makes a sentence of it.

    kind: the rule.
    count: number of slices, points, trajectories or drivers that it was needed for.
    of: number of all these.
    manoeuvre: the ADS's, with the first two kinds.
    """

    kind: NoteKind
    count: int = 0
    of: int = 0
    manoeuvre: Manoeuvre = ()


@frozen
class Likeness:
    """Factors of a safe case's part in H, 0..1 each; plausibility is one more (scoring.quantities).

    length_factor: f_L, in comparison with all drivers.
    operation_tolerance: f_n+ (`operation_tolerance`).
    similarity: that of mixture mode.
    """

    length_factor: float
    operation_tolerance: float
    similarity: float

    @property
    def value(self) -> float:
        """The product of the three factors."""
        return self.length_factor * self.operation_tolerance * self.similarity


@frozen
class Ingredients:
    """Quantities behind the factors of a D_i, for `report.explain`.

    drivers: number of drivers that count; in mixture mode those of the ADS's manoeuvre.
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
    """D_i of one ADS in one concrete scenario, Eq. 12, and its ingredients.

    value: D_i = length_factor * operation_factor * similarity, 0..1.
    length_factor: f_L.
    operation_factor: f_n.
    similarity: mean over all sample points of centre term times field term. In mixture mode this is
        multiplied by the manoeuvre's share / share of the most usual manoeuvre.
    notes: special rules that were needed.
    manoeuvre: the ADS's in mixture mode, else empty.
    share: of drivers who made this manoeuvre; 1 in gaussian mode.
    likeness: None where the `Pairing` does not ask for it.
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

    ads: index of its trajectory.
    drivers: indices of theirs.
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

    f_L = min(1, L / mean human L); f_n = min(1, mean human n / n); the mean is over all points of
    all slices, from the ADS's start to where it or, on average, the drivers were last seen.

    ads: its trajectory in road coordinates.
    drivers: trajectories of at least two, in the same concrete scenario.
    road: its end ends the slices, its edges narrow them.
    settings: `[method.anthropomorphic]`.

    Raises InputError for fewer drivers and for an ADS that starts past the road's end.
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
    """Eqs. 11-12: `anthropomorphic_index` of each pairing among the trajectories of one concrete
    scenario, by group.

    trajectories: in road coordinates.
    groups: pairings.
    road, settings: as in `anthropomorphic_index`.

    Lengths, operations and far fields of each trajectory are computed once. The fields at the
    points of all pairings of a group are computed together. Other groups do not
    change the indexes of a group in which all their drivers occur, to the last bit.
    """
    pairings = [pairing for group in groups for pairing in group]
    for pairing in pairings:
        if (n := len(pairing.drivers)) < 2:
            raise must_be("The number of drivers", "the anthropomorphic index", "at least 2", n)
        if (start := float(trajectories[pairing.ads].x[0])) >= road.length:
            wanted = f"before its end at x = {road.length:g} m"
            raise must_be("The ADS's start", f"road `{road.name}`", wanted, start)
    if not pairings:
        return [[] for _ in groups]
    vehicles = [_Vehicle.of(trajectory, road, settings) for trajectory in trajectories]
    # fields are wanted on the part of the road where any driver was
    drivers = [vehicles[index] for pairing in pairings for index in pairing.drivers]
    stretch = Stretch(
        west=min(driver.begin for driver in drivers),
        east=max(driver.begin + driver.reach for driver in drivers),
        south=road.right_edge,
        north=road.left_edge,
    )
    points_per_slice = 2 * settings.points_per_side + 1
    # about as many points as the longest comparison has; `SharedFields` chooses its method by them
    points = int(stretch.length / settings.slice_spacing) * points_per_slice
    shared = SharedFields(
        [vehicle.on_road for vehicle in vehicles], stretch, settings.field, points
    )
    return [_indexes(group, vehicles, shared, road, settings) for group in groups]


class _Vehicle(NamedTuple):
    """A trajectory and the quantities that Eqs. 11-12 need of it.

    whole: as recorded.
    on_road: up to its first sample at or past the road's end; `whole` itself if nothing is cut.
    begin: first x, m.
    length: L, m.
    reach: distance from `begin` to where it was last seen on the road, m.
    operations: n of D_i.
    most_operations: n of H.
    manoeuvre: that of `whole`, because a lane change begun before the road's end may end beyond it.
    still_driving, left_the_road: whether it neither stopped nor reached the road's end, and its
        last sample is on the road, or off it.
    """

    whole: Trajectory
    on_road: Trajectory
    begin: float
    length: float
    reach: float
    operations: int
    most_operations: int
    manoeuvre: Manoeuvre
    still_driving: bool
    left_the_road: bool

    @classmethod
    def of(cls, whole: Trajectory, road: Road, settings: AnthropomorphicSettings) -> _Vehicle:
        """Quantities of a recorded trajectory."""
        beyond = np.flatnonzero(whole.x >= road.length)
        on_road = whole
        if beyond.size and beyond[0] + 1 < len(whole):
            on_road = first_samples(whole, beyond[0] + 1)
        unfinished = not (_reached_the_end(on_road, road) or _has_stopped(on_road, settings))
        left = _left_the_road(on_road, road)
        return cls(
            whole=whole,
            on_road=on_road,
            begin=float(whole.x[0]),
            length=driven_length(on_road, road, settings),
            reach=_reach(on_road, road, settings),
            operations=count_operations(on_road, settings),
            most_operations=most_operations(on_road, settings),
            manoeuvre=manoeuvre_of(whole, road, settings.manoeuvre_time),
            still_driving=unfinished and not left,
            left_the_road=unfinished and left,
        )


def first_samples(drive: Trajectory, number: int) -> Trajectory:
    """The first samples of a drive, as a drive that ends with them."""
    channels = (getattr(drive, name)[:number] for name in CHANNELS)
    return Trajectory(*channels, length=drive.length, width=drive.width)


_Slices = tuple[float, float, float]
"""Slices of a comparison: the arguments of `slice_positions`, m."""


class _Comparison(NamedTuple):
    """An ADS and k drivers at m slices. Row 0 of an array is the ADS's.

    choice: drivers that count; in mixture mode those of the ADS's manoeuvre, else all.
    x: of the slices, (m,), m.
    y: centres at the slices, (1 + k, m), m.
    fields: Eq. 9 at the sample points, (1 + k, m, p); p = 2 `points_per_side` + 1, by default 7.
    """

    ads: _Vehicle
    drivers: Sequence[_Vehicle]
    choice: Choice
    x: FloatArray
    y: FloatArray
    fields: FloatArray


def _indexes(
    pairings: Sequence[Pairing],
    vehicles: Sequence[_Vehicle],
    shared: SharedFields,
    road: Road,
    settings: AnthropomorphicSettings,
) -> list[AnthropomorphicIndex]:
    """The indexes of one group."""
    if not pairings:
        return []
    # `Likeness` needs mixture mode too
    modes: tuple[Mode, Mode] = settings.mode, "mixture"
    # drivers that count, and slices, of each comparison
    choices = {
        (pairing, mode): _choice(pairing, mode, vehicles)
        for mode in modes
        for pairing in pairings
        if pairing.likeness or mode == settings.mode
    }

    @cache
    def centres(index: int, slices: _Slices) -> FloatArray:
        """Centres of a trajectory at slices, (m,), m."""
        return lateral_position(vehicles[index].on_road, slice_positions(*slices))

    # pairings of an ADS with the same slices share the sample points
    points = {
        (pairing.ads, slices): slice_points(
            slice_positions(*slices), centres(pairing.ads, slices), road, settings
        )
        for (pairing, _), (_, slices) in choices.items()
    }
    used = sorted({index for pairing in pairings for index in (pairing.ads, *pairing.drivers)})
    # Eq. 9: fields of these trajectories at all sample points, computed together, then split
    together = np.concatenate(list(points.values()))
    ends = np.cumsum([len(each) for each in points.values()])[:-1]
    x, y = together[:, 0, 0], together[..., 1]  # a slice has one x
    strengths = shared.at(x, y, used)
    fields = dict(zip(points, np.split(strengths, ends, axis=1), strict=True))

    @cache
    def index_of(pairing: Pairing, mode: Mode) -> AnthropomorphicIndex:
        """D_i of a pairing in a mode."""
        choice, slices = choices[pairing, mode]
        compared = (pairing.ads, *pairing.drivers)
        ads, *drivers = (vehicles[index] for index in compared)
        y = np.array([centres(index, slices) for index in compared])
        field = fields[pairing.ads, slices][[used.index(index) for index in compared]]
        return _index(
            _Comparison(ads, drivers, choice, slice_positions(*slices), y, field), road, settings
        )

    indexes = []
    for pairing in pairings:
        index = index_of(pairing, settings.mode)
        if pairing.likeness:
            similarity = index_of(pairing, "mixture").similarity
            index = replace(index, likeness=_likeness(pairing, vehicles, similarity))
        indexes.append(index)
    return indexes


def _choice(pairing: Pairing, mode: Mode, vehicles: Sequence[_Vehicle]) -> tuple[Choice, _Slices]:
    """The drivers that count in a mode, and the slices of the comparison."""
    ads, drivers = vehicles[pairing.ads], [vehicles[index] for index in pairing.drivers]
    choice = everyone(len(drivers))
    if mode == "mixture":
        choice = chosen(ads.manoeuvre, [driver.manoeuvre for driver in drivers])
    mean_reach = float(np.array([driver.reach for driver in drivers])[choice.members].mean())
    return choice, (ads.begin, min(ads.reach, mean_reach), pairing.spacing)


def _index(
    compared: _Comparison, road: Road, settings: AnthropomorphicSettings
) -> AnthropomorphicIndex:
    """Eqs. 11-12: D_i = f_L f_n mean(min(1, pt/pt_2sigma) min(1, pv/pv_2sigma)).

    f_L = min(1, L / mean of the drivers' L); f_n = min(1, mean of the drivers' n / n).
    """
    ads, drivers, choice = compared.ads, compared.drivers, compared.choice
    lengths = np.array([driver.length for driver in drivers])[choice.members]
    operations = np.array([driver.operations for driver in drivers])[choice.members]

    length_factor = _capped_ratio(ads.length, lengths.mean())
    operation_factor = _capped_ratio(operations.mean(), ads.operations)
    centre, centre_notes = _centre_term(compared, road, settings)
    field, field_notes = _field_term(compared, settings)
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
            *_choice_notes(choice),
            *centre_notes,
            *field_notes,
            *_trajectory_notes(ads, drivers, settings),
            *_note(operation_factor == 0.0, "drivers_without_operation"),
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


def _likeness(pairing: Pairing, vehicles: Sequence[_Vehicle], similarity: float) -> Likeness:
    """The human-likeness of a case.

    similarity: that of mixture mode, computed before.
    """
    ads, drivers = vehicles[pairing.ads], [vehicles[index] for index in pairing.drivers]
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

    Raises InputError for arguments outside these meanings.
    """
    owner = "the exposure-weighted index"
    indices, weights = finite(owner, "values", values), not_negative(owner, "exposure", exposure)
    if indices.ndim != 1 or indices.shape != weights.shape:
        shapes = f"{indices.shape} and {weights.shape}"
        raise must_be("`values` and `exposure`", owner, "one list each, equally long", shapes)
    if weights.sum() <= 0.0:
        raise must_be("The sum of `exposure`", owner, "greater than 0", float(weights.sum()))
    once = score_terms.once(len(indices))  # every scenario counts once: no resampling
    return float(score_terms.exposure_mean(indices, weights, once)[0])


# --- lengths and operations -----------------------------------------------------------------------


def driven_length(
    trajectory: Trajectory, road: Road, settings: AnthropomorphicSettings = DEFAULTS
) -> float:
    """Eq. 12: L, m, from the start to where the vehicle stopped or left the road sideways, else to
    the road's end.

    trajectory: in road coordinates, x in m.
    road: its length and edges, m.
    settings: `stop_speed` of `[method.anthropomorphic]`, m/s.

    A vehicle that still drives at the end of its recording has not stopped: its L ends at the
    road's end.
    """
    if _has_stopped(trajectory, settings) or _left_the_road(trajectory, road):
        return _reach(trajectory, road, settings)
    return max(road.length - float(trajectory.x[0]), 0.0)


def _reach(trajectory: Trajectory, road: Road, settings: AnthropomorphicSettings) -> float:
    """Distance from its start over which a vehicle was seen, at most to the road's end, m."""
    # where it stands, if it stopped; else the furthest x
    last = trajectory.x[-1] if _has_stopped(trajectory, settings) else trajectory.x.max()
    if _reached_the_end(trajectory, road):
        last = road.length
    return max(float(last - trajectory.x[0]), 0.0)


def _reached_the_end(trajectory: Trajectory, road: Road) -> bool:
    """Whether a sample, or the one that would come next, lies at or past the road's end."""
    step = trajectory.x[-1] - trajectory.x[-2] if len(trajectory) > 1 else 0.0
    return bool(max(trajectory.x.max(), trajectory.x[-1] + step) >= road.length - SAME_PLACE)


def _has_stopped(trajectory: Trajectory, settings: AnthropomorphicSettings) -> bool:
    """Whether the vehicle stands at its last sample."""
    return bool(trajectory.speed[-1] < settings.stop_speed)


def _left_the_road(trajectory: Trajectory, road: Road) -> bool:
    """Whether the vehicle's centre is off the road, to its side, at the last sample."""
    x, y = trajectory.x[-1], trajectory.y[-1]
    return bool(not road.right_edge_at(x) <= y <= road.left_edge_at(x))


def operation_tolerance(operations: int, of_drivers: Sequence[int]) -> float:
    """f_n+ of H: 1 up to the drivers' mean number of operations, above it min(1, exp(2 - z^2 / 2)).

    z = (n - mean) / max(deviation, 0.5), with mean and sample deviation over the drivers. Eq. 11
    gives the same tolerance to centre and field.

    operations: `most_operations` of the ADS.
    of_drivers: `most_operations` of each driver, at least two.
    """
    drivers = np.asarray(of_drivers, dtype=float)
    deviation = max(float(drivers.std(ddof=1)), OPERATION_DEVIATION_FLOOR)
    return float(gaussian_similarity(max(operations, drivers.mean()), drivers.mean(), deviation))


# --- slices ---------------------------------------------------------------------------------------


def slice_positions(start: float, length: float, spacing: float) -> FloatArray:
    """Eq. 11: x of the slices, (m,), m.

    start: x of the first slice, m: the ADS's start.
    length: distance to the last slice, m: the lesser of the ADS's reach and the drivers' mean.
    spacing: between neighbouring slices, m, `slice_spacing` of the settings; the last two may be
        closer.
    """
    steps = int(length / spacing)
    positions = start + spacing * np.arange(steps + 1, dtype=float)
    return (
        np.append(positions, start + length) if length - steps * spacing > SAME_PLACE else positions
    )


def lateral_position(trajectory: Trajectory, positions: ArrayLike) -> FloatArray:
    """Eq. 11: y where the vehicle first gets to each x of `positions`, (m,), m.

    trajectory: in road coordinates, m.
    positions: x of the slices, (m,), m, from `slice_positions`.

    Behind its start this is its first y; ahead of the furthest x that it reached, its last y.
    """
    x, y = trajectory.x, trajectory.y
    wanted = np.asarray(positions, dtype=float)
    # index of the first sample at or past each position; the running maximum ignores rolling back
    after = np.searchsorted(np.maximum.accumulate(x), wanted)
    crossed = (after > 0) & (after < x.size)
    # samples on both sides of the crossing; where there is none, both are the first sample
    right = np.where(crossed, after, 0)
    left = np.where(crossed, after - 1, 0)
    share = quotient(wanted - x[left], x[right] - x[left], crossed, 0.0)  # 0 if not crossed
    lateral = y[left] + share * (y[right] - y[left])
    return np.where(after == x.size, y[-1], lateral)


def slice_points(
    slices: FloatArray, centre: FloatArray, road: Road, settings: AnthropomorphicSettings = DEFAULTS
) -> FloatArray:
    """Eq. 11: x and y of the ADS's centre and three points on each side of it, 0.5 m apart,
    (m, 7, 2), m.

    slices: x, (m,), m.
    centre: y, (m,), m.
    road: its edges.
    settings: `side_width` and `points_per_side`, by default 1.5 m and 3.

    Near an edge the points of its side divide the distance to it into equal parts. Beyond the edge
    the points of this side coincide with the centre.
    """
    right = np.clip(centre - road.right_edge_at(slices), 0.0, settings.side_width)
    left = np.clip(road.left_edge_at(slices) - centre, 0.0, settings.side_width)
    parts = np.arange(1, settings.points_per_side + 1) / settings.points_per_side
    offsets = np.column_stack(
        (-right[:, None] * parts[::-1], np.zeros(len(centre)), left[:, None] * parts)
    )
    y = centre[:, None] + offsets
    return np.stack((np.broadcast_to(slices[:, None], y.shape), y), axis=-1)


# --- terms ----------------------------------------------------------------------------------------


def gaussian_similarity(value: ArrayLike, mean: ArrayLike, deviation: ArrayLike) -> FloatArray:
    """Eq. 11: min(1, p(value) / p(mean + 2 deviation)) = min(1, exp(2 - z^2 / 2)).

    value: of the ADS, in any unit; the arguments broadcast.
    mean: of the drivers' values, same unit.
    deviation: of the drivers' values, same unit, above 0.

    p: Gaussian density; z = (value - mean) / deviation.
    """
    z = (np.asarray(value) - np.asarray(mean)) / np.asarray(deviation)
    similarity: FloatArray = np.exp(np.minimum(2.0 - z * z / 2.0, 0.0))
    return similarity


def _centre_term(
    compared: _Comparison, road: Road, settings: AnthropomorphicSettings
) -> tuple[FloatArray, list[IndexNote]]:
    """Eq. 11: min(1, pt / pt_2sigma) at each slice, (m,), and notes."""
    ads, humans, choice = compared.y[0], compared.y[1:], compared.choice
    members = choice.members
    ends = np.array([driver.begin + driver.reach for driver in compared.drivers])
    reached = compared.x <= ends[:, None] + SAME_PLACE  # (k, m)
    # Where too few members got that far, all of them count, with their last y. In mixture mode one
    # is enough, because its deviation is pooled with those of the other manoeuvres.
    too_few = np.count_nonzero(reached[members], axis=0) < (1 if choice.manoeuvre else 2)
    counted = reached | (too_few & members[:, None])
    mean, deviation = spread(humans, counted, choice, settings.pooled_drivers)
    floor = settings.centre_deviation_floor
    term = gaussian_similarity(ads, mean, np.maximum(deviation, floor))

    of_members = np.where(counted[members], humans[members], np.nan)
    outside = (ads < road.right_edge_at(compared.x)) | (ads > road.left_edge_at(compared.x))
    return term, [
        *_note(deviation < floor, "centre_floor"),
        *_note(_two_groups(of_members, SPLIT_GAP * road.lane_width), "two_groups"),
        *_note(~reached[members].all(axis=0), "driver_not_so_far"),
        *_note(too_few, "drivers_hold_last_y"),
        *_note(outside, "ads_off_road"),
    ]


def _two_groups(y: FloatArray, gap: float) -> BoolArray:
    """Whether drivers form two groups at each slice, (m,): neighbours more than `gap` m apart, with
    at least `SPLIT_MEMBERS` drivers on each side.

    y: centres, (k, m), m; nan for a driver who does not count at the slice.
    """
    number = np.count_nonzero(np.isfinite(y), axis=0)
    below = np.arange(1, len(y))[:, None]  # drivers on the lower side of each pair of neighbours
    enough = (below >= SPLIT_MEMBERS) & (number - below >= SPLIT_MEMBERS)
    # nan sorts last and makes no gap
    split = enough & (np.diff(np.sort(y, axis=0), axis=0) > gap)
    return np.asarray(split.any(axis=0))


def _field_term(
    compared: _Comparison, settings: AnthropomorphicSettings
) -> tuple[FloatArray, list[IndexNote]]:
    """Eq. 11: min(1, pv / pv_2sigma) at each point, (m, 7), and notes."""
    # every driver has a field everywhere
    everywhere = np.ones((len(compared.drivers), 1, 1), dtype=bool)
    mean, deviation = spread(
        compared.fields[1:], everywhere, compared.choice, settings.pooled_drivers
    )
    floor = settings.field_deviation_floor * mean
    term = gaussian_similarity(compared.fields[0], mean, np.maximum(deviation, floor))
    return term, _note(deviation < floor, "field_floor")


def _choice_notes(choice: Choice) -> list[IndexNote]:
    """Notes on the drivers that count in mixture mode; none in gaussian mode."""
    if not choice.manoeuvre:
        return []
    if choice.usual == 0.0:
        return [IndexNote("manoeuvre_made_by_nobody", manoeuvre=choice.manoeuvre)]
    number = int(np.count_nonzero(choice.members))
    return [IndexNote("manoeuvre_made_by", number, choice.members.size, choice.manoeuvre)]


def _trajectory_notes(
    ads: _Vehicle, drivers: Sequence[_Vehicle], settings: AnthropomorphicSettings
) -> list[IndexNote]:
    """Notes on special rules for whole trajectories."""
    latest = ads.begin + settings.slice_spacing  # x, m; a driver who starts ahead of it is late
    return [
        # `on_road` is another object if the trajectory was cut at the road's end
        *_note([it.on_road is not it.whole for it in (ads, *drivers)], "past_the_road"),
        *_note([driver.begin > latest for driver in drivers], "drivers_start_late"),
        *_note([driver.still_driving for driver in drivers], "drivers_still_driving"),
        *_note(ads.still_driving, "ads_still_driving"),
        *_note(ads.left_the_road, "ads_left_the_road"),
    ]


def _note(flags: ArrayLike, kind: NoteKind) -> list[IndexNote]:
    """A note with the number of true flags and of all flags; no note if none is true."""
    count = int(np.count_nonzero(flags))
    return [IndexNote(kind, count, np.size(flags))] if count else []


def _capped_ratio(value: float | np.floating, reference: float | np.floating) -> float:
    """min(1, value / reference), and 1 where the reference is 0."""
    return 1.0 if value >= reference else float(value / reference)
