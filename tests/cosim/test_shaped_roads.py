"""Driving where lanes open and end: the way of an ego, the end of its lane, merging, missing an
exit."""

import math
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

from sumo_eval import Command
from sumo_eval.cosim.doors.features import Action, Feature, Interface
from sumo_eval.cosim.simulation import simulate, simulate_many
from sumo_eval.cosim.sumo.sumo_files import network_xml
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.road.reference_line import arc, map_places

SPEEDS = {"ego_speed": 24.0, "other_speed": 24.0}
POINTS = {
    "ramp_merge": {**SPEEDS, "offset": 15.0, "other_acceleration": -2.0},
    "lane_drop": {**SPEEDS, "offset": -15.0, "other_acceleration": 0.0},
    "exit": {**SPEEDS, "gap": 35.0, "other_acceleration": -2.0},
}
CROSSED = {"crossing_path": {"ego_speed": 14.0, "other_speed": 10.0, "arrival": 1.0}}


def case(name, **changes):
    return catalogue.load(name).concrete(**{**(POINTS | CROSSED)[name], **changes})


def clips(found):
    return {clip.what for clip in found.clips}


class Straight:
    """Keeps its lane and its speed, and remembers what it was told."""

    def act(self, seen):
        if seen.time == 0.0:
            self.told = seen.goal, seen.change, [line.centre for line in seen.lane_borders]
        self.edges = (*getattr(self, "edges", ()), round(seen.ego.y - seen.right_edge, 3))
        return Command(0.0, 0.0)


def test_an_ego_that_stays_in_a_lane_that_ends_leaves_the_road_where_its_centre_crosses_the_edge():
    ads = Straight()
    found = simulate(case("ramp_merge", offset=60.0), ads)
    # the edge moves from y = -1.75 m at 660 m to 1.75 m at 720 m: it is at 0 at 690 m; 24 m/s and
    # 0.05 s are 1.2 m
    assert found.end_reason == "off_road"
    assert 690.0 < found.ego.x[-1] <= 691.2
    assert "goal_missed" in clips(found)
    lanes = [((0.0, 0.0), (660.0, 0.0)), ((0.0, 3.5), (3000.0, 3.5)), ((0.0, 7.0), (3000.0, 7.0))]
    assert ads.told == ((1000.0, 3.5), (440.0, 660.0), lanes)
    assert (ads.edges[0], min(ads.edges) < 0.0 < ads.edges[-1] + 0.2) == (-1.75, True)


def hold(traci, ego, time):
    """Keep its lane and its speed by TraCI; SUMO's route leads to the goal."""
    traci.vehicle.setSpeed(ego, 24.0)


@pytest.mark.parametrize("name", ["ramp_merge", "lane_drop"])
def test_a_hook_that_stays_in_a_lane_that_ends_leaves_the_road(name):
    found = simulate(case(name), hold)
    # SUMO has no taper: the front bumper gets to x = 660 m within the next step of 1.2 m
    assert found.end_reason == "off_road"
    assert 658.8 < found.ego.x[-1] + 2.25 <= 660.0


def test_law_arrays_of_policies_have_the_edges_of_others():
    wanted = Interface((Feature("left_edge"), Feature("right_edge")), (Action("acceleration"),))
    shown = [[], []]

    class Arrays:
        batch = True

        def act(self, seen):
            shown[0] += wanted.show(seen)[0].tolist()
            return np.zeros(1)

    def single(seen):
        shown[1] += [seen.left_edge, seen.right_edge]
        return 0.0

    for policy in (Arrays(), single):
        simulate(case("exit"), policy)
    assert shown[0] == pytest.approx(shown[1], abs=1e-5)
    assert len(set(shown[1])) > 2


@pytest.mark.parametrize("ads", [Straight(), hold])
def test_missing_an_exit_is_reported_by_the_case(ads):
    found = simulate(case("exit"), ads)
    assert (found.end_reason, clips(found) & {"goal_missed"}) == ("road_end", {"goal_missed"})


def test_law_whose_rule_is_for_the_pedals_changes_lanes_on_the_fixed_way():
    concrete = case("ramp_merge", offset=60.0, other_speed=28.0, other_acceleration=2.0)
    found = simulate(concrete, "no_reaction")
    assert np.abs(found.ego.y - concrete.ego.y_at(found.ego.x)).max() < 0.03
    assert found.ego.y[-1] == pytest.approx(3.5, abs=1e-3)
    assert np.all(found.ego.speed == 24.0)
    assert found.end_reason == "road_end"


@pytest.mark.parametrize("name", sorted(POINTS))
@pytest.mark.parametrize("ads", ["idm", "lane_changer"])
def test_who_chooses_a_gap_reaches_its_goal_without_a_touch(name, ads):
    concrete = case(name)
    found = simulate(concrete, ads)
    assert (found.collision, "goal_missed" in clips(found)) == (None, False)
    assert found.ego.y[-1] == pytest.approx(concrete.ego.y + concrete.ego.way.offset, abs=0.02)
    assert found.ego.acceleration.min() > -4.0


def test_who_finds_no_gap_waits_before_the_end_of_its_lane():
    concrete = case(
        "ramp_merge", offset=0.0, other_acceleration=0.0, ego_speed=16.0, other_speed=16.0
    )
    wall = [replace(concrete.actors[0], name=f"other_{k}",
        start=replace(concrete.actors[0].start, x=60.0 + 18.0 * k))
            for k in range(40)]  # fmt: skip
    found = simulate(replace(concrete, actors=tuple(wall), time_limit=32.0), "idm")
    assert found.collision is None
    assert found.ego.x.max() + 2.25 <= 660.0 - 20.0 + 0.1  # 20 m before the end, a shortest change
    assert np.abs(found.ego.y).max() < 0.01
    assert found.ego.speed[-1] < 1.0


def test_law_a_case_on_such_a_road_has_the_bits_alone_that_it_has_in_company():
    cases = [case("ramp_merge", offset=offset) for offset in (-30.0, 15.0, 60.0)]
    together = list(simulate_many(cases, "idm"))
    for concrete, packed in zip(cases, together, strict=True):
        assert packed.same_drive(simulate(concrete, "idm"))


def test_a_model_of_sumos_takes_the_exit_that_its_route_leads_to():
    found = simulate(case("exit", gap=65.0, other_acceleration=0.0), "sumo:IDM")
    assert (found.collision, found.end_reason, found.error) == (None, "road_end", None)
    assert found.ego.y[-1] == pytest.approx(0.0, abs=1e-6)


def bent(concrete, radius):
    """The case where the road bends from its beginning on."""
    return replace(
        concrete, road=replace(concrete.road, name=f"bend_{radius:g}", line=(arc(900.0, radius),))
    )


@pytest.mark.parametrize("name", sorted(POINTS | CROSSED))
def test_law_shapes_on_a_wide_curve_are_those_on_a_straight_road(name):
    straight, wide = (simulate(it, "idm") for it in (case(name), bent(case(name), 1e9)))
    assert straight.end_reason == wide.end_reason
    assert len(straight.ego) == len(wide.ego)
    for channel in ("x", "y", "heading", "speed"):
        assert np.abs(getattr(straight.ego, channel) - getattr(wide.ego, channel)).max() < 1e-4, (
            channel
        )


@pytest.mark.parametrize("radius", [250.0, -250.0])
def test_on_a_curve_a_lane_change_reaches_the_goal_in_the_frame(radius):
    merges = simulate(bent(case("ramp_merge"), radius), "idm")
    assert (merges.collision, merges.end_reason) == (None, "road_end")
    assert "goal_missed" not in clips(merges)
    assert merges.ego.y[-1] == pytest.approx(3.5, abs=0.05)
    pedals = bent(case("ramp_merge", offset=60.0, other_speed=28.0, other_acceleration=2.0), radius)
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
    flat = case("crossing_path", arrival=0.2)
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
    net = etree.fromstring(network_xml(bent(case("crossing_path"), 250.0).road).encode())
    lane = net.find("edge[@id='crossing0']/lane")
    ends = np.array([place.split(",") for place in lane.get("shape").split()], dtype=float)
    assert sorted(np.hypot(ends[:, 0], ends[:, 1] - 250.0)) == pytest.approx(
        [120.0, 380.0], abs=1e-3
    )
    west, south, east, north = map(float, net.find("location").get("convBoundary").split(","))
    inside = [west, south] <= ends + 0.01, ends <= np.array([east, north]) + 0.01
    assert np.all(inside)
