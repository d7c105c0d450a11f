"""State of one simulation, of one case or a batch: positions of all vehicles, scripts, contacts,
ends of cases.

`cosim/records.py` defines its records, `cosim/step_rules.py` the rules of a step.
`cosim/loop.py` calls `move` before SUMO's step and `see` after it. `cosim/recordings.py` makes the
recordings of cases that have ended.

Users: `cosim/`, `record/loops.py`.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from sumo_eval.cosim.doors.fault_place import fault_place
from sumo_eval.cosim.impossible import FASTEST
from sumo_eval.cosim.latency import Latencies
from sumo_eval.cosim.records import (
    CLIP,
    CYCLE,
    EGO,
    LEFT_TO_SUMO,
    LIMITS,
    MODEL,
    MOVER,
    OTHER,
    REASONS,
    SCENARIO,
    SIM_ERROR,
    WHATS,
    Scenes,
)
from sumo_eval.cosim.step_rules import (
    begin_rows,
    map_rows,
    move_rows,
    read_rows,
    received_rows,
    see_rows,
)
from sumo_eval.cosim.vehicle_model import GRAVITY, count_clip
from sumo_eval.errors import ControllerError
from sumo_eval.kernels import Records, bound
from sumo_eval.scenario.concrete import ConcreteScenario, Road, Way
from sumo_eval.scenario.played import FOLLOW, Cast, players, wake_rows
from sumo_eval.scenario.road.reference_line import curvatures, knots_of
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.text import traceback_of
from sumo_eval.trajectory import (
    CHANNELS,
    Alone,
    BoolArray,
    EndReason,
    FloatArray,
    IntArray,
    Recording,
)

_CODES: dict[Any, Any] = {}
"""The rules of a step as machine code (`kernels.bound`): called directly, it takes a third of the
time of a call through numba. One for all worlds, as their arrays have the same types."""
_HELD = 0.99  # largest share of the tyres' grip that an ego uses when it begins in a curve
_ARRIVED = 0.101  # m; SUMO removes a vehicle whose front is nearer to the end of the last lane


def described(
    road: Road, vehicles: Sequence[VehicleSettings], settings: SimulationSettings
) -> Records:
    """Two `SCENARIO` records for each of these egos' vehicles on this road.

    The two differ in `step`: the first has the time step, s, the second the cycle of decisions
    (`records.CYCLE`), rounded to whole steps.
    """
    # all values in the order of the fields of `SCENARIO`
    limits = [tuple(getattr(vehicle, name) for name, _ in LIMITS) for vehicle in vehicles]
    steps = settings.step, max(round(CYCLE / settings.step), 1) * settings.step
    stands = settings.standstill_speed, settings.standstill_time
    ends = settings.time_limit, *stands, settings.end_when_decided
    of_road = _road_values(road)
    return np.array([(of_road, own, step, *ends) for own in limits for step in steps], SCENARIO)


def _road_values(road: Road) -> tuple[float, ...]:
    """The values of `records._ROAD`, in their order."""
    places: list[float] = []  # x, m, as in `records.PLACES`
    for lane in (0, road.lanes - 1):  # the right and the left one
        span = road.span(lane)
        places += *span.places, span.parted_until, span.parted_from
    edges = road.length, road.right_edge, road.left_edge, road.lane_width
    return *edges, road.lanes, road.bent, road.shaped, *places


def kind_of(concrete: ConcreteScenario) -> tuple[object, ...]:
    """Values that all cases of a batch must share."""
    times = concrete.time_limit, concrete.standstill_time
    return concrete.road, concrete.ego_body, *times, len(concrete.actors)


def _code(rule: Any, *arguments: Any) -> Any:
    """Machine code of a rule.

    arguments: of the types that every call has.
    """
    if rule not in _CODES:
        _CODES[rule] = bound(rule, *arguments)
    return _CODES[rule]


def _run(rule: Any, *arguments: Any) -> Any:
    """Call the machine code of a rule."""
    return _code(rule, *arguments)(*arguments)


class World:
    """One simulation: n cases on one road with m actors each.

    At most 29 attributes: Python 3.11 reads those of a larger object more slowly.

    A case is an index of `cases` throughout. Its row in the arrays may change: `keep` drops rows.

    rows: the case of each row; rows of ended cases stay until `keep`.
    each: settings of each case.
    placed: `MODEL`, `SUMO` or `PLANT`: what moves the egos.
    egos (n,), others (n, m): the vehicles' records.
    players: the actors' scripts.
    scenes, cast: named tuples that hold these arrays for the kernels (`gather`).
    samples, seen, clips, commands: as in `Scenes`.
    tell: what SUMO receives in this step, a row for each vehicle, as in `move_rows`.
    shown: x, y, angle and speed of the actors as SUMO shows them, (n, m, 4).
    going: number of cases that have not ended.
    left: by case, the reason why it has left its batch.
    ended: by case, the maker of its recording.
    scenario: two `SCENARIO` records, or two for each row where the cases change the vehicle.
    end_of_lanes: x at which SUMO removes a vehicle, m.
    none_leaves_before: time until which no actor can reach that x, s.
    """

    def __init__(
        self, cases: Sequence[ConcreteScenario], settings: SimulationSettings, placed: int = MODEL
    ) -> None:
        self.cases, self.settings = cases, settings
        self.each = [concrete.simulation(settings) for concrete in cases]
        self.going = n = len(cases)
        self.rows = np.arange(n)
        self.steps = 0
        self.ended: dict[int, Callable[..., Recording]] = {}
        self.errors: dict[int, str] = {}
        self.logs: dict[int, str] = defaultdict(str)
        # where in the user's code an exception came from
        self.places: dict[int, str] = defaultdict(str)
        # clips that no kernel counts, by case and name
        self.notes: dict[int, Any] = defaultdict(
            lambda: defaultdict(
                lambda: SimpleNamespace(count=0, first=0.0, requested=0.0, applied=0.0)
            )
        )
        self.left: dict[int, Alone] = {}
        self.latencies = Latencies(n)
        self._make_vehicles(placed)
        self._take_scripts()
        self._make_room(placed)
        self.gather()
        # these three are not called yet, but compiled or loaded here, not within a timed step; some
        # arguments only have the type of the later ones
        _code(move_rows, self.cast, self.clips, self.tell, self.scenario, 0, 0)
        _code(see_rows, self.scenes, self.scenario, self.cast.line, 0, 0, 0)
        _code(read_rows, self.egos, self.shown, self.scenario, self.rows, self.tell, self.rows)
        _run(wake_rows, self.cast, 0.0, 0.0)
        _run(begin_rows, self.cast, self.seen, self.samples, self.scenario)

    def _make_vehicles(self, placed: int) -> None:
        """Make the records of the scenario, the egos and the actors, at their start."""
        settings, road = self.settings, self.cases[0].road
        vehicles = [case.vehicle for case in self.each]
        if vehicles.count(vehicles[0]) == len(vehicles):  # one for all rows
            vehicles = vehicles[:1]
        self.scenario = described(road, vehicles, settings)
        self.egos = _egos(self.cases, settings.vehicle, placed)
        self.others = _others(self.cases)
        if placed == MODEL and road.bent:
            # every second record: the first of each pair
            limits = self.scenario["vehicle"][::2].view(np.recarray)
            _put_in_curve(self.egos, road, limits)
        for bodies in (self.egos, self.others):
            for name in ("x", "y", "heading", "speed"):
                bodies["before"][name] = bodies[name]

    def _take_scripts(self) -> None:
        """Make the records of the actors' scripts, and the cast that plays them."""
        road = self.cases[0].road
        self.players = players([case.actors for case in self.cases])
        self.egos["scripted_until"] = [it.script_end + self.settings.step for it in self.cases]
        self.end_of_lanes = road.end - _ARRIVED
        self.none_leaves_before = 0.0
        acts = self.players.acts
        # whether any move waits for its condition, of `steps` operations, or (FOLLOW) for the end
        # of a step
        self.waits = bool(((acts["steps"] > 0) | (acts["kind"] == FOLLOW)).any())
        self.cast = Cast(self.egos, self.others, *self.players, knots_of(road.line))

    def _make_room(self, placed: int) -> None:
        """Make arrays for what the steps write: clips, sights, samples, commands."""
        settings = self.settings
        n, m = self.others.shape
        self.clips = np.zeros((n, len(WHATS)), CLIP)
        self.seen = np.zeros((n, m), MOVER)
        self.shown = np.zeros((n, m, 4))
        self.tell = np.zeros((n * (1 + m), 8))  # as in `move_rows`
        room = 512 if n == 1 else 64  # instants
        # free instants of `samples`. Not counted: that of the start, that of an end between two
        # samples, and a spare one.
        self._free = room - 3
        # `empty`: kernels read only what kernels have written
        self.samples = np.empty((n, 1 + m, room, len(CHANNELS)))
        every = round(settings.record_interval / settings.step)  # steps from one sample to the next
        model = placed == MODEL and settings.plant is None  # the vehicle model moves all egos
        self.commands = np.empty((n, room * every, 2 if model else 7))

    def begin_as_model(self, case: int) -> None:
        """Begin a case again, before its first step: the vehicle model takes over the ego."""
        road = self.cases[0].road
        row = self.rows.tolist().index(case)
        # the steering wheel in the first sample, nan as long as SUMO moves the ego
        self.samples[row, 0, 0, -1] = 0.0
        if road.bent:
            _put_in_curve(self.egos[row : row + 1], road, self.each[case].vehicle)
            self.egos["samples"][row] = 0
            # for all rows; for the others nothing changes, as they have a sample of this instant
            _run(begin_rows, self.cast, self.seen, self.samples, self.scenario)

    def gather(self) -> None:
        """Make `scenes` and `cast` again, after an array that they hold has been replaced."""
        self.scenes = Scenes(
            self.egos, self.others, self.clips, self.seen, self.samples, self.shown, self.commands
        )
        self.cast = Cast(self.egos, self.others, *self.players, self.cast.line)

    def move(self, *, to_sumo: int, as_read: bool = False) -> tuple[int, Sequence[int]]:
        """Move all vehicles to the end of the coming step; return the number of rows of `tell`, and
        the numbers of the actors that leave the network in this step. `tell` has no rows of these.

        to_sumo: what SUMO receives in this step, as in `move_rows`.
        as_read: whether actors get their places and speeds from SUMO, not from their scripts.
        """
        steps = self.steps + 1
        count = _CODES[move_rows](self.cast, self.clips, self.tell, self.scenario, steps, to_sumo)
        now = steps * self.settings.step
        return self.let_leave(now, count, as_read) if self.may_leave(now) else (count, ())

    def see(self, *, sampling: bool = False, as_read: bool = False) -> int:
        """Take in what SUMO shows at the end of the step; return how many cases ended."""
        self.steps += 1
        see = _CODES[see_rows]
        return int(see(self.scenes, self.scenario, self.cast.line, self.steps, sampling, as_read))

    def read(self, numbers: IntArray, read: FloatArray, odd: IntArray) -> int:
        """Take in what SUMO shows of vehicles, as in `read_rows`."""
        code = _CODES[read_rows]
        return int(code(self.egos, self.shown, self.scenario, numbers, read, odd))

    def received(self, end: float) -> FloatArray:
        """Vehicles that SUMO received in this step and has a lane for, as in `received_rows`."""
        received = np.empty((self.going * (1 + self.others.shape[1]), 4))
        return received[: _run(received_rows, self.cast, self.scenario, end, received)]

    def may_leave(self, now: float) -> bool:
        """Whether an actor may come to the end of its lanes in the step that ends `now`, s.

        Most steps end before `none_leaves_before`: even the fastest vehicle is too far away.
        """
        if now < self.none_leaves_before:
            return False
        # all front bumpers are behind this x, m
        near = float((self.others["x"] + self.others["length"]).max(initial=-math.inf))
        # a step earlier: actors get to the places of `now` only in the coming step
        self.none_leaves_before = now + (self.end_of_lanes - near) / FASTEST - self.settings.step
        return now > self.none_leaves_before

    def let_leave(self, now: float, count: int, as_read: bool) -> tuple[int, Sequence[int]]:
        """Remove the actors that come to the end of their lanes in the step that ends `now`, s;
        return the number of rows of `tell` without them, and their numbers in `tell`.

        count: number of rows of `tell`.
        as_read: as of `move`.
        """
        leaving = self._pass_the_end(as_read)
        self.others["present"][leaving] = 0
        rows, actors = np.nonzero(leaving)
        for row in rows.tolist():
            self.note(self.case_of(row), "actor_left_the_network", now, now)

        numbers = rows * (1 + leaving.shape[1]) + 1 + actors  # as in `tell`: each row's ego first
        staying = self.tell[:count][~np.isin(self.tell[:count, 0], numbers)]
        self.tell[: len(staying)] = staying
        return len(staying), numbers.tolist()

    def _pass_the_end(self, as_read: bool) -> BoolArray:
        """Whether each actor's front passes the end of its lanes in this step, (n, m).

        False off the lanes, and in cases that have ended.

        as_read: as of `move`; SUMO itself reports the end of actors that it moves.
        """
        others, egos, road = self.others, self.egos, self.cases[0].road
        before, now = (
            bodies["x"] + 0.5 * others["length"] * np.cos(bodies["heading"])
            for bodies in (others["before"], others)
        )  # x of the fronts, m
        passes = (before <= self.end_of_lanes) & (now > self.end_of_lanes)
        passes &= others["present"] == 1
        passes &= (others["y"] >= road.right_edge) & (others["y"] <= road.left_edge)
        passes &= (others["told"] != LEFT_TO_SUMO) | (not as_read)
        passes &= ((egos["live"] == 1) & (egos["reason"] == 0))[:, None]
        return np.asarray(passes)

    def wake(self, now: float) -> None:
        """Begin the moves whose conditions became true in the step that ends `now`, s."""
        # `time` is still the step's beginning, as `see` counts the step
        _run(wake_rows, self.cast, now, self.time)
        self.put_on_map()

    def put_on_map(self) -> None:
        """Compute the actors' positions on the map from those along and across the road."""
        _run(map_rows, self.others, self.cast.line)

    @property
    def reacts(self) -> bool:
        """Whether SUMO's models drive actors."""
        return any(case.reacts for case in self.cases)

    @property
    def time(self) -> float:
        """s since the start of the cases."""
        return float(self.steps * self.settings.step)

    @property
    def live(self) -> IntArray:
        """The rows of cases that have not ended."""
        return np.flatnonzero(self.egos["live"])

    def case_of(self, row: int) -> int:
        """The index of the case of a row."""
        return int(self.rows[row])

    def note(self, case: int, what: str, requested: float, applied: float, **values: float) -> None:
        """Count a clip that no kernel counts, and keep its worst instance.

        requested, applied: the two numbers of the clip; their meaning depends on `what`.
        values: `count` and `first` (time, s); by default one more, and the time of the first call.
        """
        notes = self.notes[case]
        name: Any = what  # `count_clip` is made for kernels, which pass a number as key
        count_clip(notes, name, self.time, float(requested), float(applied))
        vars(notes[what]).update(values)

    def keep_fault(self, case: int, error: BaseException, code: Any, folder: Path | None) -> None:
        """Keep the place of an exception in the user's code, and its traceback for the log.

        The log has no traceback of a ControllerError (a refused or late answer) without a place.

        code: the user's function or object. folder: as of `fault_place`.
        """
        place = fault_place(error, code, folder)
        if place or not isinstance(error, ControllerError):
            self.logs[case] += traceback_of(error)
        self.places[case] = self.places[case] or place

    def touched(self, counts: Mapping[str, int], ignored: Mapping[str, str]) -> None:
        """Record how often the ADS of a lone case changed other things than its ego.

        counts: by name of the clip.
        ignored: TraCI call -> why SUMO ignored it, for the log.
        """
        for call, why in ignored.items():
            self.logs[0] += f"SUMO ignored {call}: {why}.\n"
        for what, count in counts.items():
            self.note(0, what, count, count, count=count, first=0.0)

    def leave(self, row: int, why: Alone) -> None:
        """Note that a case leaves its batch, to restart alone; the loop drops its row."""
        self.left[self.case_of(row)] = why
        self.egos["reason"][row] = SIM_ERROR  # any reason ends the row; no recording is made of it

    def fail(self, row: int, reason: EndReason, sentence: str) -> None:
        """Mark a case as ended for a reason, with an error message."""
        case = self.case_of(row)
        self.egos["reason"][row] = REASONS.index(reason)
        self.errors[case] = f"{self.errors.get(case, '')} {sentence}".lstrip()

    def room_for_samples(self) -> None:
        """Make room for the sample that the coming step takes."""
        self._free -= 1
        if self._free < 0:
            self._free += self.samples.shape[2]
            self.samples = _twice_as_long(self.samples)
            self.commands = _twice_as_long(self.commands)
            self.gather()

    def keep(self, rows: IntArray) -> None:
        """Drop all rows but these; keep their order."""
        for name in (
            "rows", "egos", "others", "clips", "seen", "shown", "samples", "commands"
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[rows])
        if len(self.scenario) > 2:  # two records for each row
            self.scenario = self.scenario.reshape(-1, 2)[rows].reshape(-1)
        self.players = self.players.of(rows)
        self.gather()


def _twice_as_long(array: FloatArray) -> FloatArray:
    """An array, (..., instants, values), with room for twice the instants."""
    instants, values = array.shape[-2:]
    longer = np.empty((*array.shape[:-2], 2 * instants, values))
    longer[..., :instants, :] = array
    return longer


def _egos(cases: Sequence[ConcreteScenario], vehicle: VehicleSettings, placed: int) -> Records:
    """The egos at their start, (n,).

    placed: as of `World`.
    """
    egos = np.zeros(len(cases), EGO)
    for name in ("x", "y", "speed", "heading"):
        egos[name] = [getattr(concrete.ego, name) for concrete in cases]
    egos["length"], egos["width"] = vehicle.length, vehicle.width
    egos["live"] = 1
    egos["placed"] = placed
    egos["way"] = [way_of(it.ego.way, it.ego.y, it.ego.speed) for it in cases]
    return egos


def way_of(way: Way | None, y: float, speed: float) -> tuple[float, ...]:
    """The values of `records._WAY` of an ego that has to make a lane change, or none.

    y: of the ego's start, m.
    speed: at the start, m/s.
    """
    if way is None:
        return y, 0.0, 0.0, 1.0, 0.0, 0, 0
    return y, way.offset, way.begin, way.length(speed), way.by, 1, int(way.ends)


def _put_in_curve(egos: Records, road: Road, limits: Any) -> None:
    """Turn egos that begin in a curve as if they had driven the curve before: the rear axle along
    it, the steering wheel turned.

    The rear axle is on the circle of the lane's curvature k, 1/m. The body's centre is h =
    wheelbase / 2 ahead of the axle, so sqrt(1 / k^2 + h^2) from the circle's centre: further out
    than the lane by k h^2 / (1 + sqrt(1 + (k h)^2)). Tyres that slip turn the body further in.

    limits: as of `corner`.
    """
    bend = corner(egos, curvatures(road.line, egos["x"]), limits)
    half = 0.5 * limits.wheelbase
    egos["y"] -= bend * half * half / (1.0 + np.sqrt(1.0 + np.square(bend * half)))


def corner(egos: Records, of_line: Any, limits: Any) -> Any:
    """Turn egos that point along their lane, and their wheels and tyres, as if they had driven the
    lane's curve; return the curvature of their lanes, 1/m.

    of_line: curvature of the road's line beside each ego, 1/m.
    limits: `VehicleSettings` or an array of their records.

    Both axles of the dynamic model have one slip angle alpha at the curvature k: v^2 k = mu g
    tanh(C alpha), of the speed v, friction mu, g = 9.81 m/s2 and cornering stiffness C.
    """
    bend = of_line / (1.0 - of_line * egos["y"])
    speed = egos["speed"]
    turn = limits.wheelbase * bend  # tangent of the road wheels' angle
    alpha = np.arctanh(np.clip(speed * speed * bend / limits.friction / GRAVITY, -_HELD, _HELD))
    alpha *= limits.dynamic / limits.cornering_stiffness
    egos["steering"] = limits.steering_ratio * np.arctan(turn)
    # slip: of the centre of gravity, which is `front_share` of the wheelbase behind the front axle
    egos["slip"] = turn - turn * limits.front_share - alpha
    egos["yaw_rate"] = speed * bend
    turned = alpha - np.arctan(0.5 * turn)  # of the body, whose middle is between the axles
    egos["heading"] += turned
    egos["map"]["heading"] += turned
    return bend


def _others(cases: Sequence[ConcreteScenario]) -> Records:
    """The actors at their start, (n, m)."""
    others = np.zeros((len(cases), len(cases[0].actors)), OTHER)
    for name in ("x", "y", "speed"):
        others[name] = [[getattr(it.start, name) for it in case.actors] for case in cases]
    for name in ("heading", "length", "width"):
        others[name] = [[getattr(it, name) for it in case.actors] for case in cases]
    others["present"] = 1
    return others
