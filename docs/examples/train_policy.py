"""Train a small policy in a scenario with an evolution strategy, and write it as ONNX with its
features table.

    python train_policy.py front_vehicle_cut_out policy.onnx --minutes 2
    sumo-eval run --ads onnx:policy.onnx --ads idm --out results/learned

Every episode beside the others has weights of its own; numpy and gymnasium are all it takes (and
onnx to write it)."""

import argparse
import time
from pathlib import Path

import gymnasium
import numpy as np
import onnx
from gymnasium.vector import AutoresetMode
from onnx import TensorProto, helper, numpy_helper

from sumo_eval.gym import Action, Feature, Interface

INTERFACE = Interface(
    (
        Feature("ego.speed", 0.0, 40.0), Feature("ego.acceleration", -10.0, 10.0),
        Feature("lead.present", 0.0, 1.0),
        Feature("lead.gap", 0.0, 100.0), Feature("lead.relative_speed", -30.0, 30.0),
        Feature("vehicles.1.x", -50.0, 100.0), Feature("vehicles.1.y", -5.0, 5.0),
        Feature("vehicles.1.vx", -30.0, 30.0), Feature("vehicles.1.vy", -3.0, 3.0),
    ),
    (Action("acceleration", -9.0, 4.0),),
    period=0.1,
)  # fmt: skip
HIDDEN = 16
# perturbations, each with both signs, and episodes of each, the same points for all
PAIRS, EACH = 48, 6
SPREAD, RATE, HORIZON = 0.1, 0.08, 250  # of the weights; of learning; answers of 0.1 s


def sizes():
    inputs = len(INTERFACE.features)
    return [(inputs, HIDDEN), (HIDDEN,), (HIDDEN, 1), (1,)]


def answers(weights, seen):
    """Weights (n, all of them), what is seen (n, features): tanh layers, (n, 1)."""
    parts, begin = [], 0
    for shape in sizes():
        end = begin + int(np.prod(shape))
        parts.append(weights[:, begin:end].reshape(-1, *shape))
        begin = end
    hidden = np.tanh(np.einsum("nf,nfh->nh", seen, parts[0]) + parts[1])
    return np.tanh(np.einsum("nh,nha->na", hidden, parts[2]) + parts[3])


def returns(env, weights, seed):
    """The summed reward of one episode each; what comes after its end does not count."""
    seen, _ = env.reset(seed=[seed + row % EACH for row in range(env.num_envs)])
    total, running = np.zeros(env.num_envs), np.ones(env.num_envs, dtype=bool)
    for _ in range(HORIZON):
        seen, reward, terminated, truncated, _ = env.step(answers(weights, seen))
        total += np.where(running, reward, 0.0)
        running &= ~(terminated | truncated)
        if not running.any():
            break
    return total


def train(scenario, seconds, generations=10**6, seed=0):
    drawn = np.random.default_rng(seed)
    env = gymnasium.make_vec(
        f"sumo_eval/{scenario}-v0", num_envs=2 * PAIRS * EACH, interface=INTERFACE,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )  # fmt: skip
    count = sum(int(np.prod(shape)) for shape in sizes())
    weights = drawn.normal(0.0, 0.1, count)
    began, history = time.process_time(), []
    for generation in range(generations):
        if time.process_time() - began > seconds:
            break
        noise = drawn.normal(size=(PAIRS, count))
        tried = weights + SPREAD * np.repeat(np.concatenate([noise, -noise]), EACH, axis=0)
        worth = returns(env, tried, 1000 * generation).reshape(2, PAIRS, EACH).mean(axis=2)
        ranks = worth.ravel().argsort().argsort().reshape(worth.shape) / (worth.size - 1) - 0.5
        weights = weights + RATE / (PAIRS * SPREAD) * (ranks[0] - ranks[1]) @ noise
        history.append(float(worth.mean()))
        if generation % 20 == 0:
            print(f"generation {generation}: {history[-1]:.2f}", flush=True)  # noqa: T201
    return weights, history


def write(weights, path):
    """The network as ONNX, and its table beside it."""
    parts, begin = [], 0
    for number, shape in enumerate(sizes()):
        end = begin + int(np.prod(shape))
        parts.append(
            numpy_helper.from_array(
                weights[begin:end].reshape(shape).astype(np.float32), f"w{number}"
            )
        )
        begin = end
    nodes = [
        helper.make_node("Gemm", ["seen", "w0", "w1"], ["a"]),
        helper.make_node("Tanh", ["a"], ["b"]),
        helper.make_node("Gemm", ["b", "w2", "w3"], ["c"]),
        helper.make_node("Tanh", ["c"], ["action"]),
    ]  # fmt: skip
    graph = helper.make_graph(
        nodes, "policy",
        [helper.make_tensor_value_info("seen", TensorProto.FLOAT,
            ["rows", len(INTERFACE.features)])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["rows", 1])], parts,
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, path)
    path.with_suffix(".toml").write_text(INTERFACE.to_toml(), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("scenario")
    parser.add_argument("file", type=Path)
    parser.add_argument("--minutes", type=float, default=2.0, help="of processor time")
    given = parser.parse_args()
    write(train(given.scenario, 60.0 * given.minutes)[0], given.file)
