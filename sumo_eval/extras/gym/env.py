"""The environments of `gymnasium.make` and `make_vec`: single episodes, or parallel ones in one
process.

Users: gymnasium, with which `extras/gym/__init__.py` registers both by their import paths.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from sumo_eval.cosim.doors.features import Action, Feature, Interface
from sumo_eval.errors import must_be
from sumo_eval.extras.gym.episodes import TERMINAL, Episodes, Floats
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.trajectory import BoolArray

Info = dict[str, Any]
"""Values by name, as in gymnasium's `options` and `info`."""


def _spaces(interface: Interface) -> tuple[Box, gymnasium.Space[Any]]:
    """The spaces of the features and of the actions."""
    choices = Discrete(interface.width)
    actions = _box(interface.actions) if interface.choices is None else choices
    return _box(interface.features), actions


def _box(scaled: Sequence[Feature | Action]) -> Box:
    """The space of scaled values: -1..1 of each with a range, else all numbers."""
    largest = np.array([np.inf if it.low is None else 1.0 for it in scaled], np.float32)
    return Box(-largest, largest, dtype=np.float32)


def _answers(interface: Interface, actions: Any, count: int) -> Floats:
    """Actions of the action space as answers of a policy, (count, width).

    A choice becomes the score 1 of the chosen action and 0 of all other actions.

    count: number of episodes.
    """
    width = interface.width
    values = np.empty(0, object)
    with suppress(ValueError):  # rows of different lengths: refused below
        values = np.asarray(actions)
    kind = values.dtype.kind  # numpy's letters: b bool, i and u integers, f floats
    if interface.choices is None:
        # axes of length 1 may be left out or added; other shapes would mix up the episodes
        expected = tuple(length for length in (count, width) if length > 1)
        if kind in "biuf" and values.squeeze().shape == expected:
            return values.reshape(count, -1).astype(np.float64)
        got = values.shape if kind in "biuf" else actions
        raise must_be("The actions", "an environment", f"{count} x {width} numbers", got)
    whole = values.size == count and kind in "iu"
    if whole and 0 <= values.min() <= values.max() < width:
        return np.eye(width)[values.ravel()]
    must = f"whole numbers from 0 to {width - 1}, {count} in all"
    raise must_be("The actions", "an environment", must, actions)


class ScenarioEnv(gymnasium.Env[Floats, Floats]):
    """Single cases of a logical scenario; arguments as of `Episodes`.

    interface: features and actions. `interface.to_toml()` is the table that `onnx:` needs with the
        model.

    `reset(options={"gap": 20.0})` sets parameters and draws the rest. `options={"sampler": f}`
    takes the point that `f(generator)` returns. The `info` of `reset` has the point (`values`), the
    `info` of the last step the `end_reason`.
    """

    metadata: Info = {"render_modes": []}  # noqa: RUF012 - gymnasium's own form

    def __init__(self, use: str | LogicalScenario, *, render_mode: None = None, **how: Any) -> None:
        self.render_mode = render_mode
        self.episodes = Episodes(use, 1, **how)
        self.interface = self.episodes.interface
        self.observation_space, self.action_space = _spaces(self.interface)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Floats, Info]:
        """Begin a case."""
        super().reset(seed=seed)
        self.episodes.begin(np.array([0]), [self.np_random], options or {})
        return self.episodes.show()[0], {"values": dict(self.episodes.rows.world.cases[0].values)}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, Info]:
        """One step, or the steps of one `period`."""
        if not self.episodes.rows.world.egos["live"][0]:
            raise gymnasium.error.ResetNeeded(
                "The episode is over; call reset before the next step."
            )
        (reward,), (reason,) = self.episodes.step(_answers(self.interface, action, 1))
        info = {"end_reason": str(reason)} if reason else {}
        terminated = reason in TERMINAL
        truncated = bool(reason) and not terminated
        return self.episodes.show()[0], float(reward), terminated, truncated, info

    def close(self) -> None:
        """End the simulation."""
        self.episodes.close()


class ScenarioVectorEnv(VectorEnv[Floats, Floats, Floats]):
    """`num_envs` parallel cases of a logical scenario; other arguments as of `Episodes`.

    interface: as of a `ScenarioEnv`.

    autoreset_mode: when a finished episode restarts. `NextStep`, gymnasium's usual: the next step
        gives the first observation of the new episode and reward 0. `SameStep`: the step that ends
        an episode gives the new one's first observation, and the last one in `final_obs` of
        `info`. `Disabled`: never.
    """

    def __init__(
        self, use: str | LogicalScenario, num_envs: int = 1, *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP, render_mode: None = None,
        **how: Any,
    ) -> None:  # fmt: skip
        self.render_mode, self.num_envs = render_mode, num_envs
        self.episodes = Episodes(use, num_envs, **how)
        self.interface = self.episodes.interface
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self.single_observation_space, self.single_action_space = _spaces(self.interface)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator] = []
        self._over = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: Info | None = None
    ) -> tuple[Floats, Info]:
        """Begin a case in every environment, or in those of `options["reset_mask"]`.

        seed: a list with a seed for each environment; of a number, environment i receives seed + i.
            Without a seed, and where the list has None, its present generator continues.
        """
        options = dict(options or {})
        mask = options.pop("reset_mask", np.ones(self.num_envs, bool))
        if np.shape(mask) != (self.num_envs,) or getattr(mask, "dtype", None) != np.bool_:
            must = f"{self.num_envs} truth values in an array"
            raise must_be("`reset_mask`", "the options of reset", must, mask)
        self._seed(seed, mask)
        self.episodes.begin(np.flatnonzero(mask), self._generators, options)
        self._over[mask] = False
        return self.episodes.show(), {
            "values": np.array([dict(it.values) for it in self.episodes.rows.world.cases])
        }

    def _seed(self, seed: int | list[int | None] | None, begun: BoolArray) -> None:
        """Make a generator for each environment that begins with a seed; all others keep theirs.

        begun: whether each environment begins, (n,); the first time all do.
        """
        present = self._generators
        if seed is None:
            if present:
                return
            seed = int(self.np_random.integers(2**31))
        seeds = seed if isinstance(seed, list) else range(seed, seed + self.num_envs)
        if len(seeds) != self.num_envs:
            raise must_be("`seed`", "reset", f"one number, or {self.num_envs}", seed)
        self._generators = [
            present[row]
            if present and (own is None or not begun[row])
            else np.random.default_rng(own)
            for row, own in enumerate(seeds)
        ]

    def step(self, actions: Floats) -> tuple[Floats, Floats, BoolArray, BoolArray, Info]:
        """One step of all, or the steps of one `period`."""
        answers = _answers(self.interface, actions, self.num_envs)
        # Episodes that ended with the last step: their actions do not count, and they restart
        # below. With SAME_STEP there are none, because `_over` stays False.
        ended_before = self._over
        if ended_before.any():
            if self._mode is AutoresetMode.DISABLED:
                raise gymnasium.error.ResetNeeded(
                    "Some episodes are over; reset them with `reset_mask` first."
                )
            answers = np.where(ended_before[:, None], 0.0, answers)
        rewards, reasons = self.episodes.step(answers)
        over = reasons != ""
        info = {}
        if over.any():
            # a copy, because `reset` changes `_over`
            info = {"end_reason": reasons, "_end_reason": over.copy()}
        # The step has not moved episodes that were over. They restart after it, so that they show
        # their first observation.
        self.episodes.begin(np.flatnonzero(ended_before), self._generators, {})
        observations = self.episodes.show()
        if self._mode is AutoresetMode.SAME_STEP and over.any():
            info["final_obs"], info["_final_obs"] = observations, over
            self.episodes.begin(np.flatnonzero(over), self._generators, {})
            observations = self.episodes.show()
        else:
            self._over = over
        terminated = np.isin(reasons, TERMINAL)
        return observations, rewards, terminated, over & ~terminated, info

    def close_extras(self, **kwargs: Any) -> None:
        """End the simulation."""
        self.episodes.close()
