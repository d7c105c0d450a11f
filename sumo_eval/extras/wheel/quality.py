"""How good a drive by a person is as a measurement: dropped pictures, pauses, road left, when they
first reacted.

What is measured is about the drive as a recording, not about driving well: a drive is left out by a
stated rule, and the rule, the value and its bound go on record with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from sumo_eval.extras.wheel.tape import ROW, Tape, settings_of
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import VehicleSettings
from sumo_eval.settings.checked import About, Checked, NotNegative
from sumo_eval.trajectory import Recording

# m/s2 of braking beyond what the pedals gave before the event from which a person has reacted
BRAKES = 0.5
STEERS = 0.35  # m/s2 of acceleration across the road
SEEN = ROW.index("seen")


@dataclass(frozen=True, slots=True)
class QualitySettings(Checked):
    """From which quality a drive counts."""

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
    contact: Annotated[bool, About("a drive with a contact counts as skilled driving")] = False


@dataclass(frozen=True, slots=True)
class Quality:
    """One drive.

    dropped: share of pictures that came late, None where the page told of none.
    latency_ms: 95th percentile from input to picture.
    stalls, pauses: how often the loop, or the person, held.
    reaction: s from the first event to the first answer, None without either.
    unanswered: the longest that the drive went on without an answer of the window, s.
    stepped_down: how often the page drew more cheaply by itself while the drive went on (plainly,
        with fewer pixels, from above).
    drawn: how the road was drawn, in words. The last three are None on a tape that does not tell.
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

    def plain(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)

    def sentences(self) -> list[str]:
        """In words, for the participant."""
        said = []
        if self.reaction is not None:
            said.append(f"You answered the first event after {self.reaction:.2f} s.")
        if self.latency_ms is not None:
            said.append(f"From input to picture: 95 % within {self.latency_ms:.0f} ms.")
        if self.dropped:
            said.append(f"{100.0 * self.dropped:.0f} % of the pictures came late.")
        if self.stepped_down:
            said.append(
                "The road was drawn more cheaply from some moment on, because pictures came too "
                "late."
            )
        if self.pauses:
            often = "once" if self.pauses == 1 else f"{self.pauses} times"
            said.append(f"The drive was held {often}, for {self.paused:.1f} s.")
        return said

    def against(self, rule: QualitySettings) -> tuple[str, ...]:
        """Why a drive does not count, a sentence for each bound that it breaks; none: it counts."""
        why = []
        for name, words in (("dropped", "share of late pictures"),
            ("latency_ms", "input to picture, 95 %, ms"),
                            ("stalls", "halts of the loop"), ("pauses", "pauses"),
                            ("unanswered", "no answer of the window, s"),
                            ("stepped_down", "times that the road was drawn more cheaply in "
                                             "mid-drive")):  # fmt: skip
            value, bound = getattr(self, name), getattr(rule, name)
            if value is not None and value > bound:
                why.append(f"{words} {value:.3g}, at most {bound:g}")
        for name, end, words in (("off_road", "off_road", "left the road"),
            ("quit", "quit", "ended before its end"),
                                 ("contact", "contact", "touched another vehicle")):  # fmt: skip
            if self.end == end and not getattr(rule, name):
                why.append(words)
        if self.end in ("sim_error", "ads_error", "ads_timeout"):
            why.append("a fault of the simulation")
        return tuple(why)


def quality_of(
    recording: Recording, tape: Tape, concrete: ConcreteScenario, time: Mapping[str, Any]
) -> Quality:
    """The quality of a drive, from what was recorded and what was measured of it in time
    (`window.timing`).
    """
    frames, pauses = time.get("frames") or 0, [it for it in tape.notes if it["note"] == "pause"]
    event, settings = first_event(concrete), settings_of(tape.head)
    vehicle = concrete.ego_vehicle(settings.vehicle)
    return Quality(
        end=recording.end_reason,
        dropped=time["dropped"] / frames if frames else None,
        latency_ms=time.get("input_to_picture_p95_ms"),
        stalls=sum(it["note"] == "stall" for it in tape.notes),
        pauses=len(pauses),
        paused=float(sum(it["seconds"] for it in pauses)),
        event=event,
        reaction=None if event is None else reaction(recording, event, vehicle),
        unanswered=round(
            max((k - row[SEEN] for k, row in enumerate(tape.rows)), default=0) * settings.step, 4
        ),
        stepped_down=time.get("stepped_down"),
        drawn=time.get("renderer"),
    )


def first_event(concrete: ConcreteScenario) -> float | None:
    """When the first of the others changes what it does, s; None where nobody does at a stated
    time.
    """
    begins = [act.begin for it in concrete.actors for act in it.acts if act.timed]
    return min((begin for begin in begins if np.isfinite(begin)), default=None)


def reaction(recording: Recording, event: float, vehicle: VehicleSettings) -> float | None:
    """From an event to the first braking or steering that was not there before it, s; None where
    there is none.

    Braking: 0.5 m/s2 below the acceleration at the event. Steering: 0.35 m/s2 across beyond that at
        the event, of the path that the steering wheel asks for, v^2 tan(angle / steering ratio) /
        wheelbase; so a bend of the road alone, on which nobody moves the wheel, is no answer.
    """
    ego = recording.ego
    if len(ego) < 3:
        return None
    across = (
        ego.speed**2 * np.tan(ego.steering_wheel_angle / vehicle.steering_ratio) / vehicle.wheelbase
    )
    before = int(np.searchsorted(ego.time, event + 1e-9, side="right")) - 1
    at = max(before, 0)
    after = ego.time > event + 1e-9
    braked = after & (ego.acceleration < min(float(ego.acceleration[at]), 0.0) - BRAKES)
    steered = after & (np.abs(across - across[at]) > STEERS)
    found = np.flatnonzero(braked | steered)
    return round(float(ego.time[found[0]] - event), 4) if found.size else None
