"""Populations of synthetic drivers, and what they do in a concrete scenario."""

from sumo_eval.cosim import simulate
from sumo_eval.drivers.synthetic.driver import SyntheticDriver
from sumo_eval.drivers.synthetic.population import AS_RECORDED, draw_driver


def draw_population(count, seed, settings=AS_RECORDED):
    """The first `count` drivers of the population `seed`."""
    return tuple(draw_driver(index, seed, settings) for index in range(count))


def synthetic_reference(concrete, drivers, seed):
    """What each driver does in a concrete scenario."""
    return [simulate(concrete, SyntheticDriver(driver, concrete, seed)) for driver in drivers]
