"""Write the drawings of docs/pictures that a tool makes, or say which of them are stale."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"


def write_or_check(drawings: Mapping[str, str], tool: str, about: str) -> int:
    """The exit status of a tool that makes these drawings, by file name. tool: its file; about: its docstring."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if one is missing or stale")
    arguments = parser.parse_args()
    stale = 0
    for name, text in drawings.items():
        path = FOLDER / name
        if not arguments.check:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"docs/pictures/{name} is stale; run tools/{Path(tool).name}.")
            stale = 1
    return stale
