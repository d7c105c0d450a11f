"""Exposure p_i: how often a concrete scenario occurs on the road, from recorded events or as
declared.

scipy and the recordings' pandas take 1 s to import, so they are imported only where an exposure
needs them.

Users: `extras/rates/people_command.py`, `record/facts.py`, `scoring/steps.py`.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.errors import InputError, check_known, must_be
from sumo_eval.scenario.distribution import scipy_stats
from sumo_eval.scenario.logical import LogicalScenario, PointFunction, Values, uniform_exposure
from sumo_eval.settings import DeclaredDistribution, DriverSettings, ExposureSettings
from sumo_eval.trajectory import BoolArray, FloatArray

FOLDS = 5  # of cross-validation, as is usual: each fit has four fifths of the events
_EVENTS_A_PARAMETER = 5  # fewer show no distribution
# SI units; events do not vary along a direction in which the root of the sum of their squared
# deviations is at most this
_SAME = 1e-6
# bandwidths that cross-validation chooses from, as multiples of the data's deviation
FACTORS = np.geomspace(0.1, 1.5, 15)
SUPPORT = 3.0  # kernel deviations; a point further from every event is outside the data's support
SPACE_POINTS = 4096  # on which the share of the space without support is measured


class RecordedExposure(NamedTuple):
    """A Gaussian KDE over the parameters of recorded events.

    names: parameters, in the order of the columns of `points`.
    points: the events, (n, k).
    factor: bandwidth as a multiple of the data's deviation.
    held_out: mean log density of events that were left out of the fit (5 folds), nats, by fit:
        `scott`, `cross_validated`, `single_gaussian` or `uniform`.
    """

    names: tuple[str, ...]
    points: FloatArray
    factor: float
    held_out: Mapping[str, float]

    def density(self, values: Values) -> FloatArray:
        """p at values by name (arrays that broadcast)."""
        places = np.stack(np.broadcast_arrays(*(values[name] for name in self.names)))  # (k, ...)
        kde = scipy_stats().gaussian_kde(self.points.T, bw_method=self.factor)
        return np.reshape(kde(places.reshape(len(places), -1)), places.shape[1:])

    def supported(self, points: FloatArray) -> BoolArray:
        """Whether each of the points (m, k) is within `SUPPORT` kernel deviations of at least one
        event.
        """
        from scipy.spatial import cKDTree

        kernel = np.atleast_2d(np.cov(self.points.T)) * self.factor**2
        whiten = np.linalg.inv(np.linalg.cholesky(kernel))
        distance, _ = cKDTree(self.points @ whiten.T).query(points @ whiten.T)
        return np.asarray(distance <= SUPPORT)


class RunExposure(NamedTuple):
    """Exposure of a scenario's concrete scenarios.

    density: p at values by name.
    about: one sentence.
    recorded: the KDE, where recordings are the source.
    unsupported_share: share of the possible space outside the data's support; None without data,
        or where no point that was tried is possible.
    """

    density: PointFunction
    about: str
    recorded: RecordedExposure | None = None
    unsupported_share: float | None = None

    @property
    def known(self) -> bool:
        """Whether it was declared or measured; else every concrete scenario counts the same."""
        return self.density is not uniform_exposure

    def plain(self, points: FloatArray) -> dict[str, Any]:
        """Its record for a run's JSON.

        points: (n, k), the concrete scenarios of the run.
        """
        content = {"about": self.about, "known": self.known}
        if self.recorded is not None:
            content |= {
                "events": len(self.recorded.points),
                "bandwidth_factor": self.recorded.factor,
                "held_out_log_likelihood": self.recorded.held_out,
                "unsupported_share": self.unsupported_share,
                "outside_support": np.flatnonzero(~self.recorded.supported(points)).tolist(),
            }
        return content


def exposure_of(
    logical: LogicalScenario, settings: ExposureSettings, drivers: DriverSettings, source: Path
) -> RunExposure:
    """The exposure that the settings ask for.

    source: folder where relative paths start.
    """
    if settings.kind == "scenario":
        return RunExposure(logical.exposure, logical.exposure_about)
    if settings.kind == "uniform":
        return RunExposure(uniform_exposure, "uniform: every concrete scenario counts the same")
    if settings.kind == "declared":
        return _declared(logical, settings.declared or {})
    recordings = settings.recordings or drivers.recordings
    if not recordings:
        raise InputError(
            f"The exposure of scenario `{logical.name}` must name recordings, in "
            "`scenario.exposure.recordings` or `drivers.recordings`, got none."
        )
    if logical.recorded is None:  # checked before any file is read
        raise InputError(
            f"There is no recorded event that corresponds to scenario `{logical.name}`: a scenario "
            "file names its event in [recorded]."
        )
    owner = f"parameter in [recorded] of scenario `{logical.name}`"
    check_known(owner, dict(logical.recorded.columns), *logical.names)
    from sumo_eval.drivers.recorded.reference import matching_events, open_people

    people = open_people(DriverSettings(recordings=tuple(recordings)), source)
    assert people.events is not None  # there are recordings
    events = matching_events(people.events, logical.name, logical.recorded)
    model = fit_exposure(
        events[list(logical.names)].to_numpy(), logical.names, bandwidth=settings.bandwidth
    )
    share = unsupported_share(model, logical)
    words = ", ".join(f"{name} {value:.3f}" for name, value in model.held_out.items())
    return RunExposure(
        model.density,
        f"a Gaussian KDE over {len(model.points)} recorded events (bandwidth {model.factor:.3f} of "
        f"the data's deviation); held-out log-likelihood in nats an event: {words}; "
        f"{'an unknown share' if share is None else f'{share:.0%}'} of the space lies outside its "
        "support",
        model,
        share,
    )


def fit_exposure(
    events: FloatArray, names: Sequence[str], *, bandwidth: str = "scott"
) -> RecordedExposure:
    """A KDE over events (n, k).

    bandwidth: `scott`, or `cross_validated` for the best of `FACTORS` on held-out events.

    Raises InputError for fewer than 5 events a parameter, which show no distribution, and for
    events on a line.
    """
    n, k = events.shape
    least = _EVENTS_A_PARAMETER * k
    if n < least:
        raise must_be("The number of recorded events", "an exposure", f"at least {least}", n)
    fold = np.arange(n) % FOLDS
    # for each fold (every fifth event): the events outside it, and those in it
    folds = [(events[fold != number], events[fold == number]) for number in range(FOLDS)]
    fits = [events, *(train for train, _ in folds)]  # events of each fit below
    if any(np.linalg.matrix_rank(part - part.mean(axis=0), tol=_SAME) < k for part in fits):
        raise InputError(
            f"The recorded events of an exposure must vary in each of {', '.join(names)} "
            "independently, got events that do not."
        )
    scott = n ** (-1.0 / (k + 4))
    likelihoods = [_held_out(folds, partial(_kde, factor=factor)) for factor in FACTORS]
    best = np.argmax(likelihoods)
    factor = scott if bandwidth == "scott" else FACTORS[best]
    held_out = {
        "scott": _held_out(folds, partial(_kde, factor=scott)),
        "cross_validated": likelihoods[best],
        "single_gaussian": _held_out(folds, _gaussian),
        # over the smallest box around all events, held-out ones included, which favours this fit
        "uniform": -np.log(np.ptp(events, axis=0)).sum(),
    }
    return RecordedExposure(tuple(names), events, factor, held_out)


def unsupported_share(model: RecordedExposure, logical: LogicalScenario) -> float | None:
    """Share of the possible points of a space that lie outside the data's support; None where no
    point that is tried is possible.
    """
    unit = scipy_stats().qmc.Sobol(len(logical.parameters), seed=0).random(SPACE_POINTS)
    points = logical.from_unit(unit)
    possible = points[logical.feasible(points)]
    return float(np.mean(~model.supported(possible))) if len(possible) else None


def _held_out(folds: Sequence[tuple[FloatArray, FloatArray]], fit: Any) -> float:
    """Mean log density of each event under a fit without its fold.

    folds: for each, the events outside it, and those in it.
    fit: takes events, gives a function for the log density at points.
    """
    return float(np.concatenate([fit(train)(test) for train, test in folds]).mean())


def _kde(train: FloatArray, factor: float) -> Any:
    """Log density of a KDE over events, a function of points; `factor` as in `RecordedExposure`."""
    kernel = scipy_stats().gaussian_kde(train.T, bw_method=factor)
    return lambda points: kernel.logpdf(points.T)


def _gaussian(train: FloatArray) -> Any:
    """Log density of one Gaussian over all events, a function of points."""
    normal = scipy_stats().multivariate_normal(train.mean(axis=0), np.cov(train.T))
    return lambda points: np.atleast_1d(normal.logpdf(points))


def _declared(
    logical: LogicalScenario, declared: Mapping[str, DeclaredDistribution]
) -> RunExposure:
    """The exposure of declared distributions, by name of parameter."""
    if not declared:
        raise InputError(
            f"The declared exposure of scenario `{logical.name}` must name at least one parameter."
        )
    check_known(f"parameter of scenario `{logical.name}`", logical.names, *declared)

    def density(values: Values) -> FloatArray:
        product = uniform_exposure(values)  # 1: parameters that are not declared add no factor
        for name, item in declared.items():
            product = product * _distribution(item).pdf(values[name])
        return product

    words = ", ".join(
        f"{name} {item.distribution} ({item.first:g}, {item.second:g})"
        for name, item in declared.items()
    )
    return RunExposure(density, f"declared: {words}; other parameters uniform")


def _distribution(item: DeclaredDistribution) -> Any:
    """A declared distribution. Its two numbers: mean and deviation, for `lognormal` those of the
    logarithm, or the two ends of `uniform`.
    """
    stats = scipy_stats()
    if item.distribution == "normal":
        return stats.norm(item.first, item.second)
    if item.distribution == "lognormal":
        return stats.lognorm(item.second, scale=np.exp(item.first))
    return stats.uniform(item.first, item.second - item.first)
