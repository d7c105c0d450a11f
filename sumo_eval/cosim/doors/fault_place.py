"""Place in the user's code that an exception came from, kept in a recording beside the error
message.
"""

from __future__ import annotations

import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path
from types import FrameType, FunctionType
from typing import Any

from sumo_eval.text import clean

_OURS = f"{Path(__file__).resolve().parents[2]}/"
_INSTALLED = tuple(
    f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")
)


def fault_place(error: BaseException | None, driver: Any, folder: Path | None) -> str:
    """`my_ads.py:42 in act`: file, line and function of the user's code that an exception passed
    last.

    That is the innermost frame in the file of the user's object `driver`, else the innermost in a
    file that is neither this package's nor an installed library's, else the innermost outside this
    package, else nothing. The frames are the exception's own, or those of the one that it was
    raised from. Paths within `folder` are relative to it. Of an exception that passed none,
    because what the user's code returned is refused, it is where that function is.
    """
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        frames = [(code.co_filename, line, code.co_name) for code, line in _frames(error)]
        outside = [one for one in frames if not one[0].startswith(_OURS)]
        users = [one for one in outside if not one[0].startswith((*_INSTALLED, "<frozen "))]
        own = _file_of(driver)
        for found in ([one for one in frames if one[0] == own], users, outside):
            if found:
                file, line, function = found[-1]
                return clean(f"{_short(file, folder)}:{line} in {function}")
        error = error.__cause__ or error.__context__
    return _asked_at(driver, folder)


def _asked_at(driver: Any, folder: Path | None) -> str:
    """Place where the user's function or method begins whose result cannot be used; "" if it is not
    Python code.
    """
    methods = (getattr(type(driver), name, None) for name in ("act", "step"))
    code = next((one.__code__ for one in (driver, *methods) if isinstance(one, FunctionType)), None)
    if code is None or code.co_filename.startswith(_OURS):
        return ""
    return clean(f"{_short(code.co_filename, folder)}:{code.co_firstlineno} in {code.co_name}")


def _frames(error: BaseException) -> Iterator[tuple[Any, int]]:
    """Code and line of every frame that an exception passed, the outermost first."""
    at = error.__traceback__
    while at is not None:
        frame: FrameType = at.tb_frame
        yield frame.f_code, at.tb_lineno
        at = at.tb_next


def _file_of(driver: Any) -> str | None:
    """The file that a user's function, or the class of a user's object, is written in."""
    try:
        code = getattr(driver, "__code__", None)
        if code is not None:
            return str(code.co_filename)
        module = sys.modules.get(type(driver).__module__)
        return (
            None
            if module is None or module.__file__ is None
            else str(Path(module.__file__).resolve())
        )
    except Exception:  # noqa: BLE001 - attributes of a user's object are the user's code
        return None


def _short(file: str, folder: Path | None) -> str:
    try:
        return str(Path(file).relative_to((folder or Path.cwd()).resolve()))
    except (ValueError, OSError):
        return file
