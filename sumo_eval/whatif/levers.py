"""Levers of a case: settings and parameters, of which `whatif/search.py` moves one at a time.

Users: `report/levers_section.py`, `whatif/search.py`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from operator import attrgetter

from sumo_eval.errors import InputError
from sumo_eval.frozen import frozen
from sumo_eval.groups import evenly_spread
from sumo_eval.scenario.concrete import Actor, ConcreteScenario
from sumo_eval.scenario.logical import ONLY, LogicalScenario
from sumo_eval.settings import SimulationSettings

VALUES = 33
"""Most values along a lever in the first round."""
_FINE = 1024  # steps from the lowest to the highest value of a scenario's parameter
_SETTINGS = {
    "conditions.perception_delay": (0.0, 2.0, 0.0, "s"),
    "conditions.actuation_delay": (0.0, 2.0, 0.0, "s"),
    "conditions.sensor_range": (10.0, 300.0, 0.5, "m"),
    "vehicle.max_deceleration": (1.0, 12.0, 0.01, "m/s2"),
    "vehicle.friction": (0.05, 1.2, 0.002, "1"),
}
"""Setting: lowest and highest value, step (0: the simulation's time step), unit."""
_SPEED, _GAP = "ego_speed", "gap"
"""Levers of the start: the ego's speed, and the gap to the lead vehicle. A parameter of the
scenario replaces the lever of the same name.
"""
_FASTEST, _FARTHEST = 40.0, 100.0  # highest values of these levers, m/s and m


@frozen
class Lever:
    """A quantity that is moved while all others stay as recorded.

    low, high: range of its values, in `unit`.
    step: distance between neighbouring values: a change of outcome is located to a step.
    recorded: its value in the recorded case; `high` if it is unlimited there.
    listed: the only values that it can have; empty: every step of the range.
    unlimited: whether it is a limit, such as the sensor's range, that the recorded case does not
        have.
    """

    name: str
    unit: str
    low: float
    high: float
    step: float
    recorded: float
    listed: tuple[float, ...] = ()
    unlimited: bool = False

    def steps(self) -> list[float]:
        """Its values: `low` and every step from there, rounded to 9 digits."""
        return list(self.listed) or [
            round(min(self.low + number * self.step, self.high), 9)
            for number in range(1 + round((self.high - self.low) / self.step))
        ]

    def place(self, value: float) -> float:
        """Where a value lies in the range, 0 (low) to 1 (high)."""
        return (value - self.low) / (self.high - self.low)

    def share(self, value: float) -> float:
        """Distance of a value from the recorded one, as a share of the range."""
        return abs(self.place(value) - self.place(self.recorded))


def levers_of(
    logical: LogicalScenario, values: Mapping[str, float], settings: SimulationSettings
) -> list[Lever]:
    """The levers of a case: conditions, brakes, friction, start, parameters of its scenario.

    values: the recorded point.
    settings: of the run.
    """
    levers = [
        *_setting_levers(settings),
        # `placed`: the recorded point fulfils the constraints
        *_start_levers(logical.placed(values), settings),
        *_parameter_levers(logical, values),
    ]
    # of two levers of one name the last stays: a parameter of the scenario
    return list({lever.name: lever for lever in levers}.values())


def _setting_levers(settings: SimulationSettings) -> Iterator[Lever]:
    """The levers of `_SETTINGS`; a recorded value outside their range widens it."""
    for name, (low, high, step, unit) in _SETTINGS.items():
        value = attrgetter(name)(settings)
        recorded = high if value is None else float(value)
        low, high = min(low, recorded), max(high, recorded)
        yield Lever(name, unit, low, high, step or settings.step, recorded, unlimited=value is None)


def _start_levers(concrete: ConcreteScenario, settings: SimulationSettings) -> Iterator[Lever]:
    """The ego's speed at the start, and its gap to the lead vehicle, if there is one."""
    ego = concrete.ego
    # an ego that starts at rest or moves sideways has no lever of its speed
    if ego.speed > 0.0 and not ego.lateral_speed:
        yield Lever(_SPEED, "m/s", 0.0, max(_FASTEST, ego.speed), 0.05, ego.speed)
    ahead = _ahead(concrete)
    if ahead is not None:
        # the gap is from the ego's front to the actor's rear; `x` is the place of a centre
        bodies = ahead.length + concrete.simulation(settings).vehicle.length
        gap = ahead.start.x - ego.x - bodies / 2.0
        yield Lever(_GAP, "m", min(0.0, gap), max(_FARTHEST, gap), 0.1, gap)


def _parameter_levers(logical: LogicalScenario, values: Mapping[str, float]) -> Iterator[Lever]:
    """The parameters of the scenario."""
    for item in logical.parameters:
        if item.name != ONLY:  # the parameter of a scenario without any
            step = (item.high - item.low) / _FINE
            value = values[item.name]
            yield Lever(item.name, item.unit, item.low, item.high, step, value, item.values)


def first_values(
    logical: LogicalScenario, values: Mapping[str, float], lever: Lever
) -> list[float]:
    """Values of the first round, evenly spread over those at which the scenario has a point."""
    steps = lever.steps()
    chosen = evenly_spread(steps, VALUES)
    # All steps are tried only if one of these is impossible: making a thousand concrete scenarios
    # takes time.
    if any(moved(logical, values, lever, value) is None for value in chosen):
        possible = [it for it in steps if moved(logical, values, lever, it) is not None]
        chosen = evenly_spread(possible, VALUES)
    return chosen


def moved(
    logical: LogicalScenario,
    values: Mapping[str, float],
    lever: Lever,
    value: float,
    *,
    revealed: bool = False,
) -> ConcreteScenario | None:
    """The concrete scenario of a case with one lever at a value; None: the scenario has no such
    point.

    values: the recorded point.
    revealed: whether the ADS receives the parameters. If not, the values in the result stay as
        recorded, because the random numbers of the case depend on them.
    """
    if lever.name in logical.names and value != lever.recorded:
        try:
            point = logical.concrete(**{**values, lever.name: value})
        except InputError:
            return None
        return point if revealed else replace(point, values=values)
    recorded = logical.placed(values)
    if value == lever.recorded:  # of an unlimited lever: without the limit
        return recorded
    if lever.name == _SPEED:
        return replace(recorded, ego=replace(recorded.ego, speed=value))
    if lever.name == _GAP:
        ahead = _ahead(recorded)
        assert ahead is not None  # else the case has no such lever
        start = replace(ahead.start, x=ahead.start.x + value - lever.recorded)
        actors = (replace(it, start=start) if it == ahead else it for it in recorded.actors)
        return replace(recorded, actors=tuple(actors))
    return replace(recorded, changes=(*recorded.changes, (lever.name, value)))


def _ahead(concrete: ConcreteScenario) -> Actor | None:
    """The nearest actor ahead in the ego's lane at the start. Actors placed on the map do not
    count: they cross the road.
    """
    ego = concrete.ego
    half = concrete.road.lane_width / 2.0
    return min(
        (
            it
            for it in concrete.actors
            if it.start.x > ego.x and abs(it.start.y - ego.y) < half and it.on_map is None
        ),
        key=lambda it: it.start.x,
        default=None,
    )
