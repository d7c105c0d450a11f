"""Result of `import traci` in a program of `traci:`: the library itself, whose `start` and `init`
connect to the case.

This folder stands first on the program's path. The library is found behind it, wherever the program
has it; only what opens a connection is another: it goes to the port of SUMO_EVAL_PORT and sets the
client's order, so that a script that starts or reaches a simulation of its own works as it is. What
it says goes into the case's log.
"""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

HERE = os.path.dirname(os.path.abspath(__file__))
ORDER = 2  # the harness is the first client

sys.path[:] = [place for place in sys.path if os.path.abspath(place) != HERE]
del sys.modules["traci"]
real = importlib.import_module("traci")
main = importlib.import_module("traci.main")
connection = importlib.import_module("traci.connection")
_made_before: list[int] = []
_make, _set_order = connection.Connection.__init__, connection.Connection.setOrder


def _say(words: str) -> None:
    print(f"sumo_eval: {words}", file=sys.stderr, flush=True)  # noqa: T201 - for the case's log


def start(cmd: Any = None, *arguments: Any, label: str = "default", **options: Any) -> Any:
    """Connect to the case in place of starting a simulation with the script's own command."""
    _say("traci.start connects to the case; its own command is not run")
    return main.init(label=label)


def _made(self: Any, host: str, port: int, process: Any, *others: Any, **options: Any) -> None:
    """A connection to the case, the only one, whatever port is named."""
    if _made_before:
        raise main.TraCIException("sumo_eval: a case takes one connection, got a second one")
    _make(self, "127.0.0.1", int(os.environ["SUMO_EVAL_PORT"]), None, *others, **options)
    _set_order(self, ORDER)
    _made_before.append(port)


def _ordered(self: Any, order: int) -> None:
    """An order that the script sets itself: the connection has the one that is left for it."""


def _quietly(
    kind: type[BaseException], error: BaseException, trace: Any, _usual: Any = sys.excepthook
) -> None:
    """SUMO closes the connection when the case is over, which a script need not expect."""
    if issubclass(kind, main.FatalTraCIError) and "closed by SUMO" in str(error):
        _say("the case is over")
    else:
        _usual(kind, error, trace)


connection.Connection.__init__, connection.Connection.setOrder = _made, _ordered
sys.excepthook = _quietly
real.start = main.start = start  # type: ignore[attr-defined]
sys.modules["libsumo"] = real
