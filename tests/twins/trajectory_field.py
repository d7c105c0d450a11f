"""Eqs. 9-10 one point and one sample at a time."""

import math

Sample = tuple[float, float, float, float]  # x, y, heading, speed


def instantaneous_field(point, sample, k1, k2):
    """s = exp(k2 v cos theta) / max(|r|, 1)^k1; a point on the vehicle is dead ahead of it."""
    x, y, heading, speed = sample
    rx, ry = point[0] - x, point[1] - y
    distance = math.hypot(rx, ry)
    theta = math.atan2(ry, rx) - heading if distance > 1e-9 else 0.0
    return math.exp(k2 * speed * math.cos(theta)) / max(distance, 1.0) ** k1


def samples(trajectory, interval=0.1):
    """The trajectory at first time, + interval, + 2 intervals, ..., linear between its own
    samples."""
    time = trajectory.time.tolist()
    heading = [float(trajectory.heading[0])]
    for angle in trajectory.heading[1:].tolist():
        heading.append(heading[-1] + math.remainder(angle - heading[-1], 2.0 * math.pi))
    channels = (trajectory.x.tolist(), trajectory.y.tolist(), heading, trajectory.speed.tolist())
    found = []
    step = 0
    while time[0] + step * interval <= time[-1] + 1e-6:
        wanted = min(time[0] + step * interval, time[-1])
        after = next(i for i, t in enumerate(time) if t >= wanted - 1e-9)
        before = max(after - 1, 0)
        share = (wanted - time[before]) / (time[after] - time[before]) if after > before else 0.0
        found.append(tuple(c[before] + share * (c[after] - c[before]) for c in channels))
        step += 1
    return found


def trajectory_field(point, trajectory, k1=0.5, k2=0.005, interval=0.1):
    """S = sum of s over the samples."""
    return sum(
        instantaneous_field(point, sample, k1, k2) for sample in samples(trajectory, interval)
    )


def vector_field(point, trajectory, k1=0.5, k2=0.005, interval=0.1):
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
