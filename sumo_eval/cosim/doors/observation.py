"""Observations of policies: the ego, the other vehicles relative to it, lanes and road edges.

`Observation` is one instant of one case, `Observations` of many cases as arrays: attributes of the
same name mean the same. Road coordinates: x along the road, y to the left, y = 0 on the centre line
of the right-hand lane. `Perception` applies the limits of `ConditionSettings`: delay, range, field
of view, misses, noise.

Names, order and units of the attributes are the contract with users (docs/ads/observation.md).

Users: `cosim/` makes observations, and its doors for JSON lines, FMUs and ONNX models read them;
`extras/bench/costs.py`, `extras/gym/episodes.py`, `extras/wheel/seat.py`.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import cos, inf, nan, radians, sin, tau
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cosim.records import SAME_TIME
from sumo_eval.kernels import Records
from sumo_eval.scenario.bodies import BODIES, CAR, half_sizes
from sumo_eval.scenario.concrete import ConcreteScenario, Road, lane_at
from sumo_eval.scenario.played import Pairs
from sumo_eval.scenario.road.pose import Pose, onto_the_line
from sumo_eval.scenario.road.reference_line import curvatures, map_places
from sumo_eval.settings import ConditionSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray, IntArray, half_extents

# Eight numbers of a vehicle. 0, 1: x, y, m. 2: heading, rad. 3: speed, m/s. 4, 5: length, width, m.
# 6: speed across, m/s. 7: acceleration of an ego, rate of the speed of an actor, m/s2.
_Body = Sequence[float]
_Look = tuple[_Body, Sequence[_Body]]  # the ego and the actors, as they are perceived
_tuple = tuple.__new__  # makes a NamedTuple in half the time of its own constructor
NO_LEAD_GAP = 1000.0  # m, the gap in `signals` where no vehicle is ahead
_COVERED = 0.8  # a vehicle is hidden if a nearer one covers more than this share of its width
# Five points of a body, its centre and its corners, as (ahead, left) in halves of its length and
# width; (5, 1, 1), for bodies (n, m).
_AHEAD, _LEFT = np.array([(0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)]).T[:, :, None, None]
_DRAWN = 64  # steps for which random numbers are drawn at once


def limits_of(conditions: ConditionSettings) -> tuple[float, ...]:
    """Limits of perception, seven numbers.

    0: delay, s.
    1: chance of a miss in a step.
    2, 3: standard deviation of the noise of positions, m, and of speeds, m/s.
    4, 5: range, m, and half the field of view, rad.
    6: 1 where a nearer vehicle can hide a farther one.
    """
    return (
        conditions.perception_delay, conditions.dropout,
        conditions.position_noise, conditions.speed_noise,
        conditions.sensor_range or inf,
        radians(conditions.field_of_view_deg or 360.0) / 2.0,
        conditions.occlusion,
    )  # fmt: skip


_NO_LIMITS = limits_of(ConditionSettings())
# Indices in `limits_of`.
_DELAY, _MISS = 0, 1
_FIELD_OF_VIEW, _OCCLUSION = 5, 6
_NOISE = [2, 2, 3]  # of x, y and speed
_CHANCE, _REACH = slice(1, 4), slice(4, 7)  # limits that need random numbers; that hide an actor


def sees_all(conditions: ConditionSettings) -> bool:
    """Whether the conditions let an ADS see the world as it is."""
    return limits_of(conditions) == _NO_LIMITS


KINDS = {kind: number for number, kind in enumerate(BODIES)}
"""Number of each kind of body, in observations that are numbers; -1 stands for no vehicle."""


class Task(NamedTuple):
    """Task of the ego.

    desired_speed: speed that the ego wants, m/s: its initial speed.
    goal: x, y of the road's end in the lane where the ego has to be then, m.
    change: first x at which the ego may change to the goal's lane, and x by which it must have
        changed, m; None: it may stay in its lane.
    """

    desired_speed: float
    goal: tuple[float, float]
    change: tuple[float, float] | None = None


_NO_TASK = Task(nan, (nan, nan))


def stream_of(seed: int, concrete: ConcreteScenario) -> str:
    """Name of the random numbers of a case's perception."""
    return f"{seed}/{concrete.scenario}/{concrete.label}"


def task_of(concrete: ConcreteScenario) -> Task:
    """The task of the ego in a concrete scenario."""
    road = concrete.road
    ego = concrete.ego
    change = ego.way
    goal_y = ego.y + change.offset if change else ego.y
    goal = road.length, road.lane_centre(lane_at(road, goal_y))
    return Task(ego.speed, goal, (change.begin, change.by) if change else None)


class LaneLine(NamedTuple):
    """Centre and borders of a lane, each a line of points (x, y), m, in the direction of travel."""

    centre: Pairs
    left: Pairs
    right: Pairs


@lru_cache(maxsize=16)
def lane_borders(road: Road) -> tuple[LaneLine, ...]:
    """The lanes of a road as lines, the right-hand lane first.

    Of a lane that opens or ends, only the part of full width.
    """
    half = 0.5 * road.lane_width
    lines = []
    for lane in range(road.lanes):
        span = road.span(lane)
        y = road.lane_centre(lane)
        begin = max(span.begin, 0.0)
        end = min(span.end, road.end)
        lines.append(
            LaneLine(*(((begin, y + beside), (end, y + beside)) for beside in (0.0, half, -half)))
        )
    return tuple(lines)


class SeenEgo(NamedTuple):
    """The ego's own state.

    x, y: of its centre, m; heading: rad; speed: m/s; acceleration: m/s2.
    lane: number of its lane; 0 is the right-hand lane.
    length, width: of its body, m.
    """

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float
    lane: int
    length: float
    width: float


class SeenVehicle(NamedTuple):
    """Another vehicle, relative to the ego at the instant it was seen.

    number: 1, 2, ..., of one vehicle throughout a case.
    ahead: whether its centre is ahead of the ego's.
    gap: distance along the road between the nearer ends of both bodies, m; negative beside the
        ego.
    relative_speed: its speed along the road less the ego's, m/s; negative of a lead that comes
        nearer.
    offset: how far its centre is to the left of the ego's, m.
    overlaps: whether its body reaches into the strip that the ego's body sweeps.
    speed: along its heading, m/s. lateral_speed: across the road, m/s, positive to the left.
    lane: number of its lane. length, width: of its body, m.
    x, y, heading: of its centre, m, and rad, in road coordinates.
    acceleration: change of its seen speed since it was last seen, m/s2; 0 until it has been seen
        twice.
    kind: `car`, `van`, `truck`, `motorcycle`, `bicycle`, `pedestrian` or `child`.
    """

    number: int
    ahead: bool
    gap: float
    relative_speed: float
    offset: float
    overlaps: bool
    speed: float
    lateral_speed: float
    lane: int
    length: float
    width: float
    x: float
    y: float
    heading: float
    acceleration: float
    kind: str = CAR


class _Computed:
    """An attribute that is computed at its first use.

    `__get__` writes the value into the object's `__dict__`, where Python finds it the next time.
    Faster than `functools.cached_property`, which takes a lock in Python 3.11.
    """

    def __init__(self, work: Callable[[Any], Any]) -> None:
        self._work = work
        self.__doc__ = work.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        value = instance.__dict__[self._name] = self._work(instance)
        return value


@dataclass(frozen=True, eq=False, init=False)
class Observation:
    """One instant; each attribute is computed at its first use.

    time: s since the start of the case.
    road: lanes and edges.
    _ego: the ego as it is, a `_Body`.
    _look: the ego and the actors as they are perceived; x is nan of an actor that is not seen.
    _kinds: kind of each actor.
    desired_speed, goal, change: as in `Task`; nan and None where there is no task.
    """

    time: float
    road: Road
    _ego: _Body
    _look: _Look
    _kinds: Sequence[str]
    desired_speed: float
    goal: tuple[float, float]
    change: tuple[float, float] | None

    def __init__(
        self, time: float, road: Road, ego: _Body, look: _Look, task: Task | None,
        kinds: Sequence[str],
    ) -> None:  # fmt: skip
        # past the frozen dataclass: its own constructor takes three times as long
        own = self.__dict__
        own["time"], own["road"], own["_ego"] = time, road, ego
        own["_look"] = look
        own["_kinds"] = kinds
        own["desired_speed"], own["goal"], own["change"] = task or _NO_TASK

    @_Computed
    def ego(self) -> SeenEgo:
        """The ego's own state, now."""
        me = self._ego
        return _tuple(SeenEgo, (*me[:4], me[7], lane_at(self.road, me[1]), me[4], me[5]))

    def _seen(self, number: int) -> SeenVehicle:
        """The actor of a number (1, 2, ...) relative to the ego."""
        me, others = self._look
        other = others[number - 1]
        x, y, heading = other[:3]
        speed, length, width = other[3:6]
        half_length, half_width = half_sizes(heading, length, width)
        my_half_length, my_half_width = half_sizes(me[2], me[4], me[5])
        along, across = _velocity(other)
        ahead, offset = x - me[0], y - me[1]
        return _tuple(SeenVehicle, (
            number, ahead > 0.0, abs(ahead) - half_length - my_half_length,
            along - _velocity(me)[0],
            offset, abs(offset) < half_width + my_half_width, speed, across, lane_at(self.road, y),
            length, width, x, y, heading, other[7], self._kinds[number - 1],
        ))  # fmt: skip

    @_Computed
    def vehicles(self) -> tuple[SeenVehicle, ...]:
        """The other vehicles that are seen, the nearest along the road first."""
        seen = [
            self._seen(number)
            for number, other in enumerate(self._look[1], 1)
            if other[0] == other[0]  # nan: not seen
        ]
        return tuple(sorted(seen, key=lambda vehicle: abs(vehicle.gap)))

    @_Computed
    def lead(self) -> SeenVehicle | None:
        """The nearest vehicle in front that reaches into the strip that the ego's body sweeps
        straight ahead.
        """
        me, others = self._look
        my_x, my_y = me[0], me[1]
        my_half_length, my_half_width = half_sizes(me[2], me[4], me[5])
        nearest = 0  # number of an actor; 0: none
        least = inf  # m, its gap
        for number, other in enumerate(others, 1):
            x = other[0]
            if x > my_x:  # false where x is nan: not seen
                half_length, half_width = half_sizes(other[2], other[4], other[5])
                gap = abs(x - my_x) - half_length - my_half_length
                if gap < least and abs(other[1] - my_y) < half_width + my_half_width:
                    nearest, least = number, gap
        return self._seen(nearest) if nearest else None

    @_Computed
    def neighbours(self) -> Mapping[str, SeenVehicle | None]:
        """Nearest vehicles by lane: `left_ahead`, `left_behind`, `right_ahead`, `right_behind`,
        `behind`.
        """
        lane = self.ego.lane
        nearest = {}
        for name, its_lane, ahead in (
            ("left_ahead", lane + 1, True), ("left_behind", lane + 1, False),
            ("right_ahead", lane - 1, True), ("right_behind", lane - 1, False),
            ("behind", lane, False),
        ):  # fmt: skip
            candidates = (v for v in self.vehicles if v.lane == its_lane and v.ahead == ahead)
            nearest[name] = min(candidates, key=lambda v: v.gap, default=None)
        return nearest

    @_Computed
    def lanes(self) -> tuple[float, ...]:
        """The lanes' centre lines to the left of the ego's centre, m, the right-hand lane first."""
        return tuple(self.road.lane_centre(lane) - self._ego[1] for lane in range(self.road.lanes))

    @property
    def speed_limit(self) -> float:
        """Speed limit of the road, m/s."""
        return self.road.speed_limit

    @property
    def lane_borders(self) -> tuple[LaneLine, ...]:
        """The lanes as lines in the coordinates of the vehicles, the right-hand lane first."""
        return lane_borders(self.road)

    @_Computed
    def second_lead(self) -> SeenVehicle | None:
        """The nearest vehicle in front of the lead that reaches into the strip that the ego's body
        sweeps.
        """
        first = None if self.lead is None else self.lead.number
        further = (v for v in self.vehicles if v.ahead and v.overlaps and v.number != first)
        return min(further, key=lambda v: v.gap, default=None)

    @property
    def left_edge(self) -> float:
        """Distance from the ego's centre to the left edge of the road, m."""
        return float(self.road.left_edge_at(self._ego[0])) - self._ego[1]

    @property
    def right_edge(self) -> float:
        """Distance from the ego's centre to the right edge of the road, m."""
        return self._ego[1] - float(self.road.right_edge_at(self._ego[0]))

    @property
    def curvature(self) -> float:
        """The curvature of the road's line (the right lane's centre) beside the ego, 1/m, positive
        to the left.
        """
        return float(curvatures(self.road.line, self._ego[0]))

    def lane_lines(self, ahead: float = 100.0, every: float = 2.0) -> tuple[FloatArray, ...]:
        """The lanes' centre lines, the right-hand lane first: of each lane points (n, 2), m ahead
        of the ego's centre and m to its left.

        ahead: length along the road, from the ego's centre on, m.
        every: distance of the points along the road, m.
        """
        road = self.road
        x, y, heading = self._ego[:3]
        me = Pose(*map(float, map_places(road.line, x, y, heading)))
        along = x + np.arange(0.0, ahead + 0.5 * every, every)
        lanes = (
            map_places(road.line, along, road.lane_centre(lane))[:2] for lane in range(road.lanes)
        )
        return tuple(onto_the_line(np.stack(lane, 1), me) for lane in lanes)

    def plain(self) -> dict[str, Any]:
        """All values that may change in a step, plain, ready for JSON."""
        return {
            "time": round(self.time, 6), "ego": self.ego._asdict(),
            "lead": self.lead and self.lead._asdict(),
            "second_lead": self.second_lead and self.second_lead._asdict(),
            "neighbours": {place: it and it._asdict() for place, it in self.neighbours.items()},
            "vehicles": [vehicle._asdict() for vehicle in self.vehicles], "lanes": list(self.lanes),
            "left_edge": self.left_edge, "right_edge": self.right_edge, "curvature": self.curvature,
        }  # fmt: skip

    def signals(self) -> dict[str, float]:
        """All values that are one number, by name.

        Of a place without a vehicle, `present` is 0, `gap` 1000 m and `kind` -1; `speed`, `x`, `y`
        and `heading` are the ego's; other values are 0. A kind is its number in `KINDS`: 0 is a
        car. `change_from` and `change_by` are nan where the ego may stay in its lane.
        """
        me, road = self.ego, self.road
        change_from, change_by = self.change or (nan, nan)
        values = {
            "time": self.time,
            **{f"ego_{name}": float(value) for name, value in me._asdict().items()},
            "left_edge": self.left_edge, "right_edge": self.right_edge,
            "lane_offset": -self.lanes[me.lane], "curvature": self.curvature,
            "lanes": float(road.lanes), "lane_width": road.lane_width,
            "speed_limit": road.speed_limit, "road_length": road.length,
            "desired_speed": self.desired_speed,
            "goal_x": self.goal[0], "goal_y": self.goal[1],
            "change_from": change_from, "change_by": change_by,
        }  # fmt: skip
        places = {"lead": self.lead, "second_lead": self.second_lead, **self.neighbours}
        for place, vehicle in places.items():
            values |= _place_signals(place, vehicle, me)
        return values


@dataclass(frozen=True)
class Observations:
    """One instant of n cases for a policy that takes arrays: the attributes of an `Observation`,
    under the same names.

    time: s; an array (n,) where cases begin one by one, as episodes do.
    number: of each case in its batch, (n,), the same at every step, by which a policy with memory
        finds a case.
    desired_speed: m/s, (n,).
    ego, lead: arrays (n,).
    vehicles: arrays (n, m), in the order of the scenario's vehicles.
    _egos, _others: records of the egos and of the actors.
    _seen: records of the actors as rules see them; x is nan in a record without a vehicle.
    _cases: of the whole batch; `number` is an index of it.
    """

    time: float
    road: Road
    number: IntArray
    _egos: Records
    _seen: Records
    _others: Records
    _cases: Sequence[ConcreteScenario]

    @cached_property
    def desired_speed(self) -> FloatArray:
        """The speed that each ego wants, m/s: its initial speed."""
        return np.array([self._cases[number].ego.speed for number in self.number.tolist()])

    @cached_property
    def kinds(self) -> IntArray:
        """Kinds of the vehicles, by their numbers in `KINDS`, (n, m): 0 is a car."""
        kinds = [
            [KINDS[actor.body] for actor in self._cases[number].actors]
            for number in self.number.tolist()
        ]
        return np.array(kinds, np.intp).reshape(self._seen.shape)

    @cached_property
    def ego(self) -> SimpleNamespace:
        """x, y, heading, speed, acceleration, lane, length, width."""
        own = {name: self._egos[name] for name in SeenEgo._fields if name != "lane"}
        return SimpleNamespace(**own, lane=lanes_at(self.road, self._egos["y"]))

    @cached_property
    def vehicles(self) -> SimpleNamespace:
        """ahead, gap, relative_speed, offset, overlaps, speed, lateral_speed, lane, length, width,
        x, y, heading, acceleration.
        """
        me = self._egos[:, None]
        others = self._others
        x = self._seen["x"]
        my_half_length, my_half_width = half_extents(me["heading"], me["length"], me["width"])
        half_length, half_width = half_extents(others["heading"], others["length"], others["width"])
        along, lateral_speed = _velocities(others)
        offset = others["y"] - me["y"]
        return SimpleNamespace(
            ahead=x > me["x"],
            gap=np.abs(x - me["x"]) - half_length - my_half_length,
            relative_speed=along - _velocities(me)[0],
            offset=offset,
            overlaps=np.abs(offset) < half_width + my_half_width,
            lateral_speed=lateral_speed,
            lane=lanes_at(self.road, others["y"]),
            acceleration=others["rate"],
            x=x,
            **{name: others[name] for name in ("speed", "length", "width", "y", "heading")},
        )

    @cached_property
    def lead(self) -> SimpleNamespace:
        """The nearest vehicle in front in the ego's strip of road: present, gap (inf without one),
        relative_speed (0), speed (the ego's), offset (0).
        """
        vehicles = self.vehicles
        rows = np.arange(len(self._egos))
        zeros = np.zeros(len(rows))
        # column 0 stands for no lead: `argmin` finds it first if all gaps are infinite
        gaps = np.column_stack(
            [zeros + np.inf, np.where(vehicles.ahead & vehicles.overlaps, vehicles.gap, np.inf)]
        )
        nearest = gaps.argmin(axis=1)

        def of_lead(without_lead: FloatArray, values: FloatArray) -> Any:
            """The lead's value of each case, from values (n, m)."""
            return np.column_stack([without_lead, values])[rows, nearest]

        return SimpleNamespace(
            present=nearest > 0,
            gap=gaps[rows, nearest],
            relative_speed=of_lead(zeros, vehicles.relative_speed),
            speed=of_lead(self._egos["speed"], vehicles.speed),
            offset=of_lead(zeros, vehicles.offset),
        )

    @cached_property
    def distances(self) -> FloatArray:
        """Distances along the road from each ego's centre to the vehicles' centres, (n, m), m; nan
        where there is no vehicle.
        """
        return np.asarray(self._seen["x"] - self._egos["seen"]["x"][:, None])

    @cached_property
    def nearest(self) -> IntArray:
        """Indices into `vehicles` of each case's vehicles, (n, m), the nearest along the road
        first.
        """
        return np.argsort(np.abs(self.vehicles.gap), axis=1, kind="stable")

    @property
    def curvature(self) -> FloatArray:
        """The curvature of the road's line beside each ego, 1/m, positive to the left, (n,)."""
        return curvatures(self.road.line, self._egos["x"])

    @property
    def lanes(self) -> FloatArray:
        """The lanes' centre lines to the left of each ego's centre, m, (n, lanes), the right-hand
        lane first.
        """
        centres = np.array([self.road.lane_centre(lane) for lane in range(self.road.lanes)])
        return np.asarray(centres - self._egos["y"][:, None])


class Perception:
    """Perception of n cases with m actors each.

    conditions: of each case.
    streams: name of the random numbers of each case: equal names give equal misses and noise.
    """

    _chance: FloatArray  # random numbers 0..1: misses are those below the dropout; (n, steps, m)
    _errors: FloatArray  # noise of x and y, m, and of speed, m/s; (n, steps, m, 3)

    def __init__(self, conditions: Sequence[ConditionSettings], streams: Sequence[str]) -> None:
        self._limits = np.array([limits_of(it) for it in conditions])
        self._used = (self._limits != _NO_LIMITS).any(axis=0)  # whether any case has a limit, (7,)
        has_chance = self._used[_CHANCE].any()
        self._random = [random_stream(0, "perception", it) for it in streams if has_chance]
        delays = self._limits[:, _DELAY]
        self._delays = delays.max(), delays.min()  # longest, shortest, s
        self._steps = 0
        # time, egos and actors of the last steps, as far back as the longest delay
        self._memory: deque[tuple[float, FloatArray, FloatArray]] = deque()

    def look(
        self, time: float, egos: FloatArray, others: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Egos and actors as they are seen at a step; call once a step.

        Both are as old as the perception delay. Until the delay has passed once, they are those of
        the first step.

        egos, others: the first 7 numbers of each `_Body`, (n, 7) and (n, m, 7); x is nan of an
            actor that has left.

        Returns copies. Actors have an eighth number, the rate of their seen speed, m/s2; x is nan
        of an actor that is not seen.
        """
        seen = np.empty((*others.shape[:2], 8))
        seen[..., :7] = others
        if self._steps == 0:
            # when each actor was last seen, s, and its speed then, m/s
            self._last = np.full((2, *others.shape[:2]), nan)
        x, speed = seen[..., 0], seen[..., 3]  # views: to write to them writes to `seen`
        visible = x == x  # false where x is nan
        if self._used[_REACH].any():
            visible &= self._within_reach(egos, others)
        if self._random:
            at = self._steps % _DRAWN
            if at == 0:
                self._draw(others.shape[1])
            visible &= self._chance[:, at] >= self._limits[:, _MISS, None]
            errors = self._errors[:, at]
            seen[..., :2] += errors[..., :2]
            # noise makes no speed negative; without noise a speed stays as it is
            np.maximum(speed + errors[..., 2], 0.0, out=speed, where=errors[..., 2] != 0.0)
        np.copyto(x, nan, where=~visible)
        seen[..., 7] = 0.0
        last_time, last_speed = self._last
        since = time - last_time
        np.divide(speed - last_speed, since, out=seen[..., 7], where=since > 0.0)
        np.copyto(last_time, time, where=visible)
        np.copyto(last_speed, speed, where=visible)
        self._steps += 1
        return self._delayed(time, egos.copy(), seen)

    def keep(self, rows: IntArray) -> None:
        """Drop all cases but these; keep their order."""
        self._limits = self._limits[rows]
        self._memory = deque((time, egos[rows], seen[rows]) for time, egos, seen in self._memory)
        if self._random:
            self._random = [self._random[row] for row in rows.tolist()]
        if self._steps:
            self._last = self._last[:, rows]
            if self._random:
                self._chance, self._errors = self._chance[rows], self._errors[rows]

    def _delayed(
        self, time: float, egos: FloatArray, seen: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Egos and actors of the newest step that is as old as the delay of each case.

        egos, seen: of the step at `time`, s.
        """
        memory = self._memory
        memory.append((time, egos, seen))
        longest, shortest = self._delays
        while len(memory) > 1 and memory[1][0] <= time - longest + SAME_TIME:
            memory.popleft()
        # all cases see the oldest step: no delay is so short that its case sees the next step
        if len(memory) == 1 or memory[1][0] > time - shortest + SAME_TIME:
            return memory[0][1:]
        latest = time - self._limits[:, _DELAY] + SAME_TIME
        # index of the newest step that each case may see; -1: none yet, it sees the oldest
        places = np.searchsorted([it[0] for it in memory], latest, side="right") - 1
        egos = egos.copy()
        seen = seen.copy()
        for place in np.unique(places).tolist():
            rows = places == place
            egos[rows], seen[rows] = (it[rows] for it in memory[max(place, 0)][1:])
        return egos, seen

    def _draw(self, actors: int) -> None:
        """Draw the chances and errors of the coming steps.

        All are drawn even if only some are used, so that one condition does not change the random
        numbers of another.
        """
        shape = len(self._random), _DRAWN, actors
        self._chance, self._errors = np.empty(shape), np.empty((*shape, 3))
        for stream, chance, errors in zip(self._random, self._chance, self._errors, strict=True):
            stream.random(out=chance)
            stream.standard_normal(out=errors)
        self._errors *= self._limits[:, None, None, _NOISE]

    def _within_reach(self, egos: FloatArray, others: FloatArray) -> BoolArray:
        """Whether each actor is in range and in the field of view, and not hidden, (n, m)."""
        columns = others.transpose(2, 0, 1)  # each (n, m)
        x, y = columns[:2]
        me_x, me_y = egos.T[:2, :, None]
        farthest, half_angle, hides = self._limits[:, _REACH].T[..., None]
        reach = np.hypot(x - me_x, y - me_y) <= farthest
        if self._used[_FIELD_OF_VIEW]:  # one of an actor's five points must be in it
            reach &= (np.abs(_angles(egos, columns)) <= half_angle).any(axis=0)
        if self._used[_OCCLUSION]:
            half_width = half_extents(columns[2], *columns[4:6])[1]
            reach &= ~(_hidden(me_x, x, y, half_width) & (hides > 0.0))
        return np.asarray(reach)


def _angles(egos: FloatArray, columns: FloatArray) -> FloatArray:
    """Angles from each ego's heading to five points of each actor, seen from the centre of the
    ego's front bumper, rad, -pi..pi; (5, n, m).

    columns: the numbers of the actors, each (n, m).
    """
    x, y, heading = columns[:3]
    length, width = columns[4:6]
    me_x, me_y, turned = egos.T[:3, :, None]
    half = 0.5 * egos[:, 4, None]
    bumper_x, bumper_y = me_x + half * np.cos(turned), me_y + half * np.sin(turned)
    along, across = 0.5 * length * _AHEAD, 0.5 * width * _LEFT
    c = np.cos(heading)
    s = np.sin(heading)
    points_x, points_y = x + along * c - across * s, y + along * s + across * c
    angle = np.arctan2(points_y - bumper_y, points_x - bumper_x) - turned
    return np.asarray(angle - tau * np.floor(angle / tau + 0.5))


def _hidden(me_x: FloatArray, x: FloatArray, y: FloatArray, half_width: FloatArray) -> BoolArray:
    """Whether a nearer vehicle in front of the ego covers more than `_COVERED` of each vehicle's
    width across the road, (n, m); lines of sight run along the road.
    """
    left, right = y + half_width, y - half_width
    # (n, m, m): of the case, the nearer vehicle, the vehicle behind it. shared: width, m, that both
    # have in common; nearer: whether the nearer vehicle is between the ego and the one behind.
    shared = np.minimum(left[:, :, None], left[:, None]) - np.maximum(
        right[:, :, None], right[:, None]
    )
    nearer = (me_x < x)[:, :, None] & (x[:, :, None] < x[:, None])
    return np.asarray((nearer & (shared > _COVERED * 2.0 * half_width[:, None])).any(axis=1))


def present(others: FloatArray, is_present: FloatArray) -> FloatArray:
    """Numbers of actors; an actor that has left the road has x nan.

    others: (n, m, k).
    is_present: 0 of an actor that has left, (n, m).
    """
    if is_present.all():
        return others
    others = others.copy()
    others[is_present == 0, 0] = nan
    return others


def lanes_at(road: Road, y: Any) -> IntArray:
    """Numbers of the lanes nearest to each y, m; `lane_at` for arrays."""
    return np.asarray(np.clip(np.round(y / road.lane_width), 0, road.lanes - 1), np.intp)


def _velocity(body: _Body) -> tuple[float, float]:
    """Speeds of a vehicle along and across the road, m/s."""
    heading, speed, across = body[2], body[3], body[6]
    if heading == 0.0:
        return speed, across
    c = cos(heading)
    s = sin(heading)
    return speed * c - across * s, speed * s + across * c


def _velocities(bodies: Records) -> tuple[FloatArray, FloatArray]:
    """`_velocity` of many bodies."""
    c = np.cos(bodies["heading"])
    s = np.sin(bodies["heading"])
    speed, across = bodies["speed"], bodies["across"]
    return speed * c - across * s, speed * s + across * c


def _place_signals(place: str, it: SeenVehicle | None, me: SeenEgo) -> dict[str, float]:
    """Values of `signals` for one place: `lead`, `left_ahead`, ...

    it: the vehicle there; None: there is none.
    """
    if it is None:
        values = {name: getattr(me, name) for name in ("speed", "x", "y", "heading")}
        values |= {"gap": NO_LEAD_GAP, "kind": -1.0}
    else:
        values = it._asdict() | {"present": 1.0, "kind": float(KINDS[it.kind])}
    return {f"{place}_{name}": values.get(name, 0.0) for name in _OF_A_PLACE}


_OF_A_PLACE = ("present", "gap", "speed", "relative_speed", "offset", "x", "y", "heading",
    "acceleration", "length", "width", "kind")  # fmt: skip


def signal_names() -> tuple[str, ...]:
    """The names of all `signals`: those of an empty road."""
    me = (0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0)  # an ego of 1 m by 1 m that stands at 0
    return tuple(Observation(0.0, Road("", 1.0, 1, 1.0, 0.0), me, (me, ()), None, ()).signals())
