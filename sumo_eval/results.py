"""What an evaluation finds out: a record for each case, one for each ADS in each scenario, plain values throughout."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

from sumo_eval.method.anthropomorphic import IndexNote
from sumo_eval.settings import EvaluationSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.trajectory import Alone

Zone = Literal["safe", "hazardous"]

# texts, because words and pictures are made in a room that builds on this one
_TABLE, _PICTURE = "sumo_eval.report.notebook:html_table", "sumo_eval.report.notebook:picture"
_CASE, _SCORE = "sumo_eval.report.notebook:case_html", "sumo_eval.report.notebook:score_html"

EVALUATED = ("ok", "collision", "off_road")
"""Statuses of cases whose outcome counts; all others could not be evaluated."""
GAVE_UP = ("ads_error", "ads_timeout", "timeout", "crashed", "rejected")
"""Statuses of cases that their ADS gave up: they count in T, A, A', H and S+ all the same."""


@dataclass(frozen=True, slots=True)
class ThinReference:
    """A concrete scenario with fewer recorded drivers than an evaluation asks for. filled: synthetic drivers who make
    up for them; None: the case is left out of D instead.
    """

    recorded: int
    least: int
    filled: int | None


@dataclass(frozen=True, slots=True)
class CaseResult:
    """One concrete scenario driven by one ADS. None: does not apply, or could not be evaluated (see `status`).

    severity U and loss L belong to collisions, Eqs. 14-15. ideal_severity Ug and no_reaction_severity U0: those of the
    ideal vehicle and of `no_reaction` in the same concrete scenario, 0 where they avoid, None where their drive could
    not be evaluated, and ideal_error, no_reaction_error: why not. ideal_collided: whether the former hit something.
    weight: r of Eq. 16, of every case.

    departure_time s, departure_speed m/s: when a corner of the body was first more than `road_margin` off the road, and
    departure_severity: U of a contact beside the road at that speed; None where it stayed on the road. task_share: t_i,
    at safe points part of T; None without a reference. no_reaction_severity likewise counts departures, ideal_severity
    contacts alone.

    latency_median and latency_p99: of a step of the ADS, s. latency_reference: median of a fixed piece of work, timed
    between the steps in the same process, s; latency_relative: latency_median over it.

    index (in tables also `d_i`): D_i and its factors, of safe-zone cases without a collision, Eqs. 11-12. Beside it the
    terms of H: operation_tolerance f_n+, mixture_similarity, plausibility (of every evaluated case) and human_likeness,
    which is 0 for a safe case with a collision that the ideal vehicle avoids.

    min_ttc s, max_ittc 1/s, min_thw s, min_gap m, max_drac m/s2, pet s, max_deceleration m/s2, max_jerk m/s3 and
    delta_v m/s as in `sumo_eval.method.measures`; None where a measure is not defined or has no bound. largest_offset
    m, overshoot m, over_line_time s and settling_time s: how the lane was kept. conflict_pet s: PET of the drive where
    somebody's way conflicts with the ego's; undisturbed_pet s and time_to_conflict s: PET of both, and how long until
    the ego is at the conflict area, where nobody reacts. struck_from_behind: a vehicle that
    reacts ran into the ego's rear and is at fault; such a case is not `collided`.

    Safe-zone cases: drivers that D_i is computed from, recorded people among them; reference_note: where they are too
    few; human_low, human_mean, human_high: what these drivers score when each is left out once; bimodal: whether they
    fall into two groups somewhere; manoeuvre of the ADS and the share of drivers who made it (mixture mode).
    exposure_note: whether the point lies outside the support of recorded events. error_place: file, line and function
    of the user's code that the exception in `error` came from. requirements_missed: names of the requirements of the
    scenario that do not hold in the drive, "" where all do, None where nothing is required or nothing was evaluated.
    """

    case: str
    scenario: str
    ads: str
    values: Mapping[str, float]
    zone: Zone
    exposure: float
    status: str
    end_reason: str | None
    error: str | None
    wall_time: float | None
    simulated_time: float | None
    latency_mean: float | None
    latency_max: float | None
    collided: bool
    impact_speed: float | None
    overlap: float | None
    side: str | None
    severity: float | None
    loss: float | None
    ideal_severity: float | None
    weight: float | None
    beats_ideal: bool
    index: float | None
    length_factor: float | None
    operation_factor: float | None
    similarity: float | None
    index_note: tuple[IndexNote, ...]
    clips: str
    ideal_collided: bool | None = None
    min_ttc: float | None = None
    max_ittc: float | None = None
    min_thw: float | None = None
    min_gap: float | None = None
    max_drac: float | None = None
    pet: float | None = None
    max_deceleration: float | None = None
    max_jerk: float | None = None
    delta_v: float | None = None
    drivers: int | None = None
    recorded_drivers: int | None = None
    reference_note: ThinReference | None = None
    human_low: float | None = None
    human_mean: float | None = None
    human_high: float | None = None
    bimodal: bool = False
    manoeuvre: str = ""
    manoeuvre_share: float | None = None
    exposure_note: Literal["", "outside_support"] = ""
    error_place: str = ""
    no_reaction_severity: float | None = None
    operation_tolerance: float | None = None
    mixture_similarity: float | None = None
    plausibility: float | None = None
    human_likeness: float | None = None
    struck_from_behind: bool = False
    largest_offset: float | None = None
    overshoot: float | None = None
    over_line_time: float | None = None
    settling_time: float | None = None
    requirements_missed: str | None = None
    conflict_pet: float | None = None
    undisturbed_pet: float | None = None
    time_to_conflict: float | None = None
    ideal_error: str = ""
    no_reaction_error: str = ""
    task_share: float | None = None
    departure_time: float | None = None
    departure_speed: float | None = None
    departure_severity: float | None = None
    latency_median: float | None = None
    latency_p99: float | None = None
    latency_reference: float | None = None
    latency_relative: float | None = None

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        shown: str = load_object(_CASE, None, "Case")(self)
        return shown

    @property
    def voids_index(self) -> bool:
        """Whether it is a collision after which there is no D: in the safe zone, and not the ideal vehicle's as well.

        One whose ideal vehicle could not be evaluated is.
        """
        return self.zone == "safe" and self.collided and not self.ideal_severity

    @property
    def counts_for_index(self) -> bool:
        """Whether the case may have a D_i that counts: in the safe zone and without a collision."""
        return self.zone == "safe" and not self.collided and not self.struck_from_behind

    @property
    def departed(self) -> bool:
        """Whether it left the road."""
        return self.departure_time is not None

    @property
    def gave_up(self) -> bool:
        """Whether the ADS gave it up."""
        return self.status in GAVE_UP

    @property
    def incident(self) -> bool:
        """Whether the case holds a contact, a departure or a giving up."""
        return self.collided or self.departed or self.gave_up

    @property
    def incident_severity(self) -> float | None:
        """U of the worst of its incidents, 0 without one; None where the harness failed, or giving up has no U0."""
        if not (self.evaluated or self.gave_up) or (self.gave_up and self.no_reaction_severity is None):
            return None
        idle = (self.no_reaction_severity or 0.0) if self.gave_up else 0.0
        return max((self.severity or 0.0) if self.collided else 0.0, self.departure_severity or 0.0, idle)

    @property
    def avoidable(self) -> bool:
        """Whether it is a collision that the ideal vehicle avoids in the same concrete scenario."""
        return self.collided and self.ideal_severity == 0.0

    @property
    def unavoidable(self) -> bool:
        """Whether it is a collision that the ideal vehicle has as well."""
        return self.collided and bool(self.ideal_severity)

    @property
    def caused(self) -> bool:
        """Whether it is a collision that the ADS brought about: neither the ideal vehicle nor doing nothing has one."""
        return self.avoidable and self.no_reaction_severity == 0.0

    @property
    def evaluated(self) -> bool:
        """Whether the case has an outcome that counts."""
        return self.status in EVALUATED


@dataclass(frozen=True, slots=True)
class NotComputed:
    """Why there is no mean over the safe cases, D or H. collisions: how many in the safe zone left none."""

    why: Literal["collisions", "no_safe_case", "nothing_compared", "no_exposure", "no_drivers"]
    collisions: int = 0


@dataclass(frozen=True, slots=True)
class DrivesLeftOut:
    """Drivers' drives that are no reference, since a skilled driver's safe case ends well: how many, by status."""

    left_out: int
    drives: int
    statuses: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class DrivenAlone:
    """Drives that were to be simulated together with others and had to be done again alone, by the reason."""

    reasons: tuple[tuple[Alone, int], ...]


@dataclass(frozen=True, slots=True)
class DrivenInBlocks:
    """Drives of a policy over arrays, whose bits may depend on which cases it is shown together: how many in blocks
    of how many cases.
    """

    drives: int
    sizes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ActorsLeft:
    """Cases that lasted longer than an actor was on the road: how many."""

    cases: int


@dataclass(frozen=True, slots=True)
class BeyondRange:
    """Collisions outside the range that a severity is known for, by what lies outside, in the severity's own words."""

    severity: str
    reasons: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class ThinReferences:
    """Safe cases with too few recorded drivers: of `safe` ones, and how many are left out of D for it."""

    thin: int
    safe: int
    left_out: int


@dataclass(frozen=True, slots=True)
class OutsideSupport:
    """Cases in which no recorded event is like the concrete scenario, of all."""

    cases: int
    of: int


@dataclass(frozen=True, slots=True)
class PlausibleTo:
    """Whose drives say how plausible a drive is, where the recorded drivers of the run were asked for.

    people: how many recorded drivers the run has in the scenario, with so many drives. least: how many a table needs;
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
    """Cases of an ADS whose reference could not be evaluated, for reasons that differ in no more than their numbers.

    who: the reference. reason: of the first of these cases, which is `example`.
    """

    who: Literal["ideal", "no_reaction"]
    reason: str
    cases: int
    example: str


@dataclass(frozen=True, slots=True)
class WorstAndBest:
    """C, D and S with the missing cases counted as worst and as best; None where nothing is missing."""

    c: tuple[float, float] | None
    d: tuple[float, float] | None
    s: tuple[float, float]


@dataclass(frozen=True, slots=True)
class StruckFromBehind:
    """Cases in which a vehicle that reacts ran into the ego's rear, the other's fault: they are no collision here."""

    cases: int


@dataclass(frozen=True, slots=True)
class GentlerThanIdeal:
    """Collisions in which the ADS was gentler than the ideal vehicle."""

    collisions: int


@dataclass(frozen=True, slots=True)
class ReferencesCollide:
    """Points of the safe zone at which drivers or the reference car collide, of all there with such a drive."""

    points: int
    of: int


@dataclass(frozen=True, slots=True)
class IdealCollidesToo:
    """Collisions in the safe zone that the ideal vehicle has as well, of all there."""

    collisions: int
    of: int


@dataclass(frozen=True, slots=True)
class RequirementMissed:
    """A requirement of the scenario that some cases miss, of all that were evaluated. name, text: as in its file."""

    name: str
    text: str
    cases: int
    of: int


ScoreNote = (
    DrivesLeftOut
    | DrivenAlone
    | DrivenInBlocks
    | ActorsLeft
    | BeyondRange
    | ThinReferences
    | OutsideSupport
    | PlausibleTo
    | CasesMissing
    | ReferenceMissing
    | WorstAndBest
    | StruckFromBehind
    | GentlerThanIdeal
    | IdealCollidesToo
    | ReferencesCollide
    | RequirementMissed
)
"""What a reader must know of a score."""


@dataclass(frozen=True, slots=True)
class ScenarioResult:
    """One ADS in one logical scenario: C, D, S, the scores that order ADSs, and what stands beside them.

    c None: no case, or no collision, could be evaluated. d None: not computed, see `d_reason`. s None: neither C nor D.
    task_share T and s_plus S+ (None where there is no safe point), avoided_share A (w = r) and its grade
    avoidance_grade A', avoided_share_exposure (w = p), regret m/s, human_likeness H (None: see `h_reason`); None where
    nothing could be evaluated. a_points and h_points: T A' a and T A' b H, the terms of S+. departures, gave_up:
    numbers of such cases. task_reference: the reference car of T; "": the run holds none, and T has the drivers alone.

    collisions = avoidable_collisions (the ideal vehicle avoids) + unavoidable_collisions (it collides as well) + those
    whose ideal vehicle could not be evaluated. caused_collisions: the avoidable ones that doing nothing avoids too.

    <name>_interval: the 95 % interval of each score, from the points, the drivers and the collisions that were not seen
    (`sumo_eval.scoring.confidence.intervals`), each end moved to where the score lies when the cases that could not be
    evaluated are counted as worst and as best (the worst of a missing safe case is a collision: then S has no D). None
    where there are fewer than two evaluated cases, and nothing is missing. half_widths_by_source: of S and S+ by points
    (`cases`) and by drivers alone.
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
        """Whether the scenario has nobody to compare an ADS with, so that there is no D and no H for anybody in it."""
        return self.h_reason == NotComputed("no_drivers")

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        shown: str = load_object(_SCORE, None, "Score")(self)
        return shown


@dataclass(frozen=True, slots=True)
class ZoneResult:
    """The partition of one logical scenario.

    boundary_error: share of the possible points on the wrong side of the exact zone; boundary_error_box: the same over
    the whole box of parameters, impossible points included.
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
    """An ADS in the order of an evaluation. s_plus: the mean over its scenarios by their weights, with its interval;
    None, like place, where a scenario that weighs and has a task has no S+ of it. a_points, h_points: its two terms, T
    A' a and T A' b H.
    """

    ads: str
    place: int | None
    s_plus: float | None
    interval: tuple[float, float] | None
    a_points: float | None = None
    h_points: float | None = None


@dataclass(frozen=True, slots=True)
class RankedPair:
    """S+ of one ADS less that of another that does not stand above it. interval: of the difference, both over the same
    points and drivers. told_apart: whether it leaves out 0. None: one of both has no interval.
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
    """ADSs in the order of S+ over all scenarios; neighbours that cannot be told apart share a place.

    weights: of every scenario. level: of the intervals. pairs: all, by the order of `ads`. without_people: scenarios
    that weigh and in which nobody is there to compare with: there H counts 0. without_task: scenarios that weigh and
    have no safe point, so no S+: they have no part in the order.
    """

    weights: Mapping[str, float]
    level: float
    ads: tuple[RankedAds, ...]
    pairs: tuple[RankedPair, ...]
    without_people: tuple[str, ...] = ()
    without_task: tuple[str, ...] = ()

    @property
    def with_people(self) -> int:
        """How many scenarios that weigh have somebody to compare with."""
        return sum(weight > 0.0 for weight in self.weights.values()) - len(self.without_people)

    def pair(self, above: str, below: str) -> RankedPair:
        """The pair of these two."""
        return next(pair for pair in self.pairs if (pair.above, pair.below) == (above, below))


@runtime_checkable
class InParts(Protocol):
    """Rows that know which of them are one ADS's in one scenario, and find one by its name."""

    def part(self, ads: str, scenario: str) -> Sequence[CaseResult]:
        """Those of one ADS in one scenario."""

    def in_scenario(self, scenario: str) -> Sequence[CaseResult]:
        """Those of all ADSs in one scenario."""

    def find(self, case: str) -> CaseResult | None:
        """The row of a case; None where there is none."""

    def columns(self, *names: str) -> Iterator[tuple[Any, ...]]:
        """These fields of all rows, without the rest of them."""


def columns(cases: Iterable[CaseResult], *names: str) -> Iterator[tuple[Any, ...]]:
    """Two or more fields of rows, a tuple a row; of kept rows nothing else is read."""
    return cases.columns(*names) if isinstance(cases, InParts) else map(attrgetter(*names), cases)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A scored run. cases: of every ADS in every scenario, read from the run's folder when they are asked for. ranking:
    None where nobody ranked its ADSs. checks: of each scenario that has requirements, their names and conditions.
    """

    name: str
    folder: Path
    settings: EvaluationSettings
    manifest: Mapping[str, Any]
    zones: tuple[ZoneResult, ...]
    scores: tuple[ScenarioResult, ...]
    cases: Sequence[CaseResult]
    exposures: Mapping[str, Any] = field(
        default_factory=dict
    )  # by scenario, as `drivers.exposure.Exposure.plain` has it
    ranking: Ranking | None = None
    checks: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def not_evaluated(self) -> int:
        """Number of cases without an outcome that counts."""
        return sum(score.not_evaluated for score in self.scores)

    def exposure_known(self, scenario: str | None = None) -> bool:
        """Whether somebody declared or measured how often the concrete scenarios of one scenario, or of any, are met.

        Else a mean over them is one over the points, and no share of encounters.
        """
        names = [zone.scenario for zone in self.zones] if scenario is None else [scenario]
        return any(self.exposures.get(name, {}).get("known", False) for name in names)

    def cases_of(self, ads: str, scenario: str) -> Sequence[CaseResult]:
        """The cases of one ADS in one scenario."""
        if isinstance(self.cases, InParts):
            return self.cases.part(ads, scenario)
        return [case for case in self.cases if (case.ads, case.scenario) == (ads, scenario)]

    def cases_in(self, scenario: str) -> Sequence[CaseResult]:
        """The cases of all ADSs in one scenario."""
        if isinstance(self.cases, InParts):
            return self.cases.in_scenario(scenario)
        return [case for case in self.cases if case.scenario == scenario]

    def case(self, key: str) -> CaseResult | None:
        """A case by its key; None where there is none."""
        if isinstance(self.cases, InParts):
            return self.cases.find(key)
        return next((case for case in self.cases if case.case == key), None)

    def score(self, ads: str, scenario: str) -> ScenarioResult:
        """The result of one ADS in one scenario."""
        return next(score for score in self.scores if (score.ads, score.scenario) == (ads, scenario))

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        table: str = load_object(_TABLE, None, "Table")(self)
        return table

    def plot(self) -> Any:
        """S+ of every ADS with its interval as a figure of matplotlib, which the extra `plots` brings."""
        return load_object(_PICTURE, None, "Picture")(self)
