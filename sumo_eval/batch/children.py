"""How child processes are made: fresh ones with the simulator loaded, which never run the user's script again."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import BaseContext
from types import ModuleType
from typing import Any, cast

_KIND = "forkserver" if sys.platform == "linux" else "spawn"  # never forked from this one: it has threads and state
_ordinary: Any = multiprocessing.get_context(_KIND)


class Child(_ordinary.Process):  # type: ignore[misc]
    """A child process.

    Children normally import the script that started everything, so a script without `if __name__ == "__main__":` would
    run the evaluation again in each of them. Nothing a child needs lives in that script, so it is kept out of sight.
    """

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802 - the name that multiprocessing looks for
        with _script_out_of_sight():
            return _ordinary.Process._Popen(process_obj)


class _Context(type(_ordinary)):  # type: ignore[misc]
    Process = Child


def child_context() -> BaseContext:
    """Where process pools get their children from."""
    context = _Context()
    if _KIND == "forkserver":
        context.set_forkserver_preload(["sumo_eval.batch.worker"])
    return cast("BaseContext", context)


@contextmanager
def _script_out_of_sight() -> Iterator[None]:
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
