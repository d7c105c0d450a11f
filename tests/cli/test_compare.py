"""A real run beside its repeat, and beside a build that does worse in one case of many."""

import csv

import junitparser
import pytest
from commands import cli_refuses, sumo_eval
from tables import rows_of

from cli.nights import evaluation
from sumo_eval.scenario import catalogue

LEVELS = "{ ego_speed = 10, lead_speed = 9 }"
CASES = 70  # at least
FAULT = "30, 0"


@pytest.fixture(scope="module")
def builds(tmp_path_factory):
    """Run folders `base`, `repeat` and `new` over the same cases; `new` does not brake in one of
    them."""
    folder = tmp_path_factory.mktemp("builds")
    for name, fault in (("base", ""), ("repeat", ""), ("new", f"{FAULT}:sleeps")):
        sumo_eval("run", evaluation(folder, LEVELS, fault), "--out", folder / name)
    return folder


def compared(builds, *options, new="new", status=0):
    return sumo_eval("compare", builds / "base", builds / new, *options, status=status)


def test_a_repeat_of_the_same_build_is_green(builds):
    done = compared(builds, new="repeat")
    assert done.stdout.startswith("THE SAME as")
    assert "cases equal to the last bit" in done.stdout


def test_one_planted_regression_among_many_cases_is_named(builds):
    done = compared(builds, "--junit", builds / "junit.xml", "--report", status=1)
    assert "outcome or likeness worse in 1 case, better in 0" in done.stdout
    said = next(line for line in done.stdout.splitlines() if "side by side" in line)
    assert int(said.split()[-5]) >= CASES, said
    assert "new collision: 1" in done.stdout
    assert "ego_speed=30, lead_speed=0" in done.stdout
    assert (
        "FAILED: mine in front_vehicle_low_speed: 1 case collided, not so in the base"
        in done.stdout
    )
    assert f"again: sumo-eval replay {builds / 'new'} front_vehicle_low_speed-" in done.stdout
    suites = {
        suite.name: list(suite)
        for suite in junitparser.JUnitXml.fromfile(str(builds / "junit.xml"))
    }
    beside = suites["mine in front_vehicle_low_speed beside the base"]
    assert [case.name for case in beside if case.result] == ["ego_speed=30, lead_speed=0"]
    page = (builds / "new" / "report.html").read_text()
    assert page.index("WORSE than") < page.index('id="verdict"')


def test_the_way_back_is_better_and_green(builds):
    assert "collision gone: 1" in sumo_eval(f"compare {builds}/new {builds}/base").stdout


def test_a_gate_file_decides_what_is_let_through(builds, tmp_path):
    (tmp_path / "gate.toml").write_text(
        'outcome.on = false\n[[limit]]\nquantity = "new_collisions"\nat_most = 1\n'
    )
    done = compared(builds, "--gate", tmp_path / "gate.toml")
    assert (
        "NO LIMIT FAILED beside base: outcome or likeness worse in 1 case, better in 0"
        in done.stdout
    )


def test_other_settings_are_refused_and_with_consent_shown(builds, tmp_path):
    sumo_eval("run", evaluation(tmp_path, "2"), "--out", tmp_path / "other")
    done = cli_refuses(
        "scenario.front_vehicle_low_speed.sampling.levels",
        f"compare {builds}/base {tmp_path}/other",
    )
    done = sumo_eval(f"compare {builds}/base {tmp_path}/other --accept-differences")
    assert "DIFFERS: scenario.front_vehicle_low_speed.sampling.levels" in done.stdout
    assert "exist in one run only" in done.stdout


def test_a_wrong_pair_and_a_folder_without_a_run_are_refused(builds):
    kept = builds / "repeat" / "kept.sqlite"
    kept.unlink()
    for arguments, sentence in rows_of(
        """
--pair mine | A pair must have the form BASE=NEW
--pair mine=yours | Unknown ADS `yours`
--pair mine=mine --pair mine=mine | An ADS may stand in one --pair
--gate missing.toml | There is no gate file missing.toml.
""",
        str.split,
    ):
        assert sentence in compared(builds, *arguments, new="repeat", status=2).stderr
    assert not kept.exists(), "they are refused before anything is scored"
    cli_refuses("is not a run folder", f"compare {builds} {builds}/base")


def test_explain_prints_the_arithmetic_that_the_score_is_made_of(builds):
    """The planted collision is the only one: r (1 - Ug/U) / sum r is all of 1 - C, 50 points."""
    key = next(
        line.split(",")[0]
        for line in (builds / "new" / "cases.csv").read_text().splitlines()
        if ",mine,30.0,0.0," in line
    )
    done = sumo_eval(f"explain {builds}/new {key}")
    for words in ("Eq. 15: U = |(30.000, 0.000) - (0.000, 0.000)| / w = 30.000 / "
                  "1.000", "Eq. 14: L = 1.0",
                  "50.00 points of S", "Eq. 18: S = 0.0"):  # fmt: skip
        assert words in done.stdout
    # r = 1 without a hazardous zone; doing nothing hits at the closing speed where it is in time,
    # here at 30 m/s
    with (builds / "new" / "cases.csv").open(newline="") as file:
        hits = [row for row in csv.DictReader(file) if float(row["no_reaction_severity"])]
    share = 30.0 / sum(float(row["ego_speed"]) - float(row["lead_speed"]) for row in hits)
    for words in (
        "A: U = 30.000 m/s, ideal vehicle Ug = 0.000 m/s, doing nothing U0 = 30.000 m/s: the "
        "collision is avoidable",
        f"of 1 - A = {share:.4f} this case took {share:.4f}; A' = ",
        "H: 0, an avoidable incident in a safe case",
    ):
        assert words in done.stdout
    safe = sumo_eval(f"explain {builds}/base {key}")
    assert "H: f_L f_n+ similarity plausibility = " in safe.stdout
    done = sumo_eval(f"explain {builds}/base")
    assert "S, the sum" in done.stdout
    assert "S+, the sum" in done.stdout
    cli_refuses(f"Did you mean `{key}`?", "explain", builds / "new", key.replace("mine", "mime"))


def test_run_only_drives_one_case_again(builds, tmp_path):
    """The command that a failed limit names, as it is typed: the case ends as in the run, to the
    last bit."""
    done = compared(builds, status=1)
    case = (
        next(line for line in done.stdout.splitlines() if "ok -> contact" in line)
        .split(":")[0]
        .strip()
    )
    assert f"alone: sumo-eval run {builds / 'new'} --only {case}" in done.stdout
    assert f"page: {builds / 'new' / 'report.html'}#case:{case}" in done.stdout
    again = sumo_eval(f"run {builds}/new --only {case} --out {tmp_path}/one")
    assert "`run.only` asks for 1 of" in again.stdout
    beside = sumo_eval(f"compare {builds}/new {tmp_path}/one")
    assert beside.stdout.startswith("NO LIMIT FAILED beside new: 1 case equal to the last bit, ")
    assert "have no partner; 1 avoidable collision." in beside.stdout.splitlines()[0]


def test_run_only_names_what_it_does_not_know(builds, tmp_path):
    for case, words in (
        ("front_vehicle_low_speed-0002-mime", "Did you mean `front_vehicle_low_speed-0002-mine`?"),
        ("front_vehicle_low_speed-9999-mine", "must be numbered 0000 to"),
        ("nonsense", "Unknown case `nonsense` of the evaluation."),
        (f"cut_in-{'1' * 5000}-mine", "Unknown case `cut_in-1111"),
    ):
        cli_refuses(words, f"run {builds}/evaluation.toml --only {case} --out {tmp_path}/none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    "limit, sentence",
    [
        ('quantity = "max_deceleration"\nat_most = 5.9', "max_deceleration is above 5.9 m/s² in "),
        ('quantity = "severity"\nat_most = 29', "severity is above 29 m/s in 1 of 75 cases"),
        ('quantity = "min_gap"\nworse_by = 0.1', "min_gap is worse by more than 0.1 m in 1 of "),
        ('quantity = "d_i"\nworse_by = 1.0', ""),
    ],
)
def test_a_column_of_the_table_may_be_a_limit(builds, tmp_path, limit, sentence):
    (tmp_path / "gate.toml").write_text(f"outcome.on = false\n[[limit]]\n{limit}\n")
    done = compared(builds, "--gate", tmp_path / "gate.toml", status=1 if sentence else 0)
    assert sentence in done.stdout


EVALUATION = """
name = "own"
scenario = [{ use = "own.toml", sampling = { levels = 2 } }]
ads = [{ name = "idm", controller = "idm" }]
drivers = { count = 2 }
"""


def test_an_edited_scenario_in_python_is_told(tmp_path):
    own, file = tmp_path / "own.py", tmp_path / "evaluation.toml"
    file.write_text(EVALUATION.replace("own.toml", "own.py:scene"))
    text = "from sumo_eval.scenario import catalogue\nscene = catalogue.load('front_vehicle_braking')\n"
    for code in (text, f"{text}an_ads = 1\n"):
        own.write_text(code)
        sumo_eval("run", file, "--out", tmp_path / str(len(code)))
    base, same = (tmp_path / str(len(text) + more) for more in (0, 11))
    told = "The scenario's file changed after it was driven"
    assert [told in sumo_eval("score", run).said for run in (base, same)] == [True, False]
    assert "THE SAME" in sumo_eval("compare", base, same).said


def test_an_edited_scenario_file_is_told(tmp_path):
    own, file = tmp_path / "own.toml", tmp_path / "evaluation.toml"
    file.write_text(EVALUATION)
    text = (catalogue.scenario_files()["front_vehicle_braking"]).read_text()
    own.write_text(text)
    sumo_eval(f"run {file} --out {tmp_path}/base")
    own.write_text(f"# the same\n{text}")
    sumo_eval(f"run {file} --out {tmp_path}/same")
    assert "THE SAME" in sumo_eval(f"compare {tmp_path}/base {tmp_path}/same").said
    own.write_text(text.replace("delay = 1.0", "delay = 2.0"))
    sumo_eval(f"run {file} --out {tmp_path}/edited")
    words = "file of scenario front_vehicle_braking: "
    cli_refuses(words, f"compare {tmp_path}/base {tmp_path}/edited")
    told = "The scenario's file changed after it was driven"
    assert told in sumo_eval(f"score {tmp_path}/base").said
    assert told not in sumo_eval(f"score {tmp_path}/edited").said
