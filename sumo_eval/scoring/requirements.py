"""Requirements of a scenario that a drive misses, for cases.csv and the scores. Requirements are
conditions on a drive, such as `min(gap) > 2`; `scenario/requirement.py` reads them.

Users: `report/checks.py`, `scoring/quantities.py`, `scoring/steps.py`. Fixed: `SEPARATOR`, which
stands in cases.csv.
"""

import re
from collections import Counter, defaultdict
from dataclasses import replace
from itertools import chain

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.cases import EVALUATED
from sumo_eval.errors import InputError
from sumo_eval.method.measures import course_of
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.store import EGO
from sumo_eval.results import ScenarioResult
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.score_notes import RequirementMissed
from sumo_eval.scoring.space import ScenarioRun
from sumo_eval.trajectory import Collision, FloatArray, Trajectories, Trajectory

SEPARATOR = "; "
"""Between the names of missed requirements, in `cases.csv` as well."""
_UNDECIDED = ": undecided at "
"""Between the name of a requirement and the moment at which it cannot be decided."""
_MISSED = re.compile(rf"(?s)(.+?)(?:{_UNDECIDED}(\d+\.\d\d s))?")


def series_of(
    ego: Trajectory, actors: Trajectories, collision: Collision | None, road: Road
) -> dict[str, FloatArray]:
    """Quantity of `scenario.requirement.SERIES` -> its values at the n samples of the ego, (n,).

    collision: the ego's first contact, if any.
    road: in whose coordinates the trajectories are.

    `gap`, `thw` and `ttc` are inf where no actor is ahead.
    """
    course = course_of(ego, actors, collision, road)
    # from sample to sample, m/s3; 0 at the first sample
    jerk = np.concatenate([[0.0], np.diff(ego.acceleration) / np.diff(ego.time)])
    to_lead = {"gap": course.gap, "thw": course.thw, "ttc": course.ttc}
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


def requirements_missed(fact: Fact, space: ScenarioRun) -> str | None:
    """Names of the requirements that a drive misses, joined by `SEPARATOR`. A name has a remark if
    a value of the requirement is not a number, so that it cannot be decided.

    "": it misses none. None: the scenario requires nothing, or the drive was not evaluated.

    Raises InputError for a requirement on an actor that the drive does not have.
    """
    required = space.logical.requirements
    if required is None or fact.status not in EVALUATED:
        return None
    actors = space.store.trajectories(fact.case)
    if EGO not in actors:
        raise space.store.no_trajectory(fact.case)
    ego = actors.pop(EGO)
    # definitions of the scenario, parameters of the point, outcomes of the drive
    numbers = required.numbers.extend(fact.values) | {
        "collided": float(fact.collision is not None),
        # x is the ego's centre; when it is at the end of the road, the drive ends
        "reached_end": float(ego.x[-1] >= space.logical.road.length),
    }
    series = series_of(ego, actors, fact.collision, space.logical.road)
    # quantities of actors: `x(lead)` has the placeholder `x_of_lead`
    for placeholder, quantity, name in chain.from_iterable(each.asks for each in required.all):
        if name not in actors:
            raise InputError(
                f"Scenario `{space.name}` requires something of `{name}`, but {fact.case} was "
                "driven without such an actor: restore the scenario's file, or run the evaluation "
                "again."
            )
        actor = actors[name]
        values = {
            "x": actor.x,
            "y": actor.y,
            "speed": actor.speed * np.cos(actor.heading),
            "lateral_speed": actor.speed * np.sin(actor.heading),
        }
        # `interp` gives the first or last value before and after the actor's recording
        series[placeholder] = np.interp(ego.time, actor.time, values[quantity])

    verdicts = [(each.name, each.check(series, numbers)) for each in required.all]
    return SEPARATOR.join(
        name if undecided is None else f"{name}{_UNDECIDED}{undecided:.2f} s"
        for name, (holds, undecided) in verdicts
        if not holds
    )


def missed_in(text: str) -> list[tuple[str, str]]:
    """Name of each requirement in a text of `requirements_missed`, and the moment at which it
    cannot be decided, such as `1.50 s`; "": it is decided.
    """
    # a name may itself hold the text of `_UNDECIDED`, but not with a moment behind it
    parts = (_MISSED.fullmatch(entry) for entry in text.split(SEPARATOR) if entry)
    return [(part[1], part[2] or "") for part in parts if part]


def with_counts(score: ScenarioResult, rows: CaseTable, logical: LogicalScenario) -> ScenarioResult:
    """The score with the number of cases that miss a requirement, and a note for each requirement
    that a case misses.

    rows: cases of the ADS.
    """
    if logical.requirements is None:
        return score
    # by name of a requirement: number of cases that miss it; those of them that are undecided
    number, undecided = Counter[str](), defaultdict[str, list[str]](list)
    texts = rows.requirements_missed.tolist()
    for case, text in zip(rows.case.tolist(), texts, strict=True):
        for name, moment in missed_in(text):
            number[name] += 1
            if moment:
                undecided[name].append(f"`{case}` at {moment}")
    evaluated = int(rows.evaluated.sum())
    notes = []
    for each in logical.requirements.all:
        if number[each.name]:
            cases = undecided[each.name]
            counts = number[each.name], evaluated, len(cases), "".join(cases[:1])
            notes.append(RequirementMissed(each.name, each.text, *counts))
    # "" of a case that misses none, and of one that was not evaluated
    missed = sum(map(bool, texts))
    return replace(score, requirements_missed=missed, notes=(*score.notes, *notes))
