"""Paths of the shipped scenario files.

Users: `cli/tools.py`, `scenario/catalogue.py`, `scenario/formats.py`,
`extras/gym/__init__.py`.
"""

from pathlib import Path


def scenario_files() -> dict[str, Path]:
    """The files of the shipped logical scenarios by scenario name, sorted."""
    return {file.stem: file for file in sorted((Path(__file__).parent / "files").glob("*.toml"))}
