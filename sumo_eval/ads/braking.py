"""Brakes in continuous time, for drivers that are asked once a step.

A driver's braking is a path: a deceleration over time that may begin, rise, hold and end anywhere within a step. The
vehicle model's brakes move to a told level at a finite rate, from the beginning of the step on, and then hold it. So a
level is told for the speed that it takes off, not for what is wanted at some instant of the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from sumo_eval.settings import VehicleSettings

_HALVINGS = 20  # of a step, to find an instant in it: 5e-8 s of 0.05 s
_JUMP = 0.5  # m/s2 by which a demand must change within a step to be looked at for a jump: 10 m/s3 at 0.05 s
_INSIDE = 1e-3  # of a part of a step: at its very ends a demand may be that before or after it


class Braked(NamedTuple):
    """lost: speed taken off within a time, m/s. level: deceleration at its end, m/s2."""

    lost: float
    level: float


def moved(level: float, target: float, rate: float, duration: float) -> Braked:
    """A deceleration that goes from `level` to `target` (m/s2) at `rate` (m/s3) and holds there, after `duration` s."""
    change = target - level
    reach = rate * duration
    if abs(change) >= reach:
        end = level + reach if change > 0.0 else level - reach
        return Braked(0.5 * (level + end) * duration, end)
    return Braked(target * duration - 0.5 * change * abs(change) / rate, target)


def switched(level: float, target: float, wait: float, rate: float, step: float) -> float:
    """What to tell brakes in a step, m/s2, that shall leave `level` for `target` only `wait` s from its beginning.

    With h the step, j the brakes' rate, D = |target - level|, b = D / j:

        change = j / 2 (h + b - sqrt((h + b)^2 - 4 b (h - wait)))

    Brakes that change so much at once, hold that to the end of the step and go on to `target` after it have in the end
    taken off the same speed as brakes that leave `level` `wait` s late.
    """
    if wait >= step:
        return level
    if wait <= 0.0:
        return target
    longest = abs(target - level) / rate
    both = step + longest
    change = 0.5 * rate * (both - math.sqrt(both * both - 4.0 * longest * (step - wait)))
    return level + change if target > level else level - change


def mean_level(level: float, mean: float, rate: float, step: float) -> float:
    """What to tell brakes at `level`, m/s2, for a mean over the step of `mean`, or as near to it as they can come."""
    change = abs(mean - level)
    if change == 0.0:
        return level
    square = step * step - 2.0 * change * step / rate
    told = rate * (step - math.sqrt(square)) if square > 0.0 else rate * step
    return level + told if mean > level else level - told


def released_level(level: float, lost: float, rate: float, step: float) -> float:
    """What to tell brakes that are at `level`, m/s2, so that they lose `lost` m/s until they are open.

    They go at `rate` j to the told level c, hold it to the end of the step h, and go on to 0 after it:

        lost = level^2 / (2 j) + c (h - (level - c) / j)
    """
    spare = step - level / rate
    square = spare * spare + 4.0 * (lost - 0.5 * level * level / rate) / rate
    told = 0.5 * rate * (math.sqrt(square) - spare) if square > 0.0 else 0.0
    return min(max(told, 0.0), level)


class BrakePath:
    """The vehicle's brakes on the way that a driver's braking takes.

    level: where the driver's braking is, m/s2. It rises at `rise` m/s3, if the brakes can, up to `strongest` m/s2, and
    falls as fast as they. Brakes that rise no faster than the driver asks may be told more, to be even with him.
    """

    def __init__(self, rise: float, strongest: float, vehicle: VehicleSettings, step: float) -> None:
        self.fall = vehicle.brake_jerk
        self.rise = min(rise, self.fall)
        self.level = 0.0
        self._strongest = min(strongest, vehicle.max_deceleration) if rise < self.fall else vehicle.max_deceleration
        self._step = step
        self._brakes = 0.0  # where the vehicle's are, m/s2
        self._owed = 0.0  # m/s that the vehicle has yet to lose to be as slow as the driver's braking makes it

    def towards(self, target: float, duration: float) -> float:
        """Speed lost while the braking goes towards `target` m/s2 for `duration` s, m/s."""
        lost, self.level = moved(self.level, target, self.rise if target > self.level else self.fall, duration)
        return lost

    def command(self, lost: float, *, releases: bool) -> float:
        """What to tell the vehicle, m/s2, where the coming step shall take off `lost` m/s. Call once a step.

        releases: the braking ends in it, or has ended.
        """
        before, step = self._brakes, self._step
        if releases and before == 0.0 and lost == 0.0:
            self._owed = 0.0
            return 0.0
        if releases:
            until_open = lost + self._owed + 0.5 * self.level * self.level / self.fall
            told = released_level(before, until_open, self.fall, step)
        else:
            told = mean_level(before, (lost + self._owed) / step, self.fall, step)
            told = min(max(told, 0.0), self._strongest)
        takes, self._brakes = moved(before, told, self.fall, step)
        self._owed += lost - takes
        return told


def first_instant(holds: Callable[[float], bool], begin: float, end: float) -> float:
    """The instant within begin..end, s, from which on `holds` is as it is at the end; it differs at the beginning."""
    wanted = holds(end)
    for _ in range(_HALVINGS):
        middle = 0.5 * (begin + end)
        if holds(middle) == wanted:
            end = middle
        else:
            begin = middle
    return end


def _jump(demand: Callable[[float], float], begin: float, end: float) -> float:
    """Where within begin..end, s, a demand that jumps there passes half of its change.

    A level in the middle of a part errs in second order where the demand is smooth in it, and in first order where it
    jumps. `end`, where the demand changes by less than `_JUMP`.
    """
    inside = _INSIDE * (end - begin)
    early, late = demand(begin + inside), demand(end - inside)
    if abs(late - early) < _JUMP:
        return end
    half = 0.5 * (early + late)
    return first_instant(lambda after: demand(after) > half, begin + inside, end - inside)


class SafetyBraking:
    """Brakes that follow a demand: `reaction` s after the first one, rising at `jerk` m/s3, up to `strongest` m/s2.

    The reaction is waited for once: who has been alarmed stays alert.
    """

    def __init__(self, reaction: float, strongest: float, jerk: float, vehicle: VehicleSettings, step: float) -> None:
        self.path = BrakePath(jerk, strongest, vehicle, step)
        self._reaction = reaction
        self._strongest = strongest
        self._step = step
        self._alarmed: float | None = None
        self._looked = self._looked_twice = False

    def follow(self, demand: Callable[[float], float], time: float) -> float:
        """What to tell the vehicle for the coming step, m/s2. Call once a step.

        demand: the deceleration that is demanded some time (s) after now, from one and a half steps before now to a
        step after it, as far as it can be foreseen, m/s2; 0 for none. The first demand is looked for half a step ago,
        where speeds that are told from positions are known; one that began with a jump began with the last step.
        """
        step, path = self._step, self.path

        def asks(after: float) -> bool:
            return demand(after) > 0.0

        if self._alarmed is None and not self._looked and asks(0.0):
            self._alarmed = time
        elif self._alarmed is None and self._looked and asks(-0.5 * step):
            earlier = -1.5 * step if self._looked_twice else -step
            self._alarmed = time + (-step if asks(earlier) else first_instant(asks, earlier, -0.5 * step))
        self._looked, self._looked_twice = True, self._looked
        wait = math.inf if self._alarmed is None else max(self._alarmed + self._reaction - time, 0.0)
        if wait >= step:
            return path.command(path.towards(0.0, step), releases=True)
        lost = path.towards(0.0, wait) if wait > 0.0 else 0.0
        before, after = asks(wait), asks(step)
        change = step if before == after else first_instant(asks, wait, step)
        for begin, end, on in ((wait, change, before), (change, step, after)):
            if end <= begin:
                continue
            jump = _jump(demand, begin, end) if on else end
            for first, last in ((begin, jump), (jump, end)):
                if last > first:
                    level = min(demand(0.5 * (first + last)), self._strongest) if on else 0.0
                    lost += path.towards(level, last - first)
        return path.command(lost, releases=not after)
