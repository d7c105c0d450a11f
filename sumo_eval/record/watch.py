"""A watch over an ADS while it drives: interrupts a step that takes too long, and names the limit
of time or memory that the ADS has exceeded.

For `record/worker.py`, which drives cases in a child process or, with `serial`, in the owner.

Users: `record/apart.py`, `record/pool.py`, `record/worker.py`.
"""

import os
import signal
import threading

# called at every step: `signal.getsignal` takes longer, because it makes an Enum of its result
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

# exit code of a copy of the process that an ADS forked in its step; the copy exits at once, so that
# it does not drive the case a second time
COPY = 87
_ALARM = int(getattr(signal, "SIGALRM", 0))


_asked = False  # whether an ADS is at its step: a process asks one at a time


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _asked:
        raise _OverdueError


class _OverdueError(BaseException):
    """Raised in the middle of a step that is over its time.

    No `except Exception` of the ADS catches it.
    """


def watched(controller: Adapter, limits: RunSettings) -> Adapter:
    """The controller under watch, or the controller itself if it needs no watch.

    SUMO's own models and the compiled rules of baselines need none. The doors for programs
    (`exec:`, `traci:`) have a watch of their own.
    """
    if isinstance(controller, NativeModel | JsonLinesProgram | TraciProgram):
        return controller
    # a baseline's compiled rule
    if isinstance(controller, ObjectController) and Compiled.rides(controller.target):
        return controller
    return WatchedController(controller, limits)


def interrupted(error: KeyboardInterrupt) -> RuntimeError:
    """The fault of an ADS that raised KeyboardInterrupt itself: Ctrl-C never reaches a child."""
    return RuntimeError(f"it raised {kind_of(error)}")


def interrupts_of_ads(limits: RunSettings) -> tuple[type[KeyboardInterrupt], ...]:
    """Exceptions to take as the ADS's own fault; none with the engine `serial`, whose process gets
    the user's Ctrl-C.
    """
    return () if limits.engine == "serial" else (KeyboardInterrupt,)


class WatchedController(Adapter):
    """A controller whose steps are interrupted by an exception when they take too long.

    The exception cannot reach C code that keeps the interpreter's lock. In that case the deadline
    of the case ends the process.
    """

    def __init__(self, controller: Any, limits: RunSettings) -> None:
        self._controller = controller
        self._allowed = limits.step_timeout
        self._limits = limits
        self._interrupts = interrupts_of_ads(limits)
        self._process = os.getpid()
        self.target = controller.target
        self.is_policy = controller.is_policy
        self._armed = (
            hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
        )

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Reset the controller under the case's deadline alone: models may load slowly."""
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
        wanted: Wanted | None = self._in_time(self._controller.step, traci, ego, time)
        return wanted

    def act(self, seen: Any) -> Any:
        """Ask the policy.

        Raises ControllerTimeoutError when it is over its time.
        """
        if takes_arrays(self._controller):  # it answers for all cases at once
            self._allowed = self._limits.step_timeout * len(seen.number)
        return self._in_time(self._controller.act, seen)

    def _in_time(self, ask: Callable[..., Any], *arguments: Any) -> Any:
        """The answer of the ADS, unless a limit of time or memory is passed."""
        global _asked
        try:
            _asked = True
            if self._armed:  # repeated, because the ADS may catch the first exception
                signal.setitimer(signal.ITIMER_REAL, self._allowed, self._allowed)
            try:
                return ask(*arguments)
            except self._interrupts as error:
                raise interrupted(error) from error
            finally:
                # another process: a copy that the step has made by a fork; it must not continue
                if os.getpid() != self._process:
                    os._exit(COPY)
                _asked = False
                # The alarm may stay set, which saves a call: `_interrupt` ignores it from now on,
                # and the next step sets it again. But if the ADS has set a signal handler of its
                # own, that must not get this alarm.
                if self._armed and getsignal(_ALARM) is not _interrupt:
                    signal.setitimer(signal.ITIMER_REAL, 0.0)
        except _OverdueError as overdue:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self._allowed:g} s, took longer"
            ) from overdue
        except MemoryError as error:
            if self._limits.engine == "serial":  # sets no limit
                raise
            raise MemoryError(
                f"more than the {self._limits.memory_limit:g} MB of `run.memory_limit`"
            ) from error

    def close(self) -> None:
        """Close the controller, with no alarm set."""
        if self._armed:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        try:
            self._controller.close()
        except self._interrupts as error:
            raise interrupted(error) from error
