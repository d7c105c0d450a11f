"""A pack gives every case exactly what it would have had alone."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cosim_cases import case, lead

from sumo_eval import Command
from sumo_eval.ads.known_answers import IdealBraking, no_reaction
from sumo_eval.ads.perception import Sensor
from sumo_eval.ads.r157_careful_driver import CarefulDriver, CarefulDriverWithAeb
from sumo_eval.batch.cases import Case, Setup
from sumo_eval.batch.worker import run_case
from sumo_eval.cosim import packed as packing
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.packed import PackedCommand
from sumo_eval.cosim.packed_files import packed_network_xml, packed_routes_xml
from sumo_eval.cosim.session import packed_session
from sumo_eval.errors import InputError
from sumo_eval.scenario import Actor, Brake, ConstantLateral, LaneChange, Start, catalogue
from sumo_eval.scenario.sampling import sample
from sumo_eval.settings import RunSettings, SimulationSettings
from sumo_eval.trajectory import CHANNELS, Recording

DECIDED = SimulationSettings(end_when_decided=True)


def everything(recording: Recording) -> tuple[object, ...]:
    """All of a recording that is no wall time, to the last bit."""
    vehicles = {"ego": recording.ego, **recording.actors}
    channels = {name: [getattr(it, channel).tobytes() for channel in CHANNELS] for name, it in vehicles.items()}
    outcome = repr((recording.end_reason, recording.error, recording.collision, recording.clips))
    return outcome, channels, [(it.length, it.width) for it in vehicles.values()]


def points(name: str, every: int):
    logical = catalogue.load(name)
    return list(logical.concretes(sample(logical).points[::every]))


@pytest.fixture
def alone(monkeypatch):
    """Counts the cases that left the packs."""
    seen: list[object] = []

    def counted(concrete, *args, **kwargs):
        seen.append(concrete)
        return simulate(concrete, *args, **kwargs)

    monkeypatch.setattr(packing, "simulate", counted)
    return seen


@pytest.mark.parametrize("settings", [SimulationSettings(), replace(DECIDED, step=0.1)], ids=["whole", "decided"])
@pytest.mark.parametrize(
    ("scenario", "every"), [("cut_in", 191), ("r157_cut_out", 101), ("front_vehicle_braking", 67), ("ncap_ccrb", 11)]
)
@pytest.mark.parametrize("ads", ["careful_driver", "no_reaction", "ideal_braking"])
def test_packed_recordings_are_the_unpacked_ones_bit_for_bit(ads, scenario, every, settings, alone):
    cases = points(scenario, every)
    together = [everything(recording) for recording in simulate_many(cases, ads, settings)]
    assert not alone
    assert together == [everything(simulate(concrete, ads, settings)) for concrete in cases]


def test_the_outcome_of_a_decided_case_is_the_one_of_the_whole_case():
    cases = points("cut_in", 53)
    for whole, decided in zip(
        simulate_many(cases, "careful_driver"), simulate_many(cases, "careful_driver", DECIDED), strict=True
    ):
        assert repr(whole.collision) == repr(decided.collision)
        n = len(decided.ego) - 1
        assert whole.ego.x[:n].tobytes() == decided.ego.x[:n].tobytes()
        if decided.end_reason == "decided":
            assert whole.end_reason in ("time_limit", "road_end")


@pytest.mark.parametrize("ads", ["careful_driver", "idm"])
def test_a_case_of_a_run_ends_when_its_ads_says_that_it_is_settled(ads):
    """Under the watch of the batch, too; an ADS that says nothing drives to the end."""
    passed = catalogue.load("cut_in").concrete(ego_speed=20.0, cut_in_speed=12.5, gap=60.0, lateral_speed=0.9)
    run = Setup(DECIDED, RunSettings(), Path())
    recording = run_case(Case(0, passed, "ads", "mine", ads), run).recording
    assert recording is not None
    assert recording.end_reason == ("decided" if ads == "careful_driver" else "time_limit")


def test_recordings_come_in_the_order_of_the_cases_whatever_the_pack(monkeypatch):
    monkeypatch.setattr(packing, "PACK", 3)
    monkeypatch.setattr(packing, "SORTED_AT_ONCE", 5)
    cases = points("cut_in", 131)
    starts = [recording.ego.speed[0] for recording in simulate_many(cases, CarefulDriver, DECIDED)]
    assert starts == [concrete.ego.speed for concrete in cases]
    assert len(set(starts)) > 3


class Gives:
    """Keeps its speed; in the cases with the given ego speed it answers `answer`."""

    def __init__(self, answer: float, at: float) -> None:
        self.answer, self.at = answer, at

    def step(self, traci, ego, time):
        return None

    def packed(self, scenario):
        return self

    def settled(self):
        return np.zeros(self.cases, dtype=bool)


class PackedGives(Gives):
    def step(self, scene, time):
        self.cases = len(scene.x)
        return PackedCommand(np.where((scene.along == self.at) & (time > 0.3), self.answer, 0.0), np.zeros(self.cases))

    def keep(self, rows):
        pass


class Scalar(Gives):
    def step(self, traci, ego, time):
        return Command(self.answer if traci.vehicle.getSpeed(ego) == self.at and time > 0.3 else 0.0)

    def packed(self, scenario):
        return PackedGives(self.answer, self.at)


SHORT = SimulationSettings(time_limit=1.0)


def test_a_faulty_case_costs_only_itself(alone):
    cases = [case(lead(50.0, speed=speed), speed=speed) for speed in (10.0, 15.0, 20.0)]
    faulty = Scalar(float("nan"), 15.0)
    first, second, third = simulate_many(cases, faulty, SHORT)
    assert alone == [cases[1]]
    assert second.end_reason == "ads_error"
    assert "must be a finite number, got nan" in (second.error or "")
    assert [everything(one) for one in (first, third)] == [
        everything(simulate(concrete, faulty, SHORT)) for concrete in (cases[0], cases[2])
    ]


@pytest.mark.parametrize("answer", [3.0, -50.0, 50.0, -4.0], ids=["drives", "beyond brakes", "beyond drive", "brakes"])
def test_what_the_vehicle_cannot_do_is_clipped_and_counted_as_alone(answer, alone):
    cases = [case(lead(50.0, speed=speed), speed=speed) for speed in (10.0, 15.0)]
    ads = Scalar(answer, 15.0)
    together = [everything(recording) for recording in simulate_many(cases, ads, SHORT)]
    assert together == [everything(simulate(concrete, ads, SHORT)) for concrete in cases]
    assert not alone


class Breaks(Scalar):
    def packed(self, scenario):
        class Broken:
            def step(self, scene, time):
                raise RuntimeError("out of order")

        return Broken()


def test_a_packed_form_that_raises_costs_no_case_and_is_logged(alone, caplog):
    cases = [case(lead(50.0, speed=speed), speed=speed) for speed in (10.0, 15.0)]
    recordings = list(simulate_many(cases, Breaks(0.0, 0.0), SHORT))
    assert [recording.end_reason for recording in recordings] == ["time_limit"] * 2
    assert alone == cases
    assert "A pack of 2 cases failed" in caplog.text
    assert "out of order" in caplog.text


def test_what_cannot_be_packed_is_simulated_alone_and_counted(alone):
    why: Counter[str] = Counter()
    steering = points("cut_in", 997)
    assert list(simulate_many(steering, CarefulDriverWithAeb, SHORT, alone=why))  # it has no packed form
    nobody = [case(speed=20.0)]
    assert list(simulate_many(nobody, "no_reaction", SHORT, alone=why))
    assert alone == [*steering, *nobody]
    assert sorted(why.values()) == [1, len(steering)]


class Sways:
    """Steers a sine, brakes behind what is near and else drives on; every bit of what it sees is in what it does."""

    def __init__(self, amplitude: float, rate: float, brakes: float, drives: float, turns_off: float = 0.0) -> None:
        self.habits = amplitude, rate, brakes, drives, turns_off

    def reset(self, scenario, traci, ego):
        self.sensor = Sensor()

    def step(self, traci, ego, time):
        amplitude, rate, brakes, drives, turns_off = self.habits
        me, others = self.sensor.look(traci, ego)
        wanted = drives + 1e-3 * (me.x + me.y + me.half_length + me.half_width + me.across)
        for other in sorted(others, key=lambda other: other.name):
            if other.x > me.x and other.x - me.x < 3.0 * (me.along - other.along) + 8.0:
                wanted = -brakes
            wanted += 1e-3 * (other.y + other.heading + other.across + other.half_length + other.half_width)
        steering = amplitude * math.sin(rate * time) - 0.8 * me.heading - 0.05 * me.y + turns_off
        return Command(wanted, steering)

    @classmethod
    def together(cls, controllers, briefing):
        return PackedSways(controllers)


class PackedSways:
    def __init__(self, controllers) -> None:
        self.habits = np.array([controller.habits for controller in controllers]).T

    def step(self, scene, time):
        amplitude, rate, brakes, drives, turns_off = self.habits
        wanted = drives + 1e-3 * (scene.x + scene.y + scene.half_length + scene.half_width + scene.across)
        for j in range(scene.other_x.shape[1]):
            x, along = scene.other_x[:, j], scene.other_along[:, j]
            near = (x > scene.x) & (x - scene.x < 3.0 * (scene.along - along) + 8.0)
            wanted = np.where(near, -brakes, wanted)
            wanted = wanted + 1e-3 * (
                scene.other_y[:, j]
                + scene.other_heading[:, j]
                + scene.other_across[:, j]
                + scene.other_half_length[:, j]
                + scene.other_half_width[:, j]
            )
        sway = np.array([math.sin(value) for value in (rate * time).tolist()])
        return PackedCommand(wanted, amplitude * sway - 0.8 * scene.heading - 0.05 * scene.y + turns_off)

    def settled(self):
        return np.ones(self.habits.shape[1], dtype=bool)

    def keep(self, rows):
        self.habits = self.habits[:, rows]


SWAYS = [
    Sways(0.05, 1.3, 4.0, 0.2),
    Sways(0.3, 0.7, 9.0, 0.0),
    Sways(0.02, 2.0, 2.0, -1.5),  # comes to a standstill
    Sways(0.1, 0.9, 0.0, 0.5),  # runs into what is ahead
    Sways(0.1, 0.9, 6.0, 0.5, 0.6),  # leaves the road to the left
    Sways(3.0, 5.0, 9.0, 4.5),  # more than wheel, tyres and drive can do
    Sways(0.0, 1.0, 3.0, -9.0),
]


@pytest.mark.parametrize(
    ("scenario", "every"),
    [
        ("front_vehicle_cut_out", 31), ("front_vehicle_low_speed", 5), ("cut_in", 331), ("front_vehicle_braking", 41),
        ("r157_cut_out", 151), ("ncap_ccrb", 9), ("ncap_ccrs", 5), ("ncap_ccrm", 5),
    ],
)  # fmt: skip
def test_egos_that_steer_and_vehicles_that_turn_are_recorded_as_alone_bit_for_bit(scenario, every, alone):
    cases = [concrete for concrete in points(scenario, every) for _ in SWAYS]
    drivers = [driver for _ in points(scenario, every) for driver in SWAYS]
    together = list(simulate_many(cases, drivers))
    assert not alone
    reasons = set()
    for concrete, driver, recording in zip(cases, drivers, together, strict=True):
        assert everything(recording) == everything(simulate(concrete, driver))
        reasons.add(recording.end_reason)
    assert reasons >= {"contact", "off_road", "standstill"}


def scripted(*moves, brake=None, slides=False, y=0.0, speed=14.0):
    """A vehicle 40 m ahead, and one in its way that nobody moves."""
    ahead = Actor("ahead", Start(90.0, y, speed), moves, brake=brake, slides=slides)
    return case(ahead, Actor("beyond", Start(150.0, 3.5, 12.0)), speed=15.0)


SCRIPTS = {
    "half a lane": scripted(LaneChange(0.5, 3.0, 1.75)),
    "a little to the right": scripted(LaneChange(0.3, 2.0, -0.7)),
    "off the road": scripted(LaneChange(0.5, 2.0, -4.5)),
    "over the left edge": scripted(LaneChange(0.5, 3.0, 5.6)),
    "there and back": scripted(LaneChange(0.5, 3.0, 3.5), LaneChange(4.0, 2.5, -3.5)),
    "two at once": scripted(LaneChange(0.5, 3.0, 2.1), LaneChange(1.5, 2.5, 1.4)),
    "at constant lateral speed": scripted(ConstantLateral(0.33, 1.1, 3.5)),
    "braking": scripted(brake=Brake(0.4, 6.0, 20.0)),
    "braking as it changes lane": scripted(LaneChange(0.5, 1.5, 3.5), brake=Brake(1.0, 4.0)),
    "sliding twice": scripted(ConstantLateral(0.2, 1.0, 2.0), ConstantLateral(3.05, 0.7, -1.0), slides=True),
    "sliding as it brakes": scripted(ConstantLateral(0.2, 2.0, 3.5), brake=Brake(1.0, 3.0), slides=True),
    "sliding off the road": scripted(ConstantLateral(0.2, 2.0, -3.0), slides=True),
    "sliding half a lane": scripted(ConstantLateral(0.2, 2.0, 1.75), slides=True),
    "off the centre": scripted(LaneChange(0.5, 3.0, 2.0), y=0.6),
    "standing": scripted(speed=0.0),
    "from the left": scripted(LaneChange(1.0, 2.5, -3.5), y=3.5),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_what_the_other_vehicles_do_is_the_same_in_a_pack_whatever_their_script(name):
    settings = SimulationSettings(time_limit=9.0)
    cases = [SCRIPTS[name]] * len(SWAYS)
    why: Counter[str] = Counter()
    for driver, recording in zip(SWAYS, simulate_many(cases, SWAYS, settings, alone=why), strict=True):
        assert everything(recording) == everything(simulate(SCRIPTS[name], driver, settings))
    if "road" not in name and "edge" not in name:  # SUMO shows another speed of who is beside every lane
        assert not why


def test_controllers_that_are_too_few_for_the_cases_are_refused():
    with pytest.raises(InputError, match="one for each of the 2 cases"):
        list(simulate_many([SCRIPTS["standing"]] * 2, [SWAYS[0]]))


def test_vehicles_of_different_roads_of_a_pack_do_not_see_each_other():
    follower, leader = case(speed=20.0), case(speed=5.0, x=70.0)
    texts = packed_network_xml(follower.road, 2), packed_routes_xml([follower, leader], SHORT.vehicle)
    with packed_session(*texts, SHORT) as traci:
        assert traci.vehicle.getPosition("1.0")[0] > traci.vehicle.getPosition("0.0")[0]
        assert not (traci.vehicle.getLeader("0.0", 200.0) or ("",))[0]


def test_known_answers_have_packed_forms():
    assert no_reaction.packed
    assert IdealBraking().packed
