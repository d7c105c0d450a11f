"""What is wrong at first sight is told at once, before anything is compiled, split or simulated."""

from pathlib import Path

import pytest
from commands import cli_refuses, sumo_eval

from sumo_eval.extras.figures import style
from sumo_eval.record import cluster, loops
from sumo_eval.report.comparison_lines import gate_lines
from sumo_eval.report.gate_result import GateResult
from sumo_eval.scenario.shipped_files import scenario_files

TWO = (
    "class Brake:\n    def act(self, seen):\n        return None\n\n\ndef steer(seen):\n    "
    "return None\n"
)


@pytest.mark.parametrize("words", [("check",), ("run", "--out", "x", "--ads")])
def test_a_file_without_a_name_lists_what_it_holds(tmp_path, words, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(TWO)
    cli_refuses(
        "is a file; name one of what it holds (`Brake`, `steer`): mine.py:Brake", *words, "mine.py"
    )


def test_a_file_that_is_not_there_is_said_to_be_missing():
    result = sumo_eval("check", "nothing.py", status=2)
    assert result.said == "sumo-eval: There is no file nothing.py.\n"


SCHEMES = [
    "exec:python 'a b.py'",
    "traci:python é.py",
    "exec:./a:b.py",
    "exec:python a.py --file b.toml",
]


@pytest.mark.parametrize("words", [("check",), ("run", "--dry-run", "--ads")])
@pytest.mark.parametrize("locator", [*SCHEMES, "sumo:a.py", "fmu:a.py", "onnx:a.py", "given:a.py"])
def test_a_locator_with_a_scheme_is_not_a_file(locator, words):
    told = sumo_eval(*words, f"{locator.replace('python', 'no-such')}", status=None).said
    assert "There is no file '" not in told
    assert "is a file; name one" not in told
    assert "evaluation file" not in told


def test_an_evaluation_without_ads_is_driven_by_those_named(tmp_path):
    file = tmp_path / "é b.toml"
    file.write_text(
        'name = "a"\n[[scenario]]\nuse = "front_vehicle_low_speed"\nsampling.levels = '
        "2\n[drivers]\ncount = 2\n"
    )
    sumo_eval("run", file, "--ads", "idm", "--dry-run")
    cli_refuses("must have at least one [[ads]], or be run with `--ads LOCATOR`", "run", file)


def test_a_value_of_a_parameter_without_unit_is_refused_without_a_unit(tmp_path):
    words = ["boundary", "exit_cut", "idm", "--fix", "side=0.5", "--out", str(tmp_path / "edge")]
    result = sumo_eval(*words, status=2)
    assert result.said == (
        "sumo-eval: `side` of the slice of scenario `exit_cut` must be one of -1, 1, got 0.5.\n"
    )


def test_a_folder_that_is_taken_is_refused_before_the_evaluation_is_looked_at(tmp_path):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "notes.txt").write_text("mine")
    result = cli_refuses("already exists and is not empty", f"run --out {tmp_path}/taken")
    assert "zones" not in result.said


def test_gates_not_evaluated_for_one_reason_are_one_line():
    reason = "there is no base to compare with"
    gates = [
        GateResult(quantity, ads, "s", None, f"{quantity}: {reason}", reason=reason)
        for ads in ("a", "b")
        for quantity in ("A", "H", "S+")
    ]
    lines = gate_lines([*gates, GateResult("C", "a", "s", False, "C: fell", None, None)])
    assert lines == [
        "gate FAILED: a in s: C: fell",
        f"6 gates not evaluated: {reason}",
        "0 gates passed.",
    ]


@pytest.mark.parametrize("options", [("--out", "x"), ("--dry-run",)])
def test_a_misspelt_scenario_is_refused_before_an_ads_is_asked(tmp_path, options, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text('open("asked", "w").close()\n\n\ndef acc(seen):\n    return 0.0\n')
    Path("evaluation.toml").write_text(
        'name = "x"\n[[scenario]]\nuse = "cut_inn"\n[[ads]]\nname = "mine"\ncontroller = '
        '"mine.py:acc"\n'
    )
    result = cli_refuses("`cut_inn`", "run", "evaluation.toml", *options)
    assert "Did you mean `cut_in`?" in result.said
    assert not Path("asked").exists()


def test_a_curve_too_tight_for_the_steering_is_refused_at_once(tmp_path, monkeypatch):
    """A steering wheel that stops at 8 deg turns the wheels by 0.5 deg: 2.7 m / tan(0.5 deg) =
    309.4 m, in the left lane, which is 3.5 m further inside.
    """
    monkeypatch.chdir(tmp_path)
    Path("evaluation.toml").write_text(
        'name = "x"\n[[scenario]]\nuse = "curve_braking"\n[[ads]]\nname = "idm"\ncontroller = '
        '"idm"\n'
        "[simulation.vehicle]\nmax_steering_wheel_angle_deg = 8.0\n"
    )
    cli_refuses(
        "The radius of scenario `curve_braking` must be at least 312.9 m, so that the ego can drive",
        "run evaluation.toml --out x",
    )


def test_impossible_placement_is_refused_before_compiling(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = scenario_files()["front_vehicle_cut_out"].read_text()
    Path("bad.toml").write_text(shipped.replace("min(1.0 * ego_speed, lead_room)", "-3.0"))
    Path("evaluation.toml").write_text(
        'name = "x"\n[[scenario]]\nuse = "bad.toml"\n[[ads]]\nname = "idm"\ncontroller = "idm"\n'
    )
    monkeypatch.setattr(loops, "ready", None)
    cli_refuses("must be clear of `ego` at the start", "run evaluation.toml --out x")


def test_too_many_parameters_are_refused_before_driving(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parameter = '[[parameter]]\nname = "p{}"\nunit = "m/s"\nlow = 1\nhigh = 2\nstep = 1\n'
    Path("many.toml").write_text(
        'name = "many"\nzone = "none"\n[road]\nlength = 900.0\nlanes = 1\n[ego]\n'
        f'x = 9.0\nspeed = "{"+".join(f"p{number}" for number in range(11))}"\n'
        + "".join(map(parameter.format, range(11)))
    )
    Path("evaluation.toml").write_text(
        'name = "x"\n[[scenario]]\nuse = "many.toml"\nsampling = { method = "sobol", count = 4 }\n'
        '[[ads]]\nname = "idm"\ncontroller = "idm"\n'
    )
    cli_refuses("at most 10 parameters", "run evaluation.toml --out x")
    assert not Path("x").exists()


@pytest.mark.parametrize(
    "options, words",
    [
        ((), "needs the address of a scheduler"),
        (("--scheduler", "tcp://127.0.0.1:1"), "needs the extra `cluster`"),
    ],
)
def test_a_cluster_that_cannot_be_is_refused_before_anything_is_compiled(
    tmp_path, options, words, monkeypatch
):
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    result = cli_refuses(words, "run", "--engine", "dask", *options, "--out", tmp_path / "x")
    assert "compiling" not in result.said
    assert not (tmp_path / "x").exists()


def test_missing_matplotlib_is_reported_before_the_run_is_opened(tmp_path, monkeypatch):
    monkeypatch.setattr(style, "find_spec", lambda name: None)
    cli_refuses(
        "A figure needs the extra `plots`, which this installs: ",
        "plot",
        tmp_path / "no run",
        "zone_map",
    )


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    result = cli_refuses("cannot be written", f"qualify --out {tmp_path}/file/x")
    assert "passed" not in result.said


def test_learning_from_a_folder_says_what_to_name(tmp_path):
    result = cli_refuses(f"{tmp_path} is a folder", f"learn {tmp_path} --out {tmp_path}/learned")
    assert "humans import" in result.said


def test_imported_people_are_written_as_csv_alone(tmp_path):
    cli_refuses(
        "must be a file that ends with .csv or .csv.gz, got ",
        f"humans import csv no --out {tmp_path}/x.parquet",
    )


def test_a_folder_to_check_is_answered_with_what_it_holds(tmp_path):
    result = cli_refuses(
        "is a folder without an evaluation, a scenario (.toml) or an ADS (.py).", "check", tmp_path
    )
    for name in ("night.toml", "mine.py", "notes.txt"):
        (tmp_path / name).write_text("")
    result = cli_refuses(
        f"is a folder; name a file that it holds: {str(tmp_path / 'mine.py')!r}, ",
        "check",
        tmp_path,
    )
    assert "night.toml" in result.said
    assert "notes" not in result.said
