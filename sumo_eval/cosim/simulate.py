"""One case through SUMO: step every vehicle, let the ADS move the ego, watch for contact, record, say why it ended."""

from __future__ import annotations

import math
import numbers
import time as clock
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sumo_eval.cosim.contact import Body, between, describe, first_touch, near
from sumo_eval.cosim.controller import Briefing, Controller, ControllerLike, NativeModel, load_controller
from sumo_eval.cosim.session import session
from sumo_eval.cosim.sumo_files import EGO
from sumo_eval.cosim.vehicle_model import Clipped, Command, EgoState, advance
from sumo_eval.errors import ControllerError, ControllerTimeoutError, InputError, SimulationError
from sumo_eval.scenario.concrete import Actor, ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Clip, Collision, EndReason, Recording, Trajectory

EGO_SPEED_MODE = 6  # bounded by vType accel and decel, no braking on the ADS's behalf: it does collide
EXACT_SPEED_MODE = 32  # setSpeed is taken as it is: the harness's own vehicle model has applied the limits
_LIMIT_TOLERANCE = 1e-6  # m/s2
_JUMP_TOLERANCE = 0.01  # m, motion of one step that speed cannot explain


def simulate(
    concrete: ConcreteScenario,
    controller: ControllerLike,
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = math.inf,
) -> Recording:
    """Run a concrete scenario with an ADS at the ego's wheel.

    controller: a locator string, a function, a class or an object (see `sumo_eval.cosim.controller`).
    folder: where relative paths in a locator start. step_timeout: longest wall time of one controller step, s.

    A fault of the ADS (an exception, a command that is no finite number, too slow a step) ends the run with
    `end_reason` "ads_error" and a sentence in `error`; one of SUMO with "sim_error". What was driven until then is kept.
    """
    settings = settings or SimulationSettings()
    if abs(settings.record_interval / settings.step - round(settings.record_interval / settings.step)) > 1e-9:
        raise InputError(
            f"`record_interval` of the simulation must be a multiple of `step` ({settings.step:g} s), "
            f"got {settings.record_interval:g}."
        )
    ads = load_controller(controller, folder)
    began = clock.perf_counter()
    ego_type = ads.vtype if isinstance(ads, NativeModel) else None
    run = _Run(concrete, settings, ads, step_timeout)
    try:
        with session(concrete, settings, ego_type) as traci:
            run.drive(traci)
    except SimulationError as error:
        run.fail("sim_error", str(error))
    return run.recording(clock.perf_counter() - began)


@dataclass(slots=True)
class _Track:
    """Samples of one vehicle while it drives."""

    length: float
    width: float
    rows: list[tuple[float, float, float, float, float, float, float]] = field(default_factory=list)

    def add(self, time: float, body: Body, acceleration: float, steering: float) -> None:
        self.rows.append((time, body.x, body.y, body.heading, body.speed, acceleration, steering))

    def trajectory(self) -> Trajectory:
        columns = list(zip(*self.rows, strict=True))
        return Trajectory(*columns, length=self.length, width=self.width)


class _Run:
    """State of one case while it runs."""

    def __init__(
        self, concrete: ConcreteScenario, settings: SimulationSettings, ads: Controller, step_timeout: float
    ) -> None:
        self.concrete = concrete
        self.settings = settings
        self.ads = ads
        self.step_timeout = step_timeout
        self.clips: dict[str, Clip] = {}
        self.collision: Collision | None = None
        self.end_reason: EndReason | None = None
        self.error: str | None = None
        self.log = ""
        self.latency_sum = 0.0
        self.latency_max = 0.0
        self.steps = 0
        self.stood = 0.0
        vehicle = settings.vehicle
        start = concrete.ego
        self.ego = Body(start.x, start.y, 0.0, start.speed, vehicle.length, vehicle.width)
        self.acceleration = 0.0
        self.steering = math.nan
        self.commanded = False
        self.actors = {
            actor.name: Body(actor.start.x, actor.y(0.0), 0.0, actor.start.speed, actor.length, actor.width)
            for actor in concrete.actors
        }
        self.tracks = {EGO: _Track(vehicle.length, vehicle.width)}
        self.tracks |= {actor.name: _Track(actor.length, actor.width) for actor in concrete.actors}
        self.sample(0.0)

    # -- the loop ------------------------------------------------------------------------------------------------------

    def drive(self, traci: Any) -> None:
        """Step until something ends the case."""
        step = self.settings.step
        samples_every = round(self.settings.record_interval / step)
        try:
            self._take_charge(traci)
            self._ask(self._reset, traci, 0.0)
            while self.end_reason is None:
                time = self.steps * step
                command = self._ask(self._decide, traci, time)
                self._move_ego(traci, command, step)
                for actor in self.concrete.actors:
                    self._move_actor(traci, actor, time + step)
                traci.simulationStep()
                self.steps += 1
                self._observe(traci, time, self.steps * step)
                if self.end_reason is None and self.steps % samples_every == 0:
                    self.sample(self.steps * step)
        except ControllerTimeoutError as error:
            self.fail("ads_timeout", str(error))
        except ControllerError as error:
            self.fail("ads_error", str(error))
        except (traci.TraCIException, traci.FatalTraCIError) as error:
            self.fail("sim_error", f"SUMO stopped at {self.steps * step:.2f} s: {error}.")
        finally:
            try:
                self.ads.close()
            except Exception as error:
                self.fail("ads_error", f"The ADS raised {type(error).__name__} in close: {error}.")

    def _take_charge(self, traci: Any) -> None:
        traci.vehicle.setSpeedMode(EGO, EGO_SPEED_MODE)
        traci.vehicle.setLaneChangeMode(EGO, 0)
        traci.vehicle.setSpeed(EGO, self.ego.speed)
        for actor in self.concrete.actors:
            traci.vehicle.setSpeedMode(actor.name, EXACT_SPEED_MODE)
            traci.vehicle.setLaneChangeMode(actor.name, 0)
            traci.vehicle.setSpeed(actor.name, actor.start.speed)

    def _reset(self, traci: Any, time: float) -> None:
        if isinstance(self.ads, NativeModel):
            traci.vehicle.setSpeed(EGO, -1)
        self.ads.reset(
            Briefing(self.concrete.scenario, self.concrete.road, self.settings.vehicle, self.settings.step), traci, EGO
        )

    def _decide(self, traci: Any, time: float) -> Command | None:
        return self.ads.step(traci, EGO, time)

    def _ask(self, what: Any, traci: Any, time: float) -> Command | None:
        """Call the ADS: any exception, an unusable answer or a slow one is its fault, and ends the case as that."""
        asked = clock.perf_counter()
        try:
            answer = what(traci, time)
        except Exception as error:
            self.log = "".join(traceback.format_exception(error))
            raise ControllerError(f"The ADS raised {type(error).__name__} at {time:.2f} s: {error}.") from error
        took = clock.perf_counter() - asked
        self.latency_sum += took
        self.latency_max = max(self.latency_max, took)
        if took > self.step_timeout and what == self._decide:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self.step_timeout:g} s, took {took:.2f} s at {time:.2f} s."
            )
        if answer is None:
            return None
        if not isinstance(answer, Command):
            raise ControllerError(
                f"The ADS must return a Command or None, got {type(answer).__name__} at {time:.2f} s."
            )
        for name in ("acceleration", "steering"):
            value = getattr(answer, name)
            if isinstance(value, bool) or not isinstance(value, numbers.Real) or not math.isfinite(value):
                raise ControllerError(
                    f"`{name}` of the ADS's Command must be a finite number, got {value!r} at {time:.2f} s."
                )
        return answer

    # -- motion --------------------------------------------------------------------------------------------------------

    def _move_ego(self, traci: Any, command: Command | None, step: float) -> None:
        if command is None:
            if self.commanded:
                traci.vehicle.setSpeedMode(EGO, EGO_SPEED_MODE)
                self.commanded = False
                self.steering = math.nan
            elif not isinstance(self.ads, NativeModel):
                mode = traci.vehicle.getSpeedMode(EGO)
                if mode != EGO_SPEED_MODE:
                    self.clip("speed_mode", mode, EGO_SPEED_MODE)
                    traci.vehicle.setSpeedMode(EGO, EGO_SPEED_MODE)
            return
        if not self.commanded:
            traci.vehicle.setSpeedMode(EGO, EXACT_SPEED_MODE)
            self.commanded = True
            self.steering = 0.0
        ego = self.ego
        state = EgoState(ego.x, ego.y, ego.heading, ego.speed, self.acceleration, self.steering)
        state, clips = advance(state, command, self.settings.vehicle, step)
        self.clip_all(clips)
        traci.vehicle.setSpeed(EGO, state.speed)
        _place(traci, EGO, state.x, state.y, state.heading, ego.length)
        self.acceleration = state.acceleration
        self.steering = state.steering_wheel_angle

    def _move_actor(self, traci: Any, actor: Actor, time: float) -> None:
        """Scripted lateral motion; straight on, SUMO moves the vehicle by itself."""
        for move in actor.lane_changes:
            if move.begin < time < move.begin + move.duration + self.settings.step:
                across = actor.lateral_speed(time)
                heading = math.atan2(across, actor.start.speed)
                traci.vehicle.setSpeed(actor.name, math.hypot(across, actor.start.speed))
                x = actor.start.x + actor.start.speed * time
                _place(traci, actor.name, x, actor.y(time), heading, actor.length)

    # -- observation ---------------------------------------------------------------------------------------------------

    def _observe(self, traci: Any, before: float, now: float) -> None:
        step = now - before
        present = traci.vehicle.getIDList()
        if EGO not in present:
            raise SimulationError(f"SUMO lost the ego at {now:.2f} s.")
        was = self.ego
        body = _read(traci, EGO, was.length, was.width)
        if self.commanded:
            body = body._replace(speed=traci.vehicle.getSpeed(EGO))
        else:
            self._check_native_motion(was, body, step)
            self.acceleration = (body.speed - was.speed) / step
        touched: tuple[float, str, Body] | None = None
        for name, last in list(self.actors.items()):
            if name not in present:
                self.clip("actor_left_the_network", now, now)
                del self.actors[name]
                continue
            other = _read(traci, name, last.length, last.width)
            if near(body, other, (was.speed + last.speed + body.speed + other.speed) * step):
                share = first_touch(was, body, last, other)
                if share is not None and (touched is None or share < touched[0]):
                    touched = (share, name, between(last, other, share))
            self.actors[name] = other
        self.ego = body
        if touched is not None:
            self._end_in_contact(touched, was, before, step)
        else:
            self._check_end(body, now, step)

    def _end_in_contact(self, touched: tuple[float, str, Body], was: Body, before: float, step: float) -> None:
        share, name, other = touched
        time = before + share * step
        self.ego = between(was, self.ego, share)
        self.collision = describe(time, name, self.ego, other)
        self.actors[name] = other
        self.end("contact", time)

    def _check_end(self, ego: Body, now: float, step: float) -> None:
        road = self.concrete.road
        self.stood = self.stood + step if ego.speed < self.settings.standstill_speed else 0.0
        if not road.right_edge <= ego.y <= road.left_edge:
            self.end("off_road", now)
        elif ego.x >= road.length:
            self.end("road_end", now)
        elif self.stood >= self.settings.standstill_time - 1e-9:
            self.end("standstill", now)
        elif now >= self.settings.time_limit - 1e-9:
            self.end("time_limit", now)

    def _check_native_motion(self, was: Body, now: Body, step: float) -> None:
        """TraCI calls that move the ego in ways no vehicle can are recorded: speed, and position against speed."""
        vehicle = self.settings.vehicle
        gained = (now.speed - was.speed) / step
        if gained > vehicle.max_acceleration + _LIMIT_TOLERANCE:
            self.clip("unphysical_acceleration", gained, vehicle.max_acceleration)
        elif gained < -vehicle.max_deceleration - _LIMIT_TOLERANCE:
            self.clip("unphysical_acceleration", gained, -vehicle.max_deceleration)
        elif (
            gained > vehicle.max_acceleration - _LIMIT_TOLERANCE
            or gained < -vehicle.max_deceleration + _LIMIT_TOLERANCE
        ):
            self.clip("vtype_limit", gained, gained)
        moved = math.hypot(now.x - was.x, now.y - was.y)
        driven = max(now.speed, was.speed) * step
        if moved > driven + _JUMP_TOLERANCE:
            self.clip("jump", moved, driven)

    # -- records -------------------------------------------------------------------------------------------------------

    def clip(self, what: str, requested: float, applied: float) -> None:
        """Count a clip and keep its worst instance."""
        known = self.clips.get(what)
        time = self.steps * self.settings.step
        if known is None:
            self.clips[what] = Clip(what, 1, time, float(requested), float(applied))
            return
        if abs(requested - applied) <= abs(known.requested - known.applied):
            requested, applied = known.requested, known.applied
        self.clips[what] = Clip(what, known.count + 1, known.first_time, float(requested), float(applied))

    def clip_all(self, clips: tuple[Clipped, ...]) -> None:
        """Count every clip of a step."""
        for what, requested, applied in clips:
            self.clip(what, requested, applied)

    def sample(self, time: float) -> None:
        """Record every vehicle as it is now."""
        ego = self.tracks[EGO]
        if ego.rows and time - ego.rows[-1][0] < 1e-9:
            return
        ego.add(time, self.ego, self.acceleration, self.steering)
        for name, body in self.actors.items():
            self.tracks[name].add(time, body, 0.0, math.nan)

    def end(self, reason: EndReason, time: float) -> None:
        """The case is over."""
        self.end_reason = reason
        self.sample(time)

    def fail(self, reason: EndReason, sentence: str) -> None:
        """The case could not be brought to its end."""
        self.end_reason = reason
        self.error = sentence if self.error is None else f"{self.error} {sentence}"

    def recording(self, wall_time: float) -> Recording:
        """Everything the case left behind."""
        assert self.end_reason is not None
        return Recording(
            ego=self.tracks[EGO].trajectory(),
            actors={name: track.trajectory() for name, track in self.tracks.items() if name != EGO},
            collision=self.collision,
            end_reason=self.end_reason,
            clips=tuple(self.clips[name] for name in sorted(self.clips)),
            error=self.error,
            log=self.log,
            controller_latency=(self.latency_sum / max(self.steps, 1), self.latency_max),
            wall_time=wall_time,
        )


def _read(traci: Any, name: str, length: float, width: float) -> Body:
    """A vehicle's body from SUMO, whose x, y is the front bumper's centre and whose angle runs clockwise from north."""
    x, y = traci.vehicle.getPosition(name)
    heading = math.radians(90.0 - traci.vehicle.getAngle(name))
    heading = math.remainder(heading, math.tau)
    half = 0.5 * length
    speed = traci.vehicle.getSpeed(name)
    return Body(x - half * math.cos(heading), y - half * math.sin(heading), heading, speed, length, width)


def _place(traci: Any, name: str, x: float, y: float, heading: float, length: float) -> None:
    """Put a vehicle's centre somewhere at the end of the coming step."""
    half = 0.5 * length
    traci.vehicle.moveToXY(
        name, "", -1, x + half * math.cos(heading), y + half * math.sin(heading), 90.0 - math.degrees(heading), 2
    )
