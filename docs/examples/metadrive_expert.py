"""The PPO expert that MetaDrive publishes (https://github.com/metadriverse/metadrive), which nobody
here trained.

Its weights are read from the wheel in which they ship (`pip install --no-deps
metadrive-simulator`), or from the file in the option `weights`; MetaDrive itself is not imported.
What the network is shown is MetaDrive's observation of 275 numbers, made from ours as its
state_obs.py, lidar.py and node_network_navigation.py do, on a straight road; its mean answer every
0.1 s is a wheel angle and a pedal, and what these do is MetaDrive's default vehicle: 4 x 800 N on
1100 kg up to 80 km/h, brakes of 4 x 7500 N up to a friction of 0.9, wheels that turn by 40 degrees.
"""

import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np

LASERS, REACH, OTHERS = 240, 50.0, 4  # rays, m, vehicles
TOP_SPEED, WIDEST, MOST_LANES = 80.0, 4.5, 4  # km/h, m
TURNS, PUSH, ROLL, BRAKE, GRIP = math.radians(40.0), 2.91, 0.36, 27.3, 8.83  # rad, m/s2


def within(value, low=0.0, high=1.0):
    return min(max(value, low), high)


def published():
    spec = find_spec("metadrive")
    if spec is None:
        raise ModuleNotFoundError("the expert's weights: pip install --no-deps metadrive-simulator")
    return Path(spec.submodule_search_locations[0]) / "examples/ppo_expert/expert_weights.npz"


class Expert:
    def __init__(self, weights=None):
        with np.load(weights or published()) as file:
            self.layers = [
                tuple(file[f"default_policy/{layer}/{part}"] for part in ("kernel", "bias"))
                for layer in ("fc_1", "fc_2", "fc_out")
            ]

    def reset(self, scenario):
        self.ratio, self.next, self.asked, self.heading, self.answer = (
            scenario.vehicle.steering_ratio,
            0.0,
            (0, 0),
            0.0,
            None,
        )

    def act(self, seen):
        if seen.time >= self.next - 1e-9:
            self.next = seen.time + 0.1
            x = self.observed(seen)
            for kernel, bias in self.layers[:2]:
                x = np.tanh(x @ kernel + bias)
            kernel, bias = self.layers[2]
            steer, pedal = (within(it, -1.0, 1.0) for it in (x @ kernel + bias)[:2].tolist())
            self.asked, self.heading = (steer, pedal), seen.ego.heading
        steer, pedal = self.asked
        pushed = PUSH * pedal if 3.6 * seen.ego.speed <= TOP_SPEED else -ROLL
        return pushed if pedal >= 0.0 else max(BRAKE * pedal, -GRIP), steer * TURNS * self.ratio

    def observed(self, seen):
        me, road = seen.ego, seen.road
        c, s = math.cos(me.heading), math.sin(me.heading)
        steer, pedal = self.asked
        own = [
            within(seen.left_edge / (MOST_LANES * WIDEST)),
            within(seen.right_edge / (MOST_LANES * WIDEST)),
            0.5 - 0.5 * s, within((3.6 * me.speed + 1.0) / (TOP_SPEED + 1.0)),
            within((steer / 60.0 + 1.0) / 2.0), (steer + 1.0) / 2.0, (pedal + 1.0) / 2.0,
            within(abs(me.heading - self.heading) / 0.1),
            within((2.0 * seen.lanes[me.lane] / WIDEST + 1.0) / 2.0),
        ]  # fmt: skip
        east, north = road.length - me.x, 0.5 * (road.lanes - 1) * road.lane_width - me.y
        # a checkpoint: the middle of the road at its end, 50 m away at most
        far = max(math.hypot(east, north), REACH)
        ahead, left = (east * c + north * s) / far, (north * c - east * s) / far
        way = [(ahead + 1.0) / 2.0, 1.0 - (left + 1.0) / 2.0, 0.0, 0.5, 0.5]
        near = [
            it
            for it in seen.vehicles
            if math.hypot(it.x - me.x, it.y - me.y) <= REACH + 0.5 * it.length
        ]
        near.sort(key=lambda it: math.hypot(it.x - me.x, it.y - me.y))
        others = np.zeros(4 * OTHERS)
        for place, it in enumerate(near[:OTHERS]):
            dx, dy = it.x - me.x, it.y - me.y
            vx, vy = (
                it.speed * math.cos(it.heading) - me.speed * c,
                it.speed * math.sin(it.heading) - me.speed * s,
            )
            where = (dx * c + dy * s) / REACH, (dy * c - dx * s) / REACH
            pace = 3.6 * (vx * c + vy * s) / TOP_SPEED, 3.6 * (vy * c - vx * s) / TOP_SPEED
            others[4 * place : 4 * place + 4] = [
                within((value + 1.0) / 2.0) for value in (*where, *pace)
            ]
        return np.concatenate([own, way, way, others, self.rays(me, near)])

    def rays(self, me, near):
        """The share of 50 m at which each ray meets a body, counter-clockwise from straight ahead;
        1: none."""
        angles = me.heading + np.arange(LASERS) * (2.0 * np.pi / LASERS)
        free = np.ones(LASERS)
        for it in near:
            turned = angles - it.heading
            c, s = math.cos(it.heading), math.sin(it.heading)
            x, y = me.x - it.x, me.y - it.y
            begin, way = (
                np.array([x * c + y * s, y * c - x * s]),
                REACH * np.stack([np.cos(turned), np.sin(turned)]),
            )
            half = 0.5 * np.array([it.length, it.width])
            with np.errstate(divide="ignore"):
                one, two = (-half - begin)[:, None] / way, (half - begin)[:, None] / way
            enters, leaves = np.minimum(one, two).max(axis=0), np.maximum(one, two).min(axis=0)
            meets = (enters <= leaves) & (enters >= 0.0)
            free = np.where(meets, np.minimum(free, enters), free)
        return free
