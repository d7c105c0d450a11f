"""A program of its own that drives the ego as a TraCI client: `traci:python traci_client.py`."""

import os

import traci

traci.init(int(os.environ["SUMO_EVAL_PORT"]))
traci.setOrder(2)
try:
    while True:
        traci.simulationStep()
        speed = traci.vehicle.getSpeed("ego")
        leader = traci.vehicle.getLeader("ego", 200.0)
        if leader and leader[0] and speed - traci.vehicle.getSpeed(leader[0]) > 0.1 and leader[1] < 3.0 * speed:
            traci.vehicle.setSpeed("ego", max(speed - 0.3, 0.0))
except traci.FatalTraCIError:
    pass  # the case is over
