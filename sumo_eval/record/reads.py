"""Files that the code of an ADS reads while it drives: their hashes are noted in its process
(`record.worker`), and compared with the files when a run is resumed (`record.recording`).

A process notes two kinds of files with their content at the time they are opened: every Python file
outside the installed packages, and every file below a folder that contains such a Python file or
the evaluation. Files that the process writes do not count, nor do compiled Python files. What a
process has read stays in its memory: so all cases of an ADS depend on all files that its processes
have read.

Users: `extras/studies/trials.py`, `record/claims.py`, `record/engines.py`, `record/facts.py`,
`record/recording.py`, `record/store.py`, `record/worker.py`.
"""

from __future__ import annotations

import hashlib
import importlib.util
import math
import os
import stat
import sys
import sysconfig
import tempfile
import threading
import time as clock
from collections.abc import Collection, Iterable
from contextlib import suppress
from os.path import abspath, dirname, exists, join, realpath
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

from sumo_eval.errors import InputError
from sumo_eval.record.hygiene import SCRATCH_PREFIX
from sumo_eval.text import clean

ABSENT, WRITTEN, UNKNOWN = "-", "", "?"
"""Marks that replace a hash. ABSENT: there is no such file. WRITTEN: the ADS writes the file.
UNKNOWN: the file may have changed after it was loaded."""
LOST = "a file that no process lived to tell"
"""Path of a stand-in for all files of an ADS whose processes were all lost before they could
report. Its hash is `UNKNOWN`, and `WRITTEN` once a process has reported."""

_PACKAGE = str(Path(__file__).parent.parent)
_PYTHON = (".py", ".pyw", ".pyc")
_CODE = (*_PYTHON, ".pyd", ".so", ".zip", ".egg", ".whl", ".pyz")
_EVENTS = frozenset({"open", "import", "os.rename", "sqlite3.connect", "ctypes.dlopen"})
_HASHED_WHOLE = 256 << 20  # bytes; a larger file is identified by its size and time of change
_MOST_REPORTED = 1_000  # written files of one process: an ADS may write one a step
# `_busy.now`: this thread is noting a file; that it opens the file for this does not count
_busy = threading.local()
_IMPORT_TIME = clock.time()  # of this module, by the system's clock, s

File = tuple[str, str]
"""Path and hash; the path is relative to the evaluation's folder if the file is below it."""
FileOfAds = tuple[str, str, str]
"""Locator of an ADS, path and hash."""


class State(NamedTuple):
    """State of a file, by which a change of its content is noticed.

    changed: time of the last change, ns.
    size: bytes.
    """

    changed: int
    size: int
    inode: int
    mode: int


NEVER = State(-1, -1, -1, -1)
"""State of a file that has not been seen yet."""


class _Watch:
    """Files that this process reads during a run.

    folder: of the evaluation.
    before: watch of an earlier run in this process, which ends.
    """

    def __init__(self, folder: Path, before: _Watch | None = None) -> None:
        self.active = True
        self.folder = str(folder)
        self._roots: set[str] = set()  # folders below which files count
        self._add_root(self.folder)
        # of files when they were read; None: there was no file
        self._states: dict[str, State | None] = {}
        self._written: set[str] = set()
        # of files when they were opened for reading and writing
        self._open_for_both: dict[str, State | None] = {}
        self._known: dict[File, None] = {}  # all files noted so far, in order
        self._reported = 0  # number of these that are reported
        self._modules = 0  # number of loaded modules at the last look
        if before is None:
            return
        before.active = False  # after a Ctrl-C amid a case it is still active
        for path, digest in before._known:
            # content that the earlier run has read may still be in memory: UNKNOWN if it has
            # changed
            if digest != WRITTEN:
                self._note(path, digest if content(path, _state(path)) == digest else UNKNOWN)

    def opens(self, path: Any, flags: int) -> None:
        """Note a file that is opened now.

        flags: of `os.open`.
        """
        opened = abspath(os.fsdecode(path))
        place = _source(opened)
        if place is None or place.startswith(self._ignored_folders()):
            return
        writes = flags & (os.O_WRONLY | os.O_RDWR)
        if writes and place != opened:  # Python writes a compiled file: its source is unchanged
            return
        if not self._is_below(place) and (writes or not place.endswith(_CODE)):
            return
        # a file that is opened for reading and writing is read, unless opening it empties it
        if writes and (flags & os.O_TRUNC or not flags & os.O_RDWR):
            self.write(place)
        else:
            self.read(place)
        if flags & os.O_RDWR:  # if its state changes later, `report` notes it as written
            self._open_for_both.setdefault(place, _state(place))

    def read(self, path: str, since: float = math.inf) -> None:
        """Note the content of a file if it has changed since it was noted.

        Pipes and devices are not opened.

        since: latest time at which the file can have been read, by the system's clock, s; if it was
            changed later, its content then is `UNKNOWN`.
        """
        state = _state(path)
        if path in self._written or self._states.get(path, NEVER) == state:
            return
        self._states[path] = state
        digest = content(path, state)
        if digest is None:
            return
        if path.endswith(_PYTHON):
            self._add_root(dirname(path))
            self._add_root(dirname(realpath(path)))  # of a link to it
        loaded = state is None or state.changed <= since * 1e9
        self._note(path, digest if loaded else UNKNOWN)

    def write(self, path: str) -> None:
        """Note that a file is written: its content does not count."""
        if path not in self._written:
            self._written.add(path)
            if len(self._written) <= _MOST_REPORTED:
                self._note(path, WRITTEN)

    def report(self) -> list[File]:
        """The files that were read since the last report."""
        self._look_at_modules()
        for path, state in self._open_for_both.items():
            if _state(path) != state:
                self.write(path)
        new = list(self._known)[self._reported :]
        self._reported = len(self._known)
        inside = join(self.folder, "")
        return [
            (os.path.relpath(path, self.folder) if path.startswith(inside) else path, digest)
            for path, digest in new
        ]

    def _note(self, path: str, digest: str) -> None:
        self._known.setdefault((path, digest))

    def _add_root(self, folder: str) -> None:
        self._roots |= {join(root, "") for root in (folder, realpath(folder))}

    def _is_below(self, path: str) -> bool:
        roots = tuple(self._roots)
        return path.startswith(roots) or realpath(path).startswith(roots)

    def _ignored_folders(self) -> tuple[str, ...]:
        """Folders of files that do not count: installed packages, caches, and the temporary files
        of a child of the pool, unless the evaluation is among these files.
        """
        temporary = join(tempfile.tempdir or "", "")
        of_pool = f"{os.sep}{SCRATCH_PREFIX}" in temporary
        ignored = of_pool and not self.folder.startswith(temporary)
        return (*_INSTALLED, temporary) if ignored else _INSTALLED

    def _look_at_modules(self) -> None:
        """Note modules that were loaded before the watch began, such as those of a script that
        calls this package.
        """
        if len(sys.modules) == self._modules:  # no module was loaded since the last look
            return
        self._modules = len(sys.modules)
        for module in list(sys.modules.values()):
            name = getattr(module, "__dict__", {}).get("__file__")
            path = abspath(name) if isinstance(name, str) else ""
            if (
                path not in self._states
                and path.endswith(_CODE)
                and not path.startswith(self._ignored_folders())
                and exists(path)  # a module in an archive has no file at this path
            ):
                self.read(path, _IMPORT_TIME)


_watch: _Watch | None = None


def begin(folder: Path, files: Iterable[Path] = ()) -> None:
    """Watch what this process reads from now on.

    files: files that count as read.
    """
    global _watch
    if _watch is None:
        sys.addaudithook(_hear)
    if _watch is None or _watch.folder != str(folder):
        _watch = _Watch(folder, _watch)
    _watch.active = True
    for file in files:
        _watch.read(abspath(file))


def begin_run() -> None:
    """Prepare a process that drives cases itself for a further run: forget versions of files that
    have changed since the last run, and watch again from the next `begin` on.
    """
    global _watch
    if _watch is not None:
        _watch = _Watch(Path(_watch.folder), _watch)
        _watch.active = False


def end() -> list[File] | None:
    """Stop watching; the files read since the last report, None if nothing was watched."""
    if _watch is None or not _watch.active:
        return None
    _watch.active = False
    return _watch.report()


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    """Audit hook of Python: note the file that an event opens, but no file that noting opens."""
    if event not in _EVENTS or _watch is None or not _watch.active or getattr(_busy, "now", False):
        return
    _busy.now = True
    try:
        # an ADS may try to open anything as a path: this must fail in the ADS, not here
        with suppress(Exception):
            if event == "open":
                _watch.opens(arguments[0], arguments[2])
            elif event == "import" and arguments[1]:
                _watch.opens(arguments[1], os.O_RDONLY)
            elif event == "os.rename":
                _watch.opens(arguments[1], os.O_WRONLY)
            elif event == "sqlite3.connect":
                _watch.opens(_database(os.fsdecode(arguments[0])), os.O_RDWR)
            elif event == "ctypes.dlopen" and os.sep in os.fsdecode(arguments[0]):
                _watch.opens(arguments[0], os.O_RDONLY)
    finally:
        _busy.now = False


def _database(name: str) -> str:
    """Path of the file that sqlite opens for a name or a `file:` address."""
    if not name.startswith("file:"):
        return name
    path = unquote(name.removeprefix("file:").partition("?")[0])
    return os.sep + path.lstrip("/") if path.startswith("/") else path


def _source(path: str) -> str | None:
    """The source of a compiled Python file; of any other file the path itself; None for a temporary
    file that Python renames to a compiled one.
    """
    folder, name = os.path.split(path)
    if not name.endswith(".pyc"):
        return None if os.path.basename(folder) == "__pycache__" or ".pyc." in name else path
    try:
        source = importlib.util.source_from_cache(path)
    except ValueError:  # it lies in no `__pycache__`
        return path
    return source if exists(source) else path


def _installed_places() -> tuple[str, ...]:
    """Folders of the interpreter, installed packages, this package, the system and caches."""
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    places = {sysconfig.get_path(name) for name in names} | {_PACKAGE, "/proc", "/sys", "/dev"}
    places |= {path for path in sys.path if path.endswith(("site-packages", "dist-packages"))}
    places.add(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    if sys.prefix != sys.base_prefix:
        places.add(sys.prefix)
    both = places | {realpath(path) for path in places}
    return tuple(join(path, "") for path in sorted(both))


_INSTALLED = _installed_places()


def _state(path: str) -> State | None:
    """State of a file; None: no such file exists."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return State(status.st_mtime_ns, status.st_size, status.st_ino, status.st_mode)


def content(path: str, state: State | None) -> str | None:
    """A hash of a file's content; None for anything that is not a regular file."""
    if state is None:
        return ABSENT
    if not stat.S_ISREG(state.mode):
        return None
    if state.size > _HASHED_WHOLE:
        return f"{state.size} bytes, {state.changed}"
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return UNKNOWN


# --- in the owner ---------------------------------------------------------------------------------


class OneVersion:
    """Files that the ADSs of one run have read; refuses a second version of a file."""

    def __init__(self, known: Iterable[FileOfAds]) -> None:
        self._files = {(locator, path): digest for locator, path, digest in known}
        self._reported = {locator for locator, _ in self._files}

    def add(self, ads: str, locator: str, files: Collection[File] | None) -> list[FileOfAds]:
        """Add files read by a process of an ADS. Returns files that are new or replace an entry.

        Raises InputError for a file that has changed.

        files: None: the process was lost.
        """
        if files is None:
            files = [] if locator in self._reported else [(LOST, UNKNOWN)]
        elif (locator, LOST) in self._files:
            files = [*files, (LOST, WRITTEN)]  # ends the effect of the stand-in
        self._reported.add(locator)
        new = []
        # WRITTEN replaces any other entry, so it comes first; UNKNOWN replaces a hash
        for path, digest in sorted(files, key=lambda file: file[1] != WRITTEN):
            before = self._files.get((locator, path))
            if before in (digest, WRITTEN) or (before == UNKNOWN and digest != WRITTEN):
                continue
            if before is not None and digest not in (WRITTEN, UNKNOWN):
                raise InputError(
                    f"ADS `{ads}` was changed while the run went on: its processes have read two "
                    f"versions of {clean(path)}. What was driven before is kept; --resume drives "
                    "again what depends on it."
                )
            self._files[locator, path] = digest
            new.append((locator, path, digest))
        return new


def changed(read: Iterable[FileOfAds], folder: Path) -> dict[str, list[str]]:
    """Files whose content has changed, or perhaps changed, since the ADS read them, by locator."""
    now = {}
    differing: dict[str, list[str]] = {}
    for locator, path, digest in read:
        if path not in now:
            file = join(folder, path)
            now[path] = content(file, _state(file)) or UNKNOWN
        if digest == UNKNOWN or digest not in (WRITTEN, now[path]):
            differing.setdefault(locator, []).append(path)
    return differing
