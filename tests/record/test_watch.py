"""The watch over an ADS changes nothing but how long it may take."""

import signal
import time as clock

import pytest
from road_scenes import at_values

from sumo_eval.cosim import Command, simulate
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.record.watch import watched
from sumo_eval.settings import RunSettings, SimulationSettings

BRIEF = SimulationSettings(step=0.1, end_when_decided=True, time_limit=30.0)
CUT_IN = at_values("cut_in", ego_speed=20.0, cut_in_speed=17.5, gap=80.0, lateral_speed=3.0)


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


@pytest.mark.parametrize(
    "engine, words", [("serial", "^my own$"), ("processes", "MB of `run.memory_limit`")]
)
def test_a_limit_of_memory_is_named_only_where_it_holds(engine, words):
    class Filling:
        def act(self, seen):
            raise MemoryError("my own")

    ads = watched(load_controller(Filling), RunSettings(engine=engine))
    with pytest.raises(MemoryError, match=words):
        ads.act(None)


needs_alarm = pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="this system has no such alarm"
)


@needs_alarm
def test_an_alarm_that_an_ads_leaves_behind_does_not_ring_in_the_harness():
    class Ringing:
        def step(self, traci, ego, time):
            signal.signal(signal.SIGALRM, self.ring)
            signal.setitimer(signal.ITIMER_REAL, 0.5)
            return Command(0.0)

        def ring(self, number, frame):
            raise ValueError("too late")

    watched(load_controller(Ringing), RunSettings()).step(None, "ego", 0.0)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@needs_alarm
def test_after_its_last_step_no_alarm_is_set():
    simulate(CUT_IN, watched(load_controller(Stepping), RunSettings()), BRIEF)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@needs_alarm
def test_every_step_has_its_whole_time_and_one_that_hangs_is_interrupted():
    class HangsLate:
        def step(self, traci, ego, time):
            # four steps together take longer than one may
            clock.sleep(0.06 if time < 0.35 else 60.0)
            return Command(0.0)

    limits = RunSettings(step_timeout=0.2)
    found = simulate(CUT_IN, watched(load_controller(HangsLate), limits), BRIEF, step_timeout=0.2)
    assert found.error == "The ADS must answer within 0.2 s, took longer at 0.40 s."
    assert found.end_reason == "ads_timeout"
