"""The human reference: a population of skilled synthetic drivers, and each of them at the wheel."""

from sumo_eval.drivers.population import Driver, draw_driver, draw_population
from sumo_eval.drivers.synthetic import SyntheticDriver, human_controller, synthetic_reference

__all__ = ["Driver", "SyntheticDriver", "draw_driver", "draw_population", "human_controller", "synthetic_reference"]
