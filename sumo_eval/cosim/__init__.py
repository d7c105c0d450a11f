"""Co-simulation: libsumo steps every vehicle, the ADS moves the ego, contact and limits are the harness's own."""

from sumo_eval.cosim.doors.controller import Briefing, Controller
from sumo_eval.cosim.simulate import simulate, simulate_many
from sumo_eval.cosim.vehicle_model import Command

__all__ = ["Briefing", "Command", "Controller", "simulate", "simulate_many"]
