"""Files that a user's scenario comes from, and hashes of their content.

Users: `extras/rates/departures.py`, `record/facts.py`, `record/fingerprint.py`,
`scoring/steps.py`, `whatif/search.py`.
"""

import importlib.util
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from sumo_eval.errors import InputError
from sumo_eval.input_file import hash_of, sha256
from sumo_eval.scenario.catalogue import options_of
from sumo_eval.scenario.formats import format_of
from sumo_eval.scenario.resolved import Resolved

# A text from each quote to the next one of its kind, which may name a file, and endings of files in
# which such texts are looked for. Texts may overlap: an apostrophe is no quote, but looks like one.
_QUOTED = re.compile(r"""(["'])(?=([^\n]{1,300}?)\1)""")
_NAMING_SUFFIXES = (".toml", ".xosc", ".py", ".json", ".xml")
_TEXT_SIZE = 8 << 20  # bytes of a file whose text may name others


def hashes_of_scenario(use: str, source: Path) -> dict[str, str]:
    """Hashes of the files that a user's scenario comes from.

    file: of its file and of the files that are named in it, without Python files; "" for a scenario
        that ships.
    code: of the Python file that `use` names, if it names one. Runs are compared by `file` alone,
        because the Python file may also hold an ADS.

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


def is_edited(recorded: Mapping[str, Any], use: str, source: Path) -> bool:
    """Whether files that a user's scenario comes from have changed since it was driven.

    recorded: notes on its exposure, which have the hashes of then.
    use, source: as in `hashes_of_scenario`.
    """
    hashes = hashes_of_scenario(use, source)
    # "": not recorded
    return any(recorded.get(name, "") not in ("", now) for name, now in hashes.items())


def refuse_edited(run: Resolved, exposures: Mapping[str, Any], scenarios: Collection[str]) -> None:
    """Raise InputError if the files of a run's scenarios have changed since they were driven.

    exposures: of the run, beside which it keeps the hashes of then.
    scenarios: names of those that matter.
    """
    for entry, logical in run.entries:
        name = logical.name
        if name in scenarios and is_edited(exposures.get(name, {}), entry.use, run.source):
            raise InputError(
                f"The file of scenario `{name}` must be that of the run, and has changed since: "
                "undo its changes, or run the evaluation again."
            )


def _content(file: Path) -> object:
    """Bytes of a file; for a TOML file its tables, so that comments do not count."""
    content = file.read_bytes()
    if file.suffix == ".toml":
        with suppress(ValueError):
            return tomllib.loads(content.decode())
    return content


def files_of(locator: str, source: Path) -> list[Path]:
    """The file that a locator names, the files that its text names, and so on; of a Python file
    also all Python files of its folder.
    """
    named = _file_of(locator, source)
    if named is None:
        return []
    waiting = [named, *(named.parent.glob("*.py") if named.suffix == ".py" else ())]
    paths: set[Path] = set()
    while waiting:
        file = waiting.pop()
        if file not in paths:
            paths.add(file)
            with suppress(OSError):  # no permission to read the file
                waiting += _named_in(file)
    return sorted(paths)


def _file_of(locator: str, source: Path) -> Path | None:
    """The file that a locator names; None where it ships."""
    module, colon, _ = locator.rpartition(":")
    if locator.endswith((".toml", ".csv", ".json", ".xml")) or format_of(locator):
        return source / locator
    if not colon:
        return None
    if not module.endswith(".py"):
        origin = None
        # a module that is not found lies beside the evaluation; `source /` keeps an absolute origin
        with suppress(ImportError, ValueError):
            spec = importlib.util.find_spec(module)
            origin = spec and spec.origin
        module = origin or module.replace(".", "/") + ".py"
    return source / module


def _named_in(file: Path) -> Iterator[Path]:
    """Files that a file's text names in quotes, by a path from the file's folder. A text of
    OpenSCENARIO may also name a folder: then all its OpenSCENARIO files.
    """
    if (
        file.suffix not in _NAMING_SUFFIXES
        or not file.is_file()
        or file.stat().st_size > _TEXT_SIZE
    ):
        return
    for _, name in set(_QUOTED.findall(file.read_text(encoding="utf-8", errors="replace"))):
        with suppress(OSError, ValueError):  # most texts are not names of files
            other = (file.parent / name).resolve()
            if other.is_file():
                yield other
            elif file.suffix == ".xosc" and other.is_dir():
                yield from other.glob("*.xosc")
