"""Ideal braking as a person would simulate it: march through time, integrate, look where it
touches. Slow and plain."""

import itertools
import math

STEPS = 400  # to each phase: waiting, ramp, plateau


def braked(ego_speed, lead_speed, gap, deceleration, delay=0.0, build_up=0.0):
    """(largest ITTC, relative speed at contact) of one approach; ITTC is inf if it hits, the speed
    is 0 if not."""
    closing = ego_speed - lead_speed
    if closing <= 0:
        return 0.0, 0.0
    if gap <= 0:
        return math.inf, closing

    def speed(t):
        if t <= delay:
            return closing
        if t <= delay + build_up:
            return closing - deceleration / build_up * (t - delay) ** 2 / 2
        return closing - deceleration * build_up / 2 - deceleration * (t - delay - build_up)

    def travelled(t0, t1):  # Simpson, exact: the speed is at most quadratic within a phase
        return (t1 - t0) / 6 * (speed(t0) + 4 * speed((t0 + t1) / 2) + speed(t1))

    longest = closing / deceleration + build_up + 1.0
    edges = [0.0, delay, delay + build_up, delay + build_up + longest]
    grid = [0.0]
    for start, end in itertools.pairwise(edges):
        if end > start:
            grid += [start + (end - start) * i / STEPS for i in range(1, STEPS + 1)]

    gaps = [gap]
    for t0, t1 in itertools.pairwise(grid):
        if speed(t1) <= 0:
            t1 = bisect(lambda t: speed(t) > 0, t0, t1)
        after = gaps[-1] - travelled(t0, t1)
        if after <= 0:
            left = gaps[-1]
            touch = bisect(lambda t, t0=t0, left=left: left - travelled(t0, t) > 0, t0, t1)
            return math.inf, speed(touch)
        gaps.append(after)
        if speed(t1) <= 1e-12:
            break
    ittc = [speed(t) / d for t, d in zip(grid, gaps, strict=False) if t <= t1]
    best = max(range(len(ittc)), key=ittc.__getitem__)
    low, high = grid[max(best - 1, 0)], min(grid[min(best + 1, len(grid) - 1)], t1)

    def ittc_at(t):
        k = max(i for i in range(len(ittc)) if grid[i] <= t)
        return speed(t) / (gaps[k] - travelled(grid[k], t))

    for _ in range(100):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        low, high = (a, high) if ittc_at(a) < ittc_at(b) else (low, b)
    return max(ittc[best], ittc_at((low + high) / 2)), 0.0


def bisect(holds, low, high):
    """Where a condition that holds at `low` and not at `high` ends."""
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return (low + high) / 2
