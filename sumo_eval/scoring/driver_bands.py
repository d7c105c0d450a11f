"""Bands of the drivers: D_i of the drivers at each point, measured against the other drivers there,
beside D_i of an ADS.

Users: `report/`.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.findings import findings_of, mean_of


class DriverBand(NamedTuple):
    """D_i of the drivers, over the safe cases in which an ADS has a D_i.

    score: of the ADS in the scenario.
    low: D_i of the driver with the least D_i of each case, averaged by exposure.
    mean: mean D_i of the drivers of each case, averaged by exposure.
    high: D_i of the driver with the largest D_i of each case, averaged by exposure. These three are
        None if no case has a band.
    below: number of cases in which D_i of the ADS is below that of every driver.
    banded: number of cases with a band.
    drivers: fewest and most drivers of a case; empty if no case has drivers.
    recorded: share of recorded drivers among all, 0..1.
    thin: number of cases with too few recorded drivers.
    outside: number of cases outside the support of the exposure.
    bimodal: number of cases with drivers in two groups.
    unlike: number of cases with a manoeuvre that no driver made.
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
    for findings in findings_of(evaluation):
        own = findings.cases[findings.indexed]
        if not len(own):
            continue
        low, mean, high = (
            mean_of(getattr(own, f"human_{end}"), own.exposure) for end in ("low", "mean", "high")
        )
        # numbers of drivers of the cases
        numbers = own.drivers[np.isfinite(own.drivers)].astype(int)
        all_drivers, recorded = numbers.sum(), np.nansum(own.recorded_drivers)
        # whether each case is thin (it has a note), outside, bimodal, unlike: the last four fields
        in_each_case = (
            [note is not None for note in own.reference_note], own.exposure_note != "",
            own.bimodal, own.manoeuvre_share == 0.0
        )  # fmt: skip
        yield DriverBand(
            findings.score, low, mean, high,
            int(np.sum(own.index < own.human_low)), int(np.isfinite(own.human_mean).sum()),
            (int(numbers.min()), int(numbers.max())) if len(numbers) else (),
            float(recorded / all_drivers) if all_drivers else 0.0,
            *(int(np.sum(it)) for it in in_each_case)
        )  # fmt: skip


def below_drivers(evaluation: Evaluation, most: int) -> CaseTable:
    """The cases of all ADSs with D_i furthest below the drivers' mean D_i, the furthest first, at
    most `most`.
    """
    cases, ahead = evaluation.cases, evaluation.cases.index - evaluation.cases.human_mean
    places = np.flatnonzero(ahead < 0.0)
    # lexsort: the last key counts first, so equal cases are sorted by name
    return cases[places[np.lexsort((cases.case[places], ahead[places]))[:most]]]
