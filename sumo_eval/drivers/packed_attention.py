"""What many drivers know: `Attention` of `drivers.synthetic` on arrays, to the last bit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_eval.ads.packed_perception import PackedEgos, PackedMovers, visible
from sumo_eval.drivers.population import Driver
from sumo_eval.drivers.synthetic import CLOSING_SPEED, CROSSING_SPEED, HIDING_SHARE, NOTICED_BRAKING
from sumo_eval.trajectory import BoolArray, FloatArray

_SEEN, _ALONG, _BRAKING = 0, 3, 7  # where a look holds when it was, and two fields of a `PackedMovers`
_FIELDS = 8


class PackedAttention:
    """`Attention` of n drivers with m others each.

    The looks of all cases fall on the same instants. So the memory holds, for each of the last instants, what each
    driver had last seen of each vehicle by then: the latest look, or an earlier one at a vehicle that was hidden.

    first_seen: s, (m, n), inf before; also the order in which a driver got to know the vehicles.
    """

    def __init__(self, drivers: Sequence[Driver], step: float, others: int) -> None:
        n = len(drivers)
        self._delay = np.array([driver.reaction_time for driver in drivers])
        self._alerted_delay = np.array([driver.alerted_reaction_time for driver in drivers])
        self._calm = np.ones(n, dtype=bool)
        self.first_seen = np.full((others, n), np.inf)
        longest = float(max(self._delay.max(), self._alerted_delay.max()))
        instants = math.ceil(longest / step) + 3
        self._times = np.full(instants, -np.inf)  # of the last looks, the latest last
        self._newest = 0  # where in the memory the latest is: it is written round and round
        self._memory = np.zeros((instants, _FIELDS, others, n))
        self._places = np.arange(self._memory[0].size).reshape(self._memory[0].shape)

    def keep(self, rows: NDArray[np.intp]) -> None:
        """Go on with these drivers, in this order."""
        self._delay, self._alerted_delay = self._delay[rows], self._alerted_delay[rows]
        self._calm, self.first_seen = self._calm[rows], self.first_seen[:, rows]
        self._memory = np.ascontiguousarray(self._memory[..., rows])
        self._places = np.arange(self._memory[0].size).reshape(self._memory[0].shape)

    def known(self, me: PackedEgos, others: PackedMovers, time: float) -> tuple[PackedMovers, BoolArray]:
        """Look at the true scenes at `time`; return the vehicles that each driver acts upon, and which he knows of."""
        seen = visible(me, others, HIDING_SHARE)
        unknown = self.first_seen == np.inf
        self._take_alarm(me, others, seen, unknown, time)
        self._remember(others, seen, unknown, time)
        if np.count_nonzero(unknown):
            self.first_seen[seen & unknown] = time
        past = time - self._delay + 1e-9
        known = self.first_seen <= past
        back = len(self._times) - np.maximum(np.searchsorted(self._times, past, side="right"), 1)
        slots = (self._newest - back) % len(self._times)
        look = self._memory.take(slots * self._places.size + self._places)
        return _after(look, time), known

    def _take_alarm(
        self, me: PackedEgos, others: PackedMovers, seen: BoolArray, unknown: BoolArray, time: float
    ) -> None:
        """From when a vehicle ahead crosses, is closed upon or appears, the reaction time is the alerted one."""
        if not np.count_nonzero(self._calm):
            return
        calls = (np.abs(others.across) > CROSSING_SPEED) | (me.along - others.along > CLOSING_SPEED)
        calls = np.where(unknown, time > 0.0, calls & (others.x > me.x))
        self._calm &= ~(calls & seen).any(axis=0)
        self._delay = np.where(self._calm, self._delay, self._alerted_delay)

    def _remember(self, others: PackedMovers, seen: BoolArray, unknown: BoolArray, time: float) -> None:
        last = self._memory[self._newest]
        self._newest = (self._newest + 1) % len(self._times)
        self._times[:-1] = self._times[1:]
        self._times[-1] = time
        look = self._memory[self._newest]
        look[_SEEN] = time
        look[1:] = others
        braking = (last[_ALONG] - others.along) / (time - last[_SEEN])
        look[_BRAKING] = np.where((braking > NOTICED_BRAKING) & ~unknown, braking, 0.0)
        if np.count_nonzero(seen) < seen.size:
            look[:] = np.where(seen, look, last)


def _after(look: FloatArray, time: float) -> PackedMovers:
    """The vehicles of a look as they are at `time` if they go on as then: `Mover.after`."""
    seen, x, y, along, across, half_length, half_width, braking = look
    elapsed = time - seen
    brakes = braking > 0.0
    if not np.count_nonzero(brakes):
        return PackedMovers(x + along * elapsed, y + across * elapsed, along, across, half_length, half_width, braking)
    rolling = np.where(brakes, np.minimum(elapsed, np.maximum(along, 0.0) / braking), elapsed)
    return PackedMovers(
        x + rolling * np.where(brakes, along - 0.5 * braking * rolling, along),
        y + across * rolling,
        np.where(brakes, along - braking * rolling, along),
        across,
        half_length,
        half_width,
        braking,
    )
