"""The people whose extremes show which driving in a scenario is plausible: motorway drivers from a
table that ships, or the recorded drivers of the run.

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

SYNTHETIC = "synthetic"  # what a fact has as the controller of a synthetic driver


def plausible_people(
    logical: LogicalScenario, store: Store, settings: PlausibilitySettings
) -> tuple[Quantiles, tuple[ScoreNote, ...]]:
    """The table of people for a scenario, and notes on who they are: the run's recorded drivers
    there. With the setting `table = "motorway"`: `MOTORWAY_PEOPLE`, without a note.

    settings: `[method.plausibility]`.

    Recorded drives have no other vehicles. The actors of the concrete scenario replace them, moving
    as they do while the ego keeps its speed.

    All drives of a person together weigh 1. Fewer than `LEAST_PEOPLE` persons cannot show a share
    of 5 %: then the table is `MOTORWAY_PEOPLE` too, with a note.
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
        stand_in = MOTORWAY_PEOPLE.people  # number of people of the other table
    else:
        people = quantiles_of(
            drives, names, source=f"recorded drivers of the run in {logical.name}"
        )
    return people, (PlausibleTo(logical.name, persons, len(drives), LEAST_PEOPLE, stand_in),)


def _undisturbed(concrete: ConcreteScenario, drive: Trajectory) -> dict[str, Trajectory]:
    """Actors of a concrete scenario by name, moving as they do while the ego keeps its speed.

    drive: of the ego; its length, width and last time.
    """
    # motion: (actors, times, channels). Channels 0 to 3 are x, y, heading, speed, in the order of
    # `Trajectory`.
    size = drive.length, drive.width
    others = tracks([concrete], [size], CLOCK, float(drive.time[-1])).others[0]
    time = CLOCK * np.arange(others.shape[1])
    return {
        actor.name: Trajectory(time, *motion.T[:4], length=actor.length, width=actor.width)
        for actor, motion in zip(concrete.actors, others, strict=True)
    }
