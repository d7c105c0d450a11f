"""Human-likeness of the drivers: D_i of each driver beside that of an ADS, case by case, for
`report.people`.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.findings import findings_of, mean_of


class DriverBand(NamedTuple):
    """D_i of the drivers, over the safe cases in which an ADS has a D_i.

    low, mean, high: D_i of the least human driver, mean D_i of all drivers, D_i of the most human
        driver, each averaged over the cases by exposure; None where no case has a band.
    below: number of cases in which the ADS is below every driver.
    banded: number of cases with a band of the drivers.
    drivers: fewest and most drivers of a case; empty where no case has drivers.
    recorded: share of recorded drivers, 0..1.
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
        known = own.drivers[np.isfinite(own.drivers)].astype(int)
        all_drivers, recorded = known.sum(), np.nansum(own.recorded_drivers)
        in_each_case = (  # thin (a note says so), outside, bimodal, unlike: the last four fields
            [note is not None for note in own.reference_note], own.exposure_note != "",
            own.bimodal, own.manoeuvre_share == 0.0
        )  # fmt: skip
        yield DriverBand(
            findings.score, low, mean, high,
            int(np.sum(own.index < own.human_low)), int(np.isfinite(own.human_mean).sum()),
            (int(known.min()), int(known.max())) if len(known) else (),
            float(recorded / all_drivers) if all_drivers else 0.0,
            *(int(np.sum(it)) for it in in_each_case)
        )  # fmt: skip


def below_drivers(evaluation: Evaluation, most: int) -> CaseTable:
    """The cases in which an ADS scores furthest below the drivers' own mean, at most `most`."""
    cases, ahead = evaluation.cases, evaluation.cases.index - evaluation.cases.human_mean
    places = np.flatnonzero(ahead < 0.0)
    # the furthest below first, then by name (the last key is first)
    return cases[places[np.lexsort((cases.case[places], ahead[places]))[:most]]]
