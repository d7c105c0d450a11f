"""Rules of driving as machine code: the only file that knows numba, as far as driving goes.

A rule is written once, for one vehicle, as a plain function of records and floats (`@kernel`), and
a short loop calls it for every row of structured arrays (`@rows`). One case is a row count of 1, so
the bits of a case do not depend on the number of cases in its batch.

With SUMO_EVAL_INTERPRETED=1 in the environment every loop runs as plain Python, line by line, for a
debugger: the same bits, fifty times slower. tests/test_kernels.py holds the rules that make both
agree: no integer powers, no `** 2.0`, no `math.hypot`, `remainder` or `fmod` in a kernel.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import importlib.metadata
import itertools
import os
import pickle
import platform
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar, cast

import numpy as np

from sumo_eval.input_file import read_input

Function = TypeVar("Function", bound=Callable[..., Any])

INTERPRETED = os.environ.get("SUMO_EVAL_INTERPRETED", "") not in ("", "0")
PLAIN = os.environ.get("SUMO_EVAL_PLAIN", "") not in ("", "0")
"""Whether the insides that `kept_code` and `record/children.py` borrow are left out."""
_PACKAGE = Path(__file__).parent
_ROOMS = (
    "kernels.py",
    "trajectory.py",
    "settings",
    "scenario",
    "cosim",
    "ads",
    "drivers",
    "method/field_loops.py",
)
"""Where kernels and the constants that are compiled into them stand."""

_SEAL = 32  # bytes before machine code on disk: the SHA-256 of the rest, which reveals damage
_unregistered: list[Callable[..., Any]] = []
"""Kernels that were marked before numba was loaded."""


def kernel(function: Function) -> Function:
    """A rule or a part of one: plain Python if called from Python, machine code within a loop of
    rows.
    """
    if "numba" in sys.modules and not INTERPRETED:
        _register(function)
    else:
        _unregistered.append(function)
    return function


def rows(function: Function) -> Function:
    """A loop over rows of structured arrays, compiled when it is first called, and kept on disk for
    the next process.

    The arrays must always have the same types: every other type compiles the loop again.
    """
    return cast("Function", _interpreted(function) if INTERPRETED else Loop(function))


class Loop:
    """A loop over rows that loads numba, and then its machine code, when it is first called."""

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        self.codes: dict[tuple[Any, ...], Callable[..., Any]] = {}

    @functools.cached_property
    def compiled(self) -> Any:
        """numba's dispatcher."""
        # set by update_wrapper
        return _compiled(self.__wrapped__)  # type: ignore[attr-defined]

    def __call__(self, *arguments: Any) -> Any:
        """The loop itself."""
        return self.compiled(*arguments)

    def code_for(self, *arguments: Any) -> Callable[..., Any]:
        """The machine code for arguments of the types that these have; it does not check them."""
        kinds = tuple(map(_kind_of, arguments))
        code = self.codes.get(kinds)
        if code is None:
            # of records it takes 20 ms, so that it is asked once a kind
            types = tuple(map(self.compiled.typeof_pyval, arguments))
            code = self.codes[kinds] = self.compiled.compile(types)
        return code


def _kind_of(argument: Any) -> Any:
    """Key of machine code: types and layout of arrays, alone or in a named tuple."""
    if isinstance(argument, tuple):
        return type(argument), tuple(map(_kind_of, argument))
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    return type(argument)


def interpreted(loop: Function) -> Function:
    """A loop over rows as plain Python, to the same bits: for a single row, which need not wait for
    numba.
    """
    wrapped = getattr(loop, "__wrapped__", loop)
    return cast("Function", _interpreted(wrapped)) if isinstance(loop, Loop) else loop


def bound(loop: Function, *arguments: Any) -> Function:
    """A loop over rows for a caller at every step: it costs a third of an ordinary call.

    Only for arrays of the same types and layout as `arguments`: they are not checked.
    """
    return cast("Function", loop.code_for(*arguments)) if isinstance(loop, Loop) else loop


def _compiled(function: Callable[..., Any]) -> Any:
    numba = _numba()
    return keep_code(numba.njit(error_model="numpy", no_cfunc_wrapper=True)(function))


def keep_code(loop: Any) -> Any:
    """A loop of numba's, whose machine code is kept on disk from now on."""
    if PLAIN:
        importlib.import_module("numba.core.config").__dict__["CACHE_DIR"] = str(cache_folder())
        loop.enable_caching()
    else:
        loop._cache = kept_code()(loop.py_func)
    return loop


@functools.cache
def kept_code() -> Any:
    """numba's way to keep code, with one sealed file for each loop and kind of arguments: its own
    index mixes kinds of arguments up where two processes write at once, and trusts damaged files.

    Borrows insides of numba that are not part of its interface, tried with numba 0.68;
    SUMO_EVAL_PLAIN=1 leaves them out.
    """
    caching = importlib.import_module("numba.core.caching")
    rebuilt = importlib.import_module("numba.core.compiler").CompileResult._rebuild

    class KeptCode(caching.NullCache):  # type: ignore[name-defined,misc]
        """The code of a loop: nothing that goes wrong with its files does more than compile it
        again.
        """

        def __init__(self, function: Callable[..., Any]) -> None:
            self._py_func = function

        def load_overload(self, signature: Any, target: Any) -> Any:
            """The code for arguments of these types, or None; without what numba imports to
            compile, 0.5 s.
            """
            importlib.import_module("numba.core.runtime").rtsys.initialize(target)
            try:
                content = read_input(self._path(signature, target.codegen()), "machine code")
                seal, code = content[:_SEAL], content[_SEAL:]
                # as numba does
                if seal == hashlib.sha256(code).digest():
                    return rebuilt(target, *pickle.loads(code))  # noqa: S301
            except Exception:  # noqa: BLE001 - whatever a file of another make holds
                return None
            return None

        def save_overload(self, signature: Any, result: Any) -> None:
            """Keep it, if it can be kept."""
            if result.library.has_dynamic_globals:
                return
            code = caching.dumps(result._reduce())
            with contextlib.suppress(OSError):
                path = self._path(signature, result.codegen)
                path.parent.mkdir(parents=True, exist_ok=True)
                with caching.IndexDataCacheFile._open_for_write(self, path) as file:
                    file.write(hashlib.sha256(code).digest() + code)

        def _path(self, signature: Any, codegen: Any) -> Path:
            source = Path(self._py_func.__code__.co_filename)
            key = caching.Cache._index_key(self, signature, codegen)
            digest = hashlib.sha256(repr((str(source), source.read_bytes(), key)).encode())
            return cache_folder() / f"{self._py_func.__name__}.{digest.hexdigest()[:24]}"

    return KeptCode


def _numba() -> Any:
    # SVML's sines and powers have other last bits
    os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")
    numba = importlib.import_module("numba")
    importlib.import_module("numba.extending")
    while _unregistered:
        _register(_unregistered.pop())
    return numba


def _register(function: Callable[..., Any]) -> None:
    register = importlib.import_module("numba.extending").register_jitable
    register(error_model="numpy", no_cfunc_wrapper=True)(function)


@functools.cache
def cache_folder() -> Path:
    """Folder of machine code: one for each processor, version of Python and of numba, state of the
    sources, and folder of theirs.

    numba itself looks at the file of the loop alone, and would keep using old code of a rule that
    another file holds.
    """
    digest = hashlib.sha256(bytes(_PACKAGE))
    made_for = _processor(), sys.version, importlib.metadata.version("numba")
    digest.update(repr(made_for).encode())
    for room in _ROOMS:
        found = _PACKAGE / room
        for path in sorted(found.rglob("*.py")) if found.is_dir() else [found]:
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    given = os.environ.get("NUMBA_CACHE_DIR")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(given or caches) / "sumo_eval" / "kernels" / digest.hexdigest()[:16]


def _processor() -> str:
    """Its name, and what it can do: one folder may serve several machines."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as lines:
        first = itertools.takewhile(str.strip, lines)
        return "".join(
            line
            for line in first
            if line.startswith(("model name", "flags", "CPU part", "Features"))
        )
    return platform.processor()


# -- interpreted -----------------------------------------------------------------------------------


def _interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    """The loop in plain Python: records become objects of plain floats, and are written back
    afterwards.
    """

    @functools.wraps(function)
    def loop(*arguments: Any) -> Any:
        opened = [_opened(argument) for argument in arguments]
        result = function(*opened)
        _write_back(arguments, opened)
        return result

    return loop


def _write_back(arguments: Sequence[Any], opened: Sequence[Any]) -> None:
    for argument, records in zip(arguments, opened, strict=True):
        if isinstance(argument, tuple):
            _write_back(argument, records)
        elif records is not argument and argument.size:
            argument[...] = _closed(records, argument.dtype)


def _opened(argument: Any) -> Any:
    if isinstance(argument, tuple):
        return type(argument)(*map(_opened, argument))
    if not isinstance(argument, np.ndarray) or argument.dtype.names is None:
        return argument
    return _records(argument.tolist(), argument.dtype, argument.ndim)


def _records(values: Any, dtype: np.dtype[Any], depth: int) -> Any:
    if depth:
        return [_records(value, dtype, depth - 1) for value in values]
    found = SimpleNamespace()
    for name, value in zip(dtype.names or (), values, strict=True):
        inner = dtype[name]
        setattr(found, name, value if inner.names is None else _records(value, inner, 0))
    return found


def _closed(records: Any, dtype: np.dtype[Any]) -> Any:
    if isinstance(records, list):
        return [_closed(record, dtype) for record in records]
    values = []
    for name in dtype.names or ():
        inner, value = dtype[name], getattr(records, name)
        values.append(value if inner.names is None else _closed(value, inner))
    return tuple(values)


# -- before the first case -------------------------------------------------------------------------


def warm(scripts: Sequence[str]) -> None:
    """Compile in child processes, one for each script, all at the same time, and wait; what they
    compile is on disk.

    scripts: Python to run. A thread would be no help: numba compiles under the interpreter's lock.
        The children look for modules where this process does, and not in the folder in which it was
        started (-P): that may hold another copy of this package, or files that are called as
        modules are.
    """
    begin = f"import sys; sys.path[:] = {sys.path!r}\n"
    # compiling makes many objects and little garbage; a tenth of its time
    begin += "import gc; gc.disable()\n"
    children = [
        subprocess.Popen([sys.executable, "-P", "-c", begin + script]) for script in scripts
    ]
    try:
        for child in children:
            child.wait()
    finally:  # after Ctrl-C none goes on behind the back of who pressed it
        for child in children:
            child.kill()
            child.wait()
