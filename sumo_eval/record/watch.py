"""A watch over an ADS while it drives: a step that hangs is interrupted, a fault past the limits
says which limit.
"""

from __future__ import annotations

import os
import signal
import threading

# signal.getsignal looks the handler up in an Enum first, which costs more than a system call
from _signal import getsignal  # type: ignore[import-not-found]
from collections.abc import Callable
from types import FrameType
from typing import Any

from sumo_eval.cosim.compiled import Compiled
from sumo_eval.cosim.doors.controller import (
    Adapter,
    Briefing,
    NativeModel,
    ObjectController,
    takes_arrays,
)
from sumo_eval.cosim.doors.json_lines import JsonLinesProgram
from sumo_eval.cosim.doors.traci_program import TraciProgram
from sumo_eval.cosim.plans import Wanted
from sumo_eval.errors import ControllerTimeoutError
from sumo_eval.settings import RunSettings
from sumo_eval.text import kind_of

# exit code of a copy of a process, made by a fork in a step, that goes on with the case as the
# process does
COPY = 87
_ALARM = int(getattr(signal, "SIGALRM", 0))


_ASKED = [False]  # whether an ADS is at its step; one at a time, however many are driven


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _ASKED[0]:
        raise _OverdueError


class _OverdueError(BaseException):
    """Raised in the middle of a step that is over its time.

    No `except Exception` of the ADS catches it.
    """


def watched(controller: Adapter, limits: RunSettings) -> Adapter:
    """The controller under watch.

    SUMO's own models and what ships need none, and programs are watched where they are talked to.
    """
    if isinstance(controller, NativeModel | JsonLinesProgram | TraciProgram):
        return controller
    if isinstance(controller, ObjectController) and Compiled.rides(controller.target):
        return controller
    return WatchedController(controller, limits)


def interrupted(error: KeyboardInterrupt) -> RuntimeError:
    """Exception to raise instead: a keyboard never reaches a child, so the ADS raised it."""
    return RuntimeError(f"it raised {kind_of(error)}")


def interrupts_of_ads(limits: RunSettings) -> tuple[type[KeyboardInterrupt], ...]:
    """Interrupts that are the ADS's own: with the engine `serial`, a user's Ctrl-C comes here."""
    return () if limits.engine == "serial" else (KeyboardInterrupt,)


class WatchedController(Adapter):
    """A controller whose steps end in time, by an exception raised in them, wherever Python code
    runs or waits.

    Code that keeps the interpreter's lock cannot be interrupted so; there the deadline of the case
    ends the process.
    """

    def __init__(self, controller: Any, limits: RunSettings) -> None:
        self._controller = controller
        self._allowed = limits.step_timeout
        self._limits = limits
        self._interrupts = interrupts_of_ads(limits)
        self._process = os.getpid()
        self.target = controller.target
        self.is_policy, self.observes = controller.is_policy, controller.observes
        self._armed = (
            hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
        )

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Pass on. Loading a model may take its time: only the deadline of the case holds."""
        try:
            self._controller.reset(scenario, traci, ego)
        except self._interrupts as error:
            raise interrupted(error) from error
        if self._armed:  # after the ADS's own reset, which may have set handlers
            signal.signal(signal.SIGALRM, _interrupt)

    def step(self, traci: Any, ego: str, time: float) -> Wanted | None:
        """Ask the controller.

        Raises ControllerTimeoutError when it is over its time.
        """
        asked: Wanted | None = self._in_time(self._controller.step, traci, ego, time)
        return asked

    def act(self, seen: Any) -> Any:
        """Ask the policy.

        Raises ControllerTimeoutError when it is over its time.
        """
        if takes_arrays(self._controller):
            self._allowed = self._limits.step_timeout * len(seen.number)
        return self._in_time(self._controller.act, seen)

    def _in_time(self, ask: Callable[..., Any], *arguments: Any) -> Any:
        try:
            _ASKED[0] = True
            if self._armed:  # again and again: an ADS may swallow the first
                signal.setitimer(signal.ITIMER_REAL, self._allowed, self._allowed)
            try:
                return ask(*arguments)
            except self._interrupts as error:
                raise interrupted(error) from error
            finally:
                # the step forked, and this is the copy: it must not continue
                if os.getpid() != self._process:
                    os._exit(COPY)
                _ASKED[0] = False
                # our own alarm may stay set: `_interrupt` ignores it until the next step sets it
                # again; an alarm of the ADS may not
                if self._armed and getsignal(_ALARM) is not _interrupt:
                    signal.setitimer(signal.ITIMER_REAL, 0.0)
        except _OverdueError as overdue:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self._allowed:g} s, took longer"
            ) from overdue
        except MemoryError as error:
            raise MemoryError(
                f"more than the {self._limits.memory_limit:g} MB of `run.memory_limit`"
            ) from error

    def close(self) -> None:
        """Pass on, with no alarm set."""
        if self._armed:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        try:
            self._controller.close()
        except self._interrupts as error:
            raise interrupted(error) from error
