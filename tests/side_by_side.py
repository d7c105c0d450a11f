"""The same scenes before plain controllers, one a case, and before their packed form."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from road_scenes import BRIEFING, FakeTraci

from sumo_eval.ads.perception import Sensor
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.packed_controller import PackedController, PackedScene
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.scenario.sampling import sample
from sumo_eval.trajectory import CHANNELS, Recording

STEP = BRIEFING.step


def points(name: str, every: int) -> list[ConcreteScenario]:
    """Every so-manyth point of a shipped scenario's own sample."""
    logical = catalogue.load(name)
    return list(logical.concretes(sample(logical).points[::every]))


def everything(recording: Recording) -> tuple[object, ...]:
    """All of a recording that is no wall time, to the last bit."""
    vehicles = {"ego": recording.ego, **recording.actors}
    channels = {name: [getattr(it, channel).tobytes() for channel in CHANNELS] for name, it in vehicles.items()}
    return repr((recording.end_reason, recording.error, recording.collision, recording.clips)), channels


def assert_same_recordings(cases: Sequence[ConcreteScenario], make: Any) -> None:
    """What a pack records is what each case records alone, and no case leaves the pack. make: the controllers."""
    alone: Counter[str] = Counter()
    together = [everything(recording) for recording in simulate_many(cases, make(), alone=alone)]
    assert not alone
    controllers = made if isinstance(made := make(), list) else [made] * len(cases)
    for concrete, controller, found in zip(cases, controllers, together, strict=True):
        assert found == everything(simulate(concrete, controller))


class Traffic:
    """A case whose vehicles do what comes: they hide and show, brake, stand, swerve, come head on, and drive abreast.

    The ego does not obey; so every decision is met with everything that a scene can hold, however unlikely.
    """

    def __init__(self, stream: np.random.Generator, others: int) -> None:
        self.stream = stream
        self.vehicles: dict[str, tuple[float, float, float, float]] = {}
        self.traci = FakeTraci(self.vehicles, 4.5, 1.8)
        speed = float(stream.choice([1.0, 8.0, 20.0, 30.0]))
        self.vehicles["ego"] = 52.25, float(stream.choice([0.0, 0.0, 0.3, 3.5])), 90.0, speed
        for number in range(others):
            ahead = float(stream.choice([stream.uniform(-40.0, 30.0), stream.uniform(5.0, 130.0)]))
            lane = float(stream.choice([0.0, 0.0, 1.9, 3.5, 3.5]))
            angle = float(stream.choice([90.0, 90.0, 90.0, 90.0, 270.0]))
            self.vehicles[f"v{number}"] = 52.25 + ahead, lane, angle, speed * float(stream.uniform(0.0, 1.2))
        self.abreast = others > 1 and bool(stream.random() < 0.4)
        self._align()

    def _align(self) -> None:
        if self.abreast:  # as far along the road, to the bit
            _, y, angle, speed = self.vehicles["v1"]
            self.vehicles["v1"] = self.vehicles["v0"][0], y, angle, speed

    def go_on(self) -> None:
        """One step."""
        stream = self.stream
        for name, (x, y, angle, speed) in self.vehicles.items():
            what = stream.random()
            if what < 0.03 and name != "ego":
                y = float(stream.choice([0.0, 1.5, 3.5]))
            elif what < 0.03:
                speed = 0.5 * speed
            elif what < 0.06 and angle < 180.0:
                angle = 90.0 if angle != 90.0 else 90.0 - float(stream.uniform(-4.0, 4.0))
            elif what < 0.16:
                speed = max(speed + float(stream.choice([-0.4, -0.03, 0.02, 0.3])), 0.0)
            self.vehicles[name] = x + (speed if angle < 180.0 else -speed) * STEP, y, angle, speed
        self._align()


def _packed_scene(traffic: Sequence[Traffic], sensors: Sequence[Sensor]) -> PackedScene:
    scenes = [sensor.look(case.traci, "ego") for sensor, case in zip(sensors, traffic, strict=True)]
    me = np.array([scene.me[1:8] for scene in scenes]).T
    others = np.array([[other[1:8] for other in scene.others] for scene in scenes]).transpose(2, 0, 1)
    return PackedScene(*me, *others)


def assert_same_commands(plain: Sequence[Any], packed: PackedController, others: int, seed: int, steps: int) -> None:
    """Every command of the packed form is that of the plain controller, to the bit, while cases end now and then."""
    streams = np.random.default_rng(seed).spawn(len(plain) + 1)
    traffic = [Traffic(stream, others) for stream in streams[1:]]
    sensors = [Sensor() for _ in plain]
    for controller, case in zip(plain, traffic, strict=True):
        controller.reset(BRIEFING, case.traci, "ego")
    rows = np.arange(len(plain))
    for count in range(steps):
        scene = _packed_scene([traffic[row] for row in rows], [sensors[row] for row in rows])
        found = np.stack(packed.step(scene, count * STEP), axis=1)
        for row, answer in zip(rows.tolist(), found, strict=True):
            command = plain[row].step(traffic[row].traci, "ego", count * STEP)
            expected = np.array([command.acceleration, command.steering])
            assert answer.tobytes() == expected.tobytes(), f"case {row} of seed {seed} at step {count}"
            traffic[row].go_on()
        if count % 17 == 16:
            kept = streams[0].permutation(len(rows))[: max(len(rows) - 1, 1)]
            packed.keep(kept)
            rows = rows[kept]
        assert packed.settled().shape == rows.shape
