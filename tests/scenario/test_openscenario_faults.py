"""Files of OpenSCENARIO that are wrong, or ask for what is not played, through the command line:
one sentence each."""

import math
import re
from pathlib import Path

import pytest
from commands import cli_refuses, sumo_eval
from tables import rows_of, values_of

from sumo_eval.extras.openscenario.collections import entries_of
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import ScenarioSettings
from tests.scenario.test_openscenario import (
    BRAKE,
    CARS,
    EGO_PLACE,
    OTHER_PLACE,
    ROAD,
    VARIATION,
    only_case,
    timed,
    written,
)


def said(path):
    """What `import` refuses a file with: exit status 2, one sentence in one line."""
    result = sumo_eval("import", path, status=2)
    assert len(result.stderr.strip().splitlines()) == 1, result.stderr
    assert result.stderr.strip()[-1] in ".?", result.stderr
    return result.stderr.strip()


@pytest.mark.parametrize(
    "words, sentence",
    values_of("""
    "osc_alks --out a.toml", "`--out` is for one file"
    "osc_alks?speed=1", "Options `?` are for one file"
    "a.xosc --set speed=1", "got no `--out`"
    "a.xosc --folder .", "`--folder` is for a catalogue"
    ".", "got '.'. Known: osc_alks"
    """),
)
def test_options_that_import_would_ignore_are_refused(words, sentence):
    cli_refuses(sentence, "import", *words.split())


def test_catalogue_of_which_nothing_plays_is_status_2(tmp_path):
    (tmp_path / "broken_variation.xosc").write_text("<OpenSCENARIO>")
    done = cli_refuses(
        "A file of catalogue `osc_alks` must play, got none",
        "import", "osc_alks", "--folder", tmp_path,
    )  # fmt: skip
    assert done.stdout.endswith("osc_alks: 0 of 1 files play, 0 of 0 points tried\n")


def change(path, old, new):
    """The same file with a part of its text replaced."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


def lane_change(n, when, target, lasts=2.0):
    """An event with a move of the other into a lane."""
    action = f"""<LateralAction><LaneChangeAction><LaneChangeActionDynamics dynamicsShape="sinusoidal" value="{lasts}"
    dynamicsDimension="time"/><LaneChangeTarget>{target}</LaneChangeTarget></LaneChangeAction></LateralAction>"""
    return timed(action, when, n=n)


def speed_change(n, when, to, seconds, priority="overwrite"):
    """An event with a change of the other's speed."""
    action = f"""<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="linear" dynamicsDimension="time"
    value="{seconds}"/><SpeedActionTarget><AbsoluteTargetSpeed value="{to}"/></SpeedActionTarget></SpeedAction>
    </LongitudinalAction>"""
    return timed(action, when, n=n).replace('priority="overwrite"', f'priority="{priority}"')


SELF = '<RelativeTargetLane entityRef="Other" value="{}"/>'
BY_ENTITY = """<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="{one}"/>
</TriggeringEntities><EntityCondition>{condition}</EntityCondition></ByEntityCondition>"""
GAP = """<RelativeDistanceCondition entityRef="{other}" relativeDistanceType="longitudinal" freespace="true"
rule="lessThan" value="30"/>"""
SOON = '<ByValueCondition><SimulationTimeCondition value="3" rule="lessThan"/></ByValueCondition>'
SLOW = '<SpeedCondition rule="lessThan" value="3" direction="lateral"/>'


def by(condition, one="Ego", other="Other"):
    """A condition on an entity, and on another one."""
    return BY_ENTITY.format(one=one, condition=condition.format(other=other))


def when(condition, more=""):
    """A brake of the other that begins by a condition, and by another one of the same group."""
    group = "".join('<Condition name="c" delay="0" '
                    f'conditionEdge="none">{it}</Condition>' for it in (condition, more)
                    if it)  # fmt: skip
    return f"""<Event name="e" priority="overwrite"><Action name="act"><PrivateAction>{BRAKE}</PrivateAction></Action>
    <StartTrigger><ConditionGroup>{group}</ConditionGroup></StartTrigger></Event>"""


def after(ref, state="endTransition"):
    """A brake of the other once an event has ended."""
    ended = (
        '<StoryboardElementStateCondition storyboardElementType="event" '
        f'storyboardElementRef="{ref}" state="{state}"/>'
    )
    return timed(BRAKE, ended, n=9)


EVENTS = {
    r"<RelativeTargetLane>: lane `3` is not on road `0` of road.xodr, which has 1, -1": lane_change(
        1, 1.0, SELF.format(2)
    ),
    r"<RelativeTargetLane>: `value` must be a whole number, got 0.5": lane_change(
        1, 1.0, SELF.format(0.5)
    ),
    r"<AbsoluteTargetLane>: lane `-1.5` is not on road": lane_change(
        1, 1.0, '<AbsoluteTargetLane value="-1.5"/>'
    ),
    r"<SpeedActionDynamics>: `Other` still changes its speed when this begins, at 2 s": (
        speed_change(1, 0.0, 5.0, 6.0) + speed_change(2, 2.0, 20.0, 3.0)
    ),
    r"<SpeedActionDynamics>: `dynamicsShape` must be one of linear, step, cubic, sinusoidal, got": (
        speed_change(1, 0.0, 5.0, 1.0)
        + speed_change(2, 4.0, 5.0, 1.0).replace('Shape="linear"', 'Shape="bent"')
    ),
    r"<SpeedActionDynamics>: `value` must be above 0, got -3": (
        when(by(GAP)) + speed_change(2, 8.0, 5.0, -3.0)
    ),
    r"<LongitudinalDistanceAction>: `distance` must be at least 0, got -30": timed(
        '<LongitudinalAction><LongitudinalDistanceAction entityRef="Ego" distance="-30" '
        'freespace="true" continuous="true"/></LongitudinalAction>',
        1,
    ),
    r"<LongitudinalDistanceAction>: `coordinateSystem` must be one of entity, lane, road, got": timed(
        '<LongitudinalAction><LongitudinalDistanceAction entityRef="Ego" distance="30" '
        'coordinateSystem="world" freespace="true" continuous="true"/></LongitudinalAction>',
        1,
    ),
    r"<Event>: with its priority `overwrite` it ends while event `e1` runs": (
        speed_change(1, 0.0, 5.0, 6.0) + lane_change(2, 2.0, SELF.format(-1))
    ),
    r"<Event>: with its priority `skip` it is left out while event `e1` runs": (
        speed_change(1, 0.0, 5.0, 6.0)
        + speed_change(2, 2.0, 20.0, 3.0, "skip").replace('"time"', '"rate"')
    ),
    r"<Condition>: a condition on the drive is not supported together with a time until which": when(
        by(GAP), SOON
    ),
    r"<Condition>: a condition on the drive is not supported together with a time until": when(
        by(GAP), SOON.replace("lessThan", "equalTo")
    ),
    r"<SimulationTimeCondition>: the time grows, so `lessThan` never has the edge `rising`": (
        when(SOON).replace('Edge="none"', 'Edge="rising"')
    ),
    r"<SpeedCondition>: `direction` must be longitudinal to be supported, got 'lateral'": when(
        by(SLOW, one="Other")
    ),
    r"<RelativeDistanceCondition>: entity `Nobody` is not among Ego, Other": when(
        by(GAP, other="Nobody")
    ),
}


@pytest.mark.parametrize("sentence", EVENTS)
def test_events_that_would_be_played_wrongly_are_refused(tmp_path, sentence):
    found = said(written(tmp_path, events=EVENTS[sentence]))
    assert "scenario.xosc, line " in found
    assert re.search(sentence, found), found


EVENTS |= {
    r"<Event>: deleting an entity during the drive is not supported": (
        speed_change(1, 0.0, 5.0, 2.0)
        + after("e1").replace(
            f"<PrivateAction>{BRAKE}</PrivateAction>",
            '<GlobalAction><EntityAction entityRef="Other"><DeleteEntityAction/></EntityAction>'
            "</GlobalAction>",
        )
    ),
    r"<StoryboardElementStateCondition>: 2 elements are called event `e1`: a path such as": (
        speed_change(1, 0.0, 5.0, 2.0) + speed_change(1, 4.0, 9.0, 2.0) + after("e1")
    ),
    r"<ParameterCondition>: parameter `light` is set during the drive": when(
        '<ByValueCondition><ParameterCondition parameterRef="light" value="night" '
        'rule="equalTo"/></ByValueCondition>'
    ) + """<Event name="n" priority="parallel"><Action name="sets"><GlobalAction><ParameterAction parameterRef="light">
    <SetAction value="night"/></ParameterAction></GlobalAction></Action></Event>""",
}  # fmt: skip
SETS = next(it for it in EVENTS if "is set during the drive" in it)
EVENTS[f"line .*{SETS}"] = EVENTS[SETS].replace(
    '<ParameterAction parameterRef="', '<ParameterAction parameterRef="$'
)
TEXTS = {name: row for name, *row in rows_of(r"""
<SimulationTimeCondition>: a stop by time must come after the start, got lessThan 30 s
| value="30" rule="greaterThan" | value="30" rule="lessThan"
<ScenarioObject>: its speed at the start must be at most 60 m/s, the fastest | ${$kph / 3.6} | 61
`value` must be a finite number, got '\$v', which is '2_0' | ${$kph / 3.6} | 2_0
expression .* divides by zero | ${$kph / 3.6} | ${$kph % 0}
<ManeuverGroup>: a group of manoeuvres must run once | maximumExecutionCount="1"
| maximumExecutionCount="2"
<ScenarioObject>: there is another entity with the name `Ego` | <ScenarioObject name="Other">
| <ScenarioObject name="Ego">
<RelativeLanePosition>: `dLane` must be a whole number, got 0.5 | dLane="1" | dLane="0.5"
<LanePosition>: road `7` is not in road.xodr | roadId="0" | roadId="7"
<CatalogReference>: entry `truck` is not in catalog `cars` | entryName="car" | entryName="truck"
<ParameterAssignments>|<CatalogReference>|<ParameterDeclarations>: parameter `wide` is not declared
| parameterRef="long" | parameterRef="wide"
<OpenSCENARIO>: <Entities> is missing in it | Entities> | Entitys>
<Init>: it must hold one <Actions>, got 2 | <Init> | <Init><Actions/>
holds `\$kph and 2` | ${$kph / 3.6} | ${$kph and 2}
bracket does not close | ${$kph / 3.6} | ${$kph / 3.6
parameter `kmh` is not declared. Did you mean `kph` | ${$kph / 3.6} | ${max(pow($kmh, 2), 1)}
<OpenSCENARIO>|<RoadNetwork>: it must hold one <LogicFile>, got 2 | <RoadNetwork>
| <RoadNetwork><LogicFile filepath="road.xodr"/>
<Private>: entity `Third` is not among | <Private entityRef="Other"> | <Private entityRef="Third">
""")} | {
    r"<StopTrigger>: an act that a time stops while an actor moves in it": (
        "</ManeuverGroup>", '</ManeuverGroup><StopTrigger><ConditionGroup><Condition name="x" '
                            'delay="0" '
        'conditionEdge="none"><ByValueCondition><SimulationTimeCondition value="2" '
        'rule="greaterThan"/>'
        "</ByValueCondition></Condition></ConditionGroup></StopTrigger>"
    ),
}  # fmt: skip


@pytest.mark.parametrize("sentence", TEXTS)
def test_a_file_with_one_thing_wrong_is_refused_with_its_element(tmp_path, sentence):
    old, new = TEXTS[sentence]
    path = written(tmp_path, events=speed_change(1, 0.0, 5.0, 6.0))
    text = path.read_text()
    assert old in text
    many = old in ("Entities>",)
    path.write_text(text.replace(old, new) if many else text.replace(old, new, 1))
    found = said(path)
    assert re.search(sentence, found), found


ROADS = {name: row for name, *row in rows_of(r"""
<lane>: `id` must be a whole number, got 1\.5 | <lane id="-1" | <lane id="1.5"
<lane>: `id` must be a finite number, got 'one' | <lane id="-1" | <lane id="one"
<lane>: its width must be one constant of at least 0 m | a="3.5" | a="-3.5"
<laneSection>: the first <laneSection> must begin at s = 0 | <laneSection s="0"> | <laneSection s="9">
<width>: `a` must be a finite number, got 'wide' | a="3.5" | a="wide"
<width>: `b` must be a finite number, got 'steep' | b="0" | b="steep"
`length` of <geometry>.* must be a number|length | hdg="0.5" length="1000"
| hdg="0.5" length="long"
<road>: there is another road with the `id` 0 | <OpenDRIVE>
| <OpenDRIVE><road id="0" length="1" junction="-1"/>
must be <OpenDRIVE> | OpenDRIVE> | OpenROAD>
<GeoPosition>: the <geoReference> .* in m and decimal degrees, got | +lat_0=4.8e1 | +lat_0=48d30'N
<GeoPosition>: the <geoReference> .* m and decimal degrees, got .*us-ft | +lon_0=11 | +units=us-ft
<GeoPosition>: the <geoReference> .* on WGS 84, .*bessel | +lon_0=11 | +ellps=bessel
<GeoPosition>: the <geoReference> .* on WGS 84, .*neu | +lon_0=11 | +lon_0=11 +axis=neu
must not declare a document type or entities, got <!DOCTYPE> in line 1: | <OpenDRIVE>
| <!DOCTYPE OpenDRIVE []><OpenDRIVE>
is in no lane; road.xodr, line 2, <road>: its lanes must be the same in every .* are not supported \(got 2
| <lanes>
| <lanes><laneSection s="0"/>
""")} | {
    r"<GeoPosition>: .* of \+proj=tmerc or \+proj=utm \+zone=1\.\.60, .*zone=61": (
        "+proj=tmerc", "+proj=utm +zone=61 "
    ),
}  # fmt: skip


@pytest.mark.parametrize("sentence", ROADS)
def test_a_road_with_one_thing_wrong_is_refused_with_its_element(tmp_path, sentence):
    path = written(tmp_path)
    if "GeoPosition" in sentence:
        change(path, OTHER_PLACE, '<GeoPosition latitudeDeg="48" longitudeDeg="11"/>')
    if "no lane" in sentence:
        change(path, EGO_PLACE, '<WorldPosition x="22.6" y="16.6" h="0.5"/>')
    old, new = ROADS[sentence]
    assert old in ROAD
    road = ROAD.replace(old, new) if old == "OpenDRIVE>" else ROAD.replace(old, new, 1)
    (tmp_path / "road.xodr").write_text(road)
    found = said(path)
    assert re.search(sentence, found), found


def test_ego_at_the_end_of_its_road_is_refused(tmp_path):
    path = change(written(tmp_path), EGO_PLACE, EGO_PLACE.replace("20", "994"))
    change(path, OTHER_PLACE, EGO_PLACE)
    assert "<ScenarioObject>: its front must be over 5 m before its road's end" in said(path)


KEEPS = """<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time"
value="0"/><SpeedActionTarget><RelativeTargetSpeed entityRef="Ghost" value="0" speedTargetValueType="delta"
continuous="true"/></SpeedActionTarget></SpeedAction></LongitudinalAction>"""
NEAR = """<LongitudinalAction><LongitudinalDistanceAction entityRef="Ghost" distance="30" freespace="true"
continuous="true"/></LongitudinalAction>"""


def deletion(name):
    """An event at the start in which an entity is deleted."""
    return re.sub(
        "<PrivateAction>.*</PrivateAction>",
        f'<GlobalAction><EntityAction entityRef="{name}"><DeleteEntityAction/></EntityAction>'
        "</GlobalAction>",
        timed(BRAKE, 0, n=9),
        flags=re.DOTALL,
    )


@pytest.mark.parametrize("action", [KEEPS, NEAR])
def test_moves_relative_to_a_deleted_entity_are_refused(tmp_path, action):
    """The other must not follow the ego instead of an entity that is deleted at 0 s."""
    path = written(tmp_path, events=deletion("Ghost") + timed(action, 1))
    ghost = """<ScenarioObject name="Ghost"><CatalogReference catalogName="cars" entryName="car"/>
    </ScenarioObject></Entities>"""
    change(path, "</Entities>", ghost)
    place = '<Private entityRef="Ghost"><PrivateAction><TeleportAction><Position>'
    place += EGO_PLACE.replace("20", "200")
    place += "</Position></TeleportAction></PrivateAction></Private></Actions></Init>"
    change(path, "</Actions></Init>", place)
    assert "entity `Ghost` is deleted at the start, so nothing depends on it" in said(path)


@pytest.mark.parametrize("at_init", [True, False])
def test_deletion_of_the_ego_is_refused(tmp_path, at_init):
    path = written(tmp_path, events="" if at_init else deletion("Ego"))
    if at_init:
        gone = '<GlobalAction><EntityAction entityRef="Ego"><DeleteEntityAction/></EntityAction>'
        change(path, "</Actions></Init>", gone + "</GlobalAction></Actions></Init>")
    assert "<ScenarioObject>: it must not be deleted: the ADS drives it" in said(path)


def test_activated_controller_marks_the_ego(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace('"Ego"', '"Hero"'))
    begin = '<Private entityRef="Hero">'
    change(path, begin, begin + "<PrivateAction><ActivateControllerAction/></PrivateAction>")
    assert only_case(path).ego.speed == pytest.approx(20.0)
    change(path, '<Private entityRef="Other">', '<Private entityRef="Old">')
    assert "<Private>: entity `Old` is not among Hero, Other" in said(path)


def test_two_lateral_moves_each_start_from_their_lane(tmp_path):
    """From lane 1 one lane to the right and one to the left again, each relative to itself: 0 m and
    then as it began, 0.25 m beside its lane's middle at the start.
    """
    events = lane_change(1, 1.0, SELF.format(-1)) + lane_change(2, 5.0, SELF.format(1))
    (other,) = only_case(written(tmp_path, events=events)).actors
    assert [move.offset for move in other.lateral_moves] == pytest.approx([-3.75, 3.5])
    assert [move.begin for move in other.lateral_moves] == [1.0, 5.0]


def test_lanes_count_to_the_left_of_where_their_entity_drives(tmp_path):
    """The other comes towards the ego in lane 1; one lane to its left is lane -1."""
    back = OTHER_PLACE.replace("/>", '><Orientation type="relative" h="3.14159265"/>')
    path = written(tmp_path, events=lane_change(1, 1.0, SELF.format(1)))
    (other,) = only_case(change(path, OTHER_PLACE, back + "</RelativeLanePosition>")).actors
    assert other.acts[0].offset == pytest.approx(3.75)


def test_each_road_of_a_file_is_an_entry_in_any_folder(tmp_path):
    folder = tmp_path / "road=1"
    folder.mkdir()
    path = change(written(folder), 'roadId="0"', 'roadId="$light"')
    road = ROAD[ROAD.index("<road") : ROAD.index("</OpenDRIVE>")]
    long = road.replace("1000", "1500").replace('id="0"', 'id="1"', 1)
    (folder / "road.xodr").write_text(f"<OpenDRIVE>{road}{long}</OpenDRIVE>")
    part = """<DeterministicSingleParameterDistribution parameterName="light"><DistributionSet>
    <Element value="0"/><Element value="1"/></DistributionSet></DeterministicSingleParameterDistribution>"""
    (folder / "varied.xosc").write_text(VARIATION.format(file=path.name, parts=part))
    use = "road=1/varied.xosc"
    entries = entries_of(ScenarioSettings(use=use), tmp_path)
    assert [entry.use for entry in entries] == [f"{use}?road=1", f"{use}?road=2"]
    second = sumo_eval("import", folder / "varied.xosc?road=2").stdout
    assert "this is road 2 of 2" in second
    assert "`?road=2`" not in second
    assert "`road` of varied.xosc must be a whole number within 1..2" in said(
        folder / "varied.xosc?road=²"
    )


def test_an_event_is_found_by_the_path_to_it(tmp_path):
    """Two manoeuvres with an event `e1` each, at 1 and at 4 s, for 2 s: `two::e1` has ended at 6
    s."""
    second = f'</Maneuver><Maneuver name="two">{speed_change(1, 4.0, 9.0, 2.0)}'
    events = speed_change(1, 1.0, 5.0, 2.0) + second + after("s::a::g::two::e1")
    for path in ("s::a::g::two::e1", "two::e1"):
        (other,) = only_case(
            written(tmp_path, events=events.replace("s::a::g::two::e1", path))
        ).actors
        assert [act.begin for act in other.acts] == pytest.approx([1.0, 4.0, 6.0])


@pytest.mark.parametrize(
    "rule, edge",
    values_of("""
    "equalTo", "none"
    "lessThan", "risingOrFalling"
    "lessThan", "falling"
    "notEqualTo", "rising"
    "notEqualTo", "falling"
    "equalTo", "falling"
    """),
)
def test_a_time_begins_when_its_rule_changes(tmp_path, rule, edge):
    events = timed(BRAKE, '<SimulationTimeCondition value="4" rule="$light"/>')
    path = written(tmp_path, events=events.replace('Edge="none"', f'Edge="{edge}"'))
    (other,) = only_case(change(path, '"day"', f'"{rule}"')).actors
    assert other.braking.begin == 4.0


@pytest.mark.parametrize(
    "rule, edge", [("greaterThan", "rising"), ("notEqualTo", "rising"), ("equalTo", "falling")]
)
def test_an_edge_before_the_start_never_comes(tmp_path, rule, edge):
    events = timed(BRAKE, f'<SimulationTimeCondition value="-1" rule="{rule}"/>')
    path = written(tmp_path, events=events.replace('Edge="none"', f'Edge="{edge}"'))
    assert only_case(path).actors[0].braking is None


@pytest.mark.parametrize("time", [0, 5])
def test_a_time_may_begin_at_the_limit_until_which_it_may(tmp_path, time):
    until = f'<SimulationTimeCondition value="{time}" rule="lessOrEqual"/>'
    until = f"<ByValueCondition>{until}</ByValueCondition>"
    events = when(until, until.replace("less", "greater"))
    (other,) = only_case(written(tmp_path, events=events)).actors
    assert other.braking.begin == time


def test_a_catalog_whose_entry_is_there_twice_is_not_guessed(tmp_path):
    """Two files with a catalog of one name: an entry that one of them has plays, one that both have
    is refused."""
    path = written(tmp_path)
    other = tmp_path / "catalogs" / "more.xosc"
    other.write_text(CARS.replace('Vehicle name="car"', 'Vehicle name="van"'))
    assert only_case(path).actors[0].length == 6.0
    other.write_text(CARS)
    sentence = said(path)
    assert (
        "entry `car` of catalog `cars` is there more than once: cars.xosc, line 2, <Vehicle>, "
        "more.xosc" in sentence
    )


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "iso-8859-1"])
def test_a_file_in_another_encoding_reads_as_it_is(tmp_path, encoding):
    path = written(tmp_path)
    told = encoding.removesuffix("-sig")
    text = path.read_text().replace('version="1.0"?>', f'version="1.0" encoding="{told}"?>')
    path.write_bytes(text.replace("a test", "Prüfung").encode(encoding))
    logical = find(str(path))
    assert logical.about == "Prüfung"
    assert logical.concrete(only=0.0).ego.speed == pytest.approx(20.0)


def test_entities_in_an_encoding_without_ascii_are_not_expanded(tmp_path):
    """In EBCDIC the bytes of `<!DOCTYPE` are others."""
    path = written(tmp_path)
    text = path.read_text().removeprefix('<?xml version="1.0"?>')
    head = '<?xml version="1.0" encoding="cp037"?><!DOCTYPE OpenSCENARIO [<!ENTITY e "72">]>'
    path.write_bytes((head + text.replace('value="72"', 'value="&e;"')).encode("cp037"))
    sentence = said(path)
    assert "must not declare a document type" in sentence or "is not XML" in sentence


def test_a_range_with_a_step_of_nothing_is_refused_at_once(tmp_path):
    written(tmp_path)
    part = """<DeterministicSingleParameterDistribution parameterName="kph"><DistributionRange stepWidth="1e-9">
    <Range lowerLimit="36" upperLimit="90"/></DistributionRange></DeterministicSingleParameterDistribution>"""
    path = tmp_path / "fine.xosc"
    path.write_text(VARIATION.format(file="scenario.xosc", parts=part))
    assert "fine must be at most 2,000,000, got 54000000001" in said(path)


def test_names_that_look_like_numbers_stay_what_they_are(tmp_path):
    """A road `1234567` that a distribution chooses."""
    path = change(written(tmp_path), 'roadId="0"', 'roadId="$light"')
    (tmp_path / "road.xodr").write_text(ROAD.replace('id="0" length', 'id="1234567" length'))
    part = """<DeterministicSingleParameterDistribution parameterName="light"><DistributionSet>
    <Element value="1234567"/></DistributionSet></DeterministicSingleParameterDistribution>"""
    varied = tmp_path / "varied.xosc"
    varied.write_text(VARIATION.format(file=path.name, parts=part))
    assert only_case(varied).ego.x == pytest.approx(21.5)


def test_parameters_in_catalog_references_and_in_each_other_are_worked_out(tmp_path):
    """`$which` names the catalog and an entry's length is an expression of parameters that rest on
    each other."""
    path = change(
        written(tmp_path),
        'catalogName="cars" entryName="car"/>',
        'catalogName="$which" entryName="car"/>',
    )
    change(path, "</ParameterDeclarations>",
           '<ParameterDeclaration name="which" parameterType="string" value="cars"/>'
           '<ParameterDeclaration name="half" parameterType="double" value="${sqrt(pow($v, 2)) / '
           '8}"/>'
           '<ParameterDeclaration name="all" parameterType="double" value="${max($half, -$half) * '
           '(1 + 1)}"/>'
           "</ParameterDeclarations>")  # fmt: skip
    change(path, 'parameterRef="long" value="6"', 'parameterRef="long" value="${$all + 0.5}"')
    change(path, path.read_text().split("<StopTrigger>")[1].split("</StopTrigger>")[0], "")
    change(path, "<StopTrigger></StopTrigger>", "")
    logical = find(str(path))
    (other,) = logical.concrete(only=0.0).actors
    assert other.length == pytest.approx(5.5)
    assert logical.time_limit == 60.0
    assert math.isfinite(logical.time_limit)


def test_an_entry_that_leads_to_itself_is_refused(tmp_path):
    """A trajectory of a catalog whose first place is on that same trajectory."""
    place = """<TrajectoryPosition s="0"><TrajectoryRef><CatalogReference catalogName="ways" entryName="round"/>
    </TrajectoryRef></TrajectoryPosition>"""
    follow = """<RoutingAction><FollowTrajectoryAction><TrajectoryRef><CatalogReference catalogName="ways"
    entryName="round"/></TrajectoryRef><TimeReference><None/></TimeReference><TrajectoryFollowingMode
    followingMode="position"/></FollowTrajectoryAction></RoutingAction>"""
    path = written(tmp_path, events=timed(follow, 1))
    (tmp_path / "catalogs" / "ways.xosc").write_text(
        f"""<OpenSCENARIO><FileHeader revMajor="1" revMinor="3"/><Catalog name="ways"><Trajectory name="round"
        closed="false"><Shape><Polyline><Vertex><Position>{place}</Position></Vertex><Vertex><Position>{place}
        </Position></Vertex></Polyline></Shape></Trajectory></Catalog></OpenSCENARIO>"""
    )
    assert "<CatalogReference>: entry `round` of catalog `ways` refers to itself" in said(path)


def test_a_start_off_the_road_is_refused_with_its_place(tmp_path):
    """Points of a space with one fault count together, so only a file of one point tells it."""
    path = written(tmp_path)
    change(path, 'ds="50"', 'ds="-19"')
    assert re.search(r"`Other` must be on the road, .*\), got 2\.5", said(path))


RELATIVE = """<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="step"
dynamicsDimension="time" value="0"/><SpeedActionTarget><RelativeTargetSpeed entityRef="Other"
value="{}" speedTargetValueType="{}" continuous="true"/></SpeedActionTarget></SpeedAction>
</LongitudinalAction>"""
DISTANCE = """<LongitudinalAction><LongitudinalDistanceAction entityRef="Other" distance="9"
freespace="true" continuous="true"/></LongitudinalAction>"""


@pytest.mark.parametrize(
    "action, sentence",
    [
        (RELATIVE.format(5, "delta"), "must be relative to another entity, got `Other` itself"),
        (RELATIVE.format(1.5, "factor"), "must be relative to another entity, got `Other` itself"),
        (DISTANCE, "a distance must be to another entity, got `Other` itself"),
    ],
)
def test_what_an_entity_keeps_to_itself_is_refused(tmp_path, action, sentence):
    """A speed would grow in every step, to 1e20 m/s within 8 s."""
    assert sentence in said(written(tmp_path, events=timed(action, 2.0)))


def test_an_entity_may_keep_its_own_speed(tmp_path):
    same = RELATIVE.format(0, "delta")
    (other,) = only_case(written(tmp_path, events=timed(same, 2.0))).actors
    assert (other.start.speed, other.acts[0].table[:2]) == (15.0, ((0.0, 1.0), (0.0, 0.0)))


def test_what_is_not_a_scenario_is_named(tmp_path):
    path = written(tmp_path)
    cars = said(tmp_path / "catalogs" / "cars.xosc")
    assert (
        "line 1, <OpenSCENARIO>: it must hold a <Storyboard>, got <FileHeader>, <Catalog>" in cars
    )
    path.write_text("")
    assert "is not XML" in said(path)
    path.write_text("<OpenDRIVE/>")
    assert "its root must be <OpenSCENARIO>, got <OpenDRIVE>" in said(path)
    assert "There is no OpenSCENARIO file" in said(tmp_path / "none.xosc")
    (tmp_path / "folder.xosc").mkdir()
    assert "cannot be read" in said(tmp_path / "folder.xosc")


def test_an_unknown_catalogue_names_the_nearest():
    assert "got 'ncap_2027'. Did you mean `ncap_2026`?" in said(Path("ncap_2027"))


def test_a_byte_order_mark_is_not_part_of_a_scenario_file(tmp_path):
    (tmp_path / "mine.toml").write_text(
        scenario_files()["ncap_ccrs"].read_text(), encoding="utf-8-sig"
    )
    assert find("mine.toml", tmp_path).name == "ncap_ccrs"


def test_a_stop_that_never_comes_stops_nothing(tmp_path):
    path = change(written(tmp_path), 'value="30" rule="greaterThan"', 'value="0" rule="lessThan"')
    assert find(str(path)).time_limit == 60.0
