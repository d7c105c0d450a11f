"""Quality of the recording of a person's drive: late pictures, pauses, leaving the road, reaction.

It does not say whether the person drives well. A study leaves a drive out if it breaks a bound of
`QualitySettings`, and records value and bound, or if the simulation failed. `trip` computes the
quality of each drive, `outcome` compares it with the bounds.

Users: `extras/wheel/outcome.py`, `extras/wheel/plan.py`, `extras/wheel/trip.py`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.extras.wheel.tape import ROW, Tape
from sumo_eval.frozen import frozen
from sumo_eval.report.page import Json
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.played import COSINE, SPEED
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.settings.checked import Checked, Natural, NotNegativeFloat, Share, setting
from sumo_eval.trajectory import Recording

# by how much a reaction brakes or steers harder than at the event, at least
BRAKES = 0.5  # m/s2
STEERS = 0.35  # m/s2 across the road
SEEN, LATE = ROW.index("seen"), ROW.index("late")  # columns of a tape's row


@frozen
class QualitySettings(Checked):
    """Bounds of quality within which a drive counts."""

    dropped: Share = setting(0.2, "largest share of pictures that came late")
    latency_ms: NotNegativeFloat = setting(
        150.0, "largest 95th percentile from input to picture", "ms"
    )
    stalls: Natural = setting(2, "most steps so late that the clock was reset")
    pauses: Natural = setting(1, "most times that the drive was held")
    unanswered: NotNegativeFloat = setting(1.0, "longest that the window did not answer", "s")
    stepped_down: Natural = setting(0, "most changes to a cheaper drawing during the drive")
    off_road: bool = setting(False, "a drive that left the road counts")
    quit: bool = setting(False, "a drive that was ended before its end counts")
    contact: bool = setting(False, "a drive with a contact counts")


_BOUNDED = {
    "dropped": "share of late pictures",
    "latency_ms": "input to picture, 95 %, ms",
    "stalls": "steps so late that the clock was reset",
    "pauses": "pauses",
    "unanswered": "no answer of the window, s",
    "stepped_down": "times that the road was drawn more cheaply in mid-drive",
}
"""Numbers of a `Quality` that `QualitySettings` bounds, in words."""
_ENDS = {
    "off_road": "left the road",
    "quit": "ended before its end",
    "contact": "touched another vehicle",
}
"""Ends of a drive that does not count unless `QualitySettings` allows it, in words."""


@dataclass(frozen=True)
class Quality:
    """Quality of one drive.

    end: reason why the drive ended.
    dropped: share of pictures that came late; None: the page sent no figures.
    latency_ms: 95th percentile of the time from input to picture; None: no input was timed.
    stalls: steps so late that the clock was reset.
    pauses, paused: how often, and for how many s in all, the drive was on hold.
    event: time of the first event, s, as by `first_event`.
    reaction: time from that event to the driver's reaction, s; None without an event or a reaction.
    unanswered: longest time that the drive continued without an answer of the window, s.
    stepped_down: number of changes to a cheaper drawing during the drive: to a plainer one, to one
        of fewer pixels, to one from above; None: the page sent no figures.
    drawn: how the road was drawn, in words; None: the page sent no figures.
    """

    end: str
    dropped: float | None
    latency_ms: float | None
    stalls: int
    pauses: int
    paused: float
    event: float | None
    reaction: float | None
    unanswered: float
    stepped_down: int | None
    drawn: str | None

    def sentences(self) -> Iterator[str]:
        """The quality in words, for the driver."""
        if self.reaction is not None:
            yield f"You answered the first event after {self.reaction:.2f} s."
        if self.latency_ms is not None:
            yield f"From input to picture: 95 % within {self.latency_ms:.0f} ms."
        if self.dropped:
            yield f"{100.0 * self.dropped:.0f} % of the pictures came late."
        if self.stepped_down:
            yield (
                "The road was drawn more cheaply from some moment on, because pictures came too "
                "late."
            )
        if self.pauses:
            often = "once" if self.pauses == 1 else f"{self.pauses} times"
            yield f"The drive was held {often}, for {self.paused:.1f} s."

    def against(self, rule: QualitySettings) -> tuple[str, ...]:
        """Reasons why the drive does not count: one for each broken bound, and a fault of the
        simulation; empty: it counts.
        """
        why = []
        for name, words in _BOUNDED.items():
            value, bound = getattr(self, name), getattr(rule, name)
            if value is not None and value > bound:
                why.append(f"{words} {value:.3g}, at most {bound:g}")
        if self.end in _ENDS and not getattr(rule, self.end):
            why.append(_ENDS[self.end])
        if self.end in ("sim_error", "ads_error", "ads_timeout"):
            why.append("a fault of the simulation")
        return tuple(why)


def timing(tape: Tape, tellings: Sequence[Json]) -> Json:
    """Figures of a drive in time, for its tape; None where nothing was measured.

    tellings: figures that the page sent, as `messages.Telling`.
    """
    late = [round(1000.0 * row[LATE], 3) for row in tape.rows]  # ms
    latency = [value for it in tellings for value in it["latency"]]
    return {
        "steps": len(tape.rows),
        "late_p50_ms": _quantile(late, 0.5), "late_p95_ms": _quantile(late, 0.95),
        "late_max_ms": max(late, default=None),
        "input_to_picture_p50_ms": _quantile(latency, 0.5),
        "input_to_picture_p95_ms": _quantile(latency, 0.95),
        "inputs_timed": len(latency),
        "frames": sum(it["frames"] for it in tellings),
        "dropped": sum(it["dropped"] for it in tellings),
        "stepped_down": sum(it["stepped"] for it in tellings) if tellings else None,
        "behind_p95_steps": _quantile(_steps_behind(tape), 0.95),
        "resolution": tellings[-1]["resolution"] if tellings else None,
        # all that were used, in order, each once
        "renderer": ", then ".join(dict.fromkeys(it["renderer"] for it in tellings)) or None
    }  # fmt: skip


def _quantile(values: Sequence[float], share: float) -> float | None:
    return round(float(np.quantile(values, share)), 4) if values else None


def _steps_behind(tape: Tape) -> list[int]:
    """Age of the state that the driver had seen at each step, in steps."""
    return [step - row[SEEN] for step, row in enumerate(tape.rows)]


def quality_of(
    recording: Recording,
    tape: Tape,
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    figures: Json,
) -> Quality:
    """The quality of a drive; figures: of `timing`."""
    pauses = [it["seconds"] for it in tape.notes if it["note"] == "pause"]
    event = first_event(concrete)
    return Quality(
        end=recording.end_reason,
        dropped=figures["dropped"] / figures["frames"] if figures["frames"] else None,
        latency_ms=figures["input_to_picture_p95_ms"],
        stalls=sum(it["note"] == "stall" for it in tape.notes),
        pauses=len(pauses),
        paused=float(sum(pauses)),
        event=event,
        reaction=None if event is None else reaction(recording, event, settings.vehicle),
        unanswered=round(max(_steps_behind(tape), default=0) * settings.step, 4),
        stepped_down=figures["stepped_down"],
        drawn=figures["renderer"],
    )


def first_event(concrete: ConcreteScenario) -> float | None:
    """Time at which the first actor moves across the road or changes its speed, s; None: no actor
    does so at a time that its script states.
    """
    begins = (
        act.begin
        for actor in concrete.actors
        for act in actor.acts
        if not act.program and act.begin < math.inf and (act.kind <= COSINE or act.kind == SPEED)
    )
    return min(begins, default=None)


def reaction(recording: Recording, event: float, vehicle: VehicleSettings) -> float | None:
    """Time from an event to the first reaction, s; None: the driver does not react.

    event: its time, s.

    A reaction brakes or steers:

    Braking: the acceleration is more than `BRAKES` below its value at the event. Where that value
        is above 0, it is more than `BRAKES` below 0: releasing the accelerator is not braking.
    Steering: the lateral acceleration that the steering wheel asks for, speed^2 tan(angle /
        steering ratio) / wheelbase, differs by more than `STEERS` from its value at the event. A
        curve of the road does not count while the wheel does not move.
    """
    ego = recording.ego
    if len(ego) < 3:
        return None
    across = (
        ego.speed**2 * np.tan(ego.steering_wheel_angle / vehicle.steering_ratio) / vehicle.wheelbase
    )
    # index of the last sample up to the event; 1e-9 s is a rounding
    at = max(int(np.searchsorted(ego.time, event + 1e-9, side="right")) - 1, 0)
    braked = ego.acceleration < min(ego.acceleration[at], 0.0) - BRAKES
    steered = np.abs(across - across[at]) > STEERS
    answers = np.flatnonzero((ego.time > event + 1e-9) & (braked | steered))
    return round(float(ego.time[answers[0]] - event), 4) if answers.size else None
