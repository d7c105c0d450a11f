"""A drive as Eqs. 11-12 compare it: its length L, its reach, its centres at slices.

Readings of the paper (docs/method.md):
- A trajectory's centre at a slice is the vehicle's own lateral position where it first gets there.
- A trajectory ends at its first sample at or past the road's end. A vehicle has reached the end if
  it has such a sample, or if its last step, repeated, would lead there.
- The length L of a vehicle that stopped ends where it stands. That of a vehicle that is beside the
  road at the end ends at its furthest x, wherever it left the road. Every other L ends at the end
  of the road, also that of a vehicle that still drives at the end of the recording.

Users: `extras/bench/costs.py`, `method/anthropomorphic.py`, `method/index_terms.py`,
`scoring/drive_beside.py`. Fixed: all values, from which D_i and H follow.
"""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.method.checks import quotient
from sumo_eval.method.manoeuvres import Manoeuvre, manoeuvre_of
from sumo_eval.method.operations import count_operations, most_operations
from sumo_eval.scenario.concrete import Road
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.trajectory import CHANNELS, FloatArray, Trajectory

DEFAULTS = AnthropomorphicSettings()
SAME_PLACE = 1e-6  # m; a smaller difference of two x is rounding


class ComparedDrive(NamedTuple):
    """A trajectory and the quantities that Eqs. 11-12 need of it.

    whole: as recorded.
    on_road: up to its first sample at or past the road's end; `whole` itself if nothing is cut.
    begin: first x, m.
    length: L of Eq. 12, m, from `begin`; the file's docstring says where it ends.
    reach: distance driven along the road, m: from `begin` to the road's end if it was reached, else
        to where it stands, else to the furthest x.
    operations: n of D_i (`operations.count_operations`).
    most_operations: n of H (`operations.most_operations`).
    manoeuvre: of `whole`, because a lane change begun before the road's end may end beyond it.
    still_driving: whether it neither stopped, nor reached the road's end, nor left the road.
    left_the_road: whether it neither stopped nor reached the road's end, and its last sample is
        beside the road.
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
    def of(cls, whole: Trajectory, road: Road, settings: AnthropomorphicSettings) -> Self:
        """Quantities of a recorded trajectory.

        whole: the trajectory, in road coordinates.
        settings: `[method.anthropomorphic]`.
        """
        beyond = np.flatnonzero(whole.x >= road.length)
        on_road = whole
        if beyond.size and beyond[0] + 1 < len(whole):
            on_road = first_samples(whole, beyond[0] + 1)
        begin = float(whole.x[0])
        last_x = on_road.x[-1]
        last_y = on_road.y[-1]
        step = last_x - on_road.x[-2] if len(on_road) > 1 else 0.0
        furthest = on_road.x.max()
        # whether a sample, or the one after the last at the same step, is at or past the road's end
        finished = max(furthest, last_x + step) >= road.length - SAME_PLACE
        stopped = on_road.speed[-1] < settings.stop_speed
        # whether the vehicle's centre is beside the road at the last sample
        is_beside = not road.right_edge_at(last_x) <= last_y <= road.left_edge_at(last_x)
        # a vehicle that rolled back and stands has driven as far as it stands
        end = road.length if finished else last_x if stopped else furthest
        reach = max(float(end - begin), 0.0)
        unfinished = not (finished or stopped)
        return cls(
            whole=whole,
            on_road=on_road,
            begin=begin,
            length=reach if stopped or is_beside else max(road.length - begin, 0.0),
            reach=reach,
            operations=count_operations(on_road, settings),
            most_operations=most_operations(on_road, settings),
            manoeuvre=manoeuvre_of(whole, road, settings.manoeuvre_time),
            still_driving=unfinished and not is_beside,
            left_the_road=unfinished and is_beside,
        )


def first_samples(drive: Trajectory, number: int) -> Trajectory:
    """A drive cut off after this number of samples."""
    channels = (getattr(drive, name)[:number] for name in CHANNELS)
    return Trajectory(*channels, length=drive.length, width=drive.width)


def slice_positions(start: float, length: float, spacing: float) -> FloatArray:
    """Eq. 11: x of the slices, (m,), m.

    start: x of the first slice, the ADS's start, m.
    length: distance from the first to the last slice, m: the lesser of the ADS's reach and the
        drivers' mean reach.
    spacing: between neighbouring slices, m, `slice_spacing` of the settings. The last two slices
        may be closer.
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
    places = np.asarray(positions, float)
    # index of the first sample at or past each position; the running maximum ignores rolling back
    after = np.searchsorted(np.maximum.accumulate(x), places)
    # samples on both sides of the crossing; where there is none, both are the first or the last
    left = np.maximum(after - 1, 0)
    right = np.minimum(after, x.size - 1)
    share = quotient(places - x[left], x[right] - x[left], left < right, 0.0)
    return y[left] + share * (y[right] - y[left])


def slice_points(
    slices: FloatArray, centre: FloatArray, road: Road, settings: AnthropomorphicSettings = DEFAULTS
) -> FloatArray:
    """Eq. 11: sample points, x and y of the ADS's centre and of three points on each side of it,
    0.5 m apart, (m, 7, 2), m.

    slices: x of the slices, (m,), m, from `slice_positions`.
    centre: y of the ADS at the slices, (m,), m, from `lateral_position`.
    road: its edges.
    settings: `side_width`, by default 1.5 m, and `points_per_side`, by default 3.

    Near an edge of the road, the points of this side divide the distance to the edge into equal
    parts. If the centre is beyond the edge, the points of this side coincide with it.
    """
    number = settings.points_per_side
    parts = np.arange(-number, number + 1) / number  # -1..1, from right to left
    # room for the points on each side, (m,), m
    right = np.clip(centre - road.right_edge_at(slices), 0.0, settings.side_width)
    left = np.clip(road.left_edge_at(slices) - centre, 0.0, settings.side_width)
    y = centre[:, None] + parts * np.where(parts < 0.0, right[:, None], left[:, None])
    return np.stack((np.broadcast_to(slices[:, None], y.shape), y), axis=-1)
