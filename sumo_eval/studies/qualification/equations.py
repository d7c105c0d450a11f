"""Equations of the method beside plain loops that are written a second time, one number after the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from sumo_eval.method.anthropomorphic import anthropomorphic_index
from sumo_eval.method.collision_avoidance import collision_avoidance_index, collision_loss, impact_severity
from sumo_eval.method.criticality import max_inverse_ttc
from sumo_eval.method.score import combined_score
from sumo_eval.method.trajectory_field import trajectory_field
from sumo_eval.studies.qualification.check import Check
from sumo_eval.studies.qualification.driven import ROAD
from sumo_eval.trajectory import Trajectory

KIND = "equations"
K1, K2 = 0.5, 0.005
TIMES = tuple(k / 10 for k in range(101))


def _bending() -> Trajectory:
    """Ten seconds at about 20 m/s with a soft swing to the left and back."""
    x = np.array([50.0 + 20.0 * t for t in TIMES])
    return Trajectory(np.array(TIMES), x, np.array([0.3 * math.sin(t) for t in TIMES]), length=4.5, width=1.8)


def _walked_ittc(speed: float, lead: float, gap: float, braking: float = 5.0) -> float:
    """Eqs. 3-6, walked in steps of 0.1 ms."""
    largest, u, t = 0.0, speed - lead, 0.0
    while u > 0.0:
        largest = max(largest, u / (gap - (speed - lead) * t + braking * t * t / 2.0))
        t += 1e-4
        u = speed - lead - braking * t
    return largest


def _summed_field(px: float, py: float, drive: Trajectory) -> float:
    """Eqs. 9-10, a sample at a time."""
    total = 0.0
    for x, y, heading, speed in zip(drive.x, drive.y, drive.heading, drive.speed, strict=True):
        theta = math.atan2(py - y, px - x) - heading
        total += math.exp(K2 * speed * math.cos(theta)) / max(math.hypot(px - x, py - y), 1.0) ** K1
    return total


def checks() -> Iterator[Check]:
    """Eqs. 5-6, 9-10, 11-12, 14, 15, 17 and 18."""

    def of(name: str, source: str, expected: float, find: Callable[[], float], bound: float, unit: str = "") -> Check:
        return Check(KIND, name, source, float(expected), find, bound, unit)

    for speed, lead, gap in ((25.0, 15.0, 14.0), (20.0, 0.0, 60.0)):
        yield of(f"max ITTC, {speed:g} to {lead:g} m/s, {gap:g} m", "Eqs. 3-6, walked in 0.1 ms",
                 _walked_ittc(speed, lead, gap),
                 lambda v=speed, w=lead, d=gap: float(max_inverse_ttc(v, w, d)), 1e-6, "1/s")  # type: ignore[misc]  # fmt: skip
    drive = _bending()
    for px, py in ((120.0, 3.0), (260.5, -1.0)):
        yield of(f"field at ({px:g}, {py:g}) m", "Eqs. 9-10, a sample at a time", _summed_field(px, py, drive),
                 lambda at=(px, py): float(trajectory_field([at], drive, k1=K1, k2=K2)[0]), 1e-9)  # type: ignore[misc]  # fmt: skip
    yield of("D of identical drives", "Eqs. 11-12: whoever drives as people do has 1", 1.0,
             lambda: float(anthropomorphic_index(drive, [drive, drive], ROAD).value), 1e-12)  # fmt: skip
    for severity, loss in ((0.0, 0.1), (8.0, 0.4), (8.001, 0.7), (15.0, 0.7), (15.001, 1.0)):
        yield of(f"collision loss of {severity:g} m/s", "Eq. 14, at its limits", loss,
                 lambda u=severity: float(collision_loss(u)), 0.0)  # type: ignore[misc]  # fmt: skip
    # |(12, 0) - (9, 4)| = 5 m/s over the half of the bumper: 10
    yield of("severity of an offset collision", "Eq. 15: |(3, -4)| / 0.5", 10.0,
             lambda: float(impact_severity((12.0, 0.0), (9.0, 4.0), 0.5)), 1e-12, "m/s")  # fmt: skip
    # (1 * 5/10 + 3 * 4/16) / 4 = 0.3125
    yield of("C of two collisions", "Eq. 17: (1 * 5/10 + 3 * 4/16) / 4", 0.3125,
             lambda: collision_avoidance_index([10.0, 16.0], [5.0, 4.0], [1.0, 3.0]), 1e-12)  # fmt: skip
    yield of("C without a collision", "Eq. 17", 1.0, lambda: collision_avoidance_index([], [], []), 0.0)
    yield of("S of C = 0.8 and D = 0.6", "Eq. 18: 50 * 0.8 + 50 * 0.6", 70.0,
             lambda: combined_score(0.8, 0.6).total or math.nan, 1e-12)  # fmt: skip
