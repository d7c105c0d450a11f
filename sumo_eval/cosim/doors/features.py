"""Table of a learned policy's inputs and outputs: the file `policy.toml` next to `policy.onnx`.

    frame = "road"                      # or "ego": x ahead of the ego and y to its left

    [[feature]]
    name = "lead.gap"
    low = 0.0                           # values are kept within low..high and mapped onto -1..1
    high = 150.0

    [[action]]
    name = "acceleration"               # or "steering": steering wheel angle, rad
    low = -8.0                          # the policy's -1..1 is mapped onto low..high
    high = 3.0
    # values = [-8.0, 0.0, 2.0]         # instead of low and high: a discrete set, of which the
                                        # best scored combination is taken

A feature may have `mean` and `deviation` instead of the range: (value - mean) / deviation. A
feature with neither, and an action without a range, are not scaled. `absent` replaces the value of
a vehicle that does not exist; it is limited and scaled like any value. Without `absent`, gap and x
are 1000 m there, kind is -1, `lead.speed` is the ego's speed, and other values are 0. `present` is
0 there and takes no `absent`.

Names and scaling of features are a format: policies are trained with it.

Users: `cosim/doors/onnx.py`, `extras/gym/`.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.doors.observation import Observations, SeenEgo
from sumo_eval.errors import InputError, check_known, must_be, unknown
from sumo_eval.frozen import frozen
from sumo_eval.settings.checked import Checked, PositiveOrNone
from sumo_eval.settings.config import read_checked, to_toml

Floats = NDArray[Any]
_Reader = Callable[[Observations, str], Floats]
ACTIONS = ("acceleration", "steering")

_LEAD = ("present", "gap", "relative_speed", "speed", "offset")
_VEHICLE = (
    "present", "gap", "relative_speed", "offset", "overlaps", "ahead", "speed", "lateral_speed",
    "lane", "length", "width", "x", "y", "vx", "vy", "kind"
)  # fmt: skip
NAMES = (
    "time", "left_edge", "right_edge", "lane_offset", *(f"ego.{name}" for name in SeenEgo._fields),
    *(f"lead.{name}" for name in _LEAD), *(f"vehicles.1.{name}" for name in _VEHICLE),
)  # fmt: skip
"""Names of features; `vehicles.1` is the nearest along the road, `vehicles.2` the next."""

# Values of a vehicle that does not exist: distances, m, beyond any to which a policy reacts, and a
# number that is no kind of vehicle. Every other value is 0, but `lead.speed` is the ego's.
_WHERE_ABSENT = {"gap": 1000.0, "x": 1000.0, "kind": -1.0}


@frozen
class Feature(Checked):
    """One input of a policy, and how it is scaled.

    low, high: the value is limited to low..high and mapped onto -1..1.
    mean, deviation: the value is mapped onto (value - mean) / deviation.
    absent: value if its vehicle does not exist, before limits and scaling; None: the ego's speed
        for `lead.speed`, else the value in `_WHERE_ABSENT`, or 0. `present`, and features of no
        vehicle, take none.
    """

    name: str
    low: float | None = None
    high: float | None = None
    mean: float | None = None
    deviation: PositiveOrNone = None
    absent: float | None = None

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        _check_range(self.name, self.low, self.high)
        if (self.mean is None) != (self.deviation is None):
            raise InputError(
                f"Feature `{self.name}` must have both `mean` and `deviation`, got one."
            )
        if self.mean is not None and self.low is not None:
            raise InputError(
                f"Feature `{self.name}` must have a range or a mean and a deviation, got both."
            )
        _reader(self.name)
        of_vehicle = self.name.startswith(("lead.", "vehicles."))
        if self.absent is not None and (self.name.endswith(".present") or not of_vehicle):
            why = "is 0 without a vehicle" if of_vehicle else "always has a value"
            raise InputError(
                f"Feature `{self.name}` must have no `absent`, as it {why}, got "
                f"{self.absent:g}. Remove `absent`."
            )


@frozen
class Action(Checked):
    """One output of a policy.

    low, high: accelerations, m/s2, or steering wheel angles, rad, of the outputs -1 and 1; None:
        the output itself is in m/s2 or rad.
    values: the discrete set of accelerations or angles; None: any number.
    """

    name: str
    low: float | None = None
    high: float | None = None
    values: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        check_known("action", ACTIONS, self.name)
        if self.values is not None and (self.low is not None or not self.values):
            raise must_be(
                "`values`", f"`{self.name}`", "numbers, without `low` and `high`", self.values
            )
        _check_range(self.name, self.low, self.high)

    def unscaled(self, outputs: Floats) -> Floats:
        """Accelerations, m/s2, or steering wheel angles, rad, of outputs of the policy; not finite
        where an output is not.
        """
        if self.low is None or self.high is None:
            return outputs
        share = 0.5 * (np.clip(outputs, -1.0, 1.0) + 1.0)  # 0..1
        return np.where(np.isfinite(outputs), self.low + share * (self.high - self.low), np.nan)


@dataclass(frozen=True)
class Interface(Checked):
    """Inputs and outputs of a policy.

    frame: axes of `vehicles.K.x`, `y`, `vx`, `vy`: the road's or the ego's. These values, and each
        `relative_speed`, are the other vehicle's minus the ego's.
    period: s between two answers, the last answer holds in between; None: an answer at each step.
    """

    features: tuple[Feature, ...]
    actions: tuple[Action, ...]
    frame: Literal["road", "ego"] = "road"
    period: PositiveOrNone = None

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if not self.features:
            raise must_be("The features", "an interface of a policy", "at least one", "none")
        names = tuple(action.name for action in self.actions)
        if names not in (ACTIONS[:1], ACTIONS):
            raise must_be("The actions", "an interface of a policy", "acceleration, or "
                                                                     "acceleration and steering",
                          ", ".join(names) or "none")  # fmt: skip
        if len({action.values is None for action in self.actions}) > 1:
            must = "given for every action or for none"
            raise must_be("`values`", "an interface of a policy", must, "one of two")

    @cached_property
    def choices(self) -> Floats | None:
        """Combinations of the discrete values, (choices, actions); None: a continuous set."""
        if self.actions[0].values is None:
            return None
        return np.array(list(itertools.product(*(it.values or () for it in self.actions))))

    @property
    def width(self) -> int:
        """How many numbers an answer has: one an action, or the score of each choice."""
        return len(self.actions) if self.choices is None else len(self.choices)

    @cached_property
    def _readers(self) -> list[tuple[_Reader, float]]:
        """Reader of each feature, and its value if its vehicle does not exist."""
        readers = []
        for it in self.features:
            read = _reader(it.name)
            if it.absent is None:
                readers.append((read, _WHERE_ABSENT.get(it.name.rpartition(".")[2], 0.0)))
            else:
                readers.append((_nan_without_lead(it.name, read), it.absent))
        return readers

    def show(self, seen: Observations) -> NDArray[np.float32]:
        """The features of n cases, (n, number of features)."""
        raw = np.empty((len(seen.number), len(self.features)))
        for column, (read, absent) in enumerate(self._readers):
            value = read(seen, self.frame)
            # not finite: of a vehicle that does not exist, see `_reader`
            raw[:, column] = np.where(np.isfinite(value), value, absent)
        offset, scale, *limits = self._scaling
        np.clip(raw, *limits, out=raw)
        return np.asarray((raw - offset) / scale, np.float32)

    @cached_property
    def _scaling(self) -> Floats:
        """Rows offset, scale, low and high, (4, number of features): each value is limited to
        low..high, and becomes (value - offset) / scale.
        """
        rows = []
        for it in self.features:
            if it.low is not None and it.high is not None:
                rows.append((0.5 * (it.low + it.high), 0.5 * (it.high - it.low), it.low, it.high))
            else:
                rows.append((it.mean or 0.0, it.deviation or 1.0, -np.inf, np.inf))
        return np.array(rows).T

    def commands(self, answers: Floats) -> Floats:
        """Answers (n, width) as accelerations, m/s2, and steering wheel angles, rad: (n, 2).

        Of a discrete set, each row gets the choice with the highest score; nan if any score is not
        finite.
        """
        commands = np.zeros((len(answers), 2))
        if self.choices is not None:
            commands[:, : len(self.actions)] = self.choices[np.argmax(answers, axis=1)]
            commands[~np.isfinite(answers).all(axis=1)] = np.nan
            return commands
        for column, action in enumerate(self.actions):
            commands[:, column] = action.unscaled(np.asarray(answers[:, column], float))
        return commands

    def to_toml(self) -> str:
        """The table as a file has it."""
        return to_toml(
            _File(self.features, self.actions, self.frame, self.period)  # type: ignore[arg-type]
        )


@frozen
class _File(Checked):
    """The table as a file has it."""

    feature: tuple[Feature, ...] = ()
    action: tuple[Action, ...] = ()
    frame: Literal["road", "ego"] = "road"
    period: PositiveOrNone = None


def read_interface(path: Path) -> Interface:
    """The table in a file.

    Raises InputError for a mistake in it.
    """
    table = read_checked(path, _File, "Features table")
    actions = table.action or (Action("acceleration"),)
    try:
        return Interface(table.feature, actions, table.frame, table.period)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def usual(*, steering: bool = False) -> Interface:
    """The default features and actions: the ego, its lane, its lead, and the two nearest
    vehicles.

    steering: whether the policy steers.
    """
    features = [
        Feature("ego.speed", 0.0, 60.0), Feature("ego.acceleration", -10.0, 10.0),
        Feature("ego.heading", -0.5, 0.5),
        Feature("lane_offset", -2.0, 2.0), Feature("left_edge", 0.0, 15.0),
        Feature("right_edge", 0.0, 15.0),
        Feature("lead.present", 0.0, 1.0), Feature("lead.gap", 0.0, 150.0),
        Feature("lead.relative_speed", -40.0, 40.0),
        Feature("lead.offset", -4.0, 4.0),
    ]  # fmt: skip
    for k in (1, 2):
        features += [
            Feature(f"vehicles.{k}.present", 0.0, 1.0), Feature(f"vehicles.{k}.x", -150.0, 150.0),
            Feature(f"vehicles.{k}.y", -8.0, 8.0), Feature(f"vehicles.{k}.vx", -40.0, 40.0),
            Feature(f"vehicles.{k}.vy", -4.0, 4.0),
        ]  # fmt: skip
    actions = [Action("acceleration", -8.0, 3.0)]
    if steering:
        actions.append(Action("steering", -1.0, 1.0))
    return Interface(tuple(features), tuple(actions))


def _reader(name: str) -> _Reader:
    """Reader of a feature.

    Without the vehicle, `lead.gap` is inf and every value of `vehicles.NUMBER` but `present` is
    nan. All other values are finite: of the lead as `Observations.lead` gives them.

    name: `time`, `ego.VALUE`, `lead.VALUE` or `vehicles.NUMBER.VALUE`.
    """
    group, _, rest = name.partition(".")
    if name in _UNGROUPED:
        return _UNGROUPED[name]
    if (group == "ego" and rest in SeenEgo._fields) or (group == "lead" and rest in _LEAD):
        return lambda seen, frame: getattr(getattr(seen, group), rest)
    number, _, value = rest.partition(".")
    if group == "vehicles" and number.isdecimal() and int(number) > 0 and value in _VEHICLE:
        index = int(number) - 1
        return lambda seen, frame: _of_vehicle(seen, frame, index, value)
    raise unknown("feature", name, NAMES)


def _nan_without_lead(name: str, read: _Reader) -> _Reader:
    """The reader of a feature, but of one of the lead with nan where there is no lead."""
    if not name.startswith("lead."):
        return read
    return lambda seen, frame: np.where(seen.lead.present, read(seen, frame), np.nan)


_UNGROUPED: Mapping[str, _Reader] = {
    "time": lambda seen, frame: np.full(len(seen.number), seen.time),
    "left_edge": lambda seen, frame: seen.road.left_edge_at(seen.ego.x) - seen.ego.y,
    "right_edge": lambda seen, frame: seen.ego.y - seen.road.right_edge_at(seen.ego.x),
    "lane_offset": lambda seen, frame: seen.ego.y - seen.road.lane_width * seen.ego.lane,
}
"""Readers of features whose names have no point."""


def _of_vehicle(seen: Observations, frame: str, index: int, what: str) -> Floats:
    """A value of one vehicle of each case, (n,); nan where there is none.

    index: 0 for the nearest vehicle along the road, 1 for the next.
    what: name of the value, one of `_VEHICLE`.
    """
    nearest = seen.nearest
    if index >= nearest.shape[1]:
        return np.full(len(nearest), 0.0 if what == "present" else np.nan)
    vehicles, ego = seen.vehicles, seen.ego
    at = np.arange(len(nearest)), nearest[:, index]  # row and column of the vehicle in each case
    exists = np.isfinite(vehicles.gap[at])
    if what == "present":
        return np.asarray(exists, float)
    if what in ("x", "y"):
        value = _along(what, frame, ego, seen.distances[at], vehicles.offset[at])
    elif what in ("vx", "vy"):
        left = vehicles.lateral_speed[at] - ego.speed * np.sin(ego.heading)
        value = _along(what, frame, ego, vehicles.relative_speed[at], left)
    elif what == "kind":
        value = seen.kinds[at]
    else:
        value = getattr(vehicles, what)[at]
    return np.where(exists, value, np.nan)


def _along(what: str, frame: str, ego: Any, ahead: Floats, left: Floats) -> Floats:
    """Part along an axis of `frame`, x for `x` and `vx`, y for `y` and `vy`, of vectors (n,).

    ahead, left: parts of the vectors along and across the road.
    """
    if frame == "ego":
        c = np.cos(ego.heading)
        s = np.sin(ego.heading)
        ahead, left = c * ahead + s * left, c * left - s * ahead
    return ahead if what in ("x", "vx") else left


def _check_range(name: str, low: float | None, high: float | None) -> None:
    """Raise InputError unless both limits are given, the lower one first, or none."""
    if (low is None) != (high is None) or (low is not None and high is not None and not low < high):
        raise must_be("`low` and `high`", f"`{name}`", "both given, low < high", (low, high))
