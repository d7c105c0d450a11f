"""Recording of a run: ADSs and references drive every concrete scenario, human drivers every safe
one. `record.facts` records a whole run with it, `record.estimate` times parts of one.

Users: `cli/tools.py`, `nightly/repeats.py`, `record/`, `extras/studies/trials.py`.
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, groupby, product
from pathlib import Path
from typing import Any

from sumo_eval.cases import EVALUATED
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.cosim.doors.entry import steps_between
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.errors import InputError, StoppedError, check_known, users_code
from sumo_eval.frozen import frozen
from sumo_eval.input_file import hash_of, sha256
from sumo_eval.record.cases import Block, Case, Outcome, Role, Setup
from sumo_eval.record.claims import NO_USER_CODE, affinity
from sumo_eval.record.engines import identify, run_batches
from sumo_eval.record.identity import (
    files_identity,
    harness_identity,
    is_over_arrays,
    people_identity,
    period_of,
    with_fingerprint,
)
from sumo_eval.record.kept import packed
from sumo_eval.record.progress import Progress, Stopping
from sumo_eval.record.reads import OneVersion, changed
from sumo_eval.record.store import LEFT_OUT, RECORDED, Store
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.resolved import Resolved
from sumo_eval.settings import EvaluationSettings
from sumo_eval.settings.locators import load_object
from sumo_eval.text import clean
from sumo_eval.trajectory import BoolArray, FloatArray, Recording, Trajectory

REFERENCES: Mapping[Role, str] = {
    "ideal": "ideal vehicle", "no_reaction": "no reaction", "task_reference": "reference car",
}  # fmt: skip
"""References of the scores by role: the ideal vehicle for Ug, no reaction for U0, the reference car
for the times of T."""


@frozen(eq=False)
class Space:
    """The points of one logical scenario.

    points: (n, k).
    hazardous: whether each point is hazardous, (n,).
    numbers: indices of the points to drive.
    weights: p_i of each point, (n,), up to a factor.
    exposure: source of the weights, as the run keeps it.
    """

    logical: LogicalScenario
    points: FloatArray
    hazardous: BoolArray
    numbers: Sequence[int]
    weights: FloatArray
    exposure: Mapping[str, Any]

    def concrete(self, number: int) -> ConcreteScenario:
        """The concrete scenario at a point; made on request, because a space can have a million
        points.
        """
        (concrete,) = self.logical.concretes(self.points[number])
        return replace(concrete, exposure=float(self.weights[number]))

    @property
    def safe(self) -> list[int]:
        """Indices of the points to drive that are in the safe zone."""
        return [number for number in self.numbers if not self.hazardous[number]]


@frozen(eq=False)
class Planner:
    """Makes the cases of an evaluation, each with a fingerprint of all that its facts depend on.

    harness: identity of this package and of its simulator.
    identities: of ADSs and drivers, by locator.
    over_arrays: locators of the policies that drive cases in blocks.
    notes: sentences on recorded drivers.
    """

    run: Resolved
    harness: str
    identities: Mapping[str, str]
    over_arrays: frozenset[str]
    notes: tuple[str, ...]

    @property
    def setup(self) -> Setup:
        """Values that all cases share."""
        settings = self.run.settings
        files = {ads.locator: tuple(ads.files) for ads in settings.ads if ads.files}
        return Setup(settings.simulation, settings.run, self.run.source, files, no_return=True)

    def ads(self, space: Space) -> Iterator[Case]:
        """Cases of every ADS at every point; policies over arrays drive blocks of cases together.

        A block is `size` consecutive points of the space, whether or not they must be driven: the
        composition of a block must not depend on the choice of points.
        """
        settings = self.run.settings
        size = min(settings.run.cases_per_pack, settings.run.cases_per_child)
        over_arrays = self.over_arrays if size > 1 else ()  # a block of one is a case alone
        for index, numbers in groupby(space.numbers, key=lambda number: number // size):
            wanted = list(numbers)
            first = index * size
            last = min(first + size, len(space.points))
            members = range(first, last) if over_arrays else wanted
            concretes = {number: space.concrete(number) for number in members}
            block = Block.of(first, tuple(concretes.values())) if over_arrays else None
            for ads, number in product(settings.ads, wanted):
                case = Case(
                    number,
                    concretes[number],
                    "ads",
                    ads.name,
                    ads.locator,
                    seed=settings.seed,
                    block=block if ads.locator in over_arrays else None,
                )
                if not settings.run.only or case.key in settings.run.only:
                    yield self._finished(case)

    def reference(self, space: Space, role: Role) -> Iterator[Case]:
        """Cases of one of the references at every point."""
        settings = self.run.settings
        controller = {"ideal": "ideal_braking", "no_reaction": "no_reaction"}.get(
            role, settings.method.task.task_reference
        )
        for number in space.numbers:
            case = Case(number, space.concrete(number).without_ads, role, role, controller)
            # identity "": the fingerprint of a reference does not depend on whether the same
            # baseline is also an ADS under test, which has an identity
            yield with_fingerprint(case, settings.simulation, "", self.harness)

    def humans(self, space: Space) -> Iterator[Case]:
        """Cases of every synthetic driver at every safe point, if they can drive the scenario."""
        for number in space.safe if space.logical.has_drivers else ():
            concrete = space.concrete(number).without_ads
            yield from self.synthetic(number, concrete, self.run.settings.drivers.count)

    def synthetic(self, number: int, concrete: ConcreteScenario, count: int) -> Iterator[Case]:
        """Cases of the first `count` synthetic drivers at one point."""
        settings = self.run.settings
        for index in range(count):
            case = Case(
                number,
                concrete,
                "human",
                f"driver_{index:02d}",
                "synthetic",
                driver_index=index,
                driver_count=count,
                seed=settings.seed,
                population=settings.drivers.population,
            )
            yield self._finished(case)

    def human(self, number: int, concrete: ConcreteScenario, name: str) -> Case:
        """Case of a human driver that is not simulated: a recorded one, or one of the user's own
        reference.
        """
        return self._finished(
            Case(number, concrete, "human", name, self.run.settings.drivers.source)
        )

    def _finished(self, case: Case) -> Case:
        identity = self.identities.get(case.controller, "")
        return with_fingerprint(case, self.run.settings.simulation, identity, self.harness)


def planner(run: Resolved) -> Planner:
    """The planner of an evaluation, with the identities of its ADSs and its human reference.

    Raises InputError if one of them cannot be loaded.
    """
    settings, source = run.settings, run.source
    named = [("ADS", ads.locator) for ads in settings.ads]
    if settings.drivers.source not in ("synthetic", RECORDED):
        named.append(("Human reference", settings.drivers.source))
    check_known(
        "baseline for `method.task.task_reference`", SHIPPED, settings.method.task.task_reference
    )
    harness = harness_identity()
    plant = settings.simulation.plant
    if plant is not None:
        FmuPlant(plant, source)
        harness += hash_of(source / plant.file, "FMU")
    setup = Setup(settings.simulation, settings.run, source)
    identities = identify(list(dict.fromkeys(named)), setup)
    over_arrays = frozenset(
        ads.locator for ads in settings.ads if is_over_arrays(identities[ads.locator])
    )
    for ads in settings.ads:
        steps_between(  # raises an error for a period that is not whole steps
            ads.period or period_of(identities[ads.locator]),
            settings.simulation.step,
            f"ADS `{ads.name}`",
        )
        identities[ads.locator] += files_identity(ads, source)
    notes: tuple[str, ...] = ()
    if settings.drivers.source == RECORDED:
        # imported here: it needs pandas, which synthetic drivers do not
        from sumo_eval.drivers.recorded.reference import notes_of, open_people

        # a file that cannot be read is reported now, not after hours of simulation
        people = open_people(settings.drivers, source)
        notes = notes_of(people, {name: it.names for name, it in run.scenarios.items()})
        identities[RECORDED] = people_identity(settings.drivers, source)
    return Planner(run, harness, identities, over_arrays, notes)


def record(
    spaces: Sequence[Space], plan: Planner, store: Store, progress: Progress, stopping: Stopping
) -> None:
    """Simulate the cases of an evaluation that are not recorded yet.

    Independent cases of all logical scenarios are one piece of work, so that no process waits for
    the last case of a scenario.

    Raises StoppedError if `stopping` returns true before all cases are recorded; finished cases
    stay recorded.
    """
    versions = OneVersion(store.files_read())
    drivers = plan.run.settings.drivers
    work = Recorder(store, plan.setup, progress, stopping, versions)
    by_space = [stages(space, plan) for space in spaces]
    # the ADSs in all scenarios first, then one role after another
    work.do(list(chain.from_iterable(zip(*by_space, strict=True))))
    for space in spaces:
        if drivers.source != "synthetic":
            _record_people(space, plan, work)
            continue
        # a run that is resumed with other settings may hold drives that these do not ask for
        names = {f"driver_{index:02d}" for index in range(drivers.count)}
        safe = set(space.safe) if space.logical.has_drivers else set()
        cases = store.names("human", space.logical.name)
        store.remove(case for case, point, name in cases if point not in safe or name not in names)


@frozen
class RoleCases:
    """Cases of one role in one logical scenario, with the name and total of their progress."""

    name: str
    scenario: str
    role: Role
    cases: Iterable[Case]
    total: int


def stages(space: Space, plan: Planner) -> Iterator[RoleCases]:
    """Stages of one logical scenario: ADSs, references, synthetic drivers."""
    settings = plan.run.settings
    points = len(space.numbers)
    name = space.logical.name
    # with `only`, the cases are made just to be counted: they are few
    total = sum(1 for _ in plan.ads(space)) if settings.run.only else points * len(settings.ads)
    yield RoleCases(f"{name}: ADSs", name, "ads", plan.ads(space), total)
    for role, words in REFERENCES.items():
        cases = plan.reference(space, role)
        yield RoleCases(f"{name}: {words}", name, role, cases, points)
    if settings.drivers.source == "synthetic":
        total = len(space.safe) * settings.drivers.count if space.logical.has_drivers else 0
        yield RoleCases(f"{name}: drivers", name, "human", plan.humans(space), total)


@dataclass
class Recorder:
    """Runs cases and records their outcomes."""

    store: Store
    setup: Setup
    progress: Progress
    stopping: Stopping
    versions: OneVersion

    def do(self, stages: Sequence[RoleCases]) -> None:
        """Drive the missing cases of all stages in one go, or raise StoppedError."""
        names = {(stage.scenario, stage.role): stage.name for stage in stages}
        totals = {stage.name: stage.total for stage in stages}
        done, failed = Counter[str](), Counter[str]()

        def missing() -> Iterator[Case]:
            for stage in stages:
                for case in stage.cases:
                    if self.store.holds(case):
                        done[stage.name] += 1
                    else:
                        yield case

        def show(name: str) -> None:
            self.progress(name, done[name], totals[name], failed[name])

        with closing(run_batches(missing(), self.setup, self.stopping)) as batches:
            for outcomes in batches:
                self._note_files(outcomes)
                ended = Counter[str]()
                for outcome in outcomes:
                    name = names[outcome.case.concrete.scenario, outcome.case.role]
                    ended[name] += not self._replaces(outcome)
                    failed[name] += outcome.status not in EVALUATED
                self.store.add(*outcomes)
                done.update(ended)
                for name in ended:
                    show(name)
        for name, total in totals.items():
            if done[name] < total:
                self.check()
                raise RuntimeError(f"{name}: {total - done[name]} of {total} cases were lost")
            show(name)

    def _replaces(self, outcome: Outcome) -> bool:
        """Whether an outcome replaces a recorded one, which is then removed: its case was driven in
        a batch before its ADS was found to keep state.
        """
        case = outcome.case
        keeps_state = outcome.alone is not None and outcome.alone.why == "keeps_state"
        if not keeps_state or not self.store.holds(case):
            return False
        self.store.remove([case.key])
        return True

    def _note_files(self, outcomes: Sequence[Outcome]) -> None:
        """Record which files the processes of users' ADSs have read."""
        for outcome in outcomes:
            case = outcome.case
            # `reads` is None if the process of a user's ADS was lost, which is noted too, and for
            # cases without a user's code, which have nothing to note
            if outcome.reads is not None or affinity(case, self.setup) != NO_USER_CODE:
                self.store.note_files(
                    self.versions.add(case.driver, case.controller, outcome.reads)
                )

    def check(self) -> None:
        """Raise StoppedError if the run shall stop."""
        if self.stopping():
            raise StoppedError("stopped")


def _record_people(space: Space, plan: Planner, work: Recorder) -> None:
    """Record the drives of recorded drivers, or of the user's own reference, at every safe point.

    Where recorded drivers are too few, synthetic ones are added if `too_thin` is `fill`.
    """
    name = space.logical.name
    settings = plan.run.settings.drivers
    safe = space.safe
    recorded = settings.source == RECORDED
    may_add = recorded and settings.too_thin == "fill" and space.logical.has_drivers
    # of every drive that is left out, at all points: the share of the road that it covers; inf: it
    # leaves the road (`drivers.recorded.reference.Reference.left_out`)
    left_out: list[float] = []
    drives = _recorded_drives(plan, space, left_out) if recorded else partial(_own_drives, plan)
    words = "recorded drivers" if recorded else "drivers"
    keys: set[str] = set()
    added: list[Case] = []
    for done, number in enumerate(safe, start=1):
        concrete = space.concrete(number).without_ads
        outcomes = list(drives(number, concrete))
        keys.update(outcome.case.key for outcome in outcomes)
        work.store.add(*(outcome for outcome in outcomes if not work.store.holds(outcome.case)))
        if may_add and len(outcomes) < settings.least:
            added += plan.synthetic(number, concrete, settings.least - len(outcomes))
        work.check()
        work.progress(f"{name}: {words}", done, len(safe))
    short = [share for share in left_out if share < math.inf]
    # number of drives that are too short, the largest share that one of these covers, number of
    # drives off the road
    counts = len(short), max(short, default=0.0), len(left_out) - len(short)
    work.store.note(f"{LEFT_OUT} {name} {plan.run.shard}", json.dumps(counts))
    if added:
        title = f"{name}: drivers where too few are recorded"
        work.do([RoleCases(title, name, "human", added, len(added))])
    keys.update(case.key for case in added)
    # drives that the run recorded before it was resumed with other settings or recordings
    work.store.remove(case for case, _, _ in work.store.names("human", name) if case not in keys)


def _recorded_drives(
    plan: Planner, space: Space, left_out: list[float]
) -> Callable[[int, ConcreteScenario], Iterator[Outcome]]:
    """Function of a point that gives the drives recorded in events like its concrete scenario."""
    # imported here: it needs pandas, which synthetic drivers do not
    from sumo_eval.drivers.recorded.reference import open_people, reference

    settings = plan.run.settings.drivers
    people = open_people(settings, plan.run.source)

    def drives(number: int, concrete: ConcreteScenario) -> Iterator[Outcome]:
        events = reference(concrete, people, settings, space.logical.recorded)
        left_out.extend(events.left_out)
        for index, (drive, name) in enumerate(zip(events.drives, events.names, strict=True)):
            case = plan.human(number, concrete, f"recorded_{index:02d}")
            # `log`: where the drive comes from
            yield Outcome(case, "ok", Recording(drive, {}, None, "recorded"), log=name)

    return drives


def find_stale(store: Store, source: Path) -> tuple[str, ...]:
    """Mark the ADSs as stale whose recorded cases depend on files that have changed since; return
    a note on each.
    """
    files = changed(store.files_read(), source)
    store.stale = frozenset(files)
    notes = []
    for locator, (first, *more) in sorted(files.items()):
        cases = Counter(ads for _, ads in store.driven_by(locator))
        others = f" and {len(more)} more" if more else ""
        notes += [
            f"{number} recorded case{'s' if number > 1 else ''} of ADS `{ads}` cannot be reused: "
            f"{clean(first)}{others} changed since its processes "
            "read it. They are rerun."
            for ads, number in sorted(cases.items())
        ]
    return tuple(notes)


def refuse_to_lose_cases(
    store: Store, spaces: Sequence[Space], settings: EvaluationSettings, run: Path
) -> None:
    """Refuse to resume a run with an evaluation that lacks recorded cases of ADSs: a run keeps its
    cases.
    """
    numbers = {space.logical.name: space.numbers for space in spaces}
    drivers = {ads.name for ads in settings.ads}
    only = settings.run.only
    for scenario in sorted({count.scenario for count in store.counts()}):
        for case, point, driver in store.names("ads", scenario):
            if (
                driver not in drivers
                or point not in numbers.get(scenario, ())
                or (only and case not in only)
            ):
                raise InputError(
                    f"Run {run} holds cases that this evaluation does not choose, e.g. {case}: "
                    "a run keeps its cases. Give the changed evaluation a folder of its own."
                )


def refuse_to_compare_with_discarded(
    store: Store, spaces: Sequence[Space], plan: Planner, run: Path
) -> None:
    """Refuse further cases of a scenario in which trajectories of drivers were discarded: scoring
    needs these, so the run could not be scored any more.
    """
    discarded = store.without_drivers()
    for space in spaces:
        for stage in stages(space, plan) if space.logical.name in discarded else ():
            # references are not compared with drivers
            for case in stage.cases if stage.role in ("ads", "human") else ():
                if not store.holds(case):
                    raise InputError(
                        f"Run {run} cannot take another drive of case {case.key}: trajectories of "
                        "drivers, which its score needs, were discarded after scoring "
                        "(`[run] keep`). Give the changed evaluation a folder of its own."
                    )


def _own_drives(plan: Planner, number: int, concrete: ConcreteScenario) -> Iterator[Outcome]:
    """Outcomes with the trajectories that the user's function returns for a concrete scenario."""
    locator = plan.run.settings.drivers.source
    reference = load_object(locator, plan.run.source, "Human reference")
    place = f"for {concrete.scenario} at {concrete.label}"
    with users_code(f"The human reference `{locator}` failed {place}"):
        trajectories = list(reference(concrete))
    for index, trajectory in enumerate(trajectories):
        if not isinstance(trajectory, Trajectory):
            raise InputError(
                f"The human reference `{locator}` must return Trajectory objects, got "
                f"{type(trajectory).__name__} {place}."
            )
        case = plan.human(number, concrete, f"driver_{index:02d}")
        # the files that the function has read are unknown: the trajectory stands for them
        case = replace(case, fingerprint=sha256(case.fingerprint.encode() + packed(trajectory)))
        yield Outcome(case, "ok", Recording(trajectory, {}, None, "recorded"))
