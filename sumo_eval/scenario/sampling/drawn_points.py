"""Points drawn at random or evenly: Latin hypercube, Sobol, Halton, by exposure, by exposure and
danger.

The sequences are scipy's, started from a named stream of the seed. Values are rounded to a
millionth of their range, so that the last digit of a machine's arithmetic decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.trajectory import FloatArray

Attention = Callable[[FloatArray], FloatArray]
"""Points (n, k) -> how much more often than by exposure each is drawn, up to a factor, (n,)."""
CANDIDATES = 64  # drawn for each point that is chosen among them
MOST_CANDIDATES = 2**18
# share of the attention that goes where nothing is dangerous: no place is left out
LEAST_DANGER = 0.05


def sequence(name: str) -> Callable[[LogicalScenario, Request], Drawn]:
    """The method that takes the first `count` points of a sequence: `latin_hypercube`, `sobol` or
    `halton`.

    A Latin hypercube has one point in each of `count` layers of every axis. Sobol and Halton
    sequences are scrambled.
    """

    def first_points(logical: LogicalScenario, request: Request) -> Drawn:
        count, stream = request.wanted(logical), request.stream(logical, name)
        if name == "sobol":
            uneven = (f"Sobol points are evenest in powers of 2; {count} is none.",)
            points = evenly(logical, count, stream)
            return Drawn(points, notes=uneven if count & (count - 1) else ())
        kind = _qmc().LatinHypercube if name == "latin_hypercube" else _qmc().Halton
        return Drawn(logical.from_shares(kind(len(logical.names), rng=stream).random(count)))

    return first_points


def by_exposure(logical: LogicalScenario, request: Request) -> Drawn:
    """`count` points drawn with the scenario's exposure as density. A point counts as many times as
    it was drawn.
    """
    points, share = _drawn(logical, request, "exposure", lambda rows: np.ones(len(rows)))
    return Drawn(points, exposure=1.0 / share, notes=_fewer(len(points), request))


def by_exposure_and_danger(logical: LogicalScenario, request: Request) -> Drawn:
    """`count` points, the more dangerous ones more often; each counts the less for that.

    Drawn with a density in proportion to exposure * danger, so a point's exposure is 1 / danger, up
    to a factor.
    """
    if request.danger is None:
        raise InputError(f"`exposure_danger` in {owner_of(logical)} needs a danger of each point.")
    danger = request.danger
    points, drawn_more = _drawn(
        logical, request, "exposure_danger", lambda rows: LEAST_DANGER + danger(rows)
    )
    return Drawn(
        points, exposure=float(np.mean(drawn_more)) / drawn_more, notes=_fewer(len(points), request)
    )


def evenly(logical: LogicalScenario, count: int, stream: np.random.Generator) -> FloatArray:
    """The first `count` points (n, k) of a scrambled Sobol sequence over the box."""
    return logical.from_shares(_sobol(len(logical.names), count, stream))


def steadily(k: int, count: int) -> FloatArray:
    """The additive recurrence x_i = frac(1/2 + i / phi^(1..k)): the first `count` points (count, k)
    of the unit box.

    phi: root of phi^(k+1) = phi + 1. It lies about as evenly as a Sobol sequence, and takes no seed
        and no scipy.
    """
    phi = 2.0
    for _ in range(60):  # fixed-point iteration: to the last bit
        phi = (1.0 + phi) ** (1.0 / (k + 1))
    return (0.5 + np.outer(np.arange(count), phi ** -np.arange(1.0, k + 1))) % 1.0


def _drawn(
    logical: LogicalScenario, request: Request, label: str, attention: Attention
) -> tuple[FloatArray, FloatArray]:
    """Points drawn in proportion to exposure times attention, and the attention that each got,
    divided by how often it was drawn.

    Candidates come evenly from the parameters' distributions, or evenly over the range without one.
    So a candidate's weight has only the rest of the exposure, without these distributions, times
    the attention.
    """
    count = request.wanted(logical)
    stream = request.stream(logical, label)
    candidates = max(min(max(1024, CANDIDATES * count), MOST_CANDIDATES), count)
    shares = _sobol(len(logical.names), candidates, stream)
    points, density = logical.from_shares(shares), np.ones(len(shares))
    for column, item in enumerate(logical.parameters):
        if item.distribution is not None and not item.values:
            low, high = item.low, item.high
            drawn = item.distribution.quantile(shares[:, column], low, high)
            points[:, column] = item.rounded(drawn)
            density *= item.distribution.density(points[:, column], low, high)
    exposure = logical.exposures(points)
    attentions = np.asarray(attention(points))
    weight = attentions * np.divide(
        exposure, density, out=np.zeros(len(points)), where=density > 0.0
    )
    if not (np.all(np.isfinite(weight)) and weight.sum() > 0.0):
        must = "finite, and above 0 somewhere"
        raise must_be("The exposure", f"scenario `{logical.name}`", must, weight.sum())
    if np.ptp(weight) <= 1e-9 * weight.max():
        return points[:count], attentions[:count]
    # Systematic sampling: the candidates' weights stand side by side, and picks at equal distances
    # take the candidates they fall on, a heavy one perhaps twice. First the candidates are
    # shuffled, because neighbours in a Sobol sequence are not neighbours in space.
    order = stream.permutation(len(points))
    points, attentions, weight = points[order], attentions[order], weight[order]
    picks = (stream.uniform() + np.arange(count)) / count
    reach = np.cumsum(weight) / weight.sum()
    places = np.minimum(np.searchsorted(reach, picks), len(points) - 1)
    chosen, times = np.unique(places, return_counts=True)
    return points[chosen], attentions[chosen] / times


def _fewer(different: int, request: Request) -> tuple[str, ...]:
    """A note where fewer different points came than were asked for."""
    if request.count == different:
        return ()
    return (
        f"{request.count} points were asked for; {different} different ones came, because some are "
        "very frequent.",
    )


def _sobol(k: int, count: int, stream: np.random.Generator) -> FloatArray:
    """The first points (count, k) of a scrambled Sobol sequence; drawn to the next power of 2,
    where it is even.
    """
    return np.asarray(
        _qmc().Sobol(k, rng=stream).random_base2(max(0, math.ceil(math.log2(count))))[:count]
    )


def _qmc() -> Any:
    """scipy's sequences; most evaluations drive a grid and do not need the 0.6 s of this import."""
    from scipy.stats import qmc

    return qmc
