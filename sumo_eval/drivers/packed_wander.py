"""The wander of many drivers: `drivers.wander` on arrays, to the last bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.elementwise import circle
from sumo_eval.drivers.wander import SmoothNoise
from sumo_eval.trajectory import FloatArray


class PackedNoise:
    """n `SmoothNoise`s; arrays (8, n), one row a sine."""

    def __init__(self, noises: Sequence[SmoothNoise]) -> None:
        self._amplitude = np.array([noise.amplitude for noise in noises])
        waves = np.array([noise.waves for noise in noises])  # (n, 8, 2)
        self._frequency, self._phase = waves.transpose(2, 1, 0).copy()
        self._squared = self._frequency * self._frequency

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these, in this order."""
        self._amplitude = self._amplitude[rows]
        self._frequency, self._phase = self._frequency[:, rows], self._phase[:, rows]
        self._squared = self._squared[:, rows]

    def value(self, time: float) -> FloatArray:
        """Each one's n(time), (n,)."""
        return self._amplitude * _total(circle(self._frequency * time + self._phase).sine)

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value, rate and bend of each at its own time (s), (n,)."""
        turns = circle(self._frequency * times + self._phase)
        terms = np.empty((len(turns.sine), 3, len(times)))
        terms[:, 0] = turns.sine
        np.multiply(self._frequency, turns.cosine, out=terms[:, 1])
        np.multiply(self._squared, turns.sine, out=terms[:, 2])
        value, rate, bend = _total(terms)
        return self._amplitude * value, self._amplitude * rate, self._amplitude * -bend


def _total(terms: FloatArray) -> FloatArray:
    """The sum over the first axis, term by term as in a loop: numpy's own sum may take another order."""
    total: FloatArray = terms[0].copy()
    for term in terms[1:]:
        total += term
    return total
