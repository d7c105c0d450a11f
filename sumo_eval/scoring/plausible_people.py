"""The people that show which driving in a scenario is plausible.

Users: `scoring.steps`, `report.driving_words`.
"""

import numpy as np

from sumo_eval.method.measures import CLOCK, course_of
from sumo_eval.method.plausibility import (
    LEAST_PEOPLE,
    MOTORWAY_PEOPLE,
    Quantiles,
    extremes_of,
    quantiles_of,
)
from sumo_eval.record.store import Store
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.score_notes import PlausibleTo, ScoreNote
from sumo_eval.settings import PlausibilitySettings
from sumo_eval.trajectory import Trajectory

SYNTHETIC = "synthetic"  # recorded as the controller of a synthetic driver


def plausible_people(
    logical: LogicalScenario, store: Store, settings: PlausibilitySettings
) -> tuple[Quantiles, tuple[ScoreNote, ...]]:
    """The motorway people, or the run's recorded drivers in this scenario; and notes on who they
    are, none where the settings ask for "motorway".

    Recorded drives hold no other vehicles. Those of the concrete scenario take their place, as they
    move while the ego keeps its speed.

    All drives of a person count as one. Fewer than `LEAST_PEOPLE` persons cannot resolve a share of
    5 %: the motorway people stand in.
    """
    if settings.table == "motorway":
        return MOTORWAY_PEOPLE, ()
    drives, names = [], []
    for fact in store.facts("human", logical.name):
        if fact.status == "ok" and fact.controller != SYNTHETIC:
            ego = store.trajectory(fact.case)
            actors = _undisturbed(logical.concrete(**fact.values), ego)
            drives.append(extremes_of(course_of(ego, actors, None, logical.road)))
            names.append(fact.log or fact.driver)
    persons = len(set(names))
    people = MOTORWAY_PEOPLE
    stand_in = None
    if persons < LEAST_PEOPLE:
        stand_in = MOTORWAY_PEOPLE.people  # how many stand in
    else:
        people = quantiles_of(
            drives, names, source=f"recorded drivers of the run in {logical.name}"
        )
    return people, (PlausibleTo(logical.name, persons, len(drives), LEAST_PEOPLE, stand_in),)


def _undisturbed(concrete: ConcreteScenario, drive: Trajectory) -> dict[str, Trajectory]:
    """The other vehicles of a concrete scenario during a drive, by name, as they move while the ego
    keeps its speed.
    """
    # (actors, times, channels); the first four channels are a Trajectory's, in its order
    size = drive.length, drive.width
    others = tracks([concrete], [size], CLOCK, float(drive.time[-1])).others[0]
    time = CLOCK * np.arange(others.shape[1])
    return {
        actor.name: Trajectory(time, *motion.T[:4], length=actor.length, width=actor.width)
        for actor, motion in zip(concrete.actors, others, strict=True)
    }
