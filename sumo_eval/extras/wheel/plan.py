"""Settings of a study, from STUDY.toml, and its plan: cases, their order, replays.

`study` carries the plan out, `outcome` writes the results.

Users: `extras/wheel/command.py`, `extras/wheel/outcome.py`, `extras/wheel/study.py`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from annotated_types import Le

from sumo_eval.errors import InputError, check_known, doubled, must_be
from sumo_eval.extras.wheel.quality import QualitySettings
from sumo_eval.frozen import frozen, required
from sumo_eval.groups import grouped
from sumo_eval.record.case_rows import Fact
from sumo_eval.record.run_folder import resolved_run
from sumo_eval.record.store import open_store
from sumo_eval.report.export_case import absolute
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings.checked import (
    Checked,
    FilledText,
    Natural,
    PositiveFloat,
    PositiveInt,
    setting,
)
from sumo_eval.settings.config import read_checked
from sumo_eval.settings.random_streams import random_stream

LOW, HIGH = 1, 10  # ends of a scale


@frozen
class PracticeSettings(Checked):
    """Practice on a road without traffic, until enough trials are passed."""

    speed: PositiveFloat = setting(20.0, "speed to keep", "m/s")
    seconds: Annotated[PositiveFloat, Le(120.0)] = setting(15.0, "length of a trial", "s")
    offset: PositiveFloat = setting(0.6, "greatest distance from the lane's centre", "m")
    within: PositiveFloat = setting(3.0, "greatest difference from the speed to keep", "m/s")
    share: Annotated[PositiveFloat, Le(1.0)] = setting(
        0.8, "share of the trial within `offset` and `within`"
    )
    passes: Natural = setting(1, "trials that must be passed; 0: no practice")
    most: PositiveInt = setting(6, "most trials; a participant without enough passes goes home")

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.passes > self.most:
            raise must_be("`passes`", "`practice`", f"at most `most` ({self.most})", self.passes)


@frozen
class QuestionSettings(Checked):
    """A question on a scale of 1 to 10."""

    key: FilledText = required("its `question` in answers.csv")
    text: FilledText = required("what is asked")
    after: Literal["drive", "replay"] = setting(
        "drive", "asked after one's own drive, or after a replay"
    )
    least: str = setting("", "what 1 means")
    most: str = setting("", "what 10 means")


SCORE = QuestionSettings(
    "score", "How well did the blue car drive?", "replay", "very badly", "very well"
)
"""The question of the paper's Fig. 11, asked after every replay."""


@frozen
class StudySettings(Checked):
    """A study: participants drive concrete scenarios of a run and rate how its ADSs drive there."""

    name: FilledText = required("name of the study, shown to the team only")
    run: FilledText = required("folder of the run, relative to this file")
    consent: FilledText = required("text that a participant agrees to, by the team")
    seed: Natural = setting(1, "source of randomness: which replays are shown, and their order")
    out: str = setting(
        "", "folder of the study, relative to this file; empty: next to it, under its name"
    )
    cases: tuple[str, ...] = setting(
        (), "what is driven: SCENARIO-POINT of the run; empty: `count` of its safe points"
    )
    count: Annotated[PositiveInt, Le(100)] = setting(
        8, "number of safe points driven if `cases` is empty"
    )
    ads: tuple[str, ...] = setting((), "whose drives are rated; empty: all of the run")
    replays: Annotated[Natural, Le(20)] = setting(1, "drives to rate per ADS and logical scenario")
    rate: Literal[20, 50, 100] = setting(50, "steps a second")
    break_after: PositiveInt = setting(8, "drives after which a break is offered")
    practice: PracticeSettings = PracticeSettings()
    question: tuple[QuestionSettings, ...] = setting((), "further questions")
    quality: QualitySettings = QualitySettings()

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        questions = SCORE, *self.question
        for after in ("drive", "replay"):
            # The answers of a sheet stand under these keys; `button`: how it was left.
            keys = "button", *(it.key for it in questions if it.after == after)
            if double := doubled(keys):
                owner = f"a sheet after a {after}"
                raise must_be("`question.key`", owner, f"distinct ({', '.join(keys)})", double[0])


class StudyCase(NamedTuple):
    """A concrete scenario of a study.

    key: `SCENARIO-POINT`.
    use: locator of the logical scenario.
    ads: name of an ADS -> fact of its drive in this case.
    """

    key: str
    use: str
    concrete: ConcreteScenario
    ads: dict[str, Fact]


class StudyPlan(NamedTuple):
    """A study that can begin.

    run: folder of the run whose drives are replayed.
    folder: of the study.
    cases: in the order of `settings.cases`; where it is empty, by scenario's name and point.
    ads: names of the ADSs whose drives are rated.
    """

    settings: StudySettings
    run: Path
    folder: Path
    cases: tuple[StudyCase, ...]
    ads: tuple[str, ...]

    def order(self, number: int) -> list[StudyCase]:
        """The cases in the order in which participant `number` (0, 1, ...) drives them."""
        rows = balanced_orders(len(self.cases))
        return [self.cases[index] for index in rows[number % len(rows)]]

    def ratings(self, code: str) -> list[tuple[StudyCase, str]]:
        """The replays that a participant rates: case and ADS, in an order drawn for this
        participant.

        code: of the participant.
        """
        draw = random_stream(self.settings.seed, "replays", code)
        replays = []
        for scenario in dict.fromkeys(case.concrete.scenario for case in self.cases):
            for ads in self.ads:
                driven = [case for case in self.cases
                    if case.concrete.scenario == scenario and ads in case.ads]  # fmt: skip
                chosen = draw.permutation(len(driven))[: self.settings.replays]
                # sorted: the order of all replays is drawn below
                replays += [(driven[index], ads) for index in sorted(chosen)]
        return [replays[index] for index in draw.permutation(len(replays))]


def balanced_orders(n: int) -> list[list[int]]:
    """Orders of n items, each as the indices of the items.

    Over all orders, each item stands equally often in each place, and directly follows every other
    item equally often.

    Source: Williams, Aust. J. Sci. Res. A 2, 149 (1949): n orders for an even n, 2 n for an odd n.
    """
    # 0, 1, -1, 2, -2, ...; each row adds a number to this sequence, modulo n
    first = [step // 2 + 1 if step % 2 else -(step // 2) for step in range(n)]
    rows = [[(index + shift) % n for index in first] for shift in range(n)]
    return rows if n % 2 == 0 else rows + [row[::-1] for row in rows]


def read_study(path: Path) -> StudyPlan:
    """The plan of a study file.

    Raises InputError for the first mistake.
    """
    settings = read_checked(path, StudySettings, "study file")
    run = (path.parent / settings.run).absolute()
    with open_store(run) as store:
        # only safe points have drives of human drivers
        safe_keys = {_key(fact) for fact in store.facts("human")}
        driven = [*store.facts("ads")]
        # A replay needs trajectories. Drives that failed, or whose trajectories were discarded,
        # have none.
        replayable = [fact for fact in driven if store.trajectories(fact.case)]
    names = tuple(dict.fromkeys(fact.driver for fact in replayable))  # of the ADSs
    drives = grouped((_key(fact), fact) for fact in replayable)
    keys = settings.cases or _spread([key for key in drives if key in safe_keys], settings.count)
    check_known("ADS of the run", {fact.driver for fact in driven}, *settings.ads)
    check_known("case of the run", [_key(fact) for fact in driven], *settings.cases)
    unseen = [*(name for name in settings.ads if name not in names),
        *(key for key in settings.cases if key not in drives)]  # fmt: skip
    if unseen or not replayable:
        raise InputError(
            f"{', '.join(unseen) or 'ADSs'} of the run {run} must have trajectories to replay, got "
            "none: the drives failed, or `[run] keep` discarded them; record the run with "
            '`keep = "all"`.'
        )
    for key, listed in (("`cases`", keys), ("`ads`", settings.ads)):
        if len(set(listed)) < len(listed):
            raise must_be(key, f"study `{settings.name}`", "distinct", ", ".join(listed))
    if not keys:
        raise InputError(
            f"The run {run} must have a safe point with drivers for a study, got none."
        )
    cases = _cases_of(run, {key: drives[key] for key in keys})
    return StudyPlan(settings, run, _folder_of(settings, path), cases, settings.ads or names)


def _folder_of(settings: StudySettings, path: Path) -> Path:
    """Folder of the study of a file, `path`."""
    if not settings.out and {"/", ".."} & {*Path(settings.name).parts}:
        owner = "a study without `out`"
        raise must_be("`name`", owner, "the name of a folder next to the file", settings.name)
    return (path.parent / (settings.out or settings.name.replace(" ", "_"))).absolute()


def _spread(keys: Sequence[str], most: int) -> list[str]:
    """At most `most` of the keys, spread evenly over the list, and so over the scenarios."""
    count = min(most, len(keys))
    return [keys[index * len(keys) // count] for index in range(count)]


def _cases_of(run: Path, drives: Mapping[str, Sequence[Fact]]) -> tuple[StudyCase, ...]:
    """Cases of a study; drives: key of a case -> facts of all ADSs' drives in it, at least one."""
    resolved = resolved_run(run)
    uses = {
        # a tape names its scenario, and is not in the folder where the run's paths start
        logical.name: (absolute(entry.use, resolved.source, "use"), logical)
        for entry, logical in resolved.entries
    }
    cases = []
    for key, facts in drives.items():
        fact = facts[0]  # all facts of a case have the same point
        use, logical = uses[fact.scenario]
        by_ads = {drive.driver: drive for drive in facts}
        cases.append(StudyCase(key, use, logical.concrete(**fact.values), by_ads))
    return tuple(cases)


def _key(fact: Fact) -> str:
    """Key of the study's case in which a drive took place."""
    return f"{fact.scenario}-{fact.point:04d}"
