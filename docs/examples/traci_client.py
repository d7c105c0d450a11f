"""A program of its own that drives the ego as a TraCI client: `traci:python traci_client.py`."""

import traci

traci.start(["sumo", "-c", "my_own.sumocfg"])  # in an evaluation this connects to the case
while True:
    traci.simulationStep()
    speed = traci.vehicle.getSpeed("ego")
    leader = traci.vehicle.getLeader("ego", 200.0)
    if (
        leader
        and leader[0]
        and speed - traci.vehicle.getSpeed(leader[0]) > 0.1
        and leader[1] < 3.0 * speed
    ):
        traci.vehicle.setSpeed("ego", max(speed - 0.3, 0.0))
