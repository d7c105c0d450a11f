"""Eqs. 9-10 one point and one sample at a time."""

import math
from collections.abc import Sequence

from sumo_eval.trajectory import Trajectory

Sample = tuple[float, float, float, float]  # x, y, heading, speed


def instantaneous_field(point: Sequence[float], sample: Sample, k1: float, k2: float) -> float:
    """s = exp(k2 v cos theta) / max(|r|, 1)^k1; a point on the vehicle is dead ahead of it."""
    x, y, heading, speed = sample
    rx, ry = point[0] - x, point[1] - y
    distance = math.hypot(rx, ry)
    theta = math.atan2(ry, rx) - heading if distance > 1e-9 else 0.0
    return math.exp(k2 * speed * math.cos(theta)) / max(distance, 1.0) ** k1


def samples(trajectory: Trajectory, interval: float = 0.1) -> list[Sample]:
    """The trajectory at first time, + interval, + 2 intervals, ..., linear between its own
    samples."""
    time = trajectory.time.tolist()
    heading = [float(trajectory.heading[0])]
    for angle in trajectory.heading[1:].tolist():
        heading.append(heading[-1] + math.remainder(angle - heading[-1], 2.0 * math.pi))
    channels = (trajectory.x.tolist(), trajectory.y.tolist(), heading, trajectory.speed.tolist())
    found: list[Sample] = []
    step = 0
    while time[0] + step * interval <= time[-1] + 1e-6:
        wanted = min(time[0] + step * interval, time[-1])
        after = next(i for i, t in enumerate(time) if t >= wanted - 1e-9)
        before = max(after - 1, 0)
        share = (wanted - time[before]) / (time[after] - time[before]) if after > before else 0.0
        found.append(tuple(c[before] + share * (c[after] - c[before]) for c in channels))  # type: ignore[arg-type]
        step += 1
    return found


def trajectory_field(
    point: Sequence[float],
    trajectory: Trajectory,
    k1: float = 0.5,
    k2: float = 0.005,
    interval: float = 0.1,
) -> float:
    """S = sum of s over the samples."""
    return sum(
        instantaneous_field(point, sample, k1, k2) for sample in samples(trajectory, interval)
    )


def vector_field(
    point: Sequence[float],
    trajectory: Trajectory,
    k1: float = 0.5,
    k2: float = 0.005,
    interval: float = 0.1,
) -> float:
    """|sum of s r/|r||; a sample on the point has no direction and adds nothing."""
    east = north = 0.0
    for sample in samples(trajectory, interval):
        rx, ry = point[0] - sample[0], point[1] - sample[1]
        distance = math.hypot(rx, ry)
        if distance > 1e-9:
            strength = instantaneous_field(point, sample, k1, k2)
            east += strength * rx / distance
            north += strength * ry / distance
    return math.hypot(east, north)
