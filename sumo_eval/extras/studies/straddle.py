"""Boundary between two outcomes with few trials: ask for points, tell their outcomes.

A Gaussian process classifier (logistic, Laplace's approximation) learns the outcomes in the unit
box. The next points are those where the sign of its latent function f is most open: the straddle
rule of Bryan et al. (2005), 1.96 sd(f) - |mean(f)|. The points of one round are chosen in order,
each as if the earlier ones had been tried; one in eight goes where sd(f) alone is
largest, so that an isolated island is found as well. The shape of the sets is free: intervals,
holes and several pieces are as good as a half-space.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.special import expit
from scipy.stats import norm
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessClassifier
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sumo_eval.errors import InputError
from sumo_eval.scenario.logical import LogicalScenario
from sumo_eval.scenario.sampling.drawn_points import evenly
from sumo_eval.settings.random_streams import random_stream
from sumo_eval.trajectory import BoolArray, FloatArray

POOL = 4_096  # points of the space that are weighed in each round
STRADDLE = 1.96
EXPLORE_EVERY = 8  # of a round, every eighth point goes where least is known
# The kernel's constants are sought again each time the number of trials has grown by half. Those
# that were sought with this many trials or more stay.
LEARN_UNTIL = 300
SIGNAL_BOUNDS, SCALE_BOUNDS = (1.0, 1e3), (0.02, 10.0)  # variance of f; unit-box lengths
LABEL_VARIANCE = 1.0  # an outcome is assumed to tell as much as f measured with this variance
CONVERGED = 1e-3  # largest difference of a trial's probability from that of f, as in `_at_mode`
CONTRADICTED = 0.05  # share of trials that the classifier may put on the wrong side
REMEMBERED = 4  # rounds whose changes predict those of the next one
SAME = 1e-9  # unit-box lengths


class BoundarySearch:
    """The search in the possible points of a space. Same seed and same outcomes, same questions."""

    def __init__(self, logical: LogicalScenario, seed: int = 1) -> None:
        listed = [item.name for item in logical.parameters if item.values]
        if listed:
            raise InputError(
                f"`{listed[0]}` of scenario `{logical.name}` has listed values only, and between "
                "them there is no boundary: hold it fixed."
            )
        self.logical = logical
        self.points: FloatArray = np.empty((0, len(logical.names)))
        self.outcomes: BoolArray = np.empty(0, dtype=np.bool_)
        self._model: GaussianProcessClassifier | None = None
        self._learnt_at = 0
        self._classes: BoolArray | None = None
        self._changes: list[float] = []
        self._skipped: set[tuple[float, ...]] = set()
        pool = evenly(logical, POOL, random_stream(seed, "boundary", logical.name))
        self._pool = pool[logical.feasible(pool)]
        if not len(self._pool):
            raise InputError(
                f"Scenario `{logical.name}` must have a possible point among {POOL} evenly spread "
                "ones, got none."
            )

    def ask(self, n: int) -> FloatArray:
        """The next `n` points (n, k) to try; evenly spread ones until both outcomes have been
        seen.
        """
        tried = {tuple(row) for row in self.points.tolist()} | self._skipped
        untried = np.array([row for row in self._pool.tolist() if tuple(row) not in tried])
        if self._model is None or not len(untried):
            return untried[:n]
        unit = self.logical.to_unit(untried)
        mean, variance, covariance = self._latent(unit)
        chosen: list[int] = []
        for number in range(min(n, len(untried))):
            score = np.sqrt(np.maximum(variance, 0.0))
            if number % EXPLORE_EVERY < EXPLORE_EVERY - 1:
                score = STRADDLE * score - np.abs(mean)
            score[chosen] = -np.inf
            best = int(np.argmax(score))
            chosen.append(best)
            shared = covariance(best)
            # its outcome will narrow f, whatever it is
            variance = variance - shared**2 / (shared[best] + LABEL_VARIANCE)
        return untried[chosen]

    def tell(self, points: ArrayLike, outcomes: ArrayLike) -> None:
        """Outcomes (n,), True or False, at points (n, k)."""
        rows, hits = np.asarray(points, dtype=np.float64), np.asarray(outcomes, dtype=np.bool_)
        self.points = np.concatenate([self.points, rows])
        self.outcomes = np.concatenate([self.outcomes, hits])
        if self.outcomes.any() and not self.outcomes.all():
            self._fit()

    def skip(self, points: ArrayLike) -> None:
        """Points (n, k) that could not be evaluated: they are not asked for again, and teach
        nothing.
        """
        self._skipped |= {tuple(row) for row in np.asarray(points, dtype=np.float64).tolist()}

    def probability(self, points: ArrayLike) -> FloatArray:
        """Probability (n,) that the outcome at points (n, k) is True, by the trials so far."""
        rows = np.asarray(points, dtype=np.float64)
        if self._model is None:
            return np.full(len(rows), float(self.outcomes[0]) if len(self.outcomes) else 0.5)
        mean, variance, _ = self._latent(self.logical.to_unit(rows))
        # P(f > 0), f being normal
        return np.asarray(norm.cdf(mean / np.sqrt(np.maximum(variance, SAME))))

    def classify(self, points: ArrayLike) -> BoolArray:
        """The likelier outcome (n,) at points (n, k)."""
        return np.asarray(self.probability(points) >= 0.5)

    @property
    def expected_change(self) -> float:
        """Share of the possible points that the next round is expected to class differently: the
        mean of the last four changes from one fit to the next; 1 until five fits have been made,
        which need both outcomes, and while the classifier contradicts its trials.
        """
        last = self._changes[-REMEMBERED:]
        if (
            len(last) < REMEMBERED
            or np.mean(self.classify(self.points) != self.outcomes) > CONTRADICTED
        ):
            return 1.0
        return float(np.mean(last))

    @property
    def doubt(self) -> float:
        """Mean probability that a possible point is in the wrong class; Laplace's approximation
        makes it too large.
        """
        if self._model is None:
            return 1.0
        probability = self.probability(self._pool)
        return float(np.mean(np.minimum(probability, 1.0 - probability)))

    def _fit(self) -> None:
        n = len(self.outcomes)
        kernel: Any = None
        if self._model is not None and (
            n < 1.5 * self._learnt_at or self._learnt_at >= LEARN_UNTIL
        ):
            kernel = self._model.kernel_
        learn = kernel is None
        if learn:
            # always from the same start: an earlier search may have ended in a poor place
            scales = RBF(np.full(len(self.logical.names), 0.3), SCALE_BOUNDS)
            kernel = ConstantKernel(100.0, SIGNAL_BOUNDS) * scales
            self._learnt_at = n
        unit = self.logical.to_unit(self.points)
        with warnings.catch_warnings(), threadpool_limits(1):
            # constants at their bounds do no harm here
            warnings.simplefilter("ignore", ConvergenceWarning)
            optimizer = "fmin_l_bfgs_b" if learn else None
            model = GaussianProcessClassifier(kernel, optimizer=optimizer).fit(unit, self.outcomes)
            # Newton's steps can overshoot where f may be very large, and scikit-learn ends
            # silently. Halve the variance of f until they converge.
            while not _at_mode(model) and model.kernel_.k1.constant_value > 2.0:
                signal = ConstantKernel(model.kernel_.k1.constant_value / 2.0, SIGNAL_BOUNDS)
                kernel = signal * model.kernel_.k2
                model = GaussianProcessClassifier(kernel, optimizer=None).fit(unit, self.outcomes)
        self._model = model
        classes = self.classify(self._pool)
        if self._classes is not None:
            self._changes.append(float(np.mean(classes != self._classes)))
        self._classes = classes

    def _latent(
        self, unit: FloatArray
    ) -> tuple[FloatArray, FloatArray, Callable[[int], FloatArray]]:
        """Mean and variance of f at points (n, k) of the unit box, and a function that gives the
        covariance of f at one of them with all, given the trials and the points that it was called
        with before.
        """
        assert self._model is not None
        inner = self._model.base_estimator_
        kernel = inner.kernel_
        cross = kernel(inner.X_train_, unit)
        mean = cross.T @ (inner.y_train_ - inner.pi_)
        half = solve_triangular(inner.L_, inner.W_sr_[:, None] * cross, lower=True)
        variance = kernel.diag(unit) - np.einsum("ij,ij->j", half, half)
        known: list[FloatArray] = []

        def covariance(row: int) -> FloatArray:
            shared = kernel(unit, unit[row : row + 1])[:, 0] - half.T @ half[:, row]
            for before in known:
                shared = shared - before * before[row]
            known.append(shared / np.sqrt(shared[row] + LABEL_VARIANCE))
            return np.asarray(shared)

        return mean, variance, covariance


def _at_mode(model: GaussianProcessClassifier) -> bool:
    """Whether Laplace's approximation has converged to the mode, where f = K (y - p) and the
    probabilities p of the trials are those of f itself, 1 / (1 + exp(-f)).
    """
    inner = model.base_estimator_
    f = inner.kernel_(inner.X_train_) @ (inner.y_train_ - inner.pi_)
    return bool(np.max(np.abs(expit(f) - inner.pi_)) < CONVERGED)
