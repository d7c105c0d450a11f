"""From an ADS's command to the one that reaches the vehicle: late commands and the way that a
command takes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.settings import ConditionSettings

Clip = Callable[[str, float, float], None]
"""Puts on record: what, the value asked for, the value that held."""

# before the first command has arrived: the speed is kept, the wheel is straight
_NEUTRAL = Command(0.0)


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
        while len(self._under_way) > 1 and self._under_way[1][0] <= time - self._delay + 1e-9:
            self._under_way.popleft()
        return self._under_way[0][1]
