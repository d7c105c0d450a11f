"""Controls of egos by users' policies: `OneEach` calls one policy for each row, `OverArrays` one
policy over arrays of all rows.

Users: `cosim/on_traci.py`, `cosim/simulation.py`.
"""

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from sumo_eval.cosim.doors.controller import Briefing, as_command
from sumo_eval.cosim.doors.observation import (
    Observation,
    Observations,
    Perception,
    present,
    sees_all,
    stream_of,
    task_of,
)
from sumo_eval.cosim.doors.traci_module import GUARD, TRACI, RefusedCallError
from sumo_eval.cosim.ego_control import (
    EgoControl,
    Terms,
    error_of,
    fault_of,
    note_unlimited,
    settled_of,
)
from sumo_eval.cosim.plans import Executor
from sumo_eval.cosim.records import COMMAND, numbers_of
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError, ControllerTimeoutError, said
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.text import SENTENCE, words_of
from sumo_eval.trajectory import Alone, EndReason, FloatArray, IntArray

# characters of an error message, less 20 for ` at 12.34 s.` or the like
_LONGEST_WORDS = SENTENCE - 20
ASKS_SUMO = Alone("asks_sumo")  # reason to drive a case alone: its ADS calls TraCI


def make_briefing(
    concrete: ConcreteScenario, settings: SimulationSettings, terms: Terms
) -> Briefing:
    """The briefing of a controller before a case."""
    revealed = settings.conditions.reveal_scenario
    road = concrete.road
    return Briefing(
        concrete.scenario if revealed else "",
        road if revealed else replace(road, name="road"),
        settings.vehicle,
        settings.step,
        concrete.values if revealed else None,
        terms.step_timeout,
        *task_of(concrete),
        terms.every * settings.step,
        concrete.ego.way,
    )


class Policies(EgoControl):
    """Common part of both controls."""

    checks = False  # whether `_check` reports a refused call, so that `_fail` does not

    def begin(self, world: World, stage: Stage) -> None:
        """Take the arrays of the world."""
        super().begin(world, stage)
        self._alone = len(world.cases) == 1
        self.keep(world, world.rows)

    def keep(self, world: World, rows: IntArray) -> None:
        """Drop all rows but these; keep their order."""
        self._commands = numbers_of(world.egos)[:, COMMAND]

    def _fail(
        self, world: World, rows: Sequence[int] | IntArray, error: BaseException, when: str
    ) -> None:
        """Fail the rows for which a call raised an error.

        In a batch, the cases of a policy that called TraCI or ran out of memory do not fail: they
        are driven alone, later.

        when: `in reset` or `at 1.50 s`, for the message.
        """
        reason = None if self._alone else self._reason_to_leave(error)
        if reason is not None:
            GUARD.refusal = None
            for row in rows:
                world.leave(row, reason)
            return
        if len(rows) > 1:
            when = f"{when}, in one call for {len(rows)} cases, which fails them all"
        for row in rows:
            case = world.case_of(row)
            world.keep_fault(case, error, self._ads[case].target, self._terms.folder)
            if not (self.checks and isinstance(error, RefusedCallError)):
                world.fail(row, *_blamed(error, when))

    def _reason_to_leave(self, error: BaseException) -> Alone | None:
        """Why the cases of an error are to be driven alone; None: the error is the ADS's own."""
        if isinstance(error, MemoryError):
            return Alone("together_failed", said(error))
        asks_sumo = GUARD.refusal is not None or isinstance(error, self._traci.TraCIException)
        return ASKS_SUMO if asks_sumo else None

    def _call(
        self,
        world: World,
        rows: Sequence[int] | IntArray,
        when: str,
        call: Callable[..., Any],
        *arguments: Any,
    ) -> bool:
        """Call the user's code; return whether it succeeded.

        An error fails the rows. So does a refused call whose exception the code has caught, unless
        `_check` reports it.

        when: as of `_fail`.
        """
        error = error_of(call, *arguments)
        refusal = GUARD.refusal
        if error is None and refusal is not None and not (self._alone and self.checks):
            error = RefusedCallError("; ".join(refusal))  # the ADS caught it
        if error is not None:
            self._fail(world, rows, error, when)
        return error is None


class OneEach(Policies):
    """Controls egos by a policy in plain Python for each row, with its own errors, times and state.

    A policy is called every n-th step (`Terms.every`); its answer holds in between.
    """

    checks = True

    def begin(self, world: World, stage: Stage) -> None:
        """Prepare perception and the executors of plans, and reset each policy."""
        self._road = world.cases[0].road
        self._tasks = [task_of(concrete) for concrete in world.cases]
        self._kinds = [[actor.body for actor in concrete.actors] for concrete in world.cases]
        self._executors = [
            Executor(settings, partial(world.note, case), self._road.line)
            for case, settings in enumerate(world.each)
        ]
        conditions = [settings.conditions for settings in world.each]
        self._limited = np.array([not sees_all(it) for it in conditions])
        self._perception = None
        if self._limited.any():
            streams = list(map(stream_of, self._seeds, world.cases))
            self._perception = Perception(conditions, streams)
        super().begin(world, stage)
        self._reset(world)

    def _reset(self, world: World) -> None:
        """Reset each policy with its briefing."""
        for case, policy in enumerate(self._ads):
            if case not in world.errors:
                briefing = make_briefing(world.cases[case], world.each[case], self._terms)
                self._call(world, [case], "in reset", policy.reset, briefing, TRACI, EGO)
        self._check(world, 0.0)
        # whether a number as answer can be used at once: no later step needs it
        self._brief = self._terms.every == 1 and self.actuation.budget == inf
        self._settled = [settled_of(policy, world.settings) for policy in self._ads]

    def keep(self, world: World, rows: IntArray) -> None:
        """Drop all rows but these; keep their order."""
        super().keep(world, rows)
        self._limited = self._limited[rows]
        if self._perception is not None:
            self._perception.keep(rows)
        # The first 8 numbers of a record: the 7 of a `records.BODY`, then the acceleration of an
        # ego, or the rate of an actor.
        self._ego_values = numbers_of(world.egos)[:, :8]
        self._other_values = numbers_of(world.others)[:, :, :8]
        self._present = world.others["present"]

    def _look(self, time: float) -> tuple[list[Any], list[Any], list[Any]]:
        """Of each row: the ego as it is, the ego as the ADS sees it, the actors as the ADS sees
        them; numbers as in `Observation`.
        """
        egos = self._ego_values.tolist()
        others = present(self._other_values, self._present)
        if self._perception is None:
            return egos, egos, others.tolist()
        seen_egos, seen = self._perception.look(time, self._ego_values[:, :7], others[..., :7])
        others = np.where(self._limited[:, None, None], seen, others)
        return egos, seen_egos.tolist(), others.tolist()

    def _check(self, world: World, time: float) -> None:
        """Check SUMO's clock where the policy has the simulation to itself."""
        error = error_of(self._check_clock, time) if self._alone else None
        if error is not None:
            world.fail(0, "ads_error", str(error))

    def step(self, world: World, time: float) -> None:
        """Call the policy of each row."""
        egos, seen_egos, others = self._look(time)
        commands = {}  # by row
        wall_time = clock.perf_counter
        terms = self._terms
        if self._alone:
            GUARD.call_listeners()  # before its policy
        # a case alone has one row, which is live: a search for live rows costs time
        for row in world.live.tolist() if len(egos) > 1 else (0,):
            case = int(world.rows[row])
            policy = self._ads[case]
            executor = self._executors[case]
            started = wall_time()
            try:
                if world.steps % terms.every:  # between two calls
                    command = executor.command(None, egos[row], time)
                    commands[row] = command.acceleration, command.steering
                    continue
                look = seen_egos[row], others[row]
                action = policy.act(
                    Observation(
                        time, self._road, egos[row], look, self._tasks[case], self._kinds[case]
                    )
                )
                # the usual answer, in a quick way: an acceleration, m/s2
                if self._brief and type(action) is float and -inf < action < inf:
                    executor.release()
                    answer = action, 0.0
                else:
                    # None: the plan in force still holds
                    request = None if action is None and executor.holds_plan else as_command(action)
                    late = self.actuation.late(wall_time() - started)
                    command = executor.command(request, egos[row], time, late=late)
                    answer = command.acceleration, command.steering
                took = wall_time() - started
                # the ADS caught the exception of a refused call
                if GUARD.refusal is not None and not self._alone:
                    raise RefusedCallError
                if took > terms.step_timeout:
                    raise ControllerTimeoutError(
                        f"The ADS must answer within {terms.step_timeout:g} s, took longer"
                    )
                if (settled := self._settled[case]) is not None:
                    world.egos["settled"][row] = bool(settled())
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # noqa: BLE001 - passed to `_fail`
                world.latencies.own[case].append(wall_time() - started)
                self._fail(world, [row], error, f"at {time:.2f} s")
                continue
            world.latencies.own[case].append(took)
            commands[row] = answer
        if commands:
            self._commands[list(commands)] = list(commands.values())
        self._check(world, time)
        self._pass_on(world)

    def release(self, world: World, row: int) -> None:
        """Close the row's policy."""
        policy = self._ads[world.case_of(row)]
        if self._alone:
            self._close_guarded(world, row, policy.close, policy.target)
        else:
            self._close(world, row, policy.close, "ads_error", policy.target)
            GUARD.refusal = None
        super().release(world, row)


def _blamed(error: BaseException, when: str) -> tuple[EndReason, str]:
    """Why a case ends at an error of the user's code, and the message; `when` as of `_fail`."""
    if not isinstance(error, ControllerError):
        return "ads_error", f"The ADS raised {when}: {said(error)}."
    words = words_of(error, SENTENCE)
    # with the time, unless the message ends with it
    return fault_of(error), words if words.endswith(f" {when}.") else str(with_time(error, when))


def with_time(error: ControllerError, when: str) -> ControllerError:
    """An error of an adapter, or of a step that took too long, with the time in its message.

    when: `at 1.50 s`, or `in reset`.
    error: may be of a class of the user's; the result is of the package's class.
    """
    kind = ControllerTimeoutError if isinstance(error, ControllerTimeoutError) else ControllerError
    return kind(f"{words_of(error, _LONGEST_WORDS)} {when}.")


class OverArrays(Policies):
    """Controls egos by one policy for all rows, which maps arrays of observations to arrays of
    commands.

    A command may depend on the other rows of the batch: that of a neural network does, in the last
    bit.
    """

    def begin(self, world: World, stage: Stage) -> None:
        """Reset the policy once for all rows."""
        super().begin(world, stage)
        note_unlimited(world)  # arrays show the world as it is
        policy = self._policy = self._ads[0]
        self._unreleased = len(world.cases)
        briefing = make_briefing(world.cases[0], world.each[0], self._terms)
        briefing = replace(briefing, values=None)
        self._call(world, world.live, "in reset", policy.reset, briefing, TRACI, EGO)
        self._settled = settled_of(policy, world.settings)

    def step(self, world: World, time: float) -> None:
        """Call the policy once for all rows."""
        live = world.live
        seen = Observations(
            time, world.cases[0].road, world.rows[live], world.egos[live], world.seen[live],
            world.others[live], world.cases,
        )  # fmt: skip
        started = clock.perf_counter()
        if not self._call(world, live, f"at {time:.2f} s", self._command, world, live, seen):
            return
        took = (clock.perf_counter() - started) / len(live)
        world.latencies.shared.append(took)
        self._pass_on(world, took)

    def _command(self, world: World, live: IntArray, seen: Observations) -> None:
        """Write the policy's commands for the rows that are live."""
        rows = len(live)
        answer = self._answer(seen, rows)
        if self._settled is not None:
            settled = np.asarray(self._settled(), bool)
            if settled.shape != (rows,):
                raise ControllerError(
                    f"`settled()` of the ADS must give the shape ({rows},), got {settled.shape}"
                )
            world.egos["settled"][live] = settled
        self._commands[live] = 0.0  # an answer without steering keeps the wheel straight
        answer = answer.reshape(rows, -1)
        self._commands[live, : answer.shape[1]] = answer

    def _answer(self, seen: Observations, rows: int) -> FloatArray:
        """The policy's answer: accelerations, (rows,) or (rows, 1), or (rows, 2) with steering.

        It may take `Terms.step_timeout` for each row.
        """
        started = clock.perf_counter()
        try:
            given = np.asarray(self._policy.act(seen))
            overdue = clock.perf_counter() - started > self._terms.step_timeout * rows
        except ControllerTimeoutError:  # raised by the watch over the process
            overdue = True
        if overdue:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self._terms.step_timeout:g} s a case, took longer"
            )
        if given.shape not in ((rows,), (rows, 1), (rows, 2)):
            raise ControllerError(
                f"The actions of the ADS must have the shape ({rows},) or ({rows}, 2), got "
                f"{given.shape}"
            )
        if given.dtype.kind not in "fiuO":  # O: a type of its own, of which `float` makes a number
            raise ControllerError(
                f"The actions of the ADS must be real numbers, got an array of {given.dtype}"
            )
        return np.asarray(given, float)

    def release(self, world: World, row: int) -> None:
        """Close the policy when the last row has ended."""
        self._unreleased -= 1
        if self._unreleased == 0:
            self._close(world, row, self._policy.close, "ads_error", self._policy.target)
        super().release(world, row)
