"""What a study comes to: the folder that `[drivers] cases` takes, the ratings that `humans opinion`
takes, and for every drive that is left out the rule that left it out.

Everything is made anew from journals and tapes. A tape is driven again for its trajectory; one that
does not come to the bytes that it was recorded with is left out, and said.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

from sumo_eval.cosim.doors.entry import made_absolute
from sumo_eval.errors import InputError, said
from sumo_eval.extras.wheel.plan import Plan, StudyCase
from sumo_eval.extras.wheel.quality import Quality
from sumo_eval.extras.wheel.study import Participant, participants
from sumo_eval.extras.wheel.tape import digest, drive_again, read_tape
from sumo_eval.record.run_folder import read_manifest, read_settings
from sumo_eval.report.page import write_csv
from sumo_eval.report.people import STUDY, drawn_words
from sumo_eval.settings import SamplingSettings
from sumo_eval.settings.config import to_toml
from sumo_eval.trajectory import Trajectory

DRIVES: Final = "drives"  # the folder for `[drivers] cases`
NAMED: Final = "cases.csv"
# of the people whose drives count: a point that fewer drove is too thin a reference
MOST_OF_THEM: Final = 2.0 / 3.0
_AGAIN: Final = ("ended, and driven again", "the drive broke off, and was driven again")
COLUMNS: Final = ("driver", "t", "x", "y", "heading", "speed", "acceleration", "steering")


@dataclass(frozen=True, slots=True)
class Left:
    """A drive that does not count.

    why: a sentence for each rule that it broke.
    """

    participant: str
    case: str
    tape: str
    why: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """people: who took part;
    with_drives: of these, whose drives count.
    drives: how many count;
    drawn: of these, how many with the road drawn in which way.
    left: which do not count.
    """

    people: int
    with_drives: int
    drives: int
    drawn: dict[str, int]
    left: tuple[Left, ...]
    ratings: int
    files: tuple[Path, ...]

    def sentences(self) -> list[str]:
        """In words."""
        said_ = [
            f"{self.people} took part; {self.drives} drives by {self.with_drives} of them count, "
            f"{len(self.left)} "
            f"{'is' if len(self.left) == 1 else 'are'} left out; {self.ratings} ratings."
        ]
        if self.drawn:
            said_.append(f"  the road as it was drawn: {drawn_words(self.drawn)}.")
        said_ += [f"  left out: {it.participant}, {it.case}: {it.why}." for it in self.left]
        return said_


def collect(plan: Plan) -> Outcome:
    """Write what the study comes to into its folder."""
    people = participants(plan)
    place = plan.folder / DRIVES
    rows: list[dict[str, Any]] = []
    left: list[Left] = []
    drawn: Counter[str] = Counter()
    for person in people:
        for case in plan.cases:
            kept = _drive(plan, person, case)
            if kept is None:
                continue
            if isinstance(kept, Left):
                left.append(kept)
                continue
            file = f"{person.code}/{case.key}.csv"
            write_csv(place / file, COLUMNS, _samples(person.code, kept))
            drawn.update(filter(None, [person.done[f"drive:{case.key}"]["quality"].get("drawn")]))
            rows.append({"scenario": case.concrete.scenario, "file": file, **case.concrete.values})
        left += _broken_off(person)
    names = list(dict.fromkeys(name for case in plan.cases for name in case.concrete.values))
    counted = {(row["scenario"], row["file"]) for row in rows}
    for stale in place.glob("*/*.csv"):
        if not any(file == stale.relative_to(place).as_posix() for _, file in counted):
            stale.unlink()
    head = ("scenario", "file", *names)
    write_csv(place / NAMED, head, [[row.get(it, "") for it in head] for row in rows])
    each = [entry | {"rater": person.code} for person in people for entry in person.done.values()
            if entry["step"].startswith("rate:") and "score" in entry["answers"]]  # fmt: skip
    ratings = _ratings(each)
    write_csv(plan.folder / "ratings.csv", ("rater", "ads", "scenario", "score"), ratings)
    write_csv(plan.folder / "answers.csv", ("rater", "step", "question", "answer"), [
        [person.code, entry["step"], key, value]
        for person in people for entry in person.done.values() for key,
        value in entry.get("answers", {}).items()
    ])  # fmt: skip
    write_csv(plan.folder / "left_out.csv", ("participant", "case", "tape", "why"),
           [[it.participant, it.case, it.tape, it.why] for it in left])  # fmt: skip
    names_of = [it.name for it in fields(Quality)]
    out = {(it.participant, it.case): it.why for it in left if it.why not in _AGAIN}
    write_csv(plan.folder / "quality.csv", ("participant", "case", *names_of, "left_out"), [
        [person.code, key, *(entry["quality"].get(name) for name in names_of),
            out.get((person.code, key), "")]
        for person in people for step, entry in person.done.items()
        if (key := step.removeprefix("drive:")) != step
    ])  # fmt: skip
    drivers = {row["file"].split("/")[0] for row in rows}
    found = Outcome(len(people), len(drivers), len(rows), dict(drawn), tuple(left), len(ratings), (
        place, plan.folder / "ratings.csv", plan.folder / "left_out.csv",
        plan.folder / "evaluation.toml"))  # fmt: skip
    summary = {
        "study": plan.settings.name,
        **{name: getattr(found, name) for name in ("people", "with_drives", "drives", "ratings",
            "drawn")},
        "left_out": [asdict(it) for it in left],
        "quality": asdict(plan.settings.quality),
    }  # fmt: skip
    (place / STUDY).write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    (plan.folder / "evaluation.toml").write_text(
        evaluation_of(plan, found.with_drives), encoding="utf-8"
    )
    return found


def _drive(plan: Plan, person: Participant, case: StudyCase) -> Trajectory | Left | None:
    """A participant's drive of a case, or why it does not count; None: it was not driven."""
    entry = person.done.get(f"drive:{case.key}")
    if entry is None:
        return None
    path = person.folder / str(entry["tape"])
    try:
        tape = read_tape(path)
    except InputError as error:
        return Left(person.code, case.key, path.name, said(error))
    if tape.came_of_it is None:
        return Left(person.code, case.key, path.name, "the tape broke off")
    why = list(Quality(**tape.came_of_it["quality"]).against(plan.settings.quality))
    if not why:
        recording = drive_again(tape, case.concrete)
        if digest(recording) == tape.came_of_it["digest"]:
            return recording.ego
        why.append("driven again, its commands come to other bytes than were recorded")
    return Left(person.code, case.key, path.name, "; ".join(why))


def _broken_off(person: Participant) -> list[Left]:
    """Tapes that no finished step names: drives that were ended and driven again, or that a machine
    lost the end of.
    """
    named = {entry.get("tape") for entry in person.done.values()}
    found = []
    for path in sorted(person.folder.glob("*.jsonl")):
        if path.name in named or path.name in ("journal.jsonl",):
            continue
        try:
            why = _AGAIN[read_tape(path).came_of_it is None]
        except InputError as error:
            why = said(error)
        found.append(Left(person.code, path.stem.rpartition("-")[0], path.name, why))
    return found


def _samples(code: str, ego: Trajectory) -> list[list[Any]]:
    channels = (
        ego.time,
        ego.x,
        ego.y,
        ego.heading,
        ego.speed,
        ego.acceleration,
        ego.steering_wheel_angle,
    )
    return [[code, *row] for row in zip(*(it.tolist() for it in channels), strict=True)]


def _ratings(each: Sequence[Mapping[str, Any]]) -> list[list[Any]]:
    """One row for each rater, ADS and scenario: the mean of what they gave its drives there."""
    given: dict[tuple[str, str, str], list[float]] = {}
    for entry in each:
        given.setdefault((entry["rater"], entry["ads"], entry["scenario"]), []).append(
            entry["answers"]["score"]
        )
    return [[*key, sum(scores) / len(scores)] for key, scores in given.items()]


def evaluation_of(plan: Plan, people: int) -> str:
    """The run's evaluation with these people in place of its drivers, as TOML."""
    settings = read_settings(plan.run)
    drivers = replace(
        settings.drivers, source="recorded", recordings=(), cases=str(plan.folder / DRIVES),
        least=max(math.ceil(MOST_OF_THEM * people), 2),
        too_thin="leave_out",
    )  # fmt: skip
    source = Path(read_manifest(plan.run)["source_folder"])
    plant = settings.simulation.plant
    moved = replace(
        settings, name=f"{settings.name} with people", drivers=drivers,
        scenario=tuple(replace(it, use=_placed(it.use, source),
            sampling=_sampled(it.sampling, source))
                       for it in settings.scenario),
        ads=tuple(replace(it, controller=made_absolute(it.controller, source),
                          files=tuple(str(source / name) for name in it.files))
                  for it in settings.ads),
        simulation=replace(
            settings.simulation,
            plant=None if plant is None else replace(plant, file=str(source / plant.file))
        ),
    )  # fmt: skip
    return (
        f"# The evaluation of {plan.run} with the people of the study `{plan.settings.name}`.\n"
        + to_toml(moved)
    )


def _placed(use: str, source: Path) -> str:
    return (
        str(source / use)
        if (source / use.partition("?")[0]).is_file()
        else made_absolute(use, source)
    )


def _sampled(sampling: SamplingSettings, source: Path) -> SamplingSettings:
    return (
        sampling if sampling.file is None else replace(sampling, file=str(source / sampling.file))
    )
