"""Requirements of a scenario that a drive does not meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sumo_eval.cases import EVALUATED, CaseTable
from sumo_eval.method.measures import time_headway, time_to_collision, vehicle_ahead
from sumo_eval.record.store import EGO, Fact
from sumo_eval.results import RequirementMissed, ScenarioResult
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.requirement import Requirement
from sumo_eval.scoring.space import ScenarioRun
from sumo_eval.trajectory import Collision, FloatArray, Trajectory

SEPARATOR = "; "
"""Between the names of missed requirements, in `cases.csv` as well."""


def series_of(
    ego: Trajectory, actors: Mapping[str, Trajectory], collision: Collision | None
) -> dict[str, FloatArray]:
    """Values for requirements at each sample of the ego, by the names of
    `scenario.requirement.SERIES`; `gap`, `thw` and `ttc` are inf where no actor is ahead.
    """
    gap, closing = vehicle_ahead(ego, actors, collision)
    along = ego.speed * np.cos(ego.heading)
    step = np.diff(ego.time)
    # none at the first sample, nor between two of one time, as at a contact
    jerk = np.concatenate([[0.0], np.diff(ego.acceleration) / np.where(step > 0.0, step, np.inf)])
    to_lead = {"gap": gap, "thw": time_headway(gap, along), "ttc": time_to_collision(gap, closing)}
    return {
        "time": ego.time,
        "x": ego.x,
        "offset": ego.y - ego.y[0],
        "speed": ego.speed,
        "acceleration": ego.acceleration,
        "jerk": jerk,
        "lateral_speed": ego.speed * np.sin(ego.heading),
        **{name: np.where(np.isnan(values), np.inf, values) for name, values in to_lead.items()},
    }


def series_of_others(
    asked: Sequence[Requirement], ego: Trajectory, actors: Mapping[str, Trajectory]
) -> dict[str, FloatArray]:
    """Values of other actors for requirements at each sample of the ego, by placeholder; outside
    an actor's own time its first or last value.
    """
    component = {"speed": np.cos, "lateral_speed": np.sin}  # along and across the road
    series: dict[str, FloatArray] = {}
    for placeholder, quantity, name in {ask for one in asked for ask in one.asks}:
        actor = actors[name]
        values = getattr(actor, "speed" if quantity in component else quantity)
        if quantity in component:
            values = values * component[quantity](actor.heading)
        series[placeholder] = np.interp(ego.time, actor.time, values)
    return series


def requirements_missed(fact: Fact, space: ScenarioRun) -> str | None:
    """Names of the requirements that a drive misses as one text, "" where it meets all; None where
    nothing is required or nothing was evaluated.
    """
    required = space.logical.requirements
    if required is None or fact.status not in EVALUATED:
        return None
    actors = space.store.trajectories(fact.case)
    if EGO not in actors:
        raise space.store.no_trajectory(fact.case)
    ego = actors.pop(EGO)
    known = required.known(fact.values) | {
        "collided": float(fact.collision is not None),
        # a drive ends when its centre is there
        "reached_end": float(ego.x[-1] >= space.logical.road.length),
    }
    series = series_of(ego, actors, fact.collision) | series_of_others(required.all, ego, actors)
    return SEPARATOR.join(one.name for one in required.all if not one.holds(series, known))


def with_counts(score: ScenarioResult, rows: CaseTable, logical: LogicalScenario) -> ScenarioResult:
    """The score with how many cases miss a requirement, and a note for each requirement that some
    miss.
    """
    if logical.requirements is None:
        return score
    texts = [row.requirements_missed for row in rows]
    missed = [text.split(SEPARATOR) if text else [] for text in texts if text is not None]
    notes = list(score.notes)
    for one in logical.requirements.all:
        number = sum(one.name in names for names in missed)
        if number:
            notes.append(RequirementMissed(one.name, one.text, number, len(missed)))
    return replace(score, requirements_missed=sum(map(bool, missed)), notes=tuple(notes))
