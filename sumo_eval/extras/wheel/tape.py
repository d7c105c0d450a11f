"""The tape of a drive: the command of every step, as it was given.

Whoever drives it again gets the same bytes.

A tape is a text file, a JSON value a line: a head, a row for each step, notes in between, and what
came of it. A line is written when its step is driven, so a machine that goes down loses a step and
no drive.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, TextIO

from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import ControllerError, InputError, must_be, said
from sumo_eval.input_file import read_input_text
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings, VehicleSettings
from sumo_eval.trajectory import CHANNELS, Recording

FORMAT = 1
OWN_WISH = "quit"  # why a drive was left, where the driver wished it
ROW = ("acceleration", "steering", "seen", "kind", "keys", "steer", "throttle", "brake", "late")
"""Of a step: the command, m/s2 and rad; the state that the driver had seen; what hands and feet
did; lateness, s."""


class LeftTheWheelError(ControllerError):
    """Whoever drives has ended the drive: by their own wish, or because nobody is there any
    more.
    """


@dataclass(frozen=True, slots=True)
class Tape:
    """head: what was driven and with what.
    rows: of `ROW`, a step each.
    notes: pauses and what else happened, by step.
    came_of_it: end reason, digest and qualities; None where the machine went down before the end.
    """

    head: Mapping[str, Any]
    rows: tuple[tuple[Any, ...], ...]
    notes: tuple[Mapping[str, Any], ...]
    came_of_it: Mapping[str, Any] | None


class Writer:
    """A tape that is being written."""

    def __init__(self, path: Path, head: Mapping[str, Any]) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: TextIO = path.open("x", encoding="utf-8")
        except OSError as error:
            raise InputError(f"The drive cannot be kept in {path}: {said(error)}.") from error
        self.path = path
        self._line({"format": FORMAT, **head})

    def row(self, row: tuple[Any, ...]) -> None:
        """A step."""
        self._line(row)

    def note(self, step: int, what: str, **more: Any) -> None:
        """Something that happened before a step."""
        self._line({"note": what, "step": step, **more})

    def end(self, came_of_it: Mapping[str, Any]) -> None:
        """The drive is over."""
        self._line({"end": dict(came_of_it)})
        self.close()

    def close(self) -> None:
        """Close the tape: no command follows."""
        self._file.close()

    def _line(self, value: Any) -> None:
        self._file.write(json.dumps(value, separators=(",", ":"), allow_nan=False) + "\n")
        self._file.flush()


def json_lines(path: Path, what: str) -> list[Any]:
    """The value of each line; a last one that was cut off was not written.

    what: names the file in sentences.
    """
    lines = read_input_text(path, what).split("\n")
    values = []
    for number, line in enumerate(lines, 1):
        try:
            values.append(json.loads(line))
        except ValueError as error:
            # the empty one behind the last line break, or one that was cut off
            if number == len(lines):
                break
            raise InputError(f"Line {number} of {path} cannot be read: {said(error)}.") from error
    return values


def read_tape(path: Path) -> Tape:
    """A tape.

    Raises InputError naming file and line; a last line that was cut off in its middle is no fault.
    """
    values = json_lines(path, "tape")
    if not values or not isinstance(values[0], dict) or values[0].get("format") != FORMAT:
        raise InputError(f"{path} is no tape of a drive of format {FORMAT}.")
    rows, notes, end = [], [], None
    for number, value in enumerate(values[1:], 2):
        if (
            isinstance(value, list)
            and len(value) == len(ROW)
            and all(_finite(it) for it in value[:2])
        ):
            rows.append(tuple(value))
        elif isinstance(value, dict) and "note" in value:
            notes.append(value)
        elif isinstance(value, dict) and isinstance(value.get("end"), dict):
            end = value["end"]
        else:
            raise must_be(
                f"Line {number}", str(path), "a step, a note or the end of a drive", value
            )
    return Tape(values[0], tuple(rows), tuple(notes), end)


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def settings_of(head: Mapping[str, Any]) -> SimulationSettings:
    """The settings that a drive was simulated with, from the head of its tape."""
    try:
        given = dict(head["simulation"])
        return SimulationSettings(**{**given, "vehicle": VehicleSettings(**given["vehicle"])})
    except (KeyError, TypeError, InputError) as error:
        raise InputError(
            f"The tape's head names no simulation that can be driven: {said(error)}."
        ) from error


def head_of(
    concrete: ConcreteScenario, settings: SimulationSettings, **more: Any
) -> dict[str, Any]:
    """The head of a tape that begins now: enough to drive it again."""
    plain = (
        "step",
        "record_interval",
        "time_limit",
        "standstill_speed",
        "standstill_time",
        "lane_change_duration",
    )
    return {
        "scenario": concrete.scenario,
        "values": dict(concrete.values),
        "simulation": {
            **{name: getattr(settings, name) for name in plain},
            "vehicle": asdict(settings.vehicle),
        },
        **more,
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {**{name: version(name) for name in ("sumo_eval", "libsumo")},
            "python": sys.version.split()[0]},
    }  # fmt: skip


class Player:
    """Commands, (acceleration, steering) a step, in place of a driver.

    left: they ended before the drive did.
    """

    def __init__(self, commands: Iterable[Sequence[float]]) -> None:
        self._commands = iter(commands)
        self.left = ""

    def act(self, seen: object) -> Command:
        """The next command; behind the last the drive is left, as it was."""
        row = next(self._commands, None)
        if row is None:
            self.left = OWN_WISH
            raise LeftTheWheelError("The tape is over")
        return Command(*row)


def drive_again(tape: Tape, concrete: ConcreteScenario) -> Recording:
    """The drive of a tape's commands in its concrete scenario."""
    player = Player(row[:2] for row in tape.rows)
    recording = simulate(concrete, player, settings_of(tape.head))
    return with_quit(recording, player.left)


def with_quit(recording: Recording, left: str) -> Recording:
    """The recording of a drive that was left has the end reason `quit`, which no ADS under test can
    give itself; the error says why, where it was not the driver's own wish.

    left: why; empty: the drive came to its end.
    """
    if not left:
        return recording
    return replace(
        recording, end_reason="quit", error=None if left == OWN_WISH else left, error_place=""
    )


def digest(recording: Recording) -> str:
    """SHA-256 of every vehicle's every sample, of the contact and of how the drive ended."""
    found = hashlib.sha256()
    for name, it in sorted({"ego": recording.ego, **recording.actors}.items()):
        found.update(f"{name} {it.length!r} {it.width!r} {len(it)}".encode())
        for channel in CHANNELS:
            found.update(getattr(it, channel).tobytes())
    found.update(f"{recording.collision!r} {recording.end_reason}".encode())
    return found.hexdigest()
