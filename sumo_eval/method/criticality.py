"""Criticality of an approach to a slower vehicle under ideal braking, Eqs. 1-6.

One ego drives at `ego_speed` towards a vehicle `gap` ahead of it (bumper to bumper) that keeps
`lead_speed`. It keeps its speed for `delay`, then brakes until it is as fast as the lead.
Everything has a closed form, except where the lead vehicle brakes or comes in from the side:
`searched_criticality` looks along the time axis. Arrays broadcast; `[()]` makes an array without
axes a number.

Users: `ads/foresight.py`, `extras/studies/qualification/table.py`, `method/point_criticality.py`.
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

    ego_speed: v2, m/s.
    lead_speed: v1, m/s.
    gap: d, bumper to bumper, m; 0 or less is contact.

    Raises InputError for numbers that are not finite and for negative speeds.
    """
    inverse = inverse_ttc(ego_speed, lead_speed, gap)
    return checks.quotient(1.0, inverse, inverse > 0.0)[()]


def inverse_ttc(ego_speed: ArrayLike, lead_speed: ArrayLike, gap: ArrayLike) -> FloatArray:
    """Eq. 2: ITTC = (v2 - v1) / d, 1/s; inf where they touch while closing, 0 where they are not
    closing.

    ego_speed: v2, m/s.
    lead_speed: v1, m/s.
    gap: d, bumper to bumper, m; 0 or less is contact.

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
    """Eq. 3: v2 = v0 - a (t - delay), m/s, until it is the lead's speed; an ego that is not closing
    keeps its own.

    ego_speed: v0, m/s.
    lead_speed: v1, m/s.
    time: t >= 0, s.
    deceleration: a, m/s2.
    delay: s before braking.

    Raises InputError for numbers outside these meanings.
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
    """Eq. 4: d = d0 + v1 t - t (v0 + v2) / 2, m, t from the delay's end, d0 the gap then;
    negative once the ego has hit.

    ego_speed: v0, m/s.
    lead_speed: v1, m/s.
    gap: m, at time 0.
    time: s, at least 0.
    deceleration: a, m/s2.
    delay: s before braking.

    Once the ego is as fast as the lead the gap stays.

    Raises InputError for numbers outside these meanings.
    """
    closing = _closing_speed(ego_speed, lead_speed)
    strength = _strength(deceleration)
    braking = _braking_time(time, delay)
    before = np.asarray(time) - braking  # s at constant speed
    # s of braking until the speeds are equal, and m/s lost in this time; an ego that does not close
    # in keeps its speed
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
    not closing.

    ego_speed: v0, m/s.
    lead_speed: v1, m/s.
    gap: d0, m; 0 or less is contact.
    deceleration: a, m/s2.
    delay: s before braking.

    D = v0 - v1 is the relative speed. When braking has left u <= D of it, the gap is
    c + u^2/(2a), with c = d0 - D delay - D^2/(2a). So ITTC(u) = u / (c + u^2/(2a)), with its peak
    sqrt(a/(2c)) at u = sqrt(2ac). If D < sqrt(2ac), the largest is that at u = D, when braking
    begins.

    Raises InputError for numbers that are not finite, negative speeds or delays, and a deceleration
    not above 0.
    """
    strength = _strength(deceleration)
    rel = _closing_speed(ego_speed, lead_speed)
    left = _finite("gap", gap) - rel * _not_negative("delay", delay)  # when braking begins
    rel, left, strength = np.broadcast_arrays(rel, left, strength)
    c = left - rel**2 / (2.0 * strength)
    hit = (left <= 0.0) | (c <= 0.0)
    # where it hits the divisors are 1: those quotients are not used
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
    """Eq. 6 solved for the gap, m, where max ITTC = k. At this gap and below a point is hazardous.

    closing_speed: D = v0 - v1, m/s.
    deceleration: a, m/s2.
    critical_inverse_ttc: k, 1/s.
    delay: s before braking.

    D/k + D delay while D <= a/k (the peak is where braking begins), else D^2/(2a) + a/(2k^2) + D
    delay; 0 where not closing.

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
    """Smallest gap behind a vehicle of constant speed at which braking avoids contact, m; 0 if not
    closing.

    closing_speed: D, m/s.
    deceleration: am, the plateau, m/s2.
    delay: td, s at constant speed.
    build_up: Tr, s of linear rise 0 -> am.

    D (td + Tr) - am Tr^2/6 + (D - am Tr/2)^2 / (2 am) if D >= am Tr/2, else D td + 2/3 D t*, t* =
    sqrt(2 D Tr/am), because the ego then is as slow as the lead before the ramp ends.

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
    """Relative speed at contact under ideal braking, m/s, 0 where contact is avoided; the impact
    speed behind Ug of Eq. 17.

    ego_speed: v0, m/s.
    lead_speed: v1, m/s.
    gap: d0, m; 0 or less is contact.
    deceleration: am, m/s2.
    delay: td, s.
    build_up: Tr, s of linear rise 0 -> am.

    D = v0 - v1 is the relative speed, d = d0 - D td the gap left when braking begins.

    - d <= 0: the result is D.
    - Contact on the ramp, with the jerk j = am/Tr: D (1 - 4 sin(q)^2), where
      sin(3q) = d / (2/3 D t*) and t* = sqrt(2 D/j). Contact is at the root t = 2 t* sin(q) of
      D t - j t^3/6 = d, as sin(3q) = 3 sin(q) - 4 sin(q)^3.
    - Contact on the plateau: sqrt((D - am Tr/2)^2 - 2 am (d - D Tr + am Tr^2/6)).

    Raises InputError for numbers that are not finite, negative speeds or times, and am not above 0.
    """
    strength = _strength(deceleration)
    rel = _closing_speed(ego_speed, lead_speed)
    left = _finite("gap", gap) - rel * _not_negative("delay", delay)  # d
    ramp = _not_negative("build_up", build_up)
    closing = np.maximum(rel, 0.0)  # D

    after_ramp = closing - strength * ramp / 2.0
    on_whole_ramp = closing * ramp - strength * ramp**2 / 6.0  # gap that it closes, m
    on_plateau = np.sqrt(np.maximum(after_ramp**2 - 2.0 * strength * (left - on_whole_ramp), 0.0))

    # gap that a ramp until equal speeds would close, m, and the gap left as a share of it
    needed = 2.0 / 3.0 * closing * np.sqrt(2.0 * closing * ramp / strength)
    free_gap = np.maximum(left, 0.0)
    share = checks.quotient(free_gap, needed, free_gap < needed, 1.0)
    at_root = closing * (1.0 - 4.0 * np.sin(np.arcsin(share) / 3.0) ** 2)
    on_ramp = np.where(share < 1.0, at_root, 0.0)

    # by contact or equal speeds
    ends_on_ramp = np.where(after_ramp >= 0.0, left < on_whole_ramp, True)
    braked = np.where(ends_on_ramp, on_ramp, on_plateau)
    return np.where(rel <= 0.0, 0.0, np.where(left <= 0.0, rel, np.maximum(braked, 0.0)))[()]


Profile = Callable[[FloatArray], FloatArray]
"""Motion of leads: function of times (n, m), s, that gives speeds, m/s, or distances driven since
t = 0, m, in the same shape."""

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
    any motion.

    ego_speed: v0, (n,), m/s.
    gap: d0, (n,), m.
    lead: two functions of times (n, m), s: its speed v1, m/s, and the distance that it has driven
        since t = 0, m.
    deceleration: a, m/s2, of the ego, which after the delay brakes to a standstill.
    delay: s before braking.
    conflict_begin: s before which the lead is not in the way, so that neither ITTC nor contact
        counts.
    passing_length: both lengths together, m. With a gap below -passing_length at the conflict's
        start the ego has passed, and nothing counts. With a gap between -passing_length and 0 it is
        a contact: the lead moves into the ego's side.

    Max ITTC is inf where the ego hits, 0 where it never closes; the impact speed is 0 where it does
    not hit. Both agree with `max_inverse_ttc` and `ideal_impact_speed` to 1e-3 (relative) where
    these apply.

    Raises InputError for numbers outside these meanings.
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
        """Closing speed and gap at times (n, m)."""
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

    # contact begins between the first time at which they touch and the time before that
    first = np.argmax(touching, axis=1)
    rows = np.arange(len(v0))
    after, before = times[rows, first], times[rows, np.maximum(first - 1, 0)]
    for _ in range(_BISECTIONS if hit.any() else 0):  # without a hit, nothing to look for
        middle = (before + after) / 2.0
        touches = relative(middle[:, None])[1][:, 0] <= 0.0
        before, after = np.where(touches, before, middle), np.where(touches, middle, after)
    impact = np.where(hit, np.abs(relative(after[:, None])[0][:, 0]), 0.0)

    # The largest ITTC at these times, then at closer times around it. Where the ego touches or does
    # not close in, the quotient may be inf or nan, and 0 replaces it.
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
    """The strength of braking, m/s2, checked."""
    return _not_negative("deceleration", deceleration, above_zero=True)


def _closing_speed(ego_speed: ArrayLike, lead_speed: ArrayLike) -> FloatArray:
    """rel = v0 - v1.

    An oncoming vehicle is refused: braking cannot bring the relative speed to 0.
    """
    return _not_negative("ego_speed", ego_speed) - _not_negative("lead_speed", lead_speed)


def _braking_time(time: ArrayLike, delay: ArrayLike) -> FloatArray:
    """Time since braking began, s; 0 during the delay."""
    return np.maximum(_not_negative("time", time) - _not_negative("delay", delay), 0.0)
