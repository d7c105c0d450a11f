"""One recorded drive beside the drivers at its point: what stands out, when, and by how much.

`report.driving_words` makes sentences and a picture of it, `report.explain` takes D_i from here.
"""

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Literal, NamedTuple, Self

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.method.anthropomorphic import AnthropomorphicIndex
from sumo_eval.method.compared_drives import first_samples
from sumo_eval.method.driving_task import asked_way, first_departure, misses, times_at
from sumo_eval.method.measures import STANDING, course_of
from sumo_eval.method.plausibility import Quantiles, extremes_of, least_plausible
from sumo_eval.record.human_reference import PointJob, compute_points
from sumo_eval.record.kept_results import KeptResults
from sumo_eval.record.store import EGO, Fact, Store
from sumo_eval.results import Evaluation
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.trajectory import FloatArray, Trajectories, Trajectory

LOW = 0.99
"""A t_i, or a factor of a case's part in H, is explained where it is lower."""
BRAKES = -1.0
"""Acceleration at or below which a vehicle counts as braking, m/s2."""
SIDEWAYS = 0.5
"""Least distance from its first y at which a vehicle counts as moved sideways, m."""
HALF_WINDOWS = {
    "max_deceleration": 0.5, "max_jerk": 1.0, "max_unrest": 1.0, "max_lateral_speed": 0.5,
    "max_lateral_acceleration": 1.0
}  # fmt: skip
"""Half of the time window that an extreme is measured over, s; 0 for extremes not named here."""
LEAST_SPREADS = {"speed": 1.0, "y": 0.2}
"""Standard deviation of speed, m/s, and y, m, used where the drivers' is less."""


class CaseDrives(NamedTuple):
    """Drive of a case, with all drives that it is compared with at its point.

    road: the drives are in its coordinates.
    drivers: drives of the human drivers.
    references: by name, the drives of the drivers and of the reference car (`task_reference`).
    """

    case: CaseResult
    ego: Trajectory
    actors: Trajectories
    road: Road
    drivers: tuple[Trajectory, ...]
    references: Trajectories

    @classmethod
    def of(cls, case: CaseResult, fact: Fact, store: Store, road: Road) -> Self:
        """The drives as they were recorded."""
        vehicles = store.trajectories(case.case)
        drives = store.driven_at(case.scenario, fact.point, "human", "task_reference")
        references = {fact.driver: store.trajectory(fact.case) for fact in drives}
        humans = tuple(references[fact.driver] for fact in drives if fact.role == "human")
        return cls(case, vehicles.pop(EGO), vehicles, road, humans, references)


def index_again(
    evaluation: Evaluation, fact: Fact, road: Road, store: Store
) -> AnthropomorphicIndex:
    """D_i of one case, computed again from its trajectory and the drivers' at its point."""
    drives = store.driven_at(fact.scenario, fact.point, "human")
    job = PointJob(tuple(fact.case for fact in drives), road, (fact.case,))
    settings = evaluation.settings.method.anthropomorphic
    with closing(KeptResults(evaluation.folder)) as cache:
        results = compute_points(store.path, [job], settings, map, lambda done: None, cache)
    return results.indexes[fact.case]


class ObservedBraking(NamedTuple):
    """Time at which an ego began to brake, s, and its strongest deceleration, m/s2."""

    first: float
    hardest: float


def braking_before(
    ego: Trajectory, contact: float, commanded: float | None
) -> ObservedBraking | None:
    """The ego's braking up to a time, s since its start; None without any.

    commanded: when it began, s, by the recorded commands; None: they do not say, samples do.
    """
    since = ego.time - ego.time[0]
    felt = ego.acceleration[since <= contact]
    brakes = since[: len(felt)][felt <= BRAKES]
    if commanded is None and not len(brakes):
        return None
    first = brakes[0] if commanded is None else commanded
    return ObservedBraking(float(first), -float(felt.min()))


class Behind(NamedTuple):
    """Place at which a drive fell furthest behind the slowest reference.

    what: `missed`: a lane change due there was missed. `stood`: the ego stood there. `short`: it
        came no further. `late`: it was late there.
    way: distance of the place from the ego's start, m.
    time: at which the ego was there, s since its start.
    target: for `stood` and `short` the distance that was asked for, m; for `late` the time of the
        slowest reference there, s; nan for `missed`.
    drivers: number of drivers among the references.
    car: whether the reference car is one of these.
    """

    what: Literal["missed", "stood", "short", "late"]
    way: float
    time: float
    target: float
    drivers: int
    car: bool


def behind(scene: CaseDrives, logical: LogicalScenario, margin: float) -> Behind | None:
    """Place at which a drive fell furthest behind; None if it lost little of its t_i, or had an
    incident.

    margin: `road_margin`, m; a drive that departs from the road does not count as a reference.
    """
    share, ego = scene.case.task_share, scene.ego
    if share is None or share >= LOW or scene.case.incident:
        return None
    start = logical.placed(scene.case.values).ego
    clean = [
        trajectory
        for trajectory in scene.references.values()
        if first_departure(trajectory, logical.road, margin) is None
    ]
    asked = asked_way(start.x, clean)
    if not asked:
        return None
    # t_i of an excused case leaves out the places that the ego did not reach
    counted = asked.places <= (ego.x.max() if scene.case.excused else np.inf)
    places, slowest = asked.places[counted], asked.slowest[counted]
    if not places.size:
        return None
    drivers = sum(trajectory in scene.drivers for trajectory in clean)
    references = drivers, len(clean) > drivers
    if start.way is not None and misses(ego, start.way):
        when = float(times_at(ego, np.array([start.way.by]))[0])
        return Behind("missed", start.way.by - start.x, when, np.nan, *references)
    own = times_at(ego, places)
    if np.isinf(own[-1]):  # it never came to the last place
        last = int(np.argmax(ego.x))
        way, when = max(float(ego.x[last]) - start.x, 0.0), float(ego.time[last] - ego.time[0])
        return Behind(
            "stood" if ego.speed[-1] < STANDING else "short",
            way,
            when,
            float(places[-1]) - start.x,
            *references,
        )
    worst = int(np.argmax(own - slowest))
    way, when, target = (float(part[worst]) for part in (places - start.x, own, slowest))
    return Behind("late", way, when, target, *references)


class Event(NamedTuple):
    """Move of an actor, and when it began, s."""

    time: float
    actor: str
    what: str


class Extreme(NamedTuple):
    """The extreme of a drive that fewest people reach.

    share: of people who go as far.
    usual: the people's median.
    time: s, when it was first reached, the middle of its window.
    event: the move of an actor that is nearest in time, if any.
    """

    name: str
    value: float
    share: float
    usual: float
    time: float
    event: Event | None


def rarest_extreme(scene: CaseDrives, people: Quantiles) -> Extreme:
    """The extreme of a drive that fewest people reach."""
    extremes = extremes_of(course_of(scene.ego, scene.actors, None, scene.road))
    name, share = least_plausible(extremes, people)
    value, half = extremes[name], HALF_WINDOWS.get(name, 0.0)
    when = max(0.0, _reached(scene, name, value) - half)
    near = min(_events(scene), key=lambda event: abs(event.time - when), default=None)
    # the last level of the table is the median
    return Extreme(name, value, share, people.values[name][-1], when, near)


def _reached(scene: CaseDrives, name: str, value: float) -> float:
    """Time at which a drive first reached an extreme, s."""
    ego = scene.ego

    def has(samples: int) -> bool:
        """Whether the first `samples` samples reach the extreme; if they do, more do."""
        part = course_of(first_samples(ego, samples), scene.actors, None, scene.road)
        return bool(np.isclose(extremes_of(part)[name], value, rtol=1e-6))

    least = bisect_left(range(len(ego.time)), True, lo=1, key=has)
    return float(ego.time[least - 1] - ego.time[0])


def _events(scene: CaseDrives) -> Iterator[Event]:
    """When each actor first braked, and first moved sideways."""
    for name, actor in scene.actors.items():
        brakes = actor.acceleration <= BRAKES
        moves = np.abs(actor.y - actor.y[0]) >= SIDEWAYS
        for done, what in ((brakes, "braked"), (moves, "moved over")):
            if done.any():
                yield Event(float(actor.time[np.argmax(done)] - actor.time[0]), name, what)


class Furthest(NamedTuple):
    """The place at which a quantity of the ADS deviates most from the drivers' mean.

    deviations: from the drivers' mean, in their standard deviations.
    time: of the ego there, s.
    own, least, mean, most: the quantity of the ADS and of the drivers there.
    """

    deviations: float
    channel: Literal["speed", "y"]
    time: float
    own: float
    least: float
    mean: float
    most: float


def furthest(scene: CaseDrives) -> Furthest:
    """Where speed or y deviates most from the drivers' mean, in their standard deviations."""
    ego = scene.ego
    end = min(float(trajectory.x.max()) for trajectory in (ego, *scene.drivers))
    # every metre, at least the first place
    places = np.arange(float(ego.x[0]), max(end, float(ego.x[0]) + 1.0))
    speed, y = _furthest(scene, places, "speed"), _furthest(scene, places, "y")
    return speed if speed.deviations > y.deviations else y


def _furthest(scene: CaseDrives, places: FloatArray, channel: Literal["speed", "y"]) -> Furthest:
    """Where `channel` differs most, among places x, (n,), m."""
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
    """A channel of a drive at places x, (n,)."""
    reached = np.maximum.accumulate(drive.x)
    return np.asarray(np.interp(places, reached, getattr(drive, channel)))


def mean_path(*drives: Trajectory) -> float:
    """Mean length of the paths of drives, m."""
    return float(np.mean([np.hypot(np.diff(it.x), np.diff(it.y)).sum() for it in drives]))


def mean_speed(drives: Sequence[Trajectory], times: FloatArray) -> FloatArray:
    """Mean speed of drives at times since their start, m/s; nan after the first of them ends."""
    speeds = [np.interp(times, drive.time - drive.time[0], drive.speed) for drive in drives]
    last = min(drive.duration for drive in drives)
    # 1e-9 s is rounding
    return np.where(times <= last + 1e-9, np.mean(speeds, axis=0), np.nan)
