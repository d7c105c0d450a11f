"""What an evaluation finds out: a record for each case, one for each ADS in each scenario, plain values throughout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from sumo_eval.settings import EvaluationSettings

Zone = Literal["safe", "hazardous"]

EVALUATED = ("ok", "collision", "off_road")
"""Statuses of cases whose outcome counts; all others could not be evaluated."""


@dataclass(frozen=True, slots=True)
class CaseResult:
    """One concrete scenario driven by one ADS. None: does not apply, or could not be evaluated (see `status`).

    severity U, loss L, ideal_severity Ug, weight r and avoided_share (Ug/U or its class form) belong to collisions,
    Eqs. 14-17; index D_i and its factors to safe-zone cases, Eqs. 11-12. ideal_collided: whether the ideal vehicle hit
    something in the same concrete scenario; None where it was not driven, because no ADS collided there.

    min_ttc s, max_ittc 1/s, min_thw s, min_gap m, max_drac m/s2, pet s, max_deceleration m/s2, max_jerk m/s3 and
    delta_v m/s as in `sumo_eval.method.measures`; None where a measure is not defined or has no bound.

    Safe-zone cases: drivers that D_i is computed from, recorded people among them; reference_note: where they are too
    few; human_low, human_mean, human_high: what these drivers score when each is left out once; bimodal: whether they
    fall into two groups somewhere; manoeuvre of the ADS and the share of drivers who made it (mixture mode).
    exposure_note: whether the point lies outside the support of recorded events. error_place: file, line and function
    of the user's code that the exception in `error` came from.
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
    index_note: str
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
    reference_note: str = ""
    human_low: float | None = None
    human_mean: float | None = None
    human_high: float | None = None
    bimodal: bool = False
    manoeuvre: str = ""
    manoeuvre_share: float | None = None
    exposure_note: str = ""
    error_place: str = ""

    @property
    def evaluated(self) -> bool:
        """Whether the case has an outcome that counts."""
        return self.status in EVALUATED


@dataclass(frozen=True, slots=True)
class ScenarioResult:
    """One ADS in one logical scenario: C, D, S and what stands beside them.

    c None: no case, or no collision, could be evaluated. d None: not computed, see `d_reason`.

    c_interval, d_interval, s_interval: where C, D and S lie when the cases that could not be evaluated are counted as
    worst and as best; None where nothing is missing. The worst of a missing safe case is a collision: then S has no D.
    """

    ads: str
    scenario: str
    c: float | None
    d: float | None
    d_reason: str
    s: float
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
    notes: tuple[str, ...]
    c_interval: tuple[float, float] | None = None
    d_interval: tuple[float, float] | None = None
    s_interval: tuple[float, float] | None = None


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
class Evaluation:
    """A scored run."""

    name: str
    folder: Path
    settings: EvaluationSettings
    manifest: Mapping[str, Any]
    zones: tuple[ZoneResult, ...]
    scores: tuple[ScenarioResult, ...]
    cases: tuple[CaseResult, ...]
    exposures: Mapping[str, Any] = field(
        default_factory=dict
    )  # by scenario, as `drivers.exposure.Exposure.plain` has it

    @property
    def not_evaluated(self) -> int:
        """Number of cases without an outcome that counts."""
        return sum(score.not_evaluated for score in self.scores)

    def score(self, ads: str, scenario: str) -> ScenarioResult:
        """The result of one ADS in one scenario."""
        return next(score for score in self.scores if (score.ads, score.scenario) == (ads, scenario))
