"""Common parts of importers: the files of a folder, and readable errors of XML."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lxml import etree

from sumo_eval.errors import InputError


def files_in(path: Path, *patterns: str) -> list[Path]:
    """The file itself, or the files of a folder that match, by name; there must be one."""
    if not path.exists():
        raise InputError(f"There is no file or folder {path}.")
    if not path.is_dir():
        return [path]
    files = sorted({file for pattern in patterns for file in path.glob(pattern)})
    if not files:
        raise InputError(f"Folder {path} must hold files called {', '.join(patterns)}, got none.")
    return files


@contextmanager
def reading_xml(path: Path) -> Iterator[None]:
    """Report a file that cannot be read, or is damaged, with its line."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path} cannot be read: {str(error).rstrip('.')}.") from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path} is not well-formed XML: {str(error.msg).rstrip('.')}.") from error
