"""Ways to choose points: each does what its name says, with a seed, and says what constraints took
away."""

import itertools
import json
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal, refused
from road_scenes import every_point
from scipy import stats
from tables import rows_of

from sumo_eval.scenario import (
    Approach,
    Constraint,
    LogicalScenario,
    Parameter,
    Road,
    Start,
    catalogue,
)
from sumo_eval.scenario.distribution import Distribution
from sumo_eval.scenario.expression import Definitions, Expression
from sumo_eval.scenario.file import check_points
from sumo_eval.scenario.formulas import ExposureDensity
from sumo_eval.scenario.number_table import read_numbers
from sumo_eval.scenario.sampling.combinations import combination_numbers
from sumo_eval.scenario.sampling.listed_points import from_csv
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sampling.samples import all_methods, sample
from sumo_eval.scenario.units import factor_to, in_own_unit, si_factor

CUT_IN, CUT_OUT = catalogue.load("cut_in"), catalogue.load("front_vehicle_cut_out")
DRAWN = ("latin_hypercube", "sobol", "halton", "exposure", "exposure_danger")


def space(*parameters, constraints=(), exposure=None):
    extra = {} if exposure is None else {"exposure": exposure}
    return LogicalScenario(
        name="box", about="-", source="-", parameters=parameters, constraints=constraints,
        road=Road("r", 600.0, 2, 3.5, 0.0), place=lambda values: (Start(0.0, 0.0, 1.0), ()),
        approach=lambda values: Approach(values["a"], values["a"], values["a"], 0.0), **extra,
    )  # fmt: skip


def axis(name, low=0.0, high=1.0, step=0.25, **more):
    return Parameter(name, low, high, step, "1", "-", **more)


SQUARE = space(axis("a"), axis("b"))


def draw(logical, method, count=64, seed=1, **more):
    danger = lambda points: np.clip(points[:, 0], 0.0, 1.0)  # noqa: E731
    return sample(logical, method, request=Request(count=count, seed=seed, danger=danger, **more))


# --- every one of them ----------------------------------------------------------------------------


@pytest.mark.parametrize("method", DRAWN)
def test_same_seed_same_points_another_seed_others(method):
    first, again, other = draw(CUT_IN, method), draw(CUT_IN, method), draw(CUT_IN, method, seed=2)
    assert first.points.tobytes() == again.points.tobytes()
    assert first.exposure.tobytes() == again.exposure.tobytes()
    assert first.points.tobytes() != other.points.tobytes()
    # 0 is a seed like any other
    assert draw(CUT_IN, method, seed=0).points.tobytes() != first.points.tobytes()


# Written down once, so that a platform or a version with other digits is noticed.
GOLDEN = tomllib.loads("""
latin_hypercube = [19.93606, 14.94641, 39.3377]
sobol = [19.13502, 6.30581, 22.6703]
halton = [18.28122, 6.67076, 48.426]
exposure = [19.44968, 13.76941, 22.2015]
exposure_danger = [13.77439, 2.39121, 25.4241]
""")


@pytest.mark.parametrize("method", DRAWN)
def test_the_points_are_those_written_down(method):
    chosen = draw(CUT_OUT, method, 4)
    everything = np.concatenate([chosen.points, chosen.refused])
    assert everything[np.lexsort(everything.T)][0].tolist() == GOLDEN[method]


@pytest.mark.parametrize("method", DRAWN)
def test_what_constraints_exclude_is_kept_apart_and_counted(method):
    chosen = draw(CUT_IN, method, 128)
    assert CUT_IN.feasible(chosen.points).all()
    assert not CUT_IN.feasible(chosen.refused).any()
    assert len(chosen.points) + len(chosen.refused) == 128
    assert len(chosen.refused) > 20  # cut_in_speed < ego_speed excludes about two fifths of the box
    assert CUT_IN.in_box(chosen.points).all()
    assert len(chosen.exposure) == len(chosen.points)


# --- combinations ---------------------------------------------------------------------------------


def held(points, strength):
    """Every combination of `strength` values that points hold, by going through all of them."""
    return {
        (columns, tuple(round(row[column], 6) for column in columns))
        for row in points.tolist()
        for columns in itertools.combinations(range(len(row)), strength)
    }


@pytest.mark.parametrize("strength", [1, 2, 3, 4])
@pytest.mark.parametrize("levels", [3, 5])
def test_every_possible_combination_of_t_values_is_held_counted_one_by_one(strength, levels):
    everything = every_point(CUT_IN, levels=levels)
    possible = held(everything[CUT_IN.feasible(everything)], strength)
    chosen = sample(CUT_IN, "combinations", request=Request(levels=levels, strength=strength))
    assert held(chosen.points, strength) == possible
    if strength < 4:
        assert len(chosen.points) < int(CUT_IN.feasible(everything).sum())


def test_strength_3_of_five_factors_of_five_holds_all_1250_triples_and_pairwise_is_far_smaller_than_the_grid():
    five = space(*(axis(name) for name in "abcde"))
    triples = sample(five, "combinations", request=Request(strength=3)).points
    # 5 values each: C(5, 3) * 5^3 = 1250 triples, C(5, 2) * 5^2 = 250 pairs, 3125 points in the
    # grid
    assert len(held(triples, 3)) == 1250
    pairs = sample(five, "pairwise").points
    assert len(held(pairs, 2)) == 250
    assert len(pairs) < 50
    assert len(triples) < 320
    assert len(sample(space(axis("a")), "combinations").points) == 5


def test_the_fast_count_of_tuples_is_the_plain_one():
    codes = combination_numbers(np.array([[0, 1, 2], [1, 1, 0], [0, 1, 0]]), [2, 2, 3], 2)
    # axes 0, 1: (0,1) (1,1) (0,1); axes 0, 2: (0,2) (1,0) (0,0); axes 1, 2: (1,2) (1,0) (1,0)
    assert [len(set(code.tolist())) for code in codes] == [2, 3, 2]


def test_impossible_pairs_are_said():
    chosen = sample(CUT_IN, "pairwise", request=Request(levels=3))
    assert any("pairs of values exist in no possible point" in note for note in chosen.notes)


# --- even ones ------------------------------------------------------------------------------------


def test_a_latin_hypercube_has_one_point_in_each_layer():
    points = draw(SQUARE, "latin_hypercube", 50).points
    for column in points.T:
        assert sorted(np.minimum((column * 50).astype(int), 49).tolist()) == list(range(50))


def test_64_sobol_points_put_one_into_each_of_8_by_8_cells():
    points = draw(SQUARE, "sobol", 64).points
    assert len({(int(a * 8 - 1e-7), int(b * 8 - 1e-7)) for a, b in points}) == 64


def test_a_count_that_is_not_a_power_of_2_is_reported():
    assert "powers of 2" in draw(CUT_IN, "sobol", 100).notes[0]
    assert draw(CUT_IN, "sobol", 128).notes == ()


def test_listed_values_are_the_only_ones_drawn():
    listed = space(axis("a", 0.0, 10.0, values=(0.0, 2.5, 10.0)), axis("b"))
    for method in DRAWN:
        assert set(draw(listed, method).points[:, 0].tolist()) == {0.0, 2.5, 10.0}
    assert set(sample(listed).points[:, 0].tolist()) == {0.0, 2.5, 10.0}


# --- by exposure ----------------------------------------------------------------------------------


def test_drawn_by_exposure_a_parameter_has_its_distribution():
    normal = Distribution.of("norm", {"loc": 0.3, "scale": 0.1}, "a test")
    axes = (axis("a", distribution=normal), axis("b"))
    exposure = ExposureDensity(axes, None, Definitions(()))
    points = draw(space(*axes, exposure=exposure), "exposure", 1024).points
    for column, law in zip(
        points.T, (stats.truncnorm(-3, 7, 0.3, 0.1).cdf, "uniform"), strict=True
    ):
        assert stats.kstest(column, law).pvalue > 0.05


def test_an_impossible_exposure_is_reported_by_one_value():
    exposure = ExposureDensity((), Expression("a - 1.0"), Definitions(()))
    with refusal("`a - 1.0` of the exposure must be finite and at least 0, got -0.5.$"):
        exposure({"a": np.linspace(0.5, 9.0, 1000), "b": np.zeros(1000)})


def test_shares_of_a_distribution_are_of_its_range():
    # F(x) = 1 - exp(-x) is 0.5 at ln 2, so half of 0..ln 2 lies below -ln(1 - 0.25)
    decay = Distribution.of("expon", {"scale": 1.0}, "a test")
    assert decay.quantile(0.5, 0.0, math.log(2.0)) == pytest.approx(-math.log(0.75))


def test_an_even_exposure_gives_any_count():
    drawn = draw(space(axis("a")), "exposure", 2**18 + 1)
    assert len(drawn.points) == 2**18 + 1
    assert drawn.notes == ()


def test_an_exposure_that_no_parameter_has_alone_is_drawn_as_well():
    # p(a, b) ~ a b on the unit square: E[a] = 2/3, E[a b] = 4/9
    both = space(axis("a"), axis("b"), exposure=lambda values: values["a"] * values["b"])
    points = draw(both, "exposure", 2000).points
    assert points[:, 0].mean() == pytest.approx(2 / 3, abs=0.02)
    assert (points[:, 0] * points[:, 1]).mean() == pytest.approx(4 / 9, abs=0.02)


def test_law_a_frequent_point_counts_as_often_as_drawn():
    # 1 for a thousandth of the range and 1 for the rest: half of the exposure is in the peak
    peak = space(axis("a"), exposure=lambda values: 1.0 + 1000.0 * (abs(values["a"] - 0.5) < 5e-4))
    chosen = draw(peak, "exposure", 100)
    assert len(chosen.points) < 100 == chosen.exposure.sum()
    share = np.average(abs(chosen.points[:, 0] - 0.5) < 5e-4, weights=chosen.exposure)
    assert share == pytest.approx(0.5, abs=0.05)


def test_a_point_drawn_by_exposure_counts_once_and_not_by_its_exposure_again():
    both = space(axis("a"), axis("b"), exposure=lambda values: values["a"])
    assert np.unique(draw(both, "exposure").exposure).tolist() == [1.0]
    grid = sample(both, levels=3)
    assert grid.exposure.tolist() == grid.points[:, 0].tolist()


def test_weighted_by_danger_a_mean_is_still_the_mean_over_the_exposure():
    # p ~ 1, danger = a: of f(a) = a^2 the mean is 1/3, whatever the attention
    chosen = draw(SQUARE, "exposure_danger", 2000)
    a = chosen.points[:, 0]
    assert a.mean() > 0.6  # attention 0.05 + a: E[a] = (0.025 + 1/3) / 0.55 = 0.652
    assert np.average(a**2, weights=chosen.exposure) == pytest.approx(1 / 3, abs=0.02)


def test_an_exposure_of_nothing_is_refused():
    with refusal("above 0 somewhere"):
        draw(space(axis("a"), exposure=lambda values: np.zeros(np.shape(values["a"]))), "exposure")


@pytest.mark.parametrize(
    "exposure, words",
    [
        (lambda values: 1.0 / values["a"], "at each point, got 'inf at a=0'"),
        (lambda values: values["a"] - 0.3, "finite and at least 0 .* got '-0.3 at a=0'"),
        (lambda values: np.where(values["a"] > 0.3, np.nan, 1.0), "got 'nan at a=0.5'"),
        (lambda values: 1 // 0, "exposure of scenario `box` failed: ZeroDivisionError"),
        (lambda values: np.ones(3), "exposure of scenario `box` failed: ValueError"),
    ],
)
def test_exposure_that_weights_no_mean_is_refused(exposure, words):
    with np.errstate(divide="ignore"), refusal(words):
        sample(space(axis("a"), exposure=exposure))


@pytest.mark.parametrize("function", ["place", "approach", "margin"])
def test_function_of_a_scenario_that_fails_is_reported(function):
    fails = replace(SQUARE, **{function: lambda values: 1 // 0})
    with refusal("Scenario `box` failed: ZeroDivisionError"):
        check_points(fails, [[0.5, 0.5]])


def test_a_density_infinite_at_an_end_is_drawn_from():
    # gamma with shape 1/2 and scale 1: its mean is 1/2, its density infinite at 0
    steep = axis("a", high=20.0, distribution=Distribution.of("gamma", {"a": 0.5}, "a test"))
    density = ExposureDensity((steep,), None, Definitions(()))
    chosen = draw(space(steep, exposure=density), "exposure", 4096)
    assert chosen.points.min() > 0.0
    mean = np.average(chosen.points[:, 0], weights=chosen.exposure)
    assert mean == pytest.approx(0.5, abs=0.04)  # its deviation is sqrt(1/2 / 4096) = 0.011


# --- the user's own -------------------------------------------------------------------------------


def from_file(tmp_path, text):
    (tmp_path / "points.csv").write_text(text)
    return sample(CUT_OUT, "file", request=Request(file="points.csv", folder=tmp_path))


def test_points_from_a_csv_in_any_order_of_columns(tmp_path):
    text = (
        "gap,name,ego_speed,obstacle_speed,exposure\n60,x,20,5,0.25\n30,y,10,10,1\n100.5,z,30,0,2\n"
    )
    again = from_file(tmp_path, text + "60,x,20,5,0.25\n").notes
    assert again[1] == "Points of points.csv that a row above has, too; they count again: 1."
    chosen = from_file(tmp_path, text)
    assert chosen.points.tolist() == [[20.0, 5.0, 60.0], [30.0, 0.0, 100.5]]
    assert chosen.refused.tolist() == [[10.0, 10.0, 30.0]]  # the obstacle must be slower
    assert chosen.exposure.tolist() == [0.25, 2.0]
    assert chosen.notes == ("Columns of points.csv that name no parameter: name.",)


def test_law_a_number_of_few_digits_in_another_unit_stays_one():
    """35 cm lie within a bound of 0.35 m, 21.6 km/h within 6 m/s."""
    centimetres, kilometres = factor_to("m", "cm", "gap"), factor_to("m/s", "km/h", "speed")
    for number in range(1, 2_000):
        assert in_own_unit(float(number), centimetres) == number / 100.0
        assert in_own_unit(number * 18 / 10.0, kilometres) == number / 2.0
    assert in_own_unit(0.1 + 0.2, 1.0) == 0.1 + 0.2


def test_factors_to_si_units():
    """180 deg = pi; 5 per km = 0.005 per m. FMUs describe some units by their names alone."""
    assert 180.0 * si_factor("°") == pytest.approx(np.pi)
    assert 5.0 * si_factor("1/km") == pytest.approx(0.005)
    assert [si_factor(unit) for unit in ("m/s^2", "1/m", "rod")] == [1.0, 1.0, None]


@pytest.mark.parametrize(
    "text, sentence",
    [
        (
            "gap,ego_sped,obstacle_speed\n1,2,3\n",
            "must have a column `ego_speed`. Did you mean `ego_sped`?",
        ),
        ("gap,ego_speed,obstacle_speed\n", "must have at least one row"),
        ("gap,ego_speed,obstacle_speed\n60,20,\n", "`obstacle_speed` in line 2 of the points"),
        ("gap,ego_speed,obstacle_speed\n60,20,5\n60,nan,5\n", "`ego_speed` in line 3"),
        ("\ngap,ego_speed,obstacle_speed\n\n60,20,5\n\n60,nan,5\n", "`ego_speed` in line 6"),
        ("gap,ego_speed,obstacle_speed\n60,20,5\n160,20,5\n", "`gap` of point 2"),
        ("gap,ego_speed,obstacle_speed,exposure\n60,20,5,-1\n", "`exposure` of the points"),
    ],
)
def test_a_csv_that_cannot_be_used_is_refused(tmp_path, text, sentence):
    with refused(sentence):
        from_file(tmp_path, text)


def test_points_at_shares_exist_where_a_parameter_lists_its_values():
    space = catalogue.load("lane_drop_cut")
    shares = np.linspace(0.0, 1.0, 9)[:, None] * np.ones(len(space.names))
    points = space.from_shares(shares)
    assert points[:, space.column("side")].tolist() == [-1.0] * 4 + [1.0] * 5
    assert points[[0, -1]].tolist() == [space.low.tolist(), space.high.tolist()]
    assert len(space.concretes(points[space.feasible(points)])) > 0


def test_a_sampler_of_the_users_is_a_function_of_space_number_and_stream(tmp_path):
    (tmp_path / "mine.py").write_text(
        "def corners(space, n, rng):\n    return space.from_unit(rng.integers(0, 2, (n, "
        "len(space.names))))\n"
        "def few(space, n, rng):\n    return space.from_unit(rng.random((n - 1, 3)))\n"
        "def broken(space, n, rng):\n    raise ValueError('no idea')\n"
        "def flat(space, n, rng):\n    return rng.random(n)\n"
        "def lost(space, n, rng):\n    return [[20.0, 5.0, float('nan')]]\n"
    )
    request = Request(count=20, folder=tmp_path)
    chosen = sample(CUT_OUT, "mine.py:corners", request=request)
    assert set(np.concatenate([chosen.points, chosen.refused])[:, 2].tolist()) == {20.0, 120.0}
    (note,) = sample(CUT_OUT, "mine.py:few", request=request).notes
    assert "was asked for 20 points, returned 19" in note
    for name, sentence in (
        ("broken", "ValueError: no idea"),
        ("flat", r"an \(n, 3\) array"),
        ("lost", "`gap` of point 1 .* within 20..120 m, got nan"),
    ):
        with refusal(sentence):
            sample(CUT_OUT, f"mine.py:{name}", request=request)


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "method, keys, sentence",
    rows_of(
        """
sobol | {}
| `count` of the sampling of scenario `front_vehicle_cut_out` must be a whole number from 1
sobol | {"count": 0} | must be a whole number from 1
sobol | {"count": 5, "levels": 3}
| `levels` of the sampling of scenario `front_vehicle_cut_out` does nothing
grid | {"count": 5} | does nothing in method `grid`, which takes `levels`, `steps`
combinations | {"strength": 4} | within 1..3, its parameters
file | {} | `file` of the sampling of scenario `front_vehicle_cut_out` is missing
exposure_danger | {"count": 5} | needs a danger of each point
soboll | {"count": 5} | Did you mean `sobol`?
""",
        str,
        json.loads,
    ),
)
def test_a_request_that_makes_no_points_is_refused(method, keys, sentence):
    with refused(sentence):
        sample(CUT_OUT, method, request=Request(**keys))


def test_every_method_says_which_keys_it_takes():
    known = {"levels", "steps", "count", "strength", "file", "round", "aim", "until", "rounds"}
    assert all(takes and takes <= known for _, takes in all_methods().values())


def test_events_are_read_as_points_are_with_units_and_lines(tmp_path):
    path, units = tmp_path / "e.csv", {"gap": "m", "v": "m/s"}
    path.write_text("gap (cm),v,note\n250,1,x\n")
    assert read_numbers(path, "events", units).rows.tolist() == [[2.5, 1.0]]
    path.write_text(",gap,v\n0,250,1\n")  # a table with an index, which has no name
    assert read_numbers(path, "events", units).rows.tolist() == [[250.0, 1.0]]
    path.write_text("gap,v\n1,nan\n")
    with refusal("`v` in line 2 of the events"):
        read_numbers(path, "events", units)
    path.write_text("exposure\n4\n")  # a parameter of that name is no weight
    assert read_numbers(path, "points", {"exposure": "1"}, "exposure").rows.tolist() == [[4.0]]


def test_constraints_that_exclude_every_point_are_refused():
    nothing = replace(CUT_OUT, constraints=(Constraint("impossible", lambda v: v["gap"] > 1e9),))
    with refusal("Of 64 points, 64 are not `impossible`"):
        draw(nothing, "sobol")
    with refusal("Of 1 point, 1 is not `impossible`"):
        sample(nothing, "sobol", request=Request(count=1))


@pytest.mark.parametrize(
    "text, words",
    [
        ("ego_speed,lead_speed\n20,10,5\n", "Line 2 of the points .* must have 2 values, got more"),
        (
            "ego_speed,ego_speed,lead_speed\n20,20,10\n",
            "must have every column once, got 'ego_speed' twice",
        ),
        (f"ego_speed,lead_speed\n{'1' * 5_000},10\n", "must be a number"),
        ("ego_speed,lead_speed\n20\n", "must be a number"),
        ("ego_speed,lead_speed\n2_0,10\n", "must be a number"),
    ],
)
def test_a_list_of_points_with_odd_rows_is_refused(tmp_path, text, words):
    (tmp_path / "points.csv").write_text(text)
    with refusal(words):
        from_csv(
            catalogue.load("front_vehicle_low_speed"), Request(file="points.csv", folder=tmp_path)
        )
