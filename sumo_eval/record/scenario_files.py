"""Files that a user's scenario comes from, and a hash of what they hold.

Users: `record/facts.py`, `scoring/fingerprint.py`, `scoring/steps.py`.
"""

from __future__ import annotations

import importlib.util
import re
import tomllib
from contextlib import suppress
from pathlib import Path

from sumo_eval.input_file import hash_of, sha256
from sumo_eval.scenario.catalogue import options_of
from sumo_eval.scenario.formats import format_of

# a quoted text, which may name a file, and endings of files in which such texts are looked for
_QUOTED = re.compile(r"""["']([^"'\n]{1,300})["']""")
_WITH_NAMES = (".toml", ".xosc", ".py", ".json", ".xml")
_LARGEST = 8 << 20  # bytes of a file whose text may name others


def hashes_of_scenario(use: str, source: Path) -> dict[str, str]:
    """Hashes of what a user's scenario comes from: `file`, its file and the files that this names,
    "" where it ships; `code`, the Python file that `use` names.

    Runs are compared by `file` alone, because the Python file may also hold an ADS.

    use: as in the evaluation.
    source: folder of the evaluation, where relative paths start.
    """
    locator = options_of(use)[0]
    files = [it for it in files_of(locator, source) if it.suffix != ".py"]
    parts = [(it.name, _content(it)) for it in files if it.is_file()]
    code = _file_of(locator, source)
    hashes = {"file": sha256(repr(parts)) if parts else ""}
    if code is not None and code.suffix == ".py" and code.is_file():
        hashes["code"] = hash_of(code, "scenario")
    return hashes


def _content(file: Path) -> object:
    """Its bytes; of a TOML file, where a comment means nothing, its tables."""
    content = file.read_bytes()
    with suppress(ValueError):
        return tomllib.loads(content.decode()) if file.suffix == ".toml" else content
    return content


def files_of(locator: str, source: Path) -> list[Path]:
    """The file that a locator names, and files that its text names; for Python also all Python
    files of its folder.
    """
    paths: set[Path] = set()
    named = _file_of(locator, source)
    if named is not None:
        beside = named.parent.glob("*.py") if named.suffix == ".py" else ()
        for file in (named, *beside):
            _add_with_named(paths, file)
    return sorted(paths)


def _file_of(locator: str, source: Path) -> Path | None:
    """The file that a locator names; None where it ships."""
    module, colon, _ = locator.rpartition(":")
    if locator.endswith((".toml", ".csv", ".json", ".xml")) or format_of(locator):
        return source / locator
    if not colon:
        return None
    if not module.endswith(".py"):
        spec = None
        # one that is not found lies beside the evaluation; `source /` keeps an absolute origin
        with suppress(ImportError, ValueError):
            spec = importlib.util.find_spec(module)
        origin = spec.origin if spec is not None else None
        module = origin or module.replace(".", "/") + ".py"
    return source / module


def _add_with_named(paths: set[Path], file: Path) -> None:
    """The file and, in turn, the files in its folder that its text names in quotes; of OpenSCENARIO
    also whole folders.
    """
    if file in paths:
        return
    paths.add(file)
    if file.suffix not in _WITH_NAMES or not file.is_file() or file.stat().st_size > _LARGEST:
        return
    for name in _QUOTED.findall(file.read_text(encoding="utf-8", errors="replace")):
        with suppress(OSError, ValueError):  # a text that is no name of a file
            other = (file.parent / name).resolve()
            if other.is_file():
                _add_with_named(paths, other)
            elif file.suffix == ".xosc" and other.is_dir():
                for path in other.glob("*.xosc"):
                    _add_with_named(paths, path)
