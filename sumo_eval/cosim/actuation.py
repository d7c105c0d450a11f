"""From an ADS's command to the one that reaches the vehicle: late commands and the way that a
command takes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.settings import ConditionSettings

Clip = Callable[[str, float, float], None]
"""Puts on record: what, the value asked for, the value that held."""

# before the first command has arrived: the speed is kept, the wheel is straight
_NEUTRAL = Command(0.0)
_ROUNDING = 1e-9  # s


class Actuation:
    """Commands of one case under `actuation_delay` and `step_budget`."""

    def __init__(self, conditions: ConditionSettings, clip: Clip) -> None:
        self._delay = conditions.actuation_delay
        self._budget = conditions.step_budget
        self._clip = clip
        self._last = _NEUTRAL
        self._under_way: deque[tuple[float, Command]] = deque([(float("-inf"), _NEUTRAL)])

    def pass_on(self, command: Command | None, time: float, took: float) -> Command | None:
        """The command that reaches the vehicle at `time` s.

        took: wall time of the ADS's step, s.

        A step that was late leaves the last command in force. What an ADS tells SUMO itself cannot
        be held back.
        """
        if self._budget is not None and took > self._budget:
            self._clip("late_command", took, self._budget)
            command = None if command is None else self._last
        if command is None:
            if self._delay > 0.0:
                self._clip("actuation_not_delayed", self._delay, 0.0)
            return None
        self._last = command
        if self._delay == 0.0:
            return command
        self._under_way.append((time, command))
        while len(self._under_way) > 1 and self._under_way[1][0] <= time - self._delay + _ROUNDING:
            self._under_way.popleft()
        return self._under_way[0][1]


class Delays:
    """Commands of a batch on their way to the vehicles.

    delays: of each case, s.
    step: of the simulation, s.
    kind: of a command in the records of egos.
    """

    def __init__(self, delays: Sequence[float], step: float, kind: np.dtype[np.void]) -> None:
        self._steps = np.array([max(math.ceil((it - _ROUNDING) / step), 0) for it in delays])
        # a ring over the last steps; a command that was never given is neutral
        self._under_way = np.zeros((self._steps.max() + 1, len(delays)), kind)

    def pass_on(self, commands: NDArray[np.void], cases: NDArray[np.intp], now: int) -> None:
        """Replace commands of cases, (n,), by those that arrive in step `now`."""
        slots = len(self._under_way)
        if slots > 1:
            self._under_way[now % slots, cases] = commands
            commands[:] = self._under_way[(now - self._steps[cases]) % slots, cases]
