"""Cases that are driven together have exactly what they have alone."""

import importlib
import itertools
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refusals import refusal
from road_scenes import (
    DECIDED,
    ROAD,
    assert_as_alone,
    assert_ended,
    assert_last,
    at_values,
    case,
    lead,
    points,
)
from tables import in_campaign, values_of

from sumo_eval import Command
from sumo_eval.ads.r157_careful_driver import CarefulDriver
from sumo_eval.cosim.simulation import NOT_TOGETHER, ON_TRACI, ONE_OBJECT, simulate, simulate_many
from sumo_eval.cosim.sumo.session import running
from sumo_eval.cosim.sumo.shared_files import shared_network_xml, shared_routes_xml
from sumo_eval.record.cases import Case, Setup
from sumo_eval.record.worker import run_case
from sumo_eval.scenario import Actor, Start, brake_to_stop, catalogue, constant_lateral, lane_change
from sumo_eval.scenario.road.reference_line import arc
from sumo_eval.scenario.sampling.samples import Request, sample
from sumo_eval.settings import ConditionSettings, RunSettings, SimulationSettings
from sumo_eval.trajectory import Alone, Recording

simulating = importlib.import_module("sumo_eval.cosim.simulation")


def behind(*speeds):
    """A case for each speed, m/s, 50 m behind a lead of that speed."""
    return [case(lead(50.0, speed=speed), speed=speed) for speed in speeds]


@pytest.fixture
def alone(monkeypatch):
    """Counts the cases that left the packs."""
    seen = []

    def counted(concrete, *args, **kwargs):
        seen.append(concrete)
        return simulate(concrete, *args, **kwargs)

    monkeypatch.setattr(simulating, "simulate", counted)
    return seen


class EasyBraking:
    """Keeps 1.5 s to the lead, under whatever conditions it sees it."""

    def act(self, observation):
        lead = observation.lead
        return 0.0 if lead is None or lead.gap > 1.5 * observation.ego.speed else -6.0


ALL_CHANGES = {
    "conditions.perception_delay": (0.1, 0.8), "conditions.sensor_range": (30.0, 60.0),
    "conditions.dropout": (0.1, 0.5), "conditions.position_noise": (0.2, 1.0),
    "conditions.speed_noise": (0.2, 1.0), "conditions.field_of_view_deg": (20.0, 90.0),
    "conditions.actuation_delay": (0.05, 0.4), "vehicle.max_deceleration": (3.0, 7.0),
    "vehicle.friction": (0.2, 0.6),
}  # fmt: skip


def changed(cases, rng):
    """The cases with one to three changes each; every fourth has none."""
    for i, concrete in enumerate(cases):
        names = rng.choice(list(ALL_CHANGES), (i % 4), replace=False)
        yield replace(
            concrete, changes=tuple((str(it), rng.uniform(*ALL_CHANGES[it])) for it in names)
        )


@pytest.mark.parametrize(
    "share, scenarios",
    [
        in_campaign(1, ["cut_in", "r157_cut_out", "front_vehicle_braking", "curve_cut_in",
            "stop_and_go_stream"], id="whole"),
        pytest.param(6, ["cut_in"], id="some"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("ads", ["careful_driver", "idm", EasyBraking])
def test_packed_cases_with_own_changes_are_as_alone(ads, scenarios, share, alone):
    """Delay, range, dropout, noise, actuation, brakes and friction mixed by row: 42 drives of
    each scenario and ADS, or more."""
    rng = np.random.default_rng(7)
    driven = different = 0
    for name in scenarios:
        logical = catalogue.load(name)
        request = Request(count=72 // share, seed=1)
        drawn = logical.concretes(sample(logical, "latin_hypercube", request=request).points)
        cases = list(changed(drawn, rng))
        together = list(simulate_many(cases, ads, DECIDED))
        assert not alone
        assert_as_alone(cases, together, ads, DECIDED)
        usual = simulate_many([replace(it, changes=()) for it in cases], ads, DECIDED)
        different += sum(not one.same_drive(two) for one, two in zip(together, usual, strict=True))
        driven += len(cases)
    assert driven >= len(scenarios) * 42 // share
    assert different > 0.2 * driven


def test_conditions_of_the_run_leave_cases_together(alone):
    """A change of every case is the same condition of the run, to the bit."""
    conditions = ConditionSettings(perception_delay=0.5, actuation_delay=0.2)
    cases = points("cut_in", 401)
    own = (("conditions.perception_delay", 0.5), ("conditions.actuation_delay", 0.2))
    changed = [replace(concrete, changes=own) for concrete in cases]
    run = simulate_many(cases, EasyBraking, replace(DECIDED, conditions=conditions))
    assert all(map(Recording.same_drive, run, simulate_many(changed, EasyBraking, DECIDED)))
    assert not alone


def test_changes_of_the_world_hold_for_references_too():
    (concrete,) = points("cut_in", 10**9)
    both = (("conditions.dropout", 0.5), ("vehicle.friction", 0.3))
    concrete = replace(concrete, changes=both)
    assert concrete.without_ads.changes == (("vehicle.friction", 0.3),)
    with refusal(r"conditions\.delay"):
        replace(concrete, changes=(("conditions.delay", 0.5),))


def test_the_outcome_of_a_decided_case_is_the_one_of_the_whole_case():
    cases = points("cut_in", 53)
    for whole, decided in zip(
        simulate_many(cases, "careful_driver"),
        simulate_many(cases, "careful_driver", DECIDED),
        strict=True,
    ):
        assert repr(whole.collision) == repr(decided.collision)
        n = len(decided.ego) - 1
        assert whole.ego.x[:n].tobytes() == decided.ego.x[:n].tobytes()
        if decided.end_reason == "decided":
            assert whole.end_reason in ("time_limit", "road_end")


@pytest.mark.parametrize("ads", ["careful_driver", "idm"])
def test_a_case_of_a_run_ends_when_its_ads_says_that_it_is_settled(ads):
    """Under the watch of the batch, too; an ADS that says nothing drives to the end."""
    passed = at_values("cut_in", ego_speed=20.0, cut_in_speed=12.5, gap=60.0, lateral_speed=0.9)
    run = Setup(DECIDED, RunSettings(), Path())
    recording = run_case(Case(0, passed, "ads", "mine", ads), run).recording
    assert recording.end_reason == ("decided" if ads == "careful_driver" else "time_limit")


class SettledOverArrays:
    """Keeps its speed and says which of its rows have settled: those slower than a speed."""

    batch = True

    def __init__(self, below=99.0, rows=0):
        self.below, self.rows = below, rows

    def act(self, seen):
        self.seen = seen
        return np.zeros(len(seen.ego.speed))

    def settled(self):
        return (self.seen.ego.speed < self.below)[self.rows :]


def test_a_policy_over_arrays_says_of_each_of_its_rows_whether_it_is_settled():
    cases = [case(lead(50.0, speed=25.0), speed=speed) for speed in (20.0, 24.0)]
    ends = [one.end_reason for one in simulate_many(cases, SettledOverArrays(22.0), DECIDED)]
    assert ends[0] == "decided"
    assert ends[1] != "decided"
    wrong = [one.error for one in simulate_many(cases, SettledOverArrays(rows=1), DECIDED)]
    assert all(
        "`settled()` of the ADS must give the shape (2,), got (1,)" in error for error in wrong
    )


class Unsettled:
    """Fails where it is asked whether it has settled."""

    def settled(self):
        raise ValueError("not yet")


class UnsettledPolicy(Unsettled):
    def act(self, seen):
        return 0.0


class UnsettledHook(Unsettled):
    def step(self, traci, ego, time):
        return Command(0.0)


@pytest.mark.parametrize("ads", [UnsettledPolicy, UnsettledHook])
def test_an_ads_that_raises_in_settled_ends_its_case(ads):
    recordings = [simulate(case(), ads, DECIDED), *simulate_many([case()] * 2, ads, DECIDED)]
    for recording in recordings:
        assert recording.end_reason == "ads_error"
        assert recording.error == "The ADS raised at 0.00 s: ValueError: not yet."


def test_recordings_have_the_order_of_the_cases_in_any_batch(monkeypatch):
    monkeypatch.setattr(simulating, "TOGETHER", 3)
    monkeypatch.setattr(simulating, "SORTED_AT_ONCE", 5)
    cases = points("cut_in", 131)
    starts = [recording.ego.speed[0] for recording in simulate_many(cases, CarefulDriver, DECIDED)]
    assert starts == [concrete.ego.speed for concrete in cases]
    assert len(set(starts)) > 3


class Gives:
    """Keeps its speed; in the cases with the given ego speed it answers `answer`."""

    def __init__(self, answer, at):
        self.answer, self.at = answer, at

    def act(self, seen):
        return self.answer if seen.ego.speed == self.at and seen.time > 0.3 else 0.0


SHORT = SimulationSettings(time_limit=1.0)


def test_a_faulty_case_costs_only_itself(alone):
    cases = behind(10.0, 15.0, 20.0)
    first, second, third = simulate_many(cases, [Gives(float("nan"), 15.0) for _ in cases], SHORT)
    assert not alone
    assert_ended(second, "ads_error", "must be a finite number, got nan")
    assert_last(second, time=0.3)  # 6 * 0.05 is a little more than 0.3
    assert_as_alone(cases, (first, second, third), Gives(float("nan"), 15.0), SHORT)


class Raises(Gives):
    def act(self, seen):
        if seen.ego.speed == self.at:
            raise RuntimeError("out of order")
        return 0.0


def test_a_policy_that_raises_fails_its_row_with_its_traceback(alone):
    cases = behind(10.0, 15.0)
    first, second = simulate_many(cases, [Raises(0.0, 15.0) for _ in cases], SHORT)
    assert first.end_reason == "time_limit"
    assert second.end_reason == "ads_error"
    assert second.error == "The ADS raised at 0.00 s: RuntimeError: out of order."
    assert "RuntimeError: out of order" in second.log
    assert not alone


def test_every_case_has_a_policy_of_its_own_when_a_class_is_given():
    class Counts:
        def __init__(self):
            self.steps = 0

        def act(self, seen):
            self.steps += 1
            return -0.1 * self.steps

    cases = behind(10.0, 15.0)
    assert_as_alone(cases, simulate_many(cases, Counts, SHORT), Counts, SHORT)


class Called:
    """A policy that is an object to call; each call brakes more, from 0 at the reset."""

    def reset(self, scenario):
        self.calls = 0

    def __call__(self, seen):
        self.calls += 1
        return -0.1 * self.calls


def test_one_object_to_call_drives_its_cases_in_order():
    cases, why = behind(10.0, 15.0), Counter()
    together = list(simulate_many(cases, Called(), SHORT, alone=why))
    assert why == {ONE_OBJECT: 2}
    assert_as_alone(cases, together, Called, SHORT)


LAST = {}


class Forgets:
    """Its last gap is in a module's variable, cleared at each start: right only alone."""

    def reset(self, scenario):
        LAST.clear()

    def act(self, seen):
        gap = 100.0 if seen.lead is None else seen.lead.gap
        rate, LAST["gap"] = gap - LAST.get("gap", gap), gap
        return max(-6.0, min(1.0, 4.0 * rate + 0.05 * (gap - 2.0 * seen.ego.speed)))


class Remembers:
    """A cache of a pure function changes no drive."""

    def act(self, seen):
        return -LAST.setdefault(-1.0, 1.0)


class Counted:
    """Each object brakes by its number."""

    number = 0

    def __init__(self):
        Counted.number += 1
        self.own = Counted.number

    def act(self, seen):
        return -0.01 * self.own


def test_state_that_objects_change_as_they_are_made_is_named():
    why = Counter()
    list(simulate_many(points("cut_in", 301), Counted, DECIDED, alone=why))
    (reason,) = why
    assert reason.why == "keeps_state"
    assert str(reason).count("Counted") == 1


LATE = {"drives": 0, "speed": 0.0}


class Late:
    """From its hundredth drive on, it brakes by the speed that it saw last, in whichever case."""

    def reset(self, scenario):
        LATE["drives"] += 1

    def act(self, seen):
        last, LATE["speed"] = LATE["speed"], seen.ego.speed
        return -0.1 * last if LATE["drives"] > 100 else 0.0


def test_state_that_shows_after_the_first_batches_is_named():
    why = Counter()
    for _ in range(5):  # 21 cases each
        list(simulate_many(points("cut_in", 97), Late, SHORT, alone=why))
    assert [reason.why for reason in why] == ["keeps_state"]


@pytest.mark.parametrize("ads, number", [(Forgets, 7), (Remembers, 0)])
def test_a_policy_whose_shared_state_matters_drives_alone(ads, number):
    cases, why = points("cut_in", 301), Counter()
    together = list(simulate_many(cases, ads, DECIDED, alone=why))
    assert sum(why.values()) == number
    assert all("test_together.LAST" in str(it) for it in why)
    assert_as_alone(cases, together, ads, DECIDED)


def test_code_without_a_module_drives_together():
    """Code that a user's program has made by `exec`, with variables of its own."""
    made = {}
    exec("def policy(seen): return -1.0", made)
    exec("def hook(traci, ego, time): traci.vehicle.setSpeed(ego, 10.0)", made)
    for ads in (made["policy"], made["hook"]):
        cases, why = points("cut_in", 997), Counter()
        assert_as_alone(cases, simulate_many(cases, ads, SHORT, alone=why), ads, SHORT)
        assert not why


class AllAtOnce:
    """The ten lines of an ACC over arrays."""

    batch = True

    def act(self, seen):
        closing, room = -seen.lead.relative_speed, np.maximum(seen.lead.gap - 2.0, 0.1)
        return np.where(closing > 0.0, -np.minimum(closing * closing / (2.0 * room), 8.0), 0.0)


class OneByOne:
    """The same for one observation."""

    def act(self, seen):
        if seen.lead is None or seen.lead.relative_speed >= 0.0:
            return 0.0
        closing, room = -seen.lead.relative_speed, max(seen.lead.gap - 2.0, 0.1)
        return -min(closing * closing / (2.0 * room), 8.0)


@pytest.mark.parametrize("scenario", ["cut_in", "front_vehicle_cut_out", "curve_following"])
def test_a_policy_over_arrays_drives_as_one_over_single_observations(scenario, alone):
    cases = points(scenario, 97)
    batch, single = (
        simulate_many(cases, AllAtOnce, DECIDED),
        simulate_many(cases, OneByOne, DECIDED),
    )
    for one, other in zip(batch, single, strict=True):
        assert one.end_reason == other.end_reason
        assert one.ego.x == pytest.approx(other.ego.x, abs=1e-6)
    assert not alone


def test_law_each_policy_over_arrays_drives_its_own_case(alone):
    class Brakes(AllAtOnce):
        def act(self, seen):
            return np.full(len(seen.number), -3.0)

    cases, given = [case(lead(50.0))] * 3, [AllAtOnce(), Brakes(), OneByOne()]
    for one, ads in zip(simulate_many(cases, given, SHORT), given, strict=True):
        assert one.same_drive(simulate(cases[0], ads, SHORT))
    assert not alone


def test_a_policy_over_arrays_that_gives_too_few_actions_fails_all_cases_of_the_call():
    class TooFew(AllAtOnce):
        def act(self, seen):
            return np.zeros(1)

    cases = behind(10.0, 15.0)
    for recording in simulate_many(cases, TooFew, SHORT):
        assert recording.end_reason == "ads_error"
        assert recording.error == (
            "The actions of the ADS must have the shape (2,) or (2, 2), got (1,) at 0.00 s, in "
            "one call for 2 cases, "
            "which fails them all."
        )


@pytest.mark.parametrize("action", ["1.5", True, 1.0 + 1.0j])
def test_arrays_of_what_is_no_real_number_are_no_actions(action):
    class Gives:
        batch = True

        def act(self, seen):
            return np.full(len(seen.number), action)

    for recording in simulate_many(points("cut_in", 997), Gives, SHORT):
        assert recording.end_reason == "ads_error"
        assert "must be real numbers, got an array of" in recording.error


def test_a_fault_in_a_call_over_arrays_belongs_to_all_its_cases_and_a_bad_number_to_its_row():
    class Raises(AllAtOnce):
        def act(self, seen):
            if seen.time > 0.4:
                raise ValueError("no path found")
            return np.where(seen.ego.speed == 10.0, np.nan, 0.0)

    cases = behind(10.0, 15.0, 20.0)
    bad, *others = simulate_many(cases, Raises, SHORT)
    assert bad.error == (
        "`acceleration` of the ADS's Command must be a finite number, got nan at 0.00 s."
    )
    assert bad.end_reason == "ads_error"
    for recording in others:
        assert recording.end_reason == "ads_error"
        assert (
            "in one call for 2 cases, which fails them all: ValueError: no path found"
            in recording.error
        )
        assert "in act" in recording.error_place

    class FailsInReset(AllAtOnce):
        def reset(self, briefing):
            raise ValueError("no weights")

    for recording in simulate_many(cases, FailsInReset, SHORT):
        assert recording.error == (
            "The ADS raised in reset, in one call for 3 cases, which fails them all: ValueError: "
            "no weights."
        )


def test_what_cannot_be_driven_together_is_driven_alone_and_counted(alone):
    why = Counter()
    cut_ins = points("cut_in", 997)
    assert list(simulate_many(cut_ins, "sumo:IDM", SHORT, alone=why))
    nobody = [case(speed=20.0)]
    assert list(simulate_many(nobody, "no_reaction", SHORT, alone=why))
    assert list(simulate_many(nobody, Gives(0.0, 0.0), SHORT, alone=why))
    assert list(simulate_many(cut_ins, Apart, SHORT, alone=why))
    asked = Alone("asked", "batch = False")
    assert why == {ON_TRACI: len(cut_ins), NOT_TOGETHER: 1, ONE_OBJECT: 1, asked: len(cut_ins)}


class Apart:
    batch = False

    def step(self, traci, ego, time):
        return Command(-1.0)


class Subclass(CarefulDriver):
    def step(self, traci, ego, time):
        return Command(-1.0)


class ThroughTraci(CarefulDriver):
    def step(self, traci, ego, time):
        return super().step(traci, ego, time)


@pytest.mark.parametrize("line", [(), (arc(400.0, 500.0),)])
def test_law_a_baseline_in_traci_goes_on_when_one_has_left(line):
    road = replace(ROAD, length=300.0, run_out=0.0, line=line)
    short = replace(case(lead(150.0, speed=40.0)), road=road)
    for ads in (CarefulDriver, ThroughTraci):
        found = simulate(short, ads)
        assert_ended(found, "road_end")


class TakesOver(CarefulDriver):
    """SUMO drives first."""

    def step(self, traci, ego, time):
        return super().step(traci, ego, time) if time > 0.9 else None


def test_a_baseline_that_begins_later_keeps_the_lane_it_is_in():
    curve = replace(ROAD, line=(arc(400.0, 500.0),), run_out=0.0)
    settings = SimulationSettings(step=0.04, record_interval=0.08, time_limit=6.0)
    found = simulate(replace(case(y=3.5), road=curve), TakesOver, settings)
    assert_ended(found)
    assert found.ego.y == pytest.approx(3.5, abs=0.1)


def test_a_subclass_that_decides_otherwise_is_asked(alone):
    cases = behind(10.0, 15.0)
    assert [
        found.ego.speed[-1] < found.ego.speed[0] - 0.5
        for found in simulate_many(cases, Subclass, SHORT)
    ] == [True] * 2
    assert len(alone) == len(cases)  # driven both ways and compared


def test_a_subclass_that_decides_otherwise_is_not_settled():
    """The rule that it derives from has not been asked."""
    found = simulate(case(lead(300.0)), Subclass, DECIDED)
    assert_ended(found, "standstill")


class Sways:
    """Steers a sine, brakes behind what is near and else drives on; every bit of what it sees is in
    what it does."""

    def __init__(self, amplitude, rate, brakes, drives, turns_off=0.0):
        self.habits = amplitude, rate, brakes, drives, turns_off

    def act(self, seen):
        amplitude, rate, brakes, drives, turns_off = self.habits
        me = seen.ego
        wanted = drives + 1e-3 * (me.x + me.y + me.acceleration)
        for other in seen.vehicles:
            if other.ahead and other.gap < -3.0 * other.relative_speed + 4.0:
                wanted = -brakes
            wanted += 1e-3 * (other.offset + other.lateral_speed + other.gap)
        return wanted, amplitude * math.sin(
            rate * seen.time
        ) - 0.8 * me.heading - 0.05 * me.y + turns_off


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
    "scenario, every",
    [
        ("front_vehicle_cut_out", 31),
        *(
            in_campaign(name, every)
            for name, every in values_of("""
    "front_vehicle_low_speed", 5
    "cut_in", 331
    "r157_cut_out", 151
    "ncap_ccrb", 9
    "ncap_ccrs", 5
    "front_vehicle_braking", 41
    "ncap_ccrm", 5
    """)
        ),
    ],
)  # fmt: skip
def test_egos_that_steer_and_vehicles_that_turn_are_recorded_as_alone_bit_for_bit(
    scenario, every, alone
):
    cases = [concrete for concrete in points(scenario, every) for _ in SWAYS]
    drivers = [driver for _ in points(scenario, every) for driver in SWAYS]
    together = list(simulate_many(cases, drivers))
    assert not alone
    reasons = set()
    for number, (concrete, driver, recording) in enumerate(
        zip(cases, drivers, together, strict=True)
    ):
        if number % 3 == 0:
            assert recording.same_drive(simulate(concrete, driver))
        reasons.add(recording.end_reason)
    assert reasons >= {"contact", "off_road", "standstill"}


def scripted(*moves, slides=False, y=0.0, speed=14.0):
    """A vehicle 40 m ahead, and one in its way that nobody moves."""
    ahead = Actor("ahead", Start(90.0, y, speed), moves, slides=slides)
    return case(ahead, Actor("beyond", Start(150.0, 3.5, 12.0)), speed=15.0)


SCRIPTS = [
    scripted(lane_change(0.5, 3.0, 1.75)),
    scripted(lane_change(0.3, 2.0, -0.7)),
    scripted(lane_change(0.5, 2.0, -4.5)),
    scripted(lane_change(0.5, 3.0, 5.6)),
    scripted(lane_change(0.5, 3.0, 3.5), lane_change(4.0, 2.5, -3.5)),
    scripted(lane_change(0.5, 3.0, 2.1), lane_change(1.5, 2.5, 1.4)),
    scripted(constant_lateral(0.33, 1.1, 3.5)),
    scripted(brake_to_stop(0.4, 6.0, 20.0)),
    scripted(lane_change(0.5, 1.5, 3.5), brake_to_stop(1.0, 4.0)),
    scripted(constant_lateral(0.2, 1.0, 2.0), constant_lateral(3.05, 0.7, -1.0), slides=True),
    scripted(constant_lateral(0.2, 2.0, 3.5), brake_to_stop(1.0, 3.0), slides=True),
    scripted(constant_lateral(0.2, 2.0, -3.0), slides=True),
    scripted(constant_lateral(0.2, 2.0, 1.75), slides=True),
    scripted(lane_change(0.5, 3.0, 2.0), y=0.6),
    scripted(speed=0.0),
    scripted(lane_change(1.0, 2.5, -3.5), y=3.5),
]


def test_other_vehicles_move_the_same_in_a_batch():
    """All scripts in one batch: none is another row's."""
    settings, why = SimulationSettings(time_limit=9.0), Counter()
    cases, drivers = zip(*itertools.product(SCRIPTS, SWAYS), strict=True)
    together = simulate_many(cases, drivers, settings, alone=why)
    for one, driver, recording in zip(cases, drivers, together, strict=True):
        assert recording.same_drive(simulate(one, driver, settings)), one
    assert not why


@pytest.mark.parametrize("cases, ads", [(2, 1), (2, 0), (0, 1)])
def test_controllers_that_are_not_one_for_each_case_are_refused(cases, ads):
    with refusal(f"one for each of the {cases} cases"):
        list(simulate_many(SCRIPTS[:cases], SWAYS[:ads]))


def test_vehicles_of_different_roads_of_a_batch_are_apart():
    follower, leader = case(speed=20.0), case(speed=5.0, x=70.0)
    texts = (shared_network_xml([follower, leader]), shared_routes_xml([follower, leader], SHORT))
    with running(*texts, SHORT, collisions="none") as traci:
        assert traci.vehicle.getPosition("1.0")[0] > traci.vehicle.getPosition("0.0")[0]
        assert not (traci.vehicle.getLeader("0.0", 200.0) or ("",))[0]
