"""One case in driving words: which quantity, compared with which drivers, at what time; and a
picture.

Users: `report/explain.py`.
"""

import shlex
from collections.abc import Iterator

import numpy as np

from sumo_eval.cases import CaseResult
from sumo_eval.method.plausibility import Quantiles
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.store import Store
from sumo_eval.report.words import cause_words, count, percent
from sumo_eval.results import Evaluation
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.drive_beside import (
    LOW,
    CaseDrives,
    behind,
    braking_before,
    furthest,
    mean_path,
    mean_speed,
    rarest_extreme,
)
from sumo_eval.scoring.findings import LIKENESS_FACTORS
from sumo_eval.scoring.plausible_people import plausible_people
from sumo_eval.trajectory import FloatArray

EXTREME_WORDS = {
    "min_ttc": ("Came within {} of a collision", "{:z.1f} s"),
    "min_thw": ("Followed at a headway of {}", "{:z.2f} s"),
    "max_deceleration": ("Braked at {}", "{:z.1f} m/s2"),
    "max_jerk": ("Changed its acceleration by {}", "{:z.1f} m/s3"),
    "max_unrest": ("Sped up and slowed down by {} within 2 s", "{:z.1f} m/s2"),
    "max_lateral_speed": ("Moved sideways at {}", "{:z.1f} m/s"),
    "max_lateral_acceleration": ("Accelerated sideways at {}", "{:z.1f} m/s2"),
}
"""Words of an extreme, and its value in its unit."""
BLOCKS = "▁▂▃▄▅▆▇█"
PICTURE = 60
"""Characters of a picture of speed over time."""


def driving_words(
    evaluation: Evaluation, case: CaseResult, fact: Fact, logical: LogicalScenario, store: Store
) -> list[str]:
    """Sentences on one case, the gravest first, and a picture of its speed beside that of the
    drivers.
    """
    gave_up = ["The ADS gave the case up, which counts as doing nothing."] if case.gave_up else []
    if store.is_discarded(case.case) or not (case.evaluated or case.departed):
        return gave_up
    scene = CaseDrives.of(case, fact, store, logical.road)
    remarks = [
        *_incident(scene, fact),
        *task_words(scene, logical, evaluation.settings.method.task.road_margin),
    ]

    if case.zone == "safe" and not case.incident:
        settings = evaluation.settings.method.plausibility
        remarks += likeness_words(scene, plausible_people(logical, store, settings)[0])
    calm = (
        "It drove as the drivers did, without harm."
        if case.human_likeness is not None  # drivers that are too few are not compared with
        else "It had no contact and stayed on the road."
    )
    sentences = [words for words, _ in remarks] or [calm]
    moment = remarks[0][1] if remarks else None
    command = (
        f"sumo-eval replay {shlex.quote(str(evaluation.folder))} {shlex.quote(case.case)} --open"
    )
    return [*sentences, *gave_up, *picture(scene, moment), f"See it: {command}"]


_Remarks = Iterator[tuple[str, float]]
"""Sentences, each with the time that it is about, s since the start of the drive."""


def _incident(scene: CaseDrives, fact: Fact) -> _Remarks:
    """Contact, departure, or an end that the harness brought, and what the ADS did before."""
    case, hit = scene.case, fact.collision
    if hit is not None:
        remark = "a contact that the ideal vehicle has as well"
        if case.struck_from_behind:
            remark = "which ran into the ego's rear and is at fault"
        elif case.ideal_severity is None:
            remark = "the ideal vehicle's case is not known"
        elif case.avoidable:
            remark = "which the ideal vehicle avoids"
        how = "Hit by" if case.struck_from_behind else "Hit"
        yield (
            f"{how} `{hit.other}` at {3.6 * hit.relative_speed:z.0f} km/h, "
            f"{hit.time:z.1f} s after the start, {remark}.",
            hit.time,
        )
        braking = braking_before(scene.ego, hit.time, case.braking_time)
        yield (
            f"The ADS braked from {braking.first:z.2f} s on, {hit.time - braking.first:z.1f} s "
            f"before it, with at most {braking.hardest:z.1f} m/s2."
            if braking
            else "Before it the ADS did not brake.",
            hit.time,
        )
        if words := cause_words(case):
            yield f"Cause: {words}.", hit.time
    if case.departed:
        when, speed = case.departure_time or 0.0, case.departure_speed or 0.0
        yield f"Left the road at {when:z.1f} s with {3.6 * speed:z.0f} km/h.", when


def task_words(scene: CaseDrives, logical: LogicalScenario, margin: float) -> _Remarks:
    """Words on where the drive fell furthest behind the slowest reference.

    margin: `road_margin`, m.
    """
    delay = behind(scene, logical, margin)
    if delay is None:
        return
    references = (delay.drivers, count(delay.drivers, "driver")), (delay.car, "the reference car")
    names = " and ".join(words for number, words in references if number)
    way, time = f"{delay.way:z.0f} m", f"{delay.time:z.1f} s"
    short = f"{way} of {delay.asked:z.0f} m, from {time} on; {names} drove on."
    words = {  # of each kind of delay
        "missed": f"Missed the lane change that was due after {way}.",
        "stood": f"Stood after {short}",
        "short": f"Came no further than {short}",
        "late": f"Needed {time} for {way}; the slowest of {names} needed {delay.slowest:z.1f} s.",
    }
    yield words[delay.what], delay.time


def likeness_words(scene: CaseDrives, people: Quantiles) -> _Remarks:
    """The factors that lower H, in words, the lowest first."""
    end = scene.ego.duration  # time of a sentence about the whole drive
    factors = [(getattr(scene.case, field), name) for name, field in LIKENESS_FACTORS.items()]
    for _, name in sorted(it for it in factors if it[0] is not None and it[0] < LOW):
        if name == "plausibility":
            yield _extreme(scene, people)
        elif name == "similarity" and len(scene.drivers) > 1:
            yield _unlike(scene)
        elif name == "operations":
            yield "Worked wheel and pedals more often than the drivers did.", end
        elif name == "length":
            gone, theirs = mean_path(scene.ego), mean_path(*scene.drivers)
            yield f"Drove {gone:z.0f} m, the drivers {theirs:z.0f} m in the mean.", end


def _extreme(scene: CaseDrives, people: Quantiles) -> tuple[str, float]:
    """The extreme that few people reach: its value and time, the event nearest to it, and how many
    people do so.
    """
    extreme = rarest_extreme(scene, people)
    words, value = EXTREME_WORDS[extreme.name]
    reached = f"{words.format(value.format(extreme.value))} at {extreme.time:z.1f} s"
    if extreme.event is not None:
        order = "after" if extreme.time >= extreme.event.time else "before"
        away = abs(extreme.time - extreme.event.time)
        reached += f", {away:z.1f} s {order} `{extreme.event.actor}` {extreme.event.what}"
    share = "none of the recorded people does"
    if extreme.share > 0.0:
        # one significant digit
        share = f"{percent(float(f'{extreme.share:z.1g}'))} of people do"
    side = "below" if extreme.usual < extreme.value else "above"
    source = f"({people.people} people, {people.source})"
    beside = f"half of them stay {side} {value.format(extreme.usual)} {source}"
    return f"{reached}; {share}, {beside}.", extreme.time


def _unlike(scene: CaseDrives) -> tuple[str, float]:
    """Words on where path or speed differ most from the drivers' own spread."""
    difference, drivers = furthest(scene), count(len(scene.drivers), "driver")
    at = f"At {difference.time:z.1f} s it"
    if difference.channel == "speed":
        own, low, high = (
            f"{3.6 * it:z.0f}" for it in (difference.own, difference.least, difference.most)
        )
        return f"{at} drove {own} km/h where {drivers} drove {low} to {high} km/h.", difference.time
    away = difference.own - difference.mean
    side = "left" if away > 0.0 else "right"
    return (
        f"{at} was {abs(away):z.1f} m further {side} than {drivers} in the mean.",
        difference.time,
    )


def picture(scene: CaseDrives, moment: float | None) -> list[str]:
    """Speed over time of the ego and of the drivers in the mean, in blocks; a mark at the
    moment.
    """
    drives = [scene.ego, *scene.drivers]
    # drivers that take longer are drawn up to 1.5 times the ego's time; never 0
    end = min(max(drive.duration for drive in drives), 1.5 * scene.ego.duration) or 1.0
    times = np.linspace(0.0, end, PICTURE)
    top = max(float(drive.speed.max()) for drive in drives) or 1.0
    rows = ("ego", [scene.ego]), ("drivers", scene.drivers)
    lines = [
        f"  {name:<8}{_blocks(mean_speed(group, times), top)}" for name, group in rows if group
    ]
    if moment is not None:
        column = round(min(moment / end, 1.0) * (PICTURE - 1))
        lines.append(f"  {'':<8}{'':<{column}}^ {moment:z.1f} s")
    return [*lines, f"  {'':<8}speed, 0 to {3.6 * top:z.0f} km/h over {end:z.1f} s"]


def _blocks(speeds: FloatArray, top: float) -> str:
    """A block for each speed, blank where there is none."""
    level = np.clip(np.round(np.nan_to_num(speeds) / top * (len(BLOCKS) - 1)), 0, len(BLOCKS) - 1)
    cells = zip(level.astype(int), np.isfinite(speeds), strict=True)
    return "".join(BLOCKS[k] if finite else " " for k, finite in cells).rstrip()
