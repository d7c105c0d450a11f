"""Controllers that ship, one rule a file, and the parts that they are made of.

Nothing here imports a simulator: a rule sees records of vehicles.

The names in `_HOMES` are public: users import them from here. A name is imported at its first use.
"""

from sumo_eval.first_use import first_use

_HOMES = {
    "IdealBraking": "sumo_eval.ads.known_answers",
    "Idm": "sumo_eval.ads.car_following",
    "IdmParameters": "sumo_eval.ads.car_following",
    "LaneChanger": "sumo_eval.ads.lane_changer",
    "no_reaction": "sumo_eval.ads.known_answers",
}

__getattr__ = first_use("sumo_eval.ads", _HOMES)
