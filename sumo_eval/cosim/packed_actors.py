"""The other vehicles of a pack: their scripts, handed to SUMO at each step, and what SUMO then shows of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.contact import Body
from sumo_eval.cosim.packed_files import edge_name, vehicle_name
from sumo_eval.cosim.packed_senses import STRAIGHT, Seen, as_seen, read_headings
from sumo_eval.cosim.session import vehicles
from sumo_eval.cosim.simulate import moved_spans, scripted_spans
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, ConstantLateral, Road
from sumo_eval.trajectory import BoolArray, FloatArray

Index = NDArray[np.intp]
KEEPS_ROUTE_OFF_ROAD = 3  # moveToXY: onto the vehicle's own road and no other, and as far off it as told
_SCRIPT_TOLERANCE = 0.02  # m, less than in `simulate`
_NOWHERE = 1e6  # m and m/s, SUMO's places and speeds that are none are far beyond


@dataclass(slots=True)
class _Script:
    """One script and everybody who follows it: (case, index of the actor) pairs."""

    actor: Actor
    spans: list[tuple[float, float]]
    who: list[tuple[int, int]]

    def moves(self, time: float) -> bool:
        """Whether the harness moves the actor at a time."""
        return any(begin < time < end for begin, end in self.spans)


@dataclass(slots=True)
class _Slides:
    """Actors whose script is one `ConstantLateral`, the cut-in of UN R157, moved with one computation."""

    case: Index
    index: Index
    start_x: FloatArray
    start_y: FloatArray
    along: FloatArray
    half_length: FloatArray
    begin: FloatArray
    duration: FloatArray
    speed: FloatArray
    offset: FloatArray
    rise: FloatArray

    @classmethod
    def of(cls, actors: Sequence[tuple[int, int, Actor]]) -> _Slides:
        rows = [
            (case, index, a.start.x, a.start.y, a.start.speed, 0.5 * a.length, *_moves(m))
            for case, index, a in actors
            for m in a.lane_changes
            if isinstance(m, ConstantLateral)
        ]
        case, index, *others = np.array(rows, dtype=np.float64).reshape(-1, 11).T
        return cls(case.astype(np.intp), index.astype(np.intp), *others)

    def moving(self, time: float, step: float) -> BoolArray:
        """Which of them the harness moves at a time."""
        return (self.begin < time) & (time < self.begin + self.duration + step)

    def places(self, who: Index, time: float) -> tuple[FloatArray, FloatArray]:
        """x of the front bumper and y of some of them at a time."""
        since, rise, speed = np.maximum(time - self.begin[who], 0.0), self.rise[who], self.speed[who]
        covered = (since - 0.5 * rise) * speed
        np.divide(0.5 * speed * since * since, rise, out=covered, where=since < rise)
        done = np.minimum(covered, np.abs(self.offset[who]))
        front = self.start_x[who] + self.along[who] * time + self.half_length[who]
        return front, self.start_y[who] + np.copysign(done, self.offset[who])

    def lateral_speed(self, time: float) -> FloatArray:
        """As `ConstantLateral.lateral_speed`."""
        since = time - self.begin
        speed = self.speed.copy()
        np.divide(self.speed * since, self.rise, out=speed, where=since < self.rise)
        moving = (since >= 0.0) & (since < self.duration)
        return np.where(moving, np.copysign(speed, self.offset), 0.0)

    def of_cases(self, stays: BoolArray) -> _Slides:
        """Those of some cases; stays: by number of the case."""
        kept = stays[self.case]
        if kept.all():
            return self
        return _Slides(*(getattr(self, name)[kept] for name in self.__slots__))


class PackedActors:
    """m other vehicles in each of k cases; arrays (k, m), as `simulate` reads them off SUMO.

    x, y: centre. across: m/s to the left of the heading, of those that slide. `seen`: what a sensor shows. surprised:
    where SUMO has shown a place, a speed or an angle that it was not told, (k,).
    """

    def __init__(self, cases: Sequence[ConcreteScenario], step: float) -> None:
        self._step = step
        self.case = np.arange(len(cases))  # number of the case of each row
        self._row = np.arange(len(cases))  # row of each case
        self.actors = [case.actors for case in cases]
        self.names = [[vehicle_name(case, 1 + j) for j in range(len(row))] for case, row in enumerate(self.actors)]
        self._edges = [edge_name(case) for case in range(len(cases))]
        self.x, self.speed, self.length, self.width = np.moveaxis(
            np.array(
                [[(a.start.x, a.start.speed, a.length, a.width) for a in row] for row in self.actors], dtype=np.float64
            ),
            2,
            0,
        ).copy()
        self.y = np.array([[a.y(0.0) for a in row] for row in self.actors], dtype=np.float64)
        self.half_length, self.half_width = 0.5 * self.length, 0.5 * self.width
        self.heading, self.across = np.zeros(self.x.shape), np.zeros(self.x.shape)
        self.angle = np.full(self.x.shape, STRAIGHT)
        self.front_x, self.front_y = self.x + self.half_length, self.y
        self.start_x, self.start_y, self.start_speed = self.x, self.y, self.speed
        self.before = self.x, self.y, self.heading, self.speed, self.across
        self.scripted_until = np.array(
            [max((end for a in row for _, end in scripted_spans(a, step)), default=0.0) for row in self.actors]
        )
        self._sort_scripts(cases[0].road)
        self._moved: list[tuple[int, int]] = []  # by the last step, and turning or changing their speed
        self._changing: list[tuple[int, int]] = []
        self.surprised = np.zeros(len(cases), dtype=bool)
        self.set_live(np.arange(len(cases)))
        self.seen = self._shown_to_a_sensor()

    def _sort_scripts(self, road: Road) -> None:
        slides: list[tuple[int, int, Actor]] = []
        scripts: dict[Actor, _Script] = {}
        for case, row in enumerate(self.actors):
            for index, actor in enumerate(row):
                spans = moved_spans(actor, self._step, road)
                if _only_slides(actor) and math.isfinite(spans[-1][1]):
                    slides.append((case, index, actor))
                elif spans:
                    scripts.setdefault(actor, _Script(actor, spans, [])).who.append((case, index))
        self._slides = _Slides.of(slides)
        self._all_scripts = list(scripts.values())
        self._scripts = self._all_scripts

    def set_live(self, rows: Index) -> None:
        """The rows of the cases that go on; only their vehicles are in SUMO."""
        self._live = rows
        self._all = len(rows) == len(self.case)
        self._shown = [name for case in self.case[rows].tolist() for name in self.names[case]]

    def without(self, cases: Sequence[int]) -> None:
        """Drop the scripts of cases that have ended."""
        gone = set(cases)
        for script in self._all_scripts:
            if any(case in gone for case, _ in script.who):
                script.who = [pair for pair in script.who if pair[0] not in gone]
        self._all_scripts = [script for script in self._all_scripts if script.who]
        self._scripts = [script for script in self._scripts if script.who]
        self._moved = [pair for pair in self._moved if pair[0] not in gone]
        stays = np.ones(len(self.actors), dtype=bool)
        stays[list(gone)] = False
        self._slides = self._slides.of_cases(stays)

    def keep(self, rows: Index) -> None:
        """Hold only these rows, in this order."""
        for name in (
            "case", "x", "y", "heading", "speed", "across", "angle", "front_x", "front_y", "length", "width",
            "half_length", "half_width", "start_x", "start_y", "start_speed", "scripted_until",
            "surprised",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[rows])
        self.seen = Seen(*(channel[rows] for channel in self.seen))
        self._row[self.case] = np.arange(len(rows))
        self.set_live(np.arange(len(rows)))

    # -- motion --------------------------------------------------------------------------------------------------------

    def move(self, traci: Any, time: float, after: float, *, closely: bool) -> None:
        """Scripted motion to a time, as in `simulate`; straight on at constant speed, or standing, SUMO moves them.

        after: the time of the next step. closely: SUMO is told of everybody. Else it hears of one that slides only when
        it takes over: it shows to the last bit what it is told, which every close look checks.
        """
        set_speed, move = vehicles(traci).setSpeed, vehicles(traci).moveToXY
        names, edges = self.names, self._edges
        moved: list[tuple[int, int]] = []
        over = False
        for script in self._scripts:
            if not script.moves(time):
                over |= self._is_over(script, time)
                continue
            actor = script.actor
            along, across = actor.speed(time), actor.lateral_speed(time)
            heading = 0.0 if actor.slides else math.atan2(across, along)
            speed = along if actor.slides else math.hypot(along, across)
            half = 0.5 * actor.length
            x, y = actor.x(time) + half * math.cos(heading), actor.y(time) + half * math.sin(heading)
            angle = STRAIGHT - math.degrees(heading)
            for case, index in script.who:
                name = names[case][index]
                set_speed(name, speed)
                move(name, edges[case], 0, x, y, angle, KEEPS_ROUTE_OFF_ROAD)
            moved += script.who
        self._slide(traci, time, after, closely=closely)
        self._changing = moved + self._moved  # SUMO takes over from the harness in the step after the last move
        self._moved = moved
        if over:
            self._scripts = [script for script in self._scripts if not self._is_over(script, time)]

    def _slide(self, traci: Any, time: float, after: float, *, closely: bool) -> None:
        slides = self._slides
        moving = slides.moving(time, self._step)
        who = np.flatnonzero(moving)
        front, y = slides.places(who, time)
        told = np.ones(len(who), dtype=bool) if closely else ~slides.moving(after, self._step)[who]
        self._slid = (self._row[slides.case[who]], slides.index[who]), front, y, told
        for one in np.flatnonzero(told).tolist():
            case, index = int(slides.case[who[one]]), int(slides.index[who[one]])
            place = float(front[one]), float(y[one])
            vehicles(traci).moveToXY(
                self.names[case][index], self._edges[case], 0, *place, STRAIGHT, KEEPS_ROUTE_OFF_ROAD
            )

    def _is_over(self, script: _Script, time: float) -> bool:
        return all(end + self._step < time for _, end in script.spans)

    # -- observation ---------------------------------------------------------------------------------------------------

    def look(self, traci: Any, now: float, *, closely: bool) -> None:
        """Read off SUMO where they are; closely: angles and speeds of all, too, not of those alone that change them."""
        self.before = self.x, self.y, self.heading, self.speed, self.across
        angle, vehicle = self.angle, vehicles(traci)
        self._read_fronts(traci)
        self._follow_slides(now)
        if closely:
            self._read_motion(traci)
            unexpected = (self.speed != self.before[3]) | (self.angle != angle)
            for case, index in self._changing:
                unexpected[self._row[case], index] = False
            self.surprised = self.surprised | unexpected.any(axis=1)
        elif self._changing:
            pairs = self._changing
            who = [self.names[case][index] for case, index in pairs]
            at = self._row[[case for case, _ in pairs]], np.array([index for _, index in pairs])
            self.speed, self.angle = self.speed.copy(), self.angle.copy()
            self.speed[at] = list(map(vehicle.getSpeed, who))
            self.angle[at] = list(map(vehicle.getAngle, who))
        self._derive()

    def look_first(self, traci: Any) -> None:
        """What a sensor shows before the first step; the record begins where the scenario says."""
        start = self.front_x, self.front_y, self.angle, self.speed
        self._read_fronts(traci)
        self._read_motion(traci)
        self.seen = self._shown_to_a_sensor()
        self.front_x, self.front_y, self.angle, self.speed = start

    def _read_fronts(self, traci: Any) -> None:
        places = chain.from_iterable(map(vehicles(traci).getPosition, self._shown))
        read = np.fromiter(places, np.float64, 2 * len(self._shown)).reshape(len(self._live), -1, 2)
        if not (read.min() > -_NOWHERE and read.max() < _NOWHERE):  # on no lane SUMO loses a place; no nan is within
            there = (read > -_NOWHERE) & (read < _NOWHERE)
            self.surprised = self.surprised.copy()
            self.surprised[self._live[~there.all(axis=(1, 2))]] = True
        if self._all:
            self.front_x, self.front_y = read[:, :, 0].copy(), read[:, :, 1].copy()
            return
        self.front_x, self.front_y = self.front_x.copy(), self.front_y.copy()
        self.front_x[self._live], self.front_y[self._live] = read[:, :, 0], read[:, :, 1]

    def _read_motion(self, traci: Any) -> None:
        shape = len(self._live), self.x.shape[1]
        self.speed, self.angle = self.speed.copy(), self.angle.copy()
        self.speed[self._live] = np.array(list(map(vehicles(traci).getSpeed, self._shown))).reshape(shape)
        self.angle[self._live] = np.array(list(map(vehicles(traci).getAngle, self._shown))).reshape(shape)

    def _follow_slides(self, now: float) -> None:
        """Those that slide are where they were moved to, and have a speed across."""
        slides = self._slides
        sliding = [script for script in self._scripts if script.actor.slides]
        if not slides.case.size and not sliding:
            return
        at, front, y, told = self._slid
        wrong = told & ((self.front_x[at] != front) | (self.front_y[at] != y))
        if wrong.any():
            self.surprised = self.surprised.copy()
            self.surprised[at[0][wrong]] = True
        self.front_x[at], self.front_y[at] = front, y
        self.across = self.across.copy()
        self.across[self._row[slides.case], slides.index] = slides.lateral_speed(now)
        for script in sliding:
            across = script.actor.lateral_speed(now)
            for case, index in script.who:
                self.across[self._row[case], index] = across

    def _derive(self) -> None:
        """Bodies as `simulate` reads them, and what a sensor shows."""
        self.x, self.y = self.front_x - self.half_length, self.front_y
        turned = np.nonzero(self.angle != STRAIGHT)
        if not turned[0].size:
            self.heading = np.zeros(self.x.shape)
            nothing = self.heading
            self.seen = Seen(self.x, self.y, nothing, self.speed, nothing, self.half_length, self.half_width)
            return
        heading = read_headings(self.angle[turned])
        half = self.half_length[turned]
        self.heading, self.y = np.zeros(self.x.shape), self.y.copy()
        self.heading[turned] = heading
        self.x[turned] = self.front_x[turned] - half * np.array(list(map(math.cos, heading.tolist())))
        self.y[turned] = self.front_y[turned] - half * np.array(list(map(math.sin, heading.tolist())))
        self.seen = self._shown_to_a_sensor()

    def _shown_to_a_sensor(self) -> Seen:
        arrays = self.front_x, self.front_y, self.angle, self.speed, self.half_length, self.half_width
        flat = as_seen(*(array.ravel() for array in arrays))
        return Seen(*(channel.reshape(self.x.shape) for channel in flat))

    def off_their_scripts(self, time: float) -> BoolArray:
        """Rows in which one is not where its script has it, which `simulate` puts on record, (k,)."""
        x, y = self.start_x + self.start_speed * time, self.start_y.copy()
        slides = self._slides
        at = self._row[slides.case], slides.index
        front, y[at] = slides.places(np.arange(len(slides.case)), time)
        x[at] = front - slides.half_length
        for script in self._all_scripts:
            place = script.actor.x(time), script.actor.y(time)
            for case, index in script.who:
                x[self._row[case], index], y[self._row[case], index] = place
        off = ~((np.abs(self.x - x) <= _SCRIPT_TOLERANCE) & (np.abs(self.y - y) <= _SCRIPT_TOLERANCE))  # as nan is
        return np.asarray(off.any(axis=1))

    def accelerations(self, time: float) -> Iterator[tuple[int, int, float]]:
        """Row, index and acceleration of those that have one at a time, m/s2."""
        for script in self._scripts:
            value = script.actor.acceleration(time)
            if value != 0.0 or math.copysign(1.0, value) < 0.0:
                for case, index in script.who:
                    yield int(self._row[case]), index, value

    def bodies(self, row: int) -> list[tuple[Body, Body]]:
        """Every other vehicle of a case at the beginning and at the end of the last step."""
        found = []
        for index, actor in enumerate(self.actors[self.case[row]]):
            x, y, heading, speed, across = (float(channel[row, index]) for channel in self.before)
            was = Body(x, y, heading, speed, actor.length, actor.width, across)
            here = self.x, self.y, self.heading, self.speed, self.across
            x, y, heading, speed, across = (float(channel[row, index]) for channel in here)
            found.append((was, Body(x, y, heading, speed, actor.length, actor.width, across)))
        return found


def _moves(move: ConstantLateral) -> tuple[float, ...]:
    return move.begin, move.duration, move.speed, move.offset, move.rise


def _only_slides(actor: Actor) -> bool:
    """Whether an actor's whole script is one move across at constant speed that keeps its heading."""
    moves = actor.lane_changes
    return actor.slides and actor.brake is None and len(moves) == 1 and isinstance(moves[0], ConstantLateral)
