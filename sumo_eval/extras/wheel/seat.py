"""The driver's seat: a controller that keeps real time, shows the driver every state, and takes
the input of hands and feet.

The harness's own loop asks it as it asks any ADS. It answers when the step is due by the clock, so
a step lasts as long as it does outside; a step that is late changes how the drive feels, never its
result: that depends on the commands alone, which are on the tape.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import Any, NamedTuple

from sumo_eval.cosim.doors.observation import Observation
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.extras.wheel.hands import RELEASED, Given, Hands
from sumo_eval.extras.wheel.tape import LeftTheWheelError, Player, Writer, with_quit
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording

STALL = 0.1  # s that a step may be late before the clock is reset: time must not jump
GLANCE = 0.005  # s between two looks whether a drive that is held may continue
# s without a step, or without an answer of the window, from which a drive is held
ASLEEP = 2.0
PATIENCE = 900.0  # s for which a drive waits for a driver who has gone away


class Input(NamedTuple):
    """The page's last message: its number, the state that was seen when it was made, and the input
    of hands and feet.
    """

    number: int = 0
    seen: int = -1
    given: Given = RELEASED


def awake() -> float:
    """Time by a clock that runs while the machine sleeps and cannot be set, s."""
    which = getattr(clock, "CLOCK_BOOTTIME", getattr(clock, "CLOCK_MONOTONIC", None))
    return clock.perf_counter() if which is None else clock.clock_gettime(which)


class Desk:
    """State shared by seat and browser.

    Single assignments only, which two threads may make without a lock.
    """

    def __init__(self) -> None:
        self.newest = Input()
        self.holds = "start"  # why the drive waits; empty: it continues
        self.held = ""  # why it was held since the seat last looked, also where it continues
        self.leaves = ""  # why the drive is to end; empty: it is not
        self.due = 0.0  # by the clock, when a drive that was held continues

    def leave(self, why: str) -> None:
        """End the drive; the first reason counts."""
        self.leaves = self.leaves or why

    def hold(self, why: str) -> None:
        """Hold the drive, all keys and pedals released; the first reason counts."""
        self.holds = self.holds or why
        self.newest = self.newest._replace(given=RELEASED)


class Seat:
    """A person who controls the ego.

    show: takes every state, from another thread;
    held: why the seat itself holds the drive, `asleep` (the machine stood still) or `silent` (the
        window does not answer).
    paced: by the clock; else each step waits for an answer to the state that it begins with.
    """

    def __init__(
        self, desk: Desk, hands: Hands, step: float, writer: Writer,
        show: Callable[[list[Any]], None], held: Callable[[str], None], *, paced: bool = True,
    ) -> None:  # fmt: skip
        self._desk, self._hands, self._step = desk, hands, step
        self._writer, self._show = writer, show
        self._held, self._paced = held, paced
        self._tick, self._start = 0, 0.0
        # step and time (`awake`) at which the drive last continued; of the last step
        self._since, self._awake = 0, 0.0
        self.left = ""
        self.late: list[float] = []
        # steps between the state that was answered and the one the answer moved
        self.behind: list[int] = []

    def act(self, seen: Observation) -> Command:
        """Show the state, wait until the step is due, and take the newest input then."""
        answered = self._desk.newest.number
        self._show(state_of(self._tick, answered, self._hands.angle, seen))
        late = self._wait() if self._paced else self._wait_for_answer()
        if self._desk.leaves:
            self.left = self._desk.leaves
            raise LeftTheWheelError(self.left)
        it = self._desk.newest
        command = self._hands.command(it.given, seen.ego.speed)
        self._writer.line(
            (command.acceleration, command.steering, it.seen, *it.given, round(late, 6))
        )
        self.late.append(late)
        self.behind.append(self._tick - it.seen)
        self._tick += 1
        return command

    def _wait_for_answer(self) -> float:
        desk, begun = self._desk, clock.perf_counter()
        while (self._waits() or desk.newest.seen < self._tick) and not desk.leaves:
            if self._waits():
                self._hold()
                begun = clock.perf_counter()
            self._lose_patience(begun)
            clock.sleep(0.0005)
        return 0.0

    def _wait(self) -> float:
        """Wait until the step is due; how late it is then, s."""
        desk = self._desk
        while True:
            if self._waits():
                self._hold()
            due = self._start + self._tick * self._step
            clock.sleep(max(due - clock.perf_counter(), 0.0))
            if awake() - self._awake > ASLEEP:
                self._fall("asleep")
            elif (self._tick - max(desk.newest.seen, self._since)) * self._step > ASLEEP:
                self._fall("silent")
            else:
                break
            if desk.leaves:
                break
        self._awake = awake()
        late = max(clock.perf_counter() - due, 0.0)
        if late > STALL:
            self._writer.note(self._tick, "stall", seconds=round(late, 4))
            self._start += late
        return late

    def _waits(self) -> bool:
        """Whether the drive is held, is counted down, or has not begun."""
        desk = self._desk
        return bool(desk.holds or desk.held) or not self._awake or clock.perf_counter() < desk.due

    def _lose_patience(self, begun: float) -> None:
        if clock.perf_counter() - begun > PATIENCE:
            self._desk.leave(f"No answer came for {PATIENCE:g} s.")

    def _fall(self, why: str) -> None:
        """Hold the drive, because the driver cannot control the ego; they continue it."""
        self._desk.hold(why)
        self._held(why)

    def _hold(self) -> None:
        """Wait until the drive may continue; nothing moves meanwhile."""
        desk, begun = self._desk, clock.perf_counter()
        why = desk.held or desk.holds or ("key" if self._tick else "start")
        self._awake = awake()
        while (desk.holds or clock.perf_counter() < desk.due) and not desk.leaves:
            self._lose_patience(begun)
            clock.sleep(GLANCE)
            if awake() - self._awake > ASLEEP and not desk.holds:  # in the countdown
                self._fall("asleep")
            self._awake = awake()
        desk.held = ""
        now = clock.perf_counter()
        if why != "start":
            self._writer.note(self._tick, "pause", why=why, seconds=round(now - begun, 3))
        self._start, self._since = now - self._tick * self._step, self._tick


def state_of(tick: int, answered: int, angle: float, seen: Observation) -> list[Any]:
    """A state as the page receives it: step, time, the input that it holds, the ego, and the actors
    by number.
    """
    ego = seen.ego
    actors = sorted(seen.vehicles, key=lambda it: it.number)
    return [
        tick, round(seen.time, 6), answered,
        [ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, angle],
        [[it.number, it.x, it.y, it.heading, it.speed, it.acceleration] for it in actors],
    ]  # fmt: skip


def drive_person(
    concrete: ConcreteScenario, settings: SimulationSettings, desk: Desk, writer: Writer,
    show: Callable[[list[Any]], None], held: Callable[[str], None], *, paced: bool = True,
) -> tuple[Recording, Seat]:  # fmt: skip
    """Let a person drive a concrete scenario; the recording has all that any ADS's has."""
    hands = Hands(concrete.ego_vehicle(settings.vehicle), settings.step)
    seat = Seat(desk, hands, settings.step, writer, show, held, paced=paced)
    return with_quit(simulate(concrete, seat, settings), seat.left), seat


def warm_up(concrete: ConcreteScenario, settings: SimulationSettings) -> None:
    """Load, and where needed compile, the needs of a drive: its first step must not be late."""
    simulate(concrete, Player([(0.0, 1e-6)] * 2), settings)
