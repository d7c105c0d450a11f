"""Criticality of an approach to a slower vehicle under ideal braking, Eqs. 1-6.

The ego drives at `ego_speed` towards a lead vehicle `gap` ahead of it (bumper to bumper). The lead
vehicle keeps `lead_speed`. The ego keeps its speed for `delay`, then brakes until it is as fast as
the lead vehicle. All of this has a closed form. Where the lead vehicle brakes, or comes in from the
side, `searched_criticality` searches over time instead.

Arguments are numbers or arrays, which broadcast. In the code, `[()]` at the end of a result makes a
number of an array without axes. The constants come from the settings `[method.zones]` (a, ITTC*)
and from the scenario (`Approach`: speeds, gap, delay).

Users: `ads/foresight.py`, `extras/studies/qualification/table.py`, `method/point_criticality.py`.
Fixed: names and arguments (docs/reference/python.md); results to the last bit (tests/golden).
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.method import checks
from sumo_eval.trajectory import FloatArray

_finite = partial(checks.finite, "an approach")
_not_negative = partial(checks.not_negative, "an approach")


def time_to_collision(ego_speed: ArrayLike, lead_speed: ArrayLike, gap: ArrayLike) -> FloatArray:
    """Eq. 1: TTC = d / (v2 - v1), s; 0 where they touch, inf where they are not closing.

    ego_speed: v2 at present, m/s.
    lead_speed: v1 at present, m/s.
    gap: d at present, bumper to bumper, m; 0 or less is contact.

    Raises InputError for numbers that are not finite and for negative speeds.
    """
    inverse = inverse_ttc(ego_speed, lead_speed, gap)
    return checks.quotient(1.0, inverse, inverse > 0.0, np.inf)[()]


def inverse_ttc(ego_speed: ArrayLike, lead_speed: ArrayLike, gap: ArrayLike) -> FloatArray:
    """Eq. 2: ITTC = (v2 - v1) / d, 1/s; inf where they touch while closing, 0 where they are not
    closing.

    ego_speed: v2 at present, m/s.
    lead_speed: v1 at present, m/s.
    gap: d at present, bumper to bumper, m; 0 or less is contact.

    Raises InputError for numbers that are not finite and for negative speeds.
    """
    closing = _closing_speed(ego_speed, lead_speed)
    distance = _finite("gap", gap)
    apart = checks.quotient(closing, distance, distance > 0.0)
    return np.where(closing > 0.0, apart, 0.0)[()]


def ideal_braking_speed(
    ego_speed: ArrayLike,
    lead_speed: ArrayLike,
    time: ArrayLike,
    *,
    deceleration: ArrayLike = 5.0,
    delay: ArrayLike = 0.0,
) -> FloatArray:
    """Eq. 3: v2 = v0 - a (t - delay), m/s, but at least the lead's speed v1.

    ego_speed: v0 at time 0, m/s.
    lead_speed: v1, constant, m/s.
    time: t, s, at least 0.
    deceleration: a, m/s2, above 0, from `[method.zones]`.
    delay: s before braking, at least 0, from the scenario.

    An ego that is not closing keeps its speed.

    Raises InputError for numbers that are not finite or not in these ranges.
    """
    closing = _closing_speed(ego_speed, lead_speed)
    braked = _strength(deceleration) * _braking_time(time, delay)
    return np.asarray(
        np.asarray(ego_speed, float) - np.clip(braked, 0.0, np.maximum(closing, 0.0))
    )[()]


def ideal_braking_gap(
    ego_speed: ArrayLike,
    lead_speed: ArrayLike,
    gap: ArrayLike,
    time: ArrayLike,
    *,
    deceleration: ArrayLike = 5.0,
    delay: ArrayLike = 0.0,
) -> FloatArray:
    """Eq. 4: gap d = d0 + v1 t - t (v0 + v2) / 2, m; negative once the ego has hit.

    In the equation, t and d0 are time and gap from the end of the delay on; `time` and `gap` count
    from the beginning.

    ego_speed: v0 at time 0, m/s.
    lead_speed: v1, constant, m/s.
    gap: at time 0, m.
    time: s since time 0, at least 0.
    deceleration: a, m/s2, above 0, from `[method.zones]`.
    delay: s before braking, at least 0, from the scenario.

    Once the ego is as fast as the lead vehicle, the gap stays.

    Raises InputError for numbers that are not finite or not in these ranges.
    """
    closing = _closing_speed(ego_speed, lead_speed)
    strength = _strength(deceleration)
    braking = _braking_time(time, delay)
    before = np.asarray(time) - braking  # s at constant speed
    # time of braking until the speeds are equal, s, and speed lost in this time, m/s; an ego that
    # is not closing loses none
    lasting = np.where(closing > 0.0, np.minimum(braking, closing / strength), braking)
    lost = np.where(closing > 0.0, strength * lasting, 0.0)
    left = _finite("gap", gap) - closing * before - lasting * (closing - lost / 2.0)
    return np.asarray(left)[()]


def max_inverse_ttc(
    ego_speed: ArrayLike,
    lead_speed: ArrayLike,
    gap: ArrayLike,
    *,
    deceleration: ArrayLike = 5.0,
    delay: ArrayLike = 0.0,
) -> FloatArray:
    """Eqs. 5-6: largest ITTC on the way to equal speeds, 1/s; inf where ideal braking hits, 0 where
    the ego is not closing.

    ego_speed: v0 at time 0, m/s.
    lead_speed: v1, constant, m/s.
    gap: d0 at time 0, m; 0 or less is contact.
    deceleration: a, m/s2, from `[method.zones]`.
    delay: s before braking, from the scenario.

    D = v0 - v1 is the relative speed at first, u <= D the relative speed during braking. The gap is
    c + u^2/(2a), with c = d0 - D delay - D^2/(2a) the gap at equal speeds. So
    ITTC(u) = u / (c + u^2/(2a)), with its peak sqrt(a/(2c)) at u = sqrt(2ac). If D < sqrt(2ac), the
    largest ITTC is that at u = D, when braking begins.

    Raises InputError for numbers that are not finite, negative speeds or delays, and a deceleration
    not above 0.
    """
    strength = _strength(deceleration)
    rel = _closing_speed(ego_speed, lead_speed)
    # gap left when braking begins, m
    left = _finite("gap", gap) - rel * _not_negative("delay", delay)
    rel, left, strength = np.broadcast_arrays(rel, left, strength)
    c = left - rel**2 / (2.0 * strength)
    hit = (left <= 0.0) | (c <= 0.0)
    # where the ego hits, the divisors become 1, because the quotients are not used there
    c = np.where(hit, 1.0, c)
    peak_in_braking = 2.0 * strength * c <= rel**2
    peak = np.where(peak_in_braking, np.sqrt(strength / (2.0 * c)), rel / np.where(hit, 1.0, left))
    return np.where(rel <= 0.0, 0.0, np.where(hit, np.inf, peak))[()]


def critical_gap(
    closing_speed: ArrayLike,
    *,
    deceleration: ArrayLike = 5.0,
    critical_inverse_ttc: ArrayLike = 0.7,
    delay: ArrayLike = 0.0,
) -> FloatArray:
    """Eq. 6 solved for the gap, m, where max ITTC = k. A point is hazardous at this gap or less.

    closing_speed: D = v0 - v1 at time 0, m/s.
    deceleration: a, m/s2, from `[method.zones]`.
    critical_inverse_ttc: k = ITTC*, 1/s, from `[method.zones]`.
    delay: s before braking, from the scenario.

    - D <= a/k, where ITTC peaks when braking begins: D/k + D delay.
    - D > a/k, where ITTC peaks during braking: D^2/(2a) + a/(2k^2) + D delay.
    - The ego is not closing: 0.

    Raises InputError for numbers that are not finite, a or k not above 0, and a negative delay.
    """
    closing = np.maximum(_finite("closing_speed", closing_speed), 0.0)
    strength = _strength(deceleration)
    k = _not_negative("critical_inverse_ttc", critical_inverse_ttc, above_zero=True)
    at_onset = closing / k
    in_braking = closing**2 / (2.0 * strength) + strength / (2.0 * k**2)
    without_delay = np.where(closing <= strength / k, at_onset, in_braking)
    return np.asarray(without_delay + closing * _not_negative("delay", delay))[()]


def required_gap(
    closing_speed: ArrayLike,
    *,
    deceleration: ArrayLike,
    delay: ArrayLike = 0.0,
    build_up: ArrayLike = 0.0,
) -> FloatArray:
    """Smallest gap behind a vehicle of constant speed at which braking avoids contact, m; 0 where
    the ego is not closing.

    closing_speed: D = v0 - v1 at time 0, m/s.
    deceleration: am, after the build-up, m/s2.
    delay: td, s at constant speed before braking.
    build_up: Tr, s in which the deceleration rises linearly from 0 to am (the ramp).

    - D >= am Tr/2: D (td + Tr) - am Tr^2/6 + (D - am Tr/2)^2 / (2 am).
    - D < am Tr/2, where the speeds are equal during the ramp, after t* = sqrt(2 D Tr/am):
      D td + 2/3 D t*.

    Raises InputError for numbers that are not finite, am not above 0, and negative times.
    """
    closing = np.maximum(_finite("closing_speed", closing_speed), 0.0)
    strength = _strength(deceleration)
    wait, ramp = _not_negative("delay", delay), _not_negative("build_up", build_up)
    after_ramp = closing - strength * ramp / 2.0
    on_plateau = closing * ramp - strength * ramp**2 / 6.0 + after_ramp**2 / (2.0 * strength)
    in_ramp = 2.0 / 3.0 * closing * np.sqrt(2.0 * closing * ramp / strength)
    return np.asarray(closing * wait + np.where(after_ramp >= 0.0, on_plateau, in_ramp))[()]


def ideal_impact_speed(
    ego_speed: ArrayLike,
    lead_speed: ArrayLike,
    gap: ArrayLike,
    *,
    deceleration: ArrayLike,
    delay: ArrayLike = 0.0,
    build_up: ArrayLike = 0.0,
) -> FloatArray:
    """Relative speed at contact under ideal braking, m/s; 0 where contact is avoided.

    For zones and rules; Ug of Eq. 17 comes from the drive of `ideal_braking`.

    ego_speed: v0 at time 0, m/s.
    lead_speed: v1, constant, m/s.
    gap: d0 at time 0, m; 0 or less is contact.
    deceleration: am, after the build-up, m/s2.
    delay: td, s at constant speed before braking.
    build_up: Tr, s in which the deceleration rises linearly from 0 to am (the ramp).

    D = v0 - v1 is the relative speed, d = d0 - D td the gap when braking begins.

    - d <= 0: the result is D.
    - Contact during the ramp, with the jerk j = am/Tr: D (1 - 4 sin(q)^2), where
      sin(3q) = d / (2/3 D t*) and t* = sqrt(2 D/j). The time of contact is the root
      t = 2 t* sin(q) of D t - j t^3/6 = d, because sin(3q) = 3 sin(q) - 4 sin(q)^3.
    - Contact after the ramp: sqrt((D - am Tr/2)^2 - 2 am (d - D Tr + am Tr^2/6)).

    Raises InputError for numbers that are not finite, negative speeds or times, and am not above 0.
    """
    strength = _strength(deceleration)
    rel = _closing_speed(ego_speed, lead_speed)
    left = _finite("gap", gap) - rel * _not_negative("delay", delay)  # d
    ramp = _not_negative("build_up", build_up)
    closing = np.maximum(rel, 0.0)  # D

    after_ramp = closing - strength * ramp / 2.0
    on_whole_ramp = closing * ramp - strength * ramp**2 / 6.0  # gap closed during the ramp, m
    on_plateau = np.sqrt(np.maximum(after_ramp**2 - 2.0 * strength * (left - on_whole_ramp), 0.0))

    # gap that a ramp until equal speeds would close, m; `share`: the gap d over it
    needed = 2.0 / 3.0 * closing * np.sqrt(2.0 * closing * ramp / strength)
    free_gap = np.maximum(left, 0.0)
    share = checks.quotient(free_gap, needed, free_gap < needed, 1.0)
    at_root = closing * (1.0 - 4.0 * np.sin(np.arcsin(share) / 3.0) ** 2)
    on_ramp = np.where(share < 1.0, at_root, 0.0)

    # whether the approach ends during the ramp: by contact, or (D < a ramp / 2) by equal speeds
    ends_on_ramp = np.where(after_ramp >= 0.0, left < on_whole_ramp, True)
    braked = np.where(ends_on_ramp, on_ramp, on_plateau)
    return np.where(rel <= 0.0, 0.0, np.where(left <= 0.0, rel, np.maximum(braked, 0.0)))[()]


Profile = Callable[[FloatArray], FloatArray]
"""Motion of n lead vehicles: a function of times (n, m), s. It gives their speeds, m/s, or the
distances that they drove since t = 0, m, in the same shape."""

_TIMES = 161  # times searched from the conflict's start to the ego's standstill
_ZOOM = 21  # times searched between the neighbours of the most critical one
_BISECTIONS = 40  # halvings of the interval in which contact begins


def searched_criticality(
    ego_speed: ArrayLike,
    gap: ArrayLike,
    lead: tuple[Profile, Profile],
    *,
    deceleration: ArrayLike = 5.0,
    delay: ArrayLike = 0.0,
    conflict_begin: ArrayLike = 0.0,
    passing_length: float = math.inf,
) -> tuple[FloatArray, FloatArray]:
    """Eqs. 5-6 searched over time: max ITTC, 1/s, and impact speed, m/s, of ideal braking behind
    any motion, (n,) each.

    ego_speed: v0 at time 0, (n,), m/s.
    gap: d0 at time 0, (n,), m.
    lead: the lead vehicle's motion, two functions of times (n, m), s: its speed v1, m/s, and the
        distance that it drove since t = 0, m.
    deceleration: a, m/s2, from `[method.zones]`. After the delay the ego brakes to a standstill.
    delay: s before braking, from the scenario.
    conflict_begin: time at which the lead vehicle comes into the ego's path, s, from the scenario.
        Neither ITTC nor contact counts before.
    passing_length: length of the ego plus that of the lead vehicle, m. With a gap below
        -passing_length at `conflict_begin` the ego has passed, and nothing counts. A gap between
        -passing_length and 0 is a contact: the lead vehicle moves into the ego's side.

    Max ITTC is inf where the ego hits, 0 where it never closes. The impact speed is 0 where it does
    not hit. Both agree with `max_inverse_ttc` (to 1e-3, relative) and `ideal_impact_speed` where
    these apply, except within a hair of contact.

    Raises InputError for numbers that are not finite, negative ones except of the gap, and a
    deceleration of 0.
    """

    def column(values: FloatArray) -> FloatArray:
        """Values as (n, 1)."""
        return np.broadcast_to(values, np.shape(ego_speed))[:, None]

    v0, d0 = column(_not_negative("ego_speed", ego_speed)), column(_finite("gap", gap))
    wait = column(_not_negative("delay", delay))
    begin = column(_not_negative("conflict_begin", conflict_begin))
    strength = column(_strength(deceleration))
    lead_speed, lead_distance = lead
    braking_time = v0 / strength

    def relative(time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Closing speed, m/s, and gap, m, at times (n, m), s."""
        braking = np.clip(time - wait, 0.0, braking_time)
        speed = v0 - strength * braking
        driven = v0 * np.minimum(time, wait) + braking * (v0 + speed) / 2.0
        return speed - lead_speed(time), d0 + lead_distance(time) - driven

    standstill = wait + braking_time  # time of the ego's standstill, s
    times = begin + np.linspace(0.0, 1.0, _TIMES) * np.maximum(standstill - begin, 0.0)
    closing, distance = relative(times)
    passed = distance[:, 0] < -passing_length
    touching = distance <= 0.0
    hit = touching.any(axis=1) & ~passed

    # bisection: contact begins between the first of `times` at which the vehicles touch and the one
    # before it
    first = np.argmax(touching, axis=1)
    rows = np.arange(len(v0))
    after, before = times[rows, first], times[rows, np.maximum(first - 1, 0)]
    for _ in range(_BISECTIONS if hit.any() else 0):  # without a hit, nothing to look for
        middle = (before + after) / 2.0
        touches = relative(middle[:, None])[1][:, 0] <= 0.0
        before, after = np.where(touches, before, middle), np.where(touches, middle, after)
    impact = np.where(hit, np.abs(relative(after[:, None])[0][:, 0]), 0.0)

    # The largest ITTC at `times`, then at closer times around its peak. Where the ego touches or is
    # not closing, the quotient may be inf or nan, and 0 replaces it.
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where((closing > 0.0) & ~touching, closing / distance, 0.0)
        peak = np.argmax(inverse, axis=1)
        low = times[rows, np.maximum(peak - 1, 0)]
        high = times[rows, np.minimum(peak + 1, _TIMES - 1)]
        near = low[:, None] + np.linspace(0.0, 1.0, _ZOOM) * (high - low)[:, None]
        closing, distance = relative(near)
        refined = np.where((closing > 0.0) & (distance > 0.0), closing / distance, 0.0).max(axis=1)
    largest = np.maximum(inverse.max(axis=1), refined)
    return np.where(passed, 0.0, np.where(hit, np.inf, largest)), impact


def _strength(deceleration: ArrayLike) -> FloatArray:
    """The deceleration as an array, m/s2. Raises InputError unless it is finite and above 0."""
    return _not_negative("deceleration", deceleration, above_zero=True)


def _closing_speed(ego_speed: ArrayLike, lead_speed: ArrayLike) -> FloatArray:
    """D = v0 - v1, m/s, as an array. Raises InputError for a speed that is negative or not finite.

    So an oncoming vehicle is refused: braking cannot bring the relative speed to 0.
    """
    return _not_negative("ego_speed", ego_speed) - _not_negative("lead_speed", lead_speed)


def _braking_time(time: ArrayLike, delay: ArrayLike) -> FloatArray:
    """Time since braking began, s, as an array; 0 during the delay."""
    return np.maximum(_not_negative("time", time) - _not_negative("delay", delay), 0.0)
