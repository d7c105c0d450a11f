"""Paths of the shipped files: SUMO networks and routes, and the shipped scenario files.

Networks and routes are inside the package once installed, next to it in the source tree.
"""

from __future__ import annotations

from pathlib import Path

from sumo_eval.errors import InputError

_PACKAGE = Path(__file__).resolve().parents[1]


def networks_folder() -> Path:
    """The folder of the `.net.xml` files."""
    return _find("networks")


def routes_folder() -> Path:
    """The folder of the `.rou.xml` and `.sumocfg` files."""
    return _find("routes")


def scenario_files() -> dict[str, Path]:
    """The files of the shipped logical scenarios by scenario name, sorted."""
    return {file.stem: file for file in sorted((_PACKAGE / "scenario" / "files").glob("*.toml"))}


def _find(name: str, package: Path = _PACKAGE) -> Path:
    # a wheel has them inside the package; a source tree, known by its pyproject.toml, has them at
    # its top
    installed, source = package / name, package.parent / name
    if installed.is_dir():
        return installed
    if source.is_dir() and (package.parent / "pyproject.toml").is_file():
        return source
    raise InputError(
        f"The shipped {name} are missing: neither {installed} nor {source} is there. Reinstall "
        "sumo_eval."
    )
