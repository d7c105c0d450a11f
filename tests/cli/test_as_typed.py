"""Each example of `--help`, and a locator of each scheme, runs as it is typed into a shell: quotes,
spaces, options."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from commands import ROOT, in_a_shell, typed
from doc_blocks import code_of
from example_files import ADS, CASES, EVALUATION, GATE, RATINGS, SMALL, write_needs, write_policy
from laid import lay
from tables import in_campaign, rows_of

from cli.test_help import all_commands

EXAMPLES = {
    name: " ".join(str(command.epilog).split()).removeprefix("Example: ")
    for name, command in all_commands()
    if name != "humans"  # whose example is that of `humans import`
}
NOT_RUN = {
    "drive": "needs a person in a browser; tests/wheel/test_drive_start.py has bots",
    "qualify": "takes minutes; tests/studies/test_qualification.py runs a check of each kind",
    "bench": "tests/bench/test_benchmark.py runs it",
    "import": "needs a file of OpenSCENARIO; tests/scenario/test_openscenario_faults.py has some",
}
"""Commands whose example is not run here, and why."""


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """The files that the examples name, and the run that the first of them makes."""
    folder = tmp_path_factory.mktemp("examples")
    files = {"evaluation.toml": EVALUATION, "cases.csv": CASES, "gate.toml": GATE}
    lay(folder, files | {"my_ads.py": ADS, "ratings.csv": RATINGS})
    done = typed(EXAMPLES["run"], folder)
    assert done.returncode == 0, done.said
    return folder


def second_run(folder):
    """Copy the run to the other names that examples have for runs."""
    for name in ("second", "before", "after"):
        shutil.copytree(folder / "results" / "first", folder / "results" / name)


OF_THE_DOCS = {"campaign", "humans departure", "learn", "nightly", "plot", "score", "sensitivity"}
"""Commands of which the docs' blocks have examples too, which tests/docs/test_every_block.py
runs."""


@pytest.mark.parametrize(
    "name",
    [
        in_campaign(name) if name in OF_THE_DOCS else name
        for name in EXAMPLES
        if name not in (*NOT_RUN, "run", "replay")
    ],
)
def test_the_example_of_a_command_runs_as_typed(name, desk, tmp_path):
    folder = Path(shutil.copytree(desk, tmp_path / "desk"))
    line = EXAMPLES[name]
    write_needs(shlex.split(line), folder)
    if name in ("compare", "calibrate"):
        second_run(folder)
    if name in ("trend", "accept"):
        typed("sumo-eval trend nights --import results/first", folder)
    done = typed(line, folder)
    assert done.returncode == 0, done.said
    assert "Traceback" not in done.said
    for place in re.findall(r"(?:--out|--page|--history|>) (\S+)", line):
        assert (folder / place).exists(), place


def test_an_example_runs_in_a_real_shell_and_opens_the_page(desk, tmp_path):
    """BROWSER names what opens a page, as on any desktop: here a program that writes down what it
    was asked for."""
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/opened\n')
    browser.chmod(0o755)
    done = in_a_shell(EXAMPLES["replay"], desk, BROWSER=str(browser))
    assert done.returncode == 0, done.stderr
    assert "replay-cut_in-0007-idm" in (tmp_path / "opened").read_text()


def test_a_terminal_without_a_character_shows_a_question_mark(tmp_path):
    line = "sumo-eval sample front_vehicle_low_speed --out 東"
    done = in_a_shell(line, tmp_path, PYTHONIOENCODING="latin-1")
    assert "\n?/points.csv\n" in done.stdout, done.stderr


@pytest.mark.parametrize("command", ["schema evaluation", "--help", "--version"])
def test_closed_pipe_is_no_failed_gate(command, tmp_path):
    done = in_a_shell(f"sumo-eval {command} | true; exit ${{PIPESTATUS[0]}}", tmp_path)
    assert done.returncode == 141
    assert done.stderr == ""


def test_each_example_that_is_not_run_says_why_and_what_runs_it():
    assert set(NOT_RUN) < set(EXAMPLES)
    for reason in NOT_RUN.values():
        for place in re.findall(r"tests/[\w/]+\.py", reason):
            assert (ROOT / place).is_file(), reason


# --- locators -------------------------------------------------------------------------------------

PLACES = "docs/bring_your_ads.md"
HERE = dict(
    rows_of("""
my_ads.py:acc | my_ads.py:acc
package.module:Policy | package.module:Policy
my_ads.py:MyAds | my_ads.py:MyAds
sumo:IDM?tau=1.2 | 'sumo:IDM?tau=1.2'
exec:./my_ads --fast | 'exec:./my_ads --fast'
traci:python my_client.py | "traci:python my_client.py"
fmu:acc.fmu | 'fmu:Acc.fmu?inputs.v=ego_speed&inputs.gap=lead_gap&outputs.acceleration=a_cmd'
onnx:policy.onnx | onnx:policy.onnx
idm | idm
lane_changer | lane_changer
careful_driver | careful_driver
""")
)
"""Locators of the table of doors, and how they are typed."""
ELSEWHERE = {
    "carla_agent.py:": "needs a planner of another tool; tests/ads/test_adapters.py has some",
    "smarts_agent.py:": "needs a planner of another tool; tests/ads/test_adapters.py has some",
    "nuplan_planner.py:": "needs a planner of another tool; tests/ads/test_adapters.py has some",
    "commonroad_planner.py:": "needs a planner of another tool; tests/ads/test_adapters.py has "
    "some",
    "exec:/usr/bin/python3 ros2_node.py": "needs ROS 2; tests/ads/test_ros2.py has a stand-in",
}


def doors(folder):
    """Write what the locators name."""
    (folder / "evaluation.toml").write_text(SMALL)
    (folder / "my_ads.py").write_text(ADS)
    (folder / "package").mkdir()
    (folder / "package" / "module.py").write_text(ADS.replace("MyAds", "Policy"))
    (folder / "my_ads").write_text(code_of("docs/ads/exec.md", "read -r briefing"))
    (folder / "my_ads").chmod(0o755)
    shutil.copy(ROOT / "docs" / "examples" / "traci_client.py", folder / "my_client.py")
    write_policy("policy")(folder)


def fmu(folder):
    """Build the example of an FMU."""
    builder = pytest.importorskip("pythonfmu.builder")
    shutil.copy(ROOT / "docs" / "examples" / "acc_fmu.py", folder)
    builder.FmuBuilder.build_FMU(folder / "acc_fmu.py", dest=folder)


IN_ANOTHER_TEST = {
    "traci:python my_client.py",
    "fmu:acc.fmu",
    "package.module:Policy",
    "lane_changer",
}
"""Locators that tests/cosim and tests/ads drive too: they are typed in the campaign."""


@pytest.mark.parametrize(
    "locator",
    [in_campaign(it) if it in IN_ANOTHER_TEST else it for it in HERE],
)
def test_a_locator_of_each_scheme_drives_as_typed(locator, tmp_path):
    doors(tmp_path)
    if locator.startswith("fmu:"):
        fmu(tmp_path)
    line = f"sumo-eval run evaluation.toml --ads {HERE[locator]} --out out"
    done = in_a_shell(line, tmp_path) if locator.startswith("exec:") else typed(line, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr  # 3 where a case could not be evaluated


def test_the_table_of_doors_has_no_locator_that_nothing_types():
    table = (ROOT / PLACES).read_text().split("## Choose a way")[1].split("\n\n")[1]
    named = [
        locator
        for row in table.splitlines()[2:]
        for locator in re.findall(r"`([^`]+)`", row.split("|")[2])
    ]
    assert {one for one in named if not one.startswith(tuple(ELSEWHERE))} == set(HERE)
    for reason in ELSEWHERE.values():
        assert (ROOT / re.findall(r"tests/\S+\.py", reason)[0]).is_file()
