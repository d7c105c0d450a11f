"""Eqs. 9-10 one point at a time, as they are written."""

import numpy as np


def instantaneous_field(point, sample, k1, k2):
    """s = exp(k2 v cos theta) / max(|r|, 1)^k1; a point on the vehicle is dead ahead of it.

    sample: x, y, heading and speed, of each sample.
    """
    x, y, heading, speed = sample
    rx, ry = point[0] - x, point[1] - y
    distance = np.hypot(rx, ry)
    theta = np.where(distance > 1e-9, np.arctan2(ry, rx) - heading, 0.0)
    return np.exp(k2 * speed * np.cos(theta)) / np.maximum(distance, 1.0) ** k1


def samples(trajectory, interval=0.1):
    """The trajectory at first time, + interval, + 2 intervals, ..., linear between its own
    samples."""
    time, heading = trajectory.time, np.unwrap(trajectory.heading)
    wanted = time[0] + np.arange(0.0, time[-1] - time[0] + 1e-6, interval)
    channels = trajectory.x, trajectory.y, heading, trajectory.speed
    return np.array([np.interp(wanted, time, channel) for channel in channels])


def trajectory_field(point, trajectory, k1=0.5, k2=0.005, interval=0.1):
    """S = sum of s over the samples."""
    return instantaneous_field(point, samples(trajectory, interval), k1, k2).sum()


def vector_field(point, trajectory, k1=0.5, k2=0.005, interval=0.1):
    """|sum of s r/|r||; a sample on the point has no direction and adds nothing."""
    found = samples(trajectory, interval)
    r = (point[0] - found[0]) + 1j * (point[1] - found[1])
    directed = instantaneous_field(point, found, k1, k2) * r
    return abs(np.divide(directed, abs(r), where=abs(r) > 1e-9, out=np.zeros_like(r)).sum())
