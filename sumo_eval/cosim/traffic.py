"""SUMO's side of cases in which vehicles react: SUMO drives them, and is told of everybody else at
every step.

Everybody else is put where it is at the begin of a step, with the speed that it has at the end, so
that who follows it sees what is. SUMO knows a body in one lane only. Here we say in which: the main
one where the middle of its front is, and a second body, its shadow, in the lane over whose line it
reaches (`SimulationSettings.seen_over_line`). A shadow that is not needed stands beside the road,
where SUMO has lost it and nobody sees it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.impossible import BACKWARDS, BESIDE, FASTEST
from sumo_eval.cosim.records import STRAIGHT
from sumo_eval.cosim.stage import ASIDE, EXACT_SPEED_MODE, Stage, joined
from sumo_eval.cosim.sumo.session import NOWHERE
from sumo_eval.cosim.sumo.shared_files import has_shadow, shadow_name
from sumo_eval.cosim.world import World
from sumo_eval.scenario.bodies import VULNERABLE
from sumo_eval.scenario.played import HANDED_OVER
from sumo_eval.scenario.road.reference_line import curvatures
from sumo_eval.trajectory import BoolArray, FloatArray

_AS_TOLD_ON_A_BEND = 0.1  # m: on top of that, lanes are polygons of 1 m
_DEGREES = 180.0 / math.pi
_ITS_OWN_SPEED_MODE = 31  # SUMO's default: as its model says


def _of_all(world: World, number: NDArray[np.intp], name: str) -> FloatArray:
    """One field of vehicles by their number: the ego of a row, then its others, then the next
    row.
    """
    return joined(world.egos, world.others, name).ravel()[number]


class Traffic(Stage):
    """The running simulation of the cases of a world in which vehicles react."""

    # m, that SUMO's own step may differ from ours within a step: it takes the mean of both speeds
    tolerance = 0.05

    def __init__(
        self, traci: Any, world: World, *, asked: bool = False, as_read: bool = False
    ) -> None:
        self._on_foot = [
            [False, *(actor.body in VULNERABLE for actor in case.actors)] for case in world.cases
        ]
        self._road = world.cases[0].road
        self._handed: set[str] = set()  # those that SUMO drives from within the case on
        self._shadows = not as_read and self._road.lanes > 1
        super().__init__(traci, world, asked=asked, as_read=as_read)

    def keep(self, world: World) -> None:
        """From now on these rows, in this order."""
        cases = world.rows.tolist()
        self._count_reacting(world)
        self._walks = np.array([walks for case in cases for walks in self._on_foot[case]])
        self._shadow_of = [
            shadow_name(self.names[case][j])
            if self._shadows and has_shadow(world.cases[case], j)
            else ""
            for case in cases
            for j in range(len(self._on_foot[case]))
        ]
        self._has_shadow = np.array([bool(name) for name in self._shadow_of])
        super().keep(world)
        self._lanes = [
            [f"{edge}_{lane}" for lane in range(self._road.lanes)] for edge in self._edge
        ]

    def _count_reacting(self, world: World) -> None:
        """Whom SUMO drives by now."""
        rows, columns = np.nonzero(world.players.plays["model"])
        self._reacting = rows, columns
        names = [
            self.names[case][1 + j]
            for case, j in zip(world.rows[rows].tolist(), columns.tolist(), strict=True)
        ]
        self._reacting_names = np.array(names, dtype=object)

    def _hand_over(self, world: World) -> None:
        """Let SUMO drive those from here on that have begun to follow in the last step."""
        others = world.others
        there = (others["present"] == 1) & (world.egos["live"] == 1)[:, None]
        late = np.argwhere((world.players.plays["model"] == HANDED_OVER) & there).tolist()
        began = [
            (row, j) for row, j in late if self._flat[row * self._width + 1 + j] not in self._handed
        ]
        if not began:
            return
        self._count_reacting(world)
        calls, road = self.calls, self._road
        for row, j in began:
            number, other = row * self._width + 1 + j, others[row, j]
            name, speed = (
                self._flat[number],
                max(float(other["speed"]) * math.cos(float(other["heading"])), 0.0),
            )
            self._handed.add(name)
            lane = min(max(round(float(other["y"]) / road.lane_width), 0), road.lanes - 1)
            calls.setSpeedMode(name, _ITS_OWN_SPEED_MODE)
            if not self.as_read:
                if self._shadow_of[number] in self._seen:
                    self._hide(self._shadow_of[number])
                inner = (
                    1.0 - float(curvatures(road.line, other["x"])) * float(other["y"])
                    if self._bent
                    else 1.0
                )
                calls.moveTo(
                    name,
                    self._lanes[row][lane],
                    float(other["x"]) + 0.5 * float(other["length"]) / inner,
                )
                calls.setLateralLanePosition(name, float(other["y"]) - road.lane_width * lane)
            calls.setPreviousSpeed(name, speed)
            calls.setSpeed(name, -1.0)
            self._told.pop(name, None)

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
        self.calls.moveToXY(name, self._edge[0], -1, 10.0, ASIDE, STRAIGHT, self._keep)
        self._seen.discard(name)

    def put_aside(self, numbers: Sequence[int]) -> None:
        """Their shadows go with them."""
        super().put_aside(numbers)
        for number in numbers:
            if self._shadow_of[number] in self._seen:
                self._hide(self._shadow_of[number])

    def tell(self, world: World, count: int) -> None:
        """Hand the motion of this step to SUMO: so many rows of `world.tell`."""
        self._hand_over(world)
        if self.as_read:
            super().tell(world, count)
            return
        if not count:
            return
        told = world.tell[:count]
        number = told[:, 0].astype(np.intp)
        was = {
            key: joined(world.egos["before"], world.others["before"], key).ravel()[number]
            for key in ("x", "heading", "speed")
        }
        half = 0.5 * _of_all(world, number, "length")
        if self._bent:
            y, along = told[:, 6], told[:, 7]
            heading = _of_all(world, number, "heading")
            before = np.array(
                [
                    self._told.get(self._flat[n], v)
                    for n, v in zip(number.tolist(), along, strict=True)
                ]
            )
            begin = told[:, 5] - 0.5 * (before + along) * self._step
        else:
            y, heading = told[:, 2], (STRAIGHT - told[:, 3]) / _DEGREES
            along = told[:, 4] * np.cos(heading)
            begin = was["x"] + half * np.cos(was["heading"])
        on_lanes = self._on_lanes_from(number, begin, y, heading)
        lane = np.clip(np.round(y / self._road.lane_width), 0, self._road.lanes - 1).astype(np.intp)
        wide = 0.5 * _of_all(world, number, "width") * np.abs(np.cos(heading))
        wide += half * np.abs(np.sin(heading))
        centre = _of_all(world, number, "y")
        beside = np.where(
            on_lanes & self._has_shadow[number],
            self._lanes_beside(centre, wide, lane, world.settings.seen_over_line), -1,
        )  # fmt: skip
        if not on_lanes.all():
            for k in np.flatnonzero(~on_lanes).tolist():
                _, x, north, angle, speed = told[k, :5].tolist()
                self._put_anywhere(int(number[k]), x, north, angle, speed)
        self._put_on_lanes(
            np.flatnonzero(on_lanes).tolist(), number.tolist(), lane.tolist(), begin.tolist(),
            y.tolist(),
            np.maximum(along, 0.0).tolist(), beside.tolist(), was["speed"].tolist(),
        )  # fmt: skip

    def _on_lanes_from(
        self, number: NDArray[np.intp], begin: FloatArray, y: FloatArray, heading: FloatArray
    ) -> BoolArray:
        """Who of those told can be put on a lane: not who walks, is beside them, comes the other
        way, or drives off.
        """
        road = self._road
        inside = (
            (y > road.right_edge + BESIDE) & (y < road.left_edge - BESIDE) & (np.cos(heading) > 0.0)
        )
        inside &= (begin >= 0.0) & (begin < road.length + road.run_out - FASTEST * self._step * 0.1)
        return np.asarray(inside & ~self._walks[number])

    def _lanes_beside(
        self, y: FloatArray, wide: FloatArray, lane: NDArray[np.intp], over: float
    ) -> NDArray[np.intp]:
        """The lane beside its own into which each body reaches further than the setting says, -1
        without one.
        """
        width, lanes = self._road.lane_width, self._road.lanes
        left = (y + wide > width * (lane + 0.5) + over) & (lane + 1 < lanes)
        right = (y - wide < width * (lane - 0.5) - over) & (lane > 0)
        return np.where(left, lane + 1, np.where(right, lane - 1, -1))

    def _put_anywhere(self, number: int, x: float, y: float, angle: float, speed: float) -> None:
        calls, name = self.calls, self._flat[number]
        calls.setSpeed(name, speed)
        calls.moveToXY(
            name,
            self._edge[number // self._width],
            -1 if self._road.network else 0,
            x,
            y,
            angle,
            self._keep,
        )
        if self._shadow_of[number] in self._seen:
            self._hide(self._shadow_of[number])

    def _put_on_lanes(
        self, chosen: list[int], number: list[int], lane: list[int], begin: list[float],
        y: list[float],
        along: list[float], beside: list[int], before: list[float],
    ) -> None:  # fmt: skip
        """Put vehicles and their shadows where they are at the step's begin, with the speed that
        they have at its end.

        The lists are of all that are told;

        chosen: places in them.
        """
        move, aside, set_speed = (
            self.calls.moveTo,
            self.calls.setLateralLanePosition,
            self.calls.setSpeed,
        )
        width = self._road.lane_width
        for k in chosen:
            name, lanes = self._flat[number[k]], self._lanes[number[k] // self._width]
            move(name, lanes[lane[k]], begin[k])
            aside(name, y[k] - width * lane[k])
            set_speed(name, along[k])
            if self._bent:
                self._told[name] = along[k]
            shadow = self._shadow_of[number[k]]
            if beside[k] < 0:
                if shadow in self._seen:
                    self._hide(shadow)
                continue
            if shadow not in self._seen:
                self.calls.setPreviousSpeed(shadow, before[k])
                self._seen.add(shadow)
            move(shadow, lanes[beside[k]], begin[k])
            aside(shadow, y[k] - width * beside[k])
            set_speed(shadow, along[k])

    def read(self, world: World) -> None:
        """Where SUMO has driven those that react."""
        if self.as_read:
            super().read(world)
        others = world.others
        rows, columns = self._reacting
        there = (world.egos["live"][rows] == 1) & (others["present"][rows, columns] == 1)
        rows, columns, names = rows[there], columns[there], self._reacting_names[there].tolist()
        if not names:
            return
        try:
            shown = self._shown(names)
        except self.traci.TraCIException:  # one of them has left the network
            shown = np.concatenate([self._shown_or_nowhere(name) for name in names])
        speed = shown[:, 3]
        gone = (shown[:, 0] <= NOWHERE) | ~((speed > BACKWARDS) & (speed < FASTEST))
        others["told"][rows, columns] = 1
        for k in np.flatnonzero(gone).tolist():
            others["present"][rows[k], columns[k]] = 0
            now = world.time + world.settings.step
            world.note(int(world.rows[rows[k]]), "actor_left_the_network", now, now)
        self._take(world, rows[~gone], columns[~gone], shown[~gone])
        world.put_on_map()

    def _shown(self, names: list[str]) -> FloatArray:
        """x, y, angle and speed of vehicles; on a bend the place along its lane, as SUMO's drivers
        know it, (n, 4).
        """
        calls, found = self.calls, np.full((len(names), 4), STRAIGHT)
        found[:, 3] = list(map(calls.getSpeed, names))
        if self._bent:
            found[:, 0] = list(map(calls.getLanePosition, names))
            return found
        found[:, :2] = list(map(calls.getPosition, names))
        if self.as_read:  # else nobody can have taken it out of its lane
            found[:, 2] = list(map(calls.getAngle, names))
        return found

    def _shown_or_nowhere(self, name: str) -> FloatArray:
        try:
            return self._shown([name])
        except self.traci.TraCIException:
            return np.array([[NOWHERE, 0.0, STRAIGHT, 0.0]])

    def _take(
        self, world: World, rows: NDArray[np.intp], columns: NDArray[np.intp], shown: FloatArray
    ) -> None:
        """Write to the world where those that react are."""
        others, at = world.others, (rows, columns)
        half, speed = 0.5 * others["length"][at], shown[:, 3]
        if self._bent:  # a metre of lane is 1 - curvature y metres of ground
            inner = 1.0 - curvatures(self._road.line, shown[:, 0]) * others["y"][at]
            others["x"][at], others["heading"][at], speed = (
                shown[:, 0] - half / inner,
                0.0,
                speed * inner,
            )
        else:
            heading = np.radians((STRAIGHT - shown[:, 2] + 180.0) % 360.0 - 180.0)
            others["x"][at], others["y"][at] = (
                shown[:, 0] - half * np.cos(heading),
                shown[:, 1] - half * np.sin(heading),
            )
            others["heading"][at] = heading
            others["front_x"][at], others["front_y"][at] = shown[:, 0], shown[:, 1]
        others["across"][at] = 0.0
        others["acceleration"][at] = (speed - others["speed"][at]) / world.settings.step
        others["speed"][at] = speed

    def compare(self, world: World) -> None:
        """A case in which SUMO shows something else than it was told has come to its end."""
        if not self._bent:
            super().compare(world)
            return
        for row in self._live.tolist():
            for j in range(self._width):
                body = world.egos[row] if j == 0 else world.others[row, j - 1]
                name = self._flat[row * self._width + j]
                if world.egos["reason"][row] or (j and not (body["present"] and body["told"] == 2)):
                    continue
                if name not in self._told or not self._on_some_lane(name):
                    continue
                inner = 1.0 - float(curvatures(self._road.line, body["x"])) * float(body["y"])
                ahead = 0.5 * float(body["length"]) * math.cos(float(body["heading"])) / inner
                off = self.calls.getLanePosition(name) - float(body["x"]) - ahead
                if not abs(off) <= _AS_TOLD_ON_A_BEND:  # which also finds a nan
                    who = (
                        "the ego"
                        if j == 0
                        else f"vehicle `{world.cases[int(world.rows[row])].actors[j - 1].name}`"
                    )
                    world.fail(
                        row,
                        "sim_error",
                        f"SUMO put {who} {off:.3f} m along its lane from where it was told.",
                    )

    def _on_some_lane(self, name: str) -> bool:
        return bool(self.calls.getLaneIndex(name) >= 0)

    def remove(self, world: World, row: int) -> None:
        """Take the vehicles of a case that has ended off their road, while others go on."""
        if self._alone:
            return
        held = (
            set(self.traci.vehicle.getIDList()) if not world.others["present"][row].all() else None
        )
        for number in range(row * self._width, (row + 1) * self._width):
            for name in (self._flat[number], self._shadow_of[number]):
                if name and (held is None or name in held):
                    self.traci.vehicle.remove(name)
                self._seen.discard(name)
