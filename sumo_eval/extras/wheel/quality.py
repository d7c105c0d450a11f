"""Quality of a person's drive as a measurement: late pictures, pauses, road left, reaction.

It is about the drive as a recording, not about driving well: a drive is left out by a stated rule,
and the rule, the value and its bound are recorded with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from sumo_eval.extras.wheel.tape import ROW, Tape, settings_of
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import VehicleSettings
from sumo_eval.settings.checked import About, Checked, NotNegative
from sumo_eval.trajectory import Recording

# A reaction is to brake or steer harder than at the event by more than:
BRAKES = 0.5  # m/s2; an ego that gains speed at the event brakes with 0
STEERS = 0.35  # m/s2 across the road
SEEN = ROW.index("seen")  # column with the number of the last step that the driver saw


@dataclass(frozen=True, slots=True)
class QualitySettings(Checked):
    """Bounds of quality within which a drive counts."""

    dropped: Annotated[
        float, NotNegative, Le(1.0), About("largest share of pictures that came late")
    ] = 0.2
    latency_ms: Annotated[
        float, NotNegative, About("largest 95th percentile from input to picture", "ms")
    ] = 150.0
    stalls: Annotated[int, Ge(0), About("most halts of the loop itself, which the driver felt")] = 2
    pauses: Annotated[int, Ge(0), About("most times that the drive was held")] = 1
    unanswered: Annotated[
        float, NotNegative, About("longest that the window did not answer", "s")
    ] = 1.0
    stepped_down: Annotated[
        int, Ge(0), About("most times that the road was drawn more cheaply from then on")
    ] = 0
    off_road: Annotated[bool, About("a drive that left the road counts")] = False
    quit: Annotated[bool, About("a drive that was ended before its end counts")] = False
    contact: Annotated[bool, About("a drive with a contact counts")] = False


@dataclass(frozen=True)
class Quality:
    """One drive.

    dropped: share of pictures that came late, None where the page sent no figures.
    latency_ms: 95th percentile from input to picture.
    stalls: halts of the loop itself.
    pauses, paused: how often, and for how many s in all, the drive was held.
    event: time of the first event, s.
    reaction: s from the first event to the first answer, None without either.
    unanswered: the longest that the drive continued without an answer of the window, s.
    stepped_down: how often the page drew more cheaply by itself during the drive (plainly, with
        fewer pixels, from above).
    drawn: how the road was drawn, in words. The last three are None on a tape without them.
    """

    end: str
    dropped: float | None
    latency_ms: float | None
    stalls: int
    pauses: int
    paused: float
    event: float | None
    reaction: float | None
    unanswered: float | None = None
    stepped_down: int | None = None
    drawn: str | None = None

    def sentences(self) -> list[str]:
        """In words, for the participant."""
        words = []
        if self.reaction is not None:
            words.append(f"You answered the first event after {self.reaction:.2f} s.")
        if self.latency_ms is not None:
            words.append(f"From input to picture: 95 % within {self.latency_ms:.0f} ms.")
        if self.dropped:
            words.append(f"{100.0 * self.dropped:.0f} % of the pictures came late.")
        if self.stepped_down:
            words.append(
                "The road was drawn more cheaply from some moment on, because pictures came too "
                "late."
            )
        if self.pauses:
            often = "once" if self.pauses == 1 else f"{self.pauses} times"
            words.append(f"The drive was held {often}, for {self.paused:.1f} s.")
        return words

    def against(self, rule: QualitySettings) -> tuple[str, ...]:
        """Reasons why a drive does not count, a sentence for each bound that it breaks; none: it
        counts.
        """
        why = []
        for name, words in (
            ("dropped", "share of late pictures"),
            ("latency_ms", "input to picture, 95 %, ms"),
            ("stalls", "halts of the loop"),
            ("pauses", "pauses"),
            ("unanswered", "no answer of the window, s"),
            ("stepped_down", "times that the road was drawn more cheaply in mid-drive"),
        ):
            value, bound = getattr(self, name), getattr(rule, name)
            if value is not None and value > bound:
                why.append(f"{words} {value:.3g}, at most {bound:g}")
        ends = {
            "off_road": "left the road",
            "quit": "ended before its end",
            "contact": "touched another vehicle",
        }
        if self.end in ends and not getattr(rule, self.end):
            why.append(ends[self.end])
        if self.end in ("sim_error", "ads_error", "ads_timeout"):
            why.append("a fault of the simulation")
        return tuple(why)


def quality_of(
    recording: Recording, tape: Tape, concrete: ConcreteScenario, time: Mapping[str, Any]
) -> Quality:
    """The quality of a drive, from its recording and its figures in time (`window.timing`)."""
    pauses = [it["seconds"] for it in tape.notes if it["note"] == "pause"]
    event, settings = first_event(concrete), settings_of(tape.head)
    vehicle = concrete.ego_vehicle(settings.vehicle)
    # steps by which the driver's picture was behind the drive
    behind = max((step - row[SEEN] for step, row in enumerate(tape.rows)), default=0)
    return Quality(
        end=recording.end_reason,
        dropped=time["dropped"] / time["frames"] if time.get("frames") else None,
        latency_ms=time.get("input_to_picture_p95_ms"),
        stalls=sum(it["note"] == "stall" for it in tape.notes),
        pauses=len(pauses),
        paused=float(sum(pauses)),
        event=event,
        reaction=None if event is None else reaction(recording, event, vehicle),
        unanswered=round(behind * settings.step, 4),
        stepped_down=time.get("stepped_down"),
        drawn=time.get("renderer"),
    )


def first_event(concrete: ConcreteScenario) -> float | None:
    """Time at which the first actor changes its motion, s; None: none does at a known time."""
    return min((act.begin for it in concrete.actors for act in it.acts if act.timed), default=None)


def reaction(recording: Recording, event: float, vehicle: VehicleSettings) -> float | None:
    """Time from an event to the first braking or steering that was not there before it, s; None
    without any.

    Braking: more than `BRAKES` below the acceleration at the event, or below 0 where that is
        positive: a driver who only releases the accelerator has not braked.
    Steering: the acceleration across the path that the steering wheel asks for, v^2 tan(angle /
        steering ratio) / wheelbase, differs by more than `STEERS` from that at the event. A curve
        of the road alone, without a move of the wheel, does not count.
    """
    ego = recording.ego
    if len(ego) < 3:
        return None
    across = (
        ego.speed**2 * np.tan(ego.steering_wheel_angle / vehicle.steering_ratio) / vehicle.wheelbase
    )
    at = max(int(np.searchsorted(ego.time, event + 1e-9, side="right")) - 1, 0)
    braked = ego.acceleration < min(ego.acceleration[at], 0.0) - BRAKES
    steered = np.abs(across - across[at]) > STEERS
    answers = np.flatnonzero((ego.time > event + 1e-9) & (braked | steered))
    return round(float(ego.time[answers[0]] - event), 4) if answers.size else None
