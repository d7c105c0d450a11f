"""The site's pages are true: blocks of code parse, commands and options exist, links lead somewhere, examples run."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import click
import pytest

import sumo_eval
from sumo_eval.cli import COMMANDS, main
from sumo_eval.cosim import simulate
from sumo_eval.record.exchange import open_run
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.catalogue import SCENARIOS, find
from sumo_eval.settings.config import settings_from

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), ROOT / "README.md", ROOT / "PACKAGE.md"])
NAMES = [page.relative_to(ROOT).as_posix() for page in PAGES]
NOTEBOOK = DOCS / "tutorials" / "first_look.ipynb"


def blocks(page: Path, *languages: str) -> list[str]:
    found = re.findall(r"^ *```(\w+)[^\n]*\n(.*?)^ *```", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    return [text for language, text in found if language in languages]


def commands(page: Path) -> list[list[str]]:
    """Every line of a page's shell blocks that calls the program, as words."""
    lines = "\n".join(blocks(page, "sh", "text", "bash")).replace("\\\n", " ").splitlines()
    words = [shlex.split(line, comments=True) for line in lines if re.match(r"\s*(\S*/)?sumo-eval ", line)]
    return [line[1:] for line in words]


@pytest.mark.parametrize("page", NAMES)
def test_every_command_of_a_page_exists_with_its_options(page: str) -> None:
    for words in commands(ROOT / page):
        if words[0].startswith("-"):
            continue
        assert words[0] in COMMANDS, words
        command: Any = main.get_command(click.Context(main), words[0])
        if isinstance(command, click.Group) and len(words) > 1:
            command = command.get_command(click.Context(command), words[1])
            assert command is not None, words
        known = {name for item in command.params for name in (*item.opts, *item.secondary_opts)} | {"--help"}
        assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known, words


@pytest.mark.parametrize("page", NAMES)
def test_every_block_of_python_and_toml_can_be_read(page: str) -> None:
    for text in blocks(ROOT / page, "python"):
        compile(text, page, "exec")
    for text in blocks(ROOT / page, "toml"):
        if "..." not in text:
            tomllib.loads(text)


@pytest.mark.parametrize("page", [name for name in NAMES if name.startswith(("docs/tutorials", "docs/index"))])
def test_the_evaluations_of_the_tutorials_are_accepted(page: str) -> None:
    for text in blocks(ROOT / page, "toml"):
        content = tomllib.loads(text)
        if "ads" in content and "scenario" in content:
            settings_from(content, page)


@pytest.mark.parametrize("page", NAMES)
def test_links_between_pages_lead_somewhere(page: str) -> None:
    made = {"gallery.md", "leaderboard.md"}
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.S)
    for target in re.findall(r"\]\((?![a-z]+:)([^)#\s]+)[^)]*\)", text):
        assert target in made or (ROOT / page).parent.joinpath(target).resolve().exists(), target


def test_the_page_of_an_index_links_to_nothing_in_the_repository() -> None:
    assert not re.findall(r"\]\((?!https?:)", (ROOT / "PACKAGE.md").read_text(encoding="utf-8"))


def test_every_page_of_the_menu_is_there() -> None:
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:")[1]
    made = re.compile(r"project/|gallery|leaderboard")
    for path in re.findall(r": ([\w/]+\.md)", menu):
        assert made.match(path) or (DOCS / path).is_file(), path


def hooks() -> Any:
    """What the site does to its pages, as a module."""
    spec = importlib.util.spec_from_file_location("site_hooks", DOCS / "site_hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_gallery_has_every_scenario_with_its_picture_and_its_parameters() -> None:
    gallery = hooks().gallery()
    for name, logical in SCENARIOS.items():
        assert f"](scenarios/{name}.md)\n" in gallery, name
        part = gallery.split(f'`use = "{name}"`')[0].split("\n## ")[-1]
        assert "](pictures/" in part, name
        for parameter in logical.names:
            assert f"| `{parameter}` | " in part, (name, parameter)


def test_formulas_and_the_glossary_of_the_site_are_the_repositorys() -> None:
    formulas = (DOCS / "formulas.md").read_text(encoding="utf-8")
    assert formulas.count("```math") >= 7
    assert all(f"Eq{'s' if '-' in part else ''}. {part}" in formulas for part in ("1-6", "7-8", "9-10", "14-17", "18"))


def test_the_first_ads_of_the_site_drives(tmp_path: Path) -> None:
    (source,) = [text for text in blocks(DOCS / "index.md", "python") if "class MyAds" in text]
    space: dict[str, Any] = {}
    exec(compile(source, "my_ads.py", "exec"), space)
    concrete = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20.0, lead_speed=10.0)
    recording = simulate(concrete, space["MyAds"]())
    assert recording.collision is None
    assert recording.end_reason != "ads_error"


def test_the_scenario_of_the_tutorial_is_one(tmp_path: Path) -> None:
    (source,) = [text for text in blocks(DOCS / "tutorials" / "own_scenario.md", "toml") if "[[parameter]]" in text]
    (tmp_path / "lorry.toml").write_text(source)
    logical = find("lorry.toml", tmp_path)
    assert logical.names == ("ego_speed", "gap")
    (lorry,) = logical.concrete(ego_speed=20.0, gap=60.0).actors
    assert lorry.length > 8.0


def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    space: dict[str, Any] = {}
    shown = []
    for number, text in enumerate(code):
        *body, last = text.rstrip().split("\n")
        exec(compile("\n".join(body), f"cell {number}", "exec"), space)
        shown.append(eval(last, space))
    assert all("<table" in one._repr_html_() for one in shown[:4])
    assert len(shown[-1]) == 2
    assert "idm" in open_run("first-look")._repr_html_()


def test_no_module_needs_posix_to_be_imported() -> None:
    posix = re.compile(r"^(?:import|from) (?:fcntl|resource|termios|pwd|grp|pty|tty|syslog)\b", flags=re.M)
    package = Path(str(files(sumo_eval)))
    assert not [path for path in package.rglob("*.py") if posix.search(path.read_text(encoding="utf-8"))]
