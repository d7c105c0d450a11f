"""ADSs that drive through TraCI: hooks (TraCI code), step listeners, programs, SUMO's own models.

In any step such an ADS may return a command, or let SUMO move the ego. Where SUMO moves the ego,
this file checks that the ego moves as a vehicle can. `cosim/doors/traci_module.py` guards the
ADS's calls through TraCI.

Users: `cosim/simulation.py`, which also decides which of these ADSs share a simulation.
"""

import cmath
from collections.abc import Callable, Sequence
from functools import partial
from math import cos, dist, hypot, radians, remainder, sin, sqrt, tau
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
from sumo_eval.cosim.impossible import (
    FASTEST,
    JUMP_TOLERANCE,
    LIMIT_TOLERANCE,
    LOST,
    LOWEST_SPEED,
    LeftTheRoadError,
    impossible,
    leaves_the_lanes,
)
from sumo_eval.cosim.plans import Executor, checked_answer
from sumo_eval.cosim.policies import make_briefing, with_time
from sumo_eval.cosim.records import (
    COMMAND,
    MAP,
    MODEL,
    NEXT,
    STRAIGHT,
    SUMO,
    first_number,
)
from sumo_eval.cosim.stage import EGO_SPEED_MODE, EXACT_SPEED_MODE, LEFT_BATCH, Stage
from sumo_eval.cosim.sumo.shared_files import suffix
from sumo_eval.cosim.sumo.sumo_files import EGO, gripped, vehicle_edges
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.cosim.world import World, corner
from sumo_eval.errors import ControllerError, ControllerTimeoutError, SimulationError, said
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.road.reference_line import curvatures, frame_places
from sumo_eval.scenario.touch import Body
from sumo_eval.trajectory import IntArray

_SIDEWAYS_SPEED = 3.0  # m/s across, the fastest lane change that counts as driving
_SHARPEST = 25.0  # m/s2 across, which no vehicle exceeds at `_SIDEWAYS_SPEED` or above
_ALONG = 0.5  # rad, largest heading at which SUMO finds a vehicle's lane
_PLACE_TOLERANCE = 1e-3  # m
_AT_END = 0.1  # m before the end of a lane, where SUMO stops a vehicle
_NEAR_END = 20.0  # m, more than a vehicle drives in two steps
# share of speed * step by which motion in a curve may differ: SUMO's lanes are stretched polylines
_CHORD_SHARE = 0.03

# indices among the numbers of an ego; `stale` has two meanings, see `records.EGO`
_FRONT_X, _FRONT_Y = first_number("front_x"), first_number("front_y")
_PLACED, _STALE, _SETTLED = first_number("placed"), first_number("stale"), first_number("settled")
# The ego's speed along its lane, as SUMO counts it, after the last step. The slot also holds the
# speed of a plant's next state, from the plant's step until the ego is moved.
_LANE_SPEED = NEXT.start + 3


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
            hook.watch(world, row)

    def _each(
        self, world: World, do: Callable[[Any, World, float], None], time: float, rows: Any = None
    ) -> None:
        """Call `do` with the hook of each row; in a batch, a row for which the call fails leaves.

        rows: None: those that have not ended.
        """
        if self._alone:
            hook = self._rows[0]
            try:
                do(hook, world, time)
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
                do(hook, world, time)
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
            self._check_clock(world, time)

    def after(self, world: World, now: float) -> None:
        """Read the egos that SUMO moved."""
        # rows whose egos did more than drive straight ahead; most often none
        rows = self._stage.read_at_once(world)
        if rows:
            self._each(world, _Hook.after, now, rows)

    def release(self, world: World, row: int) -> None:
        """Close the ADS and remove its listeners."""
        hook = self._rows[row]
        if self._alone:
            self._close_guarded(world, row, hook.ads.close, hook.ads.target)
        else:
            self._each(world, lambda hook, *_: hook.ads.close(), 0.0, [row])
        super().release(world, row)


class _Hook:
    """The ADS of one case, and its ego where SUMO moves it.

    At most 29 attributes: see `World`.
    """

    def __init__(self, ads: Adapter, terms: Terms) -> None:
        self.ads, self._terms = ads, terms
        self._bend = 0.0  # 1/m, the road's curvature beside the ego
        # the last step whose motion was read here, and the motion's direction relative to the road,
        # rad
        self._course = 0, 0.0
        self._lanes = 0, 0  # on a curved road: its lane before and after the last step
        self._lane_end = 0.0  # x of its lane's end, m; in a curve off by less than `_NEAR_END`

    # -- the ADS -----------------------------------------------------------------------------------

    def take(self, world: World, stage: Stage, case: int, actuation: Actuation) -> None:
        """Make ready for a case of the world.

        actuation: carries the commands of all cases to their vehicles.
        """
        self._world, self._case = world, case
        self._calls, self._stage = stage.calls, stage
        self._check_clock, self._actuation = stage.check_clock, actuation
        ads = self.ads
        self.ego = stage.names[case][0]
        self.names = _names(world.cases[case], suffix(case, len(world.cases)))
        self._native = isinstance(ads, NativeModel)
        # call a function itself: the adapter's `step` around it takes time
        plain = type(ads) is ObjectController and type(ads.target) is FunctionType
        self._act = ads.target if plain else ads.step
        self._step, self._limits = world.settings.step, gripped(world.each[case].vehicle)
        self._half = 0.5 * self._limits.length
        self._take_road(world)

    def _take_road(self, world: World) -> None:
        """Keep the road and its curves, the delay of commands, and the executor of answers."""
        case = self._case
        settings = world.each[self._case]
        self._latencies = world.latencies.own[case]
        self._settled = settled_of(self.ads, settings)
        self.road = world.cases[case].road
        self._bent = self.road.bent
        # curvatures at both ends of the pieces of the road's line, and 0, 1/m
        self._bends = {0.0, *(bend for it in self.road.line for bend in (it.begin, it.end))}
        self._executor = Executor(settings, partial(world.note, case), self.road.line)
        self._delay = settings.conditions.actuation_delay

    def watch(self, world: World, row: int) -> None:
        """Use this row of the world's arrays from now on."""
        # _mine: the ego's record in the world, as an array of one
        self._mine = world.egos[row : row + 1]
        # Memory views: to read one number of them takes a tenth as long as of an array.
        # _state: the numbers of an `EGO` (`records.numbers_of`): 0: x, 1: y, 2: heading, 3: speed,
        # 7: acceleration; others by `first_number`
        self._state: Any = self._mine.view(np.float64).reshape(-1).data
        # _flags: the same bytes as whole numbers, for the fields of `records.flags`
        self._flags: Any = self._mine.view(np.int64).reshape(-1).data

    def reset(self, world: World, time: float) -> None:
        """Reset the ADS."""
        concrete = world.cases[self._case]
        settings = world.each[self._case]
        self._calls.setSpeedMode(self.ego, EGO_SPEED_MODE)
        if self._native:
            self._calls.setSpeed(self.ego, -1)
        briefing = make_briefing(concrete, settings, self._terms)
        if (error := error_of(self.ads.reset, briefing, TRACI, EGO)) is not None:
            self._blamed(error, "in reset", time)
        self._check_clock(world, time)

    def _blamed(self, error: BaseException, when: str, time: float) -> None:
        """Raise an exception of the user's code as a ControllerError.

        when: as of `policies.with_time`. time: s.
        """
        # an adapter, or the watch over the step, has given it a message
        if isinstance(error, ControllerError) and not isinstance(error, RefusedCallError):
            raise with_time(error, when) from error
        self._check_clock(self._world, time)  # raises the message of a refused call
        raise ControllerError(f"The ADS raised {when}: {said(error)}.") from error

    def step(self, world: World, time: float) -> None:
        """One step of the ADS.

        Raises ControllerError for an exception of its code, an unusable answer and a slow one.
        """
        try:
            command, took = (
                self._ask(time) if world.steps % self._terms.every == 0 else self._held(time)
            )
            if self._delay:
                command = self._arriving(world, command, took)
            if command is not None:
                self._take_over(world, command)
            # false in most steps: SUMO moves the ego already, and nothing has to be checked
            elif self._flags[_PLACED] != SUMO or GUARD.mode_may_differ or self.road.spans:
                self._leave_to_sumo()
        except self._stage.traci.TraCIException as error:
            raise ControllerError(
                f"After the ADS's step at {time:.2f} s SUMO cannot move the ego: {said(error)}."
            ) from error
        if self._settled is not None:
            self._flags[_SETTLED] = bool(self._settled())

    def _lead_along_lane(self) -> None:
        """Reroute an ego along its lane where its route leaves the lane: SUMO would stop it there.

        The route stays if the ego brakes at least as hard as SUMO's own model would.
        """
        vehicle = self._stage.traci.vehicle
        ego = self.ego
        if not self._may_pass_lane_end():
            return
        edges = vehicle_edges(self.road, self._state[1])
        route = vehicle.getRoute(ego)
        index = vehicle.getRouteIndex(ego)
        following = slice(index + 1, index + 2)  # the next edge, none after the last one
        too_fast = vehicle.getSpeed(ego) > vehicle.getSpeedWithoutTraCI(ego)
        if too_fast and edges[following] != route[following]:
            vehicle.setRoute(ego, edges[index:])

    def _may_pass_lane_end(self) -> bool:
        """Whether SUMO may move the ego past the end of its lane in this step."""
        front_x = self._state[0] + self._half
        step = self._step
        if front_x < self._lane_end - _NEAR_END:  # the common case, without a call of SUMO
            return False
        self._lane_end = front_x + self._left_of_lane()
        reach = step * (self._state[_LANE_SPEED] + self._limits.max_acceleration * step)
        return bool(self._lane_end <= front_x + reach)

    def _held(self, time: float) -> tuple[Command | None, None]:
        """The command between two calls, without a wall time; None: SUMO moves the ego."""
        return (self._obeyed(None, time) if self._executor.holds else None), None

    def _arriving(
        self, world: World, command: Command | None, took: float | None
    ) -> Command | None:
        """The delayed command that reaches the vehicle now; None: SUMO moves the ego.

        Calls by which the ADS lets SUMO move the ego are not delayed: a note records that.

        took: wall time of the ADS's step, s; None: the ADS was not called.
        """
        due = self._mine["command"]
        has_new = command is not None
        if command is not None:
            due[0] = command.acceleration, command.steering
        elif took is not None:
            world.note(self._case, "actuation_not_delayed", self._delay, 0.0)
        # also without a new command, as the queue of delayed commands advances in every step; SUMO
        # then moves the ego, and `due` has no effect
        self._actuation.pass_on(due, [self._case], world.steps, has_new=has_new)
        return Command(*due[0].tolist()) if has_new else None

    def _ask(self, time: float) -> tuple[Command | None, float]:
        """The answer of the ADS as a command, after its listeners, and its wall time, s."""
        if self._native:  # there is no code to call
            return None, 0.0
        answer = None
        started = perf_counter()
        GUARD.moved = GUARD.placed = False
        try:
            if not GUARD.shared:
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
            self._check_clock(self._world, time)
        late = self._actuation.late(took)
        # after the first step, SUMO continues to move an ego whose command is late
        if answer is None or (late and self._world.steps and self._flags[_PLACED] == SUMO):
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
            if self._flags[_PLACED] == SUMO:
                self._calls.setSpeedMode(self.ego, EXACT_SPEED_MODE)
                self._flags[_PLACED] = MODEL
                # turns the ego and its wheels as if the vehicle model had driven the curve so far
                corner(self._mine, self._bend, self._limits)
                if self._world.steps == 0:
                    self._world.begin_as_model(self._case)
            return self._executor.command(request, self._state, time, late=late)
        except ControllerError as error:
            raise with_time(error, f"at {time:.2f} s") from error

    # -- motion ------------------------------------------------------------------------------------

    def _leave_to_sumo(self) -> None:
        """Let SUMO move the ego, within its limits, from this step on."""
        world = self._world
        if self._terms.plant is not None:
            world.note(self._case, "vehicle_model_not_used", 1.0, 0.0)
        if self._flags[_PLACED] != SUMO:
            self._calls.setSpeedMode(self.ego, EGO_SPEED_MODE)
            self._flags[_PLACED] = SUMO
            self._flags[_STALE] = 1  # SUMO begins to move it in this step
        elif not self._native and GUARD.mode_may_differ:
            mode = self._calls.getSpeedMode(self.ego)
            if mode != EGO_SPEED_MODE:
                world.note(self._case, "speed_mode", mode, EGO_SPEED_MODE)
                self._calls.setSpeedMode(self.ego, EGO_SPEED_MODE)
        if self.road.spans:  # lanes begin or end; such cases are driven alone
            self._lead_along_lane()

    def _take_over(self, world: World, command: Command) -> None:
        """Let the vehicle model or the plant move the ego, as commanded."""
        state = self._state
        self._flags[_STALE] = 1  # so that SUMO receives its motion in every step
        if self._terms.plant is None:
            at = COMMAND.start
            state[at], state[at + 1] = command.acceleration, command.steering
        else:
            advance_plant(self._terms.plant, world, command)

    def after(self, world: World, now: float) -> None:
        """Read the ego that SUMO moved; where the vehicle model moves it, SUMO must show the
        same.
        """
        if self._flags[_PLACED] != SUMO:
            self._check_placed_ego(now)
        else:
            self._read_driven_ego(now)
        on_lanes = (
            self.road.right_edge <= self._state[1] <= self.road.left_edge
            and abs(self._state[2]) < _ALONG
        )
        if GUARD.shared and not on_lanes:  # the row leaves its batch
            raise SimulationError("An ego off its lanes may lie on another case's road.")

    def _check_placed_ego(self, now: float) -> None:
        """Raise SimulationError unless SUMO shows the ego where the vehicle model has put it."""
        state = self._state
        # without a speed in `GUARD`, calls for the ego's speed and position ask SUMO again
        GUARD.speeds.pop(self.ego, None)
        state[_LANE_SPEED], self._course = state[3], (self._world.steps, state[2])
        front_x, front_y = state[_FRONT_X], state[_FRONT_Y]
        x, y = self._stage.fronts[self.ego]
        # `not <=`: true of nan as well
        if not (abs(x - front_x) <= _PLACE_TOLERANCE and abs(y - front_y) <= _PLACE_TOLERANCE):
            raise SimulationError(
                f"SUMO put the ego's front bumper at ({x:.3f}, {y:.3f}) m instead of "
                f"({front_x:.3f}, {front_y:.3f}) m at {now:.2f} s."
            )

    def _read_driven_ego(self, now: float) -> None:
        """Take in the ego as SUMO moved it.

        SUMO gives the speed along the lane, on a curved road along the road's line, and the speed
        across. Both make the speed over the ground.
        """
        state = self._state
        half = self._half
        (front_x, front_y), heading, lane_speed = self._shown(now)
        last_speed = state[3]
        last_x, last_y, last_heading = state[MAP : MAP + 3]
        # SUMO inserts the ego along its lane, whatever its heading in the case
        heading_before = last_heading
        if not self._world.steps:
            heading_before = last_heading - state[2]
            state[2] = 0.0
        # motion of the front bumper
        moved_x = front_x - last_x - half * cos(heading_before)
        moved_y = front_y - last_y - half * sin(heading_before)
        pose: tuple[float, ...] = (
            front_x - half * cos(heading), front_y - half * sin(heading), heading
        )  # fmt: skip
        state[MAP], state[MAP + 1], state[MAP + 2] = pose
        if self._bent:
            pose, moved_x, moved_y = self._along_curve(pose, moved_x, moved_y, lane_speed)
        self._check_motion(moved_x, moved_y, lane_speed, now)
        self._check_course(pose, now)
        acceleration = (lane_speed - state[_LANE_SPEED]) / self._step
        state[_LANE_SPEED] = lane_speed
        if self._flags[_STALE]:  # the first step in which SUMO moves the ego
            self._flags[_STALE] = 0
            self._note_turn(heading, last_heading, last_speed)
        speed = lane_speed * (1.0 - self._bend * pose[1]) if self._bent else lane_speed
        if self._bent or moved_y != 0.0 or heading != 0.0:
            speed = self._with_sideways(speed, now)
        state[0], state[1], state[2] = pose
        state[3], state[7] = speed, acceleration

    def _shown(self, now: float) -> tuple[tuple[float, float], float, float]:
        """Front bumper of the ego on the map, m, heading, rad, and speed along its lane, m/s, as
        SUMO shows them.

        Raises LeftTheRoadError if SUMO has lost the ego beside its lanes; ControllerError or
        SimulationError for other impossible values.
        """
        calls, ego = self._calls, self.ego
        front_x, front_y = self._stage.fronts[ego]
        speed = self._stage.speeds[ego]
        angle = calls.getAngle(ego)
        if not (
            -LOST < front_x < LOST
            and -LOST < front_y < LOST
            and LOWEST_SPEED < speed < FASTEST
            and 0.0 <= angle <= 360.0
        ):
            sizes = self._limits.length, self._limits.width
            x, y, heading = self._state[:3]
            last = Body(x, y, heading, self._state[3], *sizes)
            if front_x <= -LOST and leaves_the_lanes(last, self.road, self._step):
                raise LeftTheRoadError
            x, y, heading = self._state[MAP : MAP + 3]
            front = last._replace(x=x, y=y, heading=heading).moved(self._half)[:2]
            fault = impossible(calls, ego, front, now)
            raise ControllerError(f"The ADS is responsible: {fault}") if GUARD.moved else fault
        return (front_x, front_y), remainder(radians(STRAIGHT - angle), tau), speed

    def _along_curve(
        self, on_map: Sequence[float], moved_x: float, moved_y: float, speed: float
    ) -> tuple[tuple[float, ...], float, float]:
        """The ego relative to the line of a curved road: x, y and heading, and the motion of its
        front bumper along and across the line in this step, m.

        on_map: x, y and heading on the map. moved_x, moved_y: motion on the map, m.
        speed: along the line, m/s.
        """
        state, line = self._state, self.road.line
        x, y, heading = on_map
        pose = tuple(float(it) for it in frame_places(line, x, y, heading, near=state[0]))
        self._bend = float(curvatures(line, pose[0]))
        self._lanes = self._lanes[1], self._calls.getLaneIndex(self.ego)
        across = pose[1] - state[1] + self._half * (sin(pose[2]) - sin(state[2]))
        moved = sqrt(max(moved_x**2 + moved_y**2 - across**2, 0.0))
        # SUMO stretches each lane evenly over its whole length, so a motion on the map has no exact
        # length along the line. It is between those at the road's curvatures: take the length in
        # this range that is nearest to speed * step.
        lengths = [moved / (1.0 - bend * pose[1]) for bend in self._bends]
        return pose, min(max(speed * self._step, min(lengths)), max(lengths)), across

    def _note_turn(self, heading: float, last_heading: float, last_speed: float) -> None:
        """Note that SUMO turned the ego into its lane, if it did so by more than rounding and the
        road's own curve.
        """
        turned = abs(remainder(heading - last_heading, tau))
        if turned > 1e-3 + abs(last_speed * self._step * self._bend):
            self._world.note(self._case, "heading", last_heading, heading)

    def _with_sideways(self, speed: float, now: float) -> float:
        """Speed over the ground, m/s, of a speed along the lane and SUMO's speed across it."""
        sideways = self._calls.getLateralSpeed(self.ego)
        if not -FASTEST < sideways < FASTEST:
            raise SimulationError(
                f"SUMO gave vehicle `{EGO}` the speed {sideways:g} m/s across at {now:.2f} s."
            )
        return hypot(speed, sideways) if sideways else speed

    def _check_motion(self, ahead: float, across: float, speed: float, now: float) -> None:
        """Refuse motion that no vehicle can do, as TraCI calls may cause it.

        ahead, across: motion of the front bumper in the step, m.
        speed: along the lane, m/s.
        now: time, s.
        """
        step = self._step
        sideways = _SIDEWAYS_SPEED * self._step
        lane_speed = self._state[_LANE_SPEED]  # a step ago
        self._check_acceleration((speed - lane_speed) / step, now, stands=speed == 0.0)
        # the motion must fit a speed between the old and the new one
        slower, faster = (speed, lane_speed) if speed < lane_speed else (lane_speed, speed)
        tolerance = JUMP_TOLERANCE + (_CHORD_SHARE * faster * step if self._bent else 0.0)
        least, most = slower * step - tolerance, faster * step + tolerance
        if least <= ahead <= most and -sideways <= across <= sideways:
            return
        moved = hypot(ahead, across)
        possible = min(max(moved, least), most)
        # SUMO itself moves an ego to a lane's centre, or along a curve when it changes lanes
        sideways_only = least <= ahead <= most
        if (sideways_only and self._put_on_centre()) or (
            self._lanes[0] != self._lanes[1] and abs(moved - possible) <= self._lanes_apart()
        ):
            self._world.note(self._case, "jump", moved, possible)  # by SUMO
        elif moved != possible:  # if equal, only the direction is odd: `_check_course` checks it
            self._unphysical(
                "jump", moved, possible,
                f"The ADS moved its vehicle {moved:.2f} m in a step that its speed limits to "
                f"{max(least, 0.0):.2f}..{most:.2f} m, at {now:.2f} s (moveToXY needs a setSpeed "
                "to go with it).",
            )  # fmt: skip

    def _check_acceleration(self, acceleration: float, now: float, *, stands: bool) -> None:
        """Refuse an acceleration that no vehicle can have, m/s2; note one at a limit.

        stands: whether the ego stands at the end of the step.
        """
        lowest, highest = -self._limits.max_deceleration, self._limits.max_acceleration
        if not lowest - LIMIT_TOLERANCE <= acceleration <= highest + LIMIT_TOLERANCE:
            # SUMO stops a vehicle at once where its lane ends: the ego has left the road, unless a
            # call put it there. Of SUMO's own model the stop is only noted, by `_unphysical`.
            at_end = stands and self._left_of_lane() < _AT_END
            if at_end and not (GUARD.placed or self._native):
                raise LeftTheRoadError
            self._unphysical(
                "unphysical_acceleration", acceleration, min(max(acceleration, lowest), highest),
                f"The ADS must drive its vehicle within {lowest:g}..{highest:g} m/s2, "
                f"got {acceleration:.1f} m/s2 at {now:.2f} s.",
            )  # fmt: skip
        # at a limit: SUMO may have held the vehicle back
        elif not lowest + LIMIT_TOLERANCE <= acceleration <= highest - LIMIT_TOLERANCE:
            self._world.note(self._case, "vtype_limit", acceleration, acceleration)

    def _left_of_lane(self) -> float:
        """Distance from the ego's front bumper to the end of its lane, m."""
        vehicle, lane = self._stage.traci.vehicle, self._stage.traci.lane
        length = lane.getLength(vehicle.getLaneID(self.ego))
        return float(length - vehicle.getLanePosition(self.ego))

    def _put_on_centre(self) -> bool:
        """Whether SUMO moved the ego to its lane's centre within the step, as at the end of a lane
        change that did not begin at a centre.

        False in a batch: the case then leaves its batch, and is driven alone.
        """
        placed = GUARD.shared or GUARD.placed
        return not placed and self._calls.getLateralLanePosition(self.ego) == 0.0

    def _lanes_apart(self) -> float:
        """Distance along a curve, m, between the places of the ego's position on its old and on its
        new lane.

        SUMO stretches each lane evenly, so equal positions on two lanes are not side by side.
        """
        at = self._calls.getLanePosition(self.ego)
        old, new = self._lanes
        on_map = self._stage.traci.simulation.convert2D
        edge = self._stage.traci.vehicle.getRoadID(self.ego)
        apart = dist(*(on_map(edge, at, lane) for lane in (old, new)))
        return sqrt(max(apart**2 - (self.road.lane_width * (new - old)) ** 2, 0.0))

    def _check_course(self, pose: Sequence[float], now: float) -> None:
        """Refuse fast sideways motion into which no vehicle can turn.

        pose: the new x, y and heading, relative to the road.
        """
        old, new = (
            complex(x, y) + cmath.rect(self._half, heading)  # the front bumper, x + y i, m
            for x, y, heading in (self._state[:3], pose)
        )
        moved = new - old
        step = self._step
        course = cmath.phase(moved)
        last_step, last_course = self._course
        if last_step < self._world.steps - 1:  # since then it drove straight ahead
            last_course = 0.0
        self._course = self._world.steps, course
        # lateral acceleration, m/s2: speed times rate of turning
        sharp = abs(moved * remainder(course - last_course, tau)) / step**2
        too_sharp = abs(moved.imag) > _SIDEWAYS_SPEED * step and sharp > _SHARPEST
        if too_sharp and not self._put_on_centre():
            self._unphysical(
                "unphysical_turn", sharp, _SHARPEST,
                f"The ADS must turn its vehicle within {_SHARPEST:g} m/s2, got {sharp:.1f} m/s2 "
                f"at {now:.2f} s.",
            )  # fmt: skip

    def _unphysical(self, what: str, requested: float, possible: float, sentence: str) -> None:
        """Raise ControllerError for impossible motion; if SUMO's own model drives, only record it.

        what: name of the clip. requested, possible: its values.
        """
        if not self._native:
            raise ControllerError(sentence)
        if what == "jump" and not requested < FASTEST * self._step:  # `not <`: true of nan as well
            raise SimulationError(
                f"SUMO moved vehicle `{EGO}` {requested:g} m in the step after "
                f"{self._world.time:.2f} s."
            )
        self._world.note(self._case, what, requested, possible)


def _names(concrete: ConcreteScenario, suffix: str) -> SumoNames:
    """Names that a hook can give SUMO in a case: vehicles, the edge, the route `along`, lanes."""
    lanes = [f"road_{lane}" for lane in range(concrete.road.lanes)]
    actors = [actor.name for actor in concrete.actors]
    return SumoNames((EGO, *actors, "road", "along", *lanes), suffix)
