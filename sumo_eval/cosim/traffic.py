"""SUMO's side of cases in which vehicles react: SUMO's models drive these vehicles, and SUMO
receives all others at every step.

A vehicle that SUMO receives is put where it was at the start of a step, with the speed that it has
at the end. SUMO's step then moves it to its place at the end, where followers see it.

For SUMO a body is in one lane only. So a vehicle that reaches into a neighbouring lane, by more
than `SimulationSettings.seen_over_line`, has a second body there, its shadow. A shadow that is not
needed stands beside the road, where it is on no lane and no vehicle sees it.

Users: `cosim/simulation.py`.
"""

from collections.abc import Sequence
from math import cos
from typing import Any

import numpy as np

from sumo_eval.cosim.discrepancies import fail_misplaced
from sumo_eval.cosim.doors.observation import lanes_at
from sumo_eval.cosim.impossible import FASTEST, LOWEST_SPEED
from sumo_eval.cosim.lane_places import (
    Vehicles,
    exact_begins,
    ground_of_lane,
    inside_lanes,
    shadow_lanes,
)
from sumo_eval.cosim.records import NOT_SENT, STRAIGHT
from sumo_eval.cosim.stage import EXACT_SPEED_MODE, Stage
from sumo_eval.cosim.sumo.session import NOWHERE
from sumo_eval.cosim.sumo.shared_files import has_shadow, shadow_name
from sumo_eval.cosim.world import World
from sumo_eval.scenario.bodies import VULNERABLE
from sumo_eval.scenario.played import HANDED_OVER
from sumo_eval.trajectory import FloatArray, IntArray

# m by which SUMO's position in a curve may differ: more than `tolerance`, as lanes are polylines
_TOLERANCE_IN_A_CURVE = 0.1
_ITS_OWN_SPEED_MODE = 31  # bits 0 to 4, SUMO's default: all checks of its model are on


class Traffic(Stage):
    """The running simulation of the cases of a world in which vehicles react.

    With `as_read` SUMO receives positions on the map, as a TraCI program puts them, and there are
    no shadows.
    """

    # m by which SUMO's position may differ after a step: SUMO moves by the mean of both speeds
    tolerance = 0.05

    def keep(self, world: World) -> None:
        """Keep only the rows that the world still has, in its order."""
        cases = world.rows.tolist()
        # rows and columns of the actors that SUMO drives
        self._reacting = np.nonzero(world.players.plays["model"])
        # whether each vehicle, by number, is a pedestrian or a cyclist
        self._vulnerable = np.array(
            [[False, *(it.body in VULNERABLE for it in world.cases[case].actors)] for case in cases]
        ).ravel()
        self._shadow_of = [
            "" if self.as_read or not has_shadow(world.cases[case], j) else shadow_name(name)
            for case in cases
            for j, name in enumerate(self.names[case])
        ]
        self._has_shadow = np.array(self._shadow_of) != ""
        super().keep(world)

    def take_charge(self, world: World) -> None:
        """Take control of the vehicles that SUMO does not drive."""
        super().take_charge(world)
        self._handed: set[str] = set()  # vehicles that SUMO has begun to drive within their case
        self._shown_shadows: set[str] = set()
        # number of a vehicle that SUMO received -> position of its front along the lane after the
        # step, m
        self._expected: dict[int, float] = {}
        calls = self.calls
        for name in filter(None, self._shadow_of):
            calls.setSpeedMode(name, EXACT_SPEED_MODE)
            calls.setLaneChangeMode(name, 0)
            self._hide(name)
        if self.as_read:
            return
        world.egos["stale"] = 1
        # SUMO moves a vehicle in a lane by its speeds along the lane, also in the first step
        for names, concrete in zip(self.names, world.cases, strict=True):
            for name, actor in zip(names[1:], concrete.actors, strict=True):
                if actor.heading:
                    along = max(actor.start.speed * cos(actor.heading), 0.0)
                    self._received_speeds[name] = along
                    calls.setPreviousSpeed(name, along)

    def exchange(self, world: World) -> tuple[int, bool]:
        """As of `Stage`, but SUMO receives all vehicles: those that react see them."""
        _, compares = super().exchange(world)
        return 1, compares

    def _hide(self, name: str) -> None:
        """Put a shadow beside the road."""
        self._set_aside(name, self._edge[0])  # any edge will do: beside it there is no lane
        self._shown_shadows.discard(name)

    def _hide_shadow(self, number: int) -> None:
        """Put the shadow of a vehicle beside the road, unless it is there."""
        if self._shadow_of[number] in self._shown_shadows:
            self._hide(self._shadow_of[number])

    def put_aside(self, numbers: Sequence[int]) -> None:
        """Hide vehicles, with their shadows."""
        super().put_aside(numbers)
        for number in numbers:
            self._hide_shadow(number)

    def tell(self, world: World, count: int) -> None:
        """Hand the motion of this step to SUMO: `count` rows of `world.tell`."""
        self._hand_over(world)
        if self.as_read:
            super().tell(world, count)
            return
        if not count:
            return
        received = world.tell[:count]
        numbers = received[:, 0].astype(np.intp)
        now = Vehicles(world.egos, world.others, numbers)
        before = Vehicles(world.egos["before"], world.others["before"], numbers)
        # of each vehicle at the step's end: position of its front along the lane, m, y of its
        # front, m, and speed along the road, m/s
        s, y, along = received[:, 5:].T
        heading, half = now.field("heading"), 0.5 * now.field("length")
        self._expected = dict(zip(numbers.tolist(), s.tolist(), strict=True))
        names = [self._flat[n] for n in numbers.tolist()]
        # m/s, the speed that SUMO received last; of a vehicle without one, this step's
        last = [self._received_speeds.get(name, v) for name, v in zip(names, along, strict=True)]
        # SUMO's step moves a vehicle by the mean of both speeds
        begin = s - 0.5 * (np.array(last) + along) * self._step
        if not self._bent:
            begin = exact_begins(begin, before, half)
        road = self._road
        # SUMO has pedestrians and cyclists on no lane
        on_lanes = inside_lanes(road, begin, y, heading, self._step) & ~self._vulnerable[numbers]
        # `moveTo` leads no vehicle that was beside the lanes back to its last lane: put such a
        # vehicle on the map
        for k in np.flatnonzero(on_lanes).tolist():
            name = names[k]
            on_lanes[k] = name in self._received_speeds or self.calls.getLaneIndex(name) >= 0
        lane = lanes_at(road, y)
        # m, half the extent of each body across the road
        across = 0.5 * now.field("width") * np.abs(np.cos(heading))
        across += half * np.abs(np.sin(heading))
        over_line = world.settings.seen_over_line
        shadow_lane = shadow_lanes(road, now.field("y"), across, lane, over_line)
        shadow_lane[~(on_lanes & self._has_shadow[numbers])] = -1
        for vehicle, *motion in received[~on_lanes, :5].tolist():
            self._move(int(vehicle), *motion)
            self._hide_shadow(int(vehicle))
            self._received_speeds.pop(self._flat[int(vehicle)], None)  # it is on no lane
        along = np.maximum(along, 0.0)
        columns = numbers, lane, shadow_lane, begin, y, along, before.field("speed")
        for values in zip(*(column[on_lanes].tolist() for column in columns), strict=True):
            self._put_on_lane(*values)

    def _hand_over(self, world: World) -> None:
        """Let SUMO drive the actors whose scripts handed them over to a model in the last step."""
        present = (world.others["present"] == 1) & (world.egos["live"] == 1)[:, None]
        models = world.players.plays["model"]
        for row, j in np.argwhere((models == HANDED_OVER) & present).tolist():
            number = row * self._width + 1 + j
            if self._flat[number] not in self._handed:
                self._reacting = np.nonzero(models)
                self._hand_over_one(number, world.others[row, j])

    def _hand_over_one(self, number: int, other: Any) -> None:
        """Let SUMO drive an actor from its place and speed on.

        number: of the vehicle. other: its record.
        """
        calls = self.calls
        road = self._road
        name = self._flat[number]
        self._handed.add(name)
        calls.setSpeedMode(name, _ITS_OWN_SPEED_MODE)
        if not self.as_read:
            self._hide_shadow(number)
            x = other["x"]
            y = other["y"]
            lane = int(lanes_at(road, y))
            ground = float(ground_of_lane(road, x, y)) if self._bent else 1.0
            # SUMO's position is the position of the front, in metres of the lane
            half = 0.5 * other["length"]
            calls.moveTo(name, f"{self._edge[number]}_{lane}", x + half / ground)
            calls.setLateralLanePosition(name, y - road.lane_width * lane)
        speed = other["speed"] * cos(other["heading"])
        calls.setPreviousSpeed(name, max(speed, 0.0))
        calls.setSpeed(name, -1.0)  # SUMO's model drives from here on
        self._received_speeds.pop(name, None)

    def _put_on_lane(
        self, number: int, lane: int, shadow_lane: int, begin: float, y: float, along: float,
        speed_before: float,
    ) -> None:  # fmt: skip
        """Put a vehicle and its shadow where they are at the step's start, with the speed of its
        end.

        number: of the vehicle.
        lane, shadow_lane: of its body and of its shadow; -1: no shadow.
        begin: position of its front along the lane at the step's start, m.
        y: position across the road at the step's end, m.
        along: speed along the road at the step's end, m/s.
        speed_before: speed at the step's start, m/s.
        """
        calls = self.calls
        name = self._flat[number]
        shadow = self._shadow_of[number]
        if name not in self._received_speeds:
            calls.setPreviousSpeed(name, along)
        self._received_speeds[name] = along
        edge = self._edge[number]
        bodies = [(name, lane)]
        if shadow_lane < 0:
            self._hide_shadow(number)
        else:
            bodies.append((shadow, shadow_lane))
            # A new shadow comes from beside the road. Without these calls SUMO would take its speed
            # there, 0, for its last speed, and would not lead it back to a lane.
            if shadow not in self._shown_shadows:
                calls.setPreviousSpeed(shadow, speed_before)
                calls.moveTo(shadow, f"{edge}_{lane}", begin)
                self._shown_shadows.add(shadow)
        for body, its_lane in bodies:
            calls.moveTo(body, f"{edge}_{its_lane}", begin)
            calls.setLateralLanePosition(body, y - self._road.lane_width * its_lane)
            calls.setSpeed(body, along)

    def read(self, world: World) -> None:
        """Take in where SUMO has driven the vehicles that react."""
        if self.as_read:
            super().read(world)
        others = world.others
        rows, columns = self._reacting
        present = (world.egos["live"][rows] == 1) & (others["present"][rows, columns] == 1)
        rows = rows[present]
        columns = columns[present]
        names = [self._flat[number] for number in (rows * self._width + 1 + columns).tolist()]
        if not names:
            return
        try:
            shown = self._shown(names)
        except self.traci.TraCIException:  # one of them has left the network
            shown = np.concatenate([self._shown_or_nowhere(name) for name in names])
        speed = shown[:, 3]
        # of a vehicle on no lane SUMO shows an impossible speed; `~`: true of nan as well
        absent = (shown[:, 0] <= NOWHERE) | ~((speed > LOWEST_SPEED) & (speed < FASTEST))
        others["told"][rows, columns] = NOT_SENT
        for k in np.flatnonzero(absent).tolist():
            others["present"][rows[k], columns[k]] = 0
            now = world.time + world.settings.step
            world.note(world.case_of(rows[k]), "actor_left_the_network", now, now)
        self._take(world, rows[~absent], columns[~absent], shown[~absent])
        world.put_on_map()

    def _shown(self, names: list[str]) -> FloatArray:
        """x, y, angle and speed of vehicles as SUMO shows them, (n, 4).

        On a curved road x is the position along the lane, and y and angle are placeholders.
        """
        calls = self.calls
        shown = np.full((len(names), 4), STRAIGHT)
        shown[:, 3] = list(map(calls.getSpeed, names))
        if self._bent:
            shown[:, 0] = list(map(calls.getLanePosition, names))
            return shown
        shown[:, :2] = list(map(calls.getPosition, names))
        if self.as_read:  # only TraCI code can turn a vehicle from its lane's direction
            shown[:, 2] = list(map(calls.getAngle, names))
        return shown

    def _shown_or_nowhere(self, name: str) -> FloatArray:
        """`_shown` of one vehicle; at x = `NOWHERE` if it has left the network."""
        try:
            return self._shown([name])
        except self.traci.TraCIException:
            return np.array([[NOWHERE, 0.0, STRAIGHT, 0.0]])

    def _take(self, world: World, rows: IntArray, columns: IntArray, shown: FloatArray) -> None:
        """Write to the world the positions and speeds of the actors that SUMO drives.

        rows, columns: of each actor in `World.others`.
        shown: as of `_shown`.
        """
        others = world.others
        at = (rows, columns)
        half = 0.5 * others["length"][at]
        front = shown[:, 0]
        speed = shown[:, 3]
        if self._bent:
            # of the front instead of the centre: at a curve's begin x differs by centimetres
            ground = ground_of_lane(self._road, front, others["y"][at])
            others["x"][at] = front - half / ground
            others["heading"][at] = 0.0
            speed = speed * ground
        else:
            # within -180..180 deg
            heading = np.radians((STRAIGHT - shown[:, 2] + 180.0) % 360.0 - 180.0)
            others["x"][at] = front - half * np.cos(heading)
            others["y"][at] = shown[:, 1] - half * np.sin(heading)
            others["heading"][at] = heading
            others["front_x"][at] = front
            others["front_y"][at] = shown[:, 1]
        others["across"][at] = 0.0
        others["acceleration"][at] = (speed - others["speed"][at]) / world.settings.step
        others["speed"][at] = speed

    def compare(self, world: World) -> None:
        """Fail the cases in which SUMO shows a vehicle elsewhere than it was put."""
        if not self._bent:
            super().compare(world)
            return
        for number, expected in self._expected.items():
            row, j = divmod(number, self._width)
            name = self._flat[number]
            if world.egos["reason"][row] or name not in self._received_speeds:
                continue
            off = self.calls.getLanePosition(name) - expected
            if not abs(off) <= _TOLERANCE_IN_A_CURVE:  # `not <=`: true of nan as well
                words = f"put {{}} {off:.3f} m along its lane from its place."
                fail_misplaced(world, row, j, words, ads_asks=self.ads_asks)

    def remove(self, world: World, row: int, shadows: Sequence[str] = ()) -> None:
        """Remove the vehicles of a case that has ended from its batch, and their shadows."""
        of_row = self._shadow_of[row * self._width : (row + 1) * self._width]
        super().remove(world, row, list(filter(None, of_row)))
        self._shown_shadows.difference_update(of_row)
