"""What an ADS sees without TraCI, and what the conditions put in between."""

import math
from contextlib import suppress
from dataclasses import FrozenInstanceError, replace
from importlib import import_module
from operator import attrgetter

import numpy as np
import pytest
from evaluations import settings_of
from refusals import refusal
from road_scenes import HALF_SECOND, ROAD, Watches, case, clips_of, half_second, lead, under

from sumo_eval import Command, Plan
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.doors.features import Action, Feature, Interface
from sumo_eval.cosim.doors.observation import Observation, Perception, signal_names
from sumo_eval.scenario import Actor, Start, brake_to_stop
from sumo_eval.scenario.touch import Body
from sumo_eval.settings import ConditionSettings, SimulationSettings

EGO = Body(50.0, 0.0, 0.0, 20.0, 4.5, 1.8)


def car(x, y=0.0, speed=10.0, heading=0.0):
    return Body(x, y, heading, speed, 4.5, 1.8)


def eyes(**conditions):
    return Perception([ConditionSettings(**conditions)], ["1"])


def look(*others, own=None, time=0.0, **conditions):
    bodies = np.reshape(others, (1, -1, 7))
    me, seen = (own or eyes(**conditions)).look(time, np.array([EGO]), bodies)
    shown, kinds = (me[0].tolist(), seen[0].tolist()), ["car"] * len(others)
    return Observation(time, ROAD, (*EGO, -1.0), shown, None, kinds)


def seen_by(ads, concrete, **conditions):
    """The recording, and every observation that the ADS was shown."""
    shown = []

    def act(observation):
        shown.append(observation)
        return ads(observation) if ads else 0.0

    return simulate(concrete, act, under(**conditions)), shown


def test_a_lead_and_its_neighbours_by_hand():
    # gaps: 84.5 - 50 - 4.5 = 30 m ahead; 50 - 30 - 4.5 = 15.5 m behind; 70 - 50 - 4.5 = 15.5 m
    # ahead in the left lane
    seen = look(car(84.5), car(70.0, 3.5, 25.0), car(30.0, 0.0, 20.0))
    assert seen.lead.gap == 30.0
    assert seen.lead.relative_speed == -10.0
    assert seen.lead.offset == 0.0
    assert seen.neighbours["left_ahead"].gap == 15.5
    assert seen.neighbours["left_ahead"].relative_speed == 5.0
    assert seen.neighbours["behind"].gap == 15.5
    assert seen.neighbours["left_behind"] is seen.neighbours["right_ahead"] is None
    assert seen.ego.speed == 20.0
    assert seen.ego.acceleration == -1.0
    assert seen.ego.lane == 0
    assert seen.lanes == (0.0, 3.5)
    assert seen.left_edge == 5.25
    assert seen.right_edge == 1.75


def test_a_vehicle_out_of_the_strip_is_not_a_lead():
    assert look(car(84.5, 1.79)).lead is not None
    assert look(car(84.5, 1.81)).lead is None


def test_speeds_are_along_and_across_the_road():
    seen = look(car(84.5, 0.0, 10.0, math.radians(30.0))).lead
    speeds = seen.relative_speed + 20.0, seen.lateral_speed
    assert speeds == pytest.approx((8.660254, 5.0))


def test_an_observation_is_frozen_and_worked_out_once_when_asked():
    seen = look(car(84.5))
    assert "lead" not in vars(seen)
    assert seen.lead is seen.lead
    with pytest.raises(FrozenInstanceError):
        seen.time = 1.0


def test_a_controller_that_takes_traci_is_shown_no_observation_and_none_is_made(monkeypatch):
    made = []
    monkeypatch.setattr(Perception, "look", lambda *_: made.append(1))
    half_second(lambda traci, ego, time: None, lead(50.0))
    assert made == []


@pytest.mark.parametrize("action", [-2.0, -2, (-2.0, 0.0), [-2.0], Command(-2.0)])
def test_a_function_of_the_observation_or_an_object_with_act_will_do(action):
    class Policy:
        def act(self, observation):
            return action

    def function(observation):
        return action

    drives = [half_second(ads) for ads in (Policy, Policy(), function)]
    assert {d.ego.speed[-1] for d in drives} == {
        half_second(lambda *_: Command(-2.0)).ego.speed[-1]
    }


def test_a_policy_receives_road_and_vehicle_not_the_scenario():
    told = []

    class Policy:
        def reset(self, scenario):
            told.append(scenario)

        def act(self, observation):
            return 0.0

    secret = replace(case(lead(50.0)), scenario="secret", values={"gap": 50.0})
    simulate(secret, Policy(), HALF_SECOND)
    open_ = under(reveal_scenario=True)
    simulate(secret, Policy(), open_)
    assert told[0].scenario == ""
    assert told[0].values is None
    assert told[0].road.name == "road"
    assert told[1].scenario == "secret"
    assert told[1].values == {"gap": 50.0}
    assert told[1].road == ROAD


def test_sumos_files_do_not_tell_the_future_unless_the_scenario_is_revealed():
    import libsumo

    told = []

    def spy(traci, ego, time):
        from pathlib import Path

        told.append(Path(libsumo.simulation.getOption("route-files")).read_text())

    secret = replace(case(lead(50.0)), scenario="secret", values={"gap": 50.0})
    for reveal in (False, True):
        simulate(secret, spy, under(reveal_scenario=reveal))
    assert "secret" not in told[0]
    assert "secret: gap=50" in told[-1]


@pytest.mark.parametrize(
    "wrong",
    [{"sensor_range": 0.0}, {"field_of_view_deg": 361.0}, {"dropout": 1.5}, {"step_budget": -1.0}],
)
def test_conditions_that_cannot_be_are_refused_in_the_file_and_in_python(wrong):
    with refusal():
        ConditionSettings(**wrong)
    with refusal(r"simulation\.conditions"):
        settings_of(simulation={"conditions": wrong})


def test_every_seen_vehicle_has_its_place_in_the_world_beside_the_relative_values():
    seen = look(car(84.5, 0.5, 10.0, 0.1), car(70.0, 3.5, 25.0))
    assert [(v.x, v.y, v.heading, v.kind) for v in seen.vehicles] == [
        (70.0, 3.5, 0.0, "car"),
        (84.5, 0.5, 0.1, "car"),
    ]
    assert seen.ego.x + seen.lead.gap + 4.5 == pytest.approx(84.5, abs=0.15)
    assert seen.ego.y + seen.lead.offset == 0.5


as_it_is_and_through_senses = pytest.mark.parametrize("conditions", [{}, {"sensor_range": 1000.0}])


@as_it_is_and_through_senses
def test_every_seen_vehicle_says_what_it_is(conditions):
    """A lorry ahead, a person beside the road behind it; as numbers, 2 and 5 of car, van, truck,
    motorcycle, ..."""
    truck = Actor("truck", Start(100.0, 0.0, 20.0), length=12.0, width=2.5, body="truck")
    person = Actor("person", Start(160.0, -3.0, 0.0), length=0.215, width=0.478, body="pedestrian")
    _, shown = seen_by(None, case(truck, person), **conditions)
    assert [it.kind for it in shown[0].vehicles] == ["truck", "pedestrian"]
    assert shown[0].lead.kind == "truck"
    assert shown[0].plain()["lead"]["kind"] == "truck"
    assert shown[0].signals()["lead_kind"] == 2.0
    assert shown[0].signals()["left_ahead_kind"] == -1.0


def test_a_policy_over_arrays_receives_kinds_as_numbers():
    feature = Interface(
        (Feature("vehicles.1.kind"), Feature("vehicles.2.kind")), (Action("acceleration"),)
    )
    policy = Watches(
        lambda seen: (seen.vehicles.length[:, 0].tolist(), seen.kinds.tolist(), feature.show(seen))
    )
    bicycle = Actor("bicycle", Start(150.0, 0.0, 5.0), length=1.6, width=0.65, body="bicycle")
    cases = [case(bicycle), case(lead(60.0))]
    drives = simulate_many(cases, policy, SimulationSettings(time_limit=0.1))
    assert {it.error for it in drives} == {None}
    lengths, kinds, features = policy.shown[0]
    assert sorted(zip(lengths, kinds, features.tolist(), strict=True)) == [
        (1.6, [4], [4.0, -1.0]),
        (4.5, [0], [0.0, -1.0]),
    ]


def first_features(concrete, names, **absent):
    """Values of features at the first step of a drive."""
    table = Interface(tuple(Feature(it, **absent) for it in names), (Action("acceleration"),))
    policy = Watches(lambda seen: table.show(seen).tolist()[0])
    assert simulate(concrete, policy, SimulationSettings(time_limit=0.1)).error is None
    return policy.shown[0]


def test_features_without_their_vehicle_have_the_stated_values():
    """An ego of 20 m/s beside one car, without a lead and without a second vehicle; then with a
    standing lead in a gap of 60 m."""
    of_lead = ["lead.gap", "lead.relative_speed", "lead.speed", "lead.offset"]
    names = [*of_lead, "vehicles.2.x", "vehicles.2.speed"]
    aside = case(Actor("aside", Start(100.0, 3.5, 10.0)))
    assert first_features(aside, names) == [1000.0, 0.0, 20.0, 0.0, 1000.0, 0.0]
    assert first_features(aside, names, absent=-7.0) == [-7.0] * 6
    assert first_features(case(lead(60.0)), of_lead, absent=-7.0) == [60.0, -20.0, 0.0, 0.0]
    with refusal("`vehicles.2.present` must have no `absent`"):
        Feature("vehicles.2.present", absent=-1.0)
    for name in ("ego.speed", "time", "left_edge", "lane_offset"):
        with refusal(f"`{name}` must have no `absent`, as it always has a value, got -1"):
            Feature(name, absent=-1.0)


def test_the_second_lead_is_the_next_one_ahead_in_the_strip():
    seen = look(car(150.0), car(90.0, 3.5), car(84.5), car(110.0))
    assert seen.lead.x == 84.5
    assert seen.second_lead.x == 110.0
    assert look(car(84.5)).second_lead is None
    assert look().second_lead is None


def test_the_road_has_lane_lines_and_the_ads_receives_its_task():
    _, shown = seen_by(None, case(lead(50.0)))
    end = ROAD.length + ROAD.run_out
    assert [line.centre for line in shown[0].lane_borders] == [
        ((0.0, 0.0), (end, 0.0)),
        ((0.0, 3.5), (end, 3.5)),
    ]
    assert (
        shown[0].lane_borders[0].left
        == shown[0].lane_borders[1].right
        == ((0.0, 1.75), (end, 1.75))
    )
    assert shown[0].desired_speed == 20.0
    assert shown[0].goal == (600.0, 0.0)
    assert shown[0].speed_limit == ROAD.speed_limit


@as_it_is_and_through_senses
def test_acceleration_is_the_rate_of_the_seen_speed(conditions):
    # braking from 20 m/s at 4 m/s2 from the start: 0 at the first look, then -4
    _, shown = seen_by(
        None, case(Actor("lead", Start(150.0, 0.0, 20.0), (brake_to_stop(0.0, 4.0),))), **conditions
    )
    assert [seen.lead.acceleration for seen in shown] == pytest.approx([0.0] + [-4.0] * 9)
    assert [seen.lead.x for seen in shown][:2] == pytest.approx(
        [150.0, 150.0 + 0.05 * 20.0 - 0.5 * 4.0 * 0.05**2]
    )


def test_under_conditions_the_places_in_the_world_are_the_noisy_ones():
    noisy = look(car(84.5), position_noise=0.5).lead
    assert noisy.x != 84.5
    assert noisy.gap == pytest.approx(noisy.x - 50.0 - 4.5)
    assert noisy.offset == noisy.y


def test_acceleration_under_noise_is_that_of_the_noisy_speeds():
    own = eyes(speed_noise=0.2)
    looks = [look(car(84.5), own=own, time=0.05 * step).lead for step in range(3)]
    rates = np.diff([lead.speed for lead in looks]) / 0.05
    assert [lead.acceleration for lead in looks] == pytest.approx([0.0, *rates])


# --- conditions -----------------------------------------------------------------------------------


def test_a_perception_delay_shows_the_world_as_it_was():
    _, shown = seen_by(None, case(lead(50.0)), perception_delay=0.2)
    # 1 m a step of 0.05 s at 20 m/s towards a standing lead
    assert [round(seen.lead.gap, 6) for seen in shown] == [50, 50, 50, 50, 50, 49, 48, 47, 46, 45]
    # its own state is the present one
    assert [round(seen.ego.x, 6) for seen in shown][:3] == [50, 51, 52]


def test_what_is_beyond_the_sensors_range_is_not_seen():
    near, far = car(100.0), car(101.0)
    assert [v.number for v in look(near, far, sensor_range=50.5).vehicles] == [1]


def test_what_is_outside_the_field_of_view_is_not_seen():
    # 60 deg: from the front bumper at 52.25 m, a body whose nearest corner lies within 30 deg of
    # straight ahead
    ahead, beside, behind = car(80.0), car(53.0, 3.5), car(30.0)
    seen = look(ahead, beside, behind, field_of_view_deg=60.0).vehicles
    assert [v.number for v in seen] == [1]
    assert len(look(ahead, beside, behind, field_of_view_deg=360.0).vehicles) == 3


def test_a_vehicle_behind_a_nearer_one_is_hidden_until_a_fifth_of_it_shows():
    for y, seen in ((0.0, {1}), (0.35, {1}), (0.37, {1, 2})):
        shown = look(car(70.0, y), car(100.0), occlusion=True).vehicles
        assert {v.number for v in shown} == seen


def test_what_is_seen_from_its_side_shows_and_hides_its_length():
    # a car is 1.8 m wide: a crossing one shows 4.5 m
    crossing, along = (car(100.0, heading=heading) for heading in (math.pi / 2, 0.0))
    hidden_by = {crossing: car(70.0), along: car(70.0, 1.3, heading=math.pi / 2)}
    seen = {it: len(look(by, it, occlusion=True).vehicles) for it, by in hidden_by.items()}
    assert seen == {crossing: 2, along: 1}


def test_misses_and_noise_have_the_stated_size_and_leave_the_truth_alone():
    own, gaps, speeds = eyes(dropout=0.3, position_noise=0.5, speed_noise=0.2), [], []
    for step in range(4000):
        for vehicle in look(car(84.5), own=own, time=0.05 * step).vehicles:
            gaps.append(vehicle.gap - 30.0)
            speeds.append(vehicle.speed - 10.0)
    deviation = lambda values: math.sqrt(sum(v * v for v in values) / len(values))  # noqa: E731
    assert len(gaps) / 4000 == pytest.approx(0.7, abs=0.03)
    assert deviation(gaps) == pytest.approx(0.5, abs=0.03)
    assert deviation(speeds) == pytest.approx(0.2, abs=0.01)


def test_one_seed_is_one_drive_and_another_seed_another():
    noisy = under(position_noise=1.0, dropout=0.1)
    ads = lambda seen: -0.1 * seen.lead.gap if seen.lead else 0.0  # noqa: E731
    drives = [
        simulate(case(lead(50.0)), ads, noisy, seed=seed).ego.speed.tolist() for seed in (1, 1, 2)
    ]
    assert drives[0] == drives[1] != drives[2]


def test_noise_does_not_depend_on_what_the_ads_looks_at():
    one, two = eyes(position_noise=1.0), eyes(position_noise=1.0)
    for step in range(3):
        mine, its = (look(car(84.5), own=it, time=0.05 * step) for it in (one, two))
        mine.plain()
    assert mine.lead.gap == its.lead.gap


def test_that_traci_shows_everything_is_on_record_when_conditions_were_asked_for():
    limited = under(sensor_range=30.0)
    clips = simulate(case(), lambda traci, ego, time: None, limited).clips
    assert [clip.what for clip in clips] == ["perception_not_limited"]
    assert simulate(case(), lambda observation: 0.0, limited).clips == ()


def test_an_actuation_delay_holds_each_command_back():
    now, _ = seen_by(lambda seen: -4.0, case())
    late, _ = seen_by(lambda seen: -4.0, case(), actuation_delay=0.2)
    assert late.ego.speed[:3].tolist() == [20.0, 20.0, 20.0]
    assert late.ego.speed[2:].tolist() == pytest.approx(now.ego.speed[:-2].tolist())


EARLIER = [
    Command(-4.0), Command(speed=15.0), Command.pedals(brake=0.5),
    Plan([0.0, 0.5], [60.0, 69.0], [0.0, 0.3]), None,
]  # fmt: skip


@pytest.mark.parametrize("earlier", EARLIER, ids=["number", "speed", "pedals", "plan", "none"])
@pytest.mark.parametrize("door", [False, True], ids=["policy", "hook"])
def test_a_late_answer_is_dropped_and_the_earlier_one_followed(door, earlier):
    """None: the first answer is late, so that the ego keeps its speed."""
    import time as clock

    def drive(command, settings):
        traci, policy = lambda traci, ego, time: command(time), lambda seen: command(seen.time)
        return simulate(case(), traci if door else policy, settings, period=0.2)

    def late(time):
        if time <= 0.1 and earlier is not None:
            return earlier
        clock.sleep(0.1)
        return Command(speed=30.0, steering=0.1)

    found = drive(late, under(step_budget=0.08))
    assert clips_of(found)["late_command"].count == 2 + (earlier is None)
    alone = drive(lambda time: earlier or Command(0.0), HALF_SECOND)
    for channel in ("x", "y", "steering_wheel_angle"):
        assert getattr(found.ego, channel).tolist() == getattr(alone.ego, channel).tolist()


def test_what_an_ads_tells_sumo_itself_cannot_be_held_back_and_that_is_on_record():
    delayed = under(actuation_delay=0.2)
    found = simulate(case(), lambda traci, ego, time: traci.vehicle.setSpeed(ego, 15.0), delayed)
    assert clips_of(found)["actuation_not_delayed"].count == 10


def test_the_flat_signals_and_the_plain_form_say_the_same():
    seen = look(car(84.5), car(70.0, 3.5, 25.0))
    signals, plain = seen.signals(), seen.plain()
    assert signals["lead_gap"] == plain["lead"]["gap"] == 30.0
    assert signals["ego_speed"] == plain["ego"]["speed"] == 20.0
    assert len(plain["vehicles"]) == 2
    assert signals["lead_x"] == 84.5
    assert signals["left_ahead_x"] == 70.0
    assert signals["left_ahead_y"] == 3.5
    assert signals["lanes"] == 2.0
    assert signals["lane_width"] == 3.5
    assert signals["second_lead_present"] == 0.0
    assert tuple(signals) == signal_names()
    assert math.isnan(signals["change_from"] + signals["change_by"])  # it may keep its lane
    nobody = look()
    assert nobody.signals()["lead_present"] == 0.0
    assert nobody.signals()["lead_gap"] == 1000.0
    assert nobody.plain()["lead"] is None


def test_numbers_stay_with_their_vehicles():
    actors = Actor("b", Start(100.0, 0.0, 25.0)), Actor("a", Start(90.0, 3.5, 10.0))
    _, shown = seen_by(None, case(*actors))
    assert {(v.number, v.speed) for seen in shown for v in seen.vehicles} == {(1, 25.0), (2, 10.0)}
    assert isinstance(shown[0], Observation)


def test_law_no_policy_sees_a_vehicle_that_has_left_the_road():
    arrays = Watches(lambda seen: (seen.time, np.isfinite(seen.vehicles.x).any()))
    shown = arrays.shown

    def single(seen):
        shown.append((seen.time, bool(seen.vehicles)))
        return 0.0

    leaver = case(Actor("gone", Start(280.0, 0.0, 20.0)))
    short = replace(leaver, road=replace(ROAD, length=300.0, run_out=0.0))
    limits = ConditionSettings(sensor_range=500.0)
    for policy, conditions in ((arrays, None), (single, None), (single, limits)):
        shown.clear()
        settings = SimulationSettings(time_limit=2.0, conditions=conditions or ConditionSettings())
        assert simulate(short, policy, settings).error is None
        assert [seen for time, seen in shown if time < 0.8] == [True] * 16
        assert not any(seen for time, seen in shown if time > 1.0)


def test_lead_over_arrays_is_neutral_where_there_is_no_vehicle():
    policy = Watches(lambda seen: (seen.lead.speed, seen.lead.offset, seen.lead.gap))
    simulate(case(), policy, SimulationSettings(time_limit=0.1))
    assert policy.shown[0] == (20.0, 0.0, math.inf)


@pytest.mark.parametrize(
    "call, arguments",
    {
        "close": (), "simulationStep": (), "vehicle.setSpeed": ("lead", 1.0),
        "vehicle.remove": ("ego",), "vehicle.moveToXY": ("ego", "", 0, 300.0, 0.0, 90.0, 2),
    }.items(),
)  # fmt: skip
def test_a_policy_that_writes_to_sumo_is_at_fault_itself(call, arguments):
    before = import_module("libsumo")

    def policy(seen):
        module = before if call == "close" else import_module("libsumo")
        attrgetter(call)(module)(*arguments)
        return 0.0

    def sly(seen):
        with suppress(Exception):
            return policy(seen)
        return 0.0

    cases = [case(lead(50.0))] * 2
    for ads in (policy, sly):
        for found in (simulate(cases[0], ads), *simulate_many(cases, ads)):
            assert found.end_reason == "ads_error"
