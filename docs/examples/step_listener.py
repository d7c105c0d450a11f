"""A TraCI step listener, as a script with `traci.addStepListener` would have it.

It knows nothing of sumo_eval.
"""

import traci


class KeepDistance(traci.StepListener):
    """Slows down 0.3 m/s a step (6 m/s2) while the lead is less than 3 s away."""

    def step(self, t=0):
        speed = traci.vehicle.getSpeed("ego")
        leader = traci.vehicle.getLeader("ego", 200.0)
        if (
            leader
            and leader[0]
            and speed - traci.vehicle.getSpeed(leader[0]) > 0.1
            and leader[1] < 3.0 * speed
        ):
            traci.vehicle.setSpeed("ego", max(speed - 0.3, 0.0))
        return True  # stay
