"""What the site does to the repository's pages: formulas become MathML, pages at the top come
along, links are turned.

A link to a file of the program stays as its words, since the site holds no sources. Formulas stand
in ```math blocks and in $`...`$; they are rendered while the site is built, so that a reader needs
neither a script nor a network.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parent))  # mkdocs loads this file by its path

import site_reference as reference

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

TOP = ("ARCHITECTURE", "CONTRIBUTING", "CHANGELOG", "GLOSSARY")
ROOT = Path(__file__).resolve().parents[1]
_LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the repository's own pages under `project/`."""
    from mkdocs.structure.files import File

    for name in TOP:
        text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
        files.append(File.generated(config, f"project/{name.lower()}.md", content=text))
    return files


BOARD = ROOT / "docs" / "leaderboard"
"""The scores of every suite: a folder a suite, in it `scores.json` files of runs, under any
name."""
PARTS = {"T": "task_share", "A'": "avoidance_grade", "H": "human_likeness"}
PARTS_OF = {"2026.1": {"A": "avoided_share", "H": "human_likeness"}}
"""What S+ is made of, key by name; in 2026.1 it was 50 A + 50 H."""


def leaderboard() -> str:
    """A table of every suite's scores, best first.

    Raises ValueError for a file that is not of its folder's suite.
    """
    text: list[str] = []
    for folder in sorted((path for path in BOARD.iterdir() if path.is_dir()), reverse=True):
        suite = tomllib.loads(
            (ROOT / "sumo_eval/settings/suites" / f"{folder.name}.toml").read_text(encoding="utf-8")
        )
        parts = PARTS_OF.get(folder.name, PARTS)
        rows = [
            row for path in sorted(folder.glob("*.json")) for row in _board_rows(path, suite, parts)
        ]
        uses = [entry["use"] for entry in suite["scenario"]]
        text += [
            "",
            f"## {folder.name}",
            "",
            f"| ADS | S+ | {' | '.join(parts)} | avoidable collisions | {' | '.join(uses)} | with |",
        ]
        text += ["|---" * (4 + len(parts) + len(uses)) + "|"]
        text += [f"| {' | '.join(cells)} |" for _, cells in sorted(rows, key=lambda row: -row[0])]
        text += ["", "Columns named after a scenario hold S+ there."]
    return "\n".join([*text, ""])


def _board_rows(
    path: Path, suite: dict[str, Any], parts: dict[str, str]
) -> list[tuple[float, list[str]]]:
    """S+ and the cells of every ADS of a `scores.json`.

    parts: of S+, key by name.
    """
    found = json.loads(path.read_text(encoding="utf-8"))
    uses = [entry["use"] for entry in suite["scenario"]]
    for what, is_, must in (
        ("seed", found["seed"], suite["seed"]),
        ("number of drivers", found["drivers"].get("count"), suite["drivers"]["count"]),
        ("list of scenarios", [zone["scenario"] for zone in found["zones"]], uses),
    ):
        if is_ != must:
            raise ValueError(
                f"{path} is no run of its suite: the {what} must be {must}, got {is_}."
            )
    rows = []
    for one in found["ranking"]["ads"]:
        scores = {
            score["scenario"]: score for score in found["scores"] if score["ads"] == one["ads"]
        }
        low, high = one["interval"]
        means = [sum(scores[use][key] for use in uses) / len(uses) for key in parts.values()]
        versions = found["versions"]
        cells = [
            f"`{one['ads']}`",
            f"{one['s_plus']:.1f} ({low:.1f}..{high:.1f})",
            *(f"{mean:.3f}" for mean in means),
            str(sum(scores[use]["avoidable_collisions"] for use in uses)),
            *(f"{scores[use]['s_plus']:.1f}" for use in uses),
            f"[{versions['sumo_eval']}, libsumo "
            f"{versions['libsumo']}](leaderboard/{path.parent.name}/{path.name})",
        ]
        rows.append((one["s_plus"], cells))
    return rows


MOVED = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Moved</title><meta http-equiv="refresh" content="0; url={to}">
<link rel="canonical" href="{to}"></head><body><p>This page moved to <a href="{to}">{to}</a>.</p></body></html>
"""
"""A page at an old address."""


def moved_pages(rows: dict[str, str], pages: set[str]) -> dict[str, str]:
    """The pages at old addresses, by address.

    Raises ValueError for a row that names no page or hides one.

    rows: new address, perhaps with a heading, by old address, both ending in `.md`.
    pages: addresses of the site's pages, ending in `.md`.
    """
    made = {}
    for old, new in rows.items():
        page, mark, heading = new.partition("#")
        if old in pages or page not in pages:
            raise ValueError(
                f"mkdocs.yml, redirects: must lead from no page to a page, got `{old}: {new}`."
            )
        to = f"{'../' * old.count('/')}{page.removesuffix('.md')}.html{mark}{heading}"
        made[f"{old.removesuffix('.md')}.html"] = MOVED.format(to=to)
    return made


def on_env(env: Any, config: Any, files: Files) -> None:
    """Write the pages at old addresses."""
    pages = {file.src_uri for file in files.documentation_pages()}
    for address, text in moved_pages(config.extra["redirects"] or {}, pages).items():
        place = Path(config.site_dir, address)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text, encoding="utf-8")


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn links, render formulas."""
    here = page.file.src_uri
    if here == "leaderboard.md":
        markdown = f"{markdown}\n{leaderboard()}"
    if here.startswith("scenarios/"):
        markdown = reference.with_scenarios(markdown)
    if here in reference.GENERATED:
        markdown = f"{markdown}\n{reference.GENERATED[here]()}\n"
    turned = _LINK.sub(lambda found: _turned(found, here, files), markdown)
    turned = re.sub(
        r"```math\n(.*?)```", lambda found: _formula(found[1], "block"), turned, flags=re.S
    )
    return re.sub(r"\$`([^`]+)`\$", lambda found: _formula(found[1], "inline"), turned)


def _formula(latex: str, display: str) -> str:
    from latex2mathml.converter import convert

    made = convert(" ".join(latex.split()), display=display)
    # In a span, because Markdown takes a line that begins with another tag for a block.
    return (
        f'\n<div class="formula">{made}</div>\n' if display == "block" else f"<span>{made}</span>"
    )


def _turned(found: re.Match[str], here: str, files: Files) -> str:
    words, target = found[1], found[2]
    if re.match(r"[a-z]+:|#", target):
        return found[0]
    path, mark, anchor = target.partition("#")
    base = ROOT if here.startswith("project/") else (ROOT / "docs" / here).parent
    place = (base / path).resolve()
    if not place.is_relative_to(ROOT):
        return words
    inside = place.relative_to(ROOT).as_posix()
    if place.stem in TOP and place.parent == ROOT:
        uri = f"project/{place.stem.lower()}.md"
    elif inside == "README.md":
        uri = "index.md"
    elif inside.startswith("docs/") and files.get_file_from_path(inside.removeprefix("docs/")):
        uri = inside.removeprefix("docs/")
    else:
        return words
    up = "../" * here.count("/")
    return f"[{words}]({up}{uri}{mark}{anchor})"
