"""k5 and k6 (Eq. 18) with which the middle one of several ADSs gets half of the points.

For `sumo-eval calibrate`.

Users: `extras/rates/people_command.py`.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.errors import InputError
from sumo_eval.groups import grouped
from sumo_eval.method.score import middle, population_scale
from sumo_eval.results import Evaluation, ScenarioResult


class Calibration(NamedTuple):
    """Eq. 18: k5 = 0.5 / middle C and k6 = 0.5 / middle D.

    by: which ADS is the middle one: `median` or `mean`.
    k5, k6: None where no ADS has the index, or the middle one is 0.
    c, d: C and D by ADS, means over its scenarios.
    left_out: a sentence for each score that these means lack.
    """

    by: str
    k5: float | None
    k6: float | None
    c: dict[str, float]
    d: dict[str, float]
    left_out: tuple[str, ...]


def calibrate(evaluations: Sequence[Evaluation], *, by: str) -> Calibration:
    """Calibrate on the ADSs of one or several runs.

    by: `median` or `mean`.

    Results with the same name are one ADS, and its scenarios are averaged. Raises InputError for
    fewer than 2 ADSs, and for another `by`.
    """
    if by not in ("median", "mean"):
        raise InputError(f"`by` of a calibration must be 'median' or 'mean', got {by!r}.")
    scores = [score for evaluation in evaluations for score in evaluation.scores]
    count = len({score.ads for score in scores})
    if count < 2:
        raise InputError(f"A calibration needs a population of at least 2 ADSs, got {count}.")
    left_out = [
        f"{it.ads} in {it.scenario} has no {index.upper()} and is left out of its mean."
        for it in scores
        for index in ("c", "d")
        if getattr(it, index) is None
    ]
    c, d = _means(scores, "c"), _means(scores, "d")
    return Calibration(by, _scale(c, by), _scale(d, by), c, d, tuple(left_out))


def _means(scores: Sequence[ScenarioResult], index: str) -> dict[str, float]:
    """The mean of an index, `c` or `d`, over the scenarios in which an ADS has it, by ADS."""
    values = ((it.ads, getattr(it, index)) for it in scores)
    by_ads = grouped((ads, value) for ads, value in values if value is not None)
    return {ads: float(np.mean(own)) for ads, own in by_ads.items()}


def _scale(means: Mapping[str, float], by: Any) -> float | None:
    """k5 or k6; None where no ADS has the index, or the middle one is 0.

    means: the index of each ADS.
    by: `median` or `mean`.
    """
    values = list(means.values())
    if values and middle(values, by) > 0.0:
        return population_scale(values, centre=by)
    return None


def calibration_lines(calibration: Calibration) -> Iterator[str]:
    """k5 and k6 as sentences, and the command that scores with them."""
    it, by = calibration, calibration.by
    yield from it.left_out
    options = []
    for name, index, scale, values in (("k5", "C", it.k5, it.c), ("k6", "D", it.k6, it.d)):
        means = ", ".join(f"{ads} {value:z.3f}" for ads, value in values.items()) or "none"
        if scale is None:
            words = f"is not defined: the {by} {index} is 0 or there is none"
        else:
            words = f"= {scale:z.4f}: the {by} ADS gets half of the points of {index}"
            options.append(f"--set method.score.{name}={scale:z.6g}")
        yield f"{name} {words} ({means})."
    if options:
        yield f"Score with them: sumo-eval score RUN {' '.join(options)}"
