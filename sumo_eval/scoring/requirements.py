"""Which requirements of a scenario a drive does not meet."""

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


def series_of(
    ego: Trajectory, actors: Mapping[str, Trajectory], collision: Collision | None
) -> dict[str, FloatArray]:
    """Values for requirements at each sample of the ego, by the names of `SERIES`; inf where
    no actor is ahead.
    """
    gap, closing = vehicle_ahead(ego, actors, collision)
    along = ego.speed * np.cos(ego.heading)
    step = np.diff(ego.time)
    jerk = np.concatenate([[0.0], np.diff(ego.acceleration) / np.where(step > 0.0, step, np.inf)])
    known = {"gap": gap, "thw": time_headway(gap, along), "ttc": time_to_collision(gap, closing)}
    return {
        "time": ego.time,
        "x": ego.x,
        "offset": ego.y - ego.y[0],
        "speed": ego.speed,
        "acceleration": ego.acceleration,
        "jerk": jerk,
        "lateral_speed": ego.speed * np.sin(ego.heading),
        **{name: np.where(np.isnan(values), np.inf, values) for name, values in known.items()},
    }


def series_of_others(
    asked: Sequence[Requirement], ego: Trajectory, actors: Mapping[str, Trajectory]
) -> dict[str, FloatArray]:
    """Values of other actors for requirements at each sample of the ego, by the placeholders of
    `Requirement.asks`.
    """
    found: dict[str, FloatArray] = {}
    for placeholder, function, name in {ask for one in asked for ask in one.asks}:
        actor = actors[name]
        values = {
            "x": actor.x,
            "y": actor.y,
            "speed": actor.speed * np.cos(actor.heading),
            "lateral_speed": actor.speed * np.sin(actor.heading),
        }[function]
        found[placeholder] = np.interp(ego.time, actor.time, values)
    return found


def requirements_missed(fact: Fact, space: ScenarioRun) -> str | None:
    """Names of the requirements that a drive misses; None where nothing is required or nothing was
    evaluated.
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
        "reached_end": float(ego.x[-1] >= space.logical.road.length),
    }
    series = series_of(ego, actors, fact.collision) | series_of_others(required.all, ego, actors)
    return "; ".join(one.name for one in required.all if not one.holds(series, known))


def with_counts(score: ScenarioResult, rows: CaseTable, logical: LogicalScenario) -> ScenarioResult:
    """The score with how many cases miss a requirement, and a note for each requirement that some
    miss.
    """
    if logical.requirements is None:
        return score
    missed = [
        set(row.requirements_missed.split("; ")) - {""}
        for row in rows
        if row.requirements_missed is not None
    ]
    notes = tuple(
        RequirementMissed(one.name, one.text, number, len(missed))
        for one in logical.requirements.all
        if (number := sum(one.name in names for names in missed))
    )
    failed = sum(map(bool, missed))
    return replace(score, requirements_missed=failed, notes=(*score.notes, *notes))
