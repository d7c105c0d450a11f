"""A concrete scenario: one point of a space as plain data, with its road, the ego's start and the
actors.

`scenario/` makes it, `cosim/` sets SUMO up from it, and workers receive it within their cases. The
fingerprint of a drive hashes the `repr` of these records.

Positions are vehicle centres in road coordinates: x along the road, y to the left, y = 0 on the
right lane's centre line, headings from the road's direction. On a curved road x is the distance
along the right lane's centre line.

Users: `ads/`, `cosim/`, `drivers/`, `method/`, `record/`, `report/`, `scenario/`, `scoring/`,
`whatif/`, `extras/`.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import asin, inf, sqrt

import numpy as np
from numpy.typing import ArrayLike

from sumo_eval.errors import check_known, must_be
from sumo_eval.frozen import frozen
from sumo_eval.kernels import kernel
from sumo_eval.scenario import motion, played
from sumo_eval.scenario.bodies import CAR
from sumo_eval.scenario.played import Act, Pairs
from sumo_eval.scenario.road.lanes import EVERYWHERE, Crossing, LaneSpan, missing_at
from sumo_eval.scenario.road.reference_line import Line
from sumo_eval.settings import SimulationSettings
from sumo_eval.text import point_words
from sumo_eval.trajectory import FloatArray

# s: a motion divides by the square of a move's duration, which must not be rounded to 0
_SHORTEST = 1e-9
Numbers = Mapping[str, float]
"""Numbers by name, as of the parameters at a point of a space."""


@frozen
class NetworkFile:
    """A user's SUMO network.

    path: of the .net.xml, absolute.
    edges: ids of the edges that the scenario uses, in driving order. A road keeps its network only
        if they form one straight line (`sumo_network.read_road`).
    sha256: of the file's content; a road of a changed file is not the same road.
    sections: of each edge begin and end, x in m, and SUMO's index of the road's lane 0 on it: above
        0 where a pavement lies to the right of that lane, -1 where the edge lacks it.
    """

    path: str
    edges: tuple[str, ...]
    sha256: str
    sections: tuple[tuple[float, float, int], ...] = ()


@frozen
class Road:
    """A road of parallel lanes.

    length: x at which cases end, m.
    lanes: number of lanes, all `lane_width` m wide.
    run_out: length of road beyond `length`, for vehicles that are faster than the ego, m.
    speed_limit: the most that SUMO lets a vehicle drive, m/s.
    network: the user's network that contains the road; None: a network is written for it.
    line: the right lane's centre line from x = 0 on, piece by piece; after its last piece the road
        is straight. Empty: the road is straight throughout.
    spans: where the lanes exist that begin or end on the road.
    crossings: roads that cross this one.
    """

    name: str
    length: float
    lanes: int
    lane_width: float
    run_out: float
    speed_limit: float = 60.0
    network: NetworkFile | None = None
    line: Line = ()
    spans: tuple[LaneSpan, ...] = ()
    crossings: tuple[Crossing, ...] = ()

    @property
    def end(self) -> float:
        """x at which the road itself ends, m; a case ends before, at x = `length`."""
        return self.length + self.run_out

    @property
    def shaped(self) -> bool:
        """Whether lanes begin or end on the road, or roads cross it."""
        return bool(self.spans or self.crossings)

    def span(self, lane: int) -> LaneSpan:
        """Part of the road on which a lane exists."""
        return next((span for span in self.spans if span.lane == lane), EVERYWHERE)

    @property
    def bent(self) -> bool:
        """Whether the road is curved, so that road coordinates differ from those on the map."""
        return bool(self.line)

    @property
    def right_edge(self) -> float:
        """y of the right road edge where all lanes exist, m."""
        return -self.lane_width / 2

    @property
    def left_edge(self) -> float:
        """y of the left road edge where all lanes exist, m."""
        return self.lane_width * (self.lanes - 0.5)

    def right_edge_at(self, x: ArrayLike) -> FloatArray:
        """y of the right road edge at x (any shape), m."""
        return self.right_edge + self.lane_width * missing_at(self.span(0), x)

    def left_edge_at(self, x: ArrayLike) -> FloatArray:
        """y of the left road edge at x (any shape), m."""
        return self.left_edge - self.lane_width * missing_at(self.span(self.lanes - 1), x)

    def lanes_at(self, x: float) -> tuple[int, ...]:
        """Numbers of the lanes that have their full width at x, m."""
        return tuple(
            lane for lane in range(self.lanes) if self.span(lane).begin <= x <= self.span(lane).end
        )

    def lane_centre(self, lane: int) -> float:
        """y of a lane's centre line, m; lane 0 is the right-hand one."""
        return self.lane_width * lane


CHANGE_TIME = 4.0
"""Duration of the lane change in a `Way` if the ego keeps its first speed, s.

Over 3.5 m its lateral acceleration then peaks at 1.26 m/s2.
"""
LEAST_CHANGE = 20.0  # m of road, at least, that the lane change in a `Way` takes
RECORDED_EVERY = 0.1  # s between two positions of a recorded ego (`Start.recorded`)
_PIECES = 64  # straight pieces whose lengths add up to that of a lane change


@kernel
def lane_at(road: Road, y: float) -> int:
    """Number of the lane nearest to y, m; 0: the right-hand one."""
    return min(max(round(y / road.lane_width), 0), road.lanes - 1)


@frozen
class Way:
    """The lane change that the ego has to make.

    offset: across the road to the other lane's centre, m, to the left.
    begin: x from which on it is possible, m.
    by: x at which it must be finished, m.
    ends: whether the ego's first lane ends at `by`. True: an ego that has not changed must wait
        there. False: it drives on, and has missed the lane change.
    """

    offset: float
    begin: float
    by: float
    ends: bool

    def length(self, speed: float) -> float:
        """Length of road, m, of a lane change that begins at x = `begin` at a speed, m/s."""
        return min(max(CHANGE_TIME * speed, LEAST_CHANGE), self.by - self.begin)


@frozen
class Start:
    """Start of a vehicle.

    x, y: centre, m.
    speed: m/s.
    lateral_speed: of the ego, to the left, below `speed`, m/s; the ego heads in the direction of
        its motion.
    way: the lane change that the ego has to make; None: it has to make none.
    recorded: positions of a recorded ego, x and y of its centre, m, every `RECORDED_EVERY` s from
        the start; empty: there is no recording.
    """

    x: float
    y: float
    speed: float
    lateral_speed: float = 0.0
    way: Way | None = None
    recorded: Pairs = ()

    def y_at(self, x: ArrayLike) -> FloatArray:
        """y of the ego's path at x (any shape), m: in its first lane, from `way.begin` on within
        the lane change, then in the other lane.
        """
        places = np.asarray(x, float)
        if self.way is None:
            return np.full(places.shape, self.y)
        share = (places - self.way.begin) / self.way.length(self.speed)
        return self.y + self.way.offset * smooth_step(share)

    def x_after(self, distance: ArrayLike) -> FloatArray:
        """x after a distance along the ego's path (any shape), m.

        A lane change makes the path longer than the road, by a detour.
        """
        driven = np.asarray(distance, float)
        if self.way is None:
            return self.x + driven
        begin = self.way.begin
        # knots through the lane change, and the path's length from the start to each of them, m
        x = np.linspace(begin, begin + self.way.length(self.speed), _PIECES + 1)
        pieces = np.hypot(np.diff(x), np.diff(self.y_at(x)))
        along = begin - self.x + np.append(0.0, np.cumsum(pieces))
        # m; before the first knot `interp` gives 0, beyond the last knot the whole detour
        detour = np.interp(driven, along, along - (x - self.x))
        return np.asarray(self.x + driven - detour)

    @property
    def heading(self) -> float:
        """Direction of its motion, rad to the left of the road."""
        return asin(self.lateral_speed / self.speed) if self.lateral_speed else 0.0


def departures(
    recorded: Sequence[tuple[float, float]], time: ArrayLike, x: ArrayLike, y: ArrayLike
) -> FloatArray:
    """Distances of an ego from a recorded ego at the same times, m, (n,).

    recorded: positions as in `Start`. After the recording's end its last position counts.
    time: since the start, s, (n,).
    x, y: positions of the ego, m, (n,).
    """
    recorded_x, recorded_y = np.array(recorded, float).T
    at = np.asarray(time, float)
    times = np.arange(len(recorded)) * RECORDED_EVERY
    ahead = np.asarray(x) - np.interp(at, times, recorded_x)
    return np.asarray(np.hypot(ahead, np.asarray(y) - np.interp(at, times, recorded_y)))


def smooth_step(share: FloatArray | float) -> FloatArray:
    """Share of its offset that a lateral move has covered after a share s of its duration:
    10 s^3 - 15 s^4 + 6 s^5, at rest at both ends.
    """
    return np.asarray(motion.quintic(np.clip(share, 0.0, 1.0)))


def lane_change(begin: float, duration: float, offset: float, *, cosine: bool = False) -> Act:
    """A smooth lateral move.

    begin, duration: s; it lasts `_SHORTEST` at least.
    offset: to the left, m; negative: to the right.
    cosine: which share of the offset is covered after a share s of the duration. False: that of
        `smooth_step`; the lateral speed peaks at 1.875 offset/duration. True: (1 - cos(pi s)) / 2,
        OpenSCENARIO's `sinusoidal`; the lateral speed peaks at pi/2 offset/duration.
    """
    _check_above_zero("duration", "a lateral move", "s", duration)
    lasts = max(duration, _SHORTEST)
    return Act(played.COSINE if cosine else played.SMOOTH, begin, lasts, 0.0, offset)


def constant_lateral(begin: float, speed: float, offset: float, acceleration: float = inf) -> Act:
    """A lateral move at constant speed, as in UN R157.

    begin: s.
    speed: above 0, m/s.
    offset: to the left, m; negative: to the right.
    acceleration: with which the lateral speed builds up from 0 at `begin`, m/s2; inf: at once.
    """
    _check_above_zero("speed", "a lateral move", "m/s", speed)
    _check_above_zero("acceleration", "a lateral move", "m/s2", acceleration, endless=True)
    rise = speed / acceleration  # time in which the speed builds up, s
    covered = 0.5 * speed * rise  # distance in that time, m
    duration = 0.5 * rise + abs(offset) / speed
    if abs(offset) < covered:  # the move ends before the speed is reached
        duration = rise * sqrt(abs(offset) / covered)
    return Act(played.CONSTANT, begin, duration, speed, offset, acceleration)


def brake_to_stop(begin: float, deceleration: float, jerk: float = inf) -> Act:
    """Braking to a standstill.

    begin: s.
    deceleration: above 0, m/s2.
    jerk: with which the deceleration rises from 0, m/s3; inf: at once.
    """
    _check_above_zero("deceleration", "a brake", "m/s2", deceleration)
    _check_above_zero("jerk", "a brake", "m/s3", jerk, endless=True)
    return Act(played.SPEED, begin, 0.0, 0.0, 0.0, deceleration, jerk)


def _check_above_zero(
    name: str, owner: str, unit: str, value: float, *, endless: bool = False
) -> None:
    """Refuse a value that is not above 0; inf too, unless it is `endless`."""
    if not value > 0.0 or (value == inf and not endless):
        finite = "" if endless else "finite and "
        raise must_be(f"`{name}`", owner, f"{finite}greater than 0 {unit}", value)


def keeps_on(acts: Sequence[Act]) -> Act:
    """An act that changes no motion, but makes its vehicle `Actor.lively`: the kernels of
    `scenario/played.py` move the vehicle, not SUMO, and it may start beside the lanes.

    acts: the other acts of the vehicle; if there are any, this one never begins.
    """
    return Act(played.KEEP, inf if acts else 0.0)


def braked_speed(speed: ArrayLike, deceleration: ArrayLike, time: ArrayLike) -> FloatArray:
    """Speed of a vehicle that brakes to a standstill, m/s. Arrays broadcast.

    speed: before braking, m/s.
    deceleration: m/s2.
    time: since braking began, s; below 0: it has not begun.
    """
    v0, a = np.asarray(speed, float), np.asarray(deceleration, float)
    return np.asarray(np.maximum(v0 - a * np.clip(time, 0.0, v0 / a), 0.0))


def braked_distance(speed: ArrayLike, deceleration: ArrayLike, time: ArrayLike) -> FloatArray:
    """Distance driven since braking began, m; below 0 before that.

    Arguments as in `braked_speed`.
    """
    v0, a = np.asarray(speed, float), np.asarray(deceleration, float)
    t = np.minimum(np.asarray(time, float), v0 / a)
    return np.asarray(v0 * t - a * (np.square(np.maximum(t, 0.0)) / 2.0))


@frozen
class Model:
    """A car-following model of SUMO that drives a vehicle: it reacts to the ego and to all other
    vehicles.

    name: SUMO's name of the model.
    desired: desired speed, m/s.
    numbers: its parameters, (SUMO's name, value).
    """

    name: str
    desired: float
    numbers: tuple[tuple[str, float], ...] = ()


@frozen
class Actor:
    """An actor: keeps its speed along the road until one of its acts begins.

    Its methods compute positions and speeds in closed form. They are right unless the actor is
    `lively`: of a lively actor they ignore the acts, as if it kept its first speed.

    length, width: m.
    slides: it keeps its heading while it moves across the road, as the rectangles behind UN R157's
        tables do; otherwise it points where it moves.
    body: kind of road user, a name in `scenario.bodies.BODIES`.
    heading: at the start, rad to the left of the road.
    model: SUMO's model that drives it, from the start if it has no acts, else from its act `FOLLOW`
        on; None: its acts move it.
    on_map: x m, y m and heading rad of its start on the map of a curved road. Set where the actor
        drives straight on the map, as across the path of a turning ego; `start` and `heading` are
        in road coordinates all the same. None: its path is along the road.
    """

    name: str
    start: Start
    acts: tuple[Act, ...] = ()
    length: float = 4.5
    width: float = 1.8
    slides: bool = False
    body: str = CAR
    heading: float = 0.0
    model: Model | None = None
    on_map: tuple[float, float, float] | None = None

    @property
    def follows_at_once(self) -> bool:
        """Whether SUMO drives it from the start on."""
        return self.model is not None and not self.acts

    @property
    def lively(self) -> bool:
        """Whether its motion has no closed form here: it depends on what happens in the drive, or
        is not of the simple kind (`Act.timed`, at most one braking, along the road).
        """
        if self.model is not None or self.heading != 0.0 or self.on_map is not None:
            return True
        kinds = [act.kind for act in self.acts]
        return kinds.count(played.SPEED) > 1 or not all(act.timed for act in self.acts)

    @property
    def lateral_moves(self) -> tuple[Act, ...]:
        """Its moves across the road; empty if it is lively."""
        return () if self.lively else tuple([act for act in self.acts if act.kind != played.SPEED])

    @property
    def braking(self) -> Act | None:
        """Its braking to a standstill; None if it does not brake or is lively."""
        return next(
            (act for act in self.acts if act.kind == played.SPEED and not self.lively), None
        )

    @property
    def script_end(self) -> float:
        """Time at which its last act ends, s; -inf without acts."""
        return max([self._stands_from, *(act.begin + act.duration for act in self.lateral_moves)])

    @property
    def _stands_from(self) -> float:
        """Time at which its braking to a standstill ends, s; -inf if it does not brake."""
        brake = self.braking
        if brake is None:
            return -inf
        return brake.begin + motion.time_to_stand(brake, self.start.speed)

    def __post_init__(self) -> None:
        stands = self._stands_from
        # `script_end` is the last of all ends: here a lateral move would outlast the braking
        if -inf < stands < self.script_end:
            wanted = f"over when it stands, at {stands:.2f} s"
            raise must_be(
                "The lane changes", f"vehicle `{self.name}`", wanted, round(self.script_end, 2)
            )

    def x(self, time: float) -> float:
        """Position of the centre along the road at a time, m."""
        return self.start.x + self._driven(time)[0]

    def y(self, time: float) -> float:
        """Lateral position of the centre at a time, m."""
        moves = [motion.lateral_motion(move, time)[0] for move in self.lateral_moves]
        return self.start.y + sum(moves)

    def speed(self, time: float) -> float:
        """Speed along the road at a time, m/s."""
        return self._driven(time)[1]

    def _driven(self, time: float) -> tuple[float, float]:
        """Distance driven along the road up to a time, m, and speed along it then, m/s."""
        speed = self.start.speed
        return motion.braked(self.braking, speed, time) if self.braking else (speed * time, speed)

    def lateral_speed(self, time: float) -> float:
        """Lateral speed at a time, m/s."""
        return sum([motion.lateral_motion(move, time)[1] for move in self.lateral_moves])


OF_THE_WORLD = ("vehicle.friction",)
"""Settings of the world, not of the ADS: they hold also for references and human drivers."""
CHANGES = (
    "conditions.perception_delay", "conditions.dropout", "conditions.position_noise",
    "conditions.speed_noise", "conditions.sensor_range", "conditions.field_of_view_deg",
    "conditions.actuation_delay", "vehicle.max_deceleration", "vehicle.brake_build_up",
    *OF_THE_WORLD,
)  # fmt: skip
"""Settings of the simulation that can differ between the cases of a scenario."""


@frozen
class EgoBody:
    """The ego's body where a scenario prescribes it, m."""

    length: float
    width: float


@frozen
class ConcreteScenario:
    """One point of a logical scenario.

    scenario: name of the logical scenario.
    values: of its parameters, by name.
    exposure: p_i, up to a factor common to all points.
    ego: start of the ego.
    ego_body: the ego's body in this scenario; None: that of the vehicle settings.
    time_limit: simulated time after which the case ends, s, if the settings of the simulation do
        not end it earlier; None: these settings alone decide.
    standstill_time: time that the ego must stand for the case to end, s; None: that of the settings
        of the simulation.
    changes: settings of this case alone, (name, value), with names in `CHANGES`.
    """

    scenario: str
    values: Numbers
    exposure: float
    road: Road
    ego: Start
    actors: tuple[Actor, ...]
    ego_body: EgoBody | None = None
    time_limit: float | None = None
    standstill_time: float | None = None
    changes: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        for name, _ in self.changes:
            check_known("setting that a case can change", CHANGES, name)
        names = ["ego", *(actor.name for actor in self.actors)]
        if len(set(names)) < len(names):
            raise must_be(
                "The names of the vehicles",
                f"scenario `{self.scenario}`",
                "distinct",
                ", ".join(names),
            )

    @property
    def lively(self) -> bool:
        """Whether the kernels of `scenario.played`, not SUMO, move the actors.

        True where an actor is lively itself, where lanes open or end (SUMO numbers the lanes of
        each edge on its own), where roads cross, and where the ego has to change lanes.
        """
        return (
            self.road.shaped
            or self.ego.way is not None
            or any(actor.lively for actor in self.actors)
        )

    @property
    def script_end(self) -> float:
        """Time at which the actors' last acts end, s; inf if it depends on the drive."""
        return (
            inf if self.lively else max((actor.script_end for actor in self.actors), default=-inf)
        )

    @property
    def reacts(self) -> bool:
        """Whether a SUMO model drives any actor."""
        return any(actor.model is not None for actor in self.actors)

    @property
    def label(self) -> str:
        """The point in words: `ego_speed=30, gap=40`."""
        return point_words(self.values)

    @property
    def without_ads(self) -> ConcreteScenario:
        """The scenario for references and drivers: without the changes that only an ADS gets."""
        if not self.changes:
            return self
        return replace(self, changes=tuple(it for it in self.changes if it[0] in OF_THE_WORLD))

    def simulation(self, settings: SimulationSettings) -> SimulationSettings:
        """These settings with the changes, the ego's body and the limits of time of this case."""
        # `plant` (an FMU instead of the vehicle model) cannot be hashed: bypass the cache
        changed = _changed.__wrapped__ if settings.plant else _changed
        return changed(settings, self.changes, self.ego_body, self.time_limit, self.standstill_time)


@functools.lru_cache(maxsize=64)  # made and checked once for all cases of a scenario
def _changed(
    settings: SimulationSettings,
    changes: tuple[tuple[str, float], ...],
    body: EgoBody | None,
    time_limit: float | None,
    standstill_time: float | None,
) -> SimulationSettings:
    """`ConcreteScenario.simulation` of the parts of a case that it depends on."""
    for name, value in changes:
        group, setting = name.split(".")
        changed = replace(getattr(settings, group), **{setting: value})
        settings = replace(settings, **{group: changed})
    own = body or settings.vehicle
    return replace(
        settings,
        vehicle=replace(settings.vehicle, length=own.length, width=own.width),
        time_limit=min(settings.time_limit, time_limit or inf),
        standstill_time=standstill_time or settings.standstill_time,
    )
