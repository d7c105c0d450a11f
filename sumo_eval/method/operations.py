"""Operations of an ADS and of drivers, the n of Eq. 12: turns of the wheel and moves of the pedals.

Readings of the paper (docs/method.md):
- A signal is neutral at or below its threshold. Neutral time runs from the first neutral sample to
  the next sample above the threshold. Steering wheel angles that are not known (nan) are left out.
- One rule counts the steering operations of the ADS and of the drivers. By default an operation is
  a lateral manoeuvre: a move to one side at more than 0.12 m/s (mean over 1 s) that shifts the
  vehicle by at least 1 m. At motorway speed a lane change turns the wheel by 1 to 7 degrees, so the
  paper's 10 degrees would count none there.

Users: `method/`. Fixed: the counts, from which D_i and H follow.
"""

import math

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.method.checks import quotient
from sumo_eval.method.trajectory_field import SAME_TIME
from sumo_eval.settings import AnthropomorphicSettings
from sumo_eval.trajectory import BoolArray, FloatArray, Trajectory

DEFAULTS = AnthropomorphicSettings()

RELEASED = 0.8  # share of a level; at or below it the pedals count as moved back
SAME_PEAK = 1.0 - 1e-9  # share of a level; a sample above it is at the level, despite rounding
MANOEUVRE_SPEED = 0.12  # m/s; a vehicle that keeps its lane wanders more slowly
MANOEUVRE_SHIFT = 1.0  # m; a vehicle that keeps its lane wanders less far
# s; lateral speed is a mean over this time, because recorded positions are noisy
MANOEUVRE_WINDOW = 1.0


def count_operations(trajectory: Trajectory, settings: AnthropomorphicSettings = DEFAULTS) -> int:
    """Eq. 12: n, the number of operations of the steering wheel plus that of the pedals.

    trajectory: of the ADS or of a driver.
    settings: `[method.anthropomorphic]`: thresholds, neutral time, steering rule.

    An operation of the pedals begins where |acceleration| > 0.5 m/s2, and ends once the signal has
    been neutral for 0.5 s. So acceleration and braking right after it are one operation. An
    operation that has not ended by the last sample counts. A steering operation is a lateral
    manoeuvre. With `steering_rule = "wheel"` it is a turn of the steering wheel. The turn begins
    above 10 degrees (or the angle for a given lateral acceleration) and ends once the signal has
    been neutral for 0.5 s.

    Raises InputError under the rule "wheel" if the trajectory has no steering wheel angle: the ADS
    and the drivers are counted by one rule or not at all.
    """
    active = np.abs(trajectory.acceleration) > settings.acceleration_threshold
    pedals = _operations(active, trajectory.time, settings)
    return len(pedals) + _steering_operations(trajectory, settings)


def most_operations(trajectory: Trajectory, settings: AnthropomorphicSettings = DEFAULTS) -> int:
    """Eq. 12's n as f_n+ of H counts it: the largest n over several thresholds of |acceleration|.

    trajectory: of the ADS or of a driver.
    settings: `[method.anthropomorphic]`.

    Eq. 12 counts an oscillation without neutral time as one operation, so a stronger oscillation
    may have fewer operations than a weaker one. Here it never has: the thresholds (levels) are the
    signal's own peaks above 0.5 m/s2, and grow with it. Between two operations at a level the
    signal must also fall to 0.8 of the level, so the rounding of a constant acceleration makes no
    operations.
    """
    signal = np.abs(trajectory.acceleration)
    padded = np.concatenate(([-np.inf], signal, [-np.inf]))
    # whether each sample is at least as high as both neighbours
    peak = (signal >= padded[:-2]) & (signal >= padded[2:])
    levels = np.unique(signal[peak & (signal > settings.acceleration_threshold)])
    at_levels = [
        _operations(
            signal > SAME_PEAK * level, trajectory.time, settings, signal <= RELEASED * level
        )
        for level in levels
    ]
    return max(map(len, at_levels), default=0) + _steering_operations(trajectory, settings)


def _steering_operations(trajectory: Trajectory, settings: AnthropomorphicSettings) -> int:
    """Number of steering operations by the rule of the settings."""
    if settings.steering_rule == "manoeuvre":
        return _lateral_manoeuvres(trajectory, settings)
    has_angle = np.isfinite(trajectory.steering_wheel_angle)
    if not has_angle.any():
        raise InputError(
            '`steering_rule = "wheel"` of the anthropomorphic index needs the steering wheel angle '
            "of the ADS and of all drivers, and a trajectory has none; "
            '"manoeuvre" counts both alike without it.'
        )
    # Eq. 12: steering wheel angle above which an operation begins, rad, at each speed
    threshold: float | FloatArray = math.radians(settings.steering_threshold_deg)
    lateral = settings.steering_lateral_acceleration
    if lateral is not None:
        speed = trajectory.speed[has_angle]
        curvature = quotient(lateral, speed**2, speed > 0.0)
        threshold = settings.steering_ratio * np.arctan(settings.wheelbase * curvature)
    turned = np.abs(trajectory.steering_wheel_angle[has_angle]) > threshold
    return len(_operations(turned, trajectory.time[has_angle], settings))


def _operations(
    active: BoolArray,
    time: FloatArray,
    settings: AnthropomorphicSettings,
    released: BoolArray | None = None,
) -> list[tuple[int, int]]:
    """Indices of the first and the last active sample of each operation.

    active: whether the signal is above its threshold, (n,).
    time: of the samples, (n,), s.
    settings: `neutral_time`, the least neutral time between two operations, s.
    released: whether the pedals were moved back, (n,). A sample of this kind must lie between two
        operations. None: no such condition.
    """
    samples = np.flatnonzero(active)
    if samples.size == 0:
        return []
    # of each active sample but the last: neutral time before the next one, s, and whether an
    # operation ends here
    neutral = time[samples[1:]] - time[samples[:-1] + 1]
    ends = (np.diff(samples) > 1) & (neutral >= settings.neutral_time - SAME_TIME)
    if released is not None:
        # the number of released samples so far rises between the two active samples
        ends &= np.diff(np.cumsum(released)[samples]) > 0
    first = samples[np.append(True, ends)]
    last = samples[np.append(ends, True)]
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _lateral_manoeuvres(trajectory: Trajectory, settings: AnthropomorphicSettings) -> int:
    """Number of moves to one side that are too fast and too far for keeping a lane."""
    time, y = trajectory.time, trajectory.y
    if time.size < 2:
        return 0
    # mean lateral speed over the window around each sample, m/s
    before = np.maximum(time - MANOEUVRE_WINDOW / 2, time[0])
    after = np.minimum(time + MANOEUVRE_WINDOW / 2, time[-1])
    rate = (np.interp(after, time, y) - np.interp(before, time, y)) / (after - before)
    return sum(
        bool(side * (y[last] - y[first]) >= MANOEUVRE_SHIFT)
        for side in (-1.0, 1.0)
        for first, last in _operations(side * rate > MANOEUVRE_SPEED, time, settings)
    )
