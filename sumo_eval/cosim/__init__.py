"""Co-simulation of an ADS and SUMO: the ADS moves the ego, libsumo steps every vehicle, and this
package finds contact and applies the vehicle's limits.

`first_use` imports the names below when users' code first uses them: code that only reads a
recording, or writes one for another simulator, does not load SUMO.
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
