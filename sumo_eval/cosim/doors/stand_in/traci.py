"""The `traci` that a program of `traci:COMMAND` imports: the library itself, whose `start` and
`init` connect to the case.

`sitecustomize.py` beside this file makes the program import this module, which then imports the
library from where the program has it. Only the opening of a connection is replaced: the connection
goes to the port in SUMO_EVAL_PORT and takes the second place in SUMO's order of clients. So a
script that starts or reaches a simulation of its own works unchanged. Messages of this module go
into the case's log.

Users: users' programs, and `libsumo.py` beside this file. It runs without this package.
"""

import functools
import math
import os
import sys
from importlib import import_module
from typing import Any

ORDER = 2  # the harness is the first client

# With this module out of `sys.modules`, the import finds the library (see `sitecustomize`) and
# leaves it there, from where the script's own `import traci` takes it.
del sys.modules["traci"]
real = import_module("traci")
main = import_module("traci.main")
connection = import_module("traci.connection")
_asked_ports: list[int] = []  # the port that the script named, once it is connected
_usual_init, _usual_set_order = connection.Connection.__init__, connection.Connection.setOrder


@functools.cache
def _say(words: str) -> None:
    """Write a message to the case's log, once."""
    print(f"sumo_eval: {words}", file=sys.stderr, flush=True)  # noqa: T201


def start(
    cmd: Any = None, port: Any = None, numRetries: Any = None, label: str = "default",  # noqa: N803
    *others: Any, **options: Any,
) -> Any:  # fmt: skip
    """Connect to the case, instead of starting a simulation by the script's own command."""
    _say("traci.start connects to the case; its own command is not run")
    return main.init(label=label)


def _init_once(self: Any, host: str, port: int, process: Any, *others: Any, **options: Any) -> None:
    """Open the only connection to the case, whatever port is named."""
    if _asked_ports:
        _begin_again()
    _usual_init(self, "127.0.0.1", int(os.environ["SUMO_EVAL_PORT"]), None, *others, **options)
    _usual_set_order(self, ORDER)
    _asked_ports.append(port)


def _begin_again(*arguments: Any) -> Any:
    """Refuse a second simulation, started or loaded."""
    raise main.TraCIException(
        "sumo_eval: a case takes one connection, got a second one: start SUMO once, and do not "
        "call load, loadState or close to begin again"
    )


def _without_window(call: str) -> Any:
    """Stand-in of a call that changes a window."""
    return lambda *_, **__: _say(f"traci.gui.{call} does nothing: a case has no window")


def _of_finite_numbers(call: str, usual: Any) -> Any:
    """A call that moves a vehicle, and that ends the script at nan or infinity: SUMO takes such
    numbers, and does not show them to the harness.
    """

    def checked(self: Any, vehID: str, *values: float, **named: float) -> Any:  # noqa: N803
        numbers = (*values, *named.values())
        if not all(map(math.isfinite, numbers)):
            sys.exit(f"sumo_eval: traci.vehicle.{call} must be given finite numbers, got {numbers}")
        return usual(self, vehID, *values, **named)

    return checked


def _quietly(
    kind: type[BaseException], error: BaseException, trace: Any, _usual: Any = sys.excepthook
) -> None:
    """Hide the error of a script that does not expect SUMO to close the connection at the end."""
    if issubclass(kind, main.FatalTraCIError) and "closed by SUMO" in str(error):
        _say("the case is over")
    else:
        _usual(kind, error, trace)


connection.Connection.__init__ = _init_once
connection.Connection.setOrder = lambda *_: None  # the connection has `ORDER`
connection.Connection.load = _begin_again
import_module("traci._simulation").SimulationDomain.loadState = _begin_again
windows = import_module("traci._gui").GuiDomain
for call in vars(windows):
    if not call.startswith(("_", "get", "has", "is")):
        setattr(windows, call, _without_window(call))
vehicles = import_module("traci._vehicle").VehicleDomain
for call in ("setSpeed", "slowDown", "setAcceleration", "setPreviousSpeed"):
    setattr(vehicles, call, _of_finite_numbers(call, getattr(vehicles, call)))
sys.excepthook = _quietly
real.start = main.start = start  # type: ignore[attr-defined]
# for a script that imports both; `libsumo.py` is for one that imports libsumo first
sys.modules["libsumo"] = real
