"""From an ADS's command to the one that reaches the vehicle: late commands and the way that a
command takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.settings import ConditionSettings

_ROUNDING = 1e-9  # s; a delay of whole steps does not become one more by rounding


class Actuation:
    """Commands of cases on their way to the vehicles, under `actuation_delay` and `step_budget`.

    conditions: of each case; only a case alone has a budget.
    step: of the simulation, s.
    kind: of a command in the records of egos.
    note: puts on record of a case alone: what, the value asked for, the value that held.
    """

    def __init__(
        self,
        conditions: Sequence[ConditionSettings],
        step: float,
        kind: np.dtype[np.void],
        note: Callable[[str, float, float], None],
    ) -> None:
        self._steps = np.array(
            [max(math.ceil((it.actuation_delay - _ROUNDING) / step), 0) for it in conditions]
        )
        self._budget, self._note = conditions[0].step_budget, note
        # a ring over the last steps; before the first command the speed is kept, the wheel straight
        self._given = np.zeros((self._steps.max() + 1, len(conditions)), kind)
        self._late = False

    def pass_on(
        self, commands: NDArray[np.void], cases: Any, now: int, took: float | None, *,
        given: bool = True,
    ) -> None:  # fmt: skip
        """Replace commands of cases, (n,), by those that arrive in step `now`.

        took: wall time of the ADS's step, s; None: it was not asked, and what
            its last command was, late or in time, still holds.
        given: whether there are new commands; else, or where they are late, the last ones hold.
        """
        slots = len(self._given)
        if self._budget is not None:
            if took is not None:
                self._late = took > self._budget
                if self._late:
                    self._note("late_command", took, self._budget)
        elif slots == 1:
            return
        new = commands if given and not self._late else self._given[(now - 1) % slots, cases]
        self._given[now % slots, cases] = new
        commands[:] = self._given[(now - self._steps[cases]) % slots, cases]
