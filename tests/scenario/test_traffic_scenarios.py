"""The shipped scenarios with people, others that react and moves that depend on what happens."""

from string import Template

import numpy as np
import pytest
from road_scenes import at_values, clear_drive, scenario_of
from tables import rows_of

from sumo_eval.cosim import simulate
from sumo_eval.scenario import catalogue

OTHERS = sorted(name for name in catalogue.SCENARIOS if catalogue.load(name).approach is None)


@pytest.mark.parametrize("name", OTHERS)
def test_ranges_without_a_standard_are_labelled_as_research_ranges(name):
    assert "research range, not a standard limit" in catalogue.load(name).source.lower()


@pytest.mark.parametrize(
    "ego, faster", [(100 / 3.6, 30 / 3.6), (80 / 3.6, 50 / 3.6), (80 / 3.6, 20 / 3.6)]
)
def test_oracle_braking_as_un_r79_ends_1_s_behind(ego, faster):
    # S = dv 0.4 s + dv^2 / (2 3 m/s2) + v 1 s: 130 behind 100 km/h 42.7 m, 130 behind 80 59.9, 100
    # behind 80 29.6
    s = faster * 0.4 + faster * faster / 6.0 + ego
    known = {(100, 30): 42.7, (80, 50): 59.9, (80, 20): 29.6}
    assert s == pytest.approx(known[round(ego * 3.6), round(faster * 3.6)], abs=0.06)
    point = {"ego_speed": np.array([ego]), "faster": np.array([faster]), "gap": np.array([50.0])}
    margin = catalogue.load("lane_change_rear").margin(point)
    assert margin == pytest.approx([50.0 - s])
    logical = scenario_of(f"""
name = "t"
parameter = [{{ name = "gap", unit = "m", low = 10.0, high = 90.0, step = 10.0 }}]
end = {{ x = 600.0, time = 8.0 }}
zone = "none"
ego = {{ speed = {ego}, x = 150.0 }}
[[vehicle]]
name = "rear"
speed = {ego + faster}
gap_behind = "gap"
manoeuvre = [{{ do = "accelerate", when = "time >= 0", begin = 0.4, speed = {ego}, acceleration = 3.0 }}]
""")  # fmt: skip
    for gap in (s - 0.01, s + 0.01):
        found = simulate(logical.concrete(gap=gap), "no_reaction")
        left = found.ego.x[-1] - found.actors["rear"].x[-1] - 4.5
        assert found.actors["rear"].speed[-1] == pytest.approx(ego)
        assert left == pytest.approx(ego + gap - s, abs=1e-6)
        assert (left >= ego) == (gap >= s)


def test_a_watching_driver_brakes_for_a_vehicle_on_its_way():
    # in the path 0.65 s after reaching the lane, 0.85 s and 13 m before an ego at 15 m/s: too late
    # to brake only then
    concrete = at_values(
        "pedestrian_crossing", ego_speed=15.0, walking_speed=1.3, time_to_place=1.5
    )
    collisions = {who: simulate(concrete, who).collision for who in ("idm", "attentive")}
    assert collisions["idm"] is not None
    assert collisions["attentive"] is None


def test_an_ego_that_begins_sideways_returns_on_a_curve_too():
    offsets = []
    for use in ("lane_keeping_disturbed", "lane_keeping_disturbed?radius=500"):
        found = clear_drive(at_values(use, ego_speed=20.0, lateral_speed=0.8), "idm")
        assert found.end_reason == "road_end"
        offsets.append(found.ego.y)
    count = min(map(len, offsets))
    assert 0.2 < offsets[0].max() < 1.75
    np.testing.assert_allclose(offsets[1][:count], offsets[0][:count], atol=0.05)


def odd(keys):
    """A case of a scenario file with these keys."""
    return scenario_of(f"""
name = "odd"
zone = "none"
parameter = [{{ name = "v", unit = "m/s", low = 10.0, high = 20.0, step = 10.0 }}]
{keys}""").concrete(v=10.0)  # fmt: skip


ACCEPTED = Template("""
slower | lanes = 3, $arc | 3.5 | $ahead, manoeuvre = [{ $slower }]
past_the_arc | lanes = 3, $arc | 3.5
| $ahead, body = "truck", y = 7.0, manoeuvre = [{ $slower, when = "speed(ego) > 90" }]
back | lanes = 3, $arc | 3.5
| $ahead, manoeuvre = [{ do = "path", begin = 0.5, points = [[50.0, 4.5], [120.0, 3.5], [210.0, 3.0]] }]
exit | lanes = 3, $bend, $exit | 3.5 | $ahead, y = 3.5
ramp | lanes = 3, $bend, lane = [{ lane = 0, taper = 60.0, end = 530.0, ramp_until = 410.0 }] | 6.6
| $ahead, y = 3.5
across | lanes = 2 | 0.0 | x = 180.0, y = 8.0, speed = 16.0, heading = -90.0
follows_across | lanes = 2 | 0.0
| x = 180.0, y = 8.0, speed = 16.0, heading = -90.0, manoeuvre = [{ $slower, when = "distance(ego, a) < 40" }]
steep | lanes = 2 | 0.0 | gap = 40.0, speed = 2.0, manoeuvre = [{ $steep }]
zigzag | lanes = 2 | 0.0
| gap = 40.0, speed = 4.0, manoeuvre = [{ do = "path", points = [[90.0, 3.5], [92.0, -5.0], [85.0, 0.0], [99.0, 1.0]] }]
beside | lanes = 4, $arc | 10.5
| $ahead, y = 10.5, manoeuvre = [{ $steep }, { $slower, when = "y(a) > 13" }]
tight | lanes = 4, $arc, $exit | 10.5 | $ahead, y = 3.5
stops | length = 900.0, lane = [{ lane = 1, end = 500.0 }] | 0.0
| x = 863.0, speed = 16.0, manoeuvre = [{ do = "brake", begin = 1.2, deceleration = 8.5 }]
""").substitute(
    # more than half a circle
    arc="length = 900.0, line = [{ length = 60.0 }, { length = 260.0, radius = 72.0 }]",
    bend="length = 900.0, line = [{ length = 70.0 }, { length = 140.0, radius = -690.0 }]",
    exit="lane = [{ lane = 0, taper = 60.0, begin = 410.0, ramp_from = 560.0 }]",
    ahead="gap = 40.0, speed = 18.0",
    slower='do = "follow", model = "Krauss", speed = 10.5',
    steep='do = "move_sideways", begin = 0.5, speed = 2.5, offset = 4.0',
)  # fmt: skip


@pytest.mark.parametrize(
    "road, y, vehicle", [pytest.param(*row, id=name) for name, *row in rows_of(ACCEPTED)]
)
@pytest.mark.parametrize("ads", ["no_reaction", "traci"])
def test_what_check_accepts_is_played(road, y, vehicle, ads):
    """A straight drive that leaves the road in a curve included, beside traffic that reacts."""
    stream = '{ name = "st", lane = 1, begin = 60.0, end = 200.0, density = 20.0, speed = "v" }'
    concrete = odd(f"""
road = {{ {road} }}
ego = {{ speed = "v", x = 30.0, y = {y} }}
vehicle = [{{ name = "a", {vehicle} }}]
stream = [{stream * ("lane = [" not in road)}]
""")
    drive = simulate(concrete, (lambda traci, ego, time: None) if ads == "traci" else ads)
    assert drive.error is None
    assert drive.simulated_time > 1.0


def test_law_a_body_that_reaches_over_a_line_again_is_seen():
    concrete = odd("""
ego = { speed = "v", x = 100.0 }
stream = [
    { name = "left", lane = 1, begin = -60.0, end = -50.0, density = 1.0, speed = "v + 4", headway = 0.5 },
]
[[vehicle]]
name = "a"
gap = 20.0
speed = "v"
manoeuvre = [
    { do = "sinus", begin = 0.5, offset = 1.5, acceleration = 1.0 },
    { do = "sinus", begin = 10.5, offset = 1.5, acceleration = 1.0 },
]
""")
    drive = simulate(concrete, "no_reaction")
    assert drive.actors["left_1"].speed[105:].min() < 13.0  # of 14 m/s, as without the swing
