"""Known answers that `sumo-eval qualify` expects of an installation, as a table of checks.

Each check is a function, its arguments, the value it must give and the source of this value;
`qualified.qualify` carries them out. A generator for each kind of check yields its rows.

Users: `extras/studies/qualification/qualified.py`, `extras/studies/qualify_command.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
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

LENGTH = 4.5  # m, of every vehicle unless a check sets its own
EGO_X = 50.0  # m, where the ego starts
# name; x at which drives end, m; number of lanes; lane width, m; length of road after the end, m
ROAD = Road("qualification_road", 1500.0, 2, 3.5, 1000.0)
EU_ROAD = Road("eu_2022_1426_2x3.5m", 2000.0, 2, 3.5, 200.0)
# brakes of the ideal vehicle and of the default vehicle model: deceleration, m/s2, and the time
# until it is built up, s
STRENGTH, BUILD_UP = 9.0, 0.15
SHORT = SimulationSettings(time_limit=0.5)
"""Half a second, for the traps of libsumo."""
R157 = SimulationSettings(
    time_limit=35.0, vehicle=VehicleSettings(length=4.3, width=1.9), record_interval=0.1
)
"""For the rows of UN R157."""


class Check(NamedTuple):
    """One known answer.

    kind: the group it belongs to.
    name: at most 40 characters.
    find: called with `arguments`, gives the tool's answer.
    expected: the right answer.
    source: where it comes from.
    bound: largest difference of two numbers that passes, in `unit`; words must be equal.
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
"""Rows of the table: the fields of `Check` from `name` on."""


# --- drives ---------------------------------------------------------------------------------------


def drive(
    concrete: ConcreteScenario, ads: ControllerLike, settings: SimulationSettings | None = None
) -> Recording:
    """The recording of one drive.

    Raises SimulationError where it ended with an error.
    """
    recording = simulate(concrete, ads, settings)
    if recording.error is not None:
        raise SimulationError(recording.error)
    return recording


def behind(speed: float, lead_speed: float, gap: float, braking: float = 0.0) -> ConcreteScenario:
    """An ego behind a lead vehicle, the actor `other`, which keeps its speed or brakes at once.

    speed: of the ego, m/s.
    gap: between the two bodies, m.
    braking: deceleration of the lead vehicle, m/s2; 0: it keeps its speed.
    """
    acts = (brake_to_stop(0.0, braking),) if braking else ()
    lead = Actor("other", Start(EGO_X + LENGTH + gap, 0.0, lead_speed), acts, LENGTH)
    return ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.0, speed), (lead,))


def impact(*arguments: Any) -> float:
    """Relative speed at contact in a `drive` with these arguments, m/s; 0 without contact."""
    collision = drive(*arguments).collision
    return 0.0 if collision is None else collision.relative_speed


def least_gap(*arguments: Any) -> float:
    """Smallest distance along the road from the ego's front to the rear of `other`, m, in a `drive`
    with these arguments.
    """
    recording = drive(*arguments)
    return float((recording.actors["other"].x - recording.ego.x).min()) - LENGTH


def rolls(*_: Any) -> Command:
    """ADS that neither brakes nor accelerates."""
    return Command(0.0)


# --- closed forms ---------------------------------------------------------------------------------

DELAYED = (
    (10.0, 0.4, 7.59294, 0.6, 6.7356, 9.51065),
    (30.0, 0.0, 7.59294, 0.6, 34.0758, 22.74802),
    (20.0, 1.15, 7.59294, 0.6, 27.6132, 19.6595),
    (25.0, 0.4, 9.0, 1e-6, 22.3611, 20.06241),
)
"""Rows of delayed braking towards a standing vehicle, computed in closed form outside this package.

Closing speed, m/s; delay, s; largest deceleration, m/s2; time of its linear rise, s; gap, m; impact
speed, m/s.
"""


class LateBraking:
    """ADS that rolls for `delay` s, then brakes as hard as its vehicle can."""

    def __init__(self, delay: float) -> None:
        self.delay = delay

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Command of a step; -100 m/s2 is more than any brake has, 1e-9 s a rounding."""
        return Command(-100.0 if time >= self.delay - 1e-9 else 0.0)


def _late(closing: float, delay: float, largest: float, rise: float, gap: float) -> float:
    """Impact speed of a row of DELAYED, m/s; friction of 2.0 does not limit braking."""
    vehicle = VehicleSettings(
        length=LENGTH, max_deceleration=largest, brake_build_up=rise, friction=2.0
    )
    return impact(
        behind(closing, 0.0, gap),
        LateBraking(delay),
        SimulationSettings(time_limit=60.0, vehicle=vehicle),
    )


def closed_forms() -> Rows:
    """Ideal braking, delayed braking, and driving behind a lead vehicle that brakes."""
    brakes = {"deceleration": STRENGTH, "build_up": BUILD_UP}
    # braking that rises linearly (ramp), then holds (plateau)
    source = "ramp and plateau: `ideal_impact_speed`"
    # share: gap as a share of the one that the ideal vehicle needs
    for speed, lead_speed, share in ((20.0, 0.0, 0.6), (30.0, 10.0, 0.8), (30.0, 0.0, 0.9)):
        gap = round(share * float(required_gap(speed - lead_speed, **brakes)), 2)
        name = f"ideal braking {speed:g} to {lead_speed:g} m/s in {gap:g} m"
        expected = float(ideal_impact_speed(speed, lead_speed, gap, **brakes))
        arguments = behind(speed, lead_speed, gap), "ideal_braking"
        yield name, impact, arguments, expected, source, 0.1, "m/s"
    gap = float(required_gap(25.0, **brakes)) + 0.1
    yield (
        "ideal braking, 0.1 m more than it needs", impact,
        (behind(25.0, 0.0, gap), "ideal_braking"), 0.0, "`required_gap`", 0.0, "m/s",
    )  # fmt: skip

    source = "closed form, as a number"
    for closing, delay, largest, rise, gap, expected in DELAYED:
        name = f"delay {delay:g} s, rise {rise:.2g} s, from {closing:g} m/s"
        yield name, _late, (closing, delay, largest, rise, gap), expected, source, 0.1, "m/s"

    # Both are equally fast, and the lead brakes with a at once. It uses up the gap d within
    # sqrt(2 d / a), when their speeds differ by sqrt(2 d a).
    yield (
        "no reaction behind a braking lead", impact,
        (behind(25.0, 25.0, 10.0, 5.0), "no_reaction"), math.sqrt(100.0),
        "sqrt(2 d a), d = 10 m, a = 5 m/s2", 0.1, "m/s",
    )  # fmt: skip
    # The ego brakes as hard as the lead, but builds this deceleration a up over T: it travels
    # v T / 2 - a T^2 / 24 further.
    until_both_stand = SimulationSettings(time_limit=25.0 / STRENGTH + 2.0)
    yield (
        "as hard as the lead: gap that is left", least_gap,
        (behind(25.0, 25.0, 20.0, STRENGTH), "ideal_braking", until_both_stand),
        20.0 - 25.0 * BUILD_UP / 2.0 + STRENGTH * BUILD_UP**2 / 24.0,
        "d - v T / 2 + a T^2 / 24, d = 20 m, v = 25 m/s", 0.05, "m",
    )  # fmt: skip


# --- equations ------------------------------------------------------------------------------------


def _field(*point: float) -> float:
    """Field strength at (x, y), m, of a single sample: a vehicle at (0, 0), at 20 m/s along x."""
    return float(
        trajectory_field([point], Trajectory([0.0], [0.0], [0.0], heading=[0.0], speed=[20.0]))[0]
    )


def _identical() -> float:
    """D_i of an ADS whose trajectory, slightly winding, is that of both drivers."""
    time = np.arange(101) / 10.0
    path = Trajectory(time, EGO_X + 20.0 * time, 0.3 * np.sin(time), length=LENGTH, width=1.8)
    return float(anthropomorphic_index(path, [path, path], ROAD).value)


def equations() -> Rows:
    """Eqs. 5-6, 9-12, 14, 15, 17 and 18."""
    for speed, lead, gap in ((25.0, 15.0, 14.0), (20.0, 0.0, 60.0)):
        name = f"max ITTC, {speed:g} to {lead:g} m/s, {gap:g} m"
        # a = 5 m/s2, the criterion's deceleration
        largest = math.sqrt(5.0 / (2.0 * gap - (speed - lead) ** 2 / 5.0))
        source = "Eqs. 5-6: sqrt(a / (2 d - u^2 / a))"
        yield name, max_inverse_ttc, (speed, lead, gap), largest, source, 1e-9, "1/s"
    source = "Eq. 10: exp(0.005 * 20) / 4^0.5"
    yield "field 4 m ahead at 20 m/s", _field, (4.0, 0.0), math.exp(0.1) / 2.0, source, 1e-12
    yield "field 9 m beside", _field, (0.0, 9.0), 1.0 / 3.0, "Eq. 10: 9^-0.5", 1e-12
    source = "Eqs. 11-12: an ADS that drives as people do has 1"
    yield "D of identical drives", _identical, (), 1.0, source, 1e-12
    for severity, loss in ((0.0, 0.1), (8.0, 0.4), (8.001, 0.7), (15.0, 0.7), (15.001, 1.0)):
        name = f"collision loss of {severity:g} m/s"
        yield name, collision_loss, (severity,), loss, "Eq. 14, at its limits"
    yield (
        "severity of an offset collision", impact_severity,
        # velocities of ego and obstacle, overlap of the ego's width
        ((12.0, 0.0), (9.0, 4.0), 0.5), 10.0, "Eq. 15: |(3, -4)| / 0.5", 1e-12, "m/s",
    )  # fmt: skip
    yield (
        "C of two collisions", collision_avoidance_index,
        # U, U of the ideal vehicle, weight r
        ([10.0, 16.0], [5.0, 4.0], [1.0, 3.0]), 0.3125, "Eq. 17: (1 * 5/10 + 3 * 4/16) / 4", 1e-12,
    )  # fmt: skip
    yield "C without a collision", collision_avoidance_index, ([], [], []), 1.0, "Eq. 17"
    yield "S of C = 0.8 and D = 0.6", _score, (0.8, 0.6), 70.0, "Eq. 18: 50 * 0.8 + 50 * 0.6", 1e-12


def _score(c: float, d: float) -> float | None:
    """S, None where it is not computed."""
    return combined_score(c, d).total


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
        {"ego_speed": 3.6, "headway": 1.0, "lead_deceleration": 1.0 / 9.81},  # in g
        ((30, 1, 0.9, 0.4), (60, 1, 0.9, 0.5), (120, 1, 0.8, 0.6)),
    ),
)  # fmt: skip
"""Rows of UN R157, for each of three scenarios:

the name of the shipped scenario; the pattern of a check's name;
its parameters, each with the divisor that makes SI units of a row's value (3.6: of km/h);
rows: values of all parameters but the last, then two neighbouring values of the last, one with
contact and one without.
"""
DISTANCES = ((130, 100, 42.7), (130, 80, 59.9), (120, 100, 35.1), (100, 80, 29.6))
"""Rows of UN R79: speed of the vehicle behind and of the ego, km/h; distance S, m."""
TABLE = (
    (SEATED, (0.48, 0.71, 0.94, 1.18, 1.41, 1.64)),
    (STANDING, (0.74, 1.32, 1.90, 2.47, 3.05, 3.63)),
)
"""Rows of (EU) 2022/1426: brakes that it assumes of an ADS with seated or with standing passengers;
TTC, s, above which a cut-in must be avoided, at closing speeds of 10, 20 .. 60 km/h.
"""


def _outcome(name: str, values: dict[str, float]) -> str:
    """Outcome of `careful_driver` at a point of a shipped scenario: `avoided` or `contact`."""
    recording = drive(catalogue.load(name).concrete(**values), "careful_driver", R157)
    return "avoided" if recording.collision is None else "contact"


def consensus() -> Rows:
    """Rows on both sides of the limit at which the careful driver just avoids a collision.

    Independent readings of the regulation's text agree in them.
    """
    for scenario, name, parameters, rows in CONSENSUS:
        for *fixed, contact, avoided in rows:
            for value, expected in ((contact, "contact"), (avoided, "avoided")):
                point = (*fixed, value)
                pairs = zip(parameters.items(), point, strict=True)
                values = {key: number / divisor for (key, divisor), number in pairs}
                source = "independent readings of Annex 3 agree"
                yield name.format(*point), _outcome, (scenario, values), expected, source


def _margin(ego: float, faster: float) -> float:
    """S, m, by the shipped scenario, whose margin is gap - S.

    ego: its speed, m/s.
    faster: speed of the vehicle behind less that of the ego, m/s.
    """
    logical = catalogue.load("lane_change_rear")
    assert logical.margin is not None
    at_100_m = logical.columns([(ego, faster, 100.0)])
    return 100.0 - float(logical.margin(at_100_m)[0])


def _rest(ego: float, faster: float, gap: float) -> float:
    """Time gap, s, that is left of `gap` m when the vehicle behind has braked to the ego's speed,
    with 3 m/s2 from 0.4 s on.

    ego, faster: as in `_margin`.
    """
    # `accelerate` to a lower speed brakes; its acceleration is a magnitude
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
    """S of the regulation, and the time gap of 1 s that a vehicle behind keeps at a gap of S."""
    for number, (rear, own, distance) in enumerate(DISTANCES):
        ego, faster = own / 3.6, (rear - own) / 3.6
        yield (
            f"S, {rear} behind {own} km/h", _margin,
            (ego, faster), distance, "dv 0.4 s + dv^2 / (2 * 3 m/s2) + v * 1 s", 0.06, "m",
        )  # fmt: skip
        if number < 2:  # two drives through SUMO are enough
            s = faster * 0.4 + faster * faster / 6.0 + ego
            yield (
                f"left of S, {rear} behind {own} km/h", _rest,
                (ego, faster, s), 1.0, "1 s is left of a gap of S", 1e-6, "s",
            )  # fmt: skip


def _cut_in(closing: float, ttc: float) -> ConcreteScenario:
    """A cut-in at 1 m/s lateral speed, with this TTC once the body is 0.30 m over the line.

    closing: speed of the ego less that of the other vehicle, m/s.
    ttc: s.

    The other vehicle moves 1.75 m (half a lane) - 0.90 m (half a body) + 0.30 m = 1.15 m until
    then, which takes 1.15 s.
    """
    speed = 60.0 / 3.6 + 10.0  # of the ego, m/s: the other drives 10 m/s or faster
    start = Start(100.0 + LENGTH + closing * (ttc + 1.15), 3.5, speed - closing)
    other = Actor("other", start, (constant_lateral(0.0, 1.0, -3.5),), slides=True)
    return ConcreteScenario(
        "eu_2022_1426", {"closing": closing}, 1.0, EU_ROAD, Start(100.0, 0.0, speed), (other,)
    )


def eu_2022_1426() -> Rows:
    """Cut-ins 0.05 s above each TTC of the table: the vehicle that the regulation demands avoids
    them, and its braking leaves a known gap.
    """
    source = "Annex III: avoided, 0.1 m + a tau^2 / 24 left"
    for brakes, values in TABLE:
        # What is left: 0.1 m that the rule keeps, and a tau^2 / 24. The rule counts the build-up of
        # the braking a over tau as a delay of tau / 2, which needs that much more road.
        margin = 0.1 + brakes.braking * brakes.build_up**2 / 24.0
        model = brakes.ads.removeprefix("eu_2022_")
        for kph, ttc in zip(range(10, 70, 10), values, strict=True):
            name = f"{model} {kph} km/h, TTC {ttc:.2f} + 0.05 s"
            arguments = _cut_in(kph / 3.6, ttc + 0.05), brakes.ads
            yield name, least_gap, arguments, margin, source, 0.01, "m"


# --- steps, workers and batches, which change nothing ---------------------------------------------


def _change(
    find: Callable[..., float], concrete: ConcreteScenario, ads: str, step: float, limit: float
) -> float:
    """Change of a measure, `impact` or `least_gap`, when the step is halved.

    step: the larger step, s.
    limit: time limit of the drive, s.
    """
    coarse, fine = (
        find(concrete, ads, SimulationSettings(step=size, time_limit=limit))
        for size in (step, step / 2.0)
    )
    return fine - coarse


def halving() -> Rows:
    """Measures that a step half as long does not change."""
    source = "does not depend on the step"
    limit = SimulationSettings().time_limit
    stops, follows = behind(30.0, 0.0, 45.0), behind(25.0, 15.0, 40.0)
    for step in (0.1, 0.05):
        name = f"impact speed, {step:g} to {step / 2.0:g} s"
        arguments = impact, stops, "ideal_braking", step, limit
        yield name, _change, arguments, 0.0, source, 0.02, "m/s"
    name = "gap of careful_driver, 0.05 to 0.025 s"
    arguments = least_gap, follows, "careful_driver", 0.05, 15.0
    yield name, _change, arguments, 0.0, source, 0.05, "m"


def _digest(workers: int, batch: int) -> str:
    """Hash of all facts and trajectories of sixteen cases, its first 12 digits.

    batch: most cases in one simulation.
    """
    settings = SimulationSettings(step=0.1)
    low = catalogue.load("front_vehicle_low_speed")
    cases = [
        with_fingerprint(Case(number, concrete, "ads", ads, ads), settings, "", "")
        for ads in ("careful_driver", "no_reaction")
        for number in range(8)
        for concrete in [low.concrete(ego_speed=15.0 + number, lead_speed=5.0)]
    ]
    with TemporaryDirectory() as folder:
        setup = Setup(settings, RunSettings(workers=workers, cases_per_pack=batch), Path(folder))
        with open_store(Path(folder) / "facts.sqlite", create=True) as store:
            for outcomes in run_batches(cases, setup):
                store.add(*outcomes)
            return store.digest()[:12]


def _same(workers: int, batch: int) -> str:
    """`the same`, or both hashes where this one is not that of one worker and batches of 512."""
    reference, digest = _digest(1, 512), _digest(workers, batch)
    return "the same" if digest == reference else f"{digest}, not {reference}"


def determinism() -> Rows:
    """Facts and trajectories that do not depend on workers and batches, to the last bit."""
    for workers, batch in ((2, 512), (1, 1)):
        name = f"{workers} worker(s), batches of {batch}"
        yield name, _same, (workers, batch), "the same", "hash of 1 worker, batches of 512"


# --- traps of libsumo -----------------------------------------------------------------------------


def _stop(traci: Any, ego: str, time: float) -> None:
    """ADS that commands SUMO to stop the ego within one step, which no car can do."""
    traci.vehicle.setSpeedMode(ego, 0)
    traci.vehicle.setSpeed(ego, 0.0)


def _sample(channel: str, index: int, concrete: ConcreteScenario, ads: ControllerLike) -> float:
    """One sample of a channel of the ego's trajectory: the first (0) or the last (-1)."""
    return float(getattr(drive(concrete, ads, SHORT).ego, channel)[index])


def _end(concrete: ConcreteScenario, ads: ControllerLike) -> str:
    """Reason why the drive ended."""
    return simulate(concrete, ads, SHORT).end_reason


def _difference_of_repetition() -> float:
    """Largest difference between a drive and its repetition after another drive in the same
    process, m.
    """
    first, _, again = (
        drive(behind(*arguments), rolls, SHORT).ego.x
        for arguments in ((20.0, 15.0, 30.0), (30.0, 5.0, 9.0), (20.0, 15.0, 30.0))
    )
    return float(abs(again - first).max())


def traps() -> Rows:
    """Known answers in places where libsumo alone does what `source` states."""
    yield (
        "a start 1 m behind is not delayed", _sample,
        ("x", 0, behind(20.0, 10.0, 1.0), rolls), EGO_X,
        "libsumo inserts it seconds later", 1e-9, "m",
    )  # fmt: skip
    # bodies of 1.8 m whose middles are 1.5 m apart, each in its own lane
    other = Actor("other", Start(EGO_X + 1.0, 2.4, 20.0))
    across = ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.9, 20.0), (other,))
    yield (
        "bodies touch across a lane line", _end,
        (across, rolls), "contact", "getCollisions does not see them",
    )  # fmt: skip
    free = behind(20.0, 20.0, 100.0)
    yield (
        "speed mode 0 stops nothing at once", _sample,
        ("speed", -1, free, _stop), 15.5,  # 9 m/s2 for 0.5 s from 20 m/s
        "libsumo brakes with 400 m/s2", 1e-6, "m/s",
    )  # fmt: skip
    yield (
        "a command that is not a number", _end,
        (free, lambda *_: Command(math.nan)), "ads_error", "libsumo takes nan silently",
    )  # fmt: skip
    yield (
        "a simulation leaves nothing behind", _difference_of_repetition,
        (), 0.0, "one process, two drives in order", 0.0, "m",
    )  # fmt: skip
