"""SUMO's side of a simulation: what SUMO receives before a step, what it shows after the step,
and whether its places agree with the world's.

SUMO steps the ego and every actor of every case. If no ADS asks SUMO, SUMO receives the vehicles
only in the first and in every tenth step, and must then show each vehicle at its place.

A vehicle's number is its index row by row, the ego first: row * (1 + m) + column, of m actors.

`cosim/loop.py` and `cosim/episode_rows.py` call a stage at every step. `cosim/traffic.py` derives
the stage for cases with vehicles that SUMO's models drive.

Users: `cosim/ego_control.py`, `cosim/ego_motion.py`, `cosim/loop.py`, `cosim/on_traci.py`,
`cosim/episode_rows.py`, `cosim/policies.py`, `cosim/simulation.py`, `cosim/traffic.py`.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from itertools import compress, product
from struct import Struct
from typing import Any

import numpy as np

from sumo_eval.cosim.discrepancies import (
    check_clock,
    fail_misplaced,
    may_leave_sumo,
    note_leaving,
)
from sumo_eval.cosim.impossible import FARTHEST, FASTEST, LOSS_MARGIN, LOWEST_SPEED, impossible
from sumo_eval.cosim.records import STRAIGHT
from sumo_eval.cosim.sumo.insides import simulation_step, simulation_time, vehicles
from sumo_eval.cosim.sumo.sections import on_route, vehicle_routes
from sumo_eval.cosim.sumo.session import bend_tolerance, check_start
from sumo_eval.cosim.sumo.shared_files import suffix, vehicle_names
from sumo_eval.cosim.sumo.sumo_files import EGO, departure_speed, departures
from sumo_eval.cosim.world import World
from sumo_eval.errors import SimulationError
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.trajectory import Alone, IntArray

# Speed modes of SUMO, sets of bits. Bits 1 and 2 (2 + 4): limits of acceleration and deceleration
# of the vType hold, but SUMO does not brake for the ADS, which can therefore collide.
EGO_SPEED_MODE = 6
# Without bits 0 to 2 setSpeed is taken as it is: the harness's own vehicle model has applied the
# limits. Bit 5 (32): no right of way within junctions.
EXACT_SPEED_MODE = 32
LEFT_BATCH = Alone("left_batch")
CHECKED_EVERY = 10  # steps
ASIDE = -500.0  # m, y of a hidden vehicle
# place, m, angle, deg, and speed, m/s, of an actor whose leaving of SUMO has been recorded
_NOT_THERE = (0.0, 0.0, STRAIGHT, 0.0)
# writes the values of a vehicle into an array faster than numpy does
_SHOWN = Struct("4d")
# of a vehicle that SUMO does not know any more; `World.read` takes in no vehicle with nan
_UNKNOWN = (math.nan, math.nan), math.nan, math.nan
# `keepRoute` of moveToXY: SUMO looks for the road, and the vehicle may be off the road
_ANY_ROAD = 2
# the road is the vehicle's own, and the vehicle may be off the road
_OWN_ROAD = 3


class Stage:
    """The running simulation of the cases of a world.

    ads_asks: an ADS may ask SUMO, so SUMO receives the vehicles at every step.
    as_read: the world takes the actors' places and speeds from SUMO, not from their scripts.
    """

    tolerance = 1e-3  # m, between the vehicle model and SUMO

    def __init__(
        self, traci: Any, world: World, *, ads_asks: bool = False, as_read: bool = False
    ) -> None:
        self.traci, self.ads_asks, self.as_read = traci, ads_asks, as_read
        cases = world.cases
        self.calls = vehicles(traci)
        self.step = simulation_step(traci)
        # raises ControllerError if an ADS has touched SUMO's clock by this time, s
        self.check_clock = partial(check_clock, traci, simulation_time(traci), world.settings.step)
        self.names = vehicle_names(cases, ads_asks=ads_asks)
        road = cases[0].road
        self._alone = len(cases) == 1
        self._bent = road.bent
        self._road = road
        self._step = world.settings.step
        # whether SUMO receives places on lanes: in a curve a place on the map costs it fifty times
        # the time
        self._on_lanes = self._bent and not as_read
        # edges of each vehicle's route, on a road of several sections
        self._routes = _routes(world, self.names) if as_read and road.spans else {}
        # Whether SUMO can move by itself the actors that only keep their speed: on a straight road,
        # where the actors' motion depends on time alone.
        quiet = as_read and not road.line and not any(case.lively for case in cases)
        self._to_sumo = 2 if quiet else 1  # as of `move_rows`
        # the speed that SUMO received last, m/s along the line, by vehicle
        self._received_speeds: dict[str, float] = {}
        self._edges, self._lane, self._keep_route = _addresses(
            cases, ads_asks=ads_asks, as_read=as_read
        )
        actors = [name for names in self.names for name in names[1:]]
        front_x, front_y = world.others["front_x"], world.others["front_y"]
        world.shown[:, :, 0], world.shown[:, :, 1] = front_x, front_y
        self.speeds: dict[str, float] = {}  # m/s, of vehicles as read after the last step
        # x and y of front bumpers, m, of vehicles as last read; of actors at first at their start
        fronts = zip(front_x.ravel().tolist(), front_y.ravel().tolist(), strict=True)
        self.fronts = dict(zip(actors, fronts, strict=True))
        # in a curve, actors with a place on the map: SUMO drives no lane backwards
        on_map = (
            actor.on_map is not None or math.cos(actor.heading) < 0.0
            for it in cases for actor in it.actors
        )  # fmt: skip
        self._on_map = set(compress(actors, on_map))
        self.keep(world)

    def keep(self, world: World) -> None:
        """Keep only the rows that the world still has, in its order."""
        self._width = 1 + world.others.shape[1]  # vehicles of a row
        # by number of the vehicle: its name, its edge
        self._flat = [name for case in world.rows.tolist() for name in self.names[case]]
        self._edge = [self._edges[case] for case in world.rows.tolist() for _ in range(self._width)]
        # a memory view: to read a single number of it takes a tenth as long as of an array
        self._present: Any = world.others["present"].data
        self.without(world)

    def without(self, world: World) -> None:
        """Continue without the rows that have ended."""
        self._live = world.live
        self._names: list[str] = []  # of vehicles that are read at once; empty: to be found again
        # name -> row and index of the actors that `read_at_once` leaves to `read`
        self._unread: dict[str, tuple[int, int]] = {}

    def take_charge(self, world: World) -> None:
        """Take control of SUMO's vehicles; fail cases whose start SUMO shows differently."""
        calls = self.calls
        for case, (concrete, names) in enumerate(zip(world.cases, self.names, strict=True)):
            try:
                check_start(self.traci, concrete, world.settings, names, by_map=self.as_read)
            except SimulationError as error:
                world.fail(case, "sim_error", str(error))
                continue
            starts = [(actor.start, actor.follows_at_once) for actor in concrete.actors]
            for name, (start, follows) in zip(names, [(concrete.ego, False), *starts], strict=True):
                calls.setLaneChangeMode(name, 0)  # SUMO changes no lane by itself
                if follows:  # SUMO's model drives it
                    continue
                calls.setSpeedMode(name, EXACT_SPEED_MODE)
                self._received_speeds[name] = start.speed
                if name == EGO and hasattr(self.traci, "ego_has_speed"):
                    continue  # a program (`ServedSimulation`) may have set a speed of its own
                calls.setSpeed(name, start.speed)
            for name, actor in zip(names[1:], concrete.actors, strict=True):
                if departure_speed(actor) < actor.start.speed:
                    calls.setPreviousSpeed(name, actor.start.speed)

    def exchange(self, world: World) -> tuple[int, bool]:
        """`to_sumo` of `move_rows`, the vehicles that SUMO receives in the coming step, and whether
        SUMO and the world are compared after it: in the first and in every tenth step.

        Near the road's end SUMO receives them at every step. Otherwise it would drive on a vehicle
        that slows down by its script, and remove it at the end.
        """
        steps = world.steps
        compares = not self.as_read and (steps == 0 or (steps + 1) % CHECKED_EVERY == 0)
        sends = self.ads_asks or compares or world.may_leave(world.time + self._step)
        return (self._to_sumo if sends else 0), compares

    def _move(self, number: int, x: float, y: float, angle: float, speed: float) -> None:
        """Put the front bumper of a vehicle where it is on the map at the step's end.

        x, y: m. angle: SUMO's, deg. speed: m/s.
        """
        name = self._flat[number]
        self.calls.setSpeed(name, speed)
        self.calls.moveToXY(name, self._edge[number], self._lane, x, y, angle, self._keep_route)

    def tell(self, world: World, count: int) -> None:
        """Hand the motion of this step to SUMO: `count` rows of `world.tell`."""
        if not count:  # in most steps
            return
        if self._on_lanes:
            self._tell_lanes(world, count)
            return
        if self._routes:
            self._tell_sections(world, count)
            return
        set_speed = self.calls.setSpeed
        move = self.calls.moveToXY
        names = self._flat
        # `_move`, written out: a call less for each vehicle and step
        for number, x, y, angle, speed in world.tell[:count, :5].tolist():
            name = names[int(number)]
            edge = self._edge[int(number)]
            set_speed(name, speed)
            move(name, edge, self._lane, x, y, angle, self._keep_route)

    def put_aside(self, numbers: Sequence[int]) -> None:
        """Hide vehicles that have left the network; with `as_read`, remove them."""
        for number in numbers:
            name = self._flat[number]
            if self.as_read:
                self.traci.vehicle.remove(name)
                self.speeds.pop(name, None)
                self._names = []
                continue
            self._set_aside(name, self._edge[number])

    def _set_aside(self, name: str, edge: str) -> None:
        """Put a vehicle where SUMO has no lane for it, so that no other vehicle sees it."""
        self.calls.setSpeed(name, 0.0)
        self.calls.moveToXY(name, edge, -1, 10.0, ASIDE, STRAIGHT, self._keep_route)

    def begin_again(self, world: World, row: int) -> None:
        """Put the vehicles of a new case in a row to their places after the case's first step."""
        for j, body in enumerate((world.egos[row], *world.others[row])):
            angle = STRAIGHT - math.degrees(body["map"]["heading"])
            number = row * self._width + j
            self._move(number, body["front_x"], body["front_y"], angle, body["speed"])

    def _tell_sections(self, world: World, count: int) -> None:
        """Hand over the motion of this step on a road of several sections.

        SUMO looks for a vehicle's lane on its route. For a vehicle in a lane off its route, SUMO
        has to look at all edges near it, and gives it another route. In a batch its row leaves:
        the edges of all rows are at the same place.
        """
        calls = self.calls
        for number, x, y, angle, speed in world.tell[:count, :5].tolist():
            name, edge = self._flat[int(number)], self._edge[int(number)]
            mode = _OWN_ROAD if on_route(self._road, self._routes[name], x, y) else _ANY_ROAD
            if mode == _ANY_ROAD and not self._alone:
                world.leave(int(number) // self._width, LEFT_BATCH)
                continue
            calls.setSpeed(name, speed)
            calls.moveToXY(name, edge, self._lane, x, y, angle, mode)

    def _tell_lanes(self, world: World, count: int) -> None:
        """Hand over the motion of this step on a curved road, as places on lanes.

        SUMO's step then moves a vehicle by the mean of its old and new speed. So each vehicle is
        put that much behind its place at the step's end. A vehicle of `_on_map`, which drives
        straight on the map or has driven against the lanes, gets a place on the map instead.
        """
        calls = self.calls
        end = self._road.end
        for number, x, y, angle, speed, s, d, along in world.tell[:count].tolist():
            number = int(number)
            name = self._flat[number]
            if along < 0.0:
                self._on_map.add(name)
            if name in self._on_map:
                self._move(number, x, y, angle, speed)
                continue
            begin = s - 0.5 * (self._received_speeds.get(name, along) + along) * self._step
            if not (begin >= 0.0 and s < end):  # there are no lanes
                continue
            calls.setSpeed(name, along)
            calls.moveTo(name, f"{self._edge[number]}_0", begin)
            calls.setLateralLanePosition(name, d)
            self._received_speeds[name] = along

    def read_at_once(self, world: World) -> list[int]:
        """Read the egos and the actors; return the rows whose egos remain to be read, as they do
        more than drive straight ahead. The actors that remain are for `read`.
        """
        calls = self.calls
        names = self._names or self._find_names()
        write = _SHOWN.pack_into
        place = 0  # of the vehicle's values, bytes
        for name in names:
            try:
                front = calls.getPosition(name)
                angle = calls.getAngle(name)
                speed = calls.getSpeed(name)
            except self.traci.TraCIException:  # it has left SUMO
                if self._alone and name == self._flat[0]:  # the ego
                    raise
                front, angle, speed = _UNKNOWN
                self.fronts.pop(name, None)  # so its row, if it is an ego, leaves the batch
                self.speeds.pop(name, None)
            else:
                self.fronts[name], self.speeds[name] = front, speed
            x, y = front
            write(self._values, place, x, y, angle, speed)
            place += _SHOWN.size
        remaining = world.read(self._numbers, self._values, self._odd)
        if not remaining and not self._unread:  # in most steps
            return []
        return self._keep_unread(self._odd[:remaining])

    def _keep_unread(self, numbers: IntArray) -> list[int]:
        """Leave the actors among these vehicles to `read`; return the rows of the egos."""
        self._unread = {}
        rows = []
        for number in numbers.tolist():
            row, column = divmod(number, self._width)
            if column:
                self._unread[self._flat[number]] = row, column - 1
            else:
                rows.append(row)
        return rows

    def _find_names(self) -> list[str]:
        """Names of the egos and of the actors that are present, in rows that have not ended."""
        present, width = self._present, self._width
        cells = product(self._live.tolist(), range(width))  # row, column; column 0: the ego
        numbers = [row * width + j for row, j in cells if not j or present[row, j - 1]]
        self._numbers = np.array(numbers)
        self._odd = np.zeros_like(self._numbers)
        self._values: Any = np.empty((len(self._numbers), 4))  # as in `World.shown`
        self._names = [self._flat[number] for number in numbers]
        return self._names

    def read(self, world: World) -> None:
        """Read the actors, if they are as SUMO shows them."""
        if not self.as_read:
            return
        present = self._present
        for name, (row, j) in self._unread.items():
            shown = _NOT_THERE  # as in `World.shown`
            if present[row, j]:
                try:
                    shown = self._read_actor(world, name, row, j)
                except self.traci.TraCIException:
                    present[row, j] = 0
                    self._names = []
                    self.speeds.pop(name, None)
                    note_leaving(world, row, j)
                except SimulationError:
                    if self._alone:
                        raise
                    world.leave(row, LEFT_BATCH)
            world.shown[row, j] = shown

    def _read_actor(
        self, world: World, name: str, row: int, j: int
    ) -> tuple[float, float, float, float]:
        """x and y of an actor's front bumper, angle and speed as SUMO shows them.

        Raises TraCIException if the actor has left SUMO, SimulationError for impossible values.
        """
        calls = self.calls
        x, y = front = calls.getPosition(name)
        angle = calls.getAngle(name)
        speed = calls.getSpeed(name)
        last_x, last_y = world.shown[row, j, :2].tolist()
        near = abs(x - last_x) < FARTHEST and abs(y - last_y) < FARTHEST
        if near and 0.0 <= angle <= 360.0 and LOWEST_SPEED < speed < FASTEST:
            self.fronts[name], self.speeds[name] = front, speed
            return x, y, angle, speed
        if may_leave_sumo(world, row, j):  # SUMO shows such values of a vehicle on no lane
            raise self.traci.TraCIException(name)
        raise impossible(calls, name, (last_x, last_y), world.time + self._step)

    def compare(self, world: World) -> None:
        """Fail the cases in which SUMO shows a vehicle elsewhere than it received it."""
        # a row for each vehicle: number, x and y of its front bumper on the map, m, y of its centre
        received = world.received(self._road.end - LOSS_MARGIN)
        numbers = received[:, 0].astype(int).tolist()
        places = received[:, 1:3].tolist()
        shown = map(self.calls.getPosition, [self._flat[number] for number in numbers])
        tolerances = [self.tolerance] * len(numbers)
        if self._bent:
            tolerances = bend_tolerance(self._road, received[:, 3]).tolist()
        for number, (x, y), (shown_x, shown_y), tolerance in zip(
            numbers, places, shown, tolerances, strict=True
        ):
            if not math.hypot(shown_x - x, shown_y - y) <= tolerance:  # `not`: finds a nan as well
                row, column = divmod(number, self._width)
                fail_misplaced(
                    world, row, column,
                    f"put the front bumper of {{}} at ({shown_x:.3f}, {shown_y:.3f}) m "
                    f"instead of ({x:.3f}, {y:.3f}) m.", ads_asks=self.ads_asks,
                )  # fmt: skip

    def remove(self, world: World, row: int, shadows: Sequence[str] = ()) -> None:
        """Remove the vehicles of a case that has ended from its batch, and their shadows."""
        if self._alone:
            return
        for name in (*self.names[world.case_of(row)], *shadows):
            with suppress(self.traci.TraCIException):  # SUMO may have removed it
                self.traci.vehicle.remove(name)


def _routes(world: World, names: Sequence[Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """The edges of each vehicle's route, by its name in SUMO."""
    routes = {}
    for case, settings, its_names in zip(world.cases, world.each, names, strict=True):
        starts = departures(case, settings.vehicle.length, exact=True)
        edges = vehicle_routes(case, starts)
        for name, start in zip(its_names, starts, strict=True):
            routes[name] = edges[start["route"]]
    return routes


def _addresses(
    cases: Sequence[ConcreteScenario], *, ads_asks: bool, as_read: bool
) -> tuple[list[str], int, int]:
    """Arguments of moveToXY: the edge of each case, the lane and `keepRoute`.

    SUMO has to look for the lane of a place in a user's network, which has several edges, and
    where an ADS may move a vehicle to any lane. In a case alone, it also looks for the edge.

    ads_asks, as_read: as of `Stage`.
    """
    count = len(cases)
    finds_lane = cases[0].road.network is not None or as_read
    any_edge = finds_lane and count == 1
    edges = [
        "" if any_edge else f"road{suffix(case, count, ads_asks=ads_asks)}" for case in range(count)
    ]
    # lane -1: SUMO looks for it
    return edges, -1 if finds_lane else 0, _ANY_ROAD if any_edge else _OWN_ROAD
