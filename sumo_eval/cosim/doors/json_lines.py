"""`exec:COMMAND`: an ADS in any language, a program that reads observations and writes commands,
one JSON text a line.

The protocol, version 1 (docs/ads/exec.md), must stay as it is for users' programs. For every line
that the harness writes to the program's stdin, the program writes one line to its stdout:

- {"type": "reset", "protocol": 1, "step": s, "vehicle": {...}, "road": {...}, ...}; the answer is
  any JSON object.
- {"type": "step", "time": s, "ego": {...}, "lead": ..., ...}; the answer is {"acceleration": m/s2,
  "steering": rad}, or a speed, pedals or a plan.

The end of the input ends the case. One program serves one case.

Users: `record/watch.py`; `cosim/doors/controller.py` finds `JsonLinesProgram` by name (`DOORS`).
"""

from __future__ import annotations

import json
import os
import select
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

from sumo_eval.cosim.doors.child_program import ChildProgram, checked_command
from sumo_eval.cosim.doors.controller import Adapter, Briefing
from sumo_eval.cosim.doors.observation import Observation, lane_borders
from sumo_eval.cosim.doors.traci_numbers import shown
from sumo_eval.cosim.plans import Plan
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.errors import ControllerError, ControllerTimeoutError
from sumo_eval.scenario.concrete import Road

_Message = dict[str, Any]  # a JSON object
PROTOCOL = 1
# s of wall time for a program's start and its answer to the reset; `step_timeout` if that is longer
START_TIMEOUT = 10.0
_OF_A_PLAN = ("time", "x", "y", "heading", "speed")


@dataclass(slots=True)
class JsonLinesProgram(Adapter):
    """A program that is asked once a step.

    log: its output on stderr, once it has ended.
    options: of its entry in the evaluation; the program receives them at the reset.
    """

    command: tuple[str, ...]
    folder: Path
    log: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    _program: Any = None  # a ChildProgram, from `reset` to `close`
    _stdin: int = -1  # its handles
    _stdout: int = -1
    _unread: bytes = b""  # of its output, beyond the last line
    _deadline: float = START_TIMEOUT  # s of wall time allowed for an answer
    _until: float = 0.0  # when that time is over, s on the monotonic clock
    is_policy = True

    @classmethod
    def from_command(cls, command: str, folder: Path) -> JsonLinesProgram:
        """A program of this command. Raises InputError for a command that cannot be run."""
        return cls(checked_command(command, folder, "exec"), folder)

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Start the program and brief it."""
        self.log = ""
        self._unread = b""
        self._program = ChildProgram(self.command, self.folder, talks=True)
        process = self._program.process
        self._stdin, self._stdout = process.stdin.fileno(), process.stdout.fileno()
        # a write must not block for ever if a program reads nothing and the pipe is full
        os.set_blocking(self._stdin, False)
        self._deadline = max(START_TIMEOUT, scenario.step_timeout)
        self._ask(_reset_message(scenario, self.options))
        self._deadline = scenario.step_timeout

    def act(self, seen: Observation) -> Any:
        """Send the observation, and read the request. Raises ControllerError if the last answer had
        more than one line.
        """
        if self._unread or select.select([self._stdout], [], [], 0.0)[0]:
            more = self._unread or self._read()
            raise ControllerError(f"The ADS must answer with one line, got more: {more[:200]!r}")
        return _request(self._ask({"type": "step", **seen.plain()}))

    def close(self) -> None:
        """End of input, then the end of the program."""
        if self._program is not None:
            self.log = self._program.stop()
            self._program = None

    def _ask(self, message: _Message) -> _Message:
        """Send a message, and return the program's answer to it."""
        self._until = monotonic() + self._deadline
        self._send(json.dumps(message, separators=(",", ":")).encode() + b"\n")
        while b"\n" not in self._unread:
            self._wait([self._stdout], [])
            self._unread += self._read()
        line, _, self._unread = self._unread.partition(b"\n")
        return _json_object(line.decode("utf-8", errors="replace"))

    def _send(self, text: bytes) -> None:
        """Write a line to the program, in as many parts as its pipe takes."""
        try:
            while text:
                self._wait([], [self._stdin])
                text = text[os.write(self._stdin, text) :]
        except BrokenPipeError:
            raise self._program.ended("input") from None

    def _wait(self, to_read: list[int], to_write: list[int]) -> None:
        """Wait until a handle can be read, or written; end the program at its deadline."""
        remaining = self._until - monotonic()
        timeout = None if remaining == float("inf") else remaining
        if remaining <= 0.0 or not any(select.select(to_read, to_write, [], timeout)):
            self._program.kill()
            got = "nothing (it must flush its output after every line)"
            if self._unread:
                got = f"{self._unread[:200]!r} without an end of line"
            raise ControllerTimeoutError(
                f"The ADS's program must answer within {self._deadline:g} s, got {got}, and was "
                "ended"
            )

    def _read(self) -> bytes:
        """The next bytes of the program's output, at least one."""
        chunk = os.read(self._stdout, 65536)
        if not chunk:
            raise self._program.ended("output")
        return chunk


def _json_object(line: str) -> _Message:
    """A line of the program's output as a JSON object."""
    try:
        answer = json.loads(line)
    except (ValueError, RecursionError):
        answer = None
    if not isinstance(answer, dict):
        raise ControllerError(
            f"The ADS must answer with a JSON object on one line, got {line[:200]!r}"
        )
    return answer


def _road_message(road: Road) -> _Message:
    """The road of the message of the reset."""
    return {
        "lanes": road.lanes, "lane_width": road.lane_width, "length": road.length,
        "speed_limit": road.speed_limit,
        "line": [asdict(piece) for piece in road.line],
        "lane_borders": [line._asdict() for line in lane_borders(road)],
    }  # fmt: skip


def _reset_message(scenario: Briefing, options: Mapping[str, Any]) -> _Message:
    """The briefing as the message of the reset."""
    message: _Message = {
        "type": "reset", "protocol": PROTOCOL, "step": scenario.step, "period": scenario.period,
        "vehicle": asdict(scenario.vehicle), "road": _road_message(scenario.road),
        "desired_speed": scenario.desired_speed,
        "goal": scenario.goal, "change": scenario.change,
    }  # fmt: skip
    if options:
        message["options"] = options
    if scenario.values is not None:
        message |= {"scenario": scenario.scenario, "values": dict(scenario.values)}
    return message


def _request(answer: _Message) -> Any:
    """The request that an answer of the ADS holds: a command or a plan."""
    kind = next((name for name in _ANSWERS if name in answer), "acceleration")
    names, make = _ANSWERS[kind]
    _refuse_other_names(answer, names, "answer")
    if kind not in answer or (kind == "speed" and answer[kind] is None):
        raise ControllerError(
            "Without a `speed`, a `throttle`, a `brake` or a `plan` the ADS's answer must have an "
            f"`acceleration`, got {json.dumps(answer)}"
        )
    return make(**answer)


def _plan(plan: Any) -> Any:
    """A plan of an answer; null (None): the plan in force holds."""
    if plan is None:
        return None
    if not isinstance(plan, dict):
        raise ControllerError(
            f"The ADS's `plan` must be an object of lists, or null, got {shown(plan)}"
        )
    _refuse_other_names(plan, _OF_A_PLAN, "plan")
    return Plan(*(plan.get(name) for name in _OF_A_PLAN))


_ANSWERS: dict[str, tuple[tuple[str, ...], Callable[..., Any]]] = {
    "acceleration": (("acceleration", "steering"), Command),
    "speed": (("speed", "steering"), Command),
    "throttle": (("throttle", "brake", "steer"), Command.pedals),
    "brake": (("throttle", "brake", "steer"), Command.pedals),
    "plan": (("plan",), _plan),
}
"""Required name of each kind of answer -> all names allowed in it, and the function that makes a
request of the values."""


def _refuse_other_names(answer: _Message, names: tuple[str, ...], what: str) -> None:
    """Raise ControllerError if a JSON object has names other than these.

    what: the object, for the message.
    """
    for name in answer:
        if name not in names:
            known = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
            raise ControllerError(f"The ADS's {what} has an unknown `{name}`, and not only {known}")
