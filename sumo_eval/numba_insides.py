"""Machine code of numba's, kept in one sealed file for each loop: numba's own index mixes kinds of
arguments up where two processes write at once, and trusts damaged files.

This borrows insides of numba that are not part of its interface, tried with numba 0.68.
SUMO_EVAL_PLAIN=1 leaves them out.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sumo_eval import kernels
from sumo_eval.input_file import read_input

_SEAL = 32  # bytes before machine code that is kept: the SHA-256 of the rest


@functools.cache
def kept_code() -> Any:
    """numba's way to keep code, with one sealed file for each loop and kind of arguments."""
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
                whole = content[:_SEAL] == _seal(content)
                # as numba does
                if not whole:
                    return None
                return rebuilt(target, *pickle.loads(content[_SEAL:]))  # noqa: S301
            except Exception:  # noqa: BLE001 - whatever a file of another make holds
                return None

        def save_overload(self, signature: Any, result: Any) -> None:
            """Keep it, if it can be kept."""
            if result.library.has_dynamic_globals:
                return
            content = bytes(_SEAL) + caching.dumps(result._reduce())
            with contextlib.suppress(OSError):
                path = self._path(signature, result.codegen)
                path.parent.mkdir(parents=True, exist_ok=True)
                with caching.IndexDataCacheFile._open_for_write(self, path) as file:
                    file.write(_seal(content) + content[_SEAL:])

        def _path(self, signature: Any, codegen: Any) -> Path:
            source = Path(self._py_func.__code__.co_filename)
            key = caching.Cache._index_key(self, signature, codegen)
            digest = hashlib.sha256(repr((str(source), source.read_bytes(), key)).encode())
            return kernels.cache_folder() / f"{self._py_func.__name__}.{digest.hexdigest()[:24]}"

    return KeptCode


def _seal(content: bytes) -> bytes:
    """Header of machine code on disk, which reveals damage."""
    return hashlib.sha256(content[_SEAL:]).digest()
