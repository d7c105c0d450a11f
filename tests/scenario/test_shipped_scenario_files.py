"""The shipped scenarios as files: each says exactly what the scenario of that name in the catalogue does."""

import numpy as np
import pytest
from scipy.stats import qmc

from sumo_eval.scenario import catalogue
from sumo_eval.scenario.file import check_file, read_scenario
from sumo_eval.scenario.sampling import sample
from sumo_eval.scenario.shipped_files import scenario_file

NAMES = sorted(catalogue.SCENARIOS)


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_scenario_is_equal_to_its_file(name):
    shipped, written = catalogue.load(name), read_scenario(scenario_file(name))
    for part in (
        "name",
        "about",
        "source",
        "parameters",
        "road",
        "ego_body",
        "time_limit",
        "samples",
        "default_sample",
    ):
        assert getattr(written, part) == getattr(shipped, part), part
    assert written.exposure_about == shipped.exposure_about
    box = shipped.from_unit(qmc.Sobol(len(shipped.names), rng=np.random.default_rng(7)).random(256))
    points = np.concatenate([box, sample(shipped).points])
    assert np.array_equal(written.feasible(points), shipped.feasible(points))
    assert [c.about for c in written.constraints] == [c.about for c in shipped.constraints]
    possible = points[shipped.feasible(points)]
    for ours, theirs in zip(written.concretes(possible), shipped.concretes(possible), strict=True):
        assert ours == theirs
    columns = shipped.columns(points)
    ours, theirs = written.approach(columns), shipped.approach(columns)
    for part in ("ego_speed", "obstacle_speed", "gap", "delay", "obstacle_deceleration", "conflict_begin"):
        assert np.allclose(getattr(ours, part), getattr(theirs, part), rtol=1e-12, atol=1e-12), part
    assert (written.zone_coordinates is None) == (shipped.zone_coordinates is None)
    if shipped.zone_coordinates is not None:
        assert written.zone_coordinates.names == shipped.zone_coordinates.names
        pairs = zip(written.zone_coordinates.of(columns), shipped.zone_coordinates.of(columns), strict=True)
        assert all(np.allclose(mine, other, rtol=1e-12, atol=1e-12) for mine, other in pairs)
    assert ours.passing_length == theirs.passing_length
    assert ours.has_closed_form == theirs.has_closed_form


@pytest.mark.parametrize("name", NAMES)
def test_the_check_of_a_shipped_file_counts_its_points(name):
    chosen = sample(catalogue.load(name))
    sentences = check_file(scenario_file(name))
    assert f"{len(chosen.points)} possible points; constraints refuse {len(chosen.refused)} more." in sentences[1]
