"""The site's pages are true: blocks of code parse, commands and options exist, links lead
somewhere, examples run."""

import dataclasses
import json
import re
import sys
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import get_args, get_type_hints

import click
import pytest
from commands import ROOT, program, python
from doc_blocks import PAGES
from laid import read_json
from loaded import load

import sumo_eval
from sumo_eval import cli
from sumo_eval.cosim.doors.controller import SHIPPED
from sumo_eval.record.exchange import open_run
from sumo_eval.scenario.catalogue import SCENARIOS, find
from sumo_eval.scenario.shipped_files import scenario_files
from sumo_eval.settings import EvaluationSettings
from sumo_eval.settings.config import SUITES

DOCS = ROOT / "docs"
NOTEBOOK = DOCS / "tutorials" / "first_look.ipynb"


@pytest.mark.parametrize("page", PAGES)
def test_links_between_pages_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(), flags=re.S)
    for target in re.findall(r"\]\((?![a-z]+:)([^)#\s]+)[^)]*\)", text):
        assert (ROOT / page).parent.joinpath(target).resolve().exists(), target


@pytest.mark.parametrize("repository", ["", "https://example.org/sumo_eval"])
def test_page_of_the_package_has_absolute_links_only(repository):
    make = load("packaging/package_page.py").package_page
    page = make((ROOT / "README.md").read_text(), repository)
    assert not re.findall(r"\]\((?!https?:)|(?:src|srcset)=\"(?!https?:)", page)
    assert ("https://example.org/sumo_eval/blob/HEAD/docs/index.md" in page) == bool(repository)
    assert "class MyAds" in page


def test_every_page_is_in_the_menu():
    menu = (ROOT / "mkdocs.yml").read_text().split("\nnav:")[1]
    listed = re.findall(r": ([\w/]+\.md)", menu)
    assert len(listed) == len(set(listed))
    pages = {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}
    assert pages <= set(listed)
    assert all(path.startswith("project/") for path in set(listed) - pages)


def redirects():
    """The rows of mkdocs.yml: new address by old address."""
    rows = (ROOT / "mkdocs.yml").read_text().split("  redirects:\n")[1].split("\nvalidation:")[0]
    return dict(re.findall(r"^    (\S+): (\S+)$", rows, flags=re.M))


def test_old_addresses_lead_to_pages():
    pages = {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}
    made = hooks().moved_pages(redirects(), {*pages, "project/glossary.md"})
    assert len(made) == len(redirects())


def test_old_address_leads_up_and_to_a_heading():
    (page,) = hooks().moved_pages({"ads/old.md": "run.md#part"}, {"run.md"}).items()
    assert page[0] == "ads/old.html"
    assert 'url=../run.html#part"' in page[1]


@pytest.mark.parametrize("row", [{"run.md": "run.md"}, {"old.md": "gone.md"}])
def test_wrong_redirect_is_refused(row):
    with pytest.raises(ValueError, match="redirects"):
        hooks().moved_pages(row, {"run.md"})


def hooks():
    """What the site does to its pages, as a module."""
    return load("docs/site_hooks.py")


def test_every_scenario_is_described_on_one_family_page():
    reference = hooks().reference
    families = reference.scenario_families()
    assert set(families) == set(SCENARIOS)
    headings = [
        name
        for page in (DOCS / "scenarios").glob("*.md")
        for name in re.findall(r"^## (\w+)$", page.read_text(), flags=re.M)
    ]
    assert sorted(headings) == sorted(SCENARIOS)
    index = reference.scenario_index()
    assert all(f"[{name}]({page}#{name})" in index for name, page in families.items())


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_a_scenario_has_its_picture_parameters_options_and_source(name):
    text = hooks().reference.with_scenarios(f"# Page\n\n## {name}\n")
    assert f"](../pictures/moving/{name}.svg)" in text
    logical = find(name, ROOT)
    for parameter in logical.names:
        assert f"| `{parameter}` | " in text, parameter
    file = tomllib.loads(scenario_files()[name].read_text())
    assert all(f"Option `{option['name']}`" in text for option in file.get("option", ()))
    assert f"- Source: {logical.source}" in text


def test_the_reference_has_every_setting_command_and_option():
    reference = hooks().reference
    settings, commands = reference.settings_reference(), reference.command_reference()
    for owner, name in every_setting(EvaluationSettings):
        assert f"| `{name}`" in settings or f".{name}]" in settings or f"[{name}]" in settings, (
            owner,
            name,
        )
    for name in cli.commands():
        command = cli.main.get_command(click.Context(cli.main), name)
        assert f"### sumo-eval {name}\n" in commands
        for option in command.params if command else ():
            shown = option.param_type_name == "option" and not option.hidden
            assert not shown or f"`{option.opts[0]}`" in commands, (name, option)


def every_setting(owner):
    """Class and name of each setting of an evaluation, nested ones too."""
    for name, hint in get_type_hints(owner).items():
        if name.startswith("_"):
            continue
        yield owner.__name__, name
        for inner in (hint, *get_args(hint)):
            if dataclasses.is_dataclass(inner):
                yield from every_setting(inner)


def test_site_adds_elements_of_openscenario():
    from sumo_eval.extras.openscenario.conformity import table

    assert hooks().reference.GENERATED["reference/openscenario.md"]() == table()


def test_the_leaderboard_has_every_ads_that_ships_in_every_suite_with_what_the_files_say():
    text = hooks().leaderboard()
    for suite in SUITES.glob("*.toml"):
        part = text.split(f"\n## {suite.stem}\n")[1].split("\n## ")[0]
        found = read_json(DOCS / "leaderboard" / suite.stem / "shipped.json")
        said = {row["ads"]: row["s_plus"] for row in found["ranking"]["ads"]}
        assert set(said) == set(SHIPPED)
        for name, s_plus in said.items():
            assert f"| `{name}` | {s_plus:.1f} (" in part
        ordered = re.findall(r"^\| `(\w+)` \| ([\d.]+) ", part, flags=re.M)
        assert [float(value) for _, value in ordered] == sorted(
            (float(value) for _, value in ordered), reverse=True
        )


@pytest.mark.parametrize("key, value", [("seed", 1), ("drivers", {"count": 7}), ("zones", [])])
def test_scores_of_another_suite_are_refused(tmp_path, key, value):
    module = hooks()
    board = tmp_path / "leaderboard" / "2026.1"
    board.mkdir(parents=True)
    found = read_json(DOCS / "leaderboard" / "2026.1" / "shipped.json")
    (board / "other.json").write_text(json.dumps({**found, key: value}))
    module.BOARD = board.parent
    with pytest.raises(ValueError, match="is no run of its suite"):
        module.leaderboard()


@pytest.mark.parametrize(
    "name", ["bicycle_crossing", "cut_in", "curve_cut_in", "lane_drop", "turn_across_path"]
)
def test_a_moving_picture_shows_what_the_code_drives(name):
    """Where this fails: python tools/animate_scenarios.py docs/pictures/moving"""
    kept = DOCS / "pictures" / "moving" / f"{name}.svg"
    assert load("tools/animate_scenarios.py").drawn(find(name, ROOT)) == kept.read_text()


def test_figures_of_the_formulas_are_what_their_functions_give():
    """Where this fails: python tools/draw_method.py"""
    program(sys.executable, ROOT / "tools" / "draw_method.py", "--check")
    shown = re.findall(r"\]\(pictures/(method_\w+\.svg)\)", (DOCS / "formulas.md").read_text())
    assert sorted(shown) == sorted(path.name for path in (DOCS / "pictures").glob("method_*.svg"))


def test_formulas_and_the_glossary_of_the_site_are_the_repositorys():
    formulas = (DOCS / "formulas.md").read_text()
    assert formulas.count("```math") >= 7
    assert all(
        f"Eq{'s' if '-' in part else ''}. {part}" in formulas
        for part in ("1-6", "7-8", "9-10", "14-17", "18")
    )


EXECUTE = """
import sys, nbformat
from nbclient import NotebookClient
book = nbformat.read(sys.argv[1], 4)
NotebookClient(book, timeout=300, kernel_name="python3").execute()
nbformat.write(book, "executed.ipynb")
"""


@pytest.mark.campaign
def test_the_notebook_runs_in_a_kernel_and_shows_its_tables(tmp_path, monkeypatch):
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    python(EXECUTE, NOTEBOOK, cwd=tmp_path)
    cells = read_json(tmp_path / "executed.ipynb")["cells"]
    shown = [cell["outputs"] for cell in cells if cell["cell_type"] == "code"]
    assert [len(outputs) for outputs in shown] == [1] * 6
    assert all("<table" in "".join(one[0]["data"]["text/html"]) for one in shown[:4])
    assert shown[4][0]["data"]["image/png"], "the picture of the scores"
    monkeypatch.chdir(tmp_path)
    assert "idm" in open_run("first-look")._repr_html_()


def test_no_module_needs_posix_to_be_imported():
    posix = re.compile(
        r"^(?:import|from) (?:fcntl|resource|termios|pwd|grp|pty|tty|syslog)\b", flags=re.M
    )
    package = Path(str(files(sumo_eval)))
    assert not [path for path in package.rglob("*.py") if posix.search(path.read_text())]
