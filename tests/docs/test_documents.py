"""What the pages for who carries on name is there: links, files, make targets; and the picture is
sound."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from loaded import ROOT

DECISIONS = tuple(
    f"docs/decisions/{path.name}" for path in sorted((ROOT / "docs" / "decisions").glob("*.md"))
)
PAGES = ("ARCHITECTURE.md", "CONTRIBUTING.md", "GLOSSARY.md", *DECISIONS)
PICTURE = ROOT / "docs" / "pictures" / "flow.svg"
SVG = "{http://www.w3.org/2000/svg}"
FOLDERS = ("", "sumo_eval", "sumo_eval/extras", "sumo_eval/cosim")
"""Where a path in a page may begin."""


def text(page):
    return (ROOT / page).read_text()


def paths_in(page):
    """Files and folders that a page names in code spans; placeholders and a user's own files are
    none."""
    spans = " ".join(re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text(page), flags=re.S)))
    found = set(
        re.findall(
            r"(?<![\w./<>*-])((?:[a-z_0-9]+/)*[a-z_0-9]+\.(?:py|toml|js|j2|sh)|(?:[a-z_0-9]+/)+)(?![\w<*])",
            spans,
        )
    )
    return found - {"my_ads.py", "evaluation.toml", "utils.py", "dist/"}


@pytest.mark.parametrize("page", PAGES)
def test_files_that_a_page_names_are_there(page):
    said = text(page).split("\n## Where it is going")[0]
    missing = {
        path
        for path in paths_in(page)
        if path in said and not any((ROOT / folder / path).exists() for folder in FOLDERS)
    }
    assert not missing


def test_modules_that_any_page_names_are_there():
    rooms = "|".join(path.name for path in (ROOT / "sumo_eval").iterdir() if path.is_dir())
    named = {
        (page.name, module)
        for page in (ROOT / "docs").rglob("*.md")
        for module in re.findall(rf"`((?:{rooms})/[\w/]+\.py)`", page.read_text())
    }
    assert len(named) > 10
    assert not {it for it in named if not (ROOT / "sumo_eval" / it[1]).is_file()}


def test_every_room_of_the_package_stands_in_the_architecture():
    table = text("ARCHITECTURE.md").split("\n## Rooms as they are")[1].split("\n## ")[0]
    for path in sorted((ROOT / "sumo_eval").iterdir()):
        if path.is_dir() and (path / "__init__.py").is_file():
            assert f"`{path.name}/`" in table, path.name


def test_make_targets_that_the_pages_name_are_there_and_quick_names_files_that_are():
    makefile = text("Makefile")
    for target in {
        target
        for page in (*PAGES, "README.md")
        for target in re.findall(r"(?:^|`)make (\w+)", text(page), flags=re.M)
    }:
        assert re.search(rf"^{target}:", makefile, flags=re.M), target
    quick = re.findall(r"tests/\S+\.py", makefile)
    assert len(quick) > 10
    for path in quick:
        assert (ROOT / path).is_file(), path


def test_make_test_takes_as_long_on_every_page_as_it_says_itself():
    (minutes,) = re.findall(r"^TEST_MINUTES := (\d+)$", text("Makefile"), flags=re.M)
    for page in ("README.md", "CONTRIBUTING.md"):
        assert f"about {minutes} minutes on two" in text(page), page


def test_the_tables_that_are_named_for_extension_are_there():
    from sumo_eval.cosim.doors.controller import DOORS, SHIPPED
    from sumo_eval.drivers.recorded.importing import READERS
    from sumo_eval.report.sections import SECTIONS
    from sumo_eval.scenario.sampling.samples import METHODS

    assert all((DOORS, SHIPPED, READERS, SECTIONS, METHODS))
    for name in ("SHIPPED", "READERS", "SECTIONS", "METHODS"):
        assert f"`{name}`" in text("CONTRIBUTING.md")


def test_every_decision_stands_in_the_list_and_is_half_a_page():
    listed = text("docs/decisions/README.md")
    for page in DECISIONS:
        name = Path(page).name
        if name != "README.md":
            assert f"]({name})" in listed
            assert len(text(page).split()) < 450, name
            assert "**What would change it.**" in text(page), name


def test_the_picture_is_small_says_what_it_shows_and_has_colours_for_light_and_dark():
    assert PICTURE.stat().st_size < 10_000
    root = ElementTree.parse(PICTURE).getroot()
    assert root.find(f"{SVG}title") is not None
    assert root.find(f"{SVG}desc") is not None
    style = root.find(f"{SVG}style")
    light, _, dark = style.text.partition("@media (prefers-color-scheme: dark)")
    for name in ("page", "box", "small", "safe", "danger", "field"):
        assert f".{name} {{" in light, name
        assert f".{name} {{" in dark, name
    used = {word for node in root.iter() for word in node.get("class", "").split()}
    assert used <= set(re.findall(r"\.([a-z]+) \{", light))
    assert text("docs/formulas.md").split("## ")[0].count("](pictures/flow.svg)") == 1


def test_the_source_archive_takes_the_pages_along():
    sdist = text("pyproject.toml").split("[tool.hatch.build.targets.sdist]")[1].split("\n[")[0]
    for name in ("ARCHITECTURE.md", "CONTRIBUTING.md", "GLOSSARY.md", "docs", "tools", "Makefile"):
        assert f'"{name}"' in sdist


def test_what_runs_before_a_commit_is_what_make_check_runs():
    check = text("Makefile").split("\ncheck:")[1].split("\n\n")[0]
    for tool in ("ruff check", "ruff format", "mypy", "lint-imports", "tools/house_check.py"):
        assert tool in check
        assert tool in text(".pre-commit-config.yaml")


NOT_UNDERSTOOD = (
    "unless the interval holds",
    "drivers against the drivers",
    "left the pack",
    "otherwise, than it was told",
    "shading is exact",
    "what was learnt from it",
    "fall into two groups, such as",
    "tells little of the ADS",
    "worth two drivers",
    "nobody did what the ads did",
    "stands in for it",
    "orders in which they can be taken off",
    "rooms that make facts",
    "rooms of it that make facts",
    "percentiles are widened",
    "weights r of collisions are held fixed",
)
"""Pieces of sentences that readers did not understand."""


def test_sentences_that_readers_did_not_understand_stand_nowhere():
    files = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")]
    files += [
        path for ending in ("py", "j2", "js") for path in (ROOT / "sumo_eval").rglob(f"*.{ending}")
    ]
    assert len(files) > 300
    for path in files:
        words = " ".join(path.read_text().split()).lower()
        assert not [one for one in NOT_UNDERSTOOD if one.lower() in words], path
