"""Many cases in one simulation: SUMO steps them together, and a vectorised controller drives all egos with one call.

A pack holds cases on the same road with the same settings and as many other vehicles, whose vehicles all keep their
heading (an ADS that steers, or a lane change that turns the body, is simulated alone). Every recording is bit for bit
what `simulate` gives for that case, but for the wall times. A case that leaves the ordinary course (its controller asks
for the impossible, SUMO loses a vehicle) leaves the pack and is simulated alone, so that it costs only itself and ends
in the words of `simulate`; when the pack as a whole fails, each of its cases is.
"""

from __future__ import annotations

import logging
import math
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.clips import count_clip
from sumo_eval.cosim.contact import Body, between, describe, first_touch
from sumo_eval.cosim.controller import Briefing, ControllerLike, ObjectController, load_controller
from sumo_eval.cosim.packed_files import edge_name, packed_network_xml, packed_routes_xml, vehicle_name
from sumo_eval.cosim.session import packed_session
from sumo_eval.cosim.simulate import EXACT_SPEED_MODE, scripted_spans, simulate
from sumo_eval.cosim.vehicle_model import GRAVITY, Command, EgoState, advance
from sumo_eval.errors import ControllerTimeoutError
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, ConstantLateral
from sumo_eval.settings import ConditionSettings, SimulationSettings, VehicleSettings
from sumo_eval.trajectory import BoolArray, Clip, Collision, EndReason, FloatArray, Recording, Trajectory

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)

SORTED_AT_ONCE = 4096  # cases whose recordings are held until those before them are there
CHECKED_EVERY = 10  # steps after which SUMO must show every ego where the vehicle model has it
PACK = 256  # cases in one simulation: enough that a step's fixed cost is shared, few enough that stragglers are
_PLACE_TOLERANCE = 1e-3  # m, between the vehicle model and SUMO
_STEADY = 1e-12  # m/s2, accelerations closer than this are one, as in the vehicle model


class PackedScene(NamedTuple):
    """What a sensor of each ego sees, as in `ads.perception`: n cases, m other vehicles each; m and m/s.

    x, y, speed: of the ego, (n,). other_x, other_y, other_speed: along the road, (n, m). half_length, half_width: of
    the ego. other_half_length, other_half_width: (n, m). Every heading is 0.
    """

    x: FloatArray
    y: FloatArray
    speed: FloatArray
    other_x: FloatArray
    other_y: FloatArray
    other_speed: FloatArray
    half_length: float
    half_width: float
    other_half_length: FloatArray
    other_half_width: FloatArray


class PackedController(Protocol):
    """A controller that keeps its wheel straight, for n cases at once."""

    def step(self, scene: PackedScene, time: float) -> FloatArray:
        """Acceleration of each ego for the coming step, (n,) m/s2; nan: this case has to be simulated alone."""

    def settled(self) -> BoolArray:
        """Where it brakes for nothing, nor is about to, (n,)."""


def simulate_many(
    cases: Sequence[ConcreteScenario],
    controller: ControllerLike,
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = math.inf,
) -> Iterator[Recording]:
    """Recordings of concrete scenarios driven by one ADS, in their order; arguments and errors as in `simulate`.

    controller: a locator, a class or a function, so that every case gets a fresh one. Cases that follow each other are
    packed where the ADS has a packed form (`packed(briefing)` of an object, None where it has none) and the case allows
    it; the others are simulated one by one. An object that is given ready-made serves all cases one after the other.
    """
    together = simulate_packed(cases, controller, settings, folder=folder, step_timeout=step_timeout)
    for concrete, recording in zip(cases, together, strict=True):
        if recording is None:
            yield simulate(concrete, controller, settings, folder=folder, step_timeout=step_timeout)
        else:
            yield recording


def simulate_packed(
    cases: Sequence[ConcreteScenario],
    controller: ControllerLike,
    settings: SimulationSettings | None = None,
    *,
    folder: Path | None = None,
    step_timeout: float = math.inf,
) -> Iterator[Recording | None]:
    """As `simulate_many`, but for the cases that have to be simulated alone: None, for the caller to see to them."""
    basis = settings or SimulationSettings()
    packed_form = _packed_form(controller, folder)
    as_usual = basis.plant is None and basis.conditions == ConditionSettings()

    def kind(concrete: ConcreteScenario) -> tuple[object, ...] | None:
        if packed_form is None or not _keeps_headings(concrete) or not as_usual or concrete.road.network is not None:
            return None
        return concrete.scenario, concrete.road, concrete.ego_body, concrete.time_limit, len(concrete.actors)

    for key, group in groupby(cases, key=kind):
        for members in _chunks(list(group), SORTED_AT_ONCE):
            recordings: list[Recording | None] = [None] * len(members)
            if key is not None:
                resolved = members[0].simulation(basis)
                order = sorted(range(len(members)), key=lambda index: first_meeting(members[index]))
                for part in _chunks(order, PACK):
                    found = _packed([members[index] for index in part], packed_form, resolved, step_timeout)
                    for index, recording in zip(part, found, strict=True):
                        recordings[index] = recording
            yield from recordings


def _chunks(items: list[_T], size: int) -> Iterator[list[_T]]:
    return (items[begin : begin + size] for begin in range(0, len(items), size))


def first_meeting(concrete: ConcreteScenario) -> float:
    """About when the ego reaches another vehicle if nobody does anything, s: cases that end together share a pack."""
    ego = concrete.ego
    times = [
        (actor.start.x - ego.x) / (ego.speed - actor.start.speed)
        for actor in concrete.actors
        if ego.speed > actor.start.speed
    ]
    return min(times, default=math.inf)


def _packed_form(controller: ControllerLike, folder: Path | None) -> Any:
    """What makes the packed form of an ADS from a briefing; None where it has none."""
    ads = load_controller(controller, folder)
    target = ads.target if isinstance(ads, ObjectController) else getattr(ads, "function", None)
    return getattr(target, "packed", None)


def _keeps_headings(concrete: ConcreteScenario) -> bool:
    road = concrete.road
    inside = road.right_edge <= concrete.ego.y <= road.left_edge
    return inside and bool(concrete.actors) and all(a.slides or not a.lane_changes for a in concrete.actors)


def _packed(
    cases: Sequence[ConcreteScenario], packed_form: Any, settings: SimulationSettings, step_timeout: float
) -> Sequence[Recording | None]:
    """The recording of each case; None for a case that has to be simulated alone."""
    briefing = Briefing(cases[0].scenario, cases[0].road, settings.vehicle, settings.step)
    controller = packed_form(briefing)
    if controller is None:
        return [None] * len(cases)
    began = clock.perf_counter()
    pack = _Pack(cases, settings, controller)
    try:
        network = packed_network_xml(cases[0].road, len(cases))
        with packed_session(network, packed_routes_xml(cases, settings.vehicle), settings) as traci:
            pack.drive(traci, step_timeout)
    except Exception:  # noqa: BLE001 - logged in full, and each case is simulated alone
        _LOG.exception("A pack of %d cases failed; each of them is simulated alone.", len(cases))
        return [None] * len(cases)
    return pack.recordings(clock.perf_counter() - began)


def _only_slides(actor: Actor) -> bool:
    """Whether an actor's whole script is one move across at constant speed, the cut-in of UN R157."""
    return actor.brake is None and len(actor.lane_changes) == 1 and isinstance(actor.lane_changes[0], ConstantLateral)


class _Slides:
    """Actors of a pack whose script is one `ConstantLateral`, moved with one computation."""

    def __init__(self, actors: Sequence[tuple[int, int, Actor]]) -> None:
        self.actors = actors
        moves = [actor.lane_changes[0] for _, _, actor in actors]
        self.at = np.array([case for case, _, _ in actors], dtype=np.intp), np.array([j for _, j, _ in actors], np.intp)
        self.start_x, self.start_y, self.along, self.half = np.array(
            [(a.start.x, a.start.y, a.start.speed, 0.5 * a.length) for _, _, a in actors]
        ).reshape(-1, 4).T  # fmt: skip
        self.begin, self.duration, self.speed, self.offset = np.array(
            [(m.begin, m.duration, m.speed, m.offset) for m in moves if isinstance(m, ConstantLateral)]
        ).reshape(-1, 4).T  # fmt: skip

    def places(self, time: float, step: float) -> list[tuple[int, int, float, float]]:
        """Case, index, x of the front bumper and y of those that are moving at a time."""
        moving = np.flatnonzero((self.begin < time) & (time < self.begin + self.duration + step))
        done = np.minimum(np.maximum(time - self.begin[moving], 0.0) * self.speed[moving], np.abs(self.offset[moving]))
        y = self.start_y[moving] + np.copysign(done, self.offset[moving])
        front = self.start_x[moving] + self.along[moving] * time + self.half[moving]
        cases, indexes = self.at[0][moving], self.at[1][moving]
        return list(zip(cases.tolist(), indexes.tolist(), front.tolist(), y.tolist(), strict=True))

    def lateral_speed(self, time: float) -> FloatArray:
        """As `ConstantLateral.lateral_speed`."""
        moving = (time - self.begin >= 0.0) & (time - self.begin < self.duration)
        return np.where(moving, np.copysign(self.speed, self.offset), 0.0)

    def without(self, cases: NDArray[np.intp]) -> _Slides:
        """Those of the other cases."""
        stays = ~np.isin(self.at[0], cases)
        return self if stays.all() else _Slides([one for one, kept in zip(self.actors, stays, strict=True) if kept])


@dataclass(slots=True)
class _End:
    """How a case ended: when, why, and where everything was."""

    time: float
    reason: EndReason
    collision: Collision | None
    ego: tuple[float, ...]
    others: Sequence[tuple[float, ...]]


class _Pack:
    """State of all cases of a pack while they run; arrays (n,) for the egos and (n, m) for the others."""

    def __init__(
        self, cases: Sequence[ConcreteScenario], settings: SimulationSettings, controller: PackedController
    ) -> None:
        self.cases, self.settings, self.controller = cases, settings, controller
        n, m = len(cases), len(cases[0].actors)
        vehicle = settings.vehicle
        self.actors = [case.actors for case in cases]
        self.egos = [vehicle_name(case, 0) for case in range(n)]
        self.names = [[vehicle_name(case, 1 + index) for index in range(m)] for case in range(n)]
        self.x, self.y, self.speed = np.array([(c.ego.x, c.ego.y, c.ego.speed) for c in cases], dtype=np.float64).T
        self.acceleration = np.zeros(n)
        self.sensed_x = self.x.copy()
        self.other_x = np.array([[a.start.x for a in row] for row in self.actors], dtype=np.float64)
        self.other_y = np.array([[a.y(0.0) for a in row] for row in self.actors], dtype=np.float64)
        self.other_speed = np.array([[a.start.speed for a in row] for row in self.actors], dtype=np.float64)
        self.other_length = np.array([[a.length for a in row] for row in self.actors], dtype=np.float64)
        self.other_width = np.array([[a.width for a in row] for row in self.actors], dtype=np.float64)
        self.size = 0.5 * (vehicle.length + vehicle.width + self.other_length + self.other_width)
        self.front = 0.5 * vehicle.length
        self.other_front = 0.5 * self.other_length
        self.across = np.zeros((n, m))  # m/s, of actors that slide
        self.stood = np.zeros(n)
        self.live = np.arange(n)
        self.ends: list[_End | None] = [None] * n
        self.clips: list[dict[str, Clip]] = [{} for _ in cases]
        self.left = np.zeros(n, dtype=bool)  # the pack, to be simulated alone
        self.samples: list[tuple[float, FloatArray, FloatArray]] = []
        self.steps = 0
        self.latency: list[float] = []
        grip = vehicle.friction * GRAVITY
        self.strongest = min(vehicle.max_deceleration, grip)
        scripts = [
            (case, index, actor, spans)
            for case, row in enumerate(self.actors)
            for index, actor in enumerate(row)
            if (spans := scripted_spans(actor, settings.step))
        ]
        self.scripts = [script for script in scripts if not _only_slides(script[2])]
        self.slides = _Slides([(case, index, actor) for case, index, actor, _ in scripts if _only_slides(actor)])
        self.scripted_until = np.array(
            [max((end for a in row for _, end in scripted_spans(a, settings.step)), default=0.0) for row in self.actors]
        )
        self.was_speed = self.speed
        self.was_across = self.across
        self.first_look = self.other_x, self.other_y, self.other_speed  # as SUMO shows them

    def drive(self, traci: Any, step_timeout: float) -> None:
        """Step until every case has ended."""
        step = self.settings.step
        samples_every = round(self.settings.record_interval / step)
        self._take_charge(traci)
        self._sample(0.0)
        while self.live.size:
            time = self.steps * step
            asked = clock.perf_counter()
            wanted = self.controller.step(self._scene(), time)
            took = clock.perf_counter() - asked
            self.latency.append(took / self.live.size)
            if took > step_timeout:
                raise ControllerTimeoutError("The pack's controller took too long.")
            before, self.was_speed, self.was_across = self.x.copy(), self.speed.copy(), self.across.copy()
            self._move_egos(traci, wanted)
            self._move_actors(traci, time + step)
            traci.simulationStep()
            self.steps += 1
            self._observe(traci, before, sampled=self.steps % samples_every == 0)

    def _scene(self) -> PackedScene:
        vehicle = self.settings.vehicle
        others = self.first_look if self.steps == 0 else (self.other_x, self.other_y, self.other_speed)
        return PackedScene(
            self.sensed_x, self.y, self.speed, *others,
            0.5 * vehicle.length, 0.5 * vehicle.width, 0.5 * self.other_length, 0.5 * self.other_width,
        )  # fmt: skip

    def _take_charge(self, traci: Any) -> None:
        vehicle = traci.vehicle
        seen: list[tuple[float, float, float]] = []
        for case, concrete in enumerate(self.cases):
            starts = [(self.egos[case], concrete.ego, self.settings.vehicle.length)]
            starts += [(name, a.start, a.length) for name, a in zip(self.names[case], concrete.actors, strict=True)]
            for name, start, length in starts:
                x, y = vehicle.getPosition(name)
                if abs(x - 0.5 * length - start.x) > _PLACE_TOLERANCE or abs(y - start.y) > _PLACE_TOLERANCE:
                    self.left[case] = True
                if name != self.egos[case]:
                    seen.append((x - 0.5 * length, y, vehicle.getSpeed(name)))
                vehicle.setSpeedMode(name, EXACT_SPEED_MODE)
                vehicle.setLaneChangeMode(name, 0)
                vehicle.setSpeed(name, start.speed)
            self.sensed_x[case] = vehicle.getPosition(self.egos[case])[0] - self.front
        shape = self.other_x.shape
        x, y, speed = np.array(seen, dtype=np.float64).T
        self.first_look = x.reshape(shape), y.reshape(shape), speed.reshape(shape)
        self._forget(traci, np.flatnonzero(self.left))

    # -- motion --------------------------------------------------------------------------------------------------------

    def _move_egos(self, traci: Any, wanted: FloatArray) -> None:
        """The vehicle model for every ego: at once where the acceleration stays, else with the model itself."""
        step, limits = self.settings.step, self.settings.vehicle
        live = self.live
        target, a, v = wanted[live], self.acceleration[live], self.speed[live]
        lost = ~np.isfinite(target)
        steady = (
            (np.abs(a - target) < _STEADY) & (target <= 0.0) & (target >= -self.strongest) & (v <= limits.max_speed)
        )
        # first time at which v + a t is 0, as the model computes it
        stops = np.divide(2.0 * v, np.sqrt(a * a) - a, out=np.full(len(a), np.inf), where=a < 0.0) <= step
        steady &= ~stops
        moved = v * step + 0.5 * a * step**2 + 0.0
        new_speed = np.maximum(v + a * step + 0.0, 0.0)
        rows = live[steady]
        changed = rows[new_speed[steady] != v[steady]]
        self.x[rows] = self.x[rows] + moved[steady]
        self.speed[rows] = new_speed[steady]
        self.acceleration[rows] = target[steady]
        set_speed = traci.vehicle.setSpeed
        for case in changed.tolist():
            set_speed(self.egos[case], float(self.speed[case]))
        for case in live[~steady & ~lost].tolist():
            state = EgoState(
                float(self.x[case]),
                float(self.y[case]),
                0.0,
                float(self.speed[case]),
                float(self.acceleration[case]),
                0.0,
            )
            after, clips = advance(state, Command(float(wanted[case])), limits, step)
            for what, requested, applied in clips:
                count_clip(self.clips[case], what, self.steps * step, requested, applied)
            self.x[case], self.speed[case], self.acceleration[case] = after.x, after.speed, after.acceleration
            set_speed(self.egos[case], after.speed)
            # SUMO's own motion within a step is not the model's while the acceleration changes
            traci.vehicle.moveToXY(self.egos[case], edge_name(case), 0, after.x + self.front, after.y, 90.0, 3)
        self.sensed_x[live] = (self.x[live] + self.front) - self.front
        if lost.any():
            self.left[live[lost]] = True
            self._forget(traci, live[lost])

    def _move_actors(self, traci: Any, time: float) -> None:
        """Scripted motion, as in `simulate`; straight on at constant speed, or standing, SUMO moves the vehicle."""
        vehicle = traci.vehicle
        for case, index, actor, spans in self.scripts:
            if self.ends[case] is None and any(begin < time < end for begin, end in spans):
                name = self.names[case][index]
                vehicle.setSpeed(name, actor.speed(time))
                x = actor.x(time) + 0.5 * actor.length
                vehicle.moveToXY(name, edge_name(case), 0, x, actor.y(time), 90.0, 3)
        for case, index, front, y in self.slides.places(time, self.settings.step):
            vehicle.moveToXY(self.names[case][index], edge_name(case), 0, front, y, 90.0, 3)

    # -- observation ---------------------------------------------------------------------------------------------------

    def _observe(self, traci: Any, before: FloatArray, *, sampled: bool) -> None:
        step, road, settings = self.settings.step, self.cases[0].road, self.settings
        now, previous = self.steps * step, (self.steps - 1) * step
        live = self.live
        was_x, was_y, was_speed = self.other_x.copy(), self.other_y.copy(), self.other_speed.copy()
        for case, index, actor, _ in self.scripts:
            if actor.slides:
                self.across[case, index] = actor.lateral_speed(now)
        self.across[self.slides.at] = self.slides.lateral_speed(now)
        position, speed = traci.vehicle.getPosition, traci.vehicle.getSpeed
        names = [name for case in live.tolist() for name in self.names[case]]
        places = np.array([position(name) for name in names]).reshape(len(live), -1, 2)
        self.other_x[live] = places[:, :, 0] - self.other_front[live]
        self.other_y[live] = places[:, :, 1]
        self.other_speed[live] = np.array([speed(name) for name in names]).reshape(len(live), -1)

        shift_x = (self.other_x - was_x) - (self.x - before)[:, None]
        shift_y = self.other_y - was_y
        reach = self.size + np.abs(shift_x) + np.abs(shift_y)
        near = (np.abs(was_x - before[:, None]) <= reach) & (np.abs(was_y - self.y[:, None]) <= reach)
        ended: list[int] = []
        for case in live[near[live].any(axis=1)].tolist():
            poses = [
                (
                    _body(was_x[case, j], was_y[case, j], was_speed[case, j], a, self.was_across[case, j]),
                    _body(
                        self.other_x[case, j], self.other_y[case, j], self.other_speed[case, j], a, self.across[case, j]
                    ),
                )
                for j, a in enumerate(self.actors[case])
            ]
            if self._touches(case, before, poses, previous):
                ended.append(case)
        standing = self.speed < settings.standstill_speed
        self.stood[live] = np.where(standing[live], self.stood[live] + step, 0.0)
        over = (self.x >= road.length) | (self.stood >= settings.standstill_time - 1e-9)
        over |= now >= settings.time_limit - 1e-9
        decided = np.zeros(len(over), dtype=bool)
        if settings.end_when_decided:
            decided = ~over & (self.scripted_until <= now) & (self.acceleration == 0.0) & self.controller.settled()
            decided[live] &= self._keep_apart(live)
        touched = set(ended)
        for case in live[(over | decided)[live]].tolist():
            if case in touched:
                continue
            reason: EndReason = "decided"
            if self.x[case] >= road.length:
                reason = "road_end"
            elif self.stood[case] >= settings.standstill_time - 1e-9:
                reason = "standstill"
            elif not decided[case]:
                reason = "time_limit"
            others = [
                (self.other_x[case, j], self.other_y[case, j], 0.0, self.other_speed[case, j], a.acceleration(now))
                for j, a in enumerate(self.actors[case])
            ]
            ego = (self.x[case], self.y[case], 0.0, self.speed[case], self.acceleration[case], 0.0)
            self.ends[case] = _End(now, reason, None, ego, others)
            ended.append(case)
        if self.steps % CHECKED_EVERY == 0:
            self._check_places(traci)
        if sampled:
            self._sample(now)
        if ended:
            self._forget(traci, np.array(ended))

    def _touches(self, case: int, before: FloatArray, poses: list[tuple[Body, Body]], previous: float) -> bool:
        """Whether something touches the ego within the step; then the case has ended."""
        vehicle, step = self.settings.vehicle, self.settings.step
        was = _body(before[case], self.y[case], self.was_speed[case], vehicle)
        body = _body(self.x[case], self.y[case], self.speed[case], vehicle)
        hits = [(share, j) for j, (a, b) in enumerate(poses) if (share := first_touch(was, body, a, b)) is not None]
        if not hits:
            return False
        share, struck = min(hits)
        time = previous + share * step
        ego = between(was, body, share)
        there = [between(a, b, share) for a, b in poses]
        hit = describe(time, self.actors[case][struck].name, ego, there[struck])
        others = [
            (other.x, other.y, other.heading, other.speed, actor.acceleration(time))
            for other, actor in zip(there, self.actors[case], strict=True)
        ]
        row = (ego.x, ego.y, ego.heading, ego.speed, self.acceleration[case], 0.0)
        self.ends[case] = _End(time, "contact", hit, row, others)
        return True

    def _keep_apart(self, rows: NDArray[np.intp]) -> BoolArray:
        """`contact.keeps_apart` for all the others of some cases, (k,)."""
        vehicle = self.settings.vehicle
        ahead = self.other_x[rows] - self.x[rows][:, None]
        length = 0.5 * vehicle.length + 0.5 * self.other_length[rows]
        beside = np.abs(self.other_y[rows] - self.y[rows][:, None]) >= (
            0.5 * vehicle.width + 0.5 * self.other_width[rows]
        )
        slower = self.other_speed[rows] <= self.speed[rows][:, None]
        faster = self.other_speed[rows] >= self.speed[rows][:, None]
        apart = beside | ((ahead >= length) & faster) | ((-ahead >= length) & slower)
        return np.asarray((apart & (self.across[rows] == 0.0)).all(axis=1))

    # -- records -------------------------------------------------------------------------------------------------------

    def _check_places(self, traci: Any) -> None:
        """SUMO must show every ego where the vehicle model has it; a case in which it does not leaves the pack."""
        position = traci.vehicle.getPosition
        places = np.array([position(self.egos[case]) for case in self.live.tolist()])
        off = np.abs(places[:, 0] - self.x[self.live] - self.front) > _PLACE_TOLERANCE
        off |= np.abs(places[:, 1] - self.y[self.live]) > _PLACE_TOLERANCE
        if off.any():
            gone = self.live[off]
            self.left[gone] = True
            self._forget(traci, gone)

    def _sample(self, time: float) -> None:
        """Record every vehicle as it is now."""
        ego = np.stack((self.x, self.y, self.speed, self.acceleration))
        braking = np.zeros(self.other_x.shape)
        for case, index, actor, _ in self.scripts:
            braking[case, index] = actor.acceleration(time)
        self.samples.append((time, ego, np.stack((self.other_x, self.other_y, self.other_speed, braking))))

    def _forget(self, traci: Any, cases: NDArray[np.intp]) -> None:
        """Take the vehicles of cases that have ended off their roads."""
        if not cases.size:
            return
        for case in cases.tolist():
            for name in (self.egos[case], *self.names[case]):
                traci.vehicle.remove(name)
        self.live = self.live[~np.isin(self.live, cases)]
        self.slides = self.slides.without(cases)
        gone = set(cases.tolist())
        self.scripts = [script for script in self.scripts if script[0] not in gone]

    def recordings(self, wall_time: float) -> list[Recording | None]:
        """What each case left behind; None for those that left the pack."""
        times = np.array([*(time for time, _, _ in self.samples), np.inf])
        # one row more, for the end of the longest
        egos = np.stack([ego for _, ego, _ in (*self.samples, self.samples[-1])])  # (samples + 1, 4, n)
        others = np.stack([other for _, _, other in (*self.samples, self.samples[-1])])  # (samples + 1, 4, n, m)
        mean, longest = float(np.mean(self.latency)), float(np.max(self.latency))
        found: list[Recording | None] = []
        for case, end in enumerate(self.ends):
            if end is None or self.left[case]:
                found.append(None)
                continue
            last = int(np.searchsorted(times, end.time - 1e-9))
            own_times = times[: last + 1].copy()
            own_times[last] = end.time
            ego = _trajectory(own_times, egos[: last + 1, :, case], end.ego, self.settings.vehicle)
            actors = {
                actor.name: _trajectory(own_times, others[: last + 1, :, case, j], end.others[j], actor)
                for j, actor in enumerate(self.actors[case])
            }
            clips = tuple(self.clips[case][what] for what in sorted(self.clips[case]))
            found.append(
                Recording(
                    ego, actors, end.collision, end.reason, clips,
                    controller_latency=(mean, longest), wall_time=wall_time / len(self.ends),
                )
            )  # fmt: skip
        return found


def _body(
    x: np.float64, y: np.float64, speed: np.float64, of: VehicleSettings | Actor, across: np.float64 | float = 0.0
) -> Body:
    return Body(float(x), float(y), 0.0, float(speed), of.length, of.width, float(across))


def _trajectory(
    times: FloatArray, samples: FloatArray, end: tuple[float, ...], body: VehicleSettings | Actor
) -> Trajectory:
    """Samples of x, y, speed, acceleration (k, 4), the last of which becomes the row at the end: x, y, heading, speed,
    acceleration, and of the ego the steering wheel angle.
    """
    x, y, _, speed, acceleration = end[:5]
    samples[-1] = x, y, speed, acceleration
    straight = np.zeros(len(times))
    steering = straight if len(end) > 5 else None
    columns = samples.T
    return Trajectory(
        times, columns[0], columns[1], straight, columns[2], columns[3], steering, length=body.length, width=body.width
    )
