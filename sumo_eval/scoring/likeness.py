"""Whom each safe case is compared with, what these people score among themselves, and what that tells of the case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from sumo_eval.method.anthropomorphic import AnthropomorphicIndex
from sumo_eval.method.leave_one_out import HumanBand
from sumo_eval.method.manoeuvres import words
from sumo_eval.method.plausibility import LEAST_PEOPLE, MOTORWAY_PEOPLE, Quantiles, extremes_of, quantiles_of
from sumo_eval.record.human_reference import LeftOut, PointJob, compute_points
from sumo_eval.record.progress import Progress
from sumo_eval.record.recording import RECORDED
from sumo_eval.record.spread import Spread
from sumo_eval.record.store import Fact, Store
from sumo_eval.results import (
    EVALUATED,
    CaseResult,
    OutsideSupport,
    PlausibleTo,
    ScoreNote,
    ThinReference,
    ThinReferences,
)
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings import DriverSettings, EvaluationSettings, PlausibilitySettings
from sumo_eval.trajectory import FloatArray, Trajectory

FEWEST_DRIVERS = 2  # a deviation needs two
FEWEST_FOR_A_BAND = 3  # and so does what is left when one is left out
SYNTHETIC = "synthetic"  # what is recorded as the controller of a synthetic driver
JACKKNIFED = 16  # cases of an ADS in a scenario on which drivers are left out one by one

Judged = TypeVar("Judged")


@dataclass(frozen=True, slots=True)
class PointReference:
    """The drivers of one concrete scenario. cases: their drives that ended well, and drivers: who drove them. recorded:
    how many of these are recorded people. note: where the reference is too thin. usable: whether a D_i may be computed
    from it.
    """

    cases: tuple[str, ...]
    drivers: tuple[str, ...]
    recorded: int
    note: ThinReference | None
    usable: bool


def references(logical: LogicalScenario, store: Store, settings: DriverSettings) -> dict[int, PointReference]:
    """The drivers of every concrete scenario that has some, or should have some, by point."""
    drives: dict[int, list[Fact]] = {}
    for fact in store.facts("human", logical.name):
        if fact.status == "ok":
            drives.setdefault(fact.point, []).append(fact)
    found = {}
    for point, facts in drives.items():
        recorded = sum(fact.controller == RECORDED for fact in facts)
        note: ThinReference | None = None
        usable = len(facts) >= FEWEST_DRIVERS
        if settings.source == RECORDED and recorded < settings.least:
            fills = settings.too_thin == "fill"
            note = ThinReference(recorded, settings.least, len(facts) - recorded if fills else None)
            usable = fills and usable
        found[point] = PointReference(
            tuple(fact.case for fact in facts), tuple(fact.driver for fact in facts), recorded, note, usable
        )
    return found


@dataclass(frozen=True, slots=True, eq=False)
class PlausiblePeople:
    """The table of people that the plausibility of a scenario's cases is read from. notes: who they are, if not those
    of the default.
    """

    people: Quantiles
    notes: tuple[ScoreNote, ...]


def plausible_people(logical: LogicalScenario, store: Store, settings: PlausibilitySettings) -> PlausiblePeople:
    """The people of the motorway, or the recorded drivers of the run in this scenario, each among its other vehicles.

    Drives of one person at several points are one person's. Fewer than `LEAST_PEOPLE` persons cannot show a share of
    5 %: the motorway's stand in.
    """
    if settings.table == "motorway":
        return PlausiblePeople(MOTORWAY_PEOPLE, ())
    drives, names = [], []
    for fact in store.facts("human", logical.name):
        if fact.status == "ok" and fact.controller != SYNTHETIC:
            ego = store.trajectory(fact.case)
            drives.append(extremes_of(ego, _scripted(logical.concrete(**fact.values), ego.time)))
            names.append(fact.log or fact.driver)
    if len(set(names)) < LEAST_PEOPLE:
        missing = PlausibleTo(logical.name, len(set(names)), len(drives), LEAST_PEOPLE, MOTORWAY_PEOPLE.people)
        return PlausiblePeople(MOTORWAY_PEOPLE, (missing,))
    people = quantiles_of(drives, names, source=f"recorded drivers of the run in {logical.name}")
    note = PlausibleTo(logical.name, people.people, people.drives, LEAST_PEOPLE, None)
    return PlausiblePeople(people, (note,))


def _scripted(concrete: ConcreteScenario, time: FloatArray) -> dict[str, Trajectory]:
    """The other vehicles of a concrete scenario at some times, s, by name."""
    found = {}
    for actor in concrete.actors:
        x, y = (np.array([place(float(t)) for t in time]) for place in (actor.x, actor.y))
        speed = np.array([actor.speed(float(t)) for t in time])
        found[actor.name] = Trajectory(time, x, y, speed=speed, length=actor.length, width=actor.width)
    return found


@dataclass(frozen=True, slots=True)
class Comparison:
    """What comes of putting people beside cases. indexes: D_i by case. bands: what the drivers of a point score among
    themselves, each left out once, by point. left_out: what evenly chosen cases get without each driver, by case.
    """

    indexes: Mapping[str, AnthropomorphicIndex]
    bands: Mapping[int, HumanBand]
    left_out: Mapping[str, LeftOut]


def compare_with_people(
    logical: LogicalScenario,
    compared: Mapping[int, PointReference],
    judged: Sequence[Sequence[Fact]],
    store: Store,
    settings: EvaluationSettings,
    spread: Spread,
    progress: Progress,
) -> Comparison:
    """D_i of every evaluated case that has enough drivers to compare with, and the drivers' bands. judged: the cases of
    each ADS that are to have a D_i. spread: as in `compute_points`.
    """
    usable = {point: reference for point, reference in compared.items() if reference.usable}
    cases: dict[int, list[str]] = {point: [] for point in usable}
    left_out: dict[int, list[str]] = {point: [] for point in usable}
    for facts in judged:
        counted = [fact for fact in facts if fact.status in EVALUATED and fact.point in usable]
        for fact in counted:
            cases[fact.point].append(fact.case)
        for fact in jackknifed(counted):
            left_out[fact.point].append(fact.case)
    points = [point for point in sorted(usable) if cases[point] or len(usable[point].cases) >= FEWEST_FOR_A_BAND]
    jobs = [
        PointJob(
            usable[point].cases,
            logical.road,
            tuple(cases[point]),
            tuple(left_out[point]),
            len(usable[point].cases) >= FEWEST_FOR_A_BAND,
        )
        for point in points
    ]
    stage = f"{logical.name}: comparing everybody with the drivers"
    results = compute_points(
        store.path,
        jobs,
        settings.method.anthropomorphic,
        spread,
        lambda done: progress(stage, done, len(jobs)),
    )
    return Comparison(
        {case: index for result in results for case, index in result.indexes.items()},
        {point: result.band for point, result in zip(points, results, strict=True) if result.band is not None},
        {case: found for result in results for case, found in result.left_out.items()},
    )


def jackknifed(cases: Sequence[Judged]) -> list[Judged]:
    """The cases, evenly chosen, on which drivers are left out one by one."""
    chosen = {round(place) for place in np.linspace(0, len(cases) - 1, min(JACKKNIFED, len(cases)))}
    return [cases[place] for place in sorted(chosen)]


def with_people(
    rows: Sequence[CaseResult],
    facts: Sequence[Fact],
    people: Comparison,
    compared: Mapping[int, PointReference],
    exposure: Mapping[str, Any],
    settings: DriverSettings,
) -> list[CaseResult]:
    """The rows with what is known of their human reference and of their exposure."""
    outside = set(exposure.get("outside_support", ()))
    full = []
    for row, fact in zip(rows, facts, strict=True):
        note: Literal["", "outside_support"] = "outside_support" if fact.point in outside else ""
        if row.zone == "hazardous":
            full.append(replace(row, exposure_note=note))
            continue
        reference, band = compared.get(fact.point), people.bands.get(fact.point)
        index = people.indexes.get(fact.case)
        thin = reference.note if reference else None
        if reference is None and settings.source == RECORDED:
            thin = ThinReference(0, settings.least, None)
        full.append(
            replace(
                row,
                drivers=len(reference.cases) if reference else 0,
                recorded_drivers=reference.recorded if reference else 0,
                reference_note=thin,
                human_low=band.low if band else None,
                human_mean=band.mean if band else None,
                human_high=band.high if band else None,
                bimodal=bool(index and any(one.kind == "two_groups" for one in index.notes)),
                manoeuvre=words(index.manoeuvre) if index and index.manoeuvre else "",
                manoeuvre_share=index.share if index and index.manoeuvre else None,
                exposure_note=note,
            )
        )
    return full


def reference_notes(rows: Sequence[CaseResult]) -> tuple[ScoreNote, ...]:
    """What must be said of the human reference and the exposure of the cases of one ADS in one scenario."""
    safe = [row for row in rows if row.zone == "safe"]
    thin = [row.reference_note for row in safe if row.reference_note is not None]
    outside = sum(bool(row.exposure_note) for row in rows)
    said: list[ScoreNote] = []
    if thin:
        said.append(ThinReferences(len(thin), len(safe), sum(one.filled is None for one in thin)))
    if outside:
        said.append(OutsideSupport(outside, len(rows)))
    return tuple(said)
