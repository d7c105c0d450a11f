"""Roads that bend, through SUMO: a bend changes nothing but what it must."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cosim_cases import ROAD, case, lead

from sumo_eval import Command
from sumo_eval.cosim.simulation import simulate
from sumo_eval.scenario import Actor, Start, constant_lateral, lane_change
from sumo_eval.scenario.concrete import brake_to_stop
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
        assert (bent.end_reason, bent.error) == (straight.end_reason, None)
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
    found = simulate(
        on(bend(500.0), case(slow)), "lane_changer", SimulationSettings(time_limit=20.0)
    )
    assert (found.error, found.collision) == (None, None)
    assert found.ego.y[-1] == pytest.approx(3.5, abs=0.05)


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
    assert (found.error, [clip.what for clip in found.clips]) == (None, ["jump"])
    assert found.ego.y[-1] > 1.75


def test_a_rear_end_on_a_curve_is_evaluated_on_the_map():
    """On R = 100 m bodies 4.55 m apart are turned by 0.0455 rad, and the ego leans out by atan(1.35
    / 100) more."""
    found = simulate(
        on(bend(100.0), case(lead(20.0, 5.0), speed=15.0, x=10.0)), "no_reaction", SHORT
    )
    hit = found.collision
    assert (hit.other, hit.side) == ("lead", "front")
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
    found = simulate(
        on(bend(250.0), case(lead(40.0, 15.0))), ads, SimulationSettings(time_limit=15.0)
    )
    assert found.error is None
    assert np.abs(found.ego.y).max() < 0.02  # the chord between its bumpers
    assert np.abs(found.ego.heading).max() < 0.012
    assert found.collision is None


@pytest.mark.parametrize("road, apart", [(ROAD, 1e-6), (bend(250.0), 0.03)])
def test_a_shipped_rule_asked_through_traci_drives_the_same(road, apart):
    from sumo_eval.ads.car_following import Idm

    class Mine(Idm):
        def step(self, traci, ego, time):  # type: ignore[no-untyped-def]
            return super().step(traci, ego, time)

    concrete = on(road, case(lead(40.0, 15.0)))
    plain, mine = simulate(concrete, "idm", SHORT), simulate(concrete, Mine, SHORT)
    assert (mine.error, mine.end_reason) == (None, plain.end_reason)
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
