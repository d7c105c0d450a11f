"""Formats of scenario files that installed packages bring: entry points of the group
`sumo_eval.scenarios`."""

import sys
import tomllib

import pytest
from laid import lay
from refusals import refusal

import sumo_eval
from sumo_eval.scenario import catalogue, formats
from sumo_eval.scenario.sampling.samples import sample

EVALUATION = tomllib.loads("""
name = "own format"
scenario = [{ use = "slow.lead?speed=5", sampling = { levels = 2 } }]
ads = [{ name = "idm", controller = "idm" }]
drivers = { count = 2 }
""")
READER = """
from dataclasses import replace
from sumo_eval.scenario.catalogue import load

def read(path, options):
    assert path.read_text() == "a slow lead vehicle" and options == {"speed": "5"}
    return replace(load("front_vehicle_low_speed"), name="slow_lead")
"""


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of installed packages, where a test may install its own."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    for known in (formats._readers, formats._loaded):
        known.cache_clear()
    yield tmp_path
    sys.modules.pop("lead_format", None)
    for known in (formats._readers, formats._loaded):
        known.cache_clear()


def install(site, code, ending="lead"):
    """Install a package with this code, whose `read` reads files of an ending."""
    about = {
        "METADATA": "Metadata-Version: 2.1\nName: lead_format\nVersion: 1.0\n",
        "entry_points.txt": f"[{formats.GROUP}]\n{ending} = lead_format:read\n",
    }
    lay(site / "lead_format-1.0.dist-info", about)
    (site / "lead_format.py").write_text(code)


def test_an_installed_package_reads_a_format_of_its_own(site):
    (site / "slow.lead").write_text("a slow lead vehicle")
    install(site, READER)
    assert catalogue.is_file("slow.lead")
    done = sumo_eval.evaluate(EVALUATION, site / "run", engine="serial")
    assert [score.scenario for score in done.scores] == ["slow_lead"]


FORMAT = "from sumo_eval.scenario.formats import Format\n"
LOADED = r"The reader of `\.lead` files, `lead_format:read`, cannot be loaded: "
FOUND = r"Logical scenario `slow\.lead` .*"


@pytest.mark.parametrize(
    "read, words",
    [
        ("1\nimport nowhere", f"{LOADED}ModuleNotFoundError"),
        ("Format(None, None, 3)", f"{LOADED}TypeError: 'int' object is not iterable"),
        ("Format(None, samplings=3)", f"{LOADED}AttributeError: 'int' .* no attribute 'values'"),
        ("Format(None, samplings={'x': 3})", f"{LOADED}TypeError: cannot unpack"),
        ("lambda path, options: 1 / 0", f"{FOUND}Zero"),
        ("lambda path, options: 3", f"{FOUND}LogicalScenario, got int"),
    ],
)
def test_a_format_that_cannot_be_loaded_or_fails_is_refused(site, read, words):
    install(site, f"{FORMAT}read = {read}")
    with refusal(words):
        catalogue.find("slow.lead", site)


def test_two_readers_of_one_ending_are_refused_by_name(site):
    install(site, "", "xosc")
    with refusal(r"Files `\.xosc` must have one reader, got .*uninstall one"):
        catalogue.find("any.xosc", site)


def test_an_ending_that_nothing_reads_is_refused(tmp_path):
    with refusal(r"Unknown logical scenario `slow\.lead`: .*entry point `lead` of .* would do\.$"):
        catalogue.find("slow.lead", tmp_path)


def test_path_without_an_ending_is_an_unknown_name(tmp_path):
    with refusal(r"^Unknown logical scenario `\.\./slow_lead`\. "):
        catalogue.find("../slow_lead", tmp_path)


def test_own_format_without_entry_point_names_the_mend(tmp_path, monkeypatch):
    monkeypatch.setattr(formats, "_readers", dict)
    with refusal(r"no installed package reads `\.xosc` files.*`pip install -e \.` once more"):
        catalogue.find("any.xosc", tmp_path)


@pytest.mark.parametrize("body, words", [("1 / 0", "Zero"), ("request", "no attribute 'points'")])
def test_a_sampling_of_a_package_that_fails_is_refused(site, body, words):
    mine = f"mine = lambda logical, request: {body}\n"
    install(site, f"{FORMAT}{mine}read = Format(None, samplings={{'mine': (mine, frozenset())}})")
    with refusal("Sampling method `mine` failed: .*" + words):
        sample(catalogue.load("cut_in"), "mine")
