"""Other people's OpenSCENARIO files as they are: how many run, and where every vehicle is then."""

import json
import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from laid import read_json
from loaded import ROOT
from tables import in_campaign

from sumo_eval.cosim import simulate
from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.logical import concrete, concrete_points, read_file
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.settings import SimulationSettings

SNAPSHOTS = Path(os.environ.get("SNAPSHOTS", Path(__file__).parents[3] / ".mirror"))
ASAM = "RA-Consulting-GmbH+openscenario.api.test", "cpp/applications/openScenarioTester/res"
ESMINI = "esmini+esmini", "resources"
CARLA = "carla-simulator+scenario_runner", "srunner"
TOWN = "ignacioalvmar+RSS-Demonstrator", "Town01.xodr"
NCAP = "vectorgrp+OSC-NCAP-scenarios", "."
STANDARD_RANGE = "OpenSCENARIO/NCAP/CA-FC_2026/Variations/StandardRange"
PLAYS = {
    "exampleFilesVersion1_2": (10, 17), "exampleFilesVersion1_3": (9, 16), "xosc": (23, 69),
    "examples": (5, 16), STANDARD_RANGE: (22, 22),
}  # fmt: skip
"""Files of a folder that run, of all."""
WITHIN = 0.5  # m
MEASURED = ROOT / "docs" / "measurements" / "openscenario.json"
TABLE = read_json(MEASURED)["tables"][-1]["rows"]
LATE = 0.05  # s: a step of the simulation
SECOND = json.loads(Path(__file__).with_name("second_reader.json").read_text())
EACH_STEP = SimulationSettings(record_interval=0.05)
HERO = '<Private entityRef="hero">'
DRIVES = """<PrivateAction><LongitudinalAction><SpeedAction><SpeedActionDynamics
dynamicsShape="step" dynamicsDimension="time" value="0"/><SpeedActionTarget>
<AbsoluteTargetSpeed value="8"/></SpeedActionTarget></SpeedAction></LongitudinalAction>
</PrivateAction>"""
"""CARLA's ego stands until its agent drives; with 8 m/s it meets the triggers of the file."""


def options(file):
    """What the user names behind a file's name."""
    if file.parent.name == "examples":
        return {"ego": "hero", "map": "../Town01.xodr"}
    return {"ego": "Vehicle 2"} if file.stem == "SimpleOvertake" else {}


def files(repository, target):
    """The scenario files of a snapshot by folder, with their roads and catalogs beside them."""
    store, folder = SNAPSHOTS / repository[0] / "repo", repository[1]
    if not store.is_dir():
        pytest.skip(f"no snapshot of {repository[0]} is here")
    git = ["git", "-C", str(store)]
    listed = subprocess.check_output(
        [*git, "ls-tree", "-r", "--name-only", "HEAD", folder], text=True
    )
    for name in listed.splitlines():
        if name.endswith((".xosc", ".xodr")):
            path = target / (Path(name).relative_to(folder) if folder != name else name)
            path.parent.mkdir(parents=True, exist_ok=True)
            content = subprocess.check_output([*git, "show", f"HEAD:{name}"])
            if repository == CARLA:
                content = content.replace(HERO.encode(), (HERO + DRIVES).encode())
            path.write_bytes(content)
    if repository == CARLA:
        files(TOWN, target)
    return {
        name: sorted((target / name).glob("*.xosc")) for name in PLAYS if (target / name).is_dir()
    }


def running(found):
    """Those that run. The others are refused with the name of an element, or of what is missing."""
    reads = {}
    for file in found:
        try:
            reads[file] = read_file(file, options(file))
        except InputError as error:
            why = str(error)
            if "<" not in why and "must" not in why:
                pytest.fail(why)
    return reads


def compared(file, read):
    """How far a vehicle is at most from where the second reader has it, m, at four times of a drive
    of an ego that keeps its speed; and how far apart contact, or the time at which a vehicle begins
    to move otherwise, is at most, s.
    """
    point = next(point for point, why in concrete_points(read) if why is None)
    drive = simulate(concrete(read, point), "no_reaction", EACH_STEP)
    assert not drive.error
    theirs, apart, late = SECOND[f"{file.parent.name}/{file.stem}"], [], []

    def place(name, time):
        seen = drive.actors.get(name, drive.ego)
        x, y = (np.interp(time, seen.time, it) for it in (seen.x, seen.y))
        if read.frame.line:
            x, y, _ = map_places(read.frame.line, x, y)
        return np.stack(read.frame.origin.moved(x, y)[:2])

    for name, (start, begins, places) in theirs["vehicles"].items():
        apart += [math.dist(place(name, time), its) for time, *its in places]
        if start is not None and begins is not None:
            time = np.arange(0.0, drive.actors[name].time[-1] + 1e-6, 0.01)
            x, y, heading, speed = start
            way = speed * time * [[math.cos(heading)], [math.sin(heading)]]
            off = np.hypot(*(place(name, time) - way - [[x], [y]])) > 0.1
            late.append(abs(time[off].min(initial=math.inf) - begins))
    if drive.collision is not None:
        late.append(abs(drive.collision.time - theirs["contact"]))
    return max(apart), max(late, default=0.0)


@pytest.mark.parametrize(
    "repository, folders, compares",
    [
        (ASAM, ("exampleFilesVersion1_2",), 6),
        *(in_campaign(it, (*PLAYS,), None) for it in (ASAM, ESMINI, CARLA, NCAP)),
    ],
    ids=["few", "asam", "esmini", "carla", "ncap"],
)
def test_public_files_run_with_every_vehicle_in_place(repository, folders, compares, tmp_path):
    for folder, found in files(repository, tmp_path).items():
        if folder not in folders:
            continue
        reads = running(found)
        assert (len(reads), len(found)) == PLAYS[folder], [it.stem for it in reads]
        names = {it: f"{it.parent.name}/{it.stem}" for it in found}
        plays = {row[1].partition("?")[0]: row[2] for row in TABLE}
        assert {name: plays[name] for name in names.values()} == {
            name: file in reads for file, name in names.items()
        }
        apart = {file.stem: compared(file, read) for file, read in [*reads.items()][:compares]}
        assert all(far < WITHIN and late < LATE for far, late in apart.values()), apart
