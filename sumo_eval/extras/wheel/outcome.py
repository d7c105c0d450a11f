"""Results of a study: the folder of drives for `[drivers] cases`, the ratings for `humans opinion`,
and the drives that are left out, each with the rule that it breaks.

`sumo-eval drive` computes all of them from journals and tapes, again after each session. A tape is
rerun for its trajectory. A tape that does not give its recorded bytes is left out and reported.

Users: `extras/wheel/command.py`.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import NamedTuple

from sumo_eval.errors import InputError, said
from sumo_eval.extras.wheel.plan import StudyCase, StudyPlan
from sumo_eval.extras.wheel.quality import Quality
from sumo_eval.extras.wheel.study import Participant, participants
from sumo_eval.extras.wheel.tape import digest, drive_again, read_tape
from sumo_eval.groups import grouped
from sumo_eval.input_file import taking_apart
from sumo_eval.record.run_folder import read_manifest, read_settings
from sumo_eval.report.export_case import absolute
from sumo_eval.report.page import Json, write_csv, write_json, write_page
from sumo_eval.report.people import STUDY, drawn_words
from sumo_eval.settings.config import to_toml
from sumo_eval.trajectory import CHANNELS, Trajectory

DRIVES = "drives"  # the folder for `[drivers] cases`
# share of the participants that must have driven a point; with fewer it is left out of the run
LEAST_SHARE = 2.0 / 3.0


class DiscardedDrive(NamedTuple):
    """A drive that does not count.

    why: the rules that it broke, in words.
    """

    participant: str
    case: str
    tape: str
    why: str


class StudyResult(NamedTuple):
    """Results of a study.

    people: number of participants.
    with_drives: number of participants with a drive that counts.
    drives: number of drives that count.
    ratings: number of ratings.
    drawn: how the screen drew the road, in words -> number of drives that count.
    discarded: drives that do not count.
    files: what was written: folder of drives, ratings, drives left out, evaluation.
    """

    people: int
    with_drives: int
    drives: int
    ratings: int
    drawn: dict[str, int]
    discarded: tuple[DiscardedDrive, ...]
    files: tuple[Path, ...]

    def sentences(self) -> list[str]:
        """The results in words."""
        left_out = len(self.discarded)
        words = [
            f"{self.people} took part; {self.drives} drives by {self.with_drives} of them count, "
            f"{left_out} {'is' if left_out == 1 else 'are'} left out; {self.ratings} ratings."
        ]
        if self.drawn:
            words.append(f"  the road as it was drawn: {drawn_words(self.drawn)}.")
        return words + [
            f"  left out: {it.participant}, {it.case}: {it.why}." for it in self.discarded
        ]


def collect(plan: StudyPlan) -> StudyResult:
    """Write the results of the study into its folder."""
    people, drives = participants(plan), plan.folder / DRIVES
    rows: list[Json] = []
    discarded = []
    drawn: Counter[str] = Counter()
    for person in people:
        for case in plan.cases:
            entry = person.done.get(f"drive:{case.key}")
            if entry is None:
                continue
            drive = _counted_drive(plan, person, case, entry)
            if isinstance(drive, DiscardedDrive):
                discarded.append(drive)
                continue
            file = f"{person.code}/{case.key}.csv"
            _write_drive(drives / file, person.code, drive)
            rows.append({"scenario": case.concrete.scenario, "file": file, **case.concrete.values})
            how = entry["quality"].get("drawn")
            if how is not None:
                drawn[str(how)] += 1
        discarded += [*_without_case(plan, person), *_unfinished(person)]
    _write_table(plan, drives, rows)
    ratings = _write_answers(plan.folder, people, discarded)
    with_drives = len({row["file"].partition("/")[0] for row in rows})
    evaluation = write_page(
        plan.folder / "evaluation.toml", evaluation_of(plan, with_drives), "The evaluation"
    )
    counts: Json = {
        "people": len(people), "with_drives": with_drives, "drives": len(rows), "ratings": ratings,
        "drawn": dict(drawn)
    }  # fmt: skip
    summary = {
        "study": plan.settings.name, **counts, "left_out": [it._asdict() for it in discarded],
        "quality": asdict(plan.settings.quality)
    }  # fmt: skip
    write_json(drives / STUDY, summary, "The summary")
    tables = (plan.folder / name for name in ("ratings.csv", "left_out.csv"))
    return StudyResult(**counts, discarded=tuple(discarded), files=(drives, *tables, evaluation))


def _without_case(plan: StudyPlan, person: Participant) -> list[DiscardedDrive]:
    """Drives of cases that the study no longer has."""
    keys = {case.key for case in plan.cases}
    drives = ((step.partition(":"), entry) for step, entry in person.done.items())
    return [
        DiscardedDrive(person.code, key, entry["tape"], "no case of the study now")
        for (kind, _, key), entry in drives
        if kind == "drive" and key not in keys
    ]


def _write_table(plan: StudyPlan, drives: Path, rows: list[Json]) -> None:
    """Write the table of the drives that count, and remove the files of all others."""
    for stale in {*drives.glob("*/*.csv")} - {drives / row["file"] for row in rows}:
        stale.unlink()
    parameters = (name for case in plan.cases for name in case.concrete.values)
    head = dict.fromkeys(("scenario", "file", *parameters))
    write_csv(drives / "cases.csv", head, ([row.get(name, "") for name in head] for row in rows))


def _write_drive(path: Path, driver: str, drive: Trajectory) -> None:
    """Write a drive as CSV, one sample a row."""
    samples = zip(*(getattr(drive, name).tolist() for name in CHANNELS), strict=True)
    # the table calls the first and the last channel `t` and `steering`
    head = ("driver", "t", *CHANNELS[1:-1], "steering")
    write_csv(path, head, ((driver, *sample) for sample in samples))


def _write_answers(folder: Path, people: list[Participant], discarded: list[DiscardedDrive]) -> int:
    """Write ratings, answers, drives left out and the quality of all drives; count the ratings.

    A rating is the mean score that a participant gives an ADS in a scenario, over its replays.
    """
    entries = [(person.code, step, entry) for person in people
        for step, entry in person.done.items()]  # fmt: skip
    scores = grouped(
        ((code, entry["ads"], entry["scenario"]), entry["answers"]["score"])
        for code, step, entry in entries
        if step.startswith("rate:") and "score" in entry["answers"]
    )
    ratings = [[*rater_ads_scenario, sum(own) / len(own)]
        for rater_ads_scenario, own in scores.items()]  # fmt: skip
    write_csv(folder / "ratings.csv", ("rater", "ads", "scenario", "score"), ratings)
    answers = [
        [code, step, question, answer]
        for code, step, entry in entries
        for question, answer in entry.get("answers", {}).items()
    ]
    write_csv(folder / "answers.csv", ("rater", "step", "question", "answer"), answers)
    write_csv(folder / "left_out.csv", DiscardedDrive._fields, discarded)
    names = [it.name for it in fields(Quality)]
    why = {(it.participant, it.tape): it.why for it in discarded}
    qualities = [
        [code, step.removeprefix("drive:"), *map(entry["quality"].get, names),
            why.get((code, entry["tape"]), "")]
        for code, step, entry in entries if step.startswith("drive:")
    ]  # fmt: skip
    write_csv(folder / "quality.csv", ("participant", "case", *names, "left_out"), qualities)
    return len(ratings)


def _counted_drive(
    plan: StudyPlan, person: Participant, case: StudyCase, entry: Json
) -> Trajectory | DiscardedDrive:
    """A participant's drive of a case, or why it does not count.

    entry: of this drive in the participant's journal.
    """
    path = person.folder / entry["tape"]
    why = "the tape broke off"
    try:
        tape = read_tape(path)
        if tape.end is not None:
            with taking_apart(path, "Its end must be as a study writes it."):
                why = "; ".join(Quality(**tape.end["quality"]).against(plan.settings.quality))
            if not why:
                recording = drive_again(tape, case.concrete)
                if digest(recording) == tape.end.get("digest"):
                    return recording.ego
                why = "rerun, its commands give other bytes than were recorded"
    except InputError as error:
        why = said(error)
    return DiscardedDrive(person.code, case.key, path.name, why)


def _unfinished(person: Participant) -> Iterator[DiscardedDrive]:
    """Drives on tapes that no step of the journal names.

    The driver ended such a drive early, or it broke off.
    """
    named = {entry.get("tape") for entry in person.done.values()} | {"journal.jsonl"}
    for path in sorted(person.folder.glob("*.jsonl")):
        if path.name not in named:
            case = path.stem.rpartition("-")[0]  # a tape is named CASE-NUMBER by `trip.new_tape`
            rerun = f"drive:{case}" in person.done
            try:
                if read_tape(path).end is None:
                    why = "the drive broke off" + ", and was rerun" * rerun
                else:
                    why = "ended" + ", and rerun" * rerun
            except InputError as error:
                why = said(error)
            yield DiscardedDrive(person.code, case, path.name, why)


def evaluation_of(plan: StudyPlan, people: int) -> str:
    """The run's evaluation with the participants instead of its drivers, as TOML.

    people: number of participants with a drive that counts.
    """
    settings = absolute(read_settings(plan.run), Path(read_manifest(plan.run)["source_folder"]))
    drivers = replace(
        settings.drivers, source="recorded", recordings=(), cases=str(plan.folder / DRIVES),
        least=max(math.ceil(LEAST_SHARE * people), 2), too_thin="leave_out"
    )  # fmt: skip
    # an exposure without recordings of its own used those of the drivers, which are replaced here
    scenarios = tuple(
        replace(it, exposure=replace(
            it.exposure, recordings=it.exposure.recordings or settings.drivers.recordings))
        for it in settings.scenario
    )  # fmt: skip
    evaluation = replace(
        settings, name=f"{settings.name} with people", drivers=drivers, scenario=scenarios
    )
    return (
        f"# The evaluation of {plan.run} with the people of the study `{plan.settings.name}`.\n"
        f"{to_toml(evaluation)}"
    )
