"""A tape driven again: whether its commands still come to the same bytes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sumo_eval.errors import InputError, said
from sumo_eval.extras.wheel.tape import digest, drive_again, read_tape
from sumo_eval.scenario.catalogue import find
from sumo_eval.trajectory import Recording


@dataclass(frozen=True, slots=True)
class Again:
    """same: None where the tape broke off before what came of it was written."""

    same: bool | None
    recording: Recording
    sentence: str


def again(path: Path) -> Again:
    """Drive a tape again.

    Raises InputError where it, or its scenario, cannot be used.
    """
    tape = read_tape(path)
    try:
        use, values = (
            str(tape.head["use"]),
            {str(k): float(v) for k, v in tape.head["values"].items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"The head of {path} names no concrete scenario: {said(error)}."
        ) from error
    concrete = find(use, path.parent).concrete(**values)
    recording = drive_again(tape, concrete)
    steps = f"{len(tape.rows)} steps of {tape.head['simulation']['step']:g} s"
    if tape.came_of_it is None:
        return Again(
            None,
            recording,
            f"The tape of {steps} broke off; driven again, its drive ends by "
            f"{recording.end_reason}.",
        )
    same = digest(recording) == tape.came_of_it.get("digest")
    words = (
        "comes to the same bytes"
        if same
        else "comes to OTHER bytes; versions then: " + str(tape.head.get("versions"))
    )
    return Again(same, recording, f"The tape of {steps} ({recording.end_reason}) {words}.")
