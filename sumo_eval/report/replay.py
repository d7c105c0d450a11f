"""One case, or two side by side, as a page of its own that plays without a server and loads
nothing.

Users: `cli/look.py`.
"""

from pathlib import Path

import numpy as np

from sumo_eval.errors import InputError, unknown
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.cases import Role
from sumo_eval.record.store import EGO, Store, open_store
from sumo_eval.report.explain import known_case
from sumo_eval.report.page import Json, packed_json, write_filled
from sumo_eval.report.page_data import drawn_bodies, drawn_road
from sumo_eval.report.sent_drives import CHANNEL_STEPS, contact_of, encode_trajectories
from sumo_eval.report.words import cause_words
from sumo_eval.scenario.concrete import RECORDED_EVERY, ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scoring.contact_cause import cause_of_contact
from sumo_eval.text import point_words
from sumo_eval.trajectory import Trajectory

ROLES_BESIDE: tuple[Role, ...] = ("ads", "human", "ideal")
"""Roles of drives that may be shown next to the drive of an ADS."""


def write_replay(
    run: Path, logical: LogicalScenario, fact: Fact, path: Path, *, beside: str | None
) -> Path:
    """Write the animation of a recorded case to `path` and return it.

    beside: name of another ADS, of a driver (`driver_03`), or of the ideal vehicle, to show next to
        it in the same concrete scenario.
    """
    concrete = logical.concrete(**fact.values)
    with open_store(run) as store:
        trajectories: list[Trajectory] = []
        views = [_view(fact, store, trajectories)]
        if beside is not None:
            views.append(_view(_companion(fact, store, beside), store, trajectories))
        first_ghost = len(trajectories)
        trajectories += _ghosts(fact, concrete, store)
    ghosts = list(range(first_ghost, len(trajectories)))
    data = {
        "channels": CHANNEL_STEPS,
        "road": drawn_road(logical.road),
        "bodies": drawn_bodies(concrete),
        "views": views,
        "ghosts": ghosts,
        "trajectories": encode_trajectories(trajectories)
    }  # fmt: skip
    return write_filled(
        path, "replay.html.j2", "The replay", title=f"{fact.driver} in {fact.scenario}",
        point=point_words(fact.values), case=fact.case,
        end=fact.end_reason or "", status=fact.status, drivers=len(ghosts), data=packed_json(data),
        cause=cause_words(cause_of_contact(fact)) if fact.collision else ""
    )  # fmt: skip


def _ghosts(fact: Fact, concrete: ConcreteScenario, store: Store) -> list[Trajectory]:
    """Drives at the same point that are drawn as outlines: of the human drivers whose drives ended
    "ok" and were kept, and of the ego that was recorded on the road.
    """
    drivers = store.driven_at(fact.scenario, fact.point, "human")
    ghosts = [store.trajectory(driver.case) for driver in drivers]
    if concrete.ego.recorded:
        at = np.array(concrete.ego.recorded)  # (n, 2): x and y, m
        ghosts.append(Trajectory(np.arange(len(at)) * RECORDED_EVERY, *at.T))
    return ghosts


def recorded(run: Path, key: str) -> Fact:
    """The fact of a drive that `write_replay` can play, by its case's key.

    Raises InputError if nothing was recorded of it, or its trajectories were discarded.
    """
    fact = known_case(run, key)
    with open_store(run) as store:
        return _playable(fact, store)


def _playable(fact: Fact, store: Store) -> Fact:
    """The fact, if its drive can be played; else an error says why not."""
    if store.is_discarded(fact.case):
        raise store.no_trajectory(fact.case)
    if not store.trajectories(fact.case):
        raise InputError(
            f"Case `{fact.case}` has no recording to replay: {fact.error or fact.status}."
        )
    return fact


def _view(fact: Fact, store: Store, trajectories: list[Trajectory]) -> Json:
    """One drive. Appends its trajectories; key `vehicles` has the index of each in the list."""
    vehicles = store.trajectories(fact.case)
    places = {name: len(trajectories) + index for index, name in enumerate(vehicles)}
    trajectories += vehicles.values()
    return {"name": fact.driver, "vehicles": places, "contact": contact_of(fact, vehicles[EGO])}


def _companion(fact: Fact, store: Store, name: str) -> Fact:
    """Drive that `name` controls at the point of `fact`.

    Raises InputError if none is there, or for one that cannot be played.
    """
    at_point = [
        other
        for role in ROLES_BESIDE
        for other in store.facts_at(range(fact.point, fact.point + 1), role, fact.scenario)
        if other.case != fact.case
    ]
    for other in at_point:
        if other.driver == name:
            return _playable(other, store)
    raise unknown(
        "ADS or driver of this concrete scenario", name, [other.driver for other in at_point]
    )
