"""What must not matter: the step, the number of workers, the size of packs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.engines import run_packs
from sumo_eval.record.identity import with_fingerprint
from sumo_eval.record.store import open_store
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings
from sumo_eval.studies.qualification.check import Check
from sumo_eval.studies.qualification.driven import behind, drive, impact_speed, least_gap

STEPS, DETERMINISM = "step halving", "determinism"
RUNS = ((2, 512), (1, 1))
"""Workers and cases in a pack that must give what 1 worker with packs of 512 gives."""


def _contact_moves(step: float) -> float:
    """Change of the impact speed of ideal braking when the step is halved, m/s."""
    concrete = behind(30.0, 0.0, 45.0)
    coarse, fine = (
        impact_speed(drive(concrete, "ideal_braking", SimulationSettings(step=size))) for size in (step, step / 2.0)
    )
    return fine - coarse


def _gap_moves(step: float) -> float:
    """Change of the careful driver's smallest gap behind somebody slower when the step is halved, m."""
    concrete = behind(25.0, 15.0, 40.0)
    coarse, fine = (
        least_gap(drive(concrete, "careful_driver", SimulationSettings(step=size, time_limit=15.0)))
        for size in (step, step / 2.0)
    )
    return fine - coarse


def halving() -> Iterator[Check]:
    """How far digits move from one step to half of it."""
    for step in (0.1, 0.05):
        yield Check(STEPS, f"impact speed, {step:g} to {step / 2.0:g} s", "does not depend on the step", 0.0,
                    partial(_contact_moves, step), 0.02, "m/s")  # fmt: skip
    yield Check(STEPS, "gap of careful_driver, 0.05 to 0.025 s", "does not depend on the step", 0.0,
                partial(_gap_moves, 0.05), 0.05, "m")  # fmt: skip


def _cases(settings: SimulationSettings) -> list[Case]:
    low = catalogue.load("front_vehicle_low_speed")
    points = [low.concrete(ego_speed=15.0 + number, lead_speed=5.0) for number in range(8)]
    return [
        with_fingerprint(Case(number, concrete, "ads", ads, ads), settings, "", "")
        for ads in ("careful_driver", "no_reaction")
        for number, concrete in enumerate(points)
    ]


def _digest(workers: int, pack: int) -> str:
    """A hash of all facts and trajectories of sixteen cases, its first 12 digits."""
    settings = SimulationSettings(step=0.1)
    with TemporaryDirectory() as folder:
        setup = Setup(settings, RunSettings(workers=workers, cases_per_pack=pack), Path(folder))
        with open_store(Path(folder) / "facts.sqlite", create=True) as store:
            for outcomes in run_packs(_cases(settings), setup):
                store.add(*outcomes)
            return store.digest()[:12]


def _same(workers: int, pack: int) -> str:
    """Both hashes where they differ."""
    reference, found = _digest(1, 512), _digest(workers, pack)
    return "the same" if found == reference else f"{found}, not {reference}"


def determinism() -> Iterator[Check]:
    """Facts and trajectories are the same to the last bit."""
    for workers, pack in RUNS:
        yield Check(DETERMINISM, f"{workers} worker(s), packs of {pack}", "hash of 1 worker, packs of 512", "the same",
                    partial(_same, workers, pack))  # fmt: skip
