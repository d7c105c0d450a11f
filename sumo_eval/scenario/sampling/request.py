"""The argument and the result of every method of sampling: `Request` and `Drawn`.

Users: `extras/openscenario/points.py`, `record/points.py`, `scenario/sampling/adaptive.py`,
`scenario/sampling/combinations.py`, `scenario/sampling/drawn_points.py`,
`scenario/sampling/grid.py`, `scenario/sampling/listed_points.py`, `scenario/sampling/samples.py`.
"""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np

from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.settings import SamplingSettings
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import FloatArray, IntArray

MAX_POINTS = 1_000_000
"""More points than any machine will simulate: a larger sample is a typing error."""

Levels = int | dict[str, int] | None
"""Number of values on every axis, or by parameter; None: not requested."""
Steps = dict[str, float] | None
"""Distance of values by parameter; None: not requested."""


@frozen
class Request(SamplingSettings):
    """Request for points: the settings `sampling` of a scenario, of which each method takes some
    keys (`METHODS` of `sumo_eval.scenario.sampling.samples`), and three further values.

    folder: where relative paths start; None: the current folder.
    seed: of the evaluation.
    danger: points (n, k) -> how dangerous each is, 0..1, (n,); None: unknown.
    """

    folder: Path | None = None
    seed: int = 1
    danger: Callable[[FloatArray], FloatArray] | None = None

    def __post_init__(self) -> None:
        """Check nothing: each method checks its keys, with the scenario's name in the message."""

    @property
    def given(self) -> frozenset[str]:
        """The keys that are set."""
        no_keys = {"method", "folder", "seed", "danger"}
        return frozenset(
            item.name
            for item in fields(self)
            if item.name not in no_keys and getattr(self, item.name) not in (None, (), {})
        )

    def wanted(self, logical: LogicalScenario) -> int:
        """`count`. Raises InputError if it is missing or out of bounds."""
        if type(self.count) is int and 1 <= self.count <= MAX_POINTS:
            return self.count
        must = f"a whole number from 1 to {MAX_POINTS:,}"
        raise must_be("`count`", owner_of(logical), must, self.count)

    def stream(self, logical: LogicalScenario, *label: str) -> np.random.Generator:
        """Random numbers of a method; `label` names its stream."""
        return random_stream(self.seed, "sampling", logical.name, *label)


def owner_of(logical: LogicalScenario) -> str:
    """Name of a space's sampling in error messages."""
    return f"the sampling of scenario `{logical.name}`"


@frozen(eq=False)
class Drawn:
    """Result of a method: points (n, k), possible or not.

    exposure: how much each point counts, (n,); None: the scenario's own exposure.
    notes: sentences on what the method did otherwise than requested.
    stands_for: how many points of an even sample each point stands for, (n,); None: 1.
    stratum: number of each point's stratum, within which resampling exchanges points, (n,); None:
        strata by the method (`sumo_eval.scoring.confidence.resamples.strata`).
    """

    points: FloatArray
    exposure: FloatArray | None = None
    notes: tuple[str, ...] = ()
    stands_for: FloatArray | None = None
    stratum: IntArray | None = None
