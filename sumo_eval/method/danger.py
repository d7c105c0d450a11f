"""How dangerous a point of a space is for an ideally braking vehicle, on a scale from 0 to 1."""

from __future__ import annotations

import numpy as np

from sumo_eval.method.zone_partition import exact_target
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings import ZoneSettings
from sumo_eval.trajectory import FloatArray


def danger(logical: LogicalScenario, points: FloatArray, settings: ZoneSettings) -> FloatArray:
    """(1 - y) / 2 of the criticality y that the zones are learnt from (Eqs. 5-7): 0.5 on the zone boundary, 1 where
    ideal braking hits hard, 0 where nothing comes near. points: (n, k); returns (n,).
    """
    return np.asarray((1.0 - exact_target(logical, points, settings)) / 2.0)
