"""Request to a sampling method, and its answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sumo_eval.errors import must_be
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray

MAX_POINTS = 1_000_000
"""More points than any machine will simulate; a larger sample is a slip of the pen."""

Levels = int | Mapping[str, int] | None
Steps = Mapping[str, float] | None


@dataclass(frozen=True, slots=True)
class Request:
    """Request for points; `sumo_eval.scenario.sampling.samples.METHODS` has the keys that each
    method takes.

    levels: points on each axis, evenly spaced with both ends; one number for all axes, or by
        parameter name.
    steps: distance between the points of an axis, by parameter name.
    count: how many points to draw.
    strength: t of t-way combinations.
    file: a CSV of points.
    folder: where relative paths start.
    seed: of the evaluation.
    danger: points (n, k) -> how dangerous each is, 0..1.
    round: number of points of a round (method `adaptive`, with the next three).
    aim: the quantity that rounds shall make more certain: `s_plus` or `boundary`.
    until: half the width of its interval at which the rounds end.
    rounds: of each round so far, its number of points from each cell of the space.
    """

    levels: Levels = None
    steps: Steps = None
    count: int | None = None
    strength: int | None = None
    file: str | None = None
    folder: Path | None = None
    seed: int = 1
    danger: Callable[[FloatArray], FloatArray] | None = None
    round: int | None = None
    aim: str | None = None
    until: float | None = None
    rounds: Sequence[Sequence[int]] = ()

    @property
    def given(self) -> frozenset[str]:
        """The keys that are set."""
        unset = {"folder", "seed", "danger"}
        return frozenset(
            item.name
            for item in fields(self)
            if item.name not in unset and getattr(self, item.name) not in (None, (), {})
        )

    def wanted(self, logical: LogicalScenario) -> int:
        """`count`. Raises InputError if it is missing or out of bounds."""
        if type(self.count) is int and 1 <= self.count <= MAX_POINTS:
            return self.count
        must = f"a whole number from 1 to {MAX_POINTS:,}"
        raise must_be("`count`", owner_of(logical), must, self.count)

    def stream(self, logical: LogicalScenario, *label: str) -> np.random.Generator:
        """Random numbers of a method."""
        return random_stream(self.seed, "sampling", logical.name, *label)


def owner_of(logical: LogicalScenario) -> str:
    """Name of a space's sampling in error messages."""
    return f"the sampling of scenario `{logical.name}`"


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """Answer of a method: points (n, k), possible or not.

    exposure: (n,) how much each counts; None: the scenario's own exposure.
    notes: sentences on requests that it could not fulfil.
    stands_for: (n,) how many points of an even sample each stands for; None: one.
    stratum: (n,) number of each point's stratum, within which resampling exchanges points; None:
        strata by the method (`sumo_eval.scoring.confidence.resamples.strata`).
    """

    points: FloatArray
    exposure: FloatArray | None = None
    notes: tuple[str, ...] = ()
    stands_for: FloatArray | None = None
    stratum: NDArray[np.intp] | None = None
