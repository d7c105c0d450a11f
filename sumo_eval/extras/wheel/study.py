"""`sumo-eval drive STUDY.toml`: participants drive and rate, step by step; every step that is done
is kept at once.

What a participant has done stands in a journal, a line a step. A browser that was closed, a server
that was stopped, a machine that went down: who gives the code again goes on with the first step
that the journal does not have.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from sumo_eval.errors import InputError, said
from sumo_eval.extras.wheel.page import drive_view, replay, sheet
from sumo_eval.extras.wheel.plan import (
    HIGH,
    LOW,
    Plan,
    PracticeSettings,
    QuestionSettings,
    StudyCase,
)
from sumo_eval.extras.wheel.tape import json_lines
from sumo_eval.extras.wheel.trip import ENDS, TASK, new_tape, one_drive, settings_at
from sumo_eval.extras.wheel.window import Window
from sumo_eval.record.run_folder import FACTS
from sumo_eval.record.store import open_store
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Road, Start
from sumo_eval.trajectory import Recording

CODE: Final = re.compile(r"[A-Za-z0-9_-]{1,20}")
SCORE: Final = QuestionSettings(
    "score", "How well did the blue car drive?", "replay", "very badly", "very well"
)
"""The question of Fig. 11, asked after every replay."""


@dataclass
class Participant:
    """A participant: a code, never a name.

    number: how many began before;
    done: steps with what they gave.
    """

    code: str
    number: int
    folder: Path
    done: dict[str, dict[str, Any]] = field(default_factory=dict)

    def finish(self, step: str, **what: Any) -> None:
        """A step is done; it is on disk before the next one begins."""
        entry = {"step": step, "when": datetime.now(UTC).isoformat(timespec="seconds"), **what}
        with (self.folder / "journal.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry, allow_nan=False) + "\n")
        self.done[step] = entry


def participants(plan: Plan) -> list[Participant]:
    """Everybody who has begun, in that order.

    A last line of a journal that was cut off is a step that was not done.
    """
    found = []
    for path in sorted((plan.folder / "participants").glob("*/journal.jsonl")):
        entries = json_lines(path, "journal")
        if entries:
            person = Participant(path.parent.name, int(entries[0]["number"]), path.parent)
            person.done = {entry["step"]: entry for entry in entries}
            found.append(person)
    return sorted(found, key=lambda person: person.number)


def enter(plan: Plan, code: str) -> Participant:
    """The participant with this code: from the journal, or new."""
    known = participants(plan)
    for person in known:
        if person.code.lower() == code.lower():
            return person
    folder = plan.folder / "participants" / code
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The study cannot be kept in {folder}: {said(error)}.") from error
    person = Participant(code, len(known), folder)
    person.finish("begun", number=person.number)
    return person


async def study(window: Window, plan: Plan, tell: Callable[[str], None]) -> None:
    """One participant after the other, until the team has had enough.

    tell: is given a line on each.
    """
    wrong = ""
    while True:
        given = await window.ask(
            sheet("Welcome", "Please enter the code that you were given. No names.", wrong,
                  questions=[{"key": "code", "kind": "code", "text": "Code"}],
                  buttons=[["go", "Begin"], ["skip", "End the session"]])
        )  # fmt: skip
        if given.get("button") == "skip":
            break
        code = str(given.get("code", ""))
        if not CODE.fullmatch(code):
            wrong = "A code has 1 to 20 letters, digits, hyphens and underscores."
            continue
        wrong = ""
        person = enter(plan, code)
        ended = await session(window, plan, person)
        tell(f"{person.code}: {ended}")
        answer = await window.ask(
            sheet("Thank you", "You are through." if ended == "done" else "Thank you for coming. "
                                                                          "Please tell the team.",
                  buttons=[["next", "Next participant"], ["end", "End the session"]])
        )  # fmt: skip
        if answer.get("button") == "end":
            break
    await window.show(
        {**sheet("The session is over", "You can close this window."), "show": "over"}
    )


class StopsError(Exception):
    """A participant wishes to stop."""


async def asked_of(window: Window, view: dict[str, Any]) -> dict[str, Any]:
    """A participant's answers to a sheet; the participant may stop there.

    Raises StopsError where they do.
    """
    view["buttons"] = [*view["buttons"], ["stop", "I want to stop"]]
    given = await window.ask(view)
    if given.pop("button", None) == "stop":
        raise StopsError
    return given


async def session(window: Window, plan: Plan, person: Participant) -> str:
    """All steps of a participant that are not done yet; how it ended: `done`, `no consent`,
    `practice not passed`, `stopped`. Whoever stopped may come back: the code goes on with the first
    step that is not done.
    """
    try:
        return await steps_of(window, plan, person)
    except StopsError:
        person.finish("stopped")
        return "stopped"


async def steps_of(window: Window, plan: Plan, person: Participant) -> str:
    """All steps of a participant that are not done yet, and how they ended."""
    if "consent" not in person.done:
        given = await window.ask(
            sheet("Before you begin", plan.settings.consent, "You may stop at any time without "
                                                             "giving a reason.",
                  questions=[{"key": "agrees", "kind": "yes", "text": "Your consent",
                      "label": "I agree."}],
                  buttons=[["go", "Go on"], ["skip", "I do not take part"]])
        )  # fmt: skip
        person.finish("consent", agrees=given.get("agrees") is True and given.get("button") == "go")
    if not person.done["consent"]["agrees"]:
        return "no consent"
    if not await practised(window, plan, person):
        return "practice not passed"
    for place, case in enumerate(plan.order(person.number)):
        if f"drive:{case.key}" in person.done:
            continue
        if place and place % plan.settings.break_after == 0:
            done = f"{place} of {len(plan.cases)} drives are done. Go on when you like."
            await asked_of(window, sheet("Time for a break", done, buttons=[["go", "Go on"]]))
        await own_drive(window, plan, person, case, f"Drive {place + 1} of {len(plan.cases)}")
    shown = plan.ratings(person.code)
    for place, (case, ads) in enumerate(shown):
        if f"rate:{case.key}:{ads}" not in person.done:
            await rate(
                window, plan, person, case, ads, f"Drive {place + 1} of {len(shown)} to rate"
            )
    if "done" not in person.done:
        person.finish("done")
    return "done"


async def practised(window: Window, plan: Plan, person: Participant) -> bool:
    """Practice until the criterion is fulfilled; whether it was, within the allowed trials."""
    rule = plan.settings.practice
    trials = [entry for step, entry in person.done.items() if step.startswith("practice:")]
    passed = sum(entry["passed"] for entry in trials)
    road = plan.cases[0].concrete.road
    while passed < rule.passes and len(trials) < rule.most:
        concrete = practice_drive(rule, road)
        lines = (
            f"Keep a lane and about {3.6 * rule.speed:.0f} km/h. Change lanes once or twice, to "
            "get the feel of it.",
            f"You are through when you keep within {rule.offset:g} m of a lane's centre and within "
            f"{3.6 * rule.within:.0f} km/h of the speed for "
            f"{rule.share:.0%} of {rule.seconds:g} s.",
        )
        settings = settings_at(plan.settings.rate)
        path = new_tape(person.folder, "practice")
        view = drive_view(concrete, settings, f"Practice, trial {len(trials) + 1}", lines)
        recording, quality = await one_drive(
            window, concrete, settings, path, view, use="", participant=person.code
        )
        share = kept_share(recording, concrete, rule)
        good = share >= rule.share and recording.end_reason not in (
            "contact",
            "off_road",
            "quit",
            "sim_error",
        )
        passed += good
        person.finish(f"practice:{len(trials) + 1}", passed=good, share=round(share, 4),
            tape=path.name,
                      quality=quality.plain())  # fmt: skip
        trials.append(person.done[f"practice:{len(trials) + 1}"])
        await asked_of(
            window,
            sheet("Well done" if good else "Once more",
                  f"You kept lane and speed for {share:.0%} of the time; {rule.share:.0%} are "
                  "needed.",
                  buttons=[["go", "Go on"]]),
        )  # fmt: skip
    return bool(passed >= rule.passes)


def practice_drive(rule: PracticeSettings, road: Road) -> ConcreteScenario:
    """A road with one vehicle far ahead, which drives on as fast as the driver is to."""
    ahead = Actor("ahead", Start(50.0 + 60.0 + 2.0 * rule.speed, 0.0, rule.speed))
    return ConcreteScenario(
        "practice", {}, 1.0, road, Start(50.0, 0.0, rule.speed), (ahead,), time_limit=rule.seconds
    )  # fmt: skip


def kept_share(recording: Recording, concrete: ConcreteScenario, rule: PracticeSettings) -> float:
    """Share of a trial in which the driver was near a lane's centre and at the speed."""
    road, ego = concrete.road, recording.ego
    centres = np.array([road.lane_centre(lane) for lane in range(road.lanes)])
    off = np.abs(ego.y[:, None] - centres).min(axis=1)
    return float(np.mean((off <= rule.offset) & (np.abs(ego.speed - rule.speed) <= rule.within)))


async def own_drive(
    window: Window, plan: Plan, person: Participant, case: StudyCase, title: str
) -> None:
    """A drive of a case, and the questions after it.

    One that the person ended may be driven again, once asked.
    """
    settings = settings_at(plan.settings.rate)
    wanted = f"Your speed: about {3.6 * case.concrete.ego.speed:.0f} km/h, as the traffic allows."
    stops = False
    while True:
        path = new_tape(person.folder, case.key)
        view = drive_view(case.concrete, settings, title, (TASK, wanted))
        recording, quality = await one_drive(
            window, case.concrete, settings, path, view, use=case.use, participant=person.code,
            case=case.key
        )  # fmt: skip
        if recording.end_reason != "quit":
            break
        again = await window.ask(
            sheet("The drive was ended", recording.error or "", "You can drive it again, or leave "
                                                                "it out.",
                  buttons=[["again", "Drive again"], ["leave", "Leave it out"],
                      ["stop", "I want to stop"]])
        )  # fmt: skip
        if again.get("button") != "again":
            stops = again.get("button") == "stop"
            break
    asked = [it for it in plan.settings.question if it.after == "drive"]
    answers: dict[str, Any] = {}
    if asked and recording.end_reason != "quit":
        end = ENDS.get(recording.end_reason, "The drive is over.")
        try:
            answers = await asked_of(
                window,
                sheet(title, end, questions=[scale(it) for it in asked], buttons=[["go", "Go on"]]),
            )
        except StopsError:
            stops = True
    person.finish(f"drive:{case.key}", tape=path.name, end=recording.end_reason, answers=answers,
                  quality=quality.plain())  # fmt: skip
    if stops:
        raise StopsError


async def rate(
    window: Window, plan: Plan, person: Participant, case: StudyCase, ads: str, title: str
) -> None:
    """A replay of an ADS's recorded drive, whose name nobody is told, and the questions about
    it.
    """
    asked = [SCORE, *(it for it in plan.settings.question if it.after == "replay")]
    answers = await asked_of(
        window,
        sheet(title, "Watch the blue car, as often as you like, from where you like.",
              replay=replay_of(plan, case, ads), questions=[scale(it) for it in asked],
              buttons=[["go", "Go on"]]),
    )  # fmt: skip
    person.finish(
        f"rate:{case.key}:{ads}",
        case=case.key,
        ads=ads,
        scenario=case.concrete.scenario,
        answers=answers,
    )


def scale(question: QuestionSettings) -> dict[str, Any]:
    """A question as the page asks it."""
    return {"key": question.key, "kind": "scale", "text": question.text, "low": LOW, "high": HIGH,
            "least": question.least, "most": question.most}  # fmt: skip


def replay_of(plan: Plan, case: StudyCase, ads: str) -> dict[str, Any]:
    """Data of a recorded drive for the page's player, without the ADS's name."""
    fact = case.ads[ads]
    with open_store(plan.run / FACTS) as store:
        vehicles = store.trajectories(fact.case)
    return replay(case.concrete, "the blue car", vehicles, fact.collision)
