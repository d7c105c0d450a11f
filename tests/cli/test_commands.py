"""The command line as a person meets it: quick help, sentences instead of tracebacks, statuses that
mean something."""

import os
import sys
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from commands import Done, cli_refuses, in_a_process, python, sumo_eval
from laid import read_json
from tables import rows_of

from sumo_eval import cli
from sumo_eval.cli import main

EVALUATION = """
name = "cli"
[[scenario]]
use = "front_vehicle_low_speed"
[scenario.sampling]
levels = 2
[[ads]]
name = "idm"
controller = "idm"
[drivers]
count = 2
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    (folder / "evaluation.toml").write_text(EVALUATION)
    done = in_a_process("run", "evaluation.toml", "--out", "out", cwd=folder)
    return Done(done.returncode, done.stdout, done.stderr), folder / "out"


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom sumo_eval.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as stop:\n    assert stop.code == 0\n"
        "heavy = {'numpy', 'scipy', 'pandas', 'sklearn', 'pydantic', 'libsumo', 'numba', 'rich', "
        "'plotly', 'jinja2'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    assert "partition" in python(code).stdout


def test_running_and_scoring_import_no_more_than_synthetic_drivers_on_a_grid_need():
    code = (
        "import sys, sumo_eval.evaluation, sumo_eval.report.assessed, sumo_eval.report.tables\n"
        "heavy = {'pandas', 'sklearn', 'scipy.stats', 'numba', 'plotly.graph_objects', 'fmpy', "
        "'distributed'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    python(code)


def test_linear_algebra_keeps_to_one_thread_unless_the_user_says_otherwise(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    assert CliRunner().invoke(main, ["scenarios"]).exit_code == 0
    assert os.environ["OMP_NUM_THREADS"] == "3"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_a_run_ends_with_a_table_a_report_and_status_0(finished):
    done, out = finished
    assert done.returncode == 0, done.stderr
    assert "front_vehicle_low_speed" in done.stdout
    assert "idm" in done.stdout
    assert "Traceback" not in done.stderr
    for name in (
        "evaluation.toml",
        "manifest.json",
        "facts.sqlite",
        "scores.json",
        "cases.csv",
        "report.html",
    ):
        assert (out / name).is_file()
    read_json(out / "scores.json")


def test_score_prints_the_same_table_again(finished):
    done, out = finished
    before = (out / "scores.json").read_text()
    assert without_path(sumo_eval(f"score {out}").stdout) == without_path(done.stdout)
    assert (out / "scores.json").read_text() == before


def without_path(text):
    lines = [line.partition("; check: ")[0] for line in text.splitlines()]
    return [line for line in lines if not line.startswith("The report is ")]


def test_report_writes_the_report_again(finished):
    _, out = finished
    (out / "report.html").unlink()
    sumo_eval(f"report {out}")
    assert (out / "report.html").stat().st_size > 100_000


def test_scenarios_lists_names_units_and_ranges():
    done = sumo_eval("scenarios")
    assert "front_vehicle_cut_out" in done.stdout
    assert "20..120 m, step 10" in done.stdout


def test_partition_says_where_the_danger_is_greatest():
    done = sumo_eval("partition", "front_vehicle_cut_out")
    assert "1 hazardous zone" in done.stdout
    assert "ego_speed=30, obstacle_speed=0" in done.stdout


@pytest.mark.parametrize(
    "arguments, sentence",
    rows_of(
        """
runn | Did you mean `run`?
run missing.toml --out x | There is no evaluation file
score nowhere | is not a run folder
report nowhere | is not a run folder
partition front_vehicle_cutout | Did you mean `front_vehicle_cut_out`?
run --resume | need `--out`
run --resume --out nowhere | there is no run to resume
sample cut_in --method sobol --out x | needs `--count`
sample cut_in --method sobl --count 8 --out x | Did you mean `sobol`?
run --out x --workers 0 | --workers
""",
        str.split,
    ),
)
def test_bad_input_gets_a_sentence_and_status_2(arguments, sentence, tmp_path):
    cli_refuses(sentence, *arguments, cwd=tmp_path)
    assert not (tmp_path / "x").exists()


def test_cases_that_cannot_be_evaluated_give_status_3_and_are_listed(tmp_path):
    (tmp_path / "broken.py").write_text(
        "def broken(traci, ego, time):\n    raise RuntimeError('no plan')\n"
    )
    (tmp_path / "evaluation.toml").write_text(
        EVALUATION.replace('"idm"\n[drivers]', '"broken.py:broken"\n[drivers]')
    )
    done = in_a_process("run", "evaluation.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "no plan" in done.stdout
    assert "C of idm in front_vehicle_low_speed is not computed" in done.stdout
    assert "Traceback" not in done.stdout + done.stderr


def test_a_replay_lies_in_its_run_whatever_the_ads_is_called(tmp_path, monkeypatch):
    fact, run = SimpleNamespace(scenario="s"), SimpleNamespace(scenarios={"s": None})
    monkeypatch.setattr("sumo_eval.record.run_folder.resolved_run", lambda _: run)
    monkeypatch.setattr("sumo_eval.report.replay.recorded", lambda *_: fact)
    monkeypatch.setattr("sumo_eval.report.replay.write_replay", lambda *given, **_: given[3])
    done = sumo_eval("replay", tmp_path, "s-0000-idm/~a--b")
    assert done.said == f"The replay is {tmp_path / 'replay-s-0000-idm__a_-b.html'}\n"


@pytest.mark.parametrize(
    "amid, arguments",
    [("record.estimate", "run --out r"), ("nightly.night", "nightly none.toml --history h")],
)
def test_a_signal_amid_imports_that_a_callback_drops_is_heard(amid, arguments, tmp_path):
    code = (
        "import signal, sys, weakref\nfrom sumo_eval.cli import main\nclass Finder:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == 'sumo_eval.{amid}':\n"
        "            kept = weakref.ref(Finder(), lambda _: signal.raise_signal(signal.SIGTERM))\n"
        "sys.meta_path.insert(0, Finder())\n"
        "try: main()\nexcept SystemExit as end: print(end.code)"
    )
    assert python(code, *arguments.split(), cwd=tmp_path).stdout == "130\n"


def test_sigterm_between_drives_is_status_130():
    code = (
        "import os, signal, click\nfrom sumo_eval.cli import main\n"
        "click.Group.invoke = lambda *_: os.kill(os.getpid(), signal.SIGTERM)\n"
        "try: main()\nexcept SystemExit as end: print(end.code)"
    )
    done = python(code, "scenarios")
    assert done.stdout == "130\n"
    assert done.stderr == "sumo-eval: Stopped.\n"


# --- commands that installed packages bring: entry points of the group `sumo_eval.commands` -------


COMMAND = """
import click

@click.command()
def weather():
    '''Say what the weather is.'''
    click.echo("dry")

nothing = 1
mute = click.Command("mute", help=3)
"""


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of installed packages, where a test may install its own."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "weather_tool.py").write_text(COMMAND)
    cli._plugins.cache_clear()
    yield tmp_path
    sys.modules.pop("weather_tool", None)
    cli._plugins.cache_clear()


def install(site, entry):
    folder = site / "weather_tool-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: weather_tool\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(f"[{cli.GROUP}]\n{entry}\n")


def test_a_run_stopped_between_two_rounds_says_how_to_continue(tmp_path, monkeypatch):
    file = tmp_path / "evaluation.toml"
    file.write_text(EVALUATION.replace("levels = 2", 'method = "adaptive"\ncount = 16\nround = 8'))

    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("sumo_eval.evaluation._further_rounds", stop)
        stopped = sumo_eval("run evaluation.toml --out out", cwd=tmp_path, status=130)
    assert "recorded in out; the same command with --out out --resume continues" in stopped.stderr
    sumo_eval("run evaluation.toml --out out --resume", cwd=tmp_path)
    assert len((tmp_path / "out" / "cases.csv").read_text().splitlines()) == 1 + 16


def test_an_installed_package_brings_a_command_of_its_own(site):
    install(site, "weather = weather_tool:weather")
    assert sumo_eval("weather").said == "dry\n"
    assert "Say what the weather is." in sumo_eval("--help").said.partition(f"{cli.FURTHER}:")[2]


@pytest.mark.parametrize(
    "entry, sentence",
    [
        (
            "weather = weather_tool:rain",
            "Command `weather`, `weather_tool:rain`, cannot be loaded: AttributeError",
        ),
        ("weather = weather_tool:nothing", "must be a click command, got int."),
        (
            "weather = weather_tool:mute",
            "`weather_tool:mute`, must have a text as its help: AttributeError",
        ),
    ],
)
def test_what_is_not_a_command_gets_status_2(site, entry, sentence):
    install(site, entry)
    cli_refuses(sentence, "weather")
    assert sentence in " ".join(sumo_eval("--help").said.split())


def test_our_command_without_its_entry_point_says_what_to_do(monkeypatch):
    monkeypatch.setattr(cli, "_plugins", dict)
    cli_refuses(
        "Command `drive` is not installed: run `pip install -e .` again.", "drive", "cut_in"
    )


def test_no_package_takes_the_place_of_our_commands(site):
    install(site, "run = weather_tool:weather")
    assert "EVALUATION" in sumo_eval("run", "--help").said
