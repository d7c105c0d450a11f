"""The zones' Gaussian process beside scikit-learn's, and beside differences of its own value."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from sumo_eval.method.gaussian_process import (
    Hyperparameters,
    covariance,
    marginal_likelihood,
    most_likely,
)

POINTS = np.random.default_rng(4).random((60, 3))
TARGET = np.sin(5.0 * POINTS[:, 0]) + POINTS[:, 1] ** 2 + 0.4 * np.cos(4.0 * POINTS[:, 2]) - 0.5
VARIANCES = (0.1 * TARGET) ** 2
SOME = Hyperparameters(0.8, (0.4, 0.7, 2.5), 3e-3)
BOUNDS = np.log([(1e-2, 1e2), (0.1, 10.0), (0.1, 10.0), (0.1, 10.0), (1e-6, 1.0)])


def textbook():
    """The kernel with the parameters SOME."""
    signal, first, second, third, noise = np.exp(BOUNDS).tolist()
    scales = RBF(SOME.length_scales, (first, second, third))
    return ConstantKernel(SOME.signal, signal) * scales + WhiteKernel(SOME.noise, noise)


def test_two_points_by_hand():
    # One apart at length scale 1: exp(-1/2) = 0.60653 of the signal 2; on the diagonal signal and
    # noise, 2.5.
    k = covariance(np.array([[0.0], [1.0]]), Hyperparameters(2.0, (1.0,), 0.5))
    assert k == pytest.approx(np.array([[2.5, 1.2130613], [1.2130613, 2.5]]))


def test_the_covariance_is_scikit_learns_to_the_bit():
    assert np.array_equal(covariance(POINTS, SOME), textbook()(POINTS))


@pytest.mark.parametrize("shift", [0.0, 0.6, -1.1])
def test_the_likelihood_and_its_gradient_are_scikit_learns(shift):
    theta = SOME.logarithms + shift * np.array([1.0, -1.0, 0.5, 1.0, 2.0])
    value, gradient = marginal_likelihood(POINTS, TARGET, VARIANCES)(theta)
    other = GaussianProcessRegressor(textbook(), alpha=VARIANCES, optimizer=None).fit(
        POINTS, TARGET
    )
    expected, slope = other.log_marginal_likelihood(theta, eval_gradient=True)
    assert value == pytest.approx(-expected, rel=1e-10)
    assert gradient == pytest.approx(-slope, rel=1e-8, abs=1e-9)


def test_law_the_gradient_is_how_the_value_changes():
    likelihood = marginal_likelihood(POINTS, TARGET, VARIANCES)
    differences = approx_fprime(SOME.logarithms, lambda theta: likelihood(theta)[0], 1e-6)
    assert likelihood(SOME.logarithms)[1] == pytest.approx(differences, rel=1e-4)


def test_a_covariance_that_cannot_be_factored_is_infinitely_unlikely():
    # Twice the same point and no variance at all: K is singular; a huge signal rounds the noise of
    # 1e-300 away.
    twice = np.array([[0.5], [0.5], [0.1]])
    likelihood = marginal_likelihood(twice, np.array([1.0, 1.0, 0.0]), np.zeros(3))
    value, gradient = likelihood(Hyperparameters(1e6, (1.0,), 1e-300).logarithms)
    assert value == np.inf
    assert np.all(gradient == 0.0)


# both end at the least noise allowed
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_the_search_ends_where_scikit_learns_does():
    theta, failures = most_likely(
        marginal_likelihood(POINTS, TARGET, VARIANCES), SOME, BOUNDS, restarts=2, seed=20220
    )
    other = GaussianProcessRegressor(
        textbook(), alpha=VARIANCES, n_restarts_optimizer=2, random_state=20220
    )
    assert failures == []
    assert theta == pytest.approx(other.fit(POINTS, TARGET).kernel_.theta, abs=1e-4)


def test_a_search_that_stops_early_reports_it():
    def jagged(theta):
        return float(np.sum(theta**2)), np.ones(len(theta))  # a gradient that leads nowhere

    _, failures = most_likely(jagged, SOME, BOUNDS, restarts=0, seed=1)
    assert len(failures) == 1
