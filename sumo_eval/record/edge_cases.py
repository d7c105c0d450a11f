"""Concrete scenarios at the edges of a space, where an ADS is most likely to fail. For
`sumo-eval check`.

Users: `cli/tools.py`.
"""

import itertools

import numpy as np

from sumo_eval.method.point_criticality import danger
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.samples import central_point, sample
from sumo_eval.settings import ZoneSettings
from sumo_eval.settings.random_streams import random_stream

_MOST_PARAMETERS = 10  # of a space whose corners, at most 2 ** 10, are used; with more, none


def edge_cases(logical: LogicalScenario, seed: int) -> list[ConcreteScenario]:
    """The concrete scenarios at up to seven points of a space: its centre, its most dangerous and
    its safest point, the points with the fastest and the slowest ego, and two corners.

    The extreme points are sought among the space's own sample and the corners of its box, as far as
    its constraints allow them. Of equally extreme points the first is taken. The seed draws the two
    corners. A point that has several of these properties stands once.
    """
    box = [(item.low, item.high) for item in logical.parameters]
    every = itertools.product(*box) if len(box) <= _MOST_PARAMETERS else ()
    corners = np.reshape(list(every), (-1, len(box)))
    corners = corners[logical.feasible(corners)]
    points = np.unique(np.concatenate([sample(logical).points, corners]), axis=0)
    # rounded: rounding errors must not make a difference between equally dangerous points
    risk = np.round(danger(logical, points, ZoneSettings()), 12)
    speed = np.array([case.ego.speed for case in logical.concretes(points)])
    drawn = random_stream(seed, "check", logical.name).permutation(len(corners))[:2]
    chosen = [
        central_point(logical),
        *(
            points[index]
            for index in (risk.argmax(), risk.argmin(), speed.argmax(), speed.argmin())
        ),
        *corners[np.sort(drawn)],
    ]
    return list(logical.concretes(list(dict.fromkeys(tuple(point.tolist()) for point in chosen))))
