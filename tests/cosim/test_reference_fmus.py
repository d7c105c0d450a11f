"""Modelica's Reference-FMUs (https://github.com/modelica/Reference-FMUs) drive as they are, FMI 2.0
and 3.0.

Their releases are no package: REFERENCE_FMUS names a folder with `2.0` and `3.0` as in the
release's archive.
"""

import os
from pathlib import Path

import pytest
from refusals import refusal
from road_scenes import half_second, lead
from tables import values_of

from sumo_eval.cosim.doors.controller import load_controller

if "REFERENCE_FMUS" not in os.environ:
    pytest.skip(
        "REFERENCE_FMUS names no folder with Modelica's Reference-FMUs", allow_module_level=True
    )
FOLDER = Path(os.environ["REFERENCE_FMUS"])
TYPES = {
    "2.0/Feedthrough.fmu": ("Float64_continuous", "Int32"),
    "3.0/Feedthrough.fmu": (
        "Float64_continuous", "Float64_discrete", "Float32_continuous", "Int8", "Int16", "Int32",
        "Int64",
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "file, kind", [(file, kind) for file, kinds in TYPES.items() for kind in kinds]
)
def test_feedthrough_gives_back_what_it_is_given_in_every_type(file, kind):
    """-2 in, -2 m/s2 out; all its other inputs keep their start values."""
    locator = f"fmu:{file}?inputs.{kind}_input=-2&inputs.*=start&outputs.acceleration={kind}_output"
    found = half_second(locator, lead(80.0), folder=FOLDER)
    assert found.error is None, found.log
    assert found.ego.acceleration[-1] == -2.0


def test_feedthrough_takes_texts_truth_and_enumerations_beside():
    given = "Boolean_input=true&inputs.Enumeration_input=2&inputs.String_input='hello'&inputs.Binary_input=abc"
    locator = f"fmu:3.0/Feedthrough.fmu?inputs.{given}&inputs.*=start&outputs.acceleration=Enumeration_output"
    found = half_second(locator, folder=FOLDER)
    assert found.error is None, found.log
    assert found.ego.acceleration[-1] == 2.0


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize(
    "name, output",
    values_of("""
    "BouncingBall", "v"
    "Dahlquist", "x"
    "Stair", "counter"
    "VanDerPol", "x1"
    "Resource", "y"
    """),
)
def test_models_without_inputs_drive_too(version, name, output):
    found = half_second(f"fmu:{version}/{name}.fmu?outputs.acceleration={output}", folder=FOLDER)
    assert found.error is None, found.log


def test_a_state_space_takes_an_array():
    locator = "fmu:3.0/StateSpace.fmu?inputs.u=objects_gap&inputs.*=start&outputs.acceleration=y[0]"
    assert half_second(locator, lead(80.0), folder=FOLDER).error is None


def test_clocks_is_refused_for_what_it_is():
    with refusal("must be one for co-simulation, got one for scheduled execution"):
        load_controller("fmu:3.0/Clocks.fmu", FOLDER)
