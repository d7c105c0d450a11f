"""Scores any automated driving system over the whole parameter space of a logical scenario, in
simulation with SUMO.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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


def __getattr__(name: str) -> Any:
    """Import on first use: `import sumo_eval` and `sumo-eval --help` cost nothing."""
    if name == "__version__":
        from importlib.metadata import version

        return version("sumo_eval")
    if name in _HOMES:
        import importlib

        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module `sumo_eval` has no attribute `{name}`")
