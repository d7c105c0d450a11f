"""What the site does to the repository's pages: formulas become MathML, pages at the top come along, links are turned.

A link to a file of the program stays as its words, since the site holds no sources. Formulas stand in ```math blocks
and in $`...`$; they are rendered while the site is built, so that a reader needs neither a script nor a network.
"""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

TOP = ("ARCHITECTURE", "CONTRIBUTING", "CHANGELOG", "GLOSSARY", "README")
ROOT = Path(__file__).resolve().parents[1]
_LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the repository's own pages under `project/`, the gallery of scenarios and the leaderboard."""
    from mkdocs.structure.files import File

    for name in TOP:
        text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
        files.append(File.generated(config, f"project/{name.lower()}.md", content=text))
    files.append(File.generated(config, "gallery.md", content=gallery()))
    files.append(File.generated(config, "leaderboard.md", content=leaderboard()))
    return files


def gallery() -> str:
    """A page with every scenario: its picture, its parameters, where it is described."""
    text = [
        "# Gallery of scenarios",
        "",
        "The middle of each space, driven by `idm` in SUMO. Blue: the ADS. Ochre: the others.",
        "",
    ]
    for path in sorted((ROOT / "sumo_eval" / "scenario" / "files").glob("*.toml")):
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        name = path.stem
        page, pictures = ROOT / "docs" / "scenarios" / f"{name}.md", ROOT / "docs" / "pictures"
        candidates = (pictures / "moving" / f"{name}.svg", pictures / f"{name}.svg")
        shown = next((one for one in candidates if one.is_file()), None)
        title = f"[{name}](scenarios/{name}.md)" if page.is_file() else name
        text += [f"## {title}", "", content["about"], ""]
        if shown:
            text += [f"![{content['about']}]({shown.relative_to(ROOT / 'docs').as_posix()})", ""]
        text += ["| parameter | range | |", "|---|---|---|"]
        text += [f"| `{one['name']}` | {_range(one)} | {one['about']} |" for one in content["parameter"]]
        text += ["", f'`use = "{name}"`', ""]
    return "\n".join(text)


def _range(parameter: dict[str, Any]) -> str:
    """The values of a parameter in words: a list, or the ends of a range, and the unit."""
    unit = parameter.get("unit", "")
    if "values" in parameter:
        said = ", ".join(f"{value:g}" for value in parameter["values"])
    else:
        said = f"{parameter['low']:g} to {parameter['high']:g}"
    return f"{said} {unit}".rstrip()


def leaderboard() -> str:
    """The golden scores of every suite, best first."""
    text = [
        "# Leaderboard",
        "",
        "A suite is a fixed list of scenarios, samples, drivers and seed. It never changes, so its scores are citable:",
        '`use = "suite:2026.1"` in an evaluation file. To add an ADS, send its `scores.json` and its locator to the',
        "maintainers, or add its row to the suite's file in `sumo_eval/settings/suites/`.",
        "",
    ]
    kept = sorted((ROOT / "sumo_eval" / "settings" / "suites").glob("*.scores.json"), reverse=True)
    if not kept:
        text.append("No scores are kept here yet: yours may be the first.")
    for path in kept:
        found = json.loads(path.read_text(encoding="utf-8"))
        text += [
            f"## {path.name.removesuffix('.scores.json')}",
            "",
            found["about"],
            "",
            "| ADS | S+ | A | H | avoidable collisions |",
            "|---|---|---|---|---|",
        ]
        text += [
            f"| `{row['ads']}` | {row['s_plus']:.1f} | {row['a']:.3f} | {row['h']:.3f} | {row['avoidable']} |"
            for row in sorted(found["rows"], key=lambda row: -row["s_plus"])
        ]
        text.append("")
    return "\n".join(text)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn links, render formulas."""
    here = page.file.src_uri
    turned = _LINK.sub(lambda found: _turned(found, here, files), markdown)
    turned = re.sub(r"```math\n(.*?)```", lambda found: _formula(found[1], "block"), turned, flags=re.S)
    return re.sub(r"\$`([^`]+)`\$", lambda found: _formula(found[1], "inline"), turned)


def _formula(latex: str, display: str) -> str:
    from latex2mathml.converter import convert

    made = convert(" ".join(latex.split()), display=display)
    # In a span, because Markdown takes a line that begins with another tag for a block.
    return f"\n{made}\n" if display == "block" else f"<span>{made}</span>"


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
    elif inside.startswith("docs/") and files.get_file_from_path(inside.removeprefix("docs/")):
        uri = inside.removeprefix("docs/")
    else:
        return words
    up = "../" * here.count("/")
    return f"[{words}]({up}{uri}{mark}{anchor})"
