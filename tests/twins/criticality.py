"""Ideal braking as a motion: speed and room at a time, and where a solver finds peak and contact."""

import math

from scipy.optimize import brentq, minimize_scalar


def braked(ego_speed, lead_speed, gap, deceleration, delay=0.0, build_up=0.0):
    """(largest ITTC, relative speed at contact) of one approach; ITTC is inf if it hits, the speed
    is 0 if not."""
    closing = ego_speed - lead_speed
    if closing <= 0:
        return 0.0, 0.0

    def braking(t):  # time on the ramp of the brakes and at their full strength
        return min(max(t - delay, 0.0), build_up), max(t - delay - build_up, 0.0)

    def speed(t):
        ramp, full = braking(t)
        rising = ramp**2 / build_up / 2 if build_up else 0.0
        return closing - deceleration * (rising + full)

    def room(t):
        ramp, full = braking(t)
        rising = ramp**3 / build_up / 6 if build_up else 0.0
        return gap - closing * t + deceleration * (rising + build_up / 2 * full + full**2 / 2)

    stop = brentq(speed, 0.0, delay + build_up + closing / deceleration + 1.0)
    if room(stop) <= 0:
        return math.inf, speed(brentq(room, 0.0, stop))
    peak = minimize_scalar(
        lambda t: -speed(t) / room(t), bounds=(0.0, stop), options={"xatol": 1e-9}
    )
    return max(speed(t) / room(t) for t in (0.0, min(delay, stop), peak.x)), 0.0
