"""Every constant of the method and of the simulation, once: default, unit, symbol, equation, bounds.

The `Annotated` bounds are the only place where a limit is written: direct construction checks them here, and
`sumo_eval.settings.config` hands the same annotations to the reader of evaluation.toml.
"""

from __future__ import annotations

import functools
import json
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, get_args, get_origin, get_type_hints
from urllib.parse import urlencode

from annotated_types import Ge, Gt, Le, Lt, MinLen

from sumo_eval.errors import must_be


@dataclass(frozen=True, slots=True)
class About:
    """What a setting means, for the documentation, the schema and the report."""

    text: str
    unit: str = ""
    symbol: str = ""
    equation: str = ""


Positive = Gt(0.0)
NotNegative = Ge(0.0)


@functools.lru_cache(maxsize=64)
def _hints(cls: Any) -> dict[str, Any]:
    return get_type_hints(cls, include_extras=True)


def about(cls: type, name: str) -> About:
    """The `About` of a setting (an empty one where a setting has none)."""
    hint = _hints(cls)[name]
    for extra in getattr(hint, "__metadata__", ()):
        if isinstance(extra, About):
            return extra
    return About("")


_KINDS: dict[object, tuple[type, str]] = {
    float: (Real, "a number"), int: (Integral, "a whole number"), bool: (bool, "true or false"), str: (str, "a text"),
}  # fmt: skip
_CHECKS: tuple[tuple[type, str, Callable[[Any, Any], bool], str], ...] = (
    (Gt, "gt", operator.gt, "greater than"),
    (Ge, "ge", operator.ge, "at least"),
    (Lt, "lt", operator.lt, "less than"),
    (Le, "le", operator.le, "at most"),
)


class Checked:
    """Base of all settings: refuses a value outside the bounds that its annotation states."""

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        cls: type = type(self)
        owner = f"`{cls.__name__}`"
        for rule in _rules(cls):
            value = getattr(self, rule.name)
            if value is None and rule.optional:
                continue
            if rule.choices and value not in rule.choices:
                raise must_be(f"`{rule.name}`", owner, "one of " + ", ".join(map(repr, rule.choices)), value)
            kind = rule.kind
            if not isinstance(value, kind) or (isinstance(value, bool) and kind in (Real, Integral)):
                raise must_be(f"`{rule.name}`", owner, rule.words, value)
            if isinstance(value, float) and not math.isfinite(value):
                words = "a finite number" if math.isinf(value) else "a number"
                raise must_be(f"`{rule.name}`", owner, words, value)
            for holds, bound, words in rule.bounds if value is not None else ():
                if not holds(value, bound):
                    raise must_be(f"`{rule.name}`", owner, f"{words} {bound:g}", value)


class _Rule(NamedTuple):
    """What the annotation of a setting demands of its value."""

    name: str
    optional: bool
    choices: tuple[Any, ...]
    kind: type
    words: str
    bounds: tuple[tuple[Callable[[Any, Any], bool], Any, str], ...]


@functools.lru_cache(maxsize=64)
def _rules(cls: Any) -> tuple[_Rule, ...]:
    """Worked out once for a class: settings are made for every case."""
    found = []
    for item in fields(cls):
        hint = _hints(cls)[item.name]
        base = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        choices = get_args(base) if get_origin(base) is Literal else ()
        kind, words = _KINDS.get(base, (object, ""))
        bounds = tuple(
            (holds, getattr(extra, attribute), words)
            for extra in getattr(hint, "__metadata__", ())
            for bound, attribute, holds, words in _CHECKS
            if isinstance(extra, bound)
        )
        found.append(_Rule(item.name, type(None) in get_args(base), choices, kind, words, bounds))
    return tuple(found)


# --- the method -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FieldSettings(Checked):
    """Trajectory field, Eqs. 9-10. The paper prints no values; these were chosen on recorded motorway approaches."""

    k1: Annotated[
        float, NotNegative, Le(20.0), About("decay of the field with distance", symbol="k1", equation="10")
    ] = 0.5
    k2: Annotated[float, NotNegative, Le(1.0), About("growth of the field with speed ahead", "s/m", "k2", "10")] = 0.005
    sample_interval: Annotated[float, Positive, About("time between summed samples", "s", equation="9")] = 0.1
    superposition: Annotated[
        Literal["magnitude", "vector"],
        About("sum magnitudes (the paper's peak lies on the path) or vectors (as printed)", equation="9"),
    ] = "magnitude"


@dataclass(frozen=True, slots=True)
class AnthropomorphicSettings(Checked):
    """Anthropomorphic index D, Eqs. 11-13."""

    field: FieldSettings = field(default_factory=FieldSettings)
    mode: Annotated[
        Literal["gaussian", "mixture"],
        About(
            "one Gaussian over all drivers (the paper), or one for each manoeuvre, times how usual the manoeuvre is",
            equation="11",
        ),
    ] = "gaussian"
    manoeuvre_time: Annotated[
        float, Positive, About("time a lane must be kept to be part of a manoeuvre (mixture)", "s", equation="11")
    ] = 1.0
    pooled_drivers: Annotated[
        float,
        Positive,
        About("drivers that the deviation pooled over all manoeuvres counts as (mixture)", equation="11"),
    ] = 2.0
    band_slice_spacing: Annotated[
        float,
        Positive,
        About("distance between slices where drivers are scored against each other", "m", equation="11"),
    ] = 2.5
    slice_spacing: Annotated[float, Positive, About("distance between slices along the road", "m", equation="11")] = 0.5
    side_width: Annotated[float, Positive, About("reach of a slice to each side of the centre", "m", equation="11")] = (
        1.5
    )
    points_per_side: Annotated[
        int, Ge(1), Le(1_000), About("sample points on each side of the centre", equation="11")
    ] = 3
    centre_deviation_floor: Annotated[
        float, Ge(1e-6), About("smallest deviation of the human centre", "m", equation="12")
    ] = 0.15
    field_deviation_floor: Annotated[
        float, Ge(1e-6), About("smallest deviation of the human field, as a share of its mean", equation="12")
    ] = 0.01
    steering_rule: Annotated[
        Literal["manoeuvre", "wheel"],
        About(
            "what a steering operation is, of the ADS and of the drivers: a lateral manoeuvre (over 0.12 m/s to one "
            "side over at least 1 m), or the wheel past its threshold; `wheel` needs both to have a steering signal",
            equation="12",
        ),
    ] = "manoeuvre"
    steering_threshold_deg: Annotated[
        float, Positive, About("steering wheel angle above which an operation begins (wheel)", "deg", "k3", "12")
    ] = 10.0
    steering_lateral_acceleration: Annotated[
        float | None,
        Positive,
        About(
            "in place of that angle: the operation begins at the wheel angle that gives this lateral acceleration at "
            "the speed driven (wheel)",
            "m/s2",
            equation="12",
        ),
    ] = None
    steering_ratio: Annotated[
        float, Positive, About("steering wheel angle over road wheel angle, where an acceleration is the threshold")
    ] = 16.0
    wheelbase: Annotated[
        float, Positive, About("distance between the axles, where an acceleration is the threshold", "m")
    ] = 2.7
    acceleration_threshold: Annotated[
        float, Positive, About("longitudinal acceleration above which an operation begins", "m/s2", "k4", "12")
    ] = 0.5
    neutral_time: Annotated[
        float,
        NotNegative,
        About("time the signal must stay neutral for an operation to have ended", "s", equation="12"),
    ] = 0.5
    stop_speed: Annotated[float, Positive, About("speed below which a vehicle counts as stopped", "m/s", "L", "12")] = (
        0.1
    )


@dataclass(frozen=True, slots=True)
class ZoneSettings(Checked):
    """Safe and hazardous zones, Eqs. 1-8."""

    deceleration: Annotated[float, Ge(0.01), About("ideal braking deceleration of the zones", "m/s2", "a", "5")] = 5.0
    critical_inverse_ttc: Annotated[
        float, Ge(0.001), About("inverse TTC from which a point is hazardous", "1/s", "ITTC*", "6")
    ] = 0.7
    target: Annotated[
        Literal["squared_time", "label"],
        About("what the GP learns: a smooth function of max ITTC, or plain +1/-1 labels", equation="7"),
    ] = "squared_time"
    target_scale: Annotated[float, Positive, About("scale of the squared-time target", "s2", equation="7")] = 10.0
    restarts: Annotated[int, Ge(0), Le(1_000), About("restarts of the GP's hyperparameter search", equation="8")] = 4
    refinements: Annotated[
        int,
        Ge(0),
        Le(1_000),
        About("rounds in which training points are added where the GP is wrong, while that is over 1 %"),
    ] = 3
    grid_points: Annotated[
        int, Ge(1_000), Le(10_000_000), About("points on which zones are separated and searched")
    ] = 60_000


@dataclass(frozen=True, slots=True)
class CollisionSettings(Checked):
    """Collision avoidance index C, Eqs. 14-17, and the ideal vehicle it is relative to."""

    loss: Annotated[
        Literal["severity", "class"], About("compare U (as printed) or the loss class L", equation="17")
    ] = "severity"
    severity: Annotated[
        str,
        MinLen(1),
        About(
            "what stands in the place of U: severity (U of Eq. 15), eq14 (its class L), injury:car_driver, "
            "injury:pedestrian, injury:cyclist, or package.module:function from a Contact to a loss in 0..1",
            symbol="U",
            equation="15",
        ),
    ] = "severity"
    age: Annotated[
        float | None, Positive, Le(120.0), About("age of who is hit, for injury risks; default: the curve's own", "a")
    ] = None
    ego_mass: Annotated[float, Positive, About("mass of the ego, for severities of one's own", "kg")] = 1500.0
    other_mass: Annotated[float, Positive, About("mass of what it hits, for severities of one's own", "kg")] = 1500.0

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.loss == "class" and self.severity not in ("severity", "eq14"):
            raise must_be(
                "`severity`", "`CollisionSettings`", "'severity' or 'eq14' beside `loss` 'class'", self.severity
            )
        if self.severity == "eq14":  # two names of one choice
            object.__setattr__(self, "loss", "class")


@dataclass(frozen=True, slots=True)
class ScoreSettings(Checked):
    """Combined score S, Eq. 18."""

    a: Annotated[
        float, NotNegative, Le(100.0), About("points for collision avoidance; b = 100 - a", symbol="a", equation="18")
    ] = 50.0
    k5: Annotated[float, Positive, About("scale of C", symbol="k5", equation="18")] = 1.0
    k6: Annotated[float, Positive, About("scale of D", symbol="k6", equation="18")] = 1.0

    @property
    def b(self) -> float:
        """Points for human-likeness: b = 100 - a."""
        return 100.0 - self.a


@dataclass(frozen=True, slots=True)
class RankingSettings(Checked):
    """The order of the ADSs of an evaluation by S+."""

    weights: Annotated[
        dict[str, float],
        About("weight of a scenario in the mean S+ that ADSs are ranked by, by name; others weigh 1"),
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        for name, weight in self.weights.items():
            number = isinstance(weight, Real) and not isinstance(weight, bool) and math.isfinite(weight)
            if not (number and weight >= 0.0):
                raise must_be(f"`weights.{name}`", "the ranking", "a number of at least 0", weight)


@dataclass(frozen=True, slots=True)
class MethodSettings(Checked):
    """Everything that turns recorded facts into scores."""

    zones: ZoneSettings = field(default_factory=ZoneSettings)
    anthropomorphic: AnthropomorphicSettings = field(default_factory=AnthropomorphicSettings)
    collision: CollisionSettings = field(default_factory=CollisionSettings)
    score: ScoreSettings = field(default_factory=ScoreSettings)
    ranking: RankingSettings = field(default_factory=RankingSettings)


# --- the simulation ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class VehicleSettings(Checked):
    """The ego as a machine: a kinematic single-track model with limited steering, tyres, brakes and drive."""

    length: Annotated[float, Positive, About("body length", "m")] = 4.5
    width: Annotated[float, Positive, About("body width", "m")] = 1.8
    wheelbase: Annotated[float, Positive, About("distance between the axles", "m")] = 2.7
    steering_ratio: Annotated[float, Positive, About("steering wheel angle over road wheel angle")] = 16.0
    max_steering_wheel_angle_deg: Annotated[float, Positive, About("end stop of the steering wheel", "deg")] = 540.0
    max_steering_wheel_rate_deg: Annotated[float, Positive, About("fastest turn of the steering wheel", "deg/s")] = (
        720.0
    )
    friction: Annotated[float, Positive, About("tyre-road friction coefficient: bounds the total acceleration")] = 0.92
    max_acceleration: Annotated[float, Positive, About("strongest drive", "m/s2")] = 4.0
    max_deceleration: Annotated[float, Positive, About("strongest braking", "m/s2")] = 9.0
    brake_build_up: Annotated[float, Positive, About("time from no braking to the strongest, linear", "s")] = 0.15
    drive_jerk: Annotated[float, Positive, About("fastest rise of drive", "m/s3")] = 10.0
    max_speed: Annotated[float, Positive, About("top speed", "m/s")] = 60.0

    @property
    def brake_jerk(self) -> float:
        """Rate at which braking builds up, m/s3."""
        return self.max_deceleration / self.brake_build_up


@dataclass(frozen=True, slots=True)
class ConditionSettings(Checked):
    """What stands between the world and the ADS under test. By default nothing: all is seen, and obeyed, at once.

    The first seven hold for controllers that are given an `Observation` (`act(obs)`, `exec:`, `fmu:`): TraCI shows
    everything. Neither the ideal vehicle nor the human drivers are under these conditions.
    """

    perception_delay: Annotated[float, NotNegative, About("age of what is seen of other vehicles", "s")] = 0.0
    dropout: Annotated[float, NotNegative, Le(1.0), About("chance that a vehicle is missed at a step")] = 0.0
    position_noise: Annotated[
        float, NotNegative, About("standard deviation of seen positions, along and across the road", "m")
    ] = 0.0
    speed_noise: Annotated[float, NotNegative, About("standard deviation of seen speeds along the road", "m/s")] = 0.0
    sensor_range: Annotated[
        float | None, Positive, About("farthest other vehicle that is seen, centre to centre; default: no limit", "m")
    ] = None
    field_of_view_deg: Annotated[
        float | None, Positive, Le(360.0), About("angle in front of the ego that is seen; default: all around", "deg")
    ] = None
    occlusion: Annotated[bool, About("a vehicle covered to 80 % of its width by a nearer one is not seen")] = False
    actuation_delay: Annotated[float, NotNegative, About("time until a Command reaches the vehicle", "s")] = 0.0
    step_budget: Annotated[
        float | None,
        Positive,
        About("wall time of a step after which its Command is late and the last one holds; default: none", "s"),
    ] = None
    interference: Annotated[
        Literal["refuse", "record"],
        About("an ADS that touches other vehicles, the road or the clock: ends its case, or is put on record"),
    ] = "refuse"
    reveal_scenario: Annotated[bool, About("tell the ADS the scenario's name and its parameters' values")] = False


@dataclass(frozen=True, slots=True)
class FmuSettings(Checked):
    """Which variables of an FMU carry what; names that are not mapped are looked for as they are."""

    inputs: Annotated[dict[str, str], About("input of the FMU = signal that it is given")] = field(default_factory=dict)
    outputs: Annotated[dict[str, str], About("what is read = output of the FMU")] = field(default_factory=dict)
    parameters: Annotated[
        dict[str, float | int | bool | str], About("parameter of the FMU = its value, or a signal at the start")
    ] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PlantSettings(FmuSettings):
    """An FMU as the ego's vehicle model, in place of the single-track model."""

    file: Annotated[str, MinLen(1), About("the FMU, relative to the evaluation file")] = ""


@dataclass(frozen=True, slots=True)
class SimulationSettings(Checked):
    """How SUMO steps a case and when a case ends."""

    step: Annotated[float, Positive, Le(0.1), About("step of SUMO and of the controller", "s")] = 0.05
    record_interval: Annotated[float, Positive, Le(0.1), About("time between recorded samples", "s")] = 0.1
    time_limit: Annotated[float, Positive, About("longest simulated time of a case", "s")] = 150.0
    standstill_speed: Annotated[float, Positive, About("speed below which the ego stands", "m/s")] = 0.1
    standstill_time: Annotated[float, Positive, About("time the ego must stand for the case to end", "s")] = 2.0
    lane_change_duration: Annotated[
        float, Positive, About("duration of a lane change that SUMO itself performs for the ego", "s")
    ] = 5.0
    seen_over_line: Annotated[
        float,
        NotNegative,
        Le(2.0),
        About(
            "vehicles that react see a body in their lane once it reaches so far over the line; at the latest when the "
            "middle of its front is there",
            "m",
        ),
    ] = 0.0
    end_when_decided: Annotated[
        bool,
        About(
            "end a case as soon as no contact can come of it; quicker where only collisions count, but shorter drives "
            "change D"
        ),
    ] = False
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    ideal_deceleration: Annotated[float, Positive, About("braking of the ideal vehicle", "m/s2", "Ug", "17")] = 9.0
    ideal_build_up: Annotated[float, Positive, About("its pressure build-up time", "s", "Ug", "17")] = 0.15
    ideal_visible_share: Annotated[
        float,
        NotNegative,
        Le(1.0),
        About("share of a hidden vehicle's width that must show for it to see it; 0: it sees through", "", "Ug", "17"),
    ] = 0.2
    conditions: ConditionSettings = field(default_factory=ConditionSettings)
    plant: Annotated[PlantSettings | None, About("an FMU as vehicle model of the ADSs under test")] = None


@dataclass(frozen=True, slots=True)
class PopulationSettings(Checked):
    """The synthetic drivers, as far as they may be told to differ from the recorded ones that they were fitted to."""

    overtake_share: Annotated[float, NotNegative, Le(1.0), About("share who overtake a slower leader")] = 0.771
    headway_scale: Annotated[float, Positive, About("factor on everybody's desired time headway (IDM)", symbol="T")] = (
        1.0
    )
    reaction_scale: Annotated[float, Positive, About("factor on everybody's reaction time")] = 1.0
    lane_change_scale: Annotated[float, Positive, About("factor on the duration of everybody's lane changes")] = 1.0


@dataclass(frozen=True, slots=True)
class DriverSettings(Checked):
    """The skilled human drivers that D compares with."""

    count: Annotated[int, Ge(2), Le(10_000), About("number of drivers in each concrete scenario")] = 10
    population: PopulationSettings = field(default_factory=PopulationSettings)
    source: Annotated[
        str,
        About("`synthetic`, `recorded`, or package.module:function from concrete scenario to trajectories"),
    ] = "synthetic"
    recordings: Annotated[
        tuple[str, ...], About("canonical tables of recorded driving, as `sumo-eval humans import` writes them")
    ] = ()
    cases: Annotated[str, About("folder of drives recorded in named cases, with its cases.csv; empty: none")] = ""
    tolerance: Annotated[
        dict[str, float] | None,
        About("how far an event's parameter may be from the concrete scenario's, by parameter; others keep their own"),
    ] = None
    least: Annotated[int, Ge(2), About("recorded drivers below which a reference is too thin")] = 10
    too_thin: Annotated[
        Literal["fill", "leave_out"],
        About("a reference that is too thin is filled from the synthetic population, or its case gets no D_i"),
    ] = "fill"
    coverage: Annotated[
        float, Positive, Le(1.0), About("share of the road that a recorded drive must cover to be compared with")
    ] = 0.8


@dataclass(frozen=True, slots=True)
class RunSettings(Checked):
    """How the cases are worked off."""

    workers: Annotated[int, Ge(1), Le(1_000), About("processes that simulate cases")] = 2
    case_timeout: Annotated[float, Positive, Le(1e6), About("wall time a case may take", "s")] = 60.0
    step_timeout: Annotated[float, Positive, Le(1e6), About("wall time one controller step may take", "s")] = 1.0
    memory_limit: Annotated[float, Ge(256.0), Le(1e8), About("memory that the process of a case may fill", "MB")] = (
        4096.0
    )
    cases_per_child: Annotated[int, Ge(1), About("cases after which a child process is replaced by a fresh one")] = 500
    cases_per_pack: Annotated[
        int,
        Ge(1),
        Le(512),
        About("cases simulated together at most where the driver of the ego has a form for many; 1: each alone"),
    ] = 512
    engine: Annotated[
        Literal["processes", "serial", "dask"],
        About("where cases run: in child processes, in this process without isolation, or on a Dask cluster"),
    ] = "processes"
    scheduler: Annotated[str, About("address of the Dask cluster's scheduler, e.g. tcp://host:8786")] = ""
    incomplete: Annotated[
        Literal["shown", "gate"],
        About("what cases that could not be evaluated do: widen C and D visibly (exit 3), or fail the run (exit 1)"),
    ] = "shown"


@dataclass(frozen=True, slots=True)
class ReportSettings(Checked):
    """What the report and the JUnit file show. Scores do not depend on it."""

    reference: Annotated[
        str,
        MinLen(1),
        About(
            "name or controller of the ADS that decides what was preventable; the ideal vehicle if none is so called"
        ),
    ] = "careful_driver"
    junit: Annotated[
        Literal["case", "cell"], About("a JUnit test for each concrete scenario, or for each cell of the space")
    ] = "case"
    junit_cells: Annotated[int, Ge(1), Le(100), About("cells on each axis of the space, for JUnit tests by cell")] = 4
    junit_failures: Annotated[
        Literal["any", "avoidable"],
        About("which collisions are JUnit failures: those that the ideal vehicle avoids, or any"),
    ] = "avoidable"
    axes: Annotated[
        dict[str, tuple[str, str]],
        About("the two parameters that a scenario's maps show, by scenario; others: the two with most values"),
    ] = field(default_factory=dict)


# --- an evaluation ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SamplingSettings(Checked):
    """Which concrete scenarios of a space are simulated."""

    method: Annotated[
        str | None,
        About(
            "how points are chosen: grid, pairwise, combinations, latin_hypercube, sobol, halton, exposure, "
            "exposure_danger, file, openscenario, module:name, or a sample that the scenario names; default: the scenario's own"  # noqa: E501
        ),
    ] = None
    levels: Annotated[
        int | dict[str, int] | None,
        About("points on each axis, one number or by parameter; default: the space's steps"),
    ] = None
    steps: Annotated[dict[str, float] | None, About("step by parameter name; others keep the space's own")] = None
    count: Annotated[int | None, Ge(1), About("number of points, of methods that draw them")] = None
    strength: Annotated[int | None, Ge(1), About("t of `combinations`: every combination of t parameters' values")] = (
        None
    )
    file: Annotated[str | None, About("CSV of points, or mapping of an OpenSCENARIO variation")] = None


@dataclass(frozen=True, slots=True)
class DeclaredDistribution(Checked):
    """How one parameter is distributed on the road, as somebody declares it."""

    distribution: Annotated[Literal["normal", "lognormal", "uniform"], About("which family")]
    first: Annotated[float, About("mean; mean of the logarithm; low")]
    second: Annotated[float, About("deviation; deviation of the logarithm; high")]

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.distribution == "uniform" and not self.second > self.first:
            raise must_be("`second`", "a uniform distribution", f"greater than `first` ({self.first:g})", self.second)
        if self.distribution != "uniform" and not self.second > 0.0:
            raise must_be("`second`", f"a {self.distribution} distribution", "greater than 0", self.second)


@dataclass(frozen=True, slots=True)
class ExposureSettings(Checked):
    """How often the concrete scenarios of a space are met on the road: p_i of Eq. 13."""

    kind: Annotated[
        Literal["scenario", "uniform", "recorded", "declared"],
        About("the scenario's own, uniform, from recorded events, or declared", symbol="p_i", equation="13"),
    ] = "scenario"
    recordings: Annotated[
        tuple[str, ...], About("canonical tables of recorded driving; none: those of the drivers")
    ] = ()
    bandwidth: Annotated[Literal["scott", "cross_validated"], About("bandwidth of the KDE over recorded events")] = (
        "scott"
    )
    declared: Annotated[
        dict[str, DeclaredDistribution] | None, About("distribution by parameter; others are uniform")
    ] = None


@dataclass(frozen=True, slots=True)
class ScenarioSettings(Checked):
    """One logical scenario of an evaluation."""

    use: Annotated[str, About("a shipped name, a scenario file (.toml) or module:name")]
    sampling: SamplingSettings = field(default_factory=SamplingSettings)
    exposure: ExposureSettings = field(default_factory=ExposureSettings)


@dataclass(frozen=True, slots=True)
class AdsSettings(Checked):
    """One ADS under test."""

    name: Annotated[str, MinLen(1), About("what the tables call it")]
    controller: Annotated[
        str, About("a shipped name, module:name, file.py:name, sumo:MODEL, exec:COMMAND, traci:COMMAND or fmu:FILE")
    ]
    fmu: Annotated[FmuSettings | None, About("variables of the FMU, where the controller is one")] = None

    @property
    def locator(self) -> str:
        """The controller with everything that belongs to it, in one text: `fmu:acc.fmu?inputs.v=ego_speed`."""
        if self.fmu is None:
            return self.controller
        pairs = [
            (f"{group}.{name}", value if isinstance(value, str) else json.dumps(value))
            for group in ("inputs", "outputs", "parameters")
            for name, value in getattr(self.fmu, group).items()
        ]
        return f"{self.controller}?{urlencode(pairs)}" if pairs else self.controller


@dataclass(frozen=True, slots=True)
class EvaluationSettings(Checked):
    """Everything an evaluation depends on: the content of evaluation.toml, defaults filled in."""

    name: Annotated[str, MinLen(1), About("name of the evaluation")]
    scenario: Annotated[tuple[ScenarioSettings, ...], About("logical scenarios")]
    ads: Annotated[tuple[AdsSettings, ...], About("ADSs under test")]
    seed: Annotated[int, Ge(0), About("the only source of randomness")] = 1
    drivers: DriverSettings = field(default_factory=DriverSettings)
    run: RunSettings = field(default_factory=RunSettings)
    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    method: MethodSettings = field(default_factory=MethodSettings)
    report: ReportSettings = field(default_factory=ReportSettings)
