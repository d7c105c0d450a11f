"""`fmu:`: FMUs of FMI 2.0 and 3.0 as the ADS and as the ego's vehicle model.

They are built here.
"""

import math
import shutil
import textwrap
import zipfile
from dataclasses import replace
from types import SimpleNamespace
from zipfile import ZipFile

import pytest
from evaluations import settings_of
from loaded import ROOT
from refusals import refusal, refused
from road_scenes import HALF_SECOND, assert_ended, assert_last, case, clips_of, half_second, lead
from tables import values_of

from sumo_eval.cosim import Command, simulate
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.vehicle_model import EgoState
from sumo_eval.settings import PlantSettings, SimulationSettings
from sumo_eval.settings.config import settings_from, to_plain

pytest.importorskip("fmpy")
EXAMPLES = ROOT / "docs" / "examples"
MAPPED = "fmu:Acc.fmu?inputs.v=ego_speed&inputs.gap=lead_gap&outputs.acceleration=a_cmd"


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    """The folder with both examples, built."""
    folder = tmp_path_factory.mktemp("fmus")
    for builder, source in (("pythonfmu", "acc_fmu.py"), ("pythonfmu3", "car_fmu.py")):
        library = pytest.importorskip(f"{builder}.builder")
        shutil.copy(EXAMPLES / source, folder)
        library.FmuBuilder.build_FMU(folder / source, dest=folder)
    return folder


@pytest.mark.parametrize(
    "unit, name", [(1.0, "one"), (0.8, "one"), (1.0 / 3.6, "km/h"), (1.0, "rod")]
)
def test_an_fmu_drives_as_the_same_formula_in_python_does(fmus, tmp_path, capsys, unit, name):
    """unit: of all its variables, in SI units; km/h and rod have no BaseUnit, rod is unknown."""
    base = f'<BaseUnit factor="{unit}"/>' if name == "one" else ""
    definition = f'<UnitDefinitions><Unit name="{name}">{base}</Unit></UnitDefinitions>'

    def acc(seen):
        values = (seen.lead.gap, seen.lead.speed) if seen.lead else (1000.0, seen.ego.speed)
        gap, speed, own = (value / unit for value in (*values, seen.ego.speed))
        wanted = 3.0 + 1.5 * own
        acceleration = 0.15 * (gap - wanted) + 0.9 * (speed - own)
        return unit * min(max(acceleration, -6.0), 0.0 if gap > wanted else 2.0)

    with ZipFile(fmus / "Acc.fmu") as old, ZipFile(tmp_path / "Acc.fmu", "w") as new:
        for file in old.namelist():
            text = old.read(file)
            if file == "modelDescription.xml":
                units = f"{definition}<LogCategories>"
                text = text.replace(b"<LogCategories>", units.encode())
                text = text.replace(b"<Real", f'<Real unit="{name}"'.encode())
            new.writestr(file, text)
    settings = SimulationSettings(time_limit=10.0)
    fmu = simulate(case(lead(40.0, speed=10.0)), MAPPED, settings, folder=tmp_path)
    python = simulate(case(lead(40.0, speed=10.0)), acc, settings)
    assert fmu.error is None
    assert fmu.clips == python.clips
    assert fmu.ego.speed == pytest.approx(python.ego.speed, abs=1e-9)
    assert fmu.ego.speed[-1] < 12.0
    words = "unit `rod` is not known, SI is assumed"
    assert capsys.readouterr().out.count(words) == (name == "rod")
    simulate(case(lead(40.0, speed=10.0)), MAPPED, settings, folder=tmp_path)
    assert capsys.readouterr().out.count(words) == (name == "rod"), "every drive has its own log"


def test_a_parameter_reaches_the_fmu_and_every_case_has_a_fresh_instance(fmus):
    concrete = case(lead(60.0, speed=15.0))
    settings = SimulationSettings(time_limit=5.0)
    near, far, again = (
        simulate(concrete, f"{MAPPED}&parameters.headway={headway}", settings, folder=fmus).ego.x[
            -1
        ]
        for headway in (1.0, 3.0, 1.0)
    )
    assert near > far + 5.0
    assert near == again


def test_an_fmi_3_car_is_the_egos_vehicle_model(fmus):
    plant = PlantSettings(file="Car.fmu", parameters={"v0": "speed"})
    settings = SimulationSettings(time_limit=2.0, plant=plant)
    found = simulate(case(), lambda seen: -4.0, settings, folder=fmus)
    assert found.error is None
    assert found.clips == ()
    # a' = (u - a) / 4 a step: after 40 steps v = 20 - 4 * 0.05 * (40 - 3 (1 - 0.75^40)) = 12.6 m/s
    assert_last(found, speed=20.0 - 4.0 * 0.05 * (40.0 - 3.0 * (1.0 - 0.75**40)))
    assert found.ego.x[0] == 50.0
    assert_last(found, 0.01, x=50.0 + sum(found.ego.speed[:-1] + found.ego.speed[1:]) * 0.05)
    turning = simulate(case(), lambda seen: (0.0, 0.3), settings, folder=fmus)
    assert_last(turning, heading=40.0 * math.tan(0.3 / 16.0) / 2.7)


@pytest.mark.parametrize(
    "heading, speed, words",
    [
        (0.0, 0.0, "must start at 20 m/s, got 0; map a parameter of it to `speed`"),
        (math.inf, 20.0, "FMU `Car.fmu` must give finite numbers, got {'x': 0.0, 'y': 0.0, 'h"),
    ],
)
def test_a_wrong_start_of_a_vehicle_model_is_a_sim_error(fmus, monkeypatch, heading, speed, words):
    values = iter((0.0, 0.0, heading, speed))
    monkeypatch.setattr("fmpy.fmi3.FMU3Slave.getFloat64", lambda *_: [next(values)])
    settings = replace(HALF_SECOND, plant=PlantSettings(file="Car.fmu"))
    found = simulate(case(), lambda *_: Command(0.0), settings, folder=fmus)
    assert_ended(found, "sim_error", words)


def test_a_vehicle_models_acceleration_may_need_a_step(fmus, monkeypatch):
    # by reference: v0, x, y, heading, speed
    values = {1: math.nan, 4: 0.0, 5: 0.0, 6: 0.0, 7: 20.0}
    for name, call in (
        ("getFloat64", lambda _, references: [values[references[0]]]),
        ("doStep", lambda *_, **__: values.update({1: 0.5})),
    ):
        monkeypatch.setattr(f"fmpy.fmi3.FMU3Slave.{name}", call)
    plant = PlantSettings(file="Car.fmu", outputs={"acceleration": "v0"})
    settings = replace(HALF_SECOND, plant=plant)
    found = simulate(case(), lambda *_: Command(0.0), settings, folder=fmus)
    assert found.error is None
    assert found.ego.acceleration[-1] == 0.5


def test_a_vehicle_model_that_drives_backwards_is_a_sim_error(fmus, monkeypatch):
    values = {4: 0.0, 5: 0.0, 6: 0.0, 7: 20.0}  # by reference: x, y, heading, speed
    for name, call in (
        ("getFloat64", lambda _, references: [values[references[0]]]),
        ("doStep", lambda *_, **__: values.update({7: -5.0})),
    ):
        monkeypatch.setattr(f"fmpy.fmi3.FMU3Slave.{name}", call)
    settings = replace(HALF_SECOND, plant=PlantSettings(file="Car.fmu"))
    found = simulate(case(), lambda *_: Command(0.0), settings, folder=fmus)
    words = "to the speed -5 m/s; no vehicle drives at other speeds than -1..1000 m/s."
    assert_ended(found, "sim_error", words)


class NotANumber:
    """A policy over arrays that answers nan."""

    batch = True

    def act(self, seen):
        return [math.nan] * len(seen.number)


@pytest.mark.parametrize(
    "ads, words",
    [
        (lambda seen: 1e30, "At the command 1e+30 m/s2 the vehicle model moved `ego`"),
        (NotANumber(), "`acceleration` of the ADS's Command must be a finite number, got nan at 0"),
    ],
)
def test_what_no_vehicle_model_can_do_is_the_adss_error(fmus, ads, words):
    settings = replace(HALF_SECOND, plant=PlantSettings(file="Car.fmu", parameters={"v0": "speed"}))
    assert_ended(simulate(case(), ads, settings, folder=fmus), "ads_error", words)


def test_a_vehicle_model_starts_in_the_direction_of_the_case(fmus):
    settings = PlantSettings(file="Car.fmu", parameters={"v0": "speed"})
    plant = FmuPlant(settings, fmus)
    state = plant.advance(EgoState(5.0, 7.0, math.pi / 2, speed=20.0), Command(0.0), 0.05)
    plant.close()
    assert state[:4] == pytest.approx((5.0, 8.0, math.pi / 2, 20.0))


@pytest.mark.parametrize("call", ["exitInitializationMode", "getReal", "setReal", "doStep"])
def test_nothing_is_asked_of_an_fmu_after_fatal(fmus, monkeypatch, call):
    fatal, calls = RuntimeError("fatal"), []
    fatal.status = 4

    def fail(*_, **__):
        calls.append("fatal")
        raise fatal

    monkeypatch.setattr(f"fmpy.fmi2.FMU2Slave.{call}", fail)
    for later in ("terminate", "freeInstance"):
        name = f"fmpy.fmi2.FMU2Slave.{later}"
        monkeypatch.setattr(name, lambda self, later=later: calls.append(later))
    assert half_second(MAPPED, lead(50.0), folder=fmus).end_reason == "ads_error"
    assert calls == ["fatal"]


def test_that_sumo_moves_an_ego_that_has_a_vehicle_model_of_its_own_is_on_record(fmus):
    settings = replace(HALF_SECOND, plant=PlantSettings(file="Car.fmu", parameters={"v0": "speed"}))
    found = simulate(case(), lambda traci, ego, time: None, settings, folder=fmus)
    assert [clip.what for clip in found.clips] == ["vehicle_model_not_used"]


@pytest.mark.parametrize(
    "locator, sentence",
    [
        ("fmu:nowhere.fmu", "There is no FMU"),
        ("fmu:acc_fmu.py", "cannot be read"),
        ("fmu:Acc.fmu", "Input `v` of FMU `Acc.fmu` is not a signal; `inputs` must map it."),
        (
            f"{MAPPED}&inputs.gapp=lead_gap",
            "`gapp` of FMU `Acc.fmu` in `inputs`. Did you mean `gap`?",
        ),
        (
            f"{MAPPED}&outputs.steer=a_cmd",
            "`steer` in the mapping of FMU `Acc.fmu`. Did you mean `steering`?",
        ),
        ("fmu:Acc.fmu?inputs.v=ego_sped", "`ego_sped`. Did you mean `ego_speed`?"),
        (
            "fmu:Acc.fmu?inputs.v=ego_speed&inputs.gap=lead_gap",
            "no output `acceleration`; `outputs` must map it",
        ),
        (f"{MAPPED}&parameters.tau=1", "`tau`"),
        (f"{MAPPED}&parameters.headway=objects_gap", "must be an array to be given `objects_gap`"),
        (f"{MAPPED}&parameters.headway=ego_sped", "`ego_sped`. Did you mean `ego_speed`?"),
        (f"{MAPPED}&inputs.gap=ego_speed", "outputs.NAME=NAME, each name once, got"),
        ("fmu:Acc.fmu?inputs.v", "outputs.NAME=NAME, each name once, got 'inputs.v'"),
        (f"{MAPPED}&input.v=x", "must be inputs.NAME, outputs.NAME or parameters.NAME"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused_before_anything_runs(fmus, locator, sentence):
    with refused(sentence):
        simulate(case(), locator, folder=fmus)


def with_fmu(**fmu):
    return settings_of(ads=[{"name": "mine", "controller": "fmu:Acc.fmu", "fmu": fmu}])


def test_the_mapping_in_the_evaluation_file_is_the_one_of_the_locator(fmus):
    settings = with_fmu(
        inputs={"v": "ego_speed", "gap": "lead_gap"},
        outputs={"acceleration": "a_cmd"},
        parameters={"headway": 1.25},
    )
    constant = with_fmu(inputs={"whole_in": 12, "*": "start"})
    for it in (settings, constant):
        assert settings_from(to_plain(it), "again") == it
    assert "inputs.whole_in=12" in constant.ads[0].locator
    written = half_second(settings.ads[0].locator, lead(50.0), folder=fmus)
    typed = half_second(f"{MAPPED}&parameters.headway=1.25", lead(50.0), folder=fmus)
    assert written.ego.speed.tolist() == typed.ego.speed.tolist()


def test_unknown_keys_of_the_mapping_are_refused():
    with refusal(r"`ads\[0\]\.fmu\.input`.*Did you mean `inputs`"):
        with_fmu(input={})


# --- inputs of all kinds of types, constants, start values and arrays -----------------------------


FEEDTHROUGH_2 = """
    from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String

    class Feedthrough2(Fmi2Slave):
        def __init__(self, **kwargs):
            super().__init__(**kwargs)
            self.real_in, self.whole_in, self.truth_in, self.text_in, self.real_out = 0.0, 7, True, "gentle", 0.0
            self.lead_kind = "none"  # a text, unlike the signal of this name
            for name, kind in (("real_in", Real), ("whole_in", Integer), ("truth_in", Boolean), ("text_in", String),
                               ("lead_kind", String)):
                self.register_variable(kind(name, causality=Fmi2Causality.input, variability=Fmi2Variability.discrete))
            self.code = "none"
            self.register_variable(String("code", causality=Fmi2Causality.parameter,
                                          variability=Fmi2Variability.tunable))
            self.register_variable(Real("real_out", causality=Fmi2Causality.output))
            self.register_variable(Integer("whole_out", causality=Fmi2Causality.output,
                                           variability=Fmi2Variability.discrete))
            self.whole_out = 0

        def do_step(self, current_time, step_size):
            strength = {"gentle": 1.0, "firm": 2.0}[self.text_in]
            self.real_out = -0.1 * self.whole_in * strength * self.truth_in
            self.real_out -= self.code == "07"
            self.real_out -= 9.0 * (self.lead_kind != "none")
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
def feedthroughs(tmp_path_factory):
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
    values_of("""
    "inputs.*=start", -0.7
    "inputs.*=start&parameters.code=07", -1.7
    "inputs.whole_in=12&inputs.*=start", -1.2
    "inputs.whole_in=12&inputs.truth_in=false&inputs.text_in=start&inputs.lead_kind=start", 0.0
    "inputs.whole_in=12&inputs.truth_in=1.0&inputs.text_in='firm'&inputs.lead_kind='none'", -2.4
    "inputs.whole_in=lead_present&inputs.truth_in=true&inputs.text_in=firm&inputs.*=start", -0.2
    """),
)
def test_constants_start_values_and_every_type_of_fmi_2(feedthroughs, mapping, expected):
    """-0.1 of the whole number, which starts as 7, twice as much if the text is `firm`, nothing if
    not true."""
    assert deceleration(f"{TWO}&{mapping}", feedthroughs, lead(50.0)) == expected


def test_an_output_may_be_a_whole_number(feedthroughs):
    locator = f"{TWO.replace('=real_out', '=whole_out')}&inputs.whole_in=2&inputs.*=start"
    assert deceleration(locator, feedthroughs) == -2.0


def test_arrays_of_fmi_3_are_given_a_value_of_each_vehicle(feedthroughs):
    """Gaps of 40 and 90 m, the nearest first: -0.01 of their sum, -1 for each that is there, -0.5
    of the 3 that `count` starts with.
    """
    both = (lead(90.0), replace(lead(40.0), name="near"))
    assert deceleration(f"{THREE}&outputs.acceleration=speeds[1]", feedthroughs, *both) == -2.0
    assert deceleration(f"{THREE}&outputs.acceleration=speeds[2]", feedthroughs, *both) == -1.5
    first = half_second(f"{THREE}&outputs.acceleration=speeds[0]", *both, folder=feedthroughs)
    assert -1.4 < first.ego.acceleration[1] < -0.5
    assert deceleration(f"{THREE}&outputs.acceleration=speeds[1]", feedthroughs, lead(90.0)) == -1.0


def test_kinds_of_vehicles_are_numbers(feedthroughs):
    """A lorry is 2 and nobody -1: -0.01 of the sum over the one that is there."""
    locator = THREE.replace("objects_gap", "objects_kind") + "&outputs.acceleration=speeds[0]"
    assert deceleration(locator, feedthroughs, replace(lead(50.0), body="truck")) == -0.02


PLANS = {
    "scalars": "fmu:Planner2.fmu?outputs.plan_time=plan_time&outputs.plan_count=places&outputs.plan_number=number",
    "arrays": "fmu:Planner3.fmu?outputs.plan_time=when",
}


@pytest.mark.parametrize("kind", PLANS)
def test_an_fmu_may_plan(feedthroughs, kind):
    """From where the ego is at half its speed, every second or at every step: it slows down along
    its lane."""
    found = simulate(case(), PLANS[kind], SimulationSettings(time_limit=2.0), folder=feedthroughs)
    assert found.error is None, found.log
    assert found.ego.speed[-1] < 0.6 * found.ego.speed[0]
    assert abs(found.ego.y).max() < 1e-6
    assert "plan_error" in clips_of(found)


def test_a_plan_has_at_most_the_places_of_its_outputs(feedthroughs):
    recording = half_second(PLANS["scalars"].replace("=places", "=number"), folder=feedthroughs)
    assert recording.error is None  # the first plan of number 1 has one place
    wide = PLANS["scalars"].replace("plan_count=places", "plan_count=plan_time[1]")
    recording = half_second(wide, folder=feedthroughs)
    assert "`plan_count` of FMU `Planner2.fmu` must be within 1 and 4" in recording.error


@pytest.mark.parametrize(
    "locator, sentence",
    [
        (TWO, "its start value (`inputs.*=start`: of all that are left)"),
        (
            f"{TWO}&inputs.whole_in=1&inputs.truth_in=1&inputs.text_in=firm",
            "Input `lead_kind` of FMU `Feedthrough2.fmu` is a text; `inputs` must map it.",
        ),
        (f"{TWO}&inputs.*=1", "`inputs.*` of FMU `Feedthrough2.fmu` must be `start`"),
        (
            f"{TWO}&inputs.whole_in=1.5",
            "`whole_in` of FMU `Feedthrough2.fmu` must be finite and of",
        ),
        (f"{TWO}&inputs.truth_in=2", "finite and of type Boolean, got 2.0"),
        (f"{THREE}&inputs.count=-3&outputs.acceleration=speeds[2]", "of type UInt64, got -3.0"),
        (
            f"{TWO}&inputs.*=start&parameters.real_in=1",
            "one of its parameters that can be set, got 'a discrete input",
        ),
        (
            f"{TWO}&inputs.real_out=time",
            "one of its inputs that can be set, got 'a continuous output",
        ),
        (
            f"{TWO}&inputs.whole_in=objects_gap&inputs.*=start",
            "must be an array to be given `objects_gap`",
        ),
        (
            "fmu:Feedthrough3.fmu?outputs.plan_time=speeds&inputs.*=start",
            "has no output `plan_x`, nor `plan_x[1]`, for `plan_x`; `outputs` must map it",
        ),
        (
            "fmu:Feedthrough2.fmu?inputs.*=start&outputs.plan_time=code",
            "The output `code` of FMU `Feedthrough2.fmu` must be a number, got 'String'",
        ),
        (f"{THREE}&outputs.acceleration=speeds", "must be one value, `speeds[0]`"),
        (f"{THREE}&outputs.acceleration=speeds[3]", "must be within its 3 values"),
        (
            THREE.replace("objects_gap", "lead_gap") + "&outputs.acceleration=speeds[0]",
            "as it is an array",
        ),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_runs(feedthroughs, locator, sentence):
    with refused(sentence):
        load_controller(locator, feedthroughs)


@pytest.mark.parametrize("signal, value", [("lead_kind", "-1"), ("change_by", "nan")])
def test_a_whole_number_that_its_type_cannot_hold_ends_the_case(feedthroughs, signal, value):
    locator = f"{THREE}&inputs.count={signal}&outputs.acceleration=speeds[2]"
    recording = half_second(locator, folder=feedthroughs)
    assert_ended(recording, "ads_error", f"is of type UInt64, which cannot hold {value}")


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


@pytest.mark.parametrize(
    "flags, deed",
    [
        ((False, True, False, 0.0), "asked to end the simulation"),
        ((False, False, True, 0.05), "ended its step early"),
    ],
)
def test_an_fmu_that_steps_no_further_ends_its_case(feedthroughs, monkeypatch, flags, deed):
    monkeypatch.setattr("fmpy.fmi3.FMU3Slave.doStep", lambda *_, **__: flags)
    locator = f"{THREE}&outputs.acceleration=speeds[0]"
    recording = half_second(locator, folder=feedthroughs)
    assert recording.error == f"FMU `Feedthrough3.fmu` {deed} at 0.00 s."


def test_messages_of_an_fmu_are_kept_in_any_encoding(feedthroughs, monkeypatch, capsys):
    def instance(*_, logger):
        logger(None, b"car", 1, b"", b"temp\xe9rature")

    monkeypatch.setattr("fmpy.instantiate_fmu", instance)
    ads = load_controller(f"{TWO}&inputs.*=start", feedthroughs)
    ads.reset(SimpleNamespace(period=0.1), None, "ego")
    assert capsys.readouterr().out == "[WARNING] temp\N{REPLACEMENT CHARACTER}rature\n"
