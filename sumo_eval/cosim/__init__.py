"""Co-simulation: libsumo steps every vehicle, the ADS moves the ego, contact and limits are the harness's own."""

from sumo_eval.cosim.controller import Briefing, Command, Controller
from sumo_eval.cosim.simulate import simulate

__all__ = ["Briefing", "Command", "Controller", "simulate"]
