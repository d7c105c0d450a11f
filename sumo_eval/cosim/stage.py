"""SUMO's side of the cases that are driven: what it receives before a step, what it shows after it,
whether both agree.

SUMO steps the ego and every actor of every case. Where no ADS asks it, it receives all of them at
every tenth step, and must then show each at its place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import chain, compress
from typing import Any

import numpy as np

from sumo_eval.cosim.doors.traci_module import GUARD
from sumo_eval.cosim.impossible import FASTEST, LOSS_MARGIN, LOWEST_SPEED, impossible
from sumo_eval.cosim.records import STRAIGHT, SUMO
from sumo_eval.cosim.sumo.insides import simulation_step, vehicles
from sumo_eval.cosim.sumo.session import bend_tolerance, check_start
from sumo_eval.cosim.sumo.shared_files import edge_name, vehicle_names
from sumo_eval.cosim.world import World
from sumo_eval.errors import ControllerError, SimulationError
from sumo_eval.trajectory import Alone, FloatArray, IntArray

# bounded by vType accel and decel, no braking on the ADS's behalf: it does collide
EGO_SPEED_MODE = 6
# setSpeed is taken as it is: the harness's own vehicle model has applied the limits
EXACT_SPEED_MODE = 32
LEFT_BATCH = Alone("left_batch")
CHECKED_EVERY = 10  # steps
ASIDE = -500.0  # m, y of a hidden vehicle
# place, angle and speed of a vehicle that SUMO has no longer
_NOT_THERE = (0.0, 0.0, STRAIGHT, 0.0)
_KEEPS_ROUTE = 2  # moveToXY: anywhere, off the road too
# moveToXY: onto the vehicle's own road and no other, and as far off it as told
_KEEPS_ROUTE_OFF_ROAD = 3


def joined(egos: Any, others: Any, name: str) -> FloatArray:
    """One field of the vehicles of rows, (n, 1 + m), the egos first."""
    return np.column_stack([egos[name], others[name]])


class Stage:
    """The running simulation of the cases of a world.

    asked: an ADS may ask SUMO, which receives everything at every step.
    as_read: the actors are as SUMO shows them in every respect, whatever their scripts say.
    """

    tolerance = 1e-3  # m, between the vehicle model and SUMO

    def __init__(
        self, traci: Any, world: World, *, asked: bool = False, as_read: bool = False
    ) -> None:
        self.traci, self.asked, self.as_read = traci, asked, as_read
        self.calls = vehicles(traci)
        self.step = simulation_step(traci)
        self.names = vehicle_names(world.cases, asked=asked)
        count, road = len(world.cases), world.cases[0].road
        self._alone = count == 1
        self._bent, self._road, self._step = road.bent, road, world.settings.step
        # it receives places on lanes: a place on the map costs fifty times
        self._on_lanes = self._bent and not as_read
        # m/s along the line, with which SUMO continues until it receives another
        self._told: dict[str, float] = {}
        # a network of many edges, or whatever the ADS has made of it
        own = road.network is not None or as_read
        any_edge = own and self._alone
        edges = ("" if any_edge else edge_name(case, count, asked=asked) for case in range(count))
        self._edges = list(edges)
        self._lane = -1 if own else 0
        self._keep = _KEEPS_ROUTE if any_edge else _KEEPS_ROUTE_OFF_ROAD
        self._far = FASTEST * world.settings.step  # m, further than anything drives in a step
        actors = [name for names in self.names for name in names[1:]]
        places = world.others[["front_x", "front_y"]]
        world.shown[:, :, 0], world.shown[:, :, 1] = places["front_x"], places["front_y"]
        fronts = places.ravel().tolist()
        self.speeds: dict[str, float] = {}  # m/s, of vehicles as read after the last step
        self.fronts: dict[str, Any] = dict(zip(actors, fronts, strict=True))
        on_map = (actor.on_map is not None for it in world.cases for actor in it.actors)
        self._on_map = frozenset(compress(actors, on_map))
        self.keep(world)

    def keep(self, world: World) -> None:
        """Drop all rows but these; keep their order."""
        self._width = 1 + world.others.shape[1]
        self._flat = [name for case in world.rows.tolist() for name in self.names[case]]
        self._edge = [self._edges[case] for case in world.rows.tolist()]
        # whose numbers are read one by one: an array takes ten times as long for each
        if self.as_read:
            self._cells: Any = world.shown.reshape(-1).data
            self._present: Any = world.others["present"].data
        self.without(world)

    def without(self, world: World) -> None:
        """Some of the rows have ended."""
        self._live = np.flatnonzero(world.egos["live"])
        self._all = len(self._live) == len(world.rows)
        self._names: list[str] = []  # of those that are read at once
        # rows of the unread vehicles, and places in these, the ego's first
        self._unread = [(0, j) for j in range(self._width)]

    def take_charge(self, world: World) -> None:
        """Make SUMO obey, and fail the cases whose vehicles it has not placed as they are meant."""
        calls = self.calls
        for case, concrete in enumerate(world.cases):
            try:
                check_start(self.traci, concrete, world.settings, self.names[case])
            except SimulationError as error:
                world.fail(case, "sim_error", str(error))
                continue
            starts = [concrete.ego, *(actor.start for actor in concrete.actors)]
            models = [False, *(actor.follows_at_once for actor in concrete.actors)]
            for name, start, is_model in zip(self.names[case], starts, models, strict=True):
                calls.setLaneChangeMode(name, 0)
                if is_model:  # it drives by itself
                    continue
                calls.setSpeedMode(name, EXACT_SPEED_MODE)
                calls.setSpeed(name, start.speed)
                self._told[name] = start.speed

    def closely(self, steps: int) -> bool:
        """Whether SUMO receives everything in the step after n."""
        return self.asked or self.compares(steps)

    def compares(self, steps: int) -> bool:
        """Whether SUMO and the world are compared in the step after n; where an ADS asks SUMO, each
        vehicle is.
        """
        return not self.as_read and (steps == 0 or (steps + 1) % CHECKED_EVERY == 0)

    def _move(self, number: int, x: float, y: float, angle: float, speed: float) -> None:
        """Put a vehicle, by its number, on the map, where its front bumper is at a step's end."""
        name = self._flat[number]
        self.calls.setSpeed(name, speed)
        edge = self._edge[number // self._width]
        self.calls.moveToXY(name, edge, self._lane, x, y, angle, self._keep)

    def tell(self, world: World, count: int) -> None:
        """Hand the motion of this step to SUMO: `count` rows of `world.tell`."""
        if not count:
            return
        if self._on_lanes:
            self._tell_lanes(world, count)
            return
        set_speed, move, names = self.calls.setSpeed, self.calls.moveToXY, self._flat
        # one call less for each vehicle and step than `_move`
        for number, x, y, angle, speed in world.tell[:count, :5].tolist():
            name, edge = names[int(number)], self._edge[int(number) // self._width]
            set_speed(name, speed)
            move(name, edge, self._lane, x, y, angle, self._keep)

    def put_aside(self, numbers: Sequence[int]) -> None:
        """Hide vehicles that have left the network."""
        for number in numbers:
            name = self._flat[number]
            if self.as_read:
                self.traci.vehicle.remove(name)
                self.speeds.pop(name, None)
                self._names = []
                continue
            self._set_aside(name, self._edge[number // self._width])

    def _set_aside(self, name: str, edge: str) -> None:
        """Put a vehicle where SUMO has no lane for it, so that no other sees it."""
        self.calls.setSpeed(name, 0.0)
        self.calls.moveToXY(name, edge, -1, 10.0, ASIDE, STRAIGHT, self._keep)

    def begin_again(self, world: World, row: int) -> None:
        """Put the vehicles of a row whose case has begun where they are at the end of this, its
        first step.
        """
        for j, body in enumerate((world.egos[row], *world.others[row])):
            angle = STRAIGHT - math.degrees(float(body["map"]["heading"]))
            place = float(body["front_x"]), float(body["front_y"])
            self._move(row * self._width + j, *place, angle, float(body["speed"]))

    def _tell_lanes(self, world: World, count: int) -> None:
        """In a curve: put vehicles where the mean of old and new speed takes them to their place in
        this step.

        One whose line is on the map, far beside the lanes, gets a place on the map.
        """
        calls, end = self.calls, self._road.length + self._road.run_out
        for told in world.tell[:count].tolist():
            number, (s, d, along) = int(told[0]), told[5:]
            name = self._flat[number]
            if name in self._on_map:
                self._move(number, *told[1:5])
                continue
            before = s - 0.5 * (self._told.get(name, along) + along) * self._step
            if not (before >= 0.0 and s < end):  # there are no lanes
                continue
            calls.setSpeed(name, along)
            calls.moveTo(name, f"{self._edge[number // self._width]}_0", before)
            calls.setLateralLanePosition(name, d)
            self._told[name] = along

    def read_at_once(self, world: World) -> list[int] | None:
        """Read the vehicles of many rows; the rows whose egos do not just go straight on, and are
        not read yet, as actors in `_unread`. None: nothing is read.
        """
        names, calls = self._names or self._look_for_names(world), self.calls
        shown = np.empty((len(names), 4))  # as in `World.shown`
        try:
            fronts, speeds = list(map(calls.getPosition, names)), list(map(calls.getSpeed, names))
            # an array of pairs takes twice as long
            shown[:, :2] = np.fromiter(chain.from_iterable(fronts), float).reshape(-1, 2)
            shown[:, 2], shown[:, 3] = list(map(calls.getAngle, names)), speeds
        except self.traci.TraCIException:
            self._unread = self._places_of(self._numbers)
            self.speeds.clear()
            return None
        odd = self._odd[: world.read(self._numbers, shown, self._odd)]
        self._unread = self._places_of(odd)
        # places of actors that are still to be compared stay as they were
        actors = [self._flat[row * self._width + j] for row, j in self._unread if j > 0]
        last = {name: self.fronts[name] for name in actors}
        self.fronts |= zip(names, fronts, strict=True)
        self.fronts |= last
        self.speeds |= zip(names, speeds, strict=True)
        return [row for row, j in self._unread if j == 0]

    def _places_of(self, numbers: IntArray) -> list[tuple[int, int]]:
        return [divmod(number, self._width) for number in numbers.tolist()]

    def _look_for_names(self, world: World) -> list[str]:
        there = np.pad(world.others["present"][self._live] == 1, ((0, 0), (1, 0)))
        there[:, 0] = True
        numbers = self._live[:, None] * self._width + np.arange(self._width)
        self._numbers, self._odd = numbers[there], np.zeros(there.sum(), dtype=np.int64)
        self._names = [self._flat[number] for number in self._numbers.tolist()]
        return self._names

    def read(self, world: World) -> None:
        """Take in the actors where they are as SUMO shows them."""
        if not self.as_read:
            return
        calls, cells, present = self.calls, self._cells, self._present
        far, fronts, speeds = self._far, self.fronts, self.speeds
        for row, j in self._unread:
            name, j = self._flat[row * self._width + j], j - 1
            if j < 0:
                continue
            shown = _NOT_THERE
            if present[row, j]:
                try:
                    x, y = front = calls.getPosition(name)
                    angle, speed = calls.getAngle(name), calls.getSpeed(name)
                    last_x, last_y = fronts[name]
                    there = (
                        -far < x - last_x < far
                        and -far < y - last_y < far
                        and 0.0 <= angle <= 360.0
                    )
                    if not (there and LOWEST_SPEED < speed < FASTEST):
                        if not self._is_past_the_road(world, row, j):
                            raise impossible(
                                calls, name, fronts[name], world.time + self._step, self._step
                            )
                        raise self.traci.TraCIException(name)
                    fronts[name], speeds[name] = front, speed
                    shown = x, y, angle, speed
                except self.traci.TraCIException:
                    present[row, j], self._names = 0, []
                    speeds.pop(name, None)
                    self._note_leaving(world, row, j)
                except SimulationError:
                    if self._alone:
                        raise
                    world.leave(row, LEFT_BATCH)
            at = 4 * (row * (self._width - 1) + j)
            cells[at], cells[at + 1] = shown[:2]
            cells[at + 2], cells[at + 3] = shown[2:]

    def _note_leaving(self, world: World, row: int, other: int) -> None:
        """Record an actor that left the network; raise ControllerError if the ADS removed it."""
        case, now = int(world.rows[row]), world.time + self._step
        actor = world.cases[case].actors[other]
        itself = actor.model or self._is_past_the_road(world, row, other)
        if not itself and world.each[case].conditions.interference == "refuse":
            raise ControllerError(
                f"The ADS removed vehicle `{actor.name}` before {now:.2f} s; only its own vehicle "
                'is its own (`interference = "record"` lets it, and counts).'
            )
        world.note(case, "actor_left_the_network", now, now)

    def _is_past_the_road(self, world: World, row: int, other: int) -> bool:
        """Whether a script has its vehicle's front bumper beyond the last lane."""
        body = world.others[row, other]
        end = self._road.length + self._road.run_out - LOSS_MARGIN
        return bool(body["x"] + 0.5 * body["length"] > end)

    def compare(self, world: World) -> None:
        """Fail the cases in which SUMO shows a vehicle at another place."""
        road, live = self._road, self._live
        egos, others = world.egos[live], world.others[live]
        x, y, length = (joined(egos, others, name) for name in ("x", "y", "length"))
        front_x, front_y = (joined(egos, others, name) for name in ("front_x", "front_y"))
        told = np.column_stack(
            [egos["placed"] != SUMO, (others["told"] == 2) & (others["present"] == 1)]
        )
        told &= (egos["reason"] == 0)[:, None]
        end = road.length + road.run_out - LOSS_MARGIN
        told &= (x - 0.5 * length >= 0.0) & (x + 0.5 * length < end)  # there are lanes
        reach = 0.5 * joined(egos, others, "width") - LOSS_MARGIN
        beside = (front_y <= road.right_edge - reach) | (front_y >= road.left_edge + reach)
        told &= self._bent | ~beside  # beside every lane of a straight road SUMO shows others
        rows, columns = np.nonzero(told)
        numbers = live[rows] * self._width + columns
        shown = list(map(self.calls.getPosition, [self._flat[n] for n in numbers.tolist()]))
        meant = np.column_stack([front_x[rows, columns], front_y[rows, columns]])
        off = np.hypot(*(np.reshape(shown, (-1, 2)) - meant).T)
        allowed = bend_tolerance(road, y[rows, columns]) if self._bent else self.tolerance
        for k in np.flatnonzero(~(off <= allowed)).tolist():  # which also finds a nan
            (at_x, at_y), (x_there, y_there) = shown[k], meant[k]
            self._fail(
                world, int(live[rows[k]]), int(columns[k]),
                f"put the front bumper of {{}} at ({at_x:.3f}, {at_y:.3f}) m "
                f"instead of ({x_there:.3f}, {y_there:.3f}) m.",
            )  # fmt: skip

    def _fail(self, world: World, row: int, vehicle: int, words: str) -> None:
        """Fail a case of which SUMO shows a vehicle at another place: by the ADS's fault where its
        calls moved the ego.

        words: with {} for the vehicle.
        """
        actors = world.cases[int(world.rows[row])].actors
        who = f"vehicle `{actors[vehicle - 1].name}`" if vehicle else "the ego"
        moved = self.asked and self._alone and GUARD.moved and not vehicle
        world.fail(row, "ads_error" if moved else "sim_error", f"SUMO {words.format(who)}")

    def remove(self, world: World, row: int) -> None:
        """Remove the vehicles of a case that has ended from its batch."""
        for name in () if self._alone else self.names[int(world.rows[row])]:
            with suppress(self.traci.TraCIException):  # SUMO may have removed it
                self.traci.vehicle.remove(name)
