"""A recorded scene with an ADS in the place of one of its vehicles: others as they drove, or
reacting to it."""

import json
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import sumo_eval
from rates.planted import recordings_of
from refusals import refusal
from road_scenes import scenario_of
from tables import rows_of

from sumo_eval.cosim import simulate
from sumo_eval.drivers.recorded.recordings import Recordings, canonical, write_csv
from sumo_eval.evaluation import evaluate
from sumo_eval.extras.rates.departures import SceneDrive, write_departures
from sumo_eval.extras.rates.fitted import fit_speeds, thinned
from sumo_eval.extras.rates.recorded_scene import FAR, NEVER, ROAD_AS_WRITTEN, write_scene
from sumo_eval.record.store import open_store
from sumo_eval.scenario.concrete import departures, smooth_step
from sumo_eval.scenario.file import read_scenario
from sumo_eval.settings import AdsSettings, EvaluationSettings, SamplingSettings, ScenarioSettings

TIME = np.round(np.arange(0.0, 20.05, 0.1), 1)


def recorded():
    """Four in two lanes: the ego, one behind it, one that changes from the left lane to behind
    that, one far away."""
    changing = 3.6 * (1.0 - smooth_step((TIME - 4.0) / 5.0))
    tracks = {
        "ego": (200.0 + 25.0 * TIME, 0.0 * TIME),
        "rear": (160.0 + 25.0 * TIME + 0.5 * np.sin(TIME), 0.1 * np.sin(TIME / 3.0)),
        "side": (110.0 + 25.0 * TIME, changing),
        "left": (230.0 + 28.0 * TIME, 3.6 + 0.0 * TIME),
        "far": (900.0 + 28.0 * TIME, 3.6 + 0.0 * TIME),
    }
    return recordings_of(TIME, tracks, 3.6, 100.0)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    found = write_scene(recorded(), path, "ego", span=(None, 120.0), model="IDM", beyond=2.0)
    assert found.left_out == {FAR: 1}
    assert found.others == 3
    assert found.continued == 0
    assert found.seconds == 20.0
    assert found.error[1] < 0.1
    return path


def test_the_file_and_the_terminal_say_what_of_the_road_is_not_written(scene, tmp_path):
    assert read_scenario(scene).about.endswith(ROAD_AS_WRITTEN)
    table = tmp_path / "people.csv.gz"
    write_csv(recorded(), table)
    pd.read_csv(table).assign(weather="dry").to_csv(table, index=False)
    told = sumo_eval(f"humans scene {table} --ego ego --end 120 --out {tmp_path}/scene.toml")
    assert ROAD_AS_WRITTEN in told.said
    note = "Column `weather` of people.csv.gz is not known and is not read."
    assert note in told.said
    assert note in sumo_eval(f"humans exposure cut_in {table}", status=2).said


def test_names_that_differ_in_punctuation_stay_apart(tmp_path):
    table = recorded().table.replace({"vehicle": {"side": "a-1", "left": "a_1"}})
    write_scene(Recordings(table), tmp_path / "scene.toml", "ego")
    actors = read_scenario(tmp_path / "scene.toml").concrete(react_beyond=NEVER).actors
    assert {it.name for it in actors} == {"vrear", "va_1", "va_1_"}


def test_ego_stands_in_its_place_at_the_begin_of_the_scene(tmp_path):
    """`rear` is at 101.6 s where the ego was at 100 s."""
    found = write_scene(recorded(), tmp_path / "scene.toml", "ego", span=(101.6, 110.0))
    assert found.others == 3
    assert found.left_out == {FAR: 1}


def test_without_a_model_no_vehicle_reacts_and_one_point_is_left(tmp_path):
    path = tmp_path / "scene.toml"
    write_scene(recorded(), path, "ego")
    logical = read_scenario(path)
    with refusal("one where no actor reacts"):
        logical.concrete(react_beyond=2.0)
    found = simulate(logical.concrete(react_beyond=NEVER), "careful_driver")
    assert not any(clip.what == "handed_over" for clip in found.clips)


def test_without_a_departure_all_drive_as_recorded(scene):
    logical = read_scenario(scene)
    # the recorded ego kept its speed, too
    found = simulate(logical.concrete(react_beyond=2.0), "no_reaction")
    (clip,) = [one for one in found.clips if one.what == "departed"]
    assert clip.requested < 0.01
    assert not any(one.what in ("handed_over", "trigger_never_fired") for one in found.clips)
    truth = recorded().table
    for name in ("rear", "side", "left"):
        drive, rows = found.actors[f"v{name}"], truth[truth["vehicle"] == name]
        shift = found.ego.x[0] - 200.0
        x = np.interp(drive.time, TIME, rows["x"]) + shift
        assert np.abs(drive.x - x).max() < 0.1
        assert np.abs(drive.y - np.interp(drive.time, TIME, rows["y"])).max() < 0.1


def brakes(observation):
    return -3.0 if observation.time >= 12.0 else 0.0


def test_others_react_from_the_departure_on_else_they_collide(scene):
    logical = read_scenario(scene)
    reacting, blind = (
        simulate(logical.concrete(react_beyond=beyond), brakes) for beyond in (2.0, NEVER)
    )
    # 2 m = 3.0 / 2 t^2 after t = 1.155 s; the acceleration builds up within the vehicle's own jerk.
    (over,) = [one for one in reacting.clips if one.what == "handed_over"]
    assert over.count == 3
    assert 13.1 < over.requested < 13.7
    before = min(over.requested, 13.0)
    for name, drive in reacting.actors.items():
        seen = drive.time <= before
        assert np.array_equal(drive.x[seen], blind.actors[name].x[: seen.sum()])
    assert reacting.collision is None
    assert blind.collision.other == "vrear"
    assert blind.collision.side == "rear"


def test_distance_from_a_recorded_ego_by_hand():
    # at 0.05 s it was half-way between (0, 0) and (3, 4); after 0.1 s it stays at (3, 4)
    found = departures(((0.0, 0.0), (3.0, 4.0)), [0.0, 0.05, 9.0], [0.0, 1.5, 0.0], [0.0, 0.0, 0.0])
    assert found == pytest.approx([0.0, 2.0, 5.0])
    told = SceneDrive(
        "mine", "scene", "react_beyond=2", np.array([0.0, 0.05, 9.0]), found, (1.2, 2), "time_limit"
    )
    assert (
        "up to 5.0 m, at 9.0 s; 5.0 m at the end (time_limit); 2 react, from 1.2 s on"
        in told.sentence()
    )


def test_drives_without_trajectories_are_counted_not_passed_over(scene, tmp_path):
    settings = EvaluationSettings(
        "x",
        (ScenarioSettings(str(scene), sampling=SamplingSettings("grid")),),
        (AdsSettings("a", "no_reaction"),),
    )
    run = evaluate(settings, tmp_path / "run", engine="serial").folder
    with open_store(run, create=True) as store:
        cases = len(list(store.names("ads")))
        store.discard_trajectories(lambda scenario, number: number == 0)
    *drives, note = write_departures(run, tmp_path / "page.html")
    assert len(drives) == 1 < cases
    assert note == f"Drives left out, without trajectories: {cases - 1}."
    assert note in (tmp_path / "page.html").read_text()


def test_distances_are_from_the_ego_of_the_run_or_refused(tmp_path):
    """A scene that was written again under the same name, with another ego."""
    path = tmp_path / "scene.toml"
    write_scene(recorded(), path, "ego")
    settings = EvaluationSettings(
        "x",
        (ScenarioSettings(str(path), sampling=SamplingSettings("grid")),),
        (AdsSettings("a", "no_reaction"),),
    )
    run = evaluate(settings, tmp_path / "run", engine="serial").folder
    assert len(write_departures(run, tmp_path / "page.html")) == 2
    write_scene(recorded(), path, "left")
    with refusal("The file of scenario `scene` must be that of the run, and has changed since"):
        write_departures(run, tmp_path / "page.html")
    evaluation = run / "evaluation.toml"
    evaluation.write_text(evaluation.read_text().replace(str(path), "cut_in"))
    with refusal("Unknown scenario `scene` of the run"):
        write_departures(run, tmp_path / "page.html")


@pytest.mark.parametrize("seed", range(5))
def test_law_a_way_that_straight_speeds_drive_gives_them_back_wherever_it_begins(seed):
    stream = np.random.default_rng(seed)
    time = np.round(np.arange(3.0, 9.01, 0.1), 1)
    truth = stream.uniform(5.0, 30.0, 13)  # at 3, 3.5, ... 9 s
    fine = np.linspace(3.0, 9.0, 601)
    driven = np.concatenate([[0.0],
        np.cumsum(np.convolve(np.interp(fine, np.linspace(3.0, 9.0, 13), truth),
                                                          [0.5, 0.5],
                                                          "valid") * 0.01)])  # fmt: skip
    knots, speeds = fit_speeds(time, 100.0 + np.interp(time, fine, driven))
    assert knots == pytest.approx(np.arange(3.0, 9.01, 0.5))
    # the way is known every 0.1 s; it is a parabola between two knots, whose speeds it then
    # determines
    assert speeds == pytest.approx(truth, abs=1e-3)


def test_law_no_vehicle_drives_backwards_where_the_tracker_jumps():
    time = np.arange(0.0, 4.01, 0.1)
    assert fit_speeds(time, np.zeros(len(time)))[1] == pytest.approx(0.0, abs=1e-9)
    way = np.where(time < 2.0, 5.0 * time, 10.0 - 3.0 * (time - 2.0))
    _, speeds = fit_speeds(time, way)
    assert speeds.min() >= 0.0
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9)  # he stands while his track goes back


def test_points_that_make_a_line_by_hand():
    x = np.arange(5.0)
    assert thinned(x, np.array([0.0, 0.0, 1.0, 0.0, 0.0]), 0.1) == [0, 1, 2, 3, 4]
    assert thinned(x, 0.3 * x, 0.1) == [0, 4]


@pytest.mark.parametrize("tolerance", [0.01, 0.03, 0.3])
def test_law_a_thinned_path_keeps_its_ends_and_is_nowhere_further_off_than_it_may_be(tolerance):
    stream = np.random.default_rng(7)
    x = np.cumsum(stream.uniform(0.5, 3.0, 300))
    y = np.cumsum(stream.normal(0.0, 0.05, 300))
    kept = thinned(x, y, tolerance)
    assert kept[0] == 0
    assert kept[-1] == 299
    assert kept == sorted(set(kept))
    for a, b in pairwise(kept):
        along = np.array([x[b] - x[a], y[b] - y[a]])
        off = (x[a : b + 1] - x[a]) * along[1] - (y[a : b + 1] - y[a]) * along[0]
        assert np.abs(off).max() / np.hypot(*along) <= tolerance + 1e-12
    assert len(kept) < 300


def test_a_path_that_comes_back_to_where_it_began_keeps_its_furthest_point():
    assert thinned(np.array([0.0, 3.0, 0.0]), np.array([0.0, 4.0, 0.0]), 0.1) == [0, 1, 2]


@pytest.mark.parametrize(
    "given, words",
    [
        *rows_of(
            """
{"ego": "eg"} | Unknown vehicle `eg` of the recording. Did you mean `ego`
{"ego": "ego", "span": [null, 300.0]} | within its recording, 100 to 120 s
{"ego": "ego", "recording": "q"} | Unknown recording `q`
{"ego": "ego", "model": "IDM", "beyond": 0.0} | must be above 0 m
""",
            json.loads,
        ),
        ({"ego": "ego", "path": Path("x.txt")}, "one that ends with .toml, got 'x.txt'"),
    ],
)
def test_a_scene_that_cannot_be_is_refused(tmp_path, given, words):
    with refusal(words):
        write_scene(recorded(), **{"path": tmp_path / "scene.toml", **given})


def test_a_refused_scene_leaves_no_file(tmp_path):
    recordings = recorded()
    flat = recordings.table["width"].mask(recordings.table["vehicle"] == "rear", 0.0)
    recordings = recordings._replace(table=recordings.table.assign(width=flat))
    with refusal(r"`vehicle\[1\].width` in scene .* must be greater than 0"):
        write_scene(recordings, tmp_path / "scene.toml", "ego")
    assert not any(tmp_path.iterdir())


def twice(*, with_ego):
    """Two recordings of the same vehicles, the ego in both or in the first alone."""
    table = recorded().table
    other = table if with_ego else table[table["vehicle"] != "ego"]
    return canonical(pd.concat([table, other.assign(recording="s")], ignore_index=True))


def test_of_several_recordings_the_only_one_with_the_ego_is_taken(tmp_path):
    path = tmp_path / "scene.toml"
    write_scene(twice(with_ego=False), path, "ego")
    alone = tmp_path / "alone" / "scene.toml"
    write_scene(recorded(), alone, "ego")
    assert path.read_text() == alone.read_text()
    with refusal(r"`recording` must name one recording: vehicle `ego` is in 2, r, s\."):
        write_scene(twice(with_ego=True), path, "ego")
    with refusal(r"Unknown vehicle `eg` of the recording\. Did you mean `ego`"):
        write_scene(twice(with_ego=True), path, "eg")
    write_scene(twice(with_ego=True), path, "ego", recording="s")
    assert "s, recorded" in read_scenario(path).source


def test_one_who_follows_late_must_do_nothing_after_it_and_departed_needs_a_recorded_ego():
    follow = """
name = "t"
parameter = [{ name = "far", unit = "m", values = [1.0, 2.0] }]
zone = "none"
ego = { speed = 20.0, recorded = [[50.0, 0.0], [52.0, 0.0]] }
[[vehicle]]
name = "a"
gap = 30.0
speed = 20.0
[[vehicle.manoeuvre]]
do = "follow"
model = "IDM"
when = "departed > far"
"""
    assert scenario_of(follow).concrete(far=1.0).reacts
    with refusal("must do nothing after it does `follow`"):
        scenario_of(f'{follow}[[vehicle.manoeuvre]]\ndo = "brake"\ndeceleration = 2.0')
    with refusal("has `recorded` places"):
        scenario_of(follow.replace(", recorded = [[50.0, 0.0], [52.0, 0.0]]", ""))


def test_law_others_are_handed_over_on_a_curve_as_on_a_straight(scene):
    """The recorded ego brakes with 3 m/s2 from 12 s on, the ADS does not: 2 m apart after sqrt(4 /
    3) = 1.155 s."""
    content = tomllib.loads(scene.read_text())
    braked = np.maximum(np.arange(len(content["ego"]["recorded"])) * 0.1 - 12.0, 0.0)
    content["ego"]["recorded"] = [
        [x - 1.5 * t**2, y]
        for (x, y), t in zip(content["ego"]["recorded"], braked.tolist(), strict=True)
    ]
    straight = simulate(scenario_of(content).concrete(react_beyond=2.0), "idm")
    content["road"]["line"] = [{"length": content["road"].pop("length"), "radius": 600.0}]
    bend = simulate(scenario_of(content).concrete(react_beyond=2.0), "idm")
    for found in (straight, bend):
        assert found.collision is None
        (over,) = [one for one in found.clips if one.what == "handed_over"]
        assert over.count == 3
        assert over.requested == pytest.approx(13.18, abs=0.06)  # a step of 0.05 s
    for name, drive in bend.actors.items():
        other = straight.actors[name]
        assert len(drive) == len(other)
        # scripts say speeds along their own lane: on the one 3.6 m to the left, arcs are 3.6 / 600
        # shorter
        assert (
            np.abs(drive.x - other.x)[drive.time <= 13.0].max() < 3.6 / 600.0 * 28.0 * 13.0 + 0.05
        )
        assert np.abs(drive.y - other.y)[drive.time <= 13.0].max() < 0.05
        # nobody jumps where SUMO takes over: 28 m/s drive 2.8 m in 0.1 s
        assert np.abs(np.diff(drive.x)).max() < 3.1
        assert np.abs(np.diff(drive.y)).max() < 0.2


def test_a_vehicle_that_stops_at_the_begin_stands_in_the_file(tmp_path):
    """It stops from 1.8 m/s within 0.9 m, and stands for 19 s."""
    braking = np.minimum(TIME, 1.0)
    tracks = {
        "ego": (200.0 + 5.0 * TIME, 3.6 + 0.0 * TIME),
        "stops": (260.0 + 1.8 * braking - 0.9 * braking**2, 0.0 * TIME),
    }
    path = tmp_path / "scene.toml"
    found = write_scene(recordings_of(TIME, tracks, 3.6, 100.0), path, "ego")
    assert found.error[1] == pytest.approx(0.9, abs=1e-3)
    assert simulate(
        read_scenario(path).concrete(react_beyond=NEVER), "no_reaction"
    ).actors["vstops"].x[-1] == pytest.approx(160.0, abs=0.01)  # fmt: skip


def test_the_longest_scene_may_begin_at_any_tenth_of_a_second(tmp_path):
    """220.3 s - 100.3 s is more than 120 s by rounding."""
    time = np.round(np.arange(0.0, 125.05, 0.1), 1)
    tracks = {"ego": (200.0 + 5.0 * time, 0.0 * time), "left": (230.0 + 6.0 * time, 3.6 + 0 * time)}
    table = recordings_of(time, tracks, 3.6, 100.0)
    assert write_scene(table, tmp_path / "scene.toml", "ego", span=(100.3, 220.3)).seconds == 120.0


def test_a_scene_of_vehicles_left_out_says_why(tmp_path):
    with refusal(r"got none \(left out: 4 recorded for less than a second of the scene\)"):
        write_scene(recorded(), tmp_path / "scene.toml", "ego", span=(100.0, 100.5))
