"""Common parts of importers: the files of a folder, and readable errors of XML."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lxml import etree

from sumo_eval.errors import InputError


def files_in(path: Path, *patterns: str) -> list[Path]:
    """The file itself, or all files of a folder that match a pattern, sorted: at least one."""
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
    """Raise InputError for a file that cannot be read, or for the line where it is damaged."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path} cannot be read: {str(error).rstrip('.')}.") from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path} is not well-formed XML: {str(error.msg).rstrip('.')}.") from error
