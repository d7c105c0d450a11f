"""`sumo-eval drive STUDY.toml`: participants drive and rate, step by step.

A participant's journal has a line for each step, written when the step is done. After an
interruption (a closed browser, a stopped server, a crash of the machine) the participant enters the
same code and continues with the first step that is not in the journal. `outcome` reads the
journals.

Users: `extras/wheel/command.py`, `extras/wheel/outcome.py`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sumo_eval.extras.wheel.page import drive_view, replay, sheet
from sumo_eval.extras.wheel.plan import (
    HIGH,
    LOW,
    SCORE,
    PracticeSettings,
    QuestionSettings,
    StudyCase,
    StudyPlan,
)
from sumo_eval.extras.wheel.tape import json_lines
from sumo_eval.extras.wheel.trip import ENDS, TASK, new_tape, one_drive, settings_at
from sumo_eval.input_file import taking_apart, writing
from sumo_eval.record.store import open_store
from sumo_eval.report.page import Json
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Start
from sumo_eval.text import timestamp
from sumo_eval.trajectory import Recording

if TYPE_CHECKING:
    from sumo_eval.extras.wheel.window import Window

CODE = re.compile(r"[A-Za-z0-9_-]{1,20}")
CONTINUE = ["go", "Continue"]
"""A button: the answer `button` that it gives, and its words."""


@dataclass
class Participant:
    """A participant.

    code: stands for the name, which is never asked.
    number: selects the order of cases; no two participants have the same number.
    folder: of the participant's journal and tapes.
    done: the journal: name of a step that is done -> its entry.
    """

    code: str
    number: int
    folder: Path
    done: dict[str, Json] = field(default_factory=dict)

    def finish(self, step: str, **entry: Any) -> None:
        """Note that a step is done, in the journal on disk before the next step begins."""
        entry = {"step": step, "when": timestamp(), **entry}
        with (self.folder / "journal.jsonl").open("ab+") as file:
            file.seek(0)
            last = file.read().rpartition(b"\n")[2]
            # A crash may have cut off the last line. Without its newline it is ended if it is
            # whole, else overwritten.
            try:
                json.loads(last)
                file.write(b"\n")
            except ValueError:
                file.truncate(file.tell() - len(last))
            file.write(json.dumps(entry, allow_nan=False).encode() + b"\n")
        self.done[step] = entry


def participants(plan: StudyPlan) -> list[Participant]:
    """All participants who have begun, by number.

    A step whose line in the journal was cut off is not done.
    """
    people = []
    for path in (plan.folder / "participants").glob("*/journal.jsonl"):
        lines = json_lines(path, "journal")
        with taking_apart(path, "Each line must be a step as a study writes it."):
            done = {_step_of(entry): entry for entry in lines}
            if done:
                people.append(
                    Participant(path.parent.name, done["begun"]["number"], path.parent, done)
                )
    return sorted(people, key=lambda person: (person.number, person.folder))


def _step_of(entry: Any) -> Any:
    """Name of the step of a journal's entry, as `drive:CASE`.

    Raises ValueError where the entry lacks something that its kind of step needs.
    """
    step = entry["step"]
    match step.partition(":")[0], entry:
        case (
            ("begun", {"number": int()})
            | ("consent", {"agrees": bool()})
            | ("practice", {"passed": bool(), "tape": str()})
            | ("drive", {"tape": str(), "answers": {}, "quality": {}})
            | ("rate", {"ads": str(), "scenario": str(), "answers": {}})
            | ("stopped" | "done", _)
        ) if LOW <= entry.get("answers", {}).get("score", LOW) <= HIGH:
            return step
    raise ValueError(entry)


def enter(plan: StudyPlan, code: str) -> Participant:
    """The participant with this code: from the journal, or new."""
    people = participants(plan)
    for person in people:
        if person.code.lower() == code.lower():
            return person
    folder = plan.folder / "participants" / code
    # the least free number: that of a removed folder is free again
    number = min({*range(len(people) + 1)} - {person.number for person in people})
    person = Participant(code, number, folder)
    with writing(f"The study in {folder}", folder):
        person.finish("begun", number=number)
    return person


async def study(window: Window, plan: StudyPlan, tell: Callable[[str], None]) -> None:
    """One participant at a time, until the team ends the session.

    tell: receives a line on each participant.
    """
    fault = ""  # of the code that was entered
    while True:
        answer = await window.ask(
            sheet("Welcome", "Please enter the code that you were given. No names.", fault,
                  questions=[{"key": "code", "kind": "code", "text": "Code"}],
                  buttons=[["go", "Begin"], ["skip", "End the session"]])
        )  # fmt: skip
        if answer.get("button") == "skip":
            break
        code = str(answer.get("code", ""))
        if not CODE.fullmatch(code):
            fault = "A code has 1 to 20 letters, digits, hyphens and underscores."
            continue
        fault = ""
        person = enter(plan, code)
        try:
            ended = await steps_of(window, plan, person)
        except StopsError:
            ended = "stopped"
            person.finish(ended)
        tell(f"{person.code}: {ended}")
        answer = await window.ask(
            sheet("Thank you", "You have finished." if ended == "done" else
                  "Thank you for coming. Please tell the team.",
                  buttons=[["next", "Next participant"], ["end", "End the session"]])
        )  # fmt: skip
        if answer.get("button") == "end":
            break
    # "over": after this sheet the page does not reconnect
    await window.show(
        {**sheet("The session is over", "You can close this window."), "show": "over"}
    )


class StopsError(Exception):
    """A participant wishes to stop."""


async def asked_of(window: Window, view: Json) -> Json:
    """A participant's answers to a sheet of scales; shown again until all answers are on their
    scales.

    view: the sheet, which gets a button to stop.

    Raises StopsError where the participant stops.
    """
    view["buttons"].append(["stop", "I want to stop"])
    keys = {question["key"] for question in view.get("questions", ())}
    while True:
        answers = await window.ask(view)
        if answers.pop("button", None) == "stop":
            raise StopsError
        if answers.keys() == keys and all(
            isinstance(it, float) and LOW <= it <= HIGH for it in answers.values()
        ):
            return answers


async def steps_of(window: Window, plan: StudyPlan, person: Participant) -> str:
    """Carry out all steps of a participant that are not done yet.

    Returns `done`, `no consent` or `practice not passed`.

    Raises StopsError where the participant stops. With the same code they continue later.
    """
    if "consent" not in person.done:
        answer = await window.ask(
            sheet("Before you begin", plan.settings.consent,
                  "You may stop at any time without giving a reason.",
                  questions=[{"key": "agrees", "kind": "yes", "text": "Your consent",
                              "label": "I agree."}],
                  buttons=[CONTINUE, ["skip", "I do not take part"]])
        )  # fmt: skip
        agrees = answer.get("agrees") is True and answer.get("button") == "go"
        person.finish("consent", agrees=agrees)
    if not person.done["consent"]["agrees"]:
        return "no consent"
    if not await practised(window, plan, person):
        return "practice not passed"
    count = len(plan.cases)
    for number, case in enumerate(plan.order(person.number)):
        if f"drive:{case.key}" in person.done:
            continue
        if number and number % plan.settings.break_after == 0:
            await asked_of(
                window,
                sheet("Time for a break", f"{number} of {count} drives are done. Continue when you "
                      "like.", buttons=[CONTINUE])
            )  # fmt: skip
        await own_drive(window, plan, person, case, f"Drive {number + 1} of {count}")
    replays = plan.ratings(person.code)
    for number, (case, ads) in enumerate(replays):
        if f"rate:{case.key}:{ads}" not in person.done:
            await rate(
                window, plan, person, case, ads, f"Drive {number + 1} of {len(replays)} to rate"
            )
    if "done" not in person.done:
        person.finish("done")
    return "done"


async def practised(window: Window, plan: StudyPlan, person: Participant) -> bool:
    """Let a participant practise; return whether enough of the allowed trials were passed."""
    rule = plan.settings.practice
    settings = settings_at(plan.settings.rate)
    # for each trial, whether it was passed
    trials = [entry["passed"] for step, entry in person.done.items() if "practice:" in step]
    concrete = practice_drive(rule, plan.cases[0].concrete.road)
    lines = (
        f"Keep a lane and about {3.6 * rule.speed:.0f} km/h. Change lanes once or twice, to get "
        "the feel of it.",
        f"A trial is passed when you keep within {rule.offset:g} m of a lane's centre and within "
        f"{3.6 * rule.within:.0f} km/h of the speed for {rule.share:.0%} of {rule.seconds:g} s.",
    )
    while sum(trials) < rule.passes and len(trials) < rule.most:
        number = len(trials) + 1
        path = new_tape(person.folder, "practice")
        view = drive_view(concrete, settings, f"Practice, trial {number}", lines)
        recording, quality = await one_drive(
            window, concrete, settings, path, view, use="", participant=person.code
        )
        share = kept_share(recording, concrete, rule)
        ends = "contact", "off_road", "quit", "sim_error"
        passed = share >= rule.share and recording.end_reason not in ends
        trials.append(passed)
        person.finish(f"practice:{number}", passed=passed, share=round(share, 4), tape=path.name,
            quality=asdict(quality))  # fmt: skip
        words = f"You kept lane and speed for {share:.0%} of the time; {rule.share:.0%} are needed."
        await asked_of(
            window, sheet("Well done" if passed else "Once more", words, buttons=[CONTINUE])
        )
    return bool(sum(trials) >= rule.passes)


def practice_drive(rule: PracticeSettings, road: Road) -> ConcreteScenario:
    """A concrete scenario on a road with one vehicle far ahead, at the speed that the driver is to
    keep.
    """
    ego = Start(50.0, 0.0, rule.speed)  # x in m, the default of scenario files
    ahead = Start(ego.x + 60.0 + 2.0 * rule.speed, 0.0, rule.speed)  # 60 m and 2 s further on
    # {}: it has no parameters; 1.0: its exposure
    return ConcreteScenario(
        "practice", {}, 1.0, road, ego, (Actor("ahead", ahead),), time_limit=rule.seconds
    )


def kept_share(recording: Recording, concrete: ConcreteScenario, rule: PracticeSettings) -> float:
    """Share of a trial in which the driver was near a lane's centre and at the speed."""
    road = concrete.road
    ego = recording.ego
    centres = np.array([road.lane_centre(lane) for lane in range(road.lanes)])
    # distance from the nearest centre at each sample, m, (n,)
    off_centre = np.abs(ego.y[:, None] - centres).min(axis=1)
    at_speed = np.abs(ego.speed - rule.speed) <= rule.within
    return float(np.mean((off_centre <= rule.offset) & at_speed))


async def own_drive(
    window: Window, plan: StudyPlan, person: Participant, case: StudyCase, title: str
) -> None:
    """A drive of a case, and the questions after it.

    The participant may repeat a drive that they ended early.
    """
    settings = settings_at(plan.settings.rate)
    view = drive_view(
        case.concrete, settings, title,
        (TASK, f"Your speed: about {3.6 * case.concrete.ego.speed:.0f} km/h, as traffic allows.")
    )  # fmt: skip
    button = "again"
    while button == "again":
        path = new_tape(person.folder, case.key)
        recording, quality = await one_drive(
            window, case.concrete, settings, path, view, use=case.use, participant=person.code,
            case=case.key
        )  # fmt: skip
        button = ""
        if recording.end_reason == "quit":
            answer = await window.ask(
                sheet("The drive was ended", recording.error or "",
                      "You can drive it again, or leave it out.",
                      buttons=[["again", "Drive again"], ["leave", "Leave it out"],
                          ["stop", "I want to stop"]])
            )  # fmt: skip
            button = answer.get("button", "")
    questions = [scale(it) for it in plan.settings.question if it.after == "drive"]
    answers = {}
    if questions and recording.end_reason != "quit":
        end = ENDS.get(recording.end_reason, "The drive is over.")
        try:
            answers = await asked_of(
                window, sheet(title, end, questions=questions, buttons=[CONTINUE])
            )
        except StopsError:
            button = "stop"
    # the drive is done even if the participant stops here
    person.finish(f"drive:{case.key}", tape=path.name, end=recording.end_reason, answers=answers,
                  quality=asdict(quality))  # fmt: skip
    if button == "stop":
        raise StopsError


async def rate(
    window: Window, plan: StudyPlan, person: Participant, case: StudyCase, ads: str, title: str
) -> None:
    """A replay of a recorded drive of an ADS without its name, and the questions about it."""
    fact = case.ads[ads]
    with open_store(plan.run) as store:
        vehicles = store.trajectories(fact.case)
    questions = [SCORE, *(it for it in plan.settings.question if it.after == "replay")]
    answers = await asked_of(
        window,
        sheet(title, "Watch the blue car, as often as you like, from where you like.",
              replay=replay(case.concrete, "the blue car", vehicles, fact.collision),
              questions=[scale(it) for it in questions], buttons=[CONTINUE])
    )  # fmt: skip
    person.finish(f"rate:{case.key}:{ads}", case=case.key, ads=ads, scenario=fact.scenario,
                  answers=answers)  # fmt: skip


def scale(question: QuestionSettings) -> Json:
    """A question as the page asks it. low, high: numbers at the ends; least, most: their words."""
    return {"key": question.key, "kind": "scale", "text": question.text, "low": LOW, "high": HIGH,
            "least": question.least, "most": question.most}  # fmt: skip
