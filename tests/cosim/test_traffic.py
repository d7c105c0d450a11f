"""Vehicles that react: SUMO drives them and sees the ego, alone and in packs to the same bits."""

import tomllib
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from road_scenes import assert_as_alone, clear_drive, clips_of, scenario_of

from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.scenario.concrete import Actor, ConcreteScenario, Model, Road, Start
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import Recording

TWENTY = SimulationSettings(time_limit=12.0)
ROAD = Road("r", 900.0, 2, 3.5, 300.0)

SPACE = tomllib.loads("""
name = "t"
zone = "none"
ego = { speed = "v" }
parameter = [{ name = "v", unit = "m/s", low = 10.0, high = 30.0, step = 10.0 }]
""")  # fmt: skip
"""A scenario file without vehicles and an end."""


def of_text(text):
    """The scenario of that space with this text."""
    return scenario_of(SPACE | tomllib.loads(text))


def rear(model="IDM", gap=25.0, y=0.0, name="rear", speed=25.0):
    return Actor(name, Start(100.0 - 4.5 - gap, y, speed), model=Model(model, speed))


def scene(*actors, speed=25.0, y=0.0):
    return ConcreteScenario("t", {"v": speed}, 1.0, ROAD, Start(100.0, y, speed), actors)


def brakes(observation):
    return -8.0 if observation.time >= 2.0 else 0.0


@pytest.mark.parametrize("model", ["Krauss", "IDM", "EIDM"])
def test_a_vehicle_behind_brakes_for_the_ego_and_begins_one_step_later(model):
    settings = SimulationSettings(time_limit=12.0, record_interval=0.05)
    found = clear_drive(scene(rear(model, gap=40.0)), brakes, settings)
    follower = found.actors["rear"]
    assert follower.speed[-1] < 6.0
    calm = simulate(scene(rear(model, gap=40.0)), "no_reaction", settings).actors["rear"]
    count = min(len(calm), len(follower))
    differs = np.flatnonzero(calm.speed[:count] != follower.speed[:count])[0]
    first = found.ego.time[np.argmax(found.ego.speed < 25.0)]
    # EIDM acts on an acceleration that it has already decided on, and so some steps later
    assert first + 0.04 <= follower.time[differs] <= first + (0.51 if model == "EIDM" else 0.06)


def test_one_that_is_too_near_runs_into_the_ego_from_behind():
    found = simulate(scene(rear("IDM", gap=1.0, speed=33.0)), lambda observation: -9.0, TWENTY)
    assert found.collision.other == "rear"
    assert found.collision.side == "rear"
    clip = clips_of(found)["struck_from_behind"]
    assert clip.requested == found.collision.relative_speed
    assert clip.applied == pytest.approx(found.collision.time)  # it never left its lane


def cuts_in(observation):
    time = observation.time
    return (
        -9.0 if time > 1.8 else 0.0,
        0.5 if 1.0 < time < 1.7 else -0.5 if 1.7 <= time < 2.2 else 0.0,
    )


def test_how_long_the_ego_had_been_in_the_lane_in_which_it_is_struck():
    # it crosses the line, y = 1.75 m, and brakes, with the other 15 m/s faster and 15 m behind
    found = simulate(scene(rear("IDM", 40.0, 3.5, speed=35.0), speed=20.0), cuts_in, TWENTY)
    assert found.collision.side == "rear"
    crossed = found.ego.time[np.argmax(found.ego.y > 1.75)]
    assert clips_of(found)["struck_from_behind"].applied == pytest.approx(
        found.collision.time - crossed, abs=0.11
    )


@pytest.mark.parametrize("radius", [1e6, 250.0])
def test_law_on_a_curve_vehicles_react_as_on_a_straight_road(radius):
    content = SPACE | tomllib.loads("""
end = { x = 600.0, time = 6.0 }
vehicle = [
    { name = "walker", body = "pedestrian", x = 150.0, y = -4.0, speed = 0.0, heading = 90.0, manoeuvre = [
        { do = "accelerate", when = "ttc(ego, walker) < 4", speed = 1.0, acceleration = 2.0 },
    ] },
    { name = "lead", x = 100.0, speed = "v", manoeuvre = [{ do = "brake", when = "time > 1", deceleration = 3.0 }] },
    { name = "rear", gap_behind = 15.0, speed = "v", manoeuvre = [{ do = "follow", model = "IDM" }] },
]
""")
    bent = {**content, "road": {"line": [{"length": 1400.0, "radius": radius}]}}
    straight, found = (simulate(scenario_of(it).concrete(v=15.0), "idm") for it in (content, bent))
    assert found.error is None
    # the reference line is the middle of the right lane: there everything is as on a straight road
    least, far = (1e-3, 1e-6) if radius > 1e5 else (0.2, 0.15)
    count = min(len(straight.ego), len(found.ego))
    for name, track in [("ego", found.ego), *found.actors.items()]:
        other = straight.ego if name == "ego" else straight.actors[name]
        assert np.abs(track.x[:count] - other.x[:count]).max() < least, name
        assert np.abs(track.y[:count] - other.y[:count]).max() < max(far, 1e-3), name
    assert found.actors["rear"].speed.min() < 14.0
    assert found.actors["walker"].y.max() > -3.0


def test_law_reacting_traffic_has_the_same_bits_in_any_batch():
    cases = [
        scene(rear(gap=10.0 + 3 * k), rear("EIDM", 5.0, 3.5, "beside", 20.0 + k), speed=20.0 + k)
        for k in range(6)
    ]
    for who in ("idm", "lane_changer", "no_reaction"):
        alone = [simulate(case, who, TWENTY) for case in cases]
        assert not any(it.error for it in alone)
        for order in (1, -1):
            together = simulate_many(cases[::order], who, TWENTY)
            assert all(map(Recording.same_drive, alone[::order], together))


def test_law_cases_with_other_numbers_of_vehicles_between_them_have_the_bits_that_they_have_alone(
    monkeypatch,
):
    """A stream's number of vehicles follows from its density: of five cases those with two others
    share a simulation, and those with three, although they take turns."""
    short, sizes = SimulationSettings(time_limit=4.0), []
    module = import_module("sumo_eval.cosim.simulation")
    drive = module.drive

    def counted(world, *rest):
        sizes.append(len(world.rows))
        drive(world, *rest)

    third = rear(gap=60.0, y=3.5, name="third")
    few = [
        scene(rear(gap=12.0 + 4 * k), rear(gap=30.0, y=3.5, name="beside"), speed=20.0 + k)
        for k in range(3)
    ]
    many = [
        scene(rear(gap=14.0 + 4 * k), rear(gap=25.0, y=3.5, name="beside"), third, speed=20.0)
        for k in range(2)
    ]
    cases = [few[0], many[0], few[1], many[1], few[2]]
    alone = [simulate(case, "idm", short) for case in cases]
    monkeypatch.setattr(module, "drive", counted)
    assert not any(it.error for it in alone)
    assert all(map(Recording.same_drive, alone, simulate_many(cases, "idm", short)))
    assert sorted(sizes) == [2, 3]


def swerve(observation):
    return 0.0, (0.25 if 1.0 < observation.time < 1.6 else 0.0)


@pytest.mark.parametrize("over", [0.0, 0.6])
def test_others_see_the_ego_once_it_reaches_over_their_line_as_the_setting_says(over):
    settings = replace(
        SimulationSettings(time_limit=8.0, record_interval=0.05), seen_over_line=over
    )
    left = rear("IDM", gap=40.0, y=3.5, name="left", speed=26.0)
    found = simulate(scene(left, speed=20.0), swerve, settings)
    track = found.actors["left"]
    reach = found.ego.y + 0.9 * np.cos(found.ego.heading) + 2.25 * np.sin(found.ego.heading)
    crossing = found.ego.time[np.argmax(reach > 1.75 + over)]
    braking = track.time[np.argmax(track.acceleration < -0.5)]
    assert crossing - 0.11 <= braking <= crossing + 0.2


def test_a_scripted_vehicle_is_followed_as_well():
    logical = of_text("""
ego = { speed = "v", y = 3.5 }
end = { x = 600.0, time = 12.0 }
vehicle = [
    { name = "lead", x = 200.0, speed = "v", manoeuvre = [{ do = "brake", begin = 1.0, deceleration = 5.0 }] },
    { name = "next", x = 170.0, speed = "v", manoeuvre = [{ do = "follow", model = "IDM" }] },
]
""")
    found = simulate(logical.concrete(v=20.0), "no_reaction")
    ahead, behind = found.actors["lead"], found.actors["next"]
    assert ahead.x[-1] == pytest.approx(200.0 + 20.0 + 40.0)
    assert (ahead.x - behind.x - 4.5 > 1.0).all()
    assert behind.speed[-1] < 0.5


def test_a_trigger_that_never_fires_is_on_record():
    logical = of_text("""
end = { x = 400.0, time = 12.0 }
vehicle = [
    { name = "child", body = "child", x = 200.0, y = -5.0, speed = 0.0, heading = 90.0, manoeuvre = [
        { do = "accelerate", when = "ttc(ego, child) < 0.01", speed = 2.0, acceleration = 2.0 },
    ] },
]
""")
    found = simulate(logical.concrete(v=20.0), "no_reaction")
    assert clips_of(found)["trigger_never_fired"].count == 1
    assert np.ptp(found.actors["child"].y) == 0.0


def test_law_packed_scripts_with_conditions_have_the_bits_of_single_ones():
    logical = of_text("""
end = { x = 400.0, time = 12.0 }
vehicle = [
    { name = "walker", body = "pedestrian", x = 180.0, y = -5.0, speed = 0.0, heading = 90.0, manoeuvre = [
        { do = "accelerate", name = "go", when = "ttc(ego, walker) < 3", speed = 1.5, acceleration = 2.0 },
    ] },
    { name = "lead", gap = 90.0, y = 3.5, speed = "v", manoeuvre = [
        { do = "sinus", when = "ended(walker, go)", offset = -0.5, acceleration = 1.0 },
    ] },
]
""")

    cases = [logical.concrete(v=float(v)) for v in (10, 14, 20, 25, 30)]
    for who in ("idm", "lane_changer", "ideal_braking"):
        assert_as_alone(cases, simulate_many(cases, who), who)


@pytest.mark.parametrize("begin", [0.2, 0.27])
def test_law_sumo_takes_a_vehicle_over_where_it_is(begin):
    """At 20 m/s one more step would be 1 m; it drives as before until `begin`."""
    settings = SimulationSettings(record_interval=0.05)
    logical = of_text(f"""
end = {{ x = 400.0, time = 2.0 }}
vehicle = [{{ name = "lead", gap = 90.0, speed = "v", manoeuvre = [
    {{ do = "follow", when = "speed(ego) > 1", begin = {begin}, model = "IDM", speed = 30.0 }}] }}]
""")
    lead = simulate(logical.concrete(v=20.0), "no_reaction", settings).actors["lead"]
    driven = 0.5 * (lead.speed[1:] + lead.speed[:-1]) * np.diff(lead.time)
    np.testing.assert_allclose(np.diff(lead.x), driven, rtol=0, atol=1e-9)
    assert (lead.speed > 20.0).tolist() == (lead.time > begin + 0.04).tolist()
