"""Known answers that `sumo-eval qualify` expects of an installation, as a table of checks.

Each check is a function, its arguments, the value it must give and the source of this value;
`qualified.qualify` carries them out. A generator for each kind of check yields its rows.

Users: `extras/studies/qualification/qualified.py`, `extras/studies/qualify_command.py`.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cosim.doors.controller import ControllerLike
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.extras.studies.qualification.drives import (
    BUILD_UP,
    EGO_X,
    LENGTH,
    ROAD,
    SHORT,
    STRENGTH,
    Rows,
    behind,
    drive,
    impact,
    least_gap,
    rolls,
)
from sumo_eval.extras.studies.qualification.regulations import consensus, eu_2022_1426, un_r79
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
from sumo_eval.scenario import Actor, ConcreteScenario, Start, catalogue
from sumo_eval.settings import RunSettings, SimulationSettings, VehicleSettings
from sumo_eval.trajectory import Trajectory

Answer = float | str


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


def _late(closing: float, delay: float, largest: float, rise: float, gap: float) -> float:
    """Impact speed of a row of DELAYED, m/s; friction of 2.0 does not limit braking."""

    def brakes_late(traci: Any, ego: str, time: float) -> Command:
        """ADS that rolls for `delay` s, then brakes as hard as its vehicle can.

        -100 m/s2 is more than any brake has, 1e-9 s a rounding.
        """
        return Command(-100.0 if time >= delay - 1e-9 else 0.0)

    vehicle = VehicleSettings(
        length=LENGTH, max_deceleration=largest, brake_build_up=rise, friction=2.0
    )
    return impact(
        behind(closing, 0.0, gap),
        brakes_late,
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
        (behind(25.0, 0.0, gap), "ideal_braking"), 0.0, "`required_gap`", 0.0, "m/s"
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
        "sqrt(2 d a), d = 10 m, a = 5 m/s2", 0.1, "m/s"
    )  # fmt: skip
    # The ego brakes as hard as the lead, but builds this deceleration a up over T: it travels
    # v T / 2 - a T^2 / 24 further.
    until_both_stand = SimulationSettings(time_limit=25.0 / STRENGTH + 2.0)
    yield (
        "as hard as the lead: gap that is left", least_gap,
        (behind(25.0, 25.0, 20.0, STRENGTH), "ideal_braking", until_both_stand),
        20.0 - 25.0 * BUILD_UP / 2.0 + STRENGTH * BUILD_UP**2 / 24.0,
        "d - v T / 2 + a T^2 / 24, d = 20 m, v = 25 m/s", 0.05, "m"
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
        ((12.0, 0.0), (9.0, 4.0), 0.5), 10.0, "Eq. 15: |(3, -4)| / 0.5", 1e-12, "m/s"
    )  # fmt: skip
    yield (
        "C of two collisions", collision_avoidance_index,
        # U, U of the ideal vehicle, weight r
        ([10.0, 16.0], [5.0, 4.0], [1.0, 3.0]), 0.3125, "Eq. 17: (1 * 5/10 + 3 * 4/16) / 4", 1e-12
    )  # fmt: skip
    yield "C without a collision", collision_avoidance_index, ([], [], []), 1.0, "Eq. 17"
    yield (
        "S of C = 0.8 and D = 0.6", lambda c, d: combined_score(c, d).total,
        (0.8, 0.6), 70.0, "Eq. 18: 50 * 0.8 + 50 * 0.6", 1e-12
    )  # fmt: skip


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

    batch: most cases in one simulation; one holds cases of one ADS, here at most 8.
    """
    settings = SimulationSettings(step=0.1)
    logical = catalogue.load("front_vehicle_low_speed")
    points = [logical.concrete(ego_speed=15.0 + number, lead_speed=5.0) for number in range(8)]
    cases = [
        # role, driver and controller; no identity of a user's code, no harness
        with_fingerprint(Case(number, concrete, "ads", ads, ads), settings, "", "")
        for ads in ("careful_driver", "no_reaction")
        for number, concrete in enumerate(points)
    ]
    with TemporaryDirectory() as folder:
        setup = Setup(settings, RunSettings(workers=workers, cases_per_pack=batch), Path(folder))
        with open_store(Path(folder), create=True) as store:
            for outcomes in run_batches(cases, setup):
                store.add(*outcomes)
            return store.digest()[:12]


def _same(workers: int, batch: int) -> str:
    """`the same`, or both hashes where this one is not that of one worker and largest batches."""
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
    """Largest difference between a drive and its repetition, m, with another drive between them in
    the same process.
    """
    first, _, again = (
        drive(behind(*arguments), rolls, SHORT).ego.x
        for arguments in ((20.0, 15.0, 30.0), (30.0, 5.0, 9.0), (20.0, 15.0, 30.0))
    )
    return float(abs(again - first).max())


def traps() -> Rows:
    """Known answers in places where libsumo alone does what `source` states; of the last row
    `source` states what was driven.
    """
    yield (
        "a start 1 m behind is not delayed", _sample,
        ("x", 0, behind(20.0, 10.0, 1.0), rolls), EGO_X,
        "libsumo inserts it seconds later", 1e-9, "m"
    )  # fmt: skip
    # bodies of 1.8 m whose middles are 1.5 m apart, each in its own lane
    other = Actor("other", Start(EGO_X + 1.0, 2.4, 20.0))
    across = ConcreteScenario("qualification", {}, 1.0, ROAD, Start(EGO_X, 0.9, 20.0), (other,))
    yield (
        "bodies touch across a lane line", _end,
        (across, rolls), "contact", "getCollisions does not see them"
    )  # fmt: skip
    free = behind(20.0, 20.0, 100.0)
    yield (
        "speed mode 0 stops nothing at once", _sample,
        ("speed", -1, free, _stop), 15.5,  # 9 m/s2 for 0.5 s from 20 m/s
        "libsumo brakes with 400 m/s2", 1e-6, "m/s"
    )  # fmt: skip
    yield (
        "a command that is not a number", _end,
        (free, lambda *_: Command(math.nan)), "ads_error", "libsumo takes nan silently"
    )  # fmt: skip
    yield (
        "a simulation leaves nothing behind", _difference_of_repetition,
        (), 0.0, "one process, two drives in order", 0.0, "m"
    )  # fmt: skip
