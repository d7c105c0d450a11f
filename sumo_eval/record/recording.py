"""Fill a run's store: ADSs and the references in every concrete scenario, drivers where it is
safe.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

from sumo_eval.cases import EVALUATED
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.cosim.doors.entry import steps_between
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.errors import InputError, StoppedError, said, unknown
from sumo_eval.input_file import hash_of
from sumo_eval.record.cases import Block, Case, Outcome, Role, Setup
from sumo_eval.record.claims import OURS, home
from sumo_eval.record.engines import identify, run_packs
from sumo_eval.record.identity import (
    files_identity,
    harness_identity,
    is_over_arrays,
    people_identity,
    with_fingerprint,
)
from sumo_eval.record.progress import Progress, Stopping, never
from sumo_eval.record.reads import LINKS, NOT_KNOWN, OneVersion, changed
from sumo_eval.record.store import RECORDED, Store
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings import EvaluationSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.text import clean
from sumo_eval.trajectory import BoolArray, FloatArray, Recording, Trajectory

REFERENCES: Mapping[Role, str] = {
    "ideal": "ideal vehicle", "no_reaction": "no reaction", "task_reference": "reference car",
}  # fmt: skip
"""References of the scores, by role: Ug of the ideal vehicle, U0 of doing nothing, times of
T."""


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """The points (n, k) of one logical scenario, which of them are hazardous (n,), and the numbers
    of those to do.

    weights: p_i of each point, (n,), up to a factor.
    exposure: what the run keeps of where they come from.
    """

    logical: LogicalScenario
    points: FloatArray
    hazardous: BoolArray
    numbers: Sequence[int]
    weights: FloatArray
    exposure: Mapping[str, Any] = field(default_factory=dict)

    def concrete(self, number: int) -> ConcreteScenario:
        """The concrete scenario at a point; made when asked for, because a space can have a million
        of them.
        """
        values: list[float] = self.points[number].tolist()
        made = self.logical.concrete(**dict(zip(self.logical.names, values, strict=True)))
        return replace(made, exposure=float(self.weights[number]))

    @property
    def safe(self) -> list[int]:
        """The points to do that lie in the safe zone."""
        return [number for number in self.numbers if not self.hazardous[number]]


@dataclass(frozen=True, slots=True, eq=False)
class Planner:
    """Makes the cases of an evaluation, each with the fingerprint of what its facts depend on."""

    settings: EvaluationSettings
    source: Path
    harness: str
    identities: Mapping[str, str]
    over_arrays: frozenset[str] = frozenset()  # locators of the policies that drive cases in blocks

    @property
    def setup(self) -> Setup:
        """Values that all cases share."""
        files = {ads.locator: tuple(ads.files) for ads in self.settings.ads if ads.files}
        simulation, run = self.settings.simulation, self.settings.run
        return Setup(simulation, run, self.source, files, no_return=True)

    def ads(self, space: Space) -> Iterator[Case]:
        """Every ADS at every point; policies over arrays block by block."""
        seed, size = self.settings.seed, self._cases_in_block
        by_case = [
            ads for ads in self.settings.ads if size == 1 or ads.locator not in self.over_arrays
        ]
        for number in space.numbers:
            concrete = space.concrete(number)
            for ads in by_case:
                yield self._finished(
                    Case(number, concrete, "ads", ads.name, ads.locator, seed=seed)
                )
        by_block = [ads for ads in self.settings.ads if ads not in by_case]
        for _, numbers in groupby(
            space.numbers if by_block else (), key=lambda number: number // size
        ):
            wanted = list(numbers)
            first = wanted[0] // size * size
            concretes = [
                space.concrete(number)
                for number in range(first, min(first + size, len(space.points)))
            ]
            block = Block.of(first, concretes)
            for ads in by_block:
                for number in wanted:
                    case = Case(
                        number,
                        concretes[number - first],
                        "ads",
                        ads.name,
                        ads.locator,
                        seed=seed,
                        block=block,
                    )
                    yield self._finished(case)

    @property
    def _controllers(self) -> Mapping[Role, str]:
        """The controller of each reference."""
        car = self.settings.method.task.task_reference
        return {"ideal": "ideal_braking", "no_reaction": "no_reaction", "task_reference": car}

    @property
    def _cases_in_block(self) -> int:
        """How many cases a policy over arrays drives together: of the points, whoever works them
        off.
        """
        return min(self.settings.run.cases_per_pack, self.settings.run.cases_per_child)

    def reference(self, space: Space, role: Role) -> Iterator[Case]:
        """One of the references at every point, whatever the ADSs did there."""
        controller = self._controllers[role]
        for number in space.numbers:
            case = Case(number, space.concrete(number).without_ads, role, role, controller)
            # Without an identity of its own: an ADS that is called by the same locator must not
            # change a reference.
            yield with_fingerprint(case, self.settings.simulation, "", self.harness)

    def humans(self, space: Space) -> Iterator[Case]:
        """Every synthetic driver at every safe point of a scene that they know."""
        for number in space.safe if space.logical.has_drivers else ():
            concrete = space.concrete(number).without_ads
            yield from self.synthetic(number, concrete, self.settings.drivers.count)

    def synthetic(self, number: int, concrete: ConcreteScenario, count: int) -> Iterator[Case]:
        """The first `count` synthetic drivers at one point."""
        seed, population = self.settings.seed, self.settings.drivers.population
        for index in range(count):
            yield self._finished(
                Case(
                    number,
                    concrete,
                    "human",
                    f"driver_{index:02d}",
                    "synthetic",
                    index,
                    count,
                    seed,
                    population,
                )
            )

    def human(self, number: int, concrete: ConcreteScenario, name: str) -> Case:
        """The drive of a person that is not simulated: a recorded one, or of the user's own
        reference.
        """
        return self._finished(Case(number, concrete, "human", name, self.settings.drivers.source))

    def _finished(self, case: Case) -> Case:
        identity = self.identities.get(case.controller, "")
        return with_fingerprint(case, self.settings.simulation, identity, self.harness)


def planner(settings: EvaluationSettings, source: Path) -> Planner:
    """Find every ADS and the human reference.

    Raises InputError when one of them cannot be loaded.
    """
    named = [("ADS", ads.locator) for ads in settings.ads]
    if settings.drivers.source not in ("synthetic", RECORDED):
        named.append(("Human reference", settings.drivers.source))
    if (car := settings.method.task.task_reference) not in SHIPPED:
        raise unknown("baseline for `method.task.task_reference`", car, SHIPPED)
    setup = Setup(settings.simulation, settings.run, source)
    harness = harness_identity() + _plant_identity(settings, source)
    identities = dict(identify(list(dict.fromkeys(named)), setup))
    over_arrays = frozenset(
        ads.locator for ads in settings.ads if is_over_arrays(identities[ads.locator])
    )
    for ads in settings.ads:
        steps_between(ads.period or 0.0, settings.simulation.step, f"ADS `{ads.name}`")
        identities[ads.locator] += files_identity(ads, source)
    if settings.drivers.source == RECORDED:
        # pandas, which synthetic drivers do not need
        from sumo_eval.drivers.recorded.reference import open_people

        # a file that cannot be read must not be found out after the simulation
        open_people(settings.drivers, source)
        identities[RECORDED] = people_identity(settings.drivers, source)
    return Planner(settings, source, harness, identities, over_arrays)


def _plant_identity(settings: EvaluationSettings, source: Path) -> str:
    """A hash of the FMU that moves the ego in place of the single-track model.

    Raises InputError when it is none.
    """
    plant = settings.simulation.plant
    if plant is None:
        return ""
    FmuPlant(plant, plant.file, source)
    return hash_of(source / plant.file, "FMU")


def record(
    spaces: Sequence[Space],
    plan: Planner,
    store: Store,
    progress: Progress,
    stopping: Stopping = never,
) -> None:
    """Simulate the cases of an evaluation that are not recorded yet.

    What does not depend on each other is one piece of work, over all logical scenarios, so that no
    process waits for the last case of each.

    Raises StoppedError when `stopping` returned true before all were done; what has been done is
    recorded.
    """
    settings = plan.settings
    work = _Work(store, plan.setup, progress, stopping)
    work.do(
        [
            stage
            for stages in zip(*(stages(space, plan) for space in spaces), strict=True)
            for stage in stages
        ]
    )
    for space in spaces:
        if settings.drivers.source == "synthetic":
            drivers = {f"driver_{index:02d}" for index in range(settings.drivers.count)}
            safe = set(space.safe) if space.logical.has_drivers else set()
            found = store.names("human", space.logical.name)
            store.remove(
                (case for case, point, who in found if point not in safe or who not in drivers)
            )
        else:
            _record_people(space, plan, store, work, progress)


@dataclass(frozen=True, slots=True)
class _Stage:
    """Cases of one role in one logical scenario, as their progress is shown."""

    name: str
    scenario: str
    role: Role
    cases: Iterable[Case]
    total: int


def stages(space: Space, plan: Planner) -> list[_Stage]:
    """Drivers simulated in one logical scenario: ADSs, references, synthetic drivers."""
    name, points, drivers = space.logical.name, len(space.numbers), plan.settings.drivers
    found = [_Stage(f"{name}: ADSs", name, "ads", plan.ads(space), points * len(plan.settings.ads))]
    for role, words in REFERENCES.items():
        found.append(_Stage(f"{name}: {words}", name, role, plan.reference(space, role), points))
    if drivers.source == "synthetic":
        total = len(space.safe) * drivers.count * space.logical.has_drivers
        found.append(_Stage(f"{name}: drivers", name, "human", plan.humans(space), total))
    return found


def _record_people(
    space: Space, plan: Planner, store: Store, work: _Work, progress: Progress
) -> None:
    """The drives that the source of drivers has for every safe point, and synthetic drivers where
    recorded ones are too few and shall be filled up.
    """
    name, settings, safe = space.logical.name, plan.settings.drivers, space.safe
    recorded = settings.source == RECORDED
    fills = recorded and settings.too_thin == "fill" and space.logical.has_drivers
    drives = _recorded_drives(plan, space) if recorded else partial(_own_drives, plan)
    known: set[str] = set()
    fill: list[Case] = []
    for done, number in enumerate(safe, start=1):
        concrete = space.concrete(number).without_ads
        found = list(drives(number, concrete))
        for outcome in found:
            known.add(outcome.case.key)
            if not store.holds(outcome.case):
                store.add(outcome)
        if fills and len(found) < settings.least:
            fill += plan.synthetic(number, concrete, settings.least - len(found))
        work.check()
        progress(f"{name}: {'recorded ' * recorded}drivers", done, len(safe))
    if fill:
        work.do(
            [_Stage(f"{name}: drivers where too few are recorded", name, "human", fill, len(fill))]
        )
    known |= {case.key for case in fill}
    store.remove((case for case, _, _ in store.names("human", name) if case not in known))


def _recorded_drives(
    plan: Planner, space: Space
) -> Callable[[int, ConcreteScenario], Iterator[Outcome]]:
    """Source of the drives of people who were recorded in events like a concrete scenario."""
    # pandas, which synthetic drivers do not need
    from sumo_eval.drivers.recorded.reference import (
        open_people,
        reference,
    )

    settings = plan.settings.drivers
    people = open_people(settings, plan.source)

    def drives(number: int, concrete: ConcreteScenario) -> Iterator[Outcome]:
        found = reference(concrete, people, settings, space.logical.recorded)
        for index, (drive, who) in enumerate(zip(found.drives, found.names, strict=True)):
            case = plan.human(number, concrete, f"recorded_{index:02d}")
            yield Outcome(case, "ok", Recording(drive, {}, None, "recorded"), log=who)

    return drives


def find_stale(store: Store, source: Path) -> tuple[str, ...]:
    """Find the recorded cases whose ADS has read files that are not there as they were; a sentence
    for each ADS.
    """
    files = changed(store.reads(), source)
    stale = [(case, ads, files[name]) for case, ads, name in store.read_by() if name in files]
    store.stale = frozenset(case for case, _, _ in stale)
    notes = []
    for ads in sorted({ads for _, ads, _ in stale}):
        names = sorted({name for _, of, its in stale if of == ads for name in its})
        cases = sum(of == ads for _, of, _ in stale)
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        notes.append(
            f"{cases} recorded case{'s' * (cases > 1)} of ADS `{ads}` cannot be reused: "
            f"{clean(names[0])}{more} "
            "changed since its processes read it. They are rerun."
        )
    return tuple(notes)


def refuse_to_lose_cases(
    store: Store, spaces: Sequence[Space], settings: EvaluationSettings, run: Path
) -> None:
    """A resumed run keeps what it has: refuses an evaluation that leaves out cases of ADSs
    that are recorded.
    """
    counts = {space.logical.name: len(space.points) for space in spaces}
    drivers = {ads.name for ads in settings.ads}
    for scenario in sorted({row[0] for row in store.counts()}):
        for case, point, driver in store.names("ads", scenario):
            if driver not in drivers or point >= counts.get(scenario, 0):
                raise InputError(
                    f"Run {run} holds cases that this evaluation does not choose, e.g. {case}: "
                    "a run keeps its cases. Give the changed evaluation a folder of its own."
                )


class _Work:
    """Runs cases and records their outcomes."""

    def __init__(self, store: Store, setup: Setup, progress: Progress, stopping: Stopping) -> None:
        self._store, self._setup, self._progress, self._stopping = store, setup, progress, stopping
        self._versions = OneVersion()
        self._latest: dict[str, str] = {}  # names of what the processes of each ADS have read
        LINKS.update(store.reads())
        reused = {(ads, name) for case, ads, name in store.read_by() if case not in store.stale}
        for ads, name in sorted(reused):
            self._take_in(ads, name)

    def do(self, stages: Sequence[_Stage]) -> None:
        """Bring stages to their end, all at a time, or raise StoppedError."""
        of = {(stage.scenario, stage.role): stage.name for stage in stages}
        done, failed = dict.fromkeys(of.values(), 0), dict.fromkeys(of.values(), 0)
        totals = {stage.name: stage.total for stage in stages}

        def missing() -> Iterator[Case]:
            for stage in stages:
                for case in stage.cases:
                    if self._store.holds(case):
                        done[stage.name] += 1
                    else:
                        yield case

        with closing(run_packs(missing(), self._setup, self._stopping)) as packs:
            for outcomes in packs:
                self._store.add(*map(self._with_reads, outcomes))
                touched = []
                for outcome in outcomes:
                    name = of[outcome.case.concrete.scenario, outcome.case.role]
                    touched.append(name)
                    done[name] += 1
                    failed[name] += outcome.status not in EVALUATED
                for name in dict.fromkeys(touched):
                    self._progress(name, done[name], totals[name], failed[name])
        for name, total in totals.items():
            if done[name] < total:
                self.check()
                raise RuntimeError(
                    f"{name}: {total - done[name]} of {total} cases got lost on their way"
                )
            self._progress(name, done[name], total, failed[name])

    def _with_reads(self, outcome: Outcome) -> Outcome:
        """The outcome with what its process had read; of one that was lost before it told, what
        others had.
        """
        case = outcome.case
        if outcome.reads is not None:
            self._take_in(case.driver, outcome.reads)
        elif home(case, self._setup) != OURS:
            return replace(outcome, reads=self._latest.get(case.driver, NOT_KNOWN))
        return outcome

    def _take_in(self, ads: str, reads: str) -> None:
        self._versions.check(ads, reads)
        self._latest[ads] = reads

    def check(self) -> None:
        """Raise StoppedError when the work shall stop."""
        if self._stopping():
            raise StoppedError("stopped")


def _own_drives(plan: Planner, number: int, concrete: ConcreteScenario) -> Iterator[Outcome]:
    """The trajectories that the user's function has for a concrete scenario, as cases beside the
    simulated ones.
    """
    locator = plan.settings.drivers.source
    reference: Callable[[ConcreteScenario], Iterable[object]] = load_object(
        locator, plan.source, "Human reference"
    )
    try:
        trajectories = list(reference(concrete))
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(
            f"The human reference `{locator}` failed for {concrete.scenario} at {concrete.label}: "
            f"{said(error)}."
        ) from error
    for index, trajectory in enumerate(trajectories):
        if not isinstance(trajectory, Trajectory):
            raise InputError(
                f"The human reference `{locator}` must return Trajectory objects, got "
                f"{type(trajectory).__name__} "
                f"for {concrete.scenario} at {concrete.label}."
            )
        case = plan.human(number, concrete, f"driver_{index:02d}")
        yield Outcome(case, "ok", Recording(trajectory, {}, None, "recorded"))
