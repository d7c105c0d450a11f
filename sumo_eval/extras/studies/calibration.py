"""k5 and k6 from a population of ADSs, so that the middle one gets half of the points (Eq. 18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.method.score import middle, population_scale
from sumo_eval.results import Evaluation


class Calibration(NamedTuple):
    """k5 = 0.5 / middle C and k6 = 0.5 / middle D; None where no ADS has the index or its middle is
    0.

    c, d: the ADSs' indexes, means over their scenarios, by name.
    left_out: sentences about what is missing from them.
    """

    by: str
    k5: float | None
    k6: float | None
    c: dict[str, float]
    d: dict[str, float]
    left_out: tuple[str, ...]


def calibrate(evaluations: Sequence[Evaluation], *, by: str = "median") -> Calibration:
    """Scales from the ADSs of one run or several.

    by: `median` or `mean`. An ADS is one name; its scenarios are averaged.

    Raises InputError for one ADS only, or for an unknown `by`.
    """
    if by not in ("median", "mean"):
        raise InputError(f"`by` of a calibration must be 'median' or 'mean', got {by!r}.")
    values: dict[str, dict[str, list[float]]] = {"c": {}, "d": {}}
    left_out = []
    scores = [score for evaluation in evaluations for score in evaluation.scores]
    for score in scores:
        for index, of_ads in values.items():
            value = getattr(score, index)
            if value is None:
                missing = f"{score.ads} in {score.scenario} has no {index.upper()}"
                left_out.append(f"{missing} and is left out of its mean.")
            else:
                of_ads.setdefault(score.ads, []).append(value)
    count = len({score.ads for score in scores})
    if count < 2:
        raise InputError(f"A calibration needs a population of at least 2 ADSs, got {count}.")
    c, d = (
        {name: float(np.mean(each)) for name, each in of_ads.items()} for of_ads in values.values()
    )
    centre: Literal["median", "mean"] = "median" if by == "median" else "mean"
    return Calibration(by, _scale(c, centre), _scale(d, centre), c, d, tuple(left_out))


def _scale(means: Mapping[str, float], centre: Literal["median", "mean"]) -> float | None:
    """The scale of one index; None where no ADS has it or the middle one has 0, which no scale can
    lift.
    """
    values = list(means.values())
    exists = values and middle(values, centre) > 0.0
    return population_scale(values, centre=centre) if exists else None


def calibration_lines(calibration: Calibration) -> list[str]:
    """The scales in words, and how to score with them."""
    it, by = calibration, calibration.by
    lines, changes = list(it.left_out), []
    for name, index, scale, values in (("k5", "C", it.k5, it.c), ("k6", "D", it.k6, it.d)):
        among = ", ".join(f"{ads} {value:z.3f}" for ads, value in values.items()) or "none"
        words = f" is not defined: the {by} {index} is 0 or there is none ({among})."
        if scale is not None:
            words = f" = {scale:z.4f}: the {by} ADS gets half of the points of {index} ({among})."
            changes.append(f"--set method.score.{name}={scale:z.6g}")
        lines.append(name + words)
    if changes:
        lines.append(f"Score with them: sumo-eval score RUN {' '.join(changes)}")
    return lines
