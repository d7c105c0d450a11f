"""Parallel episodes of a logical scenario, for both environments of `env`: their start, reward and
end.

Users: `extras/gym/__init__.py`, `extras/gym/env.py`.
"""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from sumo_eval.cosim.doors.entry import steps_between
from sumo_eval.cosim.doors.features import Interface, read_interface, usual
from sumo_eval.cosim.doors.observation import Observations
from sumo_eval.cosim.episode_rows import EpisodeRows
from sumo_eval.errors import InputError, must_be, said
from sumo_eval.input_file import working_folder
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.resolved import find_with
from sumo_eval.scenario.touch import Body, velocity
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import BoolArray, IntArray

Floats = NDArray[Any]
Point = Mapping[str, float]
Sampler = Callable[[Generator], Point]

TERMINAL = ("contact", "off_road", "road_end", "standstill")
"""Ends that the drive itself brings (gymnasium's `terminated`). Others, such as `time_limit` and
`step_limit`, cut an episode short (`truncated`).
"""
_TRIES = 10_000  # points drawn at most to find one that satisfies the constraints
_REASON = "U16"  # numpy's type of end reasons: texts of up to 16 characters


class Transition(NamedTuple):
    """One step of the simulation for n episodes, arrays (n,).

    seen: observations after the step.
    command: commanded acceleration, m/s2, and steering wheel angle, rad, (n, 2).
    speed, acceleration, jerk: of the ego after the step, m/s, m/s2, m/s3.
    start_speed: of the ego at the start of its episode, m/s.
    running: False for episodes that were over before the step.
    ended: why an episode ended with this step, "" otherwise.
    impact: relative speed of both bodies at a contact, m/s; 0 without a contact.
    step: length of the step, s.
    """

    seen: Observations
    command: Floats
    speed: Floats
    acceleration: Floats
    jerk: Floats
    start_speed: Floats
    running: BoolArray
    ended: NDArray[Any]
    impact: Floats
    step: float


Reward = Callable[[Transition], Floats]

COMFORTABLE = 3.0  # m/s2; a second at this acceleration costs 0.1
COMFORTABLE_JERK = 15.0  # m/s3; a second at this jerk costs 0.01
CONTACT_COSTS, IMPACT_COSTS = 20.0, 2.0  # a contact, and each m/s of its impact
DEPARTURE_COSTS = 20.0  # leaving the road


def usual_reward(transition: Transition) -> Floats:
    """Reward (n,) for progress, comfort and no collision: a second at the speed of the start is
    worth 1.

    It stands for the parts of S+ = T A' (a + b H) that a single step can show: progress for T,
    contacts and departures from the road for A', comfort for H. S+ itself needs the references of
    an evaluation.

    A second costs (acceleration / 3 m/s2)^2 / 10 + (jerk / 15 m/s3)^2 / 100. A contact costs 20,
    and 2 more for each m/s of its impact. Leaving the road costs 20.
    """
    progress = np.minimum(transition.speed / np.maximum(transition.start_speed, 1.0), 1.0)
    discomfort = (
        0.1 * (transition.acceleration / COMFORTABLE) ** 2
        + 0.01 * (transition.jerk / COMFORTABLE_JERK) ** 2
    )
    worth = (progress - discomfort) * transition.step
    contact = CONTACT_COSTS + IMPACT_COSTS * transition.impact
    worth -= np.where(transition.ended == "contact", contact, 0.0)
    worth -= np.where(transition.ended == "off_road", DEPARTURE_COSTS, 0.0)
    return worth


class Episodes:
    """n parallel episodes of one logical scenario.

    use: a shipped scenario's name, a scenario file, `module:name`, or a LogicalScenario.
    count: number of episodes, n.
    interface: features and actions, or their file; None: the usual ones.
    reward: function that gives the reward (n,) of a `Transition`; None: `usual_reward`.
    sampler: draws a point from a random generator; None: evenly over the space.
    settings: of the simulation; None: the defaults.
    steering: whether the usual interface has steering.
    sumo: True: SUMO steps the actors, as in an evaluation, with one simulation in a process.
        False: the actors follow their scripts, with any number of simulations in a process.
    max_episode_steps: calls of `step` after which `step_limit` ends an episode; None: no limit.
    """

    def __init__(
        self, use: str | LogicalScenario, count: int, *,
        interface: Interface | str | Path | None = None,
        reward: Reward | None = None, sampler: Sampler | None = None,
        settings: SimulationSettings | None = None,
        steering: bool = False, sumo: bool = False, max_episode_steps: int | None = None,
    ) -> None:  # fmt: skip
        if count < 1:
            raise must_be("`num_envs`", "an environment", "at least 1", count)
        if max_episode_steps is not None and max_episode_steps < 1:
            raise must_be("`max_episode_steps`", "an environment", "at least 1", max_episode_steps)
        if isinstance(interface, str | Path):
            interface = read_interface(Path(interface))
        self.interface = interface or usual(steering=steering)
        self.settings = settings or SimulationSettings()
        # these come from a user's own code
        for name, kind in (("interface", Interface), ("settings", SimulationSettings)):
            if not isinstance(value := getattr(self, name), kind):
                raise must_be(f"`{name}`", "an environment", f"of {kind.__name__}", value)
        if not isinstance(use, LogicalScenario):
            use = find_with(self.settings.vehicle, str(use), working_folder())
        self.logical = use
        self.reward = reward or usual_reward
        self.sampler = sampler
        self.count, self._sumo = count, sumo
        self._rows: EpisodeRows | None = None
        self._start_speeds = np.zeros(count)  # m/s
        # limit and number of the calls of `step` in each episode
        self._limit, self._calls = max_episode_steps, np.zeros(count, int)
        # simulation steps in a call of `step`
        self._steps = steps_between(
            self.interface.period or 0.0, self.settings.step, "the interface"
        )

    def begin(
        self, rows: IntArray, generators: list[Generator], options: Mapping[str, Any]
    ) -> None:
        """Restart episodes, each at a point drawn by its generator. The first call begins all.

        rows: indices of the episodes.
        generators: of all episodes.
        options: see `point`.
        """
        if self._rows is None:
            rows = np.arange(self.count)
        cases = [
            self.logical.concrete(**self.point(generators[row], options)) for row in rows.tolist()
        ]
        if self._rows is None:
            self._rows = EpisodeRows(cases, self.settings, sumo=self._sumo)
        else:
            for row, concrete in zip(rows.tolist(), cases, strict=True):
                self._rows.restart(row, concrete)
        self._start_speeds[rows] = [concrete.ego.speed for concrete in cases]
        self._calls[rows] = 0

    def point(self, generator: Generator, options: Mapping[str, Any]) -> dict[str, float]:
        """A point of the space: parameter -> value.

        A parameter that neither the options nor the sampler set is drawn from its range.

        options: values of parameters by name. `sampler`: instead of that of the environment.
        """
        set_values = dict(options)
        sampler = set_values.pop("sampler", self.sampler)
        for name, value in set_values.items():
            self.logical.column(name)  # raises InputError for an unknown parameter
            if isinstance(value, bool) or not isinstance(value, int | float | np.number):
                raise must_be(f"`{name}`", "the options of reset", "a number", value)
        if sampler is not None:
            set_values = _sampled(sampler, generator) | set_values
        values = {name: float(value) for name, value in set_values.items()}
        free = [item for item in self.logical.parameters if item.name not in values]
        if not free:
            return values
        for _ in range(_TRIES):
            for item in free:
                values[item.name] = float(
                    item.values[generator.integers(len(item.values))]
                    if item.values
                    else generator.uniform(item.low, item.high)
                )
            if self.logical.feasible([[values[name] for name in self.logical.names]])[0]:
                return values
        raise InputError(
            f"No point of scenario `{self.logical.name}` with these options satisfies its "
            "constraints."
        )

    @property
    def rows(self) -> EpisodeRows:
        """The batch whose rows are the episodes."""
        if self._rows is None:
            raise InputError("An environment must be reset before its first step.")
        return self._rows

    def close(self) -> None:
        """End the simulation; the next `begin` starts a new simulation."""
        if self._rows is not None:
            self._rows.close()
            self._rows = None

    def show(self) -> NDArray[np.float32]:
        """Features for the policies, (n, number of features)."""
        return self.interface.show(self.rows.observations())

    def step(self, answers: Floats) -> tuple[Floats, NDArray[Any]]:
        """The steps of one period of the interface, with the same commands in each.

        answers: of the policies, (n, width).
        Returns the sums of the rewards, (n,), and why episodes ended, (n,), "" otherwise.
        """
        commands = self.interface.commands(answers)
        if not np.isfinite(commands).all():
            raise must_be("The actions", "an environment", "finite numbers", answers)
        rewards = np.zeros(self.count)
        reasons = np.full(self.count, "", _REASON)
        for _ in range(self._steps):
            transition = self._transition(commands)
            rewards += self._reward(transition)
            reasons = np.where(transition.ended == "", reasons, transition.ended)

        self._calls += 1
        if self._limit is not None:
            egos = self.rows.world.egos
            at_limit = (self._calls >= self._limit) & (egos["live"] != 0)
            egos["live"][at_limit] = 0
            reasons[at_limit] = "step_limit"
        return rewards, reasons

    def _transition(self, commands: Floats) -> Transition:
        """One step of the simulation.

        commands: accelerations, m/s2, and steering wheel angles, rad, (n, 2).
        """
        rows = self.rows
        egos = rows.world.egos
        running = egos["live"] != 0
        before = egos["acceleration"].copy()
        ended = np.full(self.count, "", _REASON)
        impact = np.zeros(self.count)
        for row in rows.step(commands).tolist():  # indices of the rows that ended with this step
            ended[row] = rows.reason(row)
            if ended[row] == "contact":
                impact[row] = self._impact(row)
        # copies: a reward may change and keep what it receives
        return Transition(
            seen=rows.observations(), command=commands.copy(), speed=egos["speed"].copy(),
            acceleration=egos["acceleration"].copy(),
            jerk=(egos["acceleration"] - before) / rows.world.settings.step,
            start_speed=self._start_speeds.copy(), running=running, ended=ended, impact=impact,
            step=rows.world.settings.step,
        )  # fmt: skip

    def _reward(self, transition: Transition) -> Floats:
        """The user's reward of a step, checked, and 0 for episodes that were over."""
        answer = self.reward(transition)
        with suppress(TypeError, ValueError):  # not numbers, or a wrong shape: refused below
            # "same_kind" raises TypeError for complex numbers, texts and objects
            numbers = np.asarray(answer).astype(np.float64, casting="same_kind")
            rewards = np.where(transition.running, numbers, 0.0)
            if numbers.shape in ((), transition.running.shape) and np.isfinite(rewards).all():
                return rewards
        raise must_be(
            "The reward",
            "an environment",
            f"a finite number for each of {self.count} episodes",
            answer,
        )

    def _impact(self, row: int) -> float:
        """Relative speed of the ego and the actor that it touches, m/s."""
        world = self.rows.world
        both = world.egos[row], world.others[row, world.egos["struck"][row]]
        # the first 7 fields of both records are those of a body
        return math.dist(*(velocity(Body(*vehicle.tolist()[:7])) for vehicle in both))


def _sampled(sampler: Any, generator: Generator) -> dict[str, float]:
    """A user's point: parameter -> value."""
    if not callable(sampler):
        raise must_be("`sampler`", "an environment", "a function of a random generator", sampler)
    try:
        return {str(name): float(value) for name, value in sampler(generator).items()}
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"The sampler must give a number for each parameter by name: {said(error)}."
        ) from error
