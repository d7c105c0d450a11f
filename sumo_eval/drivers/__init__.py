"""The human reference: a population of skilled synthetic drivers, and each of them at the wheel."""

from sumo_eval.drivers.synthetic.driver import SyntheticDriver, human_controller, synthetic_reference
from sumo_eval.drivers.synthetic.population import Driver, draw_driver, draw_population

__all__ = ["Driver", "SyntheticDriver", "draw_driver", "draw_population", "human_controller", "synthetic_reference"]
