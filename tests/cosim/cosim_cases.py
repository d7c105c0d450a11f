"""Concrete scenarios that the tests of the co-simulation share."""

from sumo_eval.scenario import Actor, ConcreteScenario, Road, Start, catalogue
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import SimulationSettings

ROAD = Road(name="test_road", length=600.0, lanes=2, lane_width=3.5, run_out=5400.0)
HALF_SECOND = SimulationSettings(time_limit=0.5)


def case(*actors, speed=20.0, x=50.0, y=0.0):
    """The ego at x m and `speed` m/s, and the given others."""
    return ConcreteScenario("test", {}, 1.0, ROAD, Start(x, y, speed), actors)


def lead(gap, speed=0.0, y=0.0, x=50.0):
    """A vehicle `gap` m (bumper to bumper) ahead of an ego at x."""
    return Actor("lead", Start(x + 4.5 + gap, y, speed))


def points(name, every):
    logical = catalogue.load(name)
    return list(logical.concretes(sample(logical).points[::every]))


def once(action):
    """An ADS that does something at 0.3 s, and otherwise nothing."""
    return lambda traci, ego, time: action(traci) if abs(time - 0.3) < 1e-9 else None


def assert_whole(found):
    """It was driven until the time was up, without an error."""
    assert (found.end_reason, found.error) == ("time_limit", None)
