"""What facts depend on is part of their fingerprint."""

import ast
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from evaluations import small
from laid import replace_in
from refusals import refused

import sumo_eval
from sumo_eval.record.identity import (
    hashes_of_inputs,
    locator_identity,
    named_files,
    people_identity,
    sources_of_facts,
)
from sumo_eval.settings import (
    DriverSettings,
    ExposureSettings,
    PlantSettings,
    ScenarioSettings,
    SimulationSettings,
)

PACKAGE = Path(sumo_eval.__file__).parent


def test_facts_depend_on_the_code_that_makes_them_and_on_the_scenario_files(tmp_path):
    copy = tmp_path / "sumo_eval"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    as_it_was = sources_of_facts(copy)
    assert as_it_was == sources_of_facts(PACKAGE)
    assert {
        "scenario/files/cut_in.toml",
        "scenario/concrete.py",
        "ads/car_following.py",
        "record/worker.py",
    } <= set(as_it_was)
    replace_in(copy / "scenario" / "files" / "cut_in.toml", "high = 40.0", "high = 39.0")
    (copy / "report" / "html.py").unlink()  # the report makes no facts
    changed = {name for name, found in sources_of_facts(copy).items() if found != as_it_was[name]}
    assert changed == {"scenario/files/cut_in.toml"}


def imported_by(path):
    """The files of the package that a file of it imports, by path in the package."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sumo_eval"):
            place = PACKAGE.parent / node.module.replace(".", "/")
            files = (place.with_suffix(".py"), *(place / f"{it.name}.py" for it in node.names))
            yield from (str(it.relative_to(PACKAGE)) for it in files if it.is_file())


def test_code_that_makes_facts_imports_only_what_is_hashed():
    """Else an edit of a file would leave facts of the old and the new code in one resumed run."""
    hashed = {name for name in sources_of_facts(PACKAGE) if name.endswith(".py")}
    # words, errors, what starts and keeps drives, settings, whose values are in each fingerprint
    files = ("coded", "errors", "first_use", "frozen", "gone", "groups", "input_file", "text")
    harmless = ("record/", "settings/", *(f"{it}.py" for it in files))
    imported = {it for name in hashed for it in imported_by(PACKAGE / name)}
    assert not {name for name in imported - hashed if not name.startswith(harmless)}


def test_tables_of_options_are_checked_before_driving(tmp_path):
    with refused("unexpected keyword argument 'foo'"):
        locator_identity(("ADS", 'lane_changer?options.habits={"foo": 1}'), tmp_path)


def test_recorded_drivers_are_the_same_in_any_folder(tmp_path):
    settings = DriverSettings(recordings=("a.csv",), cases="cases")
    identities = []
    for folder in (tmp_path / "one", tmp_path / "other"):
        for name in ("a.csv", "cases/inner/b.csv"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(name)
        identities.append(people_identity(settings, folder))
    (folder / name).write_text("changed")
    assert identities[0] == identities[1] != people_identity(settings, folder)


def test_recordings_and_the_vehicles_fmu_are_inputs_of_a_run(tmp_path):
    for name in ("a.csv", "b.csv", "unused.csv", "car.fmu"):
        (tmp_path / name).write_text(name)
    entry = ScenarioSettings("cut_in", exposure=ExposureSettings("recorded", recordings=("a.csv",)))
    settings = replace(
        small(["idm"]),
        scenario=(entry,),
        drivers=DriverSettings(source="recorded", recordings=("b.csv",)),
        simulation=SimulationSettings(plant=PlantSettings(file="car.fmu")),
    )
    assert hashes_of_inputs(settings, tmp_path).keys() == {"a.csv", "b.csv", "car.fmu"}
    synthetic = replace(settings, drivers=DriverSettings(recordings=("unused.csv",)))
    assert hashes_of_inputs(synthetic, tmp_path).keys() == {"a.csv", "car.fmu"}


@pytest.mark.parametrize(
    "locator",
    [
        "exec:python 'my ads.py' --files 'no?e' {long}?period=0.1",
        "traci:python 'my ads.py'",
        "fmu:my ads.py?inputs.v=ego_speed",
    ],
)
def test_a_locator_depends_on_the_file_it_names(locator, tmp_path):
    (tmp_path / "my ads.py").write_text("import shutil")
    locator = locator.format(long="x" * 300)
    assert named_files(locator, tmp_path) == {tmp_path / "my ads.py"}
    if not locator.startswith("fmu:"):
        assert "my ads.py" in locator_identity(("ADS", locator), tmp_path)


def test_files_of_one_name_elsewhere_all_count(tmp_path):
    files = [tmp_path / folder / "tool.py" for folder in ("one", "other")]
    for file in files:
        file.parent.mkdir()
        file.write_text(f"import {file.parent.name}")
    ads, identities = ("ADS", f"exec:cat {files[0]} {files[1]}"), set()
    for file in files:
        file.write_text("import shutil")
        identities.add(locator_identity(ads, tmp_path / "evaluation"))
    assert len(identities) == 2
