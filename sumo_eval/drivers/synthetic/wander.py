"""Random but smooth: a stationary noise that a vehicle can follow exactly.

n(t) = s sqrt(2 / K) sum_k sin(w_k t + p_k),   w_k ~ N(0, 1 / l^2),   p_k ~ U(0, 2 pi),   K = 8

It has mean 0, deviation s and correlation exp(-t^2 / (2 l^2)) (Shinozuka, Jan, J. Sound Vib. 25,
111 (1972)). It can be differentiated, which an Ornstein-Uhlenbeck process cannot: that one would
ask for unlimited lateral speed.

Users: `drivers/synthetic/driver.py`.
"""

import math
from typing import Any

import numpy as np

from sumo_eval.kernels import kernel
from sumo_eval.trajectory import FloatArray

COMPONENTS = 8  # K, number of sines


def random_waves(stream: np.random.Generator, correlation_time: float) -> FloatArray:
    """(w_k, p_k) of a noise, rad/s and rad, (8, 2).

    correlation_time: l, s.
    """
    frequencies = stream.normal(0.0, 1.0 / correlation_time, COMPONENTS)
    phases = stream.uniform(0.0, math.tau, COMPONENTS)
    return np.stack((frequencies, phases), axis=1)


@kernel
def noise_at(waves: Any, deviation: float, time: float) -> tuple[float, float, float]:
    """n, dn/dt and d2n/dt2 of a noise at `time`, s.

    waves: from `random_waves`.
    deviation: s, in the unit of n.
    """
    amplitude = deviation * math.sqrt(2.0 / COMPONENTS)
    value = rate = bend = 0.0
    for k in range(len(waves)):
        frequency = waves[k, 0]
        angle = frequency * time + waves[k, 1]
        sine = math.sin(angle)
        value += sine
        rate += frequency * math.cos(angle)
        bend -= frequency * frequency * sine
    return amplitude * value, amplitude * rate, amplitude * bend
