"""The files of docs/examples/nights start a night as the command line takes it."""

import shlex
import subprocess
from importlib.metadata import version

import pytest
from commands import ROOT, cli_refuses, sumo_eval

NIGHTS = ROOT / "docs" / "examples" / "nights"


@pytest.mark.parametrize(
    "name", ["night.cron", "sumo-eval-night.service", "night.yml", "gitlab.yml"]
)
def test_recipe_names_options_of_nightly(name):
    text = (NIGHTS / name).read_text()
    known = sumo_eval("nightly", "--help").said
    lines = [line for line in text.splitlines() if "sumo-eval nightly" in line]
    assert lines
    for line in lines:
        command = line.partition("sumo-eval nightly")[2].partition(";")[0].partition("2>")[0]
        options = [word for word in shlex.split(command) if word.startswith("--")]
        assert "--history" in options
        assert all(option in known for option in options)


def test_lines_for_cron_are_lines_of_a_shell():
    for line in (NIGHTS / "night.cron").read_text().splitlines():
        assert line.startswith("#") or "%" not in line, "cron ends a command there"
        command = line if line.startswith("#") else line.split(None, 5)[5]
        subprocess.run(["sh", "-n", "-c", command], check=True)


def test_recipes_hide_no_failure_and_pin_what_they_run():
    texts = {path.name: path.read_text() for path in NIGHTS.iterdir()}
    service, workflow = texts["sumo-eval-night.service"], texts["night.yml"]
    assert service.count("ExecStartPre=/bin/sh -c ") == 2
    assert "SuccessExitStatus" not in service, "status 3 must not pass in silence"
    assert workflow.count("${{") == workflow.count("}}") == 2
    assert "cache" not in workflow, "a cache may be evicted, and the history with it"
    assert "continue-on-error" not in workflow, "status 3 must not pass in silence"
    for name in ("night.cron", "night.yml", "sumo-eval-night.service"):
        assert "sha256sum --check" in texts[name], name
    for name in ("night.cron", "night.yml", "sumo-eval-night.service", "gitlab.yml"):
        assert version("sumo_eval") in texts[name], name


def test_removed_option_names_the_files():
    cli_refuses("docs/examples/nights", "nightly evaluation.toml --history nights --install cron")
