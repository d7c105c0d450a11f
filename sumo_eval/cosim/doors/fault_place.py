"""Place in the user's code that an exception came from, kept in a recording beside the error
message.
"""

from __future__ import annotations

import inspect
import sysconfig
from contextlib import suppress
from pathlib import Path
from traceback import walk_tb
from types import CodeType, FunctionType
from typing import Any

from sumo_eval.errors import ControllerError
from sumo_eval.text import clean

_OURS = f"{Path(__file__).resolve().parents[2]}/"
_INSTALLED = (
    "<frozen ",
    *(f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")),
)


def fault_place(error: BaseException | None, driver: Any, folder: Path | None) -> str:
    """`my_ads.py:42 in act`: file, line and function of the user's code that an exception passed
    last.

    The innermost frame of the first kind that exists, in the exception, else in its cause: in the
    file of the user's object `driver`; in a file that is neither this package's nor an installed
    library's; outside this package (unless a door has put the error in words). Without one, as the
    user's code returned a refused value, where that function begins; "" if it is not Python code.
    Paths within `folder` are relative to it.
    """
    seen = set()
    own = _file_of(driver)
    worded = type(error) is ControllerError  # by a door, even if its library raised the cause
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        frames = [(frame.f_code, line) for frame, line in walk_tb(error.__traceback__)]
        outside = [it for it in frames if not it[0].co_filename.startswith(_OURS)]
        users = [it for it in outside if not it[0].co_filename.startswith(_INSTALLED)]
        owned = [it for it in frames if it[0].co_filename == own]
        for candidates in (owned, users, () if worded else outside):
            if candidates:
                return _place(*candidates[-1], folder)
        error = error.__cause__ or error.__context__
    return _asked_at(driver, folder)


def _asked_at(driver: Any, folder: Path | None) -> str:
    """Place where the user's function or method begins whose result cannot be used; "" if it is not
    Python code.
    """
    methods = (getattr(type(driver), name, None) for name in ("act", "step"))
    code = next((it.__code__ for it in (driver, *methods) if isinstance(it, FunctionType)), None)
    if code is None or code.co_filename.startswith(_OURS):
        return ""
    return _place(code, code.co_firstlineno, folder)


def _file_of(driver: Any) -> str | None:
    """The file that a user's function, or the class of a user's object, is written in."""
    try:
        if inspect.isroutine(driver):
            return inspect.getfile(driver)
        return str(Path(inspect.getfile(type(driver))).resolve())
    except Exception:  # noqa: BLE001 - attributes of a user's object are the user's code
        return None


def _place(code: CodeType, line: int, folder: Path | None) -> str:
    """File, line and function; a path within `folder` is relative to it."""
    file = code.co_filename
    with suppress(ValueError, OSError):
        file = str(Path(file).relative_to((folder or Path.cwd()).resolve()))
    return clean(f"{file}:{line} in {code.co_name}")
