"""The loop that steps every simulation, of one case or of hundreds in a batch.

A step: the ADS commands, the vehicle model moves the egos and the scripts move the actors, SUMO
steps all vehicles, the world takes in what SUMO shows. One of five classes controls the egos:
`Rules` (kernels), `OneEach` (a policy in plain Python for each row), `OverArrays` (one policy over
arrays), `Replays` (recorded commands), and `OnTraci` of `cosim/on_traci.py` (an ADS that calls
TraCI).

Users: `cosim/no_return.py`, `cosim/on_traci.py`, `cosim/simulation.py`, `record/worker.py`.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import hypot, inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cosim.actuation import Actuation
from sumo_eval.cosim.doors.controller import (
    Briefing,
    as_command,
    knows_the_scripts,
)
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.doors.observation import (
    Observation,
    Observations,
    Perception,
    present,
    sees_all,
    stream_of,
    task_of,
)
from sumo_eval.cosim.doors.traci_module import GUARD, TRACI, RefusedCallError, heeding
from sumo_eval.cosim.impossible import FASTEST, LOWEST_SPEED, LeftTheRoadError
from sumo_eval.cosim.latency import STEPS_BETWEEN_TIMINGS
from sumo_eval.cosim.plans import Executor
from sumo_eval.cosim.records import COMMAND, MODEL, NEXT, PLANT, REASONS, numbers_of
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.step_rules import stop_rows
from sumo_eval.cosim.sumo.insides import simulation_time
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.cosim.vehicle_model import Command, EgoState
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError, ControllerTimeoutError, SimulationError, said
from sumo_eval.kernels import Records, bound
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.text import SENTENCE, words_of
from sumo_eval.trajectory import Alone, EndReason, FloatArray, IntArray

# characters of an error message; 20 are left for ` at 12.34 s.` or the like
_LONGEST_WORDS = SENTENCE - 20
_CLOCK_TOLERANCE = 1e-4  # s; SUMO counts in milliseconds
ASKS_SUMO = Alone("asks_sumo")  # reason to drive a case alone: its ADS calls TraCI
_STANDS = 1e-3  # m in a step, least divisor in `Replays._steering`: a standing ego does not turn
KEPT = 0.75  # rows of ended cases are dropped when the share of live rows falls below this


class Terms(NamedTuple):
    """Conditions of calling an ADS.

    step_timeout: longest wall time of a step, s.
    plant: the user's vehicle model; None: the package's.
    folder: where relative paths start.
    every: the ADS is called every n-th step.
    """

    step_timeout: float = inf
    plant: FmuPlant | None = None
    folder: Path | None = None
    every: int = 1


def error_of(call: Callable[..., Any], *arguments: Any) -> BaseException | None:
    """The error that a call of the user's code raises, None without one; Ctrl-C is passed on."""
    try:
        call(*arguments)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # noqa: BLE001 - returned to the caller
        return error
    return None


class EgoControl:
    """Controls the egos of all rows.

    ads: what drives each case; a policy over arrays is the first one alone.
    seeds: of each case, for the random effects of its conditions.
    unguarded: whether the ADS writes to SUMO past the harness. If SUMO then shows a vehicle where
        none can be, that is the ADS's fault.
    """

    unguarded = False

    def __init__(self, ads: Sequence[Any], seeds: Sequence[int], terms: Terms) -> None:
        self._ads, self._seeds, self._terms = ads, seeds, terms
        self.released: set[int] = set()  # cases whose ADS has been released

    def begin(self, world: World, stage: Stage) -> None:
        """Prepare for the first step, and take charge of the vehicles."""
        self._traci, self._clock = stage.traci, simulation_time(stage.traci)
        concrete, settings = world.cases[0], world.settings
        others = [actor.name for actor in concrete.actors]
        GUARD.begin(others, settings.step, settings.conditions.interference, heeding(concrete))
        stage.take_charge(world)
        conditions = [settings.conditions for settings in world.each]
        # notes go to case 0: only a case that is alone has a step budget, which makes them
        self.actuation = Actuation(
            conditions, settings.step, world.egos["command"].dtype, partial(world.note, 0)
        )

    def step(self, world: World, time: float) -> None:
        """Write the egos' commands, or fail rows."""
        raise NotImplementedError

    def after(self, world: World, now: float) -> None:
        """Act after SUMO's step to `now`, s."""

    def keep(self, world: World, rows: IntArray) -> None:
        """Drop all rows but these; keep their order."""

    def release(self, world: World, row: int) -> None:
        """Close what the control holds for a row that has ended."""
        if self._terms.plant is not None:
            self._closed(world, row, self._terms.plant.close, "sim_error")

    def _pass_on(self, world: World, took: float = 0.0) -> None:
        """Replace the commands by those that reach the vehicles; with a plant, also ask it for its
        next state.

        took: wall time of the ADS's step, of one case, s; if it is over the budget, the last
            commands hold.
        """
        self.actuation.pass_on(
            world.egos["command"], world.rows, world.steps, has_new=not self.actuation.late(took)
        )
        if self._terms.plant is not None:
            advance_plant(self._terms.plant, world, Command(*world.egos["command"][0].tolist()))

    def _closed(
        self,
        world: World,
        row: int,
        close: Callable[[], None],
        fault: EndReason,
        target: Any = None,
    ) -> None:
        """Close one of the things that a case holds; record an error of it, without raising it.

        close: closes it.
        fault: why the case then ends, unless it ended with a contact.
        target: the user's code, for the place of the error.
        """
        error = error_of(close)
        if error is None:
            return
        world.keep_fault(world.case_of(row), error, target, self._terms.folder)
        subject = "The ADS" if fault == "ads_error" else "The vehicle model"
        if REASONS[int(world.egos["reason"][row])] == "contact":  # it stays the reason
            fault = "contact"
        world.fail(row, fault, f"{subject} raised in close: {said(error)}.")

    def _close_guarded(
        self, world: World, row: int, close: Callable[[], None], target: Any
    ) -> None:
        """Close an ADS that may have used TraCI, and remove its listeners."""
        self._closed(world, row, close, "ads_error", target)
        self._closed(world, row, GUARD.end, "ads_error")
        # records what the ADS changed that is not its own
        world.touched(GUARD.touched, GUARD.ignored)

    def _check_clock(self, world: World, time: float) -> None:
        """Raise ControllerError if the ADS has stepped or closed the simulation, or has caught the
        refusal of a call that is not allowed.
        """
        if GUARD.refusal is not None:
            deed, reason = GUARD.refusal
            raise ControllerError(f"{deed} at {time:.2f} s; {reason}.")
        try:
            now = self._clock()
        except (self._traci.TraCIException, self._traci.FatalTraCIError) as error:
            raise ControllerError(
                f"The ADS closed the simulation at {time:.2f} s; that is the harness's."
            ) from error
        # SUMO is one step ahead: the step that inserted the vehicles
        ahead = now - time - world.settings.step
        if abs(ahead) > _CLOCK_TOLERANCE:
            raise ControllerError(
                f"The ADS moved SUMO's clock by {ahead:+.2f} s at {time:.2f} s; stepping is the "
                "harness's."
            )


def note_unlimited(world: World) -> None:
    """Note in each case with limited perception that its ADS sees everything all the same."""
    for case, settings in enumerate(world.each):
        if not sees_all(settings.conditions):
            world.note(case, "perception_not_limited", 1.0, 0.0)


def drive(world: World, driver: EgoControl, stage: Stage) -> None:
    """Step until every case has ended.

    driver: controls the egos of all rows.
    """
    settings = world.settings
    step, every = settings.step, round(settings.record_interval / settings.step)
    # step: s; every: steps from one sample to the next
    moved = 0  # 1 between `world.move` and SUMO's answer: an error there discards the step
    try:
        driver.begin(world, stage)
        if world.errors or world.left:  # left: cases to be driven alone
            _end_rows(world, driver, stage)
        while world.going:
            steps_after = world.steps + 1
            if world.steps % STEPS_BETWEEN_TIMINGS == 0:
                world.latencies.time_fixed_work()
            driver.step(world, world.steps * step)
            now, sampling = steps_after * step, steps_after % every == 0
            if sampling:
                world.room_for_samples()
            # as_read: actors are where SUMO shows them; count: rows of `world.tell` to send; gone:
            # numbers of actors that left their last lane
            count, gone = world.move(to_sumo=stage.sends(world), as_read=stage.as_read)
            moved = 1
            if gone:
                stage.put_aside(gone)
            try:
                stage.tell(world, count)
                stage.step()
                driver.after(world, now)
                stage.read(world)
                if stage.compares(world.steps):
                    stage.compare(world)
            except stage.traci.TraCIException as error:
                if not stage.ads_asks:  # no ADS may ask SUMO
                    raise
                raise ControllerError(  # the ADS has removed a vehicle by TraCI
                    f"After the ADS's step at {world.time:.2f} s SUMO cannot move the ego: "
                    f"{said(error)}."
                ) from error
            moved = 0
            if world.waits:  # an act of an actor waits for a condition
                world.wake(now)
            if world.see(sampling=sampling, as_read=stage.as_read):
                _end_rows(world, driver, stage)
    except LeftTheRoadError:  # raised only where the case is alone
        world.egos["reason"][0] = REASONS.index("off_road")
        _stop(world, moved)
    except (
        ControllerError, SimulationError, stage.traci.TraCIException, stage.traci.FatalTraCIError
    ) as error:  # fmt: skip
        if len(world.cases) > 1:
            raise
        if driver.unguarded and isinstance(error, SimulationError):
            error = ControllerError(f"The ADS's program is responsible: {error}")
        break_off(world, error, moved)
    finally:
        for row in world.live.tolist():
            _release(world, driver, row)
    for row in world.live.tolist():
        world.end(row)


def _release(world: World, driver: EgoControl, row: int) -> None:
    """Release the controller of a row, once."""
    case = world.case_of(row)
    if case not in driver.released:
        driver.released.add(case)
        driver.release(world, row)


def break_off(world: World, error: Exception, moved: int = 0) -> None:
    """End a single case by an error.

    moved: 1: within a step, which then does not count.
    """
    if isinstance(error, ControllerError | SimulationError):
        world.fail(0, _fault(error), words_of(error, SENTENCE))
    elif not world.errors:  # an ADS that closed the simulation has its error already
        world.fail(
            0,
            "sim_error",
            words_of(f"SUMO stopped at {world.time:.2f} s: {said(error)}.", SENTENCE),
        )
    _stop(world, moved)


def _stop(world: World, moved: int) -> None:
    """Record the vehicles of a single case where it stops; `moved` as in `break_off`."""
    world.room_for_samples()
    stop_rows(world.egos, world.others, world.samples, moved)


def _end_rows(world: World, driver: EgoControl, stage: Stage) -> None:
    """Keep the recordings of rows that have ended, and drop these rows once they are many."""
    egos = world.egos
    for row in np.flatnonzero((egos["reason"] != 0) & (egos["live"] != 0)).tolist():
        case = world.case_of(row)
        # `move_rows` refused a command that is not finite; it cannot make the message
        if REASONS[int(egos["reason"][row])] == "ads_error" and case not in world.errors:
            acceleration, steering = egos["command"][row].tolist()
            name, value = "acceleration", acceleration
            if np.isfinite(acceleration):
                name, value = "steering", steering
            world.fail(
                row,
                "ads_error",
                f"`{name}` of the ADS's Command must be a finite number, got {value!r} "
                f"at {float(egos['time'][row]):.2f} s.",
            )
        _release(world, driver, row)
        stage.remove(world, row)
        world.end(row)
    if not world.going:
        return
    rows = world.live
    if len(rows) < KEPT * len(world.rows):
        world.keep(rows)
        driver.keep(world, rows)
        stage.keep(world)
    else:
        stage.without(world)  # the ended rows stay in the arrays, but SUMO's side passes over them


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


def advance_plant(plant: FmuPlant, world: World, command: Command) -> None:
    """Ask the user's vehicle model for the single ego's state at the end of the coming step."""
    ego = world.egos[0]
    before = EgoState(*ego["map"].tolist(), *ego[["speed", "acceleration", "steering"]].tolist())
    state = plant.advance(before, command, world.settings.step)
    moved = hypot(state.x - before.x, state.y - before.y)
    if not (moved < FASTEST * world.settings.step and LOWEST_SPEED < state.speed < FASTEST):
        raise SimulationError(
            f"The vehicle model moved `{EGO}` {moved:g} m in the step after {world.time:.2f} s, "
            f"to the speed {state.speed:g} m/s; no vehicle is faster than {FASTEST:g} m/s."
        )
    world.egos["next"][0] = tuple(state)
    world.egos["placed"][0] = PLANT


class Rules(EgoControl):
    """Controls egos by rules that are kernels: one object a case, all of one class."""

    def begin(self, world: World, stage: Stage) -> None:
        """Make the memory of every row."""
        super().begin(world, stage)
        note_unlimited(world)  # a rule sees the world
        kind = type(self._ads[0])
        self._loop = kind.loop
        if knows_the_scripts(self._ads[0]):  # the ideal vehicle of Eq. 17
            self._arrays = kind.foreseeing(self._ads, world.cases, world.each)
        else:
            self._arrays = kind.arrays(self._ads, world.scenario, world.seen.shape[1])
        # a call without rows: the kernel is compiled or loaded here, not within a timed step
        self._loop(world.egos[:0], world.seen[:0], *self._arrays, world.scenario, 0.0)
        self._egos: Records | None = None
        self._code = self._loop

    def step(self, world: World, time: float) -> None:
        """Call the kernel once for all rows."""
        started = clock.perf_counter()
        arguments = (world.egos, world.seen, *self._arrays, world.scenario, time)
        # machine code is for arrays of one layout: find it again after `World.keep` replaced them
        if self._egos is not world.egos:
            self._code, self._egos = bound(self._loop, *arguments), world.egos
        self._code(*arguments)
        took = (clock.perf_counter() - started) / world.going
        world.latencies.shared.append(took)
        self._pass_on(world, took)

    def keep(self, world: World, rows: IntArray) -> None:
        """Keep the memory of these rows."""
        # each an array, or a named tuple of arrays
        self._arrays = tuple(
            type(it)(*(array[rows] for array in it)) if isinstance(it, tuple) else it[rows]
            for it in self._arrays
        )


class Replay(NamedTuple):
    """A recorded drive up to a step, and full braking from there on.

    commands: of a `Recording`: acceleration and steering, (steps, 2), or, where SUMO or a plant
        moved the ego, its motion as in `records._NEXT`, (steps, 6).
    until: index of the first step of braking.
    """

    commands: FloatArray
    until: int


class Replays(EgoControl):
    """Controls egos by recorded commands, then by the strongest braking, with the wheel straight,
    or, on a curved road, as it was last.

    The commands were recorded after all delays.
    """

    def begin(self, world: World, stage: Stage) -> None:
        """Find the strongest braking of each ego, and the steering of those that need it."""
        super().begin(world, stage)
        replays = self._ads
        # (n, steps, 6), as in `records._NEXT`; of replays of two columns the first four are 0;
        # the last step, beyond the longest recording, stands for all that follow
        self._commands = np.zeros((len(replays), 1 + max(len(it.commands) for it in replays), 6))
        for row, it in enumerate(replays):
            self._commands[row, : len(it.commands), -it.commands.shape[1] :] = it.commands
        # whether the ego was moved by SUMO or a plant
        self._moved = np.array([it.commands.shape[1] > 2 for it in replays])
        self._until = np.array([it.until for it in replays])
        self._strongest = np.array([it.vehicle.max_deceleration for it in world.each])
        if world.cases[0].road.bent and self._moved.any():
            self._commands[self._moved, :, -1] = self._steering(world)[self._moved]

    def _steering(self, world: World) -> FloatArray:
        """Steering wheel angles by which the vehicle turns as it did in each step, rad."""
        heading, speed = self._commands[..., 2], self._commands[..., 3]
        turned = np.diff(heading, axis=1, prepend=heading[:, :1])
        distance = np.maximum(speed * world.settings.step, _STANDS)
        vehicle = world.settings.vehicle
        return np.arctan(vehicle.wheelbase * turned / distance) * vehicle.steering_ratio

    def step(self, world: World, time: float) -> None:
        """Write the recorded command of this step, or full braking."""
        rows, egos = world.rows, world.egos
        brakes = world.steps >= self._until[rows]
        replays, numbers, command = ~brakes, numbers_of(egos), egos["command"]
        # of the egos that do not brake yet, (k, 6)
        now = self._commands[rows, min(world.steps, self._commands.shape[1] - 1)][replays]
        numbers[replays, NEXT], numbers[replays, COMMAND] = now, now[:, -2:]
        egos["placed"] = np.where(self._moved[rows] & replays, PLANT, MODEL)
        command["acceleration"][brakes] = -self._strongest[rows][brakes]
        if not world.cases[0].road.bent:
            command["steering"][brakes] = 0.0
        # a braking ego is settled: its case ends once it stands
        world.egos["settled"] = brakes


class Policies(EgoControl):
    """Common part of plain Python policies, one in each row or one for all."""

    checks = False  # whether `_check` reports a refused call, so `_fail` does not

    def begin(self, world: World, stage: Stage) -> None:
        """Prepare perception, and the executors that carry out plans and speeds."""
        super().begin(world, stage)
        self._road, self._alone = world.cases[0].road, len(world.cases) == 1
        self._tasks = [task_of(concrete) for concrete in world.cases]
        self._kinds = [[actor.body for actor in concrete.actors] for concrete in world.cases]
        conditions = [settings.conditions for settings in world.each]
        self._limited = np.array([not sees_all(it) for it in conditions])
        self._perception = (
            Perception(conditions, list(map(stream_of, self._seeds, world.cases)))
            if self._limited.any()
            else None
        )
        self._executors = [
            Executor(settings, partial(world.note, case), world.cases[case].road.line)
            for case, settings in enumerate(world.each)
        ]
        self.keep(world, world.rows)

    def keep(self, world: World, rows: IntArray) -> None:
        """Drop all rows but these; keep their order."""
        self._limited = self._limited[rows]
        if self._perception is not None:
            self._perception.keep(rows)
        # the first 8 numbers of a record: the 7 of a `BODY`, then acceleration of an ego, rate of
        # the speed of an actor
        self._ego_values = numbers_of(world.egos)[:, :8]
        self._commands = numbers_of(world.egos)[:, COMMAND]
        self._other_values = numbers_of(world.others)[:, :, :8]
        self._present = world.others["present"]

    def _fail(
        self, world: World, rows: Sequence[int], error: BaseException, when: str, target: Any
    ) -> None:
        """Fail the rows for which a call raised an error.

        In a batch, a policy that called TraCI or ran out of memory is not failed: its cases are
        driven alone, later.

        when: `in reset` or `at 1.50 s`, for the message.
        target: the user's code, for the place of the error.
        """
        out_of_memory = isinstance(error, MemoryError)
        asks_sumo = GUARD.refusal is not None or isinstance(error, self._traci.TraCIException)
        if (out_of_memory or asks_sumo) and not self._alone:
            GUARD.refusal = None
            reason = Alone("together_failed", said(error)) if out_of_memory else ASKS_SUMO
            for row in rows:
                world.leave(row, reason)
            return
        if len(rows) > 1:
            when = f"{when}, in one call for {len(rows)} cases, which fails them all"
        fault: EndReason = "ads_error"
        sentence = f"The ADS raised {when}: {said(error)}."
        if isinstance(error, ControllerError):
            fault, words = _fault(error), words_of(error, SENTENCE)
            # a message may end with the time already
            sentence = words if words.endswith(f" {when}.") else str(with_time(error, when))
        for row in rows:
            world.keep_fault(world.case_of(row), error, target, self._terms.folder)
            if not (self.checks and isinstance(error, RefusedCallError)):
                world.fail(row, fault, sentence)

    def _error_of(self, call: Callable[..., Any], *arguments: Any) -> BaseException | None:
        """The error of a call of the user's code, or a refusal that it caught and `_check` does not
        report; None without one.
        """
        error, refusal = error_of(call, *arguments), GUARD.refusal
        if error is None and refusal is not None and not (self._alone and self.checks):
            return RefusedCallError("; ".join(refusal))  # the ADS caught it
        return error

    def _look(self, time: float) -> tuple[list[Any], list[Any], list[Any]]:
        """The ego as it is, the ego as the ADS sees it, and the actors as it sees them, of each
        row.
        """
        egos, others = self._ego_values.tolist(), present(self._other_values, self._present)
        if self._perception is None:
            return egos, egos, others.tolist()
        seen_egos, seen = self._perception.look(time, self._ego_values[:, :7], others[..., :7])
        others = np.where(self._limited[:, None, None], seen, others)
        return egos, seen_egos.tolist(), others.tolist()


class OneEach(Policies):
    """Controls egos by a policy in plain Python for each row, with its own errors, times and state.

    A policy is called every n-th step (`Terms.every`); its answer holds in between.
    """

    checks = True

    def begin(self, world: World, stage: Stage) -> None:
        """Reset each of them."""
        super().begin(world, stage)
        for case, policy in enumerate(self._ads):
            if case in world.errors:
                continue
            briefing = make_briefing(world.cases[case], world.each[case], self._terms)
            error = self._error_of(policy.reset, briefing, TRACI, EGO)
            if error is not None:
                self._fail(world, [case], error, "in reset", policy.target)
        self._check(world, 0.0)
        # whether a number as answer can be used at once: it need not be held for a later step
        self._brief = self._terms.every == 1 and self.actuation.budget == inf
        self._settled = [
            getattr(policy.target, "settled", None) if world.settings.end_when_decided else None
            for policy in self._ads
        ]

    def _check(self, world: World, time: float) -> None:
        """Check the clock where the policy has the simulation to itself."""
        error = error_of(self._check_clock, world, time) if self._alone else None
        if error is not None:
            world.fail(0, "ads_error", str(error))

    def step(self, world: World, time: float) -> None:
        """Call the policy of each row."""
        egos, seen_egos, others = self._look(time)
        commands, commanded_rows = [], []
        wall_time, terms = clock.perf_counter, self._terms
        if self._alone:
            GUARD.call_listeners()  # before its policy
        # a single row is live, and need not be looked for
        for row in world.live.tolist() if len(egos) > 1 else (0,):
            case = int(world.rows[row])
            policy, executor = self._ads[case], self._executors[case]
            started = wall_time()
            try:
                if world.steps % terms.every:  # between two calls
                    command = executor.command(None, egos[row], time)
                    commands.append((command.acceleration, command.steering))
                    commanded_rows.append(row)
                    continue
                look = seen_egos[row], others[row]
                action = policy.act(
                    Observation(
                        time, self._road, egos[row], look, self._tasks[case], self._kinds[case]
                    )
                )
                # nearly every answer of nearly every policy: an acceleration, m/s2
                if self._brief and type(action) is float and -inf < action < inf:
                    executor.release()
                    answer = action, 0.0
                else:
                    # None: the plan that is in force still holds
                    wanted = None if action is None and executor.holds_plan else as_command(action)
                    late = self.actuation.late(wall_time() - started)
                    command = executor.command(wanted, egos[row], time, late=late)
                    answer = command.acceleration, command.steering
                took = wall_time() - started
                if GUARD.refusal is not None and not self._alone:  # the ADS caught it
                    raise RefusedCallError
                if took > terms.step_timeout:
                    raise ControllerTimeoutError(
                        f"The ADS must answer within {terms.step_timeout:g} s, took longer"
                    )
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # noqa: BLE001 - passed to `_fail`
                world.latencies.own[case].append(wall_time() - started)
                self._fail(world, [row], error, f"at {time:.2f} s", policy.target)
                continue
            world.latencies.own[case].append(took)
            commands.append(answer)
            commanded_rows.append(row)
            if (settled := self._settled[case]) is not None:
                world.egos["settled"][row] = bool(settled())
        if commands:
            self._commands[commanded_rows] = commands
        self._check(world, time)
        self._pass_on(world)

    def release(self, world: World, row: int) -> None:
        """Close the row's policy."""
        policy = self._ads[world.case_of(row)]
        if self._alone:
            self._close_guarded(world, row, policy.close, policy.target)
        else:
            self._closed(world, row, policy.close, "ads_error", policy.target)
            GUARD.refusal = None
        super().release(world, row)


def with_time(error: ControllerError, when: str) -> ControllerError:
    """An error of an adapter, or of a step that took too long, with the time in its message.

    error: its class may be the user's own; it becomes one of the package's.
    """
    kind = ControllerTimeoutError if isinstance(error, ControllerTimeoutError) else ControllerError
    return kind(f"{words_of(error, _LONGEST_WORDS)} {when}.")


def _fault(error: ControllerError | SimulationError) -> EndReason:
    if isinstance(error, SimulationError):
        return "sim_error"
    return "ads_timeout" if isinstance(error, ControllerTimeoutError) else "ads_error"


class OverArrays(Policies):
    """Controls egos by one policy for all rows, which maps arrays of observations to arrays of
    commands.

    Its commands may depend on the batch (those of a neural network do, in the last bit): the batch
    is part of its input.
    """

    def begin(self, world: World, stage: Stage) -> None:
        """Reset the policy once for all rows."""
        super().begin(world, stage)
        note_unlimited(world)  # arrays show the world as it is
        self._policy = self._ads[0]
        self._unreleased = len(world.cases)
        briefing = make_briefing(world.cases[0], world.each[0], self._terms)
        self._call(
            world, "in reset", self._policy.reset, replace(briefing, values=None), TRACI, EGO
        )
        decided = world.settings.end_when_decided
        self._settled = getattr(self._policy.target, "settled", None) if decided else None

    def step(self, world: World, time: float) -> None:
        """Call the policy once for all rows."""
        live = world.live
        seen = Observations(
            time, world.cases[0].road, world.rows[live], world.egos[live], world.seen[live],
            world.others[live], world.cases,
        )  # fmt: skip
        started = clock.perf_counter()
        if not self._call(world, f"at {time:.2f} s", self._command, world, live, seen):
            return
        took = (clock.perf_counter() - started) / len(live)
        world.latencies.shared.append(took)
        self._pass_on(world, took)

    def _command(self, world: World, live: IntArray, seen: Observations) -> None:
        """Write the policy's commands for the rows that are live."""
        rows = len(live)
        answer = self._answer(seen, rows)
        if self._settled is not None:
            settled = np.asarray(self._settled(), dtype=bool)
            if settled.shape != (rows,):
                raise ControllerError(
                    f"`settled()` of the ADS must give the shape ({rows},), got {settled.shape}"
                )
            world.egos["settled"][live] = settled
        self._commands[live] = 0.0
        answer = answer.reshape(rows, -1)
        self._commands[live, : answer.shape[1]] = answer

    def _answer(self, seen: Observations, rows: int) -> FloatArray:
        started = clock.perf_counter()
        try:
            answer = np.asarray(self._policy.act(seen), float)
            overdue = clock.perf_counter() - started > self._terms.step_timeout * rows
        except ControllerTimeoutError:  # raised by the watch over the process
            overdue = True
        if overdue:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self._terms.step_timeout:g} s a case, took longer"
            )
        if answer.shape not in ((rows,), (rows, 1), (rows, 2)):
            raise ControllerError(
                f"The actions of the ADS must have the shape ({rows},) or ({rows}, 2), got "
                f"{answer.shape}"
            )
        return answer

    def _call(self, world: World, when: str, call: Callable[..., Any], *arguments: Any) -> bool:
        """Call the policy; an error fails all rows. Return whether there was none."""
        error = self._error_of(call, *arguments)
        if error is not None:
            self._fail(world, world.live.tolist(), error, when, self._policy.target)
        return error is None

    def release(self, world: World, row: int) -> None:
        """Close the policy when the last row has ended."""
        self._unreleased -= 1
        if self._unreleased == 0:
            self._closed(world, row, self._policy.close, "ads_error", self._policy.target)
        super().release(world, row)
