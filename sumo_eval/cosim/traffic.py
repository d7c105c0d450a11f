"""SUMO's side of cases in which vehicles react: SUMO drives them, and is told of everybody else at every step.

Everybody else is put where it is at the begin of a step, with the speed that it has at the end, so that who follows it
sees what is. SUMO knows a body in one lane only. Here we say in which: the main one where the middle of its front is,
and a second body, its shadow, in the lane over whose line it reaches (`SimulationSettings.seen_over_line`). A shadow
that is not needed stands beside the road, where SUMO has lost it and nobody sees it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sumo_eval.cosim.contact import within_a_turn
from sumo_eval.cosim.impossible import BACKWARDS, BESIDE, FASTEST
from sumo_eval.cosim.stage import EXACT_SPEED_MODE, Stage
from sumo_eval.cosim.sumo.session import NOWHERE
from sumo_eval.cosim.sumo.shared_files import has_shadow, shadow_name
from sumo_eval.cosim.world import STRAIGHT, World
from sumo_eval.scenario.bodies import VULNERABLE

_ASIDE = -500.0  # m, y of a shadow that nobody is to see
_AS_TOLD = 0.05  # m, that SUMO's own step may differ from ours within a step: it takes the mean of both speeds
_DEGREES = 180.0 / math.pi


class Traffic(Stage):
    """The running simulation of the cases of a world in which vehicles react."""

    def __init__(self, traci: Any, world: World, *, asked: bool = False, as_read: bool = False) -> None:
        self._models = [[actor.model is not None for actor in case.actors] for case in world.cases]
        self._on_foot = [[False, *(actor.body in VULNERABLE for actor in case.actors)] for case in world.cases]
        self._road = world.cases[0].road
        self._shadows = not as_read and self._road.lanes > 1
        super().__init__(traci, world, asked=asked, as_read=as_read)
        self._tolerance = _AS_TOLD

    def keep(self, world: World) -> None:
        """From now on these rows, in this order."""
        cases = world.rows.tolist()
        self._reacting = [
            (row, j, self.names[case][1 + j])
            for row, case in enumerate(cases)
            for j, is_model in enumerate(self._models[case])
            if is_model
        ]
        self._walks = [walks for case in cases for walks in self._on_foot[case]]
        self._shadow_of = [
            shadow_name(self.names[case][j]) if self._shadows and has_shadow(world.cases[case], j) else ""
            for case in cases
            for j in range(1 + len(self._models[case]))
        ]
        super().keep(world)

    def take_charge(self, world: World) -> None:
        """Make SUMO obey where it does not drive itself."""
        super().take_charge(world)
        self._seen: set[str] = set()
        calls = self.calls
        for name in filter(None, self._shadow_of):
            calls.setSpeedMode(name, EXACT_SPEED_MODE)
            calls.setLaneChangeMode(name, 0)
            self._hide(name)
        if not self.as_read:
            world.egos["stale"] = 1

    def closely(self, steps: int) -> bool:
        """Who reacts is to see everybody at every step."""
        return True

    def _hide(self, name: str) -> None:
        self.calls.setSpeed(name, 0.0)
        self.calls.moveToXY(name, self._edge[0], -1, 10.0, _ASIDE, STRAIGHT, self._keep)
        self._seen.discard(name)

    def tell(self, world: World, count: int) -> None:
        """Hand the motion of this step to SUMO: so many rows of `world.tell`."""
        if self.as_read:
            super().tell(world, count)
            return
        calls, road, names, width = self.calls, self._road, self._flat, self._width
        least, most = road.right_edge + BESIDE, road.left_edge - BESIDE
        over = world.settings.seen_over_line
        end = road.length + road.run_out
        for vehicle, x, y, angle, speed in world.tell[:count, :5].tolist():
            number = int(vehicle)
            row, j = divmod(number, width)
            name, edge = names[number], self._edge[row]
            body = world.egos[row] if j == 0 else world.others[row, j - 1]
            was = body["before"]
            half = 0.5 * float(body["length"])
            begin = float(was["x"]) + half * math.cos(float(was["heading"]))
            calls.setSpeed(name, speed)
            if self._walks[number] or not (
                least < y < most and 0.0 <= begin < end - FASTEST * world.settings.step * 0.1
            ):
                calls.moveToXY(name, edge, -1 if road.network else 0, x, y, angle, self._keep)
                if self._shadow_of[number] in self._seen:
                    self._hide(self._shadow_of[number])
                continue
            heading = (STRAIGHT - angle) / _DEGREES
            along = speed * math.cos(heading)
            lane = min(max(round(y / road.lane_width), 0), road.lanes - 1)
            calls.moveTo(name, f"{edge}_{lane}", begin)
            calls.setLateralLanePosition(name, y - road.lane_width * lane)
            calls.setSpeed(name, max(along, 0.0))
            shadow = self._shadow_of[number]
            if not shadow:
                continue
            wide = 0.5 * float(body["width"]) * abs(math.cos(heading)) + half * abs(math.sin(heading))
            other = self._lane_beside(float(body["y"]), wide, lane, over)
            if other < 0:
                if shadow in self._seen:
                    self._hide(shadow)
                continue
            if shadow not in self._seen:
                calls.setPreviousSpeed(shadow, float(was["speed"]))
                self._seen.add(shadow)
            calls.moveTo(shadow, f"{edge}_{other}", begin)
            calls.setLateralLanePosition(shadow, y - road.lane_width * other)
            calls.setSpeed(shadow, max(along, 0.0))

    def _lane_beside(self, y: float, wide: float, lane: int, over: float) -> int:
        """The lane beside its own into which a body reaches further than the setting says, -1 without one."""
        width = self._road.lane_width
        if y + wide > width * (lane + 0.5) + over and lane + 1 < self._road.lanes:
            return lane + 1
        if y - wide < width * (lane - 0.5) - over and lane > 0:
            return lane - 1
        return -1

    def read(self, world: World) -> None:
        """Where SUMO has driven those that react."""
        if self.as_read:
            super().read(world)
        calls, others, step = self.calls, world.others, world.settings.step
        if self.compares(world.steps):
            for row in self._live.tolist():
                for j in np.flatnonzero(others["present"][row]).tolist():
                    if others["told"][row, j] == 2:
                        world.shown[row, j, :2] = calls.getPosition(self._flat[row * self._width + 1 + j])
        for row, j, name in self._reacting:
            other = others[row, j]
            if not world.egos["live"][row] or not other["present"]:
                continue
            other["told"] = 1
            try:
                x, y = calls.getPosition(name)
                angle, speed = calls.getAngle(name), calls.getSpeed(name)
            except self.traci.TraCIException:
                x, y, angle, speed = NOWHERE, 0.0, STRAIGHT, 0.0
            if x <= NOWHERE or not BACKWARDS < speed < FASTEST:
                other["present"] = 0
                world.note(int(world.rows[row]), "actor_left_the_network", world.time + step, world.time + step)
                continue
            heading = within_a_turn((STRAIGHT - angle) / _DEGREES) if angle != STRAIGHT else 0.0
            half = 0.5 * float(other["length"])
            other["x"], other["y"] = x - half * math.cos(heading), y - half * math.sin(heading)
            other["heading"], other["across"] = heading, 0.0
            other["acceleration"] = (speed - float(other["speed"])) / step
            other["speed"] = speed
            other["front_x"], other["front_y"] = x, y

    def remove(self, world: World, row: int) -> None:
        """Take the vehicles of a case that has ended off their road, while others go on."""
        if self._alone:
            return
        held = set(self.traci.vehicle.getIDList()) if not world.others["present"][row].all() else None
        for number in range(row * self._width, (row + 1) * self._width):
            for name in (self._flat[number], self._shadow_of[number]):
                if name and (held is None or name in held):
                    self.traci.vehicle.remove(name)
                self._seen.discard(name)
