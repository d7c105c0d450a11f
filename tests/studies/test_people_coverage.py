"""`humans coverage`: the paper's space misses people at motorway speeds, its motorway variant has them."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from drivers.test_reference import write_people

from sumo_eval.cli import main
from sumo_eval.drivers.recorded.matching import match_of
from sumo_eval.scenario.file import check_file, read_scenario
from sumo_eval.scenario.shipped_files import scenario_files

MOTORWAY = sorted(file for name, file in scenario_files().items() if name.startswith("motorway_"))
EVALUATION = """
name = "people"
[[scenario]]
use = "USE"
[[ads]]
name = "idm"
controller = "idm"
[drivers]
source = "recorded"
recordings = ["people.csv"]
least = 2
"""


@pytest.mark.parametrize("file", MOTORWAY, ids=lambda file: file.stem)
def test_the_motorway_variants_can_be_placed_and_name_their_event(file):
    assert "possible points" in check_file(file)[1]
    logical = read_scenario(file)
    match = match_of(logical.name, logical.recorded)
    assert set(match.columns) == set(logical.names) == set(match.tolerance)


def test_people_at_motorway_speeds_are_in_the_variant_and_not_in_the_papers_space(tmp_path):
    write_people(tmp_path / "people.csv", np.linspace(34.0, 41.0, 8).tolist(), lead_step=4.0)  # leaders at 15, 19, 23
    for use, people in (("front_vehicle_low_speed", False), ("motorway_approach", True)):
        (tmp_path / "evaluation.toml").write_text(EVALUATION.replace("USE", use))
        result = CliRunner().invoke(main, ["humans", "coverage", str(tmp_path / "evaluation.toml")])
        assert result.exit_code == 0, result.output
        assert "8 approach events" in result.output
        assert ("WARN" in result.output) is not people


def test_an_evaluation_with_synthetic_drivers_has_no_coverage(tmp_path):
    (tmp_path / "evaluation.toml").write_text(EVALUATION.replace("USE", "cut_in").replace('"recorded"', '"synthetic"'))
    result = CliRunner().invoke(main, ["humans", "coverage", str(tmp_path / "evaluation.toml")])
    assert result.exit_code == 2
    assert "must ask for recorded people" in result.output + result.stderr
