"""Points drawn at random or evenly: the methods `latin_hypercube`, `sobol`, `halton`, `exposure`
and `exposure_danger` of `sampling`.

The sequences are scipy's, started from a named stream of the seed. Values are rounded
(`logical.DIGITS`), so that all machines draw the same points.

Users: `extras/rates/importance.py`, `extras/studies/boundary_page.py`,
`extras/studies/straddle.py`, `method/zone_partition.py`, `scenario/sampling/adaptive.py`,
`scenario/sampling/samples.py`, `scoring/confidence/coverage.py`,
`scoring/confidence/further_cases.py`.
"""

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from sumo_eval.errors import InputError, must_be
from sumo_eval.scenario.distribution import scipy_stats
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.request import Drawn, Request, owner_of
from sumo_eval.trajectory import FloatArray, IntArray

Attention = Callable[[FloatArray], FloatArray]
"""Points (n, k) -> factors (n,): a point is drawn in proportion to its exposure times its factor.
"""
CANDIDATES = 64  # for each requested point, which is chosen among all candidates
LEAST_CANDIDATES, MOST_CANDIDATES = 2**10, 2**18  # in all
LEAST_DANGER = 0.05  # added to each point's danger, 0..1, so that points without any are drawn too
_EQUAL = 1e-9  # relative difference of weights that count as equal


def sequence(name: str) -> Callable[[LogicalScenario, Request], Drawn]:
    """The method of a name, `latin_hypercube`, `sobol` or `halton`: the first `count` points of
    that sequence.

    A Latin hypercube has one point in each of `count` layers of every axis. Sobol and Halton
    sequences are scrambled.
    """

    def first_points(logical: LogicalScenario, request: Request) -> Drawn:
        count = request.wanted(logical)
        stream = request.stream(logical, name)
        if name == "sobol":
            uneven = (f"Sobol points are evenest in powers of 2; {count} is none.",)
            points = evenly(logical, count, stream)
            # count & (count - 1) is 0 for a power of 2
            return Drawn(points, notes=uneven if count & (count - 1) else ())
        qmc = scipy_stats().qmc
        kind = qmc.LatinHypercube if name == "latin_hypercube" else qmc.Halton
        return Drawn(logical.from_shares(kind(len(logical.names), rng=stream).random(count)))

    return first_points


def by_exposure(logical: LogicalScenario, request: Request) -> Drawn:
    """`count` points drawn with the scenario's exposure as density. A point counts as many times as
    it was drawn.
    """
    # the attention is 1 everywhere, so `per_draw` is 1 / (times that the point was drawn)
    points, per_draw = _drawn(logical, request, "exposure", lambda rows: np.ones(len(rows)))
    return Drawn(points, exposure=1.0 / per_draw, notes=_fewer(len(points), request))


def by_exposure_and_danger(logical: LogicalScenario, request: Request) -> Drawn:
    """`count` points, dangerous ones drawn more often than their exposure and counting less.

    They are drawn with a density proportional to exposure * danger and weighted by 1 / danger, so
    that a weighted mean over the points estimates the mean over the exposure.
    """
    if request.danger is None:
        raise InputError(f"`exposure_danger` in {owner_of(logical)} needs a danger of each point.")
    danger = request.danger
    points, per_draw = _drawn(
        logical, request, "exposure_danger", lambda rows: LEAST_DANGER + danger(rows)
    )
    # a common factor of the weights changes nothing: the mean only brings them near 1
    return Drawn(
        points, exposure=float(np.mean(per_draw)) / per_draw, notes=_fewer(len(points), request)
    )


def evenly(logical: LogicalScenario, count: int, stream: Generator) -> FloatArray:
    """The first `count` points (n, k) of a scrambled Sobol sequence over the box."""
    return logical.from_shares(_sobol(len(logical.names), count, stream))


def steadily(k: int, count: int) -> FloatArray:
    """The first `count` points (count, k) of the unit box by an additive recurrence: coordinate j
    of point i is frac(1/2 + i / phi^j), where phi^(k+1) = phi + 1.

    They lie about as evenly as a Sobol sequence, and need no seed and no scipy.
    """
    phi = 2.0
    for _ in range(60):  # fixed-point iteration, converged to the last bit
        phi = (1.0 + phi) ** (1.0 / (k + 1))
    return (0.5 + np.outer(np.arange(count), phi ** -np.arange(1.0, k + 1))) % 1.0


def _drawn(
    logical: LogicalScenario, request: Request, label: str, attention: Attention
) -> tuple[FloatArray, FloatArray]:
    """Different points (m, k) drawn in proportion to exposure times attention, and for each its
    attention divided by how often it was drawn, (m,).

    label: name of the method's stream of random numbers.
    """
    count = request.wanted(logical)
    stream = request.stream(logical, label)
    number = max(min(max(LEAST_CANDIDATES, CANDIDATES * count), MOST_CANDIDATES), count)
    points, density = _candidates(logical, _sobol(len(logical.names), number, stream))
    exposure = logical.exposures(points)
    attentions = np.asarray(attention(points))
    # 0 where the density is 0, and at an end of a range where both are infinite
    has_density = (density > 0.0) & np.isfinite(density)
    per_density = np.divide(exposure, density, out=np.zeros(len(points)), where=has_density)
    weight = attentions * per_density
    if not (np.all(np.isfinite(weight)) and weight.sum() > 0.0):
        must = "finite, and above 0 somewhere"
        raise must_be("The exposure", f"scenario `{logical.name}`", must, weight.sum())
    if np.ptp(weight) <= _EQUAL * weight.max():  # the sequence is even as it is
        return points[:count], attentions[:count]
    chosen, times = _systematic(weight, count, stream)
    return points[chosen], attentions[chosen] / times


def _candidates(logical: LogicalScenario, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (n, k) at shares 0..1 of each axis, and the density with which they lie, (n,).

    They follow the distribution of each parameter that has one, and are even over the range of any
    other. Listed values are even, too: the exposure has their probability.
    """
    points = logical.from_shares(shares)
    density = np.ones(len(shares))
    for column, item in enumerate(logical.parameters):
        if item.distribution is not None and not item.values:
            low, high = item.low, item.high
            drawn = item.distribution.quantile(shares[:, column], low, high)
            points[:, column] = item.rounded(drawn)
            density *= item.distribution.density(points[:, column], low, high)
    return points, density


def _systematic(weight: FloatArray, count: int, stream: Generator) -> tuple[IntArray, IntArray]:
    """Systematic sampling: numbers of the drawn candidates, each once, and how often each is drawn.

    The weights are laid end to end on a line of length 1. `count` picks at equal distances each
    draw the candidate on whose part they fall, a heavy one perhaps twice. The order on the line is
    shuffled, because neighbours in a Sobol sequence are not neighbours in space.
    """
    order = stream.permutation(len(weight))
    picks = (stream.uniform() + np.arange(count)) / count
    ends = np.cumsum(weight[order]) / weight[order].sum()
    picked = np.minimum(np.searchsorted(ends, picks), len(weight) - 1)  # last end may round below 1
    places, times = np.unique(picked, return_counts=True)
    return order[places], times


def _fewer(different: int, request: Request) -> tuple[str, ...]:
    """A note if fewer different points were drawn than were requested; else none."""
    if request.count == different:
        return ()
    return (
        f"{request.count} points were asked for; {different} different ones came, because some are "
        "very frequent.",
    )


def _sobol(k: int, count: int, stream: Generator) -> FloatArray:
    """The first points (count, k) of a scrambled Sobol sequence, which is drawn up to the next
    power of 2, where it is even.
    """
    power = (count - 1).bit_length()  # the least with 2^power >= count
    return np.asarray(scipy_stats().qmc.Sobol(k, rng=stream).random_base2(power)[:count])
