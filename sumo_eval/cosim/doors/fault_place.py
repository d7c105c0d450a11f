"""The place in the user's code from which an exception came; a recording keeps it beside the error
message.

Users: `cosim/world.py`, `record/apart.py`, `record/worker.py`.
"""

import inspect
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from traceback import walk_tb
from types import CodeType, FunctionType
from typing import Any

from sumo_eval.errors import ControllerError
from sumo_eval.text import clean

_OURS = f"{Path(__file__).parents[2]}/"  # this package
# beginnings of the files of Python's library and of installed packages
_INSTALLED = (
    "<frozen ",
    *(f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")),
)


_Frame = tuple[CodeType, int]  # code, line


def fault_place(error: BaseException | None, controller: Any, folder: Path | None) -> str:
    """`my_ads.py:42 in act`: file, line and function in the user's code that an exception comes
    from.

    The place is that of a frame of the exception (`_frame_at_fault`), else of its cause, and so on.
    Without such a frame, as where a call or a result was at fault, it is the start of the user's
    function; "" if the controller is not Python code.

    controller: the user's object or function.
    folder: paths within it are relative to it; None: the working directory.
    """
    methods = ["act", "step", "__call__"]
    own_file = _file_of(controller)
    by_door = type(error) is ControllerError  # the libraries of a door are not the user's
    for each in _with_causes(error):
        frames = [(frame.f_code, line) for frame, line in walk_tb(each.__traceback__)]
        methods = [it.co_name for it, _ in frames if it.co_name in ("reset", "close")] + methods
        if frame := _frame_at_fault(frames, own_file, by_door):
            return _place(*frame, folder)
    return _function_start(controller, methods, folder)


def _with_causes(error: BaseException | None) -> Iterator[BaseException]:
    """An exception, then its cause, and so on, each once."""
    seen = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__


def _frame_at_fault(frames: list[_Frame], own_file: str | None, by_door: bool) -> _Frame | None:
    """The innermost frame of the first of these groups that is not empty; None: all are empty.

    1. frames in `own_file`
    2. frames outside this package and installed libraries
    3. frames outside this package; not for an error message that a door raised
    """
    outside = [it for it in frames if not it[0].co_filename.startswith(_OURS)]
    users = [it for it in outside if not it[0].co_filename.startswith(_INSTALLED)]
    own = [it for it in frames if it[0].co_filename == own_file]
    groups = (own, users, [] if by_door else outside)
    return next((group[-1] for group in groups if group), None)


def _function_start(controller: Any, methods: list[str], folder: Path | None) -> str:
    """Place where the user's function begins, or the first of these methods that its object has; ""
    if that is not Python code.
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
