"""Small logical scenarios of one, two or three parameters, for tests of zones."""

import numpy as np

from sumo_eval.scenario import Approach, Constraint, LogicalScenario, Parameter, Road


def space(axes, gap, ego_speed=20.0, delay=0.0, constraints=()):
    """A scenario whose obstacle stands `gap` m ahead; gap, speed and constraints may be functions
    of its parameters.

    axes: their names, lows, highs and steps, as `x 0 100 10, y 0 1 0.5`.
    """

    def approach(values):
        shape = np.shape(next(iter(values.values())))
        gaps, speeds = (
            np.broadcast_to(it(**values) if callable(it) else it, shape) for it in (gap, ego_speed)
        )
        return Approach(speeds, np.zeros(shape), gaps, delay)

    return LogicalScenario(
        name="toy",
        about="",
        source="",
        parameters=tuple(
            Parameter(name, *map(float, numbers), "m", "")
            for name, *numbers in map(str.split, axes.split(","))
        ),
        constraints=tuple(
            Constraint("one that exists", lambda values, holds=holds: holds(**values))
            for holds in constraints
        ),
        road=Road("none", 100.0, 1, 3.5, 0.0),
        place=lambda values: None,
        approach=approach,
    )


def two_hills():
    """The gap is short around (30, 40) and around (80, 70), where the second is the smaller zone."""

    def gap(x, y):
        return 45.102 + np.minimum(np.hypot(x - 30, y - 40) - 25, np.hypot(x - 80, y - 70) - 10)

    return space("x 0 100 10, y 0 100 10", gap)
