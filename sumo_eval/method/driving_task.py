"""The driving task of a case: departure from the road, and t_i, the share of the asked way that was
driven in time.

The asked way of a point is the distance along the road that every reference drove there, less its
last 5 m. References are the point's drivers and the reference car (docs/method.md). Departure and
t_i follow from recorded trajectories alone, so a run recorded earlier has them as well.

Users: `scoring/` (for every case), `drivers/`. Fixed: the values, from which T and S+ follow.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_eval.frozen import frozen
from sumo_eval.method.measures import STANDING
from sumo_eval.scenario.concrete import Road, Way
from sumo_eval.scenario.road.reference_line import frame_places, map_places
from sumo_eval.trajectory import (
    BoolArray,
    Collision,
    FloatArray,
    Trajectories,
    Trajectory,
    half_extents,
)

PLACE_SPACING = 1.0  # m between the places of the asked way at which times are compared
SHORT_OF_THE_END = 5.0
"""m by which the asked way ends before the shortest reference, because vehicles stop a few metres
apart."""
# A road user within all three limits excuses an ego that stands. Distances are between bodies.
EXCUSE_AHEAD = 10.0  # m, largest distance ahead of the ego
EXCUSE_BESIDE = 3.5  # m, largest distance to its side (the width of a lane)
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
    """The first sample of a drive with a corner more than `margin` beyond the drivable area; None
    without such a sample.

    ego: the drive, in road coordinates.
    road: of the scenario; roads that cross it are drivable as well.
    margin: width of a paved edge strip, m, `road_margin` of `[method.task]`.
    """
    # on a curve a body is a rectangle on the map alone
    pose = map_places(road.line, ego.x, ego.y, ego.heading)
    x, y, _ = frame_places(road.line, *_corners(*pose, ego), near=ego.x)
    away = np.flatnonzero(off_road(x, y, road, margin).any(axis=0))
    if not away.size:
        return None
    return Departure(float(ego.time[away[0]]), float(ego.speed[away[0]]))


def _corners(
    x: FloatArray, y: FloatArray, heading: FloatArray, ego: Trajectory
) -> tuple[FloatArray, FloatArray]:
    """x and y of the four corners of the ego's body at n poses, m, (4, n) each."""
    # of each corner, forward and to the left of the centre, m, (4, 1)
    along = 0.5 * ego.length * np.array([[1.0, 1.0, -1.0, -1.0]]).T
    aside = 0.5 * ego.width * np.array([[1.0, -1.0, 1.0, -1.0]]).T
    cosine = np.cos(heading)
    sine = np.sin(heading)
    return x + along * cosine - aside * sine, y + along * sine + aside * cosine


def off_road(x: FloatArray, y: FloatArray, road: Road, margin: float) -> BoolArray:
    """Whether points are more than `margin` beyond the road and beyond every road that crosses it,
    (...).

    x, y: of the points, in road coordinates, (...), m.
    margin: m.
    """
    beyond = (y < road.right_edge_at(x) - margin) | (y > road.left_edge_at(x) + margin)
    for crossing in road.crossings:
        inside = np.abs(x - crossing.at) <= 0.5 * crossing.width + margin
        beyond &= ~(inside & (np.abs(y) <= crossing.reach + margin))
    return beyond


def roadside_contact(departure: Departure, overlap: float) -> Collision:
    """A departure as a contact with a standing car, at the speed of the departure: U = |v| / w.

    departure: has the speed v, m/s.
    overlap: w, share of the bumper's width, `roadside_overlap` of `[method.task]`.
    """
    # a departure has no second vehicle, and U depends on no pose
    pose = (0.0, 0.0, 0.0)
    return Collision(
        departure.time, "roadside", (departure.speed, 0.0), (0.0, 0.0), overlap, "front", pose, pose
    )


def is_excused(ego: Trajectory, actors: Trajectories) -> bool:
    """Whether an ego stands at the end of its drive because of a road user.

    ego, actors: in road coordinates; actors by name.

    A road user excuses the ego if, at any time since the ego last moved, it was close ahead and
    hardly moved along the road (`EXCUSE_AHEAD`, `EXCUSE_BESIDE`, `EXCUSE_SPEED`).
    """
    if ego.speed[-1] >= STANDING:
        return False
    # time of the sample after the last one at which the ego moved
    since = ego.time[np.flatnonzero(ego.speed >= STANDING).max(initial=-1) + 1]
    # corners at the end, (4, 1) each
    x, y = _corners(ego.x[-1:], ego.y[-1:], ego.heading[-1:], ego)
    front = x.max()
    left = y.max()
    right = y.min()
    return any(_excuses(actor, since, front, left, right) for actor in actors.values())


def _excuses(actor: Trajectory, since: float, front: float, left: float, right: float) -> bool:
    """Whether a road user stood or crept close ahead of a standing ego at any sample.

    since: samples of the actor count from this time on, s.
    front: x of the front end of the ego's body, m.
    left, right: y of the left and right end of the ego's body, m.
    """
    long, wide = half_extents(actor.heading, actor.length, actor.width)

    ahead = (actor.x + long >= front) & (actor.x - long - front <= EXCUSE_AHEAD)
    to_the_left, to_the_right = actor.y - wide - left, right - actor.y - wide  # gaps, m
    beside = np.maximum(to_the_left, to_the_right) <= EXCUSE_BESIDE
    creeps = np.abs(actor.speed * np.cos(actor.heading)) <= EXCUSE_SPEED
    return bool((ahead & beside & creeps & (actor.time >= since)).any())


def times_at(drive: Trajectory, places: FloatArray) -> FloatArray:
    """Times at which a drive first reached places, (n,), s since its start; inf for a place that it
    never reached.

    places: x, (n,), m, ascending.
    """
    furthest = np.maximum.accumulate(drive.x)
    rises = furthest[1:] > furthest[:-1]
    # During a stop all samples have one furthest x. Of these only the first and the last are used,
    # the last with a slightly larger x. So the next place is interpolated from the end of the stop.
    arrives, leaves = np.append(True, rises), np.append(rises, False)
    x = np.where(arrives, furthest, np.nextafter(furthest, np.inf))
    ends = arrives | leaves
    return np.asarray(np.interp(places, x[ends], drive.time[ends] - drive.time[0], right=np.inf))


class AskedWay(NamedTuple):
    """The distance along the road that an ADS has to drive at a point, and the time for it.

    places: x, `PLACE_SPACING` apart, (n,), m.
    slowest: time at which the slowest reference reached each place, (n,), s since its start.
    """

    places: FloatArray
    slowest: FloatArray


def clean_references(drives: Iterable[Trajectory], road: Road, margin: float) -> list[Trajectory]:
    """Those of the drives that have no departure from the road.

    drives: of references, without contact, in road coordinates.
    margin: m, `road_margin` of `[method.task]`.
    """
    return [drive for drive in drives if first_departure(drive, road, margin) is None]


def asked_way(begin: float, references: Sequence[Trajectory]) -> AskedWay | None:
    """The asked way of a point: from the ego's start, or the first start of a reference ahead of
    it, to `SHORT_OF_THE_END` before the end of the shortest reference; None without a reference.

    begin: x of the ego's start, m.
    references: drives of those references at the point that had no incident, in road coordinates,
        from `clean_references`.
    """
    if not references:
        return None
    end = min(drive.x.max() for drive in references) - SHORT_OF_THE_END
    # 1e-9 m is rounding: a place at the end itself counts
    places = np.arange(begin + PLACE_SPACING, end + 1e-9, PLACE_SPACING)
    slowest = np.max([times_at(drive, places) for drive in references], axis=0)
    timed = slowest > 0.0  # no reference has a time at a place behind the start of all of them
    return AskedWay(places[timed], slowest[timed])


def task_share(
    ego: Trajectory, asked: AskedWay, lane_change: Way | None, *, incident: bool, excused: bool
) -> float:
    """t_i: mean over the asked way of min(1, time of the slowest reference there / own time there).

    ego: the drive, in road coordinates.
    asked: the places, with the references' times.
    lane_change: lane change or exit that the point asks for; None without one.
    incident: whether the ego had a contact, departed or gave up; then t_i = 0.
    excused: whether the ego stands because of a road user; then the asked way ends where it stands.

    A place counts 0 if it was never reached, or if it is beyond the end of a lane change that the
    ego missed. t_i is 1 if the asked way has no place.
    """
    if incident:
        return 0.0
    counted = asked.places <= (ego.x.max() if excused else np.inf)
    own = times_at(ego, asked.places)
    shares = np.minimum(1.0, asked.slowest / np.maximum(own, 1e-9))  # no division by 0 s
    if lane_change is not None and misses(ego, lane_change):
        shares = np.where(asked.places > lane_change.by, 0.0, shares)
    return float(shares[counted].mean()) if counted.any() else 1.0


def misses(ego: Trajectory, lane_change: Way) -> bool:
    """Whether the ego missed a lane change: at the end of the change its y is more than half the
    offset away from the target, to either side. False if it never got there.
    """
    at_end = times_at(ego, np.array([lane_change.by]))[0]
    if np.isinf(at_end):
        return False
    y = float(np.interp(at_end + ego.time[0], ego.time, ego.y))
    return abs(y - float(ego.y[0]) - lane_change.offset) > 0.5 * abs(lane_change.offset)
