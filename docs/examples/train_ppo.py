"""Train PPO of stable-baselines3 in a scenario, and write it as ONNX with its features table.

pip install '.[gym,onnx]' stable-baselines3 onnxscript
python train_ppo.py front_vehicle_cut_out ppo.onnx --minutes 5
sumo-eval run --ads onnx:ppo.onnx --ads idm --out results/ppo
"""

# ruff: noqa: E402 - missing packages are named before the first import of one

import argparse
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

NEEDED = ("gymnasium", "onnxruntime", "onnxscript", "stable_baselines3", "torch")
if missing := [name for name in NEEDED if find_spec(name) is None]:
    install = "pip install '.[gym,onnx]' stable-baselines3 onnxscript"
    sys.exit(f"Not installed: {', '.join(missing)}. {install} installs what the training needs.")

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from sumo_eval.gym import Action, Feature, Interface

INTERFACE = Interface(
    (
        Feature("ego.speed", 0.0, 40.0), Feature("ego.acceleration", -10.0, 10.0),
        Feature("lead.present", 0.0, 1.0),
        Feature("lead.gap", 0.0, 100.0), Feature("lead.relative_speed", -30.0, 30.0),
        Feature("vehicles.1.x", -50.0, 100.0), Feature("vehicles.1.y", -5.0, 5.0),
        Feature("vehicles.1.vx", -30.0, 30.0), Feature("vehicles.1.vy", -3.0, 3.0),
    ),
    # the same range on both sides: an untrained network, near 0, holds the speed
    (Action("acceleration", -9.0, 9.0),),
    period=0.1,
)  # fmt: skip
BESIDE, STEPS = 128, 128  # parallel episodes, steps of each between two updates


class Beside(VecEnv):
    """The vectorised environment of sumo_eval, as stable-baselines3 calls one."""

    def __init__(self, scenario, seed):
        self.env, self.start = (
            gymnasium.make_vec(
                f"sumo_eval/{scenario}-v0",
                num_envs=BESIDE,
                interface=INTERFACE,
                autoreset_mode=AutoresetMode.SAME_STEP,
            ),
            seed,
        )
        super().__init__(BESIDE, self.env.single_observation_space, self.env.single_action_space)

    def reset(self):
        return self.env.reset(seed=self.start)[0]

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        seen, worth, terminated, truncated, info = self.env.step(self.actions)
        infos = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(terminated | truncated):
            infos[row] = {
                "terminal_observation": info["final_obs"][row],
                "TimeLimit.truncated": bool(truncated[row]),
                "is_success": info["end_reason"][row] != "contact",
            }
        return seen, worth.astype(np.float32), terminated | truncated, infos

    def close(self):
        self.env.close()

    def get_attr(self, name, indices=None):
        return [getattr(self.env, name, None)] * self.num_envs

    def set_attr(self, name, value, indices=None):
        raise NotImplementedError

    def env_method(self, name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper, indices=None):
        return [False] * self.num_envs


class Until(BaseCallback):
    """Ends the learning after so many seconds of processor time."""

    def __init__(self, seconds):
        super().__init__()
        self.end = time.process_time() + seconds

    def _on_step(self):
        return time.process_time() < self.end


class Mean(torch.nn.Module):
    """What PPO's policy answers without its noise."""

    def __init__(self, policy):
        super().__init__()
        self.hidden, self.out = policy.mlp_extractor.policy_net, policy.action_net

    def forward(self, seen):
        return torch.clamp(self.out(self.hidden(seen)), -1.0, 1.0)


def untrained(scenario, seed=0):
    torch.set_num_threads(1)
    return PPO(
        "MlpPolicy", VecMonitor(Beside(scenario, seed)), n_steps=STEPS,
        batch_size=BESIDE * STEPS // 8, n_epochs=8, gamma=0.98, learning_rate=5e-4,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.0}, seed=seed, device="cpu",
    )  # fmt: skip


def train(scenario, seconds, steps=10**9, seed=0):
    """The network with the best mean return over the same 128 points, drawn from no training."""
    model, points = untrained(scenario, seed), VecMonitor(Beside(scenario, 10_000))
    with tempfile.TemporaryDirectory() as folder:
        evaluation = EvalCallback(
            points, n_eval_episodes=BESIDE, eval_freq=10 * STEPS, best_model_save_path=folder
        )
        model.learn(steps, callback=[evaluation, Until(seconds)])
        model.env.close()
        points.close()
        best = Path(folder, "best_model.zip")
        return PPO.load(best, device="cpu") if best.exists() else model


def write(model, path):
    """The network as ONNX, and its table beside it."""
    rows = torch.export.Dim("rows")
    torch.onnx.export(
        Mean(model.policy).eval(), (torch.zeros(2, len(INTERFACE.features)),), str(path),
        input_names=["seen"],
        output_names=["action"], dynamic_shapes=({0: rows},), dynamo=True, external_data=False,
    )  # fmt: skip
    path.with_suffix(".toml").write_text(INTERFACE.to_toml(), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("scenario")
    parser.add_argument("file", type=Path)
    parser.add_argument("--minutes", type=float, default=5.0, help="of processor time")
    parser.add_argument("--steps", type=int, default=2_000_000, help="at most")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    write(train(given.scenario, 60.0 * given.minutes, given.steps, given.seed), given.file)
