"""Results of an evaluation: a record for each case, one for each ADS in each scenario, plain
values throughout.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sumo_eval.cases import CaseResult, CaseTable, Zone
from sumo_eval.errors import check_known
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import EvaluationSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.trajectory import Alone

# texts, because words and pictures are made in a room that builds on this one
_TABLE, _PICTURE = "sumo_eval.report.notebook:html_table", "sumo_eval.report.notebook:picture"
_SCORE = "sumo_eval.report.notebook:score_html"


@dataclass(frozen=True, slots=True)
class NotComputed:
    """Reason why there is no mean over the safe cases, D or H.

    collisions: how many in the safe zone left none.
    """

    why: Literal["collisions", "no_safe_case", "nothing_compared", "no_exposure", "no_drivers"]
    collisions: int = 0


@dataclass(frozen=True, slots=True)
class DrivesLeftOut:
    """Drivers' drives that cannot be references, since a skilled driver's safe case ends well:
    how many, by status.
    """

    left_out: int
    drives: int
    statuses: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class DrivenAlone:
    """Drives that were to be simulated together with others and had to be done again alone, by the
    reason.
    """

    reasons: tuple[tuple[Alone, int], ...]


@dataclass(frozen=True, slots=True)
class Compared:
    """Drives of an ADS that asks SUMO which shared a simulation, and how many of them were driven
    alone, too, and equal.
    """

    compared: int
    drives: int


@dataclass(frozen=True, slots=True)
class DrivenInBlocks:
    """Drives of a policy over arrays, whose bits may depend on which cases it is shown together:
    how many in blocks of how many cases.
    """

    drives: int
    sizes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Counted:
    """A number of cases, collisions or points, of a total.

    actors_left: cases that lasted longer than an actor was on the road.
    outside_support: cases in which no recorded event is like the concrete scenario.
    struck_from_behind: cases in which a vehicle that reacts ran into the ego's rear, its own fault
        and no collision here.
    gentler_than_ideal: collisions in which the ADS was gentler than the ideal vehicle.
    references_collide: points of the safe zone at which drivers or the reference car collide.
    ideal_collides_too: collisions in the safe zone that the ideal vehicle has as well.
    """

    what: Literal[
        "actors_left",
        "outside_support",
        "struck_from_behind",
        "gentler_than_ideal",
        "references_collide",
        "ideal_collides_too",
    ]
    number: int
    of: int


@dataclass(frozen=True, slots=True)
class BeyondRange:
    """Collisions outside the range that a severity is known for, by what lies outside, in the
    severity's own words.
    """

    severity: str
    reasons: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class ThinReferences:
    """Safe cases with too few recorded drivers: of `safe` ones, and how many are left out of D for
    it.
    """

    thin: int
    safe: int
    left_out: int


@dataclass(frozen=True, slots=True)
class PlausibleTo:
    """Drivers that plausibility is measured against, where the recorded drivers of the run were
    asked for.

    people: how many recorded drivers the run has in the scenario.
    drives: of all of them.
    least: how many drivers a table needs.
    instead: the people of the default table who stand in where they are fewer, else None.
    """

    scenario: str
    people: int
    drives: int
    least: int
    instead: int | None


@dataclass(frozen=True, slots=True)
class CasesMissing:
    """Cases that could not be evaluated, by the zone they lie in."""

    zones: tuple[tuple[Zone, int], ...]

    @property
    def cases(self) -> int:
        """All of them."""
        return sum(number for _, number in self.zones)


@dataclass(frozen=True, slots=True)
class ReferenceMissing:
    """Cases of an ADS whose reference could not be evaluated, for reasons that differ in no more
    than their numbers.

    who: the reference.
    reason: of the first of these cases, which is `example`.
    """

    who: Literal["ideal", "no_reaction"]
    reason: str
    cases: int
    example: str


@dataclass(frozen=True, slots=True)
class WorstAndBest:
    """C, D and S with the missing cases counted as worst and as best; None where nothing is
    missing.
    """

    c: tuple[float, float] | None
    d: tuple[float, float] | None
    s: tuple[float, float]


@dataclass(frozen=True, slots=True)
class RequirementMissed:
    """A requirement of the scenario that some cases miss, of all that were evaluated.

    name, text: as in its file.
    """

    name: str
    text: str
    cases: int
    of: int


ScoreNote = (
    DrivesLeftOut
    | Compared
    | DrivenAlone
    | DrivenInBlocks
    | Counted
    | BeyondRange
    | ThinReferences
    | PlausibleTo
    | CasesMissing
    | ReferenceMissing
    | WorstAndBest
    | RequirementMissed
)
"""Kinds of remarks on a score."""


@dataclass(frozen=True, slots=True)
class ScenarioResult:
    """One ADS in one logical scenario: C, D, S, the scores that order ADSs, and what stands beside
    them.

    c None: no case, or no collision, could be evaluated. d None: not computed, see `d_reason`. s
    None: neither C nor D. task_share T and s_plus S+ (None without a safe point),
    avoided_share A (w = r) and its grade avoidance_grade A', avoided_share_exposure (w = p), regret
    m/s, human_likeness H (None: see `h_reason`); None where nothing could be evaluated.

    a_points and h_points: T A' a and T A' b H, the terms of S+.
    departures, gave_up: numbers of such cases.
    task_reference: the reference car of T; "": the run holds none, and T has the drivers alone.

    collisions = avoidable_collisions (the ideal vehicle avoids) + unavoidable_collisions (it
    collides as well) + those whose ideal vehicle could not be evaluated.

    caused_collisions: the avoidable ones that doing nothing avoids too.

    <name>_interval: the 95 % interval of each score, from the points, the drivers and the
    collisions that were not seen (`sumo_eval.scoring.confidence.intervals`), each end moved to
    where the score lies when the cases that could not be evaluated are counted as worst and as best
    (the worst of a missing safe case is a collision: then S has no D). None where there are fewer
    than two evaluated cases, and nothing is missing.

    half_widths_by_source: of S and S+ by points (`cases`) and by drivers alone.
    """

    ads: str
    scenario: str
    c: float | None
    d: float | None
    d_reason: NotComputed | None
    s: float | None
    c_points: float
    d_points: float
    cases: int
    safe_cases: int
    hazardous_cases: int
    collisions: int
    safe_collisions: int
    avoidable_collisions: int
    collision_probability: float
    off_road: int
    not_evaluated: int
    notes: tuple[ScoreNote, ...]
    c_interval: tuple[float, float] | None = None
    d_interval: tuple[float, float] | None = None
    s_interval: tuple[float, float] | None = None
    avoided_share: float | None = None
    avoided_share_exposure: float | None = None
    regret: float | None = None
    human_likeness: float | None = None
    h_reason: NotComputed | None = None
    s_plus: float | None = None
    a_points: float = 0.0
    h_points: float = 0.0
    avoided_share_interval: tuple[float, float] | None = None
    avoided_share_exposure_interval: tuple[float, float] | None = None
    regret_interval: tuple[float, float] | None = None
    human_likeness_interval: tuple[float, float] | None = None
    s_plus_interval: tuple[float, float] | None = None
    unavoidable_collisions: int = 0
    struck_from_behind: int = 0
    caused_collisions: int = 0
    half_widths_by_source: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    requirements_missed: int | None = None
    task_share: float | None = None
    avoidance_grade: float | None = None
    departures: int = 0
    gave_up: int = 0
    task_reference: str = ""
    task_share_interval: tuple[float, float] | None = None
    avoidance_grade_interval: tuple[float, float] | None = None

    @property
    def nobody_compared(self) -> bool:
        """Whether the scenario has no drivers to compare an ADS with, so that no ADS has D or H
        in it.
        """
        return self.h_reason == NotComputed("no_drivers")

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        shown: str = load_object(_SCORE, None, "Score")(self)
        return shown


@dataclass(frozen=True, slots=True)
class ZoneResult:
    """The partition of one logical scenario.

    boundary_error: share of the possible points on the wrong side of the exact zone;
    boundary_error_box: the same over the whole box of parameters, impossible points included.
    """

    scenario: str
    zones: int
    hazardous_share: float
    most_dangerous: tuple[Mapping[str, float], ...]
    boundary_error: float
    boundary_error_box: float
    sampled: int
    refused: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RankedAds:
    """An ADS in the order of an evaluation.

    s_plus: the mean over its scenarios by their weights, with its interval; None, like place, where
        a scenario that weighs and has a task has no S+ of it.
    a_points, h_points: its two terms, T A' a and T A' b H.
    """

    ads: str
    place: int | None
    s_plus: float | None
    interval: tuple[float, float] | None
    a_points: float | None = None
    h_points: float | None = None


@dataclass(frozen=True, slots=True)
class RankedPair:
    """S+ of one ADS less that of another that does not stand above it.

    interval: of the difference, both over the same points and drivers.
    told_apart: whether it leaves out 0. None: one of both has no interval.
    """

    above: str
    below: str
    difference: float
    interval: tuple[float, float] | None
    told_apart: bool

    @property
    def scored_alike(self) -> bool:
        """Whether both scored alike in every case that weighs: their difference is 0, exactly."""
        return self.interval == (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Ranking:
    """ADSs in the order of S+ over all scenarios; neighbours that cannot be told apart share a
    place.

    weights: of every scenario.
    level: of the intervals.
    pairs: all, by the order of `ads`.
    without_people: scenarios that weigh and have no drivers to compare with: there H counts 0.
    without_task: scenarios that weigh and have no safe point, so no S+: they have no part in the
        order.
    """

    weights: Mapping[str, float]
    level: float
    ads: tuple[RankedAds, ...]
    pairs: tuple[RankedPair, ...]
    without_people: tuple[str, ...] = ()
    without_task: tuple[str, ...] = ()

    @property
    def with_people(self) -> int:
        """Number of scenarios that weigh and have drivers to compare with."""
        return sum(weight > 0.0 for weight in self.weights.values()) - len(self.without_people)

    def pair(self, above: str, below: str) -> RankedPair:
        """The pair of these two."""
        return next(pair for pair in self.pairs if (pair.above, pair.below) == (above, below))


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A scored run.

    cases: of every ADS in every scenario, read from the run's folder when they are asked for.
    ranking: None without an order of its ADSs.
    scenarios: the logical scenarios by name.
    """

    name: str
    folder: Path
    settings: EvaluationSettings
    manifest: Mapping[str, Any]
    zones: tuple[ZoneResult, ...]
    scores: tuple[ScenarioResult, ...]
    cases: CaseTable
    exposures: Mapping[str, Any] = field(
        default_factory=dict
    )  # by scenario, as `drivers.recorded.exposure.RunExposure.plain` has it
    ranking: Ranking | None = None
    scenarios: Mapping[str, LogicalScenario] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # records may be given in its place
        object.__setattr__(self, "cases", CaseTable.of(self.cases))

    @property
    def source(self) -> Path:
        """Folder where relative paths of its settings start."""
        return Path(str(self.manifest.get("source_folder", ".")))

    @property
    def resolved(self) -> Resolved:
        """Its settings and scenarios."""
        return Resolved(self.settings, self.source, self.scenarios)

    @property
    def checks(self) -> dict[str, dict[str, str]]:
        """Names and conditions of what scenarios require, by scenario."""
        return {
            name: {one.name: one.text for one in logical.requirements.all}
            for name, logical in self.scenarios.items()
            if logical.requirements is not None
        }

    @property
    def not_evaluated(self) -> int:
        """Number of cases without an outcome that counts."""
        return sum(score.not_evaluated for score in self.scores)

    def exposure_known(self, scenario: str | None = None) -> bool:
        """Whether the frequency of the concrete scenarios of one scenario, or of any, was declared
        or measured.

        Else a mean over them is one over the points, and no share of encounters.
        """
        names = [zone.scenario for zone in self.zones] if scenario is None else [scenario]
        return any(self.exposures.get(name, {}).get("known", False) for name in names)

    def cases_of(self, ads: str, scenario: str) -> CaseTable:
        """The cases of one ADS in one scenario."""
        return self.cases.part(scenario, ads)

    def cases_in(self, scenario: str) -> CaseTable:
        """The cases of all ADSs in one scenario."""
        return self.cases.part(scenario)

    @property
    def ads_names(self) -> list[str]:
        """Names of its ADSs, in the order of the scores."""
        return list(dict.fromkeys(score.ads for score in self.scores))

    def scores_in(self, scenario: str) -> list[ScenarioResult]:
        """The results of all ADSs in one scenario."""
        return [score for score in self.scores if score.scenario == scenario]

    def case(self, key: str) -> CaseResult | None:
        """A case by its key; None where there is none."""
        return next(iter(self.cases[np.flatnonzero(self.cases.case == key)]), None)

    def score(self, ads: str, scenario: str) -> ScenarioResult:
        """The result of one ADS in one scenario.

        Raises InputError where there is none.
        """
        names = dict.fromkeys(score.scenario for score in self.scores)
        check_known("scenario of this evaluation", names, scenario)
        there = {score.ads: score for score in self.scores_in(scenario)}
        check_known(f"ADS of scenario `{scenario}`", there, ads)
        return there[ads]

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        table: str = load_object(_TABLE, None, "Table")(self)
        return table

    def plot(self) -> Any:
        """S+ of every ADS with its interval as a figure of matplotlib, which the extra `plots`
        brings.
        """
        return load_object(_PICTURE, None, "Picture")(self)
