"""Controls of egos, one object for all rows of a simulation: their base class, and the controls
without a user's code, `Rules` (kernels) and `Replays` (recorded commands).

`cosim/loop.py` calls `begin` once, `step` and `after` at each step, `keep` when rows are dropped,
and `release` for each row that has ended.

Users: `cosim/loop.py`, `cosim/no_return.py`, `cosim/on_traci.py`, `cosim/policies.py`,
`cosim/simulation.py`, `record/worker.py`.
"""

import time as clock
from collections.abc import Callable, Sequence
from functools import partial
from math import hypot, inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cosim.actuation import Actuation
from sumo_eval.cosim.doors.controller import knows_the_scripts
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.doors.observation import sees_all
from sumo_eval.cosim.doors.traci_module import GUARD, heeding_parts
from sumo_eval.cosim.impossible import FASTEST, LOWEST_SPEED
from sumo_eval.cosim.records import COMMAND, CONTACT, MODEL, NEXT, PLANT, numbers_of
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.cosim.vehicle_model import Command, EgoState
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError, ControllerTimeoutError, SimulationError, said
from sumo_eval.kernels import bound
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import EndReason, FloatArray, IntArray

_STANDS = 1e-3  # m in a step, least distance to divide by: a standing ego does not turn


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

    ads: what drives each case; of policies over arrays, the first drives all cases.
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
        self._traci, self._check_clock = stage.traci, stage.check_clock
        concrete = world.cases[0]
        settings = world.settings
        others = [actor.name for actor in concrete.actors]
        lateral_speed = concrete.road.lane_width / settings.lane_change_duration
        interference = settings.conditions.interference
        GUARD.begin(others, settings.step, interference, heeding_parts(concrete), lateral_speed)
        stage.take_charge(world)
        conditions = [settings.conditions for settings in world.each]
        # 0: only a step budget makes notes, and a case with a step budget is alone
        self.actuation = Actuation(conditions, settings.step, partial(world.note, 0))

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
            self._close(world, row, self._terms.plant.close, "sim_error")

    def _pass_on(self, world: World, took: float = 0.0) -> None:
        """Replace the commands of the ADS by the commands that reach the vehicles in this step;
        with a plant, also ask the plant for its next state.

        took: wall time of the ADS's step for one case, s; if it is over the budget, the last
            commands hold.
        """
        self.actuation.pass_on(
            world.egos["command"], world.rows, world.steps, has_new=not self.actuation.late(took)
        )
        if self._terms.plant is not None:
            advance_plant(self._terms.plant, world, Command(*world.egos["command"][0].tolist()))

    def _close(
        self,
        world: World,
        row: int,
        close: Callable[[], None],
        fault: EndReason,
        target: Any = None,
    ) -> None:
        """Close an ADS or a plant of a case; record its error, without raising it.

        close: the call that closes it.
        fault: why the case ends after an error, unless it has ended with a contact.
        target: the user's code, for the place of the error.
        """
        error = error_of(close)
        if error is None:
            return
        world.keep_fault(world.case_of(row), error, target, self._terms.folder)
        subject = "The ADS" if fault == "ads_error" else "The vehicle model"
        if world.egos["reason"][row] == CONTACT:  # the contact stays the reason
            fault = "contact"
        world.fail(row, fault, f"{subject} raised in close: {said(error)}.")

    def _close_guarded(
        self, world: World, row: int, close: Callable[[], None], target: Any
    ) -> None:
        """Close an ADS that may have used TraCI, and remove its listeners."""
        self._close(world, row, close, "ads_error", target)
        self._close(world, row, GUARD.end, "ads_error")
        # calls that changed more than the ego, and calls that SUMO ignored
        world.touched(GUARD.touched, GUARD.ignored)


def note_unlimited(world: World) -> None:
    """Note in each case with limited perception that its ADS sees everything nevertheless."""
    for case, settings in enumerate(world.each):
        if not sees_all(settings.conditions):
            world.note(case, "perception_not_limited", 1.0, 0.0)


def settled_of(ads: Any, settings: SimulationSettings) -> Any:
    """The method `settled` of an ADS, by which it says that it will do nothing new, so that its
    case may end; None: the ADS has no such method, or the settings end no case early.
    """
    return getattr(ads.target, "settled", None) if settings.end_when_decided else None


def advance_plant(plant: FmuPlant, world: World, command: Command) -> None:
    """Ask the user's vehicle model for the single ego's state at the end of the coming step."""
    if not (isfinite(command.acceleration) and isfinite(command.steering)):
        world.egos["placed"][0] = MODEL  # so that `step_rules.move_rows` refuses the ADS's command
        return
    ego = world.egos[0]
    before = EgoState(*ego["map"].tolist(), *ego[["speed", "acceleration", "steering"]].tolist())
    step = world.settings.step
    state = plant.advance(before, command, step)
    moved = hypot(state.x - before.x, state.y - before.y)
    if not (moved < FASTEST * step and LOWEST_SPEED < state.speed < FASTEST):
        # a model without limits does what the ADS requests, however impossible
        is_possible = abs(command.acceleration) * step < FASTEST
        raise (SimulationError if is_possible else ControllerError)(
            f"At the command {command.acceleration:g} m/s2 the vehicle model moved `{EGO}` "
            f"{moved:g} m in the step after {world.time:.2f} s, to the speed {state.speed:g} m/s; "
            f"no vehicle drives at other speeds than {LOWEST_SPEED:g}..{FASTEST:g} m/s."
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
        if knows_the_scripts(self._ads[0]):  # the ideal vehicle of Eq. 17 foresees all actors
            self._arrays = kind.foreseeing(self._ads, world.cases, world.each)
        else:
            self._arrays = kind.arrays(self._ads, world.scenario, world.seen.shape[1])
        self._bind(world)  # the kernel is compiled or loaded here, not within a timed step

    def _bind(self, world: World) -> None:
        """Find the machine code for the arrays as they are; again after `World.keep`."""
        self._egos = world.egos
        self._code = bound(self._loop, world.egos, world.seen, *self._arrays, world.scenario, 0.0)

    def step(self, world: World, time: float) -> None:
        """Call the kernel once for all rows."""
        started = clock.perf_counter()
        if self._egos is not world.egos:  # machine code is for arrays of one layout
            self._bind(world)
        self._code(world.egos, world.seen, *self._arrays, world.scenario, time)
        took = (clock.perf_counter() - started) / world.going
        world.latencies.shared.append(took)
        self._pass_on(world, took)

    def keep(self, world: World, rows: IntArray) -> None:
        """Keep the memory of these rows."""
        # `it` is an array, or a named tuple of arrays
        self._arrays = tuple(
            type(it)(*(array[rows] for array in it)) if isinstance(it, tuple) else it[rows]
            for it in self._arrays
        )


class Replay(NamedTuple):
    """Replay of a recorded drive up to a step, and full braking from there on.

    commands: those of a `Recording`: acceleration and steering, (steps, 2); or, where SUMO or a
        plant moved the ego, the heading at each step's start and the motion as in
        `records._NEXT`, (steps, 7).
    until: index of the first step of braking.
    """

    commands: FloatArray
    until: int


class Replays(EgoControl):
    """Controls egos by recorded commands, then by the strongest braking.

    While it brakes, the steering wheel is straight, or on a curved road at its last angle. Recorded
    commands are those that reached the vehicle, after all delays.
    """

    def begin(self, world: World, stage: Stage) -> None:
        """Find the strongest braking of each ego, and the steering of the egos that need it."""
        super().begin(world, stage)
        recorded = [it.commands for it in self._ads]
        # (n, steps, 7), as in `Replay`; of replays with two columns the first five stay 0.
        # One more step than the longest recording has: it stands for all later steps.
        self._commands = np.zeros((len(recorded), 1 + max(map(len, recorded)), 7))
        for row, commands in enumerate(recorded):
            self._commands[row, : len(commands), -commands.shape[1] :] = commands
        # whether SUMO or a plant moved the ego
        self._moved = np.array([it.shape[1] > 2 for it in recorded])
        self._until = np.array([it.until for it in self._ads])
        self._strongest = np.array([it.vehicle.max_deceleration for it in world.each])
        if world.cases[0].road.bent:
            self._commands[self._moved, :, -1] = self._steering(world)[self._moved]

    def _steering(self, world: World) -> FloatArray:
        """Steering wheel angles with which the vehicle turns as it did, rad, (n, steps)."""
        heading, speed = self._commands[..., 3], self._commands[..., 4]
        turned = np.diff(heading, axis=1, prepend=heading[:, :1])
        distance = np.maximum(speed * world.settings.step, _STANDS)
        vehicle = world.settings.vehicle
        return np.arctan(vehicle.wheelbase * turned / distance) * vehicle.steering_ratio

    def step(self, world: World, time: float) -> None:
        """Write the recorded command of this step, or full braking."""
        rows, egos = world.rows, world.egos
        brakes = world.steps >= self._until[rows]
        replays = ~brakes
        numbers = numbers_of(egos)
        command = egos["command"]
        # motion and command of the egos that do not brake yet, (k, 7)
        now = self._commands[rows, min(world.steps, self._commands.shape[1] - 1)][replays]
        moved = self._moved[rows] & replays
        egos["map"]["heading"][moved] = now[self._moved[rows][replays], 0]
        numbers[replays, NEXT] = now[:, 1:]
        numbers[replays, COMMAND] = now[:, -2:]
        egos["placed"] = np.where(moved, PLANT, MODEL)
        command["acceleration"][brakes] = -self._strongest[rows][brakes]
        if not world.cases[0].road.bent:
            command["steering"][brakes] = 0.0
        egos["settled"] = brakes  # the case of a braking ego ends once it stands


def fault_of(error: ControllerError | SimulationError) -> EndReason:
    """The reason why an error ends a case."""
    if isinstance(error, SimulationError):
        return "sim_error"
    return "ads_timeout" if isinstance(error, ControllerTimeoutError) else "ads_error"
