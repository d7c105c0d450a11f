"""The table of known answers: function, arguments, value, source; `qualified` runs it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.ads.eu_2022_1426 import SEATED, STANDING
from sumo_eval.cosim.doors.controller import ControllerLike
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import SimulationError
from sumo_eval.method.anthropomorphic import anthropomorphic_index
from sumo_eval.method.collision_avoidance import (
    collision_avoidance_index,
    collision_loss,
    impact_severity,
)
from sumo_eval.method.criticality import ideal_impact_speed, max_inverse_ttc, required_gap
from sumo_eval.method.score import combined_score
from sumo_eval.method.trajectory_field import trajectory_field
from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.engines import run_batches
from sumo_eval.record.identity import with_fingerprint
from sumo_eval.record.store import open_store
from sumo_eval.scenario import (
    Actor,
    ConcreteScenario,
    Road,
    Start,
    brake_to_stop,
    catalogue,
    constant_lateral,
)
from sumo_eval.scenario.file import scenario_from
from sumo_eval.settings import RunSettings, SimulationSettings, VehicleSettings
from sumo_eval.trajectory import Recording, Trajectory

Answer = float | str

LENGTH, EGO_X = 4.5, 50.0  # m, of every body and of the ego's start
ROAD = Road("qualification_road", 1500.0, 2, 3.5, 1000.0)
EU_ROAD = Road("eu_2022_1426_2x3.5m", 2000.0, 2, 3.5, 200.0)
# m/s2, s: brakes of the ideal vehicle and of the default vehicle model
STRENGTH, BUILD_UP = 9.0, 0.15
SHORT = SimulationSettings(time_limit=0.5)
R157 = SimulationSettings(
    time_limit=35.0, vehicle=VehicleSettings(length=4.3, width=1.9), record_interval=0.1
)


class Check(NamedTuple):
    """One known answer.

    kind: the group it belongs to.
    name: at most 40 characters.
    find: finds the answer through the tool, of these arguments.
    source: of the expected answer.
    bound: largest difference of numbers that passes, in `unit`; words must be equal.
    """

    kind: str
    name: str
    find: Callable[..., Answer]
    arguments: tuple[Any, ...]
    expected: Answer
    source: str
    bound: float = 0.0
    unit: str = ""


def all_checks() -> Iterator[Check]:
    """Every check that ships."""
    kinds = {
        "closed forms through SUMO": closed_forms,
        "equations": equations,
        "UN R157, consensus rows": consensus,
        "UN R79, distance S": un_r79,
        "(EU) 2022/1426, table": eu_2022_1426,
        "step halving": halving,
        "determinism": determinism,
        "libsumo traps": traps,
    }
    return (Check(kind, *row) for kind, rows in kinds.items() for row in rows())


Rows = Iterator[tuple[Any, ...]]
"""Of the table, without their kind."""


# --- one drive ------------------------------------------------------------------------------------


def drive(
    concrete: ConcreteScenario, ads: ControllerLike, settings: SimulationSettings | None = None
) -> Recording:
    """Raises SimulationError where the drive ended with an error."""
    recording = simulate(concrete, ads, settings)
    if recording.error is not None:
        raise SimulationError(recording.error)
    return recording


def behind(speed: float, other: float, gap: float, braking: float = 0.0) -> ConcreteScenario:
    """The ego `gap` m behind another in its lane, which keeps its speed or brakes. m/s, m/s2."""
    acts = (brake_to_stop(0.0, braking),) if braking else ()
    lead = Actor("other", Start(EGO_X + LENGTH + gap, 0.0, other), acts, LENGTH)
    return ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.0, speed), (lead,))


def impact(*drives: Any) -> float:
    """Relative speed at contact of a `drive` of these arguments, 0 without one, m/s."""
    collision = drive(*drives).collision
    return 0.0 if collision is None else collision.relative_speed


def least_gap(*drives: Any) -> float:
    """Smallest distance along the road from the ego's front to the other's rear, m."""
    recording = drive(*drives)
    return float((recording.actors["other"].x - recording.ego.x).min()) - LENGTH


def rolls(*_: Any) -> Command:
    """Neither brakes nor accelerates."""
    return Command(0.0)


# --- closed forms ---------------------------------------------------------------------------------

DELAYED = (
    (10.0, 0.4, 7.59294, 0.6, 6.7356, 9.51065),
    (30.0, 0.0, 7.59294, 0.6, 34.0758, 22.74802),
    (20.0, 1.15, 7.59294, 0.6, 27.6132, 19.6595),
    (25.0, 0.4, 9.0, 1e-6, 22.3611, 20.06241),
)
"""Closing speed, m/s; delay, s; plateau, m/s2; rise, s; gap, m; impact speed, m/s: integrated apart
from this code."""


class LateBraking:
    """Rolls for `delay` s, then asks for all that the brakes have."""

    def __init__(self, delay: float) -> None:
        self.delay = delay

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Command of a step."""
        return Command(-100.0 if time >= self.delay - 1e-9 else 0.0)


def _late(closing: float, delay: float, plateau: float, rise: float, gap: float) -> float:
    vehicle = VehicleSettings(
        length=LENGTH, max_deceleration=plateau, brake_build_up=rise, friction=2.0
    )
    settings = SimulationSettings(time_limit=60.0, vehicle=vehicle)
    return impact(behind(closing, 0.0, gap), LateBraking(delay), settings)


def closed_forms() -> Rows:
    """Ideal braking, delayed braking, and behind a lead that brakes."""
    brakes = {"deceleration": STRENGTH, "build_up": BUILD_UP}
    source = "ramp and plateau: `ideal_impact_speed`"
    for speed, other, share in ((20.0, 0.0, 0.6), (30.0, 10.0, 0.8), (30.0, 0.0, 0.9)):
        gap = round(share * float(required_gap(speed - other, **brakes)), 2)
        name = f"ideal braking {speed:g} to {other:g} m/s in {gap:g} m"
        expected = float(ideal_impact_speed(speed, other, gap, **brakes))
        braking = behind(speed, other, gap), "ideal_braking"
        yield name, impact, braking, expected, source, 0.1, "m/s"
    needed = behind(25.0, 0.0, float(required_gap(25.0, **brakes)) + 0.1), "ideal_braking"
    name = "ideal braking, 0.1 m more than it needs"
    yield name, impact, needed, 0.0, "`required_gap`", 0.0, "m/s"
    for *values, expected in DELAYED:
        name = "delay {1:g} s, rise {3:.2g} s, from {0:g} m/s".format(*values)
        yield name, _late, tuple(values), expected, "closed form, as a number", 0.1, "m/s"
    # both at v, the lead at once with a: the gap d is used up after sqrt(2 d / a), sqrt(2 d a) m/s
    # apart
    name, source = "no reaction behind a braking lead", "sqrt(2 d a), d = 10 m, a = 5 m/s2"
    rolling = behind(25.0, 25.0, 10.0, 5.0), "no_reaction"
    yield name, impact, rolling, math.sqrt(100.0), source, 0.1, "m/s"
    # as hard as the lead, only built up over T: the ego comes to stand v T / 2 - a T^2 / 24 further
    # on
    name = "as hard as the lead: gap that is left"
    stops = SimulationSettings(time_limit=25.0 / STRENGTH + 2.0)
    drives = behind(25.0, 25.0, 20.0, STRENGTH), "ideal_braking", stops
    expected = 20.0 - 25.0 * BUILD_UP / 2.0 + STRENGTH * BUILD_UP**2 / 24.0
    source = "d - v T / 2 + a T^2 / 24, d = 20 m, v = 25 m/s"
    yield name, least_gap, drives, expected, source, 0.05, "m"


# --- equations ------------------------------------------------------------------------------------


def _field(*place: float) -> float:
    sample = Trajectory([0.0], [0.0], [0.0], heading=[0.0], speed=[20.0])
    return float(trajectory_field([place], sample)[0])


def _identical() -> float:
    time = np.arange(101) / 10.0
    swings = Trajectory(time, EGO_X + 20.0 * time, 0.3 * np.sin(time), length=LENGTH, width=1.8)
    return float(anthropomorphic_index(swings, [swings, swings], ROAD).value)


def _number(function: Callable[..., Any], *arguments: Any) -> float:
    return float(function(*arguments))


def equations() -> Rows:
    """Eqs. 5-6, 9-12, 14, 15, 17 and 18."""
    for speed, lead, gap in ((25.0, 15.0, 14.0), (20.0, 0.0, 60.0)):
        name = f"max ITTC, {speed:g} to {lead:g} m/s, {gap:g} m"
        largest = math.sqrt(5.0 / (2.0 * (gap - (speed - lead) ** 2 / 10.0)))
        source = "Eqs. 5-6: sqrt(a / (2 d - u^2 / a))"
        yield name, _number, (max_inverse_ttc, speed, lead, gap), largest, source, 1e-9, "1/s"
    source = "Eq. 10: exp(0.005 * 20) / 4^0.5"
    yield "field 4 m ahead at 20 m/s", _field, (4.0, 0.0), math.exp(0.1) / 2.0, source, 1e-12
    yield "field 9 m beside", _field, (0.0, 9.0), 1.0 / 3.0, "Eq. 10: 9^-0.5", 1e-12
    source = "Eqs. 11-12: an ADS that drives as people do has 1"
    yield "D of identical drives", _identical, (), 1.0, source, 1e-12
    for severity, loss in ((0.0, 0.1), (8.0, 0.4), (8.001, 0.7), (15.0, 0.7), (15.001, 1.0)):
        name = f"collision loss of {severity:g} m/s"
        yield name, _number, (collision_loss, severity), loss, "Eq. 14, at its limits"
    name, source = "severity of an offset collision", "Eq. 15: |(3, -4)| / 0.5"
    arguments = impact_severity, (12.0, 0.0), (9.0, 4.0), 0.5
    yield name, _number, arguments, 10.0, source, 1e-12, "m/s"
    index, source = collision_avoidance_index, "Eq. 17: (1 * 5/10 + 3 * 4/16) / 4"
    collisions = [10.0, 16.0], [5.0, 4.0], [1.0, 3.0]
    yield "C of two collisions", index, collisions, 0.3125, source, 1e-12
    yield "C without a collision", index, ([], [], []), 1.0, "Eq. 17"
    name, source = "S of C = 0.8 and D = 0.6", "Eq. 18: 50 * 0.8 + 50 * 0.6"
    yield name, lambda *it: combined_score(*it).total or math.nan, (0.8, 0.6), 70.0, source, 1e-12


# --- regulations ----------------------------------------------------------------------------------

CONSENSUS = (
    (
        "cut_in", "cut-in {} to {} km/h, {} m/s, {} m",
        {"ego_speed": 3.6, "cut_in_speed": 3.6, "lateral_speed": 1.0, "gap": 1.0},
        ((40, 10, 1.2, 18, 26), (60, 30, 1.2, 18, 26), (100, 70, 1.6, 18, 22)),
    ),
    (
        "r157_cut_out", "cut-out {} km/h, {} m/s, {} m",
        {"ego_speed": 3.6, "lateral_speed": 1.0, "obstacle_gap": 1.0},
        ((70, 1.0, 5, 20), (90, 1.5, 20, 30), (130, 1.5, 50, 75)),
    ),
    (
        "front_vehicle_braking", "lead brakes {} km/h, {} s, {} g",
        {"ego_speed": 3.6, "headway": 1.0, "lead_deceleration": 1.0 / 9.81},
        ((30, 1, 0.9, 0.4), (60, 1, 0.9, 0.5), (120, 1, 0.8, 0.6)),
    ),
)  # fmt: skip
"""Scenario; name of a check; parameters with what their values are divided by; rows of values, the
last parameter's with contact and without."""
DISTANCES = ((130, 100, 42.7), (130, 80, 59.9), (120, 100, 35.1), (100, 80, 29.6))
"""Speeds behind and of the ego, km/h, and S, m."""
TABLE = (
    (SEATED, (0.48, 0.71, 0.94, 1.18, 1.41, 1.64)),
    (STANDING, (0.74, 1.32, 1.90, 2.47, 3.05, 3.63)),
)
"""TTC, s, above which a cut-in must be avoided, at closing speeds of 10, 20 .. 60 km/h."""


def _outcome(name: str, values: dict[str, float]) -> str:
    recording = drive(catalogue.load(name).concrete(**values), "careful_driver", R157)
    return "avoided" if recording.collision is None else "contact"


def consensus() -> Rows:
    """Neighbouring rows on both sides of the limit, in which independent readings of the careful
    driver agree.
    """
    for scenario, name, parameters, rows in CONSENSUS:
        for *fixed, contact, avoided in rows:
            for value, expected in ((contact, "contact"), (avoided, "avoided")):
                point = (*fixed, value)
                pairs = zip(parameters.items(), point, strict=True)
                values = {key: number / unit for (key, unit), number in pairs}
                source = "independent readings of Annex 3 agree"
                yield name.format(*point), _outcome, (scenario, values), expected, source


def _margin(ego: float, faster: float) -> float:
    """S as the shipped scenario has it: its zone begins where the gap is S."""
    margin = catalogue.load("lane_change_rear").margin
    assert margin is not None
    point = {"ego_speed": ego, "faster": faster, "gap": 100.0}
    return 100.0 - float(margin({name: np.array([value]) for name, value in point.items()})[0])


def _rest(ego: float, faster: float, gap: float) -> float:
    """Time gap, s, that remains of `gap` m after the vehicle behind braked 3 m/s2 from 0.4 s."""
    brakes = {"do": "accelerate", "when": "time >= 0", "begin": 0.4, "speed": ego,
        "acceleration": 3.0}  # fmt: skip
    content: dict[str, Any] = {
        "name": "un_r79", "zone": "none", "ego": {"speed": ego, "x": 150.0},
        "end": {"x": 600.0, "time": 8.0},
        "parameter": [{"name": "gap", "unit": "m", "low": 10.0, "high": 90.0, "step": 10.0}],
        "vehicle": [{"name": "rear", "speed": ego + faster, "gap_behind": "gap",
            "manoeuvre": [brakes]}],
    }  # fmt: skip
    concrete = scenario_from(content, "un_r79", Path()).concrete(gap=gap)
    recording = drive(concrete, "no_reaction")
    return float(recording.ego.x[-1] - recording.actors["rear"].x[-1] - LENGTH) / ego


def un_r79() -> Rows:
    """S of the regulation, and that a vehicle behind by S is left with 1 s."""
    for place, (rear, own, distance) in enumerate(DISTANCES):
        ego, faster = own / 3.6, (rear - own) / 3.6
        name, source = f"S, {rear} behind {own} km/h", "dv 0.4 s + dv^2 / (2 * 3 m/s2) + v * 1 s"
        yield name, _margin, (ego, faster), distance, source, 0.06, "m"
        if place < 2:
            s = faster * 0.4 + faster * faster / 6.0 + ego
            name, source = f"left of S, {rear} behind {own} km/h", "1 s is left of a gap of S"
            yield name, _rest, (ego, faster, s), 1.0, source, 1e-6, "s"


def _cut_in(closing: float, ttc: float) -> ConcreteScenario:
    """A vehicle that crosses at 1 m/s, with that TTC when 0.30 m over the line, 1.15 m from its
    lane's middle.
    """
    speed = 60.0 / 3.6 + 10.0
    start = Start(100.0 + LENGTH + closing * (ttc + 1.15), 3.5, speed - closing)
    other = Actor("other", start, (constant_lateral(0.0, 1.0, -3.5),), slides=True)
    return ConcreteScenario(
        "eu_2022_1426", {"closing": closing}, 1.0, EU_ROAD, Start(100.0, 0.0, speed), (other,)
    )


def eu_2022_1426() -> Rows:
    """0.05 s above each value of the table the demanded vehicle avoids with the margin that its
    braking gives.
    """
    source = "Annex III: avoided, 0.1 m + a tau^2 / 24 left"
    for granted, values in TABLE:
        # 0.1 m that it keeps, and a tau^2 / 24 that braking built up over tau saves
        margin = 0.1 + granted.braking * granted.build_up**2 / 24.0
        model = granted.ads.removeprefix("eu_2022_")
        for kph, ttc in zip(range(10, 70, 10), values, strict=True):
            name = f"{model} {kph} km/h, TTC {ttc:.2f} + 0.05 s"
            arguments = _cut_in(kph / 3.6, ttc + 0.05), granted.ads
            yield name, least_gap, arguments, margin, source, 0.01, "m"


# --- what must not matter -------------------------------------------------------------------------


def _change(
    find: Callable[..., float], concrete: ConcreteScenario, ads: str, step: float, limit: float
) -> float:
    """Change of a measure when the step is halved."""
    coarse, fine = (
        find(concrete, ads, SimulationSettings(step=size, time_limit=limit))
        for size in (step, step / 2.0)
    )
    return fine - coarse


def halving() -> Rows:
    """Change of digits from one step to half of it."""
    source, limit = "does not depend on the step", SimulationSettings().time_limit
    stops, follows = behind(30.0, 0.0, 45.0), behind(25.0, 15.0, 40.0)
    for step in (0.1, 0.05):
        name = f"impact speed, {step:g} to {step / 2.0:g} s"
        arguments = impact, stops, "ideal_braking", step, limit
        yield name, _change, arguments, 0.0, source, 0.02, "m/s"
    name = "gap of careful_driver, 0.05 to 0.025 s"
    arguments = least_gap, follows, "careful_driver", 0.05, 15.0
    yield name, _change, arguments, 0.0, source, 0.05, "m"


def _digest(workers: int, batch: int) -> str:
    """A hash of all facts and trajectories of sixteen cases, its first 12 digits."""
    settings = SimulationSettings(step=0.1)
    low = catalogue.load("front_vehicle_low_speed")
    points = [low.concrete(ego_speed=15.0 + number, lead_speed=5.0) for number in range(8)]
    cases = [
        with_fingerprint(Case(number, concrete, "ads", ads, ads), settings, "", "")
        for ads, (number, concrete) in product(("careful_driver", "no_reaction"), enumerate(points))
    ]
    with TemporaryDirectory() as folder:
        setup = Setup(settings, RunSettings(workers=workers, cases_per_pack=batch), Path(folder))
        with open_store(Path(folder) / "facts.sqlite", create=True) as store:
            for outcomes in run_batches(cases, setup):
                store.add(*outcomes)
            return store.digest()[:12]


def _same(workers: int, batch: int) -> str:
    """Both hashes where they differ."""
    reference, digest = _digest(1, 512), _digest(workers, batch)
    return "the same" if digest == reference else f"{digest}, not {reference}"


def determinism() -> Rows:
    """Facts and trajectories are the same to the last bit."""
    for workers, batch in ((2, 512), (1, 1)):
        name = f"{workers} worker(s), batches of {batch}"
        yield name, _same, (workers, batch), "the same", "hash of 1 worker, batches of 512"


# --- traps of libsumo -----------------------------------------------------------------------------


def _stop(traci: Any, ego: str, time: float) -> None:
    """Asks SUMO for what no car can do."""
    traci.vehicle.setSpeedMode(ego, 0)
    traci.vehicle.setSpeed(ego, 0.0)


def _sample(channel: str, place: int, concrete: ConcreteScenario, ads: ControllerLike) -> float:
    """One sample of the ego."""
    return float(getattr(drive(concrete, ads, SHORT).ego, channel)[place])


def _end(concrete: ConcreteScenario, ads: ControllerLike) -> str:
    return simulate(concrete, ads, SHORT).end_reason


def _second() -> float:
    """Largest difference between a drive and the same after another in the process, m."""
    first, _, again = (
        drive(behind(*start), rolls, SHORT).ego.x
        for start in ((20.0, 15.0, 30.0), (30.0, 5.0, 9.0), (20.0, 15.0, 30.0))
    )
    return float(abs(again - first).max())


def traps() -> Rows:
    """Answers where bare libsumo, as each source states, does something else."""
    name, source = "a start 1 m behind is not delayed", "libsumo inserts it seconds later"
    yield name, _sample, ("x", 0, behind(20.0, 10.0, 1.0), rolls), EGO_X, source, 1e-9, "m"
    name, source = "bodies touch across a lane line", "getCollisions does not see them"
    # bodies of 1.8 m whose middles are 1.5 m apart, each in its own lane
    other = Actor("other", Start(EGO_X + 1.0, 2.4, 20.0))
    across = ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.9, 20.0), (other,))
    yield name, _end, (across, rolls), "contact", source
    # 9 m/s2 for 0.5 s from 20 m/s
    name, source = "speed mode 0 stops nothing at once", "libsumo brakes with 400 m/s2"
    free = behind(20.0, 20.0, 100.0)
    yield name, _sample, ("speed", -1, free, _stop), 15.5, source, 1e-6, "m/s"
    name, source = "a command that is not a number", "libsumo takes nan silently"
    yield name, _end, (free, lambda *_: Command(math.nan)), "ads_error", source
    name, source = "a simulation leaves nothing behind", "one process, two drives in order"
    yield name, _second, (), 0.0, source, 0.0, "m"
