"""One case through SUMO: step every vehicle, let the ADS move the ego, watch for contact, record, say why it ended."""

from __future__ import annotations

import math
import numbers
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sumo_eval.cosim.actuation import Actuation
from sumo_eval.cosim.clips import count_clip
from sumo_eval.cosim.contact import Body, between, describe, first_touch, keeps_apart
from sumo_eval.cosim.controller import (
    Briefing,
    Controller,
    ControllerLike,
    NativeModel,
    ObservingController,
    load_controller,
)
from sumo_eval.cosim.fault_place import fault_place
from sumo_eval.cosim.fmu import FmuPlant
from sumo_eval.cosim.observation import Senses
from sumo_eval.cosim.session import session, vehicles
from sumo_eval.cosim.sumo_files import EGO
from sumo_eval.cosim.traci_module import GUARD, TRACI, RefusedCallError, seen_as_traci
from sumo_eval.cosim.traci_program import TraciProgram, served
from sumo_eval.cosim.vehicle_model import Command, EgoState, advance
from sumo_eval.errors import ControllerError, ControllerTimeoutError, SimulationError, must_be, said
from sumo_eval.scenario.concrete import Actor, ConcreteScenario
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.text import SENTENCE, clean, clean_log, shown, traceback_of, words_of
from sumo_eval.trajectory import Clip, Collision, EndReason, Recording, Trajectory

EGO_SPEED_MODE = 6  # bounded by vType accel and decel, no braking on the ADS's behalf: it does collide
EXACT_SPEED_MODE = 32  # setSpeed is taken as it is: the harness's own vehicle model has applied the limits
_LIMIT_TOLERANCE = 1e-6  # m/s2
_JUMP_TOLERANCE = 0.01  # m, motion of one step that speed cannot explain
_SIDEWAYS_SPEED = 3.0  # m/s, the fastest lane change that counts as driving
_PLACE_TOLERANCE = 1e-3  # m
_CLOCK_TOLERANCE = 1e-4  # s; SUMO counts in milliseconds
_SCRIPT_TOLERANCE = 0.05  # m, what another vehicle may be off its script
_NEAR = 0.02  # m, along and across, as near to it as nobody need look closer
_LONGEST_WORDS = SENTENCE - 20  # characters of an adapter's sentence, to which the time is added
_tuple = tuple.__new__  # a NamedTuple's own constructor takes twice as long, and a step makes several
_SEEN_AS_IT_IS: dict[str, Any] = {
    "perception_delay": 0.0, "dropout": 0.0, "position_noise": 0.0, "speed_noise": 0.0, "sensor_range": None,
    "field_of_view_deg": None, "occlusion": False,
}  # fmt: skip


def simulate(
    concrete: ConcreteScenario,
    controller: ControllerLike,
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = math.inf,
    seed: int = 0,
) -> Recording:
    """Run a concrete scenario with an ADS at the ego's wheel.

    controller: a locator string, a function, a class or an object (see `sumo_eval.cosim.controller`).
    folder: where relative paths in a locator start. step_timeout: longest wall time of one controller step, s.
    seed: of what `settings.conditions` leave to chance.

    A fault of the ADS (an exception, a command that is no finite number, motion that no vehicle can do, touching SUMO's
    clock) ends the run with `end_reason` "ads_error" and a sentence in `error`, too slow a step with "ads_timeout", a
    fault of SUMO with "sim_error". What was driven until then is kept.
    """
    settings = concrete.simulation(settings or SimulationSettings())
    check_intervals(settings)
    ads = load_controller(controller, folder)
    began = clock.perf_counter()
    ego_type = ads.vtype if isinstance(ads, NativeModel) else None
    run = _Run(concrete, settings, ads, step_timeout, seed)
    run.folder = folder
    if settings.plant is not None:
        run.plant = FmuPlant(settings.plant, settings.plant.file, folder)
    if isinstance(ads, TraciProgram):
        opened = served(concrete, settings, ads, step_timeout)
    else:
        opened = session(concrete, settings, ego_type)
    try:
        with opened as traci, seen_as_traci():
            run.drive(traci)
    except ControllerTimeoutError as error:
        run.fail("ads_timeout", words_of(error, SENTENCE))
    except ControllerError as error:
        run.fail("ads_error", words_of(error, SENTENCE))
    except SimulationError as error:
        run.fail("sim_error", words_of(error, SENTENCE))
    run.log += getattr(ads, "log", "")
    return run.recording(clock.perf_counter() - began)


def check_intervals(settings: SimulationSettings) -> None:
    """SUMO rounds its step to milliseconds, and a sample falls on a step."""
    milliseconds = settings.step * 1000.0
    if round(milliseconds) < 1 or abs(milliseconds - round(milliseconds)) > 1e-6:
        raise must_be("`step`", "the simulation", "a whole number of milliseconds (SUMO rounds it)", settings.step)
    ratio = settings.record_interval / settings.step
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise must_be(
            "`record_interval`",
            "the simulation",
            f"a multiple of `step` ({settings.step:g} s)",
            settings.record_interval,
        )


@dataclass(slots=True)
class _Track:
    """Samples of one vehicle while it drives, one after the other in one list, which costs a step least: time, x, y,
    heading, speed, acceleration, and of the ego steering.
    """

    length: float
    width: float
    channels: int
    samples: list[float] = field(default_factory=list)

    def trajectory(self) -> Trajectory:
        columns = np.array(self.samples, dtype=np.float64).reshape(-1, self.channels).T
        return Trajectory(*columns, length=self.length, width=self.width)


class _Script:
    """What another vehicle's script says, and when it says no more than: straight on, at one speed."""

    __slots__ = (
        "actor", "after", "before", "begin", "end", "half_length", "length", "reach", "slides", "spans", "width",
    )  # fmt: skip

    def __init__(self, actor: Actor, step: float, ego: VehicleSettings) -> None:
        self.actor = actor
        self.length, self.width, self.slides = actor.length, actor.width, actor.slides
        self.half_length = 0.5 * actor.length
        self.reach = 0.5 * (ego.length + ego.width + actor.length + actor.width)  # m, of `first_touch`
        self.spans = scripted_spans(actor, step)
        self.begin = min((begin for begin, _ in self.spans), default=math.inf)
        self.end = max((end for _, end in self.spans), default=-math.inf)
        start = actor.start
        # x = offset + speed * time, and y, before and after everything that the script has the vehicle do
        self.before = self.after = (start.x, start.speed, start.y)
        if self.spans:
            x, speed = (start.x, start.speed) if actor.brake is None else (actor.x(self.end), 0.0)
            self.after = (x, speed, actor.y(self.end))


class _Run:
    """State of one case while it runs."""

    def __init__(
        self,
        concrete: ConcreteScenario,
        settings: SimulationSettings,
        ads: Controller,
        step_timeout: float,
        seed: int = 0,
    ) -> None:
        self.concrete = concrete
        self.settings = settings
        self.ads = ads
        self.step_timeout = step_timeout
        self.clips: dict[str, Clip] = {}
        self.collision: Collision | None = None
        self.end_reason: EndReason | None = None
        self.error: str | None = None
        self.error_place = ""
        self.folder: Path | None = None  # where the user's files lie
        self.log = ""
        self.latency_sum = 0.0
        self.latency_max = 0.0
        self.answers = 0
        self.steps = 0
        self.stood = 0.0
        vehicle, road = settings.vehicle, concrete.road
        start = concrete.ego
        self.step = settings.step
        self.limits = vehicle
        self.half_length = 0.5 * vehicle.length
        self.edges = road.right_edge, road.left_edge
        self.time = 0.0  # s, what `ego` and `actors` stand for
        self.ego = Body(start.x, start.y, 0.0, start.speed, vehicle.length, vehicle.width)
        self.lane_speed = start.speed  # m/s, the ego's as SUMO counts it, without the sideways part
        self.acceleration = 0.0
        self.state: EgoState | None = None  # while the harness's vehicle model moves the ego
        self.placed_at = (0.0, 0.0)  # m, where SUMO was told to put the front bumper's centre
        self.handed_over = False  # from the vehicle model back to SUMO, in this step
        self.vehicles: Any = None  # calls of the simulation that drives
        self.plant: FmuPlant | None = None  # in place of the single-track model
        self.actuation = Actuation(settings.conditions, self.clip)
        self.senses: Senses | None = None  # of an ADS that is shown Observations
        if isinstance(ads, ObservingController):
            stream = f"{seed}/{concrete.scenario}/{concrete.label}"
            self.senses = ads.senses = Senses(road, settings.conditions, stream)
        self.waits = hasattr(ads, "took")  # for a program that drives in its own time
        self.driver = getattr(ads, "target", getattr(ads, "function", None))  # the user's own object
        self.actors = {
            actor.name: Body(actor.start.x, actor.y(0.0), 0.0, actor.start.speed, actor.length, actor.width)
            for actor in concrete.actors
        }
        self.scripts = {actor.name: _Script(actor, settings.step, vehicle) for actor in concrete.actors}
        self.scripted_until = max((script.end for script in self.scripts.values()), default=-math.inf)
        self.tracks = {EGO: _Track(vehicle.length, vehicle.width, 7)}
        self.tracks |= {actor.name: _Track(actor.length, actor.width, 6) for actor in concrete.actors}
        self.sampled = -math.inf  # s, when last
        self.sample(0.0)

    # -- the loop ------------------------------------------------------------------------------------------------------

    def drive(self, traci: Any) -> None:
        """Step until something ends the case."""
        step = self.settings.step
        samples_every = round(self.settings.record_interval / step)
        self.vehicles = vehicles(traci)
        GUARD.begin(self.actors, step, self.settings.conditions.interference)
        try:
            self._take_charge()
            self._reset(traci)
            while self.end_reason is None:
                command = self._ask(traci, self.time)
                self._move_ego(traci, command, step)
                coming = self.time + step
                if coming < self.scripted_until:
                    self._move_actors(coming)
                traci.simulationStep()
                self.steps += 1
                self._observe(traci, self.steps * step)
                if self.end_reason is None and self.steps % samples_every == 0:
                    self.sample(self.time)
        except ControllerTimeoutError as error:
            self.fail("ads_timeout", words_of(error, SENTENCE))
        except ControllerError as error:
            self.fail("ads_error", words_of(error, SENTENCE))
        except (traci.TraCIException, traci.FatalTraCIError) as error:
            self.fail("sim_error", f"SUMO stopped at {self.time:.2f} s: {said(error)}.")
        finally:
            self._let_go("The ADS", self.ads.close, "ads_error")
            self._let_go("The ADS", GUARD.end, "ads_error")
            if self.plant is not None:
                self._let_go("The vehicle model", self.plant.close, "sim_error")
            for what, count in sorted(GUARD.touched.items()):
                self.clips[what] = Clip(what, count, 0.0, float(count), float(count))

    def _let_go(self, who: str, close: Callable[[], None], fault: EndReason) -> None:
        """Close one of the things a case holds; what goes wrong there keeps none of the others from being closed."""
        try:
            close()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - kept: sentence, place and traceback
            self._keep_traceback(error)
            sentence = f"{who} raised in close: {said(error)}."
            if self.collision is None:
                self.fail(fault, sentence)
            else:  # nobody undoes a collision by breaking down afterwards
                self.error = sentence if self.error is None else f"{self.error} {sentence}"

    def _take_charge(self) -> None:
        self.vehicles.setSpeedMode(EGO, EGO_SPEED_MODE)
        self.vehicles.setLaneChangeMode(EGO, 0)
        self.vehicles.setSpeed(EGO, -1 if isinstance(self.ads, NativeModel) else self.ego.speed)
        for actor in self.concrete.actors:
            self.vehicles.setSpeedMode(actor.name, EXACT_SPEED_MODE)
            self.vehicles.setLaneChangeMode(actor.name, 0)
            self.vehicles.setSpeed(actor.name, actor.start.speed)

    # -- the ADS -------------------------------------------------------------------------------------------------------

    def _reset(self, traci: Any) -> None:
        conditions, road = self.settings.conditions, self.concrete.road
        told = conditions.reveal_scenario
        if self.senses is None and any(getattr(conditions, what) != usual for what, usual in _SEEN_AS_IT_IS.items()):
            self.clip("perception_not_limited", 1.0, 0.0)  # TraCI shows everything
        briefing = Briefing(
            self.concrete.scenario if told else "",
            road if told else replace(road, name="road"),
            self.settings.vehicle,
            self.settings.step,
            self.concrete.values if told else None,
            self.step_timeout,
        )
        try:
            self.ads.reset(briefing, TRACI, EGO)
        except RefusedCallError as error:
            self._keep_traceback(error)
        except ControllerError as error:
            raise _fault(error, "in reset") from error
        except KeyboardInterrupt:  # the user's; an ADS's own is put in words by the watch over it
            raise
        except BaseException as error:
            self._keep_traceback(error)
            self._check_refusal(0.0)
            raise ControllerError(f"The ADS raised in reset: {said(error)}.") from error
        self._check_refusal(0.0)
        self._check_clock(traci, 0.0)

    def _ask(self, traci: Any, time: float) -> Command | None:
        """One step of the ADS: an exception, an unusable answer or a slow one is its fault, and ends the case so."""
        if self.senses is not None:
            self.senses.take_in(time, self.ego, self.acceleration, self.actors)
        asked = clock.perf_counter()
        try:
            GUARD.heard()
            answer = self.ads.step(TRACI, EGO, time)
        except RefusedCallError as error:
            self._keep_traceback(error)
            answer = None
        except ControllerError as error:  # an adapter, or the watch over the step, has put it in words
            self.latency_max = max(self.latency_max, clock.perf_counter() - asked)
            self._keep_traceback(error)
            raise _fault(error, f"at {time:.2f} s") from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._keep_traceback(error)
            self._check_refusal(time)
            raise ControllerError(f"The ADS raised at {time:.2f} s: {said(error)}.") from error
        took = clock.perf_counter() - asked
        if self.waits:
            took += self.ads.took  # type: ignore[attr-defined]
        self.answers += 1
        self.latency_sum += took
        if took > self.latency_max:
            self.latency_max = took
        if took > self.step_timeout:
            raise ControllerTimeoutError(
                f"The ADS must answer within {self.step_timeout:g} s, took longer at {time:.2f} s."
            )
        if GUARD.refusal is not None:
            self._check_refusal(time)
        self._check_clock(traci, time)
        command = None if answer is None else _checked(answer, time)
        return command if self.actuation.is_direct else self.actuation.pass_on(command, time, took)

    def _check_refusal(self, time: float) -> None:
        """An ADS that swallows the exception of a refused call has made it all the same."""
        if GUARD.refusal is not None:
            deed, why = GUARD.refusal
            raise ControllerError(f"{deed} at {time:.2f} s; {why}.")

    def _check_clock(self, traci: Any, time: float) -> None:
        """The harness alone steps, starts and closes the simulation."""
        try:
            now = traci.simulation.getTime()
        except (traci.TraCIException, traci.FatalTraCIError) as error:
            raise ControllerError(f"The ADS closed the simulation at {time:.2f} s; that is the harness's.") from error
        ahead = now - time - self.step  # SUMO has made one step more, the one that inserted the vehicles
        if abs(ahead) > _CLOCK_TOLERANCE:
            raise ControllerError(
                f"The ADS moved SUMO's clock by {ahead:+.2f} s at {time:.2f} s; stepping is the harness's."
            )

    def _keep_traceback(self, error: BaseException) -> None:
        """Traceback and place of an exception, for a log and for a table."""
        self.log = clean_log(self.log + traceback_of(error))
        self.error_place = self.error_place or fault_place(error, self.driver, self.folder)

    # -- motion --------------------------------------------------------------------------------------------------------

    def _move_ego(self, traci: Any, command: Command | None, step: float) -> None:
        """Hand the ego's next motion to SUMO; where SUMO no longer has the ego, the ADS has just taken it away."""
        try:
            if command is None:
                self._leave_to_sumo()
            else:
                self._move_by_model(command, step)
        except traci.TraCIException as error:
            raise ControllerError(
                f"After the ADS's step at {self.time:.2f} s SUMO cannot move the ego: {said(error)}."
            ) from error

    def _leave_to_sumo(self) -> None:
        if self.plant is not None:
            self.clip("vehicle_model_not_used", 1.0, 0.0)
        if self.state is not None:
            self.vehicles.setSpeedMode(EGO, EGO_SPEED_MODE)
            self.state = None
            self.handed_over = True
        elif not isinstance(self.ads, NativeModel):
            mode = self.vehicles.getSpeedMode(EGO)
            if mode != EGO_SPEED_MODE:
                self.clip("speed_mode", mode, EGO_SPEED_MODE)
                self.vehicles.setSpeedMode(EGO, EGO_SPEED_MODE)

    def _move_by_model(self, command: Command, step: float) -> None:
        before = self.state
        if before is None:
            self.vehicles.setSpeedMode(EGO, EXACT_SPEED_MODE)
            if self.steps == 0:  # it has had its hands on the wheel, and the wheel straight, from the start
                self.tracks[EGO].samples[6] = 0.0
            ego = self.ego
            before = EgoState(ego.x, ego.y, ego.heading, ego.speed, self.acceleration)
        if self.plant is None:
            state, clips = advance(before, command, self.limits, step)
        else:
            state, clips = self.plant.advance(before, command, step)
        for what, requested, applied in clips:
            self.clip(what, requested, applied)
        x, y, heading, speed, _, _ = state
        self.vehicles.setSpeed(EGO, speed)
        self.placed_at = _place(self.vehicles, EGO, x, y, heading, self.half_length)
        self.state = state

    def _move_actors(self, time: float) -> None:
        """Scripted motion of those that have any to do at a time."""
        for script in self.scripts.values():
            for begin, end in script.spans:
                if begin < time < end:
                    self._move_actor(script.actor, time)
                    break

    def _move_actor(self, actor: Actor, time: float) -> None:
        """Scripted motion at a time within one of the actor's spans."""
        if actor.name not in self.actors:
            return
        speed, heading = actor.speed(time), 0.0
        if not actor.slides:
            across = actor.lateral_speed(time)
            speed, heading = math.hypot(speed, across), math.atan2(across, speed)
        self.vehicles.setSpeed(actor.name, speed)
        _place(self.vehicles, actor.name, actor.x(time), actor.y(time), heading, 0.5 * actor.length)

    # -- observation ---------------------------------------------------------------------------------------------------

    def _observe(self, traci: Any, now: float) -> None:
        """Read every vehicle at the end of the step, and see whether anything touched the ego or ended the case."""
        was, before = self.ego, self.actors
        body = self._read_placed_ego() if self.state is not None else self._read_driven_ego(now)
        was_x, was_y = was.x, was.y
        moved_x, moved_y = body.x - was_x, body.y - was_y
        actors: dict[str, Body] = {}
        touched: tuple[float, str] | None = None
        for name, last in before.items():
            script = self.scripts[name]
            try:
                x, y, heading, speed = _read(self.vehicles, name, script.half_length)
            except traci.TraCIException:
                self.clip("actor_left_the_network", now, now)
                continue
            across = script.actor.lateral_speed(now) if script.slides and script.begin <= now <= script.end else 0.0
            other = _tuple(Body, (x, y, heading, speed, script.length, script.width, across))
            actors[name] = other
            last_x, last_y = last.x, last.y
            shift_x, shift_y = (x - last_x) - moved_x, (y - last_y) - moved_y
            reach = script.reach + abs(shift_x) + abs(shift_y)
            if abs(last_x - was_x) > reach or abs(last_y - was_y) > reach:
                continue  # as `first_touch` would say, at less cost
            share = first_touch(was, body, last, other)
            if share is not None and (touched is None or share < touched[0]):
                touched = share, name
        if touched is None:
            self.time, self.ego, self.actors = now, body, actors
            self._check_end()
            return
        share, name = touched
        self.time += share * self.step
        self.ego = between(was, body, share)
        self.actors = {other: between(before[other], after, share) for other, after in actors.items()}
        self.collision = describe(self.time, name, self.ego, self.actors[name])
        self.end("contact")

    def _check_end(self) -> None:
        ego, settings = self.ego, self.settings
        self.stood = self.stood + self.step if ego.speed < settings.standstill_speed else 0.0
        right_edge, left_edge = self.edges
        if not right_edge <= ego.y <= left_edge:
            self.end("off_road")
        elif ego.x >= self.concrete.road.length:
            self.end("road_end")
        elif self.stood >= settings.standstill_time - 1e-9:
            self.end("standstill")
        elif self.time >= settings.time_limit - 1e-9:
            self.end("time_limit")
        elif settings.end_when_decided and self._is_decided():
            self.end("decided")

    def _is_decided(self) -> bool:
        """Whether nothing can come of the case any more: scripts are over, the ADS says that it is settled, and at the
        present speeds nothing comes nearer.
        """
        ego = self.ego
        if self.acceleration != 0.0 or ego.heading != 0.0 or self.time < self.scripted_until:
            return False
        settled = getattr(self.driver, "settled", None)
        if settled is None or not settled():
            return False
        return all(keeps_apart(ego, other) for other in self.actors.values())

    def _read_placed_ego(self) -> Body:
        """The ego as the vehicle model moved it; SUMO must show the same."""
        assert self.state is not None
        x, y, heading, speed, self.acceleration, _ = self.state
        self.lane_speed = speed
        body = _tuple(Body, (x, y, heading, speed, self.limits.length, self.limits.width, 0.0))
        x, y = self.vehicles.getPosition(EGO)
        front_x, front_y = self.placed_at
        if abs(x - front_x) > _PLACE_TOLERANCE or abs(y - front_y) > _PLACE_TOLERANCE:
            raise SimulationError(
                f"SUMO put the ego's front bumper at ({x:.3f}, {y:.3f}) m instead of ({front_x:.3f}, {front_y:.3f}) m."
            )
        return body

    def _read_driven_ego(self, now: float) -> Body:
        """The ego as SUMO moved it, with its ground speed: SUMO counts the motion along and across the lane apart."""
        body = Body(*_read(self.vehicles, EGO, self.half_length), self.limits.length, self.limits.width)
        self._check_native_motion(body, now)
        self.acceleration = (body.speed - self.lane_speed) / self.step
        self.lane_speed = body.speed
        if self.handed_over:
            self.handed_over = False
            if abs(body.heading - self.ego.heading) > 1e-3:
                self.clip("heading", self.ego.heading, body.heading)
        across = self.vehicles.getLateralSpeed(EGO)
        return body._replace(speed=math.hypot(body.speed, across)) if across else body

    def _check_native_motion(self, body: Body, now: float) -> None:
        """TraCI calls can move the ego in ways no vehicle can. `body` has the speed along the lane."""
        step, speed, lane_speed = self.step, body.speed, self.lane_speed
        gained = (speed - lane_speed) / step
        lowest, highest = -self.limits.max_deceleration, self.limits.max_acceleration
        if not lowest - _LIMIT_TOLERANCE <= gained <= highest + _LIMIT_TOLERANCE:
            self._unphysical(
                "unphysical_acceleration", gained, min(max(gained, lowest), highest),
                f"The ADS must drive its vehicle within {lowest:g}..{highest:g} m/s2, "
                f"got {gained:.1f} m/s2 at {now:.2f} s.",
            )  # fmt: skip
        elif not lowest + _LIMIT_TOLERANCE <= gained <= highest - _LIMIT_TOLERANCE:
            self.clip("vtype_limit", gained, gained)
        (x, y), (last_x, last_y) = _front(body), _front(self.ego)
        ahead, across = x - last_x, y - last_y
        slower, faster = (speed, lane_speed) if speed < lane_speed else (lane_speed, speed)
        least, most = slower * step - _JUMP_TOLERANCE, faster * step + _JUMP_TOLERANCE
        if least <= ahead <= most and abs(across) <= _SIDEWAYS_SPEED * step:
            return
        moved = math.hypot(ahead, across)
        if not least <= moved <= most:
            self._unphysical(
                "jump", moved, min(max(moved, least), most),
                f"The ADS moved its vehicle {moved:.2f} m in a step that its speed makes "
                f"{max(least, 0.0):.2f}..{most:.2f} m long, at {now:.2f} s (moveToXY needs a setSpeed to go with it).",
            )  # fmt: skip

    def _unphysical(self, what: str, requested: float, possible: float, sentence: str) -> None:
        """An ADS is refused what no vehicle can do; of SUMO's own models it is put on record."""
        if not isinstance(self.ads, NativeModel):
            raise ControllerError(sentence)
        self.clip(what, requested, possible)

    # -- records -------------------------------------------------------------------------------------------------------

    def clip(self, what: str, requested: float, applied: float) -> None:
        """Count a clip and keep its worst instance."""
        count_clip(self.clips, what, self.steps * self.step, requested, applied)

    def sample(self, time: float) -> None:
        """Record every vehicle as it is now."""
        if time - self.sampled < 1e-9:
            return
        self.sampled = time
        steering = math.nan if self.state is None else self.state.steering_wheel_angle
        x, y, heading, speed, _, _, _ = self.ego
        self.tracks[EGO].samples.extend((time, x, y, heading, speed, self.acceleration, steering))
        for name, body in self.actors.items():
            x, y, heading, speed, _, _, _ = body
            script = self.scripts[name]
            if script.begin <= time <= script.end:
                acceleration = script.actor.acceleration(time)
                self._check_actor(script.actor, body, time)
            else:
                acceleration = 0.0
                offset, pace, across = script.before if time < script.begin else script.after
                if abs(x - offset - pace * time) > _NEAR or abs(y - across) > _NEAR:
                    self._check_actor(script.actor, body, time)
            self.tracks[name].samples.extend((time, x, y, heading, speed, acceleration))

    def _check_actor(self, actor: Actor, body: Body, time: float) -> None:
        """Whatever way an ADS found to another vehicle, the vehicle then is not where its script has it."""
        ahead, left = body.x - actor.x(time), body.y - actor.y(time)
        if abs(ahead) > _NEAR or abs(left) > _NEAR:
            off = math.hypot(ahead, left)
            if off > _SCRIPT_TOLERANCE:
                self.clip("actor_off_its_script", 0.0, off)

    def end(self, reason: EndReason) -> None:
        """The case is over."""
        self.end_reason = reason
        self.sample(self.time)

    def fail(self, reason: EndReason, sentence: str) -> None:
        """The case could not be brought to its end."""
        self.end(reason)
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
            error=None if self.error is None else clean(self.error),
            log=clean_log(self.log),
            controller_latency=(self.latency_sum / max(self.answers, 1), self.latency_max),
            wall_time=wall_time,
            error_place=self.error_place,
        )


def scripted_spans(actor: Actor, step: float) -> list[tuple[float, float]]:
    """Between which times the harness moves an actor; straight on at constant speed, or standing, SUMO does."""
    spans = [(move.begin, move.begin + move.duration + step) for move in actor.lane_changes]
    if actor.brake is not None:
        spans.append((actor.brake.begin, actor.brake.end(actor.start.speed) + step))
    return spans


def _fault(error: ControllerError, when: str) -> ControllerError:
    """What an adapter, or the watch over a step, has put in words, with the time. The class may be the user's own."""
    kind = ControllerTimeoutError if isinstance(error, ControllerTimeoutError) else ControllerError
    return kind(f"{words_of(error, _LONGEST_WORDS)} {when}.")


def _checked(answer: object, time: float) -> Command:
    """The ADS's answer, if it is a command that a vehicle can be given."""
    if not isinstance(answer, Command):
        raise ControllerError(f"The ADS must return a Command or None, got {type(answer).__name__} at {time:.2f} s.")
    acceleration, steering = answer.acceleration, answer.steering
    if type(acceleration) is float and type(steering) is float and math.isfinite(acceleration + steering):
        return answer
    for name, value in (("acceleration", acceleration), ("steering", steering)):
        if isinstance(value, bool) or not isinstance(value, numbers.Real) or not math.isfinite(value):
            raise ControllerError(
                f"`{name}` of the ADS's Command must be a finite number, got {shown(value)} at {time:.2f} s."
            )
    return Command(float(acceleration), float(steering))


def _read(vehicle: Any, name: str, half_length: float) -> tuple[float, float, float, float]:
    """A vehicle's centre, heading and speed from SUMO, which reports the front bumper's centre and an angle clockwise
    from north.
    """
    x, y = vehicle.getPosition(name)
    angle = vehicle.getAngle(name)
    if angle == 90.0:  # along the road, exactly: nearly every vehicle nearly always
        return x - half_length, y, 0.0, vehicle.getSpeed(name)
    heading = math.remainder(math.radians(90.0 - angle), math.tau)
    x, y = x - half_length * math.cos(heading), y - half_length * math.sin(heading)
    return x, y, heading, vehicle.getSpeed(name)


def _front(body: Body) -> tuple[float, float]:
    """Centre of the front bumper, m."""
    half = 0.5 * body.length
    if body.heading == 0.0:
        return body.x + half, body.y
    return body.x + half * math.cos(body.heading), body.y + half * math.sin(body.heading)


def _place(vehicle: Any, name: str, x: float, y: float, heading: float, half_length: float) -> tuple[float, float]:
    """Put a vehicle's centre somewhere at the end of the coming step; where that has its front bumper's centre, m."""
    if heading == 0.0:
        x, y, angle = x + half_length, y + heading, 90.0
    else:
        x, y = x + half_length * math.cos(heading), y + half_length * math.sin(heading)
        angle = 90.0 - math.degrees(heading)
    vehicle.moveToXY(name, "", -1, x, y, angle, 2)
    return x, y
