"""Commands on their way from the ADS to the vehicle: delayed, or dropped where a step of the ADS
took too long.

Users: `cosim/ego_control.py`, `cosim/on_traci.py`.
"""

from collections.abc import Callable, Sequence
from math import ceil, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.records import EGO
from sumo_eval.settings import ConditionSettings

# s: rounding must not add a step to a delay of whole steps (0.3 s in steps of 0.1 s)
_ROUNDING = 1e-9


class Actuation:
    """Commands of cases on their way to the vehicles, under `actuation_delay` and `step_budget` of
    `ConditionSettings`.

    An answer over the budget is dropped: it never arrives, and whatever moved the ego before still
    does.

    conditions: of each case; only a case that is driven alone has a budget.
    step: of the simulation, s.
    note: records an event of a case driven alone: name, requested value, applied value.
    """

    def __init__(
        self,
        conditions: Sequence[ConditionSettings],
        step: float,
        note: Callable[[str, float, float], None],
    ) -> None:
        # delay of each case in steps
        self._steps = np.array(
            [max(ceil((it.actuation_delay - _ROUNDING) / step), 0) for it in conditions]
        )
        # s of wall time; a case with a budget is the only one
        self.budget = conditions[0].step_budget or inf
        self._note = note
        # commands of the last steps, (slots, cases), as a ring: step k is in slot k % slots. Zeros
        # until the first command: speed kept, wheel straight.
        self._ring = np.zeros((self._steps.max() + 1, len(conditions)), EGO["command"])

    def late(self, took: float) -> bool:
        """Whether an answer is over the budget; notes it if so.

        took: wall time of the ADS's step, s.
        """
        if took <= self.budget:
            return False
        self._note("late_command", took, self.budget)
        return True

    def pass_on(self, commands: NDArray[np.void], cases: Any, now: int, *, has_new: bool) -> None:
        """Replace commands of cases, (n,), by the commands that arrive in step `now`. Call it in
        every step.

        commands: replaced in place; without delay and budget the commands stay as they are.
        cases: the index of each command's case.
        now: number of the step.
        has_new: whether there are new commands; else the last ones hold.
        """
        slots = len(self._ring)  # one for each step of the longest delay, one for the present step
        if slots == 1 and self.budget == inf:
            return
        new = commands if has_new else self._ring[(now - 1) % slots, cases]
        self._ring[now % slots, cases] = new
        commands[:] = self._ring[(now - self._steps[cases]) % slots, cases]
