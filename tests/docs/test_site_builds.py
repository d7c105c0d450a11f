"""`make docs`: builds the site; a broken link fails; what was built leads nowhere and loads
nothing."""

import os
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest
from commands import program
from loaded import ROOT
from lxml import html

SITE = ROOT / "build" / "site"

pytestmark = pytest.mark.campaign


@pytest.fixture(scope="module")
def site():
    words = (sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", SITE)
    program(*words, cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    return SITE


@pytest.fixture(scope="module")
def pages(site):
    return {
        path: html.parse(str(path)).getroot()
        for path in sorted(site.rglob("*.html"))
        if path.name != "404.html"
    }


def addresses(page):
    for element, attribute, address, _ in page.iterlinks():
        if attribute in ("href", "src") and element.get("rel") != "canonical":
            yield address


def test_every_link_of_the_built_site_leads_somewhere(site, pages):
    assert len(pages) > 80
    names = {path: {*page.xpath("//@id"), *page.xpath("//a/@name")} for path, page in pages.items()}
    broken = []
    for path, page in pages.items():
        for address in addresses(page):
            if address.startswith(("http:", "https:", "mailto:", "data:", "javascript:")):
                continue
            place, _, anchor = unquote(address).partition("#")
            target = (path.parent / place).resolve() if place else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file() or (anchor and target in names and anchor not in names[target]):
                broken.append(f"{path.relative_to(site)}: {address}")
    assert broken == []


def test_no_page_of_the_site_loads_anything_from_elsewhere(pages):
    for path, page in pages.items():
        loaded = page.xpath(
            "//script/@src | //img/@src | //link[@rel='stylesheet']/@href | //iframe/@src"
        )
        assert not [address for address in loaded if str(address).startswith(("http", "//"))], path


def test_formulas_are_rendered_and_every_scenario_moves(site, pages):
    assert len(pages[site / "formulas.html"].xpath("//*[local-name()='math']")) >= 9
    pictures = {
        Path(address).stem: str(address).removeprefix("../")
        for path, page in pages.items()
        if path.parent.name == "scenarios"
        for address in page.xpath("//article//img/@src")
    }
    assert set(pictures) == {
        path.stem for path in (ROOT / "sumo_eval" / "scenario" / "files").glob("*.toml")
    }
    for name, picture in pictures.items():
        assert "<animate" in (site / picture).read_text(), name


def test_the_search_of_pages_read_as_files_says_what_it_needs(pages):
    for path, page in pages.items():
        if page.xpath("//meta[@http-equiv='refresh']"):
            continue  # an old address
        (script,) = [
            one for one in page.iter("script") if str(one.get("src")).endswith("search_note.js")
        ]
        words = (path.parent / str(script.get("src"))).read_text()
        assert 'location.protocol === "file:"' in words
        assert "The search needs a server" in words
        assert page.xpath("//input[contains(@class, 'md-search__input')]")
