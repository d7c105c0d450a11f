"""`traci:COMMAND`: the user's own program drives the ego as a TraCI client of a real sumo process
on a loopback port.

The harness is SUMO's first client and the program, through a relay, the second. SUMO takes a step
when both clients have asked for one. The unchanged `traci.start` and `traci.init` of a Python
script connect to this process (`stand_in/traci.py`). Any other program finds the port in its
environment (SUMO_EVAL_PORT) or in its command (`{port}`), and sets its order to 2 after it has
connected.

The program may write to everything in SUMO. So a failure of SUMO in the program's turn counts as
the program's, except at the start, where SUMO is tried without it too. Needs the sumo program:
extra `gui`.

Users: `cosim/simulation.py`, `record/watch.py`; `cosim/doors/controller.py` finds `TraciProgram` by
name (`DOORS`).
"""

from __future__ import annotations

import math
import os
import shutil
import socket
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any

from traci.connection import FatalTraCIError, TraCIException

from sumo_eval.cosim.doors.child_program import ChildProgram, checked_command
from sumo_eval.cosim.doors.controller import Adapter, own_vehicle_type
from sumo_eval.cosim.sumo.insides import libsumo
from sumo_eval.cosim.sumo.private_server import CLIENTS, LOOPBACK, PrivateServer, Relay
from sumo_eval.cosim.sumo.session import check_start, command_line, quoted, session
from sumo_eval.cosim.sumo.sumo_files import EGO
from sumo_eval.errors import (
    ControllerError,
    ControllerTimeoutError,
    SimulationError,
    check_known,
    needs_extra,
)
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import SimulationSettings

# s of wall time in which sumo has to start, and in which the program has to connect and to ask for
# its first step; for the program `step_timeout` if that is longer
START_TIMEOUT = 20.0
_BETWEEN_TRIES = 0.01  # s of wall time between two tries to connect
_PORT = "SUMO_EVAL_PORT"  # environment variable
_ENDED_EARLY = "; it must ask for steps until SUMO closes the connection"
_STAND_IN = Path(__file__).parent / "stand_in"
_SETTINGS = {
    name: getattr(libsumo.constants, f"VAR_{variable}")
    for name, variable in (
        ("maxSpeed", "MAXSPEED"), ("accel", "ACCEL"), ("decel", "DECEL"),
        ("apparentDecel", "APPARENT_DECEL"),
        ("emergencyDecel", "EMERGENCY_DECEL"), ("tau", "TAU"), ("minGap", "MINGAP"),
        ("speedFactor", "SPEED_FACTOR"),
        ("sigma", "IMPERFECTION"), ("maxSpeedLat", "MAXSPEED_LAT"), ("minGapLat", "MINGAP_LAT"),
        ("length", "LENGTH"),
        ("width", "WIDTH"),
    )
}  # fmt: skip
"""Attributes of the ego for which SUMO silently accepts nan and infinity -> TraCI's variables."""


@dataclass(slots=True)
class TraciProgram(Adapter):
    """A program that is a TraCI client of its own: it is not called, but acts while SUMO waits for
    it.

    folder: in which it runs.
    log: output of the program, once it has ended.
    options: of its entry in the evaluation; only `vehicle_type`, the ego's vType as a table.
    """

    command: tuple[str, ...]
    folder: Path
    log: str = ""
    took: float = 0.0  # s of wall time of its last turn, the step of SUMO included
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def vehicle_type(self) -> Any:
        """The ego's vType as the entry names it; None: the vehicle settings' own."""
        check_known("option of an ADS of `traci:`", ("vehicle_type",), *self.options)
        return self.options.get("vehicle_type")

    @classmethod
    def from_command(cls, command: str, folder: Path) -> TraciProgram:
        """A program of this command. Raises InputError for a command that cannot be run, and on a
        machine without sumo.
        """
        sumo_binary()
        return cls(checked_command(command, folder, "traci"), folder)


def sumo_binary() -> str:
    """Path of the sumo program. Raises InputError naming the extra to install."""
    path = shutil.which("sumo")
    if path is None:
        with suppress(ImportError, AttributeError):
            import sumo

            path = shutil.which("sumo", path=str(Path(sumo.SUMO_HOME) / "bin"))
    if path is None:
        raise needs_extra("`traci:`, for the program sumo,", "gui")
    return path


@dataclass
class ServedSimulation:
    """The harness's connection, with the attributes of the libsumo module that `cosim/` uses.

    ego_has_speed: the ego was given its first speed, or one of the program's, before `Stage`.
    """

    _connection: Any
    _program: ChildProgram
    _ads: TraciProgram
    _step_timeout: float
    _relay: Relay
    _logs: tuple[Path, ...]  # that tell why SUMO ended

    def __post_init__(self) -> None:
        sumo = self._connection
        self.vehicle, self.lane, self.simulation = sumo.vehicle, sumo.lane, sumo.simulation
        self.TraCIException, self.FatalTraCIError = TraCIException, FatalTraCIError
        self.ego_has_speed = True

    def begin(self, concrete: ConcreteScenario, settings: SimulationSettings) -> None:
        """Become the first of two clients, and insert the vehicles by a step in which none moves;
        check that they are at their starts.

        SUMO loads the case once the program has connected and set its order. It takes the step once
        the program has asked for one, until when the program has its first turn.
        """
        limit = max(START_TIMEOUT, self._step_timeout)
        self._wait(lambda: self._connection.setOrder(1), limit)
        # before the program's first turn, in which it may set a speed of its own
        self._wait(lambda: self.vehicle.setSpeed(EGO, concrete.ego.speed), limit)
        self._wait(self._connection.simulationStep, limit)
        # a request too: SUMO may end in it
        self._wait(lambda: check_start(self, concrete, settings), limit)
        self._watch()
        self._ads.took = 0.0  # starting and connecting is no step

    def _watch(self) -> None:
        """Let SUMO show the ego's `_SETTINGS` now, and with its answer to every step."""
        self.vehicle.subscribe(EGO, list(_SETTINGS.values()))

    def simulationStep(self) -> None:  # noqa: N802 - TraCI's name
        """Ask for a step, which SUMO takes when the program has asked for one too."""
        self._wait(self._connection.simulationStep, self._step_timeout)
        # the program writes to SUMO directly, so its values can only be checked afterwards
        shown = self.vehicle.getSubscriptionResults(EGO)  # came with the answer to the step
        # SUMO has one list of subscriptions for both clients: the program may have ended these. An
        # ego that has left SUMO shows nothing, and is reported where it is read.
        if not shown.keys() >= set(_SETTINGS.values()) and EGO in self.vehicle.getIDList():
            self._watch()
            shown = self.vehicle.getSubscriptionResults(EGO)
        wrong = [
            f"the {name} {shown[variable]}"
            for name, variable in _SETTINGS.items()
            if not math.isfinite(shown.get(variable, 0.0))
        ]
        # SUMO shows no speed that setSpeed and the like have set, so the relay reads the requests
        wrong += ["nan or infinity"] if self._relay.has_erred else []
        if wrong:
            # SUMO's clock is ahead of the case's by the step that inserted the vehicles
            now = self.simulation.getTime() - self.simulation.getDeltaT()
            raise ControllerError(
                f"The ADS's program gave `{EGO}` {wrong[0]}, seen at {now:.2f} s; it must be a "
                "finite number."
            )

    def _wait(self, call: Callable[[], object], limit: float) -> None:
        """Send a request, and wait at most `limit` s for SUMO's answer, which comes after the
        program's turn.
        """
        # traci reports a timeout as a closed connection: the time that has passed tells them apart
        self._connection._socket.settimeout(None if limit == math.inf else limit)
        started = perf_counter()
        try:
            call()
        except (self.FatalTraCIError, OSError) as error:
            raise self._fault(error, perf_counter() - started, limit) from error
        self._ads.took = perf_counter() - started

    def _fault(self, error: Exception, waited: float, limit: float) -> ControllerError:
        """The error of a request that failed in the program's turn.

        SUMO's own failure cannot be told apart here from one that the program has caused.

        waited, limit: s of wall time.
        """
        if self._relay.has_asked and not self._relay.has_order:
            return ControllerError(
                "The ADS's program must set its order to 2 after it has connected, before "
                "anything else (`setOrder(2)`): it shares the simulation with the harness"
            )
        if self._relay.has_left or self._program.process.poll() is not None:
            ended = self._program.ended("connection")
            hint = _ENDED_EARLY if self._program.process.returncode == 0 else ""
            return ControllerError(f"{ended}{hint}.")
        if waited >= limit:
            return ControllerTimeoutError(
                f"The ADS's program must connect to the port in {_PORT}, set its order to 2 "
                f"and ask for its steps, each within {limit:g} s; it was ended."
            )
        return ControllerError(
            f"SUMO ended while the ADS's program had its turn: {quoted(error, *self._logs)}."
        )


@contextmanager
def served(
    concrete: ConcreteScenario, settings: SimulationSettings, ads: TraciProgram, step_timeout: float
) -> Iterator[ServedSimulation]:
    """A sumo process with every vehicle of the case at its start (time 0), and the user's program
    connected to it; both are ended at the end.

    step_timeout: of the program, s of wall time.
    """
    settings = concrete.simulation(settings)
    with tempfile.TemporaryDirectory(prefix="sumo_eval_") as name:
        folder = Path(name)
        log, console = folder / "sumo.log", folder / "console.txt"
        with socket.socket() as probe:
            probe.bind((LOOPBACK, 0))  # the system chooses a free port
            port = probe.getsockname()[1]
        vehicle_type = own_vehicle_type(ads, concrete.road)
        words = [
            sumo_binary(),
            *command_line(concrete, settings, folder, log, vehicle_type)[1:],
            "--remote-port",
            str(port),
            "--num-clients",
            str(CLIENTS),
        ]
        with console.open("wb") as output:
            server = PrivateServer(words, port, output)
        program = None
        relay = None
        try:
            connection = _connect(server, (log, console))
            relay = Relay(server.sockets[1])
            words = [word.replace("{port}", str(relay.port)) for word in ads.command]
            program = ChildProgram(words, ads.folder, talks=False, variables=_variables(relay.port))
            simulation = ServedSimulation(
                connection, program, ads, step_timeout, relay, (log, console)
            )
            threading.Thread(target=_hang_up, args=(program, relay), daemon=True).start()
            try:
                simulation.begin(concrete, settings)
            except (ControllerError, SimulationError) as error:
                # the program has had a turn: SUMO is at fault only if it fails alone as well
                with session(concrete, settings, vehicle_type):
                    pass
                if isinstance(error, ControllerError):
                    raise
                raise ControllerError(f"The ADS's program is responsible: {error}") from error
            yield simulation
        finally:
            if relay is not None:
                relay.end()
            else:
                server.sockets[1].close()
            server.end()
            if program is not None:
                ads.log = program.stop()


def _variables(port: int) -> dict[str, str]:
    """Variables of the program's environment: the port, and where Python finds the `traci` that
    connects to it.
    """
    path = os.pathsep.join(filter(None, [str(_STAND_IN), os.environ.get("PYTHONPATH", "")]))
    return {_PORT: str(port), "PYTHONPATH": path}


def _hang_up(program: ChildProgram, relay: Relay) -> None:
    """Stop the relay when the program ends. Otherwise SUMO would wait for ever for a program that
    never connected, and this process for SUMO.
    """
    program.process.wait()
    relay.end()


def _connect(server: PrivateServer, logs: tuple[Path, ...]) -> Any:
    """The harness's connection, made once the server listens; the relay's socket is connected
    directly after it, for the program to come.

    logs: files that tell why SUMO failed to start.
    """
    until = monotonic() + START_TIMEOUT
    while True:
        try:
            server.connect()
            return _traci_connection(server.sockets[0])
        except OSError as error:
            if server.process.poll() is not None or monotonic() > until:
                raise SimulationError(
                    f"SUMO could not start the case: {quoted(error, *logs)}."
                ) from error
            with suppress(subprocess.TimeoutExpired):
                server.process.wait(_BETWEEN_TRIES)


def _traci_connection(connected: socket.socket) -> Any:
    """A TraCI connection over a connected socket.

    traci's class takes no socket, but connects one of its own: here to a listener of no use. The
    connected socket then replaces it.
    """
    import traci.connection
    import traci.main  # makes the domains that a connection has

    with socket.create_server((LOOPBACK, 0)) as listener:
        connection = traci.connection.Connection(*listener.getsockname(), None, None, False, None)
    connection._socket.close()
    connection._socket = connected
    return connection
