"""Table `[simulation]` of evaluation.toml: the ego's vehicle, limits of what an ADS perceives and
commands, steps and end of a case. The JSON schema and the report show the texts. A case may change
some settings (`CHANGES` of `scenario/concrete.py`).

Users: `ads/`, `cosim/`, `record/`, `scenario/`, `settings/evaluation.py`, `whatif/levers.py`,
`extras/`.
"""

from typing import Annotated, Literal

from annotated_types import Le

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    InnerShare,
    NotNegativeFloat,
    PositiveFloat,
    PositiveOrNone,
    Share,
    empty_table,
    optional,
    setting,
)

_Extent = Annotated[PositiveFloat, Le(100.0)]  # of a body, m; no vehicle on roads is longer


@frozen
class VehicleSettings(Checked):
    """The ego as a machine: a single-track model with limited steering, tyres, brakes and drive.

    Mass, inertia, stiffness and centre of gravity (here a share of the wheelbase) of the dynamic
    model are those of a BMW 320i, vehicle 2 of commonroad-vehicle-models. All other numbers are
    round values of a mid-size car.
    """

    length: _Extent = setting(4.5, "body length", "m")
    width: _Extent = setting(1.8, "body width", "m")
    wheelbase: _Extent = setting(2.7, "distance between the axles", "m")
    steering_ratio: PositiveFloat = setting(16.0, "steering wheel angle over road wheel angle")
    max_steering_wheel_angle_deg: PositiveFloat = setting(
        540.0, "end stop of the steering wheel", "deg"
    )
    max_steering_wheel_rate_deg: PositiveFloat = setting(
        720.0, "fastest turn of the steering wheel", "deg/s"
    )
    friction: PositiveFloat = setting(
        0.92, "tyre-road friction coefficient: bounds the total acceleration"
    )
    max_acceleration: PositiveFloat = setting(4.0, "strongest drive", "m/s2")
    max_deceleration: PositiveFloat = setting(9.0, "strongest braking", "m/s2")
    brake_build_up: PositiveFloat = setting(
        0.15, "time from no braking to the strongest, linear", "s"
    )
    drive_jerk: PositiveFloat = setting(10.0, "fastest rise of drive", "m/s3")
    max_speed: PositiveFloat = setting(60.0, "top speed", "m/s")

    model: Literal["kinematic", "dynamic"] = setting(
        "kinematic",
        "kinematic: tyres do not slip, valid up to about 0.4 g of lateral acceleration (a clip "
        "records where a case exceeds it); dynamic: side slip and yaw by tyre forces with "
        "their limit, same drive and brakes",
    )
    mass: PositiveFloat = setting(1093.3, "of the dynamic model: mass", "kg")
    yaw_inertia: PositiveFloat = setting(
        1791.6, "of the dynamic model: inertia about the vertical axis", "kg m2"
    )
    front_share: InnerShare = setting(
        0.448, "of the dynamic model: (front axle to centre of gravity) / wheelbase"
    )
    centre_height: NotNegativeFloat = setting(
        0.614, "of the dynamic model: centre of gravity above the road", "m"
    )
    cornering_stiffness: PositiveFloat = setting(
        20.9, "of the dynamic model: side force / (slip angle * axle load * friction)", "1/rad"
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        # road wheels across the vehicle: tan(angle), the curvature of its path, has no sense there
        most = 90.0 * self.steering_ratio
        if self.max_steering_wheel_angle_deg >= most:
            wanted = f"less than {most:g} deg, 90 times `steering_ratio`"
            got = self.max_steering_wheel_angle_deg
            raise must_be("`max_steering_wheel_angle_deg`", "`VehicleSettings`", wanted, got)

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

    perception_delay: NotNegativeFloat = setting(0.0, "age of what is seen of other vehicles", "s")
    dropout: Share = setting(0.0, "chance that a vehicle is missed at a step")
    position_noise: NotNegativeFloat = setting(
        0.0, "standard deviation of seen positions, along and across the road", "m"
    )
    speed_noise: NotNegativeFloat = setting(
        0.0, "standard deviation of seen speeds along the heading", "m/s"
    )
    sensor_range: PositiveOrNone = optional(
        "farthest other vehicle that is seen, centre to centre; default: no limit", "m"
    )
    field_of_view_deg: Annotated[PositiveOrNone, Le(360.0)] = optional(
        "angle in front of the ego that is seen; default: all around", "deg"
    )
    occlusion: bool = setting(
        False, "a vehicle covered to 80 % of its width by a nearer one is not seen"
    )
    # `Le`: the commands of so long a time wait in memory
    actuation_delay: Annotated[NotNegativeFloat, Le(100.0)] = setting(
        0.0, "time until a Command reaches the vehicle", "s"
    )
    step_budget: PositiveOrNone = optional(
        "wall time of a step after which its Command is late and the last one holds; default: none",
        "s",
    )
    interference: Literal["refuse", "record"] = setting(
        "refuse",
        "an ADS that touches other vehicles, the road or the clock: ends its case, or is put "
        "on record",
    )
    reveal_scenario: bool = setting(
        False, "tell the ADS the scenario's name and its parameters' values"
    )


@frozen
class FmuSettings(Checked):
    """Mapping of an FMU's variables; one that is not mapped is connected by its name."""

    inputs: dict[str, str | float] = empty_table(
        "input of the FMU = its signal, a number, or `start`: it keeps its start value"
    )
    outputs: dict[str, str] = empty_table("quantity that is read = output of the FMU")
    parameters: dict[str, int | float | bool | str] = empty_table(
        "parameter of the FMU = its value, or the signal whose value at the start it takes"
    )


@frozen
class PlantSettings(FmuSettings):
    """An FMU as the ego's vehicle model, in place of the single-track model."""

    # Python wants a default after other defaults; `FilledText` refuses it: a file must be given
    file: FilledText = setting("", "the FMU, relative to the evaluation file")


@frozen
class TrackerSettings(Checked):
    """The controller that turns wanted speeds and positions into pedal and wheel commands."""

    speed_time: PositiveFloat = setting(
        0.5, "time constant T of reaching a wanted speed: dv/dt = (wanted - v) / T", "s"
    )
    position_gain: NotNegativeFloat = setting(
        1.0, "acceleration for each metre that the ego is behind its plan", "1/s2"
    )
    speed_gain: NotNegativeFloat = setting(
        2.0, "acceleration for each m/s that the ego is slower than its plan", "1/s"
    )
    steering_gain: NotNegativeFloat = setting(
        2.5, "gain on the front axle's distance from the plan's path (Stanley)", "1/s"
    )
    softening_speed: PositiveFloat = setting(
        1.0,
        "v0 in the wheel angle towards the path: atan(steering_gain * distance / (speed + v0))",
        "m/s",
    )


@frozen
class SimulationSettings(Checked):
    """Simulation of a case: the steps of SUMO, and the end of the case."""

    step: Annotated[PositiveFloat, Le(0.1)] = setting(
        0.05, "step of SUMO and of the controller", "s"
    )
    record_interval: Annotated[PositiveFloat, Le(0.1)] = setting(
        0.1, "time between recorded samples", "s"
    )
    time_limit: PositiveFloat = setting(150.0, "longest simulated time of a case", "s")
    standstill_speed: PositiveFloat = setting(0.1, "speed below which the ego stands", "m/s")
    standstill_time: PositiveFloat = setting(
        2.0, "time the ego must stand for the case to end", "s"
    )
    lane_change_duration: PositiveFloat = setting(
        5.0, "duration of a lane change that SUMO itself performs for the ego", "s"
    )
    seen_over_line: Annotated[NotNegativeFloat, Le(2.0)] = setting(
        0.0,
        "how far a body must reach into a lane for reacting vehicles in it to see it, at most "
        "until its front's centre is in the lane; 0: they see it once it touches the line",
        "m",
    )
    end_when_decided: bool = setting(
        False,
        "end a case once no contact is possible any more; quicker where only collisions "
        "count, but shorter drives lower T and change D, H, S+",
    )
    vehicle: VehicleSettings = VehicleSettings()
    # the ideal vehicle: its U is Ug, which the paper uses in Eq. 17
    ideal_deceleration: PositiveFloat = setting(
        9.0, "braking of the ideal vehicle, limited by friction", "m/s2", symbol="Ug", equation="17"
    )
    ideal_build_up: PositiveFloat = setting(
        0.15, "pressure build-up time of its brakes", "s", symbol="Ug", equation="17"
    )
    ideal_visible_share: Share = setting(
        0.2,
        "share of a vehicle's width that must show for the ideal vehicle to see it; 0: none",
        symbol="Ug",
        equation="17",
    )
    ideal_steers: bool = setting(
        True,
        "the ideal vehicle changes to a free lane where a hidden vehicle shows too late to brake",
        symbol="Ug",
        equation="17",
    )
    conditions: ConditionSettings = ConditionSettings()
    tracker: TrackerSettings = TrackerSettings()
    plant: PlantSettings | None = optional("an FMU as vehicle model of the ADSs under test")

    def __post_init__(self) -> None:
        """Raise InputError unless `step` is in whole milliseconds and `record_interval` in whole
        steps.
        """
        Checked.__post_init__(self)
        milliseconds = self.step * 1000.0
        if round(milliseconds) < 1 or abs(milliseconds - round(milliseconds)) > 1e-6:
            raise must_be(
                "`step`",
                "the simulation",
                "a whole number of milliseconds (SUMO rounds it)",
                self.step,
            )
        ratio = self.record_interval / self.step
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9:
            raise must_be(
                "`record_interval`",
                "the simulation",
                f"a multiple of `step` ({self.step:g} s)",
                self.record_interval,
            )
