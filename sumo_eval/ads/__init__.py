"""Controllers that ship, one rule a file, and the parts that they are made of.

Nothing here imports a simulator: a rule sees records of vehicles.
"""

from importlib import import_module
from typing import Any

_HOMES = {
    "IdealBraking": "known_answers",
    "Idm": "car_following",
    "IdmParameters": "car_following",
    "LaneChanger": "lane_changer",
    "no_reaction": "known_answers",
}


def __getattr__(name: str) -> Any:
    """Import on first use: who asks for one rule loads no other."""
    if name in _HOMES:
        return getattr(import_module(f"sumo_eval.ads.{_HOMES[name]}"), name)
    raise AttributeError(f"module `sumo_eval.ads` has no attribute `{name}`")
