"""Settings of the method, each with the number of its equation.

`scoring/` reads them when it makes scores of recorded facts; `record/` drives `task_reference`.

Users: `evaluation.py`, `method/`, `record/`, `scoring/`, `settings/evaluation.py`,
`extras/figures/of_scenes.py`, `extras/rates/importance.py`.
"""

from typing import Annotated, Literal

from annotated_types import Ge, Le

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    Natural,
    NotNegativeFloat,
    PositiveFloat,
    PositiveInt,
    PositiveOrNone,
    Share,
    empty_table,
    optional,
    setting,
)

_NotTiny = Annotated[PositiveFloat, Ge(0.01)]  # of samples, whose number the memory must hold


@frozen
class FieldSettings(Checked):
    """Trajectory field, Eqs. 9-10.

    The paper prints no values; these were chosen on recorded motorway approaches.
    """

    k1: Annotated[NotNegativeFloat, Le(20.0)] = setting(
        0.5, "decay of the field with distance", symbol="k1", equation="10"
    )
    k2: Share = setting(
        0.005, "growth of the field with speed ahead", "s/m", symbol="k2", equation="10"
    )
    sample_interval: _NotTiny = setting(0.1, "time between summed samples", "s", equation="9")
    superposition: Literal["magnitude", "vector"] = setting(
        "magnitude",
        "sum the magnitudes of the field (its peak is on the path, as in the paper's figures), "
        "or its vectors (as in the printed equation)",
        equation="9",
    )


@frozen
class AnthropomorphicSettings(Checked):
    """Anthropomorphic index D, Eqs. 11-13."""

    field: FieldSettings = FieldSettings()
    mode: Literal["gaussian", "mixture"] = setting(
        "gaussian",
        "compare with all drivers at once (the paper), or with those of the same manoeuvre, "
        "times how usual that is: its share of drivers over the largest share of a manoeuvre",
        equation="11",
    )
    manoeuvre_time: PositiveFloat = setting(
        1.0, "time a lane must be kept to be part of a manoeuvre (mixture)", "s", equation="11"
    )
    pooled_drivers: PositiveFloat = setting(
        2.0,
        "weight of the deviation within all manoeuvres, beside that of the ADS's manoeuvre: "
        "it counts as this number of drivers (mixture)",
        equation="11",
    )
    band_slice_spacing: _NotTiny = setting(
        2.5,
        "distance between slices where drivers are scored against each other",
        "m",
        equation="11",
    )
    slice_spacing: _NotTiny = setting(
        0.5, "distance between slices along the road", "m", equation="11"
    )
    side_width: PositiveFloat = setting(
        1.5, "reach of a slice to each side of the centre", "m", equation="11"
    )
    points_per_side: Annotated[PositiveInt, Le(1_000)] = setting(
        3, "sample points on each side of the centre", equation="11"
    )
    centre_deviation_floor: Annotated[float, Ge(1e-6)] = setting(
        0.15, "smallest deviation of the human centre", "m", equation="12"
    )
    field_deviation_floor: Annotated[float, Ge(1e-6)] = setting(
        0.01, "smallest deviation of the human field, as a share of its mean", equation="12"
    )
    steering_rule: Literal["manoeuvre", "wheel"] = setting(
        "manoeuvre",
        "what a steering operation is, of the ADS and of the drivers: a lateral manoeuvre "
        "(faster than 0.12 m/s to one side, for at least 1 m), or the steering wheel past its "
        "threshold; `wheel` needs a steering signal of both",
        equation="12",
    )
    steering_threshold_deg: PositiveFloat = setting(
        10.0,
        "steering wheel angle above which an operation begins (wheel)",
        "deg",
        symbol="k3",
        equation="12",
    )
    steering_lateral_acceleration: PositiveOrNone = setting(
        None,
        "instead of `steering_threshold_deg`: an operation begins when the steering wheel "
        "angle gives this lateral acceleration at the current speed (wheel)",
        "m/s2",
        equation="12",
    )
    steering_ratio: PositiveFloat = setting(
        16.0, "steering wheel angle over road wheel angle, where an acceleration is the threshold"
    )
    wheelbase: PositiveFloat = setting(
        2.7, "distance between the axles, where an acceleration is the threshold", "m"
    )
    acceleration_threshold: PositiveFloat = setting(
        0.5,
        "longitudinal acceleration above which an operation begins",
        "m/s2",
        symbol="k4",
        equation="12",
    )
    neutral_time: NotNegativeFloat = setting(
        0.5, "time the signal must stay neutral for an operation to have ended", "s", equation="12"
    )
    stop_speed: PositiveFloat = setting(
        0.1,
        "speed below which a vehicle has stopped, which ends its length L",
        "m/s",
        symbol="L",
        equation="12",
    )


@frozen
class ZoneSettings(Checked):
    """Safe and hazardous zones, Eqs. 1-8."""

    deceleration: Annotated[float, Ge(0.01)] = setting(
        5.0, "ideal braking deceleration of the zones", "m/s2", symbol="a", equation="5"
    )
    critical_inverse_ttc: Annotated[float, Ge(0.001)] = setting(
        0.7, "inverse TTC from which a point is hazardous", "1/s", symbol="ITTC*", equation="6"
    )
    target: Literal["squared_time", "label"] = setting(
        "squared_time",
        "what the GP learns: a smooth function of max ITTC, or plain +1/-1 labels",
        equation="7",
    )
    target_scale: PositiveFloat = setting(
        10.0, "scale of the squared-time target", "s2", equation="7"
    )
    restarts: Annotated[Natural, Le(1_000)] = setting(
        4, "restarts of the GP's hyperparameter search", equation="8"
    )
    refinements: Annotated[Natural, Le(1_000)] = setting(
        3, "rounds in which training points are added where the GP is wrong, while that is over 1 %"
    )
    grid_points: Annotated[int, Ge(1_000), Le(10_000_000)] = setting(
        60_000, "points on which zones are separated and searched"
    )


@frozen
class CollisionSettings(Checked):
    """Collision avoidance index C, Eqs. 14-17, and the ideal vehicle it is relative to."""

    loss: Literal["severity", "class"] = setting(
        "severity", "compare U (as printed) or the loss class L", equation="17"
    )
    severity: FilledText = setting(
        "severity",
        "replacement for U: severity (U of Eq. 15), eq14 (its class L), injury:car_driver, "
        "injury:pedestrian, injury:cyclist, or package.module:function from a Contact to a "
        "loss in 0..1",
        symbol="U",
        equation="15",
    )
    age: Annotated[PositiveOrNone, Le(120.0)] = optional(
        "age of the injured person, for `injury:`; default: the risk curve's own", "a"
    )
    ego_mass: PositiveFloat = setting(1500.0, "mass of the ego, for a `severity` of your own", "kg")
    rear_end: Literal["apart", "counts"] = setting(
        "apart",
        "a contact in which a vehicle that reacts runs into the ego's rear: its own fault and "
        "counted apart from C and A, or a collision as any other",
    )
    others_fault_after: NotNegativeFloat = setting(
        3.0,
        "of `rear_end`: it is the other vehicle's fault only if the ego was in that lane for "
        "at least this time, or since the start",
        "s",
    )
    other_mass: PositiveFloat = setting(
        1500.0, "mass of what it hits, for a `severity` of your own", "kg"
    )

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

    table: Literal["motorway", "recorded"] = setting(
        "motorway",
        "the drivers: 213 on a motorway, or those recorded in the run's scenario (at least 20 "
        "of them; else the motorway's replace them, and a note reports it)",
    )


@frozen
class ScoreSettings(Checked):
    """Combined score S, Eq. 18."""

    a: Annotated[NotNegativeFloat, Le(100.0)] = setting(
        50.0, "points for collision avoidance; b = 100 - a", symbol="a", equation="18"
    )
    k5: PositiveFloat = setting(1.0, "scale of C", symbol="k5", equation="18")
    k6: PositiveFloat = setting(1.0, "scale of D", symbol="k6", equation="18")

    @property
    def b(self) -> float:
        """Points for human-likeness: b = 100 - a."""
        return 100.0 - self.a


@frozen
class TaskSettings(Checked):
    """The driving task: T, and the grade A' of avoided harm."""

    task_reference: FilledText = setting(
        "attentive",
        "baseline whose times T compares with, driven at every point under no conditions",
    )
    road_margin: Annotated[NotNegativeFloat, Le(10.0)] = setting(
        0.5, "how far a corner may be beyond the road: a paved edge strip", "m"
    )
    roadside_overlap: Annotated[float, Ge(0.5), Le(1.0)] = setting(
        1.0, "overlap of the contact that a departure counts as", symbol="w"
    )
    sharpness: Annotated[float, Ge(1e-6), Le(1e3)] = setting(
        0.01, "share of harm 1 - A below which A' hardly falls", symbol="x0"
    )


@frozen
class RankingSettings(Checked):
    """The order of the ADSs of an evaluation by S+."""

    weights: dict[str, NotNegativeFloat] = empty_table(
        "weight of a scenario in the mean S+ that ADSs are ranked by, by name; others weigh 1"
    )


@frozen
class MethodSettings(Checked):
    """Everything that turns recorded facts into scores."""

    zones: ZoneSettings = ZoneSettings()
    anthropomorphic: AnthropomorphicSettings = AnthropomorphicSettings()
    collision: CollisionSettings = CollisionSettings()
    plausibility: PlausibilitySettings = PlausibilitySettings()
    task: TaskSettings = TaskSettings()
    score: ScoreSettings = ScoreSettings()
    ranking: RankingSettings = RankingSettings()
