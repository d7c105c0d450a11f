"""`fmu:`: FMUs whose inputs have all kinds of types, constants, start values and arrays.

They are built here.
"""

import re
import textwrap
import zipfile
from dataclasses import replace

import pytest
from cosim_cases import HALF_SECOND, case, lead
from refusals import refusal

from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.simulation import simulate
from sumo_eval.settings import SimulationSettings

pytest.importorskip("fmpy")

FEEDTHROUGH_2 = """
    from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String

    class Feedthrough2(Fmi2Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.real_in, self.whole_in, self.truth_in, self.text_in, self.real_out = 0.0, 7, True, "gentle", 0.0
            for name, kind in (("real_in", Real), ("whole_in", Integer), ("truth_in", Boolean), ("text_in", String)):
                self.register_variable(kind(name, causality=Fmi2Causality.input, variability=Fmi2Variability.discrete))
            self.register_variable(Real("real_out", causality=Fmi2Causality.output))
            self.register_variable(Integer("whole_out", causality=Fmi2Causality.output,
                                           variability=Fmi2Variability.discrete))
            self.whole_out = 0

        def do_step(self, current_time, step_size):
            strength = {"gentle": 1.0, "firm": 2.0}[self.text_in]
            self.real_out = -0.1 * self.whole_in * strength * self.truth_in
            self.whole_out = -self.whole_in
            return True
"""
FEEDTHROUGH_3 = """
    import numpy as np
    from pythonfmu3 import Boolean, Dimension, Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64, Int32, UInt64

    class Feedthrough3(Fmi3Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.time = 0.0
            self.gaps, self.there, self.speeds = np.full(4, -1.0), np.zeros(4, dtype=np.int32), np.zeros(3)
            self.count, self.enable = np.uint64(3), True
            size, place = [Dimension(start="4")], {"causality": Fmi3Causality.input}
            self.register_variable(Float64("time", causality=Fmi3Causality.independent,
                                           variability=Fmi3Variability.continuous))
            self.register_variable(Float64("gaps", dimensions=size, variability=Fmi3Variability.continuous,
                                           setter=lambda values: setattr(self, "gaps", np.array(values)), **place))
            self.register_variable(Int32("there", dimensions=size, variability=Fmi3Variability.discrete,
                                         setter=lambda values: setattr(self, "there", np.array(values)), **place))
            self.register_variable(UInt64("count", variability=Fmi3Variability.discrete, **place))
            self.register_variable(Boolean("enable", variability=Fmi3Variability.discrete, **place))
            self.register_variable(Float64("speeds", dimensions=[Dimension(start="3")],
                causality=Fmi3Causality.output, variability=Fmi3Variability.continuous))

        def do_step(self, current_time, step_size):
            seen = int(np.sum(self.there))
            self.speeds = np.array([-0.01 * float(np.sum(self.gaps[:seen])), -1.0 * seen, -0.5 * int(self.count)])
            return True
"""
PLANNER_2 = """
    from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real

    class Planner2(Fmi2Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.ego_x, self.ego_speed, self.number, self.places = 0.0, 0.0, 0, 3
            for name in ("ego_x", "ego_speed"):
                self.register_variable(Real(name, causality=Fmi2Causality.input))
            for part in ("time", "x", "y"):
                for place in (1, 2, 3, 4):
                    name = f"{part}_{place}"
                    setattr(self, name, 0.0)
                    self.register_variable(Real(f"plan_{part}[{place}]", causality=Fmi2Causality.output,
                                                getter=lambda name=name: getattr(self, name)))
            for name in ("number", "places"):
                self.register_variable(Integer(name, causality=Fmi2Causality.output,
                                               variability=Fmi2Variability.discrete))

        def do_step(self, current_time, step_size):
            if current_time >= 1.0 * self.number:
                self.number += 1
                for place in (1, 2, 3):
                    ahead = 2.0 * (place - 1)
                    setattr(self, f"time_{place}", current_time + ahead)
                    setattr(self, f"x_{place}", self.ego_x + 0.5 * self.ego_speed * ahead)
            return True
"""
PLANNER_3 = """
    import numpy as np
    from pythonfmu3 import Dimension, Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64

    class Planner3(Fmi3Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.time, self.ego_x, self.ego_speed = 0.0, 0.0, 0.0
            self.when, self.plan_x, self.plan_y = np.zeros(3), np.zeros(3), np.zeros(3)
            self.register_variable(Float64("time", causality=Fmi3Causality.independent,
                                           variability=Fmi3Variability.continuous))
            for name in ("ego_x", "ego_speed"):
                self.register_variable(Float64(name, causality=Fmi3Causality.input,
                                               variability=Fmi3Variability.continuous))
            for name in ("when", "plan_x", "plan_y"):
                self.register_variable(Float64(name, dimensions=[Dimension(start="3")],
                    causality=Fmi3Causality.output, variability=Fmi3Variability.continuous))

        def do_step(self, current_time, step_size):
            ahead = np.array([0.0, 2.0, 4.0])
            self.when, self.plan_x = current_time + ahead, self.ego_x + 0.5 * self.ego_speed * ahead
            return True
"""
TWO = "fmu:Feedthrough2.fmu?inputs.real_in=ego_speed&outputs.acceleration=real_out"
THREE = "fmu:Feedthrough3.fmu?inputs.gaps=objects_gap&inputs.there=objects_present&inputs.*=start"


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("feedthrough")
    for builder, name, source in (
        ("pythonfmu", "Feedthrough2", FEEDTHROUGH_2),
        ("pythonfmu3", "Feedthrough3", FEEDTHROUGH_3),
        ("pythonfmu", "Planner2", PLANNER_2),
        ("pythonfmu3", "Planner3", PLANNER_3),
    ):
        library = pytest.importorskip(f"{builder}.builder")
        file = folder / f"{name}.py"
        file.write_text(textwrap.dedent(source))
        library.FmuBuilder.build_FMU(file, dest=folder)
    return folder


def deceleration(locator, folder, *others):
    recording = simulate(case(*others), locator, SimulationSettings(time_limit=1.0), folder=folder)
    assert recording.error is None, recording.error
    return round(recording.ego.acceleration[-1], 6)


@pytest.mark.parametrize(
    "mapping, expected",
    [
        ("inputs.*=start", -0.7),
        ("inputs.whole_in=12&inputs.*=start", -1.2),
        ("inputs.whole_in=12&inputs.truth_in=false&inputs.text_in=start", 0.0),
        ("inputs.whole_in=12&inputs.truth_in=1.0&inputs.text_in='firm'", -2.4),
        ("inputs.whole_in=lead_present&inputs.truth_in=true&inputs.text_in=firm", -0.2),
    ],
)
def test_constants_start_values_and_every_type_of_fmi_2(fmus, mapping, expected):
    """-0.1 of the whole number, which starts as 7, twice as much if the text is `firm`, nothing if
    not true."""
    assert deceleration(f"{TWO}&{mapping}", fmus, lead(50.0)) == expected


def test_an_output_may_be_a_whole_number(fmus):
    locator = f"{TWO.replace('=real_out', '=whole_out')}&inputs.whole_in=2&inputs.*=start"
    assert deceleration(locator, fmus) == -2.0


def test_arrays_of_fmi_3_are_given_a_value_of_each_vehicle(fmus):
    """Gaps of 40 and 90 m, the nearest first: -0.01 of their sum, -1 for each that is there, -0.5
    of the 3 that `count` starts with.
    """
    both = (lead(90.0), replace(lead(40.0), name="near"))
    assert deceleration(f"{THREE}&outputs.acceleration=speeds[1]", fmus, *both) == -2.0
    assert deceleration(f"{THREE}&outputs.acceleration=speeds[2]", fmus, *both) == -1.5
    first = simulate(
        case(*both), f"{THREE}&outputs.acceleration=speeds[0]", HALF_SECOND, folder=fmus
    )
    assert -1.4 < first.ego.acceleration[1] < -0.5
    assert deceleration(f"{THREE}&outputs.acceleration=speeds[1]", fmus, lead(90.0)) == -1.0


def test_kinds_of_vehicles_are_numbers(fmus):
    """A lorry is 2 and nobody -1: -0.01 of the sum over the one that is there."""
    locator = THREE.replace("objects_gap", "objects_kind") + "&outputs.acceleration=speeds[0]"
    assert deceleration(locator, fmus, replace(lead(50.0), body="truck")) == -0.02


PLANS = {
    "scalars": "fmu:Planner2.fmu?outputs.plan_time=plan_time&outputs.plan_count=places&outputs.plan_number=number",
    "arrays": "fmu:Planner3.fmu?outputs.plan_time=when",
}


@pytest.mark.parametrize("kind", PLANS)
def test_an_fmu_may_plan(fmus, kind):
    """From where the ego is at half its speed, every second or at every step: it slows down along
    its lane."""
    found = simulate(case(), PLANS[kind], SimulationSettings(time_limit=2.0), folder=fmus)
    assert found.error is None, found.log
    assert found.ego.speed[-1] < 0.6 * found.ego.speed[0]
    assert abs(found.ego.y).max() < 1e-6
    assert "plan_error" in {clip.what for clip in found.clips}


def test_a_plan_has_at_most_the_places_of_its_outputs(fmus):
    recording = simulate(
        case(), PLANS["scalars"].replace("=places", "=number"), HALF_SECOND, folder=fmus
    )
    assert recording.error is None  # the first plan of number 1 has one place
    wide = PLANS["scalars"].replace("plan_count=places", "plan_count=plan_time[1]")
    recording = simulate(case(), wide, HALF_SECOND, folder=fmus)
    assert "`plan_count` of FMU `Planner2.fmu` must be within 1 and 4" in recording.error


@pytest.mark.parametrize(
    "locator, sentence",
    [
        (TWO, "its start value (`inputs.*=start`: of all that are left)"),
        (f"{TWO}&inputs.*=1", "`inputs.*` of FMU `Feedthrough2.fmu` must be `start`"),
        (
            f"{TWO}&inputs.whole_in=objects_gap&inputs.*=start",
            "must be an array to be given `objects_gap`",
        ),
        (
            "fmu:Feedthrough3.fmu?outputs.plan_time=speeds&inputs.*=start",
            "has no output `plan_x`, nor `plan_x[1]`, for `plan_x`; `outputs` must map it",
        ),
        (f"{THREE}&outputs.acceleration=speeds", "must be one value, `speeds[0]`"),
        (f"{THREE}&outputs.acceleration=speeds[3]", "must be within its 3 values"),
        (
            THREE.replace("objects_gap", "lead_gap") + "&outputs.acceleration=speeds[0]",
            "as it is an array",
        ),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_runs(fmus, locator, sentence):
    with refusal(re.escape(sentence)):
        load_controller(locator, fmus)


def test_a_whole_number_that_its_type_cannot_hold_ends_the_case(fmus):
    locator = f"{THREE}&inputs.count=-3&outputs.acceleration=speeds[2]"
    recording = simulate(case(), locator, HALF_SECOND, folder=fmus)
    assert recording.end_reason == "ads_error"
    assert "is of type UInt64, which cannot hold -3" in recording.error


FMI_1 = (
    '<fmiModelDescription fmiVersion="1.0" modelName="old" modelIdentifier="old" guid="{1}"'
    ' numberOfContinuousStates="0" '
    'numberOfEventIndicators="0"><ModelVariables><ScalarVariable name="u"'
    ' valueReference="0" causality="input"><Real start="0"/></ScalarVariable></ModelVariables>'
    "<Implementation><CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone></Implementation>"
    "</fmiModelDescription>"
)
FMI_3 = (
    '<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="m">{}'
    '<ModelVariables><Float64 name="t" valueReference="0" causality="independent"/>'
    "</ModelVariables><ModelStructure/></fmiModelDescription>"
)
EMPTY = FMI_3.format('<CoSimulation modelIdentifier="m"/>')


@pytest.mark.parametrize(
    "text, sentence",
    [
        (FMI_1, r"The FMI version of FMU `m\.fmu` must be 2\.0 or 3\.0, got"),
        (FMI_3.format(""), "must be one for co-simulation, got one for nothing"),
        (EMPTY, "The library of FMU `m.fmu` for this platform must be binaries/.*, got 'none'"),
    ],
)
def test_an_fmu_that_cannot_run_here_is_refused(tmp_path, text, sentence):
    with zipfile.ZipFile(tmp_path / "m.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
    with refusal(sentence):
        load_controller("fmu:m.fmu", tmp_path)


def test_an_fmu_that_asks_to_end_ends_its_case(fmus, monkeypatch):
    monkeypatch.setattr("fmpy.fmi3.FMU3Slave.doStep", lambda *_, **__: (False, True, False, 0.0))
    locator = f"{THREE}&outputs.acceleration=speeds[0]"
    recording = simulate(case(), locator, HALF_SECOND, folder=fmus)
    assert recording.error == "FMU `Feedthrough3.fmu` asked to end the simulation at 0.00 s."
