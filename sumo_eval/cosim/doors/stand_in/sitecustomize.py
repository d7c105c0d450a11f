"""Makes a program of `traci:` import the stand-ins beside this file, even one that puts the folder
of SUMO's tools first on its path, as scripts do.

Python runs this file as it starts, in place of another `sitecustomize`, which is run as well.
"""

import os
import sys
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from typing import Any

HERE = os.path.dirname(os.path.abspath(__file__))
# the usual finders must not find the stand-ins, or this file, again
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
