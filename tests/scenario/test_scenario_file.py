"""A logical scenario as a file: the documented example runs, and every mistake is a sentence."""

import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from laid import replace_in
from loaded import ROOT
from refusals import refusal, refused
from scipy import stats
from tables import rows_of, values_of

import sumo_eval
from sumo_eval.cosim import simulate
from sumo_eval.report.terminal import closing_lines
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.file import check_file, read_scenario
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.scenario.schema import schema_of

DOCUMENT = ROOT / "docs" / "reference" / "scenario_file.md"
EXAMPLE = re.findall(r"```toml\n(name = .*?)```", DOCUMENT.read_text(), re.DOTALL)[0]


OPTION = """
[[option]]
name = "reaction"
unit = "s"
default = 1.0
above = 0.0
about = "when the truck brakes"
[option.given]
suffix = "later"
about = "A truck brakes when it is told to."
[option.given.road]
lanes = 3
"""
EACH = "each = { truck_speed = [10.0, 15.0] }"
SAMPLE = f"""
[[sample]]
name = "own"
units = {{ ego_speed = "km/h" }}
points = [[90], [108]]
{EACH}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "slow_truck.toml"
    path.write_text(EXAMPLE)
    return path


SHORT = """
name = "short"
[[parameter]]
name = "v"
low = 8.0
high = 14.0
step = 6.0
unit = "m/s"
about = "speed of the ego"
[road]
lanes = 2
lane_width = 3.5
length = 286.4
[end]
x = 280.0
[ego]
x = 10.0
speed = "v"
[[vehicle]]
name = "lead"
gap = 40.0
speed = SPEED
[zone]
obstacle = "lead"
"""


def at_25(logical):
    """An ego at 25 m/s behind a truck at 10 m/s."""
    return logical.concrete(ego_speed=25.0, truck_speed=10.0)


@pytest.fixture
def short(tmp_path, monkeypatch):
    """The file of a short road, from its own folder."""
    monkeypatch.chdir(tmp_path)
    path = Path("short.toml")
    path.write_text(SHORT.replace("SPEED", "4.0"))
    return path


@pytest.mark.parametrize(
    "speed, words", [("4.0", "after 57.5 s"), ("0.0", ""), ('"v"', "after 16.5 s at v=14")]
)
def test_check_says_when_a_script_leads_beyond_the_road(tmp_path, speed, words):
    """(286.4 - 10 - 2.25 - 40 - 4.5) / 4 = 57.4 s, looked at every 0.25 s; an ego that follows is
    not done by then."""
    (tmp_path / "short.toml").write_text(SHORT.replace("SPEED", speed))
    told = [
        line
        for line in check_file(tmp_path / "short.toml")
        if "comes to the end of the road" in line
    ]
    assert len(told) == (1 if words else 0)
    assert all(words in line for line in told)


def test_the_documented_example_is_short_and_is_checked_sampled_and_driven(file):
    assert len([line for line in EXAMPLE.splitlines() if line.strip()]) <= 30
    # 5 speeds x 3 = 15, less (15, 15), (15, 22.2) and (20, 22.2)
    assert (
        check_file(file)[1] == "Its own sample has 12 possible points; constraints refuse 3 more."
    )
    logical = catalogue.find("slow_truck.toml", file.parent)
    concrete = at_25(logical)
    # 2 s * 25 m/s = 50 m from bumper to bumper, both 4.5 m long
    assert concrete.actors[0].start.x - concrete.ego.x == pytest.approx(54.5)
    assert concrete.actors[0].speed(2.0) == pytest.approx(10.0 - 4.0)
    assert simulate(concrete, "careful_driver").end_reason in ("standstill", "contact")
    # from 50 m behind a truck that stands after 1 + 2.5 s and 22.5 m, at constant 25 m/s: contact
    # at 72.5 / 25 s
    hit = simulate(concrete, "no_reaction").collision
    assert hit.time == pytest.approx((50 + 10 + 10 * 1.9 - 4 * 1.9**2 / 2) / 25, abs=0.05)


def test_exposure_is_the_distribution_within_the_range(file):
    logical = read_scenario(file)
    inside = stats.norm.cdf(35, 27, 5) - stats.norm.cdf(15, 27, 5)
    point = logical.concrete(ego_speed=30.0, truck_speed=10.0)
    assert point.exposure == pytest.approx(stats.norm.pdf(30, 27, 5) / inside)
    assert "ego_speed as norm(loc=27, scale=5)" in logical.exposure_about


def test_two_readings_are_equal_and_can_be_sent_to_another_process(file):
    first, second = read_scenario(file), read_scenario(file)
    assert first == second
    assert hash(first) == hash(second)
    assert pickle.loads(pickle.dumps(first)) == first


def test_a_value_that_is_not_listed_does_not_exist(file):
    with refusal(r"`truck_speed` of scenario `slow_truck` must be one of 10, 15, 22.2 m/s"):
        read_scenario(file).concrete(ego_speed=30.0, truck_speed=12.0)


def test_definitions_exposure_and_every_manoeuvre(tmp_path):
    text = EXAMPLE.replace(
        'manoeuvre = [{ do = "brake", begin = 1.0, deceleration = 4.0 }]',
        """manoeuvre = [
  { do = "keep_speed" },
  { do = "change_lane", begin = "late", duration = 3.0, offset = 3.5 },
  { do = "move_sideways", begin = "late + 4.0", speed = 1.0, offset = -3.5 },
]""",
    )
    head, _, rest = text.partition("[[parameter]]")
    text = f'{head}exposure = "1.0 + truck_speed / 10.0"\n[define]\nhalf = "ego_speed / 2.0"\nlate = "half / 10.0"\n[[parameter]]{rest}'  # noqa: E501
    (tmp_path / "s.toml").write_text(text)
    concrete = read_scenario(tmp_path / "s.toml").concrete(ego_speed=20.0, truck_speed=10.0)
    (truck,) = concrete.actors
    assert [(move.begin, move.duration) for move in truck.lateral_moves] == [(1.0, 3.0), (5.0, 3.5)]
    assert truck.y(4.0) == 3.5
    assert truck.y(20.0) == 0.0
    with_exposure = (
        read_scenario(tmp_path / "s.toml").concrete(ego_speed=20.0, truck_speed=15.0).exposure
    )
    assert with_exposure / concrete.exposure == pytest.approx(2.5 / 2.0)


@pytest.mark.parametrize(
    "old, new, sentence",
    [
        *rows_of(r"""
truck_speed < ego_speed | truck_sped < ego_speed | Did you mean `truck_speed`?
truck_speed < ego_speed | truck_speed - ego_speed | a condition such as
"norm" | "nrm" | Did you mean `norm`?
name = "truck" | name = "a truck" | must be without spaces and
loc = 27.0 | lok = 27.0 | Did you mean `loc`?
scale = 5.0 | scale = -5.0 | does not exist with
scale = 5.0 | scale = 0.0 | does not exist with
scale = 5.0 | scale = inf | `parameter[0].distribution.scale` in scenario file
loc = 27.0, scale = 5.0 | loc = 900.0, scale = 0.1 | possible within 15..35
name = "norm", loc = 27.0, scale = 5.0 | name = "gamma", loc = 2.0 | must be given `a`
deceleration = 4.0 | deceleration = 4.0, duration = 2.0 | has no `duration`
do = "brake" | do = "break"
| must be one of 'keep_speed', 'brake', 'change_lane', 'move_sideways', 'accelerate'
obstacle = "truck" | obstacle = "trunk" | Did you mean `truck`?
step = 5.0 | stp = 5.0 | Did you mean `step`?
low = 15.0 | low = 35.0 | finite, low < high
[10.0, 15.0, 22.2] | [10.0, 10.0] | ascending
values = [ | step = 1.0\nvalues = [ | must have either low, high and step, or values
gap = "2.0 * ego_speed" | gap = "2.0 * ego_speed"\nx = 3.0 | must have either gap, gap_behind or x
gap = "2.0 * ego_speed" | gap = "open(1)" | Unknown function
gap = "2.0 * ego_speed" | gap = "60 + 1 / (ego_speed - 20)"
| must be finite, got 'inf at ego_speed=20
gap = "2.0 * ego_speed" | gap = 1e5 | on the road
speed = "truck_speed" | speed = "truck_speed - 11.0" | finite and at least 0
name = "truck" | name = "ego" | a name of its own, got `ego` twice
[ego] | [road]\nedges = ['a']\n[ego] | there is none
[ego] | [end]\nx = 7000.0\n[ego] | at most the road's length 6000
[ego] | [road]\nnetwork = 'no.net.xml'\n[ego] | There is no network
[zone] | [zone | is not valid TOML
delay = 1.0 | delay = "0 / (ego_speed - 25)" | must be a number at every point of the ranges, got nan
name = "slow_truck" | name = "slow_truck"\ndefault_sample = "grd" | Did you mean `grid`?
truck_speed < ego_speed | truck_speed > ego_speed + 100
| at least one possible point, got none. Of 15 points, 15 are not `
"ego_speed" | "lambda" | no keyword of Python, got 'lambda'
[ego] | [define]\n'a b' = 3\n[ego] | The name of a definition of
manoeuvre = [ | manoeuvre = [{ do = 'keep_speed', name = 'a' }, { do = 'keep_speed', name = 'a' },
| a name of its own, got `a` twice
above = | abov = | Did you mean `above`?
suffix | sufix | Did you mean `suffix`?
"reaction" | "ego_speed" | a name of its own, got `ego_speed` twice
"reaction" | "re action" | letters, digits and underscores
default = 1.0 | default = inf | a finite number
"later" | "" | `option[0].given.suffix` in scenario file
each = | eech = | Did you mean `each`?
each = { truck_speed | each = { truck_sped | Did you mean `truck_speed`?
truck_speed = [10.0, 15.0] | truck_speed = [] | must be non-empty, got []
km/h | km//h | Did you mean `km/h`?
[[90], [108]] | [] | must be non-empty, got []
[[90] | [[90, 3] | must be 1 numbers
units = { ego_speed | units = { ego_sped | Did you mean `ego_speed`?
each = { truck_speed = [10.0, 15.0] } | set = { truck_speed = "ego_sped" }
| Did you mean `ego_speed`?
each = { truck_speed = [10.0, 15.0] } | set = { truck_speed = "1/(ego_speed-25)" }
| must be finite, got
each = | columns = ["truck_speed"]\neach = | got `truck_speed` twice
each = { truck_speed = [10.0, 15.0] } | columns = ["ego_speed"]
| Parameter `truck_speed` of sample `own`
"""),
        *values_of("""
    "truck_speed < ego_speed", " ", "of scenario file"
    ", deceleration = 4.0", "", "`brake` of vehicle `truck` in scenario file"
    "step = 5.0", "", "`step` of parameter `ego_speed`"
    """),
        ("truck_speed < ego_speed", f"not {900 * '-'}ego_speed", "nested more than 50 deep"),
        ('"ego_speed"', '"\u00b5"', "in the form NFKC"),
        ("[[sample]]", f"{SAMPLE}[[sample]]", "a name of its own, got `own` twice"),
    ],
)  # fmt: skip
def test_every_mistake_has_a_message(file, old, new, sentence):
    text = EXAMPLE.replace("[ego]", f"{OPTION}{SAMPLE}[ego]")
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with refused(sentence):
        check_file(file)


def test_an_option_is_a_number_that_expressions_know_and_another_scenario_where_it_is_given(file):
    text = EXAMPLE.replace("begin = 1.0", 'begin = "reaction"').replace("[ego]", OPTION + "[ego]")
    file.write_text(text)
    plain, given = (
        catalogue.find(f"slow_truck.toml{use}", file.parent) for use in ("", "?reaction=2.5")
    )
    for logical, begin in ((plain, 1.0), (given, 2.5)):
        (truck,) = at_25(logical).actors
        assert truck.braking.begin == begin
    assert plain.name == "slow_truck"
    assert given.name == "slow_truck_later"
    assert plain.road.lanes == 2
    assert given.road.lanes == 3
    assert given.about == "A truck brakes when it is told to."
    assert [option.name for option in plain.options] == ["reaction"]
    with refusal(
        r"`reaction` of scenario `slow_truck` must be a finite number of s above 0, got '-1"
    ):
        catalogue.find("slow_truck.toml?reaction=-1", file.parent)
    with refusal("Did you mean `reaction`"):
        catalogue.find("slow_truck.toml?reacton=1", file.parent)


def test_options_without_an_own_table_are_named_in_order(file):
    options = "".join(
        f'[[option]]\nname = "{name}"\nunit = "s"\ndefault = 1.0\n' for name in ("first", "second")
    )
    file.write_text(
        EXAMPLE.replace("begin = 1.0", 'begin = "first + second"').replace(
            "[ego]", options + "[ego]"
        )
    )
    both = catalogue.find("slow_truck.toml?second=3&first=-0.5", file.parent)
    assert both.name == "slow_truck_first_second"
    assert at_25(both).actors[0].braking.begin == 2.5


def test_a_sample_is_rows_in_other_units_at_each_value_with_the_rest_worked_out(file):
    worked_out = SAMPLE.replace(EACH, 'set = { truck_speed = "ego_speed - 15.0" }')
    # 90 km/h = 25 m/s, 108 km/h = 30 m/s; the values of `each` are the outer loop
    for text, points in (
        (SAMPLE, [[25, 10], [30, 10], [25, 15], [30, 15]]),
        (worked_out, [[25, 10], [30, 15]]),
    ):
        file.write_text(EXAMPLE.replace("[ego]", text + "[ego]"))
        (own,) = read_scenario(file).samples
        assert np.array(own.points) == pytest.approx(np.array(points), rel=1e-15)


def test_a_point_of_a_sample_that_is_on_no_axis_is_refused(file):
    """`check` said nothing of it, and a run refused it without the sample's name."""
    beyond = SAMPLE.replace("[108]", "[200]")
    file.write_text(EXAMPLE.replace("[ego]", beyond + "[ego]"))
    with refusal(
        "`ego_speed` of point 2 of sample `own` of scenario `slow_truck` must be within 15"
    ):
        sample(read_scenario(file), "own")
    between = SAMPLE.replace("15.0]", "12.0]")
    file.write_text(EXAMPLE.replace("[ego]", between + "[ego]"))
    with refusal("`truck_speed` of point 3 of sample `own` .* must be one of 10, 15, 22.2 m/s"):
        sample(read_scenario(file), "own")


def test_an_exposure_may_be_undefined_at_impossible_points(file):
    file.write_text('exposure = "sqrt(ego_speed - truck_speed)"\n' + file.read_text())
    drawn = sample(read_scenario(file), "exposure", request=Request(count=9))
    assert len(drawn.points) + len(drawn.refused) == 9


def test_an_infinite_density_at_a_point_is_refused(file):
    """With it every mean over the points would be nan."""
    beta = 'distribution = { name = "beta", a = 0.5, b = 0.5, loc = 15.0, scale = 20.0 }'
    file.write_text(re.sub("distribution = .*", beta, EXAMPLE))
    with refusal("must be finite and at least 0 at each point, got 'inf at ego_speed=15"):
        sample(read_scenario(file))


def test_a_file_that_declares_no_exposure_has_none(file):
    from sumo_eval.drivers.recorded.exposure import exposure_of
    from sumo_eval.settings import DriverSettings, ExposureSettings

    plain = re.sub("distribution = .*", "", EXAMPLE)
    for text, known in (
        (EXAMPLE, True),
        (plain, False),
        (f'exposure = "ego_speed"\n{plain}', True),
    ):
        file.write_text(text)
        found = exposure_of(read_scenario(file), ExposureSettings(), DriverSettings(), file.parent)
        assert found.known is known


def test_what_builds_up_may_be_there_at_once_and_nothing_else_is_endless(file):
    sideways = '{ do = "move_sideways", speed = 1.0, offset = 3.5, acceleration = "1.0 / 0.0" }'
    file.write_text(EXAMPLE.replace('{ do = "brake", begin = 1.0, deceleration = 4.0 }', sideways))
    (truck,) = at_25(read_scenario(file)).actors
    assert truck.lateral_speed(0.0) == 1.0
    assert truck.y(1.0) == 1.0
    replace_in(file, "speed = 1.0, offset", 'speed = "1.0 / 0.0", offset')
    with refusal(r"speed of `move_sideways` of vehicle `truck` = `1.0 / 0.0` of scenario"):
        at_25(read_scenario(file))


def test_all_mistakes_of_a_kind_are_named_at_once(file):
    file.write_text(
        EXAMPLE.replace("step = 5.0", "stp = 5.0").replace("[ego]", "[ego]\nspede = 3.0")
    )
    with refusal(r"`parameter\[0\]\.stp`") as caught:
        check_file(file)
    assert "`ego.spede`" in str(caught.value)


def test_a_wrong_table_or_word_is_refused_with_one_message(tmp_path):
    (tmp_path / "s.toml").write_text(
        'name = "s"\nparameter = []\nego = { speed = 20.0 }\nzone = "nobody"\n'
    )
    with refusal() as caught:
        read_scenario(tmp_path / "s.toml")
    assert str(caught.value).endswith("must be a table or 'none', got 'nobody'.")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there():
    with refusal("There is no scenario file"):
        catalogue.find("nowhere.toml")


def test_schemas_name_every_key_with_its_meaning():
    for schema in map(schema_of, ("scenario", "evaluation")):
        json.dumps(schema)
        tables = [schema, *schema["$defs"].values()]
        keys = [entry for table in tables for entry in table["properties"].values()]
        assert all(table["additionalProperties"] is False for table in tables)
        assert sum("description" in entry for entry in keys) > 0.7 * len(keys)
    vehicle = schema_of("scenario")["$defs"]["VehicleTable"]
    assert "bumper" in vehicle["properties"]["gap"]["description"]


@pytest.mark.campaign
def test_the_zone_rule_of_a_file_trains_a_partition(file):
    from sumo_eval.method.zone_partition import partition

    logical = read_scenario(file)
    zones = partition(logical, points=sample(logical).points)
    # 70 m, closing with 25 m/s on a braking truck
    assert zones.hazardous([[35.0, 10.0]]).all()


UNITS = ["km/h", "kph", "mph", "kmh", "KM/H", "knots", "ft/s", "furlong", "m/s per s", "é", "kilo"]


@pytest.mark.parametrize("unit", UNITS)
def test_a_speed_in_other_units_is_never_driven_as_m_s(short, unit):
    """8 km/h = 2.22222 m/s; a fuzz of units, of which none may come to a scenario."""
    replace_in(short, 'unit = "m/s"', f'unit = "{unit}"')
    with refusal(r"nit of parameter `v`|nit `.*` of parameter `v`") as refused:
        read_scenario(short)
    assert unit != "km/h" or "low = 2.22222" in str(refused.value)


@pytest.mark.parametrize(
    "old, new, words",
    rows_of("""
speed = "v" | speed = "30 km/h" | without a unit, got 30 km/h: as m/s write 8.33333
gap = 40.0 | gap = "12 ft" | without a unit, got 12 ft: as m write 3.6576
gap = 40.0 | gap = "1e3 mm" | without a unit, got 1e3 mm: as m write 1.
gap = 40.0 | gap = "30 -" | invalid syntax
unit = "m/s" | unit = "m"
| `speed` in scenario file short.toml must be in m/s, got `v`, which is in m
x = 280.0 | x = 5.0 | must be beyond the ego's start, x = 10 m, got 5.0
[[vehicle]] | [vehicle] | write [[vehicle]], with two brackets
[ego] | [[ego]] | write [ego], with one bracket
"""),
)
def test_what_is_often_written_gets_the_sentence_that_helps(short, old, new, words):
    replace_in(short, old, new)
    with refused(words):
        check_file(short)


@pytest.mark.parametrize(
    "name, unit, wanted",
    [("conditions.field_of_view_deg", "rad", "deg"), ("vehicle.max_deceleration", "m/s", "m/s2")],
)
def test_setting_as_parameter_has_the_unit_of_the_setting(short, name, unit, wanted):
    """A field of view of 2 rad was simulated as 2 deg."""
    parameter = f'[[parameter]]\nname = "{name}"\nunit = "UNIT"\nvalues = [1.0, 2.0]\n\n[ego]'
    replace_in(short, "[ego]", parameter.replace("UNIT", wanted))
    check_file(short)
    replace_in(short, f'unit = "{wanted}"\nvalues', f'unit = "{unit}"\nvalues')
    with refusal(f"in {wanted}, got `{name}`, which is in {unit}"):
        check_file(short)


def test_an_ego_whose_front_is_beyond_the_road_is_refused(short):
    """SUMO would move it back, and every drive would fail."""
    replace_in(short, "length = 286.4", "length = 280.0")
    replace_in(short, "x = 10.0", "x = 277.75")
    with refusal("Vehicle `lead` .* on the road"):  # the ego's front is at the end: allowed
        check_file(short)
    replace_in(short, "x = 277.75", "x = 278.0")
    with refusal("Vehicle `ego` .* its centre at x = 0 to 277.75 m .* got 278.0"):
        check_file(short)


@pytest.mark.parametrize(
    "header, low",
    values_of("""
    "v (km/h)", 10.0
    "v [kph]", 10.0
    "v (m/s)", 36.0
    "v", 36.0
    "v (s)", None
    """),
)
def test_points_of_a_table_come_in_the_unit_of_its_head(short, tmp_path, header, low):
    """36 km/h = 10 m/s, within 8..14; 36 m/s is not."""
    Path("points.csv").write_text(f"{header}\n36\n")
    wanted = Request(file="points.csv", folder=tmp_path)
    logical = read_scenario(short)
    if low == 10.0:
        assert sample(logical, "file", request=wanted).points.tolist() == [[10.0]]
    else:
        with refusal(r"within 8\.\.14|[Uu]nit"):
            sample(logical, "file", request=wanted)


def test_a_vehicle_that_left_stands_in_row_and_report(short):
    evaluation = {"name": "left", "scenario": [{"use": "short.toml"}], "drivers": {"count": 2}}
    done = sumo_eval.evaluate(evaluation, "run", ads=["idm"])
    assert {case.status for case in done.cases} == {"ok"}
    assert all("actor_left_the_network x1" in case.clips for case in done.cases)
    told = [line for line in closing_lines(done) if "reached the end of the network" in line]
    assert told == ["idm in short: In 2 cases an actor reached the end of the network and left "
                    "it; the case "
                    "continued without it (clip `actor_left_the_network`)."]  # fmt: skip
