"""`sumo-eval export RUN CASE`: what is written drives, loads and says the same as what was
recorded."""

import json
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import ROOT, python
from commands import sumo_eval as sumo_eval_cli
from laid import lay
from lxml import etree
from road_scenes import at_values

import sumo_eval
from sumo_eval import Trajectory
from sumo_eval.cosim.openscenario import opendrive_xml, openscenario_xml
from sumo_eval.record.store import open_store
from sumo_eval.report.export_case import export_case
from sumo_eval.scenario.catalogue import load
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import RankingSettings, SimulationSettings
from sumo_eval.settings.config import read_evaluation, to_toml

FILE_PAGE = (ROOT / "docs" / "reference" / "scenario_file.md").read_text()
SLOW_TRUCK = re.findall(r"```toml\n(name = .*?)```", FILE_PAGE, re.DOTALL)[0]
SLOW_TRUCK = SLOW_TRUCK.replace("[ego]", '[road]\nname = "../my road"\n\n[ego]')

EVALUATION = """
name = "exported"
seed = 5
[[scenario]]
use = "cut_in"
[scenario.sampling]
file = "points.csv"
[[scenario]]
use = "slow_truck.toml"
[scenario.sampling]
file = "truck.csv"
[[ads]]
name = "draws"
controller = "lib/my_ads.py:Draws"
[[ads]]
name = "beside it/--x"
controller = "neighbour:drive"
[drivers]
count = 2
[run]
workers = 2
[simulation]
step = 0.1
[method.zones]
restarts = 0
refinements = 0
grid_points = 1000
"""

DRAWS = """
import random
from sumo_eval import Command

class Draws:
    def step(self, traci, ego, time):
        return Command(random.uniform(-3.0, 1.0))
"""

NEIGHBOUR = "def drive(seen):\n    return -1.0 if seen.lead else 0.0\n"

BRAKES = """#!/bin/sh
read -r briefing; echo '{}'
while read -r seen; do echo '{"acceleration": -2}'; done
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two scenarios, three ADSs whose code lies beside the evaluation; the second point of each is
    the exported one."""
    folder = tmp_path_factory.mktemp("exported")
    files = {
        "lib/my_ads.py": DRAWS,
        "lib/brakes.sh": BRAKES,
        "neighbour.py": NEIGHBOUR,
        "slow_truck.toml": SLOW_TRUCK,
        "points.csv": "ego_speed,cut_in_speed,gap,lateral_speed,exposure\n30,15,90,1,1\n"
        "30,15,50.1,0.8,0.3\n",
        "truck.csv": "ego_speed,truck_speed\n20,15\n25,10\n",
        "evaluation.toml": EVALUATION,
    }
    lay(folder, files)
    (folder / "lib" / "brakes.sh").chmod(0o755)
    sumo_eval.evaluate(folder / "evaluation.toml", folder / "run")
    return folder / "run"


def drive(run, case):
    """What is recorded of a case: everything that does not differ from machine to machine."""
    with open_store(run) as store:
        fact = next(fact for fact in store.facts("ads") if fact.case == case)
        vehicles = {
            name: {
                field: getattr(path, field).tolist()
                for field in ("time", "x", "y", "speed", "heading")
            }
            for name, path in store.trajectories(case).items()
        }
    return (
        fact.values,
        fact.exposure,
        fact.status,
        fact.end_reason,
        fact.error,
        fact.collision,
        fact.clips,
        vehicles,
    )


@pytest.mark.parametrize("scenario, ads", [("cut_in", "draws"), ("slow_truck", "beside it/--x")])
def test_an_exported_case_drives_again_digit_for_digit(run, tmp_path, scenario, ads):
    rerun_equals_recording(run, scenario, ads, tmp_path)


@pytest.mark.campaign
def test_an_exported_case_of_a_program_drives_again(run, tmp_path):
    text = EVALUATION.replace("lib/my_ads.py:Draws", "exec:./lib/brakes.sh")
    (run.parent / "program.toml").write_text(text)
    sumo_eval.evaluate(run.parent / "program.toml", tmp_path / "program")
    rerun_equals_recording(tmp_path / "program", "slow_truck", "draws", tmp_path)


def rerun_equals_recording(run, scenario, ads, tmp_path):
    case = f"{scenario}-0001-{ads}"
    export_case(run, case, tmp_path)
    (path,) = tmp_path.glob("*.toml")
    recorded = drive(run, case)
    assert recorded[2] in ("ok", "collision")
    assert len(recorded[-1]["ego"]["time"]) > 20
    sumo_eval.evaluate(path, tmp_path / "again")
    assert drive(tmp_path / "again", f"{scenario}-0000-{ads}") == recorded


def test_settings_of_other_scenarios_and_cases_stay_behind(run, tmp_path):
    """The exported evaluation has one scenario and one case; each setting here names another."""
    folder = shutil.copytree(run, tmp_path / "run")
    written = folder / "evaluation.toml"
    settings = read_evaluation(written)
    others = replace(
        settings,
        method=replace(settings.method, ranking=RankingSettings({"cut_in": 0, "slow_truck": 2.0})),
        report=replace(settings.report, axes={"slow_truck": ("ego_speed", "truck_speed")}),
        drivers=replace(settings.drivers, tolerance={"truck_speed": 0.5, "gap": 0.25}),
        run=replace(settings.run, only=("cut_in-0001-draws",)),
    )
    written.write_text(to_toml(others))
    out = tmp_path / "out"
    result = sumo_eval_cli("export", folder, "cut_in-0001-draws", "--out", out)
    command = result.said.splitlines()[-1].partition(": sumo-eval ")[2]
    sumo_eval_cli(*command.split(), cwd=out)
    assert drive(out / "again", "cut_in-0000-draws") == drive(run, "cut_in-0001-draws")
    assert read_evaluation(out / "cut_in-0001-draws.toml").drivers.tolerance == {"gap": 0.25}


def test_the_files_are_there_and_called_like_the_case(run, tmp_path):
    result = sumo_eval_cli("export", run, "cut_in-0001-draws", "--out", tmp_path / "out")
    stem = "cut_in-0001-draws"
    names = {"two_lanes_1400m.net.xml", "two_lanes_1400m.view.xml"} | {
        f"{stem}{kind}" for kind in (".rou.xml", ".sumocfg", ".xodr", ".xosc", ".toml", ".csv")
    }
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    told = result.said.splitlines()
    assert {Path(line).name for line in told[:-1]} == names
    assert told[-1] == f"Drive it again, in that folder: sumo-eval run {stem}.toml --out again"
    rows = (tmp_path / "out" / f"{stem}.csv").read_text().splitlines()
    assert rows == ["ego_speed,cut_in_speed,gap,lateral_speed,exposure", "30.0,15.0,50.1,0.8,0.3"]
    sumo_eval_cli("check", tmp_path / "out" / f"{stem}.toml")


def test_a_name_that_is_not_a_file_name_becomes_one(run, tmp_path):
    exported = export_case(run, "slow_truck-0000-beside it/--x", tmp_path)
    assert {path.parent for path in exported.paths} == {tmp_path}
    assert "slow_truck-0000-beside_it__-x.toml" in {path.name for path in exported.paths}
    assert ".._my_road.net.xml" in {path.name for path in exported.paths}
    assert exported.line.startswith("sumo-eval run slow_truck-0000-beside_it__-x.toml ")
    alone = (tmp_path / "slow_truck-0000-beside_it__-x.toml").read_text()
    assert f'"{run.parent}/neighbour.py:drive"' in alone, (
        "the module is named by its file, wherever the line is typed"
    )


# --- SUMO -----------------------------------------------------------------------------------------

STEPS_IN_LIBSUMO = """
import json, sys, libsumo
libsumo.start(["sumo", "-c", sys.argv[1], "--no-step-log", "true"])
libsumo.simulationStep()
found = {name: [*libsumo.vehicle.getPosition(name), libsumo.vehicle.getSpeed(name), libsumo.vehicle.getLength(name),
                libsumo.vehicle.getWidth(name)] for name in libsumo.vehicle.getIDList()}
for _ in range(30):
    libsumo.simulationStep()
print(json.dumps([found, libsumo.simulation.getDeltaT(), libsumo.simulation.getTime()]))
"""


def test_the_configuration_loads_and_steps_in_libsumo(run, tmp_path):
    case = "cut_in-0001-draws"
    export_case(run, case, tmp_path)
    done = python(STEPS_IN_LIBSUMO, f"{case}.sumocfg", cwd=tmp_path, timeout=60)
    vehicles, step, time = json.loads(done.stdout.splitlines()[-1])
    assert step == 0.1
    assert time == pytest.approx(3.1)
    # SUMO's position is the front bumper: half a body of 4.3 m before the centre, which starts at 0
    ego, other = vehicles["ego"], vehicles["other"]
    assert ego[1:] == pytest.approx([0.0, 30.0, 4.3, 1.9])
    assert other[1:] == pytest.approx([3.5, 15.0, 4.3, 1.9])
    assert other[0] - ego[0] == pytest.approx(50.1 + 4.3)  # bumper to bumper, and a body


# --- OpenSCENARIO and OpenDRIVE -------------------------------------------------------------------


def exported(run, case, folder, ending):
    """The root of one of the files that a case is exported to."""
    export_case(run, case, folder)
    return etree.parse(folder / f"{case}.{ending}").getroot()


def vertices(root, name):
    """Where a vehicle's trajectory has it, by time."""
    (group,) = (g for g in root.iter("ManeuverGroup") if g.get("name") == name)
    return {float(v.get("time")): v.find(".//WorldPosition") for v in group.iter("Vertex")}


def test_the_openscenario_file_has_the_cases_elements_and_numbers(run, tmp_path):
    case = "cut_in-0001-draws"
    root = exported(run, case, tmp_path, "xosc")
    header = root.find("FileHeader")
    assert root.tag == "OpenSCENARIO"
    assert header.get("revMajor") == "1"
    assert header.get("revMinor") == "2"
    assert header.get("description").endswith(f"Run again: sumo-eval run {case}.toml --out again")
    assert root.find("RoadNetwork/LogicFile").get("filepath") == f"{case}.xodr"
    assert [entity.get("name") for entity in root.findall("Entities/ScenarioObject")] == [
        "ego",
        "other",
    ]
    for size in root.findall("Entities/ScenarioObject/Vehicle/BoundingBox/Dimensions"):
        assert size.get("length") == "4.3"
        assert size.get("width") == "1.9"

    starts = {
        private.get("entityRef"): private
        for private in root.findall("Storyboard/Init/Actions/Private")
    }
    places = {name: private.find(".//WorldPosition") for name, private in starts.items()}
    speeds = {
        name: private.find(".//AbsoluteTargetSpeed").get("value")
        for name, private in starts.items()
    }
    assert speeds == {"ego": "30", "other": "15"}
    assert {name: place.get("y") for name, place in places.items()} == {"ego": "0", "other": "3.5"}
    assert float(places["other"].get("x")) - float(places["ego"].get("x")) == pytest.approx(
        50.1 + 4.3
    )

    # the other slides 3.5 m to the right at 0.8 m/s, which takes 4.375 s, and goes on at 15 m/s
    assert (
        root.find("Storyboard/Story/Act/ManeuverGroup/Actors/EntityRef").get("entityRef") == "other"
    )
    path = vertices(root, "other")
    begin = float(places["other"].get("x"))
    for time, y in ((0.0, 3.5), (2.0, 3.5 - 1.6), (4.3, 3.5 - 3.44), (4.4, 0.0), (10.0, 0.0)):
        assert float(path[time].get("y")) == pytest.approx(y, abs=1e-6)
        assert float(path[time].get("x")) == pytest.approx(begin + 15.0 * time, abs=1e-5)
        assert path[time].get("h") == "0"  # it slides
    # the case ends after 35 s at the latest, the others' vertices too; the ego drives as it was
    # recorded, until its end
    assert max(path) == pytest.approx(35.0)
    with open_store(run) as store:
        driven = store.trajectory(case)
    ego = vertices(root, "ego")
    assert sorted(ego) == pytest.approx(driven.time.tolist(), abs=1e-6)
    assert [float(ego[time].get("x")) for time in sorted(ego)] == pytest.approx(
        driven.x.tolist(), abs=1e-6
    )
    end = float(root.find("Storyboard/StopTrigger//SimulationTimeCondition").get("value"))
    assert end == pytest.approx(driven.time[-1], abs=1e-6)
    result = sumo_eval_cli("import", tmp_path / f"{case}.xosc")
    assert "other, a car of 4.3 x 1.9 m" in result.said, result.said


def test_a_braking_vehicle_follows_its_braking_in_openscenario(run, tmp_path):
    case = "slow_truck-0001-draws"
    root = exported(run, case, tmp_path, "xosc")
    path = {time: float(place.get("x")) for time, place in vertices(root, "truck").items()}
    # 10 m in the first second, then 4 m/s2: 10 t - 2 t^2, at rest after 2.5 s and 12.5 m
    travelled = [path[time] - path[0.0] for time in (1.0, 2.0, 3.5, 20.0)]
    assert travelled == pytest.approx([10.0, 10.0 + 8.0, 10.0 + 12.5, 10.0 + 12.5], abs=1e-5)
    routes = (tmp_path / f"{case}.rou.xml").read_text()
    assert "moves on in this file" not in routes
    assert "`truck` brakes to a standstill with 4 m/s2 from 1 s on" in routes


def recorded(start, speed):
    """A drive straight on for 2 s."""
    time = np.linspace(0.0, 2.0, 21)
    still = np.zeros(21)
    return Trajectory(time=time, x=start.x + speed * time, y=start.y + still, heading=still,
        speed=speed + still,
                      acceleration=still, steering_wheel_angle=still, length=4.5,
                      width=1.8)  # fmt: skip


def lively_case():
    """A child who runs when the ego is near: where it was is known from the recording alone."""
    logical = load("child_from_behind_parked_cars")
    concrete = logical.concrete(
        **dict(zip(logical.names, sample(logical).points[0].tolist(), strict=True))
    )
    child = next(actor for actor in concrete.actors if actor.name == "child")
    return concrete, {"ego": recorded(concrete.ego, 5.0), "child": recorded(child.start, 1.0)}


def test_who_waits_for_a_condition_follows_its_recording_in_openscenario():
    """10 m of the ego's and 2 m of the child's in 2 s at 5 and 1 m/s; a child is a Pedestrian."""
    concrete, driven = lively_case()
    root = etree.fromstring(
        openscenario_xml(concrete, SimulationSettings(), "r.xodr", "r", driven).encode()
    )
    assert [item.get("name") for item in root.iter("Pedestrian")] == ["child"]
    for name, far in (("ego", 10.0), ("child", 2.0)):
        path = vertices(root, name)
        assert float(path[2.0].get("x")) - float(path[0.0].get("x")) == pytest.approx(far, abs=1e-6)
    # parked cars stand
    assert {g.get("name") for g in root.iter("ManeuverGroup")} == {"ego", "child"}
    alone = etree.fromstring(
        openscenario_xml(concrete, SimulationSettings(), "r.xodr", "r").encode()
    )
    assert "ego" not in {g.get("name") for g in alone.iter("ManeuverGroup")}
    assert "Not recorded, and so at one speed throughout: child" in alone[0].get("description")
    for tree in (root, alone):
        assert tree.find(".//Private[@entityRef='child']//WorldPosition").get("h") == "1.570796"


CHECKER = os.environ.get("QC_OPENSCENARIO") or shutil.which("qc_openscenario")


@pytest.mark.skipif(not CHECKER, reason="ASAM's checker (asam-qc-openscenarioxml) is not here")
@pytest.mark.parametrize("kind", ["a lively case", "a recorded one", "a plain one"])
def test_asams_checker_finds_no_issue_and_skips_no_rule(tmp_path, request, kind):
    if kind == "a lively case":
        concrete, driven = lively_case()
        (tmp_path / "c.xosc").write_text(
            openscenario_xml(concrete, SimulationSettings(), "c.xodr", "r", driven)
        )
        (tmp_path / "c.xodr").write_text(opendrive_xml(concrete.road))
    elif kind == "a plain one":
        concrete = at_values(
            "cut_in", ego_speed=30.0, cut_in_speed=20.0, gap=25.0, lateral_speed=1.0
        )
        (tmp_path / "c.xosc").write_text(
            openscenario_xml(concrete, SimulationSettings(), "c.xodr", "r")
        )
        (tmp_path / "c.xodr").write_text(opendrive_xml(concrete.road))
    else:
        export_case(request.getfixturevalue("run"), "cut_in-0001-draws", tmp_path)
        (tmp_path / "cut_in-0001-draws.xosc").rename(tmp_path / "c.xosc")
    (tmp_path / "config.xml").write_text(
        f'<Config><Param name="InputFile" value="{tmp_path}/c.xosc"/><CheckerBundle '
        'application="xoscBundle">'
        f'<Param name="resultFile" value="{tmp_path}/found.xqar"/></CheckerBundle></Config>'
    )
    done = subprocess.run(
        [CHECKER, "-c", "config.xml"], cwd=tmp_path, capture_output=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    found = etree.parse(tmp_path / "found.xqar").getroot()
    assert [issue.get("description") for issue in found.iter("Issue")] == []
    checkers = list(found.iter("Checker"))
    assert len(checkers) >= 17
    assert {checker.get("status") for checker in checkers} == {"completed"}


def test_the_opendrive_road_is_the_cases_road(run, tmp_path):
    root = exported(run, "cut_in-0001-draws", tmp_path, "xodr")
    assert root.tag == "OpenDRIVE"
    # two lanes of 3.5 m, the right one's centre at y = 0: the reference line, the left edge, lies
    # at 5.25
    geometry = root.find("road/planView/geometry")
    assert geometry.get("x") == "0"
    assert geometry.get("y") == "5.25"
    assert geometry.get("hdg") == "0"
    assert geometry.get("length") == root.find("road").get("length") == "2000"
    lanes = root.findall("road/lanes/laneSection/right/lane")
    assert [(lane.get("id"), lane.find("width").get("a")) for lane in lanes] == [
        ("-1", "3.5"),
        ("-2", "3.5"),
    ]


# --- files of the user's, and mistakes ------------------------------------------------------------


@pytest.mark.campaign
def test_an_fmu_keeps_its_mapping_and_drives_again(tmp_path):
    pytest.importorskip("fmpy")
    builder = pytest.importorskip("pythonfmu.builder").FmuBuilder
    shutil.copy(ROOT / "docs" / "examples" / "acc_fmu.py", tmp_path)
    builder.build_FMU(tmp_path / "acc_fmu.py", dest=tmp_path)
    (tmp_path / "evaluation.toml").write_text("""
name = "fmu"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[[ads]]
name = "acc"
controller = "fmu:Acc.fmu"
[ads.fmu]
inputs = { v = "ego_speed", gap = "lead_gap" }
outputs = { acceleration = "a_cmd" }
parameters = { headway = 1.25 }
[drivers]
count = 2
[run]
engine = "serial"
[method.zones]
restarts = 0
refinements = 0
grid_points = 1000
""")
    case = sumo_eval.evaluate(tmp_path / "evaluation.toml", tmp_path / "run").cases[-1].case
    export_case(tmp_path / "run", case, tmp_path / "out")
    (path,) = (tmp_path / "out").glob("*.toml")
    repeated = sumo_eval.evaluate(path, tmp_path / "out" / "again")
    assert repeated.settings.ads[0].fmu.parameters == {"headway": 1.25}
    assert repeated.settings.ads[0].controller == f"fmu:{tmp_path / 'Acc.fmu'}"
    recorded = drive(tmp_path / "run", case)
    assert recorded[2] == "ok"
    assert drive(tmp_path / "out" / "again", repeated.cases[0].case) == recorded


def test_paths_of_people_and_exposure_stay_what_they_were(run, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    text = (folder / "evaluation.toml").read_text()
    text = text.replace('source = "synthetic"', 'source = "people.py:drives"').replace(
        'cases = ""', 'cases = "tests"'
    )
    text = text.replace('severity = "severity"', 'severity = "harm.py:loss"')
    assert 'cases = "tests"' in text
    (folder / "evaluation.toml").write_text(text)
    monkeypatch.setattr("sumo_eval.record.trust._trust_all", True)  # as `--trust` does
    export_case(folder, "cut_in-0001-draws", tmp_path / "out")
    (path,) = (tmp_path / "out").glob("*.toml")
    alone = read_evaluation(path)
    drivers = alone.drivers
    assert alone.method.collision.severity == f"{run.parent / 'harm.py'}:loss"
    assert drivers.source == f"{run.parent / 'people.py'}:drives"
    assert drivers.cases == str(run.parent / "tests")


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["cut_in-0001-drawz"], "Did you mean `cut_in-0001-draws`?"),
        (["cut_in-0001-draws", "--format", "csv"], "`--format` is for the tables of a whole run"),
    ],
)
def test_the_command_refuses(run, tmp_path, arguments, sentence):
    result = sumo_eval_cli("export", run, *arguments, "--out", tmp_path / "out", status=2)
    assert not (tmp_path / "out").exists()
    assert sentence in result.stderr
