"""How long a driver takes over its steps, beside a fixed piece of work that is timed between
them.
"""

from __future__ import annotations

import time
from array import array
from functools import cached_property

import numpy as np

from sumo_eval.trajectory import Latency

EVERY = 16  # steps between two timings of the fixed work
LATE = 0.99  # quantile


def fixed_work() -> float:
    """Some ten microseconds of plain Python."""
    total = 0.0
    for number in range(200):
        total += 0.5 * number
    return total


class Latencies:
    """Wall times of the steps of cases that are driven together, s: of each case, or shared by
    all.
    """

    def __init__(self, cases: int) -> None:
        self.own = [array("d") for _ in range(cases)]
        self.shared = array("d")
        self._reference = array("d")

    def time_fixed_work(self) -> None:
        """Time the fixed work once."""
        began = time.perf_counter()
        fixed_work()
        self._reference.append(time.perf_counter() - began)

    def of(self, case: int) -> Latency:
        """Of one case."""
        return self._of_all if self.shared else self._of(self.own[case])

    @cached_property
    def _of_all(self) -> Latency:
        return self._of(self.shared)

    def _of(self, took: array[float]) -> Latency:
        steps, work = (
            np.sort(np.frombuffer(times)) if times else np.zeros(1)
            for times in (took, self._reference)
        )
        late = steps[min(int(LATE * len(steps)), len(steps) - 1)]
        return Latency(
            *map(
                float, (steps.mean(), steps[-1], steps[len(steps) // 2], late, work[len(work) // 2])
            )
        )
