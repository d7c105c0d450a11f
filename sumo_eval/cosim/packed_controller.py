"""The door between a pack and a controller that drives all its egos with one call: what it sees, what it answers."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sumo_eval.trajectory import BoolArray, FloatArray


class PackedScene(NamedTuple):
    """What `ads.perception.Sensor.look` shows of n cases with m other vehicles each, to the last bit; m, m/s, rad.

    x, y: body centre. heading: 0 along the road, positive to the left. along, across: speed by road axis. half_length,
    half_width: half the extent of the (turned) body along and across the road. Egos (n,); others (n, m), in the order
    of the concrete scenario's actors. No array may be changed or kept.
    """

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    along: FloatArray
    across: FloatArray
    half_length: FloatArray
    half_width: FloatArray
    other_x: FloatArray
    other_y: FloatArray
    other_heading: FloatArray
    other_along: FloatArray
    other_across: FloatArray
    other_half_length: FloatArray
    other_half_width: FloatArray


class PackedCommand(NamedTuple):
    """What n controllers ask of their vehicles for the next step.

    acceleration: (n,) m/s2, negative brakes; nan: hand that case back, it is simulated alone. steering: (n,) rad,
    steering wheel angle, positive to the left.
    """

    acceleration: FloatArray
    steering: FloatArray


class PackedController(Protocol):
    """A controller of n cases at once: each answer is, bit for bit, the one of the plain controller in that case.

    An ADS has it as `packed(briefing)` of an object; controllers that are given one per case (all of one type), as
    their classmethod `together(controllers, briefing)`; either may answer None. It learns n and m at its first step.
    The plain controllers must stay as they were: a case that leaves the pack is driven by its own from the start.
    """

    def step(self, scene: PackedScene, time: float) -> PackedCommand:
        """What each ego is to do in the coming step; time: s."""

    def settled(self) -> BoolArray:
        """Where it brakes for nothing, nor is about to, (n,)."""

    def keep(self, rows: NDArray[np.intp]) -> None:
        """From now on the scenes hold only these of the present cases, in this order.

        Between two of these calls the rows of cases that have ended hold stale values; answers to them are ignored.
        """
