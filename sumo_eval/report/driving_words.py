"""One case in driving words: which quantity, compared with which drivers, at what time; and a
picture.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.method.driving_task import asked_way, first_departure, misses, times_at
from sumo_eval.method.measures import STANDING
from sumo_eval.method.plausibility import Quantiles, extremes_of, least_plausible
from sumo_eval.record.store import EGO, Fact, Store
from sumo_eval.report.words import cause_words, count, percent
from sumo_eval.results import Evaluation
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.findings import LIKENESS_FACTORS
from sumo_eval.scoring.plausible_people import plausible_people
from sumo_eval.trajectory import FloatArray, Trajectory

LOW = 0.99
"""A case's part in T, or a factor of its part in H, below this is explained."""
BRAKES = -1.0
"""Acceleration from which a vehicle counts as braking, m/s2."""
SIDEWAYS = 0.5
"""Way from its first y after which a vehicle counts as moving sideways, m."""
EXTREME_WORDS = {
    "min_ttc": ("came within {} of a collision", "{:z.1f} s", 0.0),
    "min_thw": ("followed at a headway of {}", "{:z.2f} s", 0.0),
    "max_deceleration": ("braked at {}", "{:z.1f} m/s2", 0.5),
    "max_jerk": ("changed its acceleration by {}", "{:z.1f} m/s3", 1.0),
    "max_unrest": ("sped up and slowed down by {} within 2 s", "{:z.1f} m/s2", 1.0),
    "max_lateral_speed": ("moved sideways at {}", "{:z.1f} m/s", 0.5),
    "max_lateral_acceleration": ("accelerated sideways at {}", "{:z.1f} m/s2", 1.0),
}
"""Words of an extreme, its value in its unit, and half of the window that it is measured over,
s."""
BLOCKS = "▁▂▃▄▅▆▇█"
PICTURE = 60
"""Characters of a picture of speed over time."""


@dataclass(frozen=True, slots=True, eq=False)
class CaseDrives:
    """One case with all that drove at its point.

    beside: drives of drivers and of the reference car, by name.
    """

    case: CaseResult
    ego: Trajectory
    actors: Mapping[str, Trajectory]
    drivers: tuple[Trajectory, ...]
    beside: Mapping[str, Trajectory]


def driving_words(
    evaluation: Evaluation, case: CaseResult, fact: Fact, logical: LogicalScenario, store: Store
) -> list[str]:
    """Sentences on one case, the gravest first, and a picture of its speed beside that of the
    drivers.
    """
    if store.is_discarded(case.case) or not (case.evaluated or case.departed):
        return ["The ADS gave the case up, which counts as doing nothing."] if case.gave_up else []
    scene = _scene(case, fact, store)
    margin = evaluation.settings.method.task.road_margin
    said = [*_incident(scene, fact), *task_words(scene, logical, margin)]

    if case.zone == "safe" and not case.incident:
        people = plausible_people(logical, store, evaluation.settings.method.plausibility).people
        said += likeness_words(scene, people)
    calm = (
        "It drove as the drivers did, without harm."
        if scene.drivers
        else "It had no contact and stayed on the road."
    )
    sentences = [words for words, _ in said] or [calm]
    moment = said[0][1] if said else None
    command = (
        f"sumo-eval replay {shlex.quote(str(evaluation.folder))} {shlex.quote(case.case)} --open"
    )
    return [*sentences, *picture(scene, moment), f"See it: {command}"]


def _scene(case: CaseResult, fact: Fact, store: Store) -> CaseDrives:
    vehicles = store.trajectories(case.case)
    drives = store.driven_at(case.scenario, fact.point, "human", "task_reference")
    beside = {one.driver: store.trajectory(one.case) for one in drives}
    humans = tuple(beside[one.driver] for one in drives if one.role == "human")
    return CaseDrives(case, vehicles.pop(EGO), vehicles, humans, beside)


_Said = Iterator[tuple[str, float]]
"""A sentence, and the time that it is about, s since the start of the drive."""


def _incident(scene: CaseDrives, fact: Fact) -> _Said:
    """Contact, departure, or an end that the harness brought, and what the ADS did before."""
    case, hit = scene.case, fact.collision
    if hit is not None:
        best = "a contact that the ideal vehicle has as well"
        if case.struck_from_behind:
            best = "which ran into the ego's rear and is at fault"
        elif case.ideal_severity is None:
            best = "the ideal vehicle's case is not known"
        elif case.avoidable:
            best = "which the ideal vehicle avoids"
        how = "Hit by" if case.struck_from_behind else "Hit"
        yield (
            f"{how} `{hit.other}` at {3.6 * hit.relative_speed:z.0f} km/h, "
            f"{hit.time:z.1f} s after the start, {best}.",
            hit.time,
        )
        yield _braking_before(scene.ego, hit.time), hit.time
        if words := cause_words(case):
            yield f"Cause: {words}.", hit.time
    if case.departed:
        when, speed = case.departure_time or 0.0, case.departure_speed or 0.0
        yield f"Left the road at {when:z.1f} s with {3.6 * speed:z.0f} km/h.", when


def _braking_before(ego: Trajectory, contact: float) -> str:
    since = ego.time - ego.time[0]
    brakes = np.flatnonzero((ego.acceleration <= BRAKES) & (since <= contact))
    if not len(brakes):
        return "Before it the ADS did not brake."
    first = float(since[brakes[0]])
    hardest = -float(ego.acceleration[since <= contact].min())
    return (
        f"The ADS braked from {first:z.1f} s on, {contact - first:z.1f} s before it, with at most "
        f"{hardest:z.1f} m/s2."
    )


def task_words(scene: CaseDrives, logical: LogicalScenario, margin: float) -> _Said:
    """Words on where the drive fell furthest behind the slowest reference.

    margin: `road_margin`, m; a drive that departs from the road does not count as a reference.
    """
    share, ego = scene.case.task_share, scene.ego
    start, beside = logical.placed(scene.case.values).ego, scene.beside.values()
    clean = [one for one in beside if first_departure(one, logical.road, margin) is None]
    asked = asked_way(start.x, clean)
    if share is None or share >= LOW or scene.case.incident or not asked or not len(asked.places):
        return
    if start.way is not None and misses(ego, start.way):
        due = start.way.by
        when = float(times_at(ego, np.array([due]))[0])
        yield f"Missed the lane change that was due after {due - start.x:z.0f} m.", when
        return
    own, places = times_at(ego, asked.places), asked.places - start.x
    drivers = sum(one in scene.drivers for one in clean)
    both = (drivers, count(drivers, "driver")), (len(clean) - drivers, "the reference car")
    who = " and ".join(words for number, words in both if number)
    if np.isinf(own[-1]):
        gone = max(ego.x.max() - start.x, 0.0)
        last = float(ego.time[np.argmax(ego.x)] - ego.time[0])
        ended = "Stood after" if ego.speed[-1] < STANDING else "Came no further than"
        how = f"{ended} {gone:z.0f} m of {places[-1]:z.0f} m"
        yield f"{how}, from {last:z.1f} s on; {who} drove on.", last
        return
    worst = int(np.argmax(own - asked.slowest))
    late = f"Needed {own[worst]:z.1f} s for {places[worst]:z.0f} m; the slowest of {who} needed"
    yield f"{late} {asked.slowest[worst]:z.1f} s.", float(own[worst])


def likeness_words(scene: CaseDrives, people: Quantiles) -> _Said:
    """The factor that lowers H most, in words; each factor below `LOW`, the lowest first."""
    factors = {name: getattr(scene.case, field) for name, field in LIKENESS_FACTORS.items()}
    low = sorted(
        (value, name) for name, value in factors.items() if value is not None and value < LOW
    )
    for _, name in low:
        if name == "plausibility":
            yield _extreme(scene, people)
        elif name == "similarity" and len(scene.drivers) > 1:
            yield _unlike(scene)
        elif name == "operations":
            words = "Worked wheel and pedals more often than the drivers did."
            yield words, scene.ego.duration
        elif name == "length":
            gone, theirs = _way(scene.ego), float(np.mean([_way(one) for one in scene.drivers]))
            words = f"Drove {gone:z.0f} m, the drivers {theirs:z.0f} m in the mean."
            yield words, scene.ego.duration


def _extreme(scene: CaseDrives, people: Quantiles) -> tuple[str, float]:
    """The extreme that few people reach: its value and time, the event nearest to it, and how many
    people do so.
    """
    extremes = extremes_of(scene.ego, scene.actors)
    name, share = least_plausible(extremes, people)
    words, value, half = EXTREME_WORDS[name]
    when = max(0.0, _reached(scene, name, extremes[name]) - half)
    most = "none of the recorded people does"
    if share > 0.0:
        most = f"{percent(float(f'{share:z.1g}'))} of people do"
    usual = people.values[name][-1]
    side = "below" if usual < extremes[name] else "above"
    done = words.format(value.format(extremes[name])).capitalize()
    source = f"({people.people} people, {people.source})"
    beside = f"half of them stay {side} {value.format(usual)} {source}"
    return f"{done}{_event(scene, when)}; {most}, {beside}.", when


def _reached(scene: CaseDrives, name: str, value: float) -> float:
    """Time at which a drive first reached an extreme, s: that of the shortest drive from its start
    that has it, by bisection.
    """
    ego, low, high = scene.ego, 2, len(scene.ego.time)
    while low < high:
        middle = (low + high) // 2
        part = extremes_of(_until(ego, middle), scene.actors)[name]
        has = np.isclose(part, value, rtol=1e-6)
        low, high = (low, middle) if has else (middle + 1, high)
    return float(ego.time[low - 1] - ego.time[0])


def _until(drive: Trajectory, samples: int) -> Trajectory:
    channels = (drive.time, drive.x, drive.y, drive.heading, drive.speed, drive.acceleration)
    return Trajectory(
        *(channel[:samples] for channel in channels), length=drive.length, width=drive.width
    )


def _event(scene: CaseDrives, when: float) -> str:
    """`, at 3.2 s, 2.1 s before `lead` braked`: the move of another road user that is nearest in
    time.
    """
    moves = []
    for name, actor in scene.actors.items():
        since = actor.time - actor.time[0]
        for done, verb in (
            (actor.acceleration <= BRAKES, "braked"),
            (np.abs(actor.y - actor.y[0]) >= SIDEWAYS, "moved over"),
        ):
            if done.any():
                moves.append((float(since[np.argmax(done)]), f"`{name}` {verb}"))
    if not moves:
        return f" at {when:z.1f} s"
    time, words = min(moves, key=lambda move: abs(move[0] - when))
    order = "after" if when >= time else "before"
    return f" at {when:z.1f} s, {abs(when - time):z.1f} s {order} {words}"


def _unlike(scene: CaseDrives) -> tuple[str, float]:
    """Words on where path or speed differ most from the drivers' own spread."""
    ego, end = scene.ego, min(float(one.x.max()) for one in (scene.ego, *scene.drivers))
    places = np.arange(float(ego.x[0]), max(end, float(ego.x[0]) + 1.0))
    speed, y = (_furthest(scene, places, channel) for channel in ("speed", "y"))
    worst = speed if speed.deviations > y.deviations else y
    own, theirs = worst.own, worst.drivers
    when = float(times_at(ego, np.array([worst.place]))[0])
    at = f"At {when:z.1f} s"
    if worst is speed:
        low, high = 3.6 * theirs.min(), 3.6 * theirs.max()
        return (
            f"{at} it drove {3.6 * own:z.0f} km/h where {len(theirs)} drivers drove {low:z.0f} to "
            f"{high:z.0f} km/h.",
            when,
        )
    side = "left" if own > theirs.mean() else "right"
    away = abs(own - theirs.mean())
    return f"{at} it was {away:z.1f} m further {side} than {len(theirs)} drivers in the mean.", when


class Furthest(NamedTuple):
    """The place at which a quantity lies furthest from that of the drivers.

    deviations: from the drivers' mean, in their standard deviations.
    place: x, m.
    own, drivers: the quantity of the ADS and of each driver there.
    """

    deviations: float
    place: float
    own: float
    drivers: FloatArray


def _furthest(scene: CaseDrives, places: FloatArray, channel: str) -> Furthest:
    own = _at_places(scene.ego, places, channel)
    theirs = np.array([_at_places(one, places, channel) for one in scene.drivers])
    spread = np.maximum(theirs.std(axis=0, ddof=1), 0.2 if channel == "y" else 1.0)
    away = np.abs(own - theirs.mean(axis=0)) / spread
    worst = int(np.argmax(away))
    return Furthest(float(away[worst]), float(places[worst]), float(own[worst]), theirs[:, worst])


def _at_places(drive: Trajectory, places: FloatArray, channel: str) -> FloatArray:
    furthest = np.maximum.accumulate(drive.x)
    return np.asarray(np.interp(places, furthest, getattr(drive, channel)))


def _way(drive: Trajectory) -> float:
    return float(np.hypot(np.diff(drive.x), np.diff(drive.y)).sum())


def picture(scene: CaseDrives, moment: float | None) -> list[str]:
    """Speed over time of the ego and of the drivers in the mean, in blocks; a mark at the
    moment.
    """
    drives = [scene.ego, *scene.drivers]
    end = min(max(drive.duration for drive in drives), 1.5 * scene.ego.duration) or 1.0
    times = np.linspace(0.0, end, PICTURE)
    top = max(float(drive.speed.max()) for drive in drives) or 1.0
    rows = [("ego", [scene.ego]), *([("drivers", scene.drivers)] if scene.drivers else [])]
    lines = [f"  {name:<8}{_blocks(some, times, top)}" for name, some in rows]
    scale = f"speed, 0 to {3.6 * top:z.0f} km/h over {end:z.1f} s"
    if moment is None:
        return [*lines, f"  {'':<8}{scale}"]
    mark = f"{'':<{8 + round(min(moment / end, 1.0) * (PICTURE - 1))}}^ {moment:z.1f} s"
    return [*lines, f"  {mark}", f"  {'':<8}{scale}"]


def _blocks(drives: Sequence[Trajectory], times: FloatArray, top: float) -> str:
    """A block for each time at which all drives last, blank after the first ends."""
    speeds = np.mean(
        [np.interp(times, one.time - one.time[0], one.speed) for one in drives], axis=0
    )
    last = min(one.duration for one in drives)
    level = np.clip(np.round(speeds / top * (len(BLOCKS) - 1)), 0, len(BLOCKS) - 1).astype(int)
    return "".join(
        BLOCKS[k] if time <= last + 1e-9 else " " for k, time in zip(level, times, strict=True)
    ).rstrip()
