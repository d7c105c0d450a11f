"""Human-likeness of the drivers: D_i of each driver beside that of an ADS, case by case."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sumo_eval.cases import CaseTable
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.findings import findings, mean_of


@dataclass(frozen=True, slots=True)
class DriverBand:
    """An ADS's safe cases with a D_i beside their drivers; means by exposure, None without any.

    low, mean, high: of the least human driver, of all, of the most human one.
    below: cases of `banded`, those with a band, in which the ADS is below every driver.
    drivers: fewest and most drivers of a case.
    recorded: share of recorded drivers.
    thin, outside, bimodal, unlike: cases with too few recorded drivers, outside the support of the
        exposure, with drivers in two groups, with a manoeuvre that no driver made.
    """

    score: ScenarioResult
    low: float | None
    mean: float | None
    high: float | None
    below: int
    banded: int
    drivers: tuple[int, ...]
    recorded: float
    thin: int
    outside: int
    bimodal: int
    unlike: int


def driver_bands(evaluation: Evaluation) -> Iterator[DriverBand]:
    """The band of each score whose cases have a D_i."""
    for one in findings(evaluation):
        own = one.cases[one.indexed]
        if not len(own):
            continue
        low, mean, high = (
            mean_of(getattr(own, f"human_{end}"), own.exposure) for end in ("low", "mean", "high")
        )
        known = own.drivers[np.isfinite(own.drivers)].astype(int)
        everybody, recorded = known.sum(), np.nansum(own.recorded_drivers)
        counts = (
            [note is not None for note in own.reference_note], own.exposure_note != "",
            own.bimodal, own.manoeuvre_share == 0.0,
        )  # fmt: skip
        yield DriverBand(
            one.score, low, mean, high,
            int(np.sum(own.index < own.human_low)), int(np.isfinite(own.human_mean).sum()),
            (int(known.min()), int(known.max())) if len(known) else (),
            float(recorded / everybody) if everybody else 0.0,
            *(int(np.sum(flags)) for flags in counts),
        )  # fmt: skip


def below_drivers(evaluation: Evaluation, most: int) -> CaseTable:
    """The cases in which an ADS scores furthest below the drivers' own mean, at most `most`."""
    cases, below = evaluation.cases, evaluation.cases.index - evaluation.cases.human_mean
    places = np.flatnonzero(below < 0.0)
    return cases[places[np.lexsort((cases.case[places], below[places]))[:most]]]
