"""The people from whose table the plausibility of a scenario's cases is read.

Users: `scoring.steps`, `report.driving_words`.
"""

from __future__ import annotations

from typing import NamedTuple

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
from sumo_eval.results import PlausibleTo, ScoreNote
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import PlausibilitySettings
from sumo_eval.trajectory import Trajectory

SYNTHETIC = "synthetic"  # what is recorded as the controller of a synthetic driver


class PlausiblePeople(NamedTuple):
    """The table of people that the plausibility of a scenario's cases is read from.

    notes: who they are, if not those of the default.
    """

    people: Quantiles
    notes: tuple[ScoreNote, ...]


def plausible_people(
    logical: LogicalScenario, store: Store, settings: PlausibilitySettings
) -> PlausiblePeople:
    """The people of the motorway, or the recorded drivers of the run in this scenario, each among
    its other vehicles as these move undisturbed.

    All drives of a person count as one person. Fewer than `LEAST_PEOPLE` persons cannot show a
    share of 5 %: the motorway's stand in.
    """
    if settings.table == "motorway":
        return PlausiblePeople(MOTORWAY_PEOPLE, ())
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
        stand_in = people.people  # number of the people that stand in
    else:
        source = f"recorded drivers of the run in {logical.name}"
        people = quantiles_of(drives, names, source=source)
    note = PlausibleTo(logical.name, persons, len(drives), LEAST_PEOPLE, stand_in)
    return PlausiblePeople(people, (note,))


def _undisturbed(concrete: ConcreteScenario, drive: Trajectory) -> dict[str, Trajectory]:
    """The other vehicles of a concrete scenario during a drive, by name, as they move while the ego
    keeps its speed.
    """
    size = drive.length, drive.width
    others = tracks([concrete], [size], CLOCK, float(drive.time[-1])).others[0]
    time = CLOCK * np.arange(others.shape[1])
    return {
        actor.name: Trajectory(time, *motion.T[:4], length=actor.length, width=actor.width)
        for actor, motion in zip(concrete.actors, others, strict=True)
    }
