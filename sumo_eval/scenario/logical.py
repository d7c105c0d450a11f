"""A logical scenario: a scenario type with a parameter space, and how one point of it becomes a
concrete scenario.

Users: `drivers/`, `method/`, `record/`, `report/`, `results.py`, `scenario/`, `scoring/`,
`whatif/`, `extras/`.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, replace
from html import escape
from math import floor, inf, isfinite, log10
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import (
    InputError,
    SumoEvalError,
    check_known,
    check_name,
    must_be,
    users_code,
)
from sumo_eval.frozen import frozen, required
from sumo_eval.scenario.concrete import (
    CHANGES,
    Actor,
    ConcreteScenario,
    EgoBody,
    Numbers,
    Road,
    Start,
)
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.requirement import Requirements
from sumo_eval.settings.checked import Checked, FilledText, Natural, PositiveFloat, setting
from sumo_eval.text import point_words
from sumo_eval.trajectory import BoolArray, FloatArray

Values = Mapping[str, FloatArray]
"""Values of the parameters by name."""
PointFunction = Callable[[Values], FloatArray]
"""Function of points: values by name -> a number at each point."""
# digits that drawn values keep after the leading digit of their range (range 100 m: to 1e-4 m), so
# that machines which differ in the last bit draw the same points
DIGITS = 6
ONLY = "only"
"""Name of the parameter, without effect, of a scenario that has no parameters of its own."""


@frozen
class Parameter:
    """One axis of a space.

    low, high: ends of its range. step: of the default grid.
    unit: of all these numbers; "1" where they have none.
    about: meaning, for people.
    values: the only values it can take, ascending, from low to high; empty: any value of the range.
    distribution: how often values occur on the road; None: unknown.
    """

    name: str
    low: float
    high: float
    step: float
    unit: str
    about: str
    values: tuple[float, ...] = ()
    distribution: Distribution | None = None

    def __post_init__(self) -> None:
        owner = f"parameter `{self.name}`"
        low, high, values = self.low, self.high, self.values
        ascending = all(a < b for a, b in itertools.pairwise(values))
        if values and not (ascending and values[0] == low and values[-1] == high):
            raise must_be("`values`", owner, "ascending, from low to high", values)
        if not -inf < low < high < inf:
            raise must_be("The range", owner, "finite, low < high", f"{low}..{high}")
        if not (isfinite(self.step) and self.step > 0):
            raise must_be("`step`", owner, "greater than 0", self.step)

    def check(self, value: object, owner: str) -> None:
        """Refuse a value that is not on the axis; owner: how errors call the space."""
        what = f"`{self.name}`"
        if isinstance(value, bool) or not isinstance(value, Real):
            raise must_be(what, owner, "a number", value)
        number = float(value)
        if not self.low <= number <= self.high:
            raise must_be(
                what, owner, f"within {self.low:g}..{self.high:g}{self.unit_suffix}", number
            )
        if self.values and number not in self.values:
            allowed = ", ".join(f"{known:g}" for known in self.values)
            raise must_be(what, owner, f"one of {allowed}{self.unit_suffix}", number)

    def from_shares(self, shares: FloatArray) -> FloatArray:
        """Values (n,) at shares 0..1 of the range; listed values divide the shares equally."""
        if self.values:
            count = len(self.values)
            # `minimum`: the share 1 belongs to the last value
            index = np.minimum((shares * count).astype(np.intp), count - 1)
            return np.array(self.values, float)[index]
        return self.rounded(self.low + shares * (self.high - self.low))

    def rounded(self, values: FloatArray) -> FloatArray:
        """Values (n,) rounded as `DIGITS` says, and within the range."""
        decimals = DIGITS - floor(log10(self.high - self.low))
        return np.clip(np.round(values, decimals), self.low, self.high)

    @property
    def unit_suffix(self) -> str:
        """The unit as text after a number, with a space before it; empty without a unit."""
        return "" if self.unit == "1" else f" {self.unit}"

    @property
    def title(self) -> str:
        """Name and unit for an axis or a column: `gap (m)`; the name alone without a unit."""
        return self.name if self.unit == "1" else f"{self.name} ({self.unit})"


@frozen
class Constraint:
    """A condition on the points of the box: those that violate it do not exist.

    about: what a point must be, to follow "the point must be".
    holds: values by name (arrays that broadcast) -> whether the condition holds.
    room: values by name -> distance to the constraint's limit, in the constraint's own unit, below
        0 where it does not hold; None: unknown.
    """

    about: str
    holds: Callable[[Values], BoolArray]
    # not compared between constraints: the same `holds` has the same `room`
    room: PointFunction | None = field(default=None, compare=False)


@frozen
class Approach:
    """The quantities that decide a point's criticality: arrays that broadcast (Eqs. 1-6).

    ego_speed, obstacle_speed: at t = 0, m/s.
    gap: bumper to bumper at t = 0, m.
    delay: time until ideal braking begins, s.
    obstacle_deceleration: of an obstacle that brakes from t = 0 to a standstill, m/s2; 0: it keeps
        its speed.
    conflict_begin: time from which the obstacle is in the ego's path, s.
    passing_length: lengths of both bodies together, m. An ego whose front is further than this
        ahead of the obstacle's rear when the conflict begins has passed it.

    Where `obstacle_deceleration` or `conflict_begin` is not 0, no closed form exists. Then
    `method.criticality.searched_criticality` looks for the worst moment. It simulates nothing,
    unlike a `Search`.
    """

    ego_speed: FloatArray
    obstacle_speed: FloatArray
    gap: FloatArray
    delay: FloatArray | float
    obstacle_deceleration: FloatArray | float = 0.0
    conflict_begin: FloatArray | float = 0.0
    passing_length: float = inf

    @property
    def has_closed_form(self) -> BoolArray:
        """Whether the obstacle is in the ego's path from the start and keeps its speed, at every
        point.
        """
        return np.equal(self.obstacle_deceleration, 0.0) & np.equal(self.conflict_begin, 0.0)


def at_once(values: Values) -> FloatArray:
    """The default of `Search.delay`: the ego brakes as soon as the actor makes its first move."""
    return np.zeros(())


@frozen
class Search:
    """A zone rule by search: the motion of the actors is simulated, without SUMO, while the ego
    brakes ideally.

    obstacle: index of the actor for which the ego brakes.
    delay: values by name -> time from this actor's first move to ideal braking, s; if the actor
        makes no move, from t = 0.
    conflict: True: the time until both paths collide counts; False: the gap along the road.
    """

    obstacle: int
    delay: PointFunction = at_once
    conflict: bool = False


@frozen
class ZoneCoordinates:
    """Inputs for the zones' Gaussian process instead of the parameters: functions of these over
    which criticality is smooth, often fewer than the parameters.

    An example: a cut-in's criticality depends on the closing speed and on the gap that is left when
    the lane is entered. Over its four parameters the hazardous points form a thin curved sheet,
    which a Gaussian process fits badly.

    of: values by name (arrays) -> one array for each of `names`.
    """

    names: tuple[str, ...]
    of: Callable[[Values], tuple[FloatArray, ...]]


@frozen
class Option(Checked):
    """A number that `use` may set: `cut_in?lateral_acceleration=1.5`."""

    name: FilledText = required("name, for expressions and in `use`")
    unit: FilledText = required("unit; `1` for a share")
    about: str = setting("", "what it is")


@frozen
class NamedSample:
    """A list of prescribed points, rows in the order of `LogicalScenario.parameters`."""

    name: str
    about: str
    points: tuple[tuple[float, ...], ...]


@frozen
class Counterpart:
    """The events in recordings that correspond to a scenario.

    event: kind of event, as `drivers/recorded/events.py` names it.
    columns: (parameter, column of the table of events).
    tolerance: (parameter, largest difference from it of an event that counts as a point's).
    start: column with the time that is the scenario's t = 0.
    only: (column, value that it must have).
    """

    event: str
    columns: tuple[tuple[str, str], ...]
    tolerance: tuple[tuple[str, float], ...]
    start: str = "start"
    only: tuple[tuple[str, str], ...] = ()


@frozen
class Occurrence(Checked):
    """Frequency with which the scenario occurred on the road, over all values of its parameters."""

    events: Natural = required("how many times")
    vehicle_km: PositiveFloat = required("driven by all vehicles that might have met it", "km")
    where: str = setting("", "on which roads, when")


def uniform_exposure(values: Values) -> FloatArray:
    """Equal exposure of every concrete scenario."""
    return np.ones(np.broadcast_shapes(*map(np.shape, values.values())))


@frozen
class LogicalScenario:
    """A scenario type over a parameter space.

    Its zones come from one of `approach`, `search` and `margin`. Without any of them no zone can be
    defined, and all points are safe.

    about: what happens, a sentence. source: where the scenario comes from.
    place: values of one point -> (ego's start, the actors).
    approach: values by name (arrays) -> `Approach`: criticality without a simulation.
    exposure: values by name (arrays) -> probability density on the road, up to a factor.
    exposure_about: the same in words.
    ego_body, time_limit, standstill_time: as in `ConcreteScenario`.
    samples: prescribed points.
    default_sample: method of sampling by default: `grid`, or the name of one of `samples`.
    zone_coordinates: inputs of the zones' Gaussian process; None: the parameters.
    options: numbers that `use` may set.
    search: criticality by a simulation of the actors' motion, where it has no closed form.
    notes: sentences that stand with its zones in every report.
    recorded: the events in recordings that correspond to this scenario; None: unknown.
    met: how often it occurred on the road; None: unknown.
    margin: values by name (arrays) -> distance to a known limit, m; hazardous at 0 and below.
    has_drivers: whether synthetic drivers can drive it; False: D needs recorded drivers.
    requirements: conditions that must hold in every drive; None: no condition.
    fixed: (name, value) of each parameter that a slice holds fixed: no axis of the space, but all
        functions and each concrete scenario get its value.
    """

    name: str
    about: str
    source: str
    parameters: tuple[Parameter, ...]
    constraints: tuple[Constraint, ...]
    road: Road
    place: Callable[[Numbers], tuple[Start, tuple[Actor, ...]]]
    approach: Callable[[Values], Approach] | None = None
    exposure: PointFunction = uniform_exposure
    exposure_about: str = "uniform: every concrete scenario counts the same"
    ego_body: EgoBody | None = None
    time_limit: float | None = None
    standstill_time: float | None = None
    samples: tuple[NamedSample, ...] = ()
    default_sample: str = "grid"
    zone_coordinates: ZoneCoordinates | None = None
    options: tuple[Option, ...] = ()
    search: Search | None = None
    notes: tuple[str, ...] = ()
    recorded: Counterpart | None = None
    met: Occurrence | None = None
    margin: PointFunction | None = None
    has_drivers: bool = True
    requirements: Requirements | None = None
    fixed: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        check_name("a logical scenario", self.name)
        for parameter in self.parameters:
            check_name(f"a parameter of scenario `{self.name}`", parameter.name)

    def _repr_html_(self) -> str:
        """HTML that notebooks show: the description, and the parameters with their ranges."""
        rows = "".join(
            f"<tr><th>{escape(item.name)}</th><td>{item.low:g} to {item.high:g}"
            f"{escape(item.unit_suffix)}</td>"
            f"<td>{item.step:g}</td><td>{escape(item.about)}</td></tr>"
            for item in self.parameters
        )
        head = "<tr><th>parameter</th><th>range</th><th>step</th><th></th></tr>"
        constraints = "".join(
            f"<p>A possible point is {escape(constraint.about)}.</p>"
            for constraint in self.constraints
        )
        about = f"<p><b>{escape(self.name)}</b>: {escape(self.about)}</p>"
        return f"{about}<table><thead>{head}</thead><tbody>{rows}</tbody></table>{constraints}"

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names in the order of the columns of `points`."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def low(self) -> FloatArray:
        """Lower corner of the box."""
        return np.array([parameter.low for parameter in self.parameters])

    @property
    def high(self) -> FloatArray:
        """Upper corner of the box."""
        return np.array([parameter.high for parameter in self.parameters])

    def to_unit(self, points: ArrayLike) -> FloatArray:
        """Points (n, k) scaled to the unit box."""
        return (np.asarray(points, float) - self.low) / (self.high - self.low)

    def from_unit(self, unit_points: ArrayLike) -> FloatArray:
        """Points (n, k) of the unit box in the parameters' own units.

        A parameter with listed values can get a value between them, unlike with `from_shares`.
        """
        return self.low + np.asarray(unit_points, float) * (self.high - self.low)

    def from_shares(self, shares: ArrayLike) -> FloatArray:
        """Points (n, k) at shares 0..1 of each axis; a parameter with listed values gets one of
        them.
        """
        rows = np.asarray(shares, float)
        return np.column_stack(
            [item.from_shares(rows[:, column]) for column, item in enumerate(self.parameters)]
        )

    def column(self, name: str) -> int:
        """Index of a parameter's column of `points`."""
        check_known(f"parameter of scenario `{self.name}`", self.names, name)
        return self.names.index(name)

    def columns(self, points: ArrayLike) -> dict[str, FloatArray]:
        """Points (..., k) as one array per parameter name, also of the fixed parameters."""
        array = np.asarray(points, float)
        if array.shape[-1] != len(self.parameters):
            raise must_be(
                "The last axis of `points`", f"scenario `{self.name}`",
                f"{len(self.parameters)} long ({', '.join(self.names)})", array.shape,
            )  # fmt: skip
        free = {name: array[..., column] for column, name in enumerate(self.names)}
        return free | {name: np.full(array.shape[:-1], value) for name, value in self.fixed}

    def row(self, values: Numbers) -> FloatArray:
        """Values by name as one row in the order of `parameters`."""
        return np.array([values[name] for name in self.names])

    def point(self, row: Iterable[float]) -> dict[str, float]:
        """Values by name of a row in the order of `parameters`."""
        return dict(zip(self.names, row, strict=True))

    def in_box(self, points: ArrayLike) -> BoolArray:
        """Whether each of the points (n, k) is within the ranges of all parameters."""
        array = np.asarray(points, float)
        inside: BoolArray = np.all((array >= self.low) & (array <= self.high), axis=-1)
        return inside

    def feasible(self, points: ArrayLike) -> BoolArray:
        """Whether each of the points (n, k) satisfies every constraint."""
        holds = np.ones(np.shape(points)[:-1], bool)
        for constraint in self.constraints:
            holds &= self.values(constraint.holds, points)
        return holds

    def values(self, function: Callable[[Values], Any], points: ArrayLike) -> Any:
        """Values of one of its functions, which may be the user's, at points (..., k)."""
        with users_code(f"Scenario `{self.name}` failed", SumoEvalError):
            return function(self.columns(points))

    def exposures(self, points: FloatArray) -> FloatArray:
        """Exposure of each of the points (n, k); a user's function may give one number for all."""
        with users_code(f"The exposure of scenario `{self.name}` failed", SumoEvalError):
            exposure = np.asarray(self.exposure(self.columns(points)), float)
            return np.broadcast_to(exposure, len(points))

    def concrete(self, **values: float) -> ConcreteScenario:
        """The concrete scenario at a point.

        values: of every parameter, by name.

        Gaps begin at the bumpers of an ego of 4.5 m, unless the scenario has a body for the ego.
        `scenario.resolved.find_with` gives the scenario for the vehicle of a run.

        Raises InputError for unknown, missing, out-of-range and impossible values.
        """
        owner = f"scenario `{self.name}`"
        names = self.names
        check_known(f"parameter of {owner}", names, *values)
        for parameter in self.parameters:
            if parameter.name not in values:
                raise InputError(f"Parameter `{parameter.name}` of {owner} is missing.")
            parameter.check(values[parameter.name], owner)
        point = {name: float(values[name]) for name in names} | dict(self.fixed)
        arrays = {name: np.float64(value) for name, value in point.items()}
        for constraint in self.constraints:
            if not np.all(constraint.holds(arrays)):  # type: ignore[arg-type]
                raise must_be("The point", owner, constraint.about, point_words(point))
        exposure = float(self.exposure(arrays))  # type: ignore[arg-type]
        return replace(self.placed(point), exposure=exposure)

    def placed(self, point: Numbers) -> ConcreteScenario:
        """The concrete scenario at values by name, with exposure 1. The values are not checked:
        constraints may forbid them.
        """
        values = {**point, **dict(self.fixed)}
        # parameters that are themselves settings of the drive
        changes = tuple((name, value) for name, value in values.items() if name in CHANGES)
        return ConcreteScenario(
            self.name, values, 1.0, self.road, *self.place(values), self.ego_body, self.time_limit,
            self.standstill_time, changes,
        )  # fmt: skip

    def concretes(self, points: ArrayLike) -> list[ConcreteScenario]:
        """The concrete scenarios at `points`, (..., k) or an empty list."""
        if np.shape(points) == (0,):
            return []
        self.columns(points)  # refuses points of another length
        rows = np.reshape(points, (-1, len(self.names))).tolist()
        return [self.concrete(**self.point(row)) for row in rows]
