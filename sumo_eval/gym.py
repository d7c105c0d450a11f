"""`import sumo_eval.gym`: the name that users' code has for `sumo_eval.extras.gym`.

The only file of the core that names `extras`.
"""

import sys

from sumo_eval.extras import gym

sys.modules[__name__] = gym
