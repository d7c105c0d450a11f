"""The libsumo session: one simulation in this process, started from a concrete scenario.

libsumo accepts a second `start` silently, delays insertions, and reports a bad file only as
"Process Error". So this file refuses a second session, checks that SUMO shows the requested start,
and quotes SUMO's own log.

Users: `cosim/` opens sessions, for cases and for the gym, and checks starts; in a curve it also
compares every later place within `bend_tolerance`. `cosim/doors/traci_program.py` and
`extras/bench/costs.py` start SUMO by its command line. Fixed: SUMO's options and the tolerances.
"""

from __future__ import annotations

import locale
import math
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_eval.cosim.sumo.insides import keep_xml_parser, libsumo, vehicles
from sumo_eval.cosim.sumo.sumo_files import (
    SEGMENT,
    SIMULATION_OPTIONS,
    first_front,
    inserted,
    network_xml,
    routes_xml,
)
from sumo_eval.errors import SimulationError, said
from sumo_eval.scenario.concrete import ConcreteScenario, Road
from sumo_eval.scenario.road.reference_line import frame_places, map_places, tightest
from sumo_eval.settings import SimulationSettings

_EgoType = Mapping[str, str] | None  # attributes of the ego's vType, as of `routes_xml`
POSITION_TOLERANCE = 1e-3  # m
# m, as `POSITION_TOLERANCE` in a curve. SUMO draws it as chords, which are within some mm of the
# curve (`sumo_files._segment`): a vehicle that is farther off is misplaced.
CHORD_TOLERANCE = 0.05
SPEED_TOLERANCE = 1e-3  # m/s
NOWHERE = -1e6  # m; SUMO shows a vehicle that is on no lane at an x far below this value
_COMMENT = re.compile(r"<!--.*?-->\s*", re.DOTALL)  # of XML
_SESSION_OPTIONS = {
    "begin": "0",
    "xml-validation": "never",
    "xml-validation.net": "never",
    "xml-validation.routes": "never",
    "no-step-log": "true",
    "no-warnings": "true",
    "duration-log.disable": "true",
    "seed": "0",
}
"""Options of SUMO that are the same in every session, in addition to `SIMULATION_OPTIONS`."""


def simulator_version() -> str:
    """SUMO's version, as it reports itself."""
    return (
        str(libsumo.simulation.getVersion()[1])
        if libsumo.simulation.isLoaded()
        else f"SUMO {libsumo.__version__}"
    )


@contextmanager
def session(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    ego_type: _EgoType = None,
) -> Iterator[Any]:
    """The running libsumo module with every vehicle of the case at its start (time 0), closed at
    the end.
    """
    settings = concrete.simulation(settings)
    texts = network_xml(concrete.road), _shown_routes(concrete, settings, ego_type)
    with running(*texts, settings, concrete.road) as traci:
        check_start(traci, concrete, settings)
        yield traci


@contextmanager
def running(
    network: str,
    routes: str,
    settings: SimulationSettings,
    road: Road | None = None,
    *,
    collisions: str = "warn",
) -> Iterator[Any]:
    """The running libsumo module with the vehicles of these files at their starts, closed at the
    end.

    network, routes: the files' texts.
    road: of a single case; None: of a batch, whose files have a road for each case.
    collisions: SUMO's `collision.action`; "none" for a batch, whose roads overlap on the map.

    The caller checks that the vehicles stand where they should (`check_start`).
    """
    if libsumo.simulation.isLoaded():
        raise SimulationError(
            "A SUMO simulation is already running in this process; libsumo holds one at a time."
        )
    with _files(network, routes) as files:
        keep_xml_parser()
        try:
            _start(_arguments(*files[:3], settings, road, collisions), files)
            yield libsumo
        finally:
            _close()


def _start(arguments: list[str], files: _Files) -> None:
    """Start SUMO and insert the vehicles; raise its errors with its log."""
    # where a library of an ADS has set a locale, SUMO would expect decimal commas
    locale.setlocale(locale.LC_NUMERIC, "C")
    try:
        with _stderr_into(files.console):
            libsumo.start(arguments)
            libsumo.simulationStep()  # inserts the vehicles, moves nothing
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        libsumo.close()  # not `_close`: its step may write files, or crash a half-loaded case
        sentence = f"SUMO could not start the case: {quoted(error, files.log, files.console)}."
        # paths of files that no longer exist when the message is read: replace them by plain names
        for path, name in zip(files, _NAMES, strict=True):
            sentence = sentence.replace(f"'{path}'", f"'{name}'")
        raise SimulationError(sentence) from error


def command_line(
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    folder: Path,
    log: Path,
    ego_type: _EgoType,
) -> list[str]:
    """SUMO's command line for a case, its files written into `folder`.

    log: file that receives SUMO's errors.
    ego_type: as of `routes_xml`.
    """
    network, routes = folder / "net.xml", folder / "rou.xml"
    network.write_text(network_xml(concrete.road), encoding="utf-8")
    routes.write_text(_shown_routes(concrete, settings, ego_type), encoding="utf-8")
    return _arguments(network, routes, log, settings, concrete.road)


def _shown_routes(
    concrete: ConcreteScenario, settings: SimulationSettings, ego_type: _EgoType
) -> str:
    """The vehicles of a case as a route file, which an ADS may read.

    Its comments name the case and the actors' moves to come. They stay only where the conditions
    reveal the scenario.
    """
    text = routes_xml(concrete, settings.vehicle, ego_type)
    return text if settings.conditions.reveal_scenario else _COMMENT.sub("", text)


class _Files(NamedTuple):
    """Files that a simulation reads and writes."""

    network: Path
    routes: Path
    log: Path
    console: Path


_NAMES = _Files(Path("net.xml"), Path("rou.xml"), Path("sumo.log"), Path("stderr.txt"))


@contextmanager
def _files(network: str, routes: str) -> Iterator[_Files]:
    """Files with these texts, and two empty ones, deleted at the end.

    In memory where the system supports it: a folder takes ten times as long.
    """
    # Reopen standard streams that an ADS has closed: numbers 0 to 2. Otherwise a file below would
    # get such a number, and with it all that SUMO prints.
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    if not hasattr(os, "memfd_create"):
        with tempfile.TemporaryDirectory(prefix="sumo_eval_") as folder:
            files = _Files(*(Path(folder) / name for name in _NAMES))
            files.network.write_text(network, encoding="utf-8")
            files.routes.write_text(routes, encoding="utf-8")
            yield files
        return
    numbers: list[int] = []
    try:
        for name, text in zip(_NAMES, (network, routes, "", ""), strict=True):
            numbers.append(os.memfd_create(str(name)))
            os.write(numbers[-1], text.encode())
        yield _Files(*(Path(f"/proc/self/fd/{number}") for number in numbers))
    finally:
        for number in numbers:
            os.close(number)


def _arguments(
    network: Path, routes: Path, log: Path, settings: SimulationSettings, road: Road | None,
    collisions: str = "warn",
) -> list[str]:  # fmt: skip
    """SUMO's command line.

    network, routes, log: files. road, collisions: as of `running`.
    """
    options = {
        "net-file": str(network),
        "route-files": str(routes),
        "step-length": f"{settings.step:g}",
        "lanechange.duration": f"{settings.lane_change_duration:g}",
        "error-log": str(log),
        **_SESSION_OPTIONS,
        **SIMULATION_OPTIONS,
        "collision.action": collisions,
    }
    # SUMO seeds 64 random generators by default, but a simulation needs only one for each of its
    # lanes, and seeding takes time. In a user's network the lanes are not counted here.
    if road is not None and road.network is None:
        options["thread-rngs"] = str(road.lanes)
    return ["sumo", *(part for name, value in options.items() for part in (f"--{name}", value))]


def bend_tolerance(road: Road, y: Any) -> Any:
    """Largest distance on the map, m, from a vehicle in a curve to the place where SUMO shows it.

    SUMO puts the vehicle on the normal of a chord of the line. The chord's normal is turned from
    the curve's normal by at most half a segment over the radius, rad. At |y| this adds the angle
    times |y| to the chord's own distance, some mm, for which half of `CHORD_TOLERANCE` is ample.
    The result is at least the whole `CHORD_TOLERANCE`, also near the line.

    y: of the vehicle, across the road's line, m.
    """
    turned = 0.5 * SEGMENT / tightest(road.line)
    return np.maximum(CHORD_TOLERANCE, 0.5 * CHORD_TOLERANCE + np.abs(y) * turned)


def check_start(
    traci: Any,
    concrete: ConcreteScenario,
    settings: SimulationSettings,
    names: Sequence[str] | None = None,
    *,
    by_map: bool = True,
) -> None:
    """Raise SimulationError unless SUMO shows every vehicle as it was to be inserted.

    SUMO may move a vehicle or delay its insertion. The place and speed of insertion are those of
    the start, with two exceptions: an actor with a place on the map must only have been inserted
    somewhere, and one that SUMO's model drives has its `departure_speed`.

    names: of the vehicles in SUMO, the ego's first; None: as in the scenario.
    by_map: on a curved road, whether places on the map are compared. False: only if SUMO's models
        drive no actor; if they do, places along the lanes are compared.
    """
    road = concrete.road
    calls = vehicles(traci)
    starts = list(inserted(concrete, settings.vehicle.length))
    for in_sumo, (name, start, length, on_map) in zip(
        names or [it[0] for it in starts], starts, strict=True
    ):
        try:
            (x, y), speed = calls.getPosition(in_sumo), calls.getSpeed(in_sumo)
        except traci.TraCIException:
            x = -math.inf
            y = 0.0
            speed = 0.0
        if x < NOWHERE:
            raise SimulationError(f"SUMO did not insert vehicle `{name}` at the start of the case.")
        # inserted elsewhere with any speed: `Stage.tell` puts it on the map in the first step
        if on_map is not None:
            continue
        front = first_front(road, start, length)
        if road.bent and (by_map or not concrete.reacts):
            meant = map_places(road.line, front, start.y)
            tolerance = bend_tolerance(road, start.y)
            # both are the distance on the map: in a curve, 1 m of x may be more or less than that
            ahead = left = math.hypot(x - meant[0], y - meant[1])
            # for the message below: the place along and across the road
            x, y = (float(it) for it in frame_places(road.line, x, y, near=front)[:2])
        else:
            if road.bent:  # SUMO drives vehicles here: compare places along their lanes
                x = calls.getLanePosition(in_sumo)
                lane = calls.getLaneIndex(in_sumo)
                y = road.lane_width * lane + calls.getLateralLanePosition(in_sumo)
            ahead, left = abs(x - front), abs(y - start.y)
            tolerance = POSITION_TOLERANCE
        if not (ahead <= tolerance and left <= tolerance):  # `not <=`: true of nan as well
            raise SimulationError(
                f"SUMO placed vehicle `{name}` at ({x - front + start.x:.3f}, {y:.3f}) m "
                f"instead of ({start.x:.3f}, {start.y:.3f}) m."
            )
        if not abs(speed - start.speed) <= SPEED_TOLERANCE:
            raise SimulationError(
                f"SUMO gave vehicle `{name}` the speed {speed:.3f} m/s instead of "
                f"{start.speed:.3f} m/s."
            )


def quoted(error: Exception, *logs: Path) -> str:
    """SUMO's error with its log, as the exception alone says no more than "Process Error"."""
    for log in logs:
        lines = (
            log.read_text(encoding="utf-8", errors="replace").splitlines() if log.is_file() else []
        )
        text = "; ".join(line.strip().rstrip(".") for line in lines if line.strip())
        if text:
            return f"{said(error)} ({text})"
    return said(error)


@contextmanager
def _stderr_into(path: Path) -> Iterator[None]:
    """Send stderr to a file, and back at the end; pass on what a successful start has printed.

    SUMO prints errors to stderr whatever its options say; they become part of the package's error.
    """
    with suppress(AttributeError, ValueError):  # stderr is None, or an ADS has closed it
        sys.stderr.flush()
    console, file = os.dup(2), os.open(path, os.O_RDWR | os.O_CREAT)
    try:
        os.dup2(file, 2)
        yield
        # SUMO has started: its output holds no errors, and goes to the user, if still there
        with suppress(BrokenPipeError):
            os.write(console, os.pread(file, os.fstat(file).st_size, 0))
    finally:
        os.dup2(console, 2)
        os.close(console)
        os.close(file)


def _close() -> None:
    """End the simulation.

    SUMO keeps a pointer to the vehicle of a moveToXY that no step has carried out: it would break
    the start of the next simulation. So a last step carries out what an ADS has left pending.
    """
    if not libsumo.simulation.isLoaded():
        return
    # the case has ended and has its reason: an error of this step changes nothing
    with suppress(libsumo.TraCIException, libsumo.FatalTraCIError):
        libsumo._libsumo_step(0.0)  # `simulationStep` would call listeners
    libsumo.close()
