"""What is recorded of a pack: samples of every vehicle, and the recordings of its cases made from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sumo_eval.cosim.packed_actors import PackedActors
from sumo_eval.cosim.packed_vehicle_model import PackedEgos
from sumo_eval.scenario.concrete import Actor
from sumo_eval.settings import VehicleSettings
from sumo_eval.trajectory import Clip, Collision, EndReason, FloatArray, Recording, Trajectory

_EGO = 6  # channels: x, y, heading, speed, acceleration, steering wheel angle
_OTHER = 5  # the same without the last
_FIRST_ROOM = 512  # samples; more room is made when they do not suffice


@dataclass(slots=True)
class End:
    """How a case ended: when, why, and the channels of everything then: the ego's, then each other vehicle's."""

    time: float
    reason: EndReason
    collision: Collision | None
    ego: Sequence[float]
    others: Sequence[Sequence[float]]


class PackedSamples:
    """Samples of n cases with m other vehicles each."""

    def __init__(self, cases: int, others: int) -> None:
        self._times: list[float] = []
        self._others = others
        self._values = np.empty((cases, _FIRST_ROOM, _EGO + _OTHER * others))

    def add(self, time: float, egos: PackedEgos, actors: PackedActors) -> None:
        """Record every vehicle as it is now."""
        m, count = self._others, len(self._times)
        if count + 1 == self._values.shape[1]:  # one is kept free for the end of a case
            self._values = np.concatenate((self._values, np.empty_like(self._values)), axis=1)
        block = np.zeros((len(actors.case), self._values.shape[2]))
        for channel, values in enumerate(egos[:_EGO]):
            block[:, channel] = values
        for channel, others in enumerate((actors.x, actors.y, actors.heading, actors.speed)):
            begin = _EGO + channel * m
            block[:, begin : begin + m] = others
        for row, index, acceleration in actors.accelerations(time):
            block[row, _EGO + 4 * m + index] = acceleration
        self._values[actors.case, count] = block
        self._times.append(time)

    def recording(
        self,
        case: int,
        end: End,
        actors: Sequence[Actor],
        vehicle: VehicleSettings,
        clips: Sequence[Clip],
        *,
        latency: tuple[float, float],
        wall_time: float,
    ) -> Recording:
        """What a case left behind."""
        last = int(np.searchsorted(self._times, end.time - 1e-9))
        times = np.array([*self._times[:last], end.time])
        m = self._others
        values = self._values[case, : last + 1].T
        values[:_EGO, last] = end.ego
        for index, other in enumerate(end.others):
            values[_EGO + index :: m, last] = other
        ego = _trajectory(times, values[:_EGO], vehicle)
        others = {
            actor.name: _trajectory(times, values[_EGO + index :: m], actor) for index, actor in enumerate(actors)
        }
        return Recording(
            ego, others, end.collision, end.reason, tuple(clips), controller_latency=latency, wall_time=wall_time
        )


def _trajectory(times: FloatArray, channels: NDArray[np.float64], body: VehicleSettings | Actor) -> Trajectory:
    return Trajectory(times, *channels, length=body.length, width=body.width)
