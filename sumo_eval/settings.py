"""Every constant of the method and of the simulation, once: default, unit, symbol, equation, bounds.

The `Annotated` bounds are the only place where a limit is written: direct construction checks them here, and
`sumo_eval.config` hands the same annotations to the reader of evaluation.toml.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

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
_CHECKS = ((Gt, "gt", "greater than"), (Ge, "ge", "at least"), (Lt, "lt", "less than"), (Le, "le", "at most"))


class Checked:
    """Base of all settings: refuses a value outside the bounds that its annotation states."""

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        cls: type = type(self)
        for item in fields(self):  # type: ignore[arg-type]
            hint = _hints(cls)[item.name]
            value = getattr(self, item.name)
            owner = f"`{cls.__name__}`"
            base = get_args(hint)[0] if get_origin(hint) is Annotated else hint
            if get_origin(base) is Literal and value not in get_args(base):
                raise must_be(f"`{item.name}`", owner, "one of " + ", ".join(map(repr, get_args(base))), value)
            kind, words = _KINDS.get(base, (object, ""))
            if not isinstance(value, kind) or (isinstance(value, bool) and kind in (Real, Integral)):
                raise must_be(f"`{item.name}`", owner, words, value)
            if isinstance(value, float) and math.isnan(value):
                raise must_be(f"`{item.name}`", owner, "a number", value)
            if value is None:  # its type allows that, and no bound applies to it
                continue
            for extra in getattr(hint, "__metadata__", ()):
                for kind, attribute, words in _CHECKS:
                    if isinstance(extra, kind):
                        bound = getattr(extra, attribute)
                        holds = {"gt": value > bound, "ge": value >= bound, "lt": value < bound, "le": value <= bound}
                        if not holds[attribute]:
                            raise must_be(f"`{item.name}`", owner, f"{words} {bound:g}", value)


# --- the method -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FieldSettings(Checked):
    """Trajectory field, Eqs. 9-10. The paper prints no values; these were chosen on recorded motorway approaches."""

    k1: Annotated[float, NotNegative, About("decay of the field with distance", symbol="k1", equation="10")] = 0.5
    k2: Annotated[float, NotNegative, About("growth of the field with speed ahead", "s/m", "k2", "10")] = 0.005
    sample_interval: Annotated[float, Positive, About("time between summed samples", "s", equation="9")] = 0.1
    superposition: Annotated[
        Literal["magnitude", "vector"],
        About("sum magnitudes (the paper's peak lies on the path) or vectors (as printed)", equation="9"),
    ] = "magnitude"


@dataclass(frozen=True, slots=True)
class AnthropomorphicSettings(Checked):
    """Anthropomorphic index D, Eqs. 11-13."""

    field: FieldSettings = field(default_factory=FieldSettings)
    slice_spacing: Annotated[float, Positive, About("distance between slices along the road", "m", equation="11")] = 0.5
    side_width: Annotated[float, Positive, About("reach of a slice to each side of the centre", "m", equation="11")] = (
        1.5
    )
    points_per_side: Annotated[int, Ge(1), About("sample points on each side of the centre", equation="11")] = 3
    centre_deviation_floor: Annotated[
        float, Positive, About("smallest deviation of the human centre", "m", equation="12")
    ] = 0.15
    field_deviation_floor: Annotated[
        float, Positive, About("smallest deviation of the human field, as a share of its mean", equation="12")
    ] = 0.01
    steering_threshold_deg: Annotated[
        float, Positive, About("steering wheel angle above which an operation begins", "deg", "k3", "12")
    ] = 10.0
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

    deceleration: Annotated[float, Positive, About("ideal braking deceleration of the zones", "m/s2", "a", "5")] = 5.0
    critical_inverse_ttc: Annotated[
        float, Positive, About("inverse TTC from which a point is hazardous", "1/s", "ITTC*", "6")
    ] = 0.7
    target: Annotated[
        Literal["squared_time", "label"],
        About("what the GP learns: a smooth function of max ITTC, or plain +1/-1 labels", equation="7"),
    ] = "squared_time"
    target_scale: Annotated[float, Positive, About("scale of the squared-time target", "s2", equation="7")] = 10.0
    restarts: Annotated[int, Ge(0), About("restarts of the GP's hyperparameter search", equation="8")] = 4
    refinements: Annotated[
        int, Ge(0), About("rounds in which training points are added where the GP is wrong, while that is over 1 %")
    ] = 3
    grid_points: Annotated[int, Ge(1_000), About("points on which zones are separated and searched")] = 60_000


@dataclass(frozen=True, slots=True)
class CollisionSettings(Checked):
    """Collision avoidance index C, Eqs. 14-17, and the ideal vehicle it is relative to."""

    loss: Annotated[
        Literal["severity", "class"], About("compare U (as printed) or the loss class L", equation="17")
    ] = "severity"


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
class MethodSettings(Checked):
    """Everything that turns recorded facts into scores."""

    zones: ZoneSettings = field(default_factory=ZoneSettings)
    anthropomorphic: AnthropomorphicSettings = field(default_factory=AnthropomorphicSettings)
    collision: CollisionSettings = field(default_factory=CollisionSettings)
    score: ScoreSettings = field(default_factory=ScoreSettings)


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
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    ideal_deceleration: Annotated[float, Positive, About("braking of the ideal vehicle", "m/s2", "Ug", "17")] = 9.0
    ideal_build_up: Annotated[float, Positive, About("its pressure build-up time", "s", "Ug", "17")] = 0.15


@dataclass(frozen=True, slots=True)
class DriverSettings(Checked):
    """The skilled human drivers that D compares with."""

    count: Annotated[int, Ge(2), About("number of drivers in each concrete scenario")] = 10
    source: Annotated[str, About("`synthetic`, or package.module:function from concrete scenario to trajectories")] = (
        "synthetic"
    )


@dataclass(frozen=True, slots=True)
class RunSettings(Checked):
    """How the cases are worked off."""

    workers: Annotated[int, Ge(1), About("processes that simulate cases")] = 2
    case_timeout: Annotated[float, Positive, About("wall time a case may take", "s")] = 60.0
    step_timeout: Annotated[float, Positive, About("wall time one controller step may take", "s")] = 1.0


@dataclass(frozen=True, slots=True)
class ReportSettings(Checked):
    """What the report compares with. Scores do not depend on it."""

    reference: Annotated[
        str,
        MinLen(1),
        About(
            "name or controller of the ADS that decides what was preventable; the ideal vehicle if none is so called"
        ),
    ] = "careful_driver"
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
class ScenarioSettings(Checked):
    """One logical scenario of an evaluation."""

    use: Annotated[str, About("a shipped name, a scenario file (.toml) or module:name")]
    sampling: SamplingSettings = field(default_factory=SamplingSettings)


@dataclass(frozen=True, slots=True)
class AdsSettings(Checked):
    """One ADS under test."""

    name: Annotated[str, MinLen(1), About("what the tables call it")]
    controller: Annotated[str, About("a shipped name, sumo:MODEL, module:name or file.py:name")]


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
