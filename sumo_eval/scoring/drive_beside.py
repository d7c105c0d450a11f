"""One recorded drive compared with the drivers at its point: what differs, when, and by how much.

`report/driving_words.py` makes sentences and a picture of it, `report/explain.py` takes D_i from
here.

Users: `report/`.
"""

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Literal, NamedTuple, Self

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.method.anthropomorphic import AnthropomorphicIndex
from sumo_eval.method.compared_drives import first_samples
from sumo_eval.method.driving_task import asked_way, clean_references, misses, times_at
from sumo_eval.method.measures import STANDING, course_of
from sumo_eval.method.plausibility import Quantiles, extremes_of, least_plausible
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.human_reference import PointJob, compute_point
from sumo_eval.record.store import EGO, Store
from sumo_eval.results import Evaluation
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.trajectory import FloatArray, Trajectories, Trajectory

LOW = 0.99
"""A t_i, or a factor of a case's part in H, is explained if it is lower than this."""
BRAKES = -1.0
"""m/s2; a vehicle with this acceleration or less counts as braking."""
SIDEWAYS = 0.5
"""m; a vehicle this far from its first y counts as moved sideways."""
HALF_WINDOWS = {
    "max_deceleration": 0.5, "max_jerk": 1.0, "max_unrest": 1.3, "max_lateral_speed": 0.5,
    "max_lateral_acceleration": 1.0
}  # fmt: skip
"""Extreme -> half of the time window over which it is measured, s; 0 for other extremes."""
LEAST_SPREADS = {"speed": 1.0, "y": 0.2}
"""Standard deviation of speed, m/s, and y, m, used where the drivers' is less."""


class CaseDrives(NamedTuple):
    """Drive of a case, and all drives that it is compared with at its point.

    ego: trajectory of the ego.
    actors: trajectories of the other vehicles by name.
    road: in whose coordinates all trajectories are.
    drivers: trajectories of the human drivers.
    references: trajectories of the drivers and of the reference car (`task_reference`) by name.
    """

    case: CaseResult
    ego: Trajectory
    actors: Trajectories
    road: Road
    drivers: tuple[Trajectory, ...]
    references: Trajectories

    @classmethod
    def of(cls, case: CaseResult, fact: Fact, store: Store, road: Road) -> Self:
        """The drives of a case as they were recorded.

        fact: of the case.
        """
        vehicles = store.trajectories(case.case)
        drives = store.driven_at(case.scenario, fact.point, "human", "task_reference")
        references = {fact.driver: store.trajectory(fact.case) for fact in drives}
        humans = tuple(references[fact.driver] for fact in drives if fact.role == "human")
        return cls(case, vehicles.pop(EGO), vehicles, road, humans, references)


def index_again(
    evaluation: Evaluation, fact: Fact, road: Road, store: Store
) -> AnthropomorphicIndex:
    """D_i of one case, computed again from the trajectories of the case and of the drivers at its
    point, and not taken from the cache.
    """
    drives = store.driven_at(fact.scenario, fact.point, "human")
    job = PointJob(tuple(it.case for it in drives), road, ads=(fact.case,))
    settings = evaluation.settings.method.anthropomorphic
    ((_, index),) = compute_point(job, job.names, store, settings)
    assert isinstance(index, AnthropomorphicIndex), "the job asks for D_i alone"
    return index


class ObservedBraking(NamedTuple):
    """The braking of an ego.

    first: time at which it began, s since the start.
    hardest: strongest deceleration, m/s2; 0 if the ego only kept its speed or sped up.
    """

    first: float
    hardest: float


def braking_before(
    ego: Trajectory, contact: float, commanded: float | None
) -> ObservedBraking | None:
    """The ego's braking before a contact; None without any.

    contact: time of the contact, s since the start.
    commanded: when braking began by the recorded commands, s; None: it is not recorded, and the
        samples show it.
    """
    time = ego.time - ego.time[0]
    acceleration = ego.acceleration[time <= contact]
    braking_times = time[: len(acceleration)][acceleration <= BRAKES]
    if commanded is None and not len(braking_times):
        return None
    first = braking_times[0] if commanded is None else commanded
    return ObservedBraking(float(first), max(0.0, -float(acceleration.min())))


class Behind(NamedTuple):
    """Place at which a drive fell furthest behind the slowest reference.

    what: `missed`: a lane change due there was missed. `stood`: the ego stood there at the end.
        `short`: the ego came no further. `late`: the ego was late there.
    way: distance of the place from the ego's start, m.
    time: when the ego was there, s since its start.
    asked: length of the asked way, m.
    drivers: number of drivers among the references.
    car: whether the reference car is one of the references.
    slowest: time of the slowest reference at the place, s; nan unless `late`.
    """

    what: Literal["missed", "stood", "short", "late"]
    way: float
    time: float
    asked: float
    drivers: int
    car: bool
    slowest: float = math.nan


def behind(scene: CaseDrives, logical: LogicalScenario, margin: float) -> Behind | None:
    """Place at which a drive fell furthest behind the slowest reference; None if its t_i is unknown
    or at least `LOW`, if the case has an incident, or if the asked way has no place.

    scene: the drive with its references.
    margin: `road_margin`, m; a drive that departs from the road does not count as a reference.
    """
    share, ego = scene.case.task_share, scene.ego
    if share is None or share >= LOW or scene.case.incident:
        return None
    start = logical.placed(scene.case.values).ego
    clean = clean_references(scene.references.values(), logical.road, margin)
    asked = asked_way(start.x, clean)
    if not asked:
        return None
    # in an excused case the places that the ego did not reach do not count, as in `task_share`
    counted = asked.places <= (ego.x.max() if scene.case.excused else np.inf)
    places, slowest = asked.places[counted], asked.slowest[counted]
    if not places.size:
        return None
    # `in` compares by identity, as trajectories have no `==` of their own
    drivers = sum(trajectory in scene.drivers for trajectory in clean)
    length = float(places[-1]) - start.x
    make = partial(Behind, asked=length, drivers=drivers, car=len(clean) > drivers)
    if start.way is not None and misses(ego, start.way):
        (when,) = times_at(ego, np.array([start.way.by])).tolist()
        return make("missed", start.way.by - start.x, when)
    own = times_at(ego, places)
    if np.isinf(own[-1]):  # the ego never reached the last place
        last = int(np.argmax(ego.x))
        way, when = max(float(ego.x[last]) - start.x, 0.0), float(ego.time[last] - ego.time[0])
        return make("stood" if ego.speed[-1] < STANDING else "short", way, when)
    worst = int(np.argmax(own - slowest))
    way, when = float(places[worst]) - start.x, float(own[worst])
    return make("late", way, when, slowest=float(slowest[worst]))


class Event(NamedTuple):
    """Move of an actor.

    time: when it began, s since the actor's first sample.
    actor: its name.
    what: in words.
    """

    time: float
    actor: str
    what: str


class Extreme(NamedTuple):
    """The extreme of a drive that fewest people reach.

    name: as in `plausibility.EXTREMES`.
    value: of the drive, in the extreme's unit.
    share: share of people at least as extreme, 0..1.
    usual: the people's median.
    time: when the drive first reached it, the middle of its window, s.
    event: the move of an actor that is nearest in time, if any.
    """

    name: str
    value: float
    share: float
    usual: float
    time: float
    event: Event | None


def rarest_extreme(scene: CaseDrives, people: Quantiles) -> Extreme:
    """The extreme of a drive that fewest people reach.

    people: the table to compare with.
    """
    extremes = extremes_of(course_of(scene.ego, scene.actors, None, scene.road))
    name, share = least_plausible(extremes, people)
    value, half = extremes[name], HALF_WINDOWS.get(name, 0.0)
    when = max(0.0, _reached(scene, name, value) - half)
    near = min(_events(scene), key=lambda event: abs(event.time - when), default=None)
    # [-1]: the last level of the table is the median
    return Extreme(name, value, share, people.values[name][-1], when, near)


def _reached(scene: CaseDrives, name: str, value: float) -> float:
    """Time at which a drive first reached an extreme, s."""
    ego = scene.ego

    def has(samples: int) -> bool:
        """Whether the first samples reach the extreme. More samples then reach it too, so bisection
        finds the least number.
        """
        part = course_of(first_samples(ego, samples), scene.actors, None, scene.road)
        # sums over fewer samples differ in the last digits
        return bool(np.isclose(extremes_of(part)[name], value, rtol=1e-6))

    least = bisect_left(range(len(ego.time)), True, lo=1, key=has)
    return float(ego.time[least - 1] - ego.time[0])


def _events(scene: CaseDrives) -> Iterator[Event]:
    """When each actor first braked, and first moved sideways."""
    for name, actor in scene.actors.items():
        brakes = actor.acceleration <= BRAKES
        is_aside = np.abs(actor.y - actor.y[0]) >= SIDEWAYS
        for flags, what in ((brakes, "braked"), (is_aside, "moved over")):
            if flags.any():
                yield Event(float(actor.time[np.argmax(flags)] - actor.time[0]), name, what)


class Furthest(NamedTuple):
    """The place at which speed or y of the ADS deviates most from the drivers' mean.

    deviations: difference from the mean, in standard deviations of the drivers.
    channel: the quantity.
    time: when the ego was there, s since its start.
    own: value of the ADS there, m/s or m.
    least, mean, most: values of the drivers there, m/s or m.
    """

    deviations: float
    channel: Literal["speed", "y"]
    time: float
    own: float
    least: float
    mean: float
    most: float


def furthest(scene: CaseDrives) -> Furthest:
    """The place at which speed or y of the ADS deviates most from the drivers' mean."""
    ego = scene.ego
    end = min(float(trajectory.x.max()) for trajectory in (ego, *scene.drivers))
    # every metre up to where the shortest drive ended, at least the first place
    places = np.arange(float(ego.x[0]), max(end, float(ego.x[0]) + 1.0))
    speed, y = _furthest(scene, places, "speed"), _furthest(scene, places, "y")
    return speed if speed.deviations > y.deviations else y


def _furthest(scene: CaseDrives, places: FloatArray, channel: Literal["speed", "y"]) -> Furthest:
    """The place at which one channel deviates most.

    places: x, (n,), m.
    """
    ads = _at_places(scene.ego, places, channel)
    drivers = np.array([_at_places(driver, places, channel) for driver in scene.drivers])
    spread = np.maximum(drivers.std(axis=0, ddof=1), LEAST_SPREADS[channel])
    away = np.abs(ads - drivers.mean(axis=0)) / spread
    worst = int(np.argmax(away))
    (when,) = times_at(scene.ego, places[worst : worst + 1])
    there = drivers[:, worst]
    values = ads[worst], there.min(), there.mean(), there.max()
    return Furthest(float(away[worst]), channel, float(when), *map(float, values))


def _at_places(drive: Trajectory, places: FloatArray, channel: str) -> FloatArray:
    """The values of a channel of a drive at places, (n,).

    places: x, m, (n,).
    """
    reached = np.maximum.accumulate(drive.x)
    return np.asarray(np.interp(places, reached, getattr(drive, channel)))


def mean_path(*drives: Trajectory) -> float:
    """Mean length of the paths of drives, m."""
    return float(np.mean([np.hypot(np.diff(it.x), np.diff(it.y)).sum() for it in drives]))


def mean_speed(drives: Sequence[Trajectory], times: FloatArray) -> FloatArray:
    """Mean speed of drives, m/s, (n,); nan after the first of them ends.

    times: since the start of each, (n,), s.
    """
    speeds = [np.interp(times, drive.time - drive.time[0], drive.speed) for drive in drives]
    last = min(drive.duration for drive in drives)
    # 1e-9 s is rounding
    return np.where(times <= last + 1e-9, np.mean(speeds, axis=0), np.nan)
