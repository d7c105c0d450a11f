"""Small logical scenarios of one, two or three parameters, for tests of zones."""

import numpy as np

from sumo_eval.scenario import Approach, Constraint, LogicalScenario, Parameter, Road


def space(parameters, gap, ego_speed=20.0, delay=0.0, constraints=()):
    """A scenario over (name, low, high, step) whose obstacle stands `gap(values)` m ahead; speeds
    may be functions."""

    def approach(values):
        shape = np.shape(next(iter(values.values())))
        speed = ego_speed(values) if callable(ego_speed) else np.full(shape, ego_speed)
        return Approach(speed, np.zeros(shape), np.broadcast_to(gap(values), shape), delay)

    return LogicalScenario(
        name="toy",
        about="",
        source="",
        parameters=tuple(
            Parameter(name, low, high, step, "m", "") for name, low, high, step in parameters
        ),
        constraints=tuple(Constraint("one that exists", holds) for holds in constraints),
        road=Road("none", 100.0, 1, 3.5, 0.0),
        place=lambda values: None,
        approach=approach,
    )


def two_hills():
    """The gap is short around (30, 40) and around (80, 70), where the second is the smaller zone."""

    def gap(values):
        first = np.hypot(values["x"] - 30, values["y"] - 40) - 25
        return 45.102 + np.minimum(first, np.hypot(values["x"] - 80, values["y"] - 70) - 10)

    return space([("x", 0.0, 100.0, 10.0), ("y", 0.0, 100.0, 10.0)], gap)
