"""The loop: the only one in which anything drives, one case or hundreds beside each other.

A step: the driver commands, the vehicle model moves the egos and the scripts move the others, SUMO
steps everything, the world takes in what SUMO shows. Who drives is one of four: `Rows` (rules that
are kernels), `OneEach` (a policy in plain Python for each row), `Batch` (one policy over arrays),
`OnTraci` (whoever needs the simulation to itself).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.actuation import Actuation
from sumo_eval.cosim.compiled import Compiled
from sumo_eval.cosim.contact import Body
from sumo_eval.cosim.doors.controller import (
    Briefing,
    PolicyController,
    as_command,
    knows_the_scripts,
)
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.doors.observation import (
    Look,
    Observation,
    Observations,
    Senses,
    kinds_of,
    task_of,
)
from sumo_eval.cosim.doors.traci_module import GUARD, TRACI, RefusedCallError, heeding
from sumo_eval.cosim.impossible import BACKWARDS, FASTEST, LeftTheRoadError
from sumo_eval.cosim.latency import EVERY
from sumo_eval.cosim.plans import Wheel
from sumo_eval.cosim.records import PLANT, REASONS, Records
from sumo_eval.cosim.stage import Stage
from sumo_eval.cosim.step_rules import stop_rows
from sumo_eval.cosim.sumo.insides import simulation_time
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.cosim.vehicle_model import Command, EgoState
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError, ControllerTimeoutError, SimulationError, said
from sumo_eval.kernels import bound
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import ConditionSettings, SimulationSettings
from sumo_eval.text import SENTENCE, words_of
from sumo_eval.trajectory import Alone, EndReason

_LONGEST_WORDS = SENTENCE - 20  # characters of an adapter's sentence, to which the time is added
_CLOCK_TOLERANCE = 1e-4  # s; SUMO counts in milliseconds
ASKS_SUMO = Alone("asks_sumo")
KEPT = 0.75  # share of the rows that must still be live, or the others are given up
_body = Body._make
_look = tuple.__new__  # a NamedTuple's own constructor takes twice as long
SEEN_AS_IT_IS: dict[str, Any] = {
    "perception_delay": 0.0, "dropout": 0.0, "position_noise": 0.0, "speed_noise": 0.0,
    "sensor_range": None,
    "field_of_view_deg": None, "occlusion": False,
}  # fmt: skip


class Terms(NamedTuple):
    """Terms on which an ADS drives.

    step_timeout: longest wall time of a step, s.
    plant: the vehicle model instead of ours.
    folder: where relative paths start.
    every: the ADS is called every n-th step.
    """

    step_timeout: float = math.inf
    plant: FmuPlant | None = None
    folder: Path | None = None
    every: int = 1


class Driver:
    """Controls the egos of all rows."""

    def __init__(self, terms: Terms) -> None:
        self._step_timeout, self._plant, self._folder, self._every = terms

    def begin(self, world: World, stage: Stage) -> None:
        """Before the first step."""
        self._traci, self._clock = stage.traci, simulation_time(stage.traci)
        self._delayed = _Delayed(world, self._plant)

    def step(self, world: World, time: float) -> None:
        """Write the egos' commands, or fail rows."""
        raise NotImplementedError

    def after(self, world: World, now: float) -> None:
        """SUMO has made its step to `now`, s."""

    def keep(self, world: World, rows: NDArray[np.intp]) -> None:
        """From now on these rows, in this order."""

    def release(self, world: World, row: int) -> None:
        """A row has ended: close what it holds."""
        if self._plant is not None:
            self._closed(world, row, "The vehicle model", self._plant.close, "sim_error")

    def _closed(
        self,
        world: World,
        row: int,
        who: str,
        close: Callable[[], None],
        fault: EndReason,
        target: Any = None,
    ) -> None:
        """Close one of the things a case holds; what goes wrong there keeps none of the others from
        being closed.
        """
        try:
            close()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - kept: sentence, place and traceback
            world.keep_fault(int(world.rows[row]), error, target, self._folder)
            # nobody undoes a collision afterwards
            contact = REASONS[int(world.egos["reason"][row])] == "contact"
            world.fail(
                row, "contact" if contact else fault, f"{who} raised in close: {said(error)}."
            )

    def _close_guarded(
        self, world: World, row: int, close: Callable[[], None], target: Any
    ) -> None:
        """Close an ADS that may have used TraCI, and remove its listeners."""
        self._closed(world, row, "The ADS", close, "ads_error", target)
        self._closed(world, row, "The ADS", GUARD.end, "ads_error")
        world.touched(GUARD.touched, GUARD.ignored)

    def _check_clock(self, world: World, time: float) -> None:
        """The harness alone steps, starts and closes the simulation; who swallows the refusal of a
        call has made it.
        """
        if GUARD.refusal is not None:
            deed, why = GUARD.refusal
            raise ControllerError(f"{deed} at {time:.2f} s; {why}.")
        try:
            now = self._clock()
        except (self._traci.TraCIException, self._traci.FatalTraCIError) as error:
            raise ControllerError(
                f"The ADS closed the simulation at {time:.2f} s; that is the harness's."
            ) from error
        # SUMO has made one step more, the one that inserted the vehicles
        ahead = now - time - world.settings.step
        if abs(ahead) > _CLOCK_TOLERANCE:
            raise ControllerError(
                f"The ADS moved SUMO's clock by {ahead:+.2f} s at {time:.2f} s; stepping is the "
                "harness's."
            )


def sees_all(conditions: ConditionSettings) -> bool:
    """Whether the conditions let an ADS see the world as it is."""
    return all(getattr(conditions, what) == usual for what, usual in SEEN_AS_IT_IS.items())


def note_unlimited(world: World) -> None:
    """Put on record that an ADS sees the world as it is where the conditions ask for something
    else.
    """
    for case, its in enumerate(world.each):
        if not sees_all(its.conditions):
            world.note(case, "perception_not_limited", 1.0, 0.0)


def drive(world: World, driver: Driver, stage: Stage) -> None:
    """Step until every case has ended."""
    settings = world.settings
    step, every = settings.step, round(settings.record_interval / settings.step)
    as_read, asked = stage.as_read, stage.asked
    moved = 0
    try:
        driver.begin(world, stage)
        if world.errors or world.left:
            _end_rows(world, driver, stage)
        while world.going:
            after = world.steps + 1
            if world.steps % EVERY == 0:
                world.latencies.time_fixed_work()
            driver.step(world, world.steps * step)
            world.keep_commands()
            now, sampling = after * step, after % every == 0
            if sampling:
                world.room_for_samples()
            count, gone = world.move(closely=asked or stage.closely(world.steps), as_read=as_read)
            moved = 1
            stage.put_aside(gone)
            try:
                stage.tell(world, count)
            except stage.traci.TraCIException as error:
                if not asked:
                    raise
                raise ControllerError(  # who asks SUMO has just taken a vehicle away
                    f"After the ADS's step at {world.time:.2f} s SUMO cannot move the ego: "
                    f"{said(error)}."
                ) from error
            stage.step()
            driver.after(world, now)
            stage.read(world)
            if stage.compares(world.steps):
                stage.compare(world)
            moved = 0
            if world.waits:
                world.wake(now)
            if world.see(sampling=sampling, as_read=as_read):
                _end_rows(world, driver, stage)
    except LeftTheRoadError:
        world.egos["reason"][0] = REASONS.index("off_road")
        world.room_for_samples()
        stop_rows(world.egos, world.others, world.samples, 0, moved)
    except (ControllerError, SimulationError) as error:
        if len(world.cases) > 1:
            raise
        break_off(world, error, moved)
    except (stage.traci.TraCIException, stage.traci.FatalTraCIError) as error:
        if len(world.cases) > 1:
            raise
        break_off(
            world, SimulationError(f"SUMO stopped at {world.time:.2f} s: {said(error)}."), moved
        )
    finally:
        for row in np.flatnonzero(world.egos["live"]).tolist():
            _release(world, driver, row)
    for row in np.flatnonzero(world.egos["live"]).tolist():
        world.end(row)


def _release(world: World, driver: Driver, row: int) -> None:
    """Release the driver of a row, once, whatever comes of it."""
    case = int(world.rows[row])
    if case not in world.released:
        world.released.add(case)
        driver.release(world, row)


def break_off(world: World, error: ControllerError | SimulationError, moved: int = 0) -> None:
    """A single case cannot go on.

    moved: within a step, of which nothing counts.
    """
    world.fail(0, _fault(error), words_of(error, SENTENCE))
    world.room_for_samples()
    stop_rows(world.egos, world.others, world.samples, 0, moved)


def _end_rows(world: World, driver: Driver, stage: Stage) -> None:
    """Take down the rows that have ended, and give their arrays up once they are many."""
    for row in np.flatnonzero((world.egos["reason"] != 0) & (world.egos["live"] != 0)).tolist():
        case = int(world.rows[row])
        if REASONS[int(world.egos["reason"][row])] == "ads_error" and case not in world.errors:
            wanted, steering = world.egos["command"][row].tolist()
            name, value = (
                ("steering", steering) if np.isfinite(wanted) else ("acceleration", wanted)
            )
            time = float(world.egos["time"][row])
            world.fail(row, "ads_error", f"`{name}` of the ADS's Command must be a finite number, "
                                         f"got {value!r} "
                       f"at {time:.2f} s.")  # fmt: skip
        _release(world, driver, row)
        stage.remove(world, row)
        world.end(row)
    if not world.going:
        return
    rows = np.flatnonzero(world.egos["live"])
    if len(rows) < KEPT * len(world.rows):
        world.keep(rows)
        driver.keep(world, rows)
        stage.keep(world)
    else:
        stage.without(world)


def told(concrete: ConcreteScenario, settings: SimulationSettings, terms: Terms) -> Briefing:
    """What a controller is told before a case."""
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


class _Delayed:
    """The way that commands take under the conditions, and the plant in place of the vehicle model;
    all rows'.
    """

    def __init__(self, world: World, plant: FmuPlant | None) -> None:
        self._plant = plant
        self._of = {
            case: Actuation(its.conditions, partial(world.note, case))
            for case, its in enumerate(world.each)
            if its.conditions.actuation_delay or its.conditions.step_budget is not None
        }

    def pass_on(self, world: World, time: float, took: Callable[[int], float]) -> None:
        """Put the commands that reach the vehicles in place of those that were given.

        took: of a case, s.
        """
        for row in np.flatnonzero(world.egos["live"]).tolist() if self._of else ():
            case = int(world.rows[row])
            if case in self._of:
                arrived = self._of[case].pass_on(
                    Command(*world.egos["command"][row].tolist()), time, took(case)
                )
                assert arrived is not None
                world.egos["command"][row] = (arrived.acceleration, arrived.steering)
        if self._plant is not None:
            advance_plant(self._plant, world, Command(*world.egos["command"][0].tolist()))


def advance_plant(plant: FmuPlant, world: World, command: Command) -> None:
    """Ask the plant for the next state of the single ego, which the coming step then has."""
    ego = world.egos[0]
    place = (float(ego["map"][name]) for name in ("x", "y", "heading"))
    state = EgoState(*place, *(float(ego[name]) for name in ("speed", "acceleration", "steering")))
    before = state
    state, clips = plant.advance(state, command, world.settings.step)
    moved = math.hypot(state.x - before.x, state.y - before.y)
    if not (moved < FASTEST * world.settings.step and BACKWARDS < state.speed < FASTEST):
        raise SimulationError(
            f"The vehicle model moved `{EGO}` {moved:g} m in the step after {world.time:.2f} s, "
            "to the speed "
            f"{state.speed:g} m/s; no vehicle is faster than {FASTEST:g} m/s."
        )
    for what, requested, applied in clips:
        world.note(0, what, requested, applied)
    world.egos["next"][0] = tuple(state)
    world.egos["placed"][0] = PLANT


def arrays(ads: Sequence[Compiled], world: World) -> tuple[Records, ...]:
    """What the loop of these objects, all of one class, wants beside what is seen: a row for each
    case of the world.
    """
    own: Any = type(ads[0])
    if knows_the_scripts(ads[0]):
        return own.foreseeing(ads, world.cases, world.each)  # type: ignore[no-any-return]
    return own.arrays(ads, world.scenario, world.seen.shape[1])  # type: ignore[no-any-return]


class Rows(Driver):
    """Rules that are kernels, one object a case, all of one class."""

    def __init__(self, ads: Sequence[Compiled], terms: Terms) -> None:
        super().__init__(terms)
        self._ads, self._loop = ads, type(ads[0]).loop

    def begin(self, world: World, stage: Stage) -> None:
        """Make the memory of every row."""
        super().begin(world, stage)
        stage.take_charge(world)
        note_unlimited(world)  # a rule sees the world
        self._arrays = arrays(self._ads, world)
        # Over no rows: compiled or loaded here, and not within the time of a step.
        self._loop(world.egos[:0], world.seen[:0], *self._arrays, world.scenario, 0.0)
        self._egos: Records | None = None
        self._code = self._loop

    def step(self, world: World, time: float) -> None:
        """One call for all."""
        asked = clock.perf_counter()
        arguments = (world.egos, world.seen, *self._arrays, world.scenario, time)
        if self._egos is not world.egos:
            self._code, self._egos = bound(self._loop, *arguments), world.egos
        self._code(*arguments)
        took = (clock.perf_counter() - asked) / world.going
        world.latencies.shared.append(took)
        self._delayed.pass_on(world, time, lambda case: took)

    def keep(self, world: World, rows: NDArray[np.intp]) -> None:
        """Keep the memory of these rows."""
        self._arrays = tuple(_rows_of(array, rows) for array in self._arrays)


def _rows_of(array: Any, rows: NDArray[np.intp]) -> Any:
    """Rows of an array, or of every array of a named tuple."""
    if isinstance(array, tuple):
        return type(array)(*(one[rows] for one in array))
    return array[rows]


class Replay(NamedTuple):
    """Commands of a drive, (steps, 2), given up to step `until`; from there on full braking."""

    commands: NDArray[np.float64]
    until: int


class Replays(Driver):
    """Recorded commands, then the strongest braking with the wheel straight, in a curve as it was.

    Nothing is asked again: delays are in the commands already.
    """

    def __init__(self, replays: Sequence[Replay], terms: Terms) -> None:
        super().__init__(terms)
        longest = max(len(it.commands) for it in replays)
        self._commands = np.zeros((len(replays), longest + 1, 2))
        for row, it in enumerate(replays):
            self._commands[row, : len(it.commands)] = it.commands
        self._until = np.array([it.until for it in replays])

    def begin(self, world: World, stage: Stage) -> None:
        """The strongest braking of each ego."""
        super().begin(world, stage)
        stage.take_charge(world)
        self._strongest = np.array([its.vehicle.max_deceleration for its in world.each])

    def step(self, world: World, time: float) -> None:
        """The command of this step, or full braking."""
        rows, command = world.rows, world.egos["command"]
        now = self._commands[rows, min(world.steps, self._commands.shape[1] - 1)]
        brakes = world.steps >= self._until[rows]
        straight = 0.0 if not world.cases[0].road.bent else command["steering"]
        command["acceleration"] = np.where(brakes, -self._strongest[rows], now[:, 0])
        command["steering"] = np.where(brakes, straight, now[:, 1])
        # full braking is no reason to go on once the ego stands
        world.egos["settled"] = brakes


class Policies(Driver):
    """What plain Python policies share, one in each row or one for all."""

    checks = False  # whether a refused call is reported by the check that follows

    def __init__(self, seeds: Sequence[int], terms: Terms) -> None:
        super().__init__(terms)
        self._seeds = seeds

    def begin(self, world: World, stage: Stage) -> None:
        """What they are shown and how they are obeyed."""
        super().begin(world, stage)
        self._road, self._alone = world.cases[0].road, len(world.cases) == 1
        stage.take_charge(world)
        GUARD.begin(
            (actor.name for actor in world.cases[0].actors) if self._alone else (),
            world.settings.step,
            world.settings.conditions.interference, heeding(world.cases[0]),
        )  # fmt: skip
        self._tasks = [task_of(concrete) for concrete in world.cases]
        self._kinds = [dict(enumerate(kinds_of(concrete).values(), 1)) for concrete in world.cases]
        self._senses = {
            case: Senses(
                it.road, its.conditions, f"{seed}/{it.scenario}/{it.label}", self._tasks[case],
                kinds_of(it),
            )
            for case, (it, its, seed) in enumerate(zip(world.cases, world.each, self._seeds,
                strict=True))
            if not sees_all(its.conditions)
        }  # fmt: skip
        self._took = [0.0] * len(world.cases)
        self._wheels = [
            Wheel(its, partial(world.note, case), world.cases[case].road.line)
            for case, its in enumerate(world.each)
        ]
        self.keep(world, world.rows)

    def keep(self, world: World, rows: NDArray[np.intp]) -> None:
        """Look at these rows."""
        n, m = world.seen.shape
        self._ego_values = world.egos.view(np.float64).reshape(n, world.egos.itemsize // 8)[:, :8]
        first = [name for name, _ in _numbers(world.egos.dtype)].index("command.acceleration")
        self._commands = world.egos.view(np.float64).reshape(n, world.egos.itemsize // 8)[
            :, first : first + 2
        ]
        self._other_values = world.others.view(np.float64).reshape(
            n, m, world.others.itemsize // 8
        )[:, :, :8]

    def _fail(
        self, world: World, rows: Sequence[int], error: BaseException, when: str, target: Any
    ) -> None:
        """Fail the rows of a call; one that asks SUMO has its case to itself, later."""
        if isinstance(error, RefusedCallError | self._traci.TraCIException) and not self._alone:
            for row in rows:
                world.leave(row, ASKS_SUMO)
            return
        if len(rows) > 1:
            when = f"{when}, in one call for {len(rows)} cases, which fails them all"
        fault: EndReason = "ads_error"
        sentence = f"The ADS raised {when}: {said(error)}."
        if isinstance(error, ControllerError):
            fault, words = _fault(error), words_of(error, SENTENCE)
            sentence = words if words.endswith(f" {when}.") else str(with_time(error, when))
        for row in rows:
            world.keep_fault(int(world.rows[row]), error, target, self._folder)
            if not (self.checks and isinstance(error, RefusedCallError)):
                world.fail(row, fault, sentence)

    def _observation(
        self, world: World, case: int, time: float, me: list[float], others: list[Any]
    ) -> Observation:
        acceleration = me.pop()
        if case not in self._senses:
            look = _look(Look, (me, list(enumerate(others, 1))))
            return Observation(
                time, self._road, me, acceleration, look, self._tasks[case], self._kinds[case]
            )
        body = _body(me)
        senses = self._senses[case]
        names = [actor.name for actor in world.cases[case].actors]
        senses.take_in(
            time,
            body,
            acceleration,
            {name: _body(other[:7]) for name, other in zip(names, others, strict=True)},
        )
        return senses.observe()


def _numbers(dtype: np.dtype[Any], within: str = "") -> list[tuple[str, int]]:
    """The numbers of a record one behind the other, by their full names."""
    found = []
    for name in dtype.names or ():
        inner = dtype[name]
        found += (
            _numbers(inner, f"{within}{name}.")
            if inner.names
            else [(f"{within}{name}", inner.itemsize)]
        )
    return found


class OneEach(Policies):
    """A policy in plain Python for each row: its own exception, time and state.

    every: it is asked at every so manieth step; in between its answer holds.
    """

    checks = True

    def __init__(
        self, policies: Sequence[PolicyController], seeds: Sequence[int], terms: Terms
    ) -> None:
        super().__init__(seeds, terms)
        self._policies, self._terms = policies, terms

    def begin(self, world: World, stage: Stage) -> None:
        """Reset each of them."""
        super().begin(world, stage)
        for case, policy in enumerate(self._policies):
            if case in world.errors:
                continue
            try:
                policy.reset(told(world.cases[case], world.each[case], self._terms), TRACI, EGO)
            # the user's; an ADS's own is put in words by the watch over it
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # noqa: BLE001 - kept: sentence, place and traceback
                self._fail(world, [case], error, "in reset", policy.target)
        self._check(world, 0.0)
        self._settled = [
            getattr(policy.target, "settled", None) if world.settings.end_when_decided else None
            for policy in self._policies
        ]
        self._any_settles = any(self._settled)

    def _check(self, world: World, time: float) -> None:
        """A policy that has the simulation to itself may have done things there."""
        if not self._alone:
            return
        try:
            self._check_clock(world, time)
        except ControllerError as error:
            world.fail(0, "ads_error", str(error))

    def step(self, world: World, time: float) -> None:
        """Ask each of them."""
        egos, others = self._ego_values.tolist(), self._other_values.tolist()
        given, asked_rows = [], []
        now = clock.perf_counter
        if self._alone:
            GUARD.heard()
        for row in np.flatnonzero(world.egos["live"]).tolist() if len(egos) > 1 else (0,):
            case = int(world.rows[row])
            policy = self._policies[case]
            asked = now()
            try:
                seen = self._observation(world, case, time, egos[row], others[row])
                if world.steps % self._every:
                    command = self._wheels[case].command(None, egos[row], time)
                    given.append((command.acceleration, command.steering))
                    asked_rows.append(row)
                    self._took[case] = 0.0
                    continue
                action = policy.act(seen)
                if self._every == 1 and type(action) is float and -math.inf < action < math.inf:
                    answer = action, 0.0
                else:
                    wheel = self._wheels[case]
                    wanted = None if action is None and wheel.holds_plan else as_command(action)
                    command = wheel.command(wanted, egos[row], time)
                    answer = command.acceleration, command.steering
                took = now() - asked
                if took > self._step_timeout:
                    raise ControllerTimeoutError(
                        f"The ADS must answer within {self._step_timeout:g} s, took longer"
                    )
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # noqa: BLE001 - kept: sentence, place and traceback
                world.latencies.own[case].append(now() - asked)
                self._fail(world, [row], error, f"at {time:.2f} s", policy.target)
                continue
            world.latencies.own[case].append(took)
            self._took[case] = took
            given.append(answer)
            asked_rows.append(row)
            if self._any_settles and (settled := self._settled[case]) is not None:
                world.egos["settled"][row] = bool(settled())
        if given:
            self._commands[asked_rows] = given
        self._check(world, time)
        self._delayed.pass_on(world, time, self._took.__getitem__)

    def release(self, world: World, row: int) -> None:
        """Close the row's policy."""
        policy = self._policies[int(world.rows[row])]
        if self._alone:
            self._close_guarded(world, row, policy.close, policy.target)
        else:
            self._closed(world, row, "The ADS", policy.close, "ads_error", policy.target)
        super().release(world, row)


def with_time(error: ControllerError, when: str) -> ControllerError:
    """What an adapter, or the watch over a step, has put in words, with the time.

    The class may be the user's own.
    """
    kind = ControllerTimeoutError if isinstance(error, ControllerTimeoutError) else ControllerError
    return kind(f"{words_of(error, _LONGEST_WORDS)} {when}.")


def _fault(error: ControllerError | SimulationError) -> EndReason:
    if isinstance(error, SimulationError):
        return "sim_error"
    return "ads_timeout" if isinstance(error, ControllerTimeoutError) else "ads_error"


class Batch(Policies):
    """One policy for all rows, which takes arrays of observations and gives arrays of commands.

    Its numbers may depend on how many rows there are and which (those of a network do, in the last
    bit): what is driven together is part of what it is given.
    """

    def __init__(self, policy: PolicyController, seeds: Sequence[int], terms: Terms) -> None:
        super().__init__(seeds, terms)
        self._policy, self._terms = policy, terms
        self._act: Callable[[Any], Any] = policy.act
        self._held = 0

    def begin(self, world: World, stage: Stage) -> None:
        """Reset it once for all rows."""
        super().begin(world, stage)
        note_unlimited(world)  # arrays are of the world as it is
        self._held = len(world.cases)
        briefing = told(world.cases[0], world.each[0], self._terms)
        try:
            self._policy.reset(replace(briefing, values=None), TRACI, EGO)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - kept: sentence, place and traceback
            self._fail_all(world, error, "in reset")
        self._settled: Callable[[], Any] | None = (
            getattr(self._policy.target, "settled", None)
            if world.settings.end_when_decided
            else None
        )

    def step(self, world: World, time: float) -> None:
        """One call for all."""
        live = np.flatnonzero(world.egos["live"])
        seen = Observations(time, world.cases[0].road, world.rows[live], world.egos[live],
            world.seen[live],
                            world.others[live], world.cases)  # fmt: skip
        asked = clock.perf_counter()
        try:
            answer = self._answer(seen, len(live))
            if self._settled is not None:
                world.egos["settled"][live] = self._have_settled(self._settled(), len(live))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - kept: sentence, place and traceback
            self._fail_all(world, error, f"at {time:.2f} s")
            return
        took = clock.perf_counter() - asked
        world.latencies.shared.append(took / len(live))
        command = world.egos["command"]
        answer = answer.reshape(len(live), -1)
        command["acceleration"][live] = answer[:, 0]
        command["steering"][live] = answer[:, 1] if answer.shape[1] == 2 else 0.0
        self._delayed.pass_on(world, time, lambda case: took / len(live))

    def _answer(self, seen: Observations, rows: int) -> NDArray[np.float64]:
        asked = clock.perf_counter()
        try:
            answer = np.asarray(self._act(seen), dtype=np.float64)
            overdue = clock.perf_counter() - asked > self._step_timeout * rows
        except ControllerTimeoutError:  # of the watch over it
            overdue = True
        if overdue:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self._step_timeout:g} s a case, took longer"
            )
        if answer.shape not in ((rows,), (rows, 1), (rows, 2)):
            raise ControllerError(
                f"The actions of the ADS must have the shape ({rows},) or ({rows}, 2), got "
                f"{answer.shape}"
            )
        return answer

    def _have_settled(self, said_so: Any, rows: int) -> NDArray[np.bool_]:
        """Which of the rows that were asked just now have settled, (n,)."""
        settled = np.asarray(said_so, dtype=bool)
        if settled.shape != (rows,):
            raise ControllerError(
                f"What `settled()` of the ADS gives must have the shape ({rows},), got "
                f"{settled.shape}"
            )
        return settled

    def _fail_all(self, world: World, error: BaseException, when: str) -> None:
        self._fail(
            world, np.flatnonzero(world.egos["live"]).tolist(), error, when, self._policy.target
        )

    def release(self, world: World, row: int) -> None:
        """Close it when the last row has ended."""
        self._held -= 1
        if self._held == 0:
            self._closed(world, row, "The ADS", self._policy.close, "ads_error")
        super().release(world, row)
