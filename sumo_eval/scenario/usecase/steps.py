"""What the steps of a use case mean: who starts where, what others do and when, and what the ego must do.

A step is one of the sentences in `SENTENCES`; another one is refused with its line, and nothing is put in its place.
Where a sentence has no number, the reading is a constant here, and docs/use_cases.md lists it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario.usecase.gherkin import PLACEHOLDER, Outline, Step, in_si

WALKING = 1.4  # m/s of a pedestrian who leaves the ego's lane
LOSES = 0.5  # m/s that an ego has lost which decelerates
SAME = 0.5  # m/s between speeds that match
STANDS = 0.1  # m/s below which a vehicle stands
CLEAR = 0.5  # m between the ego's lane and who is completely out of it
CHANGE_TIME = 3.0  # s of a lane change
ROUNDING = 1e-6  # of numbers that are compared
LANE_WIDTH = 3.5  # m where no column `w` says
BESIDE = ("parking_offset", "overtake_offset")
"""Columns by which somebody stands beside the middle of the ego's lane, m to the left."""
BY_NAME = {
    "w": "width of a lane",
    "parking_offset": "how far left of the middle of the ego's lane somebody stands",
    "d_npc": "how far Npc0 is ahead of the ego at the start",
}
"""Columns that need no step to mean something."""

_VALUE = r"(?P<{0}><\w+>|-?\d+(?:\.\d+)? ?(?:km/h|m/s\^2|m/s|m|meters|s))"
_OTHER = r"(?P<{0}>(?:Npc|Pedestrian)\d+)"


@dataclass(slots=True)
class Other:
    """Somebody besides the ego, as far as the steps have said. ahead: m from bumper to bumper; speed: m/s, an
    expression; side: of the lane's middle on which it stands, 1 left by the offset, -1 on the other one.
    """

    name: str
    line: int
    ahead: str | None = None
    behind: bool = False
    speed: str | None = None
    side: int = 0
    next_lane: bool = False
    after: str | None = None
    moves: list[dict[str, Any]] = field(default_factory=list)
    last_speed: str | None = None
    to_lane: bool = False

    @property
    def walks(self) -> bool:
        """Whether it is a person on foot."""
        return self.name.startswith("Pedestrian")


@dataclass(frozen=True, slots=True)
class Check:
    """A `Then` line as a requirement. line: in the file."""

    text: str
    check: str
    line: int


@dataclass(slots=True)
class Story:
    """What is understood of an outline. waits: the condition on which the next act of somebody begins, or none.

    unclear: why no act may begin in this block: a step before it has no number.
    """

    outline: Outline
    file: str
    ego_speed: str | None = None
    others: dict[str, Other] = field(default_factory=dict)
    checks: list[Check] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    waits: str = ""
    unclear: str = ""
    stops: bool = False
    step: Step = field(default_factory=lambda: Step("given", "", 0))
    last: int = 0

    def value(self, text: str, unit: str) -> str:
        """`<name>` or `30 m` as an expression in units of SI; refused unless it has that unit."""
        asked = PLACEHOLDER.fullmatch(text)
        if asked is None:
            number, si = in_si(text, "a quantity", self.where)
            shown = repr(number)
        else:
            column = self.outline.column(asked[1])
            assert column is not None
            self.used.add(column.name)
            si, shown = column.si, si_name(column.name, column.factor)
        if si != unit:
            raise must_be(f"`{text}`", f"step `{self.step.text}` ({self.where})", f"in {unit}", si)
        return shown

    def other(self, name: str, *, new: bool = False) -> Other:
        """Somebody by name; refused where nobody has said who that is."""
        if name not in self.others:
            if not new:
                raise InputError(
                    f"{self.where}: step `{self.step.text}` names {name}, of whom no step before it tells."
                )
            self.others[name] = Other(name, self.step.line)
        return self.others[name]

    def require(self, check: str, text: str | None = None) -> None:
        """The step as something that must hold in every drive."""
        self.checks.append(Check(text or self.step.text, check, self.step.line))

    def act(self, other: Other, move: dict[str, Any]) -> None:
        """A move that begins when what the story waits for has come."""
        if self.unclear:
            raise InputError(f"{self.where}: when {other.name} begins cannot be known: {self.unclear}.")
        begins = self.waits or "time >= 0"
        self.waits = f"ended({other.name}, {_name(other)})"
        other.moves.append({"name": _name(other), "when": begins, **move})

    @property
    def where(self) -> str:
        """File and line of the step."""
        return f"{self.file}, line {self.step.line}"


def si_name(column: str, factor: float) -> str:
    """What expressions call a column's value in units of SI."""
    return column if factor == 1.0 else f"{column}_si"


def _name(other: Other) -> str:
    return f"act{len(other.moves)}"


def understood(outline: Outline, file: str) -> Story:
    """What the steps of an outline say. Raises InputError with file, line and step for what is not understood."""
    story = Story(outline, file, last=max((step.line for step in outline.steps if step.kind == "when"), default=0))
    kind = ""
    for step in outline.steps:
        story.step = step
        if step.kind == "when" and kind != "when":
            story.unclear = ""
        kind = step.kind
        sentence, found = _found(step, story)
        sentence.means(story, found)
    return story


def _found(step: Step, story: Story) -> tuple[Sentence, dict[str, str]]:
    for sentence in SENTENCES:
        if sentence.kind != step.kind:
            continue
        match = re.fullmatch(sentence.pattern, step.text.removesuffix("."), re.IGNORECASE)
        if match is not None:
            return sentence, {name: text for name, text in match.groupdict().items() if text is not None}
    raise InputError(
        f"{story.where}: step `{step.kind.capitalize()} {step.text}` is not understood; `sumo-eval import --steps` "
        "lists the sentences that are."
    )


Found = dict[str, str]


@dataclass(frozen=True, slots=True)
class Sentence:
    """A sentence that is understood. shown: as a person would write it."""

    kind: str
    shown: str
    means: Callable[[Story, Found], None]

    @property
    def pattern(self) -> str:
        """The regular expression of the sentence: `VALUE`, `NPC` and words in brackets are its places."""
        text = re.escape(self.shown).replace(r"\ ", " ")
        for written, means in ((r"\[", "(?:"), (r"\]", ")?"), (r"\|", "|"), ("<<", "(?:"), (">>", ")")):
            text = text.replace(written, means)
        text = re.sub(r"\bVALUE(\d?)", lambda it: _VALUE.format(f"value{it[1]}"), text)
        text = re.sub(r"\bNPC(\d?)", lambda it: _OTHER.format(f"npc{it[1]}"), text)
        return re.sub(r"\bPERCENT", r"(?P<percent>\\d+)%", text)


# -- Given: who is where -----------------------------------------------------------------------------------------------


def _ego_drives(story: Story, found: Found) -> None:
    story.ego_speed = story.value(found["value"], "m/s")


def _ego_stands(story: Story, found: Found) -> None:
    raise InputError(
        f"{story.where}: `{story.step.text}` cannot be played: an ADS wants the speed with which it starts, and no "
        "step says which one it should want."
    )


def _ahead(story: Story, found: Found) -> None:
    story.other(found["npc"], new=True).ahead = story.value(found["value"], "m")


def _at_speed(story: Story, found: Found) -> None:
    other = story.other(found["npc"], new=True)
    other.speed = other.last_speed = story.value(found["value"], "m/s")


def _stands_ahead(story: Story, found: Found) -> None:
    _ahead(story, found)
    story.others[found["npc"]].speed = "0"


def _at_the_side(story: Story, found: Found) -> None:
    other = story.other(found["npc"], new=True)
    other.side = 1
    if story.outline.column("parking_offset") is None:
        raise InputError(f"{story.where}: how far to the side {other.name} is needs a column `parking_offset`.")
    story.used.add("parking_offset")
    if found["npc"] == "Npc0" and story.outline.column("d_npc") is not None:
        other.ahead = story.value("<d_npc>", "m")


def _parked(story: Story, found: Found) -> None:
    _at_the_side(story, found)
    other = story.others[found["npc"]]
    column = story.outline.column(f"vxi_{found['npc'].lower()}")
    if column is not None and any(column.values):
        raise must_be(f"`{column.name}`", story.where, f"0, as {other.name} is parked", max(column.values))
    if column is not None:
        story.used.add(column.name)
    other.speed = "0"


def _parked_further(story: Story, found: Found) -> None:
    if found["npc"] == found["npc2"]:
        raise InputError(f"{story.where}: {found['npc']} cannot be ahead of itself, as `{story.step.text}` says.")
    _parked(story, found)
    other = story.others[found["npc"]]
    other.side, other.ahead, other.after = -1, story.value(found["value"], "m"), found["npc2"]
    story.other(found["npc2"])


def _next_lane_behind(story: Story, found: Found) -> None:
    other = story.other(found["npc"], new=True)
    other.next_lane = other.behind = True
    other.speed = other.last_speed = story.value(found["value"], "m/s")


# -- When: what others do ----------------------------------------------------------------------------------------------


def _comes_close(story: Story, found: Found) -> None:
    if "npc" in found:
        story.other(found["npc"])
    story.unclear = f"`{story.step.text}` has no number"


def _is_near(story: Story, found: Found) -> None:
    story.waits = f"gap(ego, {story.other(found['npc']).name}) < {story.value(found['value'], 'm')}"


def _decelerates(story: Story, found: Found) -> None:
    other = story.other(found["npc"])
    target, rate = story.value(found["value"], "m/s"), story.value(found["value2"], "m/s2")
    story.act(other, {"do": "accelerate", "speed": target, "acceleration": f"abs({rate})"})
    other.last_speed = target


def _leaves_lane(story: Story, found: Found) -> None:
    other = story.other(found["npc"])
    if not other.walks:
        raise InputError(f"{story.where}: how {other.name} moves out of the lane is not said.")
    story.act(other, {"do": "accelerate", "speed": WALKING, "acceleration": 8.0})
    out = f"-(0.5 * lane_width + {CLEAR + 0.25})"
    other.moves.append({"do": "brake", "name": "stop", "when": f"y({other.name}) < {out}", "deceleration": 3.0})
    story.waits = f"ended({other.name}, stop)"


def _passes(story: Story, found: Found) -> None:
    story.other(found["npc"])
    for place in ("value", "value2"):
        if place in found:
            story.value(found[place], "m/s")


def _cuts_in(story: Story, found: Found) -> None:
    other = story.other(found["npc"])
    if not other.next_lane:
        raise InputError(f"{story.where}: {other.name} is not in the neighbor lane, so it cannot cut in.")
    story.waits = f"gap(ego, {other.name}) >= {story.value(found['value'], 'm')}"
    story.act(other, {"do": "change_lane", "offset": "-lane_width", "duration": CHANGE_TIME})
    other.to_lane = True


# -- Then: what the ego must do ----------------------------------------------------------------------------------------


def _slows_down(story: Story, found: Found) -> None:
    """It has lost speed; after somebody whom it follows has slowed down, less than that one had before."""
    braked = [it for it in story.others.values() if it.moves and it.last_speed not in (None, it.speed)]
    before = braked[-1].speed if braked else story.ego_speed
    story.require(f"min(speed) < {before} - {LOSES}")


def _stops(story: Story, found: Found) -> None:
    story.require(f"min(speed) < {STANDS}")
    story.waits, story.stops = f"speed(ego) < {STANDS}", True


def _matches(story: Story, found: Found) -> None:
    """At some moment; after the last `When`, at the end."""
    other = story.other(found["npc"])
    taken = "at_end" if story.step.line > story.last else "min"
    story.require(f"{taken}(abs(speed - speed({other.name}))) <= {SAME}")
    story.waits = f"abs(speed(ego) - speed({other.name})) < {SAME}"


def _arrives(story: Story, found: Found) -> None:
    if "without collision" not in story.step.text:
        story.require("reached_end == 1")
        return
    story.require("reached_end == 1 and collided == 0")


def _no_collision(story: Story, found: Found) -> None:
    story.require("collided == 0")


def _no_stop(story: Story, found: Found) -> None:
    story.require(f"min(speed) > {STANDS}")


def _resumes(story: Story, found: Found) -> None:
    story.require(f"at_end(speed) > {STANDS}")


def _brakes_less(story: Story, found: Found) -> None:
    story.require(f"min(acceleration) >= {story.value(found['value'], 'm/s2')} - {ROUNDING}")


def _brakes_less_after(story: Story, found: Found) -> None:
    other = story.other(found["npc"])
    if not other.to_lane:
        raise InputError(f"{story.where}: {other.name} changes no lane, but `{story.step.text}` asks for after it did.")
    least = story.value(found["value"], "m/s2")
    story.require(f"min(where(abs(y({other.name})) < 0.1, acceleration, 0)) >= {least} - {ROUNDING}")


def _gap(story: Story, found: Found) -> None:
    story.require(f"min(gap) >= {story.value(found['value'], 'm')} - {ROUNDING}")


def _offset(story: Story, found: Found) -> None:
    story.require(f"max(abs(offset)) <= {story.value(found['value'], 'm')} + {ROUNDING}")


def _overtakes(story: Story, found: Found) -> None:
    names = [story.other(found[place]).name for place in ("npc", "npc2") if place in found]
    story.require(" and ".join(f"at_end(x - x({name})) > 0" for name in names))


def _keeps_speed(story: Story, found: Found) -> None:
    other, least = story.other(found["npc"]), story.value(found["value"], "m/s")
    slow = f"speed({other.name}) <= {other.last_speed} + 0.01"
    story.require(f"min(where({slow}, speed, 1000)) >= {float(found['percent']) / 100.0!r} * {least} - {ROUNDING}")


SENTENCES = (
    Sentence(
        "given", "Ego <<drives|is driving>> at [a constant <<speed|velocity>> ]VALUE[, centered on its lane]",
        _ego_drives,
    ),
    Sentence("given", "Ego is in standstill", _ego_stands),
    Sentence("given", "NPC drives on the same lane as Ego, VALUE ahead of it", _ahead),
    Sentence("given", "NPC drives slower than Ego, at a speed of VALUE", _at_speed),
    Sentence("given", "NPC is driving in the same direction as Ego with velocity VALUE", _at_speed),
    Sentence("given", "NPC is standing still on the same lane as Ego, at a distance of VALUE", _stands_ahead),
    Sentence("given", "NPC is positioned on the side of the same lane", _at_the_side),
    Sentence("given", "NPC is parked on one side of the same lane", _parked),
    Sentence("given", "NPC is parked on the other side of the same lane, VALUE ahead of NPC2", _parked_further),
    Sentence("given", "NPC is in a neighbor lane behind Ego, driving at VALUE", _next_lane_behind),
    Sentence("when", "Ego gets close to NPC", _comes_close),
    Sentence("when", "Ego approaches NPC", _comes_close),
    Sentence("when", "Ego approaches the parked vehicles", _comes_close),
    Sentence("when", "the longitudinal distance between Ego and NPC is below VALUE", _is_near),
    Sentence("when", "NPC starts decelerating to VALUE with a rate of VALUE2", _decelerates),
    Sentence("when", "NPC decelerates to VALUE with acceleration VALUE2", _decelerates),
    Sentence("when", "NPC moves completely out of Ego's lane", _leaves_lane),
    Sentence("when", "NPC overtakes Ego[ with VALUE which is greater than VALUE2]", _passes),
    Sentence(
        "when",
        "NPC [overtakes Ego and ]performs a lane change to cut in front of Ego at a distance of VALUE[ from Ego]",
        _cuts_in,
    ),
    Sentence("then", "Ego <<starts decelerating[ further]|slows down>>", _slows_down),
    Sentence("then", "Ego starts decelerating to a full stop", _stops),
    Sentence("then", "Ego matches NPC's longitudinal speed", _matches),
    Sentence("then", "Ego reaches the <<goal position|goal|destination>>[ without collision[s]]", _arrives),
    Sentence("then", "Ego drives [safely ]with no collision[s] at all times", _no_collision),
    Sentence("then", "Ego drives continuously (no full stops) at all times", _no_stop),
    Sentence("then", "Ego resumes driving", _resumes),
    Sentence("then", "Ego keeps its acceleration above VALUE[ at all times]", _brakes_less),
    Sentence("then", "Ego does not decelerate at a rate below VALUE[ <<during driving|at all times>>]", _brakes_less),
    Sentence("then", "Ego does not decelerate at a rate below VALUE after NPC changed lane", _brakes_less_after),
    Sentence("then", "Ego keeps its gap above VALUE[ at all times]", _gap),
    Sentence("then", "Ego keeps its offset within VALUE[ at all times]", _offset),
    Sentence("then", "Ego overtake[s] NPC", _overtakes),
    Sentence("then", "Ego navigates between NPC and NPC2", _overtakes),
    Sentence("then", "Ego velocity does not fall below PERCENT of VALUE after NPC slows down", _keeps_speed),
)  # fmt: skip
"""Every sentence that is understood. `[...]`: may be left out; `<<a|b>>`: one of them; VALUE: `<column>` or `30 m`;
NPC: Npc0, Pedestrian1, ..."""
