"""What is recorded of a pack: samples of every vehicle, and the recordings of its cases made from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sumo_eval.cosim.packed_actors import Index, PackedActors
from sumo_eval.cosim.packed_vehicle_model import PackedEgos
from sumo_eval.scenario.concrete import Actor
from sumo_eval.settings import VehicleSettings
from sumo_eval.trajectory import CHANNELS, Clip, Collision, EndReason, FloatArray, Recording, Trajectory

_EGO = 6  # channels: x, y, heading, speed, acceleration, steering wheel angle
_OTHER = 5  # the same without the last


@dataclass(slots=True)
class End:
    """How a case ended: when, why, and the channels of everything then: the ego's, then each other vehicle's."""

    time: float
    reason: EndReason
    collision: Collision | None
    ego: Sequence[float]
    others: Sequence[Sequence[float]]


class PackedSamples:
    """Samples of n cases with m other vehicles each.

    As long as the pack holds the same rows its samples lie one behind the other; when it gives some up they are turned
    into one block (rows, channels, samples), so that every channel of a case is in one piece when it is asked for.
    """

    def __init__(self, cases: int, others: int) -> None:
        self._times: list[float] = []
        self._others = others
        self._present: list[FloatArray] = []
        self._rows = np.arange(cases)  # of each case, in the present samples
        self._blocks: list[tuple[Index, FloatArray]] = []  # row of each case, -1: not there

    def add(self, time: float, egos: PackedEgos, actors: PackedActors) -> None:
        """Record every vehicle as it is now."""
        m = self._others
        sample = np.zeros((_EGO + _OTHER * m, len(actors.case)))
        for channel, values in enumerate(egos[:_EGO]):
            sample[channel] = values
        for channel, others in enumerate((actors.x, actors.y, actors.heading, actors.speed)):
            begin = _EGO + channel * m
            sample[begin : begin + m] = others.T
        for row, index, acceleration in actors.accelerations(time):
            sample[_EGO + 4 * m + index, row] = acceleration
        self._present.append(sample)
        self._times.append(time)

    def keep(self, cases: Index) -> None:
        """From now on only these cases are sampled, in this order."""
        if self._present:
            block = np.stack(self._present, axis=-1).transpose(1, 0, 2)
            self._blocks.append((self._rows, np.ascontiguousarray(block)))
        self._present = []
        self._rows = np.full(len(self._rows), -1)
        self._rows[cases] = np.arange(len(cases))

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
        """What a case left behind; every sample must have been followed by a `keep`."""
        m, last = self._others, int(np.searchsorted(self._times, end.time - 1e-9))
        times = np.array([*self._times[:last], end.time])
        pieces = [block[rows[case]] for rows, block in self._blocks if rows[case] >= 0]
        values = pieces[0] if len(pieces) == 1 else np.concatenate(pieces, axis=1)
        ego = _trajectory(times, values[:_EGO], end.ego, vehicle)
        others = {
            actor.name: _trajectory(times, values[_EGO + index :: m], end.others[index], actor)
            for index, actor in enumerate(actors)
        }
        return Recording(
            ego, others, end.collision, end.reason, tuple(clips), controller_latency=latency, wall_time=wall_time
        )


def _trajectory(
    times: FloatArray, samples: FloatArray, end: Sequence[float], body: VehicleSettings | Actor
) -> Trajectory:
    """A vehicle's samples before the end of its case, and its channels then."""
    count, last = len(samples), len(times) - 1
    block = np.full((len(CHANNELS), len(times)), np.nan)
    block[0] = times
    block[1 : 1 + count, :last] = samples[:, :last]
    block[1 : 1 + count, last] = end
    return Trajectory.of_block(block, length=body.length, width=body.width)
