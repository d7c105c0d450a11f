"""Bands of the drivers: D_i of the drivers at each point, measured against the other drivers there,
beside D_i of an ADS.

A band is coarser than the D_i of an ADS: each driver is compared with one driver fewer, and on
fewer cross-sections (`band_slice_spacing`, 2.5 m, instead of `slice_spacing`, 0.5 m).

Users: `report/people.py`. Free to change: all but the order of `below_drivers`.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sumo_eval.case_table import CaseTable
from sumo_eval.results import Evaluation, ScenarioResult
from sumo_eval.scoring.findings import findings_of, mean_of


class DriverBand(NamedTuple):
    """D_i of the drivers, over the safe cases in which an ADS has a D_i ("cases" below).

    A case with two drivers has no band: a driver is compared with at least two others.

    score: of the ADS in the scenario.
    low, mean, high: the least, the mean and the largest D_i among the drivers of a case, averaged
        over the cases with a band by exposure; None if there are none, or all have exposure 0.
    below: number of cases in which D_i of the ADS is below that of every driver.
    banded: number of cases with a band.
    drivers: fewest and most drivers of a case.
    recorded: share of recorded drivers among all, 0..1.
    thin: number of cases with too few recorded drivers, which synthetic ones fill up. Where they
        are left out instead, the case has no D_i and does not count here.
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
        own = findings.cases[findings.indexed]  # the cases with a D_i
        if not len(own):
            continue
        low, mean, high = (
            mean_of(getattr(own, f"human_{end}"), own.exposure) for end in ("low", "mean", "high")
        )
        # numbers of drivers of the cases
        numbers = own.drivers[np.isfinite(own.drivers)].astype(int)
        all_drivers, recorded = numbers.sum(), np.nansum(own.recorded_drivers)
        yield DriverBand(
            findings.score, low, mean, high,
            # nan, of a case without a band, is above nothing
            int(np.sum(own.index < own.human_low)), int(np.isfinite(own.human_mean).sum()),
            (int(numbers.min()), int(numbers.max())) if len(numbers) else (),
            float(recorded / all_drivers) if all_drivers else 0.0,
            thin=sum(note is not None for note in own.reference_note),
            outside=int(np.sum(own.exposure_note != "")),
            bimodal=int(np.sum(own.bimodal)),
            unlike=int(np.sum(own.manoeuvre_share == 0.0))
        )  # fmt: skip


def below_drivers(evaluation: Evaluation, most: int) -> CaseTable:
    """The cases of all ADSs with D_i furthest below the drivers' mean D_i, the furthest first, at
    most `most`.
    """
    cases, difference = evaluation.cases, evaluation.cases.index - evaluation.cases.human_mean
    places = np.flatnonzero(difference < 0.0)
    # lexsort: the last key counts first, so equal cases are sorted by name
    return cases[places[np.lexsort((cases.case[places], difference[places]))[:most]]]
