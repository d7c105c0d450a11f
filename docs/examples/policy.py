"""A policy object as reinforcement learning leaves it: `act(observation)` -> array of actions."""

import numpy as np


class LinearPolicy:
    """One layer of weights on (gap error, relative speed), squashed into -6..2 m/s2."""

    weights = np.array([0.08, 0.5])

    def act(self, seen):
        if seen.lead is None:
            return np.zeros(1)
        features = np.array([seen.lead.gap - 3.0 - 1.5 * seen.ego.speed, seen.lead.relative_speed])
        return np.array(
            [4.0 * np.tanh(self.weights @ features) - 2.0 if features[0] < 40.0 else 0.0]
        )
