"""OpenSCENARIO parameter variations, in the layouts of the published ALKS set, become points of our
spaces."""

from contextlib import nullcontext

import pandas as pd
import pytest
from laid import lay
from refusals import refusal, refused
from tables import rows_of, values_of

from sumo_eval.extras.openscenario.points import read_variation
from sumo_eval.extras.openscenario.scene import FileOptions
from sumo_eval.extras.openscenario.space import Axis, FileSpace, read_space
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.sampling.request import Request
from sumo_eval.scenario.sampling.samples import sample

CUT_IN = catalogue.load("cut_in")


def single(name, inner):
    return (
        f'<DeterministicSingleParameterDistribution parameterName="{name}">{inner}'
        "</DeterministicSingleParameterDistribution>"
    )


def steps(low, high, step):
    return (
        f'<DistributionRange stepWidth="{step}"><Range lowerLimit="{low}" '
        f'upperLimit="{high}"/></DistributionRange>'
    )


def elements(*values):
    return (
        "<DistributionSet>"
        + "".join(f'<Element value="{value}"/>' for value in values)
        + "</DistributionSet>"
    )


def variation(inner):
    return (
        '<?xml version="1.0"?><OpenSCENARIO><FileHeader revMajor="1" revMinor="1" '
        'date="2021-07-06T10:00:00" '
        'description="-" author="-"/><ParameterValueDistribution>'
        f'<ScenarioFile filepath="./Concrete/cut_in.xosc"/>{inner}</ParameterValueDistribution></OpenSCENARIO>'
    )


DETERMINISTIC = variation(
    "<Deterministic><!-- a comment between -->"
    + single("Ve0_kph", steps("20.0", "60.0", "10.0"))
    + single("Model", elements("car", "truck", "van", "bus", "motorbike"))
    + single("RelativeLaneId", elements("1", "-1"))
    + single("Rel_kph", steps("-50.0", "-10.0", "10.0"))
    + single("dx0_m", steps("0.0", "60.0", "10.0"))
    + single("Vy_mps", steps("0.5", "3.0", "0.5"))
    + "</Deterministic>"
)

DECLARATIONS = """<OpenSCENARIO><FileHeader revMajor="1" revMinor="1"/>
<ParameterDeclarations>
<ParameterDeclaration name="Ve0_kph" parameterType="double" value="60.0">
  <ConstraintGroup><ValueConstraint rule="greaterThan" value="0.0"/><ValueConstraint rule="lessOrEqual" value="60.0"/>
  </ConstraintGroup></ParameterDeclaration>
<ParameterDeclaration name="Model" parameterType="string" value="car"/>
<ParameterDeclaration name="RelativeLaneId" parameterType="integer" value="-1">
  <ConstraintGroup><ValueConstraint rule="equalTo" value="-1"/></ConstraintGroup>
  <ConstraintGroup><ValueConstraint rule="equalTo" value="1"/></ConstraintGroup></ParameterDeclaration>
<ParameterDeclaration name="Rel_kph" parameterType="double" value="-20.0">
  <ConstraintGroup><ValueConstraint rule="lessThan" value="0.0"/></ConstraintGroup></ParameterDeclaration>
<ParameterDeclaration name="dx0_m" parameterType="double" value="30.0"/>
<ParameterDeclaration name="Vy_mps" parameterType="double" value="2.0">
  <ConstraintGroup><ValueConstraint rule="greaterThan" value="0.0"/>
  <ValueConstraint rule="lessThan" value="${($Ve0_kph + $Rel_kph) / 3.6}"/></ConstraintGroup></ParameterDeclaration>
</ParameterDeclarations></OpenSCENARIO>"""

MAPPING = """distribution = "variation.xosc"
[parameters]
ego_speed = "Ve0_kph / 3.6"
cut_in_speed = "(Ve0_kph + Rel_kph) / 3.6"
gap = "dx0_m"
lateral_speed = "Vy_mps"
[only]
RelativeLaneId = 1
"""


@pytest.fixture
def files(tmp_path):
    texts = {"variation.xosc": DETERMINISTIC, "Concrete/cut_in.xosc": DECLARATIONS}
    lay(tmp_path, texts | {"mapping.toml": MAPPING})
    return tmp_path


def combinations(folder, *parts):
    """The combinations of a deterministic variation of such parts."""
    inner = f"<Deterministic>{''.join(parts)}</Deterministic>"
    (folder / "variation.xosc").write_text(variation(inner))
    return read_variation(folder / "variation.xosc", None, 1).combinations


def points(folder, **keys):
    return sample(
        CUT_IN, "openscenario", request=Request(file="mapping.toml", folder=folder, **keys)
    )


def by_hand():
    """The points in plain loops: speeds in km/h, and Vy below the other's own speed."""
    return {
        (round(ve / 3.6, 9), round((ve + rel) / 3.6, 9), float(gap), vy / 2)
        for ve in range(20, 61, 10)
        for rel in range(-50, -9, 10)
        for gap in range(0, 61, 10)
        for vy in range(1, 7)
        if vy / 2 < (ve + rel) / 3.6
    }


def test_a_deterministic_variation_is_all_its_combinations_that_the_constraint_groups_allow(files):
    chosen = points(files)
    assert {tuple(row) for row in chosen.points.tolist()} == by_hand()
    assert len(chosen.refused) == 0
    # 5 * 5 * 2 * 5 * 7 * 6 = 10500 combinations, [only] keeps one lane of two
    assert "[only] keeps 5250 of 10500 combinations." in chosen.notes
    assert f"exclude {5250 - 5 * len(by_hand())} combinations" in " ".join(chosen.notes)
    assert any("Not mapped" in note and "Model" in note for note in chosen.notes)


@pytest.mark.campaign
def test_of_several_groups_one_has_to_hold_and_within_a_group_all(files):
    # both lanes are allowed by one group each; an AND over groups would allow neither
    (files / "mapping.toml").write_text(MAPPING.replace("RelativeLaneId = 1\n", ""))
    assert {tuple(row) for row in points(files).points.tolist()} == by_hand()
    loose = DECLARATIONS.replace(
        '<ValueConstraint rule="greaterThan" value="0.0"/>\n  <ValueConstraint rule="lessThan" '
        'value="${($',
        '<ValueConstraint rule="greaterThan" value="0.0"/></ConstraintGroup><ConstraintGroup>'
        '<ValueConstraint rule="lessThan" value="${($',
    )
    assert loose != DECLARATIONS
    (files / "Concrete" / "cut_in.xosc").write_text(loose)
    # Vy > 0 alone now suffices: what our own space cannot hold (speeds below its range) is left out
    # and said
    assert len(points(files).points) > len(by_hand())
    assert any("outside the ranges" in note for note in points(files).notes)


def test_steps_of_a_tenth_end_where_they_should(files):
    found = combinations(files, single("Vy_mps", steps("0.0", "1.0", "0.1")))
    assert [it["Vy_mps"] for it in found] == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]


def test_numbers_with_underscores_are_texts(files):
    found = combinations(files, single("Model", elements("1_0", "2")))
    assert [it["Model"] for it in found] == ["1_0", 2.0]


def test_value_sets_vary_parameters_together(files):
    sets = "".join(
        f'<ParameterValueSet><ParameterAssignment parameterRef="Ve0_kph" value="{ve}"/>'
        f'<ParameterAssignment parameterRef="Rel_kph" value="{rel}"/></ParameterValueSet>'
        for ve, rel in ((40, -10), (60, -30))
    )  # the first set leaves the other parameter as it is declared
    sets += '<ParameterValueSet><ParameterAssignment parameterRef="Ve0_kph" value="36"/></ParameterValueSet>'
    multi = f"<DeterministicMultiParameterDistribution><ValueSetDistribution>{sets}</ValueSetDistribution>"
    (files / "variation.xosc").write_text(
        variation(
            f"<Deterministic>{multi}</DeterministicMultiParameterDistribution></Deterministic>"
        )
    )
    (files / "mapping.toml").write_text(MAPPING.replace("[only]\nRelativeLaneId = 1\n", ""))
    # the gap 30 m and 2 m/s are the declared defaults
    expected = {
        (round(ve / 3.6, 9), round(vo / 3.6, 9), 30.0, 2.0)
        for ve, vo in ((36, 16), (40, 30), (60, 30))
    }
    assert {tuple(row) for row in points(files).points.tolist()} == expected


def stochastic(*parts):
    inner = "".join(
        f'<StochasticDistribution parameterName="{name}">{inside}</StochasticDistribution>'
        for name, inside in parts
    )
    return variation(f'<Stochastic numberOfTestRuns="2000" randomSeed="7">{inner}</Stochastic>')


def test_stochastic_distributions_have_their_moments_and_their_limits(files):
    limits = '<Range lowerLimit="{}" upperLimit="{}"/>'
    (files / "variation.xosc").write_text(
        stochastic(
            ("Ve0_kph", '<NormalDistribution expectedValue="50" variance="25"/>'),
            ("Rel_kph", f"<UniformDistribution>{limits.format(-30, -10)}</UniformDistribution>"),
            ("dx0_m", '<NormalDistribution expectedValue="0" '
                      f'variance="100">{limits.format(0, 60)}</NormalDistribution>'),
            ("Vy_mps", f'<Histogram><Bin weight="3">{limits.format(0, 1)}</Bin><Bin '
                       f'weight="1">{limits.format(1, 3)}</Bin>'
                       "</Histogram>"),
            ("Model", '<ProbabilityDistributionSet><Element value="car" weight="4"/><Element '
                      'value="bus" weight="1"/>'
                      "</ProbabilityDistributionSet>"),
            ("Count", '<PoissonDistribution expectedValue="4"/>'),
            ("Long", '<LogNormalDistribution expectedValue="10" variance="4"/>'),
        )
    )  # fmt: skip
    drawn = read_variation(files / "variation.xosc", None, 1)
    table = pd.DataFrame(drawn.combinations)
    assert len(table) == 2000
    for name, moment, value, within in (
        ("Ve0_kph", "mean", 50, 0.5),
        ("Ve0_kph", "std", 5, 0.3),
        ("Rel_kph", "mean", -20, 0.5),
        ("dx0_m", "mean", 7.98, 0.5),  # a half normal: 10 sqrt(2 / pi)
        ("Count", "mean", 4, 0.2),
        ("Count", "var", 4, 0.5),
        ("Long", "mean", 10, 0.2),
        ("Long", "std", 2, 0.2),
    ):
        assert table[name].agg(moment) == pytest.approx(value, abs=within), (name, moment)
    assert table["dx0_m"].min() >= 0
    assert (table["Vy_mps"] < 1).mean() == pytest.approx(0.75, abs=0.03)
    assert (table["Model"] == "car").mean() == pytest.approx(0.8, abs=0.03)
    assert any("random seed 7" in note for note in drawn.notes)
    again, other = (read_variation(files / "variation.xosc", 50, seed) for seed in (1, 2))
    assert len(again.combinations) == 50
    assert again.combinations != other.combinations


@pytest.mark.parametrize(
    "name, old, new, sentence",
    [
        *rows_of("""
mapping.toml | gap = | gpa = | Did you mean `gap`?
mapping.toml | dx0_m | dx_m | Did you mean `dx0_m`?
mapping.toml | RelativeLaneId | RelativLaneId | Did you mean `RelativeLaneId`?
mapping.toml | "Ve0_kph / 3.6" | "Model" | must be a number, got 'car'
mapping.toml | variation.xosc | nowhere.xosc | There is no OpenSCENARIO file
mapping.toml | [only] | [olny] | Did you mean `only`?
mapping.toml | Ve0_kph / 3.6 | Ve0_kph * 100 | lies within the ranges of `cut_in`
variation.xosc | DistributionSet | UserDefinedDistribution
| <UserDefinedDistribution>: this is not supported
variation.xosc | stepWidth="0.5" | stepWidth="0" | `stepWidth`
variation.xosc | upperLimit="3.0" | upperLimit="x" | `upperLimit` must be a finite number
variation.xosc | stepWidth="0.5" | stepWidth="1e-9" | between 1 and 1,000,000
variation.xosc | <OpenSCENARIO> | <!DOCTYPE x><OpenSCENARIO> | must not declare a document type
Concrete/cut_in.xosc | lessOrEqual | lessOrEqal | Did you mean `lessOrEqual`?
Concrete/cut_in.xosc | rule="greaterThan" value="0.0" | rule="greaterThan" value="99" | allow none
"""),
        ("mapping.toml", 'gap = "dx0_m"\n', "", "`gap` of scenario `cut_in` is missing"),
        ("variation.xosc", "</OpenSCENARIO>", "", "is not XML"),
    ],
)
def test_what_cannot_be_used_is_refused(files, name, old, new, sentence):
    text = (files / name).read_text()
    assert old in text
    (files / name).write_text(text.replace(old, new))
    with refused(sentence):
        points(files)


@pytest.mark.parametrize(
    "tag, numbers",
    [
        ("LogNormalDistribution", 'expectedValue="0" variance="1"'),
        ("PoissonDistribution", 'expectedValue="-1"'),
        ("NormalDistribution", 'expectedValue="1" variance="-1"'),
    ],
)
def test_a_distribution_that_does_not_exist_is_refused(files, tag, numbers):
    (files / "variation.xosc").write_text(stochastic(("Ve0_kph", f"<{tag} {numbers}/>")))
    with refusal(rf"<{tag}>: `\w+` must be (above|at least) 0"):
        read_variation(files / "variation.xosc", None, 1)


def test_a_count_out_of_bounds_is_the_samplings_fault(files):
    part = '<NormalDistribution expectedValue="50" variance="25"/>'
    text = stochastic(("Ve0_kph", part))
    (files / "variation.xosc").write_text(text)
    for count in (0, 1_000_001):
        with refused("`count` of the sampling of scenario `cut_in` must be a whole number from 1"):
            points(files, count=count)
    (files / "variation.xosc").write_text(text.replace('"2000"', '"0"'))
    with refused("`numberOfTestRuns` must be within 1..1,000,000, or give a `count`, got 0"):
        points(files)


def test_drawn_values_may_have_weight_0_but_not_all(files):
    values = '<Element value="1" weight="{}"/><Element value="2" weight="0"/>'
    given = f"<ProbabilityDistributionSet>{values}</ProbabilityDistributionSet>"
    path = files / "variation.xosc"
    path.write_text(stochastic(("Ve0_kph", given.format(3))))
    assert {row["Ve0_kph"] for row in read_variation(path, 20, 1).combinations} == {1.0}
    path.write_text(stochastic(("Ve0_kph", given.format(0))))
    with refused("its weights must be at least 0, one of them above 0"):
        read_variation(path, 20, 1)


def test_weights_of_one_value_add_up_and_are_not_negative(files):
    for one, weight, weights in values_of("""
        1, 2, (3.0, 1.0)
        1, -2, None
        0, 0, None
        """):
        values = f'<Element value="10" weight="{one}"/><Element value="20" weight="{one}"/>'
        again = f'<Element value="10" weight="{weight}"/>'
        given = f"<ProbabilityDistributionSet>{values}{again}</ProbabilityDistributionSet>"
        path = files / f"weights{weight}.xosc"
        path.write_text(stochastic(("Ve0_kph", given)))
        with nullcontext() if weights else refusal("weights must be"):
            assert read_space(path, FileOptions()).axes[0].weights == weights


def test_only_holds_truth_values_and_parameters_that_do_not_vary(files):
    lanes, text = elements("1", "-1"), DETERMINISTIC.replace("RelativeLaneId", "Lit")
    (files / "variation.xosc").write_text(text.replace(lanes, elements("true", "false")))
    declared = '<ParameterDeclaration name="{}" parameterType="string" value="{}"/>'
    more = "".join(declared.format(*it) for it in (("Lit", "true"), ("wide", "2")))
    (files / "Concrete" / "cut_in.xosc").write_text(
        DECLARATIONS.replace("</ParameterDeclarations>", f"{more}</ParameterDeclarations>")
    )
    mapping = MAPPING.replace("RelativeLaneId = 1", "Lit = false\nwide = 10.0")
    (files / "mapping.toml").write_text(mapping.replace('"dx0_m"', '"wide"'))
    chosen = points(files)
    assert "[only] keeps 5250 of 10500 combinations." in chosen.notes
    assert set(chosen.points[:, 2].tolist()) == {10.0}

    (files / "mapping.toml").write_text(mapping.replace("false", '"off"'))
    with refusal(r"\[only\] of mapping mapping.toml keeps no combination"):
        points(files)


def test_without_the_scenario_file_there_are_no_constraints_and_that_is_said(files):
    (files / "Concrete" / "cut_in.xosc").unlink()
    assert any("no constraint groups" in note for note in points(files).notes)


def test_a_count_for_a_deterministic_variation_is_not_ignored_in_silence(tmp_path):
    path = tmp_path / "all.xosc"
    path.write_text(
        variation(
            "<Deterministic>" + single("Ve0_kph", steps("20", "60", "10")) + "</Deterministic>"
        )
    )
    assert len(read_variation(path, None, 1).combinations) == 5
    with refusal(r"`count` does nothing for all\.xosc: its distribution is deterministic"):
        read_variation(path, 3, 1)


def test_choices_that_stay_keep_their_weights(tmp_path):
    rows = tuple((float(k), (("k", float(k)),)) for k in range(3))
    axis = Axis("k", ("k",), 0.0, 2.0, 1.0, rows, weights=(1.0, 2.0, 3.0))
    space = FileSpace("", "", tmp_path, (), (axis,), "1.2", FileOptions())
    assert space.with_choices({"k": rows[1:]}).axes[0].weights == (2.0, 3.0)
