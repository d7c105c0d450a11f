"""A concrete scenario: one point of a space, as plain data for SUMO to be set up from and a child process to receive.

Positions are vehicle centres in road coordinates: x along the road, y to the left, y = 0 on the right lane's centre
line, headings from the road's direction. On a road that bends x is the distance along that line.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import must_be
from sumo_eval.scenario import motion, played
from sumo_eval.scenario.bodies import CAR
from sumo_eval.scenario.played import Act
from sumo_eval.scenario.road.lanes import EVERYWHERE, Crossing, LaneSpan, missing_at
from sumo_eval.scenario.road.reference_line import Piece
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.trajectory import FloatArray


@dataclass(frozen=True, slots=True)
class NetworkFile:
    """A SUMO network of the user's. edges: those of its edges that are driven along, in order; together straight.

    path: of the .net.xml, absolute. sha256: of its content, so that a changed file is another road. first_lane: SUMO's
    index of the first edge's right-hand lane for cars: a pavement is to the right of it.
    """

    path: str
    edges: tuple[str, ...]
    sha256: str
    first_lane: int = 0


@dataclass(frozen=True, slots=True)
class Road:
    """A road. The ego is judged from its start to x = `length`; `run_out` lets faster vehicles drive on, m.

    network: the user's network that holds it; None: a network is written for it. line: the right lane's centre line
    from x = 0 on, piece by piece, behind which the road is straight; none: it is straight throughout. spans: the lanes
    that are not there throughout. crossings: roads that cross it.
    """

    name: str
    length: float
    lanes: int
    lane_width: float
    run_out: float
    speed_limit: float = 60.0
    network: NetworkFile | None = None
    line: tuple[Piece, ...] = ()
    spans: tuple[LaneSpan, ...] = ()
    crossings: tuple[Crossing, ...] = ()

    @property
    def shaped(self) -> bool:
        """Whether it is more than the same lanes throughout."""
        return bool(self.spans or self.crossings)

    def span(self, lane: int) -> LaneSpan:
        """Where a lane is."""
        return next((span for span in self.spans if span.lane == lane), EVERYWHERE)

    @property
    def bent(self) -> bool:
        """Whether its frame and the map are not the same numbers."""
        return bool(self.line)

    @property
    def right_edge(self) -> float:
        """y of the right road edge where all lanes are, m."""
        return -self.lane_width / 2

    @property
    def left_edge(self) -> float:
        """y of the left road edge where all lanes are, m."""
        return self.lane_width * (self.lanes - 0.5)

    def right_edge_at(self, x: ArrayLike) -> FloatArray:
        """y of the right road edge at x (any shape), m."""
        return np.asarray(self.right_edge + self.lane_width * missing_at(self.span(0), x))

    def left_edge_at(self, x: ArrayLike) -> FloatArray:
        """y of the left road edge at x (any shape), m."""
        return np.asarray(self.left_edge - self.lane_width * missing_at(self.span(self.lanes - 1), x))

    def lanes_at(self, x: float) -> tuple[int, ...]:
        """The lanes that have their full width at x."""
        return tuple(lane for lane in range(self.lanes) if self.span(lane).begin <= x <= self.span(lane).end)

    def lane_centre(self, lane: int) -> float:
        """y of a lane's centre line, m; lane 0 is the right-hand one."""
        return self.lane_width * lane


CHANGE_TIME = 4.0
"""s at the ego's first speed that the lane change of a way takes: its lateral acceleration then peaks at 1.26 m/s2."""
RECORDED_EVERY = 0.1  # s between two places of a recorded ego
LEAST_CHANGE = 20.0  # m of road that it takes at least
_PIECES = 64  # straight ones as which the length of a lane change is taken


@dataclass(frozen=True, slots=True)
class Way:
    """The lane change that the ego has to make: `offset` m to the left, from x = `begin` on, finished by x = `by`, m.

    ends: whether the lane that it starts in ends there, so that it must wait there; else it drives past.
    """

    offset: float
    begin: float
    by: float
    ends: bool

    def length(self, speed: float) -> float:
        """Road that the lane change takes whose place is fixed, begun at `begin` at a speed, m."""
        return min(max(CHANGE_TIME * speed, LEAST_CHANGE), self.by - self.begin)


@dataclass(frozen=True, slots=True)
class Start:
    """Where a vehicle begins: centre (x, y) m and speed m/s, heading along the road.

    lateral_speed: m/s to the left, below `speed`, with which the ego begins; it then heads that way. way: the lane
    change that the ego has to make. recorded: where somebody was who drove here in its place, x and y of the centre, m,
    every `RECORDED_EVERY` s from the start on.
    """

    x: float
    y: float
    speed: float
    lateral_speed: float = 0.0
    way: Way | None = None
    recorded: tuple[tuple[float, float], ...] = ()

    def y_at(self, x: ArrayLike) -> FloatArray:
        """y of its way at x (any shape), m: the lane that it starts in, the fixed lane change, the other lane."""
        places = np.asarray(x, dtype=np.float64)
        if self.way is None:
            return np.full(places.shape, self.y)
        share = (places - self.way.begin) / self.way.length(self.speed)
        return np.asarray(self.y + self.way.offset * smooth_step(share))

    def x_after(self, distance: ArrayLike) -> FloatArray:
        """x after so much of its way (any shape), m: a lane change is longer than the road beside it."""
        driven = np.asarray(distance, dtype=np.float64)
        if self.way is None:
            return np.asarray(self.x + driven)
        x = np.linspace(self.way.begin, self.way.begin + self.way.length(self.speed), _PIECES + 1)
        along = self.way.begin - self.x + np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(self.y_at(x)))))
        longer = np.interp(driven, along, along - (x - self.x))
        return np.asarray(self.x + driven - longer)

    @property
    def heading(self) -> float:
        """Where it heads, rad to the left of the road."""
        return math.asin(self.lateral_speed / self.speed) if self.lateral_speed else 0.0


def departures(recorded: Sequence[tuple[float, float]], time: ArrayLike, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """How far places x, y (n,) m are from where a recorded ego was at times (n,) s since the start, m.

    recorded: as in `Start`. After its end its last place counts.
    """
    places, at = np.array(recorded, dtype=np.float64), np.asarray(time, dtype=np.float64)
    known = np.arange(len(places)) * RECORDED_EVERY
    ahead = np.asarray(x) - np.interp(at, known, places[:, 0])
    return np.asarray(np.hypot(ahead, np.asarray(y) - np.interp(at, known, places[:, 1])))


def smooth_step(share: FloatArray | float) -> FloatArray:
    """Share of a lateral move done after a share of its duration: 10 s^3 - 15 s^4 + 6 s^5, at rest at both ends."""
    return np.asarray(motion.quintic(np.clip(share, 0.0, 1.0)))


def smooth_step_rate(share: FloatArray | float) -> FloatArray:
    """Derivative of `smooth_step` by its argument; peaks at 1.875."""
    return np.asarray(motion.quintic_rate(np.clip(share, 0.0, 1.0)))


def smooth_step_curvature(share: FloatArray | float) -> FloatArray:
    """Second derivative of `smooth_step` by its argument; peaks at 10/sqrt(3)."""
    return np.asarray(motion.quintic_bend(np.clip(share, 0.0, 1.0)))


@dataclass(frozen=True, slots=True)
class LaneChange:
    """A smooth lateral move: begins at `begin` s, takes `duration` s, ends `offset` m to the left (negative: right).

    cosine: it covers the share (1 - cos(pi s)) / 2 of its offset after the share s of its duration, OpenSCENARIO's
    `sinusoidal`, peak rate pi/2 offset/duration; else that of `smooth_step`, peak rate 1.875 offset/duration.
    """

    begin: float
    duration: float
    offset: float
    cosine: bool = False

    @property
    def kind(self) -> int:
        """Which of the kinds of lateral moves in `scenario.motion` it is."""
        return motion.COSINE if self.cosine else motion.SMOOTH

    def lateral(self, time: float) -> float:
        """Offset already covered at a time, m."""
        return motion.lateral(self, time)

    def lateral_speed(self, time: float) -> float:
        """Lateral speed at a time, m/s."""
        return motion.lateral_speed(self, time)

    def lateral_acceleration(self, time: float) -> float:
        """Lateral acceleration at a time, m/s2."""
        return motion.lateral_acceleration(self, time)


@dataclass(frozen=True, slots=True)
class ConstantLateral:
    """A lateral move at constant speed, as UN R157 has it: from `begin` s, at `speed` m/s > 0, until it has covered
    `offset` m to the left (negative: right).

    acceleration: m/s2 with which the lateral speed builds up from 0 at `begin`; inf: at once.
    """

    begin: float
    speed: float
    offset: float
    acceleration: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed) and self.speed > 0.0):
            raise must_be("`speed`", "a lateral move", "finite and greater than 0 m/s", self.speed)
        if not self.acceleration > 0.0:
            raise must_be("`acceleration`", "a lateral move", "greater than 0 m/s2", self.acceleration)

    @property
    def rise(self) -> float:
        """Time in which the lateral speed builds up, s."""
        return self.speed / self.acceleration

    @property
    def duration(self) -> float:
        """Time until the offset is covered, s."""
        covered = 0.5 * self.speed * self.rise
        if abs(self.offset) < covered:
            return self.rise * math.sqrt(abs(self.offset) / covered)
        return 0.5 * self.rise + abs(self.offset) / self.speed

    @property
    def kind(self) -> int:
        """Which of the kinds of lateral moves in `scenario.motion` it is."""
        return motion.CONSTANT

    def lateral(self, time: float) -> float:
        """Offset already covered at a time, m."""
        return motion.lateral(self, time)

    def lateral_speed(self, time: float) -> float:
        """Lateral speed at a time, m/s; at the very instants of its jumps, the speed after them."""
        return motion.lateral_speed(self, time)

    def lateral_acceleration(self, time: float) -> float:
        """Lateral acceleration at a time, m/s2; the jumps of the speed take no time."""
        return motion.lateral_acceleration(self, time)


def braking_time(speed: ArrayLike, deceleration: ArrayLike, jerk: ArrayLike = math.inf) -> FloatArray:
    """Time from the first touch of the brake to standstill, s; arguments as in `braked_speed`."""
    v0, a = np.asarray(speed, dtype=np.float64), np.asarray(deceleration, dtype=np.float64)
    rise = a / np.asarray(jerk, dtype=np.float64)
    return np.asarray(np.where(v0 >= a * rise / 2.0, v0 / a + rise / 2.0, np.sqrt(2.0 * v0 * rise / a)))


def braked_speed(speed: ArrayLike, deceleration: ArrayLike, time: ArrayLike, jerk: ArrayLike = math.inf) -> FloatArray:
    """Speed `time` s after a vehicle at `speed` m/s began to brake, m/s. Arrays broadcast; before that, its own speed.

    The deceleration rises linearly at `jerk` m/s3 to `deceleration` m/s2, stays there, and ends in standstill.
    """
    v0, a = np.asarray(speed, dtype=np.float64), np.asarray(deceleration, dtype=np.float64)
    rise = a / np.asarray(jerk, dtype=np.float64)
    t = np.clip(time, 0.0, braking_time(v0, a, jerk))
    rising = np.minimum(t, rise)
    share = np.divide(rising, rise, out=np.zeros(np.broadcast_shapes(np.shape(rising), rise.shape)), where=rise > 0.0)
    return np.asarray(np.maximum(v0 - a * (rising * share / 2.0 + (t - rising)), 0.0))


def braked_distance(
    speed: ArrayLike, deceleration: ArrayLike, time: ArrayLike, jerk: ArrayLike = math.inf
) -> FloatArray:
    """Distance driven `time` s after the brake was touched, m (negative before); arguments as in `braked_speed`."""
    v0, a = np.asarray(speed, dtype=np.float64), np.asarray(deceleration, dtype=np.float64)
    rise = a / np.asarray(jerk, dtype=np.float64)
    t = np.minimum(np.asarray(time, dtype=np.float64), braking_time(v0, a, jerk))
    rising = np.clip(t, 0.0, rise)
    share = np.divide(rising, rise, out=np.zeros(np.broadcast_shapes(np.shape(rising), rise.shape)), where=rise > 0.0)
    plateau = np.maximum(t - rise, 0.0)
    return np.asarray(v0 * t - a * (rising**2 * share / 6.0 + rise * plateau / 2.0 + plateau**2 / 2.0))


@dataclass(frozen=True, slots=True)
class Brake:
    """Braking to a standstill: from `begin` s, deceleration rises at `jerk` m/s3 to `deceleration` m/s2 > 0."""

    begin: float
    deceleration: float
    jerk: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.deceleration) and self.deceleration > 0.0):
            raise must_be("`deceleration`", "a brake", "finite and greater than 0 m/s2", self.deceleration)
        if not self.jerk > 0.0:
            raise must_be("`jerk`", "a brake", "greater than 0 m/s3", self.jerk)

    def end(self, speed: float) -> float:
        """When a vehicle that began to brake at `speed` m/s stands, s."""
        return self.begin + motion.time_to_stand(self, speed)

    def speed(self, speed: float, time: float) -> float:
        """Speed at a time of a vehicle that began to brake at `speed`, m/s."""
        return motion.braked_speed_at(self, speed, time)

    def distance(self, speed: float, time: float) -> float:
        """Distance driven from time 0 until a time, at `speed` m/s until the brake, m."""
        return motion.braked_distance_at(self, speed, time)

    def acceleration(self, speed: float, time: float) -> float:
        """Acceleration at a time, m/s2; where it jumps, the one after the jump."""
        return motion.braking_acceleration(self, speed, time)


@dataclass(frozen=True, slots=True)
class Model:
    """A car-following model of SUMO's that drives a vehicle: it reacts to the ego and to all others.

    name: SUMO's. numbers: its parameters by SUMO's name. desired: the speed that it wants to drive, m/s.
    """

    name: str
    desired: float
    numbers: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Actor:
    """Another vehicle: keeps its speed along the road until it brakes, and performs its lane changes as scripted.

    slides: it keeps its heading while it moves across, like the upright rectangles that UN R157's tables are made with;
    otherwise it points where it goes. body: what it is (`scenario.bodies`).

    One with `acts` or a heading at the start, rad to the left of the road, is played (`scenario.played`): what it does
    may depend on what happens. One with a `model` is driven by SUMO, from the start on or from when its act `FOLLOW`
    begins. Of all these the methods below know the start alone.

    on_map: of a played one on a road that bends, x m, y m and heading rad of its start on the map, from where its line
    leads straight on the map, and not along the road: who comes across the way of an ego that turns. None: its line is
    along the road. `start` and `heading` are in the road's frame all the same.
    """

    name: str
    start: Start
    lane_changes: tuple[LaneChange | ConstantLateral, ...] = ()
    length: float = 4.5
    width: float = 1.8
    brake: Brake | None = None
    slides: bool = False
    body: str = CAR
    heading: float = 0.0
    acts: tuple[Act, ...] = ()
    model: Model | None = None
    on_map: tuple[float, float, float] | None = None

    @property
    def script(self) -> tuple[Act, ...]:
        """What it does as moves of a played vehicle."""
        found = list(self.acts)
        if self.brake is not None:
            found.append(Act(played.SPEED, self.brake.begin, 0.0, 0.0, 0.0, self.brake.deceleration, self.brake.jerk))
        for move in self.lane_changes:
            if isinstance(move, LaneChange):
                found.append(Act(move.kind, move.begin, move.duration, 0.0, move.offset))
            else:
                kind, rate = played.CONSTANT, move.acceleration
                found.append(Act(kind, move.begin, move.duration, move.speed, move.offset, rate))
        return tuple(found)

    @property
    def follows_at_once(self) -> bool:
        """Whether SUMO drives it from the start on."""
        return self.model is not None and not self.acts

    @property
    def lively(self) -> bool:
        """Whether what it does is no function of time alone."""
        return self.model is not None or bool(self.acts) or self.heading != 0.0 or self.on_map is not None

    def __post_init__(self) -> None:
        if self.brake is None:
            return
        stands = self.brake.end(self.start.speed)
        late = max((move.begin + move.duration for move in self.lane_changes), default=-math.inf)
        if late > stands:
            raise must_be(
                "The lane changes", f"vehicle `{self.name}`", f"over when it stands, at {stands:.2f} s", round(late, 2)
            )

    def x(self, time: float) -> float:
        """Position of the centre along the road at a time, m."""
        driven = self.start.speed * time if self.brake is None else self.brake.distance(self.start.speed, time)
        return self.start.x + driven

    def y(self, time: float) -> float:
        """Lateral position of the centre at a time, m."""
        return self.start.y + sum([move.lateral(time) for move in self.lane_changes])

    def speed(self, time: float) -> float:
        """Speed along the road at a time, m/s."""
        return self.start.speed if self.brake is None else self.brake.speed(self.start.speed, time)

    def lateral_speed(self, time: float) -> float:
        """Lateral speed at a time, m/s."""
        return sum([move.lateral_speed(time) for move in self.lane_changes])

    def acceleration(self, time: float) -> float:
        """Acceleration along the heading at a time, m/s2: the rate of the ground speed."""
        braking = 0.0 if self.brake is None else self.brake.acceleration(self.start.speed, time)
        if self.slides or not self.lane_changes:
            return braking
        sideways = sum([move.lateral_acceleration(time) for move in self.lane_changes])
        return motion.along_heading(self.speed(time), self.lateral_speed(time), braking, sideways)


@dataclass(frozen=True, slots=True)
class EgoBody:
    """The ego's body where a scenario prescribes it, m."""

    length: float
    width: float


@dataclass(frozen=True, slots=True)
class ConcreteScenario:
    """One point of a logical scenario: parameter values by name, exposure p_i, the road and every vehicle's start.

    ego_body: the body that the ego has here; None: the one of the vehicle settings. time_limit: simulated time after
    which the case is over, s; None: the simulation's own, which holds as well. standstill_time: how long the ego must
    stand for the case to be over, s; None: the simulation's own.
    """

    scenario: str
    values: Mapping[str, float]
    exposure: float
    road: Road
    ego: Start
    actors: tuple[Actor, ...]
    ego_body: EgoBody | None = None
    time_limit: float | None = None
    standstill_time: float | None = None

    def __post_init__(self) -> None:
        names = ["ego", *(actor.name for actor in self.actors)]
        if len(set(names)) < len(names):
            raise must_be("The names of the vehicles", f"scenario `{self.scenario}`", "distinct", ", ".join(names))

    @property
    def lively(self) -> bool:
        """Whether the others are played, and not SUMO's to move: somebody does what is no function of time alone, or
        the lanes are not the same throughout, which SUMO counts from the begin of each edge.
        """
        return self.road.shaped or self.ego.way is not None or any(actor.lively for actor in self.actors)

    @property
    def reacts(self) -> bool:
        """Whether somebody in it is driven by a model of SUMO's."""
        return any(actor.model is not None for actor in self.actors)

    @property
    def label(self) -> str:
        """`ego_speed=30, gap=40`: the point in words."""
        return ", ".join(f"{name}={value:g}" for name, value in self.values.items())

    def ego_vehicle(self, vehicle: VehicleSettings) -> VehicleSettings:
        """The ego of these settings, with the body that the scenario prescribes."""
        body = self.ego_body
        if body is None or (body.length, body.width) == (vehicle.length, vehicle.width):
            return vehicle
        return _with_body(vehicle, body)

    def simulation(self, settings: SimulationSettings) -> SimulationSettings:
        """The settings with which this case is simulated: the given ones, with the scenario's ego and time limit."""
        limit = settings.time_limit if self.time_limit is None else min(settings.time_limit, self.time_limit)
        stood = settings.standstill_time if self.standstill_time is None else self.standstill_time
        vehicle = self.ego_vehicle(settings.vehicle)
        if vehicle is settings.vehicle and (limit, stood) == (settings.time_limit, settings.standstill_time):
            return settings
        return replace(settings, vehicle=vehicle, time_limit=limit, standstill_time=stood)


@functools.lru_cache(maxsize=64)
def _with_body(vehicle: VehicleSettings, body: EgoBody) -> VehicleSettings:
    """The vehicle with another body; made and checked once for all cases of a scenario."""
    return replace(vehicle, length=body.length, width=body.width)
