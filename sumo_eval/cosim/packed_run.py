"""A pack while it runs: all its cases in one SUMO simulation, step by step, each until something ends it."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_eval.cosim.clips import count_clip
from sumo_eval.cosim.contact import Body, between, describe, first_touch
from sumo_eval.cosim.packed_actors import KEEPS_ROUTE_OFF_ROAD, Index, PackedActors
from sumo_eval.cosim.packed_controller import PackedCommand, PackedController, PackedScene
from sumo_eval.cosim.packed_files import edge_name, vehicle_name
from sumo_eval.cosim.packed_samples import End, PackedSamples
from sumo_eval.cosim.packed_senses import STRAIGHT, Seen, as_seen, egos_as_seen, fronts
from sumo_eval.cosim.packed_vehicle_model import PackedEgos, advance_all
from sumo_eval.cosim.session import vehicles
from sumo_eval.cosim.simulate import EXACT_SPEED_MODE
from sumo_eval.cosim.vehicle_model import Command, advance
from sumo_eval.errors import ControllerTimeoutError
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import BoolArray, Clip, EndReason, Recording

CHECKED_EVERY = 10
"""Steps after which SUMO is told where the egos are that have turned or changed their speed, and must show every ego
there, and every other vehicle on its script. In between SUMO's egos may lag: nothing in a pack asks SUMO for them, and
the other vehicles keep to their scripts whatever the egos do."""
DROPPED_AT = 0.25  # share of the cases that has ended when the controller is told to forget them
_CLOSE = 0.1  # m, bodies that are further apart all through a step do not touch
_PLACE_TOLERANCE = 1e-3  # m, between the vehicle model and SUMO

HANDED_BACK = "The packed ADS handed the case back."
NOT_AT_ITS_START = "SUMO did not place a vehicle at its start."
BESIDE_THE_LANES = "The ego's front bumper left SUMO's lanes, where SUMO counts its speed otherwise."
NOT_AS_TOLD = "SUMO showed a vehicle elsewhere, or faster or turned otherwise, than it was told."


class PackedRun:
    """State of a pack: k rows, one for each case that is still held; some of them may have ended."""

    def __init__(
        self, cases: Sequence[ConcreteScenario], settings: SimulationSettings, controller: PackedController
    ) -> None:
        self.cases, self.settings, self.controller = cases, settings, controller
        n, vehicle = len(cases), settings.vehicle
        self.road = cases[0].road
        x, y, speed = np.array([(c.ego.x, c.ego.y, c.ego.speed) for c in cases], dtype=np.float64).T.copy()
        nothing = np.zeros(n)
        self.egos = PackedEgos(x, y, nothing, speed, nothing, nothing, np.ones(n), nothing)
        self.names = [vehicle_name(case, 0) for case in range(n)]
        self.others = PackedActors(cases, settings.step)
        self.live, self.all_live = np.ones(n, dtype=bool), True
        self.stale = np.zeros(n, dtype=bool)  # where SUMO has the ego elsewhere by now
        self.stood = np.zeros(n)
        self._body(n)
        self.left: dict[int, str] = {}  # cases that have to be simulated alone, and why
        self.ends: dict[int, End] = {}
        self.clips: list[dict[str, Clip]] = [{} for _ in cases]
        self.samples = PackedSamples(n, len(cases[0].actors))
        self.steps = 0
        self.latency: list[float] = []
        self.half_length = 0.5 * vehicle.length
        self.middle = 0.5 * (self.road.left_edge + self.road.right_edge)
        self.within = 0.5 * (self.road.left_edge - self.road.right_edge + vehicle.width) - _CLOSE  # m, SUMO's own limit

    def _body(self, rows: int) -> None:
        vehicle, others = self.settings.vehicle, self.others
        self.half_lengths, self.half_widths = np.full(rows, 0.5 * vehicle.length), np.full(rows, 0.5 * vehicle.width)
        self.near_along = 0.5 * vehicle.length + others.half_length + _CLOSE
        self.near_across = 0.5 * vehicle.width + others.half_width + _CLOSE
        self.longest = self.near_along + 4.0 * (vehicle.width + others.width)  # headings are within -pi..pi

    def drive(self, traci: Any, step_timeout: float) -> None:
        """Step until every case has ended."""
        step = self.settings.step
        samples_every = round(self.settings.record_interval / step)
        seen = self._take_charge(traci)
        self.samples.add(0.0, self.egos, self.others)
        with np.errstate(all="ignore"):
            while self.live.any():
                time = self.steps * step
                asked = clock.perf_counter()
                command = self.controller.step(PackedScene(*seen, *self.others.seen), time)
                took = clock.perf_counter() - asked
                self.latency.append(took / len(self.live))
                if took > step_timeout:
                    raise ControllerTimeoutError("The pack's controller took too long.")
                before = self.egos
                closely = (self.steps + 1) % CHECKED_EVERY == 0 or self.steps == 0
                self._move_egos(traci, command)
                if closely:
                    self._tell_egos(traci)
                now = (self.steps + 1) * step
                self.others.move(traci, time + step, now + step, closely=closely)
                traci.simulationStep()
                self.steps += 1
                self.others.look(traci, now, closely=closely)
                if closely:
                    self._check(traci)
                elif self.others.surprised.any():
                    self._leave_surprised(traci)
                self._find_ends(traci, before)
                self._forget_ended()
                seen = egos_as_seen(self.egos, self.half_lengths, self.half_widths)
                if self.steps % samples_every == 0:
                    self.samples.add(self.steps * step, self.egos, self.others)
        self.samples.keep(self.others.case)

    def _take_charge(self, traci: Any) -> Seen:
        """Make SUMO obey, and see which cases it has placed as they are meant; what a sensor shows of the egos."""
        vehicle = vehicles(traci)
        for case, concrete in enumerate(self.cases):
            starts = [(self.names[case], concrete.ego, self.settings.vehicle.length)]
            starts += [
                (name, a.start, a.length) for name, a in zip(self.others.names[case], concrete.actors, strict=True)
            ]
            for name, start, length in starts:
                x, y = vehicle.getPosition(name)
                ahead, left = abs(x - 0.5 * length - start.x), abs(y - start.y)
                if not (ahead <= _PLACE_TOLERANCE and left <= _PLACE_TOLERANCE):  # which no nan is
                    self.left[case] = NOT_AT_ITS_START
                vehicle.setSpeedMode(name, EXACT_SPEED_MODE)
                vehicle.setLaneChangeMode(name, 0)
                vehicle.setSpeed(name, start.speed)
        self.others.look_first(traci)
        x, y = np.array(list(map(vehicle.getPosition, self.names)), dtype=np.float64).T
        angle = np.array(list(map(vehicle.getAngle, self.names)))
        speed = np.array(list(map(vehicle.getSpeed, self.names)))
        self._drop(traci, list(self.left))
        return as_seen(x, y, angle, speed, self.half_lengths, self.half_widths)

    # -- motion --------------------------------------------------------------------------------------------------------

    def _move_egos(self, traci: Any, command: PackedCommand) -> None:
        """The vehicle model for every ego: at once in its ordinary course, else with the scalar model."""
        step, limits, before = self.settings.step, self.settings.vehicle, self.egos
        after, exceptional = advance_all(before, command, limits, step)
        handed_back: list[int] = []
        for row in np.flatnonzero(exceptional & self.live).tolist():
            wanted = Command(float(command.acceleration[row]), float(command.steering[row]))
            if not math.isfinite(wanted.acceleration + wanted.steering):
                handed_back.append(row)
                continue
            state, clips = advance(before.state(row), wanted, limits, step)
            for what, requested, applied in clips:
                count_clip(self.clips[self.others.case[row]], what, self.steps * step, requested, applied)
            after.put(row, state)
        self._leave(traci, handed_back, HANDED_BACK)
        if not self.all_live:  # what the others would do may be no number
            after = PackedEgos(*(np.where(self.live, new, old) for new, old in zip(after, before, strict=True)))
        self.stale |= (after.speed != before.speed) | (after.heading != 0.0) | (before.heading != 0.0)
        self.egos = after

    def _tell_egos(self, traci: Any) -> None:
        """Put those that have not gone straight on at the speed that SUMO knows where the vehicle model has them."""
        egos = self.egos
        set_speed, move = vehicles(traci).setSpeed, vehicles(traci).moveToXY
        front_x, front_y = fronts(egos, self.half_length)
        for row in np.flatnonzero(self.stale & self.live).tolist():
            case = int(self.others.case[row])
            name, angle = self.names[case], STRAIGHT - math.degrees(egos.heading[row])
            set_speed(name, float(egos.speed[row]))
            move(name, edge_name(case), 0, float(front_x[row]), float(front_y[row]), angle, KEEPS_ROUTE_OFF_ROAD)
        self.stale = np.zeros(len(self.stale), dtype=bool)

    def _check(self, traci: Any) -> None:
        """A case in which SUMO does not show what it was told leaves the pack."""
        rows = np.flatnonzero(self.live)
        names = [self.names[case] for case in self.others.case[rows].tolist()]
        vehicle = vehicles(traci)
        x, y = np.array(list(map(vehicle.getPosition, names)), dtype=np.float64).reshape(-1, 2).T
        front_x, front_y = fronts(self.egos, self.half_length)
        off = np.zeros(len(self.live), dtype=bool)
        off[rows] = ~(
            (np.abs(x - front_x[rows]) <= _PLACE_TOLERANCE) & (np.abs(y - front_y[rows]) <= _PLACE_TOLERANCE)
        )  # as nan is
        off[rows] |= np.array(list(map(vehicle.getSpeed, names))) != self.egos.speed[rows]
        off |= self.others.surprised | self.others.off_their_scripts(self.steps * self.settings.step)
        self._leave(traci, np.flatnonzero(off & self.live).tolist(), NOT_AS_TOLD)

    def _leave_surprised(self, traci: Any) -> None:
        self._leave(traci, np.flatnonzero(self.others.surprised & self.live).tolist(), NOT_AS_TOLD)

    # -- ends ----------------------------------------------------------------------------------------------------------

    def _find_ends(self, traci: Any, before: PackedEgos) -> None:
        """Which cases end with this step: as in `simulate`, and in its order."""
        settings, egos, live = self.settings, self.egos, self.live
        now = self.steps * settings.step
        ended = [row for row in self._near(before) if self._touches(row, before)]
        standing = egos.speed < settings.standstill_speed
        self.stood = np.where(standing, self.stood + settings.step, 0.0)
        off_road = ~((self.road.right_edge <= egos.y) & (egos.y <= self.road.left_edge))
        passed = egos.x >= self.road.length
        stood = self.stood >= settings.standstill_time - 1e-9
        over = off_road | passed | stood
        if now >= settings.time_limit - 1e-9:
            over[:] = True
        decided = self._decided(now) & ~over if settings.end_when_decided else np.zeros(len(live), dtype=bool)
        touched = set(ended)
        for row in np.flatnonzero((over | decided) & live).tolist():
            if row in touched:
                continue
            reason: EndReason = "decided" if decided[row] else "time_limit"
            if off_road[row]:
                reason = "off_road"
            elif passed[row]:
                reason = "road_end"
            elif stood[row]:
                reason = "standstill"
            self._end_as_it_is(row, now, reason)
            ended.append(row)
        if ended:
            self._drop(traci, ended)
        beside = (np.abs(egos.y + self.half_length * egos.sine - self.middle) > self.within) & self.live
        if beside.any():
            self._leave(traci, np.flatnonzero(beside).tolist(), BESIDE_THE_LANES)

    def _end_as_it_is(self, row: int, now: float, reason: EndReason) -> None:
        case, others = int(self.others.case[row]), self.others
        there = [
            (
                others.x[row, j],
                others.y[row, j],
                others.heading[row, j],
                others.speed[row, j],
                actor.acceleration(now),
            )
            for j, actor in enumerate(others.actors[case])
        ]
        self.ends[case] = End(now, reason, None, self.egos.state(row), there)

    def _near(self, before: PackedEgos) -> list[int]:
        """Rows in which something may touch the ego within the step: it is not apart along or across the road.

        Between the samples everything moves linearly, and a body turned by h reaches no further along the road than
        half its length + |h| half its width, and across it than half its width + |h| half its length.
        """
        egos, others = self.egos, self.others
        was_x, was_y, was_heading, *_ = others.before
        first, last = was_x - before.x[:, None], others.x - egos.x[:, None]
        apart = np.maximum(np.minimum(first, last), -np.maximum(first, last))  # m along the road, at the least
        close = (apart <= self.longest) & self.live[:, None]
        if not close.any():
            return []
        turn = np.maximum(np.abs(was_heading), np.abs(others.heading))
        ego_turn = np.maximum(np.abs(before.heading), np.abs(egos.heading))[:, None]
        half_length, half_width = self.half_lengths[:, None], self.half_widths[:, None]
        close &= apart <= self.near_along + turn * others.half_width + ego_turn * half_width
        first, last = was_y - before.y[:, None], others.y - egos.y[:, None]
        apart = np.maximum(np.minimum(first, last), -np.maximum(first, last))
        close &= apart <= self.near_across + turn * others.half_length + ego_turn * half_length
        found: list[int] = np.flatnonzero(close.any(axis=1)).tolist()
        return found

    def _touches(self, row: int, before: PackedEgos) -> bool:
        """Whether something touches the ego within the step; then the case has ended."""
        vehicle, step, case = self.settings.vehicle, self.settings.step, int(self.others.case[row])
        state = self.egos.state(row)
        was = Body(*before.state(row)[:4], vehicle.length, vehicle.width)
        body = Body(*state[:4], vehicle.length, vehicle.width)
        poses = self.others.bodies(row)
        hits = [(share, j) for j, (a, b) in enumerate(poses) if (share := first_touch(was, body, a, b)) is not None]
        if not hits:
            return False
        share, struck = min(hits)
        time = (self.steps - 1) * step + share * step
        ego = between(was, body, share)
        there = [between(a, b, share) for a, b in poses]
        actors = self.others.actors[case]
        hit = describe(time, actors[struck].name, ego, there[struck])
        channels = [
            (other.x, other.y, other.heading, other.speed, actor.acceleration(time))
            for other, actor in zip(there, actors, strict=True)
        ]
        row_of_ego = (*ego[:4], state.acceleration, state.steering_wheel_angle)
        self.ends[case] = End(time, "contact", hit, row_of_ego, channels)
        return True

    def _decided(self, now: float) -> BoolArray:
        """Where nothing can come of the case any more, as in `simulate`."""
        egos, others = self.egos, self.others
        decided: BoolArray = self.live & (others.scripted_until <= now)
        decided &= (egos.acceleration == 0.0) & (egos.heading == 0.0)
        if not decided.any():
            return decided
        decided = decided & self.controller.settled()
        ahead = others.x - egos.x[:, None]
        length = self.half_lengths[:, None] + others.half_length
        apart = np.abs(others.y - egos.y[:, None]) >= self.half_widths[:, None] + others.half_width
        slower, faster = others.speed <= egos.speed[:, None], others.speed >= egos.speed[:, None]
        apart |= ((ahead >= length) & faster) | ((-ahead >= length) & slower)
        apart &= (others.across == 0.0) & (others.heading == 0.0)
        return np.asarray(decided & apart.all(axis=1))

    # -- rows ----------------------------------------------------------------------------------------------------------

    def _leave(self, traci: Any, rows: Sequence[int], why: str) -> None:
        """These have to be simulated alone."""
        for row in rows:
            self.left[int(self.others.case[row])] = why
        self._drop(traci, rows)

    def _drop(self, traci: Any, rows: Sequence[int]) -> None:
        """Take the vehicles of cases that have ended off their roads; their rows stay for a while."""
        cases = [int(self.others.case[row]) for row in rows]
        if not cases:
            return
        for case in cases:
            for name in (self.names[case], *self.others.names[case]):
                traci.vehicle.remove(name)
        self.live = self.live.copy()
        self.live[rows] = False
        self.others.without(cases)
        self.all_live = False
        self.others.set_live(np.flatnonzero(self.live))

    def _forget_ended(self) -> None:
        """Give up the rows of cases that have ended, once they are many."""
        rows: Index = np.flatnonzero(self.live)
        if not rows.size or rows.size > (1.0 - DROPPED_AT) * len(self.live):
            return
        self.controller.keep(rows)
        self.samples.keep(self.others.case[rows])
        self.egos = PackedEgos(*(channel[rows] for channel in self.egos))
        self.stood, self.stale, self.live = self.stood[rows], self.stale[rows], self.live[rows]
        self.all_live = True
        self.others.keep(rows)
        self._body(len(rows))

    def recordings(self, wall_time: float) -> list[Recording | None]:
        """What each case left behind; None for those that left the pack."""
        latency = float(np.mean(self.latency)), float(np.max(self.latency))
        found: list[Recording | None] = []
        for case, concrete in enumerate(self.cases):
            end = self.ends.get(case)
            if end is None or case in self.left:
                found.append(None)
                continue
            clips = [self.clips[case][what] for what in sorted(self.clips[case])]
            found.append(
                self.samples.recording(
                    case,
                    end,
                    concrete.actors,
                    self.settings.vehicle,
                    clips,
                    latency=latency,
                    wall_time=wall_time / len(self.cases),
                )
            )
        return found
