"""Moves that begin when a condition holds, speeds, swings and paths, against their closed forms."""

import math
import tomllib
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal, refused
from road_scenes import scenario_of, table
from tables import rows_of, values_of

from sumo_eval.method.point_criticality import criticality
from sumo_eval.method.zone_partition import partition
from sumo_eval.scenario import played
from sumo_eval.scenario.file import check_points
from sumo_eval.scenario.played import Act
from sumo_eval.scenario.reachable import never_begin
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import ZoneSettings

BASE = tomllib.loads("""
name = "t"
parameter = [{ name = "v", unit = "m/s", low = 10.0, high = 30.0, step = 10.0 }]
ego = { speed = "v" }
end = { x = 600.0, time = 20.0 }
zone = "none"
""")  # fmt: skip


def scene(*moves, zone="none", more=""):
    """A lead 100 m ahead at 20 m/s that does something; keys as in a scenario file."""
    lead = {"name": "lead", "x": 150.0, "speed": 20.0, "manoeuvre": [*map(table, moves)]}
    return scenario_of({**BASE, "vehicle": [lead | table(more)], "zone": zone})


def drive(logical, step=0.05, until=4.0, v=20.0):
    """A drive of an ego that keeps its speed."""
    return tracks([logical.concrete(v=v)], [(4.5, 1.8)], step, until)


def way(logical, step=0.05):
    """Times and the lead's x, y, heading and speed, while the ego keeps its speed."""
    rows = drive(logical, step, 10.0).others[0, 0]
    return np.arange(len(rows)) * step, rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3]


def test_accelerating_with_a_rate_reaches_the_speed_and_keeps_it():
    # from 20 to 26 m/s at 3 m/s2: 2 s and 46 m, then 26 m/s
    t, x, _, _, v = way(scene('do = "accelerate", begin = 1.0, speed = 26.0, acceleration = 3.0'))
    assert v[t == 3.0] == pytest.approx(26.0)
    assert x[t == 3.0] == pytest.approx(150.0 + 20.0 + 46.0)
    assert x[-1] == pytest.approx(150.0 + 20.0 + 46.0 + 26.0 * 7.0)


def test_accelerating_with_a_jerk_builds_up():
    # jerk 3 m/s3 to 3 m/s2: 1 s for 1.5 m/s, then (10 - 1.5) / 3 s: 3.8333 s in all
    t, _, _, _, v = way(scene('do = "accelerate", speed = 10.0, acceleration = 3.0, jerk = 3.0'))
    assert v[t == 1.0] == pytest.approx(18.5)
    assert v[np.isclose(t, 3.85)] == pytest.approx(10.0)
    assert v[np.isclose(t, 3.80)] == pytest.approx(10.1)


def test_a_profile_by_time_and_one_by_place_pass_through_their_knots():
    t, x, _, _, v = way(scene('do = "speed_profile", times = [2.0, 4.0], speeds = [10.0, 30.0]'))
    assert v[t == 2.0] == pytest.approx(10.0)
    assert v[t == 4.0] == pytest.approx(30.0)
    assert x[t == 4.0] == pytest.approx(150.0 + 30.0 + 40.0)
    # 150 -> 190 m from 20 to 10 m/s lasts 2 * 40 / 30 s
    t, x, _, _, v = way(scene('do = "speed_profile", places = [190.0], speeds = [10.0]'), step=0.01)
    assert np.interp(190.0, x, v) == pytest.approx(10.0, abs=0.02)
    assert np.interp(190.0, x, t) == pytest.approx(80.0 / 30.0, abs=1e-3)
    move = 'do = "speed_profile", places = [190.0], speeds = [10.0]'
    with refusal(r"`heading` .* \(use `times` otherwise\), got 180"):
        way(scene(move, more="heading = 180.0"))


@pytest.mark.parametrize("profile_first", [True, False])
def test_places_of_a_profile_on_a_path_are_along_the_road(profile_first):
    # on the path's second leg 4 m along the road are 5 m to drive; it turns back before x = 300 m
    moves = [
        'do = "speed_profile", places = [180.0, 210.0, 300.0], speeds = [10.0, 30.0, 5.0]',
        'do = "path", points = [[160.0, 0.0], [190.0, 22.5], [240.0, 22.5], [200.0, 40.0]]',
    ]
    t, x, _, _, v = way(scene(*(moves if profile_first else moves[::-1])), step=0.001)
    for place, speed, driven in ((180.0, 10.0, 35.0), (210.0, 30.0, 67.5)):
        k = int(np.argmax(x >= place))
        assert v[k] == pytest.approx(speed, abs=0.05)
        assert np.trapezoid(v[: k + 1], t[: k + 1]) == pytest.approx(driven, abs=0.05)
    assert v[-1] == pytest.approx(30.0)


TIMED = [Act(kind, 1.0) for kind in (played.SMOOTH, played.CONSTANT, played.COSINE, played.SPEED)]
UNTIMED = [
    *(it._replace(begin=math.inf) for it in TIMED),
    *(it._replace(program=((0, 0, 0, 0.0),)) for it in TIMED),
    Act(played.SPEED, 1.0, speed=5.0), Act(played.SINUS, 1.0), Act(played.KEEP, 1.0),
]  # fmt: skip


def test_moves_of_a_closed_form_at_a_known_time_are_timed():
    assert [it.timed for it in (*TIMED, *UNTIMED)] == [True] * 4 + [False] * 11


def test_a_swing_has_its_amplitude_and_its_lateral_acceleration():
    # A = 1 m, a = 2 m/s2: w = sqrt(2 a / A) = 2 rad/s, so a swing lasts pi s; to the left, then to
    # the right
    t, _, y, _, _ = way(
        scene('do = "sinus", offset = 1.0, acceleration = 2.0, cycles = 2.0'), step=0.01
    )
    np.testing.assert_allclose(
        y[t < math.pi], 0.5 * (1.0 - np.cos(2.0 * t[t < math.pi])), atol=1e-12
    )
    assert y.min() == pytest.approx(-1.0, abs=1e-3)
    assert np.abs(np.diff(y, 2)).max() / 1e-4 == pytest.approx(2.0, rel=1e-3)


def test_a_path_begins_beside_the_line_after_a_lane_change():
    change = 'do = "change_lane", duration = 3.0, offset = 3.5'
    path = 'do = "path", begin = 5.0, points = [[300.0, 3.5], [500.0, 3.5]]'
    t, _, y, _, _ = way(scene(change, path))
    assert y[t >= 4.0] == pytest.approx(3.5)


def test_a_path_leads_through_its_points_at_the_vehicles_speed():
    t, x, y, heading, _ = way(
        scene('do = "path", points = [[190.0, 0.0], [220.0, 3.5], [400.0, 3.5]]'), step=0.01
    )
    at = np.isclose(t, (40.0 + math.hypot(30.0, 3.5)) / 20.0, atol=0.006)
    assert x[at][0] == pytest.approx(220.0, abs=0.15)
    assert heading[np.isclose(t, 2.5)] == pytest.approx(math.atan2(3.5, 30.0))
    assert y[-1] == 3.5


def test_a_start_with_a_heading_and_one_with_a_lateral_speed():
    _, x, y, _, _ = way(scene(more="heading = 90.0, speed = 1.5"))
    assert x[-1] == pytest.approx(150.0)
    assert y[-1] == pytest.approx(15.0)
    _, x, y, heading, v = way(scene(more="lateral_speed = 0.5"))
    assert x[-1] == pytest.approx(350.0)
    assert y[-1] == pytest.approx(5.0)
    assert (heading[0], v[0]) == (math.atan2(0.5, 20.0), math.hypot(20.0, 0.5))


@pytest.mark.parametrize("step", [0.1, 0.05, 0.01])
def test_law_a_condition_on_the_time_begins_at_that_time_whatever_the_step(step):
    _, x, _, _, _ = way(scene('do = "brake", when = "time > 2.237", deceleration = 5.0'), step)
    assert x[-1] == pytest.approx(150.0 + 20.0 * 2.237 + 20.0**2 / 10.0, abs=1e-9)


@pytest.mark.parametrize(
    "when, begins, step, until",
    [
        # the ego closes at 10 m/s on a gap of 100 - 4.5 m: 40 m are left after 5.55 s
        *[("gap(ego, lead) < 40", 5.55, step, 8.0) for step in (0.1, 0.05, 0.02)],
        # the ego's front is at the lead's rear after 9.55 s, between two looks: a number turned
        # infinite counts at the end
        ("thw(ego, lead) > 9", 9.56, 0.02, 9.8),
        *(
            (when, begins, 0.05, 9.0)
            for when, begins in (
                ("time > 1 and gap(ego, lead) < 40", 5.55),
                ("time > 7 or gap(ego, lead) < 40", 5.55),
                ("1 < time < 8", 1.0),
                ("thw(ego, lead) <= 1", (95.5 - 30.0) / 10.0),
                ("x(lead) - 150 > v", 1.5),
                ("max(speed(ego), 5) < 3", math.inf),
                ("distance(ego, lead) < 50", 5.0),
                (20 * "(1 + " + "time" + 20 * ")" + " > 21.5", 1.5),  # the deepest
                ("1 < time" + 23 * " or time > 9", 1.0),  # the longest
                ("-y(lead) + lateral_speed(ego) < -1", math.inf),
            )
        ),
    ],
)
def test_law_the_instant_of_a_linear_condition_is_exact(when, begins, step, until):
    brakes = scene(f'do = "brake", when = "{when}", deceleration = 5.0')
    found = drive(brakes, step, until, v=30.0).begins[0, 0]
    assert found == pytest.approx(begins, abs=1e-9)


def test_a_move_begins_when_another_has_ended_and_a_delay_is_over():
    # 20 -> 10 m/s at 5 m/s2 ends at 2 s; half a second later it speeds up again
    first = 'do = "accelerate", name = "slow", speed = 10.0, acceleration = 5.0'
    then = 'do = "accelerate", when = "ended(lead, slow)", begin = 0.5, speed = 15.0, acceleration = 5.0'
    t, _, _, _, v = way(scene(first, then))
    assert v[np.isclose(t, 2.5)] == pytest.approx(10.0)
    assert v[np.isclose(t, 3.0)] == pytest.approx(12.5)


@pytest.mark.parametrize("step", [0.1, 0.05, 0.02])
def test_law_a_move_begins_where_a_path_ends_whatever_the_step(step):
    path = 'do = "path", name = "p", points = [[160.0, 0.0], [190.5, 0.0]]'
    brakes = 'do = "brake", when = "ended(lead, p)", deceleration = 5.0'
    _, x, _, _, _ = way(scene(path, brakes), step)
    assert x[-1] == pytest.approx(190.5 + 20.0**2 / 10.0, abs=1e-9)


@pytest.mark.parametrize("step", [0.1, 0.05, 0.02])
def test_law_of_two_moves_the_later_replaces_the_earlier_whatever_the_step(step):
    # braked from 2.02 s to 2.05 s to 19.85 m/s, then at 3 m/s2 to 25 m/s: 5.15 / 3 s
    later = 'do = "accelerate", begin = 2.05, speed = 25.0, acceleration = 3.0'
    earlier = 'do = "brake", when = "time > 2.02", deceleration = 5.0'
    _, x, _, _, v = way(scene(later, earlier), step)
    rising = 5.15 / 3.0
    driven = 40.4 + 0.03 * 19.925 + rising * 22.425 + (10.0 - 2.05 - rising) * 25.0
    assert (x[-1], v[-1]) == (pytest.approx(150.0 + driven, abs=1e-9), 25.0)


@pytest.mark.parametrize("step", [0.1, 0.05, 0.02])
def test_law_three_moves_of_which_two_begin_in_one_step_whatever_the_step(step):
    # at 3 m/s2 for 1.02 s, at -5 m/s2 for 0.025 s, then at -4 m/s2 from 22.935 to 5 m/s
    first = 'do = "accelerate", begin = 1.0, speed = 30.0, acceleration = 3.0'
    found_late = 'do = "brake", when = "time > 2.02", deceleration = 5.0'
    last = 'do = "accelerate", begin = 2.045, speed = 5.0, acceleration = 4.0'
    _, x, _, _, _ = way(scene(first, found_late, last), step)
    slowing = 17.935 / 4.0
    driven = 20.0 + 1.02 * 21.53 + 0.025 * 22.9975 + slowing * 13.9675
    driven += (10.0 - 2.045 - slowing) * 5.0
    assert x[-1] == pytest.approx(150.0 + driven, abs=1e-9)


@pytest.mark.parametrize(
    "change, sentence",
    [
        *rows_of("""
when = "gap(ego, leed) < 3" | Did you mean `lead`?
when = "tcc(ego, lead) < 3" | Did you mean `ttc`?
when = "gap(ego, lead)" | must be a condition such as
when = "gap(ego) < 2" | gap(a, b)
when = "gap(ego, ego) < 2" | of two vehicles
when = "min(time) < 3" | given at least 2 values
when = "abs(x(ego), x(lead)) < 3" | given one value
when = "gap(ego, lead) < w" | Unknown name
when = "ended(lead, x)" | Unknown manoeuvre
when = "ended(ego, x)" | the ego has none
when = "lead.x < 2" | which the language does not have
when = "time == 2" | compared with <, <=, > or >=
when = "(time < 1) + 1 > 0" | must be of numbers, names
when = "not ended(lead, x)" | alone or joined by `and`, `or`
when = "time > sqrt(v - 30) or time > 2" | `t` must be a number, got 'nan at v=20'
when = "((" | cannot be read
speed = 3.0 | has no `speed`
do = "accelerate" | must have `speed`
do = "sinus" | must have `acceleration`
do = "sinus", deceleration = 5.0, cycles = 0.5 | must be a multiple of 1
do = "speed_profile", times = [1.0], speeds = [1.0, 2.0] | as many `times`
do = "speed_profile", times = [1.0], places = [9.0], speeds = [1.0] | got 1 and 1 for 1
do = "speed_profile", times = [2.0, 1.0], speeds = [1.0, 2.0] | ascending
do = "path", points = [[10.0, 400.0]] | must be on the map
do = "path", lanes = [7], places = [10.0] | within 0..1
do = "follow" | must have `model`
do = "follow", model = "IDM", begin = 1.0 | follows from the start
do = "follow", model = "IDM", when = "departed > 1" | has `recorded` places
"""),
        ('when = "' + 21 * "(1 + " + "time" + 21 * ")" + ' > 20.5"', "nested too deep"),
        ('when = "1 < time' + 24 * " or time > 9" + '"', "is too long"),
    ],
)
def test_every_mistake_names_the_nearest_word(change, sentence):
    braking = "" if change.startswith("do") else 'do = "brake", deceleration = 5.0, '
    with refused(sentence):
        check_points(scene(braking + change), [[20.0]])


def test_a_vehicle_that_starts_inside_another_is_refused():
    inside = scene('do = "accelerate", speed = 3.0, acceleration = 1.0', more="x = 52.0")
    with refusal("clear of `ego` at the start"):
        check_points(inside, [[20.0]])


def test_a_parameter_that_nothing_depends_on_is_refused():
    unused = table('name = "w", unit = "m", low = 0.0, high = 1.0, step = 0.5')
    lead = table('name = "lead", x = 150.0, speed = 1.0')
    with refusal("Parameter `w` of t must be used"):
        scenario_of(BASE | {"parameter": [*BASE["parameter"], unused], "vehicle": [lead]})


def test_a_stream_is_the_same_every_time_and_denser_than_its_lane_is_refused():
    lane = 'name = "s", lane = 1, begin = -100.0, end = 200.0, speed = "v", speed_spread = 2.0'
    content = {**BASE, "stream": [table(f"{lane}, density = 30.0")]}
    one, two = (scenario_of(content).concrete(v=20.0) for _ in range(2))
    assert repr(one) == repr(two)
    assert len(one.actors) in range(7, 13)  # 300 m at 30 a km, give or take what is drawn
    assert {actor.name for actor in one.actors} >= {"s_1", "s_7"}
    with refusal("spacing_spread` .* must be less than 1, got 1.0"):
        scenario_of({**content, "stream": [table(f"{lane}, density = 30.0, spacing_spread = 1.0")]})
    with refusal("`density` of stream `s` must be at most 100 a km"):
        scenario_of({**content, "stream": [table(f"{lane}, density = 150.0")]}).concrete(v=20.0)


@pytest.mark.campaign
def test_zones_of_a_played_vehicle_are_those_of_the_closed_form_where_there_is_one():
    plain, played = (
        scenario_of({**BASE, "vehicle": [table(keys)], "zone": {"obstacle": "lead"}})
        for keys in (
            'name = "lead", gap = 40.0, speed = 10.0',
            'name = "lead", gap = 40.0, speed = 10.0, heading = 0.0',
        )
    )
    points = np.linspace(10.0, 30.0, 41)[:, None]
    a, b = (criticality(it, points, partition(it).settings).inverse for it in (plain, played))
    np.testing.assert_allclose(b[np.isfinite(a)], a[np.isfinite(a)], rtol=0.02, atol=1e-9)
    assert np.isinf(a).tolist() == np.isinf(b).tolist()


def test_a_searched_zone_has_no_negative_delay():
    """The ego would brake before the lead does anything."""
    zone = {"obstacle": "lead", "delay": "v - 11"}
    early = scene('do = "accelerate", begin = 2.0, speed = 0.0, acceleration = 5.0', zone=zone)
    with refusal("`delay` of the zone of scenario `t` must be at least 0, got -1"):
        criticality(early, np.array([[10.0], [30.0]]), ZoneSettings())


def test_where_no_zone_can_be_defined_everything_is_safe():
    zones = partition(scene('do = "brake", deceleration = 9.0'))
    assert zones.zones == 0
    assert not zones.exactly_hazardous([[10.0], [30.0]]).any()


@pytest.mark.parametrize(
    "when, held",
    values_of("""
    "time > 21", False  # the case lasts 20 s
    "x(ego) > 700", False  # the ego's road ends at 600 m
    "y(ego) > 6 or time * 2 - 30 > 5", True  # from 17.5 s on
    "distance(ego, lead) + 1 < 1", False
    "min(ttc(ego, lead), 3) < 0 and time > 1", False
    "ended(lead, keep)", False  # which lasts for ever
    "ended(lead, b)", False  # this move itself
    "ended(lead, b) or time > 3", True
    "speed(lead) > 50", False  # it keeps its speed, and then brakes
    "speed(lead) > 5", True
    "gap(ego, lead) < -1000", True  # nobody knows
    """),
)
def test_a_condition_that_never_holds_is_refused_before_a_drive(when, held):
    brake = f'do = "brake", name = "b", deceleration = 5.0, when = "{when}"'
    logical = scene('do = "keep_speed", name = "keep"', brake)
    with nullcontext() if held else refusal("can never hold, whatever the ego does"):
        check_points(logical, [[20.0]])


def test_two_moves_that_wait_for_each_others_end_are_refused():
    one = 'do = "brake", name = "a", deceleration = 5.0, when = "ended(lead, b){}"'.format
    two = 'do = "accelerate", name = "b", speed = 9.0, acceleration = 1.0, when = "ended(lead, a)"'
    check_points(scene(one(" or time > 3"), two), [[20.0]])
    with refusal("can never hold, whatever the ego does"):
        check_points(scene(one(""), two), [[20.0]])


@pytest.mark.parametrize("kind", [played.KEEP, played.FOLLOW, played.MATCH])
def test_no_move_begins_at_the_end_of_an_endless_one(kind):
    waiting = Act(played.SPEED, program=((played.ENDED, 0, 0, 0.0),))
    concrete = scene().concrete(v=20.0)
    actor = replace(concrete.actors[0], acts=(Act(kind), waiting))
    assert never_begin(replace(concrete, actors=(actor,)), 20.0) == [(actor, 1)]


def test_keep_speed_ends_a_brake_and_counts_in_conditions():
    brake = 'do = "brake", name = "b", deceleration = 2.0'
    speeds = way(scene(brake, 'do = "keep_speed", begin = 2.0'))[4]
    assert speeds[-1] == 16.0  # 20 m/s less 2 s of 2 m/s2
    lead = 'name = "lead", x = 150.0, speed = 20.0, manoeuvre = [{}]'.format
    shift = (
        '{ do = "keep_speed" }, { do = "change_lane", duration = 2.0, offset = 3.5, name = "c" }'
    )
    follower = (
        'name = "other", x = 90.0, y = 3.5, speed = 10.0, manoeuvre = [{ do = "brake", '
        'deceleration = 5.0, when = "ended(lead, c)" }]'
    )
    both = scenario_of({**BASE, "vehicle": [table(lead(shift)), table(follower)]})
    assert drive(both).begins[0].tolist() == [0.0, 2.0]
    endless = table(lead('{ do = "follow", model = "IDM", name = "c" }'))
    with refusal("Unknown manoeuvre `c`"):  # it never ends
        scenario_of({**BASE, "vehicle": [endless, table(follower)]})
    later = table(lead('{ do = "follow", model = "IDM", name = "c", when = "time > 1" }'))
    with refusal("can never hold, whatever the ego does"):
        check_points(scenario_of({**BASE, "vehicle": [later, table(follower)]}), [[20.0]])


@pytest.mark.parametrize("step", [0.05, 0.5])
def test_the_end_of_a_move_shorter_than_a_step_begins_the_next(step):
    # at x(ego) > 70.4, after 1.02 s, a change of 0.03 m/s at 3 m/s2: it takes 0.01 s
    short = (
        'name = "lead", x = 150.0, speed = 20.0, manoeuvre = [{ do = "accelerate", name = "a", '
        'speed = 20.03, acceleration = 3.0, when = "x(ego) > 70.4" }]'
    )
    follower = (
        'name = "{}", x = {}, speed = 10.0, manoeuvre = [{{ do = "accelerate", name = "a", '
        'speed = 10.03, acceleration = 3.0, when = "ended({}, a)" }}]'
    ).format
    chain = [follower("first", 90.0, "second"), follower("second", 60.0, "lead"), short]
    logical = scenario_of({**BASE, "vehicle": [*map(table, chain)]})
    assert drive(logical, step).begins[0] == pytest.approx([1.04, 1.03, 1.02])


def test_an_ego_that_starts_sideways_drives_on_so_where_conditions_ask():
    # 20 m/s, 2 of them to the left: the lateral place 3 m is reached after 1.5 s
    sideways = scenario_of(BASE | tomllib.loads("""
ego = { speed = "v", lateral_speed = 2.0 }
[[vehicle]]
name = "lead"
x = 150.0
speed = 20.0
manoeuvre = [{ do = "brake", deceleration = 5.0, when = "y(ego) > 3" }]
[[vehicle]]
name = "next"
x = 200.0
speed = 20.0
manoeuvre = [{ do = "brake", deceleration = 5.0, when = "x(ego) > 119" }]
"""))  # fmt: skip
    along = math.sqrt(20.0**2 - 2.0**2)
    found = drive(sideways).begins[0].tolist()
    assert found == pytest.approx([1.5, 69.0 / along], abs=1e-9)


def test_a_margin_is_the_zone_to_the_last_digit_and_says_all():
    zone = {"margin": "20.3 - v"}
    logical = scene(zone=zone)
    points = np.array([[10.0], [20.3], [20.30001], [30.0]])
    assert partition(logical).exactly_hazardous(points).tolist() == [False, True, True, True]
    assert partition(logical).most_dangerous[0] == {"v": 30.0}
    for key, value in (("obstacle", "lead"), ("conflict", True)):
        with refusal(f"has no `{key}` beside `margin`"):
            scene(zone={**zone, key: value})
    with refusal("must have an `obstacle`, or a `margin`"):
        scene(zone={})
