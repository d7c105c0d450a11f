"""Files of a user: looked at before they are opened; what cannot be read or written is refused in
one sentence.

Users: `cli/`, `cosim/`, `drivers/`, `kernels.py`, `nightly/`, `record/`, `report/`, `scenario/`,
`settings/`, `extras/`.
"""

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sumo_eval.errors import InputError, nearest, said
from sumo_eval.text import capitalised, clean, words_of

MANIFEST = "manifest.json"
"""The file by which a folder is known as a run's."""
LARGEST = 500_000_000
"""Bytes of a file that is read as a whole; recordings are streamed and may be of any size."""

_KINDS = {
    stat.S_IFIFO: "named pipe", stat.S_IFCHR: "character device", stat.S_IFBLK: "block device",
    stat.S_IFSOCK: "socket"
}  # fmt: skip


def changed_at(path: Path) -> int:
    """Time of a file's or folder's last change, ns; -1 where there is none to see."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return -1


def input_file(path: Path, what: str) -> Path:
    """The path, refused unless it leads to a regular file; nothing is opened, because opening a
    pipe may wait for ever.

    what: names the file in sentences, `evaluation file`.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        raise InputError(f"There is no {clean(f'{what} {path}')}.{_nearest(path)}") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL byte in the path
        raise _unreadable(path, what, error) from error

    if stat.S_ISDIR(mode):
        raise InputError(f"{named(path, what)} cannot be read: it is a folder.")
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "special file")
        raise InputError(f"{named(path, what)} must be a regular file, got a {kind}.")
    return path


def read_input(path: Path, what: str, largest: int = LARGEST) -> bytes:
    """The content of a regular file of at most `largest` bytes.

    what: as in `input_file`.
    """
    try:
        with input_file(path, what).open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise _unreadable(path, what, error) from error
    if len(content) > largest:
        raise InputError(f"{named(path, what)} must be at most {largest / 1e6:g} MB.")
    return content


def read_input_text(path: Path, what: str, largest: int = LARGEST) -> str:
    """The text of a regular file in UTF-8.

    what, largest: as in `read_input`.
    """
    try:
        # some editors put a mark before the text
        return read_input(path, what, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{_unreadable(path, what, error)} Save it as UTF-8.") from error


NO_WORKING_FOLDER = "The working folder must exist, but it was deleted: change to another folder."


def working_folder() -> Path:
    """The working folder, in which child processes start and relative paths begin.

    Raises InputError if it was deleted.
    """
    try:
        return Path.cwd()
    except FileNotFoundError:
        raise InputError(NO_WORKING_FOLDER) from None


@contextmanager
def writing(what: str, folder: Path | None = None) -> Iterator[None]:
    """A block that writes files. Where the system refuses that, it raises InputError.

    what: begins the sentence, `The case in out` for example.
    folder: made before the block.
    """
    try:
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise InputError(f"{what} cannot be written: {error}.") from error


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A block that writes a file under the path that it receives. The file then takes the place of
    the one at `path`, which an error, or a kill, leaves as it was.
    """
    target = path.resolve()  # a link stays a link
    if (path.parent / MANIFEST).exists() and target.parent != path.parent.resolve():
        raise InputError(
            f"{path} must not be a link out of its run's folder, which may be someone else's, got "
            f"one to {target}. Remove the link, or name another file to write."
        )
    if path.exists() and not path.is_file():  # a pipe: /dev/stdout resolves to no file
        yield path
        return
    path = target
    # named by process, as another one may write the same file
    half = path.with_name(f"{path.name}.{os.getpid()}.half")
    try:
        yield half
        half.replace(path)
    finally:
        half.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write the whole file, or leave it as it was."""
    with whole(path) as half:
        half.write_text(text, "utf-8")


@contextmanager
def taking_apart(path: Path, fix: str) -> Iterator[None]:
    """A block that parses a file written by this package. It raises InputError if the file was
    edited or cut off.

    fix: last sentence of the error message.
    """
    try:
        yield
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} cannot be read or is damaged ({said(error)}). {fix}") from error


def sha256(content: str | bytes) -> str:
    """SHA-256 of a text or of bytes, in hexadecimal."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def hash_of(path: Path, what: str) -> str:
    """SHA-256 of a regular file of any size, in hexadecimal.

    what: as in `input_file`.
    """
    try:
        with input_file(path, what).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise _unreadable(path, what, error) from error


def _nearest(path: Path) -> str:
    """A sentence that names the nearest file of the same folder and ending; "" without one."""
    try:
        stems = sorted(it.stem for it in path.parent.iterdir() if it.suffix == path.suffix)
    except OSError:
        return ""
    near = nearest(path.stem, stems)
    return (
        "" if near is None else f" Did you mean `{clean(str(path.with_name(near + path.suffix)))}`?"
    )


def named(path: Path, what: str) -> str:
    """`Evaluation file a.toml`: the beginning of a sentence about a file."""
    return capitalised(clean(f"{what} {path}"))


def _unreadable(path: Path, what: str, error: Exception) -> InputError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else words_of(error)
    return InputError(f"{named(path, what)} cannot be read: {reason}.")
