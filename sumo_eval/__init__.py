"""Scores any automated driving system over the whole parameter space of a logical scenario, in
simulation with SUMO.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sumo_eval.first_use import first_use

if TYPE_CHECKING:
    from sumo_eval.cosim.plans import Plan
    from sumo_eval.cosim.vehicle_model import Command
    from sumo_eval.evaluation import evaluate, score
    from sumo_eval.record.exchange import open_run
    from sumo_eval.trajectory import Trajectory

__all__ = ["Command", "Plan", "Trajectory", "evaluate", "open_run", "score"]

_HOMES = {
    "Command": "sumo_eval.cosim.vehicle_model",
    "Plan": "sumo_eval.cosim.plans",
    "Trajectory": "sumo_eval.trajectory",
    "evaluate": "sumo_eval.evaluation",
    "open_run": "sumo_eval.record.exchange",
    "score": "sumo_eval.evaluation",
}
_import_name = first_use("sumo_eval", _HOMES)


def __getattr__(name: str) -> Any:
    """A name of `__all__`, imported on first use: `import sumo_eval` alone loads none of them."""
    if name == "__version__":
        from importlib.metadata import version

        return version("sumo_eval")
    return _import_name(name)
