"""Insides of numba that this package borrows, which are not part of numba's interface. Tried with
numba 0.68.

- `as_part`: rules are compiled as parts of their loops alone. The loops of the paper's evaluation
  take 50 s of processor time instead of 64 s, once on a machine. Other versions of numba do
  without, to the same bits.
- `kept_code`: machine code is kept in one sealed file for each loop. numba's own index mixes kinds
  of arguments up where two processes write at once, and trusts damaged files.

SUMO_EVAL_PLAIN=1 leaves both out.
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

_KNOWN = "0.68."
"""Versions of numba of which `as_part` knows the insides."""

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


@functools.cache
def as_part() -> dict[str, Any]:
    """How numba is to compile a rule: as a part of the loops that call it, and nothing else; empty:
    as it likes.

    By itself numba makes every function machine code of its own, optimised, and then once more
    within each that calls it. A rule is only ever called by rules and loops, so it is enough to
    optimise it, and make machine code of it, as a part of a loop: a third of the time of compiling
    everything. That is not part of numba's interface, so versions whose insides are not known here
    do as they like.
    """
    numba = importlib.import_module("numba")
    if not numba.__version__.startswith(_KNOWN):
        return {}
    codegen, compiler, passes = (
        importlib.import_module(f"numba.core.{name}")
        for name in ("codegen", "compiler", "typed_passes")
    )
    make_function = importlib.import_module("numba._dynfunc").make_function

    class Part(codegen.JITCodeLibrary):  # type: ignore[name-defined,misc]
        """The code of a rule and of those that it calls, to be linked into others and not to be
        run.
        """

        def _optimize_functions(self, module: Any) -> None:
            module.data_layout = self._codegen._data_layout

        def finalize(self) -> None:
            for library in dict.fromkeys(self._linking_libraries):
                self._reload_init.update(library._reload_init)
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
            self._finalized = True

    class LowerPart(passes.NativeLowering):  # type: ignore[name-defined,misc]
        """Lower a rule to a `Part`, for which there is no function that Python could call."""

        _name = "sumo_eval_lower_part"

        def run_pass(self, state: Any) -> bool:
            state.library = Part(state.targetctx.codegen(), state.func_id.func_qualname)
            state.flags.no_compile = True
            super().run_pass(state)
            made = state["cr"]
            name = made.fndesc.qualname.split(".")[-1]
            stands_for = make_function(
                made.fndesc.lookup_module(), name, "", 0, made.env, (state.library,)
            )
            state.targetctx.insert_user_function(stands_for, made.fndesc, [state.library])
            state.library._ensure_finalized()
            state.reload_init.extend(state.library._reload_init)
            state["cr"] = made._replace(cfunc=stands_for)
            return True

    importlib.import_module("numba.core.compiler_machinery").register_pass(
        mutates_CFG=True, analysis_only=False
    )(LowerPart)

    class PartCompiler(compiler.CompilerBase):  # type: ignore[name-defined,misc]
        """numba's own way, with the last step replaced."""

        def define_pipelines(self) -> list[Any]:
            usual = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
            usual.passes = [
                (LowerPart if step is passes.NativeLowering else step, what)
                for step, what in usual.passes
            ]
            usual.finalize()
            return [usual]

    return {"pipeline_class": PartCompiler}
