"""Wall times of an ADS's steps and, between them, of a fixed piece of work.

The time of the fixed work distinguishes a slow ADS from a slow or busy machine.

Users: `cosim/world.py` holds the times; `cosim/loop.py`, `cosim/ego_control.py`,
`cosim/policies.py` and `cosim/on_traci.py` measure them.
"""

import time
from array import array
from collections.abc import Sequence

from sumo_eval.trajectory import Latency

# steps between two timings of the fixed work: its 10 us are negligible beside 64 steps
STEPS_BETWEEN_TIMINGS = 64
LATE = 0.99  # quantile of the steps' times that `Latency.late` holds


class Latencies:
    """Wall times of the ADS's steps in one simulation, s.

    own: of each case; callers append to `own[case]`.
    shared: of steps whose one call of the ADS serves all cases. If it has times, `own` is not read.
    """

    def __init__(self, cases: int) -> None:
        self.own = [array("d") for _ in range(cases)]
        self.shared = array("d")
        self._reference = array("d")

    def time_fixed_work(self) -> None:
        """Time the fixed work once: some ten microseconds of plain Python."""
        began = time.perf_counter()
        total = 0.0
        for number in range(200):
            total += 0.5 * number
        self._reference.append(time.perf_counter() - began)

    def of_cases(self) -> list[Latency]:
        """Latency of each case, once all cases have ended."""
        reference = sorted(self._reference)
        fixed_work = reference[len(reference) // 2] if reference else 0.0  # the median
        if self.shared:  # computed once: a batch has hundreds of cases
            return [_latency(self.shared, fixed_work)] * len(self.own)
        return [_latency(times, fixed_work) for times in self.own]


def _latency(times: Sequence[float], fixed_work: float) -> Latency:
    """Latency of a case whose steps took these wall times, s; `fixed_work`: of the fixed work."""
    steps = sorted(times) or [0.0]  # the shortest first
    return Latency(
        mean=sum(steps) / len(steps),
        longest=steps[-1],
        median=steps[len(steps) // 2],
        late=steps[int(LATE * len(steps))],
        reference=fixed_work,
    )
