"""What the reference drivers of UN Regulation No. 157 share: brakes that build up, headways along and across."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from sumo_eval.ads.perception import Mover, bumper_gap

GRAVITY = 9.81  # m/s2
HUMAN_JERK = 12.65  # m/s3, rate at which the regulation's human brakes (0.774 g in 0.6 s)
HUMAN_BRAKING = 0.774 * GRAVITY  # m/s2, the strongest of the regulation's human
FOLLOWING_HEADWAY = 2.0  # s, at which and below which the regulation's human minds what the lead does
HEADWAY_ROUNDING = 0.01  # s
SHOWING = 0.8  # share of a vehicle that a nearer one may cover at most, or it is hidden: 0.375 m of 1.9 m must show


@dataclass(frozen=True, slots=True)
class BrakeRamp:
    """Braking from 0 to `level` m/s2, linear over `build_up` s, then held."""

    level: float
    build_up: float

    @property
    def rise(self) -> float:
        """Rate at which it builds up, m/s3."""
        return self.level / self.build_up if self.build_up > 0.0 else math.inf

    def at(self, since: float) -> float:
        """Deceleration `since` s after braking began, m/s2; 0 before."""
        if since <= 0.0:
            return 0.0
        return self.level * min(since / self.build_up, 1.0) if self.build_up > 0.0 else self.level

    def lost(self, since: float) -> float:
        """Speed taken off `since` s after braking began, m/s; 0 before."""
        if since <= 0.0:
            return 0.0
        if since < self.build_up:
            return 0.5 * self.level * since * since / self.build_up
        return self.level * (since - 0.5 * self.build_up)


def time_to_collision(me: Mover, other: Mover) -> float:
    """TTC = d / (v - w), s: bumper gap over closing speed; inf when not closing, 0 or less beside a slower vehicle."""
    closing = me.along - other.along
    return bumper_gap(me, other) / closing if closing > 0.0 else math.inf


def time_headway(me: Mover, other: Mover) -> float:
    """THW = d / v, s: bumper gap over the ego's own speed; inf at standstill."""
    return bumper_gap(me, other) / me.along if me.along > 0.0 else math.inf


def lateral_gap(me: Mover, other: Mover) -> float:
    """Edge to edge across the road, m; negative when the bodies share a strip of road."""
    return abs(other.y - me.y) - me.half_width - other.half_width


def within_headway(me: Mover, other: Mover, limit: float) -> bool:
    """Whether the time headway is at most `limit` s; one that is so by construction counts, whatever the rounding."""
    return time_headway(me, other) <= limit + HEADWAY_ROUNDING


class Motion:
    """What speeds and positions of one step to the next tell of the other vehicles. Call each once a step and vehicle.

    Speeds across the road come from positions, as a body may move across without turning.
    """

    def __init__(self, step: float) -> None:
        self._step = step
        self._speeds: dict[str, float] = {}
        self._places: dict[str, float] = {}
        self._across: dict[str, float] = {}

    def deceleration(self, other: Mover) -> float:
        """Mean deceleration over the last step, m/s2, 0 at first sight."""
        last = self._speeds.get(other.name, other.along)
        self._speeds[other.name] = other.along
        return (last - other.along) / self._step

    def of(self, other: Mover) -> Sighting:
        """The vehicle with its speed across the road, and its braking, as far as they are known."""
        step, last = self._step, self._places.get(other.name)
        braking = max(self.deceleration(other), 0.0)
        self._places[other.name] = other.y
        if last is None:
            return Sighting(other._replace(braking=braking), 0.0, step)
        before, across = self._across.get(other.name, 0.0), (other.y - last) / step
        self._across[other.name] = across
        gain = (across - before) / step if across * before > 0.0 else 0.0
        return Sighting(other._replace(across=across, braking=braking), gain, step)


class Sighting(NamedTuple):
    """Another vehicle as the last two steps show it.

    mover: with the mean of its speed across the road over the last step, which it had in the middle of it. gain: of
    that speed on the one in the middle of the step before, m/s2; 0 if the motion began or turned round in between.
    """

    mover: Mover
    gain: float
    step: float

    def after(self, time: float) -> Mover:
        """The vehicle `time` s from now, if it goes on as now, or before that."""
        found = self.mover.after(time)
        if self.gain == 0.0:
            return found
        middle = -0.5 * self.step
        return found._replace(across=found.across + self.gain * (min(time, middle) - middle))


def closing_across(me: Mover, other: Mover) -> float:
    """Speed at which the other comes nearer across the road, m/s; negative: away."""
    relative = other.across - me.across
    return -relative if other.y > me.y else relative
