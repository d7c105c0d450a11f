"""Controllers that ship: `idm`, `lane_changer`, `ideal_braking`, `no_reaction`, and the parts that
they are made of.

Nothing here imports a simulator: a controller gets the running TraCI module from the harness.
"""

from sumo_eval.ads.car_following import Idm, IdmParameters
from sumo_eval.ads.known_answers import IdealBraking, no_reaction
from sumo_eval.ads.lane_changer import LaneChanger

__all__ = ["IdealBraking", "Idm", "IdmParameters", "LaneChanger", "no_reaction"]
