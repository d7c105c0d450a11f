"""Makes a program of `traci:` import the stand-ins beside this file, even if it puts the folder of
SUMO's tools first on its path, as scripts do.

Python runs this file when it starts, instead of another `sitecustomize`, which this file then runs.
It runs in users' programs, without this package.
"""

import os
import sys
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from typing import Any

HERE = os.path.dirname(os.path.abspath(__file__))
# the usual finders must find the library, not the stand-ins or this file again
sys.path[:] = [folder for folder in sys.path if os.path.abspath(folder) != HERE]


class StandIns(PathFinder):
    """Finder of `traci`, once, and of `libsumo`."""

    @classmethod
    def find_spec(cls, fullname: str, *_: Any) -> Any:
        """Find a stand-in; `traci` itself then finds the library by the usual finders."""
        if fullname == "traci":
            sys.meta_path.remove(cls)
        return super().find_spec(fullname, [HERE]) if fullname in ("traci", "libsumo") else None


sys.meta_path.insert(0, StandIns)
if usual := PathFinder.find_spec("sitecustomize"):
    usual.loader.exec_module(module_from_spec(usual))  # type: ignore[union-attr]
