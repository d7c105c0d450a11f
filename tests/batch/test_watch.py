"""The watch over an ADS changes nothing but how long it may take."""

import pytest

from sumo_eval.batch.watch import watched
from sumo_eval.cosim import Command, simulate
from sumo_eval.cosim.controller import load_controller
from sumo_eval.scenario import catalogue
from sumo_eval.settings import RunSettings, SimulationSettings

BRIEF = SimulationSettings(step=0.1, end_when_decided=True, time_limit=30.0)
CUT_IN = catalogue.load("cut_in").concrete(ego_speed=20.0, cut_in_speed=17.5, gap=80.0, lateral_speed=3.0)


class Stepping:
    def step(self, traci, ego, time):
        return Command(-1.0 if time < 6.0 else 0.0)

    def settled(self):
        return True


class Acting:
    def act(self, seen):
        return -1.0 if seen.time < 6.0 else 0.0

    def settled(self):
        return True


@pytest.mark.parametrize("ads", [Stepping, Acting, "careful_driver", "sumo:IDM"])
def test_under_the_watch_an_ads_drives_and_ends_as_without(ads):
    alone = simulate(CUT_IN, ads, BRIEF)
    under_watch = simulate(CUT_IN, watched(load_controller(ads), RunSettings()), BRIEF)
    assert under_watch.end_reason == alone.end_reason
    assert alone.end_reason == "decided" or ads not in (Stepping, Acting)
    assert under_watch.ego.x.tobytes() == alone.ego.x.tobytes()
