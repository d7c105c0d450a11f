"""ADSs that drive through TraCI: hooks (TraCI code), step listeners, programs, SUMO's own models.

In any step such an ADS may return a command, or let SUMO move the ego. `cosim/ego_motion.py` checks
that the ego then moves as a vehicle can. `cosim/doors/traci_module.py` guards the ADS's calls
through TraCI.

Users: `cosim/simulation.py`, which also decides which of these ADSs share a simulation.
"""

from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter
from types import FunctionType
from typing import Any

import numpy as np

from sumo_eval.cosim.actuation import Actuation
from sumo_eval.cosim.doors.controller import Adapter, NativeModel, ObjectController
from sumo_eval.cosim.doors.traci_module import GUARD, TRACI, RefusedCallError, SumoNames
from sumo_eval.cosim.ego_control import (
    EgoControl,
    Terms,
    advance_plant,
    error_of,
    note_unlimited,
    settled_of,
)
from sumo_eval.cosim.ego_motion import HEADING, PLACED, STALE, EgoMotion
from sumo_eval.cosim.impossible import LeftTheRoadError
from sumo_eval.cosim.plans import Executor, checked_answer
from sumo_eval.cosim.policies import make_briefing, with_time
from sumo_eval.cosim.records import COMMAND, MODEL, SUMO, first_number
from sumo_eval.cosim.stage import EGO_SPEED_MODE, EXACT_SPEED_MODE, LEFT_BATCH, Stage
from sumo_eval.cosim.sumo.sections import sections
from sumo_eval.cosim.sumo.shared_files import suffix
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.cosim.world import World, corner
from sumo_eval.errors import ControllerError, ControllerTimeoutError, said
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.trajectory import IntArray

_SETTLED = first_number("settled")


class OnTraci(EgoControl):
    """Controls egos by the ADSs of all rows; a single one has the simulation to itself.

    In a batch all ADSs are hooks. A row leaves its batch, and is driven alone, after any error or
    any call that concerns more than its own ego.
    """

    def __init__(self, ads: Sequence[Adapter], seeds: Sequence[int], terms: Terms) -> None:
        super().__init__(ads, seeds, terms)
        self._rows = [_Hook(it, terms) for it in ads]
        self.unguarded = ads[0].took is not None  # a program: times itself, bypasses `GUARD`

    def begin(self, world: World, stage: Stage) -> None:
        """Reset the ADSs."""
        super().begin(world, stage)
        self._alone = not GUARD.shared
        # If true, `_leave_to_sumo` runs in every step. An ADS that is alone may change the ego's
        # speed mode at any time; in a batch `GUARD` sees every call. SUMO's own model makes no
        # calls, but with a plant each step has to note that the plant is not used.
        in_every_step = not isinstance(self._ads[0], NativeModel) or self._terms.plant is not None
        GUARD.mode_may_differ = self._alone and in_every_step
        GUARD.positions, GUARD.speeds = stage.fronts, stage.speeds
        self._stage = stage
        world.egos["next"]["speed"] = world.egos["speed"]
        note_unlimited(world)  # TraCI shows everything, whatever the conditions limit
        if not self._alone:
            # SUMO shows another start than theirs: driven alone, they report it themselves
            for case in world.errors:
                world.leave(case, LEFT_BATCH)
        for case, hook in enumerate(self._rows):
            hook.take(world, stage, case, self.actuation)
        self.keep(world, world.rows)
        self._each(world, _Hook.reset, 0.0)

    def keep(self, world: World, rows: IntArray) -> None:
        """Drop all rows but these; keep their order."""
        self._rows = [self._rows[row] for row in rows.tolist()]
        for row, hook in enumerate(self._rows):
            hook.motion.watch(world, row)

    def _each(
        self, world: World, do: Callable[[Any, float], None], time: float, rows: Any = None
    ) -> None:
        """Call `do` with the hook of each row; in a batch, a row for which the call fails leaves.

        rows: None: those that have not ended.
        """
        if self._alone:
            hook = self._rows[0]
            try:
                do(hook, time)
            except ControllerError as error:
                cause = error.__cause__ or error.__context__ or error
                world.keep_fault(0, cause, hook.ads.target, self._terms.folder)
                raise
            return
        if rows is None:
            continues = (world.egos["live"] != 0) & (world.egos["reason"] == 0)
            rows = np.flatnonzero(continues).tolist()
        for row in rows:
            hook = self._rows[row]
            GUARD.names = hook.names
            try:
                do(hook, time)
                leaves = GUARD.refusal is not None
            except KeyboardInterrupt:
                raise
            except BaseException:  # noqa: BLE001 - driven alone, the case reports it
                leaves = True
            if leaves:
                GUARD.refusal = None
                world.leave(row, LEFT_BATCH)

    def step(self, world: World, time: float) -> None:
        """One step of each ADS."""
        self._each(world, _Hook.step, time)
        if not self._alone:
            self._check_clock(time)

    def after(self, world: World, now: float) -> None:
        """Read the egos that SUMO moved."""
        # rows whose egos did more than drive straight ahead; most often none
        rows = self._stage.read_at_once(world)
        if rows:
            self._each(world, lambda hook, now: hook.motion.read(now), now, rows)

    def release(self, world: World, row: int) -> None:
        """Close the ADS and remove its listeners."""
        hook = self._rows[row]
        if self._alone:
            self._close_guarded(world, row, hook.ads.close, hook.ads.target)
        else:
            self._each(world, lambda hook, _: hook.ads.close(), 0.0, [row])
        super().release(world, row)


class _Hook:
    """The ADS of one case, and what becomes of its answers.

    motion: of its ego.
    """

    def __init__(self, ads: Adapter, terms: Terms) -> None:
        self.ads, self._terms = ads, terms

    def take(self, world: World, stage: Stage, case: int, actuation: Actuation) -> None:
        """Make ready for a case of the world.

        actuation: carries the commands of all cases to their vehicles.
        """
        ads, settings = self.ads, world.each[case]
        self._world, self._case = world, case
        self._calls, self._traci = stage.calls, stage.traci
        self._check_clock, self._actuation = stage.check_clock, actuation
        self._native = isinstance(ads, NativeModel)
        self.motion = EgoMotion(world, stage, case, native=self._native)
        self.ego = self.motion.ego
        self.names = _names(world.cases[case], suffix(case, len(world.cases)))
        # call a function itself: the adapter's `step` around it takes time
        plain = type(ads) is ObjectController and type(ads.target) is FunctionType
        self._act = ads.target if plain else ads.step
        self._latencies = world.latencies.own[case]
        self._settled = settled_of(ads, settings)
        self.road = self.motion.road
        self._executor = Executor(settings, partial(world.note, case), self.road.line)
        self._delay = settings.conditions.actuation_delay

    def reset(self, time: float) -> None:
        """Reset the ADS."""
        concrete = self._world.cases[self._case]
        settings = self._world.each[self._case]
        self._calls.setSpeedMode(self.ego, EGO_SPEED_MODE)
        if self._native:
            self._calls.setSpeed(self.ego, -1)
        briefing = make_briefing(concrete, settings, self._terms)
        if (error := error_of(self.ads.reset, briefing, TRACI, EGO)) is not None:
            self._blamed(error, "in reset", time)
        self._check_clock(time)

    def _blamed(self, error: BaseException, when: str, time: float) -> None:
        """Raise an exception of the user's code as a ControllerError.

        when: as of `policies.with_time`. time: s.
        """
        # an adapter, or the watch over the step, has given it a message
        if isinstance(error, ControllerError) and not isinstance(error, RefusedCallError):
            raise with_time(error, when) from error
        self._check_clock(time)  # raises the message of a refused call
        raise ControllerError(f"The ADS raised {when}: {said(error)}.") from error

    def step(self, time: float) -> None:
        """One step of the ADS.

        Raises ControllerError for an exception of its code, an unusable answer and a slow one.
        """
        try:
            command, took = (
                self._ask(time) if self._world.steps % self._terms.every == 0 else self._held(time)
            )
            if self._delay:
                command = self._arriving(command, took)
            if command is not None:
                self._take_over(command)
            # false in most steps: SUMO moves the ego already, and nothing has to be checked
            elif self.motion.flags[PLACED] != SUMO or GUARD.mode_may_differ or self.road.spans:
                self._leave_to_sumo()
        except self._traci.TraCIException as error:
            raise ControllerError(
                f"After the ADS's step at {time:.2f} s SUMO cannot move the ego: {said(error)}."
            ) from error
        if self._settled is not None:
            fault = error_of(self._read_settled, self._settled)
            if fault is not None:
                self._blamed(fault, f"at {time:.2f} s", time)

    def _read_settled(self, settled: Callable[[], Any]) -> None:
        """Note whether the ADS says that it will do nothing new."""
        self.motion.flags[_SETTLED] = bool(settled())

    def _held(self, time: float) -> tuple[Command | None, None]:
        """The command between two calls, after the ADS's listeners, without a wall time; None: SUMO
        moves the ego.
        """
        error = None if GUARD.shared else error_of(GUARD.call_listeners)
        if error is not None:
            self._blamed(error, f"at {time:.2f} s", time)
        return (self._obeyed(None, time) if self._executor.holds else None), None

    def _arriving(self, command: Command | None, took: float | None) -> Command | None:
        """The delayed command that reaches the vehicle now; None: SUMO moves the ego.

        Calls by which the ADS lets SUMO move the ego are not delayed: a note records that.

        took: wall time of the ADS's step, s; None: the ADS was not called.
        """
        due = self.motion.mine["command"]
        has_new = command is not None
        if command is not None:
            due[0] = command.acceleration, command.steering
        elif took is not None:
            self._world.note(self._case, "actuation_not_delayed", self._delay, 0.0)
        # also without a new command, as the queue of delayed commands advances in every step; SUMO
        # then moves the ego, and `due` has no effect
        self._actuation.pass_on(due, [self._case], self._world.steps, has_new=has_new)
        return Command(*due[0].tolist()) if has_new else None

    def _ask(self, time: float) -> tuple[Command | None, float]:
        """The answer of the ADS as a command, after its listeners, and its wall time, s."""
        if self._native:  # there is no code to call
            return None, 0.0
        answer = None
        started = perf_counter()
        GUARD.moved = GUARD.placed = False
        try:
            if GUARD.listeners._stepListeners:  # never where ADSs share SUMO
                GUARD.call_listeners()
            answer = self._act(TRACI, EGO, time)
        # Ctrl-C. In a child process, one that the ADS raised is a RuntimeError by now: the watch
        # over the step (`record/watch.py`) has turned it into one.
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - `_blamed` raises it, put in words
            self._blamed(error, f"at {time:.2f} s", time)
        finally:
            took = perf_counter() - started + (self.ads.took or 0.0)
            self._latencies.append(took)
        if took > self._terms.step_timeout:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self._terms.step_timeout:g} s, took longer at "
                f"{time:.2f} s."
            )
        if not GUARD.shared:
            self._check_clock(time)
        late = self._actuation.late(took)
        # after the first step, SUMO continues to move an ego whose command is late
        if answer is None or (late and self._world.steps and self.motion.flags[PLACED] == SUMO):
            self._executor.release()
            return None, took
        command = self._obeyed(answer, time, late=late)
        if GUARD.moved:
            self._world.note(self._case, "dropped_traci_call", 1.0, 0.0)
        return command, took

    def _obeyed(self, answer: object, time: float, *, late: bool = False) -> Command:
        """The command by which the executor carries out an answer of the ADS.

        answer: None: the last one holds.
        """
        try:
            request = None if answer is None else checked_answer(answer)
            # from here on the vehicle model or the plant moves the ego
            if self.motion.flags[PLACED] == SUMO:
                self._calls.setSpeedMode(self.ego, EXACT_SPEED_MODE)
                self.motion.flags[PLACED] = MODEL
                if self.motion.state[HEADING] != 0.0:
                    GUARD.finish_change(self.ego)  # SUMO may be within one
                # turns the ego and its wheels as if the vehicle model had driven the curve so far
                corner(self.motion.mine, self.motion.curvature, self.motion.limits)
                if self._world.steps == 0:
                    self._world.begin_as_model(self._case)
            return self._executor.command(request, self.motion.state, time, late=late)
        except ControllerError as error:
            raise with_time(error, f"at {time:.2f} s") from error

    def _leave_to_sumo(self) -> None:
        """Let SUMO move the ego, within its limits, from this step on."""
        world = self._world
        if self._terms.plant is not None:
            world.note(self._case, "vehicle_model_not_used", 1.0, 0.0)
        if self.motion.flags[PLACED] != SUMO:
            # SUMO would lose an ego that is on none of its lanes; a call may put it on one
            if self._calls.getLaneIndex(self.ego) < 0 and not GUARD.placed:
                raise LeftTheRoadError
            self._calls.setSpeedMode(self.ego, EGO_SPEED_MODE)
            GUARD.change_as_usual(self.ego)
            self.motion.flags[PLACED] = SUMO
            self.motion.flags[STALE] = 1  # SUMO begins to move it in this step
        elif not self._native and GUARD.mode_may_differ:
            mode = self._calls.getSpeedMode(self.ego)
            if mode != EGO_SPEED_MODE:
                world.note(self._case, "speed_mode", mode, EGO_SPEED_MODE)
                self._calls.setSpeedMode(self.ego, EGO_SPEED_MODE)
        if self.road.spans:  # lanes begin or end
            self.motion.lead_along_lane()

    def _take_over(self, command: Command) -> None:
        """Let the vehicle model or the plant move the ego, as commanded."""
        state = self.motion.state
        self.motion.flags[STALE] = 1  # so that SUMO receives its motion in every step
        if self._terms.plant is None:
            at = COMMAND.start
            state[at], state[at + 1] = command.acceleration, command.steering
        else:
            advance_plant(self._terms.plant, self._world, command)


def _names(concrete: ConcreteScenario, suffix: str) -> SumoNames:
    """Names that a hook can give SUMO in a case: of vehicles, edges, lanes and routes."""
    vehicles = [EGO, *(actor.name for actor in concrete.actors)]
    lanes = {it.edge: len(it.lanes) for it in sections(concrete.road)}
    lanes |= {it.ramp_edge: 1 for it in sections(concrete.road) if it.ramp_edge}
    names = [*vehicles, *lanes, "along", *(f"along_{it}" for it in vehicles)]
    names += [f"{edge}_{number}" for edge, count in lanes.items() for number in range(count)]
    return SumoNames(names, suffix)
