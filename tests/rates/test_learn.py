"""`sumo-eval learn`: what was planted in floating car data is found again, and what is written can
be driven."""

import gc
import itertools
import os
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import cli_refuses, sumo_eval
from laid import read_json
from lxml import etree
from rates.planted import RANGES, RANK_CORRELATION, TOGETHER, planted, recordings_of, shares_of
from refusals import refusal
from road_scenes import scenario_of
from scipy.integrate import cumulative_trapezoid
from tables import in_campaign

from sumo_eval.drivers.recorded.importing import import_recordings
from sumo_eval.drivers.recorded.recordings import Recordings
from sumo_eval.extras.rates.command import called
from sumo_eval.extras.rates.encounters import CLASSES, Encounters, find_encounters
from sumo_eval.extras.rates.intervals import (
    correlation_interval,
    end_interval,
    kolmogorov,
    kolmogorov_by_chance,
    of_each,
    rate_interval,
)
from sumo_eval.extras.rates.learn_page import PAGE, sentences, write_lesson
from sumo_eval.extras.rates.learned import choose_model, folds_of, learn, measure
from sumo_eval.extras.rates.measured import LEAD_MOVES
from sumo_eval.extras.rates.scenes import content_of
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.concrete import smooth_step
from sumo_eval.scenario.joint import Joint


def recovered(folder, scenes, expected, seed):
    """Whether the interval of each planted quantity holds it, and whether all of a kind, and
    everything, do at once."""
    source = folder / "fcd.csv"
    folder.mkdir(exist_ok=True)
    rate, _ = planted(source, scenes, expected, seed)
    found = find_encounters([import_recordings("sumo_fcd", [source])])
    met = measure(found.classes["cut_in"], found, "planted")
    assert set(met.ends) == set(RANGES)
    in_rate = {"rate": met.rate[1] <= rate <= met.rate[2]}
    in_ends, in_correlations = {}, {}
    for name, (low, high) in RANGES.items():
        (lower, upper) = met.ends[name]
        # the file rounds to 0.1 mm and 0.1 s
        in_ends[f"{name} from"] = lower[0] - 0.01 <= low <= lower[1] + 0.01
        in_ends[f"{name} to"] = upper[0] - 0.01 <= high <= upper[1] + 0.01
    for (one, other), (_, low, high) in met.correlations.items():
        truth = RANK_CORRELATION if {one, other} == set(TOGETHER) else 0.0
        in_correlations[f"{one} with {other}"] = low <= truth <= high
    at_once = {"all ends": all(in_ends.values()), "all correlations": all(in_correlations.values())}
    low, high = met.rate_together
    at_once["everything"] = all(at_once.values()) and low <= rate <= high
    return in_rate | in_ends | in_correlations | at_once


@pytest.mark.campaign
def test_what_was_planted_is_found_again_and_the_files_can_be_driven(tmp_path):
    source, out = tmp_path / "fcd.csv", tmp_path / "learnt"
    _, events = planted(source, 44, 32.0, 6)
    sumo_eval(f"learn {source} --format sumo_fcd --out {out}")
    told = read_json(out / "learned.json")["classes"]["cut_in"]
    assert told["events"] == events
    assert told["without_parameters"] == {}
    logical = find("cut_in.toml", out)
    assert set(logical.names) == set(RANGES)
    for item in logical.parameters:
        low, high = RANGES[item.name]
        quantiles = told["parameters"][item.name]["recorded_quantiles"]
        assert low - 0.02 <= quantiles[0]  # 2 % of a unit: the fit of 0.1 s samples
        assert quantiles[-1] <= high + 0.02
        assert item.low < quantiles[0]
        assert quantiles[-1] < item.high
    together = next(item for item in told["rank_correlations"] if set(item["of"]) == set(TOGETHER))
    assert together["interval"][0] <= RANK_CORRELATION <= together["interval"][1]
    # m: the planted motion is one that the file can say
    assert told["replay_error"]["together"]["90 %"] < 0.1
    assert logical.met.events == told["events"]
    assert f"of {events} in [met]" in logical.exposure_about
    sets = etree.parse(out / "cut_in.xosc").findall(".//ParameterValueSet")
    assert len(sets) == len((out / "cut_in.events.csv").read_text().splitlines()) - 1
    concrete = logical.concrete(
        **{item.name: (item.low + item.high) / 2.0 for item in logical.parameters}
    )
    assert concrete.exposure > 0.0
    assert "data" in (out / "learned.html").read_text()


@pytest.mark.campaign
def test_what_was_planted_lies_in_the_intervals_in_93_of_100_repetitions(tmp_path):
    """Each of 21 quantities does, all ends at once, all correlations at once, and everything at
    once."""
    held = {}
    for seed in range(100):
        for name, inside in recovered(tmp_path / str(seed), 80, 48.0, seed).items():
            held[name] = held.get(name, 0) + int(inside)
    print(held)
    assert len(held) == 24
    assert {name: count for name, count in held.items() if count < 93} == {}


@pytest.mark.campaign
def test_intervals_of_a_class_hold_its_rate_all_its_ends_and_all_its_correlations_at_once_in_95_of_100():
    """1,000 samples of 48 events on average, drawn as `planted` draws them."""
    stream = np.random.default_rng(5)
    pairs = list(itertools.combinations(RANGES, 2))
    each = of_each(2 * len(RANGES) + len(pairs) + 1)
    truths = [0.0, 1.0] * len(RANGES) + [
        RANK_CORRELATION if set(pair) == set(TOGETHER) else 0.0 for pair in pairs
    ]
    held = 0
    for _ in range(1000):
        events = int(stream.poisson(48.0))
        columns = dict(zip(RANGES, shares_of(events, stream).T, strict=True))
        spans = [
            end_interval(values, upper=upper, level=each)
            for values in columns.values()
            for upper in (False, True)
        ]
        spans += [correlation_interval(columns[a], columns[b], each)[1:] for a, b in pairs]
        spans.append(rate_interval(events, 48.0, each))
        held += all(
            low <= truth <= high for truth, (low, high) in zip([*truths, 1.0], spans, strict=True)
        )
    # 95 % and three deviations of a share of 1,000 to either side
    assert 0.93 <= held / 1000 <= 0.97


def test_a_recording_without_encounters_gives_rates_and_no_files(tmp_path):
    source, out = tmp_path / "fcd.csv", tmp_path / "learnt"
    planted(source, 3, 0.0, 1)
    lesson = learn([import_recordings("sumo_fcd", [source])], out, "three scenes")
    learnt = lesson.learnt["cut_in"]
    assert learnt.encounters.events == 0
    assert learnt.logical is None
    assert not list(out.glob("*.toml"))
    # 3.689 / km: the exact upper limit of a Poisson rate with no event, at 97.5 %
    assert learnt.rate[2] == pytest.approx(3.689 / lesson.survey.kilometres, rel=1e-3)


def test_recordings_whose_name_is_not_utf8_are_refused_before_they_are_read(tmp_path):
    path = tmp_path / os.fsdecode(b"f\xff.csv")
    path.write_text("no recording")
    cli_refuses("must have a name in UTF-8", "learn", path)


def test_too_little_data_leaves_no_campaign_that_is_refused(tmp_path):
    source, out = tmp_path / "fcd.csv", tmp_path / "learnt"
    planted(source, 2, 1.0, 0)  # one encounter, of which nothing can be fitted
    out.mkdir()
    for name in ("campaign.toml", "cut_in.toml", "cut_in.xosc", "cut_in.events.csv"):
        (out / name).write_text("of an earlier time")
    done = sumo_eval(f"learn {source} --format sumo_fcd --out {out}")
    assert "no scenario file" in done.said
    assert "cut_in: 1 event, " in done.said
    assert "fitted cut_in: 1 done\n" in done.stderr
    assert "fitted lane_change: 7 done\n" in done.stderr
    assert not [*out.glob("*.toml"), *out.glob("cut_in.*")]


def test_a_class_whose_parameters_depend_on_each_other_costs_no_other_class(tmp_path):
    """All leads drive at 20 m/s, as in simulated traffic: the closing speed is the ego's less 20
    m/s."""
    time = np.round(np.arange(0.0, 14.05, 0.1), 1)
    parts = []
    for number, speed in enumerate(np.random.default_rng(1).uniform(24.0, 32.0, 30)):
        # the gap falls below 3.5 s after 5 s
        lead = 204.4 + 3.5 * speed + (speed - 20.0) * 5.0 + 20.0 * time
        tracks = {"ego": (200.0 + speed * time, 0.0 * time), "lead": (lead, 0.0 * time)}
        parts.append(recordings_of(time, tracks, 3.6).table.assign(recording=f"r{number}"))
    lesson = learn([Recordings(pd.concat(parts))], tmp_path, "platoons")
    learnt = lesson.learnt["approach"]
    assert set(lesson.learnt) == set(CLASSES)
    assert learnt.kept.sum() >= learnt.needed
    assert learnt.logical is None
    words = "with all parameters, which do not vary in each parameter on its own"
    assert any(words in line for line in sentences(lesson))
    write_lesson(lesson, tmp_path)
    assert words in (tmp_path / PAGE).read_text()


def test_folds_leave_events_that_a_model_can_be_fitted_to():
    """Two egos at constant speeds: without one of them, the speed does not vary."""
    stream = np.random.default_rng(1)
    rows = np.column_stack([np.repeat([25.0, 30.0], 20), stream.normal(size=40)])
    egos = [{"recording": "r", "ego": ego} for ego in "ab" for _ in range(20)]
    folds = folds_of(egos, rows)
    assert set(folds) == set(range(5))
    box = tuple(rows.min(axis=0) - 1.0), tuple(rows.max(axis=0) + 1.0)
    joint = Joint("kde", ("speed", "gap"), tuple(map(tuple, rows.tolist())), *box)
    assert np.isfinite(choose_model(joint, folds)[0].log_likelihood)
    # without fold 1 the speed does not vary: fold 0 alone is held out
    rows[20:39, 0] = 25.0
    uneven = replace(joint, events=tuple(map(tuple, rows.tolist())))
    assert np.isfinite(choose_model(uneven, np.repeat([0, 1], 20))[0].log_likelihood)


def test_many_files_are_called_by_the_first_and_the_last():
    hours = [Path(f"week/{number:03d}.csv") for number in range(120)]
    assert called(hours[:3]) == "000.csv, 001.csv, 002.csv"
    assert called(hours) == "120 files, 000.csv to 119.csv"


def test_a_table_without_motor_vehicles_is_refused(tmp_path):
    path = tmp_path / "people.csv"
    rows = [f"r,a,{t / 10:.1f},{t / 10:.1f},0,0.5,0.5,pedestrian" for t in range(30)]
    path.write_text("recording,vehicle,t,x,y,length,width,class\n" + "\n".join(rows) + "\n")
    cli_refuses("motor vehicles", f"learn {path} --out {tmp_path}/out")


def test_the_exact_poisson_limits():
    # Garwood's table for 10
    assert rate_interval(10, 2.0) == pytest.approx((4.7954 / 2.0, 18.3904 / 2.0), rel=1e-4)


def test_an_end_of_a_range_lies_beyond_the_last_value_by_up_to_a_multiple_of_the_distance_from_the_fourth():
    # c = 0.05^(-1/3) - 1 = 20^(1/3) - 1 = 1.714418
    assert end_interval(np.array([1.0, 5.0, 4.5, 4.0, 3.0]), upper=True) == pytest.approx(
        (5.0, 5.0 + 1.714418 * 2.0)
    )
    assert end_interval(np.array([1.0, 1.1, 4.5, 3.0]), upper=False) == pytest.approx(
        (1.0 - 1.714418 * 3.5, 1.0)
    )
    # of three values the two spacings that there are: 20^(1/2) - 1 = 3.472136
    assert end_interval(np.array([1.0, 2.0, 4.0]), upper=True) == pytest.approx(
        (4.0, 4.0 + 3.472136 * 3.0)
    )


def test_the_level_of_each_of_several_intervals_by_hand():
    assert of_each(1) == pytest.approx(0.95)
    assert of_each(2) == pytest.approx(0.974679, abs=1e-6)  # its square is 0.95


def test_the_interval_of_a_range_end_holds_it_in_95_of_100():
    stream = np.random.default_rng(1)
    held = [
        (end := end_interval(stream.uniform(0.0, 1.0, 40), upper=True))[0] <= 1.0 <= end[1]
        for _ in range(2000)
    ]
    assert 0.94 <= np.mean(held) <= 0.96


def test_rank_correlation_of_a_monotone_function_is_one():
    values = np.linspace(0.1, 3.0, 30)
    rho, low, high = correlation_interval(values, np.exp(values))
    assert rho == pytest.approx(1.0)
    assert low > 0.99
    assert high <= 1.0


@pytest.mark.campaign
def test_one_sample_in_twenty_is_further_from_its_own_distribution_than_chance_says():
    shares = np.random.default_rng(1).uniform(size=(2000, 60))
    beyond = np.mean([kolmogorov(values) > kolmogorov_by_chance(60) for values in shares])
    assert 0.03 < beyond < 0.06  # 5 % of very many values, a little less of 60


def test_kolmogorov_distance_by_hand():
    # 0.2, 0.5: the empirical function is 0.5 behind 0.2, 1 behind 0.5, where the even one has 0.2
    # and 0.5.
    assert kolmogorov(np.array([0.5, 0.2])) == pytest.approx(0.5)


@pytest.mark.parametrize("weighted", [in_campaign(False), True])
@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("bandwidth", [0.2, in_campaign(0.85)])
@pytest.mark.parametrize("kind", ["kde", "copula"])
def test_a_narrow_joint_density_varies_as_much_as_its_events_any_other_more_and_both_are_drawn_as_they_say(
    kind, bandwidth, narrow, weighted
):
    """The box is wide: no probability is outside."""
    stream = np.random.default_rng(4)
    a = stream.standard_gamma(4.0, 300) / 2.0 - 2.0  # skewed
    b = 0.6 * a + 0.8 * stream.standard_normal(300)
    weights = stream.poisson(1.0, 300) + 1e-9 if weighted else np.ones(300)
    events, cell = np.column_stack([a, b]), 0.05
    box = (-8.0, -8.0), (8.0, 8.0)
    joint = Joint(
        kind,
        ("a", "b"),
        tuple(map(tuple, events.tolist())),
        *box,
        bandwidth,
        "",
        tuple(weights.tolist()),
        narrow,
    )
    axis = np.arange(-8.0, 8.0, cell) + cell / 2.0
    mass = (
        joint.density(np.array(np.meshgrid(axis, axis, indexing="ij")).reshape(2, -1).T).reshape(
            320, 320
        )
        * cell**2
    )
    assert mass.sum() == pytest.approx(1.0, abs=2e-3)
    assert joint.density([[8.1, 0.0]]) == pytest.approx(0.0)
    for j in range(2):
        along = mass.sum(axis=1 - j)
        mean = float(np.average(events[:, j], weights=weights))
        variance = float(np.average((events[:, j] - mean) ** 2, weights=weights))
        assert along @ axis == pytest.approx(mean, abs=0.01)
        found = along @ (axis - mean) ** 2
        if narrow:
            assert found == pytest.approx(variance, rel=0.01)  # up to one in n - 1 events
        elif kind == "kde":
            assert found == pytest.approx((1.0 + bandwidth**2) * variance, rel=0.01)
        # the kernels' width is that of the events as they were met, and less where a tail is long
        else:
            kernels = (found - variance) / bandwidth**2 / events[:, j].var()
            assert 0.5 <= kernels <= 1.02
    drawn = joint.draw(20_000, np.random.default_rng(3))
    edges = np.linspace(-8.0, 8.0, 33)
    shares = np.histogram2d(*drawn.T, bins=[edges, edges])[0] / len(drawn)
    whole = mass.reshape(32, 10, 32, 10).sum(axis=(1, 3))
    assert np.all(np.abs(shares - whole) <= 5.0 * np.sqrt(whole / len(drawn)) + 1e-3)


def test_copula_holds_parameters_that_are_in_one_order():
    first = np.random.default_rng(1).uniform(1.0, 3.0, 40)
    joint = Joint(
        "copula", ("a", "b"), tuple(zip(first, first**3, strict=True)), (0.0, 0.0), (4.0, 30.0)
    )
    drawn = joint.draw(500, np.random.default_rng(2))
    assert correlation_interval(*drawn.T)[0] > 0.999
    assert np.isfinite(joint.density(drawn)).all()


def test_events_that_lie_on_a_line_are_refused():

    rows = tuple((float(i), 2.0 * i) for i in range(20))
    with refusal("must vary in each"):
        Joint("kde", ("a", "b"), rows, (0.0, 0.0), (20.0, 40.0))


def braking_leader(across):
    """A leader 60 m ahead brakes with 2 m/s2 for 3 s, as its follower does, and moves `across`
    lanes to the left meanwhile; two more keep the lanes where they are.
    """
    time = np.round(np.arange(0.0, 30.05, 0.1), 1)
    speed = 30.0 - 2.0 * np.clip(time - 10.0, 0.0, 3.0)
    lead = 60.0 + cumulative_trapezoid(speed, dx=0.1, initial=0.0)
    tracks = {
        "ego": (lead - 60.0, 0.0 * time),
        "lead": (lead, 3.5 * across * smooth_step((time - 9.0) / 5.0)),
        "first": (500.0 + 30.0 * time, 0.0 * time),
        "second": (700.0 + 30.0 * time, 3.5 + 0.0 * time),
    }
    return recordings_of(time, tracks, 3.5)


@pytest.mark.campaign
def test_what_is_kept_of_a_recording_is_a_small_part_of_it():
    one = braking_leader(0.0)
    size = int(one.table.memory_usage(deep=False).sum())  # some 140 kB
    kept = []

    def note(_name, _done):
        gc.collect()
        kept.append(tracemalloc.get_traced_memory()[0])

    tracemalloc.start()
    find_encounters(
        (Recordings(one.table.copy().assign(recording=f"r{number}")) for number in range(8)), note
    )
    tracemalloc.stop()
    assert (kept[7] - kept[2]) / 5 < 0.1 * size


@pytest.mark.parametrize("across, left_out", [(0.0, {}), (1.0, {LEAD_MOVES: 1})])
def test_a_lead_that_changes_lane_while_it_brakes_counts(across, left_out):
    found = find_encounters([braking_leader(across)]).classes["braking"]
    assert found.events == 1
    assert dict(found.left_out) == left_out
    if not left_out:
        assert found.rows[0]["deceleration"] == pytest.approx(2.0, abs=0.1)
        assert found.rows[0]["duration"] == pytest.approx(3.0, abs=0.5)


def test_events_that_are_all_alike_give_no_file_and_still_say_how_many_are_needed(tmp_path):
    found = find_encounters([braking_leader(0.0)])
    one = found.classes["braking"]
    alike = replace(one, rows=one.rows * 3, sources=one.sources * 3)
    met = measure(alike, found, "made up")
    assert met.logical is None
    assert met.needed == 5 * 5  # five events for each of five parameters
    assert not list(tmp_path.iterdir())


def test_law_constraints_that_leave_too_few_events_are_counted():
    found = find_encounters([braking_leader(0.0)])
    stream = np.random.default_rng(1)
    names = ("ego_speed", "closing_speed", "gap", "duration", "acceleration")
    rows = [dict(zip(names, stream.uniform(3.0, 5.0, 5), strict=True)) for _ in range(60)]
    for row in rows[9:]:  # of a vehicle that would stand, or drive backwards
        row["closing_speed"] += 3.0
    met = measure(Encounters("cut_in", rows=rows), found, "made up")
    assert met.logical is None
    assert np.count_nonzero(~met.kept) >= 51


def test_events_of_one_ego_are_held_out_too():
    rows = np.random.default_rng(1).normal(size=(9, 1))
    assert set(folds_of([{"recording": "r", "ego": "e"}] * 9, rows)) == set(range(5))


def test_vehicle_from_a_ramp_moves_from_the_right_as_in_its_file():
    time = np.round(np.arange(0.0, 25.05, 0.1), 1)
    change = smooth_step((time - 8.0) / 5.0)
    for side, class_ in ((-1.0, "merging"), (1.0, "cut_in")):
        tracks = {
            "ego": (28.0 * time, 0.0 * time),
            "other": (35.0 + 26.0 * time, 3.5 * side * (1.0 - change)),
            "beside": (26.0 * time - 300.0, 3.5 * side + 0.0 * time),
        }
        (motion,) = find_encounters([recordings_of(time, tracks, 3.5)]).classes[class_].motions
        assert motion.y[0] == pytest.approx(3.5 * side)
        assert motion.y[-1] == pytest.approx(0.0)


def test_no_learnt_vehicle_is_faster_than_roads_allow():
    ranges = {"headway": (0.5, 4.0), "closing_speed": (-15.0, 10.0), "ego_speed": (20.0, 56.0)}
    content = content_of(
        "t", "braking", ranges, {"deceleration": 1.0, "duration": 4.0}, 3.5, "made up"
    )
    assert {it["name"]: (it["low"], it["high"]) for it in content["parameter"]} == ranges
    logical = scenario_of(content)
    # the lead's speed is ego_speed - closing_speed: 60 and 60.1 m/s; SUMO lets nobody depart above
    # 60
    assert logical.feasible([[48.7, -11.3, 2.0], [48.7, -11.4, 2.0]]).tolist() == [
        True,
        False,
    ]
