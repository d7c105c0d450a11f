"""Other people's OpenSCENARIO files as they are: how many run, and where every vehicle is then."""

import json
import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from twins.openscenario import STEP, Reader

from sumo_eval.cosim.simulation import simulate
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
MEASURED = Path(__file__).parents[2] / "docs" / "measurements" / "openscenario.json"
TABLE = json.loads(MEASURED.read_text())["tables"][-1]["rows"]
LATE = 0.05  # s: a step of the simulation
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


class Begun:
    """When a vehicle no longer drives as at the start: its place is 0.1 m off, on the map."""

    def __init__(self, x, y, heading, speed):
        self.start, self.time = (
            (x, y, speed * math.cos(heading), speed * math.sin(heading)),
            math.inf,
        )

    def look(self, time, place):
        """Take in a place at a time."""
        x, y, dx, dy = self.start
        if math.dist(place, (x + dx * time, y + dy * time)) > 0.1:
            self.time = min(self.time, time)


def compared(file, read):
    """How far a vehicle is at most from where the second reader has it, m, at three times and at
    the end of a drive of an ego that keeps its speed; and how far apart contact, or the time at
    which a vehicle begins to move otherwise, is at most, s.
    """
    point = next(point for point, why in concrete_points(read) if why is None)
    drive = simulate(concrete(read, point), "no_reaction", EACH_STEP)
    assert not drive.error
    given = {name: str(value) for name, value in read.space.given(point).items()}
    reader = Reader(read.space.file, given, options(file).get("map", ""))
    ego, end = reader.bodies[options(file).get("ego", "Ego")], drive.simulated_time
    theirs, ours = (
        {
            name: Begun(*it.place(), it.heading(), it.v)
            for name, it in reader.bodies.items()
            if it is not ego
        }
        for _ in range(2)
    )
    looks, contact, apart = list(np.linspace(0.25, 1.0, 4) * end), math.inf, [0.0]
    while reader.time < end + 0.1:
        time = reader.time
        reader.step()
        for name, body in list(reader.bodies.items()):
            if not (body is ego or body.unknown) and body.touches(ego):
                contact = min(contact, time)
            seen = drive.ego if body is ego else drive.actors[name.replace(" ", "_")]
            if body.unknown:  # only its end is said
                ours.pop(name, None)
            if time > seen.time[-1] + 1e-6 or body.unknown:  # or it has left the road
                continue
            x, y = (np.interp(time, seen.time, it) for it in (seen.x, seen.y))
            if read.frame.line:
                x, y, _ = map_places(read.frame.line, x, y)
            place = read.frame.origin.moved(float(x), float(y))[:2]
            if name in ours:
                ours[name].look(time, place)
                theirs[name].look(time, body.place())
            if looks and time > looks[0] - STEP:
                apart.append(math.dist(place, body.place()))
        if looks and time > looks[0] - STEP:
            looks.pop(0)
    late = [abs(it.time - theirs[name].time) for name, it in ours.items()
            if max(it.time, theirs[name].time) < math.inf]  # fmt: skip
    if drive.collision is not None:
        late.append(abs(drive.collision.time - contact))
    return max(apart), max(late, default=0.0)


@pytest.mark.parametrize(
    ("repository", "folders", "compares"),
    [
        (ASAM, ("exampleFilesVersion1_2",), 6),
        *(
            pytest.param(it, (*PLAYS,), None, marks=pytest.mark.campaign)
            for it in (ASAM, ESMINI, CARLA, NCAP)
        ),
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
