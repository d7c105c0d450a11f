"""Random but smooth: a stationary noise that a vehicle can follow exactly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class NoisePoint(NamedTuple):
    """The noise at an instant, its rate (per s) and the rate of that (per s2)."""

    value: float
    rate: float
    bend: float


class SmoothNoise:
    """A stationary random function with mean 0, deviation s and correlation exp(-t^2 / (2 l^2)), as a sum of sines:

        n(t) = s sqrt(2 / K) sum_k sin(w_k t + p_k),   w_k ~ N(0, 1 / l),   p_k ~ U(0, 2 pi),   K = 8

    (Shinozuka, Jan, J. Sound Vib. 25, 111 (1972)). It can be differentiated, which an Ornstein-Uhlenbeck process
    cannot: that one would ask for unlimited lateral speed. deviation: s. correlation_time: l, s. waves: (w_k, p_k),
    rad/s and rad. amplitude: s sqrt(2 / K).
    """

    COMPONENTS = 8

    def __init__(self, stream: np.random.Generator, deviation: float, correlation_time: float) -> None:
        frequencies = stream.normal(0.0, 1.0 / correlation_time, self.COMPONENTS)
        phases = stream.uniform(0.0, math.tau, self.COMPONENTS)
        self.waves = tuple(zip(frequencies.tolist(), phases.tolist(), strict=True))
        self._bent_waves = tuple((frequency, phase, frequency * frequency) for frequency, phase in self.waves)
        self.amplitude = deviation * math.sqrt(2.0 / self.COMPONENTS)

    def value(self, time: float) -> float:
        """n(time)."""
        value = 0.0
        sin = math.sin
        for frequency, phase in self.waves:  # `sum` rounds otherwise from Python 3.12 on
            value += sin(frequency * time + phase)
        return self.amplitude * value

    def at(self, time: float) -> NoisePoint:
        """n, dn/dt and d2n/dt2 at `time` (s)."""
        value = rate = bend = 0.0
        sin, cos = math.sin, math.cos
        for frequency, phase, squared in self._bent_waves:
            angle = frequency * time + phase
            sine = sin(angle)
            value += sine
            rate += frequency * cos(angle)
            bend -= squared * sine
        amplitude = self.amplitude
        return NoisePoint(amplitude * value, amplitude * rate, amplitude * bend)
