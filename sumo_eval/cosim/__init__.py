"""Co-simulation: libsumo steps every vehicle, the ADS moves the ego, contact and limits are the
harness's own.

The names that users' code imports from here are looked up at first use: what only reads a
recording, or writes one for another simulator, does not wait for SUMO to load.
"""

from typing import TYPE_CHECKING

from sumo_eval.first_use import first_use

if TYPE_CHECKING:
    from sumo_eval.cosim.doors.controller import Briefing, Controller
    from sumo_eval.cosim.simulation import simulate, simulate_many
    from sumo_eval.cosim.vehicle_model import Command

__all__ = ["Briefing", "Command", "Controller", "simulate", "simulate_many"]

_HOMES = {
    "Briefing": "sumo_eval.cosim.doors.controller",
    "Command": "sumo_eval.cosim.vehicle_model",
    "Controller": "sumo_eval.cosim.doors.controller",
    "simulate": "sumo_eval.cosim.simulation",
    "simulate_many": "sumo_eval.cosim.simulation",
}

__getattr__ = first_use("sumo_eval.cosim", _HOMES)
