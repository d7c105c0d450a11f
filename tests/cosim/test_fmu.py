"""`fmu:`: FMUs of FMI 2.0 and 3.0 as the ADS and as the ego's vehicle model.

They are built here.
"""

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import pytest
from cosim_cases import HALF_SECOND, case, lead
from refusals import refusal

from sumo_eval.cosim.doors.fmu import FmuPlant
from sumo_eval.cosim.simulation import simulate
from sumo_eval.cosim.vehicle_model import Command, EgoState
from sumo_eval.settings import PlantSettings, SimulationSettings
from sumo_eval.settings.config import settings_from, to_plain

pytest.importorskip("fmpy")
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
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


@pytest.mark.parametrize("unit, name", [(1.0, "one"), (0.8, "one"), (1.0 / 3.6, "km/h")])
def test_an_fmu_drives_as_the_same_formula_in_python_does(fmus, tmp_path, unit, name):
    """unit: of all its variables, in SI units; km/h has no BaseUnit."""
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
    assert (fmu.error, fmu.clips) == (None, python.clips)
    assert fmu.ego.speed == pytest.approx(python.ego.speed, abs=1e-9)
    assert fmu.ego.speed[-1] < 12.0


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
    assert (found.error, found.clips) == (None, ())
    # a' = (u - a) / 4 a step: after 40 steps v = 20 - 4 * 0.05 * (40 - 3 (1 - 0.75^40)) = 12.6 m/s
    assert found.ego.speed[-1] == pytest.approx(20.0 - 4.0 * 0.05 * (40.0 - 3.0 * (1.0 - 0.75**40)))
    assert found.ego.x[0] == 50.0
    assert found.ego.x[-1] == pytest.approx(
        50.0 + sum(found.ego.speed[:-1] + found.ego.speed[1:]) * 0.05, abs=0.01
    )
    turning = simulate(case(), lambda seen: (0.0, 0.3), settings, folder=fmus)
    assert turning.ego.heading[-1] == pytest.approx(40.0 * math.tan(0.3 / 16.0) / 2.7)


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
    assert found.end_reason == "sim_error"
    assert words in found.error


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
    assert (found.error, found.ego.acceleration[-1]) == (None, 0.5)


def test_a_vehicle_model_starts_in_the_direction_of_the_case(fmus):
    settings = PlantSettings(file="Car.fmu", parameters={"v0": "speed"})
    plant = FmuPlant(settings, settings.file, fmus)
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
    found = simulate(case(lead(50.0)), MAPPED, HALF_SECOND, folder=fmus)
    assert found.end_reason == "ads_error"
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
        (f"{MAPPED}&input.v=x", "must be inputs.NAME, outputs.NAME or parameters.NAME"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused_before_anything_runs(fmus, locator, sentence):
    with refusal(re.escape(sentence)):
        simulate(case(), locator, folder=fmus)


EVALUATION = {
    "name": "x", "scenario": [{"use": "front_vehicle_low_speed"}],
    "ads": [{"name": "mine", "controller": "fmu:Acc.fmu", "fmu": {
        "inputs": {"v": "ego_speed", "gap": "lead_gap"}, "outputs": {"acceleration": "a_cmd"},
        "parameters": {"headway": 1.25}}}],
}  # fmt: skip


def with_fmu(**fmu):
    ads = [{**EVALUATION["ads"][0], "fmu": fmu}]
    return settings_from({**EVALUATION, "ads": ads}, "evaluation.toml")


def test_the_mapping_in_the_evaluation_file_is_the_one_of_the_locator(fmus):
    settings = settings_from(EVALUATION, "evaluation.toml")
    constant = with_fmu(inputs={"whole_in": 12, "*": "start"})
    for it in (settings, constant):
        assert settings_from(to_plain(it), "again") == it
    assert "inputs.whole_in=12" in constant.ads[0].locator
    written = simulate(case(lead(50.0)), settings.ads[0].locator, HALF_SECOND, folder=fmus)
    typed = simulate(
        case(lead(50.0)), f"{MAPPED}&parameters.headway=1.25", HALF_SECOND, folder=fmus
    )
    assert written.ego.speed.tolist() == typed.ego.speed.tolist()


def test_unknown_keys_of_the_mapping_are_refused():
    with refusal(r"`ads\[0\]\.fmu\.input`.*Did you mean `inputs`"):
        with_fmu(input={})
