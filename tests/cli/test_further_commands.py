"""Commands that installed packages bring: entry points of the group `sumo_eval.commands`."""

import sys

import pytest
from commands import sumo_eval

from sumo_eval import cli

COMMAND = """
import click

@click.command()
def weather():
    '''Say what the weather is.'''
    click.echo("dry")

nothing = 1
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


def test_an_installed_package_brings_a_command_of_its_own(site):
    install(site, "weather = weather_tool:weather")
    assert sumo_eval("weather").said == "dry\n"
    shown = sumo_eval("--help").said
    assert "Say what the weather is." in shown.partition(f"{cli.FURTHER}:")[2]


@pytest.mark.parametrize(
    "entry, sentence",
    [
        (
            "weather = weather_tool:rain",
            "Command `weather`, `weather_tool:rain`, cannot be loaded: AttributeError",
        ),
        ("weather = weather_tool:nothing", "must be a click command, got int."),
    ],
)
def test_what_is_not_a_command_gets_status_2(site, entry, sentence):
    install(site, entry)
    assert sentence in sumo_eval("weather", status=2).said
    assert sentence in " ".join(sumo_eval("--help").said.split())


def test_our_command_without_its_entry_point_says_what_to_do(monkeypatch):
    monkeypatch.setattr(cli, "_plugins", dict)
    done = sumo_eval("drive", "cut_in", status=2)
    assert "Command `drive` is not installed: run `pip install -e .` again." in done.said


def test_no_package_takes_the_place_of_our_commands(site):
    install(site, "run = weather_tool:weather")
    assert "EVALUATION" in sumo_eval("run", "--help").said
