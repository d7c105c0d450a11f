"""A watch over an ADS while it drives: a step that hangs is interrupted, a fault past the limits says which limit."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

from sumo_eval.cosim.controller import Briefing, Controller
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import ControllerTimeoutError


class _OverdueError(BaseException):
    """Raised in the middle of a step that is over its time. No `except Exception` of the ADS catches it."""


class WatchedController:
    """A controller whose steps end in time, by an exception raised in them, wherever Python code runs or waits.

    Code that keeps the interpreter's lock cannot be interrupted so; there the deadline of the case ends the process.
    """

    def __init__(self, controller: Controller, step_timeout: float, memory_limit: float) -> None:
        self._controller = controller
        self._step_timeout = step_timeout
        self._memory_limit = memory_limit
        self._stepping = False
        ads: Any = getattr(controller, "target", getattr(controller, "function", None))
        if hasattr(ads, "settled"):
            self.settled = ads.settled  # what an ADS says of itself, for cases that end when they are decided
        self._armed = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Pass on. Loading a model may take its time: only the deadline of the case holds."""
        self._controller.reset(scenario, traci, ego)
        if self._armed:  # after the ADS's own reset, which may have set handlers
            signal.signal(signal.SIGALRM, self._interrupt)

    def step(self, traci: Any, ego: str, time: float) -> Command | None:
        """Ask the controller. Raises ControllerTimeoutError when it is over its time."""
        try:
            self._stepping = True
            if self._armed:  # again and again: an ADS may swallow the first
                signal.setitimer(signal.ITIMER_REAL, self._step_timeout, self._step_timeout)
            try:
                return self._controller.step(traci, ego, time)
            finally:
                self._stepping = False
                if self._armed:
                    signal.setitimer(signal.ITIMER_REAL, 0.0)
        except _OverdueError as overdue:
            raise ControllerTimeoutError("interrupted") from overdue
        except MemoryError as error:
            raise MemoryError(f"more than the {self._memory_limit:g} MB of `run.memory_limit`") from error
        except (KeyboardInterrupt, GeneratorExit) as error:  # nobody at a keyboard reaches a child: the ADS raised it
            raise RuntimeError(f"it raised {type(error).__name__}") from error

    def close(self) -> None:
        """Pass on."""
        self._controller.close()

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self._stepping:
            raise _OverdueError
