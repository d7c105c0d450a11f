"""The posterior of the zones' Gaussian process, and danger on a scale from 0 to 1."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from twins.spaces import space

from sumo_eval.method.danger import danger
from sumo_eval.method.zone_partition import TARGET_TOLERANCE, partition
from sumo_eval.method.zone_uncertainty import NEAR, posterior_factor
from sumo_eval.scenario.catalogue import load
from sumo_eval.settings import ZoneSettings

QUICK = ZoneSettings(restarts=1, grid_points=5_000)
# 20 m/s on a standing obstacle: hazardous up to 20^2 / 10 + 5 / (2 * 0.7^2) = 45.102 m
WALL = space([("d", 0.0, 100.0, 10.0), ("other", 0.0, 1.0, 0.25)], lambda values: values["d"])


def test_the_factor_is_the_textbook_posterior_of_the_points_whose_side_is_open():
    zones = partition(WALL, QUICK)
    points = np.column_stack([np.linspace(40.0, 50.0, 21), np.full(21, 0.4)])
    surface = zones.surface

    def covariance(a, b):
        return surface.signal_deviation**2 * np.exp(
            -0.5 * cdist(a / surface.length_scales, b / surface.length_scales, "sqeuclidean")
        )

    unit = surface.coordinates(WALL.to_unit(points))
    noise = surface.noise_deviation**2 + (TARGET_TOLERANCE * zones.training_target) ** 2
    inverse = np.linalg.inv(covariance(surface.points, surface.points) + np.diag(noise))
    cross = covariance(unit, surface.points)
    posterior = covariance(unit, unit) - cross @ inverse @ cross.T
    open_ = np.abs(zones.predicted(points)) < NEAR * np.sqrt(np.maximum(np.diag(posterior), 1e-9))
    assert 0 < open_.sum() < 21
    factor = posterior_factor(zones, points)
    assert (factor @ factor.T)[np.ix_(open_, open_)] == pytest.approx(posterior[np.ix_(open_, open_)], abs=1e-6)
    assert not factor[~open_].any()


def test_where_no_process_was_fitted_or_nothing_is_open_there_is_no_doubt():
    assert posterior_factor(partition(load("front_vehicle_low_speed"), QUICK), [[20.0, 5.0]]).shape == (1, 0)
    zones = partition(WALL, QUICK)
    assert posterior_factor(zones, [[99.0, 0.5], [2.0, 0.5]]).shape == (2, 0)
    assert posterior_factor(zones, np.zeros((0, 2))).shape == (0, 0)


def test_danger_is_one_half_on_the_boundary_and_grows_towards_the_impact():
    gaps = np.array([5.0, 20.0, 45.102, 60.0, 100.0])
    found = danger(WALL, np.column_stack([gaps, np.full(5, 0.5)]), ZoneSettings())
    assert found[2] == pytest.approx(0.5, abs=1e-4)
    assert (np.diff(found) < 0.0).all()
    assert found.min() > 0.0
    assert found.max() < 1.0
    # 60 m: ideal braking stops 20 m short, where ITTC is largest at sqrt(2 * 5 * 20) = 14.14 m/s:
    # T = 2 (20 m) / 14.14 = 2.8284 s; y = tanh((8 - 2.0408) / 10) = 0.53438
    assert found[3] == pytest.approx((1 - np.tanh((8.0 - 0.7**-2) / 10)) / 2, abs=1e-6)
