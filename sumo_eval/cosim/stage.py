"""SUMO's side of the cases that are driven: what it is told before a step, what it shows after it, whether both agree.

SUMO steps the ego and every other vehicle of every case. Where nobody asks it for the ego, it hears of the egos that
have turned or changed their speed at every tenth step, must then show every ego there, and every vehicle as its script
has it; what follows a script in between is told when it begins to, then, and when SUMO takes over.
"""

from __future__ import annotations

import math
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.impossible import BACKWARDS, BESIDE, FASTEST, impossible
from sumo_eval.cosim.records import MODEL, STRAIGHT
from sumo_eval.cosim.sumo.session import NOWHERE, bend_tolerance, check_start, simulation_step, vehicles
from sumo_eval.cosim.sumo.shared_files import edge_name, vehicle_names
from sumo_eval.cosim.world import World
from sumo_eval.errors import SimulationError
from sumo_eval.scenario.concrete import Actor, Road
from sumo_eval.scenario.road.reference_line import map_places

EGO_SPEED_MODE = 6  # bounded by vType accel and decel, no braking on the ADS's behalf: it does collide
EXACT_SPEED_MODE = 32  # setSpeed is taken as it is: the harness's own vehicle model has applied the limits
CHECKED_EVERY = 10  # steps
_PLACE_TOLERANCE = 1e-3  # m, between the vehicle model and SUMO
_MOTION_TOLERANCE = 1e-6  # m/s and deg
ASIDE = -500.0  # m, y of a vehicle that nothing is to see
_NOT_THERE = (0.0, 0.0, STRAIGHT, 0.0)  # place, angle and speed of a vehicle that SUMO has no longer
_KEEPS_ROUTE = 2  # moveToXY: anywhere, off the road too
_KEEPS_ROUTE_OFF_ROAD = 3  # moveToXY: onto the vehicle's own road and no other, and as far off it as told


def _front(actor: Actor, road: Road) -> tuple[float, float]:
    """Where a vehicle's front bumper is on the map at the start."""
    half = 0.5 * actor.length
    if actor.on_map is not None:
        x, y, heading = actor.on_map
        return x + half * math.cos(heading), y + half * math.sin(heading)
    if not road.bent:
        return actor.start.x + half, actor.y(0.0)
    east, north, _ = map_places(road.line, actor.start.x + half, actor.y(0.0))
    return float(east), float(north)


class Stage:
    """The running simulation of the cases of a world.

    asked: somebody else may ask SUMO, which is told everything at every step. as_read: the other vehicles are as SUMO
    shows them in every respect, whatever their scripts say.
    """

    def __init__(self, traci: Any, world: World, *, asked: bool = False, as_read: bool = False) -> None:
        self.traci, self.asked, self.as_read = traci, asked, as_read
        self.calls = vehicles(traci)
        self.step = simulation_step(traci)
        self.names = vehicle_names(world.cases)
        self._other_names = np.array(self.names, dtype=object)[:, 1:]
        count, road = len(world.cases), world.cases[0].road
        self._alone = count == 1
        self._bent, self._road, self._step = road.bent, road, world.settings.step
        self._on_lanes = self._bent and not as_read  # it is told places on lanes: a place on the map costs fifty times
        self._told: dict[str, float] = {}  # m/s along the line, which SUMO goes on with until it is told again
        own = road.network is not None or as_read  # a network of many edges, or whatever the ADS has made of it
        self._edges = [("" if own else edge_name(case, count)) for case in range(count)]
        self._lane = -1 if own else 0
        self._keep = _KEEPS_ROUTE if own else _KEEPS_ROUTE_OFF_ROAD
        self._middle = 0.5 * (road.left_edge + road.right_edge)
        self._half = 0.5 * (road.left_edge - road.right_edge)
        self._far = FASTEST * world.settings.step  # m, further than anything drives in a step
        self._fronts = [_front(it, road) for it in world.cases[0].actors]
        self._on_map = frozenset(
            name
            for names, it in zip(self.names, world.cases, strict=True)
            for name, actor in zip(names[1:], it.actors, strict=True)
            if actor.on_map is not None
        )
        self._tolerance = _PLACE_TOLERANCE
        self.keep(world)

    def keep(self, world: World) -> None:
        """From now on these rows, in this order."""
        self._width = 1 + world.others.shape[1]
        self._flat = [name for case in world.rows.tolist() for name in self.names[case]]
        self._edge = [self._edges[case] for case in world.rows.tolist()]
        self._places = world.shown[0, :, :2]
        if self._alone:  # whose numbers are read one by one: an array takes ten times as long for each
            self._cells: Any = world.shown.reshape(-1).data
            self._present: Any = world.others["present"][0].data
        self.without(world)

    def without(self, world: World) -> None:
        """Some of the rows have ended."""
        self._live = np.flatnonzero(world.egos["live"])
        self._all = len(self._live) == len(world.rows)
        self._others = self._other_names[world.rows[self._live]].ravel().tolist()

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
        """Whether everything is told in the step after so many."""
        return self.asked or self.compares(steps)

    def compares(self, steps: int) -> bool:
        """Whether SUMO and the world are compared in the step after so many; one by one, whoever asks SUMO does."""
        return not self.as_read and (steps == 0 or (steps + 1) % CHECKED_EVERY == 0)

    def tell(self, world: World, count: int) -> None:
        """Hand the motion of this step to SUMO: so many rows of `world.tell`."""
        if not count:
            return
        if self._on_lanes:
            self._tell_lanes(world, count)
            return
        set_speed, move, names = self.calls.setSpeed, self.calls.moveToXY, self._flat
        for vehicle, x, y, angle, speed in world.tell[:count, :5].tolist():
            number = int(vehicle)
            set_speed(names[number], speed)
            move(names[number], self._edge[number // self._width], self._lane, x, y, angle, self._keep)

    def put_aside(self, numbers: NDArray[np.intp]) -> None:
        """Let SUMO stand vehicles where nothing sees them: they have left the network."""
        for number in numbers.tolist():
            name = self._flat[number]
            if self.as_read:
                self.traci.vehicle.remove(name)
                continue
            self.calls.setSpeed(name, 0.0)
            self.calls.moveToXY(name, self._edge[number // self._width], -1, 10.0, ASIDE, STRAIGHT, self._keep)

    def begin_anew(self, world: World, row: int) -> None:
        """Put the vehicles of a row that has begun a case anew where they are at the end of this, its first step."""
        step, ego, concrete = world.settings.step, world.egos[row], world.cases[int(world.rows[row])]
        half, heading = 0.5 * float(ego["length"]), float(ego["heading"])
        front = float(ego["x"]) + half * math.cos(heading), float(ego["y"]) + half * math.sin(heading)
        places = [(*front, STRAIGHT - math.degrees(heading), float(ego["speed"]))]
        for other, actor in zip(world.others[row], concrete.actors, strict=True):
            if other["told"]:
                angle = STRAIGHT - math.degrees(float(other["heading"]))
                places.append((float(other["front_x"]), float(other["front_y"]), angle, float(other["speed"])))
            else:
                places.append((actor.x(step) + 0.5 * actor.length, actor.y(step), STRAIGHT, actor.speed(step)))
        for name, (x, y, angle, speed) in zip(self.names[int(world.rows[row])], places, strict=True):
            self.calls.setSpeed(name, speed)
            self.calls.moveToXY(name, self._edge[row], self._lane, x, y, angle, self._keep)

    def _tell_lanes(self, world: World, count: int) -> None:
        """On a bend: to go on from where the mean of its old and its new speed takes it to its place in this step.

        Whose line is on the map, far beside the lanes, is told a place on the map.
        """
        calls, end = self.calls, self._road.length + self._road.run_out
        for vehicle, x, y, angle, speed, s, d, along in world.tell[:count].tolist():
            number = int(vehicle)
            name = self._flat[number]
            if name in self._on_map:
                calls.setSpeed(name, speed)
                calls.moveToXY(name, self._edge[number // self._width], self._lane, x, y, angle, self._keep)
                continue
            before = s - 0.5 * (self._told.get(name, along) + along) * self._step
            if not (before >= 0.0 and s < end):  # there are no lanes
                continue
            calls.setSpeed(name, along)
            calls.moveTo(name, f"{self._edge[number // self._width]}_0", before)
            calls.setLateralLanePosition(name, d)
            self._told[name] = along

    def read(self, world: World) -> None:
        """Where SUMO shows the other vehicles."""
        if self.as_read:
            self._read_closely(world)
        elif self._bent:
            return  # everybody is where his script has him; `compare` looks whether SUMO shows him there
        elif self._alone:
            for j, name in enumerate(self._others):
                self._places[j] = self.calls.getPosition(name)
        elif self._others:
            places = chain.from_iterable(map(self.calls.getPosition, self._others))
            found = np.fromiter(places, np.float64, 2 * len(self._others)).reshape(len(self._live), -1, 2)
            if self._all:
                world.shown[:, :, :2] = found
            else:
                world.shown[self._live, :, :2] = found

    def _read_closely(self, world: World) -> None:
        """Every respect of the other vehicles of a single case."""
        calls, cells, present, far = self.calls, self._cells, self._present, self._far
        for j, name in enumerate(self._others):
            x, y, angle, speed = _NOT_THERE
            if present[j]:
                try:
                    x, y = calls.getPosition(name)
                    angle, speed = calls.getAngle(name), calls.getSpeed(name)
                    last_x, last_y = self._fronts[j]
                    there = -far < x - last_x < far and -far < y - last_y < far and 0.0 <= angle <= 360.0
                    if not (there and BACKWARDS < speed < FASTEST):
                        if not self._is_past_the_road(world, j, world.time + self._step):
                            raise impossible(calls, name, self._fronts[j], world.time + self._step, self._step)
                        raise self.traci.TraCIException(name)
                    self._fronts[j] = x, y
                except self.traci.TraCIException:
                    now = world.time + self._step
                    present[j] = 0
                    world.note(0, "actor_left_the_network", now, now)
                    x, y, angle, speed = _NOT_THERE
            at = 4 * j
            cells[at], cells[at + 1], cells[at + 2], cells[at + 3] = x, y, angle, speed

    def _is_past_the_road(self, world: World, other: int, now: float) -> bool:
        """Whether a script has its vehicle's front bumper beyond the last lane."""
        actor, road = world.cases[0].actors[other], world.cases[0].road
        return actor.x(now) + 0.5 * actor.length > road.length + road.run_out - BESIDE

    def compare(self, world: World) -> None:
        """A case in which SUMO shows something else than it was told has come to its end."""
        if self._bent:
            self._compare_on_a_bend(world)
            return
        calls, live, egos = self.calls, self._live, world.egos
        names = [self._flat[row * self._width] for row in live.tolist()]
        half = 0.5 * world.settings.vehicle.length
        shown = np.array(list(map(calls.getPosition, names))).reshape(-1, 2)
        heading = egos["heading"][live]
        x, y = egos["x"][live] + half * np.cos(heading), egos["y"][live] + half * np.sin(heading)
        off = ~((np.abs(shown[:, 0] - x) <= self._tolerance) & (np.abs(shown[:, 1] - y) <= _PLACE_TOLERANCE))
        off &= (egos["placed"][live] == MODEL) & (egos["reason"][live] == 0)  # which also finds a nan
        off &= np.abs(y - self._middle) < self._half + 0.5 * world.settings.vehicle.width - BESIDE
        for k in np.flatnonzero(off).tolist():
            world.fail(
                int(live[k]), "sim_error",
                f"SUMO put the ego's front bumper at ({shown[k, 0]:.3f}, {shown[k, 1]:.3f}) m "
                f"instead of ({x[k]:.3f}, {y[k]:.3f}) m.",
            )  # fmt: skip
        if self._others:
            self._compare_others(world)

    def _compare_on_a_bend(self, world: World) -> None:
        """Everybody was told his place along and across the line in this step."""
        end = self._road.length + self._road.run_out - BESIDE
        for row in self._live.tolist():
            if world.egos["reason"][row] != 0:
                continue
            for j in range(self._width):
                body = world.egos[row] if j == 0 else world.others[row, j - 1]
                if j and not (body["present"] and body["told"] == 2):
                    continue
                name = self._flat[row * self._width + j]
                if not (body["x"] - 0.5 * body["length"] >= 0.0 and body["x"] + 0.5 * body["length"] < end):
                    continue
                x, y = self.calls.getPosition(name)
                off = math.hypot(x - float(body["front_x"]), y - float(body["front_y"]))
                if not off <= bend_tolerance(self._road, float(body["y"])):  # which also finds a nan
                    who = "the ego" if j == 0 else f"vehicle `{world.cases[int(world.rows[row])].actors[j - 1].name}`"
                    world.fail(
                        row, "sim_error",
                        f"SUMO put the front bumper of {who} at ({x:.3f}, {y:.3f}) m instead of "
                        f"({float(body['front_x']):.3f}, {float(body['front_y']):.3f}) m.",
                    )  # fmt: skip

    def _compare_others(self, world: World) -> None:
        live, others = self._live, world.others[self._live]
        shape = others.shape
        shown = world.shown[live]
        told, half = others["told"], 0.5 * others["width"]
        off = ~(np.abs(shown[:, :, 0] - others["front_x"]) <= self._tolerance)  # which also finds a nan
        off |= ~(np.abs(shown[:, :, 1] - others["front_y"]) <= _PLACE_TOLERANCE)
        speed, angle = others["speed"], np.full(shape, STRAIGHT)
        if (told == 0).any():
            speed = np.array(list(map(self.calls.getSpeed, self._others))).reshape(shape)
            angle = np.array(list(map(self.calls.getAngle, self._others))).reshape(shape)
        moves_otherwise = ~(np.abs(speed - others["speed"]) <= _MOTION_TOLERANCE)
        moves_otherwise |= ~(np.abs(angle - STRAIGHT) <= _MOTION_TOLERANCE) | ~(shown[:, :, 0] > NOWHERE)
        off = np.where(told == 2, off, moves_otherwise & (told == 0)) & (others["present"] == 1)
        off &= np.abs(others["y"] - self._middle) < self._half + half - BESIDE  # beside every lane SUMO shows others
        off &= (world.egos["reason"][live] == 0)[:, None]
        for k, j in np.argwhere(off).tolist():
            actor = world.cases[int(world.rows[live[k]])].actors[j]
            world.fail(
                int(live[k]), "sim_error",
                f"SUMO showed vehicle `{actor.name}` at ({shown[k, j, 0]:.3f}, {shown[k, j, 1]:.3f}) m with "
                f"{speed[k, j]:.3f} m/s and {angle[k, j]:.3f} deg, which its script does not say.",
            )  # fmt: skip

    def remove(self, world: World, row: int) -> None:
        """Take the vehicles of a case that has ended off their road, while others go on."""
        if not self._alone:
            for name in self.names[int(world.rows[row])]:
                self.traci.vehicle.remove(name)
