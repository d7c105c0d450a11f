"""Place in the user's code that an exception came from, kept in a recording beside the error
message.

Users: `cosim/world.py`, `record/apart.py`, `record/worker.py`.
"""

import inspect
import sysconfig
from contextlib import suppress
from pathlib import Path
from traceback import walk_tb
from types import CodeType, FunctionType
from typing import Any

from sumo_eval.errors import ControllerError
from sumo_eval.text import clean

_OURS = f"{Path(__file__).parents[2]}/"
_INSTALLED = (
    "<frozen ",
    *(f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")),
)


def fault_place(error: BaseException | None, controller: Any, folder: Path | None) -> str:
    """`my_ads.py:42 in act`: file, line and function in the user's code that an exception comes
    from.

    Of these groups of frames, the first that is not empty gives its innermost frame. The exception
    is searched first, then its cause, and so on.

    1. frames in the file of the user's object `controller`
    2. frames outside this package and installed libraries
    3. frames outside this package; not for an error message that a door raised

    Without such a frame, as where a call or a result was at fault: the start of the user's
    function; "" if it is not Python code. Paths within `folder` are relative to it.
    """
    seen = set()
    methods = ["act", "step"]
    own = _file_of(controller)
    by_door = type(error) is ControllerError  # the libraries of a door are not the user's
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        frames = [(frame.f_code, line) for frame, line in walk_tb(error.__traceback__)]
        methods = [it.co_name for it, _ in frames if it.co_name in ("reset", "close")] + methods
        outside = [it for it in frames if not it[0].co_filename.startswith(_OURS)]
        users = [it for it in outside if not it[0].co_filename.startswith(_INSTALLED)]
        owned = [it for it in frames if it[0].co_filename == own]
        for candidates in (owned, users, () if by_door else outside):
            if candidates:
                return _place(*candidates[-1], folder)
        error = error.__cause__ or error.__context__
    return _function_start(controller, methods, folder)


def _function_start(controller: Any, methods: list[str], folder: Path | None) -> str:
    """Place where the user's function, or the first of the methods that exist, begins; "" if it is
    not Python code.
    """
    candidates = (controller, *(getattr(type(controller), name, None) for name in methods))
    code = next((it.__code__ for it in candidates if isinstance(it, FunctionType)), None)
    if code is None or code.co_filename.startswith(_OURS):
        return ""
    return _place(code, code.co_firstlineno, folder)


def _file_of(controller: Any) -> str | None:
    """The file that a user's function, or the class of a user's object, is written in."""
    try:
        return inspect.getfile(controller if inspect.isroutine(controller) else type(controller))
    except Exception:  # noqa: BLE001 - attributes of a user's object are the user's code
        return None


def _place(code: CodeType, line: int, folder: Path | None) -> str:
    """File, line and function; a path within `folder` is relative to it."""
    file = Path(code.co_filename)
    with suppress(ValueError, OSError):
        # resolve symbolic links on both sides: either path may be named through a link
        file = (file.parent.resolve() / file.name).relative_to((folder or Path.cwd()).resolve())
    return clean(f"{file}:{line} in {code.co_name}")
