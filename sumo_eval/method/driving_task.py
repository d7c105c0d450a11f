"""The driving task of a case: departure from the road, and t_i, the share of the asked way that was
driven in time.

Both follow from recorded trajectories, so a run recorded earlier has them as well.

Users: `scoring/` (for every case), `drivers/`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.frozen import frozen
from sumo_eval.method.measures import STANDING
from sumo_eval.scenario.concrete import Road, Way
from sumo_eval.trajectory import (
    BoolArray,
    Collision,
    FloatArray,
    Trajectories,
    Trajectory,
    half_extents,
)

PLACE_SPACING = 1.0  # m between the places of a way at which times are compared
SHORT_OF_THE_END = 5.0
"""m by which the asked way ends before the shortest reference: vehicles stop a few metres apart."""
# a road user within all three limits excuses an ego that stands; distances are between bodies
EXCUSE_AHEAD = 10.0  # m, largest distance ahead of the ego
EXCUSE_BESIDE = 3.5  # m, largest distance to its side (a lane)
EXCUSE_SPEED = 1.0  # m/s, largest speed along the road


@frozen
class Departure:
    """First recorded sample at which a corner of the ego's body is off the road.

    time: s.
    speed: m/s.
    """

    time: float
    speed: float


def first_departure(ego: Trajectory, road: Road, margin: float) -> Departure | None:
    """The departure of a drive, with a corner more than `margin` beyond the drivable area; None
    without one.

    ego: the drive, in road coordinates.
    road: a road that crosses it is drivable as well.
    margin: `road_margin`, width of a paved edge strip, m.
    """
    away = np.flatnonzero(off_road(*_corners(ego), road, margin).any(axis=0))
    if not away.size:
        return None
    return Departure(float(ego.time[away[0]]), float(ego.speed[away[0]]))


def _corners(ego: Trajectory) -> tuple[FloatArray, FloatArray]:
    """x and y of the body's four corners, m, (4, n) each."""
    along = 0.5 * ego.length * np.array([[1.0, 1.0, -1.0, -1.0]]).T
    aside = 0.5 * ego.width * np.array([[1.0, -1.0, 1.0, -1.0]]).T
    cosine = np.cos(ego.heading)
    sine = np.sin(ego.heading)
    return ego.x + along * cosine - aside * sine, ego.y + along * sine + aside * cosine


def off_road(x: FloatArray, y: FloatArray, road: Road, margin: float) -> BoolArray:
    """Whether places (...) are more than `margin` m beyond the road and every road that crosses
    it.
    """
    beyond = (y < road.right_edge_at(x) - margin) | (y > road.left_edge_at(x) + margin)
    for crossing in road.crossings:
        inside = np.abs(x - crossing.at) <= 0.5 * crossing.width + margin
        beyond &= ~(inside & (np.abs(y) <= crossing.reach + margin))
    return beyond


def roadside_contact(departure: Departure, overlap: float) -> Collision:
    """A departure as a contact: U = |v| / w with a standing car, at the speed of the departure.

    departure: its v, m/s.
    overlap: `roadside_overlap` w, share of the bumper's width.
    """
    pose = (0.0, 0.0, 0.0)
    return Collision(
        departure.time, "roadside", (departure.speed, 0.0), (0.0, 0.0), overlap, "front", pose, pose
    )


def is_excused(ego: Trajectory, actors: Trajectories) -> bool:
    """Whether an ego stands at the end of its drive because of a road user.

    That is so if, at any time since the ego last moved, a road user was close ahead and hardly
    moved along the road (`EXCUSE_AHEAD`, `EXCUSE_BESIDE`, `EXCUSE_SPEED`).
    """
    if ego.speed[-1] >= STANDING:
        return False
    # time of the sample after the last one at which it moved
    since = ego.time[np.flatnonzero(ego.speed >= STANDING).max(initial=-1) + 1]
    x, y = (corners[:, -1] for corners in _corners(ego))
    front = x.max()
    left = y.max()
    right = y.min()
    return any(_excuses(actor, since, front, left, right) for actor in actors.values())


def _excuses(actor: Trajectory, since: float, front: float, left: float, right: float) -> bool:
    """Whether a road user stood or crept close ahead at any sample from `since` s on.

    front, left, right: x and y of the ends of the ego's body, m.
    """
    long, wide = half_extents(actor.heading, actor.length, actor.width)

    ahead = (actor.x + long >= front) & (actor.x - long - front <= EXCUSE_AHEAD)
    to_the_left, to_the_right = actor.y - wide - left, right - actor.y - wide  # gaps, m
    beside = np.maximum(to_the_left, to_the_right) <= EXCUSE_BESIDE
    creeps = np.abs(actor.speed * np.cos(actor.heading)) <= EXCUSE_SPEED
    return bool((ahead & beside & creeps & (actor.time >= since)).any())


def times_at(drive: Trajectory, places: FloatArray) -> FloatArray:
    """Times at which a drive first reached places x (n,), m, ascending: s since its start, inf for
    a place never reached.
    """
    furthest = np.maximum.accumulate(drive.x)
    rises = furthest[1:] > furthest[:-1]
    # of a stop (samples at one furthest x) only the first and the last are used, the last a hair
    # further: so the next place is interpolated from the end of the stop, not from its beginning
    arrives, leaves = np.append(True, rises), np.append(rises, False)
    x = np.where(arrives, furthest, np.nextafter(furthest, np.inf))
    ends = arrives | leaves
    return np.asarray(np.interp(places, x[ends], drive.time[ends] - drive.time[0], right=np.inf))


class AskedWay(NamedTuple):
    """The distance along the road that an ADS has to drive at a point, and the time for it.

    places: x along it, (n,), m.
    slowest: time until the slowest reference reached each place, (n,), s.
    """

    places: FloatArray
    slowest: FloatArray


def asked_way(begin: float, references: Sequence[Trajectory]) -> AskedWay | None:
    """The asked way of a point: from the ego's start to `SHORT_OF_THE_END` before the end of the
    shortest reference; None without a reference.

    begin: x of the ego's start, m.
    references: drives of the references that had no incident.
    """
    if not references:
        return None
    end = min(drive.x.max() for drive in references) - SHORT_OF_THE_END
    places = np.arange(begin + PLACE_SPACING, end + 1e-9, PLACE_SPACING)
    return AskedWay(places, np.max([times_at(drive, places) for drive in references], axis=0))


def task_share(
    ego: Trajectory, asked: AskedWay, lane_change: Way | None, *, incident: bool, excused: bool
) -> float:
    """t_i: mean over the asked way of min(1, time of the slowest reference there / own time there).

    ego: the drive, in road coordinates.
    asked: the places, with the references' times.
    lane_change: that the point asks for; None without one.
    incident: any contact, departure or giving up: t_i = 0.
    excused: the asked way ends where the ego stands.

    A place counts 0 if it was never reached, or if it is beyond the end of a lane change that the
    ego missed. t_i is 1 where no place counts.
    """
    if incident:
        return 0.0
    counted = asked.places <= (ego.x.max() if excused else np.inf)
    own = times_at(ego, asked.places)
    shares = np.minimum(1.0, asked.slowest / np.maximum(own, 1e-9))

    if lane_change is not None and misses(ego, lane_change):
        shares = np.where(asked.places > lane_change.by, 0.0, shares)
    return float(shares[counted].mean()) if counted.any() else 1.0


def misses(ego: Trajectory, lane_change: Way) -> bool:
    """Whether the ego passed the end of its lane change more than half the offset away from the
    target, on either side of it.
    """
    at_end = times_at(ego, np.array([lane_change.by]))[0]
    if np.isinf(at_end):
        return False
    y = float(np.interp(at_end + ego.time[0], ego.time, ego.y))
    return abs(y - float(ego.y[0]) - lane_change.offset) > 0.5 * abs(lane_change.offset)
