"""Roads that bend, through SUMO: a bend changes nothing but what it must."""

import math
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree
from road_scenes import (
    ROAD,
    Watches,
    assert_as_alone,
    assert_last,
    at_values,
    case,
    clear_drive,
    clips_of,
    lead,
)

from sumo_eval import Command
from sumo_eval.cosim import simulate, simulate_many
from sumo_eval.cosim.doors.features import Action, Feature, Interface
from sumo_eval.cosim.sumo.sumo_files import network_xml
from sumo_eval.scenario import Actor, Start, brake_to_stop, constant_lateral, lane_change
from sumo_eval.scenario.road.lanes import LaneSpan
from sumo_eval.scenario.road.reference_line import Piece, arc, map_places
from sumo_eval.settings import SimulationSettings
from sumo_eval.trajectory import CHANNELS

SHORT = SimulationSettings(time_limit=8.0)
HALF_WHEELBASE = 0.5 * SHORT.vehicle.wheelbase


def bend(radius, length=1000.0):
    return replace(ROAD, name=f"bend_{radius:g}", run_out=900.0, line=(arc(length, radius),))


def on(road, concrete):
    return replace(concrete, road=road)


CUT_IN = case(Actor("other", Start(79.5, 3.5, 15.0), (constant_lateral(0.5, 1.0, -3.5),)))
BRAKING = case(replace(lead(30.0, 20.0), acts=(brake_to_stop(1.0, 6.0, 10.0),)))
CHANGING = case(Actor("other", Start(90.0, 0.0, 14.0), (lane_change(1.0, 3.0, 3.5),)))


def vehicles(recording):
    return [recording.ego, *recording.actors.values()]


def channels(recording):
    found = [np.stack([getattr(it, name) for name in CHANNELS]) for it in vehicles(recording)]
    return np.nan_to_num(np.concatenate(found, axis=1))


@pytest.mark.parametrize(
    "ads", ["idm", "careful_driver", "ideal_braking", "no_reaction", "reg157", "fsm", "rss"]
)
def test_law_on_a_radius_of_a_thousand_kilometres_all_is_as_on_the_straight(ads):
    """The rear axle is on the line; half a wheelbase ahead the centre is l^2 / (2 R) = 9e-7 m
    outside it. That decides when a lead has left the lane, up to 1e-6 s earlier or later, and rules
    that switch then show it.
    A contact is earlier by the 5e-6 m that turned corners reach further, over the closing speed.
    """
    for concrete, tolerance in ((CUT_IN, 1e-6), (BRAKING, 1e-6), (CHANGING, 1e-4)):
        straight, bent = (
            simulate(concrete, ads, SHORT),
            simulate(on(bend(1e6), concrete), ads, SHORT),
        )
        assert bent.error is None
        assert bent.end_reason == straight.end_reason
        driven = slice(-1 if straight.collision is not None else None)
        for before, after in zip(vehicles(straight), vehicles(bent), strict=True):
            assert np.abs(before.x - after.x)[driven].max() < tolerance
            assert np.abs(before.y - after.y)[driven].max() < tolerance
        if straight.collision is not None and bent.collision is not None:
            assert bent.collision.time == pytest.approx(straight.collision.time, abs=2e-6)
            assert bent.collision.relative_speed == pytest.approx(
                straight.collision.relative_speed, abs=1e-4
            )
            assert bent.collision.overlap == pytest.approx(straight.collision.overlap, abs=1e-4)


@pytest.mark.parametrize("radius", [250.0, -250.0, 60.0])
def test_law_an_ego_that_keeps_its_lane_drives_the_circle_of_the_closed_form(radius):
    """At constant speed the rear axle is on the circle, half a wheelbase before it the centre on
    one of the radius sqrt(R^2 + l^2), and both turn by v / R a second.
    """
    speed = 12.0
    concrete = on(bend(radius), case(lead(900.0, 30.0), speed=speed, x=1.0))
    ego = simulate(concrete, "no_reaction", SimulationSettings(time_limit=30.0)).ego
    settled = ego.time > 20.0
    outside = abs(radius) - math.hypot(radius, HALF_WHEELBASE)
    assert np.abs(ego.y[settled] - math.copysign(1.0, radius) * outside).max() < 1e-6
    assert np.abs(ego.heading[settled] + math.atan(HALF_WHEELBASE / radius)).max() < 1e-7
    driven = ego.x[settled] - ego.x[settled][0] - speed * (ego.time[settled] - ego.time[settled][0])
    assert np.abs(driven).max() < 1e-5
    x, y, _ = map_places(concrete.road.line, ego.x[settled], ego.y[settled], ego.heading[settled])
    assert np.abs(np.hypot(x, y - radius) - math.hypot(radius, HALF_WHEELBASE)).max() < 1e-6
    wheel = SHORT.vehicle.steering_ratio * math.atan(SHORT.vehicle.wheelbase / radius)
    assert np.abs(ego.steering_wheel_angle[settled] - wheel).max() < 1e-6


def test_over_a_spiral_into_a_curve_and_out_the_lane_is_kept():
    line = (Piece(60.0), Piece(60.0, 0.0, 1 / 200), arc(100.0, 200.0), Piece(60.0, 1 / 200, 0.0))
    concrete = on(
        replace(ROAD, name="spirals", run_out=900.0, line=line),
        case(lead(500.0, 30.0), speed=18.0, x=10.0),
    )
    found = simulate(concrete, "idm", SimulationSettings(time_limit=25.0))
    assert found.error is None
    assert np.abs(found.ego.y).max() < 0.02


def test_a_lane_changer_arrives_in_the_left_lane_of_a_curve():
    slow = Actor("slow", Start(110.0, 0.0, 10.0))
    found = clear_drive(
        on(bend(500.0), case(slow)), "lane_changer", SimulationSettings(time_limit=20.0)
    )
    assert_last(found, 0.05, y=3.5)


@pytest.mark.parametrize("spans", [(), (LaneSpan(2, end=1400.0),)])
def test_law_sumo_may_shift_an_ego_only_where_it_changes_lane(spans):
    """Each lane is stretched evenly, so at s m the left one is shown s 3.5 / R (1 - L / 1500) m
    further back, with L = 1000 m of 1500 m curved."""

    def changes(traci, ego, time):
        if time == 0.0:
            traci.vehicle.changeLane(ego, 1, 2.0)
        traci.vehicle.setSpeed(ego, max(traci.vehicle.getSpeed(ego) - 0.05, 0.2))

    road = replace(bend(250.0), lanes=3, spans=spans)
    found = simulate(on(road, case(speed=4.0)), changes, SHORT)
    assert found.error is None
    assert [clip.what for clip in found.clips] == ["jump"]
    assert found.ego.y[-1] > 1.75


def test_a_rear_end_on_a_curve_is_evaluated_on_the_map():
    """On R = 100 m bodies 4.55 m apart are turned by 0.0455 rad, and the ego leans out by atan(1.35
    / 100) more."""
    found = simulate(
        on(bend(100.0), case(lead(20.0, 5.0), speed=15.0, x=10.0)), "no_reaction", SHORT
    )
    hit = found.collision
    assert hit.other == "lead"
    assert hit.side == "front"
    turned = 0.0455 + math.atan(HALF_WHEELBASE / 100.0)
    assert hit.other_pose[2] - hit.ego_pose[2] == pytest.approx(turned, abs=1e-3)
    relative = math.hypot(15.0 - 5.0 * math.cos(turned), 5.0 * math.sin(turned))
    assert hit.relative_speed == pytest.approx(relative, abs=0.01)
    # the corners inside the bend meet first, 0.9 m from the line: half a width times the angle
    # before the centres would
    assert 0.0 < found.actors["lead"].x[-1] - found.ego.x[-1] - 4.5 < 0.9 * turned + 0.01


class StraightOn:
    """A policy that leaves the wheel alone."""

    def act(self, scene):
        """No command."""
        return Command(0.0, 0.0)


def test_an_ego_that_does_not_steer_leaves_the_road_where_the_tangent_does():
    """On R = 250 m the right edge is sqrt(251.75^2 - 250^2) = 29.63 m along the tangent; an ego
    that leans out of the bend by 1.35 / 250 to begin with is there after 28.3 m.
    """
    found = simulate(on(bend(250.0), case(lead(100.0, 30.0), x=3.0, speed=20.0)), StraightOn, SHORT)
    assert found.end_reason == "off_road"
    assert 28.2 < 20.0 * found.ego.time[-1] < 29.7 + 20.0 * SHORT.step
    assert -1.75 - 0.15 < found.ego.y[-1] < -1.75


def test_what_an_ads_sees_of_a_curve():
    seen = []

    class Looks:
        def act(self, scene):
            lines = scene.lane_lines(ahead=50.0, every=10.0)
            seen.append((scene.curvature, lines, scene.plain()["curvature"], scene.ego))
            return Command(0.0, 0.0)

    simulate(
        on(bend(-100.0), case(lead(100.0, 30.0), x=10.0)), Looks, SimulationSettings(time_limit=0.1)
    )
    curvature, (right, left), plain, ego = seen[0]
    assert curvature == plain == -0.01
    s = np.arange(0.0, 51.0, 10.0)
    # in the road's axes there
    ahead, beside = 100.0 * np.sin(s / 100.0), 100.0 * np.cos(s / 100.0) - 100.0 - ego.y
    c, n = math.cos(ego.heading), math.sin(ego.heading)
    assert np.allclose(
        right, np.stack([ahead * c + beside * n, beside * c - ahead * n], 1), atol=1e-9
    )
    assert np.allclose(left[0] - right[0], (3.5 * n, 3.5 * c), atol=1e-9)


@pytest.mark.parametrize("ads", ["sumo:IDM", "sumo:Krauss"])
def test_a_model_of_sumos_follows_a_curve(ads):
    found = clear_drive(
        on(bend(250.0), case(lead(40.0, 15.0))), ads, SimulationSettings(time_limit=15.0)
    )
    assert np.abs(found.ego.y).max() < 0.02  # the chord between its bumpers
    assert np.abs(found.ego.heading).max() < 0.012


@pytest.mark.parametrize("road, apart", [(ROAD, 1e-6), (bend(250.0), 0.03)])
def test_a_shipped_rule_asked_through_traci_drives_the_same(road, apart):
    from sumo_eval.ads.car_following import Idm

    class Mine(Idm):
        def step(self, traci, ego, time):  # type: ignore[no-untyped-def]
            return super().step(traci, ego, time)

    concrete = on(road, case(lead(40.0, 15.0)))
    plain, mine = simulate(concrete, "idm", SHORT), simulate(concrete, Mine, SHORT)
    assert mine.error is None
    assert mine.end_reason == plain.end_reason
    # SUMO has no wheel to begin with
    assert np.abs(channels(plain)[1:3] - channels(mine)[1:3]).max() < apart


def test_an_ego_may_begin_sideways():
    """asin(0.6 / 20) = 0.030005 rad to the left; the lane is kept after that."""
    concrete = case(lead(500.0, 30.0), speed=20.0)
    concrete = replace(concrete, ego=Start(50.0, 0.0, 20.0, 0.6))
    for road in (ROAD, bend(500.0)):
        ego = simulate(on(road, concrete), "idm", SHORT).ego
        leans = math.atan(HALF_WHEELBASE / 500.0) if road.bent else 0.0
        assert ego.heading[0] == pytest.approx(math.asin(0.03) - leans)
        assert 0.1 < ego.y.max() < 0.6
        assert abs(ego.y[-1]) < 0.01
        quick = replace(SHORT, step=0.02)
        assert simulate(on(road, concrete), lambda *_: None, quick).error is None


# --- where lanes open and end ---------------------------------------------------------------------


SPEEDS = {"ego_speed": 24.0, "other_speed": 24.0}
POINTS = {
    "ramp_merge": {**SPEEDS, "offset": 15.0, "other_acceleration": -2.0},
    "lane_drop": {**SPEEDS, "offset": -15.0, "other_acceleration": 0.0},
    "exit": {**SPEEDS, "gap": 35.0, "other_acceleration": -2.0},
}
CROSSED = {"crossing_path": {"ego_speed": 14.0, "other_speed": 10.0, "arrival": 1.0}}


def scene(name, **changes):
    return at_values(name, **{**(POINTS | CROSSED)[name], **changes})


class Straight:
    """Keeps its lane and its speed, and remembers what it was told."""

    def act(self, seen):
        if seen.time == 0.0:
            self.told = seen.goal, seen.change, [line.centre for line in seen.lane_borders]
        self.edges = (*getattr(self, "edges", ()), round(seen.ego.y - seen.right_edge, 3))
        return Command(0.0, 0.0)


def test_an_ego_that_stays_in_a_lane_that_ends_leaves_the_road_where_its_centre_crosses_the_edge():
    ads = Straight()
    found = simulate(scene("ramp_merge", offset=60.0), ads)
    # the edge moves from y = -1.75 m at 660 m to 1.75 m at 720 m: it is at 0 at 690 m; 24 m/s and
    # 0.05 s are 1.2 m
    assert found.end_reason == "off_road"
    assert 690.0 < found.ego.x[-1] <= 691.2
    assert "goal_missed" in clips_of(found)
    lanes = [((0.0, 0.0), (660.0, 0.0)), ((0.0, 3.5), (3000.0, 3.5)), ((0.0, 7.0), (3000.0, 7.0))]
    assert ads.told == ((1000.0, 3.5), (440.0, 660.0), lanes)
    assert (ads.edges[0], min(ads.edges) < 0.0 < ads.edges[-1] + 0.2) == (-1.75, True)


def hold(traci, ego, time):
    """Keep its lane and its speed by TraCI; SUMO's route leads to the goal."""
    traci.vehicle.setSpeed(ego, 24.0)


@pytest.mark.parametrize("name", ["ramp_merge", "lane_drop"])
def test_a_hook_that_stays_in_a_lane_that_ends_leaves_the_road(name):
    found = simulate(scene(name), hold)
    # SUMO has no taper: the front bumper gets to x = 660 m within the next step of 1.2 m
    assert found.end_reason == "off_road"
    assert 658.8 < found.ego.x[-1] + 2.25 <= 660.0


def on_the_taper(traci, ego, time):
    """Keep its lane by commands, and let SUMO drive from 10 m behind the lane's end on."""
    return Command(0.0) if traci.vehicle.getPosition(ego)[0] < 670.0 else None


def test_a_hook_that_lets_sumo_drive_where_it_has_no_lane_leaves_the_road():
    found = simulate(scene("ramp_merge"), on_the_taper)
    assert (found.end_reason, found.error) == ("off_road", None)
    assert 670.0 <= found.ego.x[-1] + 2.25 < 671.2


def test_law_arrays_of_policies_have_the_edges_of_others():
    wanted = Interface((Feature("left_edge"), Feature("right_edge")), (Action("acceleration"),))
    arrays, edges = Watches(lambda seen: wanted.show(seen)[0]), []

    def single(seen):
        edges.append([seen.left_edge, seen.right_edge])
        return 0.0

    for policy in (arrays, single):
        simulate(scene("exit"), policy)
    np.testing.assert_allclose(arrays.shown, edges, rtol=0, atol=1e-5)
    assert len(np.unique(edges)) > 2


@pytest.mark.parametrize("ads", [Straight(), hold])
def test_missing_an_exit_is_reported_by_the_case(ads):
    found = simulate(scene("exit"), ads)
    assert (found.end_reason, "goal_missed" in clips_of(found)) == ("road_end", True)


def test_law_whose_rule_is_for_the_pedals_changes_lanes_on_the_fixed_way():
    concrete = scene("ramp_merge", offset=60.0, other_speed=28.0, other_acceleration=2.0)
    found = simulate(concrete, "no_reaction")
    assert np.abs(found.ego.y - concrete.ego.y_at(found.ego.x)).max() < 0.03
    assert_last(found, 1e-3, y=3.5)
    assert np.all(found.ego.speed == 24.0)
    assert found.end_reason == "road_end"


@pytest.mark.parametrize("name", sorted(POINTS))
@pytest.mark.parametrize("ads", ["idm", "lane_changer"])
def test_who_chooses_a_gap_reaches_its_goal_without_a_touch(name, ads):
    concrete = scene(name)
    found = simulate(concrete, ads)
    assert (found.collision, "goal_missed" in clips_of(found)) == (None, False)
    assert_last(found, 0.02, y=concrete.ego.y + concrete.ego.way.offset)
    assert found.ego.acceleration.min() > -4.0


def test_who_finds_no_gap_waits_before_the_end_of_its_lane():
    concrete = scene(
        "ramp_merge", offset=0.0, other_acceleration=0.0, ego_speed=16.0, other_speed=16.0
    )
    wall = [replace(concrete.actors[0], name=f"other_{k}",
        start=replace(concrete.actors[0].start, x=60.0 + 18.0 * k))
            for k in range(40)]  # fmt: skip
    found = clear_drive(replace(concrete, actors=tuple(wall), time_limit=32.0), "idm")
    assert found.ego.x.max() + 2.25 <= 660.0 - 20.0 + 0.1  # 20 m before the end, a shortest change
    assert np.abs(found.ego.y).max() < 0.01
    assert found.ego.speed[-1] < 1.0


def test_law_a_case_on_such_a_road_has_the_bits_alone_that_it_has_in_company():
    cases = [scene("ramp_merge", offset=offset) for offset in (-30.0, 15.0, 60.0)]
    assert_as_alone(cases, simulate_many(cases, "idm"), "idm")


def test_a_model_of_sumos_takes_the_exit_that_its_route_leads_to():
    found = clear_drive(scene("exit", gap=65.0, other_acceleration=0.0), "sumo:IDM")
    assert found.end_reason == "road_end"
    assert_last(found, 1e-6, y=0.0)


def bent(concrete, radius):
    """The case where the road bends from its beginning on."""
    return replace(
        concrete, road=replace(concrete.road, name=f"bend_{radius:g}", line=(arc(900.0, radius),))
    )


@pytest.mark.parametrize("name", sorted(POINTS | CROSSED))
def test_law_shapes_on_a_wide_curve_are_those_on_a_straight_road(name):
    straight, wide = (simulate(it, "idm") for it in (scene(name), bent(scene(name), 1e9)))
    assert straight.end_reason == wide.end_reason
    assert len(straight.ego) == len(wide.ego)
    for channel in ("x", "y", "heading", "speed"):
        assert np.abs(getattr(straight.ego, channel) - getattr(wide.ego, channel)).max() < 1e-4, (
            channel
        )


@pytest.mark.parametrize("radius", [250.0, -250.0])
def test_on_a_curve_a_lane_change_reaches_the_goal_in_the_frame(radius):
    merges = clear_drive(bent(scene("ramp_merge"), radius), "idm")
    assert merges.end_reason == "road_end"
    assert "goal_missed" not in clips_of(merges)
    assert_last(merges, 0.05, y=3.5)
    pedals = bent(
        scene("ramp_merge", offset=60.0, other_speed=28.0, other_acceleration=2.0), radius
    )
    found = simulate(pedals, "no_reaction")
    assert found.end_reason == "road_end"
    assert np.abs(found.ego.y - pedals.ego.y_at(found.ego.x)).max() < 0.05


@pytest.mark.parametrize("radius", [250.0, -250.0])
def test_a_road_crosses_a_curve_straight_through_its_centre(radius):
    """At x = 300 m of an arc from the beginning on, the bend's centre is (0, R) and everything at
    that x on one line through it. Who drives along the crossing at 10 m/s covers that of it on the
    map, SUMO shows him there (or the case would be a `sim_error`), and an ego that does nothing is
    struck where it would be on a straight road, to the bodies' corners: (half a width) / R of their
    lengths."""
    flat = scene("crossing_path", arrival=0.2)
    concrete = bent(flat, radius)
    found, straight = simulate(concrete, "no_reaction"), simulate(flat, "no_reaction")
    assert found.error is None
    other = found.actors["other"]
    east, north, _ = map_places(concrete.road.line, other.x, other.y)
    turned = np.arctan2(east, (radius - north) * np.sign(radius))
    assert turned == pytest.approx(np.full(len(other), 300.0 / 250.0), abs=1e-9)
    assert np.hypot(np.diff(east), np.diff(north)) == pytest.approx(
        10.0 * np.diff(other.time), abs=1e-9
    )
    assert found.collision.other == "other"
    assert found.collision.time == pytest.approx(straight.collision.time, abs=0.01)
    # so far the road still turns, and the ego leans out by atan(1.35 / R), until it would stand
    # square to the other
    askew = (300.0 - found.ego.x[-1]) / radius + math.atan(1.35 / radius)
    meets = math.sqrt(14.0**2 + 10.0**2 + 2.0 * 14.0 * 10.0 * math.sin(askew))
    assert found.collision.relative_speed == pytest.approx(meets, abs=0.01)


def test_the_network_of_a_curve_has_the_road_that_crosses_it():
    """Its lane ends 130 m to both sides of the line: 250 - 130 and 250 + 130 m from the centre (0,
    250) of the bend."""
    net = etree.fromstring(network_xml(bent(scene("crossing_path"), 250.0).road).encode())
    lane = net.find("edge[@id='crossing0']/lane")
    ends = np.array([place.split(",") for place in lane.get("shape").split()], dtype=float)
    assert sorted(np.hypot(ends[:, 0], ends[:, 1] - 250.0)) == pytest.approx(
        [120.0, 380.0], abs=1e-3
    )
    west, south, east, north = map(float, net.find("location").get("convBoundary").split(","))
    inside = [west, south] <= ends + 0.01, ends <= np.array([east, north]) + 0.01
    assert np.all(inside)
