"""Table `[simulation]` of evaluation.toml: the ego's vehicle, limits of what an ADS perceives and
commands, steps and end of a case. Used by `cosim/`; the texts of `About` stand in the reference.
"""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Literal

from annotated_types import Le, Lt

from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import (
    About,
    Checked,
    FilledText,
    NotNegativeFloat,
    PositiveFloat,
    PositiveOrNone,
    Share,
)


@frozen
class VehicleSettings(Checked):
    """The ego as a machine: a single-track model with limited steering, tyres, brakes and drive.

    Mass, inertia, stiffness and centre of gravity (here a share of the wheelbase) of the dynamic
    model are those of a BMW 320i, vehicle 2 of commonroad-vehicle-models. All other numbers are
    round values of a mid-size car.
    """

    length: Annotated[PositiveFloat, About("body length", "m")] = 4.5
    width: Annotated[PositiveFloat, About("body width", "m")] = 1.8
    wheelbase: Annotated[PositiveFloat, About("distance between the axles", "m")] = 2.7
    steering_ratio: Annotated[
        PositiveFloat, About("steering wheel angle over road wheel angle")
    ] = 16.0
    max_steering_wheel_angle_deg: Annotated[
        PositiveFloat, About("end stop of the steering wheel", "deg")
    ] = 540.0
    max_steering_wheel_rate_deg: Annotated[
        PositiveFloat, About("fastest turn of the steering wheel", "deg/s")
    ] = 720.0
    friction: Annotated[
        PositiveFloat, About("tyre-road friction coefficient: bounds the total acceleration")
    ] = 0.92
    max_acceleration: Annotated[PositiveFloat, About("strongest drive", "m/s2")] = 4.0
    max_deceleration: Annotated[PositiveFloat, About("strongest braking", "m/s2")] = 9.0
    brake_build_up: Annotated[
        PositiveFloat, About("time from no braking to the strongest, linear", "s")
    ] = 0.15
    drive_jerk: Annotated[PositiveFloat, About("fastest rise of drive", "m/s3")] = 10.0
    max_speed: Annotated[PositiveFloat, About("top speed", "m/s")] = 60.0

    model: Annotated[
        Literal["kinematic", "dynamic"],
        About(
            "kinematic: tyres do not slip, valid up to about 0.4 g of lateral acceleration (a clip "
            "records where a case exceeds it); dynamic: side slip and yaw by tyre forces with "
            "their limit, same drive and brakes"
        ),
    ] = "kinematic"
    mass: Annotated[PositiveFloat, About("of the dynamic model: mass", "kg")] = 1093.3
    yaw_inertia: Annotated[
        PositiveFloat, About("of the dynamic model: inertia about the vertical axis", "kg m2")
    ] = 1791.6
    front_share: Annotated[
        PositiveFloat,
        Lt(1.0),
        About("of the dynamic model: (front axle to centre of gravity) / wheelbase"),
    ] = 0.448
    centre_height: Annotated[
        NotNegativeFloat, About("of the dynamic model: centre of gravity above the road", "m")
    ] = 0.614
    cornering_stiffness: Annotated[
        PositiveFloat,
        About("of the dynamic model: side force / (slip angle * axle load * friction)", "1/rad"),
    ] = 20.9

    @property
    def dynamic(self) -> float:
        """1 for the dynamic model, else 0: a vehicle's record in kernels holds floats only."""
        return 1.0 if self.model == "dynamic" else 0.0

    @property
    def brake_jerk(self) -> float:
        """Rate at which braking builds up, m/s3."""
        return self.max_deceleration / self.brake_build_up


@frozen
class ConditionSettings(Checked):
    """Conditions between the world and the ADS: limited perception, delays, late commands.

    By default there are none: the ADS sees everything, and the ego obeys at once.

    Conditions from `perception_delay` to `occlusion` limit an `Observation` (`act(obs)`, `exec:`,
    `fmu:`). Baselines, TraCI code and policies over arrays see everything. No condition limits the
    ideal vehicle or the drivers. Noise makes no speed negative.
    """

    perception_delay: Annotated[
        NotNegativeFloat, About("age of what is seen of other vehicles", "s")
    ] = 0.0
    dropout: Annotated[Share, About("chance that a vehicle is missed at a step")] = 0.0
    position_noise: Annotated[
        NotNegativeFloat,
        About("standard deviation of seen positions, along and across the road", "m"),
    ] = 0.0
    speed_noise: Annotated[
        NotNegativeFloat, About("standard deviation of seen speeds along the heading", "m/s")
    ] = 0.0
    sensor_range: Annotated[
        PositiveOrNone,
        About("farthest other vehicle that is seen, centre to centre; default: no limit", "m"),
    ] = None
    field_of_view_deg: Annotated[
        PositiveOrNone,
        Le(360.0),
        About("angle in front of the ego that is seen; default: all around", "deg"),
    ] = None
    occlusion: Annotated[
        bool, About("a vehicle covered to 80 % of its width by a nearer one is not seen")
    ] = False
    actuation_delay: Annotated[
        NotNegativeFloat, About("time until a Command reaches the vehicle", "s")
    ] = 0.0
    step_budget: Annotated[
        PositiveOrNone,
        About(
            "wall time of a step after which its Command is late and the last one holds; default: "
            "none",
            "s",
        ),
    ] = None
    interference: Annotated[
        Literal["refuse", "record"],
        About(
            "an ADS that touches other vehicles, the road or the clock: ends its case, or is put "
            "on record"
        ),
    ] = "refuse"
    reveal_scenario: Annotated[
        bool, About("tell the ADS the scenario's name and its parameters' values")
    ] = False


@frozen
class FmuSettings(Checked):
    """Mapping of an FMU's variables; one that is not mapped is connected by its name."""

    inputs: Annotated[
        dict[str, str | float],
        About("input of the FMU = its signal, a number, or `start`: it keeps its start value"),
    ] = field(default_factory=dict)
    outputs: Annotated[dict[str, str], About("quantity that is read = output of the FMU")] = field(
        default_factory=dict
    )
    parameters: Annotated[
        dict[str, float | int | bool | str],
        About("parameter of the FMU = its value, or the signal whose value at the start it takes"),
    ] = field(default_factory=dict)


@frozen
class PlantSettings(FmuSettings):
    """An FMU as the ego's vehicle model, in place of the single-track model."""

    # a field after others with defaults needs one: `MinLen` refuses it, so a file must be given
    file: Annotated[FilledText, About("the FMU, relative to the evaluation file")] = ""


@frozen
class TrackerSettings(Checked):
    """The controller that turns wanted speeds and positions into pedal and wheel commands."""

    speed_time: Annotated[
        PositiveFloat,
        About("time constant T of reaching a wanted speed: dv/dt = (wanted - v) / T", "s"),
    ] = 0.5
    position_gain: Annotated[
        NotNegativeFloat,
        About("acceleration for each metre that the ego is behind its plan", "1/s2"),
    ] = 1.0
    speed_gain: Annotated[
        NotNegativeFloat,
        About("acceleration for each m/s that the ego is slower than its plan", "1/s"),
    ] = 2.0
    steering_gain: Annotated[
        NotNegativeFloat,
        About("gain on the front axle's distance from the plan's path (Stanley)", "1/s"),
    ] = 2.5
    softening_speed: Annotated[
        PositiveFloat,
        About(
            "v0 in the wheel angle towards the path: atan(steering_gain * distance / (speed + v0))",
            "m/s",
        ),
    ] = 1.0


@frozen
class SimulationSettings(Checked):
    """Simulation of a case: the steps of SUMO, and the end of the case."""

    step: Annotated[PositiveFloat, Le(0.1), About("step of SUMO and of the controller", "s")] = 0.05
    record_interval: Annotated[
        PositiveFloat, Le(0.1), About("time between recorded samples", "s")
    ] = 0.1
    time_limit: Annotated[PositiveFloat, About("longest simulated time of a case", "s")] = 150.0
    standstill_speed: Annotated[PositiveFloat, About("speed below which the ego stands", "m/s")] = (
        0.1
    )
    standstill_time: Annotated[
        PositiveFloat, About("time the ego must stand for the case to end", "s")
    ] = 2.0
    lane_change_duration: Annotated[
        PositiveFloat, About("duration of a lane change that SUMO itself performs for the ego", "s")
    ] = 5.0
    seen_over_line: Annotated[
        NotNegativeFloat,
        Le(2.0),
        About(
            "how far a body must reach into a lane until reacting vehicles in it see it; 0: it "
            "touches the line; they see it at the latest once its front's centre is in their lane",
            "m",
        ),
    ] = 0.0
    end_when_decided: Annotated[
        bool,
        About(
            "end a case once no contact is possible any more; quicker where only collisions "
            "count, but shorter drives change D"
        ),
    ] = False
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    # the ideal vehicle: its U is Ug, which the paper uses in Eq. 17
    ideal_deceleration: Annotated[
        PositiveFloat,
        About("braking of the ideal vehicle", "m/s2", symbol="Ug", equation="17"),
    ] = 9.0
    ideal_build_up: Annotated[
        PositiveFloat,
        About("pressure build-up time of its brakes", "s", symbol="Ug", equation="17"),
    ] = 0.15
    ideal_visible_share: Annotated[
        Share,
        About(
            "share of a vehicle's width that must show for the ideal vehicle to see it; 0: none",
            symbol="Ug",
            equation="17",
        ),
    ] = 0.2
    ideal_steers: Annotated[
        bool,
        About(
            "the ideal vehicle changes to a free lane where a hidden vehicle shows too late to "
            "brake",
            symbol="Ug",
            equation="17",
        ),
    ] = True
    conditions: ConditionSettings = field(default_factory=ConditionSettings)
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    plant: Annotated[
        PlantSettings | None, About("an FMU as vehicle model of the ADSs under test")
    ] = None
