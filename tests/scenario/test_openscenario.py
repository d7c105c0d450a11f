"""OpenSCENARIO files as logical scenarios: worked numbers, what is refused, and the public
catalogues."""

import math
import re
import tomllib
from contextlib import nullcontext
from dataclasses import astuple, replace

import numpy as np
import pytest
from commands import cli_refuses, sumo_eval
from loaded import SHARED
from lxml import etree
from refusals import refusal
from road_scenes import clear_drive
from scipy.integrate import cumulative_trapezoid
from tables import rows_of, values_of

from sumo_eval.cosim import Command, simulate
from sumo_eval.errors import InputError
from sumo_eval.extras.openscenario import describe, reading
from sumo_eval.extras.openscenario.collections import uses_of
from sumo_eval.extras.openscenario.conformity import ROWS
from sumo_eval.extras.openscenario.describe import described, listed
from sumo_eval.extras.openscenario.logical import concrete, concrete_points, read_file
from sumo_eval.extras.openscenario.moves import synchronized
from sumo_eval.extras.openscenario.reading import Node
from sumo_eval.extras.openscenario.written import scenario_content, write_scenario
from sumo_eval.scenario import lane_change, motion, played
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.road.reference_line import Piece, map_places
from sumo_eval.scenario.undisturbed import tracks
from sumo_eval.settings import SimulationSettings
from sumo_eval.whatif.levers import levers_of

CATALOGUES = SHARED / "catalogues"
ALKS = CATALOGUES / "osc_alks" / "logical_scenarios"
NCAP = (
    CATALOGUES
    / "osc_ncap"
    / "OpenSCENARIO"
    / "NCAP"
    / "CA-FC_2026"
    / "Variations"
    / "StandardRange"
)
needs_catalogues = pytest.mark.skipif(
    not NCAP.is_dir(), reason="the catalogues of OpenSCENARIO are not here"
)

ROAD = """<OpenDRIVE><header><geoReference>+proj=tmerc+lat_0=4.8e1N +lon_0=11 +k=2 +k_0=1</geoReference>
</header><road id="0" length="1000" junction="-1"><planView>
<geometry s="0" x="5" y="7" hdg="0.5" length="1000"><line/></geometry></planView><lanes><laneSection s="0">
<left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes></road></OpenDRIVE>"""
CARS = """<OpenSCENARIO><FileHeader revMajor="1" revMinor="3"/><Catalog name="cars">
<Vehicle name="car" vehicleCategory="car"><ParameterDeclarations>
<ParameterDeclaration name="long" parameterType="double" value="4"/></ParameterDeclarations><BoundingBox>
<Center x="1.5" y="0" z="0"/><Dimensions length="$long" width="1.8" height="1.5"/></BoundingBox></Vehicle>
</Catalog></OpenSCENARIO>"""
STEP = '<SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time" value="0"/>'
FILE = """<?xml version="1.0"?><OpenSCENARIO><FileHeader revMajor="1" revMinor="{minor}" description="a test"/>
<ParameterDeclarations>
<ParameterDeclaration name="kph" parameterType="double" value="72"><ConstraintGroup>
<ValueConstraint rule="lessOrEqual" value="{most}"/></ConstraintGroup></ParameterDeclaration>
<ParameterDeclaration name="v" parameterType="double" value="{v}"/>
<ParameterDeclaration name="light" parameterType="string" value="day"/>
</ParameterDeclarations>
<CatalogLocations><VehicleCatalog><Directory path="{catalogs}"/></VehicleCatalog></CatalogLocations>
<RoadNetwork><LogicFile filepath="{road}"/></RoadNetwork>
<Entities><ScenarioObject name="Ego"><CatalogReference catalogName="cars" entryName="car"/></ScenarioObject>
<ScenarioObject name="Other"><CatalogReference catalogName="{catalog}" entryName="car"><ParameterAssignments>
<ParameterAssignment parameterRef="long" value="6"/></ParameterAssignments></CatalogReference></ScenarioObject>
</Entities>
<Storyboard><Init><Actions>
<Private entityRef="Ego"><PrivateAction><TeleportAction><Position><LanePosition roadId="0" laneId="-1" s="20"/>
</Position></TeleportAction></PrivateAction><PrivateAction><LongitudinalAction><SpeedAction>{step}<SpeedActionTarget>
<AbsoluteTargetSpeed value="$v"/></SpeedActionTarget></SpeedAction></LongitudinalAction></PrivateAction></Private>
<Private entityRef="Other"><PrivateAction><TeleportAction><Position>
<RelativeLanePosition entityRef="Ego" dLane="1" ds="50" offset="0.25"/></Position></TeleportAction></PrivateAction>
<PrivateAction><LongitudinalAction><SpeedAction>{step}<SpeedActionTarget><RelativeTargetSpeed entityRef="Ego"
value="-5" speedTargetValueType="delta" continuous="false"/></SpeedActionTarget></SpeedAction></LongitudinalAction>
</PrivateAction></Private></Actions></Init>
<Story name="s"><Act name="a"><ManeuverGroup name="g" maximumExecutionCount="1">
<Actors selectTriggeringEntities="false"><EntityRef entityRef="Other"/></Actors><Maneuver name="m">{events}</Maneuver>
</ManeuverGroup></Act></Story>
<StopTrigger><ConditionGroup><Condition name="end" delay="0" conditionEdge="none"><ByValueCondition>
<SimulationTimeCondition value="30" rule="greaterThan"/></ByValueCondition></Condition></ConditionGroup></StopTrigger>
</Storyboard></OpenSCENARIO>"""
CUT_IN = """<Event name="e" priority="overwrite"><Action name="cut"><PrivateAction><LateralAction><LaneChangeAction>
<LaneChangeActionDynamics dynamicsShape="sinusoidal" value="2" dynamicsDimension="rate"/><LaneChangeTarget>
<RelativeTargetLane entityRef="Ego" value="0"/></LaneChangeTarget></LaneChangeAction></LateralAction></PrivateAction>
</Action><StartTrigger><ConditionGroup><Condition name="c" delay="0.5" conditionEdge="rising"><ByEntityCondition>
<TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="Ego"/></TriggeringEntities><EntityCondition>
<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal" freespace="true" rule="lessThan"
value="30"/></EntityCondition></ByEntityCondition></Condition></ConditionGroup></StartTrigger></Event>"""
TIMED = """<Event name="e{n}" priority="overwrite"><Action name="act{n}"><PrivateAction>{action}</PrivateAction>
</Action><StartTrigger><ConditionGroup><Condition name="c" delay="{delay}" conditionEdge="none"><ByValueCondition>{when}
</ByValueCondition></Condition></ConditionGroup></StartTrigger></Event>"""
BRAKE = """<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="linear" dynamicsDimension="rate"
value="5"/><SpeedActionTarget><AbsoluteTargetSpeed value="0"/></SpeedActionTarget></SpeedAction></LongitudinalAction>"""
OFFSET = """<LateralAction><LaneOffsetAction continuous="false"><LaneOffsetActionDynamics dynamicsShape="sinusoidal"
maxLateralAcc="0.3"/><LaneOffsetTarget><AbsoluteTargetLaneOffset value="-1"/></LaneOffsetTarget></LaneOffsetAction>
</LateralAction>"""
AT = '<SimulationTimeCondition value="{}" rule="greaterOrEqual"/>'
VARIATION = """<OpenSCENARIO><FileHeader revMajor="1" revMinor="1" description="varied"/><ParameterValueDistribution>
<ScenarioFile filepath="{file}"/><Deterministic>{parts}</Deterministic></ParameterValueDistribution></OpenSCENARIO>"""
RANGE = """<DeterministicSingleParameterDistribution parameterName="{name}"><DistributionRange stepWidth="18">
<Range lowerLimit="36" upperLimit="90"/></DistributionRange></DeterministicSingleParameterDistribution>"""


ACROSS = CUT_IN[CUT_IN.index("<LateralAction>") : CUT_IN.index("</PrivateAction>")]
WAITS = CUT_IN[CUT_IN.index("<StartTrigger>") : CUT_IN.index("</Event>")]
ENDED = """<StoryboardElementStateCondition storyboardElementType="action"
storyboardElementRef="{}" state="endTransition"/>"""
COMPLETE = """<StoryboardElementStateCondition storyboardElementType="event"
storyboardElementRef="{}" state="completeState"/>"""


def timed(action, when, n=1, delay=0):
    """An event that begins an action at a time, s, or under a condition."""
    when = when if isinstance(when, str) else AT.format(when)
    return TIMED.format(n=n, action=action, delay=delay, when=when)


def space_of(path):
    """The logical scenario of a file."""
    return find(str(path))


def only_case(path):
    """The case of a file without parameters."""
    return space_of(path).concrete(only=0.0)


def written(folder, curvature="", **parts):
    """A scenario file with its road and its catalog."""
    (folder / "catalogs").mkdir(exist_ok=True)
    (folder / "catalogs" / "cars.xosc").write_text(CARS)
    arc = f'<arc curvature="{curvature}"/>'
    (folder / "road.xodr").write_text(ROAD.replace("<line/>", arc) if curvature else ROAD)
    known = {"minor": 2, "most": 80, "v": "${$kph / 3.6}", "catalogs": "catalogs",
        "road": "road.xodr",
             "catalog": "cars", "step": STEP, "events": ""}  # fmt: skip
    path = folder / "scenario.xosc"
    path.write_text(FILE.format(**{**known, **parts}))
    return path


def unnamed(case):
    """A case without its values, and without the names of its scenario, its road and its acts.

    The pieces of its road are rounded to 1e-9.
    """
    actors = (
        replace(actor, acts=tuple(act._replace(name="") for act in actor.acts))
        for actor in case.actors
    )
    line = (Piece(*np.round(astuple(piece), 9).tolist()) for piece in case.road.line)
    road = replace(case.road, name="", line=tuple(line))
    return replace(case, scenario="", values={}, road=road, actors=tuple(actors))


def acts_of(folder, *changes, **parts):
    """The other's moves in a file with texts replaced."""
    return only_case(changed(folder, *changes, **parts)).actors[0].acts


def way_of_other(scene, until):
    """The other's states in the road's frame every 0.05 s, and x, y and heading on the map."""
    seen = tracks([scene], [(4.0, 1.8)], 0.05, until).others[0, 0]
    return seen, *map_places(scene.road.line, *seen[:, :3].T)


def driven(folder, *changes, **parts):
    """The other's drive in a file with texts replaced, beside an ego that does nothing."""
    return simulate(only_case(changed(folder, *changes, **parts)), "no_reaction").actors["Other"]


def test_a_scenario_file_is_a_space_of_one_point_with_everybody_where_it_says(tmp_path):
    """The ego's axle at s = 20, its centre 1.5 m ahead; the other's 50 m further, in the left lane
    and 0.25 m on."""
    logical = find("scenario.xosc", written(tmp_path).parent)
    scene = logical.concrete(only=0.0)
    assert (scene.ego.x, scene.ego.y, scene.ego.speed) == pytest.approx((21.5, 0.0, 20.0))
    (other,) = scene.actors
    assert (other.start.x, other.start.y, other.start.speed) == pytest.approx((71.5, 3.75, 15.0))
    assert other.length == 6.0
    assert other.width == 1.8
    assert logical.time_limit == 30.0
    assert (logical.road.lanes, logical.road.lane_width, logical.road.bent) == (2, 3.5, False)
    levers = levers_of(logical, {"only": 0.0}, SimulationSettings())
    assert "only" not in {it.name for it in levers} > {"ego_speed", "vehicle.friction"}
    assert scene.ego_body.length == 4.0


def test_a_sinusoidal_lane_change_has_the_peak_speed_that_its_rate_says(tmp_path):
    """3.75 m to the right at 2 m/s: the peak of half a cosine is pi/2 of the mean, so it lasts pi *
    3.75 / 4 s."""
    (act,) = acts_of(tmp_path, events=CUT_IN)
    assert act.kind == played.COSINE
    assert act.begin == 0.5
    assert (act.offset, act.duration) == pytest.approx((-3.75, math.pi * 3.75 / 4.0))
    assert act.program[-1][0] == played.BELOW
    times = np.linspace(0.0, act.duration, 2001)
    move = lane_change(0.0, act.duration, act.offset, cosine=True)
    speeds = np.array([motion.lateral_motion(move, float(time))[1] for time in times])
    assert np.abs(speeds).max() == pytest.approx(2.0, abs=1e-6)
    along = cumulative_trapezoid(speeds, times, initial=0.0)
    assert along == pytest.approx(
        [motion.lateral_motion(move, float(time))[0] for time in times], abs=1e-5
    )
    slope = np.gradient(speeds, times)
    accelerations = [motion.lateral_motion(move, float(time))[2] for time in times]
    assert slope[5:-5] == pytest.approx(accelerations[5:-5], abs=1e-4)


def test_an_actor_that_stops_after_a_move_across_keeps_its_heading(tmp_path):
    events = timed(ACROSS, 1) + timed(BRAKE, 6, n=2)
    other = driven(tmp_path, ('ds="50"', 'ds="200"'), events=events)
    assert other.speed[-1] == 0.0
    assert other.heading[-1] == 0.0


def test_a_condition_may_bring_back_the_speed_of_the_start(tmp_path):
    to = 'AbsoluteTargetSpeed value="{}"'.format
    events = CUT_IN.replace(ACROSS, BRAKE.replace(to(0), to(15)))
    events += timed(BRAKE.replace(to(0), to(5)), 1, n=2)
    acts = acts_of(tmp_path, events=events)
    assert [(act.speed, bool(act.program)) for act in acts] == [(15.0, True), (5.0, False)]


def test_moves_at_times_are_scripts_that_a_curve_can_have(tmp_path):
    """1.25 m in pi sqrt(1.25 / 0.6) = 4.53 s from 2 s on, and 1 s after its end a brake."""
    events = timed(OFFSET, 2) + timed(BRAKE, ENDED.format("act1"), n=2, delay=1)
    (other,) = only_case(written(tmp_path, events=events)).actors
    assert not other.lively
    (move,) = other.lateral_moves
    lasts = math.pi * math.sqrt(1.25 / 0.6)
    assert (move.begin, move.duration, move.offset) == pytest.approx((2.0, lasts, -1.25))
    assert (other.braking.begin, other.braking.acceleration) == pytest.approx((3.0 + lasts, 5.0))


@pytest.mark.parametrize("name", ["kph", "$kph"])
def test_a_variation_is_the_space_and_constraints_leave_points_out(tmp_path, name):
    written(tmp_path)
    light = """<DeterministicMultiParameterDistribution><ValueSetDistribution>
    <ParameterValueSet><ParameterAssignment parameterRef="light" value="day"/></ParameterValueSet>
    <ParameterValueSet><ParameterAssignment parameterRef="light" value="night"/></ParameterValueSet>
    </ValueSetDistribution></DeterministicMultiParameterDistribution>"""
    path = tmp_path / "varied.xosc"
    path.write_text(VARIATION.format(file="scenario.xosc", parts=RANGE.format(name=name) + light))
    read = read_file(path)
    assert [
        (item.name, item.low, item.high, item.step, item.unit) for item in read.logical.parameters
    ] == [("kph", 36.0, 90.0, 18.0, "1")]
    assert read.notes == ("Points that differ in light alone are driven alike, and are one point.",)
    found = [(point["kph"], why) for point, why in concrete_points(read)]
    assert found == [(36.0, None), (54.0, None), (72.0, None), (90.0, "= kph lessOrEqual 80")]
    assert read.logical.concrete(kph=54.0).ego.speed == pytest.approx(15.0)
    with refusal("constraints allow"):
        read.logical.concrete(kph=90.0)
    said = "\n".join(described(read))
    assert "3 of 4 points play" in said
    assert "light alone are driven alike" in said


def test_a_large_space_is_tried_along_each_axis(tmp_path, monkeypatch):
    """4 speeds, of which the file forbids one, and 4 gaps: 3 lines along each axis miss one point."""
    monkeypatch.setattr(describe, "_MOST", 15)
    scenario = changed(
        tmp_path,
        ('"light" parameterType="string" value="day"', '"gap" parameterType="double" value="50"'),
        ('ds="50"', 'ds="$gap"'),
    )
    path = tmp_path / "varied.xosc"
    ranges = RANGE.format(name="kph") + RANGE.format(name="gap")
    path.write_text(VARIATION.format(file=scenario.name, parts=ranges))
    said = "\n".join(described(read_file(path)))
    assert "11 of 15 points play that were tried along each axis, of 16" in said
    assert "4 do not: kph lessOrEqual 80" in said
    assert list(listed("all", [path]))[-1] == "all: 1 of 1 files play, 11 of 15 points tried"


@pytest.mark.parametrize(
    "distance, time, speed, final, steady",
    values_of("""
    5.0, 6.0, 0.0, 1.39, 3.0
    80.0, 8.0, 0.0, 16.7, 30.0
    100.0, 8.0, 10.0, 20.0, 20.0
    90.0, 8.0, 20.0, 5.0, 5.0
    60.0, 10.0, 10.0, 10.0, 0.0
    20.0, 12.0, 6.0, 5.0, 2.0
    100.0, 10.0, 10.0, 10.0, 0.0
    """),
)  # fmt: skip
def test_who_is_synchronized_is_there_on_time_with_the_final_speed(
    distance, time, speed, final, steady
):
    """The area below the speeds is the distance; over the last `steady` m it is the final one; none
    is below 0."""
    knots = [(0.0, speed), *synchronized(distance, time, speed, final, steady)]
    at = np.array([knot[0] for knot in knots])
    of = np.array([knot[1] for knot in knots])
    times = np.union1d(np.linspace(0.0, time, 20001), at[at <= time])
    speeds = np.interp(times, at, of)
    assert np.trapezoid(speeds, times) == pytest.approx(distance, abs=1e-3)
    assert speeds[times >= time - steady / final + 1e-6] == pytest.approx(final)
    assert speeds.min() >= 0.0


@pytest.mark.parametrize("distance, time", [(50.0, 0.0), (0.0, 2.0)])
def test_no_room_to_be_there_on_time_is_refused(distance, time):
    with pytest.raises(InputError, match="leave no room"):
        synchronized(distance, time, 10.0, 10.0, 0.0)


BAD = {
    **tomllib.loads("""
"its version must be one of" = { minor = 9 }
"folder .* of its catalogs is not there" = { catalogs = "nowhere" }
"folder .*cars.xosc of its catalogs is a file" = { catalogs = "catalogs/cars.xosc" }
"catalog `bikes` is not there" = { catalog = "bikes" }
"the file .*none.xodr is not there" = { road = "none.xodr" }
"a constraint does not hold|allow no point" = { most = 10 }
"cannot be read" = { v = "${$kph +}" }
"holds `__import__" = { v = "${__import__(1)}" }
"no number has a `_`" = { v = "${1_0 + $kph}" }
"1e1_0.* cannot be read: no number" = { v = "${1e1_0}" }
"""),
    "no action `other` stands above it": {"events": timed(BRAKE, ENDED.format("other"))},
    "line .*<AcquirePositionAction>: this is not supported|<RoutingAction>": {
        "events": timed("<RoutingAction><AcquirePositionAction/></RoutingAction>", 1)
    },
    "over the distance of a lateral move the speed must stay the same": {
        "events": CUT_IN.replace('"rate"', '"distance"') + timed(BRAKE, 9)
    },
    "`Other`, on which it depends, may move before by an event below it": {
        "events": timed(BRAKE.replace('"rate"', '"time"'), 5) + timed(BRAKE, 2, n=2)
    },
    "<SpeedActionDynamics>: `Other`, on which it depends, may move before": {
        "events": timed(BRAKE.replace('value="0"', 'value="15"'), 5) + timed(BRAKE, 2, n=2)
    },
}


@pytest.mark.parametrize("sentence", BAD)
def test_what_cannot_be_played_is_refused(tmp_path, sentence):
    with refusal(sentence) as error:
        read_file(written(tmp_path, **BAD[sentence]))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "where, must",
    [
        ('dLane="0" ds="2"', "clear of `ego` at the start"),
        ('dLane="1" ds="-19"', r"on the road, its centre at x = 3 to [\d.]+ m \(the ego's .+\)"),
    ],
)
def test_impossible_points_do_not_play(tmp_path, where, must):
    """The other's body, 6 m long: 2 m ahead of the ego's centre inside it; with its centre 2.5 m
    behind the road's beginning half a metre over it. UN R157 has such points: a truck of 18.75 m
    stands 15 m before what it hides.
    """
    path = changed(tmp_path, ('dLane="1" ds="50"', where))
    where = r"xosc, line (\d+), <ScenarioObject>"
    with refusal(rf"{where}: Vehicle `Other` must be {must}, got .+\.") as error:
        read_file(path)
    line = int(re.search(where, str(error.value))[1])
    assert 'ScenarioObject name="Other"' in path.read_text().splitlines()[line - 1]


def test_entities_and_documents_outside_are_never_expanded(tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("72")
    path = written(tmp_path)
    plain = path.read_text().removeprefix('<?xml version="1.0"?>')
    bomb = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10 if n else "x"}">' for n in range(12))
    for head in (
        f'<!DOCTYPE o [<!ENTITY e SYSTEM "{secret.as_uri()}">]>',
        f"<!DOCTYPE o [{bomb}]>",
    ):
        path.write_text(head + plain.replace('value="72"', 'value="&e;"'))
        said = (
            r"scenario.xosc must not declare a document type or entities, got <!DOCTYPE> in line "
            r"1: none is ever"
        )
        with refusal(said):
            read_file(path)


def test_a_variation_that_leads_back_to_itself_is_refused(tmp_path):
    one, two = tmp_path / "one.xosc", tmp_path / "two.xosc"
    one.write_text(VARIATION.format(file="two.xosc", parts=RANGE.format(name="kph")))
    two.write_text(VARIATION.format(file="one.xosc", parts=RANGE.format(name="kph")))
    with refusal(r"two.xosc, line 2, <ScenarioFile>: it leads back to one.xosc"):
        read_file(one)
    written(tmp_path)
    one.write_text(VARIATION.format(file="scenario.xosc", parts=RANGE.format(name="kmh")))
    with refusal(r"parameter `kmh` is not declared in scenario.xosc. Did you mean `kph`"):
        read_file(one)


def test_a_move_with_a_condition_plays_on_a_curved_road(tmp_path):
    """A left bend of 500 m: the cut-in waits until the gap is below 30 m there as on a straight
    road."""
    straight = only_case(written(tmp_path, events=CUT_IN)).actors[0]
    logical = space_of(changed(tmp_path, events=CUT_IN, curvature=0.002))
    assert logical.road.bent
    (other,) = logical.concrete(only=0.0).actors
    assert other.lively
    assert [act.kind for act in other.acts] == [act.kind for act in straight.acts]
    assert other.acts[0].program == straight.acts[0].program
    assert other.acts[0].offset == pytest.approx(straight.acts[0].offset)


def test_speeds_and_gaps_on_a_curved_road_are_over_the_ground(tmp_path):
    """A left bend of 500 m: who drives 15 m/s in the left lane, 0.25 m on, is 501.75 - 3.75 m from
    its centre, and comes 15 m further each second there, by the chord: with 6 m/s2 it stands after
    15 / 6 = 2.5 s and 18.75 m.
    """
    brake = BRAKE.replace('value="5"/><SpeedActionTarget>', 'value="6"/><SpeedActionTarget>')
    logical = space_of(written(tmp_path, events=timed(brake, 2), curvature=0.002))
    scene = logical.concrete(only=0.0)
    assert scene.actors[0].start.speed == pytest.approx(15.0 / (1.0 - 3.75 / 501.75))
    _, x, y, _ = way_of_other(scene, 6.0)
    way = np.cumsum(np.hypot(np.diff(x), np.diff(y)))
    assert way[39] == pytest.approx(2.0 * 15.0, abs=1e-3)
    assert way[-1] == pytest.approx(2.0 * 15.0 + 18.75, abs=1e-3)
    # by the road's own coordinates a distance counts along its line, between bodies as well
    head, tail = CUT_IN.replace(ACROSS, BRAKE).split('<RelativeDistanceCondition entityRef="Other"')
    tail = tail.replace("/>", f' coordinateSystem="road">{_at(-1, 300)}</DistanceCondition>', 1)
    for free in ("true", "false"):
        events = f"{head}<DistanceCondition {tail}".replace('space="true"', f'space="{free}"')
        (act,) = acts_of(tmp_path, events=events, curvature=0.002)
        assert pytest.approx(500.0 / 501.75) in [value for *_, value in act.program]


def _at(lane, s):
    return f'<Position><LanePosition roadId="0" laneId="{lane}" s="{s}"/></Position>'


def _following(shape):
    return (
        "<RoutingAction><FollowTrajectoryAction><TimeReference><None/></TimeReference><TrajectoryFollowingMode "
        'followingMode="follow"/><TrajectoryRef><Trajectory name="way" closed="false"><Shape>'
        f"{shape}</Shape></Trajectory></TrajectoryRef></FollowTrajectoryAction></RoutingAction>"
    )


def _line(*places):
    return f"<Polyline>{''.join(f'<Vertex>{place}</Vertex>' for place in places)}</Polyline>"


def _segment(length, curvature, first=""):
    return (
        f'<ClothoidSplineSegment length="{length}" curvatureStart="{curvature}" '
        f'curvatureEnd="{curvature}">{first.replace("Position>", "PositionStart>")}'
        "</ClothoidSplineSegment>"
    )


def turning(folder):
    """An ego with 5 m/s that turns left on a radius of 10 m, 100 m ahead, across the way of one who
    comes with 5 m/s.

    Both keep their speed. The other starts 200 m along the same road in the left lane, 3.5 m
    beside, and comes back."""
    path = written(folder, v="5")
    text = path.read_text().replace('value="-5" speedT', 'value="0" speedT')
    shape = _segment(100.0, 0.0, _at(-1, 20.0)) + _segment(5.0 * math.pi, 0.1) + _segment(60.0, 0.0)
    for way in f"<ClothoidSpline>{shape}</ClothoidSpline>", _line(_at(1, 200.0), _at(1, 20.0)):
        place = "<TeleportAction>.*?</TeleportAction>"
        text = re.sub(place, _following(way), text, count=1, flags=re.S)
    path.write_text(text)
    return path


def test_the_road_of_an_ego_that_turns_is_its_way_and_who_comes_across_drives_straight_on_the_map(
    tmp_path,
):
    """The road begins where the ego's does, 20 m before it.

    The other's axle at s = 200 and its centre 1.5 m ahead of it, back along the road, at x = 198.5
    m and 3.5 m beside the ego's line, comes with 5 m/s along exactly that line.
    """
    logical = space_of(turning(tmp_path))
    assert [(piece.length, piece.begin, piece.end) for piece in logical.road.line] == [
        (120.0, 0.0, 0.0), (pytest.approx(5.0 * math.pi), 0.1, 0.1), (60.0, 0.0, 0.0)
    ]  # fmt: skip
    scene = logical.concrete(only=0.0)
    assert logical.road.lanes == 1
    assert scene.ego.x == 21.5
    assert scene.ego.y == 0.0
    assert scene.ego.speed == 5.0
    (other,) = scene.actors
    x, y, leads = other.on_map
    assert (x, y, math.cos(leads)) == pytest.approx((198.5, 3.5, -1.0))
    seen, x, y, heading = way_of_other(scene, 20.0)
    times = 0.05 * np.arange(len(seen))
    np.testing.assert_allclose(x, 198.5 - 5.0 * times, atol=1e-6)
    np.testing.assert_allclose(y, 3.5, atol=1e-6)
    np.testing.assert_allclose(np.cos(heading), -1.0, atol=1e-9)
    np.testing.assert_allclose(seen[:, 3], 5.0)
    assert abs(np.diff(seen[:, 2])).max() < 0.2  # its heading in the frame turns without a jump


def test_drivers_that_know_only_leads_are_not_used_for_crossings(tmp_path):
    """A car that changes lane ahead is what the synthetic drivers know; one that comes across the
    ego's turn is not, and the file that is written of it says so.
    """
    along, across = tmp_path / "along", tmp_path / "across"
    along.mkdir()
    across.mkdir()
    assert read_file(written(along, events=CUT_IN)).logical.has_drivers
    read = read_file(turning(across))
    assert not read.logical.has_drivers
    assert scenario_content(read, {})["people"] == "none"


def test_an_ego_that_turns_behind_the_crossing_vehicle_passes(tmp_path):
    """Through SUMO: an ego that does nothing reaches the bend after (120 - 20) / 5 = 20 s, when the
    other, from 198.5 m with 5 m/s, is at 98.5 m, beside the straight. The ego's axle keeps to the
    radius of 10 m, its centre 1.35 m ahead, within the 0.2 m that its wheel, which turns at a
    limited rate, needs where a bend begins without a spiral.
    """
    logical = space_of(turning(tmp_path))
    recording = clear_drive(logical.concrete(only=0.0), "no_reaction")
    assert recording.end_reason == "time_limit"
    way = recording.actors["Other"]
    x, y, _ = map_places(logical.road.line, way.x, way.y)
    np.testing.assert_allclose(x, 198.5 - 5.0 * way.time, atol=1e-6)
    np.testing.assert_allclose(y, 3.5, atol=1e-6)
    ego = recording.ego
    on_arc = (ego.x > 122.0) & (ego.x < 134.0)
    x, y, _ = map_places(logical.road.line, ego.x[on_arc], ego.y[on_arc])
    np.testing.assert_allclose(np.hypot(x - 120.0, y - 10.0), math.hypot(10.0, 1.35), atol=0.2)


def test_times_without_a_reference_do_not_count(tmp_path):
    """Version 1.0 asks every vertex for a time."""
    line = _line(_at(1, 70.0), _at(1, 90.0)).replace("<Vertex>", '<Vertex time="0">')
    acts = acts_of(tmp_path, (' offset="0.25"', ""), events=timed(_following(line), 0))
    assert not any(act.table for act in acts)


def test_a_trajectory_may_pass_its_last_point_before(tmp_path):
    """s = 70 m, 90 m, back to 60 m and again to 90 m: 60 m along it is at 70 m, where the other
    is."""
    line = _line(*(_at(1, s) for s in (70.0, 70.0, 90.0, 60.0, 90.0)))
    follow = _following(line).replace("ryAction>", 'ryAction initialDistanceOffset="60">', 1)
    (other,) = only_case(changed(tmp_path, (' offset="0.25"', ""), events=timed(follow, 0))).actors
    assert (other.start.x, other.start.y) == pytest.approx((71.5, 3.5))


def test_times_of_a_spline_give_each_segment_one_speed(tmp_path):
    """40 m in 4 s, then 40 m in 2 s."""
    first, second = _segment(40.0, 0.0, _at(1, 70.0)), _segment(40.0, 0.0)
    spline = first.replace("length", 'timeStart="0" length') + second.replace(
        "length", 'timeStart="4" length'
    )
    follow = _following(f'<ClothoidSpline timeEnd="6">{spline}</ClothoidSpline>')
    timing = '<Timing domainAbsoluteRelative="relative" scale="1" offset="0"/>'
    (act,) = acts_of(
        tmp_path, (' offset="0.25"', ""), events=timed(follow.replace("<None/>", timing), 0)
    )
    times, speeds = np.array(act.table).T
    assert times[-1] == pytest.approx(6.0)
    np.testing.assert_allclose(speeds, np.where(times < 4.0 + 1e-7, 10.0, 20.0), rtol=1e-6)


@pytest.mark.parametrize("heading, noted", [("", False), ('h="0.5"', False), ('h="-2.6"', True)])
def test_headings_along_a_trajectory_are_noted(tmp_path, heading, noted):
    """The road heads 0.5 rad; a body against its trajectory would drive backwards."""
    line = _line(_at(1, 70.0), _at(1, 90.0))
    if heading:
        turn = f'<Orientation type="absolute" {heading}/></LanePosition>'
        line = re.sub('(s="70.0")/>', rf"\1>{turn}", line)
    follow = timed(_following(line), 0)
    notes = space_of(changed(tmp_path, (' offset="0.25"', ""), events=follow)).notes[0]
    assert ("headings along a trajectory" in notes) == noted


def test_a_trajectory_crosses_a_curved_road_straight_on_the_map(tmp_path):
    """A left bend of 500 m, a body that goes from the left lane, 3.5 m to the left, to the right
    one 10 m before: on the map its places lie on the chord between both ends, 1.5 m ahead of where
    its axle is.
    """
    middle, event = (' offset="0.25"', ""), timed(_following(_line(_at(1, 70.0), _at(-1, 60.0))), 0)
    logical = space_of(changed(tmp_path, middle, events=event, v="10", curvature=0.002))
    scene = logical.concrete(only=0.0)
    assert logical.road.bent
    seen, *places, _ = way_of_other(scene, 4.0)
    found = np.stack(places, axis=1)
    # s = 70 m in lane 1 and s = 60 m in lane -1: the frame lies 1.75 m to the right of the road's
    # line
    outside = 1.0 + 1.75 * 0.002
    places = map_places(logical.road.line, [70.0 * outside, 60.0 * outside], [3.5, 0.0])
    ends = np.stack(places[:2], axis=1)
    along = (ends[1] - ends[0]) / math.dist(*ends)
    times = 0.05 * np.arange(len(seen))
    np.testing.assert_allclose(found, ends[0] + along * (1.5 + 5.0 * times)[:, None], atol=1e-6)


def test_a_speed_that_is_reached_within_no_time_is_the_one_at_the_start(tmp_path):
    was = only_case(written(tmp_path))
    linear = STEP.replace('"step"', '"linear"')
    assert only_case(changed(tmp_path, step=linear)).actors == was.actors
    with refusal("its first speed must be a step"):
        acts_of(tmp_path, step=linear.replace('"0"', '"2"'))


def test_the_ego_can_be_named(tmp_path):
    path = written(tmp_path, events=CUT_IN)
    was = only_case(path)
    hero = tmp_path / "hero.xosc"
    hero.write_text(path.read_text().replace('"Ego"', '"my hero"'))
    with refusal(
        r"<Entities>: the entity that the ADS drives must be named `Ego`, .* my hero, Other"
    ):
        space_of(hero)
    with refusal("must be named `Ego`"):
        find(f"{path}?ego")
    logical = find(f"{hero}?ego=my hero")
    assert logical.name == "hero_my_hero"
    named = logical.concrete(only=0.0)
    hero.write_text(path.read_text().replace('"Ego"', '"ego"'))
    for found in named, only_case(hero):
        assert found.ego == was.ego
        assert found.actors == was.actors


def test_only_roads_in_use_must_be_readable(tmp_path):
    path = written(tmp_path)
    road = ROAD[ROAD.index("<road") : ROAD.index("</OpenDRIVE>")]
    poly = road.replace("<line/>", "<poly3/>", 1)
    for text, file in ((road + poly.replace('id="0"', 'id="hill"', 1), "both"), (poly, "poly")):
        (tmp_path / "road.xodr").write_text(f"<OpenDRIVE>{text}</OpenDRIVE>")
        (tmp_path / f"{file}.xosc").write_text(path.read_text())
        if file == "both":
            assert find("both.xosc", tmp_path).concrete(only=0.0).actors
            continue
        with refusal(r"A <geometry> of road `0` .* got .poly3"):
            find("poly.xosc", tmp_path)


WIDER = '<lane id="-2" type="driving"><width sOffset="0" a="3.9" b="0" c="0" d="0"/></lane></right>'
SLOPE = '<elevationProfile><elevation s="0" a="0" b="0.1" c="0" d="0"/></elevationProfile>'
CAMBER = '<lateralProfile><{} s="0" a="0" b="0.1" c="0" d="0"/></lateralProfile>'


@pytest.mark.parametrize(
    "old, new, kind",
    [
        ("</planView>", "</planView>" + SLOPE, "elevation"),
        ('<road id="0"', '<road rule="LHT" id="0"', "left-hand traffic"),
        ("</right>", WIDER, "lanes of another width"),
        ("</planView>", "</planView>" + CAMBER.format("crossfall"), "elevation"),
        ("</planView>", "</planView>" + CAMBER.format("shape"), "elevation"),
        (
            "</planView>",
            "</planView><lateralProfile><crossSectionSurface/></lateralProfile>",
            "elevation",
        ),
        *values_of("""
    "</planView>", "</planView><objects><object/></objects>", "objects"
    "</planView>", "</planView><signals><signal/></signals>", "signals"
    "</planView>", "</planView><surface><CRG/></surface>", "road surface"
    "<planView>", '<type s="0"><speed max="20"/></type><planView>', "speed limits"
    "</lane></left>", '<height inner="0.1"/></lane></left>', "heights of lanes"
    "</lane></left>", '<access rule="deny"/></lane></left>', "rules of lanes"
    'length="1000" junction', 'length="900" junction', "a road length other than"
    """),
    ],
)
def test_what_a_road_file_says_in_vain_is_noted(tmp_path, old, new, kind):
    plain, path = space_of(written(tmp_path)), changed(tmp_path, minor=1)
    (tmp_path / "road.xodr").write_text(ROAD.replace(old, new, 1))
    for option in ("", "?flat=1"):
        other = find(f"{path}{option}")
        assert other.concrete(only=0.0).actors == plain.concrete(only=0.0).actors
        assert kind in other.notes[0]
    assert not any(kind in note for note in plain.notes)


EGO_PLACE = '<LanePosition roadId="0" laneId="-1" s="20"/>'
OTHER_PLACE = '<RelativeLanePosition entityRef="Ego" dLane="1" ds="50" offset="0.25"/>'


def changed(folder, *changes, **parts):
    """A scenario file with texts replaced, under a name that nothing was read of."""
    path = written(folder, **parts)
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / f"changed_{abs(hash(text))}.xosc"
    path.write_text(text)
    return path


FOLLOWS = 'dynamicsDimension="rate" followingMode="follow"'
IN_VAIN = {
    "TrafficSignalController": (
        "</RoadNetwork>",
        "<TrafficSignals><TrafficSignalController/></TrafficSignals></RoadNetwork>",
    ),
    "heights of positions": (
        'dLane="1" ds="50" offset="0.25"/>',
        'dLane="1" ds="50" offset="0.25" dz="1"/>',
    ),
    "tilts of positions": (
        'dLane="1" ds="50" offset="0.25"/>',
        'dLane="1" ds="50" offset="0.25"><Orientation type="relative" r="0.1"/>'
        "</RelativeLanePosition>",
    ),
    "followingMode `follow`": ('dynamicsDimension="rate"', FOLLOWS),
}


@pytest.mark.parametrize("kind", IN_VAIN)
@pytest.mark.parametrize("event", [CUT_IN, timed(BRAKE, 40)])
def test_text_without_effect_is_noted(tmp_path, kind, event):
    assert not space_of(written(tmp_path, events=event)).notes[0].startswith("Not simulated")
    note = space_of(changed(tmp_path, IN_VAIN[kind], events=event)).notes[0]
    assert note == f"Not simulated: {kind}."


@pytest.mark.parametrize("length", [400, 500])
def test_end_of_another_road_is_noted(tmp_path, length):
    """The other drives 15 m/s for 30 s, from s = 10 of a road that begins beside the ego's."""
    place = '<LanePosition roadId="1" laneId="-1" s="10"/>'
    path = changed(tmp_path, (OTHER_PLACE, place))
    other = re.search(r"<road .*</road>", ROAD, re.DOTALL)[0]
    for old, new in (('id="0"', 'id="1"'), ('x="5"', 'x="105"'), ("1000", str(length))):
        other = other.replace(old, new)
    (tmp_path / "road.xodr").write_text(ROAD.replace("</OpenDRIVE>", f"{other}</OpenDRIVE>"))
    noted = "Not simulated: the end of the road of `Other`." in space_of(path).notes
    assert noted == (length == 400)


def test_import_says_which_actor_leaves_the_road(tmp_path):
    """The other begins at s = 951 and drives 15 m/s, the ego 20 m/s behind it."""
    path = changed(tmp_path, ('ds="50"', 'ds="931"'))
    assert any("Vehicle `Other` comes to the end" in it for it in described(read_file(path)))


def test_parts_of_vehicles_without_effect_are_noted(tmp_path):
    path = str(written(tmp_path))
    cars = tmp_path / "catalogs" / "cars.xosc"
    cars.write_text(CARS.replace("<BoundingBox>", "<Performance/><BoundingBox>"))
    assert find(path).notes[0] == "Not simulated: Performance."
    trailer = '<Trailer><TrailerRef entityRef="{}"/></Trailer></Vehicle>'
    cars.write_text(CARS.replace("</Vehicle>", trailer.format("")))
    assert "Trailer" not in find(path).notes[0]
    cars.write_text(CARS.replace("</Vehicle>", trailer.format("Other")))
    assert "Trailer" in find(path).notes[0]


def test_no_synchronization_after_a_change_of_speed(tmp_path):
    """Its place is the start and the speed times 6 s only where the speed was the same."""
    place = '<LanePosition roadId="0" laneId="{}" s="{}"/>'
    meet = f"""<SynchronizeAction masterEntityRef="Ego"><TargetPositionMaster>{place.format(-1, 220)}
    </TargetPositionMaster><TargetPosition>{place.format(1, 220)}</TargetPosition></SynchronizeAction>"""
    events = [timed(action, at, n=n) for n, action, at in ((1, BRAKE, 2), (2, meet, 6))]
    (act,) = acts_of(tmp_path, events=events[1])
    assert act.table == ((4.0, 15.0),)
    # a change that begins at 0 s, too, has not ended when the other begins then
    for first, then in (events, (timed(BRAKE, 0), timed(meet, 0, n=2))):
        with refusal(r"place or speed of `Other` when this begins is unknown"):
            acts_of(tmp_path, ("overwrite", "parallel"), events=first + then)
    last = '<RelativeSpeedToMaster speedTargetValueType="{}" value="{}"/>'
    meet = meet.replace("</Sy", f"<FinalSpeed>{last}</FinalSpeed></Sy")
    for kind, value in (("delta", -5), ("factor", 0.75)):
        event = timed(meet.format(kind, value), 6, n=2)
        (act,) = acts_of(tmp_path, events=event)
        assert act.table == ((4.0, 15.0),)
        with refusal(f"Did you mean `{kind}`"):
            acts_of(tmp_path, events=event.replace(f'"{kind}"', f'"{kind}s"'))


def test_a_harder_brake_follows_a_gentle_one(tmp_path):
    """15 m/s from 2 s on by 1 m/s2, and from 4 s on by 5 m/s2: it stands at 4 + 13 / 5 = 6.6 s."""
    gentle = BRAKE.replace('\nvalue="5"', '\nvalue="1"')
    events = [
        timed(action, 2 * n, n=n)
        for n, action in ((1, gentle), (2, BRAKE), (2, BRAKE.replace("linear", "cubic")))
    ]
    other = driven(tmp_path, events="".join(events[:2]))
    assert np.interp((4.0, 5.6, 6.7), other.time, other.speed) == pytest.approx((13, 5, 0), abs=0.1)
    with refusal("only a linear change by `rate` is supported then"):
        acts_of(tmp_path, events=events[0] + events[2])
    # after a change that may still wait, too, the rate is the file's
    tiny = timed(BRAKE.replace('\nvalue="5"', '\nvalue="1e-7"'), 2, n=2)
    assert acts_of(tmp_path, events=CUT_IN.replace(ACROSS, BRAKE) + tiny)[-1].acceleration == 1e-7


@pytest.mark.parametrize("shape", ["linear", "cubic", "step"])
def test_a_change_of_speed_in_0_s_is_a_step(tmp_path, shape):
    swift = BRAKE.replace('"linear"', f'"{shape}"').replace('"rate"\nvalue="5"', '"time" value="0"')
    (act,) = acts_of(tmp_path, events=timed(swift, 2))
    assert act.kind == played.SPEED
    assert act.begin == 2.0
    assert act.acceleration == pytest.approx(15e6)


def test_starts_depend_on_each_other_in_any_order(tmp_path):
    """The ego 50 m behind a vehicle whose place and speed come later in the file."""
    later = (EGO_PLACE, '<RelativeLanePosition entityRef="Other" dLane="0" ds="-50"/>'), (
        OTHER_PLACE, '<LanePosition roadId="0" laneId="-1" s="70"/>'
    )  # fmt: skip
    case = only_case(changed(tmp_path, *later))
    assert (case.ego.x, case.actors[0].start.x) == pytest.approx((21.5, 71.5))
    with refusal("starts of Ego, Other depend on each other in a circle"):
        acts_of(tmp_path, later[0])


@pytest.mark.parametrize("place", [
    '<WorldPosition x="{x}" y="{y}" h="0.5"/>', '<RoadPosition roadId="0" s="20" t="-1.75"/>'
])  # fmt: skip
def test_a_place_in_a_driving_lane_is_that_lane(tmp_path, place):
    was = only_case(changed(tmp_path))
    x, y = (5.0 + 20.0 * math.cos(0.5) + 1.75 * math.sin(0.5),
            7.0 + 20.0 * math.sin(0.5) - 1.75 * math.cos(0.5))  # fmt: skip
    case = only_case(changed(tmp_path, (EGO_PLACE, place.format(x=x, y=y))))
    assert (case.ego.x, case.ego.y) == pytest.approx((was.ego.x, was.ego.y))
    assert case.actors[0].start.x == pytest.approx(was.actors[0].start.x)
    assert case.road.lanes == was.road.lanes


def along(begin, end, place):
    """A place on a route along the left lane."""
    stops = "".join(
        f'<Waypoint><Position><LanePosition roadId="0" laneId="1" s="{s}"/></Position></Waypoint>'
        for s in (begin, end)
    )
    return (
        '<RoutePosition><Orientation type="relative" h="{h}"/>'
        f'<RouteRef><Route name="r">{stops}</Route></RouteRef>'
        f"<InRoutePosition>{place}</InRoutePosition></RoutePosition>"
    ).format(h=math.pi * (end < begin))


@pytest.mark.parametrize("place", [
    '<RoadPosition roadId="0" s="70" t="2"/>',
    '<RelativeRoadPosition entityRef="Ego" ds="50" dt="3.75"/>',
    '<RelativeObjectPosition entityRef="Ego" dx="50" dy="3.75"/>',
    '<WorldPosition x="65.47192825" y="42.31495283" h="0.5"/>',
    '<RelativeWorldPosition entityRef="Ego" dx="42.08128239" dy="27.26220908"/>',
    '<GeoPosition latitudeDeg="48.000380559907626" longitudeDeg="11.000877348068041">'
    '<Orientation h="0.5"/></GeoPosition>',
    along(0, 900, '<FromLaneCoordinates pathS="70" laneId="1" laneOffset="0.25"/>'),
    along(900, 0, '<FromRoadCoordinates pathS="830" t="-2"/>'),
    along(900, 0, '<FromLaneCoordinates pathS="830" laneId="1" laneOffset="0.25"/>'),
])  # fmt: skip
@pytest.mark.parametrize("curvature", ["", "0.000001"])
def test_every_kind_of_position_is_one_place(tmp_path, place, curvature):
    """The numbers of the map are worked out from (5, 7), 0.5 rad and, on the earth, 48 N, 11 E."""
    (other,) = only_case(changed(tmp_path, (OTHER_PLACE, place), curvature=curvature)).actors
    assert (other.start.x, other.start.y) == pytest.approx((71.5, 3.75), abs=0.01)
    assert other.heading == pytest.approx(0.0, abs=1e-3)


def test_headings_and_offsets_of_carla_are_to_the_right(tmp_path):
    place = '<{} entityRef="Ego" dx="42.1" dy="{}"><Orientation type="relative" h="{}"/></{}>'
    ours, theirs = "RelativeWorldPosition", "RelativeObjectPosition"
    plain = changed(tmp_path, (OTHER_PLACE, place.format(ours, 27.3, -0.4, ours)))
    carla = changed(
        tmp_path,
        (OTHER_PLACE, place.format(theirs, -27.3, 0.4, theirs)),
        ('description="a test"', 'description="CARLA:a test"'),
    )
    one, two = (only_case(path).actors for path in (plain, carla))
    assert one == two
    assert one[0].heading == pytest.approx(-0.4)


def test_a_distance_is_reached_once_within_limits(tmp_path):
    """Bodies of 4 and 6 m are 30 m apart at one speed; 3 s later the other brakes."""
    reach = """<LongitudinalAction><LongitudinalDistanceAction entityRef="Ego" distance="30"
    freespace="true" continuous="false"><DynamicConstraints maxAcceleration="3" maxDeceleration="6"
    maxSpeed="40"/></LongitudinalDistanceAction></LongitudinalAction>"""
    events = timed(reach, 1) + timed(BRAKE, ENDED.format("act1"), n=2, delay=3)
    path = changed(tmp_path, ('ds="50" offset="0.25"', 'ds="50" offset="3"'), events=events)
    drive = simulate(only_case(path), "no_reaction")
    other, ego = drive.actors["Other"], drive.ego
    brakes = int(np.flatnonzero((other.speed < 19.0) & (other.time > 5.0))[0]) - 5
    assert other.x[brakes] - ego.x[brakes] == pytest.approx(35.0, abs=0.2)
    there = int(np.searchsorted(other.time, other.time[brakes] - 2.5))
    assert other.speed[there:brakes] == pytest.approx(20.0, abs=0.05)


def test_a_move_is_played_although_an_earlier_one_may_lead_there(tmp_path):
    """The first brake waits for an ego of more than 25 m/s, which has 20; the second comes."""
    fast = '<SpeedCondition rule="greaterThan" value="25"/>'
    never = re.sub("<RelativeD.*?/>", fast, CUT_IN, flags=re.S).replace(ACROSS, BRAKE)
    events = never + timed(BRAKE, 2)
    other = driven(tmp_path, ('offset="0.25"', 'offset="3"'), events=events)
    assert np.interp([2.0, 4.0, 6.0], other.time, other.speed) == pytest.approx([15.0, 5.0, 0.0])
    wrong = 'Dimension="rate"', 'Dimension="Rate"'  # no time
    with refusal("`dynamicsDimension` must be one of"):
        acts_of(tmp_path, events=never + events[len(never) :].replace(*wrong))


@pytest.mark.parametrize(
    "kind, name", [("event", "e"), ("maneuver", "m"), ("maneuverGroup", "g"), ("act", "a")]
)
def test_what_holds_two_moves_is_complete_after_both(tmp_path, kind, name):
    """A condition begins a long brake and a swift move across, in this order, or a move of no
    change, whose begin is remembered around it."""
    two = '</PrivateAction></Action><Action name="two"><PrivateAction>'
    then = f"""</Maneuver></ManeuverGroup></Act><Act name="b"><ManeuverGroup name="h"><Actors><EntityRef
    entityRef="Other"/></Actors><Maneuver name="n">{TIMED}""".format(
        n=2, action=BRAKE.replace('"0"', '"9"'), delay=0,
        when=COMPLETE.replace('"event"', f'"{kind}"').format(name),
    )  # fmt: skip
    none = set() if kind == "event" else {0}
    for first, ends in ((BRAKE + two + OFFSET, {0, 1}), (OFFSET.replace("-1", "0.25"), none)):
        last = acts_of(tmp_path, events=CUT_IN.replace(ACROSS, first) + then)[-1].program
        assert {number for op, _, number, _ in last if op == played.ENDED} == ends
        assert last


def test_a_delay_after_an_event_counts_in_a_conditional_act(tmp_path):
    events = CUT_IN + timed(BRAKE, COMPLETE.format("e"), n=2, delay=1)
    begun = ("</Act>", WAITS + "</Act>"), ('delay="0.5"', "")
    other = driven(tmp_path, *begun, events=events)
    crossed, braked = (other.time[on].max() for on in (other.y > 1e-3, other.speed > 14.999))
    assert braked - crossed == pytest.approx(1.0, abs=0.11)


def test_an_act_that_began_stays_begun(tmp_path):
    """Its condition may fail again before that of its event holds."""
    begun = ("</Act>", WAITS + "</Act>"), ('delay="0.5"', "")
    assert played.ENDED in {it[0] for it in acts_of(tmp_path, *begun, events=CUT_IN)[-1].program}
    holds = re.sub("<Rel.*?/>", '<SpeedCondition rule="lessThan" value="30"/>', WAITS, flags=re.S)
    gone = """<GlobalAction><EntityAction entityRef="Other"><DeleteEntityAction/></EntityAction>
    </GlobalAction></Actions></Init>"""
    path = changed(tmp_path, ("</Act>", holds + "</Act>"), ("</Actions></Init>", gone))
    assert only_case(path).actors == ()


def test_an_event_that_began_before_its_alternative_counts(tmp_path):
    """The first event begins at a gap below 30 m. The second waits for it to run, or for a gap
    below -90 m; the act of both begins at 25 m/s, by when the gap may be wide again.
    """
    running = COMPLETE.replace("completeState", "runningState").format("e")
    far = WAITS.replace('value="30"', 'value="-90"').replace('delay="0.5"', "")
    group = far[far.index("<ConditionGroup>") : far.index("</StartTrigger>")]
    both = timed(BRAKE, running, n=2).replace("</StartTrigger>", group + "</StartTrigger>")
    fast = re.sub("<Rel.*?/>", '<SpeedCondition rule="greaterThan" value="25"/>', far, flags=re.S)
    then = """</Maneuver></ManeuverGroup></Act><Act name="b"><ManeuverGroup name="h"><Actors><EntityRef
    entityRef="Other"/></Actors><Maneuver name="n">"""
    acts = acts_of(
        tmp_path,
        ("</ManeuverGroup></Act></Story>", f"</ManeuverGroup>{fast}</Act></Story>"),
        events=CUT_IN.replace('delay="0.5"', "") + then + both,
    )
    last = acts[-1].program
    began = [
        k for k, act in enumerate(acts) if act.program == acts[0].program and act.offset == 0.0
    ]
    assert began
    assert {(played.ENDED, 0, k, 0.0) for k in began} <= set(last)


def test_a_point_looks_at_its_own_file_alone(tmp_path, monkeypatch):
    """Of hundreds of files that were read, the others are looked at once a file that is read."""
    read, looked, was = read_file(written(tmp_path)), [], reading.changed_at
    monkeypatch.setattr(reading, "changed_at", lambda path: looked.append(path) or was(path))
    assert list(concrete_points(read)) == [({}, None)]
    assert looked == [read.space.file]


def test_events_that_follow_each_other_end_none_half_way(tmp_path):
    """A cut-in by a condition, a brake after it, a cut-out after that, and then a higher speed."""
    events = CUT_IN + timed(BRAKE.replace('"0"', '"5"'), COMPLETE.format("e"), n=1)
    events += timed(ACROSS.replace('"0"/>', '"1"/>'), COMPLETE.format("e1"), n=2)
    events += timed(BRAKE.replace('"0"', '"9"'), COMPLETE.format("e2"), n=3)
    kinds = [act.kind for act in acts_of(tmp_path, events=events)]
    assert kinds == [played.COSINE, played.SPEED] * 2


def begins_of(folder, *events):
    """When the moves of events that run in parallel begin, s."""
    acts = acts_of(folder, ("overwrite", "parallel"), events="".join(events))
    return [act.begin for act in acts]


def test_a_distance_of_a_lateral_move_counts_until_it_ends(tmp_path):
    """30 m with 15 m/s from 1 s on; the ego's lane is left again from 10 to 15 s, with a brake."""
    back = ACROSS.replace('"0"/>', '"1"/>').replace('"rate"', '"time"').replace('"2"', '"5"')
    first = ACROSS.replace('"rate"', '"distance"').replace('value="2"', 'value="30"')
    moves = timed(first, 1), timed(back, 10, n=2), timed(BRAKE, 12, n=3)
    assert begins_of(tmp_path, *moves) == [1.0, 10.0, 12.0]


def test_a_lateral_move_by_0_m_needs_no_steady_speed(tmp_path):
    """The other is 0.25 m beside its lane's centre already, and brakes twice over the 90 m."""
    stay = ACROSS.replace('"rate"', '"distance"').replace('value="2"', 'value="90"')
    stay = stay.replace('"Ego"', '"Other"').replace(
        "<LaneChangeAction>", '<LaneChangeAction targetLaneOffset="0.25">'
    )
    gentle = timed(BRAKE.replace('value="0"', 'value="12"'), 2, n=2)
    assert begins_of(tmp_path, timed(stay, 1), gentle, timed(BRAKE, 4, n=3)) == [2.0, 4.0]


@pytest.mark.parametrize("reads, value, moves, refused", [
    (5, 1, timed(BRAKE, 2, n=2), True),
    (5, 1, CUT_IN.replace(ACROSS, BRAKE).replace("lessThan", "greaterThan"), True),
    (0, 1, CUT_IN.replace(ACROSS, BRAKE), False),
    (1, 1, timed(BRAKE, COMPLETE.format("e1"), n=2), False),
    (5, -15, timed(BRAKE, COMPLETE.format("e"), n=2), True),  # no change at 5 s
])  # fmt: skip
def test_a_speed_relative_to_a_later_event_is_refused(tmp_path, reads, value, moves, refused):
    """It would be that from which the other brakes before."""
    relative = f"""<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="linear"
    dynamicsDimension="rate" value="1"/><SpeedActionTarget><RelativeTargetSpeed entityRef="Other"
    value="{value}" speedTargetValueType="delta" continuous="false"/></SpeedActionTarget></SpeedAction>
    </LongitudinalAction>"""
    third = """<ScenarioObject name="Third"><CatalogReference catalogName="cars" entryName="car"/>
    </ScenarioObject></Entities>"""
    there = """<Private entityRef="Third"><PrivateAction><TeleportAction><Position><LanePosition
    roadId="0" laneId="-1" s="90"/></Position></TeleportAction></PrivateAction></Private></Actions></Init>"""
    then = """</Maneuver></ManeuverGroup></Act><Act name="b"><ManeuverGroup name="h"><Actors>
    <EntityRef entityRef="Other"/></Actors><Maneuver name="n">"""
    aside = CUT_IN.replace(ACROSS, OFFSET)
    path = changed(tmp_path, ("</Entities>", third), ("</Actions></Init>", there),
        ('s="false"><EntityRef entityRef="Other"', 's="false"><EntityRef entityRef="Third"'),
        ("overwrite", "parallel"),
        events=timed(relative, reads) + aside + then + moves)  # fmt: skip
    with refusal("`Other`, on which it depends, may move before") if refused else nullcontext():
        read_file(path)


def test_an_oncoming_actor_on_a_curve_moves_as_the_road_says(tmp_path):
    """Its speed counts as driven, an offset of -1 m to the right of the road: 1 m further left for
    an ego that drives against it."""
    ego = """<LanePosition roadId="0" laneId="1" s="900"><Orientation type="relative"
    h="3.141592653589793"/></LanePosition>"""
    by = """<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef
    entityRef="Other"/></TriggeringEntities><EntityCondition><SpeedCondition rule="greaterThan"
    value="14"/></EntityCondition></ByEntityCondition>"""
    value = f"<ByValueCondition>{AT.format(1)}\n</ByValueCondition>"
    path = changed(tmp_path, (EGO_PLACE, ego),
        (OTHER_PLACE, '<LanePosition roadId="0" laneId="-1" s="700"/>'), (value, by),
        events=timed(OFFSET, 1), curvature=0.001)  # fmt: skip
    other = simulate(only_case(path), "no_reaction").actors["Other"]
    assert other.y[[0, -1]] == pytest.approx([3.5, 4.5])


@pytest.mark.parametrize(
    "kind, name", [("action", "act1"), ("event", "e1"), ("maneuver", "m"), ("act", "a")]
)
def test_an_event_without_effect_waits_for_its_trigger(tmp_path, kind, name):
    lights = '<VisibilityAction graphics="true" sensors="true" traffic="true"/>'
    when = COMPLETE.replace('"event"', f'"{kind}"').format(name)
    events = timed(lights, 4)
    events += """</Maneuver></ManeuverGroup></Act><Act name="b"><ManeuverGroup name="h"><Actors>
    <EntityRef entityRef="Other"/></Actors><Maneuver name="n">"""
    events += timed(BRAKE, when, n=2, delay=1)
    assert begins_of(tmp_path, events) == [5.0]


@pytest.mark.parametrize("until, begins", [(3, []), (5, [4.0])])
def test_no_event_begins_after_the_time_until_which_it_may(tmp_path, until, begins):
    """The act begins at 4 s, the event only before `until`."""
    when = f'<SimulationTimeCondition value="{until}" rule="lessThan"/>'
    start = TIMED[TIMED.index("<StartTrigger>") : TIMED.index("</Event>")]
    act = start.format(delay=0, when=AT.format(4)) + "</Act>"
    acts = acts_of(tmp_path, ("</Act>", act), events=timed(BRAKE, when))
    assert [it.begin for it in acts if it.kind == played.SPEED] == begins


def test_ego_against_the_reference_line_has_its_road_from_there(tmp_path):
    """The ego comes from s = 980 m in the left lane; the other, 50 m less, is 50 m ahead of it."""
    turned = '<Orientation type="relative" h="3.141592653589793"/></LanePosition>'
    place = '<LanePosition roadId="0" laneId="1" s="980">' + turned
    case = only_case(changed(tmp_path, (EGO_PLACE, place), ('dLane="1" ds="50"',
                'dLane="0" ds="-50"')))  # fmt: skip
    (other,) = case.actors
    assert (case.ego.x, case.ego.y, other.start.x) == pytest.approx((21.5, 0.0, 71.5))
    assert (other.start.y, other.heading) == pytest.approx((-0.25, 0.0))


def test_the_only_entity_with_a_controller_is_the_ego(tmp_path):
    controlled = ('entryName="car"/></ScenarioObject>',
        'entryName="car"/><ObjectController><Controller name="c"/></ObjectController>'
        "</ScenarioObject>")  # fmt: skip
    assert only_case(changed(tmp_path, controlled, ('"Ego"', '"hero"'))).actors[0].name == "Other"


def test_the_only_entity_is_the_ego(tmp_path):
    text = written(tmp_path).read_text().replace('"Ego"', '"hero"')
    text = text.replace('<EntityRef entityRef="Other"/>', "")
    other = r'<(ScenarioObject name|Private entityRef)="Other">.*?</(ScenarioObject|Private)>'
    path = tmp_path / "alone.xosc"
    path.write_text(re.sub(other, "", text, flags=re.S))
    assert only_case(path).actors == ()


@pytest.mark.parametrize("name", ["Town01", ""])
def test_a_map_of_a_simulator_is_named_by_the_user(tmp_path, name):
    named = f'<LogicFile filepath="{name}"/>' if name else ""
    path = changed(tmp_path, ('<LogicFile filepath="road.xodr"/>', named))
    with refusal(rf"`{name}` .* simulator's map: `\?map=FILE.xodr`"):
        space_of(path)
    assert find(f"{path}?map=road.xodr").concrete(only=0.0).actors


@pytest.mark.parametrize("action, far", [
    ('<SpeedAction><SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time" value="0"/>'
     '<SpeedActionTarget><RelativeTargetSpeed entityRef="Ego" value="2" '
     'speedTargetValueType="delta" continuous="true"/></SpeedActionTarget></SpeedAction>', 64.0),
    ('<LongitudinalDistanceAction entityRef="Ego" distance="30" freespace="true" '
     'continuous="true"/>', 35.0),
    ('<LongitudinalDistanceAction entityRef="Ego" timeGap="3" freespace="false" '
     'continuous="true"/>', 0.0),
    ('<LongitudinalDistanceAction entityRef="Ego" distance="30" freespace="true" '
     'continuous="true"><DynamicConstraints maxAcceleration="3" maxDeceleration="6"/>'
     '</LongitudinalDistanceAction>', 35.0),
])  # fmt: skip
def test_speed_and_distance_are_kept_while_the_ego_brakes(tmp_path, action, far):
    """The other starts 50 m ahead and gains 2 m/s, until the ego stands; or keeps 30 m between
    bodies of 4 and 6 m, or 3 s at the ego's speed; within limits it never brakes harder.
    """
    events = timed(f"<LongitudinalAction>{action}</LongitudinalAction>", 0)
    path = changed(tmp_path, ('ds="50" offset="0.25"', 'ds="50" offset="3"'), events=events)
    drive = simulate(only_case(path), lambda *_: Command(-2.0))
    other = drive.actors["Other"]
    at = int(np.searchsorted(other.time, 7.0))
    assert drive.ego.speed[at] < 15.0
    # of the time gap the ego's speed is the one of the step before, half a sample
    far = far or 3.0 * drive.ego.speed[at - 1 : at + 1].mean()
    assert other.x[at] - drive.ego.x[at] == pytest.approx(far, abs=0.05)
    if "Constraints" in action:
        rates = np.diff(other.speed) / np.diff(other.time)
        assert rates.min() == pytest.approx(-6.0, abs=0.01)
        assert rates.max() <= 3.01


def test_an_edge_needs_the_opposite_before(tmp_path):
    """A gap above 30 m holds at the start: its rising edge waits until it was not, the falling one
    does not.
    """
    above = CUT_IN.replace('rule="lessThan"', 'rule="greaterThan"')
    for edge, latches in (("rising", 1), ("falling", 0), ("risingOrFalling", 0), ("none", 0)):
        events = above.replace('conditionEdge="rising"', f'conditionEdge="{edge}"')
        assert sum(act.offset == 0.0 for act in acts_of(tmp_path, events=events)) == latches, edge


KEPT = """<LongitudinalAction><LongitudinalDistanceAction entityRef="{}" distance="20"
freespace="true" continuous="{}">{}</LongitudinalDistanceAction></LongitudinalAction>"""


@pytest.mark.parametrize("continuous, limits", [
    ("true", ""), ("false", '<DynamicConstraints maxSpeed="30"/>')
])  # fmt: skip
def test_a_distance_that_the_ego_would_keep_is_refused(tmp_path, continuous, limits):
    keeps = f"<PrivateAction>{KEPT.format('Other', continuous, limits)}</PrivateAction></Private>"
    with refusal(r"<LongitudinalDistanceAction>: the ego is driven by the ADS: it keeps no dis"):
        read_file(changed(tmp_path, ("</Private>", keeps)))


def test_an_exponent_of_a_projection_may_have_a_sign(tmp_path):
    place = """<GeoPosition latitudeDeg="48.000380559907626" longitudeDeg="11.000877348068041">
    <Orientation h="0.5"/></GeoPosition>"""
    path = changed(tmp_path, (OTHER_PLACE, place))
    road = ROAD.replace("4.8e1N", "4.8000000000000000e+1").replace("lon_0=11", "lon_0=1.1e+1")
    (tmp_path / "road.xodr").write_text(road)
    (other,) = only_case(path).actors
    assert (other.start.x, other.start.y) == pytest.approx((71.5, 3.75), abs=1e-6)


def test_version_1_0_measures_along_the_route_by_a_flag(tmp_path):
    """`alongRoute` of a distance to a place in the other lane."""
    place = '<Position><LanePosition roadId="0" laneId="1" s="90"/></Position></DistanceCondition>'
    found = [
        acts_of(tmp_path, (re.search("<RelativeD.*?/>", CUT_IN, flags=re.S)[0],
            f'<DistanceCondition value="30" freespace="false" rule="lessThan" {how}>{place}'),
            events=CUT_IN)[0].program
        for how in ('alongRoute="true"', 'relativeDistanceType="longitudinal"', "")
    ]  # fmt: skip
    assert found[0] == found[1] != found[2]


def test_the_largest_distance_is_refused_on_a_curve(tmp_path):
    far = """<DistanceCondition value="1.7976931348623157e308" freespace="false" rule="lessThan">
    <Position><LanePosition roadId="0" laneId="1" s="90"/></Position></DistanceCondition>"""
    events = re.sub("<RelativeD.*?/>", far, CUT_IN, flags=re.S)
    with refusal("<DistanceCondition>: a distance across a curve of the road is not supported"):
        read_file(changed(tmp_path, events=events, curvature=0.002))


SEEN = """<RelativeDistanceCondition entityRef="Ego" relativeDistanceType="{}" freespace="false"
rule="lessThan" value="5"/>"""


@pytest.mark.parametrize("events, sentence", [
    (timed(ACROSS, 2), "<LaneChangeAction>: .* along a lane, which `Other` leaves"),
    (timed(OFFSET, 2), "<LaneOffsetAction>: .* along a lane, which `Other` leaves"),
    (timed(KEPT.format("Ego", "true", ""), 2), "a distance of an entity that leaves its lane"),
    *(
        (
            re.sub("<RelativeD.*?/>", SEEN.format(kind), CUT_IN, flags=re.S)
            .replace('entityRef="Ego"/></Trig', 'entityRef="Other"/></Trig')
            .replace(ACROSS, BRAKE),
            f"a {kind} distance along the axes of `Other`, which leaves its lane",
        )
        for kind in ("longitudinal", "lateral")
    ),
])  # fmt: skip
@pytest.mark.parametrize("turned", ["-0.1", "-1.5707963"])
def test_an_actor_at_an_angle_to_its_lane_has_no_places_across_it(
    tmp_path, events, sentence, turned
):
    place = OTHER_PLACE.replace("/>", f'><Orientation type="relative" h="{turned}"/>')
    place = place.replace('offset="0.25"', 'offset="5"') + "</RelativeLanePosition>"
    with refusal(sentence):
        read_file(changed(tmp_path, (OTHER_PLACE, place), events=events))


def test_no_lane_change_follows_a_curved_trajectory(tmp_path):
    """Its lane is another one then than at the start."""
    shape = _line(_at(1, 70.0), _at(1, 90.0), _at(-1, 120.0), _at(-1, 150.0))
    back = ACROSS.replace(
        '<RelativeTargetLane entityRef="Ego" value="0"', '<AbsoluteTargetLane value="1"'
    )
    events = timed(_following(shape), 0) + timed(back, COMPLETE.format("e1"), n=2)
    with refusal("<LaneChangeAction>: .* along a lane, which `Other` leaves"):
        read_file(changed(tmp_path, (' offset="0.25"', ""), events=events))


def test_a_lane_of_another_road_is_no_target(tmp_path):
    third = """<ScenarioObject name="Third"><CatalogReference catalogName="cars" entryName="car"/>
    </ScenarioObject></Entities>"""
    there = """<Private entityRef="Third"><PrivateAction><TeleportAction><Position><LanePosition
    roadId="1" laneId="-1" s="90"/></Position></TeleportAction></PrivateAction></Private></Actions>
    </Init>"""
    path = changed(tmp_path, ("</Entities>", third), ("</Actions></Init>", there),
        events=timed(ACROSS.replace('"Ego"', '"Third"'), 2))  # fmt: skip
    road = re.search(r"<road .*</road>", ROAD, re.DOTALL)[0].replace('id="0"', 'id="1"')
    road = road.replace('x="5"', 'x="25"')
    (tmp_path / "road.xodr").write_text(ROAD.replace("</OpenDRIVE>", f"{road}</OpenDRIVE>"))
    with refusal("`Third`, to which it is relative, is not on the ego's road"):
        read_file(path)


@pytest.mark.parametrize(
    "shape, curvature, length",
    [
        (_line(_at(1, 70.0), _at(1, 90.0)), "", 20.0),
        (_line(_at(1, 70.0), _at(1, 90.0)), "0.001", 20.0 * (1.0 - 0.00175)),
        (_line(_at(1, 70.0), _at(1, 80.0), _at(-1, 100.0)), "", 10.0 + math.hypot(20.0, 3.5)),
    ],
)
def test_end_of_a_trajectory_without_times_begins_an_event(tmp_path, shape, curvature, length):
    """At 15 m/s its end comes after length / 15 s; 1 s later the brake has taken 5 m/s."""
    events = timed(_following(shape), 0) + timed(BRAKE, COMPLETE.format("e1"), n=2)
    middle = ' offset="0.25"', ""
    other = driven(tmp_path, middle, events=events, curvature=curvature)
    at = length / 15.0
    assert np.interp([at, at + 1.0], other.time, other.speed) == pytest.approx([15, 10], abs=0.3)


def test_speed_changes_on_a_trajectory_without_times(tmp_path):
    """A change of 10 m/s in 5 s that has begun when the trajectory begins."""
    slower = BRAKE.replace('"rate"\nvalue="5"', '"time" value="5"').replace('"0"', '"5"')
    events = timed(slower, 0) + timed(_following(_line(_at(1, 70.0), _at(1, 90.0))), 0, n=2)
    other = driven(
        tmp_path, (' offset="0.25"', ""), ("overwrite", "parallel"), events=events
    )  # fmt: skip
    assert np.interp([2.5, 5.0], other.time, other.speed) == pytest.approx([10.0, 5.0], abs=0.1)


def test_a_target_on_a_curve_is_reached_along_the_road(tmp_path):
    """A left bend of 200 m: the ego drives 200 m of the reference line 1.75 m outside of it, the
    other 150 m, which are as much longer along the line of the road, the ego's.
    """
    place = '<LanePosition roadId="0" laneId="{}" s="220"/>'
    meet = f"""<SynchronizeAction masterEntityRef="Ego"><TargetPositionMaster>{place.format(-1)}
    </TargetPositionMaster><TargetPosition>{place.format(1)}</TargetPosition></SynchronizeAction>"""
    (other,) = only_case(changed(tmp_path, events=timed(meet, 0), curvature=0.005)).actors
    times, speeds = np.array([(0.0, other.start.speed), *other.acts[0].table]).T
    assert times[-1] == pytest.approx(200.0 * 1.00875 / 20.0)
    assert np.trapezoid(speeds, times) == pytest.approx(150.0 * 1.00875)


def test_a_lane_change_leads_the_axle_to_the_middle(tmp_path):
    """The centre of a body 0.3 m to the left of its axle stays so: from 3.8 m to 0.3 m."""
    path = changed(tmp_path, (' offset="0.25"', ""), events=CUT_IN)
    cars = tmp_path / "catalogs" / "cars.xosc"
    cars.write_text(CARS.replace('y="0" z="0"', 'y="0.3" z="0"'))
    (other,) = only_case(path).actors
    assert (other.start.y, other.acts[0].offset) == pytest.approx((3.8, -3.5))


def test_an_event_of_a_catalog_waits_for_one_without_effect(tmp_path):
    lights = '<VisibilityAction graphics="true" sensors="true" traffic="true"/>'
    events = timed(lights, 4) + timed(BRAKE, COMPLETE.format("e1"), n=2, delay=1)
    (tmp_path / "catalogs").mkdir()
    (tmp_path / "catalogs" / "manoeuvres.xosc").write_text(
        '<OpenSCENARIO><FileHeader revMajor="1" revMinor="3"/><Catalog name="manoeuvres">'
        f'<Maneuver name="m">{events}</Maneuver></Catalog></OpenSCENARIO>'
    )
    entry = '<CatalogReference catalogName="manoeuvres" entryName="m"/>'
    (act,) = acts_of(tmp_path, ('<Maneuver name="m"></Maneuver>', entry))
    assert act.begin == 5.0


NEXT_ACT = """</ManeuverGroup></Act><Act name="{}"><ManeuverGroup name="{}"><Actors><EntityRef
entityRef="Other"/></Actors><Maneuver name="n">{}</Maneuver>"""


@pytest.mark.parametrize(
    "kind, name",
    [("event", "a::g::m::e1"), ("event", "a2::g2::m::e1"), ("act", "a2")],
)
def test_a_manoeuvre_of_a_catalog_is_below_what_refers_to_it(tmp_path, kind, name):
    """Two acts refer to it, and it does nothing at 4 s."""
    lights = timed('<VisibilityAction graphics="true" sensors="true" traffic="true"/>', 4)
    (tmp_path / "catalogs").mkdir()
    (tmp_path / "catalogs" / "manoeuvres.xosc").write_text(
        '<OpenSCENARIO><FileHeader revMajor="1" revMinor="3"/><Catalog name="manoeuvres">'
        f'<Maneuver name="m">{lights}</Maneuver></Catalog></OpenSCENARIO>'
    )
    entry = '<CatalogReference catalogName="manoeuvres" entryName="m"/>'
    last = timed(BRAKE, COMPLETE.replace('"event"', f'"{kind}"').format(name), n=2)
    second = NEXT_ACT.format("a2", "g2", "").replace('<Maneuver name="n"></Maneuver>', entry)
    acts = acts_of(
        tmp_path,
        ('<Maneuver name="m"></Maneuver>', entry + second + NEXT_ACT.format("b", "h", last)),
    )
    assert [act.begin for act in acts] == [4.0]


@pytest.mark.parametrize("delay", [0, 3])
def test_a_time_that_stops_an_act_without_moves_is_refused(tmp_path, delay):
    """Its only event does nothing, but a brake waits for it: it would have to begin at the stop."""
    lights = '<VisibilityAction graphics="true" sensors="true" traffic="true"/>'
    first = CUT_IN.replace(ACROSS, lights).replace('delay="0.5"', f'delay="{delay}"')
    stop = timed("", 2)[timed("", 2).index("<StartTrigger>") :].replace("</Event>", "")
    brake = timed(BRAKE, COMPLETE.format("e"), n=2)
    act = f"</ManeuverGroup>{stop.replace('Start', 'Stop')}</Act><Act"
    next_act = NEXT_ACT.format("b", "h", brake).replace("</ManeuverGroup></Act><Act", act)
    with refusal("a time stops while a condition waits for what is in it is not supported"):
        acts_of(tmp_path, ("</Maneuver>", "</Maneuver>" + next_act), events=first)


def test_a_story_runs_until_its_last_act_ends(tmp_path):
    """A brake from 15 to 10 m/s by 5 m/s2 at 1 s; the next story brakes to rest after it."""
    then = timed(BRAKE, COMPLETE.replace('"event"', '"story"').format("s"), n=2)
    second = NEXT_ACT.format("b", "h", then).replace("</ManeuverGroup></Act>", '<Story name="t">')
    second += "</ManeuverGroup></Act></Story>"
    acts = acts_of(
        tmp_path,
        ("</Act></Story>", "</Act></Story>" + second),
        events=timed(BRAKE.replace('"0"', '"10"'), 1),
    )
    assert [act.begin for act in acts] == [1.0, 2.0]


@pytest.mark.parametrize(
    "kind, name", [("event", "e"), ("maneuver", "m"), ("maneuverGroup", "g"), ("act", "a")]
)
def test_what_a_stop_ends_is_complete(tmp_path, kind, name):
    """The act ends when the ego has driven 40 m, after 2 s, before its brake begins; a brake to 10
    m/s by 5 m/s2 waits for its end.
    """
    far = '<TraveledDistanceCondition value="40"/>'
    stop = re.sub("<RelativeD.*?/>", far, WAITS, flags=re.S).replace("StartTrigger", "StopTrigger")
    stop = stop.replace('delay="0.5"', 'delay="0"')
    near = CUT_IN.replace(ACROSS, BRAKE).replace('value="30"', 'value="1"')
    group = """</ManeuverGroup>{}</Act><Act name="b"><ManeuverGroup name="h"><Actors><EntityRef
    entityRef="Other"/></Actors><Maneuver name="n">{}</Maneuver></ManeuverGroup>"""
    ended = COMPLETE.replace('"event"', f'"{kind}"').format(name)
    then = timed(BRAKE.replace('"0"', '"10"'), ended, n=2)
    other = driven(
        tmp_path, ("</ManeuverGroup>", group.format(stop, then)), events=near
    )  # fmt: skip
    assert np.interp([1.8, 2.5, 4.0], other.time, other.speed) == pytest.approx(
        [15.0, 12.5, 10.0], abs=0.3
    )


def test_a_stop_by_time_that_varies_is_noted(tmp_path):
    path = changed(
        tmp_path, ("kph", "until"), ("${$until / 3.6}", "20"), ('value="30"', 'value="$until"')
    )
    varied = tmp_path / "varied.xosc"
    varied.write_text(VARIATION.format(file=path.name, parts=RANGE.format(name="until")))
    logical = space_of(varied)
    assert logical.time_limit == 72.0
    assert any("not the same at all points: all last up to 72 s" in it for it in logical.notes)


@pytest.mark.parametrize("when, plays", [(0, True), (0.03, True), (4, False), ("gap", False)])
def test_a_trajectory_from_the_start_begins_there(tmp_path, when, plays):
    """At 15 m/s the other is 0.45 m further after 0.03 s, and 60 m after 4 s."""
    follow = _following(_line(_at(1, 70.0), _at(1, 90.0)))
    events = CUT_IN.replace(ACROSS, follow) if when == "gap" else timed(follow, when)
    path = changed(tmp_path, (' offset="0.25"', ""), events=events)
    sentence = "<FollowTrajectoryAction>: the trajectory must begin before `Other` leaves its start"
    with nullcontext() if plays else refusal(sentence):
        read_file(path)


@pytest.mark.parametrize("name", ["None", "if"])
def test_a_written_scenario_reads_whatever_its_actor_is_called(tmp_path, name):
    """Its brake begins by a condition that names the actor; expressions have words of their own."""
    events = CUT_IN.replace(ACROSS, BRAKE)
    read = read_file(changed(tmp_path, ('"Other"', f'"{name}"'), events=events))
    write_scenario(scenario_content(read, {}), tmp_path / "mine.toml")
    (other,) = only_case(tmp_path / "mine.toml").actors
    assert other.name == f"other_{name}"


def test_a_stop_may_be_at_the_largest_time(tmp_path):
    logical = space_of(changed(tmp_path, ('value="30" rule="gr', 'value="1.7e308" rule="gr')))
    assert logical.road.length == pytest.approx(1000.0 - 2.0 - 5.0)


def test_who_only_remembers_a_condition_stands(tmp_path):
    """In the left lane, beside the ego's path; its move by 0 m waits for an edge."""
    stays = ACROSS.replace('"Ego"', '"Other"').replace("<LaneChangeAction>",
        '<LaneChangeAction targetLaneOffset="0.25">')  # fmt: skip
    events = CUT_IN.replace(ACROSS, stays).replace('rule="lessThan"', 'rule="greaterThan"')
    path = changed(tmp_path, ('value="-5"', 'value="-20"'), events=events)
    assert only_case(path).actors[0].acts
    assert any("no actor moves or stands in the way" in it for it in space_of(path).notes)


@pytest.mark.parametrize("kept, what", [
    (KEPT.format("Third", "true", ""), "distance"),
    (KEPT.format("Third", "true", '<DynamicConstraints maxAcceleration="3"/>'), "distance"),
    ("""<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="step" value="0"
    dynamicsDimension="time"/><SpeedActionTarget><RelativeTargetSpeed entityRef="Third" value="0"
    speedTargetValueType="delta" continuous="true"/></SpeedActionTarget></SpeedAction>
    </LongitudinalAction>""", "speed"),
])  # fmt: skip
def test_no_distance_or_speed_is_kept_to_an_oncoming_vehicle(tmp_path, kept, what):
    """Both come towards the ego in the left lane: along the road their speeds are below 0."""
    back = """<LanePosition roadId="0" laneId="1" s="{}"><Orientation type="relative"
    h="3.14159265358979"/></LanePosition>"""
    third = """<ScenarioObject name="Third"><CatalogReference catalogName="cars" entryName="car"/>
    </ScenarioObject></Entities>"""
    there = f"""<Private entityRef="Third"><PrivateAction><TeleportAction><Position>
    {back.format(500)}</Position></TeleportAction></PrivateAction></Private></Actions></Init>"""
    path = changed(tmp_path, (OTHER_PLACE, back.format(540)), ("</Entities>", third),
        ("</Actions></Init>", there), events=timed(kept, 1))  # fmt: skip
    sentence = f"must drive along the road as the ego does: `Other` keeps its {what} relative to"
    with refusal(sentence):
        read_file(path)


def test_a_stop_by_two_times_is_the_later(tmp_path):
    both = """<Condition name="f" delay="0" conditionEdge="none"><ByValueCondition>
    <SimulationTimeCondition value="40" rule="greaterThan"/></ByValueCondition></Condition>
    </ConditionGroup></StopTrigger>"""
    assert space_of(changed(tmp_path, ("</ConditionGroup></StopTrigger>", both))).time_limit == 40.0


@pytest.mark.parametrize("when, plays", [(1, True), (10, False)])
def test_a_distance_to_a_vehicle_that_passes_before_has_a_side(tmp_path, when, plays):
    """The ego, 5 m/s faster, passes the other, 10 m ahead in the left lane, after 2 s."""
    path = changed(tmp_path, ('ds="50"', 'ds="10"'),
        events=timed(KEPT.format("Ego", "true", ""), when))  # fmt: skip
    with nullcontext() if plays else refusal("`displacement` must say whether `Other` leads"):
        read_file(path)


def test_a_time_that_held_counts_in_a_file_for_carla(tmp_path):
    """As in CARLA's example FollowLeadingVehicle: a time equal to 0 and a way of the ego."""
    at_once = """<Condition name="t" delay="0" conditionEdge="rising"><ByValueCondition>
    <SimulationTimeCondition value="0" rule="equalTo"/></ByValueCondition></Condition>
    </ConditionGroup>"""
    events = CUT_IN.replace("</ConditionGroup>", at_once).replace('delay="0.5"', 'delay="0"')
    carla = 'description="a test"', 'description="CARLA:a test"'
    with refusal("together with a time until which it may hold"):
        acts_of(tmp_path, events=events)
    assert len(acts_of(tmp_path, carla, events=events)) == 1


@pytest.mark.parametrize("begin, plays", [(0, True), (2, False)])
def test_a_target_beside_a_vehicle_that_has_moved_is_refused(tmp_path, begin, plays):
    """After 2 s the ego, from which it counts, is 40 m further."""
    place = '<RelativeLanePosition entityRef="Ego" dLane="{}" ds="200"/>'
    meet = f"""<SynchronizeAction masterEntityRef="Ego"><TargetPositionMaster>{place.format(0)}
    </TargetPositionMaster><TargetPosition>{place.format(1)}</TargetPosition></SynchronizeAction>"""
    with nullcontext() if plays else refusal("a place beside an entity that has moved"):
        read_file(changed(tmp_path, events=timed(meet, begin)))


def test_stories_and_manoeuvres_have_parameters_of_their_own(tmp_path):
    """The story's `who` is whom the group moves, the manoeuvre's `far` replaces the story's; the
    act has begun."""
    one = '<ParameterDeclaration name="{}" parameterType="string" value="{}"/>'.format
    own = "<ParameterDeclarations>{}</ParameterDeclarations>".format
    story, move = '<Story name="s">', '<Maneuver name="m">'
    path = changed(
        tmp_path,
        (story, story + own(one("who", "Other") + one("far", "99"))),
        (move, move + own(one("far", "${10 * 3}"))),
        ('"Other"/></Actors>', '"$who"/></Actors>'),
        ('value="30"/></EntityCondition>', 'value="$far"/></EntityCondition>'),
        events=CUT_IN,
    )
    assert only_case(path).actors == only_case(written(tmp_path, events=CUT_IN)).actors


def test_a_case_ends_before_sumo_takes_the_ego_off_the_road(tmp_path):
    """50 m/s for 30 s is more than the road's 1000 m: half a body of 4 m and 5 m for a step at full
    speed are left."""
    logical = space_of(written(tmp_path, v="50"))
    assert logical.road.length == pytest.approx(1000.0 - 2.0 - 5.0)
    assert logical.road.length + logical.road.run_out == pytest.approx(1000.0)


def test_why_every_point_counts_as_safe_is_said(tmp_path):
    path = written(tmp_path, events=timed(BRAKE, 2))
    (said,) = (note for note in space_of(path).notes if "counts as safe" in note)
    assert "`?zones=1`" in said
    searched = find(f"{path}?zones=1")
    assert searched.search is not None
    assert not any("counts as safe" in note for note in searched.notes)


@needs_catalogues
def test_all_files_of_un_r157_play():
    """The 15 files; those whose range is large are tried along each axis."""
    files = sorted((ALKS / "concrete_scenarios").glob("alks_*_template.xosc"))
    assert len(files) == 15
    for file in files:
        assert [why for _, why in concrete_points(read_file(file))] == [None], file.name


@needs_catalogues
def test_of_a_file_whose_road_is_decided_by_two_parameters_every_point_of_each_road_plays():
    """UN R157's crossing pedestrian: 5 roads, 2 lanes to start in and 12 speeds are 120 points; the
    ego's lane is the origin of the road's frame, so a bend is another road from another lane, and
    only the straight one has both lanes."""
    file = ALKS / "alks_scenario_4_2_3_crossing_pedestrian_variation.xosc"
    reads = [read for _, read in uses_of(file, file.name)]
    assert sorted(read.space.size for read in reads) == [12] * 8 + [24]
    assert all(why is None for read in reads for _, why in concrete_points(read))


@pytest.mark.campaign
@needs_catalogues
def test_values_that_play_nowhere_are_counted_with_their_reason():
    """UN R157's several targets: 12 speeds, 6 first and 5 second bodies.

    The first one's truck of 18.75 m reaches 16.375 m from its axle, the second bodies begin 12.25
    to 14.3 m from there: 60 of the 360 points of a road.
    """
    file = ALKS / "alks_scenario_4_2_4_multiple_blocking_targets_variation.xosc"
    reasons = [why for _, why in concrete_points(read_file(file)) if why is not None]
    assert len(reasons) == 60
    assert len(set(reasons)) == 1
    blocked = (
        "<ScenarioObject>: Vehicle `TargetBlocking2` must be clear of `TargetBlocking` at the start"
    )
    assert blocked in reasons[0]


@needs_catalogues
def test_the_files_of_euro_ncap_play_without_their_night_duplicates():
    """22 of 22 play, 388 of 388 cases by day; an ego that turns does so on three radii, 3 cases
    each."""
    counts = {}
    for file in sorted(NCAP.glob("*.xosc")):
        reads = [read for _, read in uses_of(file, file.name)]
        counts[file.stem] = sum(why is None for read in reads for _, why in concrete_points(read))
        assert len(reads) == (3 if file.stem in ("CCFtap", "CMFtap") else 1)
    assert sum(counts.values()) == 388
    assert counts == dict(rows_of("""
CBFA | 12
CBLA | 5
CBLA_FCW | 4
CBNA | 12
CBNAO | 12
CCCscp | 50
CCFhos | 18
CCFtap | 9
CCRb | 30
CCRm | 55
CCRs | 25
CCRs_FCW | 15
CMCscp | 50
CMFtap | 9
CMRb | 18
CMRs | 15
CMRs_FCW | 9
CPFA | 6
CPLA | 6
CPLA_FCW | 4
CPNA | 18
CPNCO | 6
""", str, int))  # fmt: skip


@needs_catalogues
def test_a_pedestrian_of_euro_ncap_meets_the_bumper_where_the_protocol_says():
    """CPNA at 50 %: when an ego that keeps 30 km/h has its bumper at the pedestrian's near side,
    its hip (0.06 m ahead of its centre) is on the ego's middle line; it walks 5 km/h over the 3 m
    before, which it reaches in 1 m."""
    scene = read_file(NCAP / "CPNA.xosc").logical.concrete(Ego_speed_kph=30.0, ImpactLocation=50.0)
    (walker,) = scene.actors
    bumper = scene.ego.x + 0.5 * scene.ego_body.length
    arrives = (walker.start.x - 0.25 - bumper) / scene.ego.speed
    ((stands, still), (walks, speed)) = walker.acts[0].table
    assert still == 0.0
    assert speed == pytest.approx(5.0 / 3.6)
    covered = 0.5 * (walks - stands) * speed + (arrives - walks) * speed
    # 1 m, and the hip's 0.06 m
    assert 0.5 * (walks - stands) * speed == pytest.approx(1.06, abs=1e-6)
    assert walker.start.y + covered - 0.06 == pytest.approx(scene.ego.y, abs=1e-6)


@needs_catalogues
def test_who_turns_across_the_way_of_a_motorcycle_is_where_the_protocol_says_when_they_meet():
    """CMFtap, 20 km/h on R2 = 14.75 m: the point that both are steered to is where the middle of
    the ego's bumper is on the middle of the oncoming lane, so contact comes as soon as the front of
    either is over the other's body: before the planned instant, by less than the motorcycle's half
    width of 0.395 m takes at the ego's 5.56 m/s.
    """
    read = read_file(NCAP / "CMFtap.xosc", {"road": "3"})
    for kph in (30.0, 60.0):
        case = read.logical.concrete(Target_final_speed_kph=kph)
        (other,) = case.actors
        (_, (until, _)) = other.acts[0].table
        # its plan begins at 0.5 s, and 50 m at the final speed end it
        planned = 0.5 + until + 50.0 / (kph / 3.6)
        hit = simulate(case, "no_reaction").collision
        assert -0.2 < hit.time - planned < 0.05
        assert math.hypot(*hit.other_velocity) == pytest.approx(kph / 3.6, abs=1e-3)


@needs_catalogues
def test_every_element_that_the_catalogues_use_is_in_the_list():
    """Actions, conditions and positions of all scenario files, by their names in the standard."""
    known = {name for rows in ROWS.values() for name in rows}
    for file in [*(ALKS / "concrete_scenarios").glob("*.xosc"), *NCAP.parents[1].glob("*.xosc")]:
        for element in etree.parse(file).iter():
            tag = str(element.tag)
            if (
                tag.endswith(("Condition", "Position"))
                and tag != "Condition"
                and len(element.attrib)
            ):
                assert tag in known, (file.name, tag)
            if tag.endswith("Action") and element.getparent().tag in (
                "PrivateAction",
                "LongitudinalAction",
            ):
                assert tag in known or tag in (
                    "LongitudinalAction",
                    "LateralAction",
                    "RoutingAction",
                ), (file.name, tag)


@pytest.mark.parametrize("events",
    ["", CUT_IN, CUT_IN.replace("sinusoidal", "linear"), timed(OFFSET, 2),
                                    CUT_IN + timed(BRAKE, ENDED.format("cut"), n=2, delay=1)])  # fmt: skip
def test_the_scenario_file_that_was_understood_says_the_same(tmp_path, events):
    """Everybody starts at the same place and does the same, by the scenario file as by the imported
    one."""
    read = read_file(written(tmp_path, events=events))
    write_scenario(scenario_content(read, {}), tmp_path / "again.toml")
    theirs, again = read.logical.concrete(only=0.0), only_case(tmp_path / "again.toml")
    assert unnamed(again) == unnamed(theirs)
    assert again.road.name == theirs.road.name


def test_a_file_alone_is_driven_with_the_papers_settings(tmp_path):
    """One point, by `idm` and `lane_changer`."""
    done = sumo_eval("run", written(tmp_path, events=CUT_IN), "--dry-run")
    assert done.said.startswith("2 drives of the ADSs")


def test_one_point_is_written_and_a_whole_space_is_not(tmp_path):
    """54 km/h = 15 m/s; the other is 5 m/s slower."""
    scenario = written(tmp_path, events=CUT_IN)
    path = tmp_path / "variation.xosc"
    path.write_text(VARIATION.format(file=scenario.name, parts=RANGE.format(name="kph")))
    read = read_file(path)
    write_scenario(scenario_content(read, {"kph": 54.0}), tmp_path / "again.toml")
    again = only_case(tmp_path / "again.toml")
    assert (again.ego.speed, again.actors[0].start.speed) == pytest.approx((15.0, 10.0))
    assert unnamed(again) == unnamed(read.logical.concrete(kph=54.0))
    result = cli_refuses(
        "must have `--set` for kph: it writes one point",
        f"import {path} --out {tmp_path}/space.toml",
    )
    assert (
        'The whole space plays from the OpenSCENARIO file itself: `use = "FILE.xosc"`'
        in result.said
    )
    assert not (tmp_path / "space.toml").exists()


def test_the_written_space_of_an_ego_that_turns_has_the_other_on_the_map(tmp_path):
    read = read_file(turning(tmp_path))
    content = scenario_content(read, {})
    assert content["vehicle"][0]["on_map"] is True
    write_scenario(content, tmp_path / "again.toml")
    assert unnamed(only_case(tmp_path / "again.toml")) == unnamed(read.logical.concrete(only=0.0))
    content["vehicle"][0] |= {"gap": 30.0}
    del content["vehicle"][0]["x"]
    write_scenario(content, tmp_path / "wrong.toml")
    with refusal("has no gap beside `on_map`"):
        find("wrong.toml", tmp_path)


def test_a_condition_too_long_for_a_scenario_file_is_refused(tmp_path):
    events = CUT_IN.replace(ACROSS, BRAKE).replace('delay="0.5"', 'delay="0"')
    one = events[events.index("<Condition ") : events.index("</ConditionGroup>")]
    read = read_file(written(tmp_path, events=events.replace(one, 40 * one)))
    with refusal("nested too deep. The case plays from the OpenSCENARIO file itself."):
        scenario_content(read, {})


def test_an_event_below_does_not_move_the_awaited_end_of_a_change(tmp_path):
    """15 m/s become 5 m/s from 2 s on, so braking at 5 m/s2 from 10 s on ends at 11 s, not 13 s."""
    slower = timed(BRAKE.replace('value="0"', 'value="5"'), 2, n=2)
    brake, then = timed(BRAKE, 10), timed(OFFSET, COMPLETE.format("e1"), n=3)
    acts = acts_of(tmp_path, events=slower + brake + then)
    assert acts[2].begin == pytest.approx(11.0)
    assert acts_of(tmp_path, events=brake + slower)  # not awaited
    with refusal("may move before by an event below it in the file"):
        acts_of(tmp_path, events=brake + slower + then)


def test_a_speed_relative_to_a_deleted_entity_is_refused(tmp_path):
    """`Third` is deleted at 0 s, so it has no speed when the other's changes at 2 s."""
    third = """<ScenarioObject name="Third"><CatalogReference catalogName="cars" entryName="car"/>
    </ScenarioObject></Entities>"""
    gone = """<Private entityRef="Third"><PrivateAction><TeleportAction><Position>
    <LanePosition roadId="0" laneId="-1" s="500"/></Position></TeleportAction></PrivateAction>
    </Private><GlobalAction><EntityAction entityRef="Third"><DeleteEntityAction/></EntityAction>
    </GlobalAction></Actions></Init>"""
    relative = '<RelativeTargetSpeed entityRef="Third" speedTargetValueType="delta" value="0"/>'
    events = timed(BRAKE.replace('<AbsoluteTargetSpeed value="0"/>', relative), 2)
    path = changed(tmp_path, ("</Entities>", third), ("</Actions></Init>", gone), events=events)
    with refusal("entity `Third` is deleted at the start, so nothing depends on it"):
        read_file(path)


@needs_catalogues
@pytest.mark.parametrize("name", [
    "CPNA.xosc", "CCRb.xosc", "CCCscp.xosc", "CMFtap.xosc?road=2",
    "alks_scenario_4_1_2_swerving_lead_vehicle_variation.xosc?road=2",
    "alks_scenario_4_1_1_free_driving_variation.xosc",
])  # fmt: skip
def test_a_written_point_is_the_case_of_the_file(tmp_path, name):
    plain, _, road = name.partition("?road=")
    read = read_file(
        (ALKS if plain.startswith("alks") else NCAP) / plain, {"road": road} if road else {}
    )
    points = [point for point, why in concrete_points(read) if why is None]
    for number, point in enumerate((points[0], points[-1])):
        write_scenario(scenario_content(read, point), tmp_path / f"{number}.toml")
        assert unnamed(only_case(tmp_path / f"{number}.toml")) == unnamed(concrete(read, point))


def test_what_cannot_be_written_is_refused(tmp_path):
    read = read_file(written(tmp_path))
    with refusal("kph"):
        scenario_content(read, {"kph": 50.0})
    with refusal(r"must be a file that ends with .toml"):
        write_scenario({}, tmp_path / "x.xosc")


@pytest.mark.parametrize(
    "written, value", [("$kph", None), ("$Ego_Kmh", None), ("${$kph / 3.6}", 20.0), ("$v", 5.0)]
)
def test_a_parameter_in_km_h_is_never_taken_as_m_s(written, value):
    element = etree.fromstring(f'<AbsoluteTargetSpeed value="{written}"/>')
    part = Node(element, {"kph": 72.0, "Ego_Kmh": 72.0, "v": 5.0})
    if value is not None:
        assert part.number("value") == value
        return
    with refusal(r"must be in m/s, got .* in km/h"):
        part.number("value")
