"""Trajectories and recordings: `cosim/` makes them with SUMO, `method/` and `scoring/` read them.

Positions are the vehicle's centre in road coordinates: x along the road, y to the left, y = 0 on
the centre line of the right-hand lane. Headings are mathematical (0 along the road,
counter-clockwise positive). SI units throughout.

Users: `ads/`, `case_table.py`, `cases.py`, `cosim/`, `drivers/`, `method/`, `nightly/`, `record/`,
`report/`, `results.py`, `scenario/`, `score_notes.py`, `scoring/`, `extras/`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sumo_eval.errors import InputError
from sumo_eval.frozen import frozen

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
EndReason = Literal[
    "contact",  # of the ego with another body
    "standstill",  # of the ego, with nothing left to happen
    "road_end",
    "off_road",
    "time_limit",  # of simulated time
    "decided",  # the outcome can no longer change
    "ads_error",
    "ads_timeout",  # of wall time
    "sim_error",
    "recorded",  # end of a drive that was recorded on the road, not simulated
    "quit",  # by the person at the steering wheel
]
Side = Literal["front", "rear", "left", "right"]

_STANDSTILL_SPEED = 0.01  # m/s; the direction of a slower motion is noise of positions
CHANNELS = ("time", "x", "y", "heading", "speed", "acceleration", "steering_wheel_angle")
"""Channels of a `Trajectory`, in the order of its block (7, n)."""


@frozen(init=False, eq=False)
class Trajectory:
    """One vehicle's motion: every channel is an (n,) array, `time` strictly increasing.

    Missing heading, speed and acceleration are derived by central differences.

    time: s.
    x, y: of the vehicle's centre, m.
    heading: rad. Where it is derived, a standing vehicle keeps the direction of its last motion.
    speed: m/s.
    acceleration: along the heading, m/s2.
    steering_wheel_angle: rad, nan where it is not known.
    length, width: of the body, m.
    """

    time: FloatArray
    x: FloatArray
    y: FloatArray
    heading: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    steering_wheel_angle: FloatArray
    length: float
    width: float

    def __init__(
        self,
        time: ArrayLike,
        x: ArrayLike,
        y: ArrayLike,
        heading: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        steering_wheel_angle: ArrayLike | None = None,
        *,
        length: float = 4.5,
        width: float = 1.8,
    ) -> None:
        times = np.asarray(time, float)
        if times.ndim != 1 or times.size == 0:
            raise InputError(
                f"`time` of a Trajectory must be a non-empty (n,) array, got shape {times.shape}."
            )
        if not np.isfinite(times).all() or (times[1:] <= times[:-1]).any():
            raise InputError("`time` of a Trajectory must be finite and strictly increasing.")
        n = times.size
        xs, ys = _channel("x", x, n), _channel("y", y, n)
        if speed is None:
            speed = np.hypot(_rate(xs, times), _rate(ys, times))
        speeds = _channel("speed", speed, n)
        headings = _channel("heading", _course(xs, ys, times) if heading is None else heading, n)
        accelerations = _rate(speeds, times) if acceleration is None else acceleration
        angles = np.full(n, np.nan) if steering_wheel_angle is None else steering_wheel_angle
        channels = [
            times, xs, ys, headings, speeds, _channel("acceleration", accelerations, n),
            _channel("steering_wheel_angle", angles, n, nan_allowed=True)
        ]  # fmt: skip
        self._set_fields(np.array(channels), length, width)

    @classmethod
    def of_block(cls, block: FloatArray, *, length: float, width: float) -> Trajectory:
        """Make a trajectory of one (7, n) array with all `CHANNELS`, in a fifth of the
        constructor's time and with the same checks.

        The array is not copied, but made read-only.
        """
        if block.ndim != 2 or len(block) != len(CHANNELS):
            raise InputError(
                f"A block of a Trajectory must have shape ({len(CHANNELS)}, n), got {block.shape}."
            )
        times = block[0]
        if times.size and (times[1:] > times[:-1]).all() and np.isfinite(block[:-1]).all():
            trajectory = object.__new__(cls)
            trajectory._set_fields(block, length, width)
            return trajectory
        return cls(*block, length=length, width=width)  # raises an error that names the fault

    def _set_fields(self, block: FloatArray, length: float, width: float) -> None:
        """Set all fields; the channels are views of the block."""
        block.setflags(write=False)
        for name, values in zip(CHANNELS, block, strict=True):
            object.__setattr__(self, name, values)
        object.__setattr__(self, "length", float(length))
        object.__setattr__(self, "width", float(width))

    def __len__(self) -> int:
        return int(self.time.size)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])


def _channel(name: str, values: ArrayLike, n: int, *, nan_allowed: bool = False) -> FloatArray:
    """A channel as an array (n,). Raises InputError for another shape or a number that is not
    finite.
    """
    array = np.asarray(values, float)
    if array.shape != (n,):
        raise InputError(
            f"`{name}` of a Trajectory must have the shape of `time` ({n},), got {array.shape}."
        )
    if not nan_allowed and not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array))[0]
        raise InputError(
            f"`{name}` of a Trajectory must be finite, got {array[bad]} at sample {bad}."
        )
    return array


def _rate(values: FloatArray, time: FloatArray) -> FloatArray:
    """Derivative by time (n,); 0 of a single sample."""
    return np.gradient(values, time) if values.size > 1 else np.zeros(1)


def _course(x: FloatArray, y: FloatArray, time: FloatArray) -> FloatArray:
    """Direction of motion, rad.

    A standing vehicle keeps the direction of its last motion. Before its first motion it has the
    direction of that one. A vehicle that never moves has 0.
    """
    vx, vy = _rate(x, time), _rate(y, time)
    moving = np.hypot(vx, vy) > _STANDSTILL_SPEED
    if not moving.any():
        return np.zeros(x.size)
    course = np.arctan2(vy, vx)
    # sample of the last motion up to each sample, -1 before the first motion
    last_motion = np.maximum.accumulate(np.where(moving, np.arange(x.size), -1))
    return course[np.where(last_motion >= 0, last_motion, np.argmax(moving))]


Trajectories = Mapping[str, Trajectory]
"""Trajectories of vehicles by name."""


@frozen
class Collision:
    """First contact of the ego's body with another's, located within the step.

    time: s.
    other: name of the actor.
    ego_velocity, other_velocity: (vx, vy) at contact, m/s, in road coordinates.
    overlap: share of the ego's bumper width that faces the other body, 0..1.
    side: of the ego, where it was hit.
    ego_pose, other_pose: (x, y, heading) of the centres at contact, m and rad.
    """

    time: float
    other: str
    ego_velocity: tuple[float, float]
    other_velocity: tuple[float, float]
    overlap: float
    side: Side
    ego_pose: tuple[float, float, float]
    other_pose: tuple[float, float, float]

    @property
    def relative_speed(self) -> float:
        """|v_ego - v_other| at contact, m/s."""
        return float(np.hypot(*np.subtract(self.ego_velocity, self.other_velocity)))


NO_RETURN = "no_return"
"""`Clip.what` of the note that `cosim/no_return.py` adds to a drive with a contact. The fields of
that `Clip` (below) mean:

first_time: the point of no return, s: the last time from which full braking avoids the contact.
    `NEVER`: full braking from the start does not avoid it. `UNKNOWN`: there was no search, because
    a replay of the drive does not end in this contact.
requested: when the ADS first braked, s; `NEVER`: it did not.
applied: time of the contact, s.
"""
NEVER, UNKNOWN = -1.0, -2.0


@frozen
class Clip:
    """Note on a drive: requests that a limit changed, or another event that a reader must know.

    what: name of the limit or event.
    count: how often it occurred.
    first_time: of its first occurrence, s.
    requested, applied: values of the worst occurrence, in the unit of `what`.
    """

    what: str
    count: int
    first_time: float
    requested: float
    applied: float


AloneReason = Literal[
    "on_traci",
    "asked",
    "one_object",
    "not_together",
    "asks_sumo",
    "left_batch",
    "keeps_state",
    "batch",
    "draws",
    "together_failed",
    "pack_lost",
    "block_lost",
    "late",
]
"""Reasons why a case has to be driven alone; `_ALONE` has a sentence for each."""

_ALONE: dict[AloneReason, str] = {
    "on_traci": "The ADS needs the simulation to itself (TraCI code, a listener, a program, an FMU "
    "or a model of SUMO's).",
    "asked": "The ADS asks for it by `{}`.",
    "one_object": "The ADS is one object for all cases, and may hold something of each.",
    "not_together": "The case or its settings must be driven alone (its road's network, its "
    "conditions, its vehicle model).",
    "asks_sumo": "Its ADS asks SUMO, which then has to hold its case alone.",
    "left_batch": "Its ADS asked for something that a batch does not offer, or something out of "
    "the ordinary happened in it.",
    "keeps_state": "The ADS keeps state that its cases share ({}), so that results may depend on "
    "their order: keep it on the object, `self`.",
    "batch": "The ADS's numbers depend on which cases are driven together.",
    "draws": "The ADS draws from the global random generators, so that its cases have to follow "
    "one another.",
    "together_failed": "Cases that were driven together failed: {}.",
    "pack_lost": "Its batch was lost. {}",
    "block_lost": "The block of cases that its policy over arrays drives together was lost, so the "
    "policy was shown this case alone, which may change the last bits of its answers. {}",
    "late": "Its ADS was too late in its first step, or while no processor worked on it (a loaded "
    "machine, an ADS that waits), so it was driven once more with no other case. {}",
}


_WENT_WRONG = ("keeps_state", "together_failed", "pack_lost", "block_lost", "late")
"""Reasons that came up in a batch, after which its cases were driven once more."""


@frozen
class Alone:
    """Reason why a case has to be driven alone.

    detail: message of what failed; empty where the reason is complete without it.
    """

    why: AloneReason
    detail: str = ""

    @property
    def by_nature(self) -> bool:
        """Whether no batch can hold the case; False: something went wrong in a batch."""
        return self.why not in _WENT_WRONG

    def __str__(self) -> str:
        """The reason as a sentence, for logs and reports."""
        return _ALONE[self.why].format(self.detail)


class Latency(NamedTuple):
    """Wall times of the steps of an ADS in one case, s.

    mean, longest, median: of all steps.
    late: 99th percentile of all steps.
    reference: median of a fixed piece of work, timed between the steps in the same process.
    """

    mean: float = 0.0
    longest: float = 0.0
    median: float = 0.0
    late: float = 0.0
    reference: float = 0.0


@frozen
class Recording:
    """One simulated case: every vehicle's motion, the ego's contact, and why the drive ended.

    actors: their motions, by name.
    error: error message of a drive that failed; None: it did not.
    wall_time: of the drive, s.
    error_place: where in the user's code an exception came from, as `my_ads.py:42 in act`.
    batched: "batched" if its ADS asks SUMO and was driven in a batch; "compared" if the case was
        driven alone as well and was the same; else empty.
    commands: of each step, (steps, 2): acceleration (m/s2) and steering wheel angle (rad). Where
        something other than the vehicle model may move the ego, (steps, 7): heading (rad) at the
        step's start, then x, y (m), heading on the map, speed (m/s), acceleration, angle at its
        end. None without a contact, as only contacts are replayed.
    """

    ego: Trajectory
    actors: dict[str, Trajectory]
    collision: Collision | None
    end_reason: EndReason
    clips: tuple[Clip, ...] = ()
    error: str | None = None
    log: str = ""
    controller_latency: Latency = Latency()
    wall_time: float = 0.0
    error_place: str = ""
    batched: str = ""
    commands: FloatArray | None = field(default=None, compare=False, repr=False)

    def same_drive(self, other: Recording) -> bool:
        """Whether another recording has the same trajectories, contact, end, clips, error (with
        its place) and log, to the bit. Wall times, `batched` and `commands` are not compared.
        """

        def content(recording: Recording) -> tuple[object, ...]:
            """Everything that is compared; `repr` of numbers shows all their bits."""
            names = ("collision", "end_reason", "clips", "error", "log", "error_place")
            motions = [
                (name, car.length, car.width, *(getattr(car, key).tobytes() for key in CHANNELS))
                for name, car in ({"ego": recording.ego} | recording.actors).items()
            ]
            return motions, repr([getattr(recording, name) for name in names])

        return content(self) == content(other)

    @property
    def simulated_time(self) -> float:
        """Simulated time from the start of the case, 0, to its end, s."""
        return float(self.ego.time[-1])


def half_extents(
    heading: FloatArray, length: float | FloatArray, width: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Half the extents of rotated bodies along x and along y, m, of the heading's shape.

    heading: rad. length, width: of all bodies, or of each, m.
    """
    cosine, sine = np.abs(np.cos(heading)), np.abs(np.sin(heading))
    along, across = length * cosine + width * sine, length * sine + width * cosine
    return 0.5 * along, 0.5 * across
