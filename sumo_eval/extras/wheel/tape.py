"""The tape of a person's drive: the commands of all steps. Repeated, they give the same recording,
byte for byte. `trip` and `study` make tapes. `outcome` and `sumo-eval drive TAPE.jsonl` repeat
them.

A tape is a text file with a JSON value on each line: a head, a row for each step, notes in between,
and the result. A row is written when its step is driven, so a crash of the machine loses at most
one step. Change nothing of this format, nor of the rows' columns, without another `FORMAT`.

Users: `extras/wheel/command.py`, `extras/wheel/outcome.py`, `extras/wheel/quality.py`,
`extras/wheel/seat.py`, `extras/wheel/study.py`, `extras/wheel/trip.py`, `extras/wheel/window.py`.
"""

import hashlib
import json
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from sumo_eval.cosim.doors.traci_numbers import finite_number
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import ControllerError, InputError, must_be, said
from sumo_eval.input_file import read_input_text, taking_apart, writing
from sumo_eval.report.page import Json
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.text import timestamp
from sumo_eval.trajectory import CHANNELS, Recording

FORMAT = 1
OWN_WISH = "quit"  # reason why a drive ended early: the driver's own wish
ROW = "acceleration", "steering", "seen", "kind", "keys", "steer", "throttle", "brake", "late"
"""Columns of a tape, a row for each step.

acceleration, steering: the command, m/s2 and rad.
seen: number of the state that the driver had seen.
kind, keys, steer, throttle, brake: the input, as in `hands.Given`.
late: time by which the step was late, s.
"""


class LeftTheWheelError(ControllerError):
    """The driver has ended the drive, by their own wish or by being away."""


class Tape(NamedTuple):
    """Content of a tape.

    head: scenario, values, settings and versions of the drive.
    rows: values of `ROW`, a row for each step.
    notes: pauses and stalls, each with its step.
    end: result of the drive, as `trip.one_drive` writes it; None: the tape breaks off before it.
    """

    head: Json
    rows: Sequence[tuple[Any, ...]]
    notes: Sequence[Json]
    end: Json | None


class Writer:
    """A tape that is being written."""

    def __init__(self, path: Path, head: Json) -> None:
        with writing(f"The drive in {path}", path.parent):
            self._file = path.open("x", encoding="utf-8")
        self.line({"format": FORMAT, **head})

    def line(self, value: Any) -> None:
        """Write a value as one line: the row of a step, or a head, note or end."""
        self._file.write(json.dumps(value, separators=(",", ":"), allow_nan=False) + "\n")
        self._file.flush()

    def note(self, step: int, what: str, **more: Any) -> None:
        """Write what happened before a step."""
        self.line({"note": what, "step": step, **more})

    def close(self) -> None:
        """Close the tape: no command follows."""
        self._file.close()


def json_lines(path: Path, what: str) -> list[Any]:
    """The value of each line of a file. A last line that was cut off is left out.

    what: noun for the file in error messages, as `tape`.
    """
    *lines, last = read_input_text(path, what).split("\n")
    if "\r" in last:
        raise InputError(f"Each line of {path} must end with LF, got CR.")
    values = []
    for number, line in enumerate(lines, 1):
        try:
            values.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            raise InputError(f"Line {number} of {path} cannot be read: {said(error)}.") from error
    # after the last line break: nothing, or a line that may be cut off
    with suppress(ValueError, RecursionError):
        values.append(json.loads(last))
    return values


def read_tape(path: Path) -> Tape:
    """A tape.

    Raises InputError that names file and line.
    """
    head, *values = json_lines(path, "tape") or [None]  # an empty file has no head
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise InputError(f"{path} must be a tape of a drive of format {FORMAT}.")
    rows = []
    notes = []
    end = None
    for number, value in enumerate(values, 2):
        # of a row only the command is checked: a repetition needs no more
        if (
            isinstance(value, list) and len(value) == len(ROW)
            and all(finite_number(part) is not None for part in value[:2])
        ):  # fmt: skip
            rows.append(tuple(value))
        elif isinstance(value, dict) and "note" in value:
            notes.append(value)
        elif isinstance(value, dict) and isinstance(value.get("end"), dict):
            end = value["end"]
        else:
            raise must_be(
                f"Line {number}", str(path), "a step, a note or the end of a drive", value
            )
    return Tape(head, rows, notes, end)


def settings_of(head: Json) -> SimulationSettings:
    """The settings of a drive, from the head of its tape."""
    try:
        simulation = dict(head["simulation"])
        vehicle = VehicleSettings(**simulation["vehicle"])
        return SimulationSettings(**{**simulation, "vehicle": vehicle})
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"The tape's head must name a simulation: {said(error)}.") from error


def head_of(concrete: ConcreteScenario, settings: SimulationSettings, **more: Any) -> Json:
    """The head of a tape that begins now.

    more: further entries. With `use`, the locator of the scenario, a tape can be repeated.
    """
    # In a person's drive all other settings have their defaults, or come from the scenario.
    written = (
        "step", "record_interval", "time_limit", "standstill_speed", "standstill_time",
        "lane_change_duration"
    )  # fmt: skip
    return {
        "scenario": concrete.scenario,
        "values": dict(concrete.values),
        "simulation": {
            **{name: getattr(settings, name) for name in written},
            "vehicle": asdict(settings.vehicle)
        },
        **more,
        "begun": timestamp(),
        "versions": {
            "sumo_eval": version("sumo_eval"), "libsumo": version("libsumo"),
            "python": sys.version.split()[0]
        }
    }  # fmt: skip


class Player:
    """A policy that gives recorded commands instead of a driver.

    commands: acceleration, m/s2, and steering wheel angle, rad, of each step.
    left: reason why the drive ended early; empty while it continues.
    """

    def __init__(self, commands: Iterable[Sequence[float]]) -> None:
        self._commands = iter(commands)
        self.left = ""

    def act(self, seen: object) -> Command:
        """The next command. After the last one the drive ends, as when the driver left it."""
        row = next(self._commands, None)
        if row is None:
            self.left = OWN_WISH
            raise LeftTheWheelError("The tape is over")
        return Command(*row)


def drive_again(tape: Tape, concrete: ConcreteScenario) -> Recording:
    """The drive of a tape's commands in the concrete scenario of the tape."""
    player = Player(row[:2] for row in tape.rows)
    return with_quit(simulate(concrete, player, settings_of(tape.head)), player.left)


def with_quit(recording: Recording, left: str) -> Recording:
    """The recording of a person's drive. If the driver left, its end reason is `quit`, which the
    drive of an ADS never has.

    left: reason why the driver left: `OWN_WISH`, or a fault, which becomes the recording's error.
        Empty: the driver did not leave.
    """
    if not left:
        return recording
    return replace(
        recording, end_reason="quit", error=None if left == OWN_WISH else left, error_place=""
    )


def digest(recording: Recording) -> str:
    """SHA-256 of all samples of all vehicles, of the contact and of the end reason.

    Tapes hold this digest, so a change of `CHANNELS` needs another `FORMAT`.
    """
    sha = hashlib.sha256()
    for name, vehicle in sorted({"ego": recording.ego, **recording.actors}.items()):
        sha.update(f"{name} {vehicle.length!r} {vehicle.width!r} {len(vehicle)}".encode())
        for channel in CHANNELS:
            sha.update(getattr(vehicle, channel).tobytes())
    sha.update(f"{recording.collision!r} {recording.end_reason}".encode())
    return sha.hexdigest()


class Repetition(NamedTuple):
    """Result of repeating a tape's drive.

    same: whether the recording has the same bytes; None: the tape breaks off before its result.
    sentence: the result in words.
    """

    same: bool | None
    sentence: str


def again(path: Path) -> Repetition:
    """Repeat the drive of a tape, and compare it with the digest that the tape holds.

    Raises InputError where the tape, or its scenario, cannot be used.
    """
    tape = read_tape(path)
    with taking_apart(path, "Its head must name a concrete scenario."):
        use = tape.head["use"]
        point = {name: float(value) for name, value in tape.head["values"].items()}
    recording = drive_again(tape, find(str(use), path.parent).concrete(**point))
    steps = f"{len(tape.rows)} steps of {tape.head['simulation']['step']:g} s"
    same = None if tape.end is None else digest(recording) == tape.end.get("digest")
    words = {
        None: "broke off: no bytes to compare with",
        True: "comes to the same bytes",
        False: f"comes to OTHER bytes; versions then: {tape.head.get('versions')}",
    }
    return Repetition(same, f"The tape of {steps} ({recording.end_reason}) {words[same]}.")
