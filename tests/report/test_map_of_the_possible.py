"""Maps of a space of many parameters: where a constraint rules points out, between the points of a lattice."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from sumo_eval.report.page_data import possible_margin
from sumo_eval.scenario import catalogue


@pytest.mark.parametrize(
    ("name", "size"),
    [("cut_in", 13), ("front_vehicle_cut_out", 31), ("oncoming_in_lane", 13), ("motorway_approach", 73)],
)
def test_law_between_points_of_the_lattice_a_margin_errs_within_a_twentieth_of_a_cell(name: str, size: int) -> None:
    logical = catalogue.load(name)
    k = len(logical.names)
    margin = possible_margin(logical, size).reshape((size,) * k).astype(float) / 16.0
    unit = np.random.default_rng(1).random((20_000, k))
    found = RegularGridInterpolator([np.linspace(0.0, 1.0, size)] * k, margin)(unit)
    wrong = (found > 0.0) != logical.feasible(logical.from_unit(unit))
    assert 0.1 < np.mean(found > 0.0) < 0.999
    assert np.mean(wrong) < 0.0015
    assert np.abs(found[wrong]).max(initial=0.0) < 0.05


def test_a_margin_counts_sixteenths_of_a_cell_along_the_axis_on_which_the_edge_is_nearest() -> None:
    margin = possible_margin(catalogue.load("motorway_approach"), 8).reshape(8, 8)  # lead_speed < ego_speed
    # cells of 20 / 7 and 15 / 7 m/s. Ego 25, lead 20 m/s: 5 m/s below the edge on the lead's axis, 5 * 7 / 15 = 2.33
    assert margin[0, 0] == round(16 * 5 * 7 / 15)
    # ego 25, lead 35 m/s is ruled out by 10 m/s: 4.67 cells on the lead's axis, 3.5 on the ego's
    assert margin[0, 7] == -round(16 * 10 * 7 / 20)
    # ego 45, lead 20 m/s: no point of either axis through it is ruled out
    assert margin[7, 0] == 127
