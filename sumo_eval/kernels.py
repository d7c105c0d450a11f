"""Rules of driving as machine code: the only file that knows numba, except `method/field_loops.py`.

A rule is written once, for one vehicle, as a plain function of records and floats (`@kernel`). A
short loop calls the rule for every row of structured arrays (`@rows`). A case alone is one row of
the same loop, so the bits of a case do not depend on the number of cases in its batch.

With SUMO_EVAL_INTERPRETED=1 in the environment every loop runs as plain Python, line by line, for a
debugger: the same bits, fifty times slower. Machine code and plain Python agree as long as kernels
follow the rules in tests/test_kernels.py: no integer powers, no `** 2.0`, no `math.hypot`,
`remainder` or `fmod`.

Free to change: where and how machine code is kept. An edit of any file in `_ROOMS` makes numba
compile all loops again.

Users: `ads/`, `cosim/`, `drivers/`, `method/`, `record/`, `scenario/`.
"""

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
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from sumo_eval.input_file import read_input

Function = TypeVar("Function", bound=Callable[..., Any])

INTERPRETED = os.environ.get("SUMO_EVAL_INTERPRETED", "") not in ("", "0")
PLAIN = os.environ.get("SUMO_EVAL_PLAIN", "") not in ("", "0")
"""Whether `kept_code`, `cosim/sumo/insides.py` and `record/children.py` do without internals of
libraries. `_name_code_apart` always uses one of numba's: without it wrong code may run."""
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
"""Files and folders of this package that hold kernels, or constants compiled into kernels."""

_SEAL = 32  # bytes at the beginning of a file of machine code: the SHA-256 of the rest
_unregistered: list[Callable[..., Any]] = []
"""Kernels that numba does not know yet: they were defined before it was loaded."""

Records = NDArray[Any]
"""A structured array. Define each layout in one place: numba compiles kernels again for each
layout."""
Layout = list[tuple[str, Any]]
"""Name and type of each field of a record."""


def fields(*names: str) -> Layout:
    """Layout of fields that are floats."""
    return [(name, "f8") for name in names]


def flags(*names: str) -> Layout:
    """Layout of fields that are whole numbers: counts, codes, or 0 and 1."""
    return [(name, "i8") for name in names]


def kernel(function: Function) -> Function:
    """Mark a rule, or a part of a rule: plain Python when Python calls it, machine code when a loop
    over rows calls it.
    """
    if "numba" in sys.modules and not INTERPRETED:
        _register(function)
    else:
        _unregistered.append(function)
    return function


def rows(function: Function) -> Function:
    """Mark a loop over rows of structured arrays: compiled at its first call, and kept on disk for
    the next process.

    Call it with arrays of the same types each time: numba compiles it again for other types.
    """
    return cast("Function", _interpreted(function) if INTERPRETED else Loop(function))


class Loop:
    """A loop over rows that loads numba, and then its machine code, when it is first called."""

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)  # sets `__wrapped__`
        self.codes: dict[tuple[Any, ...], Callable[..., Any]] = {}  # by `_kind_of` each argument

    @functools.cached_property
    def compiled(self) -> Any:
        """The loop as a dispatcher of numba, which compiles for each new type of arguments."""
        dispatcher_of = _numba().njit(error_model="numpy", no_cfunc_wrapper=True)
        return keep_code(dispatcher_of(self.__wrapped__))  # type: ignore[attr-defined]

    def __call__(self, *arguments: Any) -> Any:
        """Run the loop."""
        return self.compiled(*arguments)

    def code_for(self, *arguments: Any) -> Callable[..., Any]:
        """The machine code for arguments of these types.

        It does not check its arguments: other types give garbage or a crash.
        """
        kinds = tuple(map(_kind_of, arguments))
        code = self.codes.get(kinds)
        if code is None:
            # numba takes 20 ms to find the type of an array of records
            types = tuple(map(self.compiled.typeof_pyval, arguments))
            code = self.codes[kinds] = self.compiled.compile(types)
        return code


def _kind_of(argument: Any) -> Any:
    """Type of an argument as a key: of an array also its layout, of a named tuple its items'."""
    if isinstance(argument, tuple):
        return type(argument), tuple(map(_kind_of, argument))
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    return type(argument)


def interpreted(loop: Function) -> Function:
    """A loop over rows as plain Python, to the same bits: for a few rows, which take less time than
    loading numba.
    """
    if not isinstance(loop, Loop):
        return loop
    return cast("Function", _interpreted(loop.__wrapped__))  # type: ignore[attr-defined]


def bound(loop: Function, *arguments: Any) -> Function:
    """A loop over rows whose call takes a third of the time, for callers at every step.

    Its calls must have arguments of the types and layouts of `arguments`: it does not check them.
    """
    return cast("Function", loop.code_for(*arguments)) if isinstance(loop, Loop) else loop


def keep_code(loop: Any) -> Any:
    """Make a dispatcher of numba keep its machine code in `cache_folder`, and return it."""
    _name_code_apart()
    if PLAIN:
        # `__dict__`: mypy knows no such attribute of a module
        importlib.import_module("numba.core.config").__dict__["CACHE_DIR"] = str(cache_folder())
        loop.enable_caching()
    else:
        loop._cache = kept_code()(loop.py_func)
    return loop


@functools.cache
def _name_code_apart() -> None:
    """Give machine code that this process compiles names that no other process gives.

    numba makes a name of the function's name, a count of functions and the types. Its counts begin
    at 1 in each process. So two rules that `each_row` has made, compiled by two processes, may have
    one name, and a process that loads both would run the first for the second. Here counts begin
    at random, also after a fork.
    """
    functions = importlib.import_module("numba.core.bytecode").FunctionIdentity

    def begin_count() -> None:
        functions._unique_ids = itertools.count(int.from_bytes(os.urandom(6)))

    begin_count()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=begin_count)


@functools.cache
def kept_code() -> Any:
    """The class of numba caches that keep one sealed file for each loop and types of arguments.

    numba's own cache has one index file a loop. If two processes write it at once, it may name the
    wrong code. numba's cache also trusts damaged files.

    Uses internals of numba, tested with numba 0.68; SUMO_EVAL_PLAIN=1 avoids them.
    """
    caching = importlib.import_module("numba.core.caching")
    rebuilt = importlib.import_module("numba.core.compiler").CompileResult._rebuild

    class KeptCode(caching.NullCache):  # type: ignore[name-defined,misc]
        """Cache of one loop. Where a file is missing, damaged or not writable, numba compiles."""

        def __init__(self, function: Callable[..., Any]) -> None:
            self._py_func = function  # numba's `_index_key` reads it

        def load_overload(self, signature: Any, target: Any) -> Any:
            """Load the code for arguments of these types; None: numba has to compile it."""
            # all that machine code needs to run; numba's own cache also loads the compiler, 0.5 s
            importlib.import_module("numba.core.runtime").rtsys.initialize(target)
            try:
                content = read_input(self._path(signature, target.codegen()), "machine code")
                seal, code = content[:_SEAL], content[_SEAL:]
                if seal == hashlib.sha256(code).digest():
                    # numba's own cache unpickles its files as well
                    return rebuilt(target, *pickle.loads(code))  # noqa: S301
            except Exception:  # noqa: BLE001 - most often there is no such file yet
                return None
            return None

        def save_overload(self, signature: Any, result: Any) -> None:
            """Write code that numba has compiled, unless it holds addresses of this process."""
            if result.library.has_dynamic_globals:
                return
            code = caching.dumps(result._reduce())
            with contextlib.suppress(OSError):
                path = self._path(signature, result.codegen)
                path.parent.mkdir(parents=True, exist_ok=True)
                # writes another file and renames it; numba's method does not use its `self`
                with caching.IndexDataCacheFile._open_for_write(self, path) as file:
                    file.write(hashlib.sha256(code).digest() + code)

        def _path(self, signature: Any, codegen: Any) -> Path:
            """File of the code for these types and this processor."""
            source = Path(self._py_func.__code__.co_filename)
            key = caching.Cache._index_key(self, signature, codegen)
            digest = hashlib.sha256(repr((str(source), source.read_bytes(), key)).encode())
            return cache_folder() / f"{self._py_func.__name__}.{digest.hexdigest()[:24]}"

    return KeptCode


def _numba() -> Any:
    """Load numba and make all kernels known to it."""
    # sines and powers of Intel's SVML library differ from plain Python's in their last bits
    os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")
    numba = importlib.import_module("numba")
    while _unregistered:
        _register(_unregistered.pop())
    return numba


def _register(function: Callable[..., Any]) -> None:
    """Let loops that numba compiles call a kernel."""
    register = importlib.import_module("numba.extending").register_jitable
    register(error_model="numpy", no_cfunc_wrapper=True)(function)


@functools.cache
def cache_folder() -> Path:
    """Folder of machine code: one for each place of this package, processor, versions of Python and
    numba, and content of the files in `_ROOMS`.

    numba itself watches only the file of the loop: an edit of a kernel in another file would not
    make it compile the loop again.
    """
    digest = hashlib.sha256(bytes(_PACKAGE))
    platform_versions = _processor(), sys.version, importlib.metadata.version("numba")
    digest.update(repr(platform_versions).encode())
    for path in _files_of_rooms():
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    users_folder = os.environ.get("NUMBA_CACHE_DIR")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(users_folder or caches) / "sumo_eval" / "kernels" / digest.hexdigest()[:16]


def _files_of_rooms() -> Iterator[Path]:
    """The files in `_ROOMS`."""
    for room in _ROOMS:
        folder = _PACKAGE / room
        yield from sorted(folder.rglob("*.py")) if folder.is_dir() else [folder]


def _processor() -> str:
    """Name and abilities of the processor: machines may share one cache folder."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as lines:
        first_core = itertools.takewhile(str.strip, lines)  # an empty line ends each core
        return "".join(
            line
            for line in first_core
            if line.startswith(("model name", "flags", "CPU part", "Features"))
        )
    return platform.processor()


# -- interpreted -----------------------------------------------------------------------------------


def _interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    """A loop over rows in plain Python, which is quick on objects but slow on structured arrays.

    So the call works on arrays of objects, one for each record, and its end copies their values
    back into the structured arrays.
    """

    @functools.wraps(function)
    def loop(*arguments: Any) -> Any:
        object_arrays = [_as_objects(argument) for argument in arguments]
        result = function(*object_arrays)
        _write_back(arguments, object_arrays)
        return result

    return loop


def _write_back(arguments: Sequence[Any], object_arrays: Sequence[Any]) -> None:
    """Fill structured arrays from the objects that `_as_objects` made of them."""
    for argument, objects in zip(arguments, object_arrays, strict=True):
        if isinstance(argument, tuple):
            _write_back(argument, objects)
        elif objects is not argument:
            values = list(map(_values, objects.flat))
            argument[...] = np.array(values, argument.dtype).reshape(argument.shape)


def _as_objects(argument: Any) -> Any:
    """A structured array as an array of objects; a named tuple of arrays as one of such arrays; any
    other argument as it is.
    """
    if isinstance(argument, tuple):
        return type(argument)(*map(_as_objects, argument))
    if not isinstance(argument, np.ndarray) or argument.dtype.names is None:
        return argument
    objects = np.empty(argument.size, object)
    objects[:] = [_record(values, argument.dtype) for values in argument.ravel().tolist()]
    return objects.reshape(argument.shape)


def _record(values: tuple[Any, ...], dtype: np.dtype[Any]) -> SimpleNamespace:
    """An object with an attribute for each field; a nested record becomes an object too."""
    fields_of = {
        name: _record(value, dtype[name]) if isinstance(value, tuple) else value
        for name, value in zip(dtype.names or (), values, strict=True)
    }
    return SimpleNamespace(**fields_of)


def _values(record: SimpleNamespace) -> tuple[Any, ...]:
    """The values of an object that `_record` made, as numpy fills a record from them."""
    return tuple(
        _values(value) if isinstance(value, SimpleNamespace) else value
        for value in vars(record).values()
    )


# -- before the first case -------------------------------------------------------------------------


def warm(scripts: Sequence[str]) -> None:
    """Run scripts that compile loops, each in a child process, all at the same time, and wait.

    scripts: Python code. This process then finds their machine code on disk.

    Threads would not help: numba compiles under the interpreter's lock. The children import from
    where this process does, and not from the current folder (-P): that may hold another copy of
    this package, or files with names of modules.
    """
    preamble = f"import sys; sys.path[:] = {sys.path!r}\n"
    # compiling makes little garbage: without the search for garbage it takes a tenth less time
    preamble += "import gc; gc.disable()\n"
    children = [
        subprocess.Popen([sys.executable, "-P", "-c", preamble + script]) for script in scripts
    ]
    try:
        for child in children:
            child.wait()
    finally:  # after Ctrl-C no child keeps running
        for child in children:
            child.kill()
            child.wait()
