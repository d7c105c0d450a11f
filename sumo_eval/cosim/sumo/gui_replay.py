"""Replay of a recorded case in sumo-gui: SUMO draws, the recording says where every vehicle is.

No controller runs.

Users: `cli/look.py`, for `sumo-eval replay`.
"""

import contextlib
import io
import math
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from sumo_eval.cosim.sumo.sections import road_edges
from sumo_eval.cosim.sumo.sumo_files import EGO, network_xml, view_xml
from sumo_eval.errors import InputError, needs_extra
from sumo_eval.scenario.bodies import BODIES, CAR
from sumo_eval.scenario.concrete import Road
from sumo_eval.scenario.road.reference_line import map_places
from sumo_eval.trajectory import Collision, Trajectories, Trajectory

STEP = 0.05  # s; of the animation
ZOOM = 4000.0  # of sumo-gui: some 150 m of road
COLOURS = {EGO: "0,114,178", "": "178,106,0"}  # of the ego, of actors


def sumo_gui() -> str:
    """The path of sumo-gui. Raises InputError where there is none."""
    beside = Path(sys.executable).with_name("sumo-gui")
    path = str(beside) if beside.is_file() else shutil.which("sumo-gui")
    if path is None:
        raise needs_extra("The program sumo-gui, of which there is none on this machine,", "gui")
    return path


def replay_in_gui(
    road: Road, vehicles: Trajectories, collision: Collision | None,
    program: str | None = None,
    *, bodies: Mapping[str, str],
) -> None:  # fmt: skip
    """Play a recording in sumo-gui in real time, and leave its window open at the end until the
    user closes it.

    vehicles: trajectories in road coordinates by name, the ego's under `ego`.
    program: sumo-gui, or another SUMO program that understands TraCI.
    bodies: kind of body (`scenario/bodies.py`) by the vehicle's name; a vehicle without is a car.
    """
    program = program or sumo_gui()
    from traci import main as traci  # `import traci` gives libsumo here, which has no window

    shows = Path(program).name.startswith("sumo-gui")
    files = {"-n": network_xml(road), "-r": _types(vehicles, bodies)}  # by SUMO's option
    command = [
        program, "--step-length", str(STEP), "--collision.action", "none",
        "--no-step-log", "true", "--no-warnings", "true",
    ]  # fmt: skip
    if shows:
        files["-g"] = view_xml(road)
        command += ["--start", "true", "--window-size", "1400,600"]
    with tempfile.TemporaryDirectory(prefix="sumo_eval_") as folder:
        for option, text in files.items():
            path = Path(folder) / f"{option[1:]}.xml"
            path.write_text(text, encoding="utf-8")
            command += [option, str(path)]
        try:
            # traci prints each try to connect
            with contextlib.redirect_stdout(io.StringIO()):
                traci.start(command)
        except (OSError, traci.TraCIException, traci.FatalTraCIError) as error:
            raise InputError(f"{program} could not be started: {error}.") from error
        try:
            on_map = {name: _on_map(road, it) for name, it in vehicles.items()}
            _play(traci, on_map, collision, road_edges(road), shows=shows)
        except traci.FatalTraCIError:
            return  # the user has closed the window
        finally:
            if traci.isLoaded():
                traci.close(wait=not shows)  # a window is the user's to close


def _on_map(road: Road, trajectory: Trajectory) -> Trajectory:
    """A trajectory in road coordinates, converted to map coordinates."""
    x, y, heading = map_places(road.line, trajectory.x, trajectory.y, trajectory.heading)
    return replace(trajectory, x=x, y=y, heading=heading)


def _play(
    traci: Any,
    vehicles: Trajectories,
    collision: Collision | None,
    edges: Sequence[str],
    *,
    shows: bool,
) -> None:
    """Add the vehicles, then put them to their places at each step, in real time.

    vehicles: trajectories on the map by name.
    edges: of the road, in order.
    shows: whether the program has a window.
    """
    start = min(trajectory.time[0] for trajectory in vehicles.values())
    end = vehicles[EGO].time[-1]
    _add(traci, vehicles, edges)
    if shows:
        traci.gui.trackVehicle(traci.gui.DEFAULT_VIEW, EGO)
        traci.gui.setZoom(traci.gui.DEFAULT_VIEW, ZOOM)
    clock = time.monotonic()
    edge = edges[0] if len(edges) == 1 else ""
    for moment in np.arange(start, end + STEP, STEP):
        for name, trajectory in vehicles.items():
            _place(traci, name, trajectory, min(moment, end), edge)
        if collision is not None and moment + STEP > collision.time:
            traci.vehicle.setColor(EGO, (198, 40, 40, 255))
        traci.simulationStep()
        if shows:
            time.sleep(max(0.0, moment - start - (time.monotonic() - clock)))
    while shows:  # the last frame stays until the window is closed, which ends the connection
        traci.simulation.getTime()
        time.sleep(4 * STEP)


def _add(traci: Any, vehicles: Trajectories, edges: Sequence[str]) -> None:
    """Add the vehicles to SUMO, without safety checks and lane changes of its own."""
    traci.route.add("road", list(edges))
    for name in vehicles:
        traci.vehicle.add(
            name, "road", typeID=name, depart="now", departPos="0", departLane="0", departSpeed="0"
        )
        traci.vehicle.setSpeedMode(name, 0)
        traci.vehicle.setLaneChangeMode(name, 0)


def _place(traci: Any, name: str, trajectory: Trajectory, moment: float, edge: str) -> None:
    """Put a vehicle where it was at a moment, s; after its last sample, where it was then.

    SUMO's point is the middle of the front bumper, its angle clockwise from north.

    edge: the road's; "" if the road has several: SUMO takes the nearest.
    """
    x, y, heading = (
        np.interp(moment, trajectory.time, channel)
        for channel in (trajectory.x, trajectory.y, np.unwrap(trajectory.heading))
    )
    half = trajectory.length / 2.0
    # the lane only helps SUMO to find the road: `keepRoute` 2 lets a vehicle be anywhere on the map
    traci.vehicle.moveToXY(
        name, edge, 0 if edge else -1, x + math.cos(heading) * half, y + math.sin(heading) * half,
        angle=90.0 - math.degrees(heading), keepRoute=2,
    )  # fmt: skip


def _types(vehicles: Trajectories, bodies: Mapping[str, str]) -> str:
    """A route file with a vehicle type for each vehicle, named as the vehicle."""
    routes = etree.Element("routes")
    for name, trajectory in vehicles.items():
        body = BODIES[bodies.get(name, CAR)]
        etree.SubElement(
            routes, "vType", id=name, length=repr(trajectory.length), width=repr(trajectory.width),
            color=COLOURS.get(name, COLOURS[""]), minGap="0", vClass=body.sumo_class,
            guiShape=body.shape,
        )  # fmt: skip
    return etree.tostring(routes, encoding="unicode")
