"""The driver's seat: a controller that keeps real time, shows the driver every state, and takes
the input of hands and feet. `window` runs it in a thread.

The harness's loop asks it for a command each step, as it asks any ADS. It answers when the step is
due by the clock, so simulated time passes as fast as real time. A late step changes how the drive
feels, never its result: that depends on the commands alone, which are on the tape.

Users: `extras/wheel/messages.py`, `extras/wheel/window.py`.
"""

import time as clock
from collections.abc import Callable
from typing import Any, NamedTuple

from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.extras.wheel.hands import RELEASED, Given, Hands
from sumo_eval.extras.wheel.tape import LeftTheWheelError, Writer
from sumo_eval.settings import VehicleSettings

STALL = 0.1  # s: a step that is later than this resets the clock, so that time does not jump
GLANCE = 0.005  # s between two looks whether a drive on hold may continue
# s without a step, or without an answer of the window, after which a drive is put on hold
ASLEEP = 2.0
PATIENCE = 900.0  # s for which a drive waits for a driver who has gone away


class Input(NamedTuple):
    """The page's last message.

    number: of the message.
    seen: number of the state that the driver saw at the time of the message; -1: none yet.
    given: input of hands and feet.
    """

    number: int = 0
    seen: int = -1
    given: Given = RELEASED


def awake() -> float:
    """Time by a clock that also runs while the machine sleeps, and that cannot be set, s."""
    # Linux has the first; on macOS the second counts sleep
    which = getattr(clock, "CLOCK_BOOTTIME", getattr(clock, "CLOCK_MONOTONIC", None))
    return clock.perf_counter() if which is None else clock.clock_gettime(which)


class Desk:
    """State of a drive that `Seat` and `Window` share.

    newest: the latest input of the page.
    on_hold: reason why the drive is on hold; empty: it is not.
    was_held: reason why the drive was put on hold since the seat last looked, even if it no longer
        is on hold; empty: it was not.
    end_reason: reason why the drive must end; empty: it continues.
    due: when the countdown after a hold is over, by `perf_counter`, s.

    Two threads use a desk without a lock, because an attribute is read or set in one step.
    """

    def __init__(self) -> None:
        self.newest = Input()
        self.on_hold = self.was_held = "start"
        self.end_reason = ""
        self.due = 0.0

    def end(self, why: str) -> None:
        """End the drive; the first reason counts."""
        self.end_reason = self.end_reason or why

    def hold(self, why: str) -> None:
        """Put the drive on hold, all keys and pedals released; the first reason counts."""
        self.on_hold = self.was_held = self.on_hold or why
        self.newest = self.newest._replace(given=RELEASED)


class Seat:
    """A person who controls the ego.

    step: of the simulation, s.
    post: sends the page a message under a key; called in the thread of the drive. Key `state`: the
        state of each step. Key `held`: why the seat puts the drive on hold, `asleep` (the machine
        slept) or `silent` (the window does not answer).
    left: why the drive was ended early; empty: it was not.
    """

    def __init__(
        self, desk: Desk, vehicle: VehicleSettings, step: float, writer: Writer,
        post: Callable[[str, Any], None],
    ) -> None:  # fmt: skip
        self._desk, self._hands, self._step = desk, Hands(vehicle, step), step
        self._writer, self._post = writer, post
        self._tick = 0  # number of the step
        self._start = 0.0  # when step 0 was due, by `perf_counter`; pauses move it
        self._resumed = 0  # step at which the drive last continued
        self._awake = 0.0  # time of the last step, by `awake`
        self.left = ""

    def act(self, seen: Observation) -> Command:
        """Show the state, wait until the step is due, and take the newest input then."""
        self._post("state", state_of(self._tick, self._desk.newest.number, self._hands.angle, seen))
        late = self._wait_until_due()
        if self._desk.end_reason:
            self.left = self._desk.end_reason
            raise LeftTheWheelError(self.left)
        it = self._desk.newest
        command = self._hands.command(it.given, seen.ego.speed)
        self._writer.line(
            (command.acceleration, command.steering, it.seen, *it.given, round(late, 6))
        )
        self._tick += 1
        return command

    def _wait_until_due(self) -> float:
        """Wait until the step is due; return how late it is then, s."""
        desk = self._desk
        while True:
            # on hold, put on hold since the last look, or in the countdown
            if desk.on_hold or desk.was_held or clock.perf_counter() < desk.due:
                self._stay_on_hold()
            due = self._start + self._tick * self._step
            clock.sleep(max(due - clock.perf_counter(), 0.0))
            # steps since the last state that the driver saw, or since the drive continued
            unanswered = self._tick - max(desk.newest.seen, self._resumed)
            if awake() - self._awake > ASLEEP:
                self._put_on_hold("asleep")
            elif unanswered * self._step > ASLEEP:
                self._put_on_hold("silent")
            else:
                break
            if desk.end_reason:
                break
        self._awake = awake()
        late = max(clock.perf_counter() - due, 0.0)
        if late > STALL:
            self._writer.note(self._tick, "stall", seconds=round(late, 4))
            self._start += late
        return late

    def _put_on_hold(self, why: str) -> None:
        """Put the drive on hold because the driver cannot control the ego, and tell the page."""
        self._desk.hold(why)
        self._post("held", why)

    def _stay_on_hold(self) -> None:
        """Wait until the drive may continue; nothing moves meanwhile."""
        desk = self._desk
        begun = clock.perf_counter()
        why = desk.was_held or desk.on_hold or "key"  # "key": only the countdown is left
        self._awake = awake()
        while (desk.on_hold or clock.perf_counter() < desk.due) and not desk.end_reason:
            if clock.perf_counter() - begun > PATIENCE:
                desk.end(f"No answer came for {PATIENCE:g} s.")
            clock.sleep(GLANCE)
            if awake() - self._awake > ASLEEP and not desk.on_hold:  # in the countdown
                self._put_on_hold("asleep")
            self._awake = awake()
        desk.was_held = ""
        now = clock.perf_counter()
        if why != "start":
            self._writer.note(self._tick, "pause", why=why, seconds=round(now - begun, 3))
        self._start, self._resumed = now - self._tick * self._step, self._tick


def state_of(tick: int, answered: int, angle: float, seen: Observation) -> list[Any]:
    """A state as the page receives it.

    tick: number of the step.
    answered: number of the input that the state includes.
    angle: of the steering wheel, rad.
    """
    ego = seen.ego
    actors = sorted(seen.vehicles, key=lambda it: it.number)
    return [
        tick, round(seen.time, 6), answered,
        [ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, angle],
        [[it.number, it.x, it.y, it.heading, it.speed, it.acceleration] for it in actors]
    ]  # fmt: skip
