"""Settings of the method, each with the number of its equation: `scoring/` reads them when it makes
scores of recorded facts.
"""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Literal

from annotated_types import Ge, Le

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import (
    About,
    Checked,
    FilledText,
    Natural,
    NotNegativeFloat,
    PositiveFloat,
    PositiveInt,
    PositiveOrNone,
    Share,
)


@frozen
class FieldSettings(Checked):
    """Trajectory field, Eqs. 9-10.

    The paper prints no values; these were chosen on recorded motorway approaches.
    """

    k1: Annotated[
        NotNegativeFloat,
        Le(20.0),
        About("decay of the field with distance", symbol="k1", equation="10"),
    ] = 0.5
    k2: Annotated[
        Share,
        About("growth of the field with speed ahead", "s/m", symbol="k2", equation="10"),
    ] = 0.005
    sample_interval: Annotated[
        PositiveFloat, About("time between summed samples", "s", equation="9")
    ] = 0.1
    superposition: Annotated[
        Literal["magnitude", "vector"],
        About(
            "sum the magnitudes of the field (its peak is on the path, as in the paper's figures), "
            "or its vectors (as in the printed equation)",
            equation="9",
        ),
    ] = "magnitude"


@frozen
class AnthropomorphicSettings(Checked):
    """Anthropomorphic index D, Eqs. 11-13."""

    field: FieldSettings = field(default_factory=FieldSettings)
    mode: Annotated[
        Literal["gaussian", "mixture"],
        About(
            "compare with all drivers at once (the paper), or with those of the same manoeuvre, "
            "times how usual that is: its share of drivers over the largest share of a manoeuvre",
            equation="11",
        ),
    ] = "gaussian"
    manoeuvre_time: Annotated[
        PositiveFloat,
        About("time a lane must be kept to be part of a manoeuvre (mixture)", "s", equation="11"),
    ] = 1.0
    pooled_drivers: Annotated[
        PositiveFloat,
        About(
            "weight of the deviation within all manoeuvres, beside that of the ADS's manoeuvre: "
            "it counts as this number of drivers (mixture)",
            equation="11",
        ),
    ] = 2.0
    band_slice_spacing: Annotated[
        PositiveFloat,
        About(
            "distance between slices where drivers are scored against each other",
            "m",
            equation="11",
        ),
    ] = 2.5
    slice_spacing: Annotated[
        PositiveFloat, About("distance between slices along the road", "m", equation="11")
    ] = 0.5
    side_width: Annotated[
        PositiveFloat, About("reach of a slice to each side of the centre", "m", equation="11")
    ] = 1.5
    points_per_side: Annotated[
        PositiveInt, Le(1_000), About("sample points on each side of the centre", equation="11")
    ] = 3
    centre_deviation_floor: Annotated[
        float, Ge(1e-6), About("smallest deviation of the human centre", "m", equation="12")
    ] = 0.15
    field_deviation_floor: Annotated[
        float,
        Ge(1e-6),
        About("smallest deviation of the human field, as a share of its mean", equation="12"),
    ] = 0.01
    steering_rule: Annotated[
        Literal["manoeuvre", "wheel"],
        About(
            "what a steering operation is, of the ADS and of the drivers: a lateral manoeuvre "
            "(faster than 0.12 m/s to one side, for at least 1 m), or the steering wheel past its "
            "threshold; `wheel` needs a steering signal of both",
            equation="12",
        ),
    ] = "manoeuvre"
    steering_threshold_deg: Annotated[
        PositiveFloat,
        About(
            "steering wheel angle above which an operation begins (wheel)",
            "deg",
            symbol="k3",
            equation="12",
        ),
    ] = 10.0
    steering_lateral_acceleration: Annotated[
        PositiveOrNone,
        About(
            "instead of `steering_threshold_deg`: an operation begins when the steering wheel "
            "angle gives this lateral acceleration at the current speed (wheel)",
            "m/s2",
            equation="12",
        ),
    ] = None
    steering_ratio: Annotated[
        PositiveFloat,
        About("steering wheel angle over road wheel angle, where an acceleration is the threshold"),
    ] = 16.0
    wheelbase: Annotated[
        PositiveFloat,
        About("distance between the axles, where an acceleration is the threshold", "m"),
    ] = 2.7
    acceleration_threshold: Annotated[
        PositiveFloat,
        About(
            "longitudinal acceleration above which an operation begins",
            "m/s2",
            symbol="k4",
            equation="12",
        ),
    ] = 0.5
    neutral_time: Annotated[
        NotNegativeFloat,
        About(
            "time the signal must stay neutral for an operation to have ended", "s", equation="12"
        ),
    ] = 0.5
    stop_speed: Annotated[
        PositiveFloat,
        About(
            "speed below which a vehicle has stopped, which ends its length L",
            "m/s",
            symbol="L",
            equation="12",
        ),
    ] = 0.1


@frozen
class ZoneSettings(Checked):
    """Safe and hazardous zones, Eqs. 1-8."""

    deceleration: Annotated[
        float,
        Ge(0.01),
        About("ideal braking deceleration of the zones", "m/s2", symbol="a", equation="5"),
    ] = 5.0
    critical_inverse_ttc: Annotated[
        float,
        Ge(0.001),
        About("inverse TTC from which a point is hazardous", "1/s", symbol="ITTC*", equation="6"),
    ] = 0.7
    target: Annotated[
        Literal["squared_time", "label"],
        About(
            "what the GP learns: a smooth function of max ITTC, or plain +1/-1 labels", equation="7"
        ),
    ] = "squared_time"
    target_scale: Annotated[
        PositiveFloat, About("scale of the squared-time target", "s2", equation="7")
    ] = 10.0
    restarts: Annotated[
        Natural, Le(1_000), About("restarts of the GP's hyperparameter search", equation="8")
    ] = 4
    refinements: Annotated[
        Natural,
        Le(1_000),
        About(
            "rounds in which training points are added where the GP is wrong, while that is over "
            "1 %"
        ),
    ] = 3
    grid_points: Annotated[
        int, Ge(1_000), Le(10_000_000), About("points on which zones are separated and searched")
    ] = 60_000


@frozen
class CollisionSettings(Checked):
    """Collision avoidance index C, Eqs. 14-17, and the ideal vehicle it is relative to."""

    loss: Annotated[
        Literal["severity", "class"],
        About("compare U (as printed) or the loss class L", equation="17"),
    ] = "severity"
    severity: Annotated[
        FilledText,
        About(
            "replacement for U: severity (U of Eq. 15), eq14 (its class L), injury:car_driver, "
            "injury:pedestrian, injury:cyclist, or package.module:function from a Contact to a "
            "loss in 0..1",
            symbol="U",
            equation="15",
        ),
    ] = "severity"
    age: Annotated[
        PositiveOrNone,
        Le(120.0),
        About("age of the injured person, for `injury:`; default: the risk curve's own", "a"),
    ] = None
    ego_mass: Annotated[
        PositiveFloat, About("mass of the ego, for a `severity` of your own", "kg")
    ] = 1500.0
    rear_end: Annotated[
        Literal["apart", "counts"],
        About(
            "a contact in which a vehicle that reacts runs into the ego's rear: its own fault and "
            "counted apart from C and A, or a collision as any other"
        ),
    ] = "apart"
    others_fault_after: Annotated[
        NotNegativeFloat,
        About(
            "of `rear_end`: it is the other vehicle's fault only if the ego was in that lane for "
            "at least this time, or since the start",
            "s",
        ),
    ] = 3.0
    other_mass: Annotated[
        PositiveFloat, About("mass of what it hits, for a `severity` of your own", "kg")
    ] = 1500.0

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.loss == "class" and self.severity not in ("severity", "eq14"):
            raise must_be(
                "`severity`",
                "`CollisionSettings`",
                "'severity' or 'eq14' beside `loss` 'class'",
                self.severity,
            )
        if self.severity == "eq14":  # the same choice as `loss` "class"
            object.__setattr__(self, "loss", "class")

    @property
    def unit(self) -> str:
        """Unit of U, Ug and U0 after a space; "" where a loss in 0..1 replaces them."""
        return " m/s" if self.severity in ("severity", "eq14") else ""

    @property
    def regret_unit(self) -> str:
        """Unit of the severities that A compares, and of the regret, after a space; "" of a loss in
        0..1.
        """
        return self.unit if self.loss == "severity" else ""


@frozen
class PlausibilitySettings(Checked):
    """Plausibility, a factor of H: the share of drivers whose extremes are at least as large."""

    table: Annotated[
        Literal["motorway", "recorded"],
        About(
            "the drivers: 213 on a motorway, or those recorded in the run's scenario (at least 20 "
            "of them; else the motorway's replace them, and a note reports it)"
        ),
    ] = "motorway"


@frozen
class ScoreSettings(Checked):
    """Combined score S, Eq. 18."""

    a: Annotated[
        NotNegativeFloat,
        Le(100.0),
        About("points for collision avoidance; b = 100 - a", symbol="a", equation="18"),
    ] = 50.0
    k5: Annotated[PositiveFloat, About("scale of C", symbol="k5", equation="18")] = 1.0
    k6: Annotated[PositiveFloat, About("scale of D", symbol="k6", equation="18")] = 1.0

    @property
    def b(self) -> float:
        """Points for human-likeness: b = 100 - a."""
        return 100.0 - self.a


@frozen
class TaskSettings(Checked):
    """The driving task: T, and the grade A' of avoided harm."""

    task_reference: Annotated[
        FilledText,
        About("baseline whose times T compares with, driven at every point under no conditions"),
    ] = "attentive"
    road_margin: Annotated[
        NotNegativeFloat,
        Le(10.0),
        About("how far a corner may be beyond the road: a paved edge strip", "m"),
    ] = 0.5
    roadside_overlap: Annotated[
        float,
        Ge(0.5),
        Le(1.0),
        About("overlap of the contact that a departure counts as", symbol="w"),
    ] = 1.0
    sharpness: Annotated[
        float,
        Ge(1e-6),
        Le(1e3),
        About("share of harm 1 - A below which A' hardly falls", symbol="x0"),
    ] = 0.01


@frozen
class RankingSettings(Checked):
    """The order of the ADSs of an evaluation by S+."""

    weights: Annotated[
        dict[str, NotNegativeFloat],
        About(
            "weight of a scenario in the mean S+ that ADSs are ranked by, by name; others weigh 1"
        ),
    ] = field(default_factory=dict)


@frozen
class MethodSettings(Checked):
    """Everything that turns recorded facts into scores."""

    zones: ZoneSettings = field(default_factory=ZoneSettings)
    anthropomorphic: AnthropomorphicSettings = field(default_factory=AnthropomorphicSettings)
    collision: CollisionSettings = field(default_factory=CollisionSettings)
    plausibility: PlausibilitySettings = field(default_factory=PlausibilitySettings)
    task: TaskSettings = field(default_factory=TaskSettings)
    score: ScoreSettings = field(default_factory=ScoreSettings)
    ranking: RankingSettings = field(default_factory=RankingSettings)
