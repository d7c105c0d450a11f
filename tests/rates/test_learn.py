"""`sumo-eval learn`: what was planted in floating car data is found again, and what is written can be driven."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from lxml import etree
from rates.planted import RANGES, RANK_CORRELATION, TOGETHER, planted

from sumo_eval.cli import main
from sumo_eval.drivers.recorded.importing import import_recordings
from sumo_eval.rates.intervals import end_interval, kolmogorov, rank_correlation, rate_interval
from sumo_eval.rates.learned import learn
from sumo_eval.scenario.catalogue import find
from sumo_eval.scenario.joint import Joint


def recovered(folder: Path, scenes: int, expected: float, seed: int) -> dict[str, bool]:
    """Whether the interval of each planted quantity holds it."""
    source = folder / "fcd.csv"
    folder.mkdir(exist_ok=True)
    rate, _ = planted(source, scenes, expected, seed)
    lesson = learn([import_recordings("sumo_fcd", [source])], folder / "learnt", "planted")
    learnt = lesson.learnt["cut_in"]
    assert learnt.logical is not None
    found = {"rate": learnt.rate[1] <= rate <= learnt.rate[2]}
    for name, (low, high) in RANGES.items():
        (lower, upper) = learnt.ends[name]
        found[f"{name} from"] = lower[0] - 0.01 <= low <= lower[1] + 0.01  # the file rounds to 0.1 mm and 0.1 s
        found[f"{name} to"] = upper[0] - 0.01 <= high <= upper[1] + 0.01
    for (one, other), (_, low, high) in learnt.correlations.items():
        truth = RANK_CORRELATION if {one, other} == set(TOGETHER) else 0.0
        found[f"{one} with {other}"] = low <= truth <= high
    return found


def test_what_was_planted_is_found_again_and_the_files_can_be_driven(tmp_path):
    source, out = tmp_path / "fcd.csv", tmp_path / "learnt"
    _, events = planted(source, 44, 32.0, 6)
    result = CliRunner().invoke(main, ["learn", str(source), "--format", "sumo_fcd", "--out", str(out)])
    assert result.exit_code == 0, result.output
    told = json.loads((out / "learned.json").read_text())["classes"]["cut_in"]
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
    assert told["replay_error"]["together"]["90 %"] < 0.1  # m: the planted motion is one that the file can say
    assert logical.met is not None
    assert logical.met.events == told["events"]
    sets = etree.parse(out / "cut_in.xosc").findall(".//ParameterValueSet")
    assert len(sets) == len((out / "cut_in.events.csv").read_text().splitlines()) - 1
    concrete = logical.concrete(**{item.name: (item.low + item.high) / 2.0 for item in logical.parameters})
    assert concrete.exposure > 0.0
    assert "data" in (out / "learned.html").read_text()


@pytest.mark.campaign
def test_what_was_planted_lies_in_the_intervals_in_93_of_100_repetitions(tmp_path):
    """Over all quantities 93 % of the intervals hold, and each one's in 88 of 100.

    Each quantity by itself cannot be asked for 93: X ~ Binomial(100, 0.95) is below 93 with probability 0.128, so 21
    exact intervals all reach it with 0.872^21 = 0.056. Below 88 it is with 0.00146, any of 21 with at most 0.031
    (Bonferroni): what fails here fails by more than the choice of the worst of 21.
    """
    held: dict[str, int] = {}
    for seed in range(100):
        for name, inside in recovered(tmp_path / str(seed), 80, 48.0, seed).items():
            held[name] = held.get(name, 0) + inside
    print(held)
    assert len(held) == 21
    assert sum(held.values()) >= 93 * len(held)
    assert min(held.values()) >= 88


def test_a_recording_without_encounters_gives_rates_and_no_files(tmp_path):
    source, out = tmp_path / "fcd.csv", tmp_path / "learnt"
    planted(source, 3, 0.0, 1)
    lesson = learn([import_recordings("sumo_fcd", [source])], out, "three scenes")
    learnt = lesson.learnt["cut_in"]
    assert learnt.encounters.events == 0
    assert learnt.logical is None
    assert not list(out.glob("*.toml"))
    # 3.689 / km: the exact upper limit of a Poisson rate with no event, at 97.5 %
    assert learnt.rate[2] == pytest.approx(3.689 / lesson.found.kilometres, rel=1e-3)


def test_a_table_without_motor_vehicles_is_refused_in_a_sentence(tmp_path):
    path = tmp_path / "people.csv"
    rows = [f"r,a,{t / 10:.1f},{t / 10:.1f},0,0.5,0.5,pedestrian" for t in range(30)]
    path.write_text("recording,vehicle,t,x,y,length,width,class\n" + "\n".join(rows) + "\n")
    result = CliRunner().invoke(main, ["learn", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "motor vehicles" in result.output + result.stderr
    assert "Traceback" not in result.output + result.stderr


def test_the_exact_poisson_limits():
    assert rate_interval(10, 2.0) == pytest.approx((4.7954 / 2.0, 18.3904 / 2.0), rel=1e-4)  # Garwood's table for 10


def test_an_end_of_a_range_lies_beyond_the_last_value_by_up_to_19_times_its_distance_from_the_one_before():
    assert end_interval(np.array([1.0, 5.0, 4.5]), upper=True) == pytest.approx((5.0, 5.0 + 19.0 * 0.5))
    assert end_interval(np.array([1.0, 1.1, 4.5]), upper=False) == pytest.approx((1.0 - 19.0 * 0.1, 1.0))


def test_the_interval_of_a_range_end_holds_it_in_95_of_100():
    stream = np.random.default_rng(1)
    held = [(end := end_interval(stream.uniform(0.0, 1.0, 40), upper=True))[0] <= 1.0 <= end[1] for _ in range(2000)]
    assert 0.94 <= np.mean(held) <= 0.96


def test_rank_correlation_of_a_monotone_function_is_one():
    values = np.linspace(0.1, 3.0, 30)
    rho, low, high = rank_correlation(values, np.exp(values))
    assert rho == pytest.approx(1.0)
    assert low > 0.99
    assert high <= 1.0


def test_kolmogorov_distance_by_hand():
    # 0.2, 0.5: the empirical function is 0.5 behind 0.2, 1 behind 0.5, where the even one has 0.2 and 0.5.
    assert kolmogorov(np.array([0.5, 0.2])) == pytest.approx(0.5)


@pytest.mark.parametrize("kind", ["kde", "copula"])
def test_a_joint_density_integrates_to_its_share_of_the_box_and_keeps_the_correlation(kind):
    stream = np.random.default_rng(2)
    a = stream.standard_normal(300)
    b = 0.8 * a + 0.6 * stream.standard_normal(300)
    joint = Joint(kind, ("a", "b"), tuple(zip(a.tolist(), b.tolist(), strict=True)), (-4.5, -4.5), (4.5, 4.5), 0.3)
    axis = np.linspace(-4.5, 4.5, 120, endpoint=False) + 0.0375  # the middles of 120 cells
    grid = np.array(np.meshgrid(axis, axis)).reshape(2, -1).T
    mass = joint.density(grid).sum() * 0.075**2
    assert mass == pytest.approx(1.0, abs=0.02)
    drawn = joint.draw(4000, np.random.default_rng(3))
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.8, abs=0.1)
    assert joint.density(np.array([[4.6, 0.0]])) == pytest.approx(0.0)


def test_events_that_lie_on_a_line_are_refused_in_a_sentence():
    from sumo_eval.errors import InputError

    rows = tuple((float(i), 2.0 * i) for i in range(20))
    with pytest.raises(InputError, match="must vary in each"):
        Joint("kde", ("a", "b"), rows, (0.0, 0.0), (20.0, 40.0))
