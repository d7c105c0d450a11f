"""The shipped scenarios: which there are, and what each of their files comes to, to the last
bit."""

import hashlib
import itertools
import math

import numpy as np
import pytest
from commands import python
from refusals import refused
from tables import in_campaign, rows_of

from sumo_eval.scenario import catalogue, played
from sumo_eval.scenario.file import check_file
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.scenario.shipped_files import scenario_files

NAMES = sorted(catalogue.SCENARIOS)
CONTENT = {
    row[0]: row[1:]
    for row in rows_of("""
cut_in | 175597611e2fe6f0 | 75596380c27d9578 | 318b38130c910aed
front_vehicle_braking | a1478c0a6285f116 | a281c74aef7230e3 | 6b15dc01d611404f
front_vehicle_cut_out | 1f7e28e2e17a5845 | 180685aa1cbbf5ca | b07605bde32b0d89
front_vehicle_low_speed | 0d2e3c9b4f21fe42 | d3229e4573170531 | 2410b850ac40e478
ncap_ccrb | 3e7a16010ead55f7 | 0a3d708ff1a8e2d7 | 15598502bfb55bb4
ncap_ccrm | eed4f8560d1c34f2 | 4c0ce48c30566017 | 9d8d34ed6c73f45b
ncap_ccrs | e2776def4727f84f | 55ec2f06fa2ce51a | 077c00c05eff1066
r157_cut_out | ad3eb578dcfc8bd6 | 017e7722d0687349 | 9ff636551168a70c
curve_braking | 8d14369afdd3b43c | a281c74aef7230e3 | 98a3d5999ec5410c
curve_cut_in | cc63ca576d417cd0 | 75596380c27d9578 | 2d6149c4e1697ee8
curve_cut_in?radius=-1000 | 175597611e2fe6f0 | 75596380c27d9578 | 04c947353d10e5eb
curve_cut_out | 47050b2156141897 | 017e7722d0687349 | f80fbb67a1674db6
curve_following | c4752e1d139d9c17 | d3229e4573170531 | 98c3ad604ec0918f
bicycle_along | 183f1f3f13ec44b1 | 8bf4f911e5c9732b | a488f64e0acca153
bicycle_crossing | 1e021d7f0370c9eb | 6d12ff78a647fbc7 | d0050dfaf1522650
child_from_behind_parked_cars | b6adbea885e0668a | 02c512c9ffce69c9 | 6e7de0cba0cbca16
lane_change_rear | df8955c844dd9cf0 | bdfe51a8635e39a7 | eb7ec39ca4e1aaac
lane_keeping_disturbed | 0325beb5fa86f477 | e3b0c44298fc1c14 | 9f1b84439c64c7ed
lane_keeping_disturbed?radius=250 | 0325beb5fa86f477 | e3b0c44298fc1c14 | f3fa285b90145ba4
oncoming_in_lane | 10454619fb095d87 | e3b0c44298fc1c14 | 817adb115095ff50
overtaken_and_cut_off | b2460f07397be0f4 | c78fa3fc99a0fbae | 35737b9e7c31b1be
partially_blocked_lane | fdb243e3312ddb0a | 8bf4f911e5c9732b | c2fabe5fe0c0be94
pedestrian_along | df9c4328571c4d45 | 8bf4f911e5c9732b | e29392bba97abfca
pedestrian_crossing | 9e86bf5e98c0c400 | c65413b34e2f80b4 | 207eea9adff161d5
side_vehicle | fa22f0af966e10ab | e3b0c44298fc1c14 | e666dad7c6754fda
stop_and_go_stream | 65d4da962b86a13e | e3b0c44298fc1c14 | 0f393952d74c1df1
swerving_lead | 0413fc1ed1699959 | de9aa00c4013b7a7 | 2f9287c073c993ba
motorway_approach | f15405adff12005c | fef1046538b042ee | 72ddc317eeeac9db
motorway_cut_out | 1594c80a190f98cc | ad4c09b140f7bc5e | 1f56bda4fbab6a8f
motorway_braking | 7b52616bd25e25a5 | c23bb4bc78646553 | 85c83542b8b099c6
cut_in?lateral_acceleration=1.5 | 6dc9b9bc63ed8248 | 4f7569e89befa892 | f74d71e54d36a8b6
cut_in?lateral_acceleration=0.4 | 39aff4dd312b1a8a | 88c20fb489aa05b7 | f74d71e54d36a8b6
""")
}
"""Of each scenario: everybody's starts and scripts, the approaches that zones are computed from,
the rest of it.

Every number is a sum, product or quotient of doubles, which IEEE 754 rounds alike everywhere.
"""
PLAYED = dict(
    rows_of("""
crossing_path | 5feca20952bc67b8
cut_in_from_ramp | 04b53d9946e18e38
exit | 62ff2278dc067452
exit_cut | 99dfa70b42449a46
lane_drop | 88cd2646c83d1d29
lane_drop_cut | 3b9adc506701e311
leaving_traffic | b32dbb2715f3fb10
making_room | f54988084c511057
ramp_merge | 321e9d6151a4fb82
ramp_merge_cut | 8d56be13c6d3bad7
turn_across_path | 55e5d6e31593a09d
""")
)
"""Of each scenario without a closed form: everything that is placed, and where zones are searched
from."""


def _points(logical):
    """500 drawn points of the box, those of the scenario's own samples, and two corners."""
    drawn = logical.from_unit(np.random.default_rng(7).random((500, len(logical.names))))
    listed = [point for own in logical.samples for point in own.points]
    return np.concatenate(
        [drawn, np.reshape(listed, (-1, len(logical.names))), [logical.low, logical.high]]
    )


def _numbers(concrete):
    yield from (concrete.ego.x, concrete.ego.y, concrete.ego.speed, concrete.exposure)
    for actor in concrete.actors:
        yield from (
            actor.start.x,
            actor.start.y,
            actor.start.speed,
            actor.length,
            actor.width,
            actor.slides,
        )
        if actor.braking is not None:
            yield from (actor.braking.begin, actor.braking.acceleration, actor.braking.jerk)
        for move in actor.lateral_moves:
            yield from (move.begin, move.duration, move.offset)
            if move.kind == played.CONSTANT:
                yield from (move.speed, move.acceleration)
        for act in actor.acts if actor.lively else ():
            if math.isinf(act.begin):
                continue
            yield from act[:7]  # its kind to its jerk
            yield from itertools.chain(*act.table, *act.program)
        if actor.model is not None:
            yield from (actor.model.desired, *(value for _, value in actor.model.numbers))


def _scripts(logical):
    points = _points(logical)
    possible = logical.feasible(points)
    found = hashlib.sha256(possible.tobytes())
    for concrete in logical.concretes(points[possible]):
        names = [actor.name for actor in concrete.actors]
        found.update(
            " ".join([*names, *(float(number).hex() for number in _numbers(concrete))]).encode()
        )
    return found.hexdigest()[:16]


def _approaches(logical):
    points = _points(logical)
    if logical.approach is None:
        zone = logical.margin(logical.columns(points)) if logical.margin else np.zeros(0)
        values = [dict(zip(logical.names, row, strict=True)) for row in points.tolist()]
        search = logical.search
        delays = [float(search.delay(point)) for point in values] if search else []
        return hashlib.sha256(np.asarray(zone).tobytes() + np.array(delays).tobytes()).hexdigest()[
            :16
        ]
    approach = logical.approach(logical.columns(points))
    found = hashlib.sha256()
    for part in (
        approach.ego_speed, approach.obstacle_speed, approach.gap, approach.delay,
        approach.obstacle_deceleration,
        approach.conflict_begin, approach.passing_length,
    ):  # fmt: skip
        found.update(np.broadcast_to(np.asarray(part, dtype=np.float64), len(points)).tobytes())
    return found.hexdigest()[:16]


def _rest(logical):
    body, road = logical.ego_body, logical.road
    content = [
        logical.name,
        logical.about,
        logical.source,
        [
            (axis.name, axis.low, axis.high, axis.step, axis.unit, axis.about, axis.values)
            for axis in logical.parameters
        ],
        [constraint.about for constraint in logical.constraints],
        [(own.name, own.about, own.points) for own in logical.samples],
        logical.default_sample,
        logical.time_limit,
        body and (body.length, body.width),
        (road.name, road.length, road.lanes, road.lane_width, road.run_out),
        logical.exposure_about,
        logical.zone_coordinates and logical.zone_coordinates.names,
    ]
    return hashlib.sha256(repr(content).encode()).hexdigest()[:16]


def test_the_catalogue_is_the_folder_of_files():
    assert (
        set(catalogue.SCENARIOS)
        == set(scenario_files())
        == {use for use in CONTENT if "?" not in use} | set(PLAYED)
    )
    assert "front_vehicle" not in catalogue.SCENARIOS


@pytest.mark.parametrize("use", sorted(CONTENT))
def test_law_a_shipped_scenario_is_to_the_bit_what_runs_were_made_with(use):
    logical = catalogue.load(use)
    assert (_scripts(logical), _approaches(logical), _rest(logical)) == CONTENT[use]


@pytest.mark.parametrize("use", sorted(PLAYED))
def test_law_a_shipped_scenario_that_is_played_is_what_runs_were_made_with(use):
    logical = catalogue.load(use)
    points = _points(logical)[::10]
    if sides := [column for column, axis in enumerate(logical.parameters) if axis.values]:
        points[:, sides] = np.where(points[:, sides] > 0.0, 1.0, -1.0)
    search = logical.search
    found = hashlib.sha256(f"{search.obstacle} {search.conflict}".encode())
    for concrete in logical.concretes(points[logical.feasible(points)]):
        way = concrete.ego.way
        numbers = [
            float(search.delay(concrete.values)),
            concrete.ego.x,
            concrete.ego.y,
            concrete.ego.speed,
        ]
        numbers += [] if way is None else [way.offset, way.begin, way.by]
        for actor in concrete.actors:
            numbers += [
                actor.start.x,
                actor.start.y,
                actor.start.speed,
                actor.heading,
                actor.length,
                actor.width,
            ]
            for act in actor.acts:
                numbers += act[:7]
                numbers += [value for knot in act.table for value in knot]
        found.update(" ".join(f"{number:.9g}" for number in numbers).encode())
    assert found.hexdigest()[:16] == PLAYED[use]


def test_the_zones_of_a_cut_in_see_closing_speed_and_the_gap_left():
    # 30 - 10 = 20 m/s; the bodies overlap across after (3.5 - 1.9) / 0.8 = 2 s, when 60 - 20 * 2 =
    # 20 m are left
    point = {name: np.array([value]) for name, value in zip(
        ("ego_speed", "cut_in_speed", "gap", "lateral_speed"), (30.0, 10.0, 60.0, 0.8),
        strict=True)}  # fmt: skip
    for use in ("cut_in", "cut_in?lateral_acceleration=1.5"):
        closing, left = catalogue.load(use).zone_coordinates.of(point)
        assert closing.tolist() == [20.0]
        assert left == pytest.approx(np.tanh(20.0 / 100.0), rel=1e-14)


@pytest.mark.parametrize("name", NAMES)
def test_no_shipped_scenario_declares_an_exposure(name):
    from sumo_eval.drivers.recorded.exposure import exposure_of
    from sumo_eval.settings import DriverSettings, ExposureSettings

    settings = ExposureSettings()
    assert not exposure_of(
        catalogue.load(name), settings, DriverSettings(), scenario_files()[name].parent
    ).known


@pytest.mark.parametrize(
    "name",
    [it if place % 5 == 0 else in_campaign(it) for place, it in enumerate(NAMES)],
)
def test_the_check_of_a_shipped_file_counts_its_points(name):
    chosen = sample(catalogue.load(name))
    sentences = check_file(scenario_files()[name])
    assert (
        f"{len(chosen.points)} possible points; constraints refuse {len(chosen.refused)} more."
        in sentences[1]
    )


@pytest.mark.parametrize(
    "use, sentence",
    rows_of("""
cut_in?lateral_acceleraton=1.5
| Unknown option `lateral_acceleraton` of scenario `cut_in`. Did you mean
cut_in?lateral_acceleration=fast
| of scenario `cut_in` must be a finite number of m/s2 above 0, got 'fast'.
cut_in?lateral_acceleration=0
| of scenario `cut_in` must be a finite number of m/s2 above 0, got '0'.
cut_in?lateral_acceleration=inf | must be a finite number of m/s2 above 0, got 'inf'.
cut_in?lateral_acceleration=nan | must be a finite number of m/s2 above 0, got 'nan'.
cut_in?lateral_acceleration | must be a finite number of m/s2 above 0, got ''.
cut_in?lateral_acceleration=1&lateral_acceleration=2 | must be given once
cut_in? | Unknown option `` of scenario `cut_in`.
r157_cut_out?lateral_acceleration=1.5
| Unknown option `lateral_acceleration` of scenario `r157_cut_out`.
cutin?lateral_acceleration=1.5 | Unknown logical scenario `cutin`. Did you mean `cut_in`?
"""),
)
def test_a_wrong_option_is_refused(use, sentence):
    with refused(sentence):
        catalogue.find(use)


def test_a_scenario_is_read_when_it_is_asked_for_and_once():
    program = (
        "import sys; read = []\n"
        "sys.addaudithook(lambda event, given: read.append(str(given[0])) if event == 'open' else "
        "None)\n"
        "from sumo_eval.scenario import catalogue\n"
        "assert 'cut_in' in catalogue.SCENARIOS and len(sorted(catalogue.SCENARIOS)) > 12\n"
        "before = len([name for name in read if name.endswith('.toml')])\n"
        "assert catalogue.load('ncap_ccrs') is catalogue.find('ncap_ccrs')\n"
        "print(before, [name.replace(chr(92), '/').split('/')[-1] for name in read if "
        "name.endswith('.toml')])"
    )
    assert python(program).stdout == "0 ['ncap_ccrs.toml']\n"
