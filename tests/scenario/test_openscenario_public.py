"""Other people's OpenSCENARIO files as they are: how many run, and where every vehicle is then."""

from __future__ import annotations

import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from twins.openscenario import STEP, Reader

from sumo_eval.cosim.simulation import simulate
from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario.logical import Read, concrete, concrete_points, read_file
from sumo_eval.scenario.road.reference_line import map_places

SNAPSHOTS = Path(os.environ.get("SNAPSHOTS", Path(__file__).parents[3] / ".mirror"))
ASAM = "RA-Consulting-GmbH+openscenario.api.test", "cpp/applications/openScenarioTester/res"
ESMINI = "esmini+esmini", "resources"
CARLA = "carla-simulator+scenario_runner", "srunner"
TOWN = "ignacioalvmar+RSS-Demonstrator", "Town01.xodr"
NCAP = "vectorgrp+OSC-NCAP-scenarios", "."
STANDARD_RANGE = "OpenSCENARIO/NCAP/CA-FC_2026/Variations/StandardRange"
PLAYS = {
    "exampleFilesVersion1_2": (10, 17), "exampleFilesVersion1_3": (9, 16), "xosc": (22, 69),
    "examples": (5, 16), STANDARD_RANGE: (22, 22),
}  # fmt: skip
"""Files of a folder that run, of all."""
WITHIN = 0.5  # m
HERO = '<Private entityRef="hero">'
DRIVES = """<PrivateAction><LongitudinalAction><SpeedAction><SpeedActionDynamics
dynamicsShape="step" dynamicsDimension="time" value="0"/><SpeedActionTarget>
<AbsoluteTargetSpeed value="8"/></SpeedActionTarget></SpeedAction></LongitudinalAction>
</PrivateAction>"""
"""CARLA's ego stands until its agent drives; with 8 m/s it meets the triggers of the file."""


def options(file: Path) -> dict[str, str]:
    """What the user names behind a file's name."""
    if file.parent.name == "examples":
        return {"ego": "hero", "map": "../Town01.xodr"}
    return {"ego": "Vehicle 2"} if file.stem == "SimpleOvertake" else {}


def files(repository: tuple[str, str], target: Path) -> dict[str, list[Path]]:
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


def running(found: list[Path]) -> dict[Path, Read]:
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


def furthest(file: Path, read: Read) -> float:
    """How far a vehicle is at most from where the second reader has it, m: at three times and at
    the end of a drive of an ego that keeps its speed.
    """
    point = next(point for point, why in concrete_points(read) if why is None)
    drive = simulate(concrete(read, point), "no_reaction")
    given = {name: str(value) for name, value in read.space.given(point).items()}
    reader = Reader(read.space.file, given, options(file).get("map", ""))
    assert not drive.error
    ego = options(file).get("ego", "Ego")
    apart = []
    for time in np.linspace(0.25, 1.0, 4) * drive.simulated_time:
        while reader.time < time - 1e-9 + STEP:
            reader.step()
        for name, body in reader.bodies.items():
            seen = drive.ego if name == ego else drive.actors[name.replace(" ", "_")]
            # it has left the road, or only its end is said
            if time > seen.time[-1] + 1e-6 or body.unknown:
                continue
            x, y = (np.interp(time, seen.time, it) for it in (seen.x, seen.y))
            if read.frame.line:
                x, y, _ = map_places(read.frame.line, x, y)
            apart.append(math.dist(read.frame.origin.moved(float(x), float(y))[:2], body.place()))
    return max(apart)


@pytest.mark.parametrize(
    "repository",
    [ASAM, *(pytest.param(it, marks=pytest.mark.campaign) for it in (ESMINI, CARLA, NCAP))],
    ids=["asam", "esmini", "carla", "ncap"],
)
def test_public_files_run_with_every_vehicle_in_place(
    repository: tuple[str, str], tmp_path: Path
) -> None:
    for folder, found in files(repository, tmp_path).items():
        reads = running(found)
        assert (len(reads), len(found)) == PLAYS[folder], [it.stem for it in reads]
        apart = {file.stem: furthest(file, read) for file, read in reads.items()}
        assert max(apart.values()) < WITHIN, apart
